//! Slots in which the vehicles turn while they radiate: what the plan has them do, by the time since the slot opened. Before its
//! user is served they are to have the attitudes with which that begins, afterwards those with which it ends: what they turn in
//! between is nobody's business while they are silent, and no excuse for a jammer that is on.
//!
//! The world hears when a slot is proposed to open, and what I's companion says of its clock, and reckons by itself when those that carry
//! it on do.

use std::time::Duration;

use nalgebra::Vector3;

use super::config::{PlannedSlot, Reference};
use crate::frames::Euler;

/// A power command that lowers the power may be under way for so long: none is carried out later.
pub(super) const LOWERED: Duration = Duration::from_millis(650);
const LOWERED_S: f64 = LOWERED.as_secs_f64();
/// One that raises it is given so much ahead at most, seconds.
const AHEAD_S: f64 = 0.35;

/// From one place to the next of a vehicle that moves, in seconds: in between it goes straight, which is off by 2 mm at 2 m/s^2.
pub const PLACES_S: f64 = 0.1;

/// An instant of a vehicle's turning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedKnot {
    /// Seconds since the slot's opening.
    pub at_s: f64,
    /// Roll, pitch and yaw in radians, as in [`PlannedPose`](super::config::PlannedPose).
    pub angles_rad: [f64; 3],
    /// Watts from here to the next knot.
    pub tx_power_w: f64,
}

/// A slot that is served through its turns.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedTurns {
    /// From the close of the slot before to this one's opening, where it carries that one on; seconds.
    pub carries_on_after_s: Option<f64>,
    /// The slot's length in seconds.
    pub length_s: f64,
    /// I's and J's knots while the user is served, at least two each, in the order of time.
    pub knots: [Vec<PlannedKnot>; 2],
    /// Where I and J are, every [`PLACES_S`] seconds from the slot's opening to its close, metres, if they move.
    pub places_enu_m: [Vec<[f64; 3]>; 2],
}

/// When the slots open, as far as that is known.
#[derive(Debug, Clone, Default)]
pub(crate) struct Openings {
    by_slot: Vec<Option<Duration>>,
    /// UTC by I's companion, and when it said so. By that clock slots open; it is behind its vehicle's by the link between them, which
    /// is nobody's loss: what counts is that both vehicles go by the same.
    clock: Option<(u64, Duration)>,
}

impl Openings {
    /// I's companion tells its UTC.
    pub fn hear_clock(&mut self, utc_us: u64, now: Duration) {
        self.clock = Some((utc_us, now));
    }

    /// When it is this UTC by that clock.
    pub fn time_of(&self, utc_us: u64) -> Option<Duration> {
        let (told_us, at) = self.clock?;
        let ahead = Duration::from_micros(utc_us.saturating_sub(told_us));
        Some((at + ahead).saturating_sub(Duration::from_micros(told_us.saturating_sub(utc_us))))
    }

    /// A slot is proposed to open at this instant: those that carry it on follow.
    pub fn propose(&mut self, slot: usize, at: Duration, slots: &[PlannedSlot]) {
        self.by_slot.resize(slots.len(), None);
        let mut opens_at = at;
        for number in slot..slots.len() {
            self.by_slot[number] = Some(opens_at);
            let next = slots.get(number + 1).and_then(|next| next.turns.as_ref()?.carries_on_after_s);
            let (Some(turns), Some(after_s)) = (&slots[number].turns, next) else { break };
            opens_at = opens_at.saturating_add(seconds(turns.length_s + after_s));
        }
    }

    /// What the plan has a vehicle do in a slot at an instant: on its way if the slot's opening is known, else as it is between two
    /// turns.
    pub fn reference(
        &self,
        slot: usize,
        turns: &PlannedTurns,
        standing: Reference,
        vehicle: usize,
        at: Duration,
    ) -> Reference {
        match self.by_slot.get(slot).copied().flatten() {
            Some(opens_at) => turns.reference(standing, vehicle, at.as_secs_f64() - opens_at.as_secs_f64()),
            None => standing,
        }
    }
}

impl PlannedTurns {
    fn reference(&self, standing: Reference, vehicle: usize, since_s: f64) -> Reference {
        let served = &self.knots[vehicle];
        let begun = served.partition_point(|knot| knot.at_s <= since_s);
        let angles = match (begun.checked_sub(1).map(|k| served[k]), served.get(begun)) {
            (Some(from), Some(to)) => {
                let share = (since_s - from.at_s) / (to.at_s - from.at_s);
                Some(
                    [0, 1, 2]
                        .map(|k: usize| from.angles_rad[k] + share * (to.angles_rad[k] - from.angles_rad[k])),
                )
            }
            (Some(only), None) => Some(only.angles_rad),
            (None, first) => first.map(|knot| knot.angles_rad),
        };
        let attitude = angles.map_or(standing.attitude, |[roll_rad, pitch_rad, yaw_rad]| {
            Euler { roll_rad, pitch_rad, yaw_rad }.rotation()
        });
        // Powers are those of the served part: its first before it, its last after it.
        let power_w = |at_s: f64| {
            let steps = &served[..served.len().saturating_sub(1)];
            let begun = steps.partition_point(|knot| knot.at_s <= at_s).max(1);
            steps.get(begun - 1).map_or(0.0, |knot| knot.tx_power_w)
        };
        let lately = served.iter().map(|knot| knot.at_s);
        let lately = lately.filter(|at_s| (since_s - LOWERED_S..since_s + AHEAD_S).contains(at_s));
        let most_w = lately
            .chain([since_s - LOWERED_S, since_s + AHEAD_S])
            .map(power_w)
            .fold(power_w(since_s), f64::max);
        let position = self.place(vehicle, since_s).unwrap_or(standing.position);
        Reference {
            position,
            attitude,
            euler: Euler::of(&attitude),
            power_w: power_w(since_s),
            most_w,
            ..standing
        }
    }

    /// Where a vehicle that moves is; before the opening and after the close, where it is then.
    fn place(&self, vehicle: usize, since_s: f64) -> Option<Vector3<f64>> {
        let places = &self.places_enu_m[vehicle];
        let last = places.len().checked_sub(1)?;
        let at = (since_s / PLACES_S).clamp(0.0, last as f64);
        let [from, to] = [at.floor(), at.ceil()].map(|k| Vector3::from(places[k as usize]));
        Some(from + (to - from) * (at - at.floor()))
    }
}

fn seconds(s: f64) -> Duration {
    Duration::try_from_secs_f64(s).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::config::PlannedPose;
    use super::*;

    fn slot(carries_on_after_s: Option<f64>) -> PlannedSlot {
        let pose = PlannedPose {
            position_enu_m: [0.0, 0.0, 30.0],
            roll_rad: 0.2,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
            tx_power_w: 0.1,
            lean_deg: 0.0,
        };
        let knot =
            |at_s, roll_rad, tx_power_w| PlannedKnot { at_s, angles_rad: [roll_rad, 0.0, 0.0], tx_power_w };
        let knots = vec![knot(0.5, 0.2, 0.1), knot(2.5, 0.4, 0.3), knot(4.5, 0.4, 0.0)];
        PlannedSlot {
            user: "alpha".into(),
            secrecy_rate_bps: 1e6,
            poses: [pose, pose],
            turns: Some(PlannedTurns {
                carries_on_after_s,
                length_s: 5.0,
                knots: [knots.clone(), knots],
                places_enu_m: [vec![], (0..=50).map(|k| [f64::from(k * k), 1.0, 30.0]).collect()],
            }),
        }
    }

    #[test]
    fn val_a_slot_opens_as_proposed_and_those_that_carry_it_on_after_it() {
        let slots = [slot(None), slot(Some(0.5)), slot(None)];
        let mut openings = Openings::default();
        let at = Duration::from_secs(20);
        let reference = |openings: &Openings, number: usize, s: f64| {
            let (turns, standing) =
                (slots[number].turns.as_ref().unwrap(), Reference::from(&slots[number].poses[1]));
            openings.reference(number, turns, standing, 1, Duration::from_secs_f64(s))
        };
        // Nothing is proposed: the pose that the plan has for the slot.
        assert_eq!(reference(&openings, 1, 23.0).attitude.euler_angles().0, 0.2);
        openings.propose(0, at, &slots);
        for (number, s, roll_rad, power_w) in [
            (0, 19.0, 0.2, 0.1),
            (0, 21.5, 0.3, 0.1),
            (0, 23.0, 0.4, 0.3),
            (0, 29.0, 0.4, 0.3),
            // 25.5 s: the next one.
            (1, 25.0, 0.2, 0.1),
            (1, 27.0, 0.3, 0.1),
            (1, 28.5, 0.4, 0.3),
        ] {
            let reference = reference(&openings, number, s);
            let axis = Vector3::x() * roll_rad;
            let off = (reference.attitude.scaled_axis() - axis).norm();
            assert!(off < 1e-9 && reference.power_w == power_w, "slot {number} at {s} s: {reference:?}");
        }
        // J moves, from place to place; I has none of its own.
        for (s, east_m) in
            [(19.0, 0.0), (20.0, 0.0), (21.0, 100.0), (21.05, 110.5), (25.0, 2500.0), (40.0, 2500.0)]
        {
            assert!((reference(&openings, 0, s).position - Vector3::new(east_m, 1.0, 30.0)).norm() < 1e-6);
        }
        let (turns, standing) = (slots[0].turns.as_ref().unwrap(), Reference::from(&slots[0].poses[0]));
        let own = openings.reference(0, turns, standing, 0, Duration::from_secs(22));
        assert_eq!(own.position, Vector3::new(0.0, 0.0, 30.0));
        openings.hear_clock(1_000_000_000, Duration::from_secs(20));
        assert_eq!(openings.time_of(1_005_500_000), Some(Duration::from_millis(25_500)));
        assert_eq!(openings.time_of(999_000_000), Some(Duration::from_secs(19)));
        // Of the third nothing is known: it is agreed on by itself.
        assert_eq!(reference(&openings, 2, 40.0).power_w, 0.1);
        // More, for as long as a power may be under way.
        let most_w = |s: f64| reference(&openings, 0, s).most_w;
        assert_eq!([22.0, 22.3, 23.0].map(most_w), [0.1, 0.3, 0.3]);
    }
}
