//! `veilwing radio calibrate`: what each setting gives, measured by a person.

use std::fmt::Write;
use std::path::PathBuf;

use super::bench::{Bench, BenchError, end, runtime};
use super::{RADIATES, load, unusable};
use crate::cli::{Exit, interrupt};
use crate::config::RadioFile;
use crate::config::file::write_whole;
use crate::radio_host::{Point, Scale};

/// Measure what the device's settings give: it steps through them, and takes the power that you measured at each, in dBm.
///
/// Radiates. Writes [calibration] file, and never over one that is there.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing radio calibrate radio.toml --radiate --points 21")]
pub(super) struct Args {
    /// The radio file.
    #[arg(value_name = "RADIO.toml")]
    file: PathBuf,
    /// A power meter behind an attenuator is on, and it may radiate now.
    #[arg(long)]
    radiate: bool,
    /// At how many settings, the least and the largest among them.
    #[arg(long, default_value_t = 11, value_parser = clap::value_parser!(u32).range(2..=1000))]
    points: u32,
}

/// Asks, measures, writes.
pub(super) fn run(args: &Args) -> Exit {
    if !args.radiate {
        return unusable(RADIATES);
    }
    let Ok(radio) = load(RadioFile::load_uncalibrated(&args.file)) else { return Exit::Unusable };
    let Some(file) = &radio.calibration_file else {
        return unusable("[calibration] has no `file`: give the path that is to be written");
    };
    let Some(frequency_hz) = radio.device.frequency_hz else {
        return unusable("[device] has no `frequency_hz`: give what is radiated at");
    };
    if file.exists() {
        return unusable(&format!(
            "{} is there already: move it, or give [calibration] file another name",
            file.display()
        ));
    }
    let runtime = match runtime() {
        Ok(runtime) => runtime,
        Err(error) => return unusable(&error),
    };
    let mut bench = match Bench::new(&args.file, &radio) {
        Ok(bench) => bench,
        Err(error) => return unusable(&error),
    };
    let values = spread(&radio.scale, args.points);
    let mut measured = Vec::new();
    let done = runtime.block_on(ask(&mut bench, &values, frequency_hz, &mut measured));
    let left = runtime.block_on(bench.leave());
    // A line that nobody types is not waited for.
    runtime.shutdown_background();
    let complete = measured.len() == values.len();
    if done.is_ok()
        && complete
        && let Err(error) = write_whole(file, csv(&measured))
    {
        eprintln!("error: {error}");
        return Exit::Bad;
    }
    match end(left, done) {
        Exit::Done if !complete => {
            unusable("the input ended before all settings were measured: nothing is written")
        }
        exit => exit,
    }
}

/// So many of the settings, the weakest by their number first, evenly spread over them.
fn spread(scale: &Scale, points: u32) -> Vec<f64> {
    let mut values: Vec<f64> = scale.settings().iter().map(|setting| setting.value).collect();
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    let steps = (points as usize - 1).min(last.max(1));
    let mut chosen: Vec<f64> = (0..=steps).map(|k| values[k * last / steps]).collect();
    chosen.dedup();
    chosen
}

/// What is typed to measure the setting before once more.
const BACK: &str = "back";

/// Steps through the settings. Ends early where the input does.
async fn ask(
    bench: &mut Bench,
    values: &[f64],
    frequency_hz: f64,
    measured: &mut Vec<Point>,
) -> Result<(), BenchError> {
    bench.off().await?;
    eprintln!("give each power in dBm; `{BACK}` measures the setting before once more");
    while let Some(&setting) = values.get(measured.len()) {
        let read_back = bench.set(setting).await?.0;
        let said = read_back.map(|value| format!(", read back as {value}")).unwrap_or_default();
        loop {
            eprint!("setting {setting}{said}: how many dBm? ");
            let line = tokio::select! {
                line = bench.hold(line()) => line?,
                () = interrupt::requested() => return Err(BenchError::Interrupted),
            };
            let Some(line) = line else { return Ok(()) };
            if line.trim() == BACK {
                measured.pop();
                break;
            }
            let Some(dbm) = line.trim().parse().ok().filter(|dbm: &f64| dbm.is_finite()) else {
                eprintln!("{:?} is no number: give dBm, decimals with a point", line.trim());
                continue;
            };
            let point = Point { frequency_hz, setting, dbm, line: measured.len() + 2 };
            if keeps_order(measured, point) {
                measured.push(point);
                break;
            }
            eprintln!(
                "{dbm} dBm breaks the order of those before: power must rise, or fall, throughout; measure again, or go \
                 `{BACK}` where one of those was wrong"
            );
        }
    }
    Ok(())
}

/// Whether power goes on as it began, rising or falling.
fn keeps_order(before: &[Point], next: Point) -> bool {
    match before {
        [] => true,
        [only] => next.dbm != only.dbm,
        [first, second, ..] => {
            let last = before[before.len() - 1].dbm;
            if second.dbm > first.dbm { next.dbm > last } else { next.dbm < last }
        }
    }
}

/// A line of the standard input, read by a thread of its own; `None` at its end.
async fn line() -> Option<String> {
    let read = || {
        let mut line = String::new();
        std::io::stdin().read_line(&mut line).ok().filter(|length| *length > 0).map(|_| line)
    };
    tokio::task::spawn_blocking(read).await.ok().flatten()
}

fn csv(points: &[Point]) -> String {
    let mut text = "frequency_hz,setting,dbm\n".to_owned();
    for Point { frequency_hz, setting, dbm, .. } in points {
        let _ = writeln!(text, "{frequency_hz},{setting},{dbm}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio_host::points_of_csv;

    #[test]
    fn spec_settings_are_spread_from_the_least_to_the_largest() {
        let values: Vec<f64> = (0..=30).map(f64::from).collect();
        let scale = Scale::linear(&values, 30.0, -1.0).unwrap();
        assert_eq!(spread(&scale, 4), [0.0, 10.0, 20.0, 30.0]);
        assert_eq!(spread(&scale, 1000).len(), 31);
        assert_eq!(spread(&Scale::linear(&[7.0], 0.0, 1.0).unwrap(), 2), [7.0]);
    }

    #[test]
    fn spec_what_is_written_is_what_is_read_and_what_would_be_refused_is_not_taken() {
        let point = |setting: f64, dbm: f64, line| Point { frequency_hz: 9.15e8, setting, dbm, line };
        let mut measured = Vec::new();
        for (setting, dbm, taken) in [
            (0.0, 27.0, true),
            (1.0, 27.0, false),
            (1.0, 26.0, true),
            (2.0, 26.5, false),
            (2.0, 24.875, true),
        ] {
            let next = point(setting, dbm, measured.len() + 2);
            assert_eq!(keeps_order(&measured, next), taken, "{dbm}");
            if taken {
                measured.push(next);
            }
        }
        assert_eq!(points_of_csv(&csv(&measured)), Ok(measured.clone()));
        assert!(Scale::measured(&[0.0, 1.0, 2.0], &measured, None).is_ok());
    }
}
