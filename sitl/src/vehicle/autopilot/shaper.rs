//! ArduCopter's GUIDED does not follow the target that it is sent: it moves a target of its own after it, by an
//! acceleration that changes no faster than a jerk. Velocity and acceleration that come with a target pass as they are;
//! what closes the rest of the way is bounded, and brakes in time by half of what it is allowed.

use nalgebra::Vector3;

use crate::vehicle::control::SpeedLimits;

/// A point in motion, mission ENU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Motion {
    pub position_m: Vector3<f64>,
    pub velocity_m_s: Vector3<f64>,
    pub acceleration_m_s2: Vector3<f64>,
}

/// Bounds, horizontally and vertically.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shaping {
    /// Of the acceleration that corrects.
    pub acceleration_m_s2: [f64; 2],
    /// Of the change of the whole acceleration.
    pub jerk_m_s3: [f64; 2],
}

/// The autopilot's own target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shaper {
    own: Motion,
}

impl Shaper {
    /// Begins where the vehicle is, as it moves.
    pub fn at(position_m: Vector3<f64>, velocity_m_s: Vector3<f64>) -> Self {
        Self { own: Motion { position_m, velocity_m_s, acceleration_m_s2: Vector3::zeros() } }
    }

    /// `dt` seconds on, after `aim`.
    pub fn step(&mut self, aim: &Motion, shaping: &Shaping, speeds: &SpeedLimits, dt: f64) -> Motion {
        let own = &mut self.own;
        own.position_m += (own.velocity_m_s + own.acceleration_m_s2 * (0.5 * dt)) * dt;
        own.velocity_m_s += own.acceleration_m_s2 * dt;
        let rises = aim.position_m.z > own.position_m.z;
        let speed = [speeds.horizontal_m_s, if rises { speeds.up_m_s } else { speeds.down_m_s }];
        let parts = [0, 1].map(|k| {
            let of = |v: Vector3<f64>| if k == 0 { Vector3::new(v.x, v.y, 0.0) } else { Vector3::z() * v.z };
            let (most, jerk) = (shaping.acceleration_m_s2[k], shaping.jerk_m_s3[k]);
            let closing = braked(of(aim.position_m - own.position_m), 0.5 * jerk / most, 0.5 * most);
            let velocity = of(aim.velocity_m_s) + closing.cap_magnitude(speed[k]);
            let correcting = braked(velocity - of(own.velocity_m_s), jerk / most, jerk);
            let wanted = of(aim.acceleration_m_s2) + correcting.cap_magnitude(most);
            (wanted - of(own.acceleration_m_s2)).cap_magnitude(jerk * dt)
        });
        own.acceleration_m_s2 += parts[0] + parts[1];
        *own
    }
}

/// The rate that closes an error: in proportion to a small one, and as fast as `braking` can stop a large one.
fn braked(error: Vector3<f64>, gain: f64, braking: f64) -> Vector3<f64> {
    let (size, linear) = (error.norm(), braking / (gain * gain));
    if size <= linear {
        return error * gain;
    }
    error / size * (2.0 * braking * (size - 0.5 * linear)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOCK: Shaping = Shaping { acceleration_m_s2: [2.5, 1.0], jerk_m_s3: [5.0, 5.0] };
    const SPEEDS: SpeedLimits = SpeedLimits { horizontal_m_s: 10.0, up_m_s: 2.5, down_m_s: 1.5 };
    const DT: f64 = 0.0025;

    /// How far past 60 m east the target comes that is led there by `aim` over time.
    fn past_m(aim: impl Fn(f64) -> [f64; 3]) -> f64 {
        let mut shaper = Shaper::at(Vector3::zeros(), Vector3::zeros());
        let mut furthest = 0.0_f64;
        for k in 0..12_000 {
            let [p, v, a] = aim(f64::from(k) * DT).map(|x| Vector3::new(x, 0.0, 0.0));
            let aim = Motion { position_m: p, velocity_m_s: v, acceleration_m_s2: a };
            furthest = furthest.max(shaper.step(&aim, &STOCK, &SPEEDS, DT).position_m.x);
        }
        assert!((shaper.own.position_m.x - 60.0).abs() < 0.05, "{:?}", shaper.own);
        furthest - 60.0
    }

    /// 60 m from rest to rest at 8 m/s and 2.5 m/s^2: position, velocity, acceleration.
    fn trapezoid(t: f64) -> [f64; 3] {
        let (ramp, lasts) = (3.2, 3.2 + 7.5);
        match t {
            t if t < ramp => [1.25 * t * t, 2.5 * t, 2.5],
            t if t < lasts - ramp => [12.8 + 8.0 * (t - ramp), 8.0, 0.0],
            t if t < lasts => [60.0 - 1.25 * (lasts - t).powi(2), 2.5 * (lasts - t), -2.5],
            _ => [60.0, 0.0, 0.0],
        }
    }

    #[test]
    fn val_a_step_is_hardly_passed_and_a_transit_is_passed_unless_it_says_how_it_slows() {
        assert!(past_m(|_| [60.0, 0.0, 0.0]) < 0.3);
        // The real program's loops lag besides: ten metres were seen, and about one with the acceleration.
        let without = past_m(|t| {
            let [p, v, _] = trapezoid(t);
            [p, v, 0.0]
        });
        let with = past_m(trapezoid);
        println!("{without:.2} m without, {with:.2} m with the acceleration");
        assert!((2.0..15.0).contains(&without), "{without}");
        assert!((0.0..1.5).contains(&with) && with < without / 2.0, "{with}");
    }
}
