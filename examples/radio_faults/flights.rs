//! Flights of `veilwing sitl --radio-hosts`, by the wall's clock.

use std::io::{BufRead, BufReader, Read};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// Low, near and short: one slot.
const MISSION: &str = r#"
[mission]
name = "radio faults"
seed = 3
origin = { lat_deg = 50.0755, lon_deg = 14.4378, alt_amsl_m = 200.0 }
[airspace]
altitude_m = [10.0, 30.0]
area_enu_m = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]
[vehicles.i]
climb_m_s = 4.0
tilt_rate_deg_s = 60.0
home_enu_m = [-8.0, 0.0, 0.0]
[vehicles.j]
climb_m_s = 4.0
tilt_rate_deg_s = 60.0
home_enu_m = [33.0, -18.0, 0.0]
[tdma]
slot_s = 4.0
guard_s = 0.6
settle_s = 2.0
[[user]]
name = "alpha"
enu_m = [-5.0, 0.0, 0.0]
[[eavesdropper]]
name = "hill"
enu_m = [35.0, -20.0, 2.0]
"#;
/// I may be on the air for so long in the slot.
const AIRTIME_S: f64 = 3.4;

/// How flights are flown.
pub struct Setup {
    /// The `veilwing` command.
    pub program: PathBuf,
    /// Each flight gets a directory in it.
    pub directory: PathBuf,
    /// So many at once.
    pub at_once: usize,
}

/// One flight.
#[derive(Clone)]
struct Case {
    name: String,
    options: Vec<&'static str>,
    /// As `veilwing sitl --faults` reads it; empty: none.
    faults: String,
    /// 0 is I, 1 is J: whom it befalls.
    side: usize,
}

/// What a flight left behind.
struct Flown {
    document: Value,
    said: Vec<String>,
    /// When its fault came about.
    fault_s: Option<f64>,
}

impl Flown {
    fn completed(&self) -> bool {
        self.document["result"] == "completed"
    }

    fn unprotected_ms(&self) -> f64 {
        1e3 * self.document["unprotected_s"].as_f64().unwrap()
    }

    fn count(&self, what: &str) -> usize {
        self.document[what].as_array().map_or(0, Vec::len)
    }

    /// By how much the simulated world ran late, at worst, for the machine had more to do.
    fn late_ms(&self) -> u64 {
        self.document.pointer("/world_late/worst_ms").and_then(Value::as_u64).unwrap_or(0)
    }

    /// From the fault to the device's silence, in ms; infinite: it goes on. `None`: it was off.
    fn off_after_ms(&self, side: usize) -> Option<f64> {
        let fault_s = self.fault_s?;
        let changes = self.document["radio_hosts"]["devices"][["i", "j"][side]].as_array().unwrap();
        let changes = changes.iter().map(|change| (change["at_s"].as_f64().unwrap(), change["dbm"].as_f64()));
        let (before, after): (Vec<_>, Vec<_>) = changes.partition(|(at, _)| *at < fault_s);
        before.last()?.1?;
        let off = after.iter().find(|(_, dbm)| dbm.is_none());
        Some(off.map_or(f64::INFINITY, |(at, _)| 1e3 * (at - fault_s)))
    }

    /// What the preflights said of the radios.
    fn preflight(&self) -> String {
        let said = self.said.iter().filter_map(|line| {
            let refused = line.split_once("waiting: ").filter(|(_, text)| text.contains("TX_"));
            let warned = line.split_once("preflight warning: ").filter(|(_, text)| text.starts_with("TX_"));
            let (word, (_, text)) = match (refused, warned) {
                (Some(refused), _) => ("refused", refused),
                (None, warned) => ("warned", warned?),
            };
            let text = &text[text.find("TX_")?..];
            // Value and what it should be, without the reason.
            Some(format!("{word}: {}", text.splitn(3, ',').take(2).collect::<Vec<_>>().join(",")))
        });
        let all: std::collections::BTreeSet<String> = said.collect();
        if all.is_empty() { "nothing".to_owned() } else { Vec::from_iter(all).join("; ") }
    }
}

/// What a preflight that fails says again and again.
fn refuses(line: &str) -> bool {
    line.contains("waiting: ") && line.contains("TX_") && line.contains("should be")
}

fn fly(setup: &Setup, case: &Case) -> Flown {
    let directory = setup.directory.join(&case.name);
    std::fs::create_dir_all(&directory).unwrap();
    let write = |name: &str, text: &str| {
        let path = directory.join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let out = directory.join("out");
    let mut sitl = Command::new(&setup.program);
    sitl.arg("sitl").arg(write("mission.toml", MISSION)).arg("--json").args(&case.options);
    sitl.arg("--faults").arg(write("faults.toml", &case.faults)).arg("--out").arg(&out);
    sitl.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = sitl.spawn().unwrap();
    let mut said = Vec::new();
    let mut interrupted = false;
    for line in BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap) {
        if refuses(&line) && !std::mem::replace(&mut interrupted, true) {
            // It would wait on the ground for ever.
            let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw).unwrap();
            kill_process(pid, Signal::INT).unwrap();
        }
        said.push(line);
    }
    let mut document = String::new();
    child.stdout.take().unwrap().read_to_string(&mut document).unwrap();
    child.wait().unwrap();
    let document =
        serde_json::from_str(&document).unwrap_or_else(|error| panic!("{}: {error}\n{said:#?}", case.name));
    let events = std::fs::read_to_string(out.join("events.jsonl")).unwrap_or_default();
    let mut events = events.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let fault = events.find(|event| event["kind"] == "fault");
    Flown { document, said, fault_s: fault.and_then(|event| event["at_s"].as_f64()) }
}

/// Flies all cases, some at once, in any order; the results in the cases' order.
fn fly_all(setup: &Setup, cases: &[Case]) -> Vec<Flown> {
    let next = AtomicUsize::new(0);
    let flown: Vec<Mutex<Option<Flown>>> = cases.iter().map(|_| Mutex::new(None)).collect();
    std::thread::scope(|scope| {
        for _ in 0..setup.at_once {
            scope.spawn(|| {
                while let Some((case, slot)) = {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    cases.get(index).zip(flown.get(index))
                } {
                    *slot.lock().unwrap() = Some(fly(setup, case));
                }
            });
        }
    });
    flown.into_iter().map(|slot| slot.into_inner().unwrap().unwrap()).collect()
}

/// The kinds of device, and two that are known to be too slow.
const BACKENDS: &[(&str, &[&str])] = &[
    ("command", &["--radio-hosts", "command"]),
    ("attenuator", &["--radio-hosts", "attenuator"]),
    ("json_rpc", &["--radio-hosts", "json_rpc"]),
    ("at", &["--radio-hosts", "at"]),
    ("json_rpc, unavailable for 5 s", &["--radio-hosts", "json_rpc", "--device-ms", "20", "5000"]),
    ("at, restarting its interface", &["--radio-hosts", "at", "--device-ms", "20", "1500"]),
];

/// A flight as it should go with each kind of device.
pub fn by_backend(setup: &Setup, only: &str) {
    let cases: Vec<Case> = BACKENDS
        .iter()
        .enumerate()
        .filter(|(_, (name, _))| name.contains(only))
        .map(|(k, (_, options))| Case {
            name: format!("backend-{k}"),
            options: [*options, &["--device-dead-ms", "400"]].concat(),
            faults: String::new(),
            side: 0,
        })
        .collect();
    if cases.is_empty() {
        return;
    }
    let names = BACKENDS.iter().map(|(name, _)| *name).filter(|name| name.contains(only));
    println!(
        "{:<30} {:>6} {:>9}  {:<9} {:>14} {:>10}  preflight",
        "backend", "off ms", "change ms", "completed", "unprotected ms", "violations"
    );
    for (name, flown) in names.zip(fly_all(setup, &cases)) {
        let radios = &flown.document["radio_hosts"];
        println!(
            "{name:<30} {:>6} {:>9}  {:<9} {:>14.0} {:>10}  {}",
            radios["off_ms"],
            radios["change_ms"],
            if flown.completed() { "yes" } else { "no" },
            flown.unprotected_ms(),
            flown.count("violations"),
            flown.preflight(),
        );
    }
    println!();
}

/// What is done to whom: row, kind in the fault file, for how long, and the devices' own dead-man's switch.
const FAULTS: &[(&str, &str, Option<f64>, bool)] = &[
    ("companion killed", "companion-kill", None, false),
    ("companion stopped", "companion-stop", Some(3.0), false),
    ("companion cut off from its host", "radio-host-loss", Some(3.0), false),
    ("host killed", "radio-host-kill", None, false),
    ("host killed, dead-man 400 ms", "radio-host-kill", None, true),
    ("host stopped", "radio-host-stop", Some(3.0), false),
    ("host stopped, dead-man 400 ms", "radio-host-stop", Some(3.0), true),
    ("host cut off from its device", "device-loss", Some(3.0), false),
    ("device killed", "device-kill", None, false),
    ("device stopped", "device-stop", Some(3.0), false),
    ("device mute", "device-mute", Some(3.0), false),
];

/// Every fault, of either vehicle, at so many instants of a slot.
pub fn by_fault(setup: &Setup, instants: usize, only: &str) {
    println!(
        "an attenuator; stopped and cut for 3 s; {instants} instants of a slot; times in ms, median and worst"
    );
    println!(
        "{:<33} {:<2} {:>7} {:>9} {:>9} {:>6} {:>9} {:>9} {:>10} {:>8} {:>5}",
        "what", "of", "flights", "off", "worst", "never", "unprot.", "worst", "violations", "excused", "late"
    );
    for (row, kind, duration_s, dead_man) in FAULTS.iter().filter(|(row, ..)| row.contains(only)) {
        let cases: Vec<Case> =
            (0..2 * instants).map(|k| case(row, kind, *duration_s, *dead_man, (k, instants))).collect();
        let flown = fly_all(setup, &cases);
        for side in 0..2 {
            let of_side: Vec<&Flown> = cases
                .iter()
                .zip(&flown)
                .filter(|(case, _)| case.side == side)
                .map(|(_, flown)| flown)
                .collect();
            print_row(row, side, &of_side);
        }
    }
}

fn case(
    row: &str,
    kind: &str,
    duration_s: Option<f64>,
    dead_man: bool,
    (k, instants): (usize, usize),
) -> Case {
    let side = k / instants;
    let after_s = AIRTIME_S * ((k % instants) as f64 + 0.5) / instants as f64;
    let vehicle = ["i", "j"][side];
    let lasts = duration_s.map(|s| format!("duration_s = {s:?}\n")).unwrap_or_default();
    let mut options = vec!["--radio-hosts", "attenuator"];
    if dead_man {
        options.extend(["--device-dead-ms", "400"]);
    }
    Case {
        name: format!("{}-{k}", row.replace([' ', ','], "-")),
        options,
        faults: format!(
            "[[fault]]\nkind = \"{kind}\"\nvehicle = \"{vehicle}\"\nslot = 0\nafter_s = {after_s:.4}\n{lasts}"
        ),
        side,
    }
}

fn print_row(row: &str, side: usize, flown: &[&Flown]) {
    let mut off: Vec<f64> = flown.iter().filter_map(|flown| flown.off_after_ms(side)).collect();
    let never = off.iter().filter(|ms| ms.is_infinite()).count();
    off.retain(|ms| ms.is_finite());
    let mut unprotected: Vec<f64> = flown.iter().map(|flown| flown.unprotected_ms()).collect();
    let sum = |what: &str| flown.iter().map(|flown| flown.count(what)).sum::<usize>();
    let late_ms = flown.iter().map(|flown| flown.late_ms()).max().unwrap_or(0);
    let [off_median, off_worst] = median_and_worst(&mut off);
    let [median, worst] = median_and_worst(&mut unprotected);
    println!(
        "{row:<33} {:<2} {:>7} {off_median:>9} {off_worst:>9} {never:>6} {median:>9} {worst:>9} {:>10} {:>8} {late_ms:>5}",
        ["I", "J"][side],
        flown.len(),
        sum("violations"),
        sum("excused"),
    );
    for flown in flown.iter().filter(|flown| flown.count("violations") > 0) {
        for violation in flown.document["violations"].as_array().unwrap() {
            println!("    {violation}");
        }
    }
}

fn median_and_worst(values: &mut [f64]) -> [String; 2] {
    values.sort_by(f64::total_cmp);
    let at = |k: Option<usize>| k.and_then(|k| values.get(k)).map_or("-".to_owned(), |ms| format!("{ms:.0}"));
    [at(values.len().checked_sub(1).map(|last| last / 2)), at(values.len().checked_sub(1))]
}
