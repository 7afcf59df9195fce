//! The grid of network and faults, one row of figures each.

use std::time::Duration;

use super::world::{AIRTIME, Case, FaultKind, Seen};

const LOSSES: [f64; 4] = [0.0, 0.1, 0.3, 0.6];
const DELAYS_MS: [u64; 5] = [0, 20, 100, 400, 2000];
const DUPLICATIONS: [f64; 2] = [0.0, 0.2];
const FAULTS: [FaultKind; 9] = [
    FaultKind::None,
    FaultKind::Partition,
    FaultKind::Restart,
    FaultKind::Pose,
    FaultKind::Clock,
    FaultKind::Stale,
    FaultKind::Pause,
    FaultKind::GiveUp,
    FaultKind::RadioHop,
];
/// Beyond this delay a lease is over before its grant arrives: nothing can be served, and nothing is.
const SERVABLE_MS: u64 = 100;

/// What `pair_sweep` is asked for: the whole grid, one fault's, or one cell.
#[derive(Debug, clap::Parser)]
pub struct Args {
    /// Slots a cell.
    #[arg(long, default_value_t = 500)]
    slots: usize,
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One cell instead of the grid: share of datagrams lost.
    #[arg(long)]
    loss: Option<f64>,
    #[arg(long, default_value_t = 0)]
    delay_ms: u64,
    #[arg(long, default_value_t = 0.0)]
    duplication: f64,
    /// This one alone: None, Partition, Restart, Pose, Clock, Stale, Pause, GiveUp or RadioHop. A cell's is None by default.
    #[arg(long, value_parser = parse_fault)]
    fault: Option<FaultKind>,
    /// Slots carry each other on, served through the vehicles' turns.
    #[arg(long)]
    turning: bool,
}

fn parse_fault(text: &str) -> Result<FaultKind, String> {
    let known = FAULTS.into_iter().find(|fault| format!("{fault:?}") == text);
    known.ok_or_else(|| format!("give one of {FAULTS:?}"))
}

impl Args {
    pub fn cases(&self) -> Vec<Case> {
        let Self { slots, seed, duplication, fault, turning, .. } = *self;
        let Some(loss) = self.loss else {
            let asked = |case: &Case| fault.is_none_or(|fault| case.fault == fault);
            return cases(slots, seed, turning).into_iter().filter(asked).collect();
        };
        let fault = fault.unwrap_or(FaultKind::None);
        vec![Case {
            loss,
            delay: Duration::from_millis(self.delay_ms),
            duplication,
            fault,
            slots,
            seed,
            turning,
        }]
    }
}

/// A cell of the grid and what was seen.
pub struct Row {
    pub case: Case,
    pub seen: Seen,
}

impl Row {
    /// Whether every slot has to be served.
    pub fn must_serve(&self) -> bool {
        self.case.fault == FaultKind::None
            && self.case.loss <= 0.3
            && self.case.delay <= Duration::from_millis(SERVABLE_MS)
    }

    /// The arguments of `pair_sweep` that run this cell alone.
    pub fn replay(&self) -> String {
        let c = &self.case;
        format!(
            "cargo run --release --example pair_sweep -- --loss {} --delay-ms {} --duplication {} --fault {:?} --slots {} --seed {}{}",
            c.loss,
            c.delay.as_millis(),
            c.duplication,
            c.fault,
            c.slots,
            c.seed,
            if c.turning { " --turning" } else { "" }
        )
    }
}

/// Every case of the grid, with a seed of its own.
pub fn cases(slots: usize, seed: u64, turning: bool) -> Vec<Case> {
    let mut cases = Vec::new();
    for fault in FAULTS {
        for delay_ms in DELAYS_MS {
            for loss in LOSSES {
                for duplication in DUPLICATIONS {
                    let seed = seed * 1000 + cases.len() as u64;
                    let delay = Duration::from_millis(delay_ms);
                    cases.push(Case { loss, delay, duplication, fault, slots, seed, turning });
                }
            }
        }
    }
    cases
}

pub const HEADER: &str =
    "fault      loss  delay   dup  slots served airtime  exposed    dead out-of-pose violations";

pub fn print(row: &Row) -> String {
    let (c, s) = (&row.case, &row.seen);
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    format!(
        "{:<10} {:>4.0}% {:>4} ms {:>4.0}% {:>6} {:>6} {:>6.1}% {:>5.1} ms {:>4.0} ms {:>8.1} ms {:>10}",
        format!("{:?}", c.fault),
        c.loss * 100.0,
        c.delay.as_millis(),
        c.duplication * 100.0,
        s.slots,
        s.served,
        100.0 * s.airtime.as_secs_f64() / (AIRTIME.as_secs_f64() * s.slots as f64),
        ms(s.exposed),
        ms(s.dead),
        ms(s.out_of_pose),
        s.violations.len()
    )
}
