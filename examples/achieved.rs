//! Does a flight achieve what its plan expects? Many flights without faults at each level of attitude jitter, planned
//! for that level: the ratio of achieved to planned secrecy rate, with its standard error.
//!
//! `cargo run --release --example achieved -- [MISSION] [FLIGHTS] [STD_DEG ...]`

use std::error::Error;
use std::num::NonZeroUsize;
use std::path::Path;

use veilwing::config::Mission;
use veilwing::desk::simulation::{Flown, Scenario, ScenarioError};
use veilwing::planner::slots::Plan;
use veilwing::planning;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or_else(|| "config/mission.toml".to_owned());
    let flights: u64 = arguments.next().map_or(Ok(200), |text| text.parse())?;
    let mut levels_deg = arguments.map(|text| text.parse()).collect::<Result<Vec<f64>, _>>()?;
    if levels_deg.is_empty() {
        levels_deg = vec![1.0, 2.0, 5.0, 10.0];
    }
    println!("{path}: {flights} flights at each level, each with a seed of its own");
    println!("jitter_deg  completed  violations  planned_bit_s_hz   ratio      +-  +-_of_one  control_deg");
    let file = Mission::load(Path::new(&path)).map_err(|errors| errors.to_string())?;
    for std_deg in levels_deg {
        let mission = file.changed(|m| m.jitter.std_deg = std_deg).map_err(|errors| errors.to_string())?;
        let plan = planning::plan(&mission)?;
        let flown = fly(&Scenario::new(&mission, &plan, None)?, mission.seed, flights)?;
        println!("{}", row(std_deg, &mission, &plan, &flown));
    }
    Ok(())
}

/// Every flight, in the order of the seeds, whatever the number of threads.
fn fly(scenario: &Scenario, seed: u64, flights: u64) -> Result<Vec<Flown>, ScenarioError> {
    let threads = std::thread::available_parallelism().map_or(1, NonZeroUsize::get) as u64;
    let results: Vec<_> = std::thread::scope(|scope| {
        let share = |thread| {
            move || {
                let runs = (thread..flights).step_by(threads as usize);
                runs.map(|run| (run, scenario.fly(seed + run, Vec::new(), &mut ()))).collect::<Vec<_>>()
            }
        };
        let workers: Vec<_> = (0..threads).map(|thread| scope.spawn(share(thread))).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_default()).collect()
    });
    let mut results = results;
    results.sort_by_key(|(run, _)| *run);
    results.into_iter().map(|(_, flown)| flown).collect()
}

fn row(std_deg: f64, mission: &Mission, plan: &Plan, flown: &[Flown]) -> String {
    let ratios: Vec<f64> = flown.iter().filter_map(Flown::achieved_over_planned).collect();
    let n = ratios.len() as f64;
    let mean = ratios.iter().sum::<f64>() / n;
    let deviation = (ratios.iter().map(|ratio| (ratio - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
    let completed = flown.iter().filter(|flown| flown.completed()).count();
    let violations: usize = flown.iter().map(|flown| flown.report.violations.len()).sum();
    let rates = plan.slots.iter().map(|slot| slot.plan.secrecy_rate_bps / mission.radio.bandwidth_hz);
    let planned = rates.sum::<f64>() / plan.slots.len() as f64;
    let control: Vec<f64> = flown
        .iter()
        .flat_map(|flown| &flown.report.slots)
        .flat_map(|slot| [slot.attitude_control_rms_deg.i, slot.attitude_control_rms_deg.j])
        .flatten()
        .collect();
    let control = (control.iter().map(|deg| deg * deg).sum::<f64>() / control.len() as f64).sqrt();
    format!(
        "{std_deg:>10.1}  {completed:>9}  {violations:>10}  {planned:>16.3}  {mean:>6.4}  {:>6.4}  {deviation:>9.4}  {control:>11.3}",
        deviation / n.sqrt()
    )
}
