//! Tables of the certificate over the reference scenarios:
//! `cargo run --release --no-default-features --example certify -- no-jitter|jitter|gaps|false-thresholds`, with a budget
//! of boxes behind, and then the degrees of jitter, or which of the known plans to take (every so many-th). `gaps` is the
//! certificate of the planner's own plans by N, jitter, null floor and scattering, N = 3 being the first three of five; EVERY as before.
//! Times are those this process spent on its core where the system says so (Linux), else elapsed.

// A measuring program: it reads the clock, and a broken reference file may stop it.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::disallowed_methods)]

use std::time::Instant;

use veilwing::planner::bound::{Budget, Certificate, Reason, best_bound, certify_each};
use veilwing::planner::problem::{Fading, Pattern, Problem, Rician};
use veilwing::planner::{Options, plan_slot};

fn rows(name: &str) -> Vec<Vec<f64>> {
    let path = format!("{}/tests/reference/{name}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(&path).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect()
}

fn problem(eavesdroppers: &[f64], max_power_w: f64, jitter_rad: f64) -> Problem {
    Problem::paper(eavesdroppers.chunks(2).map(|p| [p[0], p[1]]), max_power_w, jitter_rad)
}

/// Seconds this process has spent on a core, or since `start`.
fn core_time_s(start: Instant) -> f64 {
    std::fs::read_to_string("/proc/self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok())
        .map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Gaps and times of some rows, and how many are within each of some gaps.
struct Table {
    start: Instant,
    limits: [f64; 5],
    within: [usize; 5],
    times: Vec<f64>,
}

impl Table {
    fn new(limits: [f64; 5]) -> Self {
        Self { start: Instant::now(), limits, within: [0; 5], times: Vec::new() }
    }

    /// Bounds one problem and returns the gap and the time.
    fn add(&mut self, problem: &Problem, best_known: f64, budget: Budget) -> (f64, f64, String) {
        let before = core_time_s(self.start);
        let bound = best_bound(problem, best_known * 1e6, budget).unwrap();
        let time = core_time_s(self.start) - before;
        let gap = bound.upper_bound_bps / (best_known * 1e6) - 1.0;
        assert!(gap > -1e-7, "below a known plan: {bound:?} {best_known}");
        for (within, limit) in self.within.iter_mut().zip(self.limits) {
            *within += usize::from(gap <= limit * (1.0 + 1e-6));
        }
        self.times.push(time);
        (gap, time, format!("{:?}, {} boxes", bound.kind, bound.boxes_used))
    }

    fn print(&mut self, title: &str) {
        self.times.sort_by(f64::total_cmp);
        let count = self.times.len();
        if count == 0 {
            return;
        }
        let shares: Vec<String> = (self.limits.iter().zip(self.within))
            .map(|(limit, within)| format!("{}%: {within}", limit * 100.0))
            .collect();
        let (median, most) = (self.times[count / 2], self.times[count - 1]);
        println!(
            "{title}: of {count} within {}; seconds: median {median:.3}, most {most:.3}",
            shares.join(", ")
        );
    }
}

fn no_jitter(boxes: usize) {
    let table = rows("no_jitter.csv");
    for (n, power) in [(2, 0.1), (2, 0.3), (2, 0.5), (2, 0.7), (2, 0.9), (2, 1.1), (5, 0.5), (10, 0.5)] {
        let nodes = rows(&format!("eavesdroppers_n{n}.csv"));
        let mut result = Table::new([0.05, 1e-2, 5e-3, 3e-3, 1e-3]);
        for row in table.iter().filter(|r| r[0] == f64::from(n) && r[2] == power) {
            let p = problem(&nodes[row[1] as usize][1..], power, 0.0);
            result.add(&p, row[3], Budget { boxes, ..Budget::STEADY });
        }
        result.print(&format!("N = {n}, Pmax {power} W"));
    }
}

fn jitter(boxes: usize, degrees: &[f64]) {
    let nodes = rows("eavesdroppers_n2.csv");
    let table = rows("jitter.csv");
    for &degrees in degrees {
        let mut result = Table::new([0.02, 0.04, 0.08, 0.16, 0.32]);
        for row in table.iter().filter(|r| r[0] == 2.0 && r[2] == degrees) {
            let scenario = row[1] as usize;
            let p = problem(&nodes[scenario][1..], 0.5, degrees.to_radians());
            let (gap, time, how) = result.add(&p, row[3], Budget { boxes, ..Budget::JITTER });
            println!("  {degrees} deg, scenario {scenario}: gap {:.2}% in {time:.2} s ({how})", gap * 100.0);
        }
        result.print(&format!("N = 2, {degrees} deg"));
    }
}

/// What is not ideal of a link: a name, null depths and Rician factors, dB.
type Link = (&'static str, Option<f64>, Option<f64>);

const LINKS: [Link; 4] = [
    ("ideal", None, None),
    ("-30 dB", Some(30.0), None),
    ("-20 dB", Some(20.0), None),
    ("K 15 dB", None, Some(15.0)),
];

fn with_link(mut p: Problem, (_, depth_db, k_db): Link) -> Problem {
    if let Some(depth_db) = depth_db {
        p.antennas.i = Pattern::with_null_depth(depth_db);
        p.antennas.j = Pattern::with_null_depth(depth_db);
    }
    if let Some(k_db) = k_db {
        let k = Rician::from_db(k_db);
        p.fading = Fading { user: k, eavesdropper: k };
    }
    p
}

/// Gaps of the planner's own plans after a budget of boxes (of the ideal without jitter, where boxes take a tenth of the time, ten
/// times as many), over every `every`-th scenario.
fn gaps(boxes: usize, every: usize, count: Option<usize>, std_deg: Option<f64>) {
    println!("gap of the certificate to the plan, {boxes} boxes; within 0.1, 0.3, 1, 2 and 5%");
    println!(
        " N  deg  link     scenarios  median %   mean %   most %  within                seconds: median, most  kinds"
    );
    for n in [2, 3, 5, 10].into_iter().filter(|n| count.is_none_or(|count| count == *n)) {
        let nodes = rows(&format!("eavesdroppers_n{}.csv", if n == 3 { 5 } else { n }));
        for degrees in
            [0.0, 1.0, 2.0, 5.0].into_iter().filter(|d| std_deg.is_none_or(|std_deg| std_deg == *d))
        {
            for link in LINKS {
                let (label, depth_db, k_db) = link;
                let problems = nodes
                    .iter()
                    .step_by(every)
                    .map(|row| with_link(problem(&row[1..=2 * n], 0.5, degrees.to_radians()), link));
                let ideal = degrees == 0.0 && depth_db.or(k_db).is_none();
                print_gaps(
                    &format!("{n:2} {degrees:4.0} {label:>7}"),
                    problems,
                    if ideal { 10 * boxes } else { boxes },
                );
            }
        }
    }
}

/// One line of the table.
fn print_gaps(label: &str, problems: impl Iterator<Item = Problem>, boxes: usize) {
    let mut result = Table::new([1e-3, 3e-3, 1e-2, 2e-2, 5e-2]);
    let (mut gaps, mut kinds) = (Vec::new(), std::collections::BTreeMap::new());
    for p in problems {
        let rate = plan_slot(&p, &Options::default()).unwrap().secrecy_rate_bps;
        let (gap, _, how) = result.add(&p, rate * 1e-6, Budget { boxes, ..Budget::of(&p) });
        gaps.push(gap * 100.0);
        *kinds.entry(how.split(',').next().unwrap_or_default().to_owned()).or_insert(0) += 1;
    }
    gaps.sort_by(f64::total_cmp);
    result.times.sort_by(f64::total_cmp);
    let count = gaps.len();
    println!(
        "{label} {count:10} {:9.3} {:8.3} {:8.3}  {:?} {:14.2} {:8.2}  {kinds:?}",
        gaps[count / 2],
        gaps.iter().sum::<f64>() / count as f64,
        gaps[count - 1],
        result.within,
        result.times[count / 2],
        result.times[count - 1],
    );
}

/// How attempts to certify what a known plan beats ended.
#[derive(Default)]
struct Attempts {
    tried: usize,
    certified: usize,
    unfinished: usize,
}

impl Attempts {
    fn add<const N: usize>(&mut self, problem: &Problem, thresholds_bps: [f64; N], budget: Budget) {
        for certificate in certify_each(problem, thresholds_bps, budget).unwrap() {
            self.tried += 1;
            match certificate {
                Certificate::Certified { .. } => self.certified += 1,
                Certificate::NotCertified { reason: Reason::Budget, .. } => self.unfinished += 1,
                Certificate::NotCertified { .. } => {}
            }
        }
    }

    fn print(&self, name: &str) {
        let Self { tried, certified, unfinished } = self;
        println!("{name}: {tried} false thresholds, {certified} certified, {unfinished} ended by the budget");
        assert_eq!(*certified, 0);
    }
}

/// 500 false thresholds without jitter, each to its last box, and 500 under jitter, each to the last box or to one that
/// cannot be excluded; of the latter every `every`-th known plan.
fn false_thresholds(boxes: usize, every: usize) {
    let nodes = rows("eavesdroppers_n2.csv");
    let mut attempts = Attempts::default();
    for (k, row) in rows("jitter.csv").iter().filter(|r| r[0] == 2.0).enumerate().step_by(every) {
        let p = problem(&nodes[row[1] as usize][1..], 0.5, row[2].to_radians());
        // From 0.01% to 10% below.
        let below = [1e-4, 6e-4, 3e-3, 2e-2, 1e-1].map(|share| row[3] * (1.0 - share) * 1e6);
        // Coarse, so that each ends where it is stuck.
        attempts.add(&p, below, Budget { boxes, resolution_m: 4.0, ..Budget::JITTER });
        if k % 10 == 0 {
            eprintln!("jitter: {} tried", attempts.tried);
        }
    }
    attempts.print("jitter");
    let mut attempts = Attempts::default();
    for (k, row) in rows("no_jitter.csv").iter().filter(|r| r[0] == 2.0).take(500).enumerate().step_by(every)
    {
        let p = problem(&nodes[row[1] as usize][1..], row[2], 0.0);
        // From 0.01% to 1% below.
        let share = 1e-4 * 100.0_f64.powf((k % 10) as f64 / 9.0);
        // What lies above a threshold is as wide as the root of its share: so every attempt has its last box.
        let resolution_m = 4.0 * (share * 1e4).sqrt();
        let budget = Budget { boxes, resolution_m, exhaustive: true, ..Budget::STEADY };
        attempts.add(&p, [row[3] * (1.0 - share) * 1e6], budget);
    }
    attempts.print("no jitter");
    let mut attempts = Attempts::default();
    for degrees in [0.0_f64, 1.0, 2.0, 5.0] {
        for link in LINKS {
            for row in nodes.iter().step_by(5 * every) {
                let p = with_link(problem(&row[1..], 0.5, degrees.to_radians()), link);
                let rate = plan_slot(&p, &Options::default()).unwrap().secrecy_rate_bps;
                let below = [1e-4, 3e-3, 2e-2, 1e-1].map(|share| rate * (1.0 - share));
                attempts.add(&p, below, Budget { boxes, resolution_m: 4.0, ..Budget::of(&p) });
            }
        }
    }
    attempts.print("links");
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let boxes = |default: usize| arguments.get(1).map_or(default, |a| a.parse().expect("a number of boxes"));
    match arguments.first().map(String::as_str) {
        Some("no-jitter") => no_jitter(boxes(Budget::STEADY.boxes)),
        Some("jitter") => {
            let degrees: Vec<f64> = arguments.iter().skip(2).map(|a| a.parse().expect("degrees")).collect();
            jitter(
                boxes(Budget::JITTER.boxes),
                if degrees.is_empty() { &[1.0, 2.0, 5.0, 10.0] } else { &degrees },
            );
        }
        Some("gaps") => {
            let every = arguments.get(2).map_or(10, |a| a.parse().expect("which of the scenarios"));
            let count = arguments.get(3).map(|a| a.parse().expect("a number of eavesdroppers"));
            let std_deg = arguments.get(4).map(|a| a.parse().expect("degrees"));
            gaps(boxes(100_000), every, count, std_deg);
        }
        Some("false-thresholds") => {
            let every = arguments.get(2).map_or(1, |a| a.parse().expect("which of the known plans"));
            false_thresholds(boxes(20_000_000), every);
        }
        _ => println!(
            "usage: certify no-jitter [BOXES] | jitter [BOXES [DEGREES...]] | gaps [BOXES [EVERY [N [DEGREES]]]] | false-thresholds [BOXES [EVERY]]"
        ),
    }
}
