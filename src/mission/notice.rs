//! What the operator is told: kinds and numbers, and the one place where they become words.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use crate::autopilot::{EstimatorFault, Firmware};
use crate::pair::orders::START_EXPIRES;
use crate::pair::wire::{VeilwingAnswer, VeilwingSilence};
use crate::role::{PerVehicle, Role};
use crate::schedule::transit::TransitError;
use crate::service::{GiveUp, Jamming, Silence};
use crate::transmitter::{NotReady, Trouble};
use crate::units::Watts;

use super::cause::Cause;
use super::refusal::{ParameterRefusal, Refusal};
use super::words;

/// A line for the operator: goes out as STATUSTEXT and into the log. Its `Display` is the text, in plain words with the
/// number that matters.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr, strum::VariantNames)]
pub enum Notice {
    /// A plan is there, of so many slots.
    #[error("planned {0} slots")]
    Planned(usize),
    /// How far this vehicle may lean in each slot, by the plan.
    #[error("may lean in the wind: {0}")]
    MayLean(String),
    /// The autopilot is there.
    #[error("autopilot found: system {system}, {firmware:?}")]
    AutopilotFound {
        /// Its MAVLink system.
        system: u8,
        /// What it runs.
        firmware: Firmware,
    },
    /// The autopilot does not yet do what it was asked for.
    #[error("waiting for the autopilot to {what}: {why} ({:.0} s)", waited.as_secs_f64())]
    AutopilotNotReady {
        /// What it was asked for.
        what: &'static str,
        /// Its own words, or its answer.
        why: String,
        /// Since when.
        waited: Duration,
    },
    /// The autopilot does not do what it was asked for.
    #[error("{0}")]
    AutopilotRefused(Refusal),
    /// The estimate is not to be trusted; nothing follows in this phase.
    #[error("estimator: {0}")]
    Estimator(EstimatorFault),
    /// ArduPilot's bridge script is gone; nothing follows in this phase.
    #[error("the bridge script is gone: no answer of its own for {:.1} s", .0.as_secs_f64())]
    BridgeDead(Duration),
    /// What is missing before take-off. `failed`: a preflight check is among it.
    #[error("waiting: {text}")]
    Waiting {
        /// All of it, in words.
        text: String,
        /// Told again, since a check goes on failing.
        again: bool,
    },
    /// A preflight check warns.
    #[error("preflight warning: {0}")]
    PreflightWarning(String),
    /// What the mission says of its permission to radiate, at each take-off.
    #[error("emission: {0}")]
    Emission(String),
    /// Nothing is missing.
    #[error("preflight passed, taking off")]
    TakingOff,
    /// The climb is over.
    #[error("airborne, ready for slots")]
    Airborne,
    /// A slot is agreed with the peer.
    #[error("slot {slot} for {user}: agreed, opens in {:.1} s", opens_in.as_secs_f64())]
    SlotAgreed {
        /// Its number over superframes.
        slot: u16,
        /// The user it is for.
        user: String,
        /// From now to its opening.
        opens_in: Duration,
    },
    /// The transmitter may radiate from now on.
    #[error("slot {0}: on, {1}")]
    On(u16, Watts),
    /// The transmitter was told to be silent, out of turn.
    #[error("silent: {0}")]
    Silent(Silence),
    /// A slot's time is over, in which this vehicle radiated.
    #[error("slot {0} for {1}: over")]
    SlotOver(u16, String),
    /// The attitude jitters by more than the plan counts on, or by much less; told once.
    #[error(
        "attitude jitters by {:.2} deg, the mission says {:.2}: set [jitter] std_deg so",
        measured_rad.to_degrees(),
        stated_rad.to_degrees()
    )]
    Jitter {
        /// Per axis, over a slot, radians.
        measured_rad: f64,
        /// What the mission states, radians.
        stated_rad: f64,
    },
    /// Against this wind the vehicle is slower than ways count on; told once.
    #[error(
        "makes {made_m_s:.1} m/s in this wind, ways count on {counted_on_m_s:.1}: slots begin late, or are lost"
    )]
    Slow {
        /// Towards where it should be, at best, m/s.
        made_m_s: f64,
        /// The mission's largest speed, m/s.
        counted_on_m_s: f64,
    },
    /// A new plan is flown from this slot on.
    #[error(
        "planned anew from slot {slot} on: jitter {:.2} deg, I at {:.0}% of its speed, J at {:.0}%",
        jitter_rad.to_degrees(), 100.0 * shares.i, 100.0 * shares.j
    )]
    Replanned {
        /// The first slot that is flown by it.
        slot: u16,
        /// The jitter that it is made for, per axis in radians.
        jitter_rad: f64,
        /// What it counts on of each vehicle's largest speed.
        shares: PerVehicle<f64>,
    },
    /// There is no plan for what was measured.
    #[error("no plan is found for what was measured: the one that is flown goes on")]
    NotReplanned,
    /// A vehicle that lost its motion, or its way, to the wind and is about to leave the airspace, comes back; its slot is over for it.
    #[error("blown towards the edge of the airspace: comes back inside, level")]
    BlownOut,
    /// A slot that carried on the one before ended before this vehicle was on the air in it; it will be agreed on by itself.
    #[error("slot {0} for {1}: put off")]
    SlotPutOff(u16, String),
    /// A slot's time is over, in which this vehicle did not radiate.
    #[error("slot {slot} for {user}: not served{}", words::because(silence))]
    SlotNotServed {
        /// Its number over superframes.
        slot: u16,
        /// The user it was for.
        user: String,
        /// The last reason found within its airtime.
        silence: Option<Silence>,
    },
    /// Nothing is left to do.
    #[error("all slots are over, returning")]
    AllSlotsOver,
    /// The way home begins.
    #[error("returning home")]
    ReturningHome,
    /// An abort before the altitude band was reached.
    #[error("landing where it took off")]
    LandingBelowBand,
    /// A surrendered vehicle goes home by the operator's order.
    #[error("returning by the autopilot, on the operator's order")]
    SentHome,
    /// There is no way home.
    #[error("no way home, landing here: {0}")]
    NoWayHome(TransitError),
    /// A climb or a return that does not end.
    #[error("still {} m from where it should be: the autopilot lands here", .0.map_or("?".into(), |m| format!("{m:.1}")))]
    Astray(Option<f64>),
    /// The mission is given up.
    #[error("mission aborted: {0}")]
    Aborted(Cause),
    /// Control is another hand's (F2).
    #[error("silent, hands off: {0}")]
    HandsOff(Cause),
    /// The autopilot came back to the companion's mode by itself, by setpoints that were under way, and is told to go to
    /// this mode: nobody flies it.
    #[error("the autopilot took up setpoints that came late: told to go to {0}")]
    CalledBack(&'static str),
    /// Landed by the autopilot, under us.
    #[error("landed and disarmed")]
    Landed,
    /// Seen on the ground after a surrender.
    #[error("on the ground and disarmed")]
    OnTheGround,
    /// The process is asked to end.
    #[error("companion is ending: silent, autopilot holds")]
    Ending,
    /// A parameter of the autopilot is put right that a companion had left.
    #[error("{parameter} was {was}, left so by a companion that ended in the air: it is {is} again")]
    PutRight {
        /// Its name.
        parameter: &'static str,
        /// As it was found.
        was: f64,
        /// As it is now.
        is: f64,
    },
    /// A land detector stays off: this vehicle's, or the peer's, whose companion is gone.
    #[error(
        "the land detector of vehicle {0} is off: after landing it stays armed; start its companion again, or set LNDMC_Z_VEL_MAX to 0.25 once it is level"
    )]
    LeftGuarded(Role),
    /// The peer's first message.
    #[error("vehicle {0} is heard")]
    PeerFound(Role),
    /// The peer has another mission file.
    #[error("vehicle {0} flies another mission: copy the same mission file to both vehicles")]
    MissionDiffers(Role),
    /// The peer made another plan.
    #[error("vehicle {0} made another plan of the same mission: same version on both?")]
    PlanDiffers(Role),
    /// Both vehicle files say the same role.
    #[error("the other companion is vehicle {0} too: change role in one vehicle file")]
    SameRole(Role),
    /// The peer refuses a slot.
    #[error("vehicle {peer} refused slot {slot}: {}", words::answer(*answer))]
    Refused {
        /// The peer.
        peer: Role,
        /// The slot's number over superframes.
        slot: u16,
        /// Why.
        answer: VeilwingAnswer,
    },
    /// Our own transmitter cannot serve a slot.
    #[error("transmitter cannot serve slot {slot}: {reason}")]
    Unready {
        /// The slot's number over superframes.
        slot: u16,
        /// Why.
        reason: NotReady,
    },
    /// Our own transmitter may radiate, and its device does not.
    #[error("slot {slot}: off: {trouble}")]
    Troubled {
        /// The slot's number over superframes.
        slot: u16,
        /// What is wrong with it.
        trouble: Trouble,
    },
    /// Jamming protects nobody: the slot is ended.
    #[error("slot {slot} ended early: {}", words::in_vain(*peer, *jamming))]
    JammedInVain {
        /// The peer.
        peer: Role,
        /// The slot's number over superframes.
        slot: u16,
        /// What our radio has confirmed.
        jamming: Jamming,
    },
    /// The peer fell silent out of turn.
    #[error("vehicle {peer} fell silent: {}", words::reason(*reason))]
    PeerSilent {
        /// The peer.
        peer: Role,
        /// Why.
        reason: VeilwingSilence,
    },
    /// The peer cannot be worked with; nothing follows in this phase.
    #[error("{}", words::give_up(.0, .1))]
    PeerGone(Role, GiveUp),
    /// The radio kill.
    #[error(
        "radio kill: silent until lifted at each vehicle, or both companions have restarted on the ground"
    )]
    Killed,
    /// A person has lifted it at this vehicle; it holds for the other's sake.
    #[error("radio kill lifted at this vehicle: it holds until it is lifted at vehicle {0} too")]
    KillLiftedHere(Role),
    /// It is lifted at both.
    #[error("radio kill lifted at both vehicles")]
    KillLifted,
    /// A START is pending, given here or at the other vehicle.
    #[error("start ordered")]
    StartOrdered,
    /// It cannot be accepted.
    #[error("start refused: {0}")]
    StartRefused(String),
    /// Another order that cannot be obeyed, and why.
    #[error("{0} refused: {1}")]
    OrderRefused(&'static str, &'static str),
    /// Of an edited mission file, so many of those that move are taken to be where it has them.
    #[error("mission file: {0} of those that move are elsewhere")]
    FileTaken(usize),
    /// Nothing of it is taken, and why.
    #[error("mission file: nothing of it is taken: {0}")]
    FileRefused(String),
    /// The autopilot asks whether it may be armed, and it may not.
    #[error("arming refused: {0}")]
    ArmingRefused(String),
    /// An order is in force here, and the other vehicle has not shown in time that it has it.
    #[error("{order}: in force here; vehicle {peer} has not confirmed it in time")]
    OrderUnconfirmed {
        /// What was ordered.
        order: &'static str,
        /// The other vehicle.
        peer: Role,
    },
    /// It was not confirmed by both in time.
    #[error("start expired: within {:.0} s this vehicle or vehicle {peer} was not ready", START_EXPIRES.as_secs_f64())]
    StartExpired {
        /// The other vehicle.
        peer: Role,
    },
    /// A START is taken back, and none counts that was set before.
    #[error("staying on the ground: {0}")]
    NotTakingOff(Cause),
    /// The operator's pause.
    #[error("paused by the operator: silent, holding")]
    Paused,
    /// The end of a pause.
    #[error("going on by the operator's order")]
    GoingOn,
    /// A command of a system that is no operator.
    #[error(
        "commands of system {0} are refused: it is no operator; list it in [operators] system_ids, or sign the autopilot's link"
    )]
    NoOperator(u8),
    /// A parameter that stays as it is.
    #[error("{0}")]
    ParameterRefused(ParameterRefusal),
    /// A parameter that was written.
    #[error("{0} is now {1}")]
    ParameterSet(&'static str, f64),
    /// The disk does not take the link's records.
    #[error("telemetry log: records are being lost; flying goes on")]
    LosingLog,
    /// It does again.
    #[error("telemetry log: the disk takes records again")]
    LogTakenAgain,
}

impl Notice {
    /// MAVLink severity.
    #[must_use]
    pub fn severity(&self) -> MavSeverity {
        match self {
            Self::Planned(_)
            | Self::AutopilotFound { .. }
            | Self::AutopilotNotReady { .. }
            | Self::Waiting { again: false, .. }
            | Self::Emission(_)
            | Self::TakingOff
            | Self::Airborne
            | Self::SlotAgreed { .. }
            | Self::On(..)
            | Self::SlotOver(..)
            | Self::SlotPutOff(..)
            | Self::AllSlotsOver
            | Self::ReturningHome
            | Self::LandingBelowBand
            | Self::Landed
            | Self::OnTheGround
            | Self::PeerFound(_)
            | Self::StartOrdered
            | Self::LogTakenAgain => MavSeverity::MAV_SEVERITY_INFO,
            Self::Paused
            | Self::MayLean(_)
            | Self::Jitter { .. }
            | Self::Slow { .. }
            | Self::Replanned { .. }
            | Self::NotReplanned
            | Self::SentHome
            | Self::GoingOn
            | Self::ParameterSet(..)
            | Self::FileTaken(_)
            | Self::KillLifted
            | Self::KillLiftedHere(_)
            | Self::PutRight { .. }
            | Self::NotTakingOff(_) => MavSeverity::MAV_SEVERITY_NOTICE,
            Self::AutopilotRefused(_)
            | Self::CalledBack(_)
            | Self::Estimator(_)
            | Self::BridgeDead(_)
            | Self::Waiting { again: true, .. }
            | Self::PreflightWarning(_)
            | Self::Silent(_)
            | Self::SlotNotServed { .. }
            | Self::Ending
            | Self::Refused { .. }
            | Self::Unready { .. }
            | Self::Troubled { .. }
            | Self::JammedInVain { .. }
            | Self::PeerSilent { .. }
            | Self::PeerGone(..)
            | Self::NoOperator(_)
            | Self::ParameterRefused(_)
            | Self::StartRefused(_)
            | Self::OrderRefused(..)
            | Self::FileRefused(_)
            | Self::ArmingRefused(_)
            | Self::OrderUnconfirmed { .. }
            | Self::StartExpired { .. }
            | Self::BlownOut
            | Self::LosingLog => MavSeverity::MAV_SEVERITY_WARNING,
            Self::NoWayHome(_)
            | Self::Astray(_)
            | Self::Aborted(_)
            | Self::LeftGuarded(_)
            | Self::MissionDiffers(_)
            | Self::PlanDiffers(_)
            | Self::SameRole(_) => MavSeverity::MAV_SEVERITY_ERROR,
            Self::HandsOff(_) | Self::Killed => MavSeverity::MAV_SEVERITY_CRITICAL,
        }
    }
}
