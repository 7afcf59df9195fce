//! What simulated flights come to: every kind of the companions' states, news and refusals, over one campaign of fixed
//! seeds with the harsher faults. A kind that is never reached is code that no flight tries.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::BTreeMap;
use std::path::Path;

use veilwing::config::Mission;
use veilwing::desk::campaign::coverage::{Tally, add, nothing, table};
use veilwing::desk::simulation::{Faults, Scenario, draw};
use veilwing::planning;

/// Flights of the campaign; two threads share them.
const FLIGHTS: u64 = 240;

#[test]
fn spec_every_kind_of_state_news_and_refusal_is_reached() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mission = Mission::load(&root.join("tests/flight/yard.toml")).unwrap();
    let faults = Faults::load(&root.join("config/faults-harsh.toml")).unwrap();
    let scenario = Scenario::new(&mission, &planning::plan(&mission).unwrap(), None).unwrap();
    let fly = |first: u64| {
        let mut sum = nothing();
        for seed in (first..FLIGHTS).step_by(2) {
            let mut tally = Tally::default();
            scenario.fly(seed, draw(&faults, seed, scenario.lengths()), &mut tally).unwrap();
            add(&mut sum, &tally.finish());
        }
        sum
    };
    let mut sum = std::thread::scope(|scope| {
        let odd = scope.spawn(|| fly(1));
        let even = fly(0);
        let mut sum = odd.join().unwrap();
        add(&mut sum, &even);
        sum
    });
    println!("{}", table(&sum));
    let unreachable: BTreeMap<&str, &str> = UNREACHABLE.into_iter().collect();
    for (group, kinds) in &mut sum {
        for (kind, count) in kinds {
            let name = format!("{group}: {kind}");
            match unreachable.get(&*name) {
                None => assert!(*count > 0, "{name} is never reached"),
                Some(why) => assert_eq!(*count, 0, "{name} is reached, and was thought not to be: {why}"),
            }
        }
    }
}

/// What these flights cannot come to, with the reason.
const UNREACHABLE: [(&str, &str); 0] = [];
