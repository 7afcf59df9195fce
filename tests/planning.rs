//! A mission has one plan, whichever command makes it.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::time::Duration;

use serde_json::Value;
use veilwing::config::{Mission, Optimise};
use veilwing::geo::{Attitude, Pose};
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::slots::{Plan, hex};
use veilwing::planner::turning::Knot;
use veilwing::planner::volume::Fairness;
use veilwing::planner::{EvaluateOptions, evaluate};
use veilwing::planning::{self, Delivered};
use veilwing::role::{PerVehicle, Role};
use veilwing::schedule::order::Order;
use veilwing::schedule::table::Table;
use veilwing::schedule::trajectory::Start;
use veilwing::schedule::transit::Router;

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

/// The same users, whose plan is to deliver much, from one place or from several.
fn yard(change: &str) -> Mission {
    let text = mission("listed").replace("slot_s = 5.0", "slot_s = 10.0\nsuperframes = 3");
    Mission::parse("m.toml", &format!("{text}[planner]\n{change}")).unwrap()
}

fn poses(plan: &Plan) -> Vec<PerVehicle<Pose>> {
    plan.slots.iter().map(|slot| slot.plan.vehicles.map(|vehicle| vehicle.pose)).collect()
}

/// Volume and length of a superframe by another road: rates of the poses from other samples, and what the slot table says of
/// a mission that comes from far away and goes round three times.
fn again(mission: &Mission, plan: &Plan) -> (Vec<f64>, f64) {
    let router = Router::new(&mission.airspace, &mission.transit_limits()).unwrap();
    let at = |x| Start { position_enu_m: [x, -400.0, 80.0].into(), attitude: Attitude::level() };
    let start = PerVehicle { i: at(-400.0), j: at(-300.0) };
    let users: Vec<_> = poses(plan).into_iter().map(|poses| vec![poses]).collect();
    let timing = mission.timing();
    let lengths = plan.lengths(timing.slot);
    let table = Table::with_lengths(&router, &start, &users, &lengths, &timing, Order::Listed).unwrap();
    let opens = |slot: usize| table.entries[slot].opens;
    let superframe = opens(2 * users.len()) - opens(users.len());
    let volumes = table.entries[..users.len()].iter().map(|entry| {
        let slot = &plan.slots[entry.user_index];
        let problem = mission.problem(entry.user_index).unwrap();
        let options = EvaluateOptions { seed: 99, ..EvaluateOptions::default() };
        let rate = evaluate(&problem, &slot.plan.vehicles, &options).unwrap().secrecy_rate_bps;
        rate * (entry.radiate_until - entry.radiate_from).as_secs_f64()
    });
    (volumes.collect(), superframe.as_secs_f64())
}

#[test]
fn val_what_a_plan_delivers_is_what_its_poses_and_the_slot_table_give() {
    let mut per_second = Vec::new();
    for change in ["", "optimise = \"volume\"", "optimise = \"volume\"\nfairness = \"max-min\""] {
        let mission = yard(change);
        let plan = planning::plan(&mission).unwrap();
        let stated = planning::delivered(&mission, &plan);
        let (volumes, superframe_s) = again(&mission, &plan);
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 5e-3;
        assert!(
            (stated.superframe_s.unwrap() - superframe_s).abs() < 0.11,
            "{change}: {stated:?} {superframe_s}"
        );
        assert!(close(stated.volume_bits, volumes.iter().sum()), "{change}: {stated:?} {volumes:?}");
        let least = volumes.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(close(stated.least_user_volume_bits, least), "{change}: {stated:?} {volumes:?}");
        let slots_s: f64 = plan.lengths(mission.timing().slot).iter().map(Duration::as_secs_f64).sum();
        assert!((stated.on_air_s - (slots_s - 2.0)).abs() < 1e-9 && slots_s <= 20.0, "{change}: {stated:?}");
        per_second.push([volumes.iter().sum::<f64>(), least].map(|volume| volume / superframe_s));
    }
    let [rate, volume, fair] = per_second[..] else { panic!("{per_second:?}") };
    assert!(volume[0] > 1.1 * rate[0], "{per_second:?}");
    assert!(fair[1] >= volume[1] * (1.0 - 1e-2), "{per_second:?}");
}

/// The pair where it is, with the axes of a knot's poses part of the way to the next one's.
fn between(from: &Knot, to: &Knot, share: f64) -> PerVehicle<VehiclePlan> {
    PerVehicle::from_fn(|role| {
        let (here, there) = (from.vehicles[role], to.vehicles[role].pose);
        let mix = |a: f64, b: f64| a + share * (b - a);
        let pose = Pose {
            roll_rad: mix(here.pose.roll_rad, there.roll_rad),
            pitch_rad: mix(here.pose.pitch_rad, there.pitch_rad),
            ..here.pose
        };
        VehiclePlan { pose, ..here }
    })
}

#[test]
fn val_what_is_delivered_through_turns_is_what_its_knots_give() {
    for optimise in ["rate", "volume"] {
        let planned = |mode: &str| {
            let mission = yard(&format!("optimise = \"{optimise}\"\nmode = \"{mode}\""));
            let plan = planning::plan(&mission).unwrap();
            let delivered = planning::delivered(&mission, &plan);
            (mission, plan, delivered)
        };
        let (_, held, before) = planned("static");
        let (mission, plan, after) = planned("turning");
        assert!(held.turns.is_none() && held.digest != plan.digest, "{optimise}");
        let per_second = |delivered: &Delivered| delivered.volume_bits / delivered.superframe_s.unwrap();
        assert!(per_second(&after) >= per_second(&before) * (1.0 - 2e-3), "{optimise}: {before:?} {after:?}");

        let turns = plan.turns.as_ref().unwrap();
        let guard_s = mission.tdma.guard_s;
        let (mut volumes, mut on_air_s) = (vec![0.0; mission.users.len()], 0.0);
        for slot in &turns.slots {
            assert!(slot.silence_s >= guard_s - 1e-9, "{optimise}: {}", slot.silence_s);
            for pair in slot.knots.windows(2) {
                let [from, to] = pair else { unreachable!() };
                let length_s = to.at_s - from.at_s;
                for role in Role::BOTH {
                    let [a, b] = [from, to].map(|knot| knot.vehicles[role].pose);
                    let turned_rad = (a.roll_rad - b.roll_rad).hypot(a.pitch_rad - b.pitch_rad);
                    let most_rad = mission.vehicles[role].tilt_rate_rad_s * length_s;
                    assert!(turned_rad <= most_rad * (1.0 + 1e-9) + 1e-12, "{optimise}: {role} {turned_rad}");
                    assert_eq!(a.position_enu_m, b.position_enu_m);
                }
                let Some(user) = from.served else { continue };
                let problem = mission.problem(user).unwrap();
                let options = EvaluateOptions { seed: 99, ..EvaluateOptions::default() };
                // Simpson's rule.
                let rate =
                    |share| evaluate(&problem, &between(from, to, share), &options).unwrap().secrecy_rate_bps;
                volumes[user] += length_s * (rate(0.0) + 4.0 * rate(0.5) + rate(1.0)) / 6.0;
                on_air_s += length_s;
            }
        }
        let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-2;
        assert!(close(after.volume_bits, volumes.iter().sum()), "{optimise}: {after:?} {volumes:?}");
        let least = volumes.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(close(after.least_user_volume_bits, least), "{optimise}: {after:?} {volumes:?}");
        assert!((after.on_air_s - on_air_s).abs() < 1e-9, "{optimise}: {after:?} {on_air_s}");
    }
}

#[test]
fn spec_a_plan_that_turns_is_told_by_its_knots_the_same_on_any_threads_and_flown() {
    let directory = command::directory("turning-plan");
    let file = directory.join("mission.toml");
    let text = format!("{}[planner]\noptimise = \"volume\"\nmode = \"turning\"\n", mission("listed"));
    std::fs::write(&file, &text).unwrap();
    let file = file.to_str().unwrap();
    let planned = document(&["plan", file, "--json"]);
    let again = document(&["plan", file, "--json", "--threads", "3"]);
    assert_eq!(planned["plan_digest"], again["plan_digest"]);
    let number = |value: &Value| value.as_f64().unwrap();
    let (mut volume, mut length_s) = (0.0, 0.0);
    for slot in planned["slots"].as_array().unwrap() {
        assert_eq!(slot["knots"], again["slots"][if slot["user"] == "user-1" { 0 } else { 1 }]["knots"]);
        let knots = slot["knots"].as_array().unwrap();
        let told: f64 = knots
            .windows(2)
            .map(|pair| {
                let user = pair[0]["served"].as_str().unwrap();
                assert_eq!(user, slot["user"].as_str().unwrap());
                number(&pair[0]["secrecy_rate_bps"]) * (number(&pair[1]["at_s"]) - number(&pair[0]["at_s"]))
            })
            .sum();
        assert!((told / number(&slot["secrecy_volume_bits"]) - 1.0).abs() < 1e-9, "{slot}");
        assert!(knots.last().unwrap()["served"].is_null());
        assert!(number(&knots[0]["tolerance"]["pointing_deg"]["j"]) > 0.0);
        volume += told;
        length_s += number(&slot["on_air_s"]) + number(&slot["silence_s"]);
    }
    assert!((volume / number(&planned["secrecy_volume_bits"]) - 1.0).abs() < 1e-9);
    assert!((length_s - number(&planned["superframe_s"])).abs() < 1e-9);

    let table = command::veilwing(&["plan", file]).output().unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("silent_s") && table.contains("and again after"), "{table}");
    let flown = document(&["campaign", file, "--runs", "1", "--json"]);
    assert_eq!((&flown["completed"], flown["violations"].as_array().unwrap().len()), (&Value::from(1), 0));
    let delivered = number(&flown["flights"][0]["secrecy_volume_bits"]);
    assert!((0.97..1.03).contains(&(delivered / volume)), "{delivered} {volume}");
}

#[test]
fn spec_a_plan_that_moves_states_its_ways_the_same_on_any_threads_and_is_flown() {
    let directory = command::directory("moving-plan");
    let file = directory.join("mission.toml");
    let demo = std::fs::read_to_string("config/mission.toml").unwrap();
    let moving = demo.replace("mode = \"static\"", "mode = \"moving\"");
    assert_ne!(demo, moving);
    std::fs::write(&file, &moving).unwrap();
    let file = file.to_str().unwrap();
    let planned = document(&["plan", file, "--json"]);
    let again = document(&["plan", file, "--json", "--threads", "2"]);
    assert_eq!(planned["plan_digest"], again["plan_digest"]);
    assert_eq!(planned["motion"], again["motion"]);
    let number = |value: &Value| value.as_f64().unwrap();
    let motion = &planned["motion"];
    assert_eq!(motion["period_s"], planned["superframe_s"]);
    // Knots lie on the ways that the control points draw.
    for role in ["i", "j"] {
        let points: Vec<[f64; 3]> = serde_json::from_value(motion["control_enu_m"][role].clone()).unwrap();
        let n = points.len();
        for slot in planned["slots"].as_array().unwrap() {
            for knot in slot["knots"].as_array().unwrap() {
                let at = (number(&knot["at_s"]) / number(&motion["period_s"])).fract() * n as f64;
                for c in 0..3 {
                    let drawn: f64 = (0..n)
                        .map(|k| {
                            // The cubic B-spline of the distance round the cycle.
                            let d = (at - k as f64).abs();
                            let d = d.min(n as f64 - d);
                            let b = if d < 1.0 {
                                (4.0 - 6.0 * d * d + 3.0 * d * d * d) / 6.0
                            } else {
                                (2.0 - d).max(0.0).powi(3) / 6.0
                            };
                            b * points[k][c]
                        })
                        .sum();
                    let told = number(&knot["vehicles"][role]["position_enu_m"][c]);
                    assert!((told - drawn).abs() < 1e-6, "{role} at {at}: {told} {drawn}");
                }
            }
        }
        assert!(number(&motion["demand"][role]["speed_m_s"]) > 0.1);
    }
    let turning = Mission::parse("m.toml", &demo.replace("mode = \"static\"", "mode = \"turning\"")).unwrap();
    let turning = planning::delivered(&turning, &planning::plan(&turning).unwrap());
    let per_second = number(&planned["secrecy_volume_bits"]) / number(&planned["superframe_s"]);
    assert!(per_second >= 1.01 * turning.volume_bits / turning.superframe_s.unwrap());

    let table = command::veilwing(&["plan", file]).output().unwrap();
    let table = String::from_utf8(table.stdout).unwrap();
    assert!(table.contains("both move all the while"), "{table}");
    let flown = document(&["campaign", file, "--runs", "1", "--json"]);
    assert_eq!((&flown["completed"], flown["violations"].as_array().unwrap().len()), (&Value::from(1), 0));
    let delivered = number(&flown["flights"][0]["secrecy_volume_bits"]);
    let volume = number(&planned["secrecy_volume_bits"]);
    assert!((0.95..1.05).contains(&(delivered / volume)), "{delivered} {volume}");
    let text = format!("{}[planner]\noptimise = \"rate\"\nmode = \"moving\"\n", mission("listed"));
    let refused = Mission::parse("m.toml", &text).unwrap_err().to_string();
    assert!(refused.contains("set optimise = \"volume\""), "{refused}");
}

#[test]
fn spec_a_plan_for_volume_is_the_same_on_every_road_and_any_threads() {
    let directory = command::directory("volume-plan");
    let file = directory.join("mission.toml");
    for fairness in ["slots", "max-min"] {
        let text =
            format!("{}[planner]\noptimise = \"volume\"\nfairness = \"{fairness}\"\n", mission("listed"));
        let read = Mission::parse("m.toml", &text).unwrap();
        assert_eq!(read.planner.optimise, Optimise::Volume);
        let digest = hex(&planning::plan(&read).unwrap().digest);
        std::fs::write(&file, &text).unwrap();
        let file = file.to_str().unwrap();
        for threads in ["1", "3"] {
            assert_eq!(
                document(&["plan", file, "--json", "--threads", threads])["plan_digest"],
                digest.as_str()
            );
        }
        // Its document can be scored again, its slots as long as it says.
        let out = directory.join(fairness);
        let planned = document(&["plan", file, "--json", "--out", out.to_str().unwrap()]);
        let scored = document(&["evaluate", file, out.join("plan.json").to_str().unwrap(), "--json"]);
        assert_eq!(scored["plan_digest"], digest.as_str());
        for key in ["superframe_s", "on_air_s"] {
            assert_eq!(scored[key], planned[key], "{key}");
        }
        let volume = |document: &Value| document["secrecy_volume_bits"].as_f64().unwrap();
        assert!((volume(&scored) / volume(&planned) - 1.0).abs() < 5e-3);
        // Flown: slots are served as long as they are, and the world measures what it delivers.
        let flown = document(&["campaign", file, "--runs", "1", "--json"]);
        let flight = &flown["flights"][0];
        assert_eq!(
            (&flown["plan_digest"], &flight["result"]),
            (&digest.as_str().into(), &"completed".into()),
            "{flown}"
        );
        let delivered = volume(flight) / volume(&planned);
        assert!((0.9..1.1).contains(&delivered), "{fairness}: {delivered}");
        let on_air = flight["on_air_s"].as_f64().unwrap() / planned["on_air_s"].as_f64().unwrap();
        assert!((0.97..=1.0).contains(&on_air), "{fairness}: {on_air}");
        assert_eq!(flight["unprotected_s"], 0.0);
    }
}

#[test]
fn spec_the_paper_s_methods_know_no_volume_and_say_so() {
    let directory = command::directory("volume-method");
    let file = directory.join("mission.toml");
    std::fs::write(&file, format!("{}[planner]\noptimise = \"volume\"\n", mission("listed"))).unwrap();
    let output = command::veilwing(&["plan", file.to_str().unwrap(), "--method", "paper"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = command::said(&output);
    assert!(said.contains("planner.optimise = \"rate\""), "{said}");
}

#[test]
fn spec_slots_are_as_long_as_the_least_served_asks_for() {
    let mission = yard("optimise = \"volume\"\nfairness = \"max-min\"");
    assert_eq!(mission.planner.fairness, Fairness::MaxMin);
    let plan = planning::plan(&mission).unwrap();
    let lengths = plan.lengths(mission.timing().slot);
    let volumes: Vec<f64> = plan
        .slots
        .iter()
        .zip(&lengths)
        .map(|(slot, length)| slot.plan.secrecy_rate_bps * (length.as_secs_f64() - 1.0))
        .collect();
    assert!(volumes[0] / volumes[1] < 1.01 && volumes[1] / volumes[0] < 1.01, "{volumes:?} {lengths:?}");
}

/// A plan that is made once more in flight is the one that a mission would have which stated what was measured, by the users as that
/// mission lists them.
#[test]
fn spec_a_plan_made_again_is_that_of_a_mission_that_states_what_was_measured() {
    let mission = Mission::parse("m.toml", &mission("shortest")).unwrap();
    let shares = PerVehicle { i: 1.0, j: 0.5 };
    let again = |order: &[usize]| planning::again(&mission, 0.06, &shares, order);
    let stated = mission.changed(|draft| {
        draft.jitter.std_deg = f64::to_degrees(0.06);
        draft.vehicles.j.speed_m_s *= 0.5;
        draft.tdma.order = Order::Listed;
    });
    assert_eq!(again(&[0, 1]), planning::plan(&stated.unwrap()).ok());
    let other = again(&[1, 0]).unwrap();
    assert_eq!(other.slots.iter().map(|slot| slot.user.as_str()).collect::<Vec<_>>(), ["user-1", "user-2"]);
    // Users that are not all of them, and a speed that no mission may state.
    assert_eq!((again(&[0]), again(&[0, 2])), (None, None));
    assert_eq!(planning::again(&mission, 0.06, &PerVehicle { i: 1.0, j: 0.0 }, &[0, 1]), None);
}
