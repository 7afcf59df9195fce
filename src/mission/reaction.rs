//! What the autopilot's and the pair's events lead to.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use crate::autopilot::Event as AutopilotEvent;
use crate::pair::Event as PairEvent;
use crate::pair::wire::{VeilwingAnswer, VeilwingFlags, VeilwingSilence};
use crate::time::Instant;

use super::executive::Executive;
use super::flight::Phase;

/// A refused proposal is made again after this; refused for this long altogether, the mission is given up.
const PROPOSE_AGAIN: Duration = Duration::from_millis(500);
const REFUSED_TOO_LONG: Duration = Duration::from_secs(30);

impl Executive {
    pub(super) fn on_autopilot(&mut self, event: AutopilotEvent, now: Instant) {
        match event {
            AutopilotEvent::Discovered { system, firmware } => {
                if self.settings.autopilot.autopilot_system.is_none() {
                    self.settings.own.0 = system;
                    self.autopilot.adopt_system(system);
                    self.interlock.adopt_system(system, now);
                }
                let text = format!("autopilot found: system {system}, {firmware:?}");
                self.notice(MavSeverity::MAV_SEVERITY_INFO, text);
            }
            AutopilotEvent::ControlTaken if self.phase == Phase::TakingControl => {
                self.autopilot.arm(now);
                self.enter(Phase::Arming, now);
            }
            AutopilotEvent::Armed if self.phase == Phase::Arming => self.climb(now),
            AutopilotEvent::ControlLost { mode } => match self.phase {
                Phase::Landing | Phase::Surrendered | Phase::Ended | Phase::Connecting | Phase::Standby => {}
                _ => self.surrender(
                    format!("the autopilot went to {mode} by another hand"),
                    VeilwingSilence::VEILWING_SILENCE_CONTROL,
                    now,
                ),
            },
            AutopilotEvent::LinkLost { missing, silent_for } => match self.phase {
                Phase::Connecting | Phase::Standby | Phase::Surrendered | Phase::Ended => {}
                _ => self.surrender(
                    format!("{missing} from the autopilot for {:.1} s", silent_for.as_secs_f64()),
                    VeilwingSilence::VEILWING_SILENCE_LINK,
                    now,
                ),
            },
            AutopilotEvent::EstimatorFailure(fault) => match self.phase {
                Phase::Ready { .. } | Phase::Slot | Phase::Climbing => {
                    self.pair.silent(VeilwingSilence::VEILWING_SILENCE_ESTIMATOR, now);
                    self.abort(format!("estimator: {fault}"), now);
                }
                _ => self.notice(MavSeverity::MAV_SEVERITY_WARNING, format!("estimator: {fault}")),
            },
            AutopilotEvent::Refused { what, result, statustext } => {
                let answer = result.map_or("no answer".to_owned(), |result| format!("{result:?}"));
                let text = format!("autopilot refused {what}: {answer} {}", statustext.unwrap_or_default());
                match self.phase {
                    Phase::TakingControl | Phase::Arming => self.abort(text, now),
                    _ => self.notice(MavSeverity::MAV_SEVERITY_WARNING, text),
                }
            }
            AutopilotEvent::NotReady { what, result, statustext, waited } => {
                let why = statustext.unwrap_or_else(|| format!("{result:?}"));
                let text =
                    format!("waiting for the autopilot to {what}: {why} ({:.0} s)", waited.as_secs_f64());
                self.notice(MavSeverity::MAV_SEVERITY_INFO, text);
            }
            AutopilotEvent::Restarted => match self.phase {
                Phase::Connecting | Phase::Standby | Phase::Ended => {}
                _ => self.surrender(
                    "the autopilot restarted".into(),
                    VeilwingSilence::VEILWING_SILENCE_CONTROL,
                    now,
                ),
            },
            AutopilotEvent::Landed if matches!(self.phase, Phase::Landing) => self.autopilot.disarm(now),
            AutopilotEvent::Disarmed => match self.phase {
                Phase::Landing | Phase::Surrendered => {
                    self.notice(MavSeverity::MAV_SEVERITY_INFO, "landed and disarmed".into());
                    self.end(now);
                }
                Phase::Connecting | Phase::Standby | Phase::Ended => {}
                _ => self.surrender(
                    "the autopilot disarmed".into(),
                    VeilwingSilence::VEILWING_SILENCE_CONTROL,
                    now,
                ),
            },
            _ => {}
        }
    }

    pub(super) fn on_pair(&mut self, event: PairEvent, now: Instant) {
        let peer = self.settings.role.peer();
        match event {
            PairEvent::PeerFound => {
                self.notice(MavSeverity::MAV_SEVERITY_INFO, format!("vehicle {peer} is heard"));
            }
            PairEvent::PeerLost(silent_for) => {
                let text = format!("nothing heard from vehicle {peer} for {:.1} s", silent_for.as_secs_f64());
                self.lose_peer(text, now);
            }
            PairEvent::PeerRestarted => self.lose_peer(format!("vehicle {peer}'s companion restarted"), now),
            PairEvent::MissionDiffers => {
                let text = format!(
                    "vehicle {peer} flies another mission: copy the same mission file to both vehicles"
                );
                self.notice(MavSeverity::MAV_SEVERITY_ERROR, text);
            }
            PairEvent::PlanDiffers => {
                let text =
                    format!("vehicle {peer} made another plan of the same mission: same version on both?");
                self.notice(MavSeverity::MAV_SEVERITY_ERROR, text);
            }
            PairEvent::SameRole => {
                let text = format!(
                    "the other companion is vehicle {} too: change role in one vehicle file",
                    peer.peer()
                );
                self.notice(MavSeverity::MAV_SEVERITY_ERROR, text);
            }
            PairEvent::Refused(slot, answer) => {
                self.agreement_time.refused(answer);
                self.on_refused(slot, answer_in_words(answer), now);
            }
            PairEvent::PeerLeft => {
                // Later in a slot the leases decide, and the clocks may differ at its end.
                let on_the_way = self.slot.as_ref().is_some_and(|s| now < s.course.commitment.opens_at);
                let paused = self.paused || self.pair.peer().says(VeilwingFlags::VEILWING_FLAGS_PAUSED);
                if on_the_way && !paused {
                    self.abort(format!("vehicle {peer} is not on its way to the agreed slot"), now);
                }
            }
            PairEvent::Committed(commitment) => {
                if matches!(self.phase, Phase::Ready { .. }) && !self.paused {
                    self.agreement_time.agreed();
                    self.pair.set_readiness(None);
                    self.begin_slot(commitment, now);
                } else {
                    self.pair.release(now);
                }
            }
            PairEvent::PeerSilent(reason) => {
                let text = format!("vehicle {peer} fell silent: {}", reason_in_words(reason));
                self.notice(MavSeverity::MAV_SEVERITY_WARNING, text);
                let may_recover = matches!(
                    reason,
                    // State that is late for a moment; where it stays away, the peer says that it has ended.
                    VeilwingSilence::VEILWING_SILENCE_POSE
                        | VeilwingSilence::VEILWING_SILENCE_TRANSMITTER
                        | VeilwingSilence::VEILWING_SILENCE_LINK
                );
                if !may_recover {
                    let text = format!("vehicle {peer} fell silent for good, {}", reason_in_words(reason));
                    self.lose_peer(text, now);
                }
            }
            PairEvent::Ordered(order) => self.obey(order, now),
        }
    }

    fn lose_peer(&mut self, text: String, now: Instant) {
        if self.phase.is_flying() || self.phase == Phase::Climbing {
            self.abort(text, now);
        } else if !self.pair.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED) {
            self.notice(MavSeverity::MAV_SEVERITY_WARNING, text.clone());
            if self.phase.is_ending() {
                self.note_abort(text);
            }
        }
    }

    fn on_refused(&mut self, slot: u16, answer: &str, now: Instant) {
        let Phase::Ready { refused_since, .. } = self.phase else { return };
        let since = refused_since.unwrap_or(now);
        let peer = self.settings.role.peer();
        if refused_since.is_none() {
            let text = format!("vehicle {peer} refused slot {slot}: {answer}");
            self.notice(MavSeverity::MAV_SEVERITY_WARNING, text);
        }
        self.phase = Phase::Ready { refused_since: Some(since), propose_at: now + PROPOSE_AGAIN };
        if now.saturating_since(since) > REFUSED_TOO_LONG {
            self.abort(format!("vehicle {peer} keeps refusing slot {slot}: {answer}"), now);
        }
    }

    /// Control is gone: no more setpoints, silent, until the operator asks (F2).
    pub(super) fn surrender(&mut self, cause: String, reason: VeilwingSilence, now: Instant) {
        self.notice(MavSeverity::MAV_SEVERITY_CRITICAL, format!("silent, hands off: {cause}"));
        self.note_abort(cause);
        self.pair.silent(reason, now);
        self.slot = None;
        self.motion = None;
        self.pair.release(now);
        self.pair.set_readiness(None);
        self.autopilot.release(now);
        self.enter(Phase::Surrendered, now);
    }
}

fn reason_in_words(reason: VeilwingSilence) -> &'static str {
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

fn answer_in_words(answer: VeilwingAnswer) -> &'static str {
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
