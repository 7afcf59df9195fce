//! What the two vehicles are to do.

use std::time::Duration;

use veilwing::geo::{Enu, Pose};
use veilwing::pair::{PlanTerms, SlotTerms};
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::track::{Followed, Track};
use veilwing::planner::turning::{Between, Course, Knot, Protected, Slot};
use veilwing::role::{PerVehicle, Role};

pub const POSE: Pose =
    Pose { position_enu_m: Enu::new(1.0, 2.0, 80.0), roll_rad: 0.5, pitch_rad: 0.1, yaw_rad: 0.0 };
pub const POWER_W: f64 = 0.5;

/// From when a slot is agreed on to its opening, at least.
const NEEDS: Duration = Duration::from_secs(1);
/// A slot that is held stays open longer than any input lasts.
const HELD: Duration = Duration::from_secs(100_000);
/// A slot that is served through a turn, of which a guard is silence, and from its close to the next opening.
const TURNED: Duration = Duration::from_millis(1500);
const GUARD: Duration = Duration::from_millis(400);
const BETWEEN: Duration = Duration::from_millis(100);
const SLOTS: u16 = 6;

fn vehicles(turned_rad: f64) -> PerVehicle<VehiclePlan> {
    let vehicle =
        VehiclePlan { pose: Pose { roll_rad: POSE.roll_rad + turned_rad, ..POSE }, tx_power_w: POWER_W };
    PerVehicle { i: vehicle, j: vehicle }
}

fn terms(length: Duration, guard: Duration) -> SlotTerms {
    SlotTerms {
        anew: None,
        vehicles: vehicles(0.0),
        tracks: None,
        lean_rad: PerVehicle { i: 0.0, j: 0.0 },
        jitter: None,
        opens: NEEDS,
        lead: NEEDS,
        carries_on_after: None,
        radiate_from: guard / 2,
        radiate_until: length - guard / 2,
        length,
    }
}

/// Three slots, all alike, each held in one pose.
pub fn held() -> PlanTerms {
    PlanTerms { digest: [2; 32], slots: vec![terms(HELD, Duration::ZERO); 3] }
}

/// A slot whose motion is made anew: in its beginning both rest.
pub fn followed() -> PlanTerms {
    let track = |role: Role| Track::Followed(Followed::new(role, vehicles(0.0)[role]));
    let slot = SlotTerms { tracks: Some(PerVehicle::from_fn(track)), ..terms(HELD, Duration::ZERO) };
    PlanTerms { digest: [4; 32], slots: vec![slot; 3] }
}

/// Slots that carry each other on: both vehicles turn a little while they radiate, and on in silence; J's power changes with
/// each half.
pub fn through_turns() -> PlanTerms {
    let (on_air_s, silence_s) = ((TURNED - GUARD).as_secs_f64(), (GUARD + BETWEEN).as_secs_f64());
    let slot = |slot: u16| {
        let (begins_s, turned_rad) = ((on_air_s + silence_s) * f64::from(slot), 0.05 * f64::from(slot % 2));
        let knots = [(0.0, 0.2), (0.5, 1.0), (1.0, 0.0)].map(|(share, of_power)| {
            let mut vehicles = vehicles(turned_rad + 0.05 * share);
            vehicles.j.tx_power_w *= of_power;
            let at_s = begins_s + share * on_air_s;
            Knot { at_s, vehicles, served: Some(slot.into()), rate_bps: 1e6, tolerance: None }
        });
        let between = Between::Turn(PerVehicle { i: Course::Shortest, j: Course::EvenAngles });
        Slot {
            user: slot.into(),
            on_air_s,
            silence_s,
            between,
            volume_bits: 1e6 * on_air_s,
            knots: knots.to_vec(),
        }
    };
    let superframe_s = (on_air_s + silence_s) * f64::from(SLOTS);
    let slots = (0..SLOTS).map(slot).collect();
    let tracks = Protected { slots, superframe_s }.tracks(GUARD.as_secs_f64());
    let terms = tracks.into_iter().enumerate().map(|(slot, tracks)| SlotTerms {
        tracks: Some(tracks),
        carries_on_after: (slot > 0).then_some(BETWEEN),
        ..terms(TURNED, GUARD)
    });
    PlanTerms { digest: [3; 32], slots: terms.collect() }
}
