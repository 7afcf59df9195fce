//! Those that move: straight on and round corners, about the place where the mission has them; and what their handsets, or who sees
//! them, say of it.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    COMMAND_INT_DATA, GLOBAL_POSITION_INT_DATA, MavCmd, MavFrame, MavMessage,
};
use nalgebra::Vector3;

use crate::geodesy::Origin;
use crate::random::{Noise, Purpose};
use crate::wire;

/// How fast it turns round a corner, rad/s, and how long it goes straight on, seconds.
const TURNS_RAD_S: f64 = 0.4;
const LEGS_S: [f64; 2] = [8.0, 25.0];
/// Farther from its place than so many seconds take it, it goes back.
const RANGE_S: f64 = 40.0;
/// A report a second, this one of five lost.
const EVERY: Duration = Duration::from_secs(1);
const LOST: f64 = 0.2;

/// The component of a handset; and who an operator is.
const HANDSET: u8 = 1;
const OPERATOR: u8 = 255;
const STATION: u8 = 190;

/// Who says where somebody is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reporter {
    /// Itself, as this MAVLink system.
    Handset(u8),
    /// An operator who sees it, to this companion: an eavesdropper or a user, by its number in the mission from 1 on.
    Operator {
        /// Companion's system and component.
        to: (u8, u8),
        /// Of its kind.
        number: u16,
        /// Not a user.
        eavesdrops: bool,
    },
}

/// Where somebody is at an instant of the flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// Seconds since the flight began.
    pub at_s: f64,
    /// ENU, metres.
    pub position_enu_m: [f64; 3],
}

/// Somebody that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Roams {
    /// Metres a second, where it goes as it likes.
    pub speed_m_s: f64,
    /// Where it goes instead, straight from fix to fix, in the order of their times, resting before and after; empty: as it likes.
    pub track: Vec<Fix>,
    /// Who says where it is, over I's vehicle's link to its companion.
    pub reporter: Reporter,
    /// Standard deviation of what is said, east and north each, metres; a third of it in height.
    pub noise_m: f64,
}

/// See the module.
#[derive(Debug, Clone)]
pub(crate) struct Roamer {
    roams: Roams,
    home: Vector3<f64>,
    heading_rad: f64,
    towards_rad: f64,
    leg_ends: Duration,
    next_report: Duration,
    sequence: u8,
    way: Noise,
    handset: Noise,
}

impl Roamer {
    pub fn new(roams: Roams, home: Vector3<f64>, seed: u64, index: usize) -> Self {
        let mut way = Noise::new(seed, Purpose::Roaming, index);
        let mut handset = Noise::new(seed, Purpose::Handsets, index);
        let heading_rad = std::f64::consts::TAU * way.uniform();
        Self {
            roams,
            home,
            heading_rad,
            towards_rad: heading_rad,
            leg_ends: Duration::ZERO,
            next_report: EVERY.mul_f64(handset.uniform()),
            sequence: 0,
            way,
            handset,
        }
    }

    /// Where it is `dt_s` seconds later.
    pub fn advance(&mut self, at: &Vector3<f64>, dt_s: f64, now: Duration) -> Vector3<f64> {
        if let Some(place) = along(&self.roams.track, now.as_secs_f64() + dt_s) {
            return place;
        }
        if now >= self.leg_ends {
            let back = self.home - at;
            let (away, spread) =
                (back.xy().norm() > RANGE_S * self.roams.speed_m_s, self.way.uniform() - 0.5);
            self.towards_rad = match away {
                true => back.y.atan2(back.x) + spread,
                false => self.heading_rad + std::f64::consts::PI * spread,
            };
            let lasts_s = LEGS_S[0] + (LEGS_S[1] - LEGS_S[0]) * self.way.uniform();
            self.leg_ends = now + Duration::from_secs_f64(lasts_s);
        }
        let off = self.towards_rad - self.heading_rad;
        let off = off.sin().atan2(off.cos());
        self.heading_rad += off.clamp(-TURNS_RAD_S * dt_s, TURNS_RAD_S * dt_s);
        let (north, east) = self.heading_rad.sin_cos();
        at + Vector3::new(east, north, 0.0) * (self.roams.speed_m_s * dt_s)
    }

    /// What is said of it at this instant: the frame.
    pub fn report(&mut self, at: &Vector3<f64>, origin: Origin, now: Duration) -> Option<Vec<u8>> {
        if now < self.next_report {
            return None;
        }
        self.next_report += EVERY;
        let lost = self.handset.uniform() < LOST;
        let [east, north, up] = [(); 3].map(|()| self.roams.noise_m * self.handset.normal());
        if lost {
            return None;
        }
        let (lat, lon, alt) = origin.geodetic(at + Vector3::new(east, north, 0.3 * up)).to_wire();
        self.sequence = self.sequence.wrapping_add(1);
        let (system, component, message) = match self.roams.reporter {
            Reporter::Handset(system) => {
                let time_boot_ms = now.as_millis() as u32;
                let place = GLOBAL_POSITION_INT_DATA { time_boot_ms, lat, lon, alt, ..Default::default() };
                (system, HANDSET, MavMessage::GLOBAL_POSITION_INT(place))
            }
            Reporter::Operator { to, number, eavesdrops } => {
                let seen = COMMAND_INT_DATA {
                    target_system: to.0,
                    target_component: to.1,
                    frame: MavFrame::MAV_FRAME_GLOBAL,
                    command: MavCmd::MAV_CMD_USER_5,
                    param1: f32::from(u8::from(eavesdrops)),
                    param2: f32::from(number),
                    param3: self.roams.noise_m as f32,
                    x: lat,
                    y: lon,
                    z: alt as f32 * 1e-3,
                    ..Default::default()
                };
                (OPERATOR, STATION, MavMessage::COMMAND_INT(seen))
            }
        };
        Some(wire::encode(self.sequence, system, component, &message))
    }
}

/// Where a track has it; `None` without one.
fn along(track: &[Fix], at_s: f64) -> Option<Vector3<f64>> {
    let after = track.partition_point(|fix| fix.at_s <= at_s);
    let [from, to] = [after.saturating_sub(1), after.min(track.len().checked_sub(1)?)].map(|k| track[k]);
    let lasts_s = to.at_s - from.at_s;
    let share = if lasts_s > 0.0 { ((at_s - from.at_s) / lasts_s).clamp(0.0, 1.0) } else { 0.0 };
    Some(Vector3::from(from.position_enu_m).lerp(&Vector3::from(to.position_enu_m), share))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_track_is_gone_along_evenly_and_rested_at_before_and_after() {
        let fix = |at_s, east_m, up_m| Fix { at_s, position_enu_m: [east_m, 1.0, up_m] };
        let track = [fix(2.0, 10.0, 0.0), fix(4.0, 20.0, 0.0), fix(8.0, 20.0, 4.0)];
        for (at_s, east_m, up_m) in [
            (0.0, 10.0, 0.0),
            (2.0, 10.0, 0.0),
            (2.5, 12.5, 0.0),
            (4.0, 20.0, 0.0),
            (7.0, 20.0, 3.0),
            (8.0, 20.0, 4.0),
            (99.0, 20.0, 4.0),
        ] {
            assert_eq!(along(&track, at_s), Some(Vector3::new(east_m, 1.0, up_m)), "{at_s}");
        }
        assert_eq!(along(&track[..1], 5.0), Some(Vector3::new(10.0, 1.0, 0.0)));
        assert_eq!(along(&[], 5.0), None);
    }

    #[test]
    fn val_it_moves_at_its_speed_round_corners_and_stays_about_its_place() {
        for (speed_m_s, seed) in [(1.5, 1), (8.0, 2)] {
            let home = Vector3::new(10.0, -20.0, 1.0);
            let mut roamer = Roamer::new(
                Roams { speed_m_s, track: vec![], reporter: Reporter::Handset(51), noise_m: 3.0 },
                home,
                seed,
                0,
            );
            let (mut at, mut before, mut farthest_m) = (home, None, 0.0f64);
            let mut turned_rad = 0.0f64;
            for k in 0..60_000u32 {
                let next = roamer.advance(&at, 0.02, Duration::from_millis(20) * k);
                let step = next - at;
                assert!((step.norm() - 0.02 * speed_m_s).abs() < 1e-9 && step.z == 0.0);
                if let Some(before) = before.replace(step) {
                    let angle = step.angle(&before);
                    assert!(angle <= TURNS_RAD_S * 0.02 + 1e-6, "{angle}");
                    turned_rad += angle;
                }
                farthest_m = farthest_m.max((next - home).norm());
                at = next;
            }
            assert!(farthest_m > 20.0 * speed_m_s && farthest_m < 110.0 * speed_m_s, "{farthest_m}");
            assert!(turned_rad > 20.0, "{turned_rad}");
        }
    }

    #[test]
    fn val_it_is_told_of_four_times_of_five_with_three_metres_of_noise() {
        let origin = Origin { lat_deg: 50.0, lon_deg: 14.0, alt_amsl_m: 200.0 };
        let at = Vector3::new(100.0, -50.0, 2.0);
        let operator = Reporter::Operator { to: (1, 191), number: 2, eavesdrops: true };
        for reporter in [Reporter::Handset(51), operator] {
            let roams = Roams { speed_m_s: 1.5, track: vec![], reporter, noise_m: 3.0 };
            let mut roamer = Roamer::new(roams, at, 3, 0);
            let (mut count, mut squares) = (0, 0.0);
            for k in 0..100_000u32 {
                let now = Duration::from_millis(20) * k;
                let Some(frame) = roamer.report(&at, origin, now) else { continue };
                let mut reader = wire::Decoder::default();
                reader.push(&frame);
                let header = reader.next().unwrap();
                let message = header.message().unwrap();
                let (lat, lon, alt) = match (reporter, message) {
                    (Reporter::Handset(_), MavMessage::GLOBAL_POSITION_INT(m)) => {
                        assert_eq!((header.system_id, m.time_boot_ms), (51, now.as_millis() as u32));
                        (m.lat, m.lon, f64::from(m.alt) * 1e-3)
                    }
                    (_, MavMessage::COMMAND_INT(m)) => {
                        let numbers = [header.system_id, m.target_system, m.target_component];
                        assert_eq!((numbers, m.param1, m.param2, m.param3), ([255, 1, 191], 1.0, 2.0, 3.0));
                        (m.x, m.y, f64::from(m.z))
                    }
                    other => panic!("{other:?}"),
                };
                let (lat_deg, lon_deg) = (f64::from(lat) * 1e-7, f64::from(lon) * 1e-7);
                let off = origin.enu(Origin { lat_deg, lon_deg, alt_amsl_m: alt }) - at;
                assert!(off.z.abs() < 6.0, "{off}");
                count += 1;
                squares += off.xy().norm_squared() / 2.0;
            }
            assert!((1530..=1670).contains(&count), "{count}");
            let std_m = (squares / f64::from(count)).sqrt();
            assert!((std_m - 3.0).abs() < 0.2, "{std_m}");
        }
    }
}
