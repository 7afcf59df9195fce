//! What the bench says: one line for each thing that was measured, with its verdict, and what to do about it.

use std::collections::BTreeMap;

use serde::Serialize;

use super::figures::{Drift, RoundTrips, Samples};
use crate::computer::{Reading, Room};
use crate::preflight::{Check, Verdict};

/// One thing that was measured.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    /// What it is about.
    pub name: String,
    /// How it came out.
    #[serde(serialize_with = "word")]
    pub verdict: Verdict,
    /// What was seen.
    pub seen: String,
    /// What to do, where it is not as it should be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remedy: Option<String>,
    /// The numbers, by name and unit.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub figures: BTreeMap<&'static str, f64>,
}

fn word<S: serde::Serializer>(verdict: &Verdict, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(verdict)
}

impl Line {
    /// A line; its remedy counts where it does not pass.
    #[must_use]
    pub fn new(name: &str, verdict: Verdict, seen: String, remedy: &str) -> Self {
        let remedy = (verdict != Verdict::Pass).then(|| remedy.to_owned());
        Self { name: name.to_owned(), verdict, seen, remedy, figures: BTreeMap::new() }
    }

    fn with(mut self, figures: &[(&'static str, f64)]) -> Self {
        self.figures.extend(figures.iter().copied().filter(|(_, value)| value.is_finite()));
        self
    }
}

/// A preflight's check, whose detail says what should be.
impl From<Check> for Line {
    fn from(check: Check) -> Self {
        let Check { name, result, detail } = check;
        Self { name: name.to_owned(), verdict: result, seen: detail, remedy: None, figures: BTreeMap::new() }
    }
}

/// Pass up to the first limit, warn up to the second.
fn graded(value: f64, [warn, fail]: [f64; 2]) -> Verdict {
    // What is no number is no pass.
    if value <= warn {
        Verdict::Pass
    } else if value <= fail {
        Verdict::Warn
    } else {
        Verdict::Fail
    }
}

/// Round trips of a link, and what was lost: 250 ms is what state may be old when it is radiated on.
#[must_use]
pub fn round_trips(name: &str, trips: &RoundTrips, limits_ms: [f64; 2], remedy: &str) -> Vec<Line> {
    let loss_name = format!("{name} loss");
    let Some(loss) = trips.loss() else {
        return vec![Line::new(name, Verdict::Fail, "no question was answered".to_owned(), remedy)];
    };
    let asked = trips.times.count() as f64 + f64::from(trips.lost);
    let share = Line::new(
        &loss_name,
        graded(loss, [0.01, 0.1]),
        format!("{:.1}% of {asked} questions, both ways together", loss * 100.0),
        remedy,
    );
    let mut lines = Vec::new();
    if let Some([median, most_of, most]) = trips.times.quantiles() {
        let seen = format!("{median:.1} ms median, {most_of:.1} ms 99%, {most:.1} ms worst");
        let round_trip = Line::new(name, graded(median, limits_ms), seen, remedy);
        lines.push(round_trip.with(&[("median_ms", median), ("p99_ms", most_of), ("worst_ms", most)]));
    }
    lines.push(share.with(&[("loss", loss), ("asked", asked)]));
    lines
}

/// What a message should be, and how it came.
#[derive(Debug, Clone, Copy)]
pub struct Stream<'a> {
    /// Its name.
    pub name: &'a str,
    /// A second, as asked for.
    pub wanted_hz: f64,
    /// A second, as it came.
    pub rate_hz: f64,
    /// Between two.
    pub gaps: &'a Samples,
    /// Position or attitude: a gap that is longer than this, in milliseconds, silences the transmitter.
    pub silences_ms: Option<f64>,
}

/// How a message comes.
#[must_use]
pub fn stream(stream: &Stream<'_>) -> Line {
    let Stream { name, wanted_hz, rate_hz, gaps, silences_ms } = *stream;
    let [_, most_of, worst] = gaps.quantiles().unwrap_or([f64::NAN; 3]);
    let essential = silences_ms.is_some();
    let verdict = match rate_hz / wanted_hz {
        share if share >= 0.7 => Verdict::Pass,
        share if share >= 0.4 || !essential => Verdict::Warn,
        _ => Verdict::Fail,
    };
    // Each such gap is a silence: more than one in a hundred is no service.
    let silent = silences_ms.map_or(Verdict::Pass, |limit_ms| {
        if worst.is_nan() || worst <= limit_ms {
            Verdict::Pass
        } else if most_of <= limit_ms {
            Verdict::Warn
        } else {
            Verdict::Fail
        }
    });
    let mut seen = format!("{rate_hz:.1} of {wanted_hz:.0} Hz");
    if worst.is_finite() {
        seen.push_str(&format!(", longest gap {worst:.0} ms"));
    }
    let remedy = match (verdict, silences_ms) {
        (Verdict::Pass, Some(limit_ms)) => {
            format!(
                "a gap beyond {limit_ms:.0} ms silences this vehicle: look for loss on the link, and for load on this computer"
            )
        }
        _ => "raise the link's baud rate, or stop other streams on it; see docs/on-a-vehicle.md, Links"
            .to_owned(),
    };
    Line::new(name, verdict.max(silent), seen, &remedy).with(&[
        ("rate_hz", rate_hz),
        ("wanted_hz", wanted_hz),
        ("longest_gap_ms", worst),
    ])
}

/// How old position and attitude are when they are used, at the most.
#[must_use]
pub fn age(ages: &Samples) -> Line {
    let name = "age of state";
    let remedy =
        "the link delays telemetry: a serial line or Ethernet instead of a radio, a higher baud rate";
    match ages.quantiles() {
        None => Line::new(name, Verdict::Fail, "not known: TIMESYNC is not answered".to_owned(), remedy),
        Some([median, most_of, worst]) => {
            let seen = format!(
                "at most {median:.0} ms median, {most_of:.0} ms 99%, {worst:.0} ms worst; 250 ms serve"
            );
            let line = Line::new(name, graded(most_of, [125.0, 250.0]), seen, remedy);
            line.with(&[("median_ms", median), ("p99_ms", most_of), ("worst_ms", worst)])
        }
    }
}

/// This computer's clock against the autopilot's UTC.
#[must_use]
pub fn clock(offset_s: Option<f64>, within_s: f64) -> Line {
    let name = "clock";
    match offset_s {
        None => Line::new(
            name,
            Verdict::Warn,
            "the autopilot knows no UTC".to_owned(),
            "wait for its GPS to fix; without UTC it does not take off",
        ),
        Some(offset_s) => {
            let apart_s = (offset_s.abs() - within_s).max(0.0);
            let where_ = if offset_s < 0.0 { "behind" } else { "ahead of" };
            let seen =
                format!("{:.2} s {where_} the autopilot's UTC, known within {within_s:.2} s", offset_s.abs());
            let remedy = "set this computer's clock by network or GPS (chrony); if it is right, the autopilot's is wrong, and the pair \
                          agrees on no slot";
            // A quarter of the usual guard is what two vehicles may differ by.
            Line::new(name, graded(apart_s, [0.25, 3600.0]), seen, remedy).with(&[("offset_s", offset_s)])
        }
    }
}

/// The autopilot's clock's rate: ages are reckoned with 200 ppm.
#[must_use]
pub fn drift(drift: &Drift) -> Line {
    let name = "clock drift";
    let Some((ppm, within)) = drift.ppm() else {
        let remedy = "TIMESYNC must be answered: see the link";
        return Line::new(name, Verdict::Warn, "not known".to_owned(), remedy);
    };
    let verdict = if ppm.abs() - within > 200.0 {
        Verdict::Fail
    } else if ppm.abs() > 200.0 {
        Verdict::Warn
    } else {
        Verdict::Pass
    };
    let seen = format!("{ppm:+.0} ppm, known within {within:.0}; 200 are reckoned with");
    let remedy =
        "if it stays beyond 200 over --seconds 120, this computer or the autopilot has a bad oscillator";
    Line::new(name, verdict, seen, remedy).with(&[("ppm", ppm), ("within_ppm", within)])
}

/// How late the event loop came to the instants of setpoints, at rest and under load; none was sent.
#[must_use]
pub fn cadence(name: &str, lateness: &Samples, rate_hz: f64) -> Line {
    let remedy = "stop what else runs here, cool the computer, give the service a priority (Nice=, CPUSchedulingPolicy=), or lower rate_hz";
    match lateness.quantiles() {
        None => Line::new(name, Verdict::Fail, "not measured: too short".to_owned(), "give more --seconds"),
        Some([median, most_of, worst]) => {
            let period_ms = 1e3 / rate_hz;
            let seen = format!(
                "{median:.2} ms late median, {most_of:.2} ms 99%, {worst:.1} ms worst, every {period_ms:.0} ms, {} times",
                lateness.count()
            );
            // A setpoint belongs to the stream for 200 ms; state that is used 30 ms late silences I.
            let verdict = graded(most_of, [5.0, period_ms.max(10.0)]).max(graded(worst, [30.0, 200.0]));
            Line::new(name, verdict, seen, remedy).with(&[
                ("median_ms", median),
                ("p99_ms", most_of),
                ("worst_ms", worst),
            ])
        }
    }
}

/// Writing a log and having it on disk.
#[must_use]
pub fn disk(times: &Result<Samples, String>, bytes: usize, room: Option<Room>, min_free: u64) -> Vec<Line> {
    let remedy = "a slow card loses log records, nothing else: another card (A2, or an SSD)";
    let mut lines = match times.as_ref().map(Samples::quantiles) {
        Err(error) => vec![Line::new(
            "disk",
            Verdict::Fail,
            error.clone(),
            "give [log] dir a directory that can be written",
        )],
        Ok(None) => vec![Line::new("disk", Verdict::Fail, "not measured".to_owned(), "give more --seconds")],
        Ok(Some([median, most_of, worst])) => {
            let seen = format!(
                "{median:.1} ms median, {most_of:.1} ms 99%, {worst:.1} ms worst, to append {} kB and have it on disk",
                bytes / 1024
            );
            // The log's queue holds some seconds of a busy link.
            let line = Line::new("disk", graded(worst, [1000.0, 5000.0]), seen, remedy);
            vec![line.with(&[("median_ms", median), ("p99_ms", most_of), ("worst_ms", worst)])]
        }
    };
    if let Some(Room { free, .. }) = room {
        let verdict = if free < min_free { Verdict::Fail } else { graded(1e9, [free as f64, f64::INFINITY]) };
        let seen =
            format!("{:.2} MB free for logs; min_free_mb is {}", free as f64 / 1e6, min_free / 1_000_000);
        let remedy =
            "copy flights away (`veilwing logs bundle`), then `veilwing logs prune`, or make room otherwise";
        lines.push(Line::new("disk room", verdict, seen, remedy).with(&[("free_mb", free as f64 / 1e6)]));
    }
    lines
}

/// Processors, memory and temperature: at rest, and after load.
#[must_use]
pub fn computer(before: &Reading, after_rest: &Reading, after_load: &Reading) -> Vec<Line> {
    let mut lines = Vec::new();
    let share = after_rest.processors.zip(before.processors).and_then(|(now, then)| now.share_since(then));
    let name = "processors";
    lines.push(match share {
        None => Line::new(name, Verdict::Warn, "not told by this system".to_owned(), "look with top"),
        Some(share) => {
            let seen = format!("{:.0}% of {} busy at rest, this program included", share * 100.0, after_rest.cores.len());
            let remedy = "half must be free for planning and for what comes at once: see with top what runs, and stop it";
            Line::new(name, graded(share, [0.5, 0.85]), seen, remedy).with(&[("busy", share)])
        }
    });
    if let Some(Room { free, total }) = after_load.memory {
        let (free_mb, total_mb) = (free as f64 / 1e6, total as f64 / 1e6);
        let verdict = graded(256.0, [free_mb, free_mb * 4.0]);
        let seen = format!("{free_mb:.0} of {total_mb:.0} MB can be had");
        lines.push(
            Line::new("memory", verdict, seen, "stop what else runs here").with(&[("free_mb", free_mb)]),
        );
    }
    if let Some(hottest) = after_load.hottest_c {
        let seen = format!("{hottest:.0} deg C under load");
        let remedy = "give it a heat sink and air: most computers slow down at 80 to 85 deg C";
        lines.push(
            Line::new("temperature", graded(hottest, [70.0, 80.0]), seen, remedy)
                .with(&[("hottest_c", hottest)]),
        );
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::computer::Ticks;
    use crate::time::Instant;
    use std::time::Duration;

    fn samples(values: &[f64]) -> Samples {
        let mut samples = Samples::default();
        values.iter().for_each(|value| samples.add(*value));
        samples
    }

    #[test]
    fn spec_late_timers_warn_and_fail_by_what_they_cost() {
        let verdict = |values: &[f64]| cadence("cadence", &samples(values), 50.0).verdict;
        assert_eq!(verdict(&[0.1, 0.2, 1.0]), Verdict::Pass);
        assert_eq!(verdict(&[0.1, 0.2, 12.0]), Verdict::Warn);
        assert_eq!(verdict(&[0.1, 0.2, 25.0]), Verdict::Fail, "later than the next is due");
        let mut one_in_a_thousand = vec![0.1; 999];
        one_in_a_thousand.push(60.0);
        assert_eq!(verdict(&one_in_a_thousand), Verdict::Warn);
        one_in_a_thousand.push(250.0);
        assert_eq!(verdict(&one_in_a_thousand), Verdict::Fail, "the stream is broken by it");
        assert_eq!(verdict(&[]), Verdict::Fail);
        assert!(cadence("cadence", &samples(&[25.0]), 50.0).remedy.is_some());
        assert!(cadence("cadence", &samples(&[0.1]), 50.0).remedy.is_none());
    }

    #[test]
    fn spec_a_loaded_computer_is_told_from_one_at_rest() {
        let reading = |busy: u64, free_mb: u64, hottest_c: Option<f64>| Reading {
            processors: Some(Ticks { busy, all: 1000 + busy / 1000 }),
            memory: Some(Room { free: free_mb * 1_000_000, total: 4_000_000_000 }),
            hottest_c,
            ..Reading::default()
        };
        let begin = Reading { processors: Some(Ticks { busy: 0, all: 0 }), ..Reading::default() };
        let verdicts = |rest: &Reading| -> Vec<Verdict> {
            computer(&begin, rest, rest).iter().map(|line| line.verdict).collect()
        };
        assert_eq!(verdicts(&reading(100, 2000, Some(50.0))), [Verdict::Pass; 3]);
        assert_eq!(verdicts(&reading(700, 100, Some(75.0))), [Verdict::Warn; 3]);
        assert_eq!(verdicts(&reading(990, 20, Some(85.0))), [Verdict::Fail; 3]);
        // What a computer does not say is no pass.
        assert_eq!(computer(&begin, &Reading::default(), &Reading::default())[0].verdict, Verdict::Warn);
    }

    #[test]
    fn spec_loss_and_delay_of_a_link_are_two_lines() {
        let at = |ms: u64| Instant::from_start(Duration::from_millis(ms));
        let run = |every_nth_lost: u64, delay_ms: u64| {
            let mut trips = RoundTrips::default();
            for k in 0..200 {
                trips.ask(k, at(k * 50));
                if every_nth_lost == 0 || k % every_nth_lost != 0 {
                    trips.answered(k, at(k * 50 + delay_ms));
                }
            }
            trips.forget(at(60_000));
            let lines = round_trips("link", &trips, [50.0, 250.0], "remedy");
            lines.iter().map(|line| line.verdict).collect::<Vec<_>>()
        };
        assert_eq!(run(0, 4), [Verdict::Pass; 2]);
        assert_eq!(run(0, 160), [Verdict::Warn, Verdict::Pass]);
        assert_eq!(run(25, 4), [Verdict::Pass, Verdict::Warn]);
        assert_eq!(run(3, 400), [Verdict::Fail, Verdict::Fail]);
        assert_eq!(run(1, 4), [Verdict::Fail], "nothing is answered");
    }

    #[test]
    fn spec_a_clock_that_is_off_is_told_where_it_is_known_to_be() {
        assert_eq!(clock(Some(0.1), 0.0).verdict, Verdict::Pass);
        assert_eq!(clock(Some(-2.0), 0.05).verdict, Verdict::Warn);
        assert_eq!(clock(Some(-2.0), 3.0).verdict, Verdict::Pass, "within what is known");
        assert_eq!(clock(Some(86_400.0), 0.05).verdict, Verdict::Fail);
        assert!(clock(Some(-2.0), 0.05).seen.starts_with("2.00 s behind"));
        assert_eq!(clock(None, 0.0).verdict, Verdict::Warn);
    }

    #[test]
    fn spec_a_disk_is_judged_by_its_worst_time_and_by_its_room() {
        let room = |mb: u64| Some(Room { free: mb * 1_000_000, total: 1 << 40 });
        let verdicts = |times: Result<Samples, String>, mb: u64| -> Vec<Verdict> {
            disk(&times, 16_384, room(mb), 500_000_000).iter().map(|line| line.verdict).collect()
        };
        assert_eq!(verdicts(Ok(samples(&[3.0, 40.0])), 9000), [Verdict::Pass; 2]);
        assert_eq!(verdicts(Ok(samples(&[3.0, 1400.0])), 800), [Verdict::Warn; 2]);
        assert_eq!(verdicts(Err("read-only".into()), 400), [Verdict::Fail; 2]);
    }
}
