//! The variables of a motion from now on.
//!
//! In this order: of I's way and of J's the control points that are free (the first three are given by position, velocity and
//! acceleration, the last three are one, where the vehicle rests); at each knot but the first I's roll and pitch and what J's are
//! beside those of its null on the user; at each knot but the first the logarithm of J's power over its ceiling.

use nalgebra::Vector3;

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::moving::{self, NODES};
use super::super::powers;
use super::super::setup::Setup;
use super::super::turning::Held;
use super::super::variables::PowerChart;
use super::motion::{Foreseen, Knot, Motion, Slip, held};
use super::side::Side;
use super::{Flying, Path, SEGMENT_S, SEGMENTS, SHORTEST_SLIP_S, Scene};
use crate::geo::Enu;
use crate::role::{PerVehicle, Role};

/// Units of the variables: with these what changes a rate changes it about as much.
pub const UNIT_M: f64 = 20.0;
pub const UNIT_RAD: f64 = 0.1;
pub const UNIT_LOG: f64 = 0.5;
/// Control points that are free, the last of which is three.
pub const FREE: usize = SEGMENTS - 2;
/// How far inside the band the free control points are, in metres: what rounding may take off.
const INSIDE_M: f64 = 1e-3;
/// The part of its speed at which a vehicle sets out elsewhere, to begin a search with.
pub const FAST: f64 = 0.8;

/// A motion to be found.
pub struct Frame<'a> {
    pub scene: &'a Scene<'a>,
    /// Of each node.
    pub setups: &'a [Setup<'a>],
    pub begins_s: f64,
    pub standing: Raw,
    user: &'a Foreseen,
    given: [[Enu; 3]; 2],
    /// Angles at the first knot: I's, and J's beside its null.
    angles: [[f64; 2]; 2],
    /// What J's are off besides.
    slip: [f64; 2],
    power: PowerChart,
    pub cells: [usize; 2],
    pub moves: [bool; 2],
    /// Where each has to stay.
    pub sides: PerVehicle<Side>,
}

impl<'a> Frame<'a> {
    /// When the nodes are, seconds.
    pub fn nodes_s(begins_s: f64) -> impl Iterator<Item = f64> {
        (0..SEGMENTS).flat_map(move |s| NODES.map(|share| begins_s + SEGMENT_S * (s as f64 + share)))
    }

    /// From a standing pair, how it moves, and the motion that it is on.
    pub fn new(
        scene: &'a Scene<'a>,
        setups: &'a [Setup<'a>],
        user: &'a Foreseen,
        from: &PerVehicle<Flying<'_>>,
        begins_s: f64,
    ) -> Self {
        let at = PerVehicle::from_fn(|role: Role| from[role].at(role, begins_s));
        let (raw, now) = (Setup::raw(&at.map(|(vehicle, _)| vehicle)), at.map(|(_, now)| now));
        let setup = &setups[0];
        let yaw = raw[VEHICLE + ANGLES + 2];
        let (null, _) = moving::null(&(now.j.position_enu_m - user.at(begins_s)), yaw);
        let beside = [0, 1].map(|k: usize| raw[VEHICLE + ANGLES + k] - null[k]);
        // A level vehicle leans to move, and is not level then.
        let moves = [0, 1].map(|v: usize| setup.tilt_rad[v] > 0.0);
        let last = from.j.on().filter(|_| moves[1]);
        // Of the newest motion: whatever either flies is on these planes' sides.
        let flown = Role::BOTH.into_iter().filter_map(|role| from[role].on());
        let newest = flown.reduce(|a, b| if b.begins_s() > a.begins_s() { b } else { a });
        let reach = PerVehicle::from_fn(|role: Role| from[role].reach(role, begins_s));
        let meant = last.map_or(beside, |motion| motion.knot_at(begins_s).j);
        Self {
            scene,
            setups,
            begins_s,
            standing: raw,
            user,
            given: [&now.i, &now.j].map(|now| Path::beginning(now, SEGMENT_S)),
            angles: [[raw[ANGLES], raw[ANGLES + 1]], meant],
            slip: [0, 1].map(|k: usize| beside[k] - meant[k]),
            power: powers::of(setup, &raw),
            cells: [&now.i, &now.j].map(|now| setup.region.cell_of(&now.position_enu_m)),
            moves,
            sides: Side::between(&reach, newest.map(|motion| motion.apart), scene.apart_m),
        }
    }

    pub fn point(&self, v: usize, free: usize) -> usize {
        3 * (v * FREE + free)
    }

    /// First of a vehicle's angles at a knot; none of the first.
    pub fn angle(&self, knot: usize, v: usize) -> Option<usize> {
        (knot > 0).then(|| 6 * FREE + 4 * (knot - 1) + 2 * v)
    }

    /// J's power at a knot; none of the first, nor where it does not vary.
    pub fn log(&self, knot: usize) -> Option<usize> {
        let varies = matches!(self.power, PowerChart::Log { .. });
        (knot > 0 && varies).then(|| 6 * FREE + 4 * SEGMENTS + knot - 1)
    }

    pub fn dimension(&self) -> usize {
        6 * FREE + 5 * SEGMENTS
    }

    /// The variable of a control point, if it is free.
    pub fn free(&self, v: usize, control: usize) -> Option<usize> {
        (control >= 3 && self.moves[v]).then(|| self.point(v, (control - 3).min(FREE - 1)))
    }

    fn control(&self, x: &[f64], v: usize, control: usize) -> Enu {
        match self.free(v, control) {
            Some(at) => Vector3::new(x[at], x[at + 1], x[at + 2]) * UNIT_M,
            None => self.given[v][control.min(2)],
        }
    }

    /// The weighted sum of a segment's four control points.
    pub fn sum(&self, x: &[f64], v: usize, segment: usize, weights: [f64; 4]) -> Vector3<f64> {
        (0..4).map(|k| self.control(x, v, segment + k) * weights[k]).sum()
    }

    /// Roll and pitch at a knot: I's, or J's beside its null.
    fn given_angles(&self, x: &[f64], knot: usize, v: usize) -> [f64; 2] {
        self.angle(knot, v).map_or(self.angles[v], |at| [UNIT_RAD * x[at], UNIT_RAD * x[at + 1]])
    }

    /// I's roll and pitch at a knot, within its tilt: what runs straight from one to the next is within it all the way, at one
    /// rate. (Drawn in from beyond it at each instant instead, a straight run hurries along the limit.)
    pub fn i_held(&self, x: &[f64], knot: usize) -> Held {
        held(self.given_angles(x, knot, 0), self.setups[0].tilt_rad[0])
    }

    /// J's roll and pitch beside its null at a knot.
    pub fn j_beside(&self, x: &[f64], knot: usize) -> [f64; 2] {
        self.given_angles(x, knot, 1)
    }

    /// J's power at a knot in W.
    pub fn power_w(&self, x: &[f64], knot: usize) -> f64 {
        match (self.log(knot), &self.power) {
            (Some(at), PowerChart::Log { max_w, floor }) => {
                max_w * libm::exp((UNIT_LOG * x[at]).clamp(*floor, 0.0))
            }
            _ => self.standing[VEHICLE + POWER],
        }
    }

    /// J's roll and pitch with its null on the user from a place at an instant, and how they change with the place.
    pub fn null(&self, t_s: f64, j: &Enu) -> ([f64; 2], [[f64; 3]; 2]) {
        moving::null(&(j - self.user.at(t_s)), self.standing[VEHICLE + ANGLES + 2])
    }

    /// Lowest and highest of each variable.
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        let mut bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; self.dimension()];
        for v in 0..2 {
            let [low, high] = self.setups[0].region.cells()[self.cells[v]].altitude_m;
            let inside_m = INSIDE_M.min(0.5 * (high - low));
            for free in 0..FREE {
                bounds[self.point(v, free) + 2] = [low + inside_m, high - inside_m].map(|z| z / UNIT_M);
            }
        }
        if let PowerChart::Log { floor, .. } = self.power {
            for at in (0..=SEGMENTS).filter_map(|knot| self.log(knot)) {
                bounds[at] = [floor / UNIT_LOG, 0.0];
            }
        }
        bounds
    }

    fn encode(&self, points: impl Fn(usize, usize) -> Enu, knots: impl Fn(usize) -> Knot) -> Vec<f64> {
        let mut x = vec![0.0; self.dimension()];
        for v in 0..2 {
            for free in 0..FREE {
                let at = self.point(v, free);
                x[at..at + 3].copy_from_slice((points(v, free + 3) / UNIT_M).as_slice());
            }
        }
        for knot in 1..=SEGMENTS {
            let here = knots(knot);
            for (v, angles) in [here.i, here.j].into_iter().enumerate() {
                if let Some(at) = self.angle(knot, v) {
                    x[at..at + 2].copy_from_slice(&angles.map(|a| a / UNIT_RAD));
                }
            }
            if let (Some(at), PowerChart::Log { max_w, floor }) = (self.log(knot), &self.power) {
                let least_w = max_w * libm::exp(*floor);
                x[at] = libm::log(here.j_power_w.max(least_w) / max_w) / UNIT_LOG;
            }
        }
        x
    }

    /// Each going on as it does: on its motion, or at rest.
    pub fn going_on(&self, from: &PerVehicle<Flying<'_>>) -> Vec<f64> {
        let at_s = |k: usize| self.begins_s + SEGMENT_S * k as f64;
        let points = |v: usize, control: usize| match from[Role::BOTH[v]].on() {
            Some(motion) => {
                let about_s = at_s(control) - SEGMENT_S;
                motion.ways[Role::BOTH[v]].control(about_s, SEGMENT_S)
            }
            None => self.given[v][1],
        };
        let rests = Knot {
            at_s: 0.0,
            i: self.angles[0],
            j: self.angles[1],
            j_power_w: self.standing[VEHICLE + POWER],
        };
        self.encode(points, |knot| {
            let [i, j] =
                Role::BOTH.map(|role| from[role].on().map_or(rests, |motion| motion.knot_at(at_s(knot))));
            Knot { i: i.i, ..j }
        })
    }

    /// Straight to poses: as fast as both may fly but for [`FAST`], all else evenly by an instant.
    pub fn towards(&self, to: &Raw, by_s: f64) -> Vec<f64> {
        let place = |v: usize| Enu::new(to[v * VEHICLE], to[v * VEHICLE + 1], to[v * VEHICLE + 2]);
        let points = |v: usize, control: usize| {
            let from = self.given[v][2];
            let way = place(v) - from;
            let takes_s = self.scene.limits[Role::BOTH[v]].flies_s(&way);
            let flown_s = FAST * SEGMENT_S * (control - 2) as f64;
            from + way * if flown_s < takes_s { flown_s / takes_s } else { 1.0 }
        };
        let (null, _) = self.null(by_s, &place(1));
        let angles = |v: usize| [0, 1].map(|k: usize| to[v * VEHICLE + ANGLES + k]);
        let meant = [angles(0), [0, 1].map(|k: usize| angles(1)[k] - null[k])];
        let now_w = self.standing[VEHICLE + POWER];
        self.encode(points, |knot| {
            let share = (SEGMENT_S * knot as f64 / (by_s - self.begins_s)).min(1.0);
            let mixed = |a: f64, b: f64| a + share * (b - a);
            let [i, j] = [0, 1].map(|v: usize| [0, 1].map(|k: usize| mixed(self.angles[v][k], meant[v][k])));
            Knot { at_s: 0.0, i, j, j_power_w: mixed(now_w, to[VEHICLE + POWER]) }
        })
    }

    /// The motion that the variables say.
    pub fn motion(&self, x: &[f64]) -> Motion {
        let path = |v: usize| {
            Path::new(self.begins_s, SEGMENT_S, (0..SEGMENTS + 3).map(|k| self.control(x, v, k)).collect())
        };
        let knot = |knot: usize| Knot {
            at_s: self.begins_s + SEGMENT_S * knot as f64,
            i: self.i_held(x, knot).at,
            j: self.j_beside(x, knot),
            j_power_w: self.power_w(x, knot),
        };
        let [i, j] = self.setups[0].tilt_rad;
        Motion {
            ways: PerVehicle { i: path(0), j: path(1) },
            yaws: PerVehicle { i: self.standing[ANGLES + 2], j: self.standing[VEHICLE + ANGLES + 2] },
            tilts_rad: PerVehicle { i, j },
            i_power_w: self.standing[POWER],
            knots: (0..=SEGMENTS).map(knot).collect(),
            user: self.user.clone(),
            slip: Slip { angles: self.slip, lasts_s: SHORTEST_SLIP_S },
            apart: self.sides.i.outwards,
            tolerances: Vec::new(),
            expected_bps_hz: 0.0,
        }
    }
}
