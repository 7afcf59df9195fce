//! Which of its kinds of state, news and refusal the companions' code has come to: so often in a campaign, and which never.

use std::collections::BTreeMap;
use std::fmt::{Debug, Write as _};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};
use num_traits::FromPrimitive;
use strum::VariantNames;

use crate::autopilot::EstimatorFault;
use crate::desk::simulation::{Observer, Witness};
use crate::mission::{Cause, Notice, Outgoing, PHASES};
use crate::pair::wire::{VeilwingAnswer, VeilwingSilence};
use crate::role::Role;
use crate::service::{GiveUp, Silence, Standing};
use crate::transmitter::NotReady;

/// How often each kind was reached, by group and name.
pub type Counts = BTreeMap<String, BTreeMap<String, u64>>;

/// What is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    Phase,
    Service,
    Notice,
    Cause,
    GiveUp,
    Silence,
    PeerSilence,
    Answer,
    Radio,
    Estimator,
    Order,
}

impl Group {
    const ALL: [Self; 11] = [
        Self::Phase,
        Self::Service,
        Self::Notice,
        Self::Cause,
        Self::GiveUp,
        Self::Silence,
        Self::PeerSilence,
        Self::Answer,
        Self::Radio,
        Self::Estimator,
        Self::Order,
    ];

    /// As documents spell it.
    const fn name(self) -> &'static str {
        match self {
            Self::Phase => "phase",
            Self::Service => "service",
            Self::Notice => "notice",
            Self::Cause => "cause",
            Self::GiveUp => "give-up",
            Self::Silence => "silence",
            Self::PeerSilence => "peer-silence",
            Self::Answer => "answer",
            Self::Radio => "radio-not-ready",
            Self::Estimator => "estimator",
            Self::Order => "order",
        }
    }

    /// Every kind of the group; of the peer's answers those that refuse, all but the first.
    fn kinds(self) -> Vec<String> {
        let named = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        match self {
            Self::Phase => named(&PHASES),
            Self::Service => named(Standing::VARIANTS),
            Self::Notice => named(Notice::VARIANTS),
            Self::Cause => named(Cause::VARIANTS),
            Self::GiveUp => named(GiveUp::VARIANTS),
            Self::Silence => named(Silence::VARIANTS),
            Self::PeerSilence => entries::<VeilwingSilence>(),
            Self::Answer => entries::<VeilwingAnswer>().into_iter().skip(1).collect(),
            Self::Radio => named(NotReady::VARIANTS),
            Self::Estimator => named(EstimatorFault::VARIANTS),
            Self::Order => {
                let orders = ORDERS.iter().map(|(_, order)| order);
                orders.flat_map(|order| [format!("{order} obeyed"), format!("{order} refused")]).collect()
            }
        }
    }
}

/// An operator's orders, by their commands.
const ORDERS: [(MavCmd, &str); 4] = [
    (MavCmd::MAV_CMD_MISSION_START, "start"),
    (MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, "pause or continue"),
    (MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, "return"),
    (MavCmd::MAV_CMD_USER_2, "kill or lift"),
];

/// The entries of an enum of the dialect.
fn entries<T: FromPrimitive + Debug>() -> Vec<String> {
    (0..=u8::MAX).filter_map(T::from_u8).map(|entry| format!("{entry:?}")).collect()
}

/// Every kind, at zero.
#[must_use]
pub fn nothing() -> Counts {
    let zero = |group: Group| group.kinds().into_iter().map(|kind| (kind, 0)).collect();
    Group::ALL.into_iter().map(|group| (group.name().to_owned(), zero(group))).collect()
}

/// Adds what one flight has reached.
pub fn add(sum: &mut Counts, flight: &Counts) {
    for (group, kinds) in flight {
        let group = sum.entry(group.clone()).or_default();
        for (kind, count) in kinds {
            *group.entry(kind.clone()).or_default() += count;
        }
    }
}

/// The counts for a reader: by group, the rarest first.
#[must_use]
pub fn table(counts: &Counts) -> String {
    let mut text = String::new();
    for (group, kinds) in counts {
        let mut rows: Vec<_> = kinds.iter().collect();
        rows.sort_by_key(|(kind, count)| (**count, *kind));
        let never = rows.iter().filter(|(_, count)| **count == 0).count();
        // Writing to a String cannot fail.
        let _ = writeln!(text, "{group}: {} of {} reached", rows.len() - never, rows.len());
        for (kind, count) in rows {
            let _ = writeln!(text, "  {kind:<36} {count:>9}");
        }
    }
    text
}

/// Counts what one flight reaches.
#[derive(Debug, Clone, Default)]
pub struct Tally {
    counts: Counts,
}

impl Tally {
    /// What was reached.
    #[must_use]
    pub fn finish(self) -> Counts {
        self.counts
    }

    fn count(&mut self, group: Group, kind: &str) {
        let kinds = self.counts.entry(group.name().to_owned()).or_default();
        *kinds.entry(kind.to_owned()).or_default() += 1;
    }

    fn cause(&mut self, cause: &Cause) {
        self.count(Group::Cause, cause.into());
        match cause {
            Cause::Estimator(fault) => self.count(Group::Estimator, fault.into()),
            Cause::Peer(_, give_up) => self.give_up(give_up),
            Cause::NotServed { silence, .. } => self.silence(silence.as_ref()),
            _ => {}
        }
    }

    fn give_up(&mut self, give_up: &GiveUp) {
        self.count(Group::GiveUp, give_up.into());
        match give_up {
            GiveUp::PeerSilent(reason) => self.count(Group::PeerSilence, &format!("{reason:?}")),
            GiveUp::Refused(_, answer) => self.count(Group::Answer, &format!("{answer:?}")),
            GiveUp::Unready(_, reason) => self.count(Group::Radio, reason.into()),
            _ => {}
        }
    }

    fn silence(&mut self, silence: Option<&Silence>) {
        let Some(silence) = silence else { return };
        self.count(Group::Silence, silence.into());
        if let Silence::Transmitter(reason) = silence {
            self.count(Group::Radio, reason.into());
        }
    }

    fn acknowledged(&mut self, ack: &COMMAND_ACK_DATA) {
        let Some((_, order)) = ORDERS.iter().find(|(command, _)| *command == ack.command) else { return };
        let how = if ack.result == MavResult::MAV_RESULT_ACCEPTED { "obeyed" } else { "refused" };
        self.count(Group::Order, &format!("{order} {how}"));
    }
}

impl Observer for Tally {
    fn said(&mut self, _: Duration, _: Role, _: Option<&'static str>, notice: &Notice) {
        self.count(Group::Notice, notice.into());
        match notice {
            Notice::Estimator(fault) => self.count(Group::Estimator, fault.into()),
            Notice::Silent(silence) => self.silence(Some(silence)),
            Notice::SlotNotServed { silence, .. } => self.silence(silence.as_ref()),
            Notice::Aborted(cause) | Notice::HandsOff(cause) | Notice::NotTakingOff(cause) => {
                self.cause(cause)
            }
            Notice::Refused { answer, .. } => self.count(Group::Answer, &format!("{answer:?}")),
            Notice::Unready { reason, .. } => self.count(Group::Radio, reason.into()),
            Notice::PeerSilent { reason, .. } => self.count(Group::PeerSilence, &format!("{reason:?}")),
            Notice::PeerGone(_, give_up) => self.give_up(give_up),
            _ => {}
        }
    }

    fn stands(&mut self, _: Duration, _: Role, phase: &'static str, standing: Standing) {
        self.count(Group::Phase, phase);
        self.count(Group::Service, standing.into());
    }

    fn sent(&mut self, _: Duration, _: Role, message: &Outgoing) {
        if let Outgoing::Autopilot(message) = message
            && let MavMessage::COMMAND_ACK(ack) = &**message
        {
            self.acknowledged(ack);
        }
    }
}

impl Witness for Tally {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_every_kind_is_listed_and_sums_add_up() {
        let mut sum = nothing();
        let kinds = |group: &str| sum[group].len();
        assert_eq!((kinds("phase"), kinds("service")), (PHASES.len(), Standing::VARIANTS.len()));
        assert!(kinds("answer") >= 6 && kinds("peer-silence") >= 7, "{sum:#?}");
        let mut tally = Tally::default();
        let cause = Cause::Peer(Role::J, GiveUp::Unready(0, NotReady::NotHeard));
        tally.said(Duration::ZERO, Role::I, None, &Notice::Aborted(cause));
        tally.said(Duration::ZERO, Role::I, None, &Notice::Silent(Silence::Pose));
        tally.stands(Duration::ZERO, Role::I, PHASES[0], Standing::OnAir);
        let flight = tally.finish();
        let known = sum.clone();
        add(&mut sum, &flight);
        add(&mut sum, &flight);
        for (group, kind) in [
            ("notice", "Aborted"),
            ("notice", "Silent"),
            ("cause", "Peer"),
            ("give-up", "Unready"),
            ("radio-not-ready", "NotHeard"),
            ("silence", "Pose"),
            ("phase", "connecting"),
            ("service", "on-air"),
        ] {
            assert_eq!(sum[group][kind], 2, "{group} {kind}");
            assert_eq!(known[group].get(kind), Some(&0), "{group} {kind} is not listed");
        }
        assert_eq!(sum.values().flat_map(|kinds| kinds.values()).sum::<u64>(), 16);
        assert!(table(&sum).contains(&format!("cause: 1 of {} reached", Cause::VARIANTS.len())));
    }
}
