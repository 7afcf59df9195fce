//! A slot that is served through its turns, and perhaps in motion, told to the simulated world: its course beforehand, its opening as it is proposed.

use veilwing_sitl as sim;

use crate::link::Envelope;
use crate::link::codec::Decoder;
use crate::link::counters::Counters;
use crate::link::envelope::Enclosed;
use crate::pair::wire::MavMessage;
use crate::planner::moving::Spline;
use crate::planner::turning::Slot;
use crate::role::{PerVehicle, Role};
use crate::schedule::table::Entry;

/// Reads from vehicle I's datagrams to its peer when slots are proposed to open, and by what clock.
#[derive(Debug, Clone, Default)]
pub struct Proposals {
    frames: Decoder<Envelope>,
    counters: Counters,
}

impl Proposals {
    /// Takes a datagram, and tells the world what is proposed or said of the clock in it.
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

/// Tells the world if a message of vehicle I's to its peer proposes a slot, or says what its clock shows.
pub(super) fn tell_proposal(message: &MavMessage, world: &mut sim::World) {
    match message {
        MavMessage::VEILWING_PROPOSE(propose) => {
            world.propose(usize::from(propose.slot), propose.opens_utc_us)
        }
        MavMessage::VEILWING_CLOCK(request) if request.receive_us == 0 => {
            world.hear_clock(request.originate_us)
        }
        MavMessage::VEILWING_CLOCK(reply) => world.hear_clock(reply.transmit_us),
        _ => {}
    }
}

/// A slot of the plan as the table has it.
pub(super) fn planned(
    slot: &Slot,
    ways: Option<&PerVehicle<Spline>>,
    entry: &Entry,
    guard_s: f64,
) -> sim::PlannedTurns {
    let since_opening_s = |at_s: f64| at_s - slot.knots.first().map_or(0.0, |knot| knot.at_s) + guard_s / 2.0;
    let length_s = (entry.closes - entry.opens).as_secs_f64();
    let opens_s = slot.knots.first().map_or(0.0, |knot| knot.at_s) - guard_s / 2.0;
    let places = (length_s / sim::PLACES_S).ceil() as usize;
    let places = |way: &Spline| {
        let at = |k: usize| way.position(opens_s + sim::PLACES_S * k as f64);
        (0..=places).map(|k| at(k).into()).collect::<Vec<_>>()
    };
    sim::PlannedTurns {
        carries_on_after_s: entry.carries_on_after.map(|after| after.as_secs_f64()),
        length_s,
        places_enu_m: Role::BOTH.map(|role| ways.map(|ways| places(&ways[role])).unwrap_or_default()),
        knots: Role::BOTH.map(|role| {
            let knots = slot.knots.iter().map(|knot| {
                let vehicle = &knot.vehicles[role];
                sim::PlannedKnot {
                    at_s: since_opening_s(knot.at_s),
                    angles_rad: [vehicle.pose.roll_rad, vehicle.pose.pitch_rad, vehicle.pose.yaw_rad],
                    tx_power_w: vehicle.tx_power_w,
                }
            });
            knots.collect()
        }),
    }
}
