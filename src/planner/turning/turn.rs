//! How far a vehicle turns from one attitude to another, and where it is on the way.
//!
//! Attitudes are `Rz(yaw) Ry(pitch) Rx(roll)`. At one yaw the rate of rotation is
//!
//! ```text
//! |omega|^2 = roll'^2 + pitch'^2        in all: + yaw'^2 - 2 roll' yaw' sin(pitch),
//! ```
//!
//! the axes of roll and pitch being at right angles: roll and pitch are a flat chart, and a path in them is as long as it is
//! drawn. A limit of tilt is `cos(roll) cos(pitch) >= cos(limit)` within quarter turns, a convex set of them (the logarithms of
//! both cosines are concave): what runs straight between two allowed attitudes is allowed all the way.

use std::f64::consts::FRAC_PI_2;

use nalgebra::UnitQuaternion;

use super::super::volume::ways::turn_rad;
use crate::geo::Attitude;

/// Roll, pitch and yaw in radians.
pub type Angles = [f64; 3];

/// How a silent vehicle turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Course {
    /// By the shortest rotation: the least time, through any tilt.
    Shortest,
    /// Roll, pitch and yaw each evenly: within the tilt limit.
    EvenAngles,
}

impl Course {
    /// Of a vehicle that may tilt so far.
    #[must_use]
    pub fn within(tilt_rad: f64) -> Self {
        if tilt_rad >= FRAC_PI_2 { Self::Shortest } else { Self::EvenAngles }
    }

    /// The angle to turn through, or of even angles the largest rate times the time, and how it changes with both ends.
    #[must_use]
    pub fn angle_rad(self, from: &Angles, to: &Angles) -> (f64, [Angles; 2]) {
        match self {
            Self::Shortest => turn_rad(from, to),
            Self::EvenAngles => even_rad(from, to),
        }
    }

    /// The attitude at a share of the way.
    #[must_use]
    pub fn at(self, from: &Angles, to: &Angles, share: f64) -> Attitude {
        match self {
            Self::Shortest => {
                let [a, b] =
                    [from, to].map(|angles| Attitude::from_euler(angles[0], angles[1], angles[2]).rotation());
                // Of two opposite attitudes any way is the shortest.
                let turned = a.try_slerp(&b, share, 1e-9).unwrap_or_else(|| {
                    a * UnitQuaternion::from_axis_angle(
                        &nalgebra::Vector3::x_axis(),
                        share * std::f64::consts::PI,
                    )
                });
                Attitude::from_rotation(turned)
            }
            Self::EvenAngles => {
                let [roll, pitch, yaw] = between(from, to, share);
                Attitude::from_euler(roll, pitch, yaw)
            }
        }
    }
}

/// Each angle at a share of the way.
#[must_use]
pub fn between(from: &Angles, to: &Angles, share: f64) -> Angles {
    [0, 1, 2].map(|k: usize| from[k] + share * (to[k] - from[k]))
}

/// The largest rate while all angles change evenly within one second: at one of the ends, since `sin(pitch)` is monotone
/// within quarter turns.
fn even_rad(from: &Angles, to: &Angles) -> (f64, [Angles; 2]) {
    let [roll, pitch, yaw] = [0, 1, 2].map(|k: usize| to[k] - from[k]);
    let sines = [libm::sin(from[1]), libm::sin(to[1])];
    let end = usize::from(-yaw * roll * sines[1] > -yaw * roll * sines[0]);
    let sine = sines[end];
    let square = roll * roll + pitch * pitch + yaw * yaw - 2.0 * yaw * roll * sine;
    let angle = square.max(0.0).sqrt();
    if angle < 1e-12 {
        return (angle, [[0.0; 3]; 2]);
    }
    let by = [(roll - yaw * sine) / angle, pitch / angle, (yaw - roll * sine) / angle];
    let mut ends = [by.map(|c| -c), by];
    ends[end][1] -= yaw * roll * libm::cos([from[1], to[1]][end]) / angle;
    (angle, ends)
}

/// Roll and pitch drawn towards level until they are within a tilt limit and quarter turns, and how a gradient by them is
/// carried back.
#[derive(Debug, Clone, Copy)]
pub struct Held {
    /// Allowed roll and pitch.
    pub at: [f64; 2],
    given: [f64; 2],
    factor: f64,
    by_given: [f64; 2],
}

impl Held {
    /// Of any roll and pitch.
    #[must_use]
    pub fn new(given: [f64; 2], tilt_rad: f64) -> Self {
        let [roll, pitch] = given;
        let widest = roll.abs().max(pitch.abs());
        let whole = if widest > FRAC_PI_2 { FRAC_PI_2 / widest } else { 1.0 };
        let least = if tilt_rad >= FRAC_PI_2 { f64::NEG_INFINITY } else { libm::cos(tilt_rad) };
        let upright = |factor: f64| libm::cos(factor * roll) * libm::cos(factor * pitch);
        if upright(whole) >= least {
            let by_given = if whole < 1.0 {
                [roll, pitch].map(|c| if c.abs() == widest { -whole / c } else { 0.0 })
            } else {
                [0.0; 2]
            };
            return Self { at: given.map(|c| whole * c), given, factor: whole, by_given };
        }
        let (mut inside, mut outside) = (0.0, whole);
        for _ in 0..60 {
            let middle = 0.5 * (inside + outside);
            if upright(middle) >= least { inside = middle } else { outside = middle }
        }
        let factor = inside;
        let [(sr, cr), (sp, cp)] = given.map(|c| libm::sincos(factor * c));
        let fall = roll * sr * cp + pitch * cr * sp;
        let by_given =
            if fall > 0.0 { [-factor * sr * cp / fall, -factor * cr * sp / fall] } else { [0.0; 2] };
        Self { at: given.map(|c| factor * c), given, factor, by_given }
    }

    /// A gradient by what was given, from one by what is allowed.
    #[must_use]
    pub fn pull(&self, by: [f64; 2]) -> [f64; 2] {
        let along = by[0] * self.given[0] + by[1] * self.given[1];
        [0, 1].map(|k: usize| self.factor * by[k] + along * self.by_given[k])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The rate of a rotation by differences, in radians a unit of the share.
    fn rate(course: Course, from: &Angles, to: &Angles, share: f64) -> f64 {
        const STEP: f64 = 1e-4;
        course.at(from, to, share - STEP).angle_to(&course.at(from, to, share + STEP)) / (2.0 * STEP)
    }

    proptest! {
        #[test]
        fn prop_no_rate_is_above_what_is_promised(
            from in prop::array::uniform3(-1.5..1.5f64),
            to in prop::array::uniform3(-1.5..1.5f64),
            share in 0.01..0.99f64,
        ) {
            for course in [Course::Shortest, Course::EvenAngles] {
                let (angle, _) = course.angle_rad(&from, &to);
                prop_assert!(rate(course, &from, &to, share) <= angle * (1.0 + 1e-5) + 1e-6);
            }
            let yaw_alike = [to[0], to[1], from[2]];
            let (angle, _) = Course::EvenAngles.angle_rad(&from, &yaw_alike);
            prop_assert!((angle - (to[0] - from[0]).hypot(to[1] - from[1])).abs() < 1e-12);
            prop_assert!((rate(Course::EvenAngles, &from, &yaw_alike, share) - angle).abs() < 1e-5);
        }

        #[test]
        fn val_slopes_are_those_of_differences(
            from in prop::array::uniform3(-1.4..1.4f64),
            to in prop::array::uniform3(-1.4..1.4f64),
        ) {
            for course in [Course::Shortest, Course::EvenAngles] {
                let (angle, by) = course.angle_rad(&from, &to);
                // Away from turns that have no direction, or two.
                prop_assume!((0.1..3.0).contains(&angle));
                for (end, own) in [from, to].into_iter().enumerate() {
                    for k in 0..3 {
                        let at = |step: f64| {
                            let mut moved = own;
                            moved[k] += step;
                            let ends = if end == 0 { [moved, to] } else { [from, moved] };
                            course.angle_rad(&ends[0], &ends[1]).0
                        };
                        let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
                        prop_assert!((numeric - by[end][k]).abs() < 1e-4, "{course:?} {end} {k}: {numeric} {by:?}");
                    }
                }
            }
        }

        /// What is held is allowed, and so is all that lies straight between two such.
        #[test]
        fn prop_held_angles_keep_the_tilt_all_the_way(
            a in prop::array::uniform2(-3.0..3.0f64),
            b in prop::array::uniform2(-3.0..3.0f64),
            tilt in 0.05..2.0f64,
            share in 0.0..1.0f64,
        ) {
            let [a, b] = [a, b].map(|given| Held::new(given, tilt).at);
            let [roll, pitch, yaw] = between(&[a[0], a[1], 0.0], &[b[0], b[1], 0.0], share);
            let axis = crate::radio::pattern::antenna_axis(roll, pitch, yaw);
            prop_assert!(axis.z >= tilt.min(FRAC_PI_2).cos() - 1e-12);
            prop_assert!(roll.abs() <= FRAC_PI_2 + 1e-12 && pitch.abs() <= FRAC_PI_2 + 1e-12);
        }

        #[test]
        fn val_gradients_come_back_through_the_limit(given in prop::array::uniform2(-2.0..2.0f64), tilt in 0.2..2.0f64) {
            let held = Held::new(given, tilt);
            // Away from the corner of the square and from the limit itself.
            prop_assume!((given[0].abs() - given[1].abs()).abs() > 1e-3);
            for k in 0..2 {
                let at = |step: f64| {
                    let mut moved = given;
                    moved[k] += step;
                    let [roll, pitch] = Held::new(moved, tilt).at;
                    0.7 * roll - 0.4 * pitch
                };
                let [ahead, here, behind] = [1e-5, 0.0, -1e-5].map(at);
                prop_assume!((ahead - 2.0 * here + behind).abs() < 1e-8);
                let numeric = (ahead - behind) / 2e-5;
                prop_assert!((numeric - held.pull([0.7, -0.4])[k]).abs() < 1e-5);
            }
        }
    }
}
