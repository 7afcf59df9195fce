//! The state and the view, without a terminal: what an operator sees in flight, in trouble, and of a recorded flight, in a
//! terminal of 80 by 24 and in one of 200 by 50.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::*;
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use ratatui::style::Color;

use super::recording::Record;
use super::view::{Theme, draw};
use super::*;
use crate::mission::{Figure, Vector};
use crate::role::Role;
use crate::time::{Instant, Utc};

const COMPANION: u8 = 191;
const SMALL: (u16, u16) = (80, 24);
const LARGE: (u16, u16) = (200, 50);
/// 2026-11-21T18:00:00Z.
const BEGAN: Utc = Utc { unix_us: 1_795_284_000_000_000 };

fn at(ms: u64) -> Instant {
    Instant::from_start(Duration::from_millis(ms))
}

fn live() -> State {
    State::new(Source::Live(vec!["udpin:0.0.0.0:14550".into()]), COMPANION, BEGAN)
}

fn header(system: u8, component_id: u8) -> MavHeader {
    MavHeader { system_id: system.into(), component_id, sequence: 0 }
}

fn figure(figure: Figure, value: f64) -> MavMessage {
    let name: &'static str = figure.into();
    named(name, value)
}

fn named(name: &str, value: f64) -> MavMessage {
    MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
        time_boot_ms: 0,
        value: value as f32,
        name: name.into(),
    })
}

fn vector(vector: Vector, [x, y, z]: [f32; 3]) -> MavMessage {
    let name: &'static str = vector.into();
    MavMessage::DEBUG_VECT(DEBUG_VECT_DATA { time_usec: 0, x, y, z, name: name.into() })
}

fn text(severity: MavSeverity, text: &str) -> MavMessage {
    MavMessage::STATUSTEXT(STATUSTEXT_DATA { severity, text: text.into(), id: 0, chunk_seq: 0 })
}

fn autopilot(armed: bool) -> MavMessage {
    let armed = if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        // PX4: OFFBOARD.
        custom_mode: 6 << 16,
        mavtype: MavType::MAV_TYPE_OCTOROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | armed,
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// What both say in a slot that is served: (system, component, message).
fn serving() -> Vec<(u8, u8, MavMessage)> {
    let mut said = Vec::new();
    for (system, role, dbm) in [(1, 0.0, 26.9), (2, 1.0, 12.3)] {
        said.push((system, 1, autopilot(true)));
        let own = [
            figure(Figure::Role, role),
            figure(Figure::Phase, 6.0),
            figure(Figure::Slot, 1.0),
            figure(Figure::Slots, 4.0),
            figure(Figure::Opens, -3.0),
            figure(Figure::Closes, 7.0),
            figure(Figure::Left, 95.0),
            figure(Figure::Silent, 0.0),
            figure(Figure::Radio, 2.0),
            figure(Figure::Power, dbm),
            figure(Figure::PlannedPower, dbm),
            figure(Figure::Lease, 0.31),
            figure(Figure::PositionOff, 0.04),
            figure(Figure::AttitudeOff, 0.6),
            figure(Figure::Peer, 0.05),
            figure(Figure::Clock, 0.003),
            figure(Figure::State, 0.045),
            figure(Figure::RoundTrip, 12.0),
            figure(Figure::Orders, 0.0),
            vector(Vector::Position, [12.1, -3.0 + 30.0 * role as f32, 40.2]),
            vector(Vector::Planned, [12.1, -3.04 + 30.0 * role as f32, 40.2]),
            vector(Vector::Attitude, [30.0, -10.0, 0.0]),
            vector(Vector::PlannedAttitude, [30.4, -10.4, 0.0]),
            named("SEC_RATE", 1.234e6),
            named("SINR_USER", 23.1),
            named("SINR_EVE", -3.2),
            named("SINR_E1", -3.2),
            named("SINR_E2", -8.8),
        ];
        said.extend(own.into_iter().map(|message| (system, COMPANION, message)));
    }
    said.push((1, COMPANION, text(MavSeverity::MAV_SEVERITY_INFO, "slot 1: on, 489.779 mW")));
    said
}

fn take(state: &mut State, said: Vec<(u8, u8, MavMessage)>, now: Instant) {
    for (system, component, message) in said {
        state.take(0, header(system, component), &message, now);
    }
}

struct Shown {
    rows: Vec<String>,
    coloured: bool,
}

impl Shown {
    fn has(&self, what: &str) -> bool {
        self.rows.iter().any(|row| row.contains(what))
    }

    fn says(&self, what: &[&str]) {
        for what in what {
            assert!(self.has(what), "no {what:?} in\n{}", self.rows.join("\n"));
        }
    }
}

fn shown_with(state: &State, now: Instant, (width, height): (u16, u16), colours: bool) -> Shown {
    let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
    terminal.draw(|frame| draw(state, now, Theme { colours }, frame)).unwrap();
    let buffer = terminal.backend().buffer();
    let row = |y: u16| (0..width).map(|x| buffer[(x, y)].symbol()).collect::<String>();
    let coloured = buffer.content().iter().any(|cell| cell.fg != Color::Reset || cell.bg != Color::Reset);
    Shown { rows: (0..height).map(row).collect(), coloured }
}

fn shown(state: &State, now: Instant, size: (u16, u16)) -> Shown {
    shown_with(state, now, size, true)
}

#[test]
fn spec_in_flight_both_sizes_show_phase_clock_pose_power_lease_rate_and_links() {
    let mut state = live();
    take(&mut state, serving(), at(1000));
    // The slot's clock runs on between two words of the companion.
    for size in [SMALL, LARGE] {
        let shown = shown(&state, at(1500), size);
        shown.says(&[
            "vehicle I, system 1",
            "vehicle J, system 2",
            "in slot 1, 2 of 4",
            "6.5 s  ####",
            "ON 26.9 dBm (plan 26.9)",
            "ON 12.3 dBm (plan 12.3)",
            "silent no",
            "held, 310 ms left",
            "granted, 310 ms left",
            "12.1 E   -3.0 N   40.2 m",
            "0.04 m, 0.6 deg from plan",
            "OFFBOARD armed 45 ms old",
            "J 50 ms clock +3 ms rtt 12 ms",
            "1.234 Mbit/s  user 23.1 dB, strongest eavesdropper -3.2 dB",
            "18:00:01.0 I     slot 1: on, 489.779 mW",
            "2026-11-21 18:00:01Z",
            " K KILL  L lift  Tab both  ?  q quit",
        ]);
        assert!(shown.coloured && !shown.has("RADIO KILL"));
    }
    let large = shown(&state, at(1500), LARGE);
    large.says(&[
        "from above",
        "eavesdroppers 1 to 2: -3.2, -8.8 dB",
        "roll   30.4 pitch  -10.4",
        "in about 1:35",
    ]);
    let small = shown(&state, at(1500), SMALL);
    assert!(!small.has("from above") && small.rows.iter().all(|row| row.chars().count() == 80));
}

#[test]
fn spec_in_trouble_the_reason_and_the_loss_are_said_in_words() {
    let mut state = live();
    take(&mut state, serving(), at(1000));
    let trouble = |system: u8, messages: Vec<MavMessage>| {
        messages.into_iter().map(|message| (system, COMPANION, message)).collect::<Vec<_>>()
    };
    take(
        &mut state,
        trouble(
            1,
            vec![
                figure(Figure::Silent, 9.0),
                figure(Figure::Radio, 0.0),
                figure(Figure::Lease, 0.0),
                figure(Figure::Orders, 1.0),
                text(MavSeverity::MAV_SEVERITY_WARNING, "silent: no jam lease in force"),
            ],
        ),
        at(2000),
    );
    // J is not heard any more.
    let now = at(6000);
    state.take(0, header(1, COMPANION), &figure(Figure::Phase, 7.0), now);
    state.take(0, header(1, 1), &autopilot(true), now);
    for size in [SMALL, LARGE] {
        let shown = shown(&state, now, size);
        shown.says(&[
            "RADIO KILL IN FORCE",
            "holding",
            "RADIO  off",
            "silent no jam lease in force",
            "lease  none",
            "NOT HEARD for 5.0 s",
            "secrecy none  I: no jam lease in force",
            "J: is not heard any more",
            "18:00:02.0 I     silent: no jam lease in force",
        ]);
    }
    // Without colours nothing of it is lost, and no cell has one.
    let plain = shown_with(&state, now, SMALL, false);
    assert!(!plain.coloured && plain.has("NOT HEARD for 5.0 s"));
}

#[test]
fn spec_nobody_heard_is_said_and_a_tiny_terminal_is_told_what_it_should_be() {
    let state = live();
    shown(&state, at(0), SMALL).says(&["vehicle I", "not heard yet", "secrecy none  both: is not heard"]);
    shown(&state, at(0), (50, 10)).says(&["50 by 10 is too small", "K then y kills"]);
}

fn recording() -> Recording {
    let mut records = Vec::new();
    let mut add = |ms: u64, system: u8, component: u8, message: MavMessage| {
        let at = Duration::from_millis(ms);
        records.push(Record { at, channel: 0, header: header(system, component), message });
    };
    for (system, component, message) in serving() {
        add(1000, system, component, message);
    }
    add(60_000, 1, COMPANION, figure(Figure::Phase, 9.0));
    add(60_000, 1, COMPANION, text(MavSeverity::MAV_SEVERITY_INFO, "returning home"));
    Recording { began: BEGAN, remarks: Vec::new(), roles: vec![None], records }
}

#[test]
fn spec_a_recorded_flight_plays_stands_leaps_and_takes_no_orders() {
    let mut state = State::recorded("flight-1".into(), COMPANION, recording(), at(0));
    state.advance(at(2000));
    for size in [SMALL, LARGE] {
        let shown = shown(&state, at(2000), size);
        shown.says(&[
            "recorded: flight-1",
            "plays x1  0:02 of 1:00",
            "in slot 1, 2 of 4",
            "6.0 s  ####",
            "Space ",
        ]);
        assert!(!shown.has("returning home"));
    }
    // Twice as fast, from 2 s to 6 s.
    assert_eq!(state.key(Key::Char('+'), at(2000)), After::Stay);
    state.advance(at(4000));
    shown(&state, at(4000), SMALL).says(&["plays x2  0:06 of 1:00"]);
    state.key(Key::End, at(4000));
    state.advance(at(4000));
    shown(&state, at(4000), SMALL).says(&[
        "stands x2  1:00 of 1:00",
        "returning home",
        "landing",
        "NOT HEARD for 59.0 s",
    ]);
    // Back: what came later is not known yet.
    state.key(Key::Home, at(5000));
    state.key(Key::Char(' '), at(5000));
    state.key(Key::Right, at(5000));
    state.advance(at(9000));
    let back = shown(&state, at(9000), SMALL);
    back.says(&["stands x2  0:10 of 1:00"]);
    assert!(!back.has("returning home"));
    state.key(Key::Char('k'), at(9000));
    assert_eq!(state.poll_transmit(at(9000)), None);
    shown(&state, at(9000), SMALL).says(&["a recorded flight takes no orders"]);
}

/// What is to be sent now: (system, component, command, param1, confirmation).
fn sent(state: &mut State, now: Instant) -> Vec<(u8, u8, MavCmd, f32, u8)> {
    let mut all = Vec::new();
    while let Some((0, MavMessage::COMMAND_LONG(c))) = state.poll_transmit(now) {
        all.push((c.target_system, c.target_component, c.command, c.param1, c.confirmation));
    }
    all
}

fn ack(command: MavCmd, result: MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command, result, ..COMMAND_ACK_DATA::default() })
}

#[test]
fn spec_a_kill_goes_to_both_at_once_and_again_until_each_has_answered() {
    let kill = MavCmd::MAV_CMD_USER_2;
    let mut state = live();
    take(&mut state, serving(), at(0));
    state.key(Key::Char('k'), at(1000));
    shown(&state, at(1000), SMALL).says(&["KILL both radios?   y or Enter: yes"]);
    assert_eq!(sent(&mut state, at(1000)), []);
    state.key(Key::Enter, at(1100));
    assert_eq!(sent(&mut state, at(1100)), [(1, COMPANION, kill, 0.0, 0), (2, COMPANION, kill, 0.0, 0)]);
    assert_eq!(sent(&mut state, at(1299)), []);
    state.take(0, header(1, COMPANION), &ack(kill, MavResult::MAV_RESULT_ACCEPTED), at(1150));
    assert_eq!(sent(&mut state, at(1300)), [(2, COMPANION, kill, 0.0, 1)]);
    shown(&state, at(1300), SMALL).says(&["KILL: done by I after 0.05 s", "KILL: sent to J (2), 0.2 s"]);
    // Under way: it has it, and is not told again.
    state.take(0, header(2, COMPANION), &ack(kill, MavResult::MAV_RESULT_IN_PROGRESS), at(1400));
    assert_eq!(sent(&mut state, at(5000)), []);
    state.take(0, header(2, COMPANION), &ack(kill, MavResult::MAV_RESULT_ACCEPTED), at(5100));
    shown(&state, at(5100), SMALL).says(&["KILL: done by J after 4.00 s"]);
    // An autopilot's answer is not the companion's.
    state.key(Key::Char('K'), at(9000));
    state.key(Key::Char('K'), at(9050));
    assert_eq!(sent(&mut state, at(9050)).len(), 2);
    state.take(0, header(1, 1), &ack(kill, MavResult::MAV_RESULT_ACCEPTED), at(9100));
    assert_eq!(sent(&mut state, at(9250)).len(), 2);
}

#[test]
fn spec_no_order_goes_out_without_its_yes_nor_by_a_yes_that_comes_late() {
    let mut state = live();
    take(&mut state, serving(), at(0));
    for (question, answer) in
        [('r', Key::Escape), ('s', Key::Char('n')), ('p', Key::Char('p')), ('k', Key::Tab)]
    {
        state.key(Key::Char(question), at(100));
        state.key(answer, at(200));
        assert_eq!(sent(&mut state, at(200)), [], "{question}");
    }
    state.key(Key::Char('k'), at(1000));
    state.advance(at(20_000));
    state.key(Key::Enter, at(20_000));
    assert_eq!(sent(&mut state, at(20_000)), []);
}

#[test]
fn spec_an_order_goes_to_one_for_both_is_said_again_and_a_refusal_is_in_words() {
    let (start, home) = (MavCmd::MAV_CMD_MISSION_START, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH);
    let mut state = live();
    take(&mut state, serving(), at(0));
    state.key(Key::Char('s'), at(100));
    state.key(Key::Char('y'), at(100));
    assert_eq!(sent(&mut state, at(100)), [(1, COMPANION, start, 0.0, 0)]);
    assert_eq!(sent(&mut state, at(1100)), [(1, COMPANION, start, 0.0, 1)]);
    state.take(0, header(1, COMPANION), &ack(start, MavResult::MAV_RESULT_DENIED), at(1150));
    shown(&state, at(1200), SMALL).says(&["start: I REFUSES it; its message says why (1.05 s)"]);
    // I in another hand: J takes it for both; I alone is told where that is chosen.
    state.take(0, header(1, COMPANION), &figure(Figure::Phase, 10.0), at(1200));
    let order = |state: &mut State, now: Instant| {
        state.key(Key::Char('r'), now);
        state.key(Key::Enter, now);
        sent(state, now)
    };
    assert_eq!(order(&mut state, at(1300)), [(2, COMPANION, home, 0.0, 0)]);
    state.key(Key::Tab, at(1400));
    shown(&state, at(1400), SMALL).says(&["Tab I only"]);
    assert_eq!(order(&mut state, at(1400)), [(1, COMPANION, home, 0.0, 0)]);
    // Nobody answers: it is said so, and not for ever.
    let tries = (2..60).map(|s| sent(&mut state, at(1000 * s)).len()).sum::<usize>();
    assert_eq!(tries, 5);
    shown(&state, at(10_000), SMALL).says(&["return: NO ANSWER from I"]);
}

#[test]
fn spec_what_another_station_orders_and_a_stranger_says_is_told_apart() {
    let mut state = live();
    take(&mut state, serving(), at(0));
    let order = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
        target_system: 1,
        target_component: COMPANION,
        ..COMMAND_LONG_DATA::default()
    });
    state.take(0, header(254, 190), &order, at(100));
    state.take(0, header(77, 190), &text(MavSeverity::MAV_SEVERITY_INFO, "a stranger"), at(100));
    let shown = shown(&state, at(100), SMALL);
    shown.says(&["station 254 orders: return"]);
    assert!(!shown.has("a stranger") && state.vehicles.len() == 2);
    assert_eq!(state.vehicle(Role::J).map(|vehicle| vehicle.id.system), Some(2));
}
