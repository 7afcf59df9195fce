//! A vehicle's way round a superframe: a periodic cubic B-spline.
//!
//! With n control points c_k, a period T and h = T / n,
//!
//! ```text
//! p(t) = sum over k of B(t / h - k) c_k,     B the uniform cubic B-spline over (-2, 2), indices modulo n,
//! ```
//!
//! which is twice continuously differentiable and comes round again with all its derivatives. On each segment of h seconds it
//! is a cubic inside the convex hull of four control points; its acceleration is linear and its change of acceleration constant
//! there. So bounds of position hold if they hold for control points, and the largest accelerations are found where segments
//! meet. Speeds and distances are bounded by the Bezier points of small pieces, from the safe side. All but positions scale with
//! the control points' distances from each other, and with powers of the period.

use std::ops::Range;

use nalgebra::Vector3;

use crate::geo::{Enu, EnuAcceleration, EnuVelocity};

/// Pieces of a segment by whose Bezier points its speed is bounded: what that adds is below a thousandth of the limit of
/// acceleration times the segment's length.
const PIECES: usize = 16;
/// Longest piece by which distances are bounded, in seconds.
const PIECE_S: f64 = 0.04;
/// Two pieces that reach no farther than this together, in metres, are not divided any more.
const FINEST_M: f64 = 0.05;

/// A piece of a way by its Bezier points, which have it in their midst.
#[derive(Debug, Clone, Copy)]
struct Piece([Enu; 4]);

impl Piece {
    fn middle(&self) -> Enu {
        (self.0[0] + self.0[3]) / 2.0
    }

    /// How far from the middle it is at most.
    fn reach_m(&self) -> f64 {
        self.0.iter().map(|point| (point - self.middle()).norm()).fold(0.0, f64::max)
    }

    /// Pieces of equal length.
    fn parts(self, count: usize) -> impl Iterator<Item = Self> {
        let points = self.0;
        let blossom = move |r: f64, s: f64, t: f64| {
            let first = [0, 1, 2].map(|k: usize| points[k] * (1.0 - r) + points[k + 1] * r);
            let second = [0, 1].map(|k: usize| first[k] * (1.0 - s) + first[k + 1] * s);
            second[0] * (1.0 - t) + second[1] * t
        };
        (0..count).map(move |part| {
            let [a, b] = [part, part + 1].map(|k| k as f64 / count as f64);
            Self([blossom(a, a, a), blossom(a, a, b), blossom(a, b, b), blossom(b, b, b)])
        })
    }

    fn halves(&self) -> [Self; 2] {
        let [a, b, c, d] = self.0;
        let [ab, bc, cd] = [(a + b) / 2.0, (b + c) / 2.0, (c + d) / 2.0];
        let [abc, bcd] = [(ab + bc) / 2.0, (bc + cd) / 2.0];
        let middle = (abc + bcd) / 2.0;
        [Self([a, ab, abc, middle]), Self([middle, bcd, cd, d])]
    }
}

/// A way round.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// After which it repeats, in seconds, positive.
    pub period_s: f64,
    /// Control points in metres, ENU, at least one; the k-th has the most weight `k / n` of a period after the beginning.
    pub control_enu_m: Vec<Enu>,
}

/// Where a vehicle is on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Velocity in m/s, ENU.
    pub velocity_enu_m_s: EnuVelocity,
    /// Acceleration in m/s^2, ENU.
    pub acceleration_enu_m_s2: EnuAcceleration,
}

/// What a way asks of a vehicle at most.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Demand {
    /// Horizontal speed in m/s.
    pub speed_m_s: f64,
    /// Vertical speed in m/s, up or down.
    pub climb_m_s: f64,
    /// Acceleration in m/s^2.
    pub acceleration_m_s2: f64,
    /// Change of acceleration in m/s^3.
    pub jerk_m_s3: f64,
}

/// Weights of the four control points of a segment at a share of it.
#[must_use]
pub fn weights(share: f64) -> [f64; 4] {
    let (s, r) = (share, 1.0 - share);
    [
        r * r * r / 6.0,
        (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
        (3.0 * r * r * r - 6.0 * r * r + 4.0) / 6.0,
        s * s * s / 6.0,
    ]
}

/// The same of the derivative by the share.
#[must_use]
pub fn slopes(share: f64) -> [f64; 4] {
    let (s, r) = (share, 1.0 - share);
    [-0.5 * r * r, 0.5 * (3.0 * s - 4.0) * s, -0.5 * (3.0 * r - 4.0) * r, 0.5 * s * s]
}

/// The same of the second derivative.
#[must_use]
pub fn bends(share: f64) -> [f64; 4] {
    let (s, r) = (share, 1.0 - share);
    [r, 3.0 * s - 2.0, 3.0 * r - 2.0, s]
}

/// The same of the third, anywhere on a segment.
pub const JERKS: [f64; 4] = [-1.0, 3.0, -3.0, 1.0];

/// The segment of n in a period at a time within it, and the share of it that has passed.
#[must_use]
pub fn locate(t_s: f64, period_s: f64, n: usize) -> (usize, f64) {
    let turns = t_s / period_s;
    let at = (turns - turns.floor()) * n as f64;
    let segment = (at.floor() as usize).min(n - 1);
    (segment, (at - segment as f64).clamp(0.0, 1.0))
}

/// The control points that a segment depends on.
#[must_use]
pub fn about(segment: usize, n: usize) -> [usize; 4] {
    [(segment + n - 1) % n, segment % n, (segment + 1) % n, (segment + 2) % n]
}

impl Spline {
    /// One that stays where it is.
    #[must_use]
    pub fn still(at: Enu, period_s: f64, controls: usize) -> Self {
        Self { period_s, control_enu_m: vec![at; controls] }
    }

    fn segment_s(&self) -> f64 {
        self.period_s / self.control_enu_m.len() as f64
    }

    fn sum(&self, segment: usize, weights: [f64; 4]) -> Vector3<f64> {
        let at = about(segment, self.control_enu_m.len());
        // The differences from one of them: of points that are all the same, that point to the last bit.
        let base = self.control_enu_m[at[1]];
        let total: f64 = weights.iter().sum();
        at.iter().zip(weights).map(|(k, w)| (self.control_enu_m[*k] - base) * w).sum::<Vector3<f64>>()
            + base * if total > 0.5 { 1.0 } else { 0.0 }
    }

    /// Where it leads at an instant of any period.
    #[must_use]
    pub fn position(&self, t_s: f64) -> Enu {
        let (segment, share) = locate(t_s, self.period_s, self.control_enu_m.len());
        self.sum(segment, weights(share))
    }

    /// The same with velocity and acceleration.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Instant {
        let (segment, share) = locate(t_s, self.period_s, self.control_enu_m.len());
        let h = self.segment_s();
        Instant {
            position_enu_m: self.sum(segment, weights(share)),
            velocity_enu_m_s: EnuVelocity::from_vector(self.sum(segment, slopes(share)) / h),
            acceleration_enu_m_s2: EnuAcceleration::from_vector(self.sum(segment, bends(share)) / (h * h)),
        }
    }

    /// How its acceleration changes at an instant of any period, in m/s^3.
    #[must_use]
    pub fn jerk_m_s3(&self, t_s: f64) -> Vector3<f64> {
        let h = self.segment_s();
        let (segment, _) = locate(t_s, self.period_s, self.control_enu_m.len());
        self.sum(segment, JERKS) / (h * h * h)
    }

    /// What it asks at most: accelerations exactly, speeds from above.
    #[must_use]
    pub fn demand(&self) -> Demand {
        self.demand_over(0..self.control_enu_m.len())
    }

    /// The same of some segments.
    pub(in crate::planner) fn demand_over(&self, segments: Range<usize>) -> Demand {
        let h = self.segment_s();
        let mut most = Demand::default();
        for segment in segments {
            let acceleration = self.sum(segment, bends(0.0)).norm() / (h * h);
            let jerk = self.sum(segment, JERKS).norm() / (h * h * h);
            most.acceleration_m_s2 = most.acceleration_m_s2.max(acceleration);
            most.jerk_m_s3 = most.jerk_m_s3.max(jerk);
            // The velocity's Bezier points on the segment, and its blossom on each piece of it.
            let ends = [slopes(0.0), slopes(1.0)].map(|w| self.sum(segment, w) / h);
            let middle = ends[0] + self.sum(segment, bends(0.0)) / (2.0 * h);
            let blossom = |s: f64, t: f64| {
                ends[0] * ((1.0 - s) * (1.0 - t))
                    + middle * (s * (1.0 - t) + t * (1.0 - s))
                    + ends[1] * (s * t)
            };
            for piece in 0..PIECES {
                let [a, b] = [piece, piece + 1].map(|k| k as f64 / PIECES as f64);
                for velocity in [blossom(a, a), blossom(a, b), blossom(b, b)] {
                    most.speed_m_s = most.speed_m_s.max(velocity.xy().norm());
                    most.climb_m_s = most.climb_m_s.max(velocity.z.abs());
                }
            }
        }
        most
    }

    /// Whether it keeps so many metres from another way wherever on theirs two vehicles are, as far as pieces of a few centimetres
    /// tell.
    #[must_use]
    pub fn keeps_apart(&self, other: &Self, least_m: f64) -> bool {
        let pieces = |way: &Self| (0..way.control_enu_m.len()).map(|k| way.piece(k)).collect::<Vec<_>>();
        let (own, others) = (pieces(self), pieces(other));
        let mut left: Vec<(Piece, Piece)> =
            own.iter().flat_map(|a| others.iter().map(move |b| (*a, *b))).collect();
        while let Some((a, b)) = left.pop() {
            let reach_m = a.reach_m() + b.reach_m();
            if (a.middle() - b.middle()).norm() - reach_m >= least_m {
                continue;
            }
            if reach_m < FINEST_M {
                return false;
            }
            let halves = if a.reach_m() > b.reach_m() {
                a.halves().map(|a| (a, b))
            } else {
                b.halves().map(|b| (a, b))
            };
            left.extend(halves);
        }
        true
    }

    /// Points whose convex hulls, four and four, hold some segments closely.
    pub(in crate::planner) fn hulls(&self, segments: Range<usize>) -> impl Iterator<Item = [Enu; 4]> + '_ {
        segments.flat_map(|segment| self.piece(segment).parts(self.parts()).map(|part| part.0))
    }

    /// Parts of a segment that are short enough.
    fn parts(&self) -> usize {
        (self.segment_s() / PIECE_S).ceil().max(1.0) as usize
    }

    /// A segment.
    fn piece(&self, segment: usize) -> Piece {
        let at = |weights: [f64; 4]| self.sum(segment, weights);
        let [from, to] = [weights(0.0), weights(1.0)].map(at);
        let [leaves, arrives] = [slopes(0.0), slopes(1.0)].map(at);
        Piece([from, from + leaves / 3.0, to - arrives / 3.0, to])
    }

    /// The mean of its control points.
    #[must_use]
    pub fn centre(&self) -> Enu {
        let base = self.control_enu_m[0];
        let n = self.control_enu_m.len() as f64;
        base + self.control_enu_m.iter().map(|c| c - base).sum::<Vector3<f64>>() / n
    }

    /// Drawn together about its centre: all that it asks of a vehicle shrinks by the factor.
    #[must_use]
    pub fn shrunk(&self, factor: f64) -> Self {
        let centre = self.centre();
        let control_enu_m = self.control_enu_m.iter().map(|c| centre + (c - centre) * factor).collect();
        Self { period_s: self.period_s, control_enu_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spline(points: &[[f64; 3]], period_s: f64) -> Spline {
        Spline { period_s, control_enu_m: points.iter().map(|p| Enu::from(*p)).collect() }
    }

    proptest! {
        #[test]
        fn val_derivatives_are_those_of_differences_and_demands_bound_them(
            points in prop::collection::vec(prop::array::uniform3(-20.0..20.0f64), 4..9),
            others in prop::collection::vec(prop::array::uniform3(-20.0..20.0f64), 9),
            period_s in 5.0..60.0f64,
        ) {
            let way = spline(&points, period_s);
            let other = spline(&others[..points.len()], period_s);
            let demand = way.demand();
            let (mut fastest, mut climb) = (0.0f64, 0.0f64);
            let e = 1e-4;
            for k in 0..400 {
                let t_s = period_s * (f64::from(k) + 0.37) / 400.0;
                let [before, now, after] = [t_s - e, t_s, t_s + e].map(|t| way.at(t));
                let velocity = (after.position_enu_m - before.position_enu_m) / (2.0 * e);
                let own = now.velocity_enu_m_s.vector();
                prop_assert!((velocity - own).norm() < 1e-5 * (1.0 + own.norm()));
                let bend = (after.velocity_enu_m_s.vector() - before.velocity_enu_m_s.vector()) / (2.0 * e);
                let acceleration = now.acceleration_enu_m_s2.vector();
                prop_assert!((bend - acceleration).norm() < 1e-2 * (1.0 + demand.jerk_m_s3 * e));
                prop_assert!(own.xy().norm() <= demand.speed_m_s * (1.0 + 1e-12));
                prop_assert!(own.z.abs() <= demand.climb_m_s * (1.0 + 1e-12));
                prop_assert!(acceleration.norm() <= demand.acceleration_m_s2 * (1.0 + 1e-9));
                let jerk = (after.acceleration_enu_m_s2.vector() - before.acceleration_enu_m_s2.vector()) / (2.0 * e);
                prop_assert!(jerk.norm() <= demand.jerk_m_s3 * (1.0 + 1e-6) + 1e-6);
                (fastest, climb) = (fastest.max(own.xy().norm()), climb.max(own.z.abs()));
            }
            // And not by much more than need be.
            prop_assert!(demand.speed_m_s <= 1.02 * fastest + 1e-3 * demand.acceleration_m_s2 * period_s);
            prop_assert!(demand.climb_m_s <= 1.02 * climb + 1e-3 * demand.acceleration_m_s2 * period_s);
            // Once round, and half as far from the centre.
            prop_assert!((way.position(0.3) - way.position(0.3 + 3.0 * period_s)).norm() < 1e-9);
            // Wherever on their ways two vehicles are, which is never farther than at the same time.
            let spots = |way: &Spline| (0..300).map(|k| way.position(period_s * f64::from(k) / 300.0)).collect::<Vec<_>>();
            let (own, others) = (spots(&way), spots(&other));
            let closest =
                own.iter().flat_map(|a| others.iter().map(move |b| (a - b).norm())).fold(f64::INFINITY, f64::min);
            prop_assert!(!way.keeps_apart(&other, closest + 1e-6));
            let between_m = 2.0 * demand.speed_m_s.max(demand.climb_m_s) * period_s / 300.0;
            let far = Spline { control_enu_m: other.control_enu_m.iter().map(|c| c + Enu::new(80.0, 0.0, 0.0)).collect(), ..other };
            let far_m = own.iter().flat_map(|a| spots(&far).into_iter().map(move |b| (a - b).norm())).fold(f64::INFINITY, f64::min);
            prop_assert!(way.keeps_apart(&far, far_m - between_m - 0.1));
            let half = way.shrunk(0.5).demand();
            prop_assert!((half.speed_m_s / demand.speed_m_s - 0.5).abs() < 1e-9);
            prop_assert!((half.jerk_m_s3 / demand.jerk_m_s3 - 0.5).abs() < 1e-9);
        }
    }

    #[test]
    fn val_one_that_stays_stays_to_the_last_bit() {
        let at = Enu::new(0.1, -7.3, 81.7);
        let way = Spline::still(at, 7.0, 5);
        for k in 0..50 {
            let now = way.at(0.31 * f64::from(k));
            assert_eq!(now.position_enu_m, at);
            assert_eq!(now.velocity_enu_m_s, EnuVelocity::ZERO);
        }
        assert_eq!(way.demand(), Demand::default());
    }
}
