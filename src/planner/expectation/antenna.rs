//! A vehicle's pattern as the kernels take it: a dipole's depth, or a measured pattern as a table that costs a square root
//! and a cubic.

use std::sync::Arc;

use super::lanes::{LANES, Lane};
use crate::radio::antenna::Pattern;
use crate::radio::measured::Measured;

/// Cells of a hemisphere's table.
const CELLS: usize = 1024;

/// One vehicle's antenna.
#[derive(Debug, Clone)]
pub struct Antenna {
    /// The pattern itself.
    pub pattern: Pattern,
    /// Mean gain over the sphere.
    pub mean: f64,
    table: Option<Arc<Table>>,
}

impl Antenna {
    /// Of a pattern.
    #[must_use]
    pub fn new(pattern: &Pattern) -> Self {
        let table = match pattern {
            Pattern::Dipole { .. } => None,
            Pattern::Measured(measured) => Some(Arc::new(Table::new(measured))),
        };
        Self { pattern: pattern.clone(), mean: pattern.mean(), table }
    }

    /// `1 - f` of a dipole; `None` of a measured pattern.
    #[must_use]
    pub fn depth(&self) -> Option<f64> {
        match self.pattern {
            Pattern::Dipole { floor } => Some(1.0 - floor),
            Pattern::Measured(_) => None,
        }
    }

    /// Gain and its derivative by `t`, the cosine between the axis and the direction *from* the node.
    #[must_use]
    #[inline(always)]
    pub fn gain(&self, t: &Lane) -> [Lane; 2] {
        let mut out = [[0.0; LANES]; 2];
        match (&self.table, self.depth()) {
            (Some(table), _) => {
                let [gain, slope] = table.at(&t.map(|t| -t));
                out = [gain, slope.map(|slope| -slope)];
            }
            (None, depth) => {
                let depth = depth.unwrap_or(1.0);
                for l in 0..LANES {
                    // Rounding must not make a null's gain negative: its root is taken.
                    out[0][l] = (1.0 - depth * (t[l] * t[l])).max(0.0);
                    out[1][l] = -2.0 * depth * t[l];
                }
            }
        }
        out
    }
}

/// A pattern over `x = sqrt(1 - |c|)`, c the cosine of the angle from the axis: `theta = 2 asin(x / sqrt 2)` is smooth in x as
/// far as the axis, where the gain over c may have the slope of a root. Cubic Hermite between values and slopes.
#[derive(Debug)]
struct Table {
    /// The cubic of each cell, its constant first, over the cell's own coordinate from 0 to 1: of the hemisphere about the axis,
    /// then of the other. A power of two of them, so that no index needs to be checked.
    cubics: Box<[[f64; 4]; 2 * CELLS]>,
}

impl Table {
    fn new(measured: &Measured) -> Self {
        // Value and slope by x at a cell's end.
        let knot = |k: usize, opposite: bool| {
            let x = k as f64 / CELLS as f64;
            let angle = 2.0 * libm::asin(x / std::f64::consts::SQRT_2);
            let by_x = 2.0 / (2.0 - x * x).sqrt();
            let (angle, by_x) = if opposite { (std::f64::consts::PI - angle, -by_x) } else { (angle, by_x) };
            let (gain, slope) = measured.gain_and_slope(angle);
            [gain, slope * by_x / CELLS as f64]
        };
        let mut cubics = Box::new([[0.0; 4]; 2 * CELLS]);
        for (index, cubic) in cubics.iter_mut().enumerate() {
            let (cell, opposite) = (index % CELLS, index >= CELLS);
            let ([g0, d0], [g1, d1]) = (knot(cell, opposite), knot(cell + 1, opposite));
            let rise = g1 - g0;
            *cubic = [g0, d0, 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise];
        }
        Self { cubics }
    }

    /// Gain and derivative by the cosine.
    #[inline(always)]
    fn at(&self, cosine: &Lane) -> [Lane; 2] {
        let (mut x, mut s, mut out) = ([0.0; LANES], [0.0; LANES], [[0.0; LANES]; 2]);
        let mut cells = [0u32; LANES];
        for l in 0..LANES {
            x[l] = (1.0 - cosine[l].abs()).max(0.0).sqrt();
            let place = x[l] * CELLS as f64;
            let cell = place.min(CELLS as f64 - 1.0).floor();
            s[l] = place - cell;
            cells[l] = cell as i32 as u32 + if cosine[l] < 0.0 { CELLS as u32 } else { 0 };
        }
        let mut cubic = [[0.0; LANES]; 4];
        for l in 0..LANES {
            let of = &self.cubics[cells[l] as usize % (2 * CELLS)];
            for (term, of) in cubic.iter_mut().zip(of) {
                term[l] = *of;
            }
        }
        for l in 0..LANES {
            let [g0, d0, q, r] = [cubic[0][l], cubic[1][l], cubic[2][l], cubic[3][l]];
            out[0][l] = g0 + s[l] * (d0 + s[l] * (q + s[l] * r));
            let by_x = (d0 + s[l] * (2.0 * q + s[l] * 3.0 * r)) * CELLS as f64;
            // dx/dc = -+1 / (2 x); on the axis the slope may be infinite: large enough to turn away from it.
            let by_cosine = by_x / (2.0 * x[l].max(1e-8));
            out[1][l] = if cosine[l] < 0.0 { by_cosine } else { -by_cosine };
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Against the interpolant over the angle itself, for patterns measured every 5 deg, rough ones too.
    #[test]
    fn val_the_table_is_the_pattern() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        for rough in [0.0, 3.0] {
            let points: Vec<[f64; 2]> = (0..=36)
                .map(|k| {
                    let deg = 5.0 * f64::from(k);
                    let db = 10.0 * (1.0 - 0.997 * deg.to_radians().cos().powi(2)).log10();
                    [deg, if k == 18 { 0.0 } else { db - rough * rng.random_range(0.0..1.0) }]
                })
                .collect();
            let measured = Measured::new(&points).unwrap();
            let antenna = Antenna::new(&Pattern::Measured(Arc::new(measured.clone())));
            for _ in 0..20_000 {
                let angle = rng.random_range(0.0..std::f64::consts::PI);
                let [gain, slope] = antenna.gain(&[-angle.cos(); LANES]).map(|lane| lane[0]);
                let (exact, by_angle) = measured.gain_and_slope(angle);
                // The interpolant's curvature jumps at a measured point; the table's does not within a cell.
                assert!((gain - exact).abs() < 1e-5, "{angle}: {gain} {exact}");
                assert!((slope * angle.sin() - by_angle).abs() < 5e-2, "{angle}: {slope} {by_angle}");
            }
        }
    }
}
