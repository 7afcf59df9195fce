//! What the autopilot's and the service's events lead to.

use crate::autopilot::Event as AutopilotEvent;
use crate::pair::wire::{VeilwingFlags, VeilwingSilence};
use crate::service::{Event as ServiceEvent, GiveUp, Silence};
use crate::time::Instant;
use crate::units::Watts;

use super::cause::Cause;
use super::executive::Executive;
use super::notice::Notice;
use super::phase::Phase;
use super::refusal::Refusal;

impl Executive {
    /// Whether the operator's orders are on disk as they are now, as far as a disk takes them.
    pub(super) fn is_recorded(&self) -> bool {
        self.recorded == *self.service.orders().record()
    }

    /// Arms once control is taken, and it is on disk that the mission has begun: a process that is killed on a slow disk must not leave
    /// one that takes off once more (S7, F4).
    pub(super) fn arm_once_recorded(&mut self, now: Instant) {
        if let Phase::TakingControl(motion) = &self.phase
            && self.autopilot.has_control()
            && self.is_recorded()
        {
            self.phase = Phase::Arming(motion.clone());
            self.autopilot.arm(now);
        }
    }

    pub(super) fn on_autopilot(&mut self, event: AutopilotEvent, now: Instant) {
        let control = VeilwingSilence::VEILWING_SILENCE_CONTROL;
        match event {
            AutopilotEvent::Discovered { system, firmware } => {
                if self.settings.autopilot.autopilot_system.is_none() {
                    self.settings.own.0 = system;
                    self.autopilot.adopt_system(system);
                    self.service.adopt_system(system, now);
                }
                self.notice(Notice::AutopilotFound { system, firmware });
            }
            AutopilotEvent::ControlTaken => self.arm_once_recorded(now),
            AutopilotEvent::Armed if matches!(self.phase, Phase::Arming(_)) => self.climb(now),
            AutopilotEvent::ControlLost { mode } if !matches!(self.phase, Phase::Landing) => {
                self.surrender(Cause::ControlLost(mode), control, now);
            }
            AutopilotEvent::CalledBack { to } => self.notice(Notice::CalledBack(to)),
            AutopilotEvent::LinkLost { missing, silent_for } => {
                let cause = Cause::AutopilotLost { missing, silent_for };
                self.surrender(cause, VeilwingSilence::VEILWING_SILENCE_LINK, now);
            }
            AutopilotEvent::EstimatorFailure(fault) => {
                if self.phase.is_outward() {
                    self.service.tell_silence(VeilwingSilence::VEILWING_SILENCE_ESTIMATOR, now);
                    self.abort(Cause::Estimator(fault), now);
                } else {
                    self.notice(Notice::Estimator(fault));
                }
            }
            AutopilotEvent::BridgeDead { silent_for } => {
                if self.phase.is_outward() {
                    self.service.tell_silence(VeilwingSilence::VEILWING_SILENCE_POSE, now);
                    self.abort(Cause::BridgeDead(silent_for), now);
                } else {
                    self.notice(Notice::BridgeDead(silent_for));
                }
            }
            AutopilotEvent::Refused { what, result, statustext } => {
                let answer = result.map_or("no answer".to_owned(), |result| format!("{result:?}"));
                let text = statustext.unwrap_or_default();
                let refusal = Refusal { what: what.to_string(), answer, text };
                match self.phase {
                    Phase::TakingControl(_) | Phase::Arming(_) => self.abort(Cause::Refused(refusal), now),
                    _ => self.notice(Notice::AutopilotRefused(refusal)),
                }
            }
            AutopilotEvent::NotReady { what, result, statustext, waited } => {
                let why = statustext.unwrap_or_else(|| format!("{result:?}"));
                self.notice(Notice::AutopilotNotReady { what, why, waited });
            }
            AutopilotEvent::PutRight { parameter, was, is } => {
                self.notice(Notice::PutRight { parameter, was, is });
            }
            AutopilotEvent::Restarted => self.surrender(Cause::AutopilotRestarted, control, now),
            AutopilotEvent::Landed if matches!(self.phase, Phase::Landing) => self.autopilot.disarm(now),
            AutopilotEvent::Disarmed => match self.phase {
                Phase::Landing | Phase::Surrendered { .. } => {
                    self.notice(Notice::Landed);
                    self.end(now);
                }
                _ => self.surrender(Cause::Disarmed, control, now),
            },
            _ => {}
        }
    }

    pub(super) fn on_service(&mut self, event: ServiceEvent, now: Instant) {
        let peer = self.settings.role.peer();
        match event {
            ServiceEvent::PeerFound => self.notice(Notice::PeerFound(peer)),
            ServiceEvent::MissionDiffers => self.notice(Notice::MissionDiffers(peer)),
            ServiceEvent::PlanDiffers => self.notice(Notice::PlanDiffers(peer)),
            ServiceEvent::SameRole => self.notice(Notice::SameRole(self.settings.role)),
            ServiceEvent::PeerSilent(reason) => self.notice(Notice::PeerSilent { peer, reason }),
            ServiceEvent::Refused(slot, answer) => self.notice(Notice::Refused { peer, slot, answer }),
            ServiceEvent::Unready(slot, reason) => self.notice(Notice::Unready { slot, reason }),
            ServiceEvent::Troubled(slot, trouble) => self.notice(Notice::Troubled { slot, trouble }),
            ServiceEvent::Ordered(change) => self.on_order(change, now),
            ServiceEvent::Agreed(commitment) => self.begin_transit(commitment, now),
            ServiceEvent::On(permit) => self.notice(Notice::On(permit.slot, Watts(permit.power_w))),
            ServiceEvent::Off(Silence::NoSlot) => {}
            ServiceEvent::Off(silence) => self.notice(Notice::Silent(silence)),
            ServiceEvent::JammedInVain(slot, jamming) => {
                self.notice(Notice::JammedInVain { peer, slot, jamming })
            }
            ServiceEvent::Over(slot, served) => self.slot_over(slot, served, now),
            ServiceEvent::CarriedOn(commitment) => self.carry_on(commitment, now),
            ServiceEvent::PutOff(slot) => self.put_off(slot, now),
            ServiceEvent::PlanMotion => self.plan_motion(now),
            ServiceEvent::TakeUp(number) => self.take_up(number),
            ServiceEvent::PlanSlot(slot, asked) => self.plan_poses(slot, asked),
            ServiceEvent::AllOver => self.finish(now),
            ServiceEvent::GiveUp(why) => self.lose_peer(why, now),
            ServiceEvent::Abandoned => self.break_off(now),
        }
    }

    fn lose_peer(&mut self, why: GiveUp, now: Instant) {
        let peer = self.settings.role.peer();
        let cause = Cause::Peer(peer, why);
        let died = matches!(why, GiveUp::PeerLost(_));
        if died && self.service.peer().says(VeilwingFlags::VEILWING_FLAGS_GUARDING) {
            self.notice(Notice::LeftGuarded(peer));
        }
        if self.phase.is_outward() {
            self.abort(cause, now);
        } else if !self.service.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED) {
            self.notice(Notice::PeerGone(peer, why));
            if self.phase.is_ending() {
                self.note_abort(cause);
            }
        }
    }

    /// Control is gone: no more setpoints, silent, until the operator asks (F2). Nothing is lost where nothing was had.
    fn surrender(&mut self, cause: Cause, reason: VeilwingSilence, now: Instant) {
        if self.phase.is_waiting() || matches!(self.phase, Phase::Surrendered { .. } | Phase::Ended) {
            return;
        }
        self.notice(Notice::HandsOff(cause.clone()));
        self.note_abort(cause);
        self.service.drop_out(reason, now);
        self.autopilot.release(now);
        self.phase = Phase::Surrendered { since: now };
    }
}
