//! The campaign document (`veilwing-campaign/1`): one line a flight (`line`), and the totals made from the lines.
//!
//! The totals are a function of the lines in the order of their numbers, so that neither threads nor shards change a
//! bit of them, and any documents of one campaign can be merged.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};

use crate::config::BatteryDraft;
use crate::desk::simulation::FaultKind;

use super::Quantile;
use super::coverage::{self, Counts};
use super::line::{Ending, ExcusedLine, FlightLine, FollowingLine, UserLine, ViolationLine};

/// The document's format.
pub const FORMAT: &str = "veilwing-campaign/1";

/// What two documents must have in common to be parts of one campaign.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The mission's name.
    pub mission: String,
    /// SHA-256 of its meaning, hexadecimal.
    pub mission_digest: String,
    /// SHA-256 of poses and powers, hexadecimal.
    pub plan_digest: String,
    /// How both vehicles are commanded, if not as their airframes ask for.
    pub actuation: Option<String>,
    /// Of the fault file in canonical form; absent without one.
    pub faults_digest: Option<String>,
    /// Of the tracks of those that move; absent where they wander.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracks_digest: Option<String>,
    /// Of flight 0; flight k has this plus k.
    pub seed: u64,
    /// Flights of the whole campaign.
    pub campaign_runs: u64,
}

/// Mean over flights and its standard error; `null` where there are too few.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Mean {
    /// The mean.
    pub mean: Option<f64>,
    /// Its standard error.
    pub standard_error: Option<f64>,
    /// Flights in which I radiated.
    pub flights: u64,
    /// What 95% of the flights exceed, where the link has imperfections that are drawn once a flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quantile_5pct: Option<Quantile>,
}

impl Mean {
    fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        Self {
            mean: (n > 0.0).then_some(mean),
            standard_error: (n > 1.0).then(|| (squares / (n - 1.0) / n).sqrt()),
            flights: values.len() as u64,
            quantile_5pct: None,
        }
    }

    /// The same with the 5% quantile.
    fn with_quantile(values: &[f64]) -> Self {
        Self { quantile_5pct: Quantile::of(values, 0.05), ..Self::of(values) }
    }
}

/// What the flights achieved for one user.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UserTotal {
    /// The user.
    pub user: String,
    /// The plan's expectation.
    pub planned_secrecy_rate_bps: f64,
    /// Over the flights in which the user was served.
    pub achieved_secrecy_rate_bps: Mean,
}

impl UserTotal {
    /// Of all users, in the order in which they come up.
    fn all(flights: &[FlightLine]) -> Vec<Self> {
        let mut found: Vec<(&UserLine, Vec<f64>)> = Vec::new();
        for line in flights.iter().flat_map(|flight| &flight.users) {
            match found.iter_mut().find(|(known, _)| known.user == line.user) {
                None => found.push((line, vec![line.achieved_secrecy_rate_bps])),
                Some((_, rates)) => rates.push(line.achieved_secrecy_rate_bps),
            }
        }
        let total = |(line, rates): (&UserLine, Vec<f64>)| Self {
            user: line.user.clone(),
            planned_secrecy_rate_bps: line.planned_secrecy_rate_bps,
            achieved_secrecy_rate_bps: Mean::with_quantile(&rates),
        };
        found.into_iter().map(total).collect()
    }
}

/// What following those that move gave, over the flights in which I radiated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FollowingTotal {
    /// What was lost to a pair that knows all tracks beforehand and begins each slot as this one did, of 1.
    pub lost: Mean,
    /// To one that begins each slot where it is best.
    pub lost_to_best: Mean,
    /// What one loses to that which stays where the plan has it.
    pub lost_by_staying: Mean,
    /// Motions that I asked for, and of them those that both took up.
    pub motions_asked: u64,
    /// See `motions_asked`.
    pub motions_taken_up: u64,
    /// From I's first word of a motion until J said that it flies it, seconds: median, what 99% keep, the longest.
    pub agreement_s: Option<[f64; 3]>,
}

impl FollowingTotal {
    /// Of the flights that have something to say of it; `None` of none.
    #[must_use]
    pub fn of<'a>(lines: impl IntoIterator<Item = &'a FollowingLine>) -> Option<Self> {
        let lines: Vec<_> = lines.into_iter().collect();
        let lost = |had: fn(&FollowingLine) -> f64, of: fn(&FollowingLine) -> f64| {
            let worth = lines.iter().filter(|line| of(line) > 0.0);
            Mean::of(&worth.map(|line| 1.0 - had(line) / of(line)).collect::<Vec<_>>())
        };
        let took: Vec<f64> = lines.iter().flat_map(|line| line.agreements_s.iter().copied()).collect();
        let quantile = |share| Quantile::of(&took, share).map(|quantile| quantile.value);
        (!lines.is_empty()).then(|| Self {
            lost: lost(|line| line.achieved_secrecy_rate_bps, |line| line.knowing_secrecy_rate_bps),
            lost_to_best: lost(|line| line.achieved_secrecy_rate_bps, |line| line.best_secrecy_rate_bps),
            lost_by_staying: lost(|line| line.staying_secrecy_rate_bps, |line| line.best_secrecy_rate_bps),
            motions_asked: lines.iter().map(|line| line.motions_asked).sum(),
            motions_taken_up: took.len() as u64,
            agreement_s: match [0.5, 0.99, 1.0].map(quantile) {
                [Some(median), Some(most), Some(longest)] => Some([median, most, longest]),
                _ => None,
            },
        })
    }
}

/// Faults that take charge which no companion knows of in time: gone at once, or not said.
const TAKE_CHARGE: [FaultKind; 2] = [FaultKind::BatteryLow, FaultKind::BatteryLies];

/// A time that should be nothing, over flights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Of all flights, seconds.
    pub total: f64,
    /// Of the worst flight, seconds.
    pub worst: f64,
    /// Of that flight, the first of several; `null` if it is nothing in all.
    pub seed: Option<u64>,
}

impl Exposure {
    fn of(flights: &[FlightLine], time_s: fn(&FlightLine) -> f64) -> Self {
        let mut exposure = Self { total: 0.0, worst: 0.0, seed: None };
        for flight in flights {
            let time_s = time_s(flight);
            exposure.total += time_s;
            if time_s > exposure.worst {
                (exposure.worst, exposure.seed) = (time_s, Some(flight.seed));
            }
        }
        exposure
    }
}

/// The document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CampaignDocument {
    /// [`FORMAT`].
    pub format: String,
    /// Which campaign.
    #[serde(flatten)]
    pub identity: Identity,
    /// `I/K` of a part.
    pub shard: Option<String>,
    /// Every flight that was asked for is there; not so after Ctrl-C.
    pub complete: bool,
    /// Flights in this document.
    pub runs: u64,
    /// Of them completed.
    pub completed: u64,
    /// Of them not completed, and nothing was violated.
    pub aborted_safely: u64,
    /// Violations that count, of all flights.
    pub violations: Vec<ViolationLine>,
    /// What no companion could have kept, of all flights, with the cause of each.
    pub excused: Vec<ExcusedLine>,
    /// I on without J on at its planned power and in its pose, whatever the cause, seconds.
    pub unprotected_s: Exposure,
    /// Either vehicle on out of its pose, or in no slot, whatever the cause, seconds.
    pub emitted_out_of_pose_s: Exposure,
    /// Of all flights, seconds.
    pub simulated_s: f64,
    /// Of planning and flying; summed over merged parts.
    pub wall_s: f64,
    /// Processor time of all flights.
    pub cpu_s: f64,
    /// Achieved over planned secrecy rate.
    pub achieved_over_planned: Mean,
    /// Where the link has imperfections that are drawn once a flight, what they left to each user.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub users: Vec<UserTotal>,
    /// Where users or eavesdroppers move.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub following: Option<FollowingTotal>,
    /// How often each kind of fault came about.
    pub faults: BTreeMap<String, u64>,
    /// How often the companions came to each of their kinds of state, news and refusal, those never reached included.
    pub coverage: Counts,
    /// In the order of their numbers.
    pub flights: Vec<FlightLine>,
}

/// What the flights took.
#[derive(Debug, Clone, Copy, Default)]
pub struct Times {
    /// Of planning and flying, seconds.
    pub wall_s: f64,
    /// Processor time of all flights, seconds.
    pub cpu_s: f64,
}

impl CampaignDocument {
    /// The totals of these flights, which may come in any order.
    #[must_use]
    pub fn new(
        identity: Identity,
        shard: Option<String>,
        complete: bool,
        mut flights: Vec<FlightLine>,
        times: Times,
    ) -> Self {
        flights.sort_by_key(|flight| flight.run);
        let mut faults = BTreeMap::new();
        for fault in flights.iter().flat_map(|flight| &flight.faults) {
            *faults.entry(fault.kind.clone()).or_default() += 1;
        }
        let mut coverage = coverage::nothing();
        flights.iter().for_each(|flight| coverage::add(&mut coverage, &flight.coverage));
        let ratios: Vec<f64> = flights.iter().filter_map(|flight| flight.achieved_over_planned).collect();
        let ideal = flights.iter().all(|flight| flight.users.is_empty());
        let count = |wanted: fn(&FlightLine) -> bool| flights.iter().filter(|f| wanted(f)).count() as u64;
        Self {
            format: FORMAT.to_owned(),
            identity,
            shard,
            complete,
            runs: flights.len() as u64,
            completed: count(|f| f.result == Ending::Completed),
            aborted_safely: count(|f| f.result == Ending::Aborted && f.violations.is_empty()),
            violations: flights.iter().flat_map(|f| f.violations.clone()).collect(),
            excused: flights.iter().flat_map(|f| f.excused.clone()).collect(),
            unprotected_s: Exposure::of(&flights, |flight| flight.unprotected_s),
            emitted_out_of_pose_s: Exposure::of(&flights, |flight| flight.emitted_out_of_pose_s),
            simulated_s: flights.iter().map(|f| f.simulated_s).sum(),
            wall_s: times.wall_s,
            cpu_s: times.cpu_s,
            achieved_over_planned: if ideal { Mean::of(&ratios) } else { Mean::with_quantile(&ratios) },
            users: UserTotal::all(&flights),
            following: FollowingTotal::of(flights.iter().filter_map(|flight| flight.following.as_ref())),
            faults,
            coverage,
            flights,
        }
    }

    /// The campaign for a reader; in `replay`, the command that flies one flight again, SEED stands for its seed.
    #[must_use]
    pub fn table(&self, replay: &str) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        let _ = self.write_table(&mut text, replay);
        text
    }

    fn write_table(&self, text: &mut String, replay: &str) -> std::fmt::Result {
        let Identity { mission, seed, campaign_runs, .. } = &self.identity;
        let part = self.shard.as_ref().map_or(String::new(), |shard| format!(", part {shard}"));
        let last = seed.wrapping_add(campaign_runs.saturating_sub(1));
        writeln!(text, "campaign of {campaign_runs} flights of {mission}{part}, seeds {seed} to {last}")?;
        if !self.complete {
            writeln!(text, "incomplete: not all of them were flown")?;
        }
        let violated = self.flights.iter().filter(|flight| !flight.violations.is_empty()).count();
        writeln!(
            text,
            "{} flights: {} completed, {} aborted safely, {violated} with violations ({} in all)",
            self.runs,
            self.completed,
            self.aborted_safely,
            self.violations.len()
        )?;
        for (kind, count) in &self.faults {
            writeln!(text, "  {kind:<28} {count:>7}")?;
        }
        if let (Some(mean), Some(error)) =
            (self.achieved_over_planned.mean, self.achieved_over_planned.standard_error)
        {
            let flights = self.achieved_over_planned.flights;
            writeln!(
                text,
                "achieved over planned secrecy rate: {mean:.5} +- {error:.5} (standard error over {flights} flights)"
            )?;
        }
        self.write_users(text)?;
        self.write_following(text)?;
        for violation in &self.violations {
            let ViolationLine { invariant, seed, at_s, duration_s, detail } = violation;
            writeln!(
                text,
                "VIOLATION {invariant} at {at_s:.3} s of seed {seed}, for {duration_s:.3} s: {detail}"
            )?;
        }
        let replay = |seed: u64| replay.replace("SEED", &seed.to_string());
        if let Some(first) = self.violations.first() {
            writeln!(text, "replay: {}", replay(first.seed))?;
        }
        for (what, exposure) in
            [("unprotected", self.unprotected_s), ("on the air out of pose", self.emitted_out_of_pose_s)]
        {
            write!(text, "{what}: {:.3} s in all", exposure.total)?;
            match exposure.seed {
                None => writeln!(text)?,
                Some(seed) => writeln!(
                    text,
                    ", {:.3} s at worst, in seed {seed}\n  replay: {}",
                    exposure.worst,
                    replay(seed)
                )?,
            }
        }
        self.write_excused(text)?;
        self.write_batteries(text, replay)?;
        writeln!(
            text,
            "{:.0} s simulated in {:.1} s of wall time: {:.0} times real time, {:.0} times per core",
            self.simulated_s,
            self.wall_s,
            self.simulated_s / self.wall_s,
            self.simulated_s / self.cpu_s
        )
    }

    /// What 95% of the flights exceed, where that differs from flight to flight by what is stated of the link.
    fn write_users(&self, text: &mut String) -> std::fmt::Result {
        if let Some(Quantile { value, standard_error }) = self.achieved_over_planned.quantile_5pct {
            let error = standard_error.map_or_else(String::new, |error| format!(" +- {error:.5}"));
            writeln!(text, "  exceeded in 95% of the flights: {value:.5}{error}")?;
        }
        for UserTotal { user, planned_secrecy_rate_bps, achieved_secrecy_rate_bps } in &self.users {
            let Mean { mean, quantile_5pct, .. } = achieved_secrecy_rate_bps;
            let (Some(mean), Some(quantile)) = (mean, quantile_5pct) else { continue };
            writeln!(
                text,
                "  {user:<16} {mean:.4e} bit/s of {planned_secrecy_rate_bps:.4e} planned; {:.4e} in 95%",
                quantile.value
            )?;
        }
        Ok(())
    }

    fn write_following(&self, text: &mut String) -> std::fmt::Result {
        let Some(total) = &self.following else { return Ok(()) };
        let of = [
            ("lost to who knows all tracks", &total.lost),
            ("  and begins each slot where it is best", &total.lost_to_best),
            ("  by who stays where the plan has it", &total.lost_by_staying),
        ];
        for (what, lost) in of {
            if let (Some(mean), Some(error)) = (lost.mean, lost.standard_error) {
                writeln!(text, "{what}: {:.2} +- {:.2}%", 100.0 * mean, 100.0 * error)?;
            }
        }
        write!(
            text,
            "motions: {} asked for, {} taken up by both",
            total.motions_asked, total.motions_taken_up
        )?;
        match total.agreement_s {
            Some([median, most, longest]) => writeln!(
                text,
                ", after {median:.3} s in the median, {most:.3} s in 99 of 100, {longest:.3} s at most"
            ),
            None => writeln!(text),
        }
    }

    /// The flights that ended with less than the reserve, by the fault that took it; and one by one where there
    /// was none that takes charge unseen.
    fn write_batteries(&self, text: &mut String, replay: impl Fn(u64) -> String) -> std::fmt::Result {
        let reserve = BatteryDraft::default().reserve;
        let mut below: BTreeMap<&str, u64> = BTreeMap::new();
        let mut unexplained = Vec::new();
        for flight in &self.flights {
            let Some(left) =
                flight.battery_left.map(|left| left.i.min(left.j)).filter(|left| *left < reserve)
            else {
                continue;
            };
            let named = TAKE_CHARGE.map(FaultKind::name);
            let fault =
                flight.faults.iter().find_map(|fault| named.into_iter().find(|name| *name == fault.kind));
            *below.entry(fault.unwrap_or("otherwise")).or_default() += 1;
            if fault.is_none() {
                unexplained.push((left, flight.seed));
            }
        }
        write!(
            text,
            "ended with less than {:.0}% in a battery: {}",
            reserve * 100.0,
            below.values().sum::<u64>()
        )?;
        let worded: Vec<_> = below.iter().map(|(fault, count)| format!("{fault} {count}")).collect();
        writeln!(
            text,
            "{}",
            if worded.is_empty() { String::new() } else { format!(" ({})", worded.join(", ")) }
        )?;
        for (left, seed) in unexplained {
            writeln!(text, "  {:.1}% in seed {seed}\n  replay: {}", left * 100.0, replay(seed))?;
        }
        Ok(())
    }

    /// What no companion could have kept, by cause and invariant.
    fn write_excused(&self, text: &mut String) -> std::fmt::Result {
        let mut sums: BTreeMap<_, (u64, f64, f64)> = BTreeMap::new();
        for excused in &self.excused {
            let (times, total_s, worst_s) = sums.entry((&*excused.cause, &*excused.invariant)).or_default();
            *times += 1;
            *total_s += excused.duration_s;
            *worst_s = worst_s.max(excused.duration_s);
        }
        for ((cause, invariant), (times, total_s, worst_s)) in sums {
            writeln!(
                text,
                "excused: {cause:<20} {invariant} {times:>7} times, {total_s:.3} s in all, {worst_s:.3} s at worst"
            )?;
        }
        Ok(())
    }
}
