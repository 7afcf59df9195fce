//! What simulated flights come to: every kind of the companions' states, news and refusals, over flights of fixed seeds
//! with the harsher faults, and over a few that are made to come to what is rare. A kind that none of them reaches is code
//! that no flight tries, or is listed here with what tries it instead. `veilwing campaign --coverage` counts the same over
//! any number of flights.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;

use veilwing::config::Mission;
use veilwing::desk::campaign::coverage::{Counts, Tally, add, nothing, table};
use veilwing::desk::simulation::{Faults, Scenario, draw};
use veilwing::planning;

/// Flights with the harsher faults; two threads share them.
const FLIGHTS: u64 = 120;

/// What few flights would come to by chance, each in a flight of its own.
const SCRIPTS: &[&str] = &[
    // A battery that lasts a minute and a half.
    r#"
        [[fault]]
        kind = "battery-weak"
        vehicle = "j"
        after_s = 0.0
        times = 20.0
    "#,
    // A radio of whose answers nothing comes in mid-slot.
    r#"
        [[fault]]
        kind = "radio-answers-frozen"
        vehicle = "j"
        slot = 0
        after_s = 2.0
        duration_s = 6.0
    "#,
    // A pause that ends.
    r#"
        [[fault]]
        kind = "operator-pause"
        vehicle = "i"
        after_s = 20.0
        [[fault]]
        kind = "operator-continue"
        vehicle = "j"
        after_s = 24.0
    "#,
    // A kill on the ground, lifted at one vehicle, then at the other, then a start.
    r#"
        [[fault]]
        kind = "operator-kill"
        vehicle = "i"
        after_s = 0.5
        [[fault]]
        kind = "operator-lift"
        vehicle = "i"
        after_s = 20.0
        [[fault]]
        kind = "operator-lift"
        vehicle = "j"
        after_s = 30.0
        [[fault]]
        kind = "operator-start"
        vehicle = "i"
        after_s = 40.0
    "#,
    // A kill while both are on the air.
    r#"
        [[fault]]
        kind = "operator-kill"
        vehicle = "j"
        slot = 0
        after_s = 1.5
    "#,
    // The other is gone when the start is given.
    r#"
        [[fault]]
        kind = "companion-restart"
        vehicle = "j"
        after_s = 2.0032
        duration_s = 40.0
    "#,
    // A clock that jumps: the next slot is refused for as long as the leader asks.
    r#"
        [[fault]]
        kind = "clock-jump"
        vehicle = "j"
        slot = 0
        after_s = 1.0
        step_s = 30.0
    "#,
    // Gusts that no controller stands.
    r#"
        [[fault]]
        kind = "wind-step"
        slot = 0
        after_s = 1.0
        speed_m_s = 40.0
    "#,
    // The estimate fails where nothing else does: just before one of the receiver's reports, which come five times a second, so
    // that this is heard before the position is late.
    r#"
        [[fault]]
        kind = "estimator-failure"
        vehicle = "j"
        slot = 0
        after_s = 1.045
    "#,
];

/// What these flights need not come to, and what tries it instead.
const ELSEWHERE: &[(&str, &[&str], &str)] = &[
    ("answer", &["VEILWING_ANSWER_LIMITS"], "another's word: no companion of ours answers so"),
    (
        "answer",
        &["VEILWING_ANSWER_WRONG_PLAN", "VEILWING_ANSWER_WRONG_SLOT"],
        "two that fly one plan never do; src/pair/coordinator/tests.rs",
    ),
    ("cause", &["NotRecorded"], "of a disk that takes nothing for long; tests/flight/start.rs"),
    ("cause", &["NotServed"], "the outcome says it, no notice does; tests/flight/agreement.rs"),
    ("cause", &["Astray"], "likewise; tests/flight/fence.rs"),
    ("cause", &["AutopilotRestarted", "Disarmed"], "the mode is lost first, and is the cause"),
    ("cause", &["BridgeDead"], "of ArduPilot's 6DoF frame; tests/flight/faults.rs"),
    ("cause", &["OutOfTurn"], "of two vehicles that exchange places; the yard's do not"),
    ("cause", &["Refused"], "of real autopilots; src/autopilot/pursuit.rs"),
    ("estimator", &["NotFinite", "OriginMoved"], "src/autopilot/tests/hearing.rs"),
    ("give-up", &["NoSlot"], "tests/flight/orders_table.rs"),
    ("notice", &["AutopilotNotReady"], "of real autopilots; src/autopilot/pursuit.rs"),
    (
        "notice",
        &["Astray"],
        "where a vehicle is blown that far, its autopilot's fence takes it first; tests/flight/fence.rs",
    ),
    (
        "notice",
        &["CalledBack"],
        "of links that are late by a second, and thrust vectors; tests/flight/faults.rs",
    ),
    ("notice", &["BridgeDead", "SentHome"], "of ArduPilot's 6DoF frame, of an order; tests/flight/faults.rs"),
    ("notice", &["MissionDiffers", "PlanDiffers"], "both fly one mission; tests/flight/agreement.rs"),
    ("notice", &["NoOperator", "ParameterRefused", "ParameterSet"], "tests/flight/agreement.rs, face.rs"),
    (
        "notice",
        &["NoWayHome"],
        "the other vehicle would have to bar every way; src/schedule/transit/tests.rs",
    ),
    ("notice", &["SameRole"], "src/pair/coordinator/tests.rs"),
    ("peer-silence", &["VEILWING_SILENCE_SHUTDOWN"], "nobody ends a process; tests/flight/agreement.rs"),
    (
        "radio-not-ready",
        &["NotAnswered", "NotHeard", "NotTaken", "Unsupported"],
        "the preflight waits for them; src/transmitter/numbered/tests",
    ),
    ("notice", &["FileTaken", "FileRefused"], "of a signal to a process; tests/stranger/sightings.py"),
    ("notice", &["ArmingRefused"], "no simulated autopilot asks; tests/flight/face.rs"),
    ("notice", &["OrderUnconfirmed"], "of a link that is deaf one way; tests/flight/orders.rs"),
    ("notice", &["SlotPutOff"], "of slots that carry each other on; tests/flight/turning.rs"),
    (
        "notice",
        &["Slow", "BlownOut"],
        "of winds that are stronger than a mission counts on; tests/flight/following.rs",
    ),
    (
        "notice",
        &["Replanned", "NotReplanned"],
        "of missions that know their vehicles too little, and no plan for them; tests/flight/renewal.rs, tests/planning.rs",
    ),
    ("notice", &["Jitter"], "of missions that know their vehicles too little; tests/flight/nominal.rs"),
    ("notice", &["MayLean"], "of conventional vehicles; src/mission/lean.rs"),
    ("notice", &["Troubled"], "of radio hosts; tests/flight/hosts.rs"),
    ("radio-not-ready", &["Trouble"], "of radio hosts; tests/flight/hosts.rs"),
    (
        "silence",
        &["Killed", "NotAuthorised", "NoPower", "NoSlot", "NotInControl"],
        "never what turns a radio off: others act first; src/service/interlock/decision/tests.rs",
    ),
    ("silence", &["Resting"], "of radios of the first form; src/service/interlock/decision/tests.rs"),
];

fn scenario() -> Scenario {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mission = Mission::load(&root.join("tests/flight/yard.toml")).unwrap();
    Scenario::new(&mission, &planning::plan(&mission).unwrap(), None).unwrap()
}

fn fly(scenario: &Scenario, faults: &Faults, seed: u64, sum: &mut Counts) {
    let mut tally = Tally::default();
    scenario.fly(seed, draw(faults, seed, scenario.lengths()), &mut tally).unwrap();
    add(sum, &tally.finish());
}

/// Of flights by chance.
fn campaign(scenario: &Scenario) -> Counts {
    let faults = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/faults-harsh.toml");
    let faults = Faults::load(&faults).unwrap();
    let every_other = |first: u64| {
        let mut sum = nothing();
        (first..FLIGHTS).step_by(2).for_each(|seed| fly(scenario, &faults, seed, &mut sum));
        sum
    };
    std::thread::scope(|scope| {
        let odd = scope.spawn(|| every_other(1));
        let mut sum = every_other(0);
        add(&mut sum, &odd.join().unwrap());
        sum
    })
}

#[test]
fn spec_every_kind_of_state_news_and_refusal_is_reached_or_tried_elsewhere() {
    let scenario = scenario();
    let mut counts = campaign(&scenario);
    for script in SCRIPTS {
        let mut sum = nothing();
        fly(&scenario, &Faults::parse("script.toml", script).unwrap(), 1, &mut sum);
        add(&mut counts, &sum);
    }
    println!("{}", table(&counts));
    let elsewhere = |group: &str, kind: &str| {
        ELSEWHERE.iter().any(|(of, kinds, _)| *of == group && kinds.contains(&kind))
    };
    for (group, kinds, _) in ELSEWHERE {
        for kind in *kinds {
            let count = counts.get(*group).and_then(|known| known.get(*kind));
            assert!(count.is_some(), "{group}: {kind} is no such kind");
        }
    }
    let never = counts.iter().flat_map(|(group, kinds)| {
        let zero = kinds.iter().filter(|(kind, count)| **count == 0 && !elsewhere(group, kind));
        zero.map(move |(kind, _)| format!("{group}: {kind}"))
    });
    assert_eq!(never.collect::<Vec<_>>(), Vec::<String>::new(), "reached by no flight");
}
