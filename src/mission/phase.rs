//! The phases of a flight, each with what only it needs.

use std::time::Duration;

use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity};
use crate::planner::moving::{Instant as Place, Limits};
use crate::planner::track::{Glide, Track};
use crate::schedule::trajectory::{Sample, Start, Trajectory};
use crate::time::Instant;

use super::turns::Turns;

/// For a vehicle that is farther than the first from where its trajectory has it, in metres, the trajectory goes slower, and waits at
/// the second: no more than what paths are farther apart for the errors of both, and more than who keeps up is off.
pub(super) const WAITS_M: [f64; 2] = [1.0, 2.0];
/// In all it waits for so many times as long as it takes: no state in the air lasts for ever.
const WAITS_TIMES: u32 = 3;
/// States that are older, or farther apart, come over a link that has stood still, and its setpoints with it.
pub(super) const HELD_UP: Duration = Duration::from_millis(250);

/// What the setpoints follow.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    pub trajectory: Trajectory,
    /// Later by as long as the trajectory has waited.
    pub starts_at: Instant,
    /// How long it has, in all.
    waited: Duration,
    /// How fast the trajectory's time goes, in [0, 1].
    rate: f64,
    /// Until when this is reckoned.
    reckoned_at: Option<Instant>,
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
        Self {
            trajectory,
            starts_at,
            waited: Duration::ZERO,
            rate: 1.0,
            reckoned_at: None,
            track: None,
            glide: None,
            rests_s: None,
        }
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

    /// Has the rest of the trajectory be later while its vehicle, which was there at `at`, is not where it should be: a setpoint that
    /// runs away from one that the wind holds back leads it straight on, off the path that is clear of the other vehicle and of all
    /// that stands about.
    pub fn wait_for(&mut self, position_enu_m: &Enu, at: Instant, now: Instant) {
        let passed = now.saturating_since(self.reckoned_at.replace(now).unwrap_or(now));
        let on_the_way = (self.starts_at..self.ends_at()).contains(&now);
        if on_the_way {
            let later = passed.mul_f64(1.0 - self.rate);
            self.starts_at = self.starts_at + later;
            self.waited += later;
        }
        let may_wait = on_the_way && self.waited < WAITS_TIMES * self.trajectory.duration();
        self.rate = if may_wait && now.saturating_since(at) <= HELD_UP {
            let meant = self.trajectory.sample(at.saturating_since(self.starts_at)).position_enu_m;
            let [from_m, to_m] = WAITS_M;
            ((to_m - (meant - position_enu_m).norm()) / (to_m - from_m)).clamp(0.0, 1.0)
        } else {
            1.0
        };
    }

    /// Whether the trajectory is slower for its vehicle's sake.
    pub fn waits(&self) -> bool {
        self.rate < 1.0
    }

    pub fn sample(&self, now: Instant) -> Sample {
        self.commanded(now, [Duration::ZERO; 2])
    }

    /// What to command, so that a vehicle that turns and moves `late` is where it should be on its track and on its way.
    pub fn commanded(&self, now: Instant, [late, late_on_way]: [Duration; 2]) -> Sample {
        let mut sample = self.trajectory.sample(now.saturating_since(self.starts_at));
        sample.velocity_enu_m_s = EnuVelocity::from_vector(self.rate * sample.velocity_enu_m_s.vector());
        let acceleration = sample.acceleration_enu_m_s2.vector();
        sample.acceleration_enu_m_s2 = EnuAcceleration::from_vector(self.rate * self.rate * acceleration);
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

    /// The motion of one in the air that waits for its vehicle: in a climb the autopilot may take its own time.
    pub fn motion_that_waits(&mut self) -> Option<&mut Motion> {
        match self {
            Self::InService { motion, .. } | Self::Returning(motion) => Some(motion),
            _ => None,
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

    /// A vehicle that makes `speed_m_s` along the way, and is blown `aside_m` off it, for so many seconds; how far it has come, how far it was
    /// from where it was told to be, at most, and whether the way was flown to its end.
    fn held_back(speed_m_s: f64, aside_m: f64, for_s: u64) -> (f64, f64, bool) {
        let mut motion = motion();
        let (mut gone_m, mut off_m) = (0.0f64, 0.0f64);
        for k in 0..50 * for_s {
            let now = at(100) + Duration::from_millis(20 * k);
            let is_at = Enu::new(gone_m, aside_m, 0.0);
            motion.wait_for(&is_at, now, now);
            let meant = motion.sample(now);
            off_m = off_m.max((meant.position_enu_m - is_at).norm());
            gone_m = (gone_m + 0.02 * speed_m_s).min(meant.position_enu_m.x);
        }
        (gone_m, off_m, motion.is_over(at(100 + for_s)))
    }

    #[test]
    fn spec_a_way_waits_for_its_vehicle_and_not_for_ever() {
        let lasts_s = motion().trajectory.duration().as_secs_f64();
        assert!((4.0..6.0).contains(&lasts_s), "{lasts_s}");
        let (gone_m, off_m, over) = held_back(9.0, 0.9, 6);
        assert!(gone_m > 9.99 && off_m < 1.0 && over, "it keeps up: {gone_m} {off_m}");
        // Ten metres at one a second, never two behind.
        let (gone_m, off_m, over) = held_back(1.0, 0.0, 9);
        assert!((8.5..9.01).contains(&gone_m) && off_m < 2.0 && !over, "{gone_m} {off_m}");
        assert!(held_back(1.0, 0.0, 13).2);
        // Blown aside it is waited for where it is: for three times the way's length, and no longer.
        let (_, off_m, over) = held_back(0.0, 2.5, (3.0 * lasts_s) as u64);
        assert!(off_m < 2.6 && !over, "{off_m}");
        assert!(held_back(0.0, 2.5, (4.5 * lasts_s) as u64).2);
    }

    #[test]
    fn spec_a_way_that_waits_is_commanded_slower_and_a_position_that_is_old_is_none_to_wait_for() {
        let mut motion = motion();
        let now = at(102);
        let meant = motion.sample(now);
        let speed = |motion: &Motion| motion.sample(now).velocity_enu_m_s.vector().norm();
        let nominal_m_s = speed(&motion);
        assert!(nominal_m_s > 2.0);
        for (off_m, late_ms, share) in
            [(0.9, 0, 1.0), (1.5, 0, 0.5), (2.0, 0, 0.0), (9.0, 0, 0.0), (9.0, 300, 1.0)]
        {
            let late = Duration::from_millis(late_ms);
            motion.wait_for(&(meant.position_enu_m + Enu::new(0.0, off_m, 0.0)), now - late, now);
            assert!((speed(&motion) - share * nominal_m_s).abs() < 1e-9, "{off_m} {late_ms}");
            assert_eq!(motion.waits(), share < 1.0);
        }
        assert_eq!(motion.sample(now).position_enu_m, meant.position_enu_m, "no time has passed");
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
