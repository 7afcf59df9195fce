//! The objective without jitter, at known positions: smooth in the position, for the maximum over eavesdroppers is
//! replaced by a log-sum-exp,
//!
//! ```text
//! f_q = ln(1 + Gamma_0) - (1/q) ln sum_j (1 + Gamma_j)^q  in  [f - ln(N)/q, f].
//! ```

use super::kernel::{ANGLES, Link, POWER, Raw, Scene, VEHICLE};
use crate::radio::pattern;

/// Reusable memory of an evaluation.
#[derive(Debug, Clone, Default)]
pub struct Exact {
    terms: Vec<Term>,
}

/// One node's received powers over the noise and what their gradients need.
#[derive(Debug, Clone, Copy)]
struct Term {
    link: [Link; 2],
    /// `<u, Y>`, and the gain's derivative by it.
    t: [f64; 2],
    slope: [f64; 2],
    a: f64,
    b: f64,
    log: f64,
}

impl Term {
    fn new(scene: &Scene, node: &[f64; 3], axes: &[[f64; 3]; 2], raw: &Raw, budget_m2: [f64; 2]) -> Self {
        let link = [Link::new(raw, node, budget_m2[0]), Link::new(&raw[VEHICLE..], node, budget_m2[1])];
        let t = [0, 1].map(|v: usize| dot(&link[v].u, &axes[v]));
        let gain = [0, 1].map(|v: usize| {
            // |u x Y|^2 keeps its accuracy near a null, where 1 - t^2 cancels. u comes from the node.
            let sine_squared = square(&cross(&link[v].u, &axes[v]));
            scene.antennas[v].pattern.gain_and_slope(-t[v], sine_squared)
        });
        let (a, b) = (link[0].k * gain[0].0, 1.0 + link[1].k * gain[1].0);
        Self { link, t, slope: gain.map(|(_, slope)| -slope), a, b, log: libm::log1p(a / b) }
    }

    /// Adds `c` times the gradient of `ln(1 + a / b)`.
    fn add_gradient(&self, c: f64, axes: &[[f64; 3]; 2], turns: &[[[f64; 3]; 3]; 2], out: &mut Raw) {
        let weight = [c / (self.a + self.b), -c * self.a / (self.b * (self.a + self.b))];
        let received = [self.a, self.b - 1.0];
        for v in 0..2 {
            let (link, y) = (&self.link[v], &axes[v]);
            let w = weight[v] * link.k * self.slope[v];
            let along = w * self.t[v] + 2.0 * weight[v] * received[v];
            let part = &mut out[v * VEHICLE..(v + 1) * VEHICLE];
            for axis in 0..3 {
                part[axis] += link.inverse_m * (w * y[axis] - along * link.u[axis]);
                part[ANGLES + axis] += w * dot(&turns[v][axis], &cross(y, &link.u));
            }
            part[POWER] += weight[v] * received[v];
        }
    }
}

impl Exact {
    /// f in nats per hertz with sharpness `q` (infinite: the maximum itself, whose gradient is that of one of the
    /// strongest). `gradient`, if given, is overwritten; its power entries are derivatives by ln P.
    pub fn value(
        &mut self,
        scene: &Scene,
        eavesdroppers: impl Iterator<Item = [f64; 3]>,
        raw: &Raw,
        q: f64,
        gradient: Option<&mut Raw>,
    ) -> f64 {
        let axes = [0, VEHICLE].map(|v| {
            let y = pattern::antenna_axis(raw[v + ANGLES], raw[v + ANGLES + 1], raw[v + ANGLES + 2]);
            [y.x, y.y, y.z]
        });
        let budget =
            [scene.budget_m2_w * raw[POWER].max(0.0), scene.budget_m2_w * raw[VEHICLE + POWER].max(0.0)];
        let user = Term::new(scene, &scene.user, &axes, raw, budget);
        self.terms.clear();
        self.terms.extend(eavesdroppers.map(|node| Term::new(scene, &node, &axes, raw, budget)));
        let top = self.terms.iter().map(|t| t.log).fold(0.0, f64::max);
        let weight = |log: f64| {
            if q.is_finite() { libm::exp(q * (log - top)) } else { f64::from(u8::from(log >= top)) }
        };
        let sum: f64 = self.terms.iter().map(|t| weight(t.log)).sum();
        if let Some(out) = gradient {
            out.fill(0.0);
            let turns = [0, VEHICLE].map(|v| turning_axes(&raw[v + ANGLES..]));
            user.add_gradient(1.0, &axes, &turns, out);
            for term in &self.terms {
                let c = weight(term.log) / sum.max(f64::MIN_POSITIVE);
                // Far below the strongest, a node's share is lost in rounding.
                if c > 1e-14 {
                    term.add_gradient(-c, &axes, &turns, out);
                }
            }
        }
        let excess = if q.is_finite() { libm::log(sum.max(f64::MIN_POSITIVE)) / q } else { 0.0 };
        user.log - top - excess
    }
}

/// The axes about which roll, pitch and yaw turn the antenna.
fn turning_axes(angles: &[f64]) -> [[f64; 3]; 3] {
    let (sp, cp) = libm::sincos(angles[1]);
    let (sy, cy) = libm::sincos(angles[2]);
    [[cy * cp, sy * cp, -sp], [-sy, cy, 0.0], [0.0, 0.0, 1.0]]
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn square(a: &[f64; 3]) -> f64 {
    dot(a, a)
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
