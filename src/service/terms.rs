//! What the service is told once, and what it has to say.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavMessage;

use crate::pair::orders::Change;
use crate::pair::wire::{self, VeilwingAnswer, VeilwingSilence};
use crate::pair::{self, AskedSlot, Commitment};
use crate::transmitter::{NotReady, Trouble};

use super::interlock::{Ceilings, Permit, Silence};
use super::protection::Jamming;
use super::slot::Served;
use super::staleness::Freshness;

/// What does not change while the companion runs.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The pair protocol.
    pub pair: pair::Settings,
    /// Power ceilings beside the plan's.
    pub ceilings: Ceilings,
    /// The transmitter is simulated, or the mission authorises emission.
    pub emission_authorised: bool,
    /// How old the vehicle's state may become.
    pub freshness: Freshness,
}

/// What a service is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::IntoStaticStr, strum::VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum Standing {
    /// It takes no part: on the ground, or on its way up or home.
    Away,
    /// A slot is to be agreed on.
    Between,
    /// The same, and the operator has paused it.
    Paused,
    /// A slot is agreed on; its airtime has not begun.
    Agreed,
    /// Its airtime has begun, and this vehicle has not been on the air yet, for some reason.
    Hindered,
    /// On the air.
    OnAir,
    /// It was, and is not now: by the slot's end, or for some reason.
    Interrupted,
    /// The slot is ended early, in order, and the vehicle is still on the air: J, while I is.
    Closing,
    /// The same, and the vehicle is silent.
    Closed,
    /// J, killed by the operator: on the air while I may be.
    JammingOnKilled,
    /// J, about to leave the mission: likewise.
    JammingOnLeaving,
}

/// Why the pair's service cannot go on.
#[derive(Debug, Clone, Copy, PartialEq, strum::IntoStaticStr, strum::VariantNames)]
pub enum GiveUp {
    /// Nothing was heard from the peer for this long.
    PeerLost(Duration),
    /// The peer's companion restarted: it takes nothing over in the air.
    PeerRestarted,
    /// The peer is not on its way to the agreed slot.
    PeerLeft,
    /// The peer fell silent for a reason that does not pass.
    PeerSilent(VeilwingSilence),
    /// The peer has ended its mission.
    PeerEnded,
    /// In the air for this long, and no slot agreed on: the peer takes no part, or the operator does not end a pause
    /// (F5).
    NoSlot(Duration),
    /// The peer goes on refusing this slot.
    Refused(u16, VeilwingAnswer),
    /// Our own transmitter goes on being unable to serve this slot.
    Unready(u16, NotReady),
}

/// What the owner must know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// First message of the peer.
    PeerFound,
    /// The peer flies another mission.
    MissionDiffers,
    /// The peer made another plan of the same mission.
    PlanDiffers,
    /// Both companions are configured for the same role.
    SameRole,
    /// The peer fell silent out of turn.
    PeerSilent(VeilwingSilence),
    /// What has come about by an operator's order, given here or at the peer. The service has done its part.
    Ordered(Change),
    /// A proposal of this slot was refused, for the first time.
    Refused(u16, VeilwingAnswer),
    /// Our own transmitter cannot serve this slot: it is not agreed on before it can.
    Unready(u16, NotReady),
    /// A slot is agreed: the transit to it begins at its time.
    Agreed(Commitment),
    /// The transmitter may radiate from now on.
    On(Permit),
    /// The transmitter was told to be silent.
    Off(Silence),
    /// The transmitter may radiate in this slot, and its device does not do it: it is off, or told to be.
    Troubled(u16, Trouble),
    /// J ends this slot: I is off for most of it.
    JammedInVain(u16, Jamming),
    /// A slot's time is over, or it was ended early and all is quiet.
    Over(u16, Served),
    /// The slot that carries on the one that is just over has begun, by the clock.
    CarriedOn(Commitment),
    /// A slot that carried on the one before is ended early, and will be agreed on by itself.
    PutOff(u16),
    /// The motion that is asked for ([`super::SlotService::asked_motion`]) is to be planned, and what is found to be told by
    /// [`super::SlotService::motion_planned`].
    PlanMotion,
    /// The motion of this number is flown from its beginning on, and to be given to [`super::SlotService::take_up`].
    TakeUp(u16),
    /// The poses of this slot are to be made anew, and what is found to be told by [`super::SlotService::slot_planned`]; of J with
    /// what is asked.
    PlanSlot(u16, Option<AskedSlot>),
    /// Every slot is over.
    AllOver,
    /// The owner should give the mission up, and say so by [`super::SlotService::abandon`].
    GiveUp(GiveUp),
    /// What [`super::SlotService::abandon`] had to wait for is done.
    Abandoned,
}

/// A message of the service.
#[derive(Debug, Clone, PartialEq)]
pub enum Outgoing {
    /// To the transmitter.
    Radio(Box<MavMessage>),
    /// To the peer.
    Pair(Box<wire::MavMessage>),
}

/// Whether a silence of the peer is one for a moment. State that is late for good the peer follows up by ending its
/// mission.
pub(super) fn may_recover(reason: VeilwingSilence) -> bool {
    matches!(
        reason,
        VeilwingSilence::VEILWING_SILENCE_POSE
            | VeilwingSilence::VEILWING_SILENCE_TRANSMITTER
            | VeilwingSilence::VEILWING_SILENCE_LINK
    )
}

/// What the peer is told of a silence out of turn; `None` for those that are its own news or in turn.
pub(super) fn silence_reason(silence: Silence) -> Option<VeilwingSilence> {
    match silence {
        Silence::Killed | Silence::NotAuthorised => Some(VeilwingSilence::VEILWING_SILENCE_OPERATOR),
        Silence::Stale => Some(VeilwingSilence::VEILWING_SILENCE_LINK),
        Silence::NotInControl => Some(VeilwingSilence::VEILWING_SILENCE_CONTROL),
        Silence::Estimator => Some(VeilwingSilence::VEILWING_SILENCE_ESTIMATOR),
        Silence::Pose => Some(VeilwingSilence::VEILWING_SILENCE_POSE),
        Silence::NoPower | Silence::Transmitter(_) => Some(VeilwingSilence::VEILWING_SILENCE_TRANSMITTER),
        Silence::NoSlot | Silence::NoLease | Silence::NoPeer | Silence::Resting => None,
    }
}
