//! How fast the vehicle is against this wind, and whether the ways that are laid out for it count on more.
//!
//! A multirotor that gives all the force it has against a strong wind is slower than `speed_m_s`: its setpoints run away from it, it
//! is metres behind them, and late in its slot. What it makes meanwhile towards where it should be is its pace. Where a mission follows
//! what moves, the next ways, poses and motions are planned for it: J tells I of its own in VEILWING_STATUS, and I tells J for
//! which of both, with those that move ([`Places`](crate::pair::Places)). Slots in which it keeps up let
//! it be tried faster again, more of them each time that costs one.
//! The plans of the other modes are agreed on as they are, and an operator is told. Such a mission may also leave a motion that the wind
//! has it lose: the next one is made from where it then rests.

use super::executive::Executive;
use super::notice::Notice;
use super::phase::{HELD_UP, Motion, Phase, WAITS_M};
use crate::geo::{Attitude, Enu};
use crate::pair::Pace;
use crate::planner::region::Region;
use crate::role::{PerVehicle, Role};
use crate::schedule::separation::clearance_m;
use crate::schedule::trajectory::{Limits, Sample, Start, Trajectory};
use crate::time::Instant;

/// Over the ground; the loops and links of one that keeps up leave less, in metres.
const BEHIND_M: f64 = 4.0;
/// The best of so many seconds says what it makes: it may have to gather speed first.
const SPAN_S: f64 = 2.0;
/// Who is so far off its motion, in metres, has lost its pose: half as much again as any slot bears.
const BLOWN_OFF_M: f64 = 1.5;
/// Where a vehicle is in so many seconds by its velocity, ...
const SOON_S: f64 = 0.5;
/// ... so far outside the airspace, in metres, is nobody who holds a pose on its edge, ...
const OUTSIDE_M: f64 = 0.1;
/// ... and so far inside it comes back.
const INSIDE_M: f64 = 1.0;
/// Who makes this share of what is counted on is behind for another reason.
const KEEPS_UP: f64 = 0.9;
/// Slots in a row that it keeps up in before a faster pace is tried, at the most.
const LONGEST_PATIENCE: u32 = 8;
/// The share of what was made that is counted on next: gusts.
const MARGIN: f64 = 0.9;

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Progress {
    /// What the mission lets ways count on, m/s.
    largest_m_s: f64,
    last: Option<(Instant, Enu)>,
    /// While it is behind.
    made_m: f64,
    span_s: f64,
    /// Since the last slot was over.
    best_m_s: Option<f64>,
    pace: Option<Pace>,
    told: bool,
    /// A plan for another pace is one for all slots that are left: only what was paid for counts, and no more is tried.
    of_plan: bool,
    /// It was behind while it was to be on the air.
    was_late: bool,
    /// It was waited for, be it for moments.
    was_waited_for: bool,
    /// Slots in a row in which it kept up, at the pace that it has.
    kept_up: u32,
    /// After so many a faster one is tried: the more, the oftener one was lost by it.
    patience: u32,
}

impl Progress {
    pub fn new(largest_m_s: f64, of_plan: bool) -> Self {
        Self {
            largest_m_s,
            last: None,
            made_m: 0.0,
            span_s: 0.0,
            best_m_s: None,
            pace: None,
            told: false,
            of_plan,
            was_late: false,
            was_waited_for: false,
            kept_up: 0,
            patience: 1,
        }
    }

    /// Takes the position that was measured at `at`, while the vehicle follows `motion`, and is to be `on_air` or not.
    pub fn hear(&mut self, motion: &Motion, position_enu_m: &Enu, at: Instant, on_air: bool) {
        let Some((before, was)) = self.last.replace((at, *position_enu_m)) else { return };
        let off = (motion.sample(at).position_enu_m - position_enu_m).xy();
        let apart_s = at.seconds_since(before);
        let waits = motion.waits() && off.norm() >= WAITS_M[0];
        self.was_waited_for |= waits;
        let is_behind = (off.norm() >= BEHIND_M || waits) && (0.0..HELD_UP.as_secs_f64()).contains(&apart_s);
        if !is_behind {
            return self.keep_up();
        }
        self.was_late |= on_air;
        self.made_m += (position_enu_m - was).xy().dot(&off.normalize());
        self.span_s += apart_s;
        if self.span_s >= SPAN_S {
            let made_m_s = self.made_m / self.span_s;
            self.best_m_s = Some(self.best_m_s.map_or(made_m_s, |best| best.max(made_m_s)));
            self.keep_up();
        }
    }

    /// It is not behind, or not by the wind.
    pub fn keep_up(&mut self) {
        (self.made_m, self.span_s) = (0.0, 0.0);
    }

    /// A slot is over. What the vehicle made, in m/s, where that is less than what is counted on; told once.
    pub fn slot_over(&mut self) -> Option<f64> {
        self.keep_up();
        let made_m_s = self.made_m_s();
        let pace = self.would_be();
        if made_m_s.is_some() {
            (self.kept_up, self.patience) = (0, LONGEST_PATIENCE.min(2 * self.patience));
        } else if pace != self.pace {
            (self.kept_up, self.patience) = (0, 1);
        } else if !self.was_waited_for {
            self.kept_up += 1;
        }
        self.pace = pace;
        (self.best_m_s, self.was_late, self.was_waited_for) = (None, false, false);
        made_m_s.filter(|_| !std::mem::replace(&mut self.told, true))
    }

    /// What it made since the last slot was over, where that is less than what is counted on.
    fn made_m_s(&self) -> Option<f64> {
        let counts = self.was_late || !self.of_plan;
        self.best_m_s.filter(|made| counts && *made < KEEPS_UP * self.largest_m_s)
    }

    /// What is to be counted on once a slot under way is over.
    pub fn would_be(&self) -> Option<Pace> {
        let made = self.made_m_s().and_then(|made_m_s| Pace::of(MARGIN * made_m_s / self.largest_m_s));
        match (made, self.pace) {
            (Some(made), Some(known)) if self.of_plan => Some(made.min(known)),
            (Some(made), _) => Some(made),
            (None, known) if self.of_plan || self.was_waited_for || self.kept_up + 1 < self.patience => known,
            (None, known) => known.and_then(Pace::faster),
        }
    }

    /// What is to be counted on, if that is less than what the mission lets ways count on.
    pub fn pace(&self) -> Option<Pace> {
        self.pace
    }
}

impl Executive {
    /// In a plan that follows, a vehicle that is far behind as a slot is over rests where it is: the next ways begin there, and not where
    /// it would have to fly for long yet.
    pub(super) fn rest_where_it_got(&mut self, now: Instant) {
        let Some((is_at, meant)) = self.follows_at(now) else { return };
        let is_behind = (meant.position_enu_m - is_at).xy().norm() >= BEHIND_M;
        let is_late = self.phase.motion().is_some_and(|motion| !motion.is_over(now));
        let may_be_there = (is_behind || is_late)
            && self.progress.pace().is_some()
            && self.router().is_ok_and(|router| router.holds(&is_at))
            && self.is_clear_of_peer(&is_at).unwrap_or(false);
        if may_be_there {
            self.rest_at(is_at, meant.attitude, now);
        }
    }

    /// In a plan that follows, who is blown off its motion, or its way to a slot, and is about to leave the airspace, leaves it and comes
    /// back inside, level. What goes along a fence runs away from a vehicle that the wind holds back, and what force that has left it
    /// spends to catch up, while it drifts outward; tilted it has the least. Its pose is lost, so that it is silent.
    pub(super) fn keep_inside(&mut self, now: Instant) {
        let Some((is_at, meant)) = self.follows_at(now) else { return };
        let is_lost = (meant.position_enu_m - is_at).norm() >= BLOWN_OFF_M;
        let Some(region) = is_lost.then(|| Region::new(&self.settings.airspace)).flatten() else { return };
        let velocity = self.autopilot.state().velocity_enu_m_s.map(|measured| measured.value.vector());
        let soon = is_at + SOON_S * velocity.unwrap_or_default();
        let out_m = region.nearest_allowed(&soon) - soon;
        if out_m.norm() < OUTSIDE_M {
            return;
        }
        let back = region.nearest_allowed(&(soon + out_m + INSIDE_M * out_m.normalize()));
        if self.is_clear_of_peer(&back).unwrap_or(true) {
            let (_, _, yaw_rad) = meant.attitude.euler();
            self.rest_at(back, Attitude::from_euler(0.0, 0.0, yaw_rad), now);
            self.notice(Notice::BlownOut);
        }
    }

    /// In a plan that follows, in service: where the vehicle is, and how it is meant to be.
    fn follows_at(&self, now: Instant) -> Option<(Enu, Sample)> {
        self.settings.following.as_ref()?;
        let motion = self.phase.motion().filter(|_| self.phase.is_in_service())?;
        let (is_at, at) = self.autopilot.position(now)?;
        Some((is_at, motion.sample(at)))
    }

    /// Whether a place is farther from the other vehicle than both keep from each other; `None`: nobody knows where that is.
    fn is_clear_of_peer(&self, place: &Enu) -> Option<bool> {
        let peer_enu_m = self.service.peer().position_enu_m?;
        Some((peer_enu_m - place).norm() > clearance_m(&self.settings.airspace))
    }

    /// In service, at rest where it is meant to be, whatever way it has come.
    pub(super) fn rest_here(&mut self, now: Instant) {
        let sample =
            self.phase.motion().filter(|_| self.phase.is_in_service()).map(|motion| motion.sample(now));
        if let Some(Sample { position_enu_m, attitude, .. }) = sample {
            self.rest_at(position_enu_m, attitude, now);
        }
    }

    /// In service, at rest there from now on.
    fn rest_at(&mut self, position_enu_m: Enu, attitude: Attitude, now: Instant) {
        let rest = Trajectory::rest(&Start { position_enu_m, attitude });
        self.phase = Phase::InService { motion: Motion::new(rest, now), turns: None };
    }

    /// I: what both vehicles are planned for.
    pub(super) fn agreed_paces(&self) -> PerVehicle<Option<Pace>> {
        let own = self.progress.pace();
        if self.settings.role == Role::I {
            PerVehicle { i: own, j: self.service.peer().pace }
        } else {
            PerVehicle::default()
        }
    }

    /// What ways and motions may ask of both vehicles at these paces.
    pub(super) fn limits_at(&self, paces: &PerVehicle<Option<Pace>>) -> PerVehicle<Limits> {
        PerVehicle::from_fn(|role| {
            let limits = self.settings.limits[role];
            let share = paces[role].map_or(1.0, Pace::share);
            Limits { speed_m_s: share * limits.speed_m_s, ..limits }
        })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// 100 m at 8 m/s at the most, from one second on.
    fn away() -> Motion {
        let start = Start { position_enu_m: Enu::new(0.0, 0.0, 30.0), attitude: Attitude::level() };
        let mut trajectory = Trajectory::rest(&start);
        trajectory.fly(&[Enu::new(60.0, 80.0, 30.0)], &Limits::new(8.0, 3.0, 1.0));
        Motion::new(trajectory, Instant::from_start(Duration::from_secs(1)))
    }

    /// The pace after a slot in which a vehicle goes there at this speed, with positions so many milliseconds apart.
    fn after(progress: &mut Progress, speed_m_s: f64, every_ms: u64) -> (Option<f64>, Option<f64>) {
        let motion = away();
        for at_ms in (0..20_000).step_by(every_ms as usize) {
            let at = Instant::from_start(Duration::from_millis(at_ms));
            let meant = motion.sample(at).position_enu_m;
            let start = motion.sample(Instant::ZERO).position_enu_m;
            let gone_m =
                (speed_m_s * at.seconds_since(motion.starts_at).max(0.0)).min((meant - start).norm());
            progress.hear(&motion, &(start + gone_m * nalgebra::Vector3::new(0.6, 0.8, 0.0)), at, false);
        }
        (progress.slot_over(), progress.pace().map(Pace::share))
    }

    #[test]
    fn val_the_pace_is_what_the_wind_leaves_of_the_speed_and_is_tried_upwards_again() {
        for (speed_m_s, share) in [(2.0, 0.22), (4.0, 0.45), (-1.0, 0.1)] {
            let mut progress = Progress::new(8.0, false);
            let (told, pace) = after(&mut progress, speed_m_s, 20);
            assert!(told.is_some_and(|told| (told - speed_m_s).abs() < 0.1), "{speed_m_s}: {told:?}");
            assert!(pace.is_some_and(|pace| (pace - share).abs() < 0.02), "{speed_m_s}: {pace:?}");
            // It is told once, and measured again.
            assert_eq!(after(&mut progress, 3.0, 20).0, None);
            // Two slots have been lost by then: it is tried after the fourth that is not, and then slot by slot.
            let mut last = progress.pace().map(Pace::share);
            for kept_up in 1..=15 {
                let (told, pace) = after(&mut progress, 20.0, 20);
                let rises = pace.is_none_or(|pace| last.is_some_and(|last| pace > last));
                assert!(told.is_none() && (rises == (kept_up >= 4)), "{kept_up}: {last:?} {pace:?}");
                last = pace;
            }
            assert_eq!(last, None);
        }
    }

    /// Where a plan for another pace is one for all that is left.
    #[test]
    fn spec_a_pace_of_a_plan_is_one_that_was_paid_for_and_no_more_is_tried() {
        let mut progress = Progress::new(8.0, true);
        assert_eq!(after(&mut progress, 2.0, 20), (None, None), "in time for its slot");
        for (speed_m_s, share) in [(4.0, 0.45), (2.0, 0.23), (5.0, 0.23)] {
            progress.was_late = true;
            assert_eq!(after(&mut progress, speed_m_s, 20).1, Some(share), "{speed_m_s}");
        }
        assert_eq!(after(&mut progress, 20.0, 20), (None, Some(0.23)));
    }

    #[test]
    fn spec_who_keeps_up_or_is_not_heard_has_no_pace() {
        for (speed_m_s, every_ms) in [(20.0, 20), (7.6, 20), (2.0, 300)] {
            assert_eq!(
                after(&mut Progress::new(8.0, false), speed_m_s, every_ms),
                (None, None),
                "{speed_m_s}"
            );
        }
    }
}
