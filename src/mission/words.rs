//! The words for what the pair's service says in kinds.

use crate::pair::wire::{VeilwingAnswer, VeilwingSilence};
use crate::role::Role;
use crate::service::{GiveUp, Jamming, Silence};
use crate::units::Watts;

/// Why the service cannot go on, `peer` being the other vehicle.
pub(super) fn give_up(peer: &Role, why: &GiveUp) -> String {
    match why {
        GiveUp::PeerLost(silent_for) => {
            format!("nothing heard from vehicle {peer} for {:.1} s", silent_for.as_secs_f64())
        }
        GiveUp::PeerRestarted => format!("vehicle {peer}'s companion restarted"),
        GiveUp::PeerLeft => format!("vehicle {peer} is not on its way to the agreed slot"),
        GiveUp::PeerSilent(why) => format!("vehicle {peer} fell silent for good, {}", reason(*why)),
        GiveUp::PeerEnded => format!("vehicle {peer} has ended its mission"),
        GiveUp::NoSlot(waited) => {
            format!("in the air for {:.0} s without a slot agreed with vehicle {peer}", waited.as_secs_f64())
        }
        GiveUp::Unready(slot, why) => format!("own transmitter cannot serve slot {slot}: {why}"),
        GiveUp::Refused(slot, why) => format!("vehicle {peer} keeps refusing slot {slot}: {}", answer(*why)),
    }
}

/// What the battery is to be enough for.
pub(super) fn way_home(before: Option<u16>) -> String {
    before.map_or_else(|| "the way home".into(), |slot| format!("slot {slot} with the way home"))
}

/// What is added to "not served".
pub(super) fn because(silence: &Option<Silence>) -> String {
    silence.map_or(String::new(), |silence| format!(": {silence}"))
}

/// Why J's jamming protected nobody.
pub(super) fn in_vain(peer: Role, jamming: Jamming) -> String {
    match jamming {
        Jamming::Unconfirmed => {
            "our radio has not confirmed its power, so nothing could be promised; it may refuse that power"
                .into()
        }
        Jamming::Short { given_w, planned_w } => format!(
            "our radio gives {} of the plan's {}, so nothing could be promised: give it finer steps",
            Watts(given_w),
            Watts(planned_w)
        ),
        Jamming::Full => format!(
            "vehicle {peer} hardly radiates in it, so jamming protects nobody; see vehicle {peer}'s log for the reason, and the delay of the pair link"
        ),
    }
}

/// Why the peer fell silent.
pub(super) fn reason(reason: VeilwingSilence) -> &'static str {
    match reason {
        VeilwingSilence::VEILWING_SILENCE_POSE => "its pose left tolerance",
        VeilwingSilence::VEILWING_SILENCE_CONTROL => "its autopilot left the companion's mode",
        VeilwingSilence::VEILWING_SILENCE_LINK => "its autopilot link is stale",
        VeilwingSilence::VEILWING_SILENCE_ESTIMATOR => "its position estimate failed",
        VeilwingSilence::VEILWING_SILENCE_TRANSMITTER => "its transmitter does not answer",
        VeilwingSilence::VEILWING_SILENCE_OPERATOR => "by the operator's order",
        VeilwingSilence::VEILWING_SILENCE_SHUTDOWN => "its companion is ending",
    }
}

/// What the peer said to a proposal.
pub(super) fn answer(answer: VeilwingAnswer) -> &'static str {
    match answer {
        VeilwingAnswer::VEILWING_ANSWER_ACCEPTED => "accepted",
        VeilwingAnswer::VEILWING_ANSWER_NOT_READY => "it is not ready",
        VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN => "its plan differs",
        VeilwingAnswer::VEILWING_ANSWER_WRONG_SLOT => "it expects another slot",
        VeilwingAnswer::VEILWING_ANSWER_TOO_LATE => "it cannot be on station in time",
        VeilwingAnswer::VEILWING_ANSWER_CLOCK => "the two clocks differ too much, or are not compared yet",
        VeilwingAnswer::VEILWING_ANSWER_LIMITS => "a pose or power is beyond its limits",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_each_answer_and_what_a_battery_is_to_be_enough_for_have_words_of_their_own() {
        use VeilwingAnswer::*;
        let answers = [
            VEILWING_ANSWER_ACCEPTED,
            VEILWING_ANSWER_NOT_READY,
            VEILWING_ANSWER_WRONG_PLAN,
            VEILWING_ANSWER_WRONG_SLOT,
            VEILWING_ANSWER_TOO_LATE,
            VEILWING_ANSWER_CLOCK,
            VEILWING_ANSWER_LIMITS,
        ];
        let words: std::collections::BTreeSet<_> = answers.into_iter().map(answer).collect();
        assert!(words.len() == answers.len() && words.iter().all(|words| words.len() > 5), "{words:?}");
        assert_eq!([None, Some(3)].map(way_home), ["the way home", "slot 3 with the way home"]);
    }

    #[test]
    fn spec_jamming_in_vain_names_whose_fault_it_is() {
        let short = in_vain(Role::I, Jamming::Short { given_w: 3.77e-6, planned_w: 3.82e-6 });
        assert!(short.starts_with("our radio gives 3.770 uW of the plan's 3.820 uW"), "{short}");
        assert!(in_vain(Role::I, Jamming::Unconfirmed).starts_with("our radio has not confirmed"));
        assert!(in_vain(Role::I, Jamming::Full).starts_with("vehicle I hardly radiates in it"));
    }
}
