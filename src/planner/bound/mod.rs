//! How good can a plan be? Upper bounds on the secrecy rate that no configuration exceeds.
//!
//! # 1. The problem and what is claimed
//! Notation of the paper: user at the origin, eavesdroppers `j` at `e_j`, vehicle I transmits and J jams. With
//! `rho_v = b0 Pmax_v / s^2` (m^2), `G = 1 - <u, Y>^2` the gain of axis `Y` towards `u`, `d` distances, `u_J` the jammer's
//! share of its power,
//!
//! `a_j = rho_I G_Ij / d_Ij^2`, `b_j = rho_J u_J G_Jj / d_Jj^2`, `A_j = log2(1 + a_j / (1 + b_j))`, `R = A_0 - max_j A_j`.
//!
//! `P_I = Pmax` without loss: `log2((1 + x a) / (1 + x c))` rises with `x` where it is positive. *Claim* of every bound
//! `U`: no admissible poses and powers have a rate above `U`. Every constraint of the field only shrinks the admissible
//! set: geofence, altitudes, separation and each vehicle's power are used; tilt limits and level airframes are relaxed
//! (all axes are admitted), except by the cap, and no-fly areas are left out: where there are any, a bound is one of the larger
//! problem without them, and its gap may be theirs. What each kind bounds and how firmly:
//!
//! | kind | bounds | applies to | firmness |
//! |---|---|---|---|
//! | `cap` | `R` at every draw of everything | every problem | proven, rounding included |
//! | `branch-and-bound` | `R` | no jitter, positions certain, floors or none | proven, rounding included |
//! | `without-jitter` | `R` at every draw of the noise | any jitter, positions certain, floors or none | proven, loose |
//! | `decoupled` | `E[(A_0 - max_j A_j)^+]` | Euler jitter of roll and pitch at yaw 0, or none and floors; positions certain | up to section 4 |
//! | `decoupled-signed` | `E[A_0 - max_j A_j]` | the same with scattered waves | up to section 4 |
//! | `branch-and-bound-signed` | `E[A_0 - max_j A_j]` over scattered waves | any jitter, which is left out; positions certain | proven, loose |
//!
//! Antennas are dipoles: `G = F + W sin^2` with `F = f`, `W = 1 - f` of a floor f. The best that a budget of boxes shows is
//! given, never above the cap. Over uncertain positions the rate reported is a mean over them, which no rate at the
//! estimates bounds: the cap alone is given (without jitter little is lost: the optimum lies half a percent below it).
//!
//! The **cap** ([`cap`](super::cap())) is `R <= A_0 <= log2(1 + rho_I / d_min^2)`.
//!
//! # 2. Without jitter: branch and bound over both positions
//! *Theorem.* If every pair of boxes of a finite cover of all pairs of admissible positions is excluded by the test below
//! at `T > 0`, no configuration has `R > T`. *Proof.* Suppose one has, `p_I` and `p_J` in a pair of boxes. Then in turn:
//!
//! 1. *Interference budget.* `1 + b_0 = a_0 / Gamma_0 < rho_I / (d_0^2 (2^T - 1))`, so `b_0 <= k`; a negative `k` excludes.
//! 2. *Jamming.* Angles between lines satisfy the triangle inequality, so
//!    `sin(Y_J, u_Jj) <= sin(u_J0, u_Jj) + sin(Y_J, u_J0)`, and `b_0 <= k` bounds the last. Hence
//!    `sqrt(b_j) <= sqrt(rho_J) sin(u_J0, u_Jj) / d_Jj + sqrt(k) d_J0 / d_Jj`, and never above `sqrt(rho_J) / d_Jj`.
//!    By the law of sines `sin(u_J0, u_Jj) = L_j sin(alpha) / d_Jj`, `L_j` the distance from user to eavesdropper and
//!    `alpha` the angle at the user, which a box changes by at most its own half-angle. This gives `B_j >= b_j`.
//! 3. *Axis.* With `q_j = 1 / (1 + B_j)` the axis of I satisfies `2^T (1 + q_j a_j) < 1 + a_0` for every `j`: quadratic
//!    forms in `Y_I`. Over I's box: `a_0 <= rho_I / d_min^2 (1 - (|<Y, u>| - e)_+^2)` with `e` the largest change of the
//!    direction, and, since inversion about `e_j` moves `v_j = (e_j - p) / d_j^2` by `|p - c| / (d_j(p) d_j(c))`,
//!    `sqrt(a_j / rho_I) = |Y x v_j| >= |Y x v_j(c)| - r / (d_min d_c)`. The squares of the differences are bounded
//!    by forms, `(x - e)_+^2 >= (1 - t) x^2 - (1/t - 1) e^2` for every `t` in (0, 1]: Cauchy's inequality.
//! 4. *Exclusion.* If a convex combination of the forms `F_{j,t}` is positive definite, no axis makes all of them negative:
//!    a contradiction. Which `j` and `t` enter is decided by column generation at the least eigenvector (`form`). For
//!    `N <= 2` and fixed `t` nothing is lost (Brickman's convexity theorem); for `N > 2` it is a relaxation.
//!
//! Boxes not excluded are halved where the inequality at the resisting axis loses most. A true configuration at the
//! centres may refute the threshold. Within a millimetre of a node, where the link is weaker than the formulas say,
//! eavesdroppers count as deaf. *Rounding*: distances, gains and the test of definiteness carry a relative margin of
//! 1e-11, a thousand times the rounding of the operations in between.
//!
//! *With floors*, `G = f + (1 - f) sin^2`, J's null leaks, and its power is worth a choice of its own. The range of `b_0`
//! becomes a seventh side of a box, `[b, k]`, at first all that step 1 leaves. In step 1 the user's SINR is at most
//! `a_0 / (1 + b)`, and `k` the box's own. In step 2, with `K = k d_J0^2 / rho_J`, `s = sin(u_J0, u_Jj)` and
//! `g = sin(Y_J, u_J0)`, `b_0 <= k` reads `u (f + (1 - f) g^2) <= K`, so `u <= U = min(1, K / f)` and
//! `b_j d_Jj^2 / rho_J <= u f + u (1 - f) (s + g)^2 <= K + (1 - f) u s^2 + 2 s sqrt((1 - f) u (K - f u))`. With
//! `v = f u / K` the last two are `a v + b sqrt(v (1 - v))` but for a factor, concave and largest at
//! `v = (1 + a / sqrt(a^2 + b^2)) / 2`, or at `U` if that is less. In step 3 the forms are those of
//! `f |Y|^2 + (1 - f) |Y x u|^2`.
//!
//! *With scattered waves* the received gain is `|sqrt(k G) + sqrt((1 - k) m) z|^2` (`radio::fading`), and by Jensen's
//! inequality, used as in section 3, `R <= log2(1 + E a_0 + E b_0) - E log2(1 + b_0) - max_j log2(1 + a'_j / (1 + E b_j))`,
//! `a'_j = exp(E ln a_j)`. Of the first two terms `log2(1 + E a_0 / (1 + E b_0))` is one part; the other,
//! `log2(1 + E b_0) - E log2(1 + b_0)`, is largest where `b_0` has no direct path, and grows with `E b_0`: a box takes its
//! largest interference (`Links::shortfall`). Means are gains of the form `F + W sin^2` again, those of the user and of
//! eavesdroppers with an F and a W each, so that step 2 reads, with `F_0`, `W_0` of J towards the user and `F_1`, `W_1`
//! towards eavesdroppers, `b_j d_Jj^2 / rho_J <= u F_1 + u W_1 (s + g)^2`, `u (F_0 + W_0 g^2) <= K`. `a'_j` is convex in
//! `G_j`, and three of its tangents stand for it, each a gain of that form (`Reach`): in step 3 every eavesdropper has
//! three forms.
//!
//! *Under jitter* of any law, with `[.]^+` inside or not, the bound holds as it stands: at each draw of the noise `R` is the
//! rate of a configuration of the problem without noise (all axes are admitted, so noise past a tilt limit is covered),
//! and a mean does not exceed the supremum.
//!
//! # 3. With jitter: the decoupled bound
//! *Assumptions.* Euler jitter of roll and pitch, independent Gaussian, at yaw 0, or no jitter; positions certain; the
//! airspace more than a millimetre from every node. It heeds what blurs a null; where nothing does, section 2 is sharper.
//! All eavesdroppers up to three, of more those two of the nearest to the user against which the planner does worst: dropping
//! others from the maximum only raises the rate. Bounded is `V = E[(A_0 - max_j A_j)^+]`; with scattered waves that without `[.]^+`.
//!
//! *Theorem.* With `F`, `L`, `S` and `y` as below, `V > T` implies `T < max_s [F(s) - L(s) + y] + log2(1 + S / (2^T - S))`;
//! `y` is what negative draws add, 0 where none are taken up.
//!
//! 1. *User.* For fixed J `A_0` is concave in `a_0`, and `log2(1 + E a_0 + b_0)` in `b_0`: by Jensen's inequality, twice,
//!    `E A_0 <= log2(1 + E a_0) + log2(1 + x) - l`, `l = E log2(1 + b_0)`, `x = E b_0 / (1 + E a_0)`. Let `E b_0 <= S 2^l`.
//!    From `2^T < 2^(E A_0) <= (1 + E a_0) (1 + x) 2^-l` follows `x < S (1 + x) / 2^T`, so `x < S / (2^T - S)`. `S = 4.5`
//!    is used: `E b_0 / 2^l <= E G / exp(E ln G)`, which is `e^gamma = 1.78` for a null under isotropic noise and
//!    `2 e^gamma = 3.56` for noise along one angle. A floor makes it less (its derivative in F is Jensen's inequality
//!    again), no noise 1, and scattered waves `e^gamma` times as much at most.
//! 2. *Eavesdroppers.* `max_j A_j` is convex in the `b_j` and the two noises are independent: by Jensen's inequality over J,
//!    `E max_j A_j >= E_I max_j log2(1 + a_j 2^-s_j)`, `s_j = log2(1 + E b_j)`.
//! 3. *Interface.* J enters through `l` and `s` alone. `F(s)` is the largest `log2(1 + E a_0) - E max_j log2(1 + a_j 2^-s_j)`
//!    over I's poses, `L(s)` the least `l` over J's poses and powers with `E b_j >= 2^s_j - 1`. Both rise in every `s_j`. Two
//!    problems of five variables that meet on one number an eavesdropper take the place of one of eleven. For `L` each pair of
//!    eavesdroppers is taken by itself, and the pair that asks for the most counts.
//! 4. *J's side* (`jammer`). Let the axis lie at the angle `t` from the exact null. Then `E G_Jj <= sin^2(psi_j) + 2.5 sigma^2`,
//!    `psi_j` the angle between axis and line, so with `psi_j <= angle(u_J0, u_Jj) + t`
//!    `sqrt(k_j) = (d_J0/d_Jj) sqrt(E G_Jj) <= (d_J0/d_Jj) (sqrt(sin^2(u_J0, u_Jj) + 2.5 sigma^2) + t)`, and never above
//!    `d_J0/d_Jj`. The least power per area `beta = rho_J u_J / d_J0^2` is `max_j (2^s_j - 1) / k_j`, and `l` depends on
//!    `beta`, on `t` and on the roll of the line to the user. Poses are put into *classes* by roll and `t`. Of each class
//!    the least `l` over `beta` is tabulated once a noise; and the least `beta` over all positions, for what is wanted of
//!    the first eavesdropper, by branch and bound once for each ratio of what is wanted of both: all levels of `s` share
//!    it. Over a box of positions `ln k_j` is bounded by its tangent at the centre plus half the largest curvature
//!    (`(d_J0/d_Jj) sin = |p x e_j| / d_Jj^2` has closed ones), and a maximum of two by every mean of both, so that boxes
//!    about a stationary point lose to second order only. Neighbouring ratios bound each other: the least `beta` rises
//!    with the ratio, and by no more than it. `L` is the least over classes; classes that cannot be the least are never
//!    refined. `l` is convex in `ln beta`, so that tangents interpolate from below. Of the circle of axes at angle `t` a few
//!    bearings are taken. About the pole, where the law changes fast, it is cut into arcs of roll offset, each taken at its least
//!    pitch offset; or, where that says little, it is taken at once: no axis is turned by more than `w`,
//!    `sin^2(w/2) = sin^2(x/2) + sin^2(y/2)` of the noise `x`, `y`, so `l >= E log2(1 + beta sin^2((t - w)_+))`.
//! 5. *Means over one vehicle's noise* (`law`). With roll and pitch as latitude and longitude,
//!    `cos(psi) = sin(roll) sin(roll_line) + cos(roll) cos(roll_line) cos(y)`, `y` the difference of pitch with its noise.
//!    A function that grows with the size of an angle has, under symmetric unimodal noise, a mean that grows with the
//!    offset (Anderson's inequality): over a box the least offset counts, and a box that holds a null loses nothing. So
//!    at each roll the least offset of pitch is taken; then at each pitch the gain is
//!    `1 - (1 - cos^2(roll_line) sin^2(y)) cos^2(x)`, `x` the roll less the one nearest to the line on that meridian,
//!    which is symmetric in `x` modulo half a turn: the least `|x|` over the box counts. That nearest roll lies beyond
//!    the line's by an angle of tangent `s c (1 - cos y) / (1 - c^2 (1 - cos y))`, `s`, `c` of the line's roll. It so
//!    comes nearer to an axis beyond the line, by the largest such angle of the box at most, and goes away from one on
//!    the other side, by the least: the latter is used where all offsets and pitches stay within a right angle. Between an
//!    axis and a line across the pole all this says little: there the angle `o` between them, least over the box, is lessened by
//!    `w` at each draw, as at the end of step 4, if that says more.
//! 6. *Floor.* Every axis has `psi_1 + psi_2 >=` the angle between the lines to two eavesdroppers, so
//!    `max_j A_j >= log2(1 + z)` at every draw: each mean is taken of `max(1 + c_j G_j, 1 + z)`, which keeps most of the
//!    maximum inside the expectation.
//! 7. *I's side* (`decoupled`, `view`, `hearing`). Boxes of I's position carry a box of `s`; its axes are all excluded at once, as in
//!    section 2. Let `q_j` be the squared sine of the angle between axis and line. `2^(E log2 max(1 + c G_j, 1 + z))` has a greatest
//!    convex minorant over `q_j` (a *curve*): of the least over bearings, at angles of a grid, of lines as steep as the box's
//!    steepest. In steps of `ln c` it is tabulated, between them its logarithm lies above its tangent. Each straight piece of a curve
//!    is a quadratic form in the axis. So is `1 + E a_0`: `E G = 1 - E<u, Y>^2 <= 1 - <u, E Y>^2`, and `|E Y - Y| <= sigma^2`. No axis
//!    has a rate of `R` if a convex combination of the forms `2^R (a + b q_j) - (1 + E a_0)`, over pieces and eavesdroppers, is positive
//!    definite. Over a box of positions the user's distance is the least, and `c` what the least ratio of both squared distances makes of
//!    it: farther off the user's term falls by a factor and `c` by no more, so that the rate rises by `2^-T log2` of that factor at most.
//!    An axis may be told in any frame. Where the frame turns with the line to one eavesdropper as I goes from the box's centre to where
//!    it is, that line stays, and others drift from where they are at the centre (`frame`); where it does not turn, each line is off by
//!    the largest angle to a corner. Boxes that resist take the frame in which the rate at the axis that resists is least. To find the
//!    combination, the form that is tightest at the present one's least eigenvector joins it; where the two least eigenvalues have
//!    met, the one that is tightest in the mean over both, weighted so that the present combination is at its best. A combination
//!    also bounds the rate of lower `s`: where `s_j` is lower by `d_j`, `j` hears `2^(r_j d_j)` times as much, `r_j` the least slope
//!    of its curve's logarithm over that of `c`; the weights divided by these factors, and made to add up to one again, show a rate
//!    lower by `-log2(sum of w_j 2^(-r_j d_j))`. So one combination serves all parts of the box of `s`, and `L` is taken at each part's
//!    lower corner. Parts where `F - L` stays below the threshold fall away, and the halves of a box of positions inherit what is
//!    left of `s`; no part left excludes the box.
//!
//! 8. *Negative draws.* `A_j` is convex in `b_j`: let `A'_j` be its tangent at `E b_j`, taken at `min(a_j, alpha_j)`. Then
//!    `A'_j <= A_j`, its mean over J is `log2(1 + min(a_j, alpha_j) 2^-s_j)`, and `A'_j <= c` at every draw,
//!    `c = max_j log2(1 + alpha_j 2^-s_j) + 1/ln 2`, since the slope times `E b_j` is below `1/ln 2`. So
//!    `(A_0 - max_j A_j)^+ <= A_0 - max_j A'_j + (c - A_0)^+`, and as `y^+ <= 2^y / (e ln 2)` and the noises are
//!    independent, `E (c - A_0)^+ <= kappa_0 2^l`, `kappa_0 = 2^c (S + 1) E_I[1 / (1 + a_0)] / (e ln 2)`. It is so small
//!    that `alpha` may be a dozen times the mean: eavesdroppers lose nothing by it. With `A` the mean of `max_j A'_j`,
//!    `V > T` at `l` implies `T < log2(1 + E a_0) + log2(1 + x) - l - A + kappa_0 2^l`, convex in l. At the l where
//!    `kappa_0 2^l` is `1/ln 2`, and at every larger one, where a smaller `c` keeps that product (A is concave in `c`, so
//!    it loses no more than `c` does), `T` is not reached if
//!    `kappa = kappa_0 2^(log2(1 + E a_0) + log2(1 + x) - T - A) <= 1 / (e ln 2)`; below it the least root of
//!    `y = kappa 2^y` is all that is added. `alpha_j` is chosen by the pose, so that `c - A` is bounded at all axes at once. `E_I[1 / (1 + a_0)]` is
//!    bounded, for axes of a few bands of the angle to the line to the user, in steps of the angle by which the noise turns the axis, `sin^2(w/2) <= (x^2 + y^2) / 4`: what lies beyond the largest
//!    adds its probability times `c`, in kappa's exponent too. At any pose, however near its null:
//!    `A_0 >= log2(1 + a_0) - log2(1 + b_0)` and `E log2 max(1 + a_0, 2^d) <= log2(1 + E a_0 + 2^d)`, so that with
//!    `2^d = 2^-m (1 + E a_0)` and `alpha` so that `c = A + q + 1/ln 2` the sum is `y = log2(1 + 2^-m) + t 8^-q` and the
//!    root for `kappa = (S + 1) 2^(q + m + 1/ln 2 - T) / (e ln 2)` (with the former two in its exponent); `t` bounds what
//!    counts beyond `c` by the third moment, `(z - 1)^+ <= 4 z^3 / 27`. The lesser of both is taken. A line over `E a_0` that lies above
//!    `(1 + E a_0) 2^y` in each band takes the place of `1 + E a_0` in the forms; bands whose axes reach no threshold are left out. Bands
//!    near the user's null, where `y` is largest, are excluded apart, by the lesser of two lines: one line for all bands lies higher.
//!
//! *Gains with a flat part* are `1 + c (F + W s) = (1 + c F) (1 + c W s / (1 + c F))` in every mean, `k_j` of step 4 has
//! `F (d_J0/d_Jj)^2` beside `W` times the rest, and angles off the null are counted in `sqrt(sigma^2 + F / W)`. *Scattered
//! waves*: means over them in steps 1 (of the user's) and 2 (of J's), and the tangents of section 2 for `l` and for what
//! eavesdroppers hear, of which the best at a box's centre is taken.
//!
//! # 4. Margins of the decoupled bound, and what is not proven
//! - Means are taken by a rule of 768 points, 128 from five standard deviations off the line; two margins of 0.008 bit/s/Hz, one for
//!   each side, stand for its error: twice the largest measured at any SINR at one standard deviation up to 10^6.5. A rule of 128
//!   points with a margin of 0.045, taken likewise, serves for the curves of most boxes. Rounding is far below.
//! - That bearings between those taken, angles between those of the grid and lines less steep lie no lower than the curves say is
//!   measured, not proven: the curves of random lines are compared with means at random axes by another rule, and exceed none
//!   of them by more than a quarter of the margin.
//! - `S` and `t` (with a quarter to spare) and the 2.5 of step 4 rest on maxima over fine grids of rolls, which tests take.
//! - Anderson's inequality holds exactly in the roll offset, and in that of pitch as far as the gain grows with it: past a
//!   right angle to the line it falls again, towards the line's image half a turn of pitch away. Each image is taken by
//!   itself and the least mean of them counts. Boxes about random axes and lines, steep ones and up to 10 deg among them, never
//!   exceed the mean by more than the rule's error.
//! - With scattered waves `[.]^+` inside the mean adds what the negative draws would take off. No bound on that is proven
//!   here: hence the name of that kind.
//!
//! Without jitter no rule is used, and there are no margins. The whole chain loses 0.4, 0.7, 1.9 and 14% at known plans at
//! 1, 2, 5 and 10 deg, the last for negative draws (a test of this module prints it). What is tested: the whole chain at
//! every known plan stays above its rate, the table of `L` below its `l`, and false thresholds are not certified
//! (`examples/certify.rs` runs 500 of each kind).
//!
//! *Not covered* by it, and given the bound of section 2 instead: body-axis jitter, yaw jitter, a free yaw under jitter.
//! Covered by neither, and given the cap: measured patterns, errors of poses and of the user's position.

// `!(a > b)` is how NaN is refused.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

mod budget;
mod cell;
mod decoupled;
mod form;
mod frame;
mod harm;
mod hearing;
mod jammer;
mod law;
mod link;
mod negative;
mod prepared;
mod steady;
mod view;

use std::f64::consts::FRAC_PI_2;

pub use budget::{Bound, Budget};

use prepared::Prepared;
use steady::Outcome;

use super::cap::cap_bps;
use super::error::PlanError;
use super::plan::BoundKind;
use super::problem::Problem;
use super::setup::Setup;

/// The answer to "does any configuration beat this threshold?".
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Certificate {
    /// None does.
    Certified {
        /// In which sense.
        kind: BoundKind,
        /// Boxes examined.
        boxes_used: usize,
    },
    /// Not shown.
    NotCertified {
        /// Why not.
        reason: Reason,
        /// Boxes examined.
        boxes_used: usize,
    },
}

/// Why a threshold was not certified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// A configuration beats it.
    Refuted {
        /// The secrecy rate found, bit/s.
        secrecy_rate_bps: f64,
    },
    /// A box of the smallest size resists: the threshold is within the method's resolution of what it can show.
    Resolution,
    /// The budget of boxes ended.
    Budget,
    /// The problem is not covered: see the module's documentation.
    NotCovered,
}

/// Whether no configuration of `problem` has a secrecy rate above `threshold_bps`, bit/s.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn certify(problem: &Problem, threshold_bps: f64, budget: Budget) -> Result<Certificate, PlanError> {
    Ok(certify_each(problem, [threshold_bps], budget)?[0])
}

/// [`certify`] for several thresholds, each with the whole budget; what they have in common is computed once.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn certify_each<const N: usize>(
    problem: &Problem,
    thresholds_bps: [f64; N],
    budget: Budget,
) -> Result<[Certificate; N], PlanError> {
    let setup = Setup::new(problem)?;
    let prepared = Prepared::new(problem);
    let mut search = prepared.as_ref().and_then(|p| p.search(&budget));
    Ok(thresholds_bps.map(|threshold_bps| {
        if cap_bps(&setup) <= threshold_bps {
            return Certificate::Certified { kind: BoundKind::Cap, boxes_used: 0 };
        }
        let Some(prepared) = prepared.as_ref().filter(|_| threshold_bps > 0.0) else {
            return Certificate::NotCertified { reason: Reason::NotCovered, boxes_used: 0 };
        };
        one_threshold(&setup, prepared, search.as_mut(), threshold_bps, &budget)
    }))
}

fn one_threshold(
    setup: &Setup,
    prepared: &Prepared,
    search: Option<&mut decoupled::Search>,
    threshold_bps: f64,
    budget: &Budget,
) -> Certificate {
    let bandwidth_hz = setup.problem.radio.bandwidth_hz;
    let threshold = threshold_bps / bandwidth_hz;
    let (outcome, kind, boxes_used) = if let Some(search) = search {
        let before = search.used();
        let outcome = search.run(threshold, before + budget.boxes);
        (outcome, prepared.decoupled_kind, search.used() - before)
    } else {
        let mut search = steady::Search::new(&prepared.links, &prepared.region, budget);
        (search.run(threshold), prepared.steady_kind, search.boxes)
    };
    let reason = match outcome {
        Outcome::Excluded => return Certificate::Certified { kind, boxes_used },
        // A rate without jitter, past a tilt limit, or perhaps in a no-fly area, refutes nothing.
        Outcome::Refuted(rate)
            if !setup.jitters()
                && !prepared.links.scatters
                && setup.tilt_rad.iter().all(|t| *t >= FRAC_PI_2)
                && !setup.region.has_gaps() =>
        {
            Reason::Refuted { secrecy_rate_bps: rate * bandwidth_hz }
        }
        Outcome::Refuted(_) | Outcome::Stuck => Reason::Resolution,
        Outcome::Exhausted => Reason::Budget,
    };
    Certificate::NotCertified { reason, boxes_used }
}

/// The best upper bound found within `budget`, given a rate known to be attained, bit/s (0 if none is). Never above
/// the cap.
///
/// # Errors
/// [`PlanError`] for a problem without meaning.
pub fn best_bound(problem: &Problem, lower_bound_bps: f64, budget: Budget) -> Result<Bound, PlanError> {
    let cap_bps = cap_bps(&Setup::new(problem)?);
    let mut bound = Bound { upper_bound_bps: cap_bps, kind: BoundKind::Cap, boxes_used: 0 };
    let Some(prepared) = Prepared::new(problem) else { return Ok(bound) };
    let lower_bps = if lower_bound_bps > 0.0 { lower_bound_bps } else { 0.0 };
    prepared.lower_decoupled(problem.radio.bandwidth_hz, lower_bps, &budget, &mut bound);
    if bound.kind == BoundKind::Cap {
        let budget = budget.steady(problem);
        prepared.lower_steady(problem.radio.bandwidth_hz, lower_bps, &budget, &mut bound);
    }
    Ok(bound)
}

#[cfg(test)]
mod tests;
