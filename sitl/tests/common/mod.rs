//! The least that can fly a software vehicle: an in-test companion, in virtual time.
// Each test binary uses its own part; helpers of tests may panic as tests may.
#![allow(dead_code, clippy::expect_used)]

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message};
use nalgebra::UnitQuaternion;
use veilwing_sitl::*;

pub const PX4_OFFBOARD: u32 = 6 << 16;

/// Two users, two eavesdroppers, one tilted slot; vehicles with homes and local origins of their own.
pub fn config() -> WorldConfig {
    let pose = |position_enu_m, roll_deg: f64, pitch_deg: f64, tx_power_w| PlannedPose {
        position_enu_m,
        roll_rad: roll_deg.to_radians(),
        pitch_rad: pitch_deg.to_radians(),
        yaw_rad: 0.0,
        tx_power_w,
        lean_deg: 0.0,
    };
    let mut i = VehicleConfig::new(Role::I);
    i.home_enu_m = [-30.0, 10.0, 0.0];
    i.local_origin_offset_enu_m = [3.0, -2.0, 0.5];
    let mut j = VehicleConfig::new(Role::J);
    j.home_enu_m = [40.0, -20.0, 1.0];
    j.local_origin_offset_enu_m = [-1.0, 4.0, 0.0];
    WorldConfig {
        seed: 7,
        origin: Origin { lat_deg: 50.0755, lon_deg: 14.4378, alt_amsl_m: 200.0 },
        utc_start_us: 1_790_000_000_000_000,
        vehicles: [i, j],
        users: vec![exactly("alpha", [0.0; 3])],
        eavesdroppers: vec![exactly("hill", [120.0, -40.0, 0.0]), exactly("roof", [-60.0, 100.0, 0.0])],
        radio: RadioConfig {
            bandwidth_hz: 1e6,
            noise_power_w: 1e-12,
            reference_gain: 1.0,
            max_power_w: [0.5, 0.5],
        },
        fading: Fading::default(),
        airspace: AirspaceConfig {
            altitude_m: [20.0, 300.0],
            area_enu_m: vec![[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]],
            no_fly: Vec::new(),
            min_separation_m: 5.0,
        },
        jitter: JitterConfig::default(),
        slots: vec![PlannedSlot {
            turns: None,
            user: "alpha".into(),
            secrecy_rate_bps: 20e6,
            poses: [pose([-20.0, 15.0, 30.0], 60.0, -20.0, 0.4), pose([25.0, -30.0, 40.0], 0.0, 0.0, 0.01)],
        }],
        tolerance: Tolerance::default(),
    }
}

/// A receiver where it is said to be.
pub fn exactly(name: &str, position_enu_m: [f64; 3]) -> Node {
    Node { name: name.into(), position_enu_m, uncertainty: Uncertainty::Exact, roams: None }
}

/// A client of one vehicle on one link.
pub struct Client {
    pub vehicle: usize,
    pub link: usize,
    pub header: MavHeader,
    /// Everything received, by sender's component.
    pub received: Vec<(u8, MavMessage)>,
    /// The radio's own message, each time, and whether it came in TUNNEL.
    pub reports: Vec<(RadioReport, bool)>,
}

/// What the radio says of itself, read by the message's definition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RadioReport {
    pub time_ms: u32,
    pub boot: u32,
    pub newest: u32,
    pub answers: (u32, u32),
    pub series: u32,
    pub power_mdbm: i32,
    pub result: u8,
}

/// The radio's message in a frame, as it is or in TUNNEL, and which.
fn radio_report(frame: &[u8]) -> Option<(RadioReport, bool)> {
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    let payload = &frame[10..10 + usize::from(frame[1])];
    if id == 385 && payload[..2] == 42_120u16.to_le_bytes() {
        let mut inside = payload[5..].to_vec();
        inside.resize(usize::from(payload[4]), 0);
        assert_eq!(inside[0], 0xFD, "a whole frame");
        assert_eq!(inside.len(), 12 + usize::from(inside[1]));
        return radio_report(&inside).map(|(report, _)| (report, true));
    }
    if id != 42_120 {
        return None;
    }
    let mut whole = [0; 33];
    whole[..payload.len()].copy_from_slice(payload);
    let word = |k: usize| whole[4 * k..].first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
    let report = RadioReport {
        time_ms: word(0),
        boot: word(1),
        newest: word(2),
        answers: (word(3), word(4)),
        series: word(5),
        power_mdbm: word(7).cast_signed(),
        result: whole[32],
    };
    Some((report, false))
}

impl Client {
    /// The companion of a vehicle: its system id, component 191, link 0.
    pub fn companion(vehicle: usize) -> Self {
        let header = MavHeader { system_id: vehicle as u32 + 1, component_id: 191, sequence: 0 };
        Self { vehicle, link: 0, header, received: Vec::new(), reports: Vec::new() }
    }

    pub fn ground_station(vehicle: usize, link: usize) -> Self {
        let header = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
        Self { vehicle, link, header, received: Vec::new(), reports: Vec::new() }
    }

    pub fn system(&self) -> u8 {
        self.vehicle as u8 + 1
    }

    pub fn send(&mut self, world: &mut World, message: &MavMessage) {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(self.header, message);
        self.header.sequence = self.header.sequence.wrapping_add(1);
        world.handle(self.vehicle, self.link, raw.raw_bytes());
    }

    pub fn command(&mut self, world: &mut World, command: MavCmd, params: &[f32]) {
        let p = |k: usize| params.get(k).copied().unwrap_or(0.0);
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: p(0),
            param2: p(1),
            param3: p(2),
            param4: p(3),
            param5: p(4),
            param6: p(5),
            param7: p(6),
            command,
            target_system: self.system(),
            target_component: 1,
            confirmation: 0,
        });
        self.send(world, &message);
    }

    pub fn power(&mut self, world: &mut World, dbm: f64, slot: i32, expiry_ms: i32) {
        let message = MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            param1: dbm as f32,
            x: slot,
            y: expiry_ms,
            command: MavCmd::MAV_CMD_USER_1,
            target_system: self.system(),
            target_component: 68,
            ..COMMAND_INT_DATA::DEFAULT
        });
        self.send(world, &message);
    }

    /// A numbered command, by what the radio said last of its clock and its series.
    pub fn numbered(&mut self, world: &mut World, dbm: f32, number: u32, ahead_ms: i32) {
        let (last, _) = *self.reports.last().expect("the radio speaks by itself");
        self.numbered_as(world, &last, dbm, number, ahead_ms);
    }

    /// The same by what the radio said at some time.
    pub fn numbered_as(
        &mut self,
        world: &mut World,
        last: &RadioReport,
        dbm: f32,
        number: u32,
        ahead_ms: i32,
    ) {
        let message = MavMessage::COMMAND_INT(COMMAND_INT_DATA {
            param1: dbm,
            param2: number as f32,
            param3: 5.0,
            param4: last.series as f32,
            x: 2,
            y: last.time_ms.wrapping_add_signed(ahead_ms).cast_signed(),
            command: MavCmd::MAV_CMD_USER_1,
            target_system: self.system(),
            target_component: 68,
            ..COMMAND_INT_DATA::DEFAULT
        });
        self.send(world, &message);
    }

    /// The latest message that `pick` takes, from any component.
    pub fn last<T>(&self, pick: impl Fn(&MavMessage) -> Option<T>) -> Option<T> {
        self.received.iter().rev().find_map(|(_, m)| pick(m))
    }

    pub fn last_ack(&self, command: MavCmd) -> Option<COMMAND_ACK_DATA> {
        self.last(|m| match m {
            MavMessage::COMMAND_ACK(a) if a.command == command => Some(a.clone()),
            _ => None,
        })
    }

    pub fn heartbeat(&self) -> HEARTBEAT_DATA {
        self.received
            .iter()
            .rev()
            .find_map(|(component, m)| match m {
                MavMessage::HEARTBEAT(h) if *component == 1 => Some(h.clone()),
                _ => None,
            })
            .expect("a heartbeat")
    }

    pub fn texts(&self) -> Vec<String> {
        self.received
            .iter()
            .filter_map(|(_, m)| match m {
                MavMessage::STATUSTEXT(t) => t.text.to_str().ok().map(str::to_owned),
                _ => None,
            })
            .collect()
    }
}

/// Hands out what the world sends.
pub fn deliver(world: &mut World, clients: &mut [&mut Client]) {
    while let Some((vehicle, link, frame)) = world.poll_transmit() {
        let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
        let payload = &frame[10..10 + usize::from(frame[1])];
        let report = radio_report(&frame);
        if let Some(report) = report {
            let to = clients.iter_mut().filter(|c| c.vehicle == vehicle && c.link == link);
            to.for_each(|client| client.reports.push(report));
            continue;
        }
        let message = MavMessage::parse(MavlinkVersion::V2, id, payload).expect("our own frames parse");
        for client in clients.iter_mut().filter(|c| c.vehicle == vehicle && c.link == link) {
            client.received.push((frame[6], message.clone()));
        }
    }
}

/// Advances by `ms` and delivers.
pub fn pass(world: &mut World, clients: &mut [&mut Client], ms: u64) {
    let to = world.now() + Duration::from_millis(ms);
    world.advance(to);
    deliver(world, clients);
}

/// North and east in a firmware's own local frame over metres on the ellipsoid, at the tests' latitude: its radius of
/// the earth over the radii of curvature of the meridian and across it (6373.2 and 6390.9 km at 200 m).
fn local_scales(firmware: Firmware) -> [f64; 2] {
    let radius_km = match firmware {
        Firmware::Px4 => 6371.0,
        Firmware::ArduCopter => 6378.1,
    };
    [radius_km / 6373.2, radius_km / 6390.9]
}

/// A position target in the vehicle's own NED frame, from mission ENU, by the flat earth (3 mm at these distances).
pub fn position_target(
    config: &VehicleConfig,
    position_enu_m: [f64; 3],
    velocity_enu_m_s: Option<[f64; 3]>,
) -> MavMessage {
    let origin: [f64; 3] =
        std::array::from_fn(|k| config.home_enu_m[k] + config.local_origin_offset_enu_m[k]);
    let [e, n, u] = std::array::from_fn(|k| position_enu_m[k] - origin[k]);
    let [n, e] = [n * local_scales(config.firmware)[0], e * local_scales(config.firmware)[1]];
    let v = velocity_enu_m_s.unwrap_or_default();
    let mask = if velocity_enu_m_s.is_some() { 0b1101_1100_0000 } else { 0b1101_1111_1000 };
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        x: n as f32,
        y: e as f32,
        z: -u as f32,
        vx: v[1] as f32,
        vy: v[0] as f32,
        vz: -v[2] as f32,
        type_mask: PositionTargetTypemask::from_bits_truncate(mask),
        target_system: config.system_id,
        target_component: 1,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
    })
}

/// An attitude target from the paper's angles, by the rule of MODEL: FRD roll = phi, pitch = -theta, yaw = 90 deg - psi.
pub fn attitude_target(config: &VehicleConfig, pose: &PlannedPose) -> MavMessage {
    let q = UnitQuaternion::from_euler_angles(
        pose.roll_rad,
        -pose.pitch_rad,
        std::f64::consts::FRAC_PI_2 - pose.yaw_rad,
    );
    MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
        q: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
        type_mask: AttitudeTargetTypemask::from_bits_truncate(7 | 64),
        target_system: config.system_id,
        target_component: 1,
        ..SET_ATTITUDE_TARGET_DATA::DEFAULT
    })
}

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

    pub fn invariants(&self) -> Vec<(&'static str, String)> {
        self.world.report().violations.into_iter().map(|v| (v.invariant().name(), v.to_string())).collect()
    }
}

/// Both on station, nobody on the air.
pub fn on_station(config: WorldConfig) -> Flight {
    let mut flight = Flight::new(config);
    flight.take_off();
    flight.go_to_slot(0);
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
