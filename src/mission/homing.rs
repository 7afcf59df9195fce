//! The way home: together after the last slot, one after the other after an abort.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use crate::geo::{Attitude, Enu};
use crate::pair::wire::VeilwingFlags;
use crate::role::Role;
use crate::schedule::trajectory::Start;
use crate::schedule::transit::{Router, TransitError};
use crate::time::Instant;

use super::executive::{Executive, Motion};
use super::flight::Phase;

/// An abort begins with a hold, long enough for the peer's word to come through.
pub(super) const HOLD: Duration = Duration::from_secs(3);
/// J lets I land first after an abort, for at most this long while I says that it is on its way.
const LAND_FIRST: Duration = Duration::from_secs(120);
/// Where I is not heard, J gives it the time of its way home and this much more.
const LAND_UNHEARD: Duration = Duration::from_secs(5);

impl Executive {
    /// All slots are over: both go home along the table's last transit, or, where their ways would only be apart in
    /// time, one after the other as after an abort.
    pub(super) fn finish(&mut self, now: Instant) {
        self.notice(MavSeverity::MAV_SEVERITY_INFO, "all slots are over, returning".into());
        match self.home_trajectory.clone() {
            Some(trajectory) => {
                self.motion = Some(Motion { trajectory, starts_at: now });
                self.enter(Phase::Returning, now);
            }
            None => {
                self.hold_here(now);
                self.enter(Phase::Holding { until: now + HOLD }, now);
            }
        }
    }

    /// After an abort the two must not cross. I goes home first; J when I is down, or is not coming, or took too
    /// long. If nothing is heard of I, its companion may still be flying it home by the same rule: J gives it time.
    pub(super) fn may_return(&self, now: Instant) -> bool {
        let peer = self.pair.peer();
        let waited = now.saturating_since(self.phase_since);
        if self.settings.role == Role::I || waited > LAND_FIRST {
            return true;
        }
        if peer.heard_within(self.settings.pair.peer_timeout, now) {
            return peer.says(VeilwingFlags::VEILWING_FLAGS_LANDED)
                || !peer.says(VeilwingFlags::VEILWING_FLAGS_RETURNING);
        }
        let way = self.router().ok().zip(peer.position_enu_m).zip(peer.home_enu_m).and_then(
            |((router, at), home)| {
                let start = Start { position_enu_m: at, attitude: Attitude::level() };
                router.alone(Role::I, &start, &home, &[]).ok()
            },
        );
        waited > HOLD + LAND_UNHEARD + way.map_or(LAND_FIRST, |way| way.duration())
    }

    fn router(&self) -> Result<Router, TransitError> {
        Router::new(&self.settings.airspace, &self.settings.limits)
    }

    /// Where the other vehicle may be while we fly home: where it was last seen, and above and at its home.
    fn keep_out(&self) -> Vec<Enu> {
        let peer = self.pair.peer();
        match (self.settings.role, peer.position_enu_m, peer.home_enu_m) {
            (Role::J, Some(at), Some(home)) => vec![at, self.above(home), home],
            (_, at, _) => at.into_iter().collect(),
        }
    }

    pub(super) fn go_home(&mut self, now: Instant) {
        let (Some(home), Some(start)) = (self.home_enu_m, self.motion.as_ref().map(|m| m.sample(now))) else {
            return;
        };
        let start = Start { position_enu_m: start.position_enu_m, attitude: start.attitude };
        let way = self.router().and_then(|router| {
            // A way that keeps clear of wherever the peer may be; failing that, of where it was last seen.
            let role = self.settings.role;
            let near = self.pair.peer().position_enu_m;
            router
                .alone(role, &start, &home, &self.keep_out())
                .or_else(|_| router.alone(role, &start, &home, near.as_slice()))
        });
        match way {
            Ok(trajectory) => {
                self.motion = Some(Motion { trajectory, starts_at: now });
                self.notice(MavSeverity::MAV_SEVERITY_INFO, "returning home".into());
                self.enter(Phase::Returning, now);
            }
            Err(error) => {
                self.notice(MavSeverity::MAV_SEVERITY_ERROR, format!("no way home, landing here: {error}"));
                self.motion = None;
                self.autopilot.land(now);
                self.enter(Phase::Landing, now);
            }
        }
    }
}
