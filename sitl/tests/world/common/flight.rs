//! A flight of both vehicles, and what its judge says.

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavParamType, PARAM_SET_DATA};
use veilwing_sitl::*;

use super::{Client, attitude_target, config, pass, position_target};

/// A world with its two companions, flown by hand.
pub struct Flight {
    pub world: World,
    pub config: WorldConfig,
    pub clients: [Client; 2],
}

impl Flight {
    pub fn new(config: WorldConfig) -> Self {
        let world = World::new(config.clone()).expect("a valid world");
        Self { world, config, clients: [Client::companion(0), Client::companion(1)] }
    }

    /// At the first slot's poses, for long enough to be on station.
    pub fn at_slot(config: WorldConfig) -> Self {
        let mut flight = Self::new(config);
        flight.take_off();
        flight.go_to_slot(0);
        flight
    }

    pub fn pass(&mut self, ms: u64) {
        let [a, b] = &mut self.clients;
        pass(&mut self.world, &mut [a, b], ms);
    }

    pub fn position(&self, k: usize) -> [f64; 3] {
        self.world.snapshot().vehicles[k].position_enu_m
    }

    /// One setpoint pair for a vehicle at a point, with the slot's attitude if `tilt`.
    pub fn target(&mut self, k: usize, position: [f64; 3], tilt: Option<usize>) {
        let vehicle = &self.config.vehicles[k];
        let message = position_target(vehicle, position, None);
        self.clients[k].send(&mut self.world, &message);
        if let Some(slot) = tilt {
            let message = attitude_target(vehicle, &self.config.slots[slot].poses[k]);
            self.clients[k].send(&mut self.world, &message);
        }
    }

    /// Streams targets at 50 Hz for `ms`, `each` doing what else is to be done every 20 ms.
    pub fn stream(
        &mut self,
        ms: u64,
        targets: [[f64; 3]; 2],
        tilt: Option<usize>,
        mut each: impl FnMut(&mut Self),
    ) {
        for _ in 0..ms / 20 {
            for (k, target) in targets.iter().enumerate() {
                self.target(k, *target, tilt);
            }
            each(self);
            self.pass(20);
        }
    }

    /// OFFBOARD, armed, up to 25 m above home, on PX4's order.
    pub fn take_off(&mut self) {
        let up = [0, 1].map(|k| {
            let [e, n, u] = self.config.vehicles[k].home_enu_m;
            [e, n, u + 25.0]
        });
        self.pass(3000);
        self.stream(1200, up, None, |_| {});
        for k in 0..2 {
            self.clients[k].command(&mut self.world, MavCmd::MAV_CMD_DO_SET_MODE, &[1.0, 6.0]);
            self.clients[k].command(&mut self.world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[1.0]);
        }
        self.stream(12_000, up, None, |_| {});
    }

    /// To the poses of a slot, and there for long enough to be on station.
    pub fn go_to_slot(&mut self, slot: usize) {
        let goals = self.goals(slot);
        self.stream(15_000, goals, Some(slot), |_| {});
    }

    pub fn goals(&self, slot: usize) -> [[f64; 3]; 2] {
        let poses = &self.config.slots[slot].poses;
        [poses[0].position_enu_m, poses[1].position_enu_m]
    }

    pub fn planned_dbm(&self, slot: usize, k: usize) -> f64 {
        10.0 * self.config.slots[slot].poses[k].tx_power_w.log10() + 30.0
    }

    /// Holds the slot for `ms`, with the vehicles in `on` renewing their leases.
    pub fn hold(&mut self, slot: usize, ms: u64, on: [bool; 2]) {
        let goals = self.goals(slot);
        let dbm = [self.planned_dbm(slot, 0), self.planned_dbm(slot, 1)];
        self.stream(ms, goals, Some(slot), |flight| {
            for k in [1, 0] {
                if on[k] {
                    flight.clients[k].power(&mut flight.world, dbm[k], slot as i32, 300);
                }
            }
        });
    }

    pub fn off(&mut self, k: usize) {
        self.clients[k].power(&mut self.world, f64::NEG_INFINITY, 0, 0);
    }

    /// Sets a real parameter of the first vehicle's autopilot.
    pub fn set_real(&mut self, name: &str, value: f32) {
        self.set(name, value, MavParamType::MAV_PARAM_TYPE_REAL32);
    }

    /// Sets an integer of PX4's, of the first vehicle.
    pub fn set_int(&mut self, name: &str, value: u32) {
        self.set(name, f32::from_bits(value), MavParamType::MAV_PARAM_TYPE_INT32);
    }

    fn set(&mut self, name: &str, param_value: f32, param_type: MavParamType) {
        let set = PARAM_SET_DATA {
            param_value,
            target_system: 1,
            target_component: 1,
            param_id: name.into(),
            param_type,
        };
        self.clients[0].send(&mut self.world, &MavMessage::PARAM_SET(set));
    }

    pub fn invariants(&self) -> Vec<(&'static str, String)> {
        self.world.report().violations.into_iter().map(|v| (v.invariant().name(), v.to_string())).collect()
    }
}

/// Both on station, nobody on the air.
pub fn on_station(config: WorldConfig) -> Flight {
    let flight = Flight::at_slot(config);
    assert_eq!(flight.invariants(), vec![]);
    flight
}

/// The invariants that were broken.
pub fn names(flight: &Flight) -> Vec<&'static str> {
    let mut names: Vec<_> = flight.invariants().into_iter().map(|(name, _)| name).collect();
    names.sort_unstable();
    names
}

/// Both on the air in the slot.
pub fn on_the_air() -> Flight {
    let mut flight = on_station(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 500, [true, true]);
    flight
}

/// Milliseconds: unprotected in all; excused, by cause; of violations of S1's jam.
pub fn unprotected_ms(flight: &Flight) -> (u128, Vec<(&'static str, u128)>, u128) {
    let report = flight.world.report();
    let of = |violation: &Violation| matches!(violation.breach, Breach::Unprotected);
    let excused = report.excused.iter().filter(|excused| of(&excused.violation));
    let counted = report.violations.iter().filter(|violation| of(violation));
    (
        (report.unprotected_s * 1000.0).round() as u128,
        excused.map(|excused| (excused.cause.name(), excused.duration().as_millis())).collect(),
        counted.map(|violation| violation.lasted.as_millis()).sum(),
    )
}
