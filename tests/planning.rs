//! A mission has one plan, whichever command makes it.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use serde_json::Value;
use veilwing::config::Mission;
use veilwing::planner::slots::hex;
use veilwing::planning;

/// Two users between two eavesdroppers that mirror each other: each slot has several plans of the same worth, and the
/// shortest transits are not between the first of them.
fn mission(order: &str) -> String {
    let node =
        |kind: &str, east: f64, north: f64| format!("[[{kind}]]\nenu_m = [{east:?}, {north:?}, 0.0]\n");
    let nodes = [("user", 0.0, 0.0), ("user", 80.0, 0.0), ("eavesdropper", 100.0, 100.0)];
    let nodes: String = nodes.map(|(kind, east, north)| node(kind, east, north)).concat();
    format!(
        "[mission]\nseed = 1\n[tdma]\norder = \"{order}\"\nslot_s = 5.0\n{nodes}{}",
        node("eavesdropper", 100.0, -100.0)
    )
}

fn document(arguments: &[&str]) -> Value {
    let output = command::veilwing(arguments).output().unwrap();
    assert!(output.status.success(), "{}", command::said(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn spec_every_road_gives_the_plan_of_the_shortest_order() {
    let directory = command::directory("one-plan");
    let digest = |order: &str| {
        let mission = Mission::parse("m.toml", &mission(order)).unwrap();
        hex(&planning::plan(&mission).unwrap().digest)
    };
    let shortest = digest("shortest");
    assert_ne!(shortest, digest("listed"), "the order must matter, or nothing is shown");

    let file = directory.join("mission.toml");
    std::fs::write(&file, mission("shortest")).unwrap();
    let file = file.to_str().unwrap();
    assert_eq!(document(&["plan", file, "--json"])["plan_digest"], shortest.as_str());
    assert_eq!(document(&["plan", file, "--json", "--threads", "2"])["plan_digest"], shortest.as_str());

    // Flown: both companions hold the plan that the world judges them by.
    let out = directory.join("flight");
    let flown = document(&["campaign", file, "--runs", "1", "--json", "--out", out.to_str().unwrap()]);
    assert_eq!(flown["plan_digest"], shortest.as_str());
    assert_eq!(flown["flights"][0]["result"], "completed", "{flown}");
    let kept: Value = serde_json::from_slice(&std::fs::read(out.join("plan.json")).unwrap()).unwrap();
    assert_eq!(kept["plan_digest"], shortest.as_str());
}
