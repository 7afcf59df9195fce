//! What a flight is said to be in words: its phases, what is waited for, and how bad it is.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use veilwing::desk::simulation::Observer;
use veilwing::planner::slots::Plan;
use veilwing::role::{PerVehicle, Role};
use veilwing::service::Standing;
use veilwing_sitl::Fault;

use crate::asked::said;
use crate::face::Watched;
use crate::harness::*;

/// The phases that the companion of I has been in.
#[derive(Default)]
struct Phases(Vec<&'static str>);

impl Observer for Phases {
    fn stands(&mut self, _at: Duration, role: Role, phase: &'static str, _standing: Standing) {
        if role == Role::I && self.0.last() != Some(&phase) {
            self.0.push(phase);
        }
    }
}

#[test]
fn spec_the_phases_of_a_flight_are_told_by_their_names() {
    let mut watched = Watched::new(true);
    let mut phases = Phases::default();
    while watched.flight.outcomes.i.is_none() {
        watched.flight.step(LONGEST, &mut phases).unwrap();
    }
    let (slots, between) = (["ready", "slot"], ["standby", "taking control", "arming", "climbing"]);
    let home = ["returning", "landing", "ended"];
    let expected: Vec<_> = between.into_iter().chain(slots).chain(slots).chain(home).collect();
    let begun = phases.0.iter().position(|phase| *phase == "standby").unwrap();
    assert_eq!(phases.0[begun..], expected);
}

#[test]
fn spec_what_the_other_vehicle_owes_is_said_in_words() {
    let waits = |mut flight: Flight, words: &str| {
        flight.pass(Duration::from_secs(20));
        let waiting = flight
            .log
            .notices
            .iter()
            .filter(|(_, role, text)| *role == Role::I && text.starts_with("waiting: "));
        assert!(waiting.clone().any(|(.., text)| text.contains(words)), "{words}\n{}", flight.story());
    };
    let setup = || Setup { start_unasked: false, ..Setup::default() };
    let mut nowhere = Flight::new(setup());
    nowhere.set_autopilot_path(Role::J, Path::CUT);
    waits(nowhere, "vehicle J does not know yet where it stands");
    let given = PerVehicle { i: yard().clone(), j: yard().under(|m| m.tdma.slot_s = 5.5) };
    waits(Flight::new(Setup { given, ..setup() }), "vehicle J flies another mission");
    let mut other = yard().clone();
    other.plan.slots[1].plan.vehicles.j.tx_power_w *= 1.0 - f64::EPSILON;
    other.plan = Plan::new(other.plan.slots);
    let given = PerVehicle { i: yard().clone(), j: other };
    waits(Flight::new(Setup { given, ..setup() }), "vehicle J made another plan");
    let mut unfit = Flight::new(setup());
    let wrong = PARAM_SET_DATA {
        param_value: f32::from_le_bytes(60_i32.to_le_bytes()),
        target_system: 2,
        target_component: 1,
        param_id: "FD_FAIL_R".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_INT32,
    };
    unfit.tell_autopilot(Role::J, &MavMessage::PARAM_SET(wrong));
    waits(unfit, "vehicle J is not ready");
    // What nothing fails of is said once.
    let mut ready = Flight::new(setup());
    ready.pass(Duration::from_secs(100));
    let orders = ready
        .log
        .notices
        .iter()
        .filter(|(_, role, text)| *role == Role::I && text == "waiting: MISSION_START");
    assert_eq!(orders.count(), 1, "{}", ready.story());
    for (by_s, late, early) in [(5.0, "I", "J"), (-5.0, "J", "I")] {
        let mut flight = Flight::new(setup());
        flight.world.inject(Fault::ClockJump { vehicle: 1, by_s });
        let words =
            format!("the autopilot's clock of vehicle {late} is 5.00 s behind that of vehicle {early}");
        waits(flight, &words);
    }
}

#[test]
fn spec_how_bad_it_is_is_said_beside_the_words() {
    let mut watched = Watched::new(true);
    watched.pass(Duration::from_secs(10));
    watched.command(Role::I, MavCmd::MAV_CMD_USER_2, 0.0);
    let severity = |what: &str| {
        said(&watched, 0).find_map(|m| match m {
            MavMessage::STATUSTEXT(m) if m.text.to_str().unwrap().contains(what) => Some(m.severity),
            _ => None,
        })
    };
    for (what, how) in [
        ("autopilot found", MavSeverity::MAV_SEVERITY_INFO),
        ("preflight warning", MavSeverity::MAV_SEVERITY_WARNING),
        ("mission aborted: radio kill", MavSeverity::MAV_SEVERITY_ERROR),
    ] {
        assert_eq!(severity(what), Some(how), "{what}");
    }
}
