//! The antenna axis of one vehicle under a block of attitude noise, and under what is wrong with its heading and mounting.

use super::errors::VehicleErrors;
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
            Noise::Body(n) => self.turn_body(n, &mut out),
            Noise::Turn(q) => {
                let z = [[0.0; LANES], [0.0; LANES], [1.0; LANES]];
                self.turn_body(&rotated(q, &z), &mut out);
            }
        }
        out
    }

    /// The axes where the antenna is `n` in the desired body frame.
    #[inline(always)]
    fn turn_body(&self, n: &[Lane; 3], out: &mut Axes) {
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

    /// The axes in a block of noise where heading and mounting are wrong.
    #[must_use]
    #[inline(always)]
    pub fn axes_with(&self, noise: &Noise, errors: &VehicleErrors) -> Axes {
        let n = &errors.mount;
        let mut out = self.axes(noise);
        match noise {
            // The axis is R n, and `axes` gives R's third column; roll turns about the first.
            Noise::Euler(_) => {
                let (x, z) = (out.roll, out.y);
                for l in 0..LANES {
                    let y = [
                        z[1][l] * x[2][l] - z[2][l] * x[1][l],
                        z[2][l] * x[0][l] - z[0][l] * x[2][l],
                        z[0][l] * x[1][l] - z[1][l] * x[0][l],
                    ];
                    for axis in 0..3 {
                        out.y[axis][l] = n[0][l] * x[axis][l] + n[1][l] * y[axis] + n[2][l] * z[axis][l];
                    }
                }
            }
            Noise::Turn(q) => self.turn_body(&rotated(q, n), &mut out),
            // Made where no mounting is wrong.
            Noise::Body(_) => {}
        }
        let [c, s] = &errors.heading;
        for vector in [&mut out.y, &mut out.roll, &mut out.pitch] {
            for l in 0..LANES {
                let (x, y) = (vector[0][l], vector[1][l]);
                vector[0][l] = c[l] * x - s[l] * y;
                vector[1][l] = s[l] * x + c[l] * y;
            }
        }
        out
    }
}

/// `n` turned by unit quaternions, scalar first: `n + 2 v x (v x n + s n)`.
#[inline(always)]
fn rotated([s, x, y, z]: &[Lane; 4], n: &[Lane; 3]) -> [Lane; 3] {
    let mut out = [[0.0; LANES]; 3];
    for l in 0..LANES {
        let cross =
            |a: [f64; 3]| [y[l] * a[2] - z[l] * a[1], z[l] * a[0] - x[l] * a[2], x[l] * a[1] - y[l] * a[0]];
        let n = [n[0][l], n[1][l], n[2][l]];
        let inner = cross(n);
        let turn = cross([inner[0] + s[l] * n[0], inner[1] + s[l] * n[1], inner[2] + s[l] * n[2]]);
        for axis in 0..3 {
            out[axis][l] = n[axis] + 2.0 * turn[axis];
        }
    }
    out
}
