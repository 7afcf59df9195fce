//! A client of one vehicle's link, and what it sends.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message};
use nalgebra::UnitQuaternion;
use veilwing_sitl::*;

pub const PX4_OFFBOARD: u32 = 6 << 16;

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
