//! No-fly areas as ways must heed them: upright prisms that a way goes round, over or under.
//!
//! A way that an area bars is looked for over the areas' corners at all altitudes that matter: the band's ends, those of the
//! way's own ends, and each area's floor and ceiling. It is made of level and vertical pieces, each tested whole and not at
//! points of it; then corners that nothing asks for are left out. Corners, floors and ceilings are kept away from as the
//! geofence's corners are, by the same margins in the same order. Ties go to what was found first: the same areas and ends
//! give the same way, bit for bit.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::OnceLock;

use nalgebra::Vector2;

use super::geofence::{CORNER_MARGINS_M, Geofence, tolerance_m};
use super::route::lifted;
use super::separation::segment_distance_m;
use super::transit::TransitError;
use crate::geo::Enu;
use crate::geo::polygon::{Polygon, PolygonError};
use crate::planner::problem::{Airspace, NoFly};
use crate::planner::region::Region;

/// What is kept of a margin where a corner is left out, as a part of it.
const KEPT: f64 = 0.8;

/// An upright prism in which nobody may be. Its faces are allowed.
#[derive(Debug, Clone)]
struct Prism {
    name: String,
    polygon: Polygon,
    heights_m: [f64; 2],
    /// So deep inside is still on a face.
    tolerance_m: f64,
}

impl Prism {
    fn new(area: &NoFly) -> Result<Self, PolygonError> {
        let polygon = Polygon::new(&area.area_enu_m)?;
        let tolerance_m = tolerance_m(&polygon);
        Ok(Self { name: area.name.clone(), polygon, heights_m: area.heights_m(), tolerance_m })
    }

    /// Whether it takes the altitude `z_m`.
    fn is_at(&self, z_m: f64) -> bool {
        self.heights_m[0] + self.tolerance_m < z_m && z_m < self.heights_m[1] - self.tolerance_m
    }

    fn is_over(&self, p: Vector2<f64>) -> bool {
        self.polygon.encloses(p) && (p - self.polygon.nearest_on_boundary(p)).norm() > self.tolerance_m
    }

    fn holds(&self, p: &Enu) -> bool {
        self.is_at(p.z) && self.is_over(p.xy())
    }

    /// The part of a segment at altitudes that it takes, with `margin_m` about them, over the ground.
    fn within(&self, a: &Enu, b: &Enu, margin_m: f64) -> Option<[Vector2<f64>; 2]> {
        let slack_m = margin_m - self.tolerance_m;
        let [low, high] = [self.heights_m[0] - slack_m, self.heights_m[1] + slack_m];
        let climb = b.z - a.z;
        let mut part = [0.0, 1.0];
        if climb == 0.0 {
            if !(low < a.z && a.z < high) {
                return None;
            }
        } else {
            let mut times = [(low - a.z) / climb, (high - a.z) / climb];
            if climb < 0.0 {
                times.reverse();
            }
            part = [times[0].max(0.0), times[1].min(1.0)];
            if part[0] >= part[1] {
                return None;
            }
        }
        Some(part.map(|t| a.xy() + (b.xy() - a.xy()) * t))
    }

    /// Whether any part of a segment is inside.
    fn bars(&self, a: &Enu, b: &Enu) -> bool {
        let Some([from, to]) = self.within(a, b, 0.0) else { return false };
        if (to - from).norm_squared() <= self.tolerance_m * self.tolerance_m {
            return self.is_over(from);
        }
        self.polygon.middles_of_pieces(from, to, 2.0 * self.tolerance_m).any(|middle| self.is_over(middle))
    }

    /// Whether any part of a polyline is inside.
    fn bars_any_of(&self, path: &[Enu]) -> bool {
        path.windows(2).any(|w| self.bars(&w[0], &w[1]))
    }

    /// Whether any part of a segment is inside or nearer than `margin_m`.
    fn is_near(&self, a: &Enu, b: &Enu, margin_m: f64) -> bool {
        let Some([from, to]) = self.within(a, b, margin_m) else { return false };
        self.polygon.encloses(from)
            || self.polygon.edges().any(|[p, q]| {
                segment_distance_m([from.push(0.0), to.push(0.0)], [p.push(0.0), q.push(0.0)]) < margin_m
            })
    }
}

/// All no-fly areas of an airspace, at least one.
#[derive(Debug, Clone)]
pub(super) struct NoFlyAreas {
    prisms: Vec<Prism>,
    /// What they leave of the airspace.
    allowed: Region,
    /// Lowest and highest altitude of the band in metres.
    altitude_m: [f64; 2],
    /// One for each margin, made when a way first needs it.
    nets: [OnceLock<Net>; CORNER_MARGINS_M.len()],
}

/// Where ways may turn.
#[derive(Debug, Clone)]
struct Net {
    corners: Vec<Vector2<f64>>,
    /// Altitudes at which ways may be level, ascending; the ends of a way add their own.
    levels_m: Vec<f64>,
    /// Which corners see each other, at each of the altitudes that [`NoFlyAreas::slab`] tells apart. Row-major.
    visible: Vec<OnceLock<Vec<bool>>>,
}

impl NoFlyAreas {
    /// The areas of `airspace`; `None` if it has none.
    ///
    /// # Errors
    /// [`TransitError`] if one of them is no polygon, or they leave nothing.
    pub fn new(airspace: &Airspace) -> Result<Option<Self>, TransitError> {
        if airspace.no_fly.is_empty() {
            return Ok(None);
        }
        let prisms = airspace.no_fly.iter().map(Prism::new).collect::<Result<Vec<_>, _>>()?;
        let allowed = Region::new(airspace).filter(|region| !region.cells().is_empty());
        let allowed = allowed.ok_or(TransitError::NothingLeft { areas: prisms.len() })?;
        Ok(Some(Self { prisms, allowed, altitude_m: airspace.altitude_m, nets: Default::default() }))
    }

    /// Their names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.prisms.iter().map(|prism| prism.name.as_str())
    }

    /// The area that a point is inside of, by name.
    pub fn holding(&self, p: &Enu) -> Option<&str> {
        self.prisms.iter().find(|prism| prism.holds(p)).map(|prism| prism.name.as_str())
    }

    /// The allowed point nearest to a point of the airspace: itself outside all areas.
    pub fn nearest_allowed(&self, p: &Enu) -> Enu {
        if self.holding(p).is_some() { self.allowed.nearest_allowed(p) } else { *p }
    }

    /// Those that any of the segments of a polyline enters, by name.
    pub fn barring<'a>(&'a self, path: &'a [Enu]) -> impl Iterator<Item = &'a str> {
        self.prisms.iter().filter(|prism| prism.bars_any_of(path)).map(|prism| prism.name.as_str())
    }

    /// Whether no area has any of a polyline inside.
    pub fn are_clear_of(&self, path: &[Enu]) -> bool {
        self.barring(path).next().is_none()
    }

    /// Whether a polyline enters none but those that hold its first point, from which it has to come out.
    pub fn let_out(&self, path: &[Enu]) -> bool {
        let Some(start) = path.first() else { return true };
        let mut others = self.prisms.iter().filter(|prism| !prism.holds(start));
        others.all(|prism| !prism.bars_any_of(path))
    }

    /// Those that a level straight line would cross at any altitude from one to another, by name.
    pub fn swept(&self, [a, b]: [Vector2<f64>; 2], [low_m, high_m]: [f64; 2]) -> impl Iterator<Item = &str> {
        let meets = move |prism: &&Prism| {
            let [floor, ceiling] = prism.heights_m;
            let z_m = 0.5 * (floor.max(low_m) + ceiling.min(high_m));
            floor < high_m && low_m < ceiling && prism.bars(&lifted(a, z_m), &lifted(b, z_m))
        };
        self.prisms.iter().filter(meets).map(|prism| prism.name.as_str())
    }

    /// A short way between two points of the airspace, both ends included; `None` if there is none over the corners.
    pub fn way(&self, fence: &Geofence, from: &Enu, to: &Enu) -> Option<Vec<Enu>> {
        CORNER_MARGINS_M.iter().enumerate().find_map(|(k, &margin_m)| {
            let net = self.nets[k].get_or_init(|| self.net(fence, k, margin_m));
            let path = self.over(net, fence, from, to)?;
            Some(self.shortened(fence, &path, KEPT * margin_m))
        })
    }

    fn net(&self, fence: &Geofence, k: usize, margin_m: f64) -> Net {
        let mut corners = fence.turns(k).to_vec();
        for prism in &self.prisms {
            let all = prism.polygon.corners();
            let n = all.len();
            for k in 0..n {
                let (previous, v, next) = (all[(k + n - 1) % n], all[k], all[(k + 1) % n]);
                if (v - previous).perp(&(next - v)) > 0.0 {
                    corners.push(pushed_out(fence, previous, v, next, margin_m));
                }
            }
        }
        let [low, high] = self.altitude_m;
        let faces = self.prisms.iter().flat_map(|prism| {
            let [floor, ceiling] = prism.heights_m;
            [floor - margin_m, ceiling + margin_m]
        });
        let mut levels_m: Vec<f64> =
            [low, high].into_iter().chain(faces).filter(|z| (low..=high).contains(z)).collect();
        sort(&mut levels_m);
        let slabs = 4 * self.prisms.len() + 1;
        Net { corners, levels_m, visible: vec![OnceLock::new(); slabs] }
    }

    /// Which altitudes meet the same areas: below, on and above each floor and ceiling.
    fn slab(&self, z_m: f64) -> usize {
        let faces =
            self.prisms.iter().flat_map(|prism| prism.heights_m.map(|face| (face, prism.tolerance_m)));
        let steps = faces.map(|(face, on)| usize::from(z_m >= face - on) + usize::from(z_m > face + on));
        steps.sum()
    }

    fn sees(&self, fence: &Geofence, a: Vector2<f64>, b: Vector2<f64>, z_m: f64) -> bool {
        fence.contains_segment(a, b) && self.are_clear_of(&[lifted(a, z_m), lifted(b, z_m)])
    }

    fn seen(&self, fence: &Geofence, corners: &[Vector2<f64>], z_m: f64) -> Vec<bool> {
        let m = corners.len();
        let mut visible = vec![false; m * m];
        for i in 0..m {
            for j in i + 1..m {
                let sees = self.sees(fence, corners[i], corners[j], z_m);
                visible[i * m + j] = sees;
                visible[j * m + i] = sees;
            }
        }
        visible
    }

    /// The shortest way of level and vertical pieces over the net.
    fn over(&self, net: &Net, fence: &Geofence, from: &Enu, to: &Enu) -> Option<Vec<Enu>> {
        let m = net.corners.len();
        let (source, target, points) = (m, m + 1, m + 2);
        let mut levels_m = net.levels_m.clone();
        levels_m.extend([from.z, to.z]);
        sort(&mut levels_m);
        let level_of = |z: f64| levels_m.iter().position(|level| *level == z);
        let (first, last) = (level_of(from.z)?, level_of(to.z)?);
        let ground = |k: usize| match k {
            k if k == source => from.xy(),
            k if k == target => to.xy(),
            k => net.corners[k],
        };
        let at = |node: usize| lifted(ground(node % points), levels_m[node / points]);
        // What the two ends see, level by level: looked at when a level is first reached.
        let mut ends: Vec<Option<Vec<[bool; 2]>>> = vec![None; levels_m.len()];
        let (start, goal) = (first * points + source, last * points + target);
        let mut spent = vec![f64::INFINITY; points * levels_m.len()];
        let mut before = vec![start; spent.len()];
        let mut done = vec![false; spent.len()];
        spent[start] = 0.0;
        // Lengths are not negative, so that their bits are in their order.
        let mut open = BinaryHeap::from([Reverse((0_u64, start))]);
        while let Some(Reverse((_, node))) = open.pop() {
            if node == goal {
                break;
            }
            if std::mem::replace(&mut done[node], true) {
                continue;
            }
            let (point, level) = (node % points, node / points);
            let z_m = levels_m[level];
            let of_ends = ends[level].get_or_insert_with(|| {
                let mut sights: Vec<_> = (0..m)
                    .map(|k| [from, to].map(|end| self.sees(fence, end.xy(), net.corners[k], z_m)))
                    .collect();
                sights.push([true, self.sees(fence, from.xy(), to.xy(), z_m)]);
                sights
            });
            let visible = net.visible[self.slab(z_m)].get_or_init(|| self.seen(fence, &net.corners, z_m));
            let sees = |k: usize| match (point, k) {
                (a, b) if a < m && b < m => visible[a * m + b],
                (a, b) if a < m => of_ends[a][b - m],
                (a, b) if b < m => of_ends[b][a - m],
                (a, b) => a != b && of_ends[m][1],
            };
            let level_steps = (0..points).filter(|&k| k != point && sees(k)).map(|k| level * points + k);
            let up = (level + 1 < levels_m.len()).then(|| node + points);
            let down = level.checked_sub(1).map(|_| node - points);
            let vertical =
                [up, down].into_iter().flatten().filter(|&next| self.are_clear_of(&[at(node), at(next)]));
            for next in level_steps.chain(vertical).collect::<Vec<_>>() {
                let through = spent[node] + (at(next) - at(node)).norm();
                if !done[next] && through < spent[next] {
                    spent[next] = through;
                    before[next] = node;
                    open.push(Reverse((through.to_bits(), next)));
                }
            }
        }
        if !spent[goal].is_finite() {
            return None;
        }
        let mut path = vec![*to];
        let mut node = goal;
        while node != start {
            node = before[node];
            path.push(at(node));
        }
        path.reverse();
        Some(path)
    }

    /// `path` without the corners that it does not need.
    fn shortened(&self, fence: &Geofence, path: &[Enu], margin_m: f64) -> Vec<Enu> {
        let mut kept = Vec::with_capacity(path.len());
        let mut k = 0;
        while let Some(&here) = path.get(k) {
            kept.push(here);
            let further =
                (k + 2..path.len()).rev().find(|&to| self.is_open(fence, &here, &path[to], margin_m));
            k = further.unwrap_or(k + 1);
        }
        kept
    }

    /// Whether a segment keeps `margin_m` off the areas, but for those that one of its ends is at.
    fn is_open(&self, fence: &Geofence, a: &Enu, b: &Enu, margin_m: f64) -> bool {
        let near = |prism: &Prism| {
            let at_end = [a, b].into_iter().any(|end| prism.is_near(end, end, margin_m));
            prism.bars(a, b) || (!at_end && prism.is_near(a, b, margin_m))
        };
        fence.contains_segment(a.xy(), b.xy()) && !self.prisms.iter().any(near)
    }
}

/// An area's corner `v` moved outward along its bisector, or less far where the fence is near.
fn pushed_out(
    fence: &Geofence,
    previous: Vector2<f64>,
    v: Vector2<f64>,
    next: Vector2<f64>,
    margin_m: f64,
) -> Vector2<f64> {
    let (back, ahead) = ((previous - v).normalize(), (next - v).normalize());
    // The right normal stands in where the corner is almost straight and the bisector ill-defined.
    let normal = Vector2::new(ahead.y, -ahead.x);
    let outward = (-(back + ahead)).try_normalize(1e-6).unwrap_or(normal);
    let steps = [1.0, 0.5, 0.25, 0.125].map(|part| v + outward * (part * margin_m));
    steps.into_iter().find(|candidate| fence.contains(*candidate)).unwrap_or(v)
}

fn sort(levels_m: &mut Vec<f64>) {
    levels_m.sort_by(f64::total_cmp);
    levels_m.dedup();
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::schedule::route::Corridor;
    use crate::schedule::testing::{self, star};

    /// A corridor from 20 to 120 m with random areas in a random fence.
    fn corridor(rng: &mut rand_chacha::ChaCha8Rng) -> Option<(Corridor, Airspace)> {
        let area = |rng: &mut rand_chacha::ChaCha8Rng, k: usize| {
            let centre = Vector2::new(rng.random_range(-60.0..60.0), rng.random_range(-60.0..60.0));
            let mut height = |part: f64| rng.random_bool(part).then(|| rng.random_range(0.0..140.0));
            let (mut floor_m, mut ceiling_m) = (height(0.4), height(0.6));
            if let (Some(low), Some(high)) = (&mut floor_m, &mut ceiling_m)
                && low > high
            {
                std::mem::swap(low, high);
            }
            let area_enu_m = star(rng, 30.0).into_iter().map(|corner| centre + corner).collect();
            NoFly { name: format!("area {k}"), area_enu_m, floor_m, ceiling_m }
        };
        let count = rng.random_range(1..5);
        let airspace = Airspace {
            altitude_m: [20.0, 120.0],
            area_enu_m: star(rng, 150.0),
            no_fly: (0..count).map(|k| area(rng, k)).collect(),
            min_separation_m: 5.0,
        };
        let fence = Geofence::new(&airspace.area_enu_m).ok()?;
        let no_fly = NoFlyAreas::new(&airspace).ok()?;
        Some((Corridor { fence, altitude_m: airspace.altitude_m, no_fly }, airspace))
    }

    #[test]
    fn prop_ways_between_allowed_places_stay_out_of_random_areas_and_inside_random_fences() {
        let mut rng = testing::rng(8);
        let (mut straight, mut past, mut none) = (0, 0, 0);
        for _ in 0..400 {
            let Some((corridor, airspace)) = corridor(&mut rng) else { continue };
            let mut place = || {
                let at = testing::inside(&mut rng, &corridor.fence, 150.0);
                corridor.entry(&lifted(at, rng.random_range(20.0..120.0)))
            };
            let (from, to) = (place(), place());
            let Some(path) = corridor.direct(&from, &to) else {
                none += 1;
                continue;
            };
            assert_eq!((path[0], path[path.len() - 1]), (from, to));
            for w in path.windows(2) {
                for k in 0..=400 {
                    let at = w[0] + (w[1] - w[0]) * (f64::from(k) / 400.0);
                    assert!(corridor.fence.project(at.xy()) == at.xy() && (20.0..=120.0).contains(&at.z));
                    let deepest = airspace.no_fly.iter().map(|area| area.depth_m(&at)).fold(0.0, f64::max);
                    assert!(deepest < 1e-6, "{deepest} m inside at {at} of {path:?}\n{airspace:?}");
                }
            }
            let bends = corridor.fence.shortest_path(from.xy(), to.xy()).map_or(0, |path| path.len());
            if path.len() > bends {
                past += 1
            } else {
                straight += 1
            }
            // The same the other way round: there is a way back.
            assert!(corridor.direct(&to, &from).is_some());
        }
        assert!(past > 30 && straight > 100 && none < 60, "{past} past, {straight} straight, {none} none");
    }

    #[test]
    fn val_a_way_goes_round_a_pillar_over_a_box_and_under_a_lid_by_the_margin() {
        let square = testing::polygon(&[[-500., -500.], [500., -500.], [500., 500.], [-500., 500.]]);
        let corridor = |floor_m, ceiling_m| {
            let airspace = Airspace {
                altitude_m: [20.0, 120.0],
                area_enu_m: square.clone(),
                no_fly: vec![NoFly {
                    name: "box".to_owned(),
                    area_enu_m: testing::polygon(&[[-200., -10.], [200., -10.], [200., 10.], [-200., 10.]]),
                    floor_m,
                    ceiling_m,
                }],
                min_separation_m: 5.0,
            };
            let no_fly = NoFlyAreas::new(&airspace).unwrap();
            Corridor { fence: Geofence::new(&square).unwrap(), altitude_m: airspace.altitude_m, no_fly }
        };
        let (from, to) = (Enu::new(0.0, -50.0, 60.0), Enu::new(0.0, 50.0, 60.0));
        let way = |floor_m, ceiling_m| corridor(floor_m, ceiling_m).direct(&from, &to).unwrap();
        let round = way(None, None);
        assert!(round.len() == 4 && round.iter().all(|at| at.z == 60.0), "{round:?}");
        let margin_m = round[1].x.abs() - 200.0;
        assert!((0.3..0.6).contains(&margin_m), "{round:?}");
        let over = way(None, Some(70.0));
        assert!(over.iter().any(|at| at.z == 70.5) && over.iter().all(|at| at.x.abs() < 210.0), "{over:?}");
        let under = way(Some(50.0), None);
        assert!(under.iter().any(|at| at.z == 49.5) && under.iter().all(|at| at.z <= 60.0), "{under:?}");
        assert_eq!(way(Some(70.0), None), [from, to]);
        assert_eq!(way(None, Some(50.0)), [from, to]);
        // A place inside is left by the shortest way.
        let held = Enu::new(0.0, 9.0, 60.0);
        let leaves = corridor(None, None).direct(&held, &to).unwrap();
        assert!((leaves[1] - Enu::new(0.0, 10.0, 60.0)).norm() < 1e-5, "{leaves:?}");
        assert_eq!(corridor(None, None).holding(&held), Some("box"));
    }
}
