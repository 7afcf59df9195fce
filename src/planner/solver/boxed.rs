//! A quasi-Newton method of limited memory for `min f(x)` subject to `low <= x <= high`, for some hundred variables many of which
//! end on their bounds: where [`limited`](super::limited) would meet them one by one, here a step is projected onto the box
//! (Bertsekas, Projected Newton methods, 1982).
//!
//! Each iteration, with g the gradient and F the variables that are not held at a bound by it:
//!
//! 1. The step `d = -H_F g_F`, H_F the inverse Hessian of the last few steps as F sees them (Nocedal and Wright, 7.4; a pair of
//!    changes that is curved the wrong way there is left out).
//! 2. The first of the lengths 1, and then such as the parabola through what is known proposes, at which `x + length d`, projected
//!    onto the box, decreases f by 1e-4 of what the gradient promises.
//!
//! The best point is always within its bounds.

use super::limited::{End, Settings};

/// Steps that are remembered.
const MEMORY: usize = 10;
/// Lengths that are tried on one step.
const MOST_LENGTHS: usize = 10;
/// The part of the promised decrease that is asked for.
const ENOUGH: f64 = 1e-4;

/// A step and the change of the gradient along it.
#[derive(Clone)]
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
}

/// The last steps, the newest at `next - 1`.
#[derive(Clone)]
struct Past {
    pairs: Vec<Pair>,
    len: usize,
    next: usize,
    shares: [f64; MEMORY],
    rhos: [f64; MEMORY],
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn free_dot(free: &[bool], a: &[f64], b: &[f64]) -> f64 {
    free.iter().zip(a.iter().zip(b)).filter(|(free, _)| **free).map(|(_, (a, b))| a * b).sum()
}

fn add(a: &mut [f64], scale: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += scale * b;
    }
}

impl Past {
    fn new(n: usize) -> Self {
        let pair = Pair { s: vec![0.0; n], y: vec![0.0; n] };
        Self { pairs: vec![pair; MEMORY], len: 0, next: 0, shares: [0.0; MEMORY], rhos: [0.0; MEMORY] }
    }

    fn remember(&mut self, x: [&[f64]; 2], gradient: [&[f64]; 2]) {
        let pair = &mut self.pairs[self.next];
        for k in 0..pair.s.len() {
            pair.s[k] = x[1][k] - x[0][k];
            pair.y[k] = gradient[1][k] - gradient[0][k];
        }
        if dot(&pair.s, &pair.y) > 1e-10 * (dot(&pair.s, &pair.s) * dot(&pair.y, &pair.y)).sqrt() {
            self.next = (self.next + 1) % MEMORY;
            self.len = (self.len + 1).min(MEMORY);
        }
    }

    /// Turns a gradient that is 0 where nothing is free into the step against it.
    fn step(&mut self, free: &[bool], first_step: f64, step: &mut [f64]) {
        let index = |back: usize| (self.next + 2 * MEMORY - 1 - back) % MEMORY;
        let mut scale = first_step / dot(step, step).sqrt().max(1e-12);
        let mut scaled = false;
        for back in 0..self.len {
            let Pair { s, y } = &self.pairs[index(back)];
            let sy = free_dot(free, s, y);
            let yy = free_dot(free, y, y);
            let curved = sy > 1e-10 * (free_dot(free, s, s) * yy).sqrt();
            self.rhos[back] = if curved { 1.0 / sy } else { 0.0 };
            self.shares[back] = self.rhos[back] * dot(s, step);
            if curved {
                add(step, -self.shares[back], y);
                if !scaled {
                    (scale, scaled) = (sy / yy, true);
                }
                hold(free, step);
            }
        }
        step.iter_mut().for_each(|c| *c *= scale);
        for back in (0..self.len).rev().filter(|back| self.rhos[*back] > 0.0) {
            let Pair { s, y } = &self.pairs[index(back)];
            let along = self.rhos[back] * dot(y, step);
            add(step, self.shares[back] - along, s);
            hold(free, step);
        }
        step.iter_mut().for_each(|c| *c = -*c);
    }
}

fn hold(free: &[bool], step: &mut [f64]) {
    for (c, free) in step.iter_mut().zip(free) {
        if !free {
            *c = 0.0;
        }
    }
}

/// A descent, which can be left off and gone on with.
#[derive(Clone)]
pub struct Descent {
    /// The best point.
    pub x: Vec<f64>,
    /// Its value; infinite before it began, and where it began at none.
    pub value: f64,
    gradient: Vec<f64>,
    past: Past,
    stage: Stage,
}

#[derive(Clone, Copy, PartialEq)]
enum Stage {
    New,
    Under,
    Converged,
    /// Nothing better is found.
    Stuck,
}

impl Descent {
    /// From `start`, which is moved into `bounds`, lowest and highest of each variable.
    pub fn new(bounds: &[[f64; 2]], start: &[f64]) -> Self {
        let mut x = start.to_vec();
        project(bounds, &mut x);
        let n = x.len();
        Self { x, value: f64::INFINITY, gradient: vec![0.0; n], past: Past::new(n), stage: Stage::New }
    }

    /// Goes on for so many iterations. `objective`, which writes its gradient, and `bounds` are always the same.
    pub fn go_on(
        &mut self,
        objective: &mut impl FnMut(&[f64], &mut [f64]) -> f64,
        bounds: &[[f64; 2]],
        settings: &Settings,
    ) {
        if self.stage == Stage::New {
            let value = objective(&self.x, &mut self.gradient);
            (self.value, self.stage) =
                if value.is_finite() { (value, Stage::Under) } else { (f64::INFINITY, Stage::Stuck) };
        }
        if self.stage != Stage::Under {
            return;
        }
        let Self { x, value, gradient, past, stage } = self;
        let n = x.len();
        let (mut to, mut gradient_there) = (vec![0.0; n], vec![0.0; n]);
        let (mut step, mut free) = (vec![0.0; n], vec![true; n]);
        for _ in 0..settings.iterations {
            for k in 0..n {
                let [low, high] = bounds[k];
                free[k] = !(x[k] <= low && gradient[k] > 0.0 || x[k] >= high && gradient[k] < 0.0);
            }
            step.copy_from_slice(gradient);
            hold(&free, &mut step);
            past.step(&free, settings.first_step, &mut step);
            let mut slope = dot(&step, gradient);
            if slope >= 0.0 && past.len > 0 {
                past.len = 0;
                step.copy_from_slice(gradient);
                hold(&free, &mut step);
                past.step(&free, settings.first_step, &mut step);
                slope = dot(&step, gradient);
            }
            if slope >= -settings.tolerance {
                *stage = Stage::Converged;
                return;
            }
            let mut length = 1.0;
            let mut moved = false;
            for _ in 0..MOST_LENGTHS {
                to.copy_from_slice(x);
                add(&mut to, length, &step);
                project(bounds, &mut to);
                let there = objective(&to, &mut gradient_there);
                let promised: f64 = to.iter().zip(&*x).zip(&*gradient).map(|((to, x), g)| (to - x) * g).sum();
                if there.is_finite() && there <= *value + ENOUGH * promised {
                    past.remember([x, &to], [gradient, &gradient_there]);
                    std::mem::swap(x, &mut to);
                    std::mem::swap(gradient, &mut gradient_there);
                    *value = there;
                    moved = true;
                    break;
                }
                let parabola = -0.5 * slope * length * length / (there - *value - slope * length);
                length = if parabola.is_finite() {
                    parabola.clamp(0.1 * length, 0.5 * length)
                } else {
                    0.2 * length
                };
            }
            if !moved {
                if past.len == 0 {
                    *stage = Stage::Stuck;
                    return;
                }
                // What was learnt may be stale: once more along the gradient.
                past.len = 0;
            }
        }
    }
}

fn project(bounds: &[[f64; 2]], x: &mut [f64]) {
    for (c, [low, high]) in x.iter_mut().zip(bounds) {
        *c = c.clamp(*low, *high);
    }
}

/// Minimises `objective`, which writes its gradient, from `start`, which is moved into `bounds`, lowest and highest of each
/// variable.
pub fn minimise(
    objective: &mut impl FnMut(&[f64], &mut [f64]) -> f64,
    bounds: &[[f64; 2]],
    start: &[f64],
    settings: &Settings,
) -> End {
    let mut descent = Descent::new(bounds, start);
    descent.go_on(objective, bounds, settings);
    let converged = descent.stage == Stage::Converged;
    End { x: descent.x, value: descent.value, converged }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: Settings = Settings { iterations: 600, tolerance: 1e-12, first_step: 0.2 };

    fn rosenbrock(x: &[f64], g: &mut [f64]) -> f64 {
        g.fill(0.0);
        (0..x.len() - 1)
            .map(|k| {
                let (a, b) = (1.0 - x[k], x[k + 1] - x[k] * x[k]);
                g[k] += -2.0 * a - 400.0 * x[k] * b;
                g[k + 1] += 200.0 * b;
                a * a + 100.0 * b * b
            })
            .sum()
    }

    #[test]
    fn val_rosenbrock_of_thirty_variables() {
        let end = minimise(&mut rosenbrock, &[[-9.0, 9.0]; 30], &[0.3; 30], &SETTINGS);
        assert!(end.converged && end.value < 1e-8, "{end:?}");
    }

    #[test]
    fn val_a_quadratic_ends_on_its_bounds() {
        // min sum (x_k - k)^2 + (sum x)^2 / 10 on [0, 2]^5: by its conditions, solved by hand for the free ones.
        let mut objective = |x: &[f64], g: &mut [f64]| {
            let sum: f64 = x.iter().sum();
            for (k, (g, x)) in g.iter_mut().zip(x).enumerate() {
                *g = 2.0 * (x - k as f64) + 0.2 * sum;
            }
            x.iter().enumerate().map(|(k, x)| (x - k as f64).powi(2)).sum::<f64>() + 0.1 * sum * sum
        };
        let end = minimise(&mut objective, &[[0.0, 2.0]; 5], &[1.0; 5], &SETTINGS);
        // The first two at 0 and near 0.45, the last two at 2: x_2 = 2 - s / 10, x_1 = 1 - s / 10, s = 7 / 1.2.
        let s: f64 = 7.0 / 1.2;
        let expected = [0.0, 1.0 - s / 10.0, 2.0 - s / 10.0, 2.0, 2.0];
        for (x, e) in end.x.iter().zip(expected) {
            assert!((x - e).abs() < 1e-6, "{:?} {expected:?}", end.x);
        }
    }

    #[test]
    fn spec_a_function_that_is_not_finite_ends_at_its_start() {
        let mut bad = |_: &[f64], _: &mut [f64]| f64::NAN;
        let end = minimise(&mut bad, &[[0.0, 5.0]; 2], &[1.0, 2.0], &SETTINGS);
        assert!(!end.converged && end.x == [1.0, 2.0]);
    }

    #[test]
    fn spec_a_descent_that_is_left_off_and_gone_on_with_is_the_same() {
        let bounds = [[-9.0, 9.0]; 30];
        let heat = |iterations| Settings { iterations, ..SETTINGS };
        let whole = minimise(&mut rosenbrock, &bounds, &[0.3; 30], &heat(50));
        let mut descent = Descent::new(&bounds, &[0.3; 30]);
        for iterations in [1, 9, 40] {
            descent.go_on(&mut rosenbrock, &bounds, &heat(iterations));
        }
        assert!(descent.x == whole.x && !whole.converged, "{whole:?}");
        descent.go_on(&mut rosenbrock, &bounds, &SETTINGS);
        assert!(descent.value < whole.value);
    }
}
