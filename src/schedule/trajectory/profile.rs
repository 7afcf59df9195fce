//! The speed along a straight leg, from rest to rest: up to speed, cruise, and down again as a mirror image.
//!
//! A ramp changes the acceleration by no more than the jerk (`j`), up to the acceleration's limit (`a`): it takes
//! `v / a + a / j` to the speed `v`, or `2 sqrt(v / j)` where the acceleration's limit is not reached, and covers
//! `v / 2` times that. Without a limit of the jerk a ramp is one of constant acceleration, and the profile a trapezoid or
//! a triangle.

/// How far along its leg a vehicle is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Along {
    pub distance_m: f64,
    pub speed_m_s: f64,
    pub acceleration_m_s2: f64,
}

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Profile {
    distance_m: f64,
    peak_m_s: f64,
    /// The largest acceleration, and how long a ramp takes to come to it and to leave it again.
    acceleration_m_s2: f64,
    onset_s: f64,
    ramp_s: f64,
    lasts_s: f64,
}

impl Profile {
    /// The quickest over `distance_m` within the limits, all of them above zero.
    pub fn new(distance_m: f64, speed_m_s: f64, acceleration_m_s2: f64, jerk_m_s3: Option<f64>) -> Self {
        let (peak_m_s, acceleration_m_s2, onset_s) = match jerk_m_s3 {
            None => (speed_m_s.min((distance_m * acceleration_m_s2).sqrt()), acceleration_m_s2, 0.0),
            Some(jerk) => {
                let peak = speed_m_s.min(reached_m_s(distance_m, acceleration_m_s2, jerk));
                let reached = acceleration_m_s2.min((peak * jerk).sqrt());
                (peak, reached, reached / jerk)
            }
        };
        let ramp_s = peak_m_s / acceleration_m_s2 + onset_s;
        // Both ramps together cover peak * ramp; the maximum absorbs rounding where there is no cruise.
        let cruise_s = (distance_m / peak_m_s - ramp_s).max(0.0);
        Self { distance_m, peak_m_s, acceleration_m_s2, onset_s, ramp_s, lasts_s: 2.0 * ramp_s + cruise_s }
    }

    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }

    pub fn lasts_s(&self) -> f64 {
        self.lasts_s
    }

    /// Where it is at `t_s`; before 0 at the start, after [`lasts_s`](Self::lasts_s) at the end.
    pub fn at(&self, t_s: f64) -> Along {
        let t_s = t_s.clamp(0.0, self.lasts_s);
        let left_s = self.lasts_s - t_s;
        if t_s < self.ramp_s.min(left_s) {
            self.on_ramp(t_s)
        } else if left_s < self.ramp_s {
            let left = self.on_ramp(left_s);
            Along {
                distance_m: self.distance_m - left.distance_m,
                acceleration_m_s2: -left.acceleration_m_s2,
                ..left
            }
        } else {
            let distance_m = self.peak_m_s * (t_s - 0.5 * self.ramp_s);
            Along { distance_m, speed_m_s: self.peak_m_s, acceleration_m_s2: 0.0 }
        }
    }

    /// On the way up to speed.
    fn on_ramp(&self, t_s: f64) -> Along {
        let (a, onset_s) = (self.acceleration_m_s2, self.onset_s);
        let offset_s = self.ramp_s - t_s;
        if t_s < onset_s {
            let jerk = a / onset_s;
            let v = 0.5 * jerk * t_s * t_s;
            Along { distance_m: v * t_s / 3.0, speed_m_s: v, acceleration_m_s2: jerk * t_s }
        } else if offset_s < onset_s {
            let jerk = a / onset_s;
            let short = 0.5 * jerk * offset_s * offset_s;
            let distance_m = 0.5 * self.peak_m_s * self.ramp_s - (self.peak_m_s - short / 3.0) * offset_s;
            Along { distance_m, speed_m_s: self.peak_m_s - short, acceleration_m_s2: jerk * offset_s }
        } else {
            let steady_s = t_s - onset_s;
            let onset_m_s = 0.5 * a * onset_s;
            let distance_m = onset_m_s * onset_s / 3.0 + onset_m_s * steady_s + 0.5 * a * steady_s * steady_s;
            Along { distance_m, speed_m_s: onset_m_s + a * steady_s, acceleration_m_s2: a }
        }
    }
}

/// How the time of the quickest profile changes with the distance and with the speed's limit.
pub(super) fn slopes(distance_m: f64, speed_m_s: f64, a: f64, jerk_m_s3: Option<f64>) -> [f64; 2] {
    // A ramp's length by its speed: 1 / a, or 1 / sqrt(v j) where the acceleration's limit is not reached.
    let ramp = |v: f64| match jerk_m_s3 {
        Some(jerk) if v * jerk < a * a => 1.0 / (v * jerk).sqrt(),
        _ => 1.0 / a,
    };
    let profile = Profile::new(distance_m, speed_m_s, a, jerk_m_s3);
    if profile.peak_m_s >= speed_m_s {
        return [1.0 / speed_m_s, ramp(speed_m_s) - distance_m / (speed_m_s * speed_m_s)];
    }
    // Twice the ramp to the peak, where distance = peak * ramp.
    let slope = ramp(profile.peak_m_s);
    [2.0 * slope / (profile.ramp_s + profile.peak_m_s * slope), 0.0]
}

/// The speed at which two ramps, up and down, cover the distance.
fn reached_m_s(distance_m: f64, a: f64, jerk: f64) -> f64 {
    if distance_m * jerk * jerk >= 2.0 * a * a * a {
        // v^2 / a + v a / j = distance.
        let onset_s = a / jerk;
        0.5 * a * ((onset_s * onset_s + 4.0 * distance_m / a).sqrt() - onset_s)
    } else {
        // 2 v sqrt(v / j) = distance; the same root on every machine.
        libm::cbrt(0.25 * distance_m * distance_m * jerk)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_times_with_and_without_a_limit_of_the_jerk() {
        for (distance, jerk, expected_s) in [
            // Up to 8 m/s at 2.5 m/s^2: L / v + v / a, and the onset on top.
            (100.0, None, 12.5 + 3.2),
            (100.0, Some(5.0), 12.5 + 3.2 + 0.5),
            // 2 sqrt(L / a); with 5 m/s^3, v^2 / 2.5 + v / 2 = 10 has the root 4.413911.
            (10.0, None, 4.0),
            (10.0, Some(5.0), 2.0 * 10.0 / 4.413_911),
            // 32^(1/3) seconds over a metre for each unit of jerk: four pieces of jerk alone.
            (0.1, Some(5.0), (32.0_f64 * 0.1 / 5.0).powf(1.0 / 3.0)),
        ] {
            let lasts_s = Profile::new(distance, 8.0, 2.5, jerk).lasts_s();
            assert!((lasts_s - expected_s).abs() < 2e-6, "{distance} {jerk:?}: {lasts_s} {expected_s}");
        }
    }

    #[test]
    fn val_speed_and_distance_are_integrals_of_the_acceleration() {
        for distance in [0.01, 1.0, 10.0, 100.0] {
            for jerk in [None, Some(1.0), Some(4.0), Some(50.0)] {
                let profile = Profile::new(distance, 8.0, 2.5, jerk);
                let n = 20_000;
                let dt = profile.lasts_s() / f64::from(n);
                let (mut v, mut s) = (0.0, 0.0);
                for k in 0..n {
                    let middle = profile.at((f64::from(k) + 0.5) * dt);
                    assert!((middle.speed_m_s - v).abs() < 10.0 * dt, "{distance} {jerk:?}");
                    s += middle.speed_m_s * dt;
                    v += middle.acceleration_m_s2 * dt;
                    assert!(middle.acceleration_m_s2.abs() <= 2.5 + 1e-12 && middle.speed_m_s <= 8.0 + 1e-12);
                    let end = profile.at(f64::from(k + 1) * dt).distance_m;
                    assert!((end - s).abs() < 1e-4 * distance, "{distance} {jerk:?}: {end} {s}");
                }
                assert!(v.abs() < 10.0 * dt, "at rest at the end: {v}");
            }
        }
    }
}
