//! Where the search for ways begins: from the poses of the plan that stays, and from such in which each user has a part of its
//! own best poses, of both vehicles or of one; vehicles over their users; and ways at random. Each is drawn together until it can
//! be flown.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::expectation::kernel::{ANGLES, POWER, Raw, VEHICLE};
use super::super::expectation::sobol;
use super::super::model::Memory;
use super::super::volume::objective::{COARSE, Case};
use super::super::volume::ways::Ways;
use super::frame::Frame;
use super::limits::Limits;
use super::spline::Spline;
use crate::geo::Enu;

/// How far I and J go from where they stay to where a user has its best.
const TOWARDS: [[f64; 2]; 6] = [[0.3, 0.3], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0], [0.6, 0.2], [0.2, 0.6]];
/// The same towards users themselves.
const TOWARDS_USERS: [[f64; 2]; 4] = [[0.5, 0.0], [0.0, 0.5], [0.4, 0.4], [0.3, -0.3]];
/// Ways at random, and how far they reach in metres.
const RANDOM: usize = 4;
const REACH_M: f64 = 60.0;
/// The part of its limits that a start asks of a vehicle.
const PART: f64 = 0.9;

fn position(raw: &Raw, v: usize) -> Enu {
    Enu::new(raw[v * VEHICLE], raw[v * VEHICLE + 1], raw[v * VEHICLE + 2])
}

/// All starts of a frame. `own` are each user's best configurations by itself.
pub fn all<W: Ways>(
    case: &Case<'_, W>,
    frame: &Frame<'_>,
    limits: &[Limits; 2],
    own: &[Raw],
    seed: u64,
) -> Vec<Vec<f64>> {
    let n = frame.places.len();
    let stays = |slot: usize, v: usize| position(&frame.places[slot].standing, v);
    let best = |slot: usize, v: usize| position(&own[frame.places[slot].user], v);
    let over = |slot: usize, v: usize| {
        let user = frame.setups[frame.places[slot].user].problem.user_enu_m;
        Enu::new(user.x, user.y, stays(slot, v).z)
    };
    let mut targets: Vec<[Vec<Enu>; 2]> = Vec::new();
    let mut towards = |shares: [f64; 2], to: &dyn Fn(usize, usize) -> Enu| {
        targets.push([0, 1].map(|v: usize| {
            (0..n).map(|slot| stays(slot, v) + (to(slot, v) - stays(slot, v)) * shares[v]).collect()
        }));
    };
    towards([0.0; 2], &stays);
    for shares in TOWARDS {
        towards(shares, &best);
    }
    for shares in TOWARDS_USERS {
        towards(shares, &over);
    }
    for k in 0..RANDOM {
        let mut rng = ChaCha8Rng::seed_from_u64(sobol::mix(seed, 0x30_71 + k as u64));
        targets.push([0, 1].map(|v: usize| {
            let mut by = || REACH_M * rng.random_range(-1.0..1.0);
            (0..n).map(|slot| stays(slot, v) + Enu::new(by(), by(), 0.3 * by().abs())).collect()
        }));
    }
    let mut memory = Memory::default();
    targets.into_iter().map(|targets| start(case, frame, limits, &targets, own, &mut memory)).collect()
}

/// A start that passes each slot's targets about its middle.
fn start<W: Ways>(
    case: &Case<'_, W>,
    frame: &Frame<'_>,
    limits: &[Limits; 2],
    targets: &[Vec<Enu>; 2],
    own: &[Raw],
    memory: &mut Memory,
) -> Vec<f64> {
    let middles_s: Vec<f64> =
        frame.places.iter().map(|place| place.begins_s + 0.5 * place.on_air_s).collect();
    let setup = &frame.setups[0];
    let ways = [0, 1].map(|v: usize| {
        let cell = &setup.region.cells()[frame.cells[v]];
        let point = |control: usize| {
            let t_s = control as f64 / frame.controls as f64 * frame.superframe_s;
            let mut at = between(&middles_s, &targets[v], frame.superframe_s, t_s);
            for side in &cell.sides {
                let out_m = (side.normal.dot(&at.xy()) - side.offset_m).max(0.0);
                (at.x, at.y) = (at.x - out_m * side.normal.x, at.y - out_m * side.normal.y);
            }
            at.z = at.z.clamp(cell.altitude_m[0], cell.altitude_m[1]);
            at
        };
        let way =
            Spline { period_s: frame.superframe_s, control_enu_m: (0..frame.controls).map(point).collect() };
        let strain = limits[v].strain(&way.demand());
        if strain > PART { way.shrunk(PART / strain) } else { way }
    });
    let held: Vec<Raw> = frame
        .places
        .iter()
        .zip(&middles_s)
        .map(|(place, middle_s)| {
            // With the attitudes and the power that suit the slot's middle best.
            let at = |raw: &Raw| {
                let mut moved = *raw;
                for v in 0..2 {
                    moved[v * VEHICLE..v * VEHICLE + 3]
                        .copy_from_slice(ways[v].position(*middle_s).as_slice());
                    moved[v * VEHICLE + ANGLES + 2] = place.yaw(v);
                }
                moved[POWER] = place.standing[POWER];
                let [then, now] = [position(raw, 1), position(&moved, 1)].map(|p| frame.null(place, &p).0);
                for k in 0..2 {
                    moved[VEHICLE + ANGLES + k] += now[k] - then[k];
                }
                moved
            };
            let choices = [at(&place.standing), at(&own[place.user])];
            let rates = choices.map(|raw| case.rate(place.user, COARSE, &raw, memory, &mut [0.0; 14]));
            choices[usize::from(rates[1] > rates[0])]
        })
        .collect();
    frame.encode(&ways.map(|way| way.control_enu_m), &held)
}

/// What lies evenly between the targets of two middles of slots, on the cycle.
fn between(middles_s: &[f64], targets: &[Enu], period_s: f64, t_s: f64) -> Enu {
    let n = middles_s.len();
    let next = middles_s.partition_point(|middle| *middle <= t_s);
    let [a, b] = [(next + n - 1) % n, next % n];
    let from_s = if next == 0 { middles_s[a] - period_s } else { middles_s[a] };
    let to_s = if next == n { middles_s[b] + period_s } else { middles_s[b] };
    let share = if to_s > from_s { (t_s - from_s) / (to_s - from_s) } else { 0.0 };
    targets[a] + (targets[b] - targets[a]) * share
}
