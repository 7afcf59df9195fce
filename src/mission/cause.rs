//! Why a mission was given up.

use std::time::Duration;

use crate::autopilot::EstimatorFault;
use crate::pair::orders::START_EXPIRES;
use crate::role::Role;
use crate::service::{GiveUp, Silence};

use super::refusal::Refusal;
use super::words;

/// The first of what ended a mission before its time.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr, strum::VariantNames)]
pub enum Cause {
    /// The autopilot left the companion's mode, and not by the companion's hand (F2).
    #[error("the autopilot went to {0} by another hand")]
    ControlLost(String),
    /// The autopilot's messages stopped: which, and for how long.
    #[error("{missing} from the autopilot for {:.1} s", silent_for.as_secs_f64())]
    AutopilotLost {
        /// What did not come.
        missing: &'static str,
        /// For how long.
        silent_for: Duration,
    },
    /// The autopilot restarted in flight.
    #[error("the autopilot restarted")]
    AutopilotRestarted,
    /// The autopilot disarmed in flight.
    #[error("the autopilot disarmed")]
    Disarmed,
    /// The autopilot refused to give control or to arm.
    #[error("{0}")]
    Refused(Refusal),
    /// The disk has not taken the record that the mission has begun.
    #[error("the disk has not taken the record of the start in {} s", START_EXPIRES.as_secs())]
    NotRecorded,
    /// The position estimate.
    #[error("estimator: {0}")]
    Estimator(EstimatorFault),
    /// ArduPilot's bridge script is gone: nobody follows the planned attitudes.
    #[error("the bridge script is gone: no answer of its own for {:.1} s", .0.as_secs_f64())]
    BridgeDead(Duration),
    /// The other vehicle, or its companion.
    #[error("{}", words::give_up(.0, .1))]
    Peer(Role, GiveUp),
    /// On a transit in turns the other is not where it should rest.
    #[error("vehicle {0} is not where it should be for its turn to pass")]
    OutOfTurn(Role),
    /// A slot in which this vehicle did not radiate, with the last reason found.
    #[error("slot {slot} was not served{}", words::because(silence))]
    NotServed {
        /// Its number over superframes.
        slot: u16,
        /// The last reason found within its airtime.
        silence: Option<Silence>,
    },
    /// The battery has no more than the way home and its reserve.
    #[error(
        "the battery: {charge_percent:.0}% are left, {:.1} min down to the reserve of {reserve_percent:.0}%, and {} takes {:.1}",
        left.as_secs_f64() / 60.0, words::way_home(*before), needed.as_secs_f64() / 60.0
    )]
    Battery {
        /// The charge that is left.
        charge_percent: f64,
        /// The charge to land with.
        reserve_percent: f64,
        /// Until no more than that is left.
        left: Duration,
        /// What is to be flown.
        needed: Duration,
        /// The slot that does not fit any more; `None`: the way home alone.
        before: Option<u16>,
    },
    /// A climb or a return that did not end where it should.
    #[error("{0} did not end where it should")]
    Astray(&'static str),
    /// By the operator.
    #[error("the operator ordered the return")]
    ReturnOrdered,
    /// By the operator.
    #[error("radio kill by the operator")]
    Killed,
    /// The other vehicle does not begin with us.
    #[error("vehicle {0} does not stand by the start any more")]
    StartWithdrawn(Role),
}
