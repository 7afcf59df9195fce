//! A vehicle's antenna: how much it radiates in each direction, against its strongest.
//!
//! All patterns are symmetric about the body's z. The ideal one is the paper's dipole (1.4); a real one leaks along its
//! axis, or is what somebody has measured.

use nalgebra::Vector3;

/// What is known of an antenna.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Antenna {
    /// The paper's dipole, with a perfect null along its axis.
    #[default]
    Dipole,
    /// A dipole that leaks: the power along its axis is so far below the largest.
    NullDepth {
        /// Decibels, at least 0.
        depth_db: f64,
    },
    /// A measured pattern.
    Measured {
        /// Angle from the body's z in degrees, from 0 to 180 and rising, and the gain there over the largest, dB.
        gain_db: Vec<[f64; 2]>,
    },
}

impl Antenna {
    /// The first value that no antenna can have.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64)> {
        match self {
            Self::Dipole => None,
            Self::NullDepth { depth_db } => {
                (!(depth_db.is_finite() && *depth_db >= 0.0)).then_some(("antenna.depth_db", *depth_db))
            }
            Self::Measured { gain_db } => {
                let infinite = gain_db.iter().flatten().find(|v| !v.is_finite());
                if let Some(&value) = infinite {
                    return Some(("antenna.gain_db", value));
                }
                let falls = gain_db.windows(2).find(|pair| pair[1][0] <= pair[0][0]).map(|pair| pair[1][0]);
                let first = gain_db.first().map_or(f64::NAN, |point| point[0]);
                let last = gain_db.last().map_or(f64::NAN, |point| point[0]);
                falls
                    .map(|angle| ("antenna: an angle that does not rise", angle))
                    .or_else(|| (first != 0.0).then_some(("antenna: first angle, 0 is needed", first)))
                    .or_else(|| (last != 180.0).then_some(("antenna: last angle, 180 is needed", last)))
            }
        }
    }
}

/// An antenna, ready to be asked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Pattern {
    /// `leak`: the gain along the axis, linear.
    Dipole {
        leak: f64,
    },
    Measured(Curve),
}

impl Pattern {
    pub fn new(antenna: &Antenna) -> Self {
        match antenna {
            Antenna::Dipole => Self::Dipole { leak: 0.0 },
            Antenna::NullDepth { depth_db } => Self::Dipole { leak: linear(-depth_db) },
            Antenna::Measured { gain_db } => Self::Measured(Curve::new(gain_db)),
        }
    }

    /// The gain along a line of any length, of an antenna whose axis is this unit vector; 1 where it is strongest.
    pub fn gain(&self, axis: &Vector3<f64>, line: &Vector3<f64>) -> f64 {
        match self {
            Self::Dipole { leak } => {
                let squared = line.norm_squared();
                let cosine_squared = if squared > 0.0 { axis.dot(line).powi(2) / squared } else { 0.0 };
                (1.0 - (1.0 - leak) * cosine_squared).max(0.0)
            }
            Self::Measured(curve) => curve.at(axis.cross(line).norm().atan2(axis.dot(line))),
        }
    }

    /// The mean gain over all directions: what an antenna puts into its surroundings.
    pub fn mean(&self) -> f64 {
        match self {
            // The mean of a squared cosine over the sphere is a third.
            Self::Dipole { leak } => 1.0 - (1.0 - leak) / 3.0,
            Self::Measured(curve) => curve.mean,
        }
    }
}

pub(crate) fn linear(db: f64) -> f64 {
    10f64.powf(db / 10.0)
}

/// Linear gain over the angle: piecewise cubic, with slopes that keep it monotonic between its points (Fritsch and
/// Butland 1984, known as PCHIP). Each piece is kept as the four ordinates of its Bézier form.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Curve {
    pieces: Vec<Piece>,
    mean: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    from: f64,
    to: f64,
    ordinates: [f64; 4],
}

impl Piece {
    /// De Casteljau's construction.
    fn at(&self, angle: f64) -> f64 {
        let t = (angle - self.from) / (self.to - self.from);
        let mut p = self.ordinates;
        for left in (1..4).rev() {
            for k in 0..left {
                p[k] += t * (p[k + 1] - p[k]);
            }
        }
        p[0]
    }
}

impl Curve {
    fn new(gain_db: &[[f64; 2]]) -> Self {
        let angles: Vec<f64> = gain_db.iter().map(|point| point[0].to_radians()).collect();
        let gains: Vec<f64> = gain_db.iter().map(|point| linear(point[1])).collect();
        let slopes = slopes(&angles, &gains);
        let pieces = (1..angles.len()).map(|k| {
            let third = (angles[k] - angles[k - 1]) / 3.0;
            let (start, end) = (gains[k - 1], gains[k]);
            let ordinates = [start, start + third * slopes[k - 1], end - third * slopes[k], end];
            Piece { from: angles[k - 1], to: angles[k], ordinates }
        });
        let pieces: Vec<Piece> = pieces.collect();
        Self { mean: mean_over_directions(&pieces), pieces }
    }

    fn at(&self, angle: f64) -> f64 {
        let k =
            self.pieces.partition_point(|piece| piece.to < angle).min(self.pieces.len().saturating_sub(1));
        self.pieces.get(k).map_or(0.0, |piece| piece.at(angle.clamp(piece.from, piece.to)).max(0.0))
    }
}

/// Half the integral of gain times sine over the angle, by Simpson's rule on each piece.
fn mean_over_directions(pieces: &[Piece]) -> f64 {
    const PANELS: usize = 128;
    let integral = |piece: &Piece| {
        let step = (piece.to - piece.from) / PANELS as f64;
        let value = |k: usize| {
            let angle = piece.from + step * k as f64;
            piece.at(angle) * angle.sin()
        };
        let inner: f64 = (1..PANELS).map(|k| value(k) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
        (value(0) + inner + value(PANELS)) * step / 3.0
    };
    pieces.iter().map(integral).sum::<f64>() / 2.0
}

/// The slope at each point: between two pieces the harmonic mean of their secants, weighted by their lengths, or 0 at a
/// peak or a trough; at an end by three points, held back so that the piece stays monotonic.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let widths: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let secants: Vec<f64> = y.windows(2).zip(&widths).map(|(w, h)| (w[1] - w[0]) / h).collect();
    let n = x.len();
    if n < 3 {
        return vec![secants.first().copied().unwrap_or(0.0); n];
    }
    let inner = (1..n - 1).map(|k| {
        let (before, after) = (secants[k - 1], secants[k]);
        if before * after <= 0.0 {
            return 0.0;
        }
        let (w1, w2) = (2.0 * widths[k] + widths[k - 1], widths[k] + 2.0 * widths[k - 1]);
        (w1 + w2) / (w1 / before + w2 / after)
    });
    let end = |h: [f64; 2], d: [f64; 2]| {
        let slope = ((2.0 * h[0] + h[1]) * d[0] - h[0] * d[1]) / (h[0] + h[1]);
        match slope * d[0] > 0.0 {
            false => 0.0,
            true if d[0] * d[1] < 0.0 && slope.abs() > 3.0 * d[0].abs() => 3.0 * d[0],
            true => slope,
        }
    };
    let first = end([widths[0], widths[1]], [secants[0], secants[1]]);
    let last = end([widths[n - 2], widths[n - 3]], [secants[n - 2], secants[n - 3]]);
    std::iter::once(first).chain(inner).chain([last]).collect()
}

#[cfg(test)]
mod tests;
