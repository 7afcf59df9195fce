//! Quadratic forms of the antenna axis, and when no axis satisfies a set of them.

use nalgebra::Vector3;

/// A symmetric 3x3 matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Form {
    diagonal: Vector3<f64>,
    /// xy, xz, yz.
    off: Vector3<f64>,
}

impl Form {
    /// `scalar I - weight u u'`.
    pub fn new(scalar: f64, weight: f64, u: &Vector3<f64>) -> Self {
        Self {
            diagonal: u.map(|c| scalar - weight * c * c),
            off: Vector3::new(u.x * u.y, u.x * u.z, u.y * u.z) * -weight,
        }
    }

    /// `self + factor other`.
    pub fn plus(&self, factor: f64, other: &Self) -> Self {
        Self { diagonal: self.diagonal + other.diagonal * factor, off: self.off + other.off * factor }
    }

    /// `y' self y`.
    pub fn at(&self, y: &Vector3<f64>) -> f64 {
        self.diagonal.dot(&y.component_mul(y))
            + 2.0 * (self.off.x * y.x * y.y + self.off.y * y.x * y.z + self.off.z * y.y * y.z)
    }

    /// Whether the matrix less `margin` times its size is positive definite: elimination with the margin taken
    /// off the diagonal first. The margin dwarfs the rounding of three pivots.
    pub fn is_positive(&self, margin: f64) -> bool {
        let d = self.diagonal.add_scalar(-margin * (self.diagonal.amax() + self.off.amax()));
        let [xy, xz, yz] = [self.off.x, self.off.y, self.off.z];
        if !(d.x > 0.0) {
            return false;
        }
        let yy = d.y - xy * xy / d.x;
        let yz = yz - xy * xz / d.x;
        yy > 0.0 && d.z - xz * xz / d.x - yz * yz / yy > 0.0
    }

    /// The smallest eigenvalue and its unit eigenvector, to about 1e-8: a guide, never a proof.
    pub fn smallest(&self) -> (f64, Vector3<f64>) {
        let mean = self.diagonal.sum() / 3.0;
        let d = self.diagonal.add_scalar(-mean);
        let p = ((d.norm_squared() + 2.0 * self.off.norm_squared()) / 6.0).sqrt();
        if p < 1e-14 * mean.abs() || p == 0.0 {
            return (mean, Vector3::x());
        }
        let o = self.off;
        let determinant =
            d.x * (d.y * d.z - o.z * o.z) - o.x * (o.x * d.z - o.z * o.y) + o.y * (o.x * o.z - d.y * o.y);
        let angle = (determinant / (2.0 * p * p * p)).clamp(-1.0, 1.0).acos() / 3.0;
        let value = 2.0 * p * (angle + std::f64::consts::TAU / 3.0).cos();
        // The eigenvector is orthogonal to the rows of (matrix - value I); the longest cross product is safest.
        let rows = [
            Vector3::new(d.x - value, o.x, o.y),
            Vector3::new(o.x, d.y - value, o.z),
            Vector3::new(o.y, o.z, d.z - value),
        ];
        let crosses = [rows[0].cross(&rows[1]), rows[0].cross(&rows[2]), rows[1].cross(&rows[2])];
        let mut best = crosses[0];
        for c in &crosses[1..] {
            if c.norm_squared() > best.norm_squared() {
                best = *c;
            }
        }
        let norm = best.norm();
        if norm > 1e-9 * p * p {
            return (value + mean, best / norm);
        }
        // A double eigenvalue: anything orthogonal to the longest row.
        let row = if rows[0].norm_squared() > rows[2].norm_squared() { rows[0] } else { rows[2] };
        let other = if row.x.abs() < row.norm() * 0.6 { Vector3::x() } else { Vector3::y() };
        (value + mean, row.cross(&other).try_normalize(0.0).unwrap_or_else(Vector3::z))
    }
}

/// Two axes and the share of the first: where the smallest eigenvalue of a combination is largest, it is that of both.
pub(super) type Mixture = ([Vector3<f64>; 2], f64);

/// [`exclude`] by mixtures of two axes, of which `tightest` gives the tightest in the mean, with a label. Of a combination that is
/// positive definite the weights by label.
pub(super) fn exclude_mixtures<const LABELS: usize>(
    tightest: impl Fn(&Mixture) -> (f64, Form, usize),
    hint: &Vector3<f64>,
    margin: f64,
    steps: usize,
) -> Result<[f64; LABELS], Mixture> {
    let mut mixture = ([*hint; 2], 1.0);
    let (at_hint, mut current, label) = tightest(&mixture);
    let mut weights = [0.0; LABELS];
    weights[label] = 1.0;
    if at_hint <= 0.0 {
        return Err(mixture);
    }
    let (mut value, axis) = current.smallest();
    mixture = ([axis; 2], 1.0);
    for _ in 0..steps {
        if value > 0.0 && current.is_positive(margin) {
            return Ok(weights);
        }
        let (at_mixture, form, label) = tightest(&mixture);
        if at_mixture <= 0.0 {
            break;
        }
        let (share, form, found, at) = line_search_mixture(&current, &form, margin);
        if found <= value {
            break;
        }
        (current, value, mixture) = (form, found, at);
        weights.iter_mut().for_each(|w| *w *= 1.0 - share);
        weights[label] += share;
    }
    if value > 0.0 && current.is_positive(margin) { Ok(weights) } else { Err(mixture) }
}

/// [`line_search`], with the mixture of axes that has no slope.
fn line_search_mixture(a: &Form, b: &Form, margin: f64) -> (f64, Form, f64, Mixture) {
    let step = b.plus(-1.0, a);
    let (value, axis) = a.smallest();
    let (mut lo, mut lo_value, mut lo_slope, mut lo_axis) = (0.0, value, step.at(&axis), axis);
    let (end, end_axis) = b.smallest();
    let (mut hi, mut hi_value, mut hi_slope, mut hi_axis) = (1.0, end, step.at(&end_axis), end_axis);
    if lo_slope <= 0.0 {
        return (0.0, *a, value, ([axis; 2], 1.0));
    }
    if hi_slope >= 0.0 {
        return (1.0, *b, end, ([end_axis; 2], 1.0));
    }
    let mut best = if end > value { (1.0, *b, end) } else { (0.0, *a, value) };
    for _ in 0..20 {
        // The tangents meet above the maximum.
        let meet = (hi_value - lo_value + lo_slope * lo - hi_slope * hi) / (lo_slope - hi_slope);
        let ceiling = lo_value + lo_slope * (meet - lo);
        if !(meet > lo && meet < hi) || ceiling - best.2 < 1e-9 * ceiling.abs() {
            break;
        }
        let form = a.plus(meet, &step);
        let (value, axis) = form.smallest();
        let slope = step.at(&axis);
        if value > best.2 {
            best = (meet, form, value);
            if value > 0.0 && form.is_positive(margin) {
                break;
            }
        }
        if slope > 0.0 {
            (lo, lo_value, lo_slope, lo_axis) = (meet, value, slope, axis);
        } else {
            (hi, hi_value, hi_slope, hi_axis) = (meet, value, slope, axis);
        }
    }
    (best.0, best.1, best.2, ([lo_axis, hi_axis], -hi_slope / (lo_slope - hi_slope)))
}

/// What is known about `exists y, |y| = 1: y' F_j y <= 0 for all j`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Axis {
    /// No such axis: some convex combination of the forms is positive definite, with `margin` to spare.
    None,
    /// This axis is one, or the search gave up near it.
    Maybe(Vector3<f64>),
}

/// Looks for a convex combination of forms that is positive definite.
///
/// `tightest` gives, at an axis, the largest value there of the inequalities behind the forms, and a form below
/// them all that is tight at this axis. The smallest eigenvalue is concave in the weights: from the form tight at
/// `hint`, repeatedly a line search towards the form tight at the current eigenvector (Frank and Wolfe), by the
/// intersection of the tangents at both ends of the bracket (which also proves failure early). For one and two
/// forms the answer is exact up to the margin: the joint range of two quadratic forms on the sphere in three
/// dimensions is convex (Brickman 1961). For more it may miss a combination, or none may exist although no axis
/// does: a relaxation.
pub(super) fn exclude(
    tightest: impl Fn(&Vector3<f64>) -> (f64, Form),
    hint: &Vector3<f64>,
    margin: f64,
    steps: usize,
) -> Axis {
    let (at_hint, mut current) = tightest(hint);
    if at_hint <= 0.0 {
        return Axis::Maybe(*hint);
    }
    let (mut value, mut axis) = current.smallest();
    for _ in 0..steps {
        if value > 0.0 && current.is_positive(margin) {
            return Axis::None;
        }
        let (at_axis, form) = tightest(&axis);
        if at_axis <= 0.0 {
            break;
        }
        let (form, new_value, new_axis) = line_search(&current, value, &axis, &form, margin);
        if new_value <= value {
            break;
        }
        (current, value, axis) = (form, new_value, new_axis);
    }
    if value > 0.0 && current.is_positive(margin) { Axis::None } else { Axis::Maybe(axis) }
}

/// Maximises the smallest eigenvalue on the segment from `a` (whose smallest eigenpair is given) to `b`.
fn line_search(
    a: &Form,
    value: f64,
    axis: &Vector3<f64>,
    b: &Form,
    margin: f64,
) -> (Form, f64, Vector3<f64>) {
    let step = b.plus(-1.0, a);
    let (mut lo, mut lo_value, mut lo_slope) = (0.0, value, step.at(axis));
    let (end, end_axis) = b.smallest();
    let (mut hi, mut hi_value, mut hi_slope) = (1.0, end, step.at(&end_axis));
    let mut best = if end > value { (*b, end, end_axis) } else { (*a, value, *axis) };
    if hi_slope >= 0.0 {
        return best;
    }
    for _ in 0..20 {
        // The tangents meet above the maximum.
        let meet = (hi_value - lo_value + lo_slope * lo - hi_slope * hi) / (lo_slope - hi_slope);
        let ceiling = lo_value + lo_slope * (meet - lo);
        if !(meet > lo && meet < hi) || ceiling <= 0.0 || ceiling - best.1 < 1e-10 {
            break;
        }
        let form = a.plus(meet, &step);
        let (value, axis) = form.smallest();
        let slope = step.at(&axis);
        if value > best.1 {
            best = (form, value, axis);
            if value > 0.0 && form.is_positive(margin) {
                break;
            }
        }
        if slope > 0.0 {
            (lo, lo_value, lo_slope) = (meet, value, slope);
        } else {
            (hi, hi_value, hi_slope) = (meet, value, slope);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, SymmetricEigen};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const MARGIN: f64 = 1e-9;

    impl Form {
        fn matrix(&self) -> Matrix3<f64> {
            let (d, o) = (self.diagonal, self.off);
            Matrix3::new(d.x, o.x, o.y, o.x, d.y, o.z, o.y, o.z, d.z)
        }
    }

    /// The least eigenvalue, by nalgebra.
    fn least(matrix: Matrix3<f64>) -> f64 {
        SymmetricEigen::new(matrix).eigenvalues.min()
    }

    fn excluded<const FORMS: usize>(forms: &[Form; FORMS], hint: &Vector3<f64>) -> Option<[f64; FORMS]> {
        let tightest = |&(axes, first): &Mixture| {
            let mean = |form: &Form| first * form.at(&axes[0]) + (1.0 - first) * form.at(&axes[1]);
            let values = forms.iter().enumerate().map(|(label, form)| (mean(form), *form, label));
            values.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
        };
        exclude_mixtures(tightest, hint, MARGIN, 12).ok()
    }

    #[test]
    fn prop_axes_are_excluded_by_a_positive_combination_and_where_two_forms_have_one_it_is_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(41);
        let mut direction = || loop {
            let u = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            if let Some(u) = u.try_normalize(0.1) {
                return (u, rng.random_range(-0.5..0.7), rng.random_range(-1.0..2.0));
            }
        };
        let mut counts = [[0; 2]; 2];
        for _ in 0..400 {
            let forms: [Form; 3] = std::array::from_fn(|_| {
                let (u, scalar, weight) = direction();
                Form::new(scalar, weight, &u)
            });
            let hint = direction().0;
            if let Some(weights) = excluded(&forms, &hint) {
                let sum: f64 = weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-12 && weights.iter().all(|w| *w >= 0.0), "{weights:?}");
                let combined = forms.iter().zip(weights).map(|(form, w)| form.matrix() * w).sum();
                assert!(least(combined) > 0.0, "{forms:?} {weights:?}");
                counts[0][0] += 1;
            }
            counts[0][1] += 1;
            let [first, second, _] = forms;
            let shares = (0..=1000).map(|k| f64::from(k) * 1e-3);
            let best = shares
                .map(|share| least(first.matrix() * (1.0 - share) + second.matrix() * share))
                .fold(f64::NEG_INFINITY, f64::max);
            let found = excluded(&[first, second], &hint).is_some();
            assert!(found || best < 1e-3, "{first:?} {second:?}: {best}");
            assert!(!found || best > -1e-2, "{first:?} {second:?}: {best}");
            counts[1][0] += usize::from(found);
            counts[1][1] += 1;
        }
        println!("of three and of two forms, excluded of tried: {counts:?}");
        assert!(counts.iter().all(|[some, all]| 5 * some > *all && 5 * some < 4 * all), "{counts:?}");
    }
}
