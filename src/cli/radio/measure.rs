//! `veilwing radio measure`: how long the device takes.

use std::fmt::Write;
use std::path::PathBuf;
use std::time::Duration;

use super::bench::{Bench, BenchError, end, runtime};
use super::{RADIATES, load, unusable};
use crate::cli::{Exit, print_text};
use crate::config::RadioFile;

/// Measure the device's times: from a command to the power read back, and from an off to silence read back.
///
/// Radiates. The two lines that it prints below the table are for [device], rounded up.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing radio measure radio.toml --radiate")]
pub(super) struct Args {
    /// The radio file.
    #[arg(value_name = "RADIO.toml")]
    file: PathBuf,
    /// The antenna, or a dummy load, is on, and it may radiate now.
    #[arg(long)]
    radiate: bool,
    /// How often.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    times: u32,
    /// The powers between which it changes, in dBm: at most these. By default the least and the largest.
    #[arg(long, num_args = 2, value_names = ["DBM", "DBM"], allow_negative_numbers = true)]
    between: Option<Vec<f64>>,
}

/// Measures, and prints the table.
pub(super) fn run(args: &Args) -> Exit {
    if !args.radiate {
        return unusable(RADIATES);
    }
    let Ok(radio) = load(RadioFile::load(&args.file)) else { return Exit::Unusable };
    let between = match args.between.as_deref() {
        Some([first, second]) => [*first, *second],
        _ => [radio.scale.least_dbm(), radio.scale.most_dbm()],
    };
    let [Some(first), Some(second)] = between.map(|dbm| radio.scale.at_most(dbm)) else {
        return unusable(&format!(
            "the least power that the device can give is {} dBm",
            radio.scale.least_dbm()
        ));
    };
    let runtime = match runtime() {
        Ok(runtime) => runtime,
        Err(error) => return unusable(&error),
    };
    let mut bench = match Bench::new(&args.file, &radio) {
        Ok(bench) => bench,
        Err(error) => return unusable(&error),
    };
    let mut taken = Taken::default();
    let done = runtime.block_on(taken.fill(&mut bench, args.times, [first.value, second.value]));
    let left = runtime.block_on(bench.leave());
    if done.is_ok() {
        print_text(&taken.table());
    }
    end(left, done)
}

/// What was measured.
#[derive(Debug, Default)]
struct Taken {
    on: Vec<Duration>,
    change: Vec<Duration>,
    off: Vec<Duration>,
}

impl Taken {
    async fn fill(
        &mut self,
        bench: &mut Bench,
        times: u32,
        [first, second]: [f64; 2],
    ) -> Result<(), BenchError> {
        bench.off().await?;
        for _ in 0..times {
            self.on.push(bench.set(first).await?.1);
            self.change.push(bench.set(second).await?.1);
            self.off.push(bench.off().await?);
        }
        Ok(())
    }

    fn table(&self) -> String {
        let mut table = format!("{:26}{:>10}{:>10}{:>10}{:>10}\n", "ms", "min", "median", "95%", "max");
        let rows = [
            ("off to power, read back", &self.on),
            ("power to power, read back", &self.change),
            ("off, read back", &self.off),
        ];
        for (name, times) in rows {
            let [least, median, most_of, most] = quantiles(times);
            let _ = writeln!(table, "{name:26}{least:>10.1}{median:>10.1}{most_of:>10.1}{most:>10.1}");
        }
        let largest =
            |times: &[Duration]| times.iter().max().map_or(0.0, |time| (time.as_secs_f64() * 1e3).ceil());
        let change = largest(&self.on).max(largest(&self.change));
        let _ = writeln!(
            table,
            "\nmeasured in [device], at the least: change_ms = {change:.1}, off_ms = {:.1}",
            largest(&self.off)
        );
        table
    }
}

/// Least, median, 95% and largest, in ms: each a value that was measured.
fn quantiles(times: &[Duration]) -> [f64; 4] {
    let mut sorted = times.to_vec();
    sorted.sort();
    let at = |share: f64| {
        let index = (share * sorted.len() as f64).ceil() as usize;
        sorted.get(index.saturating_sub(1)).map_or(0.0, |time| time.as_secs_f64() * 1e3)
    };
    [at(0.0), at(0.5), at(0.95), at(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_quantiles_of_a_hundred_are_the_1st_50th_95th_and_100th() {
        let times: Vec<Duration> = (1..=100).rev().map(Duration::from_millis).collect();
        assert_eq!(quantiles(&times), [1.0, 50.0, 95.0, 100.0]);
        assert_eq!(quantiles(&[Duration::from_millis(3)]), [3.0; 4]);
    }
}
