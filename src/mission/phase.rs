//! The phases of a flight, each with what only it needs.

use std::time::Duration;

use crate::geo::Attitude;
use crate::planner::moving::{Instant as Place, Limits};
use crate::planner::track::{Glide, Track};
use crate::schedule::trajectory::{Sample, Start, Trajectory};
use crate::time::Instant;

use super::turns::Turns;

/// What the setpoints follow.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub trajectory: Trajectory,
    pub starts_at: Instant,
    /// How the vehicle turns, and moves, once the trajectory is flown, and the opening of the slot in which it does.
    pub track: Option<(Track, Instant)>,
    /// How it comes to rest on the way of a track, wherever its trajectory and another track have it, and since when it does so.
    pub glide: Option<(Glide, Instant)>,
    /// It has come along such a way: the motion's time where it rests, or will.
    pub rests_s: Option<f64>,
}

impl Motion {
    /// Along a trajectory, and to rest.
    pub fn new(trajectory: Trajectory, starts_at: Instant) -> Self {
        Self { trajectory, starts_at, track: None, glide: None, rests_s: None }
    }

    /// At rest where the trajectory ends, and then along a track.
    pub fn on_track(trajectory: Trajectory, starts_at: Instant, track: Option<(Track, Instant)>) -> Self {
        Self { track, ..Self::new(trajectory, starts_at) }
    }

    /// Along a way from where the vehicle rests on it, turned as it is.
    pub fn along(glide: Glide, attitude: Attitude, now: Instant) -> Self {
        let end = glide.at(glide.lasts_s()).position_enu_m;
        let start = Start { position_enu_m: end, attitude };
        let rests_s = Some(glide.rests_s());
        Self { glide: Some((glide, now)), rests_s, ..Self::new(Trajectory::rest(&start), now) }
    }

    pub fn sample(&self, now: Instant) -> Sample {
        self.commanded(now, [Duration::ZERO; 2])
    }

    /// What to command, so that a vehicle that turns and moves `late` is where it should be on its track and on its way.
    pub fn commanded(&self, now: Instant, [late, late_on_way]: [Duration; 2]) -> Sample {
        let mut sample = self.trajectory.sample(now.saturating_since(self.starts_at));
        if let Some((track, opens_at)) = self.track.as_ref().filter(|_| self.is_over(now)) {
            sample.attitude = track.attitude((now + late).seconds_since(*opens_at));
        }
        if let Some(place) = self.place(now, late_on_way) {
            sample.position_enu_m = place.position_enu_m;
            sample.velocity_enu_m_s = place.velocity_enu_m_s;
            sample.acceleration_enu_m_s2 = place.acceleration_enu_m_s2;
        }
        sample
    }

    /// Where it is so much later on a way, if it is on one.
    fn place(&self, now: Instant, later: Duration) -> Option<Place> {
        if let Some((glide, begins_at)) = &self.glide {
            return Some(glide.at((now + later).seconds_since(*begins_at)));
        }
        let (track, opens_at) = self.track.as_ref().filter(|_| self.is_over(now))?;
        track.place((now + later).seconds_since(*opens_at))
    }

    /// Whether it follows a way.
    pub fn is_on_way(&self, now: Instant) -> bool {
        self.place(now, Duration::ZERO).is_some()
    }

    /// Whether it has come to rest, and stays so.
    pub fn is_at_rest(&self, now: Instant) -> bool {
        let moves = match (&self.glide, &self.track) {
            (Some((glide, begins_at)), _) => now.seconds_since(*begins_at) < glide.lasts_s(),
            (None, Some((track, opens_at))) => track.moves(now.seconds_since(*opens_at)),
            (None, None) => false,
        };
        self.is_over(now) && !moves
    }

    /// Whether the track has taken over.
    pub fn is_on_track(&self, now: Instant) -> bool {
        self.track.is_some() && self.is_over(now)
    }

    /// Whether the track that has taken over is made anew as it is flown.
    pub fn follows(&self, now: Instant) -> bool {
        self.is_over(now) && self.track.as_ref().is_some_and(|(track, _)| track.followed().is_some())
    }

    /// At rest where it is at `now`, or as soon as it can where it moves along a way.
    pub fn stopped(&self, now: Instant, limits: &Limits) -> Self {
        let Sample { position_enu_m, attitude, .. } = self.sample(now);
        let rest = Self::new(Trajectory::rest(&Start { position_enu_m, attitude }), now);
        let along = |(glide, begins_at): (Glide, Instant)| Self {
            glide: Some((glide.clone(), begins_at)),
            ..Self::along(glide, attitude, now)
        };
        if let Some(glide) = self.glide.clone() {
            return along(glide);
        }
        let on_track = self.track.as_ref().filter(|_| self.is_over(now));
        if let Some((track, opens_at)) = on_track
            && let Some((glide, since_s)) = track.stop(now.seconds_since(*opens_at), limits)
        {
            return along((glide, opens_at.after_s(since_s)));
        }
        match on_track.and_then(|(track, opens_at)| Some((track.way()?, *opens_at))) {
            Some((way, opens_at)) => {
                let entered = now >= opens_at;
                Self { rests_s: Some(if entered { way.exit_s() } else { way.entry_s() }), ..rest }
            }
            None => Self { rests_s: self.rests_s, ..rest },
        }
    }

    /// The same without what was to follow its trajectory, which is flown to its end.
    pub fn without_track(self) -> Self {
        let way = self.track.as_ref().and_then(|(track, _)| track.way());
        Self { rests_s: way.map(|way| way.entry_s()).or(self.rests_s), track: None, ..self }
    }

    pub fn ends_at(&self) -> Instant {
        self.starts_at + self.trajectory.duration()
    }

    /// Whether the trajectory is flown to its end, by the clock.
    pub fn is_over(&self, now: Instant) -> bool {
        now >= self.ends_at()
    }
}

/// The phases' names, in the order of a flight; in the pair's service there are two, without a slot that is agreed on
/// and with one.
pub const NAMES: [&str; 12] = [
    "connecting",
    "standby",
    "taking control",
    "arming",
    "climbing",
    "ready",
    "slot",
    "holding",
    "returning",
    "landing",
    "surrendered",
    "ended",
];

/// See the module.
#[derive(Debug, Clone)]
pub(super) enum Phase {
    /// No autopilot, or no position yet.
    Connecting,
    /// On the ground; something is missing before take-off.
    Standby,
    /// Asking for the companion's mode, at rest on the ground.
    TakingControl(Motion),
    /// Asking to arm, likewise.
    Arming(Motion),
    /// To the lowest altitude of the band, above home.
    Climbing(Motion),
    /// In the pair's service: between slots, on the transit to one, or in it. `turns`: of a transit in which time alone
    /// keeps the vehicles apart.
    InService { motion: Motion, turns: Option<Turns> },
    /// After a fault: hold at least until then, and then as long as the other's way home takes.
    Holding { motion: Motion, since: Instant },
    /// To above home.
    Returning(Motion),
    /// The autopilot lands.
    Landing,
    /// Control is the pilot's or the autopilot's own; watching.
    Surrendered { since: Instant },
    /// On the ground, over.
    Ended,
}

/// An abort begins with a hold, long enough for the peer's word to come through.
pub(super) const HOLD: Duration = Duration::from_secs(3);

impl Phase {
    /// For logs. `in_slot`: a slot is agreed on.
    pub fn name(&self, in_slot: bool) -> &'static str {
        NAMES[usize::from(self.number(in_slot))]
    }

    /// Its place in the order of a flight, and in [`NAMES`].
    pub fn number(&self, in_slot: bool) -> u8 {
        match self {
            Self::Connecting => 0,
            Self::Standby => 1,
            Self::TakingControl(_) => 2,
            Self::Arming(_) => 3,
            Self::Climbing(_) => 4,
            Self::InService { .. } if !in_slot => 5,
            Self::InService { .. } => 6,
            Self::Holding { .. } => 7,
            Self::Returning(_) => 8,
            Self::Landing => 9,
            Self::Surrendered { .. } => 10,
            Self::Ended => 11,
        }
    }

    /// What the setpoints follow; `None` where none are sent.
    pub fn motion(&self) -> Option<&Motion> {
        match self {
            Self::TakingControl(motion)
            | Self::Arming(motion)
            | Self::Climbing(motion)
            | Self::InService { motion, .. }
            | Self::Holding { motion, .. }
            | Self::Returning(motion) => Some(motion),
            Self::Connecting | Self::Standby | Self::Landing | Self::Surrendered { .. } | Self::Ended => None,
        }
    }

    /// On the ground, before anything was asked of the autopilot.
    pub fn is_waiting(&self) -> bool {
        matches!(self, Self::Connecting | Self::Standby)
    }

    /// On the ground, control and arming perhaps asked for.
    pub fn is_on_the_ground(&self) -> bool {
        self.is_waiting() || matches!(self, Self::TakingControl(_) | Self::Arming(_))
    }

    /// In the air on the mission.
    pub fn is_in_service(&self) -> bool {
        matches!(self, Self::InService { .. })
    }

    /// In the air on the mission, or on its way up to it.
    pub fn is_outward(&self) -> bool {
        matches!(self, Self::Climbing(_) | Self::InService { .. })
    }

    /// Going home under our control, or about to.
    pub fn is_returning(&self) -> bool {
        matches!(self, Self::Holding { .. } | Self::Returning(_) | Self::Landing)
    }

    /// The mission is over for this vehicle, well or badly.
    pub fn is_ending(&self) -> bool {
        self.is_returning() || matches!(self, Self::Surrendered { .. } | Self::Ended)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Enu;
    use crate::geo::Pose;
    use crate::planner::plan::VehiclePlan;
    use crate::planner::track::Followed;
    use crate::planner::track::samples::{LIMITS, on_a_way};
    use crate::role::Role;
    use crate::schedule::trajectory::Limits;

    fn at(s: u64) -> Instant {
        Instant::from_start(Duration::from_secs(s))
    }

    fn motion() -> Motion {
        let start = Start { position_enu_m: Enu::zeros(), attitude: Attitude::level() };
        let mut way = Trajectory::rest(&start);
        way.fly(&[Enu::new(10.0, 0.0, 0.0)], &Limits::new(5.0, 2.0, 0.5));
        Motion::new(way, at(100))
    }

    #[test]
    fn spec_a_motion_is_over_once_its_trajectory_is_flown() {
        let motion = motion();
        let ends_at = at(100) + motion.trajectory.duration();
        assert_eq!(motion.ends_at(), ends_at);
        for (now, over) in
            [(at(100), false), (ends_at - Duration::from_millis(1), false), (ends_at, true), (at(900), true)]
        {
            assert_eq!(motion.is_over(now), over, "{now:?}");
        }
    }

    /// Its trajectory is flown by the 104th second or before, and its slot opens at the 110th.
    fn on_track() -> Motion {
        let motion = motion();
        let pose = Pose { position_enu_m: Enu::zeros(), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        let track = Some((on_a_way(pose, None), at(110)));
        assert!(motion.ends_at() <= at(104));
        Motion::on_track(motion.trajectory, at(100), track)
    }

    #[test]
    fn spec_a_track_takes_over_once_the_trajectory_is_flown_and_moves_from_its_opening_on() {
        let motion = on_track();
        let is = |now| (motion.is_on_track(now), motion.is_on_way(now), motion.is_at_rest(now));
        assert_eq!(is(at(101)), (false, false, false), "on the trajectory");
        assert_eq!(is(at(112)), (true, true, false), "on the way");
        assert!(!motion.follows(at(112)));
        let plain = Motion::new(motion.trajectory, at(100));
        assert!(!plain.is_at_rest(at(101)) && plain.is_at_rest(at(112)));
        assert!(!plain.is_on_track(at(112)) && !plain.is_on_way(at(112)));
    }

    #[test]
    fn spec_a_track_that_is_made_anew_is_followed_once_it_has_taken_over() {
        let pose = Pose { position_enu_m: Enu::zeros(), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        let followed = Followed::new(Role::I, VehiclePlan { pose, tx_power_w: 0.5 });
        let track = Some((Track::Followed(followed), at(110)));
        let motion = Motion::on_track(motion().trajectory, at(100), track);
        assert!(!motion.follows(at(101)) && motion.follows(at(112)));
    }

    #[test]
    fn spec_who_is_stopped_on_a_way_comes_to_rest_on_it_and_says_where() {
        let stopped = on_track().stopped(at(112), &LIMITS);
        let (glide, begins_at) = stopped.glide.clone().unwrap();
        assert_eq!((stopped.rests_s, stopped.track.is_none()), (Some(glide.rests_s()), true));
        let rests_at = begins_at.after_s(glide.lasts_s());
        assert!(rests_at > at(112) && rests_at < at(120));
        assert!(!stopped.is_at_rest(at(112)) && stopped.is_at_rest(at(120)));
        let before = on_track().sample(at(112));
        let (here, there) = (stopped.sample(at(112)), stopped.sample(at(120)));
        assert!((here.position_enu_m - before.position_enu_m).norm() < 1e-6, "it goes on from where it is");
        assert!(there.velocity_enu_m_s.vector().norm() < 1e-9 && there.position_enu_m != here.position_enu_m);
        // Once more changes nothing.
        let again = stopped.stopped(at(113), &LIMITS);
        assert_eq!(
            (again.rests_s, again.sample(at(120)).position_enu_m),
            (stopped.rests_s, there.position_enu_m)
        );
        assert!(!again.is_at_rest(at(113)));
    }

    #[test]
    fn spec_what_is_asked_of_a_phase() {
        let since = at(0);
        // On the ground before anything was asked for; on the ground; outward; on its way home; ending.
        for (phase, is) in [
            (Phase::Connecting, [true, true, false, false, false]),
            (Phase::Standby, [true, true, false, false, false]),
            (Phase::TakingControl(motion()), [false, true, false, false, false]),
            (Phase::Arming(motion()), [false, true, false, false, false]),
            (Phase::Climbing(motion()), [false, false, true, false, false]),
            (Phase::InService { motion: motion(), turns: None }, [false, false, true, false, false]),
            (Phase::Holding { motion: motion(), since }, [false, false, false, true, true]),
            (Phase::Returning(motion()), [false, false, false, true, true]),
            (Phase::Landing, [false, false, false, true, true]),
            (Phase::Surrendered { since }, [false, false, false, false, true]),
            (Phase::Ended, [false, false, false, false, true]),
        ] {
            let [waiting, ground, outward, returning, ending] = is;
            assert_eq!((phase.is_waiting(), phase.is_on_the_ground()), (waiting, ground), "{phase:?}");
            assert_eq!((phase.is_outward(), phase.is_returning()), (outward, returning), "{phase:?}");
            assert_eq!(phase.is_ending(), ending, "{phase:?}");
        }
    }
}
