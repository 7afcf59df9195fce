//! The mission that is flown, and what the service is told of it.

use std::time::Duration;

use veilwing::geo::{Enu, Pose};
use veilwing::pair::{self, PlanTerms, SlotTerms};
use veilwing::planner::plan::VehiclePlan;
use veilwing::role::{PerVehicle, Role};
use veilwing::service::{Ceilings, Freshness, Settings, SlotService, Tolerance, Vehicle};
use veilwing::time::Instant;
use veilwing::transmitter::{self, Kind, Transmitter};

/// From the start of a transit to the opening of its slot; the vehicle has arrived after half of it.
pub const LEAD: Duration = Duration::from_secs(2);
pub const SLOT: Duration = Duration::from_secs(3);
pub const GUARD: Duration = Duration::from_secs(1);
pub const LEASE: Duration = Duration::from_millis(500);
pub const SLOTS: u16 = 8;
/// Between two messages of state, and between two decisions.
pub const TICK: Duration = Duration::from_millis(20);
/// Planned powers; I's vehicle file allows less (S6).
pub const PLANNED_W: PerVehicle<f64> = PerVehicle { i: 0.5, j: 0.25 };
pub const CAP_W: PerVehicle<f64> = PerVehicle { i: 0.4, j: 1.0 };

/// Poses and powers of a slot.
fn vehicles(slot: u16) -> PerVehicle<VehiclePlan> {
    let vehicle = |x: f64, tx_power_w| {
        let position_enu_m = Enu::new(x, 10.0, 80.0);
        VehiclePlan {
            pose: Pose { position_enu_m, roll_rad: 0.7, pitch_rad: -0.2, yaw_rad: 0.0 },
            tx_power_w,
        }
    };
    let slot = f64::from(slot);
    PerVehicle { i: vehicle(slot * 7.1, PLANNED_W.i), j: vehicle(100.0 + slot * 3.3, PLANNED_W.j) }
}

/// The plan of `SLOTS` slots of this length.
fn plan(length: Duration) -> PlanTerms {
    let terms = |slot: u16| SlotTerms {
        vehicles: vehicles(slot),
        tracks: None,
        lean_rad: PerVehicle { i: 0.0, j: 0.0 },
        opens: (LEAD + length) * u32::from(slot) + LEAD,
        lead: LEAD,
        carries_on_after: None,
        radiate_from: GUARD / 2,
        radiate_until: length - GUARD / 2,
        length,
    };
    PlanTerms { digest: [7; 32], slots: (0..SLOTS).map(terms).collect() }
}

/// A vehicle whose state came last at `since`, in its pose for the slot, or ten metres off it.
pub fn vehicle(role: Role, slot: u16, since: Instant, pose_lost: bool) -> Vehicle {
    let pose = vehicles(slot)[role].pose;
    let off = Enu::new(if pose_lost { 10.0 } else { 0.0 }, 0.0, 0.0);
    Vehicle {
        state_received_at: Some(since),
        state_taken_from: Some(since),
        state_period: TICK,
        position_enu_m: Some(pose.position_enu_m + off),
        attitude: Some((pose.attitude(), since)),
        in_control: true,
        estimator_ok: true,
        home_enu_m: Some(Enu::zeros()),
        preflight_ok: true,
        ..Vehicle::default()
    }
}

/// MAVLink system of a vehicle.
pub fn system(role: Role) -> u8 {
    match role {
        Role::I => 1,
        Role::J => 2,
    }
}

/// A radio that takes numbered commands, as it is flown.
pub const NUMBERED: Kind = Kind::Numbered { command: 31010 };

/// The service of a companion that has just started, with this lease and slots of this length.
pub fn service(role: Role, boot_id: u32, kind: Kind, lease: Duration, slot: Duration) -> SlotService {
    let pair = pair::Settings {
        role,
        boot_id,
        mission_digest: [3; 32],
        lease,
        peer_timeout: Duration::from_secs(3),
        clock_tolerance: GUARD / 4,
        orders: pair::Record::default(),
    };
    let radio = transmitter::Settings {
        own: (system(role), 191),
        target: (system(role), 68),
        kind,
        boot: boot_id,
        longest_round_trip: LEASE * 3 / 10,
        apart: false,
        system_is_given: false,
        first_off_after: if role == Role::J { LEASE } else { Duration::ZERO },
    };
    let settings = Settings {
        pair,
        ceilings: Ceilings { mission_w: 1.0, vehicle_w: CAP_W[role] },
        emission_authorised: true,
        freshness: Freshness { limit: Duration::from_millis(250), scheduling_allowance: Duration::ZERO },
    };
    let transmitter = Transmitter::new(radio, Instant::ZERO);
    let mut service = SlotService::new(settings, transmitter, Tolerance::for_jitter(0.0), Instant::ZERO);
    service.set_plan(plan(slot));
    service
}
