//! A slot that is served through its turns, told to the simulated world: its course beforehand, its opening as it is proposed.

use veilwing_sitl as sim;

use crate::link::Envelope;
use crate::link::codec::Decoder;
use crate::link::counters::Counters;
use crate::link::envelope::Enclosed;
use crate::pair::wire::MavMessage;
use crate::planner::turning::{Between, Course, Knot, Protected};
use crate::role::Role;
use crate::schedule::table::Entry;

/// Reads from vehicle I's datagrams to its peer when slots are proposed to open.
#[derive(Debug, Clone, Default)]
pub struct Proposals {
    frames: Decoder<Envelope>,
    counters: Counters,
}

impl Proposals {
    /// Takes a datagram, and tells the world what is proposed in it.
    pub fn hear(&mut self, bytes: &[u8], world: &mut sim::World) {
        self.frames.feed(bytes);
        self.frames.end();
        while let Some(raw) = self.frames.next_frame(&mut self.counters) {
            if let Ok(frame) = raw.parse::<Envelope>() {
                let (Enclosed::Plain(message) | Enclosed::Tunnel { message, .. }) = frame.message;
                tell_proposal(&message, world);
            }
        }
    }
}

/// Tells the world if a message of vehicle I's to its peer proposes a slot.
pub(super) fn tell_proposal(message: &MavMessage, world: &mut sim::World) {
    if let MavMessage::VEILWING_PROPOSE(propose) = message {
        world.propose(usize::from(propose.slot), propose.opens_utc_us);
    }
}

/// The slot at a place of the superframe; `carried_on` by the one after it.
pub(super) fn planned(
    turns: &Protected,
    place: usize,
    entry: &Entry,
    carried_on: bool,
    guard_s: f64,
) -> sim::PlannedTurns {
    let all = turns.slots.len();
    let (slot, before, next) =
        (&turns.slots[place], &turns.slots[(place + all - 1) % all], &turns.slots[(place + 1) % all]);
    let begins_s = guard_s / 2.0;
    let since_opening_s = |at_s: f64| at_s - slot.knots.first().map_or(0.0, |knot| knot.at_s) + begins_s;
    let served = |role: Role| {
        let to_the_last = slot.knots.len().saturating_sub(1);
        let knots = slot.knots.iter().enumerate().map(|(k, knot)| {
            let course = if k < to_the_last { Course::EvenAngles } else { silent(slot.between, role) };
            planned_knot(knot, role, since_opening_s(knot.at_s), course)
        });
        knots.collect()
    };
    let left = before.knots.last().filter(|_| entry.carries_on_after.is_some());
    let reached = next.knots.first().filter(|_| carried_on);
    let [left_s, reached_s] = [begins_s - before.silence_s, begins_s + slot.on_air_s + slot.silence_s];
    sim::PlannedTurns {
        carries_on_after_s: entry.carries_on_after.map(|after| after.as_secs_f64()),
        length_s: (entry.closes - entry.opens).as_secs_f64(),
        knots: Role::BOTH.map(served),
        before: left.map(|knot| Role::BOTH.map(|role| planned_knot(knot, role, left_s, silent(before.between, role)))),
        after: reached.map(|knot| Role::BOTH.map(|role| planned_knot(knot, role, reached_s, Course::EvenAngles))),
    }
}

/// How a vehicle turns after its slot.
fn silent(between: Between, role: Role) -> Course {
    match between {
        Between::Turn(courses) => courses[role],
        Between::Transit => Course::EvenAngles,
    }
}

fn planned_knot(knot: &Knot, role: Role, at_s: f64, course: Course) -> sim::PlannedKnot {
    let vehicle = &knot.vehicles[role];
    sim::PlannedKnot {
        at_s,
        angles_rad: [vehicle.pose.roll_rad, vehicle.pose.pitch_rad, vehicle.pose.yaw_rad],
        tx_power_w: vehicle.tx_power_w,
        turn: match course {
            Course::EvenAngles => sim::Turn::EvenAngles,
            Course::Shortest => sim::Turn::Shortest,
        },
    }
}
