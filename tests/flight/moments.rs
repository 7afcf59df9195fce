//! What happens to a companion at other moments than in the plain flight, and from others.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use veilwing::autopilot::FenceDuty;
use veilwing::config::NoFlyDraft;
use veilwing::desk::simulation::Observer;
use veilwing::mission::{Outcome, Outgoing};
use veilwing::role::{PerVehicle, Role};
use veilwing_sitl::Fault;

use crate::asked::{command, phase, said, told};
use crate::face::Watched;
use crate::harness::*;
use crate::kinds::level;

#[test]
fn spec_a_kill_is_not_lifted_under_an_armed_vehicle_though_its_companion_has_just_started() {
    let mut flight = in_mid_slot(Setup::default());
    flight.command(Role::I, MavCmd::MAV_CMD_USER_2);
    flight.pass(Duration::from_secs(1));
    flight.kill(Role::I);
    flight.start(Role::I);
    flight.pass(Duration::from_secs(2));
    flight.command_with(Role::I, MavCmd::MAV_CMD_USER_2, 1.0);
    flight.pass(Duration::from_secs(1));
    let refused = "lifting the kill refused: only on the ground, disarmed";
    assert!(flight.said(Role::I, refused).is_some(), "{}", flight.story());
}

#[test]
fn spec_a_vehicle_that_its_pilot_arms_is_not_flown() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(15));
    let mut arm = command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1.0);
    arm.target_component = 1;
    flight.tell_autopilot(Role::I, &MavMessage::COMMAND_LONG(arm));
    flight.pass(Duration::from_secs(3));
    let vehicle = &flight.world.snapshot().vehicles[0];
    assert!(vehicle.armed && vehicle.landed, "{}", flight.story());
    assert!(flight.log.setpoints.i.is_empty(), "{}", flight.story());
    let told = "disarmed: the vehicle is armed already";
    assert!(flight.said(Role::I, told).is_some(), "{}", flight.story());
}

#[test]
fn spec_a_pilot_who_takes_over_in_the_landing_ends_nothing_early() {
    let mut flight = Flight::new(Setup::default());
    assert!(flight.until(|flight| flight.said(Role::I, "returning home").is_some()
        || flight.said(Role::I, "all slots").is_some()));
    let low = |flight: &Flight| flight.world.snapshot().vehicles[0].position_enu_m[2] < 6.0;
    assert!(flight.until(low), "{}", flight.story());
    // PX4's POSCTL.
    let mut take = command(MavCmd::MAV_CMD_DO_SET_MODE, 1.0);
    (take.param2, take.target_component) = (3.0, 1);
    flight.tell_autopilot(Role::I, &MavMessage::COMMAND_LONG(take));
    flight.pass(Duration::from_secs(3));
    assert!(flight.said(Role::I, "hands off").is_none(), "{}", flight.story());
    assert_eq!(flight.outcomes.j.clone().unwrap_or(Outcome::Completed), Outcome::Completed);
}

#[test]
fn spec_a_companion_that_is_not_told_its_system_takes_the_autopilot_s() {
    let mut watched = Watched::of(true, |draft| draft.autopilot.system_id = None);
    watched.pass(Duration::from_secs(2));
    assert!(told(&watched, "autopilot found: system 1"));
    watched.until(|watched| Role::BOTH.iter().all(|role| watched.flight.outcomes[*role].is_some()));
    for role in Role::BOTH {
        assert_eq!(watched.flight.outcomes[role], Some(Outcome::Completed), "{role}");
    }
    assert_eq!(watched.flight.world.report().violations, []);
}

#[test]
fn spec_j_gives_an_unheard_i_the_time_of_its_way_home_and_no_more() {
    let mut flight = in_mid_slot(Setup::default());
    for from in Role::BOTH {
        flight.set_pair_path(from, Path::CUT);
    }
    flight.fly_out();
    flight.assert_safe();
    let home = |role| flight.said(role, "returning home").unwrap();
    let waited = home(Role::J) - home(Role::I);
    assert!(waited > Duration::from_secs(8) && waited < Duration::from_secs(12), "{}", flight.story());
}

#[test]
fn spec_after_an_ordered_return_j_waits_until_i_is_down_and_what_was_confirmed_is_not_called_unconfirmed() {
    let mut flight = in_mid_slot(Setup::default());
    flight.command_with(Role::J, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, 1.0);
    flight.pass(Duration::from_millis(200));
    assert!(flight.said(Role::J, "continue refused: nothing is paused").is_some(), "{}", flight.story());
    flight.command(Role::I, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH);
    flight.fly_out();
    flight.assert_safe();
    let why = "vehicle I fell silent: by the operator's order";
    assert!(flight.said(Role::J, why).is_some(), "{}", flight.story());
    let (down, leaves) = (flight.said(Role::I, "landed"), flight.said(Role::J, "returning home"));
    let waited = leaves.unwrap().abs_diff(down.unwrap());
    assert!(waited < Duration::from_secs(5), "{}", flight.story());
    assert!(flight.said(Role::I, "returning home").unwrap() + Duration::from_secs(5) < leaves.unwrap());
    for role in Role::BOTH {
        assert!(flight.said(role, "has not confirmed").is_none(), "{}", flight.story());
    }
}

#[test]
fn spec_a_link_that_is_lost_on_the_ground_ends_nothing() {
    let mut flight = Flight::new(Setup { start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(15));
    flight.set_autopilot_path(Role::I, Path::CUT);
    flight.pass(Duration::from_secs(5));
    flight.set_autopilot_path(Role::I, Path::GOOD);
    flight.pass(Duration::from_secs(10));
    assert!(flight.said(Role::I, "hands off").is_none(), "{}", flight.story());
    flight.command(Role::I, MavCmd::MAV_CMD_MISSION_START);
    assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
}

#[test]
fn spec_a_companion_that_is_told_to_end_on_the_ground_ends_at_once_and_says_so_in_its_heartbeat() {
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let at = watched.flight.now();
    watched.flight.stop(Role::I);
    watched.until(|watched| watched.flight.outcomes[Role::I].is_some());
    assert!(watched.flight.now() - at < Duration::from_millis(200), "{:?}", watched.flight.now() - at);
    let mut watched = Watched::new(true);
    watched.until(|watched| watched.flight.radiating() == [true, true]);
    let since = watched.station.heard.len();
    watched.flight.stop(Role::I);
    watched.until(|watched| watched.flight.outcomes[Role::I].is_some());
    let off = |m: &MavMessage| match m {
        MavMessage::HEARTBEAT(m) => m.system_status == MavState::MAV_STATE_POWEROFF,
        _ => false,
    };
    assert!(said(&watched, since).any(off));
}

#[test]
fn spec_an_autopilot_that_does_not_give_control_is_left_on_the_ground_for_that_reason() {
    let mut watched = Watched::new(true);
    watched.until(|watched| phase(watched) == Some(2.0));
    watched.flight.world.inject(Fault::EstimatorFailure { vehicle: 0 });
    watched.pass(Duration::from_secs(90));
    let texts: Vec<_> = said(&watched, 0)
        .filter_map(|m| match m {
            MavMessage::STATUSTEXT(m) => Some(m.text.to_str().unwrap().to_owned()),
            _ => None,
        })
        .collect();
    assert!(told(&watched, "mission aborted: autopilot refused"), "{texts:?}");
    assert!(matches!(watched.flight.outcomes.i, Some(Outcome::Aborted(_))), "{texts:?}");
    assert!(watched.flight.world.snapshot().vehicles.iter().all(|vehicle| vehicle.landed), "{texts:?}");
}

#[test]
fn spec_j_does_not_wait_for_an_i_that_is_in_another_hand() {
    let mut flight = in_mid_slot(Setup::default());
    let at = flight.now;
    let mut take = command(MavCmd::MAV_CMD_DO_SET_MODE, 1.0);
    // PX4's POSCTL.
    (take.param2, take.target_component) = (3.0, 1);
    flight.tell_autopilot(Role::I, &MavMessage::COMMAND_LONG(take));
    assert!(flight.until(|flight| flight.said(Role::J, "returning home").is_some()), "{}", flight.story());
    assert!(flight.now - at < Duration::from_secs(10), "{}", flight.story());
}

/// Who answers a radio that asks for the time.
#[derive(Default)]
struct Answered(usize);

impl Observer for Answered {
    fn sent(&mut self, _at: Duration, _role: Role, message: &Outgoing) {
        let (Outgoing::Autopilot(message) | Outgoing::Radio(message)) = message else { return };
        self.0 += usize::from(matches!(**message, MavMessage::TIMESYNC(TIMESYNC_DATA { ts1: 77, .. })));
    }
}

#[test]
fn spec_what_comes_over_the_autopilot_s_link_is_the_radio_s_unless_that_has_one_of_its_own() {
    for (apart, answers) in [(false, 1), (true, 0)] {
        let mut watched = Watched::of(false, |draft| {
            draft.transmitter.link = apart.then(|| veilwing::desk::simulation::on_this_machine(3));
        });
        watched.pass(Duration::from_secs(5));
        let asks = MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 0, ts1: 77, ..TIMESYNC_DATA::DEFAULT });
        let frame = watched.station.encoder.encode((1, 68), &asks);
        watched.flight.send_to_companion(Role::I, frame.raw_bytes());
        let mut answered = Answered::default();
        let end = watched.flight.now() + Duration::from_millis(100);
        while watched.flight.now() < end {
            watched.flight.step(end, &mut answered).unwrap();
        }
        assert_eq!(answered.0, answers, "apart {apart}");
    }
}

#[test]
fn spec_what_of_the_no_fly_areas_an_autopilot_would_cross_on_its_own_way_home_is_warned_of() {
    // On I's way home from bravo, above its pose at 10 m: it returns at up to 20 m, and J from there to 30 m.
    let area = |name: &str, floor_m: f64, ceiling_m: f64| NoFlyDraft {
        name: name.into(),
        area_enu_m: Some(vec![[-2.7, 3.2], [-0.7, 3.2], [-0.7, 5.2], [-2.7, 5.2]]),
        floor_m: Some(floor_m),
        ceiling_m: Some(ceiling_m),
        ..NoFlyDraft::default()
    };
    let under = yard().under(|m| m.no_fly = vec![area("low", 12.0, 15.0), area("high", 24.0, 28.0)]);
    let given = PerVehicle { i: under.clone(), j: under };
    let mut flight = Flight::new(Setup { given, start_unasked: false, ..Setup::default() });
    flight.pass(Duration::from_secs(15));
    let warned = |area: &str| {
        let text = format!("straight home from the pose for bravo {area:?}");
        let warnings = flight
            .log
            .notices
            .iter()
            .filter(|(_, role, text)| *role == Role::I && text.contains("own return"));
        warnings.into_iter().any(|(.., said)| said.contains(&text))
    };
    assert!(warned("low") && !warned("high"), "{}", flight.story());
}

#[test]
fn spec_who_is_blown_off_its_way_up_or_home_is_landed_by_the_autopilot_after_a_while() {
    let fence = PerVehicle { i: FenceDuty::None, j: FenceDuty::None };
    for (since, later_s) in [("taking off", 4), ("all slots are over", 1)] {
        let mut flight = Flight::new(Setup { fence, ..Setup::default() });
        assert!(flight.until(|flight| flight.said(Role::I, since).is_some()));
        flight.pass(Duration::from_secs(later_s));
        flight.world.inject(Fault::WindStep { vehicle: 0, mean_enu_m_s: [24.0, 0.0, 0.0] });
        flight.pass(Duration::from_secs(60));
        let text = "from where it should be: the autopilot lands here";
        assert!(flight.said(Role::I, text).is_some(), "{since}\n{}", flight.story());
    }
}

#[test]
fn spec_an_estimate_that_is_not_to_be_trusted_is_no_connection() {
    let mut watched = Watched::new(false);
    watched.flight.world.inject(Fault::EstimatorFailure { vehicle: 0 });
    watched.pass(Duration::from_secs(15));
    assert_eq!(phase(&watched), Some(0.0));
}

#[test]
fn spec_a_companion_that_ends_waits_until_a_radio_that_does_not_answer_must_be_off() {
    let given = PerVehicle { i: level(), j: level() };
    let mut flight = in_mid_slot(Setup { given, radio_apart: true, ..Setup::default() });
    flight.set_radio_path(Role::I, Path::CUT);
    let at = flight.now;
    flight.stop(Role::I);
    assert!(flight.until(|flight| flight.outcomes[Role::I].is_some()), "{}", flight.story());
    let took = flight.now - at;
    // Of the lease that it was given last not much more than a renewal's pause is gone.
    assert!(took >= Duration::from_millis(250) && took <= Duration::from_millis(500), "{took:?}");
}

#[test]
fn spec_a_vehicle_that_does_not_disarm_by_itself_is_disarmed_once_it_is_down() {
    let mut flight = Flight::new(Setup::default());
    let never = PARAM_SET_DATA {
        param_value: -1.0,
        target_system: 1,
        target_component: 1,
        param_id: "COM_DISARM_LAND".into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    };
    flight.tell_autopilot(Role::I, &MavMessage::PARAM_SET(never));
    flight.fly_out();
    assert_eq!(flight.outcomes.i, Some(Outcome::Completed), "{}", flight.story());
    assert!(flight.landed(Role::I));
}

#[test]
fn spec_j_is_silent_at_once_where_its_own_estimate_fails_though_i_may_rest_on_it() {
    let mut flight = in_mid_slot(Setup::default());
    // I hears nothing of it, and gives up none of its leases.
    flight.set_pair_path(Role::J, Path::CUT);
    flight.world.inject(Fault::EstimatorFailure { vehicle: 1 });
    assert!(
        flight.until(|flight| flight.said(Role::J, "aborted: estimator").is_some()),
        "{}",
        flight.story()
    );
    let at = flight.now;
    flight.pass(Duration::from_secs(1));
    assert!(
        flight.silent_after(Role::J, at) <= REACTION,
        "{:?}\n{}",
        flight.silent_after(Role::J, at),
        flight.story()
    );
}
