//! How users and eavesdroppers move here, and what is heard of them.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::geo::EnuVelocity;
use veilwing::planner::following::{Belief, Foresight, Report};

/// Time between points of a track, in seconds.
const STEP_S: f64 = 0.02;
/// How far east and north of the arena's middle a track leads, in metres.
const REACH_M: f64 = 400.0;
/// Least and longest time from corner to corner, in seconds.
const LEG_S: [f64; 2] = [10.0, 30.0];
/// A corner is turned at this rate in rad/s, and not with more than this acceleration in m/s^2.
const TURN_RAD_S: f64 = 1.0;
const ACROSS_M_S2: f64 = 2.0;
/// Of reports: standard deviations in metres (horizontally on each axis, and up), and the share that is lost.
pub const STD_M: [f64; 2] = [3.0, 1.0];
pub const LOSS: f64 = 0.2;

/// Where somebody truly is.
#[derive(Debug, Clone)]
pub struct Track {
    begins_s: f64,
    points: Vec<Vector3<f64>>,
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let u: f64 = 1.0 - rng.random_range(0.0..1.0);
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * rng.random_range(0.0..1.0)).cos()
}

impl Track {
    /// A walk at constant speed over straight legs and round corners, about a place at which it is at 0 s.
    pub fn new(through: Vector3<f64>, speed_m_s: f64, [from_s, to_s]: [f64; 2], seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut heading: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let along = |heading: f64| Vector3::new(heading.cos(), heading.sin(), 0.0);
        let mut at = through + along(heading) * (speed_m_s * from_s);
        let rate = TURN_RAD_S.min(ACROSS_M_S2 / speed_m_s.max(1e-3));
        // Straight up to 0 s.
        let (mut aim, mut corner_s) = (heading, 0.0);
        let count = ((to_s - from_s) / STEP_S).ceil() as usize + 2;
        let mut points = Vec::with_capacity(count);
        for k in 0..count {
            points.push(at);
            let t_s = from_s + STEP_S * k as f64;
            if t_s >= corner_s {
                let leg_s = rng.random_range(LEG_S[0]..LEG_S[1]);
                corner_s = t_s + leg_s;
                for _ in 0..20 {
                    aim = heading + rng.random_range(-2.0..2.0);
                    let end = at + along(aim) * (speed_m_s * leg_s);
                    if end.x.abs().max(end.y.abs()) <= REACH_M {
                        break;
                    }
                    // Nowhere found: back to the middle.
                    aim = heading + wrapped((-at.y).atan2(-at.x) - heading);
                }
            }
            heading += (aim - heading).clamp(-rate * STEP_S, rate * STEP_S);
            at += along(heading) * (speed_m_s * STEP_S);
        }
        Self { begins_s: from_s, points }
    }

    pub fn position(&self, t_s: f64) -> Vector3<f64> {
        let steps = ((t_s - self.begins_s) / STEP_S).clamp(0.0, (self.points.len() - 2) as f64);
        let (k, share) = (steps.floor() as usize, steps.fract());
        self.points[k] + (self.points[k + 1] - self.points[k]) * share
    }

    /// What is heard of it each second, from its beginning on.
    pub fn reports(&self, until_s: f64, seed: u64) -> Vec<Report> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut heard = Vec::new();
        let mut at_s = self.begins_s;
        while at_s <= until_s {
            let off = [STD_M[0], STD_M[0], STD_M[1]].map(|std_m| std_m * normal(&mut rng));
            // The first is never lost: from then on somebody is known of.
            let lost = rng.random_range(0.0..1.0) < LOSS && !heard.is_empty();
            if !lost {
                let position_enu_m = self.position(at_s) + Vector3::from(off);
                heard.push(Report { at_s, position_enu_m, std_m: STD_M });
            }
            at_s += 1.0;
        }
        heard
    }
}

fn wrapped(angle: f64) -> f64 {
    angle.sin().atan2(angle.cos())
}

/// Whoever knows the track knows all of it.
impl Foresight for Track {
    fn at(&self, t_s: f64) -> Belief {
        let velocity = (self.position(t_s + STEP_S) - self.position(t_s)) / STEP_S;
        Belief {
            position_enu_m: self.position(t_s),
            velocity_enu_m_s: EnuVelocity::from_vector(velocity),
            std_m: [0.0; 2],
        }
    }
}

/// Whoever knows where somebody was at an instant, and how fast, and thinks that it goes straight on.
#[derive(Debug, Clone, Copy)]
pub struct Now(pub Belief, pub f64);

impl Foresight for Now {
    fn at(&self, t_s: f64) -> Belief {
        let Self(then, at_s) = self;
        let moved_m = then.velocity_enu_m_s.vector() * (t_s - at_s).max(0.0);
        Belief { position_enu_m: then.position_enu_m + moved_m, ..*then }
    }
}

/// Whoever believes the last report as it is.
#[derive(Debug, Clone, Copy)]
pub struct Last(pub Report);

impl Foresight for Last {
    fn at(&self, _: f64) -> Belief {
        Belief {
            position_enu_m: self.0.position_enu_m,
            velocity_enu_m_s: EnuVelocity::ZERO,
            std_m: self.0.std_m,
        }
    }
}
