//! One vehicle after the other: where the two paths cannot be kept apart as sets, the vehicles move in turns, each
//! while the other rests.
//!
//! A* over pairs of sites. A site is a place where a vehicle may wait: its start, its goal, points above and below
//! both, and octagons round the places it must keep away from. A move takes one vehicle from a site to another by the
//! direct way, and is allowed if it stays clear of where the other rests. What comes out is a hold ("J waits until I
//! has arrived"), or a detour, or a step aside to let the other pass, whichever takes least time.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

use super::route::{Corridor, lifted};
use super::separation::Clearance;
use super::trajectory::Limits;
use crate::geo::Enu;
use crate::role::{PerVehicle, Role};

/// Between one vehicle's arrival and the other's departure.
pub(super) const PAUSE: Duration = Duration::from_secs(2);
/// An octagon's radius over the clearance: its sides must pass outside the circle, 1 / cos 22.5 deg = 1.082.
const OCTAGON: f64 = 1.1;

/// What one vehicle may do.
#[derive(Debug, Clone)]
pub(super) struct Side {
    /// Its start, its goal, then the others; a single one for a vehicle that stays.
    sites: Vec<Enu>,
    /// What it occupies instead of its site, where its place is not known exactly.
    blocks: Option<Vec<Enu>>,
    limits: Limits,
}

/// One vehicle flies while the other rests.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Move {
    pub role: Role,
    pub path: Vec<Enu>,
}

impl Side {
    /// A vehicle on its way from `start` to `goal` past places `around` from which it must stay `clearance_m` away.
    pub fn moving(
        corridor: &Corridor,
        start: Enu,
        goal: Enu,
        around: &[Enu],
        clearance_m: f64,
        limits: Limits,
    ) -> Self {
        let mut sites = vec![start, goal];
        let own = [corridor.entry(&start), goal];
        let places = || own.iter().chain(around);
        let levels = levels(corridor, places(), clearance_m);
        sites.extend(own.iter().flat_map(|end| levels.iter().map(|&z| lifted(end.xy(), z))));
        let d = std::f64::consts::FRAC_1_SQRT_2;
        let compass = [[1., 0.], [d, d], [0., 1.], [-d, d], [-1., 0.], [-d, -d], [0., -1.], [d, -d]];
        for centre in places() {
            for z in
                own.iter().map(|end| end.z).filter(|z| (z - corridor.clamped(centre.z)).abs() < clearance_m)
            {
                let level = Enu::new(centre.x, centre.y, z);
                sites.extend(compass.map(|[x, y]| level + Enu::new(x, y, 0.0) * (OCTAGON * clearance_m)));
            }
        }
        let mut kept: Vec<Enu> = Vec::new();
        for (k, site) in sites.into_iter().enumerate() {
            // Start and goal have been checked, and keep their places in front.
            if k < 2 || (corridor.contains(&site, 1e-9) && !kept.contains(&site)) {
                kept.push(site);
            }
        }
        Self { sites: kept, blocks: None, limits }
    }

    /// A vehicle that is somewhere on `blocks`, and whose movements are not ours to plan.
    pub fn staying(blocks: &[Enu], limits: Limits) -> Self {
        // One site to rest at; what counts is what it blocks.
        Self { sites: vec![Enu::zeros()], blocks: Some(blocks.to_vec()), limits }
    }

    fn goal(&self) -> usize {
        usize::from(self.sites.len() > 1)
    }

    fn occupied(&self, site: usize) -> &[Enu] {
        self.blocks.as_deref().unwrap_or_else(|| std::slice::from_ref(&self.sites[site]))
    }
}

/// The altitudes worth flying at between and around `places`: the band's ends, the places' own, and `clearance_m`
/// above and below them; ascending.
pub(super) fn levels<'a>(
    corridor: &Corridor,
    places: impl Iterator<Item = &'a Enu>,
    clearance_m: f64,
) -> Vec<f64> {
    let [low_m, high_m] = corridor.altitude_m;
    // A little more than the clearance, so that rounding does not refuse the level it was made for.
    let lift_m = clearance_m + 1e-6;
    let around = places.flat_map(|p| {
        let z = corridor.clamped(p.z);
        [z, z - lift_m, z + lift_m]
    });
    let mut levels: Vec<f64> =
        [low_m, high_m].into_iter().chain(around).filter(|z| (low_m..=high_m).contains(z)).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    levels
}

/// The quickest sequence of moves that takes both sides to their goals, always with `clearance` between them; `None`
/// if no sequence over the sites does.
pub(super) fn search(
    corridor: &Corridor,
    sides: &PerVehicle<Side>,
    clearance: &Clearance,
) -> Option<Vec<Move>> {
    let (n, m) = (sides.i.sites.len(), sides.j.sites.len());
    let sites_of = |state: usize| PerVehicle { i: state / m, j: state % m };
    let goal = sides.i.goal() * m + sides.j.goal();
    let ways = PerVehicle::from_fn(|role| Ways::new(corridor, &sides[role]));
    let left = |state: usize| {
        let at = sites_of(state);
        ways.i.to_goal(at.i).saturating_add(ways.j.to_goal(at.j))
    };
    let mut reached: Vec<Option<(Duration, usize)>> = vec![None; n * m];
    let mut done = vec![false; n * m];
    let mut open = BinaryHeap::from([Reverse((left(0), 0))]);
    reached[0] = Some((Duration::ZERO, 0));
    while let Some(Reverse((_, state))) = open.pop() {
        if state == goal {
            return Some(moves(&reached, goal, sites_of, &ways));
        }
        if std::mem::replace(&mut done[state], true) {
            continue;
        }
        let Some((spent, _)) = reached[state] else { continue };
        let at = sites_of(state);
        for role in Role::BOTH {
            let peer = sides[role.peer()].occupied(at[role.peer()]);
            for to in 1..sides[role].sites.len() {
                let next = if role == Role::I { to * m + at.j } else { at.i * m + to };
                if next == state || done[next] {
                    continue;
                }
                let Some(way) = ways[role].get(at[role], to) else { continue };
                let through = spent.saturating_add(way.lasts).saturating_add(PAUSE);
                let better = reached[next].is_none_or(|(known, _)| through < known);
                if better && clearance.is_kept(role, &way.path, peer) {
                    reached[next] = Some((through, state));
                    open.push(Reverse((through.saturating_add(left(next)), next)));
                }
            }
        }
    }
    None
}

/// The moves that lead from state 0 to `goal`, in order.
fn moves(
    reached: &[Option<(Duration, usize)>],
    goal: usize,
    sites_of: impl Fn(usize) -> PerVehicle<usize>,
    ways: &PerVehicle<Ways>,
) -> Vec<Move> {
    let mut moves = Vec::new();
    let mut state = goal;
    while let Some((_, before)) = reached[state].filter(|_| state != 0) {
        let (from, to) = (sites_of(before), sites_of(state));
        let role = if from.i == to.i { Role::J } else { Role::I };
        if let Some(way) = ways[role].get(from[role], to[role]) {
            moves.push(Move { role, path: way.path.clone() });
        }
        state = before;
    }
    moves.reverse();
    moves
}

/// The direct ways between a vehicle's sites.
struct Ways {
    sites: usize,
    goal: usize,
    ways: Vec<Option<Way>>,
}

struct Way {
    path: Vec<Enu>,
    lasts: Duration,
}

impl Ways {
    fn new(corridor: &Corridor, side: &Side) -> Self {
        let way = |from: &Enu, to: &Enu| {
            let path = corridor.direct(from, to)?;
            let lasts = Duration::try_from_secs_f64(side.limits.path_s(&path)).ok()?;
            Some(Way { path, lasts })
        };
        let ways =
            side.sites.iter().flat_map(|from| side.sites.iter().map(move |to| way(from, to))).collect();
        Self { sites: side.sites.len(), goal: side.goal(), ways }
    }

    fn get(&self, from: usize, to: usize) -> Option<&Way> {
        self.ways[from * self.sites + to].as_ref()
    }

    /// The time to the goal if nothing were in the way: the search's lower bound.
    fn to_goal(&self, from: usize) -> Duration {
        self.get(from, self.goal).map_or(Duration::ZERO, |way| way.lasts)
    }
}
