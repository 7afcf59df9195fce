//! Where to make for when more is to be had elsewhere than on any way that begins as the last motion goes on: the user has come to where
//! another optimum is better than the one the pair is in, or where no pose near the pair's serves it, so that nothing says which way
//! is up.

use std::f64::consts::{FRAC_PI_2, LOG2_E, PI};

use super::super::expectation::kernel::{ANGLES, Raw, VEHICLE};
use super::super::setup::Setup;
use super::super::turning::Held;
use super::frame::{FAST, Frame};
use super::search::ASIDE_M;
use crate::geo::{Attitude, Enu};
use crate::planner::{Options, search};
use crate::role::Role;

/// A pose that is farther, in seconds, by this counts half.
const WORTH_S: f64 = 10.0;
/// Starts of the search while something is carried: a part of its own number, others for each motion.
const STARTS: usize = 24;
/// By so much the antenna's axis may be beyond the horizon for its other end to be turned there, in radians: it is drawn in by as much.
const BEYOND_RAD: f64 = 0.1;

/// The poses and powers, of the best that a global search finds, that are worth most for the way to them, each on its own side, and how
/// long both take to turn there, in seconds; `None` where there are none that both may make for, or none that carry more than
/// `least_bps_hz`. Where nothing is carried the search is a whole one.
pub fn goal(
    frame: &Frame<'_>,
    setup: &Setup<'_>,
    seed: u64,
    carries: bool,
    least_bps_hz: f64,
) -> Option<(Raw, f64)> {
    let options = if carries {
        Options { seed: seed ^ frame.begins_s.to_bits(), starts: Some(STARTS), ..Options::default() }
    } else {
        Options { seed, ..Options::default() }
    };
    let better =
        search::rough(setup, &options).into_iter().filter(|rough| rough.value * LOG2_E > least_bps_hz);
    let goals = better.filter_map(|rough| {
        let to = turned(frame, setup, &beside(frame, &rough.raw));
        let [flies_s, turns_s] = takes_s(frame, setup, &to)?;
        Some((rough.value / (flies_s.max(turns_s) + WORTH_S), to, turns_s))
    });
    let best = goals.reduce(|best, other| if other.0 > best.0 { other } else { best });
    best.map(|(_, raw, turns_s)| (raw, turns_s))
}

/// The same with the upper end of each antenna's axis up, and of I's the end for which it turns less: about the horizon both are the same
/// antenna, and attitudes half a turn apart. (J's null is on a user below it.)
fn turned(frame: &Frame<'_>, setup: &Setup<'_>, to: &Raw) -> Raw {
    let (mut turned, canonical) = (*to, setup.vehicles(to));
    for (v, role) in Role::BOTH.into_iter().enumerate() {
        let pose = &canonical[role].pose;
        let over = pose.pitch_rad - PI.copysign(pose.pitch_rad);
        let may = role == Role::I && over.abs() <= FRAC_PI_2 + BEYOND_RAD && setup.tilt_rad[v] >= FRAC_PI_2;
        let other = may.then(|| Held::new([-pose.roll_rad, over], setup.tilt_rad[v]).at);
        let standing = attitude(&frame.standing, v);
        let far =
            |angles: &[f64; 2]| standing.angle_to(&Attitude::from_euler(angles[0], angles[1], pose.yaw_rad));
        let upright = [pose.roll_rad, pose.pitch_rad];
        let nearest = other.filter(|other| far(other) < far(&upright)).unwrap_or(upright);
        turned[v * VEHICLE + ANGLES..v * VEHICLE + ANGLES + 2].copy_from_slice(&nearest);
    }
    turned
}

fn attitude(raw: &Raw, v: usize) -> Attitude {
    let [roll, pitch, yaw] = std::array::from_fn(|k| raw[v * VEHICLE + ANGLES + k]);
    Attitude::from_euler(roll, pitch, yaw)
}

/// Poses with each vehicle on its own side: as near as it may come to where it is to be.
fn beside(frame: &Frame<'_>, to: &Raw) -> Raw {
    let mut beside = *to;
    for (v, role) in Role::BOTH.into_iter().enumerate() {
        let place = &mut beside[v * VEHICLE..v * VEHICLE + 3];
        let (at, side) = (Enu::new(place[0], place[1], place[2]), &frame.sides[role]);
        let drawn = at - side.outwards * (side.outside_m(&at) + ASIDE_M).max(0.0);
        place.copy_from_slice(drawn.as_slice());
    }
    beside
}

/// How long the slower of both flies to poses, and turns there, in seconds, as fast as [`Frame::towards`] has it; `None` where one may
/// not go there.
fn takes_s(frame: &Frame<'_>, setup: &Setup<'_>, to: &Raw) -> Option<[f64; 2]> {
    let mut slower_s = [0.0f64; 2];
    for (v, role) in Role::BOTH.into_iter().enumerate() {
        let place = |raw: &Raw| Enu::new(raw[v * VEHICLE], raw[v * VEHICLE + 1], raw[v * VEHICLE + 2]);
        let goal = place(to);
        let way = goal - place(&frame.standing);
        let may =
            if frame.moves[v] { setup.region.cell_of(&goal) == frame.cells[v] } else { way.norm() == 0.0 };
        if !may {
            return None;
        }
        let flies_s = frame.scene.limits[role].flies_s(&way);
        let turns_s =
            attitude(&frame.standing, v).angle_to(&attitude(to, v)) / frame.scene.turn_rate_rad_s[role];
        slower_s = [slower_s[0].max(flies_s / FAST), slower_s[1].max(turns_s / FAST)];
    }
    Some(slower_s)
}
