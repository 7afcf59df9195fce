//! Operator's orders taken two at a time, to either vehicle, over a pair link that is cut or not, with a companion that
//! restarts or not: what each pair of orders did, and whether what must never happen happened.

use std::fmt;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, MavResult};
use veilwing::desk::Order;
use veilwing::desk::simulation::Path;
use veilwing::mission::Outcome;
use veilwing::role::Role;

use crate::harness::{Flight, Setup};

/// From the first order to the second.
const APART: Duration = Duration::from_secs(1);
/// A cut that the other vehicle is not lost over, and one over which it is.
const SHORT: Duration = Duration::from_millis(2500);
const LONG: Duration = Duration::from_secs(20);
/// After the second order everything has come to its end: a START expires in 30 s, a vehicle without a slot goes home after
/// 90 s, the way home takes less than a minute for each.
const PATIENCE: Duration = Duration::from_secs(230);

/// On the ground a pause and a return take back a START. Lifting the kill is another table's.
const TOLD: [Order; 5] = [Order::Start, Order::Pause, Order::Continue, Order::Return, Order::Kill];

/// When the pair link is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Link {
    Up,
    CutBefore,
    CutBetween,
    CutAfter,
    CutForLong,
}

impl Link {
    pub const ALL: [Self; 5] =
        [Self::Up, Self::CutBefore, Self::CutBetween, Self::CutAfter, Self::CutForLong];
}

#[derive(Debug, Clone, Copy)]
pub struct Case {
    /// In the middle of a slot; else on the ground, ready.
    pub in_slot: bool,
    pub first: (Order, Role),
    pub second: (Order, Role),
    pub link: Link,
    /// Whose companion dies and comes back after the second order.
    pub restarted: Option<Role>,
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = if self.in_slot { "slot" } else { "ground" };
        let ((a, to_a), (b, to_b)) = (self.first, self.second);
        write!(
            f,
            "{place}: {a:?} to {to_a}, {b:?} to {to_b}, link {:?}, restarted {:?}",
            self.link, self.restarted
        )
    }
}

/// Every case there is.
pub fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for in_slot in [false, true] {
        for first in TOLD {
            for second in TOLD {
                for to in [(Role::I, Role::I), (Role::I, Role::J), (Role::J, Role::I), (Role::J, Role::J)] {
                    for link in Link::ALL {
                        for restarted in [None, Some(Role::I), Some(Role::J)] {
                            let (first, second) = ((first, to.0), (second, to.1));
                            cases.push(Case { in_slot, first, second, link, restarted });
                        }
                    }
                }
            }
        }
    }
    cases
}

/// What came of a case.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// Of the two orders: acknowledged as having come about.
    pub accepted: [bool; 2],
    /// Vehicles that took off after the first order.
    pub took_off: usize,
    /// Missions flown to their end.
    pub completed: usize,
    /// Vehicles in the air at the end.
    pub in_the_air: usize,
    /// The longest that one was in the air while the other was on the ground.
    pub alone: Duration,
    /// What must never be.
    pub wrong: Vec<String>,
}

fn cut(flight: &mut Flight, cut: bool) {
    let path = if cut { Path { loss: 1.0, ..Path::GOOD } } else { Path::GOOD };
    Role::BOTH.into_iter().for_each(|role| flight.set_pair_path(role, path));
}

/// When an order was acknowledged as having come about.
fn accepted_at(flight: &Flight, (told, role): (Order, Role), since: Duration) -> Option<Duration> {
    let (command, _) = told.command();
    flight.log.acks.iter().find_map(|(at, who, message)| match message {
        MavMessage::COMMAND_ACK(ack) if *who == role && ack.command == command && *at >= since => {
            (ack.result == MavResult::MAV_RESULT_ACCEPTED).then_some(*at)
        }
        _ => None,
    })
}

pub fn run(case: &Case) -> Seen {
    let mut flight = Flight::new(Setup { start_unasked: case.in_slot, ..Setup::default() });
    if case.in_slot {
        assert!(flight.until(|flight| flight.radiating() == [true, true]), "{}", flight.story());
        flight.pass(Duration::from_millis(500));
    } else {
        flight.pass(Duration::from_secs(20));
    }
    let begun = flight.now;
    let mut seen = Seen::default();
    let mut watch = Watch::default();
    if matches!(case.link, Link::CutBefore | Link::CutForLong) {
        cut(&mut flight, true);
        watch.pass(&mut flight, Duration::from_millis(300));
    }
    let given = [case.first, case.second].map(|(told, to)| {
        let (command, param1) = told.command();
        let at = flight.now;
        flight.command_with(to, command, param1);
        if (told, to) == case.first && at < begun + APART {
            watch.pass(&mut flight, APART / 2);
            if case.link == Link::CutBetween {
                cut(&mut flight, true);
            }
            watch.pass(&mut flight, APART / 2);
        }
        at
    });
    if case.link == Link::CutAfter {
        cut(&mut flight, true);
    }
    if let Some(role) = case.restarted {
        // Over what the other's loss costs by itself.
        watch.pass(&mut flight, Duration::from_millis(900));
        flight.kill(role);
        flight.start(role);
    }
    let length = if case.link == Link::CutForLong { LONG } else { SHORT };
    let rest = (begun + length).saturating_sub(flight.now);
    watch.pass(&mut flight, rest);
    cut(&mut flight, false);
    watch.pass(&mut flight, PATIENCE);
    let accepted = [accepted_at(&flight, case.first, given[0]), accepted_at(&flight, case.second, given[1])];
    seen.accepted = accepted.map(|at| at.is_some());
    seen.took_off = watch.took_off.iter().filter(|at| at.is_some()).count();
    let completed = |role: &Role| flight.outcomes[*role] == Some(Outcome::Completed);
    seen.completed = usize::from(Role::BOTH.iter().all(completed));
    seen.in_the_air = Role::BOTH.into_iter().filter(|role| !flight.landed(*role)).count();
    seen.alone = watch.alone_longest;
    seen.wrong = wrong(case, &flight, &watch, accepted);
    seen
}

fn wrong(case: &Case, flight: &Flight, watch: &Watch, accepted: [Option<Duration>; 2]) -> Vec<String> {
    let mut wrong = Vec::new();
    let report = flight.report();
    wrong.extend(report.violations.iter().map(|violation| format!("{violation:?}")));
    let unprotected: f64 = report.slots.iter().map(|slot| slot.unprotected_s).sum();
    if unprotected > 0.0 {
        wrong.push(format!("unprotected for {unprotected} s"));
    }
    for ((told, to), at) in [case.first, case.second].into_iter().zip(accepted) {
        let Some(at) = at.filter(|_| told == Order::Kill) else { continue };
        if flight.log.on_air.iter().any(|(when, on)| *when >= at && *on != [false, false]) {
            wrong.push(format!("on the air after the kill that {to} accepted at {at:?}"));
        }
        if watch.took_off.iter().flatten().any(|when| *when > at) {
            wrong.push(format!("took off after the kill that {to} accepted at {at:?}"));
        }
    }
    // A vehicle whose companion came back in the air is its autopilot's and its pilot's.
    let ours = |role: &Role| {
        case.restarted != Some(*role) || !case.in_slot && watch.took_off[*role as usize].is_none()
    };
    let paused = |role: &Role| flight.said(*role, "paused by the operator").is_some();
    for role in Role::BOTH.iter().filter(|role| ours(role) && !flight.landed(**role)) {
        if !Role::BOTH.iter().all(paused) {
            wrong.push(format!("vehicle {role} is still in the air"));
        }
    }
    wrong
}

/// Looks at the vehicles all the time.
#[derive(Debug, Default)]
struct Watch {
    was_landed: Option<[bool; 2]>,
    took_off: [Option<Duration>; 2],
    alone: Duration,
    alone_longest: Duration,
}

impl Watch {
    fn pass(&mut self, flight: &mut Flight, time: Duration) {
        const STEP: Duration = Duration::from_millis(100);
        let end = flight.now + time;
        while flight.now < end {
            flight.pass(STEP.min(end - flight.now));
            let landed = Role::BOTH.map(|role| flight.landed(role));
            let was = self.was_landed.replace(landed).unwrap_or(landed);
            for k in 0..2 {
                if was[k] && !landed[k] {
                    self.took_off[k].get_or_insert(flight.now);
                }
            }
            self.alone = if landed[0] == landed[1] { Duration::ZERO } else { self.alone + STEP };
            self.alone_longest = self.alone_longest.max(self.alone);
        }
    }
}
