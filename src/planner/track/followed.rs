//! A track that is made anew while the slot is served: motions that go on from one another, each from its beginning on.

use std::sync::Arc;

use super::super::following::Motion;
use super::super::moving::{Instant, Limits};
use super::super::plan::VehiclePlan;
use super::super::turning::{Angles, angles};
use super::{APART_S, Glide, Slack, UNDER_WAY_S};
use crate::geo::{Attitude, Enu, EnuAcceleration, EnuVelocity};
use crate::role::Role;

/// So many motions are kept: the newest, the one before while that is flown, and one for what was measured or told late.
const KEPT: usize = 3;
/// What a lease rests on lasts as long as the lease, in seconds: a power that rises evenly is commanded so much ahead.
const LEASED_S: f64 = 0.6;
/// Powers are commanded in steps of a quarter of a decibel, upwards, so that a power that changes evenly is not told the radio anew
/// at each instant.
const STEPS_PER_DECADE: f64 = 40.0;

/// See the module. A motion's time is that since the slot's opening. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct Followed {
    role: Role,
    /// Before the first motion.
    rest: VehiclePlan,
    /// In the order of their beginnings.
    motions: Vec<Arc<Motion>>,
}

impl Followed {
    /// At rest like this until a motion is taken up.
    #[must_use]
    pub fn new(role: Role, rest: VehiclePlan) -> Self {
        Self { role, rest, motions: Vec::new() }
    }

    /// From its beginning on, this is flown.
    pub fn take_up(&mut self, motion: Arc<Motion>) {
        self.motions.retain(|earlier| earlier.begins_s() < motion.begins_s());
        self.motions.push(motion);
        let old = self.motions.len().saturating_sub(KEPT);
        self.motions.drain(..old);
    }

    /// The track of one that has taken up no motion which begins later than this.
    #[must_use]
    pub fn as_of(&self, since_opening_s: f64) -> Self {
        let motions = self.motions.iter().filter(|motion| motion.begins_s() <= since_opening_s);
        Self { motions: motions.cloned().collect(), ..self.clone() }
    }

    /// What is flown at a time since the opening; `None`: the vehicle rests as the slot has it.
    fn flown(&self, since_opening_s: f64) -> Option<&Motion> {
        let begun = self.motions.iter().rfind(|motion| motion.begins_s() <= since_opening_s);
        begun.map(|motion| &**motion)
    }

    /// Where it rests before the first motion.
    #[must_use]
    pub fn rests_at(&self) -> Enu {
        self.rest.pose.position_enu_m
    }

    /// The other vehicle's part of the same motions, which rests like this before.
    #[must_use]
    pub fn other(&self, role: Role, rest: VehiclePlan) -> Self {
        Self { role, rest, motions: self.motions.clone() }
    }

    /// Where the vehicle is.
    #[must_use]
    pub fn place(&self, since_opening_s: f64) -> Instant {
        match self.flown(since_opening_s) {
            Some(motion) => motion.ways[self.role].at(since_opening_s),
            None => Instant {
                position_enu_m: self.rest.pose.position_enu_m,
                velocity_enu_m_s: EnuVelocity::ZERO,
                acceleration_enu_m_s2: EnuAcceleration::ZERO,
            },
        }
    }

    /// The vehicle's pose and power at an instant.
    #[must_use]
    pub fn vehicle(&self, since_opening_s: f64) -> VehiclePlan {
        self.flown(since_opening_s).map_or(self.rest, |motion| motion.at(since_opening_s).vehicles[self.role])
    }

    /// Its attitude.
    #[must_use]
    pub fn attitude(&self, since_opening_s: f64) -> Attitude {
        self.vehicle(since_opening_s).pose.attitude()
    }

    /// Whether it is under way, or about to be.
    #[must_use]
    pub fn moves(&self, since_opening_s: f64) -> bool {
        self.motions.last().is_some_and(|motion| since_opening_s < motion.ends_s())
    }

    /// How it stops that is under way, and since when it does so; `None` of one that rests. It never takes longer than its motion has
    /// left: that rests by itself.
    #[must_use]
    pub fn stop(&self, since_opening_s: f64, limits: &Limits) -> Option<(Glide, f64)> {
        let motion = self.flown(since_opening_s).filter(|motion| since_opening_s < motion.ends_s())?;
        let (way, passing) = motion.ways[self.role].to_rest(since_opening_s, limits);
        Some((Glide::leaving(Arc::new(way), passing), since_opening_s))
    }

    /// The power in watts that is to be commanded: no less than the largest of just before to a lease's length later, and no more than
    /// what the motions come to.
    #[must_use]
    pub fn tx_power_w(&self, since_opening_s: f64) -> f64 {
        let ends_s = [since_opening_s - APART_S, since_opening_s + APART_S + UNDER_WAY_S + LEASED_S];
        let knots = self.knots_s().filter(|at_s| (ends_s[0]..ends_s[1]).contains(at_s));
        let instants = ends_s.into_iter().chain(knots);
        let needed_w = instants.map(|at_s| self.vehicle(at_s).tx_power_w).fold(0.0, f64::max);
        let most_w = self.knots_s().map(|at_s| self.vehicle(at_s).tx_power_w).fold(needed_w, f64::max);
        let step = (libm::log10(needed_w) * STEPS_PER_DECADE).ceil();
        if needed_w > 0.0 { libm::pow(10.0, step / STEPS_PER_DECADE).clamp(needed_w, most_w) } else { 0.0 }
    }

    fn knots_s(&self) -> impl Iterator<Item = f64> + '_ {
        self.motions.iter().flat_map(|motion| motion.knots.iter().map(|knot| knot.at_s))
    }

    /// The power that protects exceeds this one from then on, if it does at this time or later.
    #[must_use]
    pub fn outgrows(&self, tx_power_w: f64, since_opening_s: f64) -> Option<f64> {
        let from_s = since_opening_s - APART_S;
        let mut instants: Vec<f64> = self.knots_s().filter(|at_s| *at_s > from_s).chain([from_s]).collect();
        instants.sort_by(f64::total_cmp);
        let missing_w = instants.iter().map(|at_s| (*at_s, self.vehicle(*at_s).tx_power_w - tx_power_w));
        rises_s(missing_w).map(|at_s| at_s - APART_S)
    }

    /// From when on the newest motion asks J for more power than the one that it goes on from, if it does.
    #[must_use]
    pub fn outgrown_s(&self) -> Option<f64> {
        let (newest, earlier) = self.motions.split_last()?;
        let before = earlier.last();
        let begins_s = newest.begins_s();
        // Before the first one J rests, with the power that it begins with.
        let rest_w = newest.knot_at(begins_s).j_power_w;
        let grown_w = |at_s: f64| {
            let before_w = before.map_or(rest_w, |before| before.knot_at(at_s).j_power_w);
            newest.knot_at(at_s).j_power_w - before_w
        };
        let knots = newest.knots.iter().chain(before.iter().flat_map(|motion| &motion.knots));
        let mut instants: Vec<f64> = knots.map(|knot| knot.at_s).filter(|at_s| *at_s > begins_s).collect();
        instants.sort_by(f64::total_cmp);
        // It begins with the power that the one before has then, but for rounding.
        let begins = (begins_s, grown_w(begins_s).min(0.0));
        rises_s([begins].into_iter().chain(instants.iter().map(|at_s| (*at_s, grown_w(*at_s)))))
    }

    /// How wrong the pose may be; `None` where nothing is asked.
    #[must_use]
    pub fn slack(&self, since_opening_s: f64) -> Option<Slack> {
        let tolerance = self.flown(since_opening_s)?.tolerance(since_opening_s)?;
        let [pointing_rad, position_m] =
            [tolerance.pointing_rad, tolerance.position_m].map(|of| of[self.role]);
        Some(Slack { pointing_rad, position_m })
    }

    /// Roll, pitch and yaw in radians as the slot begins.
    #[must_use]
    pub fn begins(&self) -> Angles {
        angles(&self.rest.pose)
    }
}

/// Since when what changes evenly between these instants and values is positive, first.
fn rises_s(values: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let mut before: Option<(f64, f64)> = None;
    for (at_s, value) in values {
        if value > 0.0 {
            let rises_s = |(from_s, from): (f64, f64)| {
                from_s + (at_s - from_s) * (from / (from - value)).clamp(0.0, 1.0)
            };
            return Some(before.map_or(at_s, rises_s));
        }
        before = Some((at_s, value));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::super::{CLOSES_IN_1_S, Track};
    use super::*;
    use crate::planner::following::{Belief, Drift, Flying, Scene, plan};
    use crate::planner::problem::Problem;
    use crate::planner::{Options, plan_slot};
    use crate::role::PerVehicle;

    const LIMITS: Limits =
        Limits { speed_m_s: 8.0, climb_m_s: 3.0, acceleration_m_s2: 2.5, jerk_m_s3: Some(4.0) };

    /// A slot whose user drives off to the east, and the two motions of its first seconds.
    fn flown() -> (PerVehicle<VehiclePlan>, [Arc<Motion>; 2]) {
        let mut problem = Problem::paper([[200.0, 80.0], [-150.0, 210.0]], 0.5, 0.03);
        problem.airspace.min_separation_m = 5.0;
        let rest = plan_slot(&problem, &Options { starts: Some(8), ..Options::default() }).unwrap().vehicles;
        let at = |at_s: f64, north_m_s: f64| Drift {
            at_s,
            belief: Belief {
                position_enu_m: Enu::new(6.0 * at_s, north_m_s * (at_s - 1.0), 0.0),
                velocity_enu_m_s: EnuVelocity::new(6.0, north_m_s, 0.0),
                std_m: [2.0, 1.0],
            },
        };
        let motion = |user: &Drift, from: &PerVehicle<Flying<'_>>| {
            let scene = Scene {
                problem: &problem,
                user: Some(user),
                eavesdroppers: vec![],
                limits: PerVehicle { i: LIMITS, j: LIMITS },
                turn_rate_rad_s: PerVehicle { i: 0.8, j: 0.8 },
                apart_m: 7.0,
            };
            plan(&scene, from, user.at_s, 1).unwrap().unwrap()
        };
        let first = motion(&at(1.0, 0.0), &Flying::rest(&rest));
        let second = motion(&at(2.5, 3.0), &Flying::motion(&first));
        (rest, [Arc::new(first), Arc::new(second)])
    }

    #[test]
    fn spec_each_motion_is_flown_from_its_beginning_on_and_goes_on_from_the_one_before() {
        let (rest, motions) = flown();
        for role in Role::BOTH {
            let mut track = Followed::new(role, rest[role]);
            assert!(!track.moves(0.0) && track.stop(3.0, &LIMITS).is_none());
            assert_eq!(track.place(3.0).position_enu_m, rest[role].pose.position_enu_m);
            for motion in &motions {
                track.take_up(Arc::clone(motion));
            }
            let mut before = track.place(0.0).position_enu_m;
            let mut attitude = track.attitude(0.0);
            for k in 1..=1600 {
                let t_s = 0.01 * f64::from(k);
                let now = track.place(t_s);
                assert!((now.position_enu_m - before).norm() < 0.09, "{role} {t_s}");
                assert!(track.attitude(t_s).angle_to(&attitude) < 0.0081, "{role} {t_s}");
                (before, attitude) = (now.position_enu_m, track.attitude(t_s));
            }
            assert!(track.moves(14.4) && !track.moves(14.6));
            assert!(
                (track.place(2.49).position_enu_m - motions[0].ways[role].at(2.49).position_enu_m).norm()
                    < 1e-12
            );
            assert_eq!(track.place(4.0), motions[1].ways[role].at(4.0));
            // Who has not taken it up goes on as before.
            let behind = track.as_of(2.4);
            assert_eq!(behind.place(4.0), motions[0].ways[role].at(4.0));
            assert_eq!((track.as_of(2.5), behind.as_of(0.9).place(4.0)), (track.clone(), track.place(0.5)));
            // Taken up anew from there, the later one is none any more.
            track.take_up(Arc::clone(&motions[0]));
            assert_eq!(track.place(4.0), motions[0].ways[role].at(4.0));
        }
    }

    /// Against a look at each millisecond.
    #[test]
    fn spec_a_motion_outgrows_the_one_before_where_it_asks_for_more_power() {
        let (rest, [first, second]) = flown();
        let powers = |motion: &Motion, powers_w: [f64; 3]| {
            let mut motion = motion.clone();
            for (k, knot) in motion.knots.iter_mut().enumerate() {
                knot.j_power_w = powers_w[k.min(2)];
            }
            Arc::new(motion)
        };
        let of_j = |track: &Followed, at_s: f64| track.vehicle(at_s).tx_power_w;
        for (firsts, seconds, outgrown) in [
            ([0.2, 0.2, 0.2], None, false),
            ([0.2, 0.1, 0.1], None, false),
            ([0.2, 0.1, 0.3], None, true),
            ([0.2, 0.4, 0.3], None, true),
            ([0.2, 0.2, 0.2], Some([0.2, 0.1, 0.2]), false),
            ([0.2, 0.2, 0.2], Some([0.2, 0.1, 0.5]), true),
            ([0.2, 0.2, 0.2], Some([0.2, 0.3, 0.1]), true),
        ] {
            let mut track = Followed::new(Role::J, VehiclePlan { tx_power_w: firsts[0], ..rest.j });
            track.take_up(powers(&first, firsts));
            let mut before = track.as_of(0.0);
            if let Some(seconds) = seconds {
                before = track.clone();
                track.take_up(powers(&second, seconds));
            }
            let grown = |at_s: &f64| of_j(&track, *at_s) > of_j(&before, *at_s) + 1e-9;
            let looked = (0..16_000).map(|k| 1e-3 * f64::from(k)).find(grown);
            let found = track.outgrown_s();
            assert_eq!(found.is_some(), outgrown, "{firsts:?} {seconds:?}: {found:?} {looked:?}");
            assert!(found.zip(looked).is_none_or(|(found, looked)| (found - looked).abs() < 2e-3));
            assert_eq!(looked.is_some(), outgrown);
        }
    }

    /// Against a vehicle whose loops are stepped through, millisecond by millisecond.
    #[test]
    fn val_a_track_leaves_behind_a_vehicle_that_is_told_nothing_more() {
        let (rest, motions) = flown();
        let mut left = [0, 0];
        for role in Role::BOTH {
            let mut track = Followed::new(role, rest[role]);
            motions.iter().for_each(|motion| track.take_up(Arc::clone(motion)));
            let track = Track::Followed(track);
            for (k, ahead_s) in (0..30).flat_map(|k| [(k, 0.0), (k, 0.15)]) {
                let since_s = 0.5 * f64::from(k);
                let far = Slack { pointing_rad: 0.03, position_m: 0.2 };
                let told = track.place(since_s).unwrap();
                let (mut place, mut velocity) = (told.position_enu_m, told.velocity_enu_m_s.vector());
                let mut turned_s = since_s;
                let stepped = (1..=600).find_map(|ms| {
                    let (at_s, after_s, dt_s) = (since_s + 1e-3 * f64::from(ms), 1e-3 * f64::from(ms), 1e-3);
                    let wanted =
                        told.velocity_enu_m_s.vector() + (told.position_enu_m - place) * CLOSES_IN_1_S;
                    velocity += (wanted - velocity) * (2.0 * CLOSES_IN_1_S * dt_s);
                    place += velocity * dt_s;
                    turned_s +=
                        if ahead_s > 0.0 { (since_s + ahead_s - turned_s) * dt_s / ahead_s } else { 0.0 };
                    let goes_on = told.position_enu_m + told.velocity_enu_m_s.vector() * after_s;
                    let now = track.place(at_s).unwrap().position_enu_m;
                    let off_m = (place - now).norm().max((goes_on - now).norm());
                    let off_rad = track.attitude(turned_s).angle_to(&track.attitude(at_s));
                    (off_m > far.position_m || off_rad > far.pointing_rad).then_some(at_s)
                });
                let found = track.leaves_behind(since_s, ahead_s, far);
                left[usize::from(found.is_some())] += 1;
                match (found, stepped) {
                    (Some(found), Some(stepped)) => {
                        assert!((-0.002..0.022).contains(&(stepped - found)), "{since_s}: {found} {stepped}");
                    }
                    (found, stepped) => {
                        // At the very end of what is looked at.
                        let late_s = found.or(stepped).map_or(0.6, |at_s| at_s - since_s);
                        assert!(late_s > 0.57, "{since_s}: {found:?} {stepped:?}");
                    }
                }
            }
        }
        assert!(left.iter().all(|times| *times > 20), "{left:?}");
    }

    #[test]
    fn spec_a_vehicle_stops_on_its_motion_no_later_than_that_ends() {
        let (rest, motions) = flown();
        let mut track = Followed::new(Role::J, rest.j);
        motions.iter().for_each(|motion| track.take_up(Arc::clone(motion)));
        for at_s in [1.0, 1.2, 2.0, 2.5, 4.0, 6.0, 9.0, 12.0, 13.9, 14.4] {
            let (glide, since_s) = track.stop(at_s, &LIMITS).unwrap();
            assert_eq!(since_s, at_s);
            assert!(at_s + glide.lasts_s() <= 14.5 + 1e-9, "{at_s}: {}", glide.lasts_s());
            let (begins, flown) = (glide.at(0.0), track.place(at_s));
            assert!((begins.position_enu_m - flown.position_enu_m).norm() < 1e-9);
            assert!((begins.velocity_enu_m_s.vector() - flown.velocity_enu_m_s.vector()).norm() < 1e-9);
            let ends = glide.at(glide.lasts_s());
            assert!(ends.velocity_enu_m_s.vector().norm() < 1e-6, "{at_s}");
            assert_eq!(glide.at(glide.lasts_s() + 50.0).position_enu_m, ends.position_enu_m);
        }
        // Sooner, where there is much left.
        let (glide, _) = track.stop(4.0, &LIMITS).unwrap();
        assert!(glide.lasts_s() < 8.0, "{}", glide.lasts_s());
        assert!(track.stop(14.5, &LIMITS).is_none());
    }

    #[test]
    fn val_powers_are_the_largest_about_an_instant_and_outgrown_where_they_rise() {
        let (rest, motions) = flown();
        let mut track = Followed::new(Role::J, rest.j);
        motions.iter().for_each(|motion| track.take_up(Arc::clone(motion)));
        let power_w = |t_s: f64| track.vehicle(t_s).tx_power_w;
        for k in 0..150 {
            let t_s = 0.1 * f64::from(k);
            let about = (-100..=850).map(|ms| power_w(t_s + 1e-3 * f64::from(ms)));
            let most = about.fold(0.0, f64::max);
            let commanded = track.tx_power_w(t_s);
            assert!(commanded >= most - 1e-12 && commanded <= most * 1.06, "{t_s}: {commanded} {most}");
            for share in [0.8, 1.0, 1.1, 3.0] {
                let level = share * power_w(t_s);
                let outgrown = track.outgrows(level, t_s);
                let risen =
                    (0..16_000).map(|ms| t_s - 0.1 + 1e-3 * f64::from(ms)).find(|at| power_w(*at) > level);
                match (outgrown, risen) {
                    (Some(a), Some(b)) => assert!((a - (b - 0.1)).abs() < 2e-3, "{t_s} {share}: {a} {b}"),
                    (a, b) => assert!(a.is_none() && b.is_none(), "{t_s} {share}: {a:?} {b:?}"),
                }
            }
        }
        let i = Followed::new(Role::I, rest.i);
        assert_eq!((i.tx_power_w(3.0), i.outgrows(0.1, 3.0)), (rest.i.tx_power_w, Some(3.0 - 2.0 * 0.1)));
        assert_eq!(i.outgrows(rest.i.tx_power_w, 3.0), None);
    }
}
