//! Where those are that move, by an operator's word and by an edited mission file.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use veilwing::geo::Enu;
use veilwing::planner::following::{Moved, Who};
use veilwing::role::Role;

use crate::face::{Watched, results};
use crate::following::following;

/// MAV_CMD_USER_5: (user or eavesdropper, its number in the mission), standard deviation and age, at the mission's origin.
fn sighting(who: [f32; 2], std_m: f32, age_s: f32) -> COMMAND_INT_DATA {
    let origin = following().given.i.mission.origin;
    COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_USER_5,
        frame: MavFrame::MAV_FRAME_GLOBAL,
        param1: who[0],
        param2: who[1],
        param3: std_m,
        param4: age_s,
        x: (origin.lat_deg * 1e7) as i32,
        y: (origin.lon_deg * 1e7) as i32,
        z: origin.alt_m as f32,
        target_component: 191,
        ..COMMAND_INT_DATA::DEFAULT
    }
}

/// All that was said in texts.
fn texts<'a>(said: impl IntoIterator<Item = &'a MavMessage>) -> String {
    let text = |m: &MavMessage| match m {
        MavMessage::STATUSTEXT(m) => m.text.to_str().ok().map(str::to_owned),
        _ => None,
    };
    said.into_iter().filter_map(text).collect()
}

/// What the companion of `role` answers to it, and says of it.
fn told(watched: &mut Watched, role: Role, mut seen: COMMAND_INT_DATA) -> (MavResult, String) {
    seen.target_system = if role == Role::I { 1 } else { 2 };
    let said = watched.ask(role, &MavMessage::COMMAND_INT(seen));
    (results(&said)[0], texts(&said))
}

#[test]
fn spec_what_an_operator_has_seen_is_taken_or_refused_with_the_reason() {
    const FIRST: [f32; 2] = [1.0, 1.0];
    let mut watched = Watched::flying(&following().given.i, false, |_| {});
    watched.pass(Duration::from_secs(15));
    let accepted = (MavResult::MAV_RESULT_ACCEPTED, String::new());
    assert_eq!(told(&mut watched, Role::I, sighting(FIRST, 0.0, 0.0)), accepted);
    assert_eq!(told(&mut watched, Role::I, sighting([0.0, 2.0], 4.0, 0.0)), accepted);
    let unsure = COMMAND_INT_DATA { z: f32::NAN, ..sighting(FIRST, f32::NAN, f32::NAN) };
    assert_eq!(told(&mut watched, Role::I, unsure), accepted, "the mission's height and certainty, now");
    let far = COMMAND_INT_DATA { x: sighting(FIRST, 0.0, 0.0).x + 2_000_000, ..sighting(FIRST, 0.0, 0.0) };
    let relative =
        COMMAND_INT_DATA { frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, ..sighting(FIRST, 0.0, 0.0) };
    for (role, seen, why) in [
        (Role::J, sighting(FIRST, 0.0, 0.0), "vehicle I is to be told"),
        (Role::I, sighting([2.0, 1.0], 0.0, 0.0), "param1 is 0 (user) or 1 (eavesdropper)"),
        (Role::I, sighting([1.0, 0.0], 0.0, 0.0), "param2 its number in the mission"),
        (Role::I, sighting([1.0, 1.5], 0.0, 0.0), "param2 its number in the mission"),
        (Role::I, sighting([1.0, 2.0], 0.0, 0.0), "in the mission it does not move"),
        (Role::I, sighting([1.0, 99.0], 0.0, 0.0), "in the mission it does not move"),
        (Role::I, relative, "its frame is to be MAV_FRAME_GLOBAL"),
        (Role::I, sighting(FIRST, -1.0, 0.0), "param3 is its standard deviation"),
        (Role::I, sighting(FIRST, 0.0, -1.0), "param4 its age in s"),
        (Role::I, sighting(FIRST, 0.0, 60.5), "param4 its age in s"),
        (Role::I, sighting(FIRST, 0.0, 60.0), "a later report is known"),
        (Role::I, far, "farther than 20 km away"),
    ] {
        let (result, said) = told(&mut watched, role, seen);
        assert_eq!(result, MavResult::MAV_RESULT_DENIED, "{why}");
        assert!(said.contains("a sighting refused: ") && said.contains(why), "{why}: {said}");
    }
    // A place needs integers: in the other form it would be metres off.
    let long = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_USER_5,
        param1: 1.0,
        param2: 1.0,
        target_system: 1,
        target_component: 191,
        ..COMMAND_LONG_DATA::DEFAULT
    });
    assert_eq!(results(&watched.ask(Role::I, &long)), [MavResult::MAV_RESULT_COMMAND_INT_ONLY]);

    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    let (result, said) = told(&mut watched, Role::I, sighting(FIRST, 0.0, 0.0));
    assert!(result == MavResult::MAV_RESULT_DENIED && said.contains("nobody `moves`"), "{said}");
}

#[test]
fn spec_of_an_edited_mission_file_those_that_move_are_taken() {
    let moved = |who, east_m| Moved { who, position_enu_m: Enu::new(east_m, 0.0, 1.0), std_m: 2.0 };
    let (of_user, of_eavesdropper) = (moved(Who::User(0), 10.0), moved(Who::Eavesdropper(0), 30.0));
    // Of the mission's, but it stays where it is.
    let still = moved(Who::Eavesdropper(1), 50.0);
    let edit = |watched: &mut Watched, role: Role, edited| {
        let since = watched.station.heard.len();
        watched.flight.edit_mission(role, edited);
        watched.pass(Duration::from_millis(50));
        let heard = watched.station.heard[since..].iter().filter(|(_, who, _)| *who == role);
        texts(heard.map(|(.., m)| m))
    };
    let mut watched = Watched::flying(&following().given.i, false, |_| {});
    watched.pass(Duration::from_secs(15));
    for (role, edited, expected) in [
        (Role::I, Ok(vec![of_user]), "mission file: 1 of those that move are elsewhere"),
        (
            Role::I,
            Ok(vec![still, of_eavesdropper, of_user]),
            "mission file: 2 of those that move are elsewhere",
        ),
        (Role::I, Ok(vec![still]), "mission file: 0 of those that move are elsewhere"),
        (Role::I, Err("line 7".to_owned()), "mission file: nothing of it is taken: line 7"),
        (Role::J, Ok(vec![of_user]), "mission file: nothing of it is taken: vehicle I's is to be edited"),
    ] {
        assert_eq!(edit(&mut watched, role, edited), expected);
    }
    let mut watched = Watched::new(false);
    watched.pass(Duration::from_secs(15));
    assert!(edit(&mut watched, Role::I, Ok(vec![of_user])).contains("nobody `moves` in this mission"));
}
