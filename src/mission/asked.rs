//! Operator's commands that are not answered for good yet: an order is acknowledged only with what has happened, at both
//! vehicles.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};

use crate::pair::orders::Order;
use crate::reply::acknowledgement;
use crate::time::Instant;

/// What takes longer than this is said to be under way.
const PATIENCE: Duration = Duration::from_millis(500);
/// The other vehicle, if it is there, has this long to show that it has an order. The order stands even if it does not.
const CONFIRMED_WITHIN: Duration = Duration::from_secs(10);
/// More that wait than this are forgotten, the oldest first: nobody has asked so much in so little time.
const MOST: usize = 16;

/// How far an order has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Progress {
    /// Not known to have come about at both vehicles.
    Open,
    /// It has.
    Done,
    /// It will not any more.
    Void,
}

#[derive(Debug, Clone, Copy)]
struct Asked {
    by: (u8, u8),
    command: MavCmd,
    order: Order,
    number: u32,
    since: Instant,
    told: bool,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct AskedFor(Vec<Asked>);

impl AskedFor {
    /// An order of `by` has got its number, and will be answered.
    pub fn note(&mut self, by: (u8, u8), command: MavCmd, (order, number): (Order, u32), now: Instant) {
        self.0.retain(|asked| (asked.by, asked.command) != (by, command));
        if self.0.len() == MOST {
            self.0.remove(0);
        }
        self.0.push(Asked { by, command, order, number, since: now, told: false });
    }

    /// The answers that are due, by the progress of each order.
    pub fn answers(&mut self, progress: impl Fn(Order, u32) -> Progress, now: Instant) -> Vec<MavMessage> {
        let mut answers = Vec::new();
        self.0.retain_mut(|asked| {
            let waited = now.saturating_since(asked.since);
            let result = match progress(asked.order, asked.number) {
                Progress::Done => MavResult::MAV_RESULT_ACCEPTED,
                Progress::Void => MavResult::MAV_RESULT_FAILED,
                // A START expires by itself.
                Progress::Open if asked.order != Order::Start && waited > CONFIRMED_WITHIN => {
                    MavResult::MAV_RESULT_FAILED
                }
                Progress::Open if waited > PATIENCE && !asked.told => {
                    asked.told = true;
                    MavResult::MAV_RESULT_IN_PROGRESS
                }
                Progress::Open => return true,
            };
            answers.push(acknowledgement(asked.by, asked.command, result));
            result == MavResult::MAV_RESULT_IN_PROGRESS
        });
        answers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KILL: MavCmd = MavCmd::MAV_CMD_USER_2;

    fn results(answers: &[MavMessage]) -> Vec<MavResult> {
        let result = |message: &MavMessage| match message {
            MavMessage::COMMAND_ACK(ack) => ack.result,
            other => panic!("{other:?}"),
        };
        answers.iter().map(result).collect()
    }

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[test]
    fn spec_an_order_is_answered_when_it_has_come_about_and_once() {
        let mut asked = AskedFor::default();
        asked.note((255, 190), KILL, (Order::Kill, 3), at(0));
        assert!(asked.answers(|_, _| Progress::Open, at(500)).is_empty());
        let open = asked.answers(|_, _| Progress::Open, at(501));
        assert_eq!(results(&open), [MavResult::MAV_RESULT_IN_PROGRESS]);
        assert!(asked.answers(|_, _| Progress::Open, at(900)).is_empty());
        let done =
            |order, number| if (order, number) == (Order::Kill, 3) { Progress::Done } else { Progress::Open };
        assert_eq!(results(&asked.answers(done, at(901))), [MavResult::MAV_RESULT_ACCEPTED]);
        assert!(asked.answers(done, at(902)).is_empty());
    }

    #[test]
    fn spec_what_the_other_never_confirms_or_what_is_void_has_failed() {
        let mut asked = AskedFor::default();
        asked.note((255, 190), KILL, (Order::Kill, 1), at(0));
        asked.note((254, 190), KILL, (Order::Start, 2), at(0));
        let start_lives = |_, _| Progress::Open;
        assert_eq!(asked.answers(start_lives, at(600)).len(), 2);
        assert!(asked.answers(start_lives, at(10_000)).is_empty());
        assert_eq!(results(&asked.answers(start_lives, at(10_001))), [MavResult::MAV_RESULT_FAILED]);
        assert_eq!(
            results(&asked.answers(|_, _| Progress::Void, at(10_002))),
            [MavResult::MAV_RESULT_FAILED]
        );
    }

    #[test]
    fn spec_the_same_asked_again_is_answered_once_and_a_flood_forgets_the_oldest() {
        let mut asked = AskedFor::default();
        for k in 0..40 {
            asked.note((k, 190), KILL, (Order::Kill, 1), at(0));
            asked.note((k, 190), KILL, (Order::Kill, 1), at(0));
        }
        assert_eq!(asked.answers(|_, _| Progress::Done, at(1)).len(), MOST);
    }
}
