//! Commands from outside: any MAVLink ground station addresses them to our component, or to all (PROTOCOL section 5). Each
//! order becomes a numbered fact that both vehicles share, and is acknowledged with what has come about.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};

use crate::autopilot::Mode;
use crate::pair::orders::{Change, Order};
use crate::pair::wire::{VeilwingFlags, VeilwingSilence};
use crate::reply::acknowledgement;
use crate::time::Instant;

use super::asked::Progress;
use super::cause::Cause;
use super::executive::Executive;
use super::notice::Notice;
use super::phase::Phase;
use super::reported::SIGHTING;
use super::start::Void;

/// What a command asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Wanted {
    Order(Order),
    /// The radio kill lifted at this vehicle.
    Lift,
    /// Somebody that moves was seen.
    Sighting,
    /// A message.
    Information(f32),
    Unknown,
}

impl Wanted {
    fn of(command: MavCmd, param1: f32) -> Self {
        match command {
            MavCmd::MAV_CMD_MISSION_START => Self::Order(Order::Start),
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE if param1 == 0.0 => Self::Order(Order::Pause),
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE if param1 == 1.0 => Self::Order(Order::Continue),
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Self::Order(Order::Recall),
            MavCmd::MAV_CMD_USER_2 if param1 == 1.0 => Self::Lift,
            MavCmd::MAV_CMD_USER_2 => Self::Order(Order::Kill),
            SIGHTING => Self::Sighting,
            MavCmd::MAV_CMD_REQUEST_MESSAGE => Self::Information(param1),
            _ => Self::Unknown,
        }
    }

    /// What makes a vehicle quieter is obeyed when it is said to all; anything else must be said to us.
    fn may_be_said_to_all(self) -> bool {
        matches!(self, Self::Order(Order::Kill | Order::Recall | Order::Pause))
    }
}

impl Executive {
    /// Takes a command that is addressed to us.
    pub(super) fn handle_operator(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        if self.handle_arming(header, message) || self.refuses_stranger(header, message) {
            return;
        }
        let (system, component, command, param1) = match message {
            MavMessage::COMMAND_LONG(c) => (c.target_system, c.target_component, c.command, c.param1),
            MavMessage::COMMAND_INT(c) => (c.target_system, c.target_component, c.command, c.param1),
            _ => return,
        };
        let wanted = Wanted::of(command, param1);
        let (own_system, own_component) = self.settings.own;
        let to_us = (system, component) == self.settings.own;
        let to_all = [0, own_system].contains(&system) && [0, own_component].contains(&component);
        if !(to_us || to_all && wanted.may_be_said_to_all()) {
            return;
        }
        let by = (u8::try_from(header.system_id).unwrap_or_default(), header.component_id);
        let mut information = None;
        let result = match wanted {
            Wanted::Order(Order::Recall) if to_us && self.may_be_sent_home() => {
                self.notice(Notice::SentHome);
                self.autopilot.return_to_launch(now);
                MavResult::MAV_RESULT_ACCEPTED
            }
            Wanted::Order(order) => match self.take_order(order, now) {
                Ok(number) => return self.asked_for.note(by, command, number, now),
                Err(refusal) => {
                    self.notice(refusal);
                    MavResult::MAV_RESULT_DENIED
                }
            },
            Wanted::Lift if self.phase.is_waiting() && self.autopilot.state().is_disarmed() => {
                self.service.orders_mut().lift();
                if self.service.orders().is_lifted_here_alone() {
                    self.notice(Notice::KillLiftedHere(self.settings.role.peer()));
                }
                MavResult::MAV_RESULT_ACCEPTED
            }
            Wanted::Lift => {
                self.notice(Notice::OrderRefused("lifting the kill", "only on the ground, disarmed"));
                MavResult::MAV_RESULT_DENIED
            }
            Wanted::Sighting => match message {
                MavMessage::COMMAND_INT(seen) => match self.take_sighting(seen, now) {
                    Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
                    Err(why) => {
                        self.notice(Notice::OrderRefused("a sighting", why));
                        MavResult::MAV_RESULT_DENIED
                    }
                },
                _ => MavResult::MAV_RESULT_COMMAND_INT_ONLY,
            },
            Wanted::Information(id) => {
                information = self.information(id, now);
                information
                    .as_ref()
                    .map_or(MavResult::MAV_RESULT_UNSUPPORTED, |_| MavResult::MAV_RESULT_ACCEPTED)
            }
            Wanted::Unknown => MavResult::MAV_RESULT_UNSUPPORTED,
        };
        self.outbox.push_back(acknowledgement(by, command, result));
        self.outbox.extend(information);
    }

    /// Whether this vehicle, surrendered and in the air, hovers in nobody's hand: its autopilot is heard, in the mode that
    /// the companion left or in its own hold. Such a vehicle the operator, and nobody else, sends home by the autopilot's
    /// own return. From a pilot's mode it is never taken (F2). The order is this vehicle's alone: a vehicle on its way by
    /// autopilot heeds no other, so when it goes is for a person to say.
    fn may_be_sent_home(&self) -> bool {
        let state = self.autopilot.state();
        matches!(self.phase, Phase::Surrendered { .. })
            && matches!(state.mode(), Some(Mode::Companion | Mode::Hold))
            && self.autopilot.state_received_at().is_some()
            && state.is_armed()
    }

    /// Gives an order its number, or says why it cannot be obeyed. On the ground, a pause takes back a START.
    fn take_order(&mut self, order: Order, now: Instant) -> Result<(Order, u32), Notice> {
        let name = match order {
            Order::Start => "start",
            Order::Kill => "kill",
            Order::Recall => "return",
            Order::Pause => "pause",
            Order::Continue => "continue",
        };
        let refused = |why| Err(Notice::OrderRefused(name, why));
        let order = match (order, &self.phase) {
            (Order::Kill, _) => Order::Kill,
            (Order::Start, phase) => {
                let obstacle = if phase.is_waiting() { self.ground.obstacle() } else { "in flight" };
                if !obstacle.is_empty() {
                    return Err(Notice::StartRefused(obstacle.to_owned()));
                }
                Order::Start
            }
            (_, Phase::Surrendered { .. }) => return refused("this vehicle is in another hand"),
            (_, Phase::Ended) => return refused("this vehicle's mission is over"),
            (Order::Recall, _) => Order::Recall,
            (Order::Pause, phase) if phase.is_on_the_ground() => Order::Recall,
            (Order::Pause, phase) if phase.is_outward() => Order::Pause,
            (Order::Continue, phase) if phase.is_outward() && self.service.orders().is_paused() => {
                Order::Continue
            }
            (Order::Continue, phase) if phase.is_on_the_ground() || phase.is_outward() => {
                return refused("nothing is paused");
            }
            (Order::Pause | Order::Continue, _) => return refused("this vehicle is on its way home"),
        };
        Ok((order, self.service.orders_mut().give(order, now)))
    }

    /// Answers the operator's orders, as far as there is something to say.
    pub(super) fn answer_operator(&mut self, now: Instant) {
        let (service, settings) = (&self.service, &self.settings.pair);
        let (orders, peer) = (service.orders(), service.peer());
        // Longer unheard, the other has lost us too, is silent, and does not begin without us.
        let alone = !peer.heard_within(settings.peer_timeout + settings.lease * 3, now);
        let peer_off = alone || !peer.says(VeilwingFlags::VEILWING_FLAGS_RADIATING);
        let progress = |order, number| {
            let shared = alone || orders.peer_has(order, number);
            let done = match order {
                Order::Start if orders.is_flying(number) => true,
                Order::Start if orders.pending_start() != Some(number) => return Progress::Void,
                Order::Start => false,
                Order::Kill => shared && peer_off && service.interlock().is_off(now),
                Order::Recall | Order::Pause | Order::Continue => shared,
            };
            if done { Progress::Done } else { Progress::Open }
        };
        let answers = self.asked_for.answers(progress, now);
        for answer in answers {
            // What becomes of a START is told where it does.
            if let MavMessage::COMMAND_ACK(ack) = &answer
                && ack.result == MavResult::MAV_RESULT_FAILED
                && let Some(order) = unconfirmed(ack.command)
            {
                self.notice(Notice::OrderUnconfirmed { order, peer: self.settings.role.peer() });
            }
            self.outbox.push_back(answer);
        }
    }

    /// Does what the operator wants, whichever vehicle was told; the service has done its part.
    pub(super) fn on_order(&mut self, change: Change, now: Instant) {
        match change {
            Change::Killed => {
                self.notice(Notice::Killed);
                self.call_off(Cause::Killed, now);
            }
            Change::Recalled => self.call_off(Cause::ReturnOrdered, now),
            Change::KillLifted => self.notice(Notice::KillLifted),
            Change::Held(paused) if self.phase.is_outward() => {
                self.notice(if paused { Notice::Paused } else { Notice::GoingOn });
            }
            Change::Held(_) => {}
            Change::StartPending => self.notice(Notice::StartOrdered),
            Change::StartExpired => self.notice(Notice::StartExpired { peer: self.settings.role.peer() }),
            Change::StartWithdrawn => self.call_off(Cause::StartWithdrawn(self.settings.role.peer()), now),
        }
    }

    /// No mission any more: not off the ground, or home.
    fn call_off(&mut self, cause: Cause, now: Instant) {
        if self.phase.is_outward() {
            if cause == Cause::ReturnOrdered {
                self.service.tell_silence(VeilwingSilence::VEILWING_SILENCE_OPERATOR, now);
            }
            self.abort(cause, now);
        } else if self.phase.is_on_the_ground() {
            self.ground.start.void(Void::TakenBack);
            self.notice(Notice::NotTakingOff(cause));
            if !self.phase.is_waiting() {
                self.autopilot.release(now);
                self.autopilot.disarm(now);
                self.service.orders_mut().stand_down();
                self.phase = Phase::Standby;
            }
        }
    }
}

/// What a command is called that the other vehicle did not confirm.
fn unconfirmed(command: MavCmd) -> Option<&'static str> {
    match command {
        MavCmd::MAV_CMD_USER_2 => Some("kill"),
        MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Some("return"),
        MavCmd::MAV_CMD_DO_PAUSE_CONTINUE => Some("pause or continue"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_an_order_that_may_go_unconfirmed_has_a_name_and_a_start_says_itself_what_becomes_of_it() {
        for (command, name) in [
            (MavCmd::MAV_CMD_USER_2, Some("kill")),
            (MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, Some("return")),
            (MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, Some("pause or continue")),
            (MavCmd::MAV_CMD_MISSION_START, None),
        ] {
            assert_eq!(unconfirmed(command), name);
        }
    }
}
