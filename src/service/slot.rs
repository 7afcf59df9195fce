//! A committed slot: its times on our monotonic clock, our power and pose in it.

use std::sync::Arc;
use std::time::Duration;

use crate::pair::adoption::LATE;
use crate::pair::{Commitment, SlotTerms};
use crate::planner::following::Motion;
use crate::planner::track::Track;
use crate::role::Role;
use crate::time::Instant;
use crate::transmitter::{NotReady, Trouble};

use super::interlock::{Silence, Window};
use super::pose_monitor::{PoseMonitor, Reference, Tolerance};
use super::protection::{Jamming, Protection};

/// See the module.
#[derive(Debug, Clone)]
pub struct Slot {
    /// What was agreed on.
    pub commitment: Commitment,
    power_w: f64,
    /// How this vehicle turns in it, where it is served through its turns.
    pub track: Option<Track>,
    /// The same once it takes up the motion that is made last, and when that begins.
    foreseen: Option<(Track, Instant)>,
    /// It carries on the slot before, by the clock.
    pub carried_on: bool,
    /// I may radiate from here ...
    pub radiate_from: Instant,
    /// ... to here; J from the opening, or from when it is turned, until I is off, at most to the close.
    pub radiate_until: Instant,
    /// From when to when the vehicle is turned as serving the user asks for.
    in_place: [Instant; 2],
    /// The slot's end.
    pub closes_at: Instant,
    /// To be ended early, in order: I is off at once, J vouches no more and is off once I is.
    pub(super) closing: bool,
    pub(super) monitor: PoseMonitor,
    pub(super) protection: Protection,
    pub(super) jamming: Jamming,
    pub(super) served: Served,
    /// Its radio was at the slot's power, as it answered.
    pub(super) achieved: bool,
    /// What was wrong with the radio's device while it was to radiate, last.
    pub(super) trouble: Option<Trouble>,
}

/// Whether this vehicle's transmitter was on in a slot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Served {
    /// It was.
    Yes,
    /// It was not: the last reason that was found within the slot's airtime, if that ever began.
    No(Option<Silence>),
}

impl Slot {
    /// The slot agreed on, by the plan's terms; or one that carries on the one before, and is agreed on with that. Its clock may be so
    /// far from the one by which it is agreed on.
    pub(super) fn new(
        role: Role,
        commitment: Commitment,
        carried_on: bool,
        terms: &SlotTerms,
        (tolerance, apart): (Tolerance, Duration),
    ) -> Self {
        let vehicle = terms.vehicles[role];
        let tolerance = terms.jitter.map_or(tolerance, |jitter| tolerance.jittering(jitter.std_rad()));
        let track = terms.tracks.as_ref().map(|tracks| tracks[role].clone());
        let track = if carried_on { track } else { track.map(Track::from_rest) };
        let opens_at = commitment.opens_at;
        let closes_at = opens_at + terms.length;
        let turned = track.as_ref().map_or([None; 2], Track::in_place);
        let turned = turned.map(|since_s| since_s.map(|since_s| opens_at.after_s(since_s)));
        let in_place = [
            turned[0].map_or(opens_at, |at| at.max(opens_at)),
            turned[1].map_or(closes_at, |at| at.min(closes_at)),
        ];
        let reference = Reference {
            pose: vehicle.pose,
            track: track.clone(),
            opens_at,
            apart,
            in_place_from: in_place[0],
        };
        Self {
            commitment,
            power_w: vehicle.tx_power_w,
            track,
            foreseen: None,
            carried_on,
            radiate_from: commitment.opens_at + terms.radiate_from,
            radiate_until: commitment.opens_at + terms.radiate_until,
            in_place,
            closes_at,
            closing: false,
            monitor: PoseMonitor::new(reference, tolerance.leaning(terms.lean_rad[role])),
            protection: Protection::default(),
            jamming: Jamming::Unconfirmed,
            served: Served::No(None),
            achieved: false,
            trouble: None,
        }
    }

    /// A motion is flown from its beginning on.
    pub(super) fn take_up(&mut self, motion: &Arc<Motion>) {
        if let Some(Track::Followed(track)) = &mut self.track {
            track.take_up(Arc::clone(motion));
            self.foreseen = None;
            self.monitor.follow(self.track.clone());
        }
    }

    /// I may take this motion up at any time.
    pub(super) fn foresee(&mut self, motion: &Arc<Motion>) {
        if let Some(Track::Followed(track)) = &self.track {
            let begins_at = self.commitment.opens_at.after_s(motion.begins_s());
            let mut track = track.clone();
            track.take_up(Arc::clone(motion));
            self.foreseen = Some((Track::Followed(track), begins_at));
        }
    }

    /// From when on the motion taken up last asks J for more power than what it goes on from, if it does.
    pub(super) fn outgrown_at(&self) -> Option<Instant> {
        let outgrown_s = self.track.as_ref().and_then(Track::followed)?.outgrown_s()?;
        Some(self.commitment.opens_at.after_s(outgrown_s))
    }

    /// Whether it is being ended early.
    #[must_use]
    pub fn is_closing(&self) -> bool {
        self.closing
    }

    /// The plan's power in watts.
    #[must_use]
    pub fn power_w(&self, now: Instant) -> f64 {
        let since_opening_s = now.seconds_since(self.commitment.opens_at);
        self.track.as_ref().map_or(self.power_w, |track| track.tx_power_w(since_opening_s))
    }

    /// J: up to when I may rest on this much power, if it may: not beyond where the plan asks for more, nor on a vehicle that turns
    /// away, nor on one that is left behind if it is told nothing more, and is told its attitude so much `ahead`. Nor where a motion does
    /// that I may take up.
    pub(super) fn suffices_until(&self, power_w: f64, ahead: Duration, now: Instant) -> Option<Instant> {
        let opens_at = self.commitment.opens_at;
        let (since_s, left) = (now.seconds_since(opens_at), self.monitor.left());
        let outgrows = |track: &Track| {
            let behind_s = left.and_then(|left| track.leaves_behind(since_s, ahead.as_secs_f64(), left));
            let until_s = [track.outgrows(power_w, since_s), behind_s].into_iter().flatten().reduce(f64::min);
            until_s.map(|until_s| opens_at.after_s(until_s))
        };
        let more_at = match &self.track {
            Some(track) => outgrows(track),
            None => (power_w < self.power_w).then_some(now),
        };
        let foreseen = self.foreseen.as_ref().filter(|(_, begins_at)| now <= *begins_at + LATE);
        let foreseen = foreseen.and_then(|(track, _)| outgrows(track));
        let until = [more_at, foreseen].into_iter().flatten().fold(self.in_place[1], Instant::min);
        Some(until).filter(|until| now < *until)
    }

    /// Whether this vehicle's transmitter was on, as far as is known: a permit is nothing where the radio's device never did it.
    pub(super) fn outcome(&self) -> Served {
        match (self.served, self.trouble) {
            (Served::Yes, Some(trouble)) if !self.achieved => {
                Served::No(Some(Silence::Transmitter(NotReady::Trouble(trouble))))
            }
            (served, _) => served,
        }
    }

    /// Whether the next slot to be agreed on is this one again: it was carried on to, and ended before this vehicle was on the air
    /// in it. The other one may not have begun it at all.
    pub(super) fn is_to_be_repeated(&self, now: Instant) -> bool {
        self.carried_on && now < self.closes_at && matches!(self.served, Served::No(_))
    }

    /// When `role` may radiate. `leases_outstanding`: I may hold a lease of J.
    pub(super) fn window(&self, role: Role, leases_outstanding: bool, now: Instant) -> Window {
        let (from, until) = match role {
            Role::I if self.closing => (self.radiate_from, now),
            Role::I => (self.radiate_from, self.radiate_until),
            // Once I has said that it is off and holds nothing, J has no more to protect.
            Role::J if (self.closing || now >= self.radiate_until) && !leases_outstanding => {
                (self.in_place[0], now)
            }
            Role::J => (self.in_place[0], self.closes_at),
        };
        Window { slot: self.commitment.slot, from, until, power_w: self.power_w(now) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Enu, Pose};
    use crate::planner::following::{Flying, Scene, plan};
    use crate::planner::moving::Limits;
    use crate::planner::plan::VehiclePlan;
    use crate::planner::problem::Problem;
    use crate::planner::track::Followed;
    use crate::planner::{Options, plan_slot};
    use crate::role::PerVehicle;
    use crate::time::Utc;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    /// From 10 to 20 s, half a second of guard at each end.
    fn slot(role: Role) -> Slot {
        let pose = Pose { position_enu_m: Enu::zeros(), roll_rad: 0.0, pitch_rad: 0.0, yaw_rad: 0.0 };
        let vehicle = VehiclePlan { pose, tx_power_w: 0.5 };
        slot_with(role, PerVehicle { i: vehicle, j: vehicle }, None)
    }

    fn slot_with(role: Role, vehicles: PerVehicle<VehiclePlan>, tracks: Option<PerVehicle<Track>>) -> Slot {
        let terms = SlotTerms {
            anew: None,
            vehicles,
            tracks,
            lean_rad: PerVehicle { i: 0.0, j: 0.0 },
            jitter: None,
            opens: Duration::ZERO,
            lead: Duration::ZERO,
            carries_on_after: None,
            radiate_from: Duration::from_millis(500),
            radiate_until: Duration::from_millis(9500),
            length: Duration::from_secs(10),
        };
        let opens_at = at(10_000);
        let commitment =
            Commitment { proposal: 1, slot: 3, opens_at, opens: Utc::default(), leaves_at: opens_at };
        Slot::new(role, commitment, false, &terms, (Tolerance::for_jitter(0.0), Duration::ZERO))
    }

    #[test]
    fn spec_i_radiates_within_the_guard_and_j_around_it_while_i_may() {
        for (role, closing, leases_outstanding, now_ms, from_ms, until_ms) in [
            (Role::I, false, false, 12_000, 10_500, 19_500),
            (Role::I, true, false, 12_000, 10_500, 12_000),
            (Role::J, false, false, 12_000, 10_000, 20_000),
            (Role::J, true, true, 12_000, 10_000, 20_000),
            (Role::J, true, false, 12_000, 10_000, 12_000),
            (Role::J, false, false, 19_499, 10_000, 20_000),
            (Role::J, false, false, 19_500, 10_000, 19_500),
            (Role::J, false, true, 19_500, 10_000, 20_000),
        ] {
            let slot = Slot { closing, ..slot(role) };
            let window = slot.window(role, leases_outstanding, at(now_ms));
            let expected = Window { slot: 3, from: at(from_ms), until: at(until_ms), power_w: 0.5 };
            assert_eq!(window, expected, "{role:?}, closing {closing}, leases {leases_outstanding}");
        }
    }

    #[test]
    fn spec_a_slot_is_repeated_that_was_carried_on_to_and_ended_before_its_close_with_nothing_served() {
        let again = |carried_on, served, now_ms| {
            Slot { carried_on, served, ..slot(Role::I) }.is_to_be_repeated(at(now_ms))
        };
        assert!(again(true, Served::No(None), 19_999));
        assert!(!again(false, Served::No(None), 19_999));
        assert!(!again(true, Served::No(None), 20_000));
        assert!(!again(true, Served::Yes, 19_999));
    }

    #[test]
    fn spec_a_jammer_suffices_with_its_power_alone_and_to_the_close() {
        let slot = slot(Role::J);
        for (power_w, now_ms, until_ms) in [
            (0.5, 12_000, Some(20_000)),
            (0.6, 19_999, Some(20_000)),
            (0.6, 20_000, None),
            (0.499, 12_000, None),
        ] {
            assert_eq!(
                slot.suffices_until(power_w, Duration::ZERO, at(now_ms)),
                until_ms.map(at),
                "{power_w} {now_ms}"
            );
        }
    }

    /// From a rest in which J hardly jams, to where it does.
    #[test]
    fn spec_what_j_vouches_for_holds_in_a_motion_that_i_may_take_up_too() {
        let problem = Problem::paper([[200.0, 80.0], [-150.0, 210.0]], 0.5, 0.03);
        let mut rest =
            plan_slot(&problem, &Options { starts: Some(8), ..Options::default() }).unwrap().vehicles;
        let most_w = rest.j.tx_power_w;
        rest.j.tx_power_w = 0.01 * most_w;
        let limits = Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };
        let scene = Scene {
            problem: &problem,
            user: None,
            eavesdroppers: vec![],
            limits: PerVehicle { i: limits, j: limits },
            turn_rate_rad_s: PerVehicle { i: 0.8, j: 0.8 },
            apart_m: 7.0,
        };
        let motion = Arc::new(plan(&scene, &Flying::rest(&rest), 2.0, 1).unwrap().unwrap());
        let tracks = PerVehicle::from_fn(|role| Track::Followed(Followed::new(role, rest[role])));
        let mut slot = slot_with(Role::J, rest, Some(tracks));
        let (power_w, begins_at) = (1.5 * rest.j.tx_power_w, at(12_000));
        assert_eq!(slot.suffices_until(power_w, Duration::ZERO, at(11_000)), Some(at(20_000)));
        slot.foresee(&motion);
        let outgrown_at = slot.suffices_until(power_w, Duration::ZERO, at(11_000)).unwrap();
        assert!(outgrown_at.seconds_since(begins_at).abs() < 1.0, "{outgrown_at:?}");
        assert_eq!(slot.suffices_until(power_w, Duration::ZERO, outgrown_at), None);
        assert_eq!(
            slot.suffices_until(power_w, Duration::ZERO, begins_at + 2 * LATE),
            Some(at(20_000)),
            "it never will"
        );
        assert_eq!(slot.outgrown_at(), None, "nor has it");
        slot.take_up(&motion);
        assert_eq!(slot.suffices_until(power_w, Duration::ZERO, at(11_000)), Some(outgrown_at));
        assert_eq!(slot.outgrown_at(), Some(begins_at));
    }

    #[test]
    fn spec_a_permit_that_the_device_never_carried_out_is_no_service() {
        let trouble = Trouble::DeviceLate;
        let of_device = Served::No(Some(Silence::Transmitter(NotReady::Trouble(trouble))));
        for (served, trouble, achieved, outcome) in [
            (Served::Yes, None, false, Served::Yes),
            (Served::Yes, Some(trouble), true, Served::Yes),
            (Served::Yes, Some(trouble), false, of_device),
            (Served::No(Some(Silence::Pose)), Some(trouble), false, Served::No(Some(Silence::Pose))),
        ] {
            assert_eq!(Slot { served, trouble, achieved, ..slot(Role::I) }.outcome(), outcome);
        }
    }
}
