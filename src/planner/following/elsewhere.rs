//! Where to make for when a motion carries nothing: the user has come to where no pose near the pair's serves it, so that nothing says
//! which way is up.

use super::super::expectation::kernel::{Raw, VEHICLE};
use super::super::setup::Setup;
use super::frame::{FAST, Frame};
use super::search::ASIDE_M;
use crate::geo::{Attitude, Enu};
use crate::planner::{LEAST_BIT_S_HZ, Options, search};
use crate::role::Role;

/// A pose that is farther, in seconds, by this counts half.
const WORTH_S: f64 = 10.0;

/// The poses and powers, of the best that a global search finds, that are worth most for the way to them, each on its own side, and how
/// long both take to turn there, in seconds; `None` where there are none that both may make for.
pub fn goal(frame: &Frame<'_>, setup: &Setup<'_>, seed: u64) -> Option<(Raw, f64)> {
    let found = search::rough(setup, &Options { seed, ..Options::default() }).into_iter();
    let goals = found.filter(|rough| rough.value > LEAST_BIT_S_HZ).filter_map(|rough| {
        let to = beside(frame, &rough.raw);
        let [flies_s, turns_s] = takes_s(frame, setup, &to)?;
        Some((rough.value / (flies_s.max(turns_s) + WORTH_S), to, turns_s))
    });
    let best = goals.reduce(|best, other| if other.0 > best.0 { other } else { best });
    best.map(|(_, raw, turns_s)| (raw, turns_s))
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
        let pose = |raw: &Raw| {
            let [x, y, z, roll, pitch, yaw] = std::array::from_fn(|k| raw[v * VEHICLE + k]);
            (Enu::new(x, y, z), Attitude::from_euler(roll, pitch, yaw))
        };
        let ((from, attitude), (to, facing)) = (pose(&frame.standing), pose(to));
        let way = to - from;
        let may =
            if frame.moves[v] { setup.region.cell_of(&to) == frame.cells[v] } else { way.norm() == 0.0 };
        if !may {
            return None;
        }
        let flies_s = frame.scene.limits[role].flies_s(&way);
        let turns_s = attitude.angle_to(&facing) / frame.scene.turn_rate_rad_s[role];
        slower_s = [slower_s[0].max(flies_s / FAST), slower_s[1].max(turns_s / FAST)];
    }
    Some(slower_s)
}
