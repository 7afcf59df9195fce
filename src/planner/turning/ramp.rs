//! One vehicle's way off its standing attitude, while it is still on the air for its user, or already on for the next: a
//! polyline in roll and pitch, passed at the full rate as late as it can be.
//!
//! Where nothing is gained by being off the standing attitude longer than need be, this is the best way along a given line:
//! `back` seconds times the rate before its end the vehicle is that far back on the line, and before that it stands.

/// Corners beside the standing attitude.
pub const CORNERS: usize = 2;

/// A leg is never shorter than this, in radians: the direction of none is no direction.
const SHORTEST_RAD: f64 = 1e-9;

/// From the standing attitude to the one in which the vehicle falls silent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ramp {
    points: [[f64; 2]; CORNERS + 1],
    lengths: [f64; CORNERS],
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

fn add(sum: &mut [f64; 2], scale: f64, by: [f64; 2]) {
    sum[0] += scale * by[0];
    sum[1] += scale * by[1];
}

impl Ramp {
    /// By its corners; the last one is its end.
    #[must_use]
    pub fn new(standing: [f64; 2], corners: [[f64; 2]; CORNERS]) -> Self {
        let [first, last] = corners;
        let points = [standing, first, last];
        let length = |k: usize| {
            let leg = minus(points[k + 1], points[k]);
            (dot(leg, leg) + SHORTEST_RAD * SHORTEST_RAD).sqrt()
        };
        Self { points, lengths: [length(0), length(1)] }
    }

    /// Of a vehicle that stays.
    #[must_use]
    pub fn none(standing: [f64; 2]) -> Self {
        Self::new(standing, [standing; CORNERS])
    }

    /// How long the line is, in radians.
    #[must_use]
    pub fn length_rad(&self) -> f64 {
        if self.points.iter().all(|point| *point == self.points[0]) { 0.0 } else { self.lengths.iter().sum() }
    }

    /// Roll and pitch at its end.
    #[must_use]
    pub fn end(&self) -> [f64; 2] {
        self.points[CORNERS]
    }

    /// The same, drawn together about the standing attitude.
    #[must_use]
    pub fn shrunk(&self, factor: f64) -> Self {
        let [standing, corners @ ..] = self.points;
        Self::new(
            standing,
            corners.map(|corner| [0, 1].map(|k: usize| standing[k] + factor * (corner[k] - standing[k]))),
        )
    }

    /// The leg so far back from the end, and the share of it that is back.
    fn locate(&self, back_rad: f64) -> Option<(usize, f64)> {
        let [first, last] = self.lengths;
        if back_rad < last {
            Some((1, back_rad / last))
        } else if back_rad < first + last {
            Some((0, (back_rad - last) / first))
        } else {
            None
        }
    }

    /// Roll and pitch so far back from the end.
    #[must_use]
    pub fn at(&self, back_rad: f64) -> [f64; 2] {
        let Some((leg, share)) = self.locate(back_rad) else { return self.points[0] };
        [0, 1]
            .map(|k: usize| self.points[leg + 1][k] + share * (self.points[leg][k] - self.points[leg + 1][k]))
    }

    /// Carries a gradient by roll and pitch so far back to the corners, and returns it by the way back.
    pub fn pull(&self, back_rad: f64, by: [f64; 2], out: &mut [[f64; 2]; CORNERS]) -> f64 {
        let Some((leg, share)) = self.locate(back_rad) else { return 0.0 };
        let length = self.lengths[leg];
        // Along the leg, backwards, for each share of it.
        let along = dot(by, minus(self.points[leg], self.points[leg + 1]));
        let direction = minus(self.points[leg + 1], self.points[leg]).map(|c| c / length);
        if leg == 1 {
            add(&mut out[1], 1.0 - share, by);
            add(&mut out[1], -along * share / length, direction);
            add(&mut out[0], share, by);
            add(&mut out[0], along * share / length, direction);
        } else {
            add(&mut out[0], 1.0 - share, by);
            add(&mut out[0], -along * share / length, direction);
            // The longer the last leg, the nearer to the standing attitude the first is left.
            let last = minus(self.points[2], self.points[1]).map(|c| c / self.lengths[1]);
            add(&mut out[0], along / length, last);
            add(&mut out[1], -along / length, last);
        }
        along / length
    }

    /// Carries a gradient by the length to the corners.
    pub fn pull_length(&self, by: f64, out: &mut [[f64; 2]; CORNERS]) {
        let [first, last] = [0, 1]
            .map(|leg: usize| minus(self.points[leg + 1], self.points[leg]).map(|c| c / self.lengths[leg]));
        add(&mut out[0], by, first);
        add(&mut out[0], -by, last);
        add(&mut out[1], by, last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prop_never_faster_than_the_way_back(
            corners in prop::array::uniform2(prop::array::uniform2(-0.5..0.5f64)),
            back in prop::array::uniform2(0.0..1.5f64),
        ) {
            let ramp = Ramp::new([0.2, -0.1], corners);
            let [a, b] = back.map(|back| ramp.at(back));
            prop_assert!(dot(minus(a, b), minus(a, b)).sqrt() <= (back[0] - back[1]).abs() + 1e-15);
            prop_assert_eq!(ramp.at(0.0), corners[1]);
            prop_assert_eq!(ramp.at(ramp.length_rad()), [0.2, -0.1]);
            let half = ramp.shrunk(0.5);
            prop_assert!((half.length_rad() - 0.5 * ramp.length_rad()).abs() < 1e-8);
        }

        #[test]
        fn val_slopes_are_those_of_differences(
            corners in prop::array::uniform2(prop::array::uniform2(-0.5..0.5f64)),
            share in 0.02..0.98f64,
        ) {
            let ramp = Ramp::new([0.6, -0.7], corners);
            let back = share * ramp.length_rad();
            // Away from the corner, where the slope jumps.
            prop_assume!((back - ramp.lengths[1]).abs() > 1e-4 && ramp.lengths[1] > 1e-3);
            let by = [0.3, -0.8];
            let (mut out, mut out_length) = ([[0.0; 2]; 2], [[0.0; 2]; 2]);
            let by_back = ramp.pull(back, by, &mut out);
            ramp.pull_length(1.0, &mut out_length);
            let value = |corners, back| dot(Ramp::new([0.6, -0.7], corners).at(back), by);
            prop_assert!(((value(corners, back + 1e-7) - value(corners, back - 1e-7)) / 2e-7 - by_back).abs() < 1e-5);
            for corner in 0..2 {
                for k in 0..2 {
                    let moved = |step: f64| {
                        let mut moved = corners;
                        moved[corner][k] += step;
                        moved
                    };
                    let numeric = (value(moved(1e-7), back) - value(moved(-1e-7), back)) / 2e-7;
                    prop_assert!((numeric - out[corner][k]).abs() < 1e-5, "{corner} {k}: {numeric} {out:?}");
                    let length = |step: f64| Ramp::new([0.6, -0.7], moved(step)).length_rad();
                    prop_assert!(((length(1e-7) - length(-1e-7)) / 2e-7 - out_length[corner][k]).abs() < 1e-5);
                }
            }
        }
    }
}
