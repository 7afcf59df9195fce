//! Both vehicles from where they are to the next poses (PROTOCOL F1): inside the geofence and the altitude band, outside the
//! no-fly areas, and apart from each other.
//!
//! The vehicles' clocks differ and either may be late, so the paths are kept apart as sets of points wherever that is
//! possible: then no timing brings the vehicles together. Tried are, in this order:
//! 1. both directly;
//! 2. one, the other or both by way of another altitude layer: of the pairs of paths that are clear of each other, the
//!    one that is done first (ties: least motion in all, then the lower layers);
//! 3. one directly, the other by a detour above, below or round the whole of the first one's path (J, or I if that is
//!    done sooner);
//! 4. in turns, one after the other, with detours and steps aside (`sequence`). Here time separates the vehicles and the
//!    result says so ([`Separation::Time`]): whoever flies it should move a vehicle only while the other rests where its
//!    trajectory says.
//!
//! *Clearance*: [`clearance_m`]. Where the ends themselves are closer than that, the vehicles come no closer than their
//! ends are, and open up to the full clearance within twice its length.

mod error;

pub use error::{End, TransitError};

use std::f64::consts::PI;
use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};

use super::geofence::Geofence;
use super::no_fly::NoFlyAreas;
use super::route::Corridor;
use super::separation::{Clearance, clearance_m, polyline_distance_m};
use super::sequence::{self, Move, PAUSE, Side};
use super::trajectory::{Limits, Start, Trajectory};
use crate::geo::polygon::MAX_COORDINATE_M;
use crate::geo::{Attitude, Enu, Pose, has_meaning};
use crate::planner::problem::Airspace;
use crate::role::{PerVehicle, Role};

/// How far outside the corridor a transit may start, in metres: a hovering vehicle is never exactly where it was told
/// to be. Below the band it may start anywhere.
const START_SLACK_M: f64 = 1.0;
/// The part of the minimum separation that vehicles on their starting places must have, for the same reason.
const START_SEPARATION: f64 = 0.9;
/// What a planner's rounding may leave of a constraint, in metres.
const GOAL_SLACK_M: f64 = 1e-6;

/// What keeps the vehicles apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Separation {
    /// The paths are apart as sets of points: however late a vehicle is, they do not meet.
    Paths,
    /// The vehicles move in turns: apart as long as none starts before the other has arrived.
    Time,
}

/// Both vehicles' way to the next poses. Both trajectories start at the same instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Transit {
    /// Who flies what.
    pub trajectories: PerVehicle<Trajectory>,
    /// What keeps them apart.
    pub separation: Separation,
    /// The distance in metres that is never undercut (with [`Separation::Time`], on time).
    pub clearance_m: f64,
}

impl Transit {
    /// Until both vehicles have arrived.
    #[must_use]
    pub fn duration(&self) -> Duration {
        self.trajectories.i.duration().max(self.trajectories.j.duration())
    }
}

/// Plans transits in one airspace for one pair of vehicles.
#[derive(Debug, Clone)]
pub struct Router {
    corridor: Corridor,
    limits: PerVehicle<Limits>,
    min_separation_m: f64,
    clearance_m: f64,
}

/// Where a vehicle goes.
#[derive(Debug, Clone, Copy)]
struct Goal {
    position_enu_m: Enu,
    attitude: Attitude,
}

impl Router {
    /// A router for `airspace` and vehicles with `limits`.
    ///
    /// # Errors
    /// [`TransitError`] if the airspace or a limit makes no sense.
    pub fn new(airspace: &Airspace, limits: &PerVehicle<Limits>) -> Result<Self, TransitError> {
        let [low_m, high_m] = airspace.altitude_m;
        let separation_m = airspace.min_separation_m;
        let usable = [low_m, high_m, separation_m].iter().all(|value| value.abs() <= MAX_COORDINATE_M);
        if !(usable && low_m <= high_m && separation_m >= 0.0) {
            return Err(TransitError::Airspace { low_m, high_m, separation_m });
        }
        for role in Role::BOTH {
            if let Some((key, value)) = limits[role].fault() {
                return Err(TransitError::Limit { role, key, value });
            }
        }
        let fence = Geofence::new(&airspace.area_enu_m)?;
        let no_fly = NoFlyAreas::new(airspace)?;
        Ok(Self {
            corridor: Corridor { fence, altitude_m: airspace.altitude_m, no_fly },
            limits: *limits,
            min_separation_m: separation_m,
            clearance_m: clearance_m(airspace),
        })
    }

    /// What a vehicle can do.
    #[must_use]
    pub fn limits(&self, role: Role) -> &Limits {
        &self.limits[role]
    }

    /// Whether a planned position is within the airspace.
    #[must_use]
    pub fn holds(&self, position_enu_m: &Enu) -> bool {
        self.corridor.contains(position_enu_m, GOAL_SLACK_M)
    }

    /// Whether a vehicle can take off and land at a place on the ground.
    #[must_use]
    pub fn can_be_home(&self, home: &Enu) -> bool {
        self.corridor.fence.contains(home.xy()) && self.check_column(Role::I, home).is_ok()
    }

    /// The no-fly areas, by name, that a vehicle would cross that goes straight home from a place at any altitude from the
    /// first to the second: as an autopilot does by itself.
    #[must_use]
    pub fn crossed_straight_home(&self, from: &Enu, home: &Enu, altitude_m: [f64; 2]) -> Vec<String> {
        let areas = self.corridor.no_fly.iter();
        areas.flat_map(|areas| areas.swept([from.xy(), home.xy()], altitude_m)).map(str::to_owned).collect()
    }

    /// The no-fly areas, by name, into which a vehicle would come that lands where it is.
    #[must_use]
    pub fn crossed_straight_down(&self, from: &Enu) -> Vec<String> {
        let areas = self.corridor.no_fly.iter();
        let depths = [from.z - MAX_COORDINATE_M, from.z];
        areas.flat_map(|areas| areas.swept([from.xy(), from.xy()], depths)).map(str::to_owned).collect()
    }

    /// Both vehicles to the poses of a slot. A start below the altitude band is left vertically and without turning.
    ///
    /// # Errors
    /// [`TransitError`] with the numbers if an end is outside the airspace, the ends are too close to each other, or
    /// no way was found.
    pub fn plan(&self, from: &PerVehicle<Start>, to: &PerVehicle<Pose>) -> Result<Transit, TransitError> {
        for role in Role::BOTH {
            let start = usable_start(role, &from[role])?;
            let below = Enu::new(start.x, start.y, start.z.max(self.corridor.altitude_m[0]));
            self.check_inside(role, End::Start, &below, START_SLACK_M)?;
        }
        let distance_m = (from.i.position_enu_m - from.j.position_enu_m).norm();
        let needed_m = START_SEPARATION * self.min_separation_m;
        if distance_m < needed_m {
            return Err(TransitError::TooClose { end: End::Start, distance_m, needed_m });
        }
        for role in Role::BOTH {
            let Pose { roll_rad, pitch_rad, yaw_rad, .. } = to[role];
            if ![roll_rad, pitch_rad, yaw_rad].iter().all(|angle| angle.is_finite()) {
                return Err(TransitError::NotUsable { role, end: End::Goal });
            }
        }
        self.pair(
            from,
            &to.map(|pose| Goal { position_enu_m: pose.position_enu_m, attitude: pose.attitude() }),
        )
    }

    /// Both vehicles to above their homes at the band's lowest altitude, level: from there the autopilots land. A
    /// vehicle below the band beside its home stays where it is. Starts are taken as they are, even outside the
    /// airspace or too close to each other.
    ///
    /// When the link between the vehicles is lost, both still know the table: planned from a slot's poses, not from
    /// measured positions, this gives both the same answer, and each flies its own part of it clear of the other's.
    ///
    /// # Errors
    /// [`TransitError`] if a home is outside the geofence, or in or below a no-fly area that its climb would enter, the homes
    /// are too close to each other, or no way was found.
    pub fn home(&self, from: &PerVehicle<Start>, homes: &PerVehicle<Enu>) -> Result<Transit, TransitError> {
        for role in Role::BOTH {
            usable_start(role, &from[role])?;
            self.check_column(role, &homes[role])?;
        }
        self.pair(from, &PerVehicle::from_fn(|role| self.above_home(&from[role], &homes[role])))
    }

    /// One vehicle home as in [`home`](Self::home), whatever the other does. `keep_out` is a polyline on which the
    /// other may be: its last known position, or from there to its home; empty if nothing is known.
    ///
    /// # Errors
    /// As [`home`](Self::home).
    pub fn alone(
        &self,
        role: Role,
        from: &Start,
        home: &Enu,
        keep_out: &[Enu],
    ) -> Result<Trajectory, TransitError> {
        let start = usable_start(role, from)?;
        for &place in keep_out {
            usable(role.peer(), End::Start, place)?;
        }
        let goal = self.above_home(from, home);
        usable(role, End::Goal, goal.position_enu_m)?;
        self.check_inside(role, End::Goal, &goal.position_enu_m, GOAL_SLACK_M)?;
        let ends = [start, goal.position_enu_m];
        let clearance = self.clearance(ends.map(|end| {
            let mut at = PerVehicle::default();
            at[role] = Some(end);
            (at, polyline_distance_m(&[end], keep_out))
        }))?;
        let direct = self.corridor.direct(&ends[0], &ends[1]).ok_or_else(|| self.no_path(role, &ends))?;
        let direct_m = polyline_distance_m(&direct, keep_out);
        let found = if clearance.is_kept(role, &direct, keep_out) {
            Some(direct)
        } else {
            self.past(role, &ends, keep_out, &clearance)
        };
        let path = found.ok_or(TransitError::NoWay { clearance_m: clearance.full_m, direct_m })?;
        let mut trajectory = Trajectory::rest(from);
        trajectory.fly(&path, &self.limits[role]);
        Ok(self.turned(role, trajectory, goal.attitude))
    }

    fn pair(&self, from: &PerVehicle<Start>, to: &PerVehicle<Goal>) -> Result<Transit, TransitError> {
        for role in Role::BOTH {
            let goal = usable(role, End::Goal, to[role].position_enu_m)?;
            // A goal on the ground is a vehicle that stays there.
            if goal != from[role].position_enu_m {
                self.check_inside(role, End::Goal, &goal, GOAL_SLACK_M)?;
            }
        }
        let ends = PerVehicle::from_fn(|role| [from[role].position_enu_m, to[role].position_enu_m]);
        let clearance = self.clearance([0, 1].map(|end| {
            let at = PerVehicle::from_fn(|role| ends[role][end]);
            (at.map(Some), (at.i - at.j).norm())
        }))?;
        let mut direct = PerVehicle::default();
        for role in Role::BOTH {
            let [start, goal] = &ends[role];
            let way = self.corridor.direct(start, goal);
            direct[role] = way.ok_or_else(|| self.no_path(role, &ends[role]))?;
        }
        let direct_m = polyline_distance_m(&direct.i, &direct.j);
        let (moves, separation) = match self.apart_as_sets(&ends, direct, &clearance) {
            Some(PerVehicle { i, j }) => {
                (vec![Move { role: Role::I, path: i }, Move { role: Role::J, path: j }], Separation::Paths)
            }
            None => {
                let found = self.in_turns(&ends, &clearance);
                let moves = found.ok_or(TransitError::NoWay { clearance_m: clearance.full_m, direct_m })?;
                (moves, Separation::Time)
            }
        };
        let trajectories = self.timed(from, to, &moves, separation);
        Ok(Transit { trajectories, separation, clearance_m: clearance.least_m })
    }

    /// The clearance to keep between start and goal, each (positions, distance).
    fn clearance(&self, ends: [(PerVehicle<Option<Enu>>, f64); 2]) -> Result<Clearance, TransitError> {
        let (needed_m, distance_m) = (self.min_separation_m, ends[1].1);
        if distance_m < needed_m - GOAL_SLACK_M {
            return Err(TransitError::TooClose { end: End::Goal, distance_m, needed_m });
        }
        Ok(Clearance::new(self.clearance_m, &ends))
    }

    /// Steps 1 to 3.
    fn apart_as_sets(
        &self,
        ends: &PerVehicle<[Enu; 2]>,
        direct: PerVehicle<Vec<Enu>>,
        clearance: &Clearance,
    ) -> Option<PerVehicle<Vec<Enu>>> {
        if clearance.is_kept(Role::I, &direct.i, &direct.j) {
            return Some(direct);
        }
        self.in_layers(ends, &direct, clearance).or_else(|| self.round(ends, direct, clearance))
    }

    /// Step 2.
    fn in_layers(
        &self,
        ends: &PerVehicle<[Enu; 2]>,
        direct: &PerVehicle<Vec<Enu>>,
        clearance: &Clearance,
    ) -> Option<PerVehicle<Vec<Enu>>> {
        let levels = sequence::levels(&self.corridor, ends.i.iter().chain(&ends.j), clearance.full_m);
        let ways = PerVehicle::from_fn(|role| {
            let [start, goal] = &ends[role];
            let layered = levels.iter().filter_map(|&z| self.corridor.via_layer(start, goal, z));
            let paths = std::iter::once(direct[role].clone()).chain(layered);
            paths.map(|path| (self.limits[role].path_s(&path), path)).collect::<Vec<_>>()
        });
        let mut pairs: Vec<_> = ways
            .i
            .iter()
            .flat_map(|(i_s, i)| ways.j.iter().map(move |(j_s, j)| (i_s.max(*j_s), i_s + j_s, i, j)))
            .collect();
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let found = pairs.into_iter().find(|(_, _, i, j)| clearance.is_kept(Role::I, i, j));
        found.map(|(_, _, i, j)| PerVehicle { i: i.clone(), j: j.clone() })
    }

    /// Step 3.
    fn round(
        &self,
        ends: &PerVehicle<[Enu; 2]>,
        direct: PerVehicle<Vec<Enu>>,
        clearance: &Clearance,
    ) -> Option<PerVehicle<Vec<Enu>>> {
        let detour = |role: Role| {
            let path = self.past(role, &ends[role], &direct[role.peer()], clearance)?;
            Some((self.limits[role].path_s(&path), role, path))
        };
        let found = [detour(Role::J), detour(Role::I)].into_iter().flatten();
        let (_, role, path) = found.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let mut paths = direct;
        paths[role] = path;
        Some(paths)
    }

    /// A vehicle's quickest way that stays clear of the polyline `keep_out`.
    fn past(
        &self,
        role: Role,
        [start, goal]: &[Enu; 2],
        keep_out: &[Enu],
        clearance: &Clearance,
    ) -> Option<Vec<Enu>> {
        let limits = self.limits[role];
        let mut sides = PerVehicle::from_fn(|_| Side::staying(keep_out, limits));
        sides[role] = Side::moving(&self.corridor, *start, *goal, keep_out, clearance.full_m, limits);
        let moves = sequence::search(&self.corridor, &sides, clearance)?;
        let mut path: Vec<Enu> = moves.into_iter().flat_map(|m| m.path).collect();
        path.dedup();
        Some(path)
    }

    /// Step 4.
    fn in_turns(&self, ends: &PerVehicle<[Enu; 2]>, clearance: &Clearance) -> Option<Vec<Move>> {
        let sides = PerVehicle::from_fn(|role| {
            let ([start, goal], [peer_start, peer_goal]) = (ends[role], ends[role.peer()]);
            let around = [self.corridor.entry(&peer_start), peer_goal];
            Side::moving(&self.corridor, start, goal, &around, clearance.full_m, self.limits[role])
        });
        sequence::search(&self.corridor, &sides, clearance)
    }

    /// The moves in time: all at once, or each after the other vehicle's last.
    fn timed(
        &self,
        from: &PerVehicle<Start>,
        to: &PerVehicle<Goal>,
        moves: &[Move],
        separation: Separation,
    ) -> PerVehicle<Trajectory> {
        let mut trajectories = PerVehicle::from_fn(|role| Trajectory::rest(&from[role]));
        for (k, Move { role, path }) in moves.iter().enumerate() {
            if separation == Separation::Time && k > 0 {
                let free_s = trajectories[role.peer()].motion_s();
                if free_s > trajectories[*role].motion_s() {
                    trajectories[*role].hold_until(free_s + PAUSE.as_secs_f64());
                }
            }
            trajectories[*role].fly(path, &self.limits[*role]);
        }
        let PerVehicle { i, j } = trajectories;
        PerVehicle { i: self.turned(Role::I, i, to.i.attitude), j: self.turned(Role::J, j, to.j.attitude) }
    }

    /// Turns to `attitude` as soon as the vehicle is above the band's lower end: near the ground it stays as it is.
    fn turned(&self, role: Role, mut trajectory: Trajectory, attitude: Attitude) -> Trajectory {
        let below = trajectory.sample(Duration::ZERO).position_enu_m.z < self.corridor.altitude_m[0];
        let starts_s = if below { trajectory.first_leg_ends_s() } else { 0.0 };
        trajectory.turn(attitude, starts_s, &self.limits[role]);
        trajectory
    }

    /// The goal of the way home.
    fn above_home(&self, from: &Start, home: &Enu) -> Goal {
        let start = from.position_enu_m;
        let low_m = self.corridor.altitude_m[0];
        let stays = start.z < low_m && (start.xy() - home.xy()).norm() <= START_SLACK_M;
        let position_enu_m = if stays { start } else { Enu::new(home.x, home.y, low_m) };
        Goal { position_enu_m, attitude: levelled(&from.attitude) }
    }

    /// Why there is no direct way.
    fn no_path(&self, role: Role, [start, goal]: &[Enu; 2]) -> TransitError {
        match &self.corridor.no_fly {
            None => TransitError::NoPath { role },
            Some(_) => TransitError::Barred { role, areas: self.corridor.barring(start, goal) },
        }
    }

    /// Whether a vehicle can climb from its home into the band and come down again: no planned path has these two ways.
    fn check_column(&self, role: Role, home: &Enu) -> Result<(), TransitError> {
        let Some(areas) = &self.corridor.no_fly else { return Ok(()) };
        let low_m = self.corridor.altitude_m[0];
        let column = [*home, Enu::new(home.x, home.y, low_m.max(home.z))];
        let held = column.iter().find_map(|end| areas.holding(end));
        match held.or_else(|| areas.barring(&column).next()) {
            None => Ok(()),
            Some(area) => {
                let (east_m, north_m, area) = (home.x, home.y, area.to_owned());
                Err(TransitError::HomeBarred { role, area, east_m, north_m })
            }
        }
    }

    fn check_inside(&self, role: Role, end: End, point: &Enu, allowed_m: f64) -> Result<(), TransitError> {
        if self.corridor.contains(point, allowed_m) {
            return Ok(());
        }
        let outside_m = (self.corridor.entry(point) - point).norm();
        let (east_m, north_m, up_m) = (point.x, point.y, point.z);
        if let Some(area) = self.corridor.holding(point) {
            let area = area.to_owned();
            return Err(TransitError::NoFly { role, end, area, east_m, north_m, up_m, outside_m, allowed_m });
        }
        Err(TransitError::Outside { role, end, east_m, north_m, up_m, outside_m, allowed_m })
    }
}

/// `position` if it can be computed with.
fn usable(role: Role, end: End, position: Enu) -> Result<Enu, TransitError> {
    if has_meaning(&position) { Ok(position) } else { Err(TransitError::NotUsable { role, end }) }
}

/// The position of `start` if it can be computed with.
fn usable_start(role: Role, start: &Start) -> Result<Enu, TransitError> {
    let rotation = start.attitude.rotation();
    if !rotation.coords.iter().all(|c| c.is_finite()) {
        return Err(TransitError::NotUsable { role, end: End::Start });
    }
    usable(role, End::Start, start.position_enu_m)
}

/// The level attitude nearest to `attitude`: the shortest rotation that brings the antenna axis upright.
fn levelled(attitude: &Attitude) -> Attitude {
    match UnitQuaternion::rotation_between(&attitude.antenna_axis(), &Vector3::z()) {
        Some(upright) => Attitude::from_rotation(upright * attitude.rotation()),
        // Upside down: any horizontal axis is as near.
        None => Attitude::from_rotation(attitude.rotation() * Attitude::from_euler(PI, 0.0, 0.0).rotation()),
    }
}

#[cfg(test)]
mod tests;
