//! The antenna axis of one vehicle under a block of attitude noise.

use super::lanes::{LANES, Lane};
use super::noise::Noise;

/// Axes of one vehicle in a block: Y, and the axes about which roll and pitch turn it.
pub struct Axes {
    /// The antenna axis.
    pub y: [Lane; 3],
    /// The axis about which roll turns it.
    pub roll: [Lane; 3],
    /// The axis about which pitch turns it, horizontal.
    pub pitch: [Lane; 3],
}

/// Sine and cosine of one vehicle's desired angles, and its rotation.
pub struct Desired {
    trig: [[f64; 2]; 3],
    rotation: [[f64; 3]; 3],
}

impl Desired {
    /// From roll, pitch and yaw.
    #[must_use]
    pub fn new(angles: &[f64]) -> Self {
        let trig = [0, 1, 2].map(|i: usize| {
            let (sin, cos) = libm::sincos(angles[i]);
            [cos, sin]
        });
        let [[cr, sr], [cp, sp], [cy, sy]] = trig;
        let rotation = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ];
        Self { trig, rotation }
    }

    /// The axes in a block of noise.
    #[must_use]
    #[inline(always)]
    pub fn axes(&self, noise: &Noise) -> Axes {
        let mut out = Axes { y: [[0.0; LANES]; 3], roll: [[0.0; LANES]; 3], pitch: [[0.0; LANES]; 3] };
        match noise {
            Noise::Euler(w) => {
                let [[cr, sr], [cp, sp], [cy, sy]] = self.trig;
                for l in 0..LANES {
                    let (c, s) = (cr * w[0][0][l] - sr * w[0][1][l], sr * w[0][0][l] + cr * w[0][1][l]);
                    let (cp, sp) = (cp * w[1][0][l] - sp * w[1][1][l], sp * w[1][0][l] + cp * w[1][1][l]);
                    let (cy, sy) = (cy * w[2][0][l] - sy * w[2][1][l], sy * w[2][0][l] + cy * w[2][1][l]);
                    out.y[0][l] = cy * c * sp + sy * s;
                    out.y[1][l] = sy * c * sp - cy * s;
                    out.y[2][l] = c * cp;
                    out.roll[0][l] = cy * cp;
                    out.roll[1][l] = sy * cp;
                    out.roll[2][l] = -sp;
                    out.pitch[0][l] = -sy;
                    out.pitch[1][l] = cy;
                }
            }
            Noise::Body(n) => {
                let r = &self.rotation;
                let [_, _, [cy, sy]] = self.trig;
                for l in 0..LANES {
                    for axis in 0..3 {
                        out.y[axis][l] = r[axis][0] * n[0][l] + r[axis][1] * n[1][l] + r[axis][2] * n[2][l];
                        out.roll[axis][l] = r[axis][0];
                    }
                    out.pitch[0][l] = -sy;
                    out.pitch[1][l] = cy;
                }
            }
        }
        out
    }
}
