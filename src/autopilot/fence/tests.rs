//! Fence and rally point against an autopilot's side written by hand, over a wire that loses, repeats and delays.

// ArduPilot asks by the superseded MISSION_REQUEST.
#![allow(deprecated)]

use mavlink::dialects::ardupilotmega::*;

use super::*;
use crate::autopilot::state::Timed;

const OWN: Address = (1, 191);
const AUTOPILOT: Address = (1, 1);
const ORIGIN: Geodetic = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };
const STEP: Duration = Duration::from_millis(10);
const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;
const RALLY_POINTS: MavMissionType = MavMissionType::MAV_MISSION_TYPE_RALLY;

fn square(duty: FenceDuty) -> Fence {
    let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]];
    Fence {
        duty,
        corners_enu_m: corners.map(Vector2::from).to_vec(),
        zones_enu_m: Vec::new(),
        untold: Vec::new(),
        tight: 0,
        top_m: 80.0,
        home_within_m: 5.0,
    }
}

/// What an autopilot answers, and what it keeps.
#[derive(Default)]
struct Autopilot {
    fence: Vec<MISSION_ITEM_INT_DATA>,
    rally: Vec<MISSION_ITEM_INT_DATA>,
    /// A list on its way in: which, how long, what of it is there, when it was asked for.
    reading: Option<(MavMissionType, usize, Vec<MISSION_ITEM_INT_DATA>, Instant)>,
    /// Asks by MISSION_REQUEST, as ArduPilot does.
    asks_the_old_way: bool,
    /// What it answers instead of taking a list.
    refuses: Option<MavMissionResult>,
    /// Has no rally points.
    without_rally: bool,
    /// Keeps what it is given one unit of 1e-7 deg aside.
    rounds: i32,
    mute: bool,
    out: Vec<MavMessage>,
}

impl Autopilot {
    fn list(&mut self, kind: MavMissionType) -> &mut Vec<MISSION_ITEM_INT_DATA> {
        if kind == FENCE { &mut self.fence } else { &mut self.rally }
    }

    fn acknowledge(&mut self, mission_type: MavMissionType, mavtype: MavMissionResult) {
        self.out.push(MavMessage::MISSION_ACK(MISSION_ACK_DATA {
            target_system: OWN.0,
            target_component: OWN.1,
            mavtype,
            mission_type,
            ..MISSION_ACK_DATA::DEFAULT
        }));
    }

    fn ask(&mut self, now: Instant) {
        let Some((mission_type, _, items, asked_at)) = &mut self.reading else { return };
        *asked_at = now;
        let (seq, mission_type) = (items.len() as u16, *mission_type);
        let (target_system, target_component) = OWN;
        self.out.push(if self.asks_the_old_way {
            MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            })
        } else {
            MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            })
        });
    }

    fn handle(&mut self, message: &MavMessage, now: Instant) {
        if self.mute {
            return;
        }
        match message {
            MavMessage::MISSION_REQUEST_LIST(m) if self.without_rally && m.mission_type == RALLY_POINTS => {
                self.acknowledge(m.mission_type, MavMissionResult::MAV_MISSION_UNSUPPORTED);
            }
            MavMessage::MISSION_REQUEST_LIST(m) => {
                let count = self.list(m.mission_type).len() as u16;
                self.out.push(MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
                    count,
                    target_system: OWN.0,
                    target_component: OWN.1,
                    mission_type: m.mission_type,
                    ..MISSION_COUNT_DATA::DEFAULT
                }));
            }
            MavMessage::MISSION_REQUEST_INT(m) => {
                let item = self.list(m.mission_type)[usize::from(m.seq)].clone();
                let (target_system, target_component) = OWN;
                self.out.push(MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                    seq: m.seq,
                    target_system,
                    target_component,
                    ..item
                }));
            }
            MavMessage::MISSION_COUNT(m) => match self.refuses {
                Some(result) => self.acknowledge(m.mission_type, result),
                None => {
                    self.reading = Some((m.mission_type, m.count.into(), Vec::new(), now));
                    self.ask(now);
                }
            },
            MavMessage::MISSION_ITEM_INT(m) => {
                let Some((kind, count, items, _)) = &mut self.reading else { return };
                let kind = *kind;
                assert_eq!((m.target_system, m.target_component, m.mission_type), (1, 1, kind));
                if usize::from(m.seq) != items.len() {
                    return self.acknowledge(kind, MavMissionResult::MAV_MISSION_INVALID_SEQUENCE);
                }
                items.push(MISSION_ITEM_INT_DATA { x: m.x + self.rounds, ..m.clone() });
                if items.len() < *count {
                    return self.ask(now);
                }
                let items = std::mem::take(items);
                self.reading = None;
                *self.list(kind) = items;
                self.acknowledge(kind, MavMissionResult::MAV_MISSION_ACCEPTED);
            }
            _ => {}
        }
    }

    fn step(&mut self, now: Instant) {
        let late = |asked_at: Instant| now.saturating_since(asked_at) > Duration::from_secs(1);
        if self.reading.as_ref().is_some_and(|(.., asked_at)| late(*asked_at)) {
            self.ask(now);
        }
    }
}

/// A keeper, an autopilot, and what passes between them.
struct Bench {
    now: Instant,
    keeper: Keeper,
    autopilot: Autopilot,
    state: VehicleState,
    out: Outbox,
    /// Everything that the keeper said.
    said: Vec<MavMessage>,
    /// Of so many messages either way the last is lost; 0: none.
    loses_every: usize,
    /// Everything arrives twice.
    repeats: bool,
    carried: usize,
}

impl Bench {
    fn new(duty: FenceDuty) -> Self {
        let now = Instant::from_start(Duration::from_secs(1));
        let state = VehicleState {
            armed: Some(Timed::new(false, now)),
            home_enu_m: Some(Timed::new(Enu::new(3.0, 4.0, 0.5), now)),
            ..VehicleState::default()
        };
        Self {
            now,
            keeper: Keeper::new(Some(square(duty)), ORIGIN),
            autopilot: Autopilot::default(),
            state,
            out: Outbox::default(),
            said: Vec::new(),
            loses_every: 0,
            repeats: false,
            carried: 0,
        }
    }

    /// How often a message arrives.
    fn times(&mut self) -> usize {
        self.carried += 1;
        let lost = self.loses_every != 0 && self.carried.is_multiple_of(self.loses_every);
        if lost { 0 } else { 1 + usize::from(self.repeats) }
    }

    fn run(&mut self, seconds: f64) {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end {
            self.now = self.now + STEP;
            if self.keeper.timeout(&self.state).is_some_and(|at| at <= self.now) {
                self.keeper.advance(&self.state, (OWN, AUTOPILOT), self.now, &mut self.out);
                let next = self.keeper.timeout(&self.state);
                assert!(next.is_none_or(|at| at > self.now), "due and not done");
            }
            while let Some(message) = self.out.next_message() {
                self.said.push(message.clone());
                for _ in 0..self.times() {
                    self.autopilot.handle(&message, self.now);
                }
            }
            self.autopilot.step(self.now);
            for message in std::mem::take(&mut self.autopilot.out) {
                for _ in 0..self.times() {
                    self.keeper.handle(&message, &self.state, self.now, &mut self.out);
                    self.keeper.advance(&self.state, (OWN, AUTOPILOT), self.now, &mut self.out);
                }
            }
        }
    }

    fn check(&self, name: &str) -> Check {
        self.keeper.checks(&self.state).into_iter().find(|check| check.name == name).unwrap()
    }

    fn passes(&self) -> bool {
        ["fence", "rally point"].iter().all(|name| self.check(name).result == Pass)
    }

    fn counts(&self) -> usize {
        self.said.iter().filter(|m| matches!(m, MavMessage::MISSION_COUNT(_))).count()
    }
}

#[test]
fn spec_fence_and_rally_point_are_uploaded_read_back_and_not_written_again() {
    for asks_the_old_way in [false, true] {
        let mut bench = Bench::new(FenceDuty::Upload);
        bench.autopilot.asks_the_old_way = asks_the_old_way;
        assert!(!bench.passes() && bench.check("fence").detail.contains("not read yet"));
        bench.run(1.0);
        assert!(bench.passes(), "{:?} {:?}", bench.check("fence"), bench.check("rally point"));
        // By hand: 50 m are 449.5 units of 1e-6 deg of latitude here, and 698.9 of longitude.
        let fence = &bench.autopilot.fence;
        let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
        assert!(fence.iter().all(|item| item.command == corner && item.param1 == 4.0));
        assert!(fence.iter().all(|item| item.frame == MavFrame::MAV_FRAME_GLOBAL));
        let [south_west, .., north_west] = fence.as_slice() else { panic!() };
        assert!((south_west.x - 500_750_505).abs() < 30 && (south_west.y - 144_371_011).abs() < 30);
        assert!((north_west.x - 500_759_495).abs() < 30 && (north_west.y - south_west.y).abs() < 3);
        let [rally] = bench.autopilot.rally.as_slice() else { panic!() };
        assert_eq!(rally.frame, MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT);
        assert!((rally.x - 500_755_360).abs() < 5 && rally.z == 0.0);
        assert_eq!(bench.counts(), 2);
        // Read again and again, and left alone.
        bench.run(60.0);
        assert!(bench.passes() && bench.counts() == 2);
        let reads = bench.said.iter().filter(|m| matches!(m, MavMessage::MISSION_REQUEST_LIST(_))).count();
        assert!((10..=18).contains(&reads), "{reads}");
        // The next companion finds it there.
        let mut next = Bench::new(FenceDuty::Upload);
        std::mem::swap(&mut next.autopilot, &mut bench.autopilot);
        next.run(1.0);
        assert!(next.passes() && next.counts() == 0);
    }
}

#[test]
fn prop_loss_and_repetition_delay_it_and_change_nothing() {
    for loses_every in 2..14 {
        for repeats in [false, true] {
            let mut bench = Bench::new(FenceDuty::Upload);
            (bench.loses_every, bench.repeats) = (loses_every, repeats);
            let mut passed = false;
            for _ in 0..120 {
                bench.run(1.0);
                passed |= bench.passes();
                let whole = bench.autopilot.fence.is_empty() || bench.autopilot.fence.len() == 4;
                assert!(whole && bench.autopilot.rally.len() <= 1);
            }
            // Of every second message lost, each question or its answer is.
            assert!(passed || loses_every == 2, "{loses_every} {repeats}");
        }
    }
}

#[test]
fn spec_refusals_are_named_and_tried_again() {
    for (result, why) in [
        (MavMissionResult::MAV_MISSION_ERROR, "busy with another station"),
        (MavMissionResult::MAV_MISSION_DENIED, "busy with another station"),
        (MavMissionResult::MAV_MISSION_NO_SPACE, "too many corners"),
        (MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME, "MAV_MISSION_UNSUPPORTED_FRAME"),
    ] {
        let mut bench = Bench::new(FenceDuty::Upload);
        bench.autopilot.refuses = Some(result);
        bench.run(20.0);
        let fence = bench.check("fence");
        assert!(fence.result == Fail && fence.detail.contains(why), "{fence:?}");
        // Two lists, each with pauses: no flood.
        assert!(bench.counts() <= 16, "{}", bench.counts());
        bench.autopilot.refuses = None;
        bench.run(8.0);
        assert!(bench.passes(), "{:?}", bench.check("fence"));
    }
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.autopilot.mute = true;
    bench.run(10.0);
    assert!(bench.check("fence").detail.contains("does not answer"), "{:?}", bench.check("fence"));
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.autopilot.without_rally = true;
    bench.run(2.0);
    assert!(bench.passes() && bench.check("rally point").detail.contains("has none"));
}

#[test]
fn spec_what_another_station_writes_is_seen_and_put_right() {
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.run(1.0);
    bench.autopilot.fence[2].y += 100;
    bench.run(9.0);
    assert!(bench.passes(), "not read again yet");
    bench.run(4.0);
    assert!(bench.passes() && bench.counts() == 3);
    bench.autopilot.fence.pop();
    bench.run(12.0);
    assert!(bench.passes() && bench.counts() == 4 && bench.autopilot.fence.len() == 4);
    // A circle in place of a corner.
    bench.autopilot.fence[1].command = MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION;
    bench.run(12.0);
    assert!(bench.passes() && bench.counts() == 5);
    // Somebody else's transfer on the same wire, and one of another list, are none of ours.
    bench.run(7.0);
    for (system, kind) in [(255, FENCE), (1, MavMissionType::MAV_MISSION_TYPE_MISSION)] {
        let ack = MISSION_ACK_DATA {
            target_system: system,
            target_component: 191,
            mavtype: MavMissionResult::MAV_MISSION_ERROR,
            mission_type: kind,
            ..MISSION_ACK_DATA::DEFAULT
        };
        let request = MISSION_REQUEST_INT_DATA {
            seq: 0,
            target_system: system,
            target_component: 191,
            mission_type: kind,
        };
        let said = bench.said.len();
        bench.keeper.handle(&MavMessage::MISSION_ACK(ack), &bench.state, bench.now, &mut bench.out);
        bench.keeper.handle(
            &MavMessage::MISSION_REQUEST_INT(request),
            &bench.state,
            bench.now,
            &mut bench.out,
        );
        bench.run(0.5);
        assert!(bench.passes() && bench.said.len() == said);
    }
}

#[test]
fn spec_what_will_be_uploaded_is_foreseen_with_a_warning_and_not_written() {
    let mut bench = Bench::new(FenceDuty::Foresee);
    let unread = bench.check("fence");
    assert_eq!(unread.result, Fail, "{unread:?}");
    bench.run(20.0);
    for name in ["fence", "rally point"] {
        let told = bench.check(name);
        assert!(told.result == Warn && told.detail.contains("uploads it before take-off"), "{told:?}");
    }
    assert_eq!(bench.counts(), 0);
}

#[test]
fn spec_check_reads_and_never_writes_and_none_is_warned_of() {
    let mut bench = Bench::new(FenceDuty::Check);
    bench.run(20.0);
    let fence = bench.check("fence");
    assert!(fence.result == Fail && fence.detail.contains("0 items, should be 4"), "{fence:?}");
    assert_eq!(bench.counts(), 0);
    let mut uploaded = Bench::new(FenceDuty::Upload);
    uploaded.run(1.0);
    std::mem::swap(&mut bench.autopilot, &mut uploaded.autopilot);
    bench.autopilot.fence[1].x += 1;
    bench.run(8.0);
    assert!(bench.passes(), "one unit is rounding");
    bench.autopilot.fence[1].x += 1;
    bench.run(12.0);
    let fence = bench.check("fence");
    assert!(fence.result == Fail && fence.detail.contains("item 2 is at"), "{fence:?}");

    let mut bench = Bench::new(FenceDuty::None);
    bench.run(5.0);
    assert!(bench.said.is_empty());
    let fence = bench.check("fence");
    assert!(fence.result == Warn && fence.detail.contains("none"), "{fence:?}");
}

#[test]
fn spec_an_autopilot_that_keeps_something_else_is_not_believed() {
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.autopilot.rounds = 5;
    bench.run(12.0);
    let fence = bench.check("fence");
    assert!(fence.result == Fail && fence.detail.contains("keeps it otherwise"), "{fence:?}");
    assert!(bench.counts() <= 8, "{}", bench.counts());
    // One unit is rounding.
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.autopilot.rounds = 1;
    bench.run(1.0);
    assert!(bench.passes());
}

#[test]
fn spec_nothing_is_said_while_the_vehicle_is_armed_or_flies_or_is_not_known() {
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.state.armed = None;
    bench.run(5.0);
    bench.state.armed = Some(Timed::new(true, bench.now));
    bench.run(5.0);
    assert!(bench.said.is_empty() && bench.keeper.timeout(&bench.state).is_none());
    bench.state.armed = Some(Timed::new(false, bench.now));
    bench.state.landed = Some(Timed::new(crate::autopilot::Landed::InAir, bench.now));
    bench.run(5.0);
    assert!(bench.said.is_empty());
    // Armed in the middle of it: silence, and from the beginning afterwards.
    bench.state.landed = None;
    bench.run(0.02);
    assert!(!bench.said.is_empty() && !bench.passes());
    // What was said before that.
    while bench.out.next_message().is_some() {}
    bench.state.armed = Some(Timed::new(true, bench.now));
    let said = bench.said.len();
    bench.autopilot.ask(bench.now);
    bench.run(20.0);
    assert_eq!(bench.said.len(), said);
    bench.state.armed = Some(Timed::new(false, bench.now));
    bench.run(10.0);
    assert!(bench.passes());
}

#[test]
fn spec_home_outside_the_fence_or_away_from_the_vehicle_is_named_and_the_rally_point_follows_home() {
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.run(1.0);
    // A little drift moves nothing; a new home does.
    bench.state.home_enu_m = Some(Timed::new(Enu::new(3.6, 4.0, 0.5), bench.now));
    bench.run(15.0);
    assert!(bench.passes() && bench.counts() == 2);
    bench.state.home_enu_m = Some(Timed::new(Enu::new(20.0, 4.0, 0.5), bench.now));
    bench.run(15.0);
    assert!(bench.passes() && bench.counts() == 3);
    bench.state.home_enu_m = Some(Timed::new(Enu::new(51.0, 4.0, 0.5), bench.now));
    let fence = bench.check("fence");
    assert!(fence.result == Fail && fence.detail.contains("home at 51.0"), "{fence:?}");
    let taken = crate::autopilot::BootTime::ZERO;
    bench.state.position_enu_m =
        Some(crate::autopilot::Sampled::new(Enu::new(45.0, 4.0, 0.0), taken, bench.now));
    let home = bench.check("place of home");
    assert!(home.result == Warn && home.detail.contains("6.0 m"), "{home:?}");
}

#[test]
fn spec_an_autopilot_that_asks_without_end_is_left() {
    let mut bench = Bench::new(FenceDuty::Upload);
    bench.run(0.02);
    let said = bench.said.len();
    for _ in 0..1000 {
        let seq = 0;
        let request =
            MISSION_REQUEST_INT_DATA { seq, target_system: 1, target_component: 191, mission_type: FENCE };
        bench.keeper.handle(
            &MavMessage::MISSION_REQUEST_INT(request),
            &bench.state,
            bench.now,
            &mut bench.out,
        );
    }
    let answers = std::iter::from_fn(|| bench.out.next_message()).count();
    assert!(answers <= 20, "{answers}");
    assert!(said <= 6);
}

#[test]
fn spec_zones_follow_the_fence_as_exclusions_and_what_the_autopilot_cannot_be_told_of_is_warned_of() {
    let corners = |corners: [[f64; 2]; 3]| corners.map(Vector2::from).to_vec();
    let fence = Fence {
        zones_enu_m: vec![
            corners([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0]]),
            corners([[-30.0, 0.0], [-20.0, 0.0], [-20.0, 9.0]]),
        ],
        untold: vec!["\"mast\" (it has a height)".to_owned()],
        ..square(FenceDuty::Upload)
    };
    let keeper = Keeper::new(Some(fence.clone()), ORIGIN);
    let said: Vec<_> = keeper.lists[0].wanted.iter().map(|item| (item.command, item.param1)).collect();
    let inclusion = (MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, 4.0);
    let exclusion = (MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION, 3.0);
    assert_eq!(said, [[inclusion; 4].as_slice(), &[exclusion; 6]].concat());
    // A corner of a zone that is an inclusion's there is another fence.
    let mut other = keeper.lists[0].wanted.clone();
    assert_eq!(keeper.lists[0].difference(&other), None);
    other[4].command = inclusion.0;
    assert!(keeper.lists[0].difference(&other).is_some_and(|how| how.starts_with("item 5 is")));

    let told = check_zones(&fence).unwrap();
    assert!(told.result == Warn && told.detail.contains("\"mast\" (it has a height)"), "{told:?}");
    let all = check_zones(&Fence { untold: Vec::new(), ..fence.clone() }).unwrap();
    assert!(all.result == Pass && all.detail.starts_with("2 of them"), "{all:?}");
    assert_eq!(check_zones(&square(FenceDuty::Upload)), None);
}
