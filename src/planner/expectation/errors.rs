//! What stays wrong during a slot, in the form in which the kernel takes it: headings, mountings and positions of the
//! vehicles, positions of the nodes.
//!
//! For a mean each sample has errors of its own; for a quantile a draw has, and meets every sample.

use nalgebra::Vector3;

use super::lanes::{LANES, Lane};
use super::noise::Uniform;
use super::{normal, trigonometry};
use crate::planner::problem::{Pointing, Problem, Uncertainty};
use crate::radio::jitter;

/// Dimensions of the sequence: of each eavesdropper's position two from [`NODES`] on; of the vehicles' errors twelve, in
/// pairs, from [`VEHICLES`] on, and the user's position after them.
const NODES: usize = 8;
const VEHICLES: usize = 1 << 12;
const USER: usize = VEHICLES + 12;

/// One vehicle's errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VehicleError {
    /// Turns the axis about the world's vertical, radians.
    pub heading_rad: f64,
    /// The antenna's axis in the body frame, a unit vector: z where it is mounted straight.
    pub mount: Vector3<f64>,
    /// True position less the one that is held, in metres.
    pub offset_m: Vector3<f64>,
}

/// One draw of everything that stays wrong during a slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// Positions of the eavesdroppers in metres.
    pub eavesdroppers: Vec<Vector3<f64>>,
    /// The errors of the user's position and of both vehicles; `None` where the sample set has its own.
    pub errors: Option<DrawErrors>,
}

/// A draw's errors beside the eavesdroppers' positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawErrors {
    /// True position of the user less the estimate, east and north in metres.
    pub user_m: [f64; 2],
    /// Of I and of J.
    pub vehicles: [VehicleError; 2],
}

impl From<Vec<Vector3<f64>>> for Draw {
    fn from(eavesdroppers: Vec<Vector3<f64>>) -> Self {
        Self { eavesdroppers, errors: None }
    }
}

/// A vehicle's errors per sample of a block.
#[derive(Debug, Clone, Copy)]
pub struct VehicleErrors {
    /// Cosine and sine of the heading's error.
    pub heading: [Lane; 2],
    /// The antenna's axis in the body frame.
    pub mount: [Lane; 3],
    /// True position less the one that is held, in metres.
    pub offset_m: [Lane; 3],
}

/// What is wrong per sample of a block.
#[derive(Debug, Clone)]
pub struct Errors {
    /// Of I and of J.
    pub vehicles: [VehicleErrors; 2],
    /// True position less the estimate, east and north in metres, of the user and of every eavesdropper; of the user alone
    /// where the draw has the eavesdroppers' positions.
    pub nodes_m: Vec<[Lane; 2]>,
}

/// A point of the errors, by its index in the sequence.
#[must_use]
pub fn draw_errors(problem: &Problem, index: usize, uniform: &Uniform) -> DrawErrors {
    let Pointing { heading_std_rad, mounting_std_rad, position_std_m: [horizontal_m, vertical_m] } =
        problem.pointing;
    let normal = |std: f64, dimension: usize| {
        if std > 0.0 { std * normal::quantile(uniform.at(index, VEHICLES + dimension)) } else { 0.0 }
    };
    let vehicles = [0, 1].map(|v: usize| VehicleError {
        heading_rad: normal(heading_std_rad, v),
        mount: jitter::body_axis([
            normal(mounting_std_rad, 2 + 2 * v),
            normal(mounting_std_rad, 3 + 2 * v),
            0.0,
        ]),
        offset_m: Vector3::new(
            normal(horizontal_m, 6 + 2 * v),
            normal(horizontal_m, 7 + 2 * v),
            normal(vertical_m, 10 + v),
        ),
    });
    DrawErrors { user_m: shift_m(problem.user_uncertainty, USER, index, uniform), vehicles }
}

/// All eavesdroppers' positions in one draw.
#[must_use]
pub fn positions(problem: &Problem, draw: usize, uniform: &Uniform) -> Vec<Vector3<f64>> {
    let nodes = problem.eavesdroppers.iter().enumerate();
    nodes
        .map(|(node, eavesdropper)| {
            let [east, north] = shift_m(eavesdropper.uncertainty, NODES + 2 * node, draw, uniform);
            eavesdropper.position_enu_m + Vector3::new(east, north, 0.0)
        })
        .collect()
}

/// A position's error, east and north in metres, by the two dimensions from `dimension` on.
fn shift_m(uncertainty: Uncertainty, dimension: usize, index: usize, uniform: &Uniform) -> [f64; 2] {
    let (u, turn) = (uniform.at(index, dimension), uniform.at(index, dimension + 1));
    let angle = std::f64::consts::TAU * turn;
    let radius = match uncertainty {
        Uncertainty::None => 0.0,
        Uncertainty::Disc { radius_m } => radius_m * u.sqrt(),
        // The radius of a two-dimensional Gaussian follows Rayleigh's law.
        Uncertainty::Gaussian { std_m } => std_m * (-2.0 * libm::log(u)).sqrt(),
    };
    let (sin, cos) = libm::sincos(angle);
    [radius * cos, radius * sin]
}

impl Errors {
    /// Errors of its own for each sample of a block; of the eavesdroppers' positions too, if so asked.
    #[must_use]
    pub fn of_block(problem: &Problem, block: usize, eavesdroppers: bool, uniform: &Uniform) -> Self {
        let indices: [usize; LANES] = std::array::from_fn(|l| block * LANES + l);
        let drawn = indices.map(|index| draw_errors(problem, index, uniform));
        let nodes = if eavesdroppers { problem.eavesdroppers.as_slice() } else { &[] };
        let shifts = nodes.iter().enumerate().map(|(node, eavesdropper)| {
            let all = indices.map(|i| shift_m(eavesdropper.uncertainty, NODES + 2 * node, i, uniform));
            [all.map(|m| m[0]), all.map(|m| m[1])]
        });
        let mut errors = Self::of_lanes(&drawn);
        errors.nodes_m.extend(shifts);
        errors
    }

    /// The same errors for every sample.
    #[must_use]
    pub fn of_draw(drawn: &DrawErrors) -> Self {
        Self::of_lanes(&[*drawn; LANES])
    }

    fn of_lanes(drawn: &[DrawErrors; LANES]) -> Self {
        let vehicles = [0, 1].map(|v: usize| {
            let lane = |f: &dyn Fn(&VehicleError) -> f64| drawn.map(|errors| f(&errors.vehicles[v]));
            VehicleErrors {
                heading: trigonometry::cos_sin(&lane(&|e| e.heading_rad)),
                mount: [0, 1, 2].map(|axis: usize| lane(&|e| e.mount[axis])),
                offset_m: [0, 1, 2].map(|axis: usize| lane(&|e| e.offset_m[axis])),
            }
        });
        Self { vehicles, nodes_m: vec![[drawn.map(|e| e.user_m[0]), drawn.map(|e| e.user_m[1])]] }
    }
}
