//! `veilwing` beside the paper's method and its benchmarks.

use veilwing::planner::problem::Method;
use veilwing::planner::{Options, plan_slot};

use crate::data::{self, Failure};
use crate::tables::{MHZ, Run, Times, mean, score};

/// All methods without jitter, N = 2, beside MODEL's means.
pub fn steady(run: &Run) -> Result<(), Failure> {
    let model: [(Method, &str, Option<[f64; 6]>); 7] = [
        (Method::Veilwing, "veilwing", Some([23.80, 25.38, 26.12, 26.60, 26.97, 27.26])),
        (Method::Paper, "paper", Some([23.67, 25.25, 25.99, 26.47, 26.84, 27.13])),
        (Method::JammerOrientation, "jammer-orientation", None),
        (Method::InteriorPoint, "interior-point", Some([20.75, 21.87, 22.45, 22.78, 22.89, 23.28])),
        (Method::InteriorPointMultiStart, "interior-point-multi", None),
        (Method::Conventional, "conventional", Some([10.57, 11.37, 11.03, 12.15, 12.10, 11.93])),
        (
            Method::ConventionalMultiStart,
            "conventional-multi",
            Some([21.06, 22.65, 23.38, 23.87, 24.23, 24.52]),
        ),
    ];
    let powers = [0.1, 0.3, 0.5, 0.7, 0.9, 1.1];
    let scenarios = data::eavesdroppers(2)?;
    println!(
        "mean rate without jitter, N = 2, one start (veilwing and multi: their own), figures of MODEL section 3 below"
    );
    println!("{:20} {}", "Pmax W", powers.map(|p| format!("{p:7.1}")).join(" "));
    for (method, name, known) in model {
        let mut means = Vec::new();
        let mut times = Times::new();
        for power in powers {
            let rates: Vec<f64> = scenarios
                .iter()
                .step_by(run.every)
                .map(|eavesdroppers| {
                    let problem = data::paper(eavesdroppers, power, 0.0);
                    let plan = times.time(|| plan_slot(&problem, &run.options(method)))?;
                    Ok(plan.secrecy_rate_bps / MHZ)
                })
                .collect::<Result<_, Failure>>()?;
            means.push(mean(&rates));
        }
        let line = |values: &[f64]| values.iter().map(|v| format!("{v:7.2}")).collect::<Vec<_>>().join(" ");
        println!("{name:20} {}   {:.2} ms", line(&means), times.median_ms());
        let known = known.map_or_else(|| "      -".to_owned(), |values| line(&values));
        println!("{:20} {known}", "");
    }
    Ok(())
}

/// A row of MODEL section 3 under jitter: N, degrees, best known, and the paper's method with many starts and with one.
const MODEL_JITTER: [(usize, f64, f64, f64, Option<f64>); 12] = [
    (2, 1.0, 21.63, 20.72, Some(20.48)),
    (2, 2.0, 19.54, 18.62, Some(18.33)),
    (2, 5.0, 16.03, 15.14, Some(15.04)),
    (2, 10.0, 12.97, 12.23, Some(11.79)),
    (5, 1.0, 15.78, 14.41, None),
    (5, 2.0, 13.72, 12.41, None),
    (5, 5.0, 10.77, 9.63, None),
    (5, 10.0, 8.25, 7.37, None),
    (10, 1.0, 14.67, 13.87, None),
    (10, 2.0, 12.61, 11.85, None),
    (10, 5.0, 9.69, 9.04, None),
    (10, 10.0, 7.26, 6.72, None),
];

/// `veilwing` and the paper's method, from one start and from many, over all scenarios of every group under jitter.
pub fn against_paper(run: &Run) -> Result<(), Failure> {
    let many = if run.starts > 0 { run.starts } else { 40 };
    println!(
        "mean rate under jitter, Pmax 0.5 W; `paper` from one start and from {many}; MODEL section 3 in brackets"
    );
    println!(
        "  N  deg  scenarios       veilwing      paper, many       paper, one    margin, many  margin, one  least margin  behind"
    );
    let mut behind = 0;
    for (n, deg, best, multi, single) in MODEL_JITTER {
        let mut rates = [vec![], vec![], vec![]];
        for eavesdroppers in data::eavesdroppers(n)?.iter().take(run.first).step_by(run.every) {
            let problem = data::paper(eavesdroppers, 0.5, deg);
            let own = Options { starts: None, ..run.options(Method::Veilwing) };
            let paper = |starts| Options { starts: Some(starts), ..run.options(Method::Paper) };
            for (rates, options) in rates.iter_mut().zip([own, paper(many), paper(1)]) {
                rates.push(score(&problem, &plan_slot(&problem, &options)?.vehicles)?);
            }
        }
        let margins: Vec<f64> = rates[0].iter().zip(&rates[1]).map(|(own, paper)| own - paper).collect();
        let lost = margins.iter().filter(|m| **m < 0.0).count();
        behind += lost;
        let [own, paper, one] = [mean(&rates[0]), mean(&rates[1]), mean(&rates[2])];
        let known = |value: Option<f64>| value.map_or_else(|| "  -  ".to_owned(), |v| format!("{v:5.2}"));
        println!(
            "{n:3} {deg:4.0} {:10}  {own:6.2} ({best:5.2})  {paper:7.2} ({multi:5.2})  {one:7.2} ({})  {:6.2} ({:4.2})  {:4.2} ({})  {:12.3} {lost:7}",
            margins.len(),
            known(single),
            own - paper,
            best - multi,
            own - one,
            single.map_or_else(|| " -  ".to_owned(), |one| format!("{:4.2}", best - one)),
            margins.iter().copied().fold(f64::INFINITY, f64::min),
        );
    }
    println!("behind the paper's method with {many} starts: {behind}");
    Ok(())
}

/// All methods under jitter, N = 2, Pmax 0.5 W, beside MODEL's means; `--starts 40` for the paper's with multi-start.
pub fn jitter(run: &Run) -> Result<(), Failure> {
    let known: [(Method, &str, &str); 6] = [
        (Method::Veilwing, "veilwing", "best known 21.63 19.54 16.03 12.97"),
        (Method::Paper, "paper", "multi-start 20.72 18.62 15.14 12.23, one start 20.48 18.33 15.04 11.79"),
        (Method::InteriorPoint, "interior-point", ""),
        (Method::InteriorPointMultiStart, "interior-point-multi", ""),
        (Method::Conventional, "conventional", ""),
        (Method::ConventionalMultiStart, "conventional-multi", "11.99 10.01 7.28 5.26"),
    ];
    let scenarios = data::eavesdroppers(2)?;
    println!("mean rate under jitter of 1, 2, 5, 10 deg, N = 2, Pmax 0.5 W");
    for (method, name, model) in known {
        let mut means = Vec::new();
        for deg in [1.0, 2.0, 5.0, 10.0] {
            let rates = scenarios.iter().step_by(run.every).map(|eavesdroppers| {
                let problem = data::paper(eavesdroppers, 0.5, deg);
                score(&problem, &plan_slot(&problem, &run.options(method))?.vehicles)
            });
            means.push(mean(&rates.collect::<Result<Vec<_>, Failure>>()?));
        }
        let line = means.iter().map(|v| format!("{v:7.2}")).collect::<Vec<_>>().join(" ");
        println!("{name:20} {line}   MODEL: {model}");
    }
    Ok(())
}
