//! A plan that is made anew between two slots, for what was measured: in missions in which nothing moves, where the mission asks for it
//! (`[planner] replan`).
//!
//! What counts is how much the less steady vehicle jitters ([`jitter`](super::jitter)), and what each makes in this wind of the speed
//! that ways and motions count on ([`pace`](super::pace)). As a slot is over, I weighs both against what the plan is made for. Where they
//! are far from it no slot carries that one on; once both vehicles rest, both make the mission's plan for what I measured and was told,
//! with users in the order in which they are served, and a slot table from where both rest. I proposes the next slot by it, with
//! what it was made for in VEILWING_PLACES, and J accepts where its own digest is the same; the slots after it are agreed on by that plan
//! as they come, or carry each other on. A plan that was made is kept: who is asked again answers at once.

use std::fmt;
use std::sync::Arc;

use super::executive::Executive;
use super::following::{Question, Ticket};
use super::notice::Notice;
use crate::pair::{MeasuredJitter, Pace, Places, SlotTerms};
use crate::planner::slots::Plan;
use crate::role::{PerVehicle, Role};
use crate::time::Instant;

/// A jitter so many times what the plan is made for, or so many times less, asks for another plan ...
const JITTER_RATIO: f64 = 1.25;
/// ... and so does a speed that is another by this share of the largest one.
const PACE_STEP: f64 = 0.15;

/// What a plan is made for, where that is not what the mission says.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Measured {
    /// The jitter of the less steady vehicle.
    pub jitter: Option<MeasuredJitter>,
    /// What each vehicle makes.
    pub paces: PerVehicle<Option<Pace>>,
}

impl Measured {
    fn of(places: &Places) -> Self {
        Self { jitter: places.jitter, paces: places.paces }
    }

    /// The jitter in radians, where the mission says `stated_rad`.
    #[must_use]
    pub fn jitter_rad(&self, stated_rad: f64) -> f64 {
        self.jitter.map_or(stated_rad, MeasuredJitter::std_rad)
    }

    /// The shares of their largest speeds.
    #[must_use]
    pub fn shares(&self) -> PerVehicle<f64> {
        self.paces.map(|pace| pace.map_or(1.0, Pace::share))
    }

    /// Whether this is far from what a plan is made for. `stated_rad`: the jitter that the mission says; `flies`: who flies far in it.
    fn is_far_from(&self, planned_for: &Self, stated_rad: f64, flies: &PerVehicle<bool>) -> bool {
        let [is_rad, was_rad] = [self, planned_for].map(|measured| measured.jitter_rad(stated_rad));
        let jitters = is_rad.max(was_rad) > JITTER_RATIO * is_rad.min(was_rad);
        let [are, were] = [self, planned_for].map(Self::shares);
        let is_other = |role: Role| (are[role] - were[role]).abs() > PACE_STEP;
        jitters || Role::BOTH.into_iter().any(|role| flies[role] && is_other(role))
    }
}

type Make = dyn Fn(&Measured, &[usize]) -> Option<Plan> + Send + Sync;

/// Makes the mission's plan for what was measured, with users served in this order; the same on both vehicles. It takes its time.
#[derive(Clone)]
pub struct Replanner(Arc<Make>);

impl Replanner {
    /// By a function of what was measured and of the order.
    #[must_use]
    pub fn new(make: impl Fn(&Measured, &[usize]) -> Option<Plan> + Send + Sync + 'static) -> Self {
        Self(Arc::new(make))
    }
}

impl fmt::Debug for Replanner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Replanner")
    }
}

/// A plan that is to be made anew.
#[derive(Debug, Clone)]
pub struct Anew {
    replanner: Replanner,
    measured: Measured,
    order: Vec<usize>,
}

impl Anew {
    /// Takes its time. With what the plan is for; none where none is found.
    #[must_use]
    pub fn answer(&self) -> (Measured, Option<Arc<Plan>>) {
        (self.measured, (self.replanner.0)(&self.measured, &self.order).map(Arc::new))
    }
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Renewal {
    /// What the plan that is flown is made for.
    planned_for: Measured,
    /// I: J has not agreed on a slot of it yet.
    untold: bool,
    /// Being planned for.
    under_way: Option<Measured>,
    /// Made last, and for what.
    made: Option<(Measured, Option<Arc<Plan>>)>,
    /// The slot that it was made for, which is entered from where the vehicle rests.
    begins_with: Option<u16>,
}

impl Renewal {
    /// A slot of the plan is agreed on.
    pub fn agreed(&mut self) {
        self.untold = false;
    }

    pub fn begins_with(&self, slot: u16) -> bool {
        self.begins_with == Some(slot)
    }
}

impl Executive {
    /// Whether the plan may be made anew in flight.
    pub(super) fn may_replan(&self) -> bool {
        self.settings.replanner.is_some()
    }

    /// Whether the next slot is to wait for another plan: as I will ask for one, by what both tell each other.
    pub(super) fn renews(&self) -> bool {
        let Some(itinerary) = self.itinerary.as_ref().filter(|_| self.may_replan()) else { return false };
        let (planned_for, stated_rad) = (&self.renewal.planned_for, self.settings.jitter.std_rad);
        self.phase.is_in_service()
            && (self.renewal.untold || self.measured().is_far_from(planned_for, stated_rad, &itinerary.flies))
    }

    /// What was measured of both so far, as it will stand once a slot under way is over.
    pub(super) fn measured(&self) -> Measured {
        let (role, peer) = (self.settings.role, self.service.peer());
        let paces = PerVehicle::from_fn(|of| if of == role { self.progress.would_be() } else { peer.pace });
        Measured { jitter: self.larger_jitter(self.jitter.would_be_rad()), paces }
    }

    /// Asks for the plan that the next slot waits for, unless it is being made, or was.
    pub(super) fn ask_for_plan(&mut self, now: Instant) {
        let (Some(replanner), Some((asked, _))) = (&self.settings.replanner, &self.followers.openings.asked)
        else {
            return;
        };
        let measured = Measured::of(&asked.places);
        if self.renewal.made.as_ref().is_some_and(|(made, _)| *made == measured) {
            return self.renew(now);
        }
        let users = self.plan.as_ref().map_or(0, |plan| plan.slots.len());
        let Some(itinerary) = self.itinerary.as_ref().filter(|_| self.renewal.under_way != Some(measured))
        else {
            return;
        };
        let question = Anew { replanner: replanner.clone(), measured, order: itinerary.order(users) };
        let ticket = Ticket { proposal: asked.proposal, number: asked.slot };
        self.renewal.under_way = Some(measured);
        self.followers.question = Some((ticket, Question::Plan(question)));
    }

    /// A plan was made, or none was found.
    pub(super) fn take_plan(&mut self, measured: Measured, plan: Option<Arc<Plan>>, now: Instant) {
        self.renewal.under_way = self.renewal.under_way.filter(|under_way| *under_way != measured);
        self.renewal.made = Some((measured, plan));
        let asked = &self.followers.openings.asked;
        if asked.as_ref().is_some_and(|(asked, _)| Measured::of(&asked.places) == measured) {
            self.renew(now);
        }
    }

    /// Flies the plan that was made from the slot on that is asked for, if both still rest where it is to begin. Where none was found
    /// the one that there is goes on.
    fn renew(&mut self, now: Instant) {
        let (Some((asked, from)), Some((measured, made))) =
            (self.followers.openings.asked.take(), self.renewal.made.clone())
        else {
            return;
        };
        if self.both_rest(now) != Some(from) {
            match self.settings.role {
                Role::I => self.plan_poses(asked.slot, None),
                Role::J => self.service.slot_planned(&asked, None, now),
            }
            return;
        }
        let limits = self.limits_at(&measured.paces);
        let renewed = made.zip(self.itinerary.as_ref()).and_then(|(plan, itinerary)| {
            let itinerary = itinerary.renewed(asked.slot, &from, &plan, (&self.settings, &limits))?;
            let terms = itinerary.terms_anew(asked.slot, &from, &plan, &limits)?;
            Some((plan, itinerary, terms))
        });
        let was_made = std::mem::replace(&mut self.renewal.planned_for, measured) == measured;
        let Some((plan, itinerary, terms)) = renewed else {
            self.notice(Notice::NotReplanned);
            return self.service.slot_planned(&asked, None, now);
        };
        let jitter = self.judged_by(measured.jitter);
        let terms = terms.into_iter().map(|terms| SlotTerms { jitter, ..terms }).collect();
        self.renewal.untold = self.settings.role == Role::I;
        self.renewal.begins_with = Some(asked.slot);
        if !was_made {
            self.notice(Notice::Replanned {
                slot: asked.slot,
                jitter_rad: measured.jitter_rad(self.settings.jitter.std_rad),
                shares: measured.shares(),
            });
        }
        self.plan = Some(Plan::clone(&plan));
        self.itinerary = Some(itinerary);
        self.rest_here(now);
        self.service.slot_planned(&asked, Some(terms), now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_plan_is_far_from_what_is_measured_by_a_quarter_of_the_jitter_or_by_the_speed_of_who_flies() {
        let measured = |jitter_deg: Option<f64>, share_of_j: f64| Measured {
            jitter: jitter_deg.map(|deg| MeasuredJitter::of(f64::to_radians(deg))),
            paces: PerVehicle { i: None, j: Pace::of(share_of_j) },
        };
        let far = |is: (Option<f64>, f64), was: (Option<f64>, f64), j_flies: bool| {
            let [is, was] = [is, was].map(|(deg, share)| measured(deg, share));
            is.is_far_from(&was, f64::to_radians(2.0), &PerVehicle { i: true, j: j_flies })
        };
        for (is, was, j_flies, is_far) in [
            ((None, 1.0), (None, 1.0), true, false),
            ((Some(2.4), 1.0), (None, 1.0), true, false),
            ((Some(2.6), 1.0), (None, 1.0), true, true),
            ((None, 1.0), (Some(2.6), 1.0), true, true),
            ((Some(0.5), 1.0), (Some(0.6), 1.0), true, false),
            ((Some(0.4), 1.0), (Some(0.6), 1.0), true, true),
            ((None, 0.9), (None, 1.0), true, false),
            ((None, 0.8), (None, 1.0), true, true),
            ((None, 0.8), (None, 1.0), false, false),
            ((None, 1.0), (None, 0.8), true, true),
        ] {
            assert_eq!(far(is, was, j_flies), is_far, "{is:?} {was:?} {j_flies}");
        }
    }
}
