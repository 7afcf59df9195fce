//! What draws of the noise with a negative rate add to the decoupled bound (step 8 of the parent module's section 3).

use std::f64::consts::LN_2;

/// 1 / (e ln 2): `y^+` is at most so much of `2^y`, and `y = kappa 2^y` has a root up to it.
const POSITIVE: f64 = 0.530_737_845;
/// Of each eavesdropper `(4/27) s^3 / ln 2`, `s = 11` at least `(E G^3)^(1/3)` over `exp(E ln G)`, 8.8 for a null under noise of
/// one angle; and of two.
const LOUD: f64 = 570.0;
/// Standard deviations of the noise by which I's axis may be turned, in steps; beyond the last it is taken to null the user.
const TURNED: [f64; 7] = [0.8, 1.4, 2.0, 2.6, 3.3, 4.2, 7.0];
/// Rounds in which the part of negative rates is found.
const ROUNDS: usize = 10;

/// What a threshold says by itself.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked {
    /// log2 of what all poses have in common: `(S + 1) / (e ln 2)` over the threshold, with the user's correction.
    disturbed: f64,
    /// What is added at most at any pose.
    anywhere: f64,
}

impl Asked {
    /// Of a threshold in bit/s/Hz, with step 1's S and what it adds.
    pub fn new(threshold: f64, spread: f64, correction: f64) -> Self {
        let disturbed = (POSITIVE * (spread + 1.0)).log2() + correction - threshold;
        // The least over what is taken off the eavesdroppers' harm and the user's rate.
        let mut anywhere = f64::INFINITY;
        for up_to in 0..24 {
            let up_to = 0.5 * f64::from(up_to);
            let cut = LOUD * (-3.0 * up_to).exp2();
            for left in 0..24 {
                let left = 0.5 * f64::from(left);
                let lifted = (-left).exp2().ln_1p() / LN_2;
                let size = disturbed + up_to + 1.0 / LN_2 + left + lifted + cut;
                anywhere = anywhere.min(cut + lifted + root(size));
            }
        }
        Self { disturbed, anywhere }
    }

    /// An upper bound on what is added where axes are at least `off` from the line to the user, the user's mean rate is at most
    /// `user` and eavesdroppers count up to `most`, which is at most `above` what they are heard in the mean. `user_sinr`: the least
    /// of the user at a squared sine of that angle.
    pub fn added(
        &self,
        std_rad: f64,
        off: f64,
        user: f64,
        [most, above]: [f64; 2],
        user_sinr: impl Fn(f64) -> f64,
    ) -> f64 {
        // 1 / (1 + a_0) where the noise turns the axis no further, and the probability that it turns it further.
        let faintest = |turned: f64| 1.0 / (1.0 + user_sinr((off - turned).sin().powi(2)));
        let beyond = |turned: f64| (-2.0 * ((0.5 * turned).sin() / std_rad).powi(2)).exp();
        let (mut faint, mut farther) = (0.0, 1.0);
        for turned in TURNED.map(|turned| (turned * std_rad).min(0.75 * off)) {
            let beyond = beyond(turned);
            faint += (farther - beyond) * faintest(turned);
            farther = beyond;
        }
        let lost = farther * (most + 1.0 / LN_2);
        let here = lost + root(self.disturbed + above + 1.0 / LN_2 + faint.log2() + user + lost);
        here.min(self.anywhere)
    }
}

/// The least root of `y = 2^(size + y)`, from above; infinite where there is none.
fn root(size: f64) -> f64 {
    let kappa = size.exp2();
    if kappa > POSITIVE {
        return f64::INFINITY;
    }
    (0..ROUNDS).fold(1.0 / LN_2, |y, _| kappa * y.exp2())
}
