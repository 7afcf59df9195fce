//! What an adapter knows of its vehicle, for those who fly it.

use std::time::Duration;

use super::super::control;
use super::super::fence::FenceDuty;
use super::super::firmware::{airframe, fencing, returning, version};
use super::super::preflight::{self, Evidence};
use super::super::settings::Settings;
use super::super::state::VehicleState;
use super::super::streams::Wanted;
use super::Autopilot;
use crate::geo::{Attitude, Enu};
use crate::preflight::Check;
use crate::time::{Instant, Utc};

impl Autopilot {
    /// What is known of the vehicle.
    #[must_use]
    pub fn state(&self) -> &VehicleState {
        &self.telemetry.state
    }

    /// The settings in use.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// When the older of position and attitude was received; `None` while one is unknown or the link is lost. Copies, and
    /// what was overtaken on its way, do not count.
    #[must_use]
    pub fn state_received_at(&self) -> Option<Instant> {
        self.telemetry.state.pose_received_at().filter(|_| !self.link.is_lost())
    }

    /// The instant before which the older of position and attitude was certainly not taken, by the autopilot's clock as it
    /// is tracked; `None` as above, and while that clock is not known.
    #[must_use]
    pub fn state_taken_from(&self, now: Instant) -> Option<Instant> {
        let taken = self.telemetry.state.pose_taken().filter(|_| !self.link.is_lost())?;
        self.telemetry.clock.taken_from(taken, now)
    }

    /// When the autopilot counts as lost, if nothing more is heard of it; `None` while it does.
    #[must_use]
    pub fn lost_at(&self) -> Option<Instant> {
        self.link.timeout()
    }

    /// Time between two messages of position or attitude, whichever is longer, as granted and as they come.
    #[must_use]
    pub fn state_period(&self) -> Duration {
        self.streams.state_period().unwrap_or_else(|| self.settings.period())
    }

    /// The newest attitude, and when it was taken: by the autopilot's clock, laid on ours but for a constant and for drift,
    /// so that the time between two of them is right however they were delayed.
    #[must_use]
    pub fn attitude(&self) -> Option<(Attitude, Instant)> {
        let attitude = self.telemetry.state.attitude?;
        Some((attitude.value, self.telemetry.clock.on_our_clock(attitude.taken)?))
    }

    /// The newest position, in metres, and when it was probably taken.
    #[must_use]
    pub fn position(&self, now: Instant) -> Option<(Enu, Instant)> {
        let position = self.telemetry.state.position_enu_m?;
        Some((position.value, self.telemetry.clock.probably_taken(position.taken, now)?))
    }

    /// Age of the older of position and attitude, at the most; `None` as above.
    #[must_use]
    pub fn state_age(&self, now: Instant) -> Option<Duration> {
        self.state_taken_from(now).map(|taken| now.saturating_since(taken))
    }

    /// Whether position and attitude are known as they were a moment ago, and the link stands.
    #[must_use]
    pub fn fresh(&self, now: Instant) -> bool {
        self.hears_state(now) && self.state_age(now).is_some_and(|age| age <= self.settings.freshness)
    }

    /// Whether position and attitude were received a moment ago, of whenever they are.
    pub(super) fn hears_state(&self, now: Instant) -> bool {
        self.state_received_at().is_some_and(|at| now.saturating_since(at) <= self.settings.freshness)
    }

    /// Whether we took control, armed or not.
    #[must_use]
    pub fn has_control(&self) -> bool {
        self.control.is_held()
    }

    /// Whether we took control and the last heartbeat shows the companion's mode, armed.
    #[must_use]
    pub fn in_control(&self) -> bool {
        self.control.is_held() && control::is_ours(&self.telemetry.state) && !self.stall.is_in_doubt()
    }

    /// Whether the autopilot still has a parameter as only a companion that flies it may leave it. That is put right by
    /// itself once the vehicle is another's and level, or on the ground.
    #[must_use]
    pub fn is_guarding(&self) -> bool {
        self.peer.as_ref().is_some_and(|peer| peer.specifics.is_guarding(&self.parameters))
    }

    /// The charge, of 1, down to which a battery falls that the autopilot simulates, as PX4's does within half a minute whatever
    /// is flown; `None` of a real one.
    #[must_use]
    pub fn simulated_charge_floor(&self) -> Option<f64> {
        self.peer.as_ref()?.specifics.simulated_charge_floor(&self.parameters)
    }

    /// UTC by the autopilot's clock.
    #[must_use]
    pub fn utc(&self, now: Instant) -> Option<Utc> {
        self.telemetry.utc.utc(now)
    }

    /// How far [`Self::utc`] may be off, transport to the autopilot alone considered.
    #[must_use]
    pub fn utc_uncertainty(&self) -> Option<Duration> {
        self.telemetry.utc.uncertainty()
    }

    /// The telemetry that is asked for, once the autopilot is found.
    pub fn wanted(&self) -> impl Iterator<Item = Wanted> {
        self.streams.wanted()
    }

    /// The thrust command that hovers, as learned so far (`thrust_vector`).
    #[must_use]
    pub fn hover_thrust(&self) -> f64 {
        self.stream.hover_thrust()
    }

    /// Everything that speaks for or against a flight, as far as the autopilot is concerned.
    #[must_use]
    pub fn preflight(&self, now: Instant) -> Vec<Check> {
        let Some(peer) = &self.peer else {
            return vec![preflight::none_found(self.discovery.candidates())];
        };
        let mut all = preflight::checks(&Evidence {
            firmware: peer.firmware,
            system: peer.address.0,
            settings: &self.settings,
            state: self.state(),
            streams: &self.streams,
            fresh: self.fresh(now),
            age: self.state_age(now).filter(|_| self.hears_state(now)),
            tracking: self.telemetry.clock.tracking(now),
            utc_uncertainty: self.utc_uncertainty(),
        });
        all.push(if self.chooses_actuation() {
            airframe::check_choice(peer.firmware, peer.chosen.as_ref(), &self.parameters, &self.settings)
        } else {
            preflight::actuation(peer.firmware, &self.settings)
        });
        let version = self.telemetry.state.version;
        all.push(version::check_version(peer.firmware, version));
        all.extend(peer.specifics.checks(&self.parameters, &self.settings, version));
        if let Some(band_m) = self.settings.return_altitude_m {
            let home_m = self.state().home_enu_m.map(|home| home.value.z);
            all.extend(returning::checks(peer.firmware, &self.parameters, home_m, band_m));
        }
        all.extend(self.fence.checks(self.state()));
        if let Some(fence) = self.settings.fence.as_ref().filter(|fence| fence.duty != FenceDuty::None) {
            let home = self.state().home_enu_m.map(|home| home.value);
            all.extend(fencing::checks(peer.firmware, &self.parameters, fence, home));
        }
        all
    }
}
