//! A track that is planned before the slot: knots of turns, and a way round.

use std::sync::Arc;

use super::super::moving::{Instant, Limits, Spline};
use super::super::turning::{Angles, Between, Course, Knot, Protected, READY_S, Slot, angles};
use super::{APART_S, Slack, Track, UNDER_WAY_S, Way};
use crate::geo::Attitude;
use crate::role::{PerVehicle, Role};

/// An even turn.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Leg {
    /// Seconds since the slot opens; before it negative.
    begins_s: f64,
    ends_s: f64,
    from: Angles,
    to: Angles,
    course: Course,
}

impl Leg {
    fn attitude(&self, since_opening_s: f64) -> Attitude {
        let share = (since_opening_s - self.begins_s) / (self.ends_s - self.begins_s);
        // Of a leg without length it is no number.
        let share = if share.is_nan() { 1.0 } else { share.clamp(0.0, 1.0) };
        self.course.at(&self.from, &self.to, share)
    }
}

/// From one knot to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    leg: Leg,
    tx_power_w: f64,
    /// At the step's beginning and at its end.
    slack: [Option<Slack>; 2],
}

/// See the module. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// While the user is served; at least one.
    steps: Arc<[Step]>,
    /// The silent turns to the first attitude and from the last one.
    before: Option<Leg>,
    after: Option<Leg>,
    /// Where the vehicle is, if it moves.
    way: Option<Way>,
}

/// Each slot's tracks, in the order of service, for slots that open half of `guard_s` before their users are served; with the ways on
/// which both move meanwhile, if they do.
#[must_use]
pub fn tracks(
    turns: &Protected,
    ways: Option<&PerVehicle<Spline>>,
    guard_s: f64,
    limits: &PerVehicle<Limits>,
) -> Vec<PerVehicle<Track>> {
    let Some(ways) = ways else { return turns.tracks(guard_s) };
    let still = turns.planned(guard_s);
    let paths = PerVehicle { i: Arc::new(ways.i.clone()), j: Arc::new(ways.j.clone()) };
    let moving = turns.slots.iter().zip(still).map(|(slot, tracks)| {
        let begins_s = slot.knots.first().map_or(0.0, |knot| knot.at_s);
        let (opens_s, length_s) = (begins_s - guard_s / 2.0, slot.on_air_s + guard_s);
        let way = |role| Way::new(Arc::clone(&paths[role]), opens_s, length_s, &limits[role]);
        let PerVehicle { i, j } = tracks;
        let tracks = PerVehicle {
            i: Planned { way: Some(way(Role::I)), ..i },
            j: Planned { way: Some(way(Role::J)), ..j },
        };
        tracks.map(Track::Planned)
    });
    moving.collect()
}

impl Protected {
    /// Each slot's tracks, in the order of service, for slots that open half of `guard_s` before their users are served.
    #[must_use]
    pub fn tracks(&self, guard_s: f64) -> Vec<PerVehicle<Track>> {
        self.planned(guard_s).into_iter().map(|tracks| tracks.map(Track::Planned)).collect()
    }

    fn planned(&self, guard_s: f64) -> Vec<PerVehicle<Planned>> {
        let before = |place: usize| (place + self.slots.len() - 1) % self.slots.len();
        let places = 0..self.slots.len();
        let all = places.map(|place| {
            let track = |role| self.track(before(place), place, role, guard_s);
            Some(PerVehicle { i: track(Role::I)?, j: track(Role::J)? })
        });
        all.collect::<Option<_>>().unwrap_or_default()
    }

    /// `None` of a slot without a knot.
    fn track(&self, before: usize, place: usize, role: Role, guard_s: f64) -> Option<Planned> {
        let (slot, before) = (&self.slots[place], &self.slots[before]);
        let next = &self.slots[(place + 1) % self.slots.len()];
        let turned = |knot: &Knot| angles(&knot.vehicles[role].pose);
        let slack = |knot: &Knot| {
            let tolerance = knot.tolerance?;
            Some(Slack { pointing_rad: tolerance.pointing_rad[role], position_m: tolerance.position_m[role] })
        };
        let (first, last) = (slot.knots.first()?, slot.knots.last()?);
        let since_opening_s = |at_s: f64| at_s - first.at_s + guard_s / 2.0;
        let steps = slot.knots.windows(2).map(|knots| {
            let leg = Leg {
                begins_s: since_opening_s(knots[0].at_s),
                ends_s: since_opening_s(knots[1].at_s),
                from: turned(&knots[0]),
                to: turned(&knots[1]),
                course: Course::EvenAngles,
            };
            Step {
                leg,
                tx_power_w: knots[0].vehicles[role].tx_power_w,
                slack: [slack(&knots[0]), slack(&knots[1])],
            }
        });
        let steps: Arc<[Step]> = steps.collect();
        if steps.is_empty() {
            return None;
        }
        let silent = |of: &Slot, from: &Knot, to: &Knot, begins_s: f64| match of.between {
            Between::Turn(courses) => Some(Leg {
                begins_s,
                ends_s: begins_s + of.silence_s - READY_S,
                from: turned(from),
                to: turned(to),
                course: courses[role],
            }),
            Between::Transit => None,
        };
        let begins_s = since_opening_s(first.at_s) - before.silence_s;
        Some(Planned {
            steps,
            before: silent(before, before.knots.last()?, first, begins_s),
            after: silent(slot, last, next.knots.first()?, since_opening_s(last.at_s)),
            way: None,
        })
    }
}

impl Planned {
    /// The same for a vehicle that has come to rest in the first attitude before the slot opens, and before it moves.
    #[must_use]
    pub fn from_rest(self) -> Self {
        Self { before: None, way: self.way.map(Way::from_rest), ..self }
    }

    /// The same for a vehicle that comes to rest afterwards, in the last attitude.
    #[must_use]
    pub fn to_rest(self) -> Self {
        Self { after: None, way: self.way.map(Way::to_rest), ..self }
    }

    /// The way on which the vehicle moves, if it does.
    #[must_use]
    pub fn way(&self) -> Option<&Way> {
        self.way.as_ref()
    }

    /// Where the vehicle is at a time since the opening, if it moves.
    #[must_use]
    pub fn place(&self, since_opening_s: f64) -> Option<Instant> {
        self.way.as_ref().map(|way| way.at(since_opening_s))
    }

    /// The attitude at a time since the opening: before the track begins its first one, after its end its last one.
    #[must_use]
    pub fn attitude(&self, since_opening_s: f64) -> Attitude {
        let served = self.step(since_opening_s).leg;
        let leg = match (self.before, self.after) {
            (Some(before), _) if since_opening_s < before.ends_s => before,
            (_, Some(after)) if since_opening_s >= after.begins_s => after,
            _ => served,
        };
        leg.attitude(since_opening_s)
    }

    /// The power in watts that is to be commanded: before the user is served that of the first step, afterwards that of the last;
    /// and of one that is just over, or about to begin, where that is more.
    #[must_use]
    pub fn tx_power_w(&self, since_opening_s: f64) -> f64 {
        let near = self.steps.iter().filter(|step| {
            step.leg.begins_s <= since_opening_s + APART_S + UNDER_WAY_S
                && since_opening_s < step.leg.ends_s + APART_S
        });
        near.map(|step| step.tx_power_w).fold(self.protects_w(since_opening_s), f64::max)
    }

    /// The power in watts of the step that is under way, or of the nearest one.
    #[must_use]
    pub fn protects_w(&self, since_opening_s: f64) -> f64 {
        self.step(since_opening_s).tx_power_w
    }

    /// The power that protects exceeds this one from then on, in seconds since the opening, if it does at this time or later.
    #[must_use]
    pub fn outgrows(&self, tx_power_w: f64, since_opening_s: f64) -> Option<f64> {
        let later = self.steps.iter().filter(|step| step.leg.ends_s + APART_S > since_opening_s);
        let more = later.filter(|step| step.tx_power_w > tx_power_w).map(|step| step.leg.begins_s - APART_S);
        more.reduce(f64::min)
    }

    /// The time since the opening from which the vehicle has the attitudes in which the user is served, and until which.
    #[must_use]
    pub fn in_place(&self) -> [Option<f64>; 2] {
        [self.before.map(|leg| leg.ends_s), self.after.map(|leg| leg.begins_s)]
    }

    /// How wrong the pose may be, by the stricter of the knots before and after; `None` where nobody is served, or nothing is asked.
    #[must_use]
    pub fn slack(&self, since_opening_s: f64) -> Option<Slack> {
        let Step { leg, slack, .. } = self.step(since_opening_s);
        if !(leg.begins_s..leg.ends_s).contains(&since_opening_s) {
            return None;
        }
        let known = slack.iter().flatten();
        known.copied().reduce(|a, b| Slack {
            pointing_rad: a.pointing_rad.min(b.pointing_rad),
            position_m: a.position_m.min(b.position_m),
        })
    }

    /// Roll, pitch and yaw in radians where the user's service begins, and where it ends.
    #[must_use]
    pub fn ends(&self) -> [Angles; 2] {
        [self.steps[0].leg.from, self.steps[self.steps.len() - 1].leg.to]
    }

    /// The step that is under way, or the nearest one.
    fn step(&self, since_opening_s: f64) -> &Step {
        let begun = self.steps.partition_point(|step| step.leg.begins_s <= since_opening_s);
        &self.steps[begun.saturating_sub(1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::{Enu, Pose};
    use crate::planner::plan::VehiclePlan;
    use crate::planner::turning::Tolerance;

    const GUARD_S: f64 = 1.0;

    fn knot(at_s: f64, roll_rad: f64, tx_power_w: f64, pointing_rad: f64) -> Knot {
        let pose = Pose { position_enu_m: Enu::new(0.0, 0.0, 80.0), roll_rad, pitch_rad: 0.1, yaw_rad: 0.0 };
        let vehicle = VehiclePlan { pose, tx_power_w };
        let tolerance = Tolerance {
            pointing_rad: PerVehicle { i: pointing_rad, j: 2.0 * pointing_rad },
            position_m: PerVehicle { i: 1.5, j: 2.5 },
            user_sinr_ratio: 0.9,
        };
        let vehicles = PerVehicle { i: vehicle, j: vehicle };
        Knot { at_s, vehicles, served: Some(0), rate_bps: 1e6, tolerance: Some(tolerance) }
    }

    /// Two users; on the air for 4 s, silent for 1.5 s.
    fn superframe() -> Protected {
        let slot = |begins_s: f64, [a, b]: [f64; 2]| {
            let knots = vec![
                knot(begins_s, a, 0.1, 0.03),
                knot(begins_s + 2.0, a, 0.3, 0.02),
                knot(begins_s + 3.0, a, 0.2, 0.04),
                knot(begins_s + 4.0, b, 0.0, 0.05),
            ];
            let between = Between::Turn(PerVehicle { i: Course::Shortest, j: Course::EvenAngles });
            Slot { user: 0, on_air_s: 4.0, silence_s: 1.5, between, volume_bits: 4e6, knots }
        };
        Protected { slots: vec![slot(0.0, [0.2, 0.3]), slot(5.5, [0.9, 0.8])], superframe_s: 11.0 }
    }

    /// A slot's opening follows the last one's by 4 s on the air and 1.5 s of silence.
    #[test]
    fn val_two_tracks_are_one_course_and_that_of_the_superframe() {
        let protected = superframe();
        let tracks = protected.planned(GUARD_S);
        for role in Role::BOTH {
            for step in -99..400 {
                let at_s = f64::from(step) * 0.01;
                let own = tracks[1][role].attitude(at_s);
                let of_the_last = tracks[0][role].attitude(at_s + 5.5);
                let planned = protected.at(5.0 + at_s).unwrap().attitudes[role];
                assert!(own.angle_to(&planned) < 1e-6, "{role} {at_s}");
                // The last one's track ends where its silence does.
                assert!(at_s > 0.3 || own.angle_to(&of_the_last) < 1e-6, "{role} {at_s}");
            }
            let [from, until] = tracks[1][role].in_place().map(Option::unwrap);
            assert!((from - 0.3).abs() < 1e-12 && (until - 4.5).abs() < 1e-12, "{from} {until}");
            let rested = tracks[1][role].clone().from_rest().to_rest();
            assert_eq!(rested.in_place(), [None, None]);
            assert!(rested.attitude(-3.0).angle_to(&rested.attitude(0.5)) < 1e-12);
            assert!(rested.attitude(9.0).angle_to(&rested.attitude(4.5)) < 1e-12);
        }
    }

    /// Steps of 0.1, 0.3 and 0.2 W begin 0.5, 2.5 and 3.5 s after the opening.
    #[test]
    fn val_a_power_is_commanded_before_it_is_needed_and_kept_after_it() {
        let track = &superframe().planned(GUARD_S)[0].j;
        for (at_s, expected_w) in [
            (-5.0, 0.1),
            (0.6, 0.1),
            (2.2, 0.1),
            (2.26, 0.3),
            (3.0, 0.3),
            (3.55, 0.3),
            (3.61, 0.2),
            (9.0, 0.2),
        ] {
            assert_eq!(track.tx_power_w(at_s), expected_w, "{at_s}");
        }
        for (power_w, at_s, expected_s) in [
            (0.3, 1.0, None),
            (0.25, 1.0, Some(2.4)),
            (0.25, 3.55, Some(2.4)),
            (0.25, 3.65, None),
            (0.15, 3.65, Some(3.4)),
            (0.05, 0.0, Some(0.4)),
        ] {
            let outgrown_s = track.outgrows(power_w, at_s);
            let as_expected = match (outgrown_s, expected_s) {
                (Some(found), Some(expected)) => (found - expected).abs() < 1e-12,
                (found, expected) => found == expected,
            };
            assert!(as_expected, "{power_w} {at_s}: {outgrown_s:?}");
        }
    }

    #[test]
    fn val_a_pose_is_asked_for_by_the_stricter_of_two_knots_and_while_somebody_is_served() {
        let track = &superframe().planned(GUARD_S)[0].i;
        for (at_s, pointing_rad) in
            [(0.4, None), (0.6, Some(0.02)), (3.0, Some(0.02)), (4.0, Some(0.04)), (4.6, None)]
        {
            assert_eq!(track.slack(at_s).map(|slack| slack.pointing_rad), pointing_rad, "{at_s}");
        }
        let slack = superframe().planned(GUARD_S)[0].j.slack(1.0).unwrap();
        assert_eq!((slack.pointing_rad, slack.position_m), (0.04, 2.5));
    }

    #[test]
    fn spec_a_plan_without_knots_has_no_tracks() {
        let mut protected = superframe();
        protected.slots[1].knots.clear();
        assert_eq!(protected.planned(GUARD_S), vec![]);
    }
}
