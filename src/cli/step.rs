//! What a simulated world and a companion process say to each other when the world gives out time: lines of text.
//!
//! The world says how far time goes, on the companion's stdin, and goes on itself when the companion answers that all is done
//! that is due until then. Answers are on stderr, among the records of the log: whoever reads one has read all that was said
//! before it.
//!
//! | line | from | says |
//! |---|---|---|
//! | `veilwing-step/1 NOW UTC` | world | first of all: what the companion's clock reads, and UTC |
//! | `go FROM TO` | world | it is FROM; go on to TO. FROM is the last TO, or later if the companion was stopped |
//! | `stop` | world | as SIGTERM; heeded at the next `go` |
//! | `done TO` | companion | all that is due until TO has happened |
//! | `done TO SLOT ALIKE I.. J..` | companion | the same, in a slot whose motions are made anew: what both fly at TO, as it knows it; ALIKE 1 where J flies the same. Of each east, north, up, roll, pitch, yaw, the power that protects and the most that may be told |
//!
//! All in microseconds, of the companion's clock and since 1970.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use veilwing_sitl as sim;

use crate::time::{Instant, Utc};

/// The first word of the first line: nobody types it by mistake.
const FORMAT: &str = "veilwing-step/1";

/// A line of the world's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    /// What the companion's clock reads, and UTC.
    Begin { now: Instant, utc: Utc },
    /// It is `from`; go on to `to`.
    Go { from: Instant, to: Instant },
    /// Stop in order.
    Stop,
}

/// A line that is none of these.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no word of a simulated world")]
pub(super) struct NoOrder(String);

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Begin { now, utc } => write!(f, "{FORMAT} {} {}", micros(*now), utc.unix_us),
            Self::Go { from, to } => write!(f, "go {} {}", micros(*from), micros(*to)),
            Self::Stop => f.write_str("stop"),
        }
    }
}

impl FromStr for Order {
    type Err = NoOrder;

    fn from_str(line: &str) -> Result<Self, NoOrder> {
        let words: Vec<&str> = line.split(' ').collect();
        let order = match words.as_slice() {
            [FORMAT, now, unix_us] => instant(now)
                .zip(unix_us.parse().ok())
                .map(|(now, unix_us)| Self::Begin { now, utc: Utc { unix_us } }),
            ["go", from, to] => instant(from).zip(instant(to)).map(|(from, to)| Self::Go { from, to }),
            ["stop"] => Some(Self::Stop),
            _ => None,
        };
        // A terminal or a wrong file may have much to say.
        order.ok_or_else(|| NoOrder(line.chars().take(40).collect()))
    }
}

/// A companion's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Done {
    /// All that is due until then has happened.
    pub to: Instant,
    /// In a slot whose motions are made anew.
    pub flown: Option<Flies>,
}

/// What both vehicles fly, as a companion knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Flies {
    pub slot: u16,
    /// Of I: J flies the same. J goes by itself.
    pub alike: bool,
    pub both: sim::Flown,
}

impl fmt::Display for Done {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "done {}", micros(self.to))?;
        let Some(Flies { slot, alike, both }) = &self.flown else { return Ok(()) };
        write!(f, " {slot} {}", u8::from(*alike))?;
        let [i, j] = both.poses;
        let poses = [i, j, both.j_behind].into_iter().flat_map(|pose| {
            let [east, north, up] = pose.position_enu_m;
            [east, north, up, pose.roll_rad, pose.pitch_rad, pose.yaw_rad, pose.tx_power_w]
        });
        poses.chain(both.most_w).try_for_each(|number| write!(f, " {number}"))
    }
}

impl Done {
    /// The answer in a line of a companion's, if it is one.
    pub fn read(line: &str) -> Option<Self> {
        let mut words = line.strip_prefix("done ")?.split(' ');
        let to = instant(words.next()?)?;
        let flown = match words.next() {
            Some(slot) => Some(Flies::read(slot, words)?),
            None => None,
        };
        Some(Self { to, flown })
    }
}

impl Flies {
    fn read<'a>(slot: &str, mut words: impl Iterator<Item = &'a str>) -> Option<Self> {
        let (slot, alike) = (slot.parse().ok()?, words.next()? == "1");
        let numbers = words.map(|word| word.parse().ok()).collect::<Option<Vec<f64>>>()?;
        let numbers: [f64; 23] = numbers.try_into().ok()?;
        let pose = |of: usize| sim::PlannedPose {
            position_enu_m: [0, 1, 2].map(|k: usize| numbers[7 * of + k]),
            roll_rad: numbers[7 * of + 3],
            pitch_rad: numbers[7 * of + 4],
            yaw_rad: numbers[7 * of + 5],
            tx_power_w: numbers[7 * of + 6],
            lean_deg: 0.0,
        };
        let both =
            sim::Flown { poses: [pose(0), pose(1)], j_behind: pose(2), most_w: [numbers[21], numbers[22]] };
        Some(Self { slot, alike, both })
    }
}

fn micros(instant: Instant) -> u128 {
    instant.since_start().as_micros()
}

fn instant(word: &str) -> Option<Instant> {
    word.parse().ok().map(|us| Instant::from_start(Duration::from_micros(us)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_each_line_is_read_as_it_was_written_and_nothing_else_is_taken_for_one() {
        let at = |us| Instant::from_start(Duration::from_micros(us));
        let orders = [
            (Order::Begin { now: at(7_000_000), utc: Utc { unix_us: 9 } }, "veilwing-step/1 7000000 9"),
            (Order::Go { from: at(7_002_500), to: at(7_005_000) }, "go 7002500 7005000"),
            (Order::Stop, "stop"),
        ];
        for (order, line) in orders {
            assert_eq!((order.to_string().as_str(), line.parse::<Order>()), (line, Ok(order)));
        }
        for line in ["", "veilwing-step/2 0 0", "veilwing-step/1 0", "go 1", "go 1 -2", "go 1 2 3", "stop "] {
            assert_eq!(line.parse::<Order>(), Err(NoOrder(line.to_owned())));
        }
        let pose = |east_m: f64| sim::PlannedPose {
            position_enu_m: [east_m, -2.5, 30.0 + 1e-9],
            roll_rad: 0.1,
            pitch_rad: -1.0 / 3.0,
            yaw_rad: 0.0,
            tx_power_w: 1e-7,
            lean_deg: 0.0,
        };
        let both = sim::Flown { poses: [pose(1.0), pose(-7.0)], j_behind: pose(-6.5), most_w: [0.5, 2e-7] };
        for flown in
            [None, Some(Flies { slot: 3, alike: true, both }), Some(Flies { slot: 0, alike: false, both })]
        {
            let done = Done { to: at(3), flown };
            assert_eq!(Done::read(&done.to_string()), Some(done), "{done}");
        }
        for line in ["done", "done x", "done 3 1", "done 3 1 1 2", "done 3 x 1", "{\"level\":\"INFO\"}"] {
            assert_eq!(Done::read(line), None);
        }
    }
}
