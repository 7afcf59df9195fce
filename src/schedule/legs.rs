//! The transits of a tour, planned when they are first asked for.

use std::collections::BTreeMap;
use std::time::Duration;

use super::error::TableError;
use super::order::{Order, Places, Tour};
use super::trajectory::Start;
use super::transit::{Router, Transit, TransitError};
use crate::geo::Pose;
use crate::role::PerVehicle;

/// The transits between places, planned when first asked for.
pub(super) struct Legs<'a> {
    router: &'a Router,
    /// Where the tour starts; `None` if that is not known yet, and getting there counts nothing.
    start: Option<&'a PerVehicle<Start>>,
    /// The user and poses of each place, user by user.
    places: Vec<(usize, PerVehicle<Pose>)>,
    /// Each user's places.
    of_user: Vec<Vec<usize>>,
    /// From a place (or the start) to a place.
    planned: BTreeMap<(Option<usize>, usize), Result<Transit, TransitError>>,
}

impl<'a> Legs<'a> {
    /// The transits of a tour through one of the candidate poses of each user.
    pub fn new(
        router: &'a Router,
        start: Option<&'a PerVehicle<Start>>,
        users: &[Vec<PerVehicle<Pose>>],
    ) -> Self {
        let mut places = Vec::new();
        let mut of_user = Vec::new();
        for (user, candidates) in users.iter().enumerate() {
            of_user.push((places.len()..places.len() + candidates.len()).collect());
            places.extend(candidates.iter().map(|&poses| (user, poses)));
        }
        Self { router, start, places, of_user, planned: BTreeMap::new() }
    }

    /// Which of its user's candidates a place is.
    pub fn candidate(&self, user: usize, place: usize) -> usize {
        place - self.of_user[user][0]
    }

    fn leg(&mut self, from: Option<usize>, to: usize) -> &Result<Transit, TransitError> {
        self.planned.entry((from, to)).or_insert_with(|| {
            let poses = &self.places[to].1;
            let hover = |pose: Pose| Start { position_enu_m: pose.position_enu_m, attitude: pose.attitude() };
            let start = match from {
                Some(place) => self.places[place].1.map(hover),
                // Without a start, the tour begins where it first goes to.
                None => self.start.copied().unwrap_or_else(|| poses.map(hover)),
            };
            self.router.plan(&start, poses)
        })
    }

    fn time(&mut self, from: Option<usize>, to: usize) -> Duration {
        if from.is_none() && self.start.is_none() {
            return Duration::ZERO;
        }
        self.leg(from, to).as_ref().map_or(Duration::MAX, Transit::duration)
    }

    /// A leg that must exist.
    pub fn transit(&mut self, from: Option<usize>, to: usize) -> Result<Transit, TableError> {
        let (from_user, to_user) = (from.map(|place| self.places[place].0), self.places[to].0);
        let leg = self.leg(from, to).clone();
        leg.map_err(|source| TableError::Transit { from: from_user, to: to_user, source })
    }

    /// The best tour in an order.
    pub fn tour(&mut self, superframes: u16, order: Order) -> Result<Tour, TableError> {
        let n = self.places.len();
        let last = self.of_user.len() - 1;
        // Only legs that may be flown are planned: a leg that is not flown may well be impossible.
        let flown = |from: Option<usize>, to: usize| match (order, from) {
            (Order::Shortest, None) => true,
            (Order::Shortest, Some(from)) => from != to || (last == 0 && superframes > 1),
            (Order::Listed, None) => to == 0,
            (Order::Listed, Some(from)) => to == from + 1 || (superframes > 1 && from == last && to == 0),
        };
        let mut from_start = vec![Duration::MAX; n];
        let mut between = vec![Duration::MAX; n * n];
        for (to, (to_user, _)) in self.places.clone().into_iter().enumerate() {
            if flown(None, to_user) {
                from_start[to] = self.time(None, to);
            }
            for from in (0..n).filter(|&from| flown(Some(self.places[from].0), to_user)).collect::<Vec<_>>() {
                between[from * n + to] = self.time(Some(from), to);
            }
        }
        let places = Places { of_user: self.of_user.clone(), from_start, between, superframes };
        places.tour(order).ok_or_else(|| self.first_failure(superframes))
    }

    /// Why there is no tour.
    fn first_failure(&self, superframes: u16) -> TableError {
        let failed =
            self.planned.iter().find_map(|((from, to), leg)| Some((*from, *to, leg.as_ref().err()?)));
        match failed {
            Some((from, to, source)) => TableError::Transit {
                from: from.map(|place| self.places[place].0),
                to: self.places[to].0,
                source: source.clone(),
            },
            None => TableError::Empty { users: self.of_user.len(), superframes },
        }
    }
}
