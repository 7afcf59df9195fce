//! The sampled objective and its gradient: the inner loop of every search under jitter.
//!
//! For samples s of both attitudes, with unit vectors `u` from node to vehicle, `k = b0 P / (s^2 d^2)` and
//! `t = <u, Y(s)>`, the received power over the noise is `a = k (1 - e t^2)` from I and `b - 1 = k (1 - e t^2)` from J,
//! `e = 1 - f` a dipole's depth (1 without a floor), and the value is the mean of
//!
//! ```text
//! f = ln((a_0 + b_0) b_m / (b_0 (a_m + b_m))),   m the eavesdropper with the largest a_m / b_m,
//! ```
//!
//! which is (3b), or (2.2b) with f replaced by max(f, 0). Derivatives follow from
//! `df/da_0 = 1/(a_0 + b_0)`, `df/db_0 = -a_0 / (b_0 (a_0 + b_0))`, their negatives with m for 0, and
//!
//! ```text
//! da/dp = (w Y - (w t + 2 a) u) / d,  w = da/dt = -2 k e t;   da/dY = w u;   dY/d(angle) = axis of that angle x Y;
//! da/d(ln P) = a.
//! ```
//!
//! Dipoles in an empty sky whose poses are as they are held have a kernel of their own, `plain`; measured patterns, scattering
//! and what stays wrong during a slot are in `full`. What they share is in `parts`.
//!
//! Samples are handled in blocks of [`LANES`], arrays of which the compiler turns into vectors. Sums are kept per lane
//! and added in order of index, so that the result is the same bit for bit on any vector width.

use super::attitude::Desired;
use super::parts::Sums;
pub use super::parts::{ANGLES, Link, POWER, Raw, Scene, VEHICLE};
pub use super::plain::power;
use super::samples::{Blocks, LANES, Lane, Samples};
use super::{full, plain};

/// Reusable memory of an evaluation.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    plain: plain::Links,
    full: full::Links,
}

fn desired(raw: &Raw) -> [Desired; 2] {
    [Desired::new(&raw[ANGLES..]), Desired::new(&raw[VEHICLE + ANGLES..])]
}

/// Adds up the lanes.
#[inline(always)]
fn reduce(sums: &[Sums; 2], scale: f64, out: &mut Raw) {
    for (vehicle, sums) in sums.iter().enumerate() {
        for (slot, lane) in out[vehicle * VEHICLE..].iter_mut().zip(sums) {
            *slot = lane.iter().sum::<f64>() * scale;
        }
    }
}

/// One of the kernels.
trait Kernel: Copy {
    /// Adds a draw's blocks to `sums` (if the gradient is wanted) and returns its total in nats per hertz.
    fn draw(
        self,
        workspace: &mut Workspace,
        at: &At<'_>,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        sums: Option<&mut [Sums; 2]>,
    ) -> f64;
}

/// What is evaluated, and where.
#[derive(Clone, Copy)]
struct At<'a> {
    scene: &'a Scene,
    samples: &'a Samples,
    raw: &'a Raw,
    clip: bool,
}

impl At<'_> {
    /// The depths of both dipoles, where nothing but these and attitude noise is in the samples.
    fn depths(&self) -> Option<[f64; 2]> {
        self.scene.depths().filter(|_| self.samples.is_plain())
    }
}

/// Dipoles of these depths.
#[derive(Clone, Copy)]
struct Plain<D>(D);

/// Everything that the link may hold.
#[derive(Clone, Copy)]
struct Full;

impl<D: plain::Depths> Kernel for Plain<D> {
    #[inline(always)]
    fn draw(
        self,
        workspace: &mut Workspace,
        at: &At<'_>,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        sums: Option<&mut [Sums; 2]>,
    ) -> f64 {
        workspace.plain.draw(at.scene, self.0, at.raw, desired, blocks, at.clip, sums)
    }
}

impl Kernel for Full {
    #[inline(always)]
    fn draw(
        self,
        workspace: &mut Workspace,
        at: &At<'_>,
        desired: &[Desired; 2],
        blocks: &Blocks<'_>,
        sums: Option<&mut [Sums; 2]>,
    ) -> f64 {
        workspace.full.draw(at.scene, at.raw, desired, blocks, at.clip, sums)
    }
}

/// What is done with a kernel.
trait Task {
    type Output;

    fn on<K: Kernel>(self, kernel: K) -> Self::Output;
}

/// A task in the vectors of the caller.
struct With<K, T>(K, T);

impl<K: Kernel, T: Task> pulp::NullaryFnOnce for With<K, T> {
    type Output = T::Output;

    #[inline(always)]
    fn call(self) -> T::Output {
        self.1.on(self.0)
    }
}

/// A task with the leanest kernel that knows all there is, in the widest vectors of this machine: the same operations in the
/// same order on any.
fn dispatch<T: Task>(depths: Option<[f64; 2]>, task: T) -> T::Output {
    let arch = pulp::Arch::new();
    match depths {
        Some([1.0, 1.0]) => arch.dispatch(With(Plain(plain::Ideal), task)),
        Some(depths) => arch.dispatch(With(Plain(depths), task)),
        None => arch.dispatch(With(Full, task)),
    }
}

/// [`Workspace::mean`].
struct Mean<'a> {
    workspace: &'a mut Workspace,
    at: At<'a>,
    gradient: Option<&'a mut Raw>,
}

impl Task for Mean<'_> {
    type Output = f64;

    #[inline(always)]
    fn on<K: Kernel>(self, kernel: K) -> f64 {
        let Self { workspace, at, gradient } = self;
        let desired = desired(at.raw);
        let scale = 1.0 / at.samples.len() as f64;
        let mut total = 0.0;
        if let Some(gradient) = gradient {
            let mut sums = [[[0.0; LANES]; 7]; 2];
            for blocks in at.samples.draws() {
                total += kernel.draw(workspace, &at, &desired, &blocks, Some(&mut sums));
            }
            reduce(&sums, scale, gradient);
        } else {
            for blocks in at.samples.draws() {
                total += kernel.draw(workspace, &at, &desired, &blocks, None);
            }
        }
        total * scale
    }
}

/// [`Workspace::means_of_draws`].
struct MeansOfDraws<'a> {
    workspace: &'a mut Workspace,
    at: At<'a>,
    out: &'a mut Vec<f64>,
}

impl Task for MeansOfDraws<'_> {
    type Output = ();

    #[inline(always)]
    fn on<K: Kernel>(self, kernel: K) {
        let Self { workspace, at, out } = self;
        let desired = desired(at.raw);
        for blocks in at.samples.draws() {
            let scale = 1.0 / (blocks.noise.len() * LANES) as f64;
            out.push(scale * kernel.draw(workspace, &at, &desired, &blocks, None));
        }
    }
}

/// [`Workspace::weighted_gradient`].
struct WeightedGradient<'a> {
    workspace: &'a mut Workspace,
    at: At<'a>,
    weights: &'a [f64],
    gradient: &'a mut Raw,
}

impl Task for WeightedGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn on<K: Kernel>(self, kernel: K) {
        let Self { workspace, at, weights, gradient } = self;
        let desired = desired(at.raw);
        gradient.fill(0.0);
        let weighed = at.samples.draws().zip(weights).filter(|(_, weight)| **weight > 0.0);
        for (blocks, weight) in weighed {
            let mut sums = [[[0.0; LANES]; 7]; 2];
            let mut own = [0.0; 14];
            kernel.draw(workspace, &at, &desired, &blocks, Some(&mut sums));
            reduce(&sums, weight / (blocks.noise.len() * LANES) as f64, &mut own);
            for (sum, own) in gradient.iter_mut().zip(own) {
                *sum += own;
            }
        }
    }
}

impl Workspace {
    /// Mean over the samples in nats per hertz; with `clip`, of max(f, 0). Adds nothing to memory after its first call.
    ///
    /// `gradient`, if given, is overwritten; its power entries are derivatives by ln P.
    pub fn mean(
        &mut self,
        scene: &Scene,
        samples: &Samples,
        raw: &Raw,
        clip: bool,
        gradient: Option<&mut Raw>,
    ) -> f64 {
        let at = At { scene, samples, raw, clip };
        dispatch(at.depths(), Mean { workspace: self, at, gradient })
    }

    /// Appends the mean of each draw in nats per hertz; with `clip`, of max(f, 0).
    pub fn means_of_draws(
        &mut self,
        scene: &Scene,
        samples: &Samples,
        raw: &Raw,
        clip: bool,
        out: &mut Vec<f64>,
    ) {
        let at = At { scene, samples, raw, clip };
        dispatch(at.depths(), MeansOfDraws { workspace: self, at, out });
    }

    /// The gradient of the draws' means, each by its weight; draws without any cost nothing.
    pub fn weighted_gradient(
        &mut self,
        scene: &Scene,
        samples: &Samples,
        raw: &Raw,
        clip: bool,
        weights: &[f64],
        gradient: &mut Raw,
    ) {
        let at = At { scene, samples, raw, clip };
        dispatch(at.depths(), WeightedGradient { workspace: self, at, weights, gradient });
    }

    /// f of every sample in nats per hertz, draw by draw, through `visit(draw, f)`.
    pub fn each(&mut self, scene: &Scene, samples: &Samples, raw: &Raw, mut visit: impl FnMut(usize, f64)) {
        let desired = desired(raw);
        let depths = At { scene, samples, raw, clip: false }.depths();
        for (index, blocks) in samples.draws().enumerate() {
            let visit = |ratio: Lane| ratio.into_iter().for_each(|ratio| visit(index, libm::log(ratio)));
            match depths {
                Some(depths) => self.plain.each(scene, depths, raw, &desired, &blocks, visit),
                None => self.full.each(scene, raw, &desired, &blocks, visit),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planner::expectation::samples::Sequence;
    use crate::planner::problem::{Jitter, JitterAxes, JitterModel, Pattern, Problem, Rician, Uncertainty};
    use crate::radio::link::{self, Transmitter};
    use crate::radio::{jitter, secrecy};
    use nalgebra::Vector3;

    const RAW: Raw = [5.0, 3.0, 80.0, 0.8, -0.3, 0.2, 0.5, 90.0, -210.0, 80.0, 1.1, 0.8, -0.1, 0.006];

    fn scene() -> Scene {
        Scene::of(&Problem::paper([], 0.5, 0.0))
    }

    /// The kernel against the radio module, sample by sample: the same noise, another road.
    #[test]
    fn val_each_sample_is_the_radio_modules_rate() {
        let nodes = [[120.0, -40.0], [-300.0, 210.0], [10.0, 400.0]];
        for model in [JitterModel::Euler, JitterModel::Body] {
            let mut problem = Problem::paper(nodes, 0.5, 3f64.to_radians());
            problem.jitter = Jitter { model, axes: JitterAxes::RollPitchYaw, ..problem.jitter };
            let samples = Samples::new(&problem, 32, 1, 4, Sequence::Sobol);
            let set = super::super::sobol::Scrambled::new(4);
            let noise = |index: u32, dimension: usize| {
                problem.jitter.std_rad * super::super::normal::quantile(set.coordinate(index, dimension))
            };
            let mut index = 0;
            let mut sum = 0.0;
            Workspace::default().each(&scene(), &samples, &RAW, |_, f| {
                let transmitter = |v: usize| {
                    let part = &RAW[v * VEHICLE..(v + 1) * VEHICLE];
                    let w = [0, 1, 2].map(|c: usize| noise(index, 3 * v + c));
                    Transmitter {
                        position_enu_m: Vector3::new(part[0], part[1], part[2]),
                        axis: jitter::axis(model, [part[3], part[4], part[5]], w),
                        tx_power_w: part[6],
                        antenna: &Pattern::IDEAL,
                    }
                };
                let (i, j) = (transmitter(0), transmitter(1));
                let sinr = |node: &Vector3<f64>| link::sinr(&i, &j, node, Rician::NONE, 1.0, 1e-12);
                let rate = secrecy::signed_bit_s_hz(
                    sinr(&problem.user_enu_m),
                    problem.eavesdroppers.iter().map(|e| sinr(&e.position_enu_m)),
                );
                assert!((f / std::f64::consts::LN_2 - rate).abs() < 1e-9, "{index}: {f} {rate}");
                sum += f;
                index += 1;
            });
            let mean = Workspace::default().mean(&scene(), &samples, &RAW, false, None);
            assert!((mean - sum / 32.0).abs() < 1e-12);
        }
    }

    /// Under Euler jitter E[YY'] is known: with c = exp(-2 s^2), E cos^2(x + w) = (1 + c cos 2x) / 2. At a signal so weak
    /// that ln(1 + a) = a, the user's mean is k E[G].
    #[test]
    fn val_mean_gain_in_closed_form() {
        let mut problem = Problem::paper([[4e5, 4e5]], 0.5, 10f64.to_radians());
        problem.jitter.std_rad = 0.3;
        let raw: Raw = [60.0, 0.0, 80.0, 0.5, 0.4, 0.0, 1.0, 0.0, 0.0, 100.0, 0.0, 0.0, 0.0, 0.0];
        let scene = Scene { budget_m2_w: 1e-4, ..scene() };
        let samples = Samples::new(&problem, 1 << 14, 1, 3, Sequence::Sobol);
        let mean = Workspace::default().mean(&scene, &samples, &raw, false, None);
        let c = (-2.0 * 0.3f64 * 0.3).exp();
        let squares = |x: f64| ((1.0 + c * (2.0 * x).cos()) / 2.0, (1.0 - c * (2.0 * x).cos()) / 2.0);
        let ((cr, _), (cp, sp)) = (squares(0.5), squares(0.4));
        // u = (0.6, 0, 0.8): <u, Y>^2 = cos^2 roll (0.6 sin pitch + 0.8 cos pitch)^2.
        let cross = c * 0.8f64.sin() / 2.0;
        let gain = 1.0 - cr * (0.36 * sp + 0.64 * cp + 0.96 * cross);
        assert!((mean / (1e-4 / 1e4 * gain) - 1.0).abs() < 1e-4, "{mean}");
    }

    #[test]
    fn spec_clipping_lifts_negative_samples_to_zero() {
        let problem = Problem::paper([[5.0, 0.0], [-300.0, 210.0]], 0.5, 10f64.to_radians());
        let samples = Samples::new(&problem, 512, 1, 3, Sequence::Sobol);
        let (mut signed, mut clipped) = (0.0, 0.0);
        let mut workspace = Workspace::default();
        workspace.each(&scene(), &samples, &RAW, |_, f| {
            signed += f / 512.0;
            clipped += f.max(0.0) / 512.0;
        });
        assert!(clipped > signed + 1e-3);
        assert!((workspace.mean(&scene(), &samples, &RAW, true, None) - clipped).abs() < 1e-12);
        assert!((workspace.mean(&scene(), &samples, &RAW, false, None) - signed).abs() < 1e-12);
    }

    #[test]
    fn spec_the_narrowest_vectors_give_the_same_bits() {
        let problem = Problem::paper([[120.0, -40.0], [-300.0, 210.0]], 0.5, 2f64.to_radians());
        let samples = Samples::new(&problem, 256, 1, 3, Sequence::Sobol);
        let (mut wide, mut narrow) = ([0.0; 14], [0.0; 14]);
        let mut workspace = Workspace::default();
        let value = workspace.mean(&scene(), &samples, &RAW, false, Some(&mut wide));
        let scalar = Mean {
            workspace: &mut Workspace::default(),
            at: At { scene: &scene(), samples: &samples, raw: &RAW, clip: false },
            gradient: Some(&mut narrow),
        };
        assert_eq!(scalar.on(Plain([1.0; 2])), value);
        assert_eq!(wide, narrow);
    }

    /// The kernel for everything is the other one where there is nothing but dipoles.
    #[test]
    fn val_both_kernels_agree_on_dipoles() {
        let mut problem = Problem::paper([[120.0, -40.0], [-300.0, 210.0]], 0.5, 2f64.to_radians());
        problem.antennas.i = Pattern::with_null_depth(20.0);
        problem.antennas.j = Pattern::with_null_depth(25.0);
        let samples = Samples::new(&problem, 256, 1, 3, Sequence::Sobol);
        let scene = Scene::of(&problem);
        let (mut plain, mut full) = ([0.0; 14], [0.0; 14]);
        let value = Workspace::default().mean(&scene, &samples, &RAW, true, Some(&mut plain));
        let other = Mean {
            workspace: &mut Workspace::default(),
            at: At { scene: &scene, samples: &samples, raw: &RAW, clip: true },
            gradient: Some(&mut full),
        };
        let other = other.on(Full);
        assert!((value - other).abs() < 1e-12, "{value} {other}");
        for (a, b) in plain.iter().zip(&full) {
            assert!((a - b).abs() < 1e-10 * (1.0 + a.abs()), "{plain:?} {full:?}");
        }
    }

    /// With noise alone, with draws of the eavesdroppers' places, and with something else wrong in each sample.
    #[test]
    fn val_parts_of_samples_add_up_to_the_whole() {
        let jittery = Problem::paper([[5.0, 0.0], [-300.0, 210.0]], 0.5, 2f64.to_radians());
        let mut about = jittery.clone();
        about.eavesdroppers[1].uncertainty = Uncertainty::Disc { radius_m: 50.0 };
        let mut turned = about.clone();
        turned.pointing.heading_std_rad = 0.05;
        let mut workspace = Workspace::default();
        for (problem, draws) in [(jittery, 1), (about.clone(), 16), (turned, 16)] {
            let samples = Samples::new(&problem, 256, draws, 5, Sequence::Sobol);
            let whole = workspace.mean(&scene(), &samples, &RAW, false, None);
            for count in [1, 2, 4] {
                let parts = samples.parts(count);
                assert!(parts.len() == count && parts.iter().all(|part| part.len() * count == samples.len()));
                let means: Vec<f64> =
                    (parts.iter()).map(|part| workspace.mean(&scene(), part, &RAW, false, None)).collect();
                assert!(
                    (means.iter().sum::<f64>() / count as f64 - whole).abs() < 1e-12,
                    "{means:?} {whole}"
                );
                assert!(count == 1 || means[0] != means[1]);
            }
        }
        // Fewer draws than parts: each draw in some of them.
        let samples = Samples::new(&about, 256, 2, 5, Sequence::Sobol);
        let whole = workspace.mean(&scene(), &samples, &RAW, false, None);
        let means = samples
            .parts(4)
            .iter()
            .map(|part| workspace.mean(&scene(), part, &RAW, false, None) / 4.0)
            .sum::<f64>();
        assert!((means - whole).abs() < 1e-12, "{means} {whole}");
        // No more than there are blocks: the last ones twice.
        let few = Samples::new(&Problem::paper([], 0.5, 0.03), 8, 1, 5, Sequence::Sobol);
        assert_eq!(few.parts(4).iter().map(Samples::len).collect::<Vec<_>>(), [8; 4]);
    }

    #[test]
    fn val_draws_add_up_to_the_mean_and_its_gradient() {
        let problem = Problem::paper([[5.0, 0.0], [-300.0, 210.0]], 0.5, 2f64.to_radians());
        let places = [[5.0, 0.0], [40.0, 9.0], [-80.0, 60.0]]
            .map(|[x, y]| vec![Vector3::new(x, y, 0.0), Vector3::new(-300.0, y, 0.0)]);
        let samples = Samples::shared(&problem, 64, places, 5);
        let mut workspace = Workspace::default();
        for clip in [false, true] {
            let (mut each, mut whole, mut parts) = (Vec::new(), [0.0; 14], [0.0; 14]);
            workspace.means_of_draws(&scene(), &samples, &RAW, clip, &mut each);
            let mean = workspace.mean(&scene(), &samples, &RAW, clip, Some(&mut whole));
            assert!((each.iter().sum::<f64>() / 3.0 - mean).abs() < 1e-12, "{each:?} {mean}");
            workspace.weighted_gradient(&scene(), &samples, &RAW, clip, &[1.0 / 3.0; 3], &mut parts);
            for (a, b) in whole.iter().zip(&parts) {
                assert!((a - b).abs() < 1e-10 * (1.0 + a.abs()), "{whole:?} {parts:?}");
            }
        }
    }
}
