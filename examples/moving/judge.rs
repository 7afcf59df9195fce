//! The judge of motions: waypoints that are flown straight on, attitudes at knots, many starts, a plain stochastic ascent on finite
//! differences, rates by plain Monte Carlo. Its vehicles have limits of speed, climb and turning, and turn corners at once: they may
//! do more than the planner's.
//!
//! A slot has [`KNOTS`] knots, at each I's roll and pitch, what J's axis is off its null on the user, and J's power as a logarithm;
//! between them all run evenly. In every step each interval is looked at once, at a random instant, and the eleven numbers of the
//! configuration there are varied one by one. Limits are weighed while it climbs, and met in the end by drawing the waypoints
//! together. What turns too fast is not drawn back: it is left to the judge.

use std::f64::consts::PI;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::planner::moving::{Limits, Moving};
use veilwing::planner::turning::Protected;
use veilwing::role::PerVehicle;

use crate::mission::Superframe;
use crate::world::{Configuration, Look, World};

const KNOTS: usize = 11;
const WAYPOINTS: usize = 4;
/// Numbers of a knot: I's roll and pitch, J's beside its null, the logarithm of its power.
const OWN: usize = 5;
/// Units of positions, angles and logarithms.
const UNITS: [f64; 3] = [15.0, 0.1, 0.4];
const NOISES: usize = 64;
const STEPS: [usize; 2] = [120, 500];
/// Draws of a start's place, and of axes and power for each user there.
const PLACES: usize = 12;
const DRAWS: usize = 40;
const KEPT: usize = 3;
/// What an excess counts.
const STIFF: f64 = 200.0;

pub struct Judge<'a> {
    mission: &'a Superframe,
    worlds: Vec<World>,
    limits: PerVehicle<Limits>,
    turn_rate_rad_s: f64,
    order: Vec<usize>,
    begins_s: Vec<f64>,
    on_air_s: f64,
    superframe_s: f64,
}

fn along(d: [f64; 3]) -> [f64; 2] {
    let up = if d[2] < 0.0 { -1.0 } else { 1.0 };
    [(-up * d[1]).atan2(d[0].hypot(d[2])), (up * d[0]).atan2(up * d[2])]
}

impl<'a> Judge<'a> {
    /// Of a mission whose slots are served in the order, and are silent as long, as in a plan.
    pub fn new(
        mission: &'a Superframe,
        limits: &PerVehicle<Limits>,
        turn_rate_rad_s: f64,
        plan: &Protected,
    ) -> Self {
        Self {
            mission,
            worlds: mission.problems.iter().map(World::new).collect(),
            limits: *limits,
            turn_rate_rad_s,
            order: plan.slots.iter().map(|slot| slot.user).collect(),
            begins_s: plan.slots.iter().map(|slot| slot.knots[0].at_s).collect(),
            on_air_s: plan.slots[0].on_air_s,
            superframe_s: plan.superframe_s,
        }
    }

    fn ways(&self) -> usize {
        WAYPOINTS * self.order.len()
    }

    fn dimension(&self) -> usize {
        6 * self.ways() + OWN * KNOTS * self.order.len()
    }

    fn knot(&self, slot: usize, knot: usize) -> usize {
        6 * self.ways() + OWN * (slot * KNOTS + knot)
    }

    /// The waypoints about an instant and the share of the way between them.
    fn leg(&self, t_s: f64) -> (usize, usize, f64) {
        let n = self.ways();
        let at = (t_s / self.superframe_s).rem_euclid(1.0) * n as f64;
        let from = (at as usize).min(n - 1);
        (from, (from + 1) % n, at - from as f64)
    }

    fn null(&self, slot: usize, j: [f64; 3]) -> [f64; 2] {
        let user = self.mission.problems[self.order[slot]].user_enu_m;
        along([j[0] - user.x, j[1] - user.y, j[2] - user.z])
    }

    /// The eleven numbers of a configuration: both positions, then those of a knot.
    fn numbers(&self, t: &[f64], slot: usize, elapsed_s: f64) -> [f64; 11] {
        let (a, b, share) = self.leg(self.begins_s[slot] + elapsed_s);
        let mut out = [0.0; 11];
        for k in 0..6 {
            out[k] = UNITS[0] * (t[6 * a + k] + share * (t[6 * b + k] - t[6 * a + k]));
        }
        let at = elapsed_s / self.on_air_s * (KNOTS - 1) as f64;
        let knot = (at as usize).min(KNOTS - 2);
        let share = at - knot as f64;
        for k in 0..OWN {
            let [x, y] = [knot, knot + 1].map(|knot| t[self.knot(slot, knot) + k]);
            out[6 + k] = (x + share * (y - x)) * if k < 4 { UNITS[1] } else { UNITS[2] };
        }
        out
    }

    fn configuration(&self, slot: usize, z: &[f64; 11]) -> Configuration {
        let world = &self.worlds[self.order[slot]];
        let [low, high] = world.altitude_m;
        let clamp = |c: f64| c.clamp(-world.half_m, world.half_m);
        let position = |at: usize| [clamp(z[at]), clamp(z[at + 1]), z[at + 2].clamp(low, high)];
        let (i, j) = (position(0), position(3));
        let null = self.null(slot, j);
        Configuration {
            position_m: [i, j],
            angles_rad: [[z[6], z[7], 0.0], [null[0] + z[8], null[1] + z[9], 0.0]],
            power_w: [world.most_w[0], world.most_w[1] * z[10].clamp(-25.0, 0.0).exp()],
        }
    }

    fn rate(&self, slot: usize, z: &[f64; 11], look: &Look) -> f64 {
        self.worlds[self.order[slot]].value(&self.configuration(slot, z), look)
    }

    /// Adds the slopes of what is exceeded.
    fn excesses(&self, t: &[f64], by: &mut [f64]) {
        let n = self.ways();
        let leg_s = self.superframe_s / n as f64;
        for k in 0..n {
            let next = (k + 1) % n;
            for (v, limits) in [&self.limits.i, &self.limits.j].into_iter().enumerate() {
                let d = [0, 1, 2]
                    .map(|c: usize| UNITS[0] * (t[6 * next + 3 * v + c] - t[6 * k + 3 * v + c]) / leg_s);
                let speed = d[0].hypot(d[1]);
                let mut push = |size: f64, limit: f64, part: [f64; 3]| {
                    let over = (size / limit - 0.97).max(0.0);
                    for c in 0..3 {
                        let slope = STIFF * over * part[c] * UNITS[0] / (leg_s * limit) / n as f64;
                        by[6 * next + 3 * v + c] -= slope;
                        by[6 * k + 3 * v + c] += slope;
                    }
                };
                push(speed, limits.speed_m_s, [d[0] / speed.max(1e-9), d[1] / speed.max(1e-9), 0.0]);
                push(d[2].abs(), limits.climb_m_s, [0.0, 0.0, d[2].signum()]);
            }
        }
        // Attitudes, knot by knot and through the silence.
        let slots = self.order.len();
        let gap_s = self.on_air_s / (KNOTS - 1) as f64;
        for slot in 0..slots {
            for knot in 0..KNOTS {
                let last = knot + 1 == KNOTS;
                let (next_slot, next) = if last { ((slot + 1) % slots, 0) } else { (slot, knot + 1) };
                let end_s = if slot + 1 < slots { self.begins_s[slot + 1] } else { self.superframe_s };
                let lasts_s = if last { end_s - self.begins_s[slot] - self.on_air_s } else { gap_s };
                let angles = |slot: usize, knot: usize| {
                    let z = self.numbers(t, slot, gap_s * knot as f64);
                    self.configuration(slot, &z).angles_rad
                };
                let (a, b) = (angles(slot, knot), angles(next_slot, next));
                for v in 0..2 {
                    let d = [b[v][0] - a[v][0], b[v][1] - a[v][1]];
                    let angle = d[0].hypot(d[1]).max(1e-9);
                    let limit = self.turn_rate_rad_s * lasts_s;
                    let over = (angle / limit - 1.0).max(0.0);
                    for c in 0..2 {
                        let slope = STIFF * over * d[c] / angle * UNITS[1] / limit / slots as f64;
                        by[self.knot(next_slot, next) + 2 * v + c] -= slope;
                        by[self.knot(slot, knot) + 2 * v + c] += slope;
                    }
                }
            }
        }
    }

    /// A stochastic slope of the volume over the superframe, in the variables.
    fn slope(&self, t: &[f64], looks: &[Look], rng: &mut ChaCha8Rng) -> Vec<f64> {
        let mut by = vec![0.0; t.len()];
        let gap_s = self.on_air_s / (KNOTS - 1) as f64;
        for slot in 0..self.order.len() {
            let look = &looks[self.order[slot]];
            for knot in 0..KNOTS - 1 {
                let share = rng.random_range(0.0..1.0);
                let elapsed_s = gap_s * (knot as f64 + share);
                let z = self.numbers(t, slot, elapsed_s);
                let (a, b, way) = self.leg(self.begins_s[slot] + elapsed_s);
                for k in 0..11 {
                    let (unit, step) = match k {
                        0..6 => (UNITS[0], 0.05),
                        6..10 => (UNITS[1], 1e-3),
                        _ => (UNITS[2], 1e-2),
                    };
                    let at = |step: f64| {
                        let mut moved = z;
                        moved[k] += step;
                        self.rate(slot, &moved, look)
                    };
                    let slope = gap_s / self.superframe_s * unit * (at(step) - at(-step)) / (2.0 * step);
                    if k < 6 {
                        by[6 * a + k] += (1.0 - way) * slope;
                        by[6 * b + k] += way * slope;
                    } else {
                        by[self.knot(slot, knot) + k - 6] += (1.0 - share) * slope;
                        by[self.knot(slot, knot + 1) + k - 6] += share * slope;
                    }
                }
            }
        }
        self.excesses(t, &mut by);
        by
    }

    /// Adam, upwards, with steps that shrink.
    fn climb(&self, start: &[f64], steps: usize, size: f64, seed: u64) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let look = |k: usize, seed: u64| self.worlds[k].look([NOISES, 1], 0.0, f64::INFINITY, seed);
        let mut t = start.to_vec();
        let (mut mean, mut square) = (vec![0.0; t.len()], vec![0.0; t.len()]);
        for step in 1..=steps {
            let looks: Vec<Look> =
                (0..self.worlds.len()).map(|k| look(k, seed ^ (step as u64) << 8 ^ k as u64)).collect();
            let by = self.slope(&t, &looks, &mut rng);
            let left = 1.0 - (step - 1) as f64 / steps as f64;
            for k in 0..t.len() {
                mean[k] = 0.9 * mean[k] + 0.1 * by[k];
                square[k] = 0.99 * square[k] + 0.01 * by[k] * by[k];
                let (m, s) = (
                    mean[k] / (1.0 - 0.9f64.powi(step as i32)),
                    square[k] / (1.0 - 0.99f64.powi(step as i32)),
                );
                t[k] += size * left * m / (s.sqrt() + 1e-9);
            }
        }
        self.drawn_together(t)
    }

    /// Waypoints within the limits of speed and climb.
    fn drawn_together(&self, mut t: Vec<f64>) -> Vec<f64> {
        let n = self.ways();
        let leg_s = self.superframe_s / n as f64;
        for (v, limits) in [&self.limits.i, &self.limits.j].into_iter().enumerate() {
            let mut most = 1.0f64;
            for k in 0..n {
                let d = [0, 1, 2].map(|c: usize| {
                    UNITS[0] * (t[6 * ((k + 1) % n) + 3 * v + c] - t[6 * k + 3 * v + c]) / leg_s
                });
                most = most.max(d[0].hypot(d[1]) / limits.speed_m_s).max(d[2].abs() / limits.climb_m_s);
            }
            for c in 3 * v..3 * v + 3 {
                let centre = (0..n).map(|k| t[6 * k + c]).sum::<f64>() / n as f64;
                for k in 0..n {
                    t[6 * k + c] = centre + (t[6 * k + c] - centre) / most;
                }
            }
        }
        t
    }

    /// Any place for all, and the best of a few axes and powers there.
    fn start(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let world = &self.worlds[0];
        let looks: Vec<Look> =
            self.worlds.iter().map(|world| world.look([NOISES, 1], 0.0, f64::INFINITY, 5)).collect();
        let mut best: Option<(f64, [f64; 6], Vec<[f64; OWN]>)> = None;
        for _ in 0..PLACES {
            let mut place = [0.0; 6];
            for (k, c) in place.iter_mut().enumerate() {
                let [low, high] = world.altitude_m;
                let reach = 0.7 * world.half_m;
                *c = if k % 3 == 2 {
                    low + (high - low) * rng.random_range(0.0f64..1.0).powi(3)
                } else {
                    rng.random_range(-reach..reach)
                };
            }
            let mut sum = 0.0;
            let mut own = Vec::new();
            for slot in 0..self.order.len() {
                let mut top = (f64::NEG_INFINITY, [0.0; OWN]);
                for _ in 0..DRAWS {
                    let z: [f64; OWN] = [
                        rng.random_range(-PI / 2.0..PI / 2.0),
                        rng.random_range(-PI / 2.0..PI / 2.0),
                        0.0,
                        0.0,
                        rng.random_range(-8.0..0.0),
                    ];
                    let mut all = [0.0; 11];
                    all[..6].copy_from_slice(&place);
                    all[6..].copy_from_slice(&z);
                    let rate = self.rate(slot, &all, &looks[self.order[slot]]);
                    if rate > top.0 {
                        top = (rate, z);
                    }
                }
                sum += top.0;
                own.push(top.1);
            }
            if best.as_ref().is_none_or(|known| sum > known.0) {
                best = Some((sum, place, own));
            }
        }
        let (_, place, own) = best.unwrap();
        let mut t = vec![0.0; self.dimension()];
        for k in 0..self.ways() {
            for c in 0..6 {
                t[6 * k + c] = (place[c]
                    + rng.random_range(-15.0..15.0) * if c % 3 == 2 { 0.1 } else { 1.0 })
                    / UNITS[0];
            }
        }
        for (slot, own) in own.iter().enumerate() {
            for knot in 0..KNOTS {
                let at = self.knot(slot, knot);
                for k in 0..OWN {
                    t[at + k] = own[k] / if k < 4 { UNITS[1] } else { UNITS[2] };
                }
            }
        }
        t
    }

    /// The variables of a plan's motion.
    fn encode(&self, plan: &Moving) -> Vec<f64> {
        let mut t = vec![0.0; self.dimension()];
        for k in 0..self.ways() {
            let at = plan.at(self.superframe_s * k as f64 / self.ways() as f64).unwrap().positions_enu_m;
            for c in 0..3 {
                t[6 * k + c] = at.i[c] / UNITS[0];
                t[6 * k + 3 + c] = at.j[c] / UNITS[0];
            }
        }
        for slot in 0..self.order.len() {
            for knot in 0..KNOTS {
                let elapsed_s = self.on_air_s * knot as f64 / (KNOTS - 1) as f64;
                let at = plan.at(self.begins_s[slot] + elapsed_s.clamp(1e-6, self.on_air_s - 1e-6)).unwrap();
                let null = self.null(slot, at.positions_enu_m.j.into());
                let [i, j] = [&at.attitudes.i, &at.attitudes.j].map(|attitude| attitude.euler());
                let log = (at.tx_powers_w.j / self.worlds[0].most_w[1]).max(1e-10).ln();
                let own = [i.0, i.1, j.0 - null[0], j.1 - null[1]].map(|c| c / UNITS[1]);
                let to = self.knot(slot, knot);
                t[to..to + 4].copy_from_slice(&own);
                t[to + 4] = log / UNITS[2];
            }
        }
        self.drawn_together(t)
    }

    /// Volume over the superframe on fresh draws, bit/s/Hz, looked at `instants` times a slot.
    fn score_with(
        &self,
        at: impl Fn(usize, f64) -> Configuration,
        instants: usize,
        draws: usize,
        seed: u64,
    ) -> f64 {
        let mut sum = 0.0;
        for slot in 0..self.order.len() {
            for k in 0..instants {
                let elapsed_s = self.on_air_s * (k as f64 + 0.5) / instants as f64;
                sum += self.worlds[self.order[slot]].score(&at(slot, elapsed_s), draws, seed);
            }
        }
        sum * self.on_air_s / (instants as f64 * self.superframe_s)
    }

    fn score(&self, t: &[f64], instants: usize, draws: usize, seed: u64) -> f64 {
        self.score_with(
            |slot, elapsed_s| self.configuration(slot, &self.numbers(t, slot, elapsed_s)),
            instants,
            draws,
            seed,
        )
    }

    /// The plan's own, and the best of the judge's: from random starts, and from near the plan.
    pub fn compare(&self, plan: &Moving, starts: usize, draws: usize, seed: u64) -> [f64; 3] {
        const INSTANTS: usize = 40;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut ends: Vec<(f64, Vec<f64>)> = (0..starts)
            .map(|k| {
                let t = self.climb(&self.start(&mut rng), STEPS[0], 0.3, seed + k as u64);
                (self.score(&t, 10, 500, seed ^ 0x55), t)
            })
            .collect();
        ends.sort_by(|a, b| b.0.total_cmp(&a.0));
        ends.truncate(KEPT);
        let free = ends
            .iter()
            .map(|(_, t)| {
                self.score(&self.climb(t, STEPS[1], 0.15, seed ^ 0x77), INSTANTS, draws, seed ^ 0xfeed)
            })
            .fold(0.0, f64::max);
        let ours = self.encode(plan);
        let near = [0.0, 0.5, 2.0]
            .iter()
            .map(|size| {
                let mut t = ours.clone();
                for c in &mut t[..6 * self.ways()] {
                    *c += size * rng.random_range(-1.0..1.0);
                }
                let end = self.climb(&t, STEPS[1], 0.1, seed ^ 0x99);
                self.score(&end, INSTANTS, draws, seed ^ 0xfeed)
            })
            .fold(0.0, f64::max);
        let own = self.score_with(
            |slot, elapsed_s| {
                let state = plan.at(self.begins_s[slot] + elapsed_s).unwrap();
                Configuration {
                    position_m: [state.positions_enu_m.i.into(), state.positions_enu_m.j.into()],
                    angles_rad: [&state.attitudes.i, &state.attitudes.j].map(|attitude| {
                        let (roll, pitch, yaw) = attitude.euler();
                        [roll, pitch, yaw]
                    }),
                    power_w: [state.tx_powers_w.i, state.tx_powers_w.j],
                }
            },
            INSTANTS,
            draws,
            seed ^ 0xfeed,
        );
        [own, free, near]
    }
}

/// The largest of what a motion asks over what it may, instant by instant: speed, climb, acceleration and its change by differences
/// of positions, the rate of turning, the separation over the distance.
pub fn strain(mission: &Superframe, plan: &Moving, limits: &PerVehicle<Limits>, turn_rate_rad_s: f64) -> f64 {
    let step_s = 0.02;
    let mut worst = 0.0f64;
    let count = (plan.protected.superframe_s / step_s) as usize + 4;
    let states: Vec<_> = (0..count).map(|k| plan.at(k as f64 * step_s).unwrap()).collect();
    let separation_m = mission.problems[0].airspace.min_separation_m;
    for four in states.windows(4) {
        for (v, limits) in [&limits.i, &limits.j].into_iter().enumerate() {
            let p = [0, 1, 2, 3].map(|k: usize| {
                let at = &four[k].positions_enu_m;
                if v == 0 { at.i } else { at.j }
            });
            let velocity = (p[1] - p[0]) / step_s;
            worst =
                worst.max(velocity.xy().norm() / limits.speed_m_s).max(velocity.z.abs() / limits.climb_m_s);
            let bend = (p[2] - 2.0 * p[1] + p[0]) / (step_s * step_s);
            worst = worst.max(bend.norm() / limits.acceleration_m_s2);
            let [a, b] = [0, 1].map(|k: usize| {
                let at = &four[k].attitudes;
                (if v == 0 { at.i } else { at.j }).rotation().into_inner().coords
            });
            let chord = (a - b).norm().min((a + b).norm());
            worst = worst.max(4.0 * (0.5 * chord).asin() / step_s / turn_rate_rad_s);
        }
        let apart_m = (four[0].positions_enu_m.i - four[0].positions_enu_m.j).norm();
        worst = worst.max(separation_m / apart_m);
    }
    worst
}
