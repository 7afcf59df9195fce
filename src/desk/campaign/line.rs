//! One flight of a campaign, as its document tells it.

use serde::{Deserialize, Serialize};

use crate::desk::simulation::{Excused, Flown, Hindsight};
use crate::role::PerVehicle;

use super::coverage::Counts;

/// How a flight ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ending {
    /// Every slot flown by both, landed.
    Completed,
    /// Not so.
    Aborted,
}

/// A violation, with the seed that replays it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViolationLine {
    /// Its number, such as `S1`.
    pub invariant: String,
    /// Of the flight.
    pub seed: u64,
    /// Flight time, seconds.
    pub at_s: f64,
    /// For how long, seconds; of unprotected emission the time that nothing excuses.
    pub duration_s: f64,
    /// What was seen.
    pub detail: String,
}

/// A break of an invariant that no companion could have kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ExcusedLine {
    /// Its number, such as `S1`.
    pub invariant: String,
    /// Of the flight.
    pub seed: u64,
    /// Why, by its kind: one of the names of [`veilwing_sitl::Cause`].
    pub cause: String,
    /// For how long, seconds.
    pub duration_s: f64,
    /// Flight time, seconds.
    pub at_s: f64,
    /// What was seen.
    pub detail: String,
}

/// A fault that came about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FaultLine {
    /// Flight time, seconds.
    pub at_s: f64,
    /// As the fault file spells it.
    pub kind: String,
    /// To whom, how much, how long.
    pub detail: String,
}

/// What a flight achieved for one user, over all its slots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UserLine {
    /// The user.
    pub user: String,
    /// The plan's expectation.
    pub planned_secrecy_rate_bps: f64,
    /// Mean over the time in which I radiated for this user.
    pub achieved_secrecy_rate_bps: f64,
}

/// What following those that move gave, over the time in which I radiated in slots of the plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FollowingLine {
    /// Mean rates of the pair that flew; of one that knows all tracks beforehand and begins each slot as that did; of one that begins it
    /// where it is best; and of one that stays where the plan has it.
    pub achieved_secrecy_rate_bps: f64,
    /// See `achieved_secrecy_rate_bps`.
    pub knowing_secrecy_rate_bps: f64,
    /// See `achieved_secrecy_rate_bps`.
    pub best_secrecy_rate_bps: f64,
    /// See `achieved_secrecy_rate_bps`.
    pub staying_secrecy_rate_bps: f64,
    /// Motions that I asked for.
    pub motions_asked: u64,
    /// Of those that both took up: from I's first word of it until J said that it flies it, seconds.
    pub agreements_s: Vec<f64>,
}

impl FollowingLine {
    /// Of a flight in which I radiated, where that was looked at.
    #[must_use]
    pub fn of(flown: &Flown) -> Option<Self> {
        let (slots, agreements) = flown.followed.as_ref()?;
        let on_air_s = |of: &Hindsight| flown.report.slots[of.slot].radiated_s.i;
        let sum_s: f64 = slots.iter().map(on_air_s).sum();
        let mean = |rate: &dyn Fn(&Hindsight) -> f64| {
            slots.iter().map(|of| on_air_s(of) * rate(of)).sum::<f64>() / sum_s
        };
        (sum_s > 0.0).then(|| Self {
            achieved_secrecy_rate_bps: mean(&|of| flown.report.slots[of.slot].achieved_secrecy_rate_bps),
            knowing_secrecy_rate_bps: mean(&|of| of.knowing_bps),
            best_secrecy_rate_bps: mean(&|of| of.best_bps),
            staying_secrecy_rate_bps: mean(&|of| of.staying_bps),
            motions_asked: agreements.asked as u64,
            agreements_s: agreements.took_s.clone(),
        })
    }
}

/// One flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlightLine {
    /// Its number in the campaign, from 0.
    pub run: u64,
    /// Replays it.
    pub seed: u64,
    /// How it ended.
    pub result: Ending,
    /// Its length, seconds.
    pub simulated_s: f64,
    /// Over the time in which I radiated; `null` if it never did.
    pub achieved_over_planned: Option<f64>,
    /// Secret bits delivered, and the seconds in which I radiated for them.
    #[serde(default)]
    pub secrecy_volume_bits: f64,
    /// See `secrecy_volume_bits`.
    #[serde(default)]
    pub on_air_s: f64,
    /// Where the link has imperfections that are drawn once a flight, what they left to each user who was served.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub users: Vec<UserLine>,
    /// I on without J on at its planned power and in its pose, seconds, whatever the cause.
    pub unprotected_s: f64,
    /// Either vehicle on out of its pose, or in no slot, seconds, whatever the cause.
    pub emitted_out_of_pose_s: f64,
    /// Charge with which each vehicle came to the end, of 1, as it truly is.
    #[serde(default)]
    pub battery_left: Option<PerVehicle<f64>>,
    /// Where users or eavesdroppers move, of a flight in which nothing went wrong.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub following: Option<FollowingLine>,
    /// Faults that came about.
    pub faults: Vec<FaultLine>,
    /// How often each kind of state, news and refusal was reached.
    pub coverage: Counts,
    /// Violations that count.
    pub violations: Vec<ViolationLine>,
    /// What no companion could have kept.
    pub excused: Vec<ExcusedLine>,
}

impl FlightLine {
    /// The line of a flight that was flown.
    #[must_use]
    pub fn new(run: u64, seed: u64, flown: &Flown, coverage: Counts) -> Self {
        let line = |v: &veilwing_sitl::Violation| ViolationLine {
            invariant: v.invariant().name().to_owned(),
            seed,
            at_s: v.at.as_secs_f64(),
            duration_s: v.lasted.as_secs_f64(),
            detail: v.to_string(),
        };
        let excused = |excused: &Excused| ExcusedLine {
            invariant: excused.violation.invariant().name().to_owned(),
            seed,
            cause: excused.cause.name().to_owned(),
            duration_s: excused.violation.lasted.as_secs_f64(),
            at_s: excused.violation.at.as_secs_f64(),
            detail: excused.violation.to_string(),
        };
        let battery = flown.report.battery_left;
        let out_of_pose = flown.report.emitted_out_of_pose_s;
        let faults = flown.faults.iter().map(|(at, fault)| FaultLine {
            at_s: at.as_secs_f64(),
            kind: fault.kind.name().to_owned(),
            detail: fault.describe(),
        });
        Self {
            run,
            seed,
            result: if flown.completed() { Ending::Completed } else { Ending::Aborted },
            simulated_s: flown.report.flight_s,
            achieved_over_planned: flown.achieved_over_planned(),
            secrecy_volume_bits: flown.report.secrecy_volume_bits,
            on_air_s: flown.report.on_air_s,
            users: if flown.world.config().has_ideal_link() { Vec::new() } else { users(flown) },
            unprotected_s: flown.report.unprotected_s,
            emitted_out_of_pose_s: out_of_pose.i + out_of_pose.j,
            battery_left: Some(PerVehicle { i: battery.i, j: battery.j }),
            following: FollowingLine::of(flown),
            faults: faults.collect(),
            coverage,
            violations: flown.report.violations.iter().map(line).collect(),
            excused: flown.excused.iter().map(excused).collect(),
        }
    }
}

/// What the flight achieved for each user whom I radiated for, in the order in which they were served.
fn users(flown: &Flown) -> Vec<UserLine> {
    let mut found: Vec<(UserLine, f64)> = Vec::new();
    for slot in flown.report.slots.iter().filter(|slot| slot.radiated_s.i > 0.0) {
        let line = UserLine {
            user: slot.user.clone(),
            planned_secrecy_rate_bps: slot.planned_secrecy_rate_bps,
            achieved_secrecy_rate_bps: slot.achieved_secrecy_rate_bps,
        };
        match found.iter_mut().find(|(known, _)| known.user == line.user) {
            None => found.push((line, slot.radiated_s.i)),
            Some((known, on_air_s)) => {
                let both_s = *on_air_s + slot.radiated_s.i;
                let part = slot.radiated_s.i / both_s;
                known.achieved_secrecy_rate_bps +=
                    part * (line.achieved_secrecy_rate_bps - known.achieved_secrecy_rate_bps);
                *on_air_s = both_s;
            }
        }
    }
    found.into_iter().map(|(line, _)| line).collect()
}
