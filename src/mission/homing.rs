//! The way home: together after the last slot, one after the other after an abort.

use std::time::Duration;

use crate::geo::{Attitude, Enu};
use crate::pair::wire::VeilwingFlags;
use crate::role::{PerVehicle, Role};
use crate::schedule::separation::{clearance_m, polyline_distance_m};
use crate::schedule::trajectory::{Limits, Sample, Start, Trajectory};
use crate::schedule::transit::{Router, TransitError};
use crate::time::Instant;

use super::executive::Executive;
use super::notice::Notice;
use super::phase::{HOLD, Motion, Phase};

/// J lets I land first after an abort, for at most this long while I says that it is on its way.
pub(super) const LAND_FIRST: Duration = Duration::from_secs(120);
/// Where I is not heard, J gives it the time of its way home and this much more.
const LAND_UNHEARD: Duration = Duration::from_secs(5);
/// A way begins where a vehicle is commanded to be, within so many metres.
const BEGINS_WITHIN_M: f64 = 0.1;
/// And the other keeps to one of its own within so many: what it is waited for, and its position's error.
const PEER_KEEPS_WITHIN_M: f64 = 3.0;
/// How far a vehicle that climbs or lands may be off the vertical above its home, in metres.
const OWN_COLUMN_M: f64 = 2.0;
/// What two ways home have between them, over the ground, where they are flown at once and nobody agreed on them: so many clearances ...
const APART: f64 = 2.0;
/// ... if I's is no longer than straight home by so many metres: another it may be on already.
const STRAIGHT_M: f64 = 0.1;

impl Executive {
    /// All slots are over: both go home along the table's last transit, or, where their ways would only be apart in
    /// time or begin elsewhere, one after the other as after an abort, unless their ways from there are far apart.
    pub(super) fn finish(&mut self, now: Instant) {
        self.notice(Notice::AllSlotsOver);
        let role = self.settings.role;
        let ways = self.itinerary.as_ref().and_then(|itinerary| itinerary.ways_home.clone());
        let at_once = |ways: &PerVehicle<Trajectory>| {
            self.begins_here(&ways[role], now) && self.peer_keeps_to(&ways[role.peer()])
        };
        match ways.filter(at_once) {
            Some(ways) => self.phase = Phase::Returning(Motion::new(ways[role].clone(), now)),
            None => self.hold_here(now),
        }
    }

    /// Whether the vehicle is where a way begins: one whose last slot ended early has left its motion elsewhere.
    pub(super) fn begins_here(&self, way: &Trajectory, now: Instant) -> bool {
        let here = self.phase.motion().map(|motion| motion.sample(now).position_enu_m);
        here.is_some_and(|here| (here - way.sample(Duration::ZERO).position_enu_m).norm() <= BEGINS_WITHIN_M)
    }

    /// Whether the other vehicle, by its own word, is on this way of its, or where it begins: one that was late for its last slot is
    /// not.
    fn peer_keeps_to(&self, way: &Trajectory) -> bool {
        let peer = self.service.peer().position_enu_m;
        peer.is_some_and(|at| polyline_distance_m(&way.path(), &[at]) <= PEER_KEEPS_WITHIN_M)
    }

    /// After an abort the two must not cross. I goes home first; J when I is down, or is not coming, or took too
    /// long, or J's battery does not bear the wait: its way keeps clear of I's. If nothing is heard of I, its companion may
    /// still be flying it home by the same rule, though it lost us later: J gives it time.
    pub(super) fn may_return(&mut self, waited: Duration, now: Instant) -> bool {
        if self.settings.role == Role::I || waited > LAND_FIRST {
            return true;
        }
        if self.endurance.is_due(now) && !self.may_wait(now) {
            return true;
        }
        let (peer, settings) = (self.service.peer(), &self.settings.pair);
        if peer.heard_within(settings.peer_timeout, now) {
            return peer.says(VeilwingFlags::VEILWING_FLAGS_LANDED)
                || !peer.says(VeilwingFlags::VEILWING_FLAGS_RETURNING)
                || (self.abort_cause.is_none() && self.ways_are_far_apart(now).unwrap_or(false));
        }
        let way = peer.position_enu_m.and_then(|at| self.way_home(Role::I, at, Attitude::level()));
        let later = settings.lost_after.saturating_sub(settings.peer_timeout);
        waited > HOLD + later + LAND_UNHEARD + way.unwrap_or(LAND_FIRST)
    }

    /// J: whether both ways home are so far apart over the ground, of I from wherever it comes to rest or already is on its way, that it
    /// does not matter when they are flown, nor at which height; `None` where one is not known. Whoever lands where it is does so
    /// on its way.
    fn ways_are_far_apart(&self, now: Instant) -> Option<bool> {
        let router = self.router().ok()?;
        let ground =
            |way: &Trajectory| way.path().iter().map(|p| Enu::new(p.x, p.y, 0.0)).collect::<Vec<_>>();
        let (at, home) = (self.service.peer().position_enu_m?, self.home_of(Role::I)?);
        let start = Start { position_enu_m: at, attitude: Attitude::level() };
        let of_i = ground(&router.alone(Role::I, &start, &home, &[]).ok()?);
        let length_m: f64 = of_i.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum();
        if length_m > (home - at).xy().norm() + STRAIGHT_M {
            return Some(false);
        }
        let Sample { position_enu_m, attitude, .. } = self.phase.motion()?.sample(now);
        let start = Start { position_enu_m, attitude };
        let own = ground(&self.own_way(&router, &start, &self.home_enu_m?).ok()?);
        let between_m =
            APART * clearance_m(&self.settings.airspace) + stops_within_m(&self.settings.limits[Role::I]);
        Some(polyline_distance_m(&own, &of_i) >= between_m)
    }

    pub(super) fn router(&self) -> Result<Router, TransitError> {
        Router::new(&self.settings.airspace, &self.settings.limits)
    }

    /// A vehicle's home, as far as it is known.
    pub(super) fn home_of(&self, role: Role) -> Option<Enu> {
        if role == self.settings.role { self.home_enu_m } else { self.service.peer().home_enu_m }
    }

    /// How long a vehicle's way from there to above its home is, whatever the other does.
    pub(super) fn way_home(&self, role: Role, at: Enu, attitude: Attitude) -> Option<Duration> {
        let start = Start { position_enu_m: at, attitude };
        let way = self.router().ok()?.alone(role, &start, &self.home_of(role)?, &[]).ok()?;
        Some(way.duration())
    }

    /// Where the other vehicle may be while we fly home: where it was last seen, and above and at its home.
    fn keep_out(&self) -> Vec<Enu> {
        let peer = self.service.peer();
        match (self.settings.role, peer.position_enu_m, peer.home_enu_m) {
            (Role::J, Some(at), Some(home)) => vec![at, self.settings.above(home), home],
            (_, at, _) => at.into_iter().collect(),
        }
    }

    /// A way home that keeps clear of wherever the peer may be; failing that, of where it was last seen.
    fn own_way(&self, router: &Router, start: &Start, home: &Enu) -> Result<Trajectory, TransitError> {
        let role = self.settings.role;
        let near = self.service.peer().position_enu_m;
        router
            .alone(role, start, home, &self.keep_out())
            .or_else(|_| router.alone(role, start, home, near.as_slice()))
    }

    /// Whether a vehicle at `at` has not climbed into the altitude band yet, or has left it to land: what is below it is its
    /// own home, and no route through the airspace begins there.
    pub(super) fn is_in_own_column(&self, at: Enu, home: Enu) -> bool {
        at.z < self.settings.above(home).z && (at - home).xy().norm() <= OWN_COLUMN_M
    }

    pub(super) fn go_home(&mut self, now: Instant) {
        let (Some(home), Some(start)) = (self.home_enu_m, self.phase.motion().map(|m| m.sample(now))) else {
            return;
        };
        if self.is_in_own_column(start.position_enu_m, home) {
            self.notice(Notice::LandingBelowBand);
            return self.land(now);
        }
        let start = Start { position_enu_m: start.position_enu_m, attitude: start.attitude };
        match self.router().and_then(|router| self.own_way(&router, &start, &home)) {
            Ok(trajectory) => {
                self.notice(Notice::ReturningHome);
                self.phase = Phase::Returning(Motion::new(trajectory, now));
            }
            Err(error) => {
                self.notice(Notice::NoWayHome(error));
                self.land(now);
            }
        }
    }
}

/// How far a vehicle goes on that stops from its largest speed, in metres: `v^2 / 2a`, and `v a / 2j` until it brakes as hard as that.
fn stops_within_m(limits: &Limits) -> f64 {
    let Limits { speed_m_s, acceleration_m_s2, jerk_m_s3, .. } = *limits;
    let brakes_s = speed_m_s / acceleration_m_s2 + jerk_m_s3.map_or(0.0, |jerk| acceleration_m_s2 / jerk);
    0.5 * speed_m_s * brakes_s
}
