//! What is reported of those that move: by handsets of their own, or by an operator who sees them.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_INT_DATA, MavCmd, MavFrame, MavMessage};

use super::executive::Executive;
use super::following::{Following, seconds};
use super::notice::Notice;
use crate::geo::{Enu, Geodetic};
use crate::planner::following::{Estimate, Moved, Mover, Report, Who};
use crate::role::Role;
use crate::time::Instant;

/// The command by which an operator says where somebody was seen.
pub(super) const SIGHTING: MavCmd = MavCmd::MAV_CMD_USER_5;
/// A report from farther away than this is none, in metres.
const FARTHEST_M: f64 = 20_000.0;
/// No report is overtaken by more than so many seconds: a clock that goes back by more has started anew.
const OVERTAKEN_S: f64 = 10.0;
/// What was seen longer ago than this, in seconds, says nothing.
const OLDEST_S: f64 = 60.0;
/// How well a height is known, over how well a place is.
const UP: f64 = 2.0;

/// What has been heard of one that moves.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Heard {
    pub estimate: Option<Estimate>,
    /// Our clock less the sender's, by the report that was fastest, in seconds.
    less_s: Option<f64>,
    /// The sender's clock in the last report, in seconds, and the place.
    last: Option<(f64, Enu)>,
}

impl Heard {
    /// A place that is reported, when by the sender's clock and received when by ours, and how well it is known across. What is
    /// overtaken on its way, and copies, say nothing.
    fn take(&mut self, position_enu_m: Enu, (sent_s, received_s): (f64, f64), std_m: f64, mover: &Mover) {
        let back_s = self.last.map(|(last_s, _)| last_s - sent_s);
        let overtaken = back_s.is_some_and(|back_s| back_s > 0.0 && back_s < OVERTAKEN_S);
        if overtaken || self.last == Some((sent_s, position_enu_m)) {
            return;
        }
        self.last = Some((sent_s, position_enu_m));
        // A clock that does not go on has started anew, or is none.
        let goes_on = back_s.is_some_and(|back_s| back_s < 0.0);
        let by_receipt_s = received_s - sent_s;
        let less_s = self.less_s.filter(|_| goes_on).map_or(by_receipt_s, |less_s| less_s.min(by_receipt_s));
        self.less_s = Some(less_s);
        self.see(position_enu_m, sent_s + less_s, std_m, mover);
    }

    /// A place, when by our clock, and how well it is known across; whether that is news.
    fn see(&mut self, position_enu_m: Enu, at_s: f64, std_m: f64, mover: &Mover) -> bool {
        let report = Report { at_s, position_enu_m, std_m: [std_m, UP * std_m] };
        match &mut self.estimate {
            Some(estimate) => estimate.take(&report),
            None => {
                self.estimate = Some(Estimate::new(&report, mover.gait.unrest()));
                true
            }
        }
    }
}

/// A report's position, the sender's clock in seconds, and how well the place is known across, if it says so.
fn report(message: &MavMessage) -> Option<(Geodetic, f64, Option<f64>)> {
    match message {
        MavMessage::GLOBAL_POSITION_INT(m) => {
            Some((Geodetic::of_wire(m.lat, m.lon, m.alt), f64::from(m.time_boot_ms) * 1e-3, None))
        }
        MavMessage::FOLLOW_TARGET(m) => {
            let place = Geodetic { alt_m: f64::from(m.alt), ..Geodetic::of_wire(m.lat, m.lon, 0) };
            let variance = f64::from(m.position_cov[0].max(m.position_cov[1]));
            let std_m = (variance.is_finite() && variance > 0.0).then(|| variance.sqrt());
            Some((place, m.timestamp as f64 * 1e-3, std_m))
        }
        _ => None,
    }
}

impl Executive {
    /// A message of whoever is on the autopilot's link, if it says where one is that moves.
    pub(super) fn hear_of_movers(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        let Some(following) = &self.settings.following else { return };
        // Its own vehicle's place is nobody else's.
        if self.autopilot.state().system.is_some_and(|own| u32::from(own) == header.system_id) {
            return;
        }
        let of = following
            .movers
            .iter()
            .position(|mover| mover.system_id.map(u32::from) == Some(header.system_id));
        let Some((index, (place, sent_s, std_m))) = of.zip(report(message)) else { return };
        let mover = &following.movers[index];
        let std_m = std_m.unwrap_or(mover.std_m);
        let position_enu_m = place.to_enu(self.settings.autopilot.mission_origin);
        // What is no number is not nearer either.
        if position_enu_m.norm() <= FARTHEST_M {
            self.followers.heard[index].take(position_enu_m, (sent_s, seconds(now)), std_m, mover);
        }
    }

    /// I: where an operator has seen somebody that moves, by COMMAND_INT.
    ///
    /// # Errors
    /// Why that says nothing, in words.
    pub(super) fn take_sighting(
        &mut self,
        seen: &COMMAND_INT_DATA,
        now: Instant,
    ) -> Result<(), &'static str> {
        let following = self.settings.following.as_ref().ok_or("nobody `moves` in this mission")?;
        if self.settings.role == Role::J {
            return Err("vehicle I is to be told");
        }
        let seen = Sighting::of(seen, following, self.settings.autopilot.mission_origin)?;
        let (heard, mover) = (&mut self.followers.heard[seen.index], &following.movers[seen.index]);
        let news = heard.see(seen.position_enu_m, seconds(now) - seen.age_s, seen.std_m, mover);
        news.then_some(()).ok_or("a later report is known")
    }

    /// The mission file was edited, and whoever did asks for it to be looked at: where those are that move, or why nothing of it
    /// counts.
    pub fn handle_file(&mut self, edited: Result<Vec<Moved>, String>, now: Instant) {
        let taken = edited.and_then(|all| {
            let following = self.settings.following.as_ref().ok_or("nobody `moves` in this mission")?;
            if self.settings.role == Role::J {
                return Err("vehicle I's is to be edited".to_owned());
            }
            let mut count = 0;
            for (mover, heard) in following.movers.iter().zip(&mut self.followers.heard) {
                let seen = all.iter().find(|moved| moved.who == mover.who);
                let news = seen.is_some_and(|m| heard.see(m.position_enu_m, seconds(now), m.std_m, mover));
                count += usize::from(news);
            }
            Ok(count)
        });
        self.notice(match taken {
            Ok(count) => Notice::FileTaken(count),
            Err(why) => Notice::FileRefused(why),
        });
        self.react(now);
    }
}

/// What an operator says of one that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sighting {
    /// Of those that move.
    index: usize,
    position_enu_m: Enu,
    /// How long ago that was, in seconds.
    age_s: f64,
    std_m: f64,
}

impl Sighting {
    fn of(seen: &COMMAND_INT_DATA, following: &Following, origin: Geodetic) -> Result<Self, &'static str> {
        let number = |param: f32| (param.fract() == 0.0 && param >= 1.0).then(|| param as usize - 1);
        let who = match (seen.param1, number(seen.param2)) {
            (0.0, Some(index)) => Who::User(index),
            (1.0, Some(index)) => Who::Eavesdropper(index),
            _ => {
                return Err(
                    "param1 is 0 (user) or 1 (eavesdropper), param2 its number in the mission, from 1 on",
                );
            }
        };
        let moves = |mover: &Mover| mover.who == who;
        let index =
            following.movers.iter().position(moves).ok_or("in the mission it does not move (`moves`)")?;
        // Many still send its twin, of the time when a frame told integers.
        #[allow(deprecated)]
        let global = [MavFrame::MAV_FRAME_GLOBAL, MavFrame::MAV_FRAME_GLOBAL_INT].contains(&seen.frame);
        if !global {
            return Err("its frame is to be MAV_FRAME_GLOBAL, its altitude above mean sea level");
        }
        let said = |param: f32| Some(f64::from(param)).filter(|number| number.is_finite() && *number != 0.0);
        let (std_m, age_s) =
            (said(seen.param3).unwrap_or(following.movers[index].std_m), said(seen.param4).unwrap_or(0.0));
        if !(std_m > 0.0 && (0.0..=OLDEST_S).contains(&age_s)) {
            return Err(
                "param3 is its standard deviation in m (0: the mission's), param4 its age in s, up to 60",
            );
        }
        let alt_m = Some(f64::from(seen.z)).filter(|alt_m| alt_m.is_finite());
        let place = Geodetic { alt_m: alt_m.unwrap_or(origin.alt_m), ..Geodetic::of_wire(seen.x, seen.y, 0) };
        let mut position_enu_m = place.to_enu(origin);
        if alt_m.is_none() {
            position_enu_m.z = following.height_m(who);
        }
        // What is no number is not nearer either.
        let near = position_enu_m.norm() <= FARTHEST_M;
        near.then_some(Self { index, position_enu_m, age_s, std_m }).ok_or("that is farther than 20 km away")
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use mavlink::dialects::ardupilotmega::{FOLLOW_TARGET_DATA, GLOBAL_POSITION_INT_DATA};

    use super::*;
    use crate::planner::Options;
    use crate::planner::following::Gait;
    use crate::planner::problem::Problem;

    const MOVER: Mover = Mover { who: Who::User(0), system_id: Some(51), gait: Gait::Drives, std_m: 3.0 };

    fn east(heard: &Heard, at_s: f64) -> f64 {
        heard.estimate.unwrap().at(at_s).position_enu_m.x
    }

    /// Eight metres a second to the east, told once a second; a report takes a tenth of a second or more.
    fn driven(delays_s: &[f64]) -> Heard {
        let mut heard = Heard::default();
        for (k, delay_s) in delays_s.iter().enumerate() {
            let (sent_s, at_s) = (500.0 + k as f64, 100.0 + k as f64);
            heard.take(Enu::new(8.0 * k as f64, 0.0, 0.0), (sent_s, at_s + delay_s), 0.5, &MOVER);
        }
        heard
    }

    #[test]
    fn spec_a_report_is_of_its_senders_time_however_late_it_comes() {
        let even = driven(&[0.1; 10]);
        let uneven = driven(&[0.1, 0.9, 0.1, 0.4, 0.8, 0.1, 0.7, 0.3, 0.9, 0.6]);
        assert_eq!(even.estimate, uneven.estimate);
        // By the fastest of them it is as late as that.
        assert!((east(&even, 109.1) - 72.0).abs() < 0.5, "{}", east(&even, 109.1));
    }

    #[test]
    fn spec_copies_and_what_was_overtaken_say_nothing() {
        let mut heard = driven(&[0.1; 5]);
        let before = heard.estimate;
        heard.take(Enu::new(32.0, 0.0, 0.0), (504.0, 104.9), 0.5, &MOVER);
        heard.take(Enu::new(24.0, 0.0, 0.0), (503.0, 104.95), 0.5, &MOVER);
        assert_eq!(heard.estimate, before);
    }

    #[test]
    fn spec_a_sender_that_starts_anew_or_has_no_clock_is_taken_by_receipt() {
        let mut heard = driven(&[0.1; 5]);
        for k in 5..9 {
            heard.take(
                Enu::new(8.0 * f64::from(k), 0.0, 0.0),
                (f64::from(k) - 4.0, 100.1 + f64::from(k)),
                0.5,
                &MOVER,
            );
        }
        assert!((east(&heard, 108.1) - 64.0).abs() < 0.5, "{}", east(&heard, 108.1));
        let mut heard = Heard::default();
        for k in 0..9 {
            heard.take(Enu::new(8.0 * f64::from(k), 0.0, 0.0), (0.0, 100.0 + f64::from(k)), 0.5, &MOVER);
        }
        assert!((east(&heard, 108.0) - 64.0).abs() < 0.5, "{}", east(&heard, 108.0));
    }

    #[test]
    fn spec_an_operator_says_who_was_seen_where_when_and_how_well() {
        let mut problem = Problem::paper([[100.0, 0.0], [0.0, 100.0]], 0.5, 0.03);
        problem.eavesdroppers[1].position_enu_m.z = 7.0;
        let mover = Mover { who: Who::Eavesdropper(1), system_id: None, ..MOVER };
        let following = Following {
            problems: vec![("alpha".into(), Arc::new(problem))],
            movers: vec![MOVER, mover],
            options: Options::default(),
            by_volume: false,
        };
        let origin = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.0 };
        let seen = COMMAND_INT_DATA {
            frame: MavFrame::MAV_FRAME_GLOBAL,
            param1: 1.0,
            param2: 2.0,
            param3: 12.0,
            param4: 1.5,
            x: 500_010_000,
            y: 140_000_000,
            z: 205.0,
            ..Default::default()
        };
        let of = |seen: &COMMAND_INT_DATA| Sighting::of(seen, &following, origin);
        let known = of(&seen).unwrap();
        assert_eq!((known.index, known.age_s, known.std_m), (1, 1.5, 12.0));
        assert!((known.position_enu_m - Enu::new(0.0, 111.2, 5.0)).norm() < 0.1, "{}", known.position_enu_m);
        // What is not said is as the mission has it.
        for nothing in [0.0, f32::NAN] {
            let bare = COMMAND_INT_DATA { param3: nothing, param4: nothing, z: f32::NAN, ..seen.clone() };
            let known = of(&bare).unwrap();
            assert_eq!((known.age_s, known.std_m, known.position_enu_m.z), (0.0, 3.0, 7.0));
        }
        let user = COMMAND_INT_DATA { param1: 0.0, param2: 1.0, ..seen.clone() };
        assert_eq!(of(&user).unwrap().index, 0);
        let wrong = |change: fn(&mut COMMAND_INT_DATA), says: &str| {
            let mut seen = seen.clone();
            change(&mut seen);
            let why = of(&seen).unwrap_err();
            assert!(why.contains(says), "{why}");
        };
        wrong(|seen| seen.param1 = 2.0, "param1 is 0");
        for number in [0.0, 1.5, -1.0, f32::NAN, f32::INFINITY] {
            let why = of(&COMMAND_INT_DATA { param2: number, ..seen.clone() }).unwrap_err();
            assert!(why.contains("param2") || number.is_infinite(), "{number}: {why}");
        }
        wrong(|seen| seen.param2 = 1.0, "does not move");
        wrong(|seen| seen.param3 = -3.0, "param3");
        wrong(|seen| seen.param4 = 61.0, "param4");
        wrong(|seen| seen.param4 = -1.0, "param4");
        wrong(|seen| seen.frame = MavFrame::MAV_FRAME_LOCAL_NED, "frame");
        wrong(|seen| seen.x = 510_000_000, "farther");
    }

    #[test]
    fn spec_places_are_read_of_both_messages_and_of_no_other() {
        let (lat, lon) = (500_000_000, 140_000_000);
        let own = MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: 1500,
            lat,
            lon,
            alt: 200_500,
            ..Default::default()
        });
        let place = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.5 };
        assert_eq!(report(&own), Some((place, 1.5, None)));
        let target = |position_cov: [f32; 3]| {
            MavMessage::FOLLOW_TARGET(FOLLOW_TARGET_DATA {
                timestamp: 1500,
                lat,
                lon,
                alt: 200.5,
                position_cov,
                ..Default::default()
            })
        };
        assert_eq!(report(&target([4.0, 1.0, 9.0])), Some((place, 1.5, Some(2.0))));
        for unknown in [[0.0; 3], [f32::NAN; 3], [-1.0, -2.0, 0.0]] {
            assert_eq!(report(&target(unknown)), Some((place, 1.5, None)));
        }
        assert_eq!(report(&MavMessage::HEARTBEAT(Default::default())), None);
    }
}
