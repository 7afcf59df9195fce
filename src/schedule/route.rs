//! Ways through the airspace: polylines inside the geofence and the altitude band, and outside the no-fly areas.

use nalgebra::Vector2;

use super::geofence::Geofence;
use super::no_fly::NoFlyAreas;
use crate::geo::Enu;

/// A geofence with an altitude band and what is left out of both.
#[derive(Debug, Clone)]
pub(super) struct Corridor {
    pub fence: Geofence,
    /// Lowest and highest altitude in metres.
    pub altitude_m: [f64; 2],
    /// Where no vehicle may be, if anywhere.
    pub no_fly: Option<NoFlyAreas>,
}

impl Corridor {
    /// Whether `point` is inside, to `tolerance_m`.
    pub fn contains(&self, point: &Enu, tolerance_m: f64) -> bool {
        (self.entry(point) - point).norm() <= tolerance_m
    }

    /// The point at which a vehicle at `point` enters: straight up or down into the band, then to the nearest point
    /// of the fence, then out of a no-fly area by the shortest way.
    pub fn entry(&self, point: &Enu) -> Enu {
        let horizontal = self.fence.project(point.xy());
        let entry = lifted(horizontal, self.clamped(point.z));
        self.no_fly.as_ref().map_or(entry, |areas| areas.nearest_allowed(&entry))
    }

    /// The no-fly area that a point is inside of, by name.
    pub fn holding(&self, point: &Enu) -> Option<&str> {
        self.no_fly.as_ref()?.holding(point)
    }

    /// The no-fly areas that bar the straight way between two points, or all of them if none does: for messages.
    pub fn barring(&self, from: &Enu, to: &Enu) -> Vec<String> {
        let Some(areas) = &self.no_fly else { return Vec::new() };
        let vertical = |end: &Enu| lifted(end.xy(), self.clamped(end.z));
        let straight = [*from, vertical(from), vertical(to), *to];
        let barring: Vec<&str> = areas.barring(&straight).collect();
        let named = if barring.is_empty() { areas.names().collect() } else { barring };
        named.into_iter().map(str::to_owned).collect()
    }

    /// `altitude_m` moved into the band.
    pub fn clamped(&self, altitude_m: f64) -> f64 {
        altitude_m.max(self.altitude_m[0]).min(self.altitude_m[1])
    }

    /// The shortest way, its altitude changing evenly along it. Outside the corridor it goes vertically first and
    /// horizontally second on the way in, the other way round on the way out. `None` if there is no way.
    pub fn direct(&self, from: &Enu, to: &Enu) -> Option<Vec<Enu>> {
        self.between(from, to, &[])
    }

    /// The way that climbs or descends to `altitude_m` at once, and changes to the final altitude at the end.
    pub fn via_layer(&self, from: &Enu, to: &Enu, altitude_m: f64) -> Option<Vec<Enu>> {
        self.between(from, to, &[altitude_m])
    }

    fn between(&self, from: &Enu, to: &Enu, layer_m: &[f64]) -> Option<Vec<Enu>> {
        if from == to {
            return Some(vec![*from]);
        }
        let (first, last) = (self.entry(from), self.entry(to));
        let at = |end: &Enu| layer_m.first().map_or(*end, |&z| lifted(end.xy(), z));
        let level = self.passage(&at(&first), &at(&last))?;
        let vertical = |end: &Enu| lifted(end.xy(), self.clamped(end.z));
        let mut path = vec![*from, vertical(from), first];
        path.extend(level);
        path.extend([last, vertical(to), *to]);
        if let Some(areas) = &self.no_fly {
            let leaves = [*from, vertical(from), first];
            let arrives = [at(&last), last, vertical(to), *to];
            let allowed = areas.let_out(&leaves)
                && areas.are_clear_of(&[first, at(&first)])
                && areas.are_clear_of(&arrives);
            if !allowed {
                return None;
            }
        }
        path.dedup();
        Some(path)
    }

    /// The shortest way between two points of the corridor, if no area bars it; else a way round, over or under.
    fn passage(&self, from: &Enu, to: &Enu) -> Option<Vec<Enu>> {
        let straight = self.slope(from, to)?;
        match &self.no_fly {
            Some(areas) if !areas.are_clear_of(&straight) => areas.way(&self.fence, from, to),
            _ => Some(straight),
        }
    }

    /// The shortest way between two points of the corridor, the altitude in proportion to the distance covered.
    fn slope(&self, from: &Enu, to: &Enu) -> Option<Vec<Enu>> {
        let corners = self.fence.shortest_path(from.xy(), to.xy())?;
        let total_m: f64 = corners.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        if total_m == 0.0 {
            return Some(vec![*from, *to]);
        }
        let mut path = vec![*from];
        let mut covered_m = 0.0;
        for w in corners.windows(2) {
            covered_m += (w[1] - w[0]).norm();
            let climbed = (to.z - from.z) * (covered_m / total_m);
            path.push(lifted(w[1], self.clamped(from.z + climbed)));
        }
        if let Some(end) = path.last_mut() {
            *end = *to;
        }
        Some(path)
    }
}

/// The point above `horizontal` at `altitude_m`.
pub(super) fn lifted(horizontal: Vector2<f64>, altitude_m: f64) -> Enu {
    Enu::new(horizontal.x, horizontal.y, altitude_m)
}
