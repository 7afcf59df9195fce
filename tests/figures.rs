//! The paper's figures: what is in their CSV files, and that their drawings are sound.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use nalgebra::Vector3;
use veilwing::desk::figures::rates::{CurveRates, MAX_POWERS_W, Source, Study, measure, score};
use veilwing::desk::figures::scenario::{self, Conditions};
use veilwing::desk::figures::{Failure, Figure, Settings, make, poses, regret, service};
use veilwing::geo::Pose;
use veilwing::planner::expectation::samples::Sequence;
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::{EvaluateOptions, cap, evaluate};
use veilwing::role::{PerVehicle, Role};

const SETTINGS: Settings = Settings { scenarios: 2, threads: 2, seed: 1 };

fn quiet(_: &str, _: usize, _: usize) {}

/// Made once for all tests.
static ALL: LazyLock<Vec<Figure>> = LazyLock::new(|| make(&SETTINGS, |_| true, &quiet).unwrap());

fn csv_of(name: &str) -> Vec<BTreeMap<String, String>> {
    rows(&ALL.iter().find(|figure| figure.name == name).unwrap().csv)
}

/// Rows of a CSV file by column name.
fn rows(csv: &str) -> Vec<BTreeMap<String, String>> {
    let mut lines = csv.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            assert_eq!(fields.len(), names.len(), "{line}");
            names.iter().zip(fields).map(|(n, f)| ((*n).to_owned(), f.to_owned())).collect()
        })
        .collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    let value: f64 = row[column].parse().unwrap_or_else(|e| panic!("{column}: {e}: {row:?}"));
    assert!(value.is_finite(), "{column}: {value}");
    value
}

/// Elements of a document by name, if it is well-formed.
fn elements(svg: &str) -> BTreeMap<String, usize> {
    let mut reader = quick_xml::Reader::from_str(svg);
    reader.config_mut().check_end_names = true;
    let (mut counts, mut depth) = (BTreeMap::new(), 0i64);
    loop {
        let event = reader.read_event().unwrap();
        let name = match &event {
            quick_xml::events::Event::Eof => break,
            quick_xml::events::Event::Start(e) | quick_xml::events::Event::Empty(e) => {
                e.attributes().for_each(|a| assert!(a.is_ok(), "{a:?}"));
                depth += i64::from(matches!(event, quick_xml::events::Event::Start(_)));
                String::from_utf8(e.name().as_ref().to_vec()).unwrap()
            }
            quick_xml::events::Event::End(_) => {
                depth -= 1;
                continue;
            }
            _ => continue,
        };
        *counts.entry(name).or_insert(0) += 1;
    }
    assert_eq!(depth, 0);
    counts
}

#[test]
fn spec_the_note_on_the_papers_method_is_of_the_rates_drawn() {
    let mut rates = measure(Study::Jitter, &SETTINGS, &quiet).unwrap();
    let mut with = |paper: [f64; 6], one: [f64; 6]| {
        for curve in &mut rates.curves {
            for (k, summary) in curve.rates.iter_mut().enumerate() {
                match curve.curve.name {
                    "paper" => summary.mean = paper[k],
                    "paper-one-start" => summary.mean = one[k],
                    "interior-point" | "interior-point-one-start" => summary.mean = 10.0,
                    _ => {}
                }
            }
        }
        rates.paper_to_interior_point().unwrap()
    };
    let said = with([9.5, 9.0, 9.0, 9.0, 9.0, 8.75], [10.25, 11.0, 11.0, 11.0, 11.0, 11.0]);
    assert!(said.contains("below by 0.50 to 1.25; from one start above by 0.25 to 1.00"), "{said}");
    let said = with([9.5, 9.0, 9.0, 9.0, 9.0, 10.75], [9.0; 6]);
    assert!(said.contains("from 0.75 above to 1.00 below"), "{said}");
}

#[test]
fn val_figure_3_rates_are_those_of_the_poses_drawn() {
    let figure = poses::plan(&SETTINGS, &quiet).unwrap();
    let rows = rows(&figure.csv());
    let conditions = Conditions { max_power_w: poses::MAX_POWER_W, jitter_std_rad: 0.0, uncertainty_m: 0.0 };
    let problem = scenario::problem(&scenario::eavesdroppers(SETTINGS.seed, 0), &conditions);
    for (_, name, _) in poses::METHODS {
        let of = |item: &str| {
            rows.iter()
                .find(|row| row["method"] == name && row["item"] == item)
                .unwrap_or_else(|| panic!("{item}"))
        };
        let vehicle = |item: &str| {
            let row = of(item);
            let position_enu_m =
                Vector3::new(number(row, "east_m"), number(row, "north_m"), number(row, "up_m"));
            let pose = Pose {
                position_enu_m,
                roll_rad: number(row, "roll_rad"),
                pitch_rad: number(row, "pitch_rad"),
                yaw_rad: 0.0,
            };
            let axis =
                Vector3::new(number(row, "axis_east"), number(row, "axis_north"), number(row, "axis_up"));
            assert!((axis - pose.antenna_axis()).norm() < 3e-6);
            VehiclePlan { pose, tx_power_w: number(row, "tx_power_w") }
        };
        let vehicles = PerVehicle { i: vehicle("vehicle-i"), j: vehicle("vehicle-j") };
        let scored = evaluate(&problem, &vehicles, &EvaluateOptions::default()).unwrap();
        let stated = number(of("vehicle-i"), "secrecy_rate_bit_s_hz");
        // Printed to 1 mm and 1e-6 rad: at J's null that alone is worth some 1e-2 bit/s/Hz.
        assert!((scenario::per_hz(scored.secrecy_rate_bps) - stated).abs() < 0.02, "{name}: {stated}");
        let tilted = Role::BOTH.iter().any(|role| vehicles[*role].pose.attitude().tilt_rad() > 1e-6);
        assert_eq!(tilted, name != "conventional", "{name}");
        if ["paper", "jammer-orientation"].contains(&name) {
            let null = of("null-line-of-j-on-ground");
            assert!(
                number(null, "east_m").hypot(number(null, "north_m")) < 2e-3,
                "J's null is not on the user"
            );
        }
    }
}

#[test]
fn val_figure_4_means_are_those_of_single_scenarios() {
    for study in Study::ALL {
        let rates = measure(study, &SETTINGS, &quiet).unwrap();
        let rows = rows(&rates.csv());
        let abscissa = study.abscissa();
        assert_eq!(rows.len(), study.curves().len() * abscissa.values.len());
        let value = 2;
        for CurveRates { curve, rates: summaries, .. } in &rates.curves {
            let single: Vec<f64> = (0..SETTINGS.scenarios)
                .map(|index| {
                    let seed = veilwing::planner::expectation::sobol::mix(SETTINGS.seed, index as u64);
                    let eavesdroppers = scenario::eavesdroppers(SETTINGS.seed, index);
                    let problem = study.problem(&eavesdroppers, abscissa.values[value]);
                    score(curve.source, &problem, seed).unwrap().of(curve.statistic)
                })
                .collect();
            let mean = (single[0] + single[1]) / 2.0;
            assert!((summaries[value].mean - mean).abs() < 1e-9, "{study:?} {}", curve.name);
            let row = rows
                .iter()
                .find(|r| r["method"] == curve.name && number(r, abscissa.name) == abscissa.values[value])
                .unwrap();
            assert!((number(row, "mean_bit_s_hz") - mean).abs() < 1e-6);
            let error = (single[0] - single[1]).abs() / 2.0;
            assert!((number(row, "standard_error_bit_s_hz") - error).abs() < 1e-6);
            assert_eq!(row["scenarios"], "2");
        }
    }
}

#[test]
fn val_a_plan_of_figure_4_is_scored_by_evaluate() {
    // Without anything random the evaluator is exact, so that the plan's own figure must be met.
    let problem = Study::Plain.problem(&scenario::eavesdroppers(1, 0), 0.5);
    let options = veilwing::planner::Options { seed: 9, ..Default::default() };
    let plan = veilwing::planner::plan_slot(&problem, &options).unwrap();
    let drawn = score(Source::Planned(None), &problem, 9).unwrap().mean;
    assert!((drawn - scenario::per_hz(plan.secrecy_rate_bps)).abs() < 1e-9);
    // With jitter and uncertain positions, within the errors of both.
    let problem = Study::Uncertain.problem(&scenario::eavesdroppers(1, 0), 0.5);
    let plan = veilwing::planner::plan_slot(&problem, &options).unwrap();
    let drawn = score(Source::Planned(None), &problem, 9).unwrap().mean;
    let scoring = EvaluateOptions { samples: 65_536, seed: 4, sequence: Sequence::Sobol };
    let score = evaluate(&problem, &plan.vehicles, &scoring).unwrap();
    // `score` scores on an eighth of the samples.
    let error = scenario::per_hz(score.standard_error_bps) * (1.0 + 8f64.sqrt());
    assert!((drawn - scenario::per_hz(score.secrecy_rate_bps)).abs() < 5.0 * error, "{drawn}");
}

#[test]
fn val_order_of_figure_4a_is_the_papers() {
    let settings = Settings { scenarios: 24, ..SETTINGS };
    let rates = measure(Study::Plain, &settings, &quiet).unwrap();
    let rows = rows(&rates.csv());
    let mean = |method: &str, power: f64| {
        let row = rows.iter().find(|r| r["method"] == method && number(r, "max_power_w") == power).unwrap();
        number(row, "mean_bit_s_hz")
    };
    for power in MAX_POWERS_W {
        let one_start = ["paper-one-start", "interior-point-one-start", "conventional-one-start"];
        let ordered = ["cap", "veilwing"].into_iter().chain(one_start).map(|m| mean(m, power));
        let ordered: Vec<f64> = ordered.collect();
        assert!(ordered.is_sorted_by(|a, b| a > b), "{power} W: {ordered:?}");
        // More starts never cost, and Veilwing is ahead of all from as many.
        for method in ["paper", "interior-point", "conventional"] {
            let [many, one] = [mean(method, power), mean(&format!("{method}-one-start"), power)];
            assert!(
                many >= one && many <= mean("veilwing", power) + 1e-3,
                "{power} W {method}: {many} {one}"
            );
        }
        let problem = Study::Plain.problem(&scenario::eavesdroppers(1, 0), power);
        assert!((mean("cap", power) - scenario::per_hz(cap(&problem).unwrap())).abs() < 1e-6);
    }
}

#[test]
fn val_who_knows_of_floors_and_scattering_is_ahead_of_who_does_not() {
    let settings = Settings { scenarios: 8, ..SETTINGS };
    for study in [Study::NullDepth, Study::Scattering] {
        let rates = measure(study, &settings, &quiet).unwrap();
        let means = |name: &str| -> Vec<f64> {
            let curve = rates.curves.iter().find(|curve| curve.curve.name == name).unwrap();
            curve.rates.iter().map(|summary| summary.mean).collect()
        };
        let [knowing, quantile] = ["knowing", "knowing-5pct"].map(means);
        let [unknowing, unknowing_quantile] = ["unknowing", "unknowing-5pct"].map(means);
        // The better the hardware and the site, the more both get; the worse, the more it is worth to know.
        assert!(knowing.is_sorted() && unknowing.is_sorted(), "{knowing:?} {unknowing:?}");
        let ahead: Vec<f64> = knowing.iter().zip(&unknowing).map(|(k, u)| k - u).collect();
        assert!(ahead.iter().all(|ahead| *ahead > -0.01) && ahead[0] > 0.3, "{study:?}: {ahead:?}");
        assert!(knowing.iter().zip(&quantile).all(|(mean, quantile)| quantile < mean));
        assert!(unknowing.iter().zip(&unknowing_quantile).all(|(mean, quantile)| quantile < mean));
    }
}

#[test]
fn spec_figures_do_not_depend_on_threads_and_are_sound() {
    let names: Vec<&str> = ALL.iter().map(|figure| figure.name).collect();
    let rates = ["figure-3", "figure-4a", "figure-4b", "figure-4c", "figure-null-depth", "figure-rician-k"];
    let service = ["figure-volume-slot", "figure-volume-arena", "figure-regret-speed"];
    assert_eq!(names, [rates.as_slice(), &service].concat());
    assert_eq!(veilwing::desk::figures::names(), names);
    assert_eq!(*ALL, make(&Settings { threads: 3, ..SETTINGS }, |_| true, &quiet).unwrap());
    for figure in ALL.iter() {
        let counts = elements(&figure.svg);
        assert_eq!(counts["svg"], 1);
        // A polygon at least for the band of every curve, but in figure 3.
        let bands = if figure.name == regret::NAME { 3 } else { 4 };
        assert!(figure.name == "figure-3" || counts["polygon"] >= bands, "{counts:?}");
        assert!(counts["text"] > 10 && counts["polyline"] > 10, "{counts:?}");
        for foreign in ["href", "<image", "<style", "@font-face", "NaN", "inf"] {
            assert!(!figure.svg.contains(foreign), "{}: {foreign}", figure.name);
        }
    }
    assert!(ALL[2].csv.lines().count() == 1 + 8 * MAX_POWERS_W.len());
}

#[test]
fn val_what_a_pair_may_do_pays_and_figures_of_volume_are_those_of_plans() {
    for study in service::Study::ALL {
        let rows = csv_of(study.name());
        let (name, _, values) = study.abscissa();
        assert_eq!(rows.len(), service::WAYS.len() * values.len());
        let at = |way: &str, value: f64, column: &str| {
            let row = rows.iter().find(|row| row["way"] == way && number(row, name) == value).unwrap();
            number(row, column)
        };
        for value in values {
            let volumes = service::WAYS.map(|(way, ..)| at(way, value, "volume_bit_s_hz"));
            // What is allowed more is planned from what is allowed less, or searched for anew: a trace may be lost.
            assert!(volumes.is_sorted_by(|less, more| *more > 0.995 * less), "{name} {value}: {volumes:?}");
            assert!(at("by-rate", value, "on_air_percent") < at("turning", value, "on_air_percent"));
        }
        // The way to the next user weighs less in a long slot, and in a small arena.
        let silent = |value: f64| 100.0 - at("by-rate", value, "on_air_percent");
        let [most, least] = match study {
            service::Study::SlotLength => [values[0], values[4]],
            service::Study::Arena => [values[4], values[0]],
        };
        assert!(silent(most) > 1.2 * silent(least), "{name}");
        let (way, optimise, mode) = service::WAYS[1];
        let one = service::deliver(study.mission(SETTINGS.seed, 0, values[1]), optimise, mode).unwrap();
        assert!((one.volume_bit_s_hz - at(way, values[1], "volume_bit_s_hz")).abs() < 1e-6);
        assert!((100.0 * one.on_air - at(way, values[1], "on_air_percent")).abs() < 1e-6);
    }
}

#[test]
fn val_who_stays_loses_more_the_faster_a_user_goes_and_who_follows_little() {
    let rows = csv_of(regret::NAME);
    assert_eq!(rows.len(), regret::CURVES.len() * regret::SPEEDS_M_S.len());
    let lost = |curve: &str| -> Vec<f64> {
        let of = rows.iter().filter(|row| row["curve"] == curve);
        of.map(|row| number(row, "lost_percent")).collect()
    };
    let [follows, stays] = regret::CURVES.map(lost);
    assert!(stays[4] > 2.0 * stays[0] && stays[4] > 10.0, "{stays:?}");
    assert!(follows.iter().zip(&stays).all(|(follows, stays)| follows < stays), "{follows:?} {stays:?}");
    assert!(follows.iter().all(|lost| lost.abs() < 10.0), "{follows:?}");
    let speed_m_s = regret::SPEEDS_M_S[1];
    let one = regret::fly(regret::mission(SETTINGS.seed, 0, speed_m_s), speed_m_s).unwrap().unwrap();
    for (alone, drawn) in one.iter().zip([&follows, &stays]) {
        assert!((alone - drawn[1]).abs() < 1e-6, "{one:?}");
    }
}

#[test]
fn spec_no_scenarios_are_refused() {
    let refused = make(&Settings { scenarios: 0, ..SETTINGS }, |_| true, &quiet);
    assert_eq!(refused.unwrap_err(), Failure::NoScenarios);
}

#[test]
fn spec_command_writes_all_files_and_refuses_bad_arguments() {
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("figures");
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_veilwing")).arg("figures").args(arguments).output().unwrap()
    };
    let done = run(&["--out", out.to_str().unwrap(), "--scenarios", "2", "--threads", "2", "--seed", "1"]);
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(!done.stderr.is_empty() && !done.stderr.contains(&0x1B), "words, and no escapes");
    let stdout = String::from_utf8(done.stdout).unwrap();
    let files: Vec<&str> = stdout.lines().collect();
    assert_eq!(files.len(), 20, "{stdout}");
    for figure in ALL.iter() {
        for (extension, text) in [("svg", &figure.svg), ("csv", &figure.csv)] {
            let path = out.join(format!("{}.{extension}", figure.name));
            assert!(files.contains(&path.to_str().unwrap()));
            assert_eq!(&std::fs::read_to_string(path).unwrap(), text);
        }
    }
    // What the imperfections of the demo cost, and what they leave: the floor by far the most by itself.
    let broken_down = std::fs::read_to_string(out.join("figure-breakdown.csv")).unwrap();
    let rows = rows(&broken_down);
    for user in ["alpha", "bravo"] {
        let loss = |cause: &str| {
            let row = rows.iter().find(|row| row["user"] == user && row["cause"] == cause).unwrap();
            number(row, "loss_bit_s_hz")
        };
        let alone = ["heading", "jitter", "mounting", "position", "user"].map(loss);
        assert!(alone.iter().all(|alone| (0.0..loss("antenna")).contains(alone)), "{broken_down}");
        assert!(loss("all") > loss("antenna") + alone.iter().sum::<f64>(), "{broken_down}");
    }
    assert_eq!(elements(&std::fs::read_to_string(out.join("figure-breakdown.svg")).unwrap())["svg"], 1);
    let some = Path::new(env!("CARGO_TARGET_TMPDIR")).join("figures-some");
    let same = ["--out", some.to_str().unwrap(), "--scenarios", "2", "--seed", "1"];
    let done = run(&[&same[..], &["--only", "figure-breakdown", "--only", "figure-3"]].concat());
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    let files = String::from_utf8(done.stdout).unwrap();
    let files: Vec<&Path> = files.lines().map(Path::new).collect();
    let named = ["figure-3.svg", "figure-3.csv", "figure-breakdown.svg", "figure-breakdown.csv"];
    assert_eq!(files, named.map(|name| some.join(name)));
    for (file, name) in files.iter().zip(named) {
        assert_eq!(std::fs::read(file).unwrap(), std::fs::read(out.join(name)).unwrap(), "{name}");
    }
    for arguments in [
        &["--mission", "no-such-mission.toml"][..],
        &["--only", "figure-5"],
        &["--scenarios", "1"],
        &["--threads", "0"],
        &["--scenarios", "many"],
    ] {
        assert_eq!(run(arguments).status.code(), Some(2), "{arguments:?}");
    }
}
