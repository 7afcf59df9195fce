//! What the vehicle says of itself.

use std::time::Duration;

use crate::geo::{Attitude, Enu};
use crate::pair::{MeasuredJitter, Pace, Rest};
use crate::time::Instant;

/// What is known of the own vehicle at one instant.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Vehicle {
    /// When the older of position and attitude was received last; `None` without either.
    pub state_received_at: Option<Instant>,
    /// The instant before which the older of them was certainly not taken; `None` while that is not known.
    pub state_taken_from: Option<Instant>,
    /// How long it may go on without a new one: the period at which both come.
    pub state_period: Duration,
    /// Position, east-north-up about the mission's origin, and when it was measured.
    pub position: Option<(Enu, Instant)>,
    /// Attitude, and when it was measured.
    pub attitude: Option<(Attitude, Instant)>,
    /// So long before it is due its attitude is commanded, as late as it follows.
    pub turns_ahead: Duration,
    /// Armed and in the companion's mode.
    pub in_control: bool,
    /// When its autopilot counts as lost, and control ends, if it goes on being unheard; `None`: not foreseen.
    pub lost_at: Option<Instant>,
    /// The autopilot has nothing to say against its own estimate.
    pub estimator_ok: bool,
    /// No transit is under way: the one to the slot's pose, or to the last slot's, is flown to its end.
    pub arrived: bool,
    /// It rests, by its setpoints.
    pub at_rest: bool,
    /// The slot whose motion it enters from where it rests.
    pub rests_for: Option<u16>,
    /// Where it rests, between slots whose poses are made anew.
    pub rests: Option<Rest>,
    /// Its jitter in the last slot, where that is another than the mission says.
    pub jitter: Option<MeasuredJitter>,
    /// What it makes in this wind, where that is less than the mission says.
    pub pace: Option<Pace>,
    /// Where it took off, or stands.
    pub home_enu_m: Option<Enu>,
    /// No preflight check fails.
    pub preflight_ok: bool,
    /// The mission is over for this vehicle, well or badly.
    pub ended: bool,
    /// Going home under the companion's control, or about to.
    pub returning: bool,
    /// On the ground.
    pub landed: bool,
    /// Its autopilot's land detector is held off.
    pub guarding: bool,
}
