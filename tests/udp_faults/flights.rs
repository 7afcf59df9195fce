//! Flights of `veilwing sitl` with its two companion processes, whose pair link over loopback UDP loses datagrams. A
//! companion is killed (SIGKILL), stopped for 3 s (SIGSTOP), or no longer heard by the other, at points of a slot from the
//! agreement on it to its end.

use std::path::PathBuf;
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::Value;

/// The pair link loses so many datagrams, in either direction, at all times.
const LOSS: f64 = 0.1;
const MISSION: &str = include_str!("../flight/yard.toml");
/// Flights under way at once.
const AT_ONCE: usize = 4;
/// How long a slot is open in the mission, in seconds.
const SLOT_S: f64 = 5.0;
/// S4's reaction, in seconds: what I may be on the air without J, after a fault.
const REACTION_S: f64 = 0.1;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    Kill,
    Stop,
    Cut,
}

/// One flight: what happens to whom, and when, in flight seconds after I was first on the air in slot 0.
#[derive(Debug, Clone, Copy)]
struct Case {
    fault: Fault,
    /// 0 is I, 1 is J. Of [`Fault::Cut`]: whose datagrams are lost.
    side: usize,
    point: u32,
    after_s: f64,
}

impl Case {
    /// What goes wrong, as `veilwing sitl --faults` reads it.
    fn faults(&self) -> String {
        let kind = match self.fault {
            Fault::None => None,
            Fault::Kill => Some("companion-kill\""),
            Fault::Stop => Some("companion-stop\"\nduration_s = 3.0"),
            Fault::Cut => Some("pair-loss\""),
        };
        let vehicle = ["i", "j"][self.side];
        let befalls = kind.map(|kind| {
            let after_s = self.after_s;
            format!("[[fault]]\nkind = \"{kind}\nvehicle = \"{vehicle}\"\nslot = 0\nafter_s = {after_s:.4}\n")
        });
        format!(
            "[[fault]]\nkind = \"pair-degraded\"\nloss = {LOSS}\nafter_s = 0\n{}",
            befalls.unwrap_or_default()
        )
    }

    /// Each point has its own air, and its own datagrams are lost.
    fn mission(&self) -> String {
        MISSION.replace("seed = 3", &format!("seed = {}", 3 + self.point))
    }
}

/// What a flight left behind.
struct Flown {
    document: Value,
    said: Vec<String>,
}

impl Flown {
    /// The flight second of the first line with all of these.
    fn second(&self, parts: &[&str]) -> Option<f64> {
        let line = self.said.iter().find(|line| parts.iter().all(|part| line.contains(part)))?;
        line.trim_start_matches('[').split_once(" s]")?.0.trim().parse().ok()
    }

    fn lost(&self) -> u64 {
        self.document.pointer("/messages/rejected/swallowed-by-fault").and_then(Value::as_u64).unwrap()
    }

    fn unprotected_s(&self) -> f64 {
        let slots = self.document["slots"].as_array().unwrap().iter();
        slots.map(|slot| slot["unprotected_s"].as_f64().unwrap()).fold(0.0, f64::max)
    }

    fn story(&self) -> String {
        format!("{}\n{:#}", self.said.join("\n"), self.document)
    }
}

/// How flights are flown.
pub struct Setup {
    /// The `veilwing` command.
    pub program: PathBuf,
    /// Each flight gets a directory in it.
    pub directory: PathBuf,
    /// Simulated seconds per second of wall time, by the wall's clock; no more than 4, for a loaded machine lets a process
    /// wait for 10 ms at times. `None`: the processes wait for each other, and none is late however long it waits.
    pub speed: Option<f64>,
}

fn fly(setup: &Setup, case: Case) -> Flown {
    let directory = setup.directory.join(format!("{:?}-{}-{}", case.fault, case.side, case.point));
    if directory.exists() {
        std::fs::remove_dir_all(&directory).unwrap();
    }
    std::fs::create_dir_all(&directory).unwrap();
    let write = |name: &str, text: &str| {
        let path = directory.join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let mut sitl = Command::new(&setup.program);
    sitl.arg("sitl").arg(write("mission.toml", &case.mission())).arg("--json");
    match setup.speed {
        Some(speed) => sitl.args(["--wall-clock", "--speed", &speed.to_string()]),
        None => sitl.args(["--speed", "50"]),
    };
    sitl.arg("--faults").arg(write("faults.toml", &case.faults())).arg("--out").arg(directory.join("out"));
    let output = sitl.output().unwrap();
    let said: Vec<String> = String::from_utf8_lossy(&output.stderr).lines().map(str::to_owned).collect();
    let document =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{case:?}: {error}\n{said:#?}"));
    Flown { document, said }
}

/// Flies all cases, some at once, in any order; the results in the cases' order.
fn fly_all(setup: &Setup, cases: &[Case]) -> Vec<Flown> {
    let next = AtomicUsize::new(0);
    let flown: Vec<Mutex<Option<Flown>>> = cases.iter().map(|_| Mutex::new(None)).collect();
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE {
            scope.spawn(|| {
                while let Some((case, slot)) = {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    cases.get(index).zip(flown.get(index))
                } {
                    *slot.lock().unwrap() = Some(fly(setup, *case));
                }
            });
        }
    });
    flown.into_iter().map(|slot| slot.into_inner().unwrap().unwrap()).collect()
}

/// The mission without a fault but the link's losses; from when to when slot 1 is, after the first on in slot 0.
fn slot_1(setup: &Setup) -> (f64, f64) {
    let flown = fly(setup, Case { fault: Fault::None, side: 0, point: 0, after_s: 0.0 });
    assert_eq!(flown.document["result"], "completed", "{}", flown.story());
    assert_eq!(flown.document["violations"], Value::Array(Vec::new()), "{}", flown.story());
    assert_eq!(flown.unprotected_s(), 0.0, "{}", flown.story());
    assert!(flown.lost() > 50, "{} datagrams lost", flown.lost());
    let second = |parts: &[&str]| flown.second(parts).unwrap_or_else(|| panic!("{}", flown.story()));
    let on = second(&["I  ", "slot 0: on"]);
    (second(&["I  ", "slot 1 for bravo: agreed"]) - on, second(&["J  ", "slot 1 for bravo: over"]) - on)
}

/// Ten points from the agreement on a slot to its end: four on the way to it, six while it is open.
fn point_s(point: u32, agreed_s: f64, over_s: f64) -> f64 {
    let opens_s = over_s - SLOT_S;
    match point {
        0..4 => agreed_s + (opens_s - agreed_s) * (f64::from(point) + 0.5) / 4.0,
        _ => opens_s + SLOT_S * (f64::from(point - 4) + 0.5) / 6.0,
    }
}

/// Flies every fault on either side at these points of ten, prints the table, and holds all to S1 to S5 and F1.
pub fn faults_at(setup: &Setup, points: &[u32]) {
    let (from_s, to_s) = slot_1(setup);
    println!(
        "slot 1: {from_s:.1} to {to_s:.1} s after I is first on the air; the pair link loses {:.0}%",
        LOSS * 100.0
    );
    let mut cases = Vec::new();
    for fault in [Fault::Kill, Fault::Stop, Fault::Cut] {
        for side in 0..2 {
            cases.extend(points.iter().map(|&point| {
                let after_s = point_s(point, from_s, to_s);
                Case { fault, side, point, after_s }
            }));
        }
    }
    let flown = fly_all(setup, &cases);
    println!("fault side point  after s   result   unprotected s  I on s  J on s  violations  separation m");
    for (case, flown) in cases.iter().zip(&flown) {
        let slot = &flown.document["slots"][1];
        let number = |value: &Value| value.as_f64().unwrap_or(f64::NAN);
        println!(
            "{:<5} {:<4} {:>5} {:>8.2} {:>8} {:>15.3} {:>7.2} {:>7.2} {:>11} {:>13.1}",
            format!("{:?}", case.fault),
            ["I", "J"][case.side],
            case.point,
            case.after_s,
            flown.document["result"].as_str().unwrap_or("?"),
            flown.unprotected_s(),
            number(&slot["radiated_s"]["i"]),
            number(&slot["radiated_s"]["j"]),
            flown.document["violations"].as_array().map_or(0, Vec::len),
            number(&flown.document["min_separation_m"]),
        );
    }
    for (case, flown) in cases.iter().zip(&flown) {
        assert_eq!(flown.document["violations"], Value::Array(Vec::new()), "{case:?}\n{}", flown.story());
        assert!(flown.unprotected_s() <= REACTION_S, "{case:?}\n{}", flown.story());
        // Whoever still has its companion and its autopilot comes home.
        let sides = ["I  ", "J  "];
        let lands = |side: usize| {
            flown.said.iter().any(|l| l.contains(sides[side]) && l.contains("landed and disarmed"))
        };
        assert!(lands(1 - case.side), "{case:?}\n{}", flown.story());
        assert!(case.fault != Fault::Cut || lands(case.side), "{case:?}\n{}", flown.story());
    }
}
