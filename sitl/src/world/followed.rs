//! Slots in which motions are made anew: what the companions say that they fly, as the host hears it from I's. The plan before the
//! flight knows nothing of it, so the world holds each vehicle to what I goes by: a J that does not fly what I takes it to fly is out of
//! its pose. Just after a motion has begun I takes it to fly that one or the one before, which are nearly the same as long.

use std::collections::VecDeque;
use std::time::Duration;

use super::config::{PlannedPose, Reference};
use super::turning::LOWERED;

/// What was told is remembered for so long: power commands under way, and looks back, reach no farther.
const KEPT: Duration = Duration::from_millis(1500);

/// Both vehicles at an instant, as they are flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// I and J; the power that protects at that instant.
    pub poses: [PlannedPose; 2],
    /// J on the motion before, where it need not have taken up the newest yet.
    pub j_behind: PlannedPose,
    /// The most that each may be at by then, since what is to come is commanded ahead, watts.
    pub most_w: [f64; 2],
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(crate) struct Followed {
    told: VecDeque<(Duration, usize, Flown)>,
}

impl Followed {
    pub fn tell(&mut self, slot: usize, flown: Flown, now: Duration) {
        self.told.push_back((now, slot, flown));
        while self.told.front().is_some_and(|(at, ..)| *at + KEPT < now) {
            self.told.pop_front();
        }
    }

    /// As told last.
    pub fn last(&self) -> Option<Flown> {
        self.told.back().map(|(.., flown)| *flown)
    }

    /// What a vehicle was to do at an instant of a slot: as told last before.
    pub fn reference(&self, slot: usize, vehicle: usize, at: Duration) -> Option<Reference> {
        let flown = self.at(slot, at)?;
        let about = self.of_slot(slot).filter(|(told, ..)| *told + LOWERED >= at && *told <= at);
        let most_w = about.map(|(.., flown)| flown.most_w[vehicle]).fold(flown.most_w[vehicle], f64::max);
        Some(Reference { most_w, ..Reference::from(&flown.poses[vehicle]) })
    }

    /// The same of J, if it is still on the motion before.
    pub fn behind(&self, slot: usize, at: Duration) -> Option<Reference> {
        Some(Reference::from(&self.at(slot, at)?.j_behind))
    }

    fn at(&self, slot: usize, at: Duration) -> Option<&Flown> {
        let before = self.of_slot(slot).rfind(|(told, ..)| *told <= at);
        before.or_else(|| self.of_slot(slot).next()).map(|(.., flown)| flown)
    }

    fn of_slot(&self, slot: usize) -> impl DoubleEndedIterator<Item = &(Duration, usize, Flown)> {
        self.told.iter().filter(move |(_, of, _)| *of == slot)
    }
}
