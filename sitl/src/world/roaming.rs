//! Those that move: straight on and round corners, about the place where the mission has them; and what their handsets say of it.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{GLOBAL_POSITION_INT_DATA, MavMessage};
use nalgebra::Vector3;

use crate::geodesy::Origin;
use crate::random::{Noise, Purpose};

/// How fast it turns round a corner, rad/s, and how long it goes straight on, seconds.
const TURNS_RAD_S: f64 = 0.4;
const LEGS_S: [f64; 2] = [8.0, 25.0];
/// Farther from its place than so many seconds take it, it goes back.
const RANGE_S: f64 = 40.0;
/// A report a second, this one of five lost, with so many metres of noise.
const EVERY: Duration = Duration::from_secs(1);
const LOST: f64 = 0.2;
const NOISE_M: f64 = 3.0;

/// Somebody that moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roams {
    /// Metres a second.
    pub speed_m_s: f64,
    /// The MAVLink system that says where it is, over I's vehicle's link to its companion.
    pub system_id: u8,
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

    /// What its handset sends at this instant: the sender, a sequence number, the message.
    pub fn report(
        &mut self,
        at: &Vector3<f64>,
        origin: Origin,
        now: Duration,
    ) -> Option<(u8, u8, MavMessage)> {
        if now < self.next_report {
            return None;
        }
        self.next_report += EVERY;
        let lost = self.handset.uniform() < LOST;
        let [east, north, up] = [(); 3].map(|()| NOISE_M * self.handset.normal());
        if lost {
            return None;
        }
        let (lat, lon, alt) = origin.geodetic(at + Vector3::new(east, north, 0.3 * up)).to_wire();
        self.sequence = self.sequence.wrapping_add(1);
        let message = MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: now.as_millis() as u32,
            lat,
            lon,
            alt,
            ..Default::default()
        });
        Some((self.roams.system_id, self.sequence, message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_it_moves_at_its_speed_round_corners_and_stays_about_its_place() {
        for (speed_m_s, seed) in [(1.5, 1), (8.0, 2)] {
            let home = Vector3::new(10.0, -20.0, 1.0);
            let mut roamer = Roamer::new(Roams { speed_m_s, system_id: 51 }, home, seed, 0);
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
    fn val_its_handset_says_where_it_is_four_times_of_five_with_three_metres_of_noise() {
        let origin = Origin { lat_deg: 50.0, lon_deg: 14.0, alt_amsl_m: 200.0 };
        let at = Vector3::new(100.0, -50.0, 2.0);
        let mut roamer = Roamer::new(Roams { speed_m_s: 1.5, system_id: 51 }, at, 3, 0);
        let (mut count, mut squares) = (0, 0.0);
        for k in 0..100_000u32 {
            let now = Duration::from_millis(20) * k;
            let Some((system, _, MavMessage::GLOBAL_POSITION_INT(m))) = roamer.report(&at, origin, now)
            else {
                continue;
            };
            assert_eq!((system, m.time_boot_ms), (51, now.as_millis() as u32));
            let place = Origin {
                lat_deg: f64::from(m.lat) * 1e-7,
                lon_deg: f64::from(m.lon) * 1e-7,
                alt_amsl_m: f64::from(m.alt) * 1e-3,
            };
            let off = origin.enu(place) - at;
            count += 1;
            squares += off.xy().norm_squared() / 2.0;
        }
        assert!((1530..=1670).contains(&count), "{count}");
        let std_m = (squares / f64::from(count)).sqrt();
        assert!((std_m - NOISE_M).abs() < 0.2, "{std_m}");
    }
}
