//! An operator's order: said to a companion, and said again until it answers.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavMessage, MavResult};

use super::vehicle::Id;
use crate::desk::Order;
use crate::time::Instant;

impl Order {
    /// What it is called.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Pause => "pause",
            Self::Continue => "continue",
            Self::Return => "return",
            Self::Kill => "KILL",
            Self::Lift => "lift the kill",
        }
    }

    /// What it does, for the question before it.
    pub(super) fn question(self) -> &'static str {
        match self {
            Self::Start => "START the mission?",
            Self::Pause => "PAUSE: silent, holding?",
            Self::Continue => "CONTINUE?",
            Self::Return => "RETURN: silent, both home?",
            Self::Kill => "KILL both radios?",
            Self::Lift => "LIFT the radio kill at both?",
        }
    }

    /// Said again after so long without an answer.
    fn again_after(self) -> Duration {
        match self {
            Self::Kill => Duration::from_millis(200),
            _ => Duration::from_secs(1),
        }
    }

    /// Said so often at the most: a kill for half a minute.
    fn most(self) -> u32 {
        match self {
            Self::Kill => 150,
            _ => 6,
        }
    }
}

/// A companion answers what it has taken up within 10 s, and a START that expires within this.
const ANSWERED_WITHIN: Duration = Duration::from_secs(40);

/// How an order has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum End {
    /// It was answered for good.
    Answered(MavResult),
    /// It was not.
    Unanswered,
}

/// One order to one companion.
#[derive(Debug, Clone)]
pub(super) struct Asked {
    pub order: Order,
    pub to: Id,
    /// What the operator sees the companion as.
    pub whom: String,
    pub since: Instant,
    sent: u32,
    next: Instant,
    /// It has said that it is under way.
    pub under_way: bool,
    pub end: Option<(End, Instant)>,
}

impl Asked {
    pub fn new(order: Order, to: Id, whom: String, now: Instant) -> Self {
        Self { order, to, whom, since: now, sent: 0, next: now, under_way: false, end: None }
    }

    /// What is to be sent now.
    pub fn poll(&mut self, component: u8, now: Instant) -> Option<MavMessage> {
        if self.end.is_some() {
            return None;
        }
        let late = now.saturating_since(self.since) > ANSWERED_WITHIN;
        if late || !self.under_way && self.sent >= self.order.most() && now >= self.next {
            self.end = Some((End::Unanswered, now));
            return None;
        }
        if self.under_way || now < self.next {
            return None;
        }
        self.next = now + self.order.again_after();
        let confirmation = u8::try_from(self.sent).unwrap_or(u8::MAX);
        self.sent += 1;
        let (command, param1) = self.order.command();
        Some(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            command,
            target_system: self.to.system,
            target_component: component,
            confirmation,
            ..COMMAND_LONG_DATA::default()
        }))
    }

    /// Takes an answer of this companion. Whether it has ended the order.
    pub fn answer(&mut self, ack: &COMMAND_ACK_DATA, now: Instant) -> bool {
        if self.end.is_some() || ack.command != self.order.command().0 {
            return false;
        }
        if ack.result == MavResult::MAV_RESULT_IN_PROGRESS {
            self.under_way = true;
            return false;
        }
        self.end = Some((End::Answered(ack.result), now));
        true
    }

    /// How it stands, in words.
    pub fn words(&self, now: Instant) -> String {
        let until = self.end.map_or(now, |(_, at)| at);
        let took = until.saturating_since(self.since).as_secs_f64();
        let (what, whom) = (self.order.name(), &self.whom);
        match self.end {
            None if self.under_way => format!("{what}: {whom} has it, not done yet, {took:.1} s"),
            None => format!("{what}: sent to {whom} ({}), {took:.1} s", self.sent),
            Some((End::Answered(MavResult::MAV_RESULT_ACCEPTED), _)) => {
                format!("{what}: done by {whom} after {took:.2} s")
            }
            Some((End::Answered(result), _)) => format!("{what}: {whom} {} ({took:.2} s)", refusal(result)),
            Some((End::Unanswered, _)) => {
                format!("{what}: NO ANSWER from {whom} in {took:.0} s, {} times sent", self.sent)
            }
        }
    }

    /// Whether it has gone wrong.
    pub fn failed(&self) -> bool {
        self.end.is_some_and(|(end, _)| end != End::Answered(MavResult::MAV_RESULT_ACCEPTED))
    }
}

/// What a companion means by an answer that is no yes.
fn refusal(result: MavResult) -> &'static str {
    match result {
        MavResult::MAV_RESULT_DENIED => "REFUSES it; its message says why",
        MavResult::MAV_RESULT_FAILED => "has taken it, and it has NOT come about at both vehicles",
        MavResult::MAV_RESULT_UNSUPPORTED => "does not know it: is that a companion?",
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED => "cannot now",
        _ => "answers neither yes nor no",
    }
}
