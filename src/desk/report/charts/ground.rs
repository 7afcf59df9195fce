//! The ground from above: where everything is, and what it looks like from there.

use nalgebra::Vector3;

use super::time::numbered_disc;
use super::{Format, THEME, colour};
use crate::desk::drawing::axes::{Axes, step, ticks};
use crate::desk::drawing::labels::Labels;
use crate::desk::drawing::svg::{Anchor, At, Marker, Stroke, Svg};
use crate::desk::report::facts::Facts;
use crate::desk::report::timeline::{Listener, PlannedSlot};
use crate::geo::Pose;
use crate::role::Role;

const LEFT: f64 = 46.0;
const RIGHT: f64 = 8.0;
const TOP: f64 = 8.0;
const BOTTOM: f64 = 38.0;
/// Half the drawn length of a level antenna's axis.
const AXIS: f64 = 15.0;
const MARKER: f64 = 4.2;
/// Least half side of a map, metres.
const LEAST_REACH_M: f64 = 10.0;

/// A square of ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Square {
    /// East and north of its middle, metres.
    pub middle_m: [f64; 2],
    /// Half its side, metres.
    pub reach_m: f64,
}

impl Square {
    /// Everything that a flight's maps must show.
    #[must_use]
    pub fn of(facts: &Facts) -> Self {
        Self::around(facts, &[])
    }

    /// The same with the geofence and the no-fly areas.
    #[must_use]
    pub fn with_airspace(facts: &Facts) -> Self {
        let air = facts.timeline.scene.airspace.iter();
        let corners = air.flat_map(|air| {
            let areas = air.no_fly.iter().flat_map(|area| &area.corners_m);
            air.area_enu_m.iter().chain(areas).copied()
        });
        Self::around(facts, &corners.collect::<Vec<_>>())
    }

    fn around(facts: &Facts, corners: &[[f64; 2]]) -> Self {
        let scene = &facts.timeline.scene;
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        let mut take = |position: &[f64; 3], around_m: f64| {
            for k in 0..2 {
                low[k] = low[k].min(position[k] - around_m);
                high[k] = high[k].max(position[k] + around_m);
            }
        };
        corners.iter().for_each(|[east, north]| take(&[*east, *north, 0.0], 0.0));
        scene.users.iter().for_each(|user| take(&user.position_enu_m, 0.0));
        for listener in &scene.eavesdroppers {
            take(&listener.position_enu_m, circles(listener).into_iter().fold(0.0, f64::max));
            listener.true_position_enu_m.iter().for_each(|truth| take(truth, 0.0));
        }
        for role in Role::BOTH {
            scene.slots.iter().for_each(|slot| take(&slot.vehicles[role].position_enu_m, 0.0));
            let states = facts.timeline.samples.iter().filter_map(|sample| sample.vehicles[role].as_ref());
            states.for_each(|state| take(&state.position_enu_m, 0.0));
        }
        if low[0] > high[0] {
            return Self { middle_m: [0.0; 2], reach_m: LEAST_REACH_M };
        }
        let middle_m = [0, 1].map(|k| f64::midpoint(low[k], high[k]));
        let half = (0..2).map(|k| (high[k] - low[k]) / 2.0).fold(0.0, f64::max);
        Self { middle_m, reach_m: (1.12 * half).max(LEAST_REACH_M) }
    }

    /// Axes over the square, in a drawing of this width.
    #[must_use]
    pub fn axes(&self, width: f64) -> Axes {
        let side = width - LEFT - RIGHT;
        let range = |middle: f64| [middle - self.reach_m, middle + self.reach_m];
        Axes {
            corner: (LEFT, TOP),
            size: (side, side),
            x: range(self.middle_m[0]),
            y: range(self.middle_m[1]),
        }
    }

    /// Width and height of a drawing of such a map.
    #[must_use]
    pub fn size(width: f64) -> At {
        (width, width - LEFT - RIGHT + TOP + BOTTOM)
    }
}

/// Frame, figures and the axes' names.
pub fn frame(svg: &mut Svg, axes: &Axes) {
    let every = step(axes.x[1] - axes.x[0], 6.0);
    axes.frame(svg, &ticks(axes.x, every), &ticks(axes.y, every), [true, true]);
    let (x, y) = axes.corner;
    let (w, h) = axes.size;
    svg.text((x + w / 2.0, y + h + 28.0), Anchor::Middle, "east (m)");
    svg.text_upwards((8.0, y + h / 2.0), "north (m)");
}

/// Radii of the circles that show how well a position is known: the disc, or one and two standard deviations.
#[must_use]
pub fn circles(listener: &Listener) -> Vec<f64> {
    let of_std = listener.std_m.map(|std_m| [std_m, 2.0 * std_m]);
    listener.radius_m.into_iter().chain(of_std.into_iter().flatten()).collect()
}

/// Where a planned vehicle is, and its antenna.
#[must_use]
pub fn pose(slot: &PlannedSlot, role: Role) -> Pose {
    let planned = &slot.vehicles[role];
    Pose {
        position_enu_m: Vector3::from(planned.position_enu_m),
        roll_rad: planned.roll_rad,
        pitch_rad: planned.pitch_rad,
        yaw_rad: planned.yaw_rad,
    }
}

/// Colours of what stands on the ground.
#[derive(Debug, Clone, Copy)]
pub struct Colours {
    /// Users.
    pub user: &'static str,
    /// Eavesdroppers.
    pub eavesdropper: &'static str,
    /// Vehicles.
    pub vehicles: [&'static str; 2],
}

/// The page's.
pub const PAGE: Colours =
    Colours { user: "var(--user)", eavesdropper: "var(--eve)", vehicles: ["var(--i)", "var(--j)"] };

/// Users, eavesdroppers and how well they are known; their names are to be placed.
pub fn draw_nodes(svg: &mut Svg, facts: &Facts, axes: &Axes, colours: Colours, names: &mut Names) {
    let scene = &facts.timeline.scene;
    let flat = |p: &[f64; 3]| axes.at(p[0], p[1]);
    let per_m = axes.size.0 / (axes.x[1] - axes.x[0]);
    svg.clipped(axes.corner, axes.size, |svg| {
        for listener in &scene.eavesdroppers {
            for radius_m in circles(listener) {
                let pen = Stroke { colour: colours.eavesdropper, width: 1.1, dashes: "3 2.5" };
                svg.circle(flat(&listener.position_enu_m), radius_m * per_m, &pen);
            }
        }
    });
    for listener in &scene.eavesdroppers {
        let at = flat(&listener.position_enu_m);
        if let Some(truth) = listener.true_position_enu_m.filter(|truth| *truth != listener.position_enu_m) {
            svg.line(&[at, flat(&truth)], &Stroke::solid(colours.eavesdropper, 0.9));
            svg.marker(flat(&truth), Marker::Circle, colours.eavesdropper, 0.8 * MARKER);
            names.labels.avoid(flat(&truth), MARKER);
        }
        svg.marker(at, Marker::Cross, colours.eavesdropper, MARKER);
        names.add(at, colours.eavesdropper, listener.name.clone());
    }
    for user in &scene.users {
        let at = flat(&user.position_enu_m);
        svg.marker(at, Marker::OpenSquare, colours.user, 1.5 * MARKER);
        names.add(at, colours.user, user.name.clone());
    }
}

/// A vehicle's marker, and its antenna's axis as seen from above.
pub fn draw_vehicle(svg: &mut Svg, axes: &Axes, pose: &Pose, role: Role, colour: &'static str) -> At {
    let (paper, marker) = (svg.theme().paper, if role == Role::I { Marker::Disc } else { Marker::Diamond });
    let (x, y) = axes.at(pose.position_enu_m.x, pose.position_enu_m.y);
    let axis = pose.antenna_axis();
    let (dx, dy) = (AXIS * axis.x, -AXIS * axis.y);
    svg.line(&[(x - dx, y - dy), (x + dx, y + dy)], &Stroke::solid(paper, 4.4));
    svg.marker((x, y), marker, paper, 1.35 * MARKER);
    svg.line(&[(x - dx, y - dy), (x + dx, y + dy)], &Stroke::solid(colour, 2.4));
    svg.marker((x, y), marker, colour, MARKER);
    (x, y)
}

/// Names to be placed when all that they must keep clear of is known.
#[derive(Debug)]
pub struct Names {
    /// What is taken.
    pub labels: Labels,
    pending: Vec<(At, &'static str, String)>,
}

impl Names {
    /// For a map.
    #[must_use]
    pub fn new(axes: &Axes) -> Self {
        Self { labels: Labels::new(axes.corner, axes.size, THEME.text), pending: Vec::new() }
    }

    /// A name for a marker.
    pub fn add(&mut self, at: At, colour: &'static str, name: String) {
        self.labels.avoid(at, 1.9 * MARKER);
        self.pending.push((at, colour, name));
    }

    /// Writes all names.
    pub fn draw(mut self, svg: &mut Svg) {
        for (at, colour, name) in &self.pending {
            let place = self.labels.place(*at, name);
            svg.label(place, Anchor::Middle, colour, name);
        }
    }
}

/// The whole flight from above.
#[must_use]
pub fn overview(facts: &Facts, format: Format) -> String {
    let width = match format {
        Format::Wide => 640.0,
        Format::Narrow => format.width(),
    };
    let axes = Square::with_airspace(facts).axes(width);
    let mut svg = Svg::inline(
        &format!("map-{}", format.name()),
        Square::size(width),
        THEME,
        "The flight from above",
        "Users, eavesdroppers and how well they are known, the planned poses of each slot, and the paths that both vehicles flew.",
    );
    let mut names = Names::new(&axes);
    let every = step(axes.x[1] - axes.x[0], 6.0);
    axes.grid(&mut svg, &ticks(axes.x, every), &ticks(axes.y, every));
    svg.clipped(axes.corner, axes.size, |svg| {
        if let Some(airspace) = &facts.timeline.scene.airspace {
            let mut corners: Vec<At> = airspace.area_enu_m.iter().map(|&[e, n]| axes.at(e, n)).collect();
            corners.extend(corners.first().copied());
            svg.line(&corners, &Stroke { colour: "var(--muted)", width: 1.0, dashes: "8 4" });
            for area in &airspace.no_fly {
                let mut corners: Vec<At> = area.corners_m.iter().map(|&[e, n]| axes.at(e, n)).collect();
                corners.extend(corners.first().copied());
                svg.line(&corners, &Stroke { colour: "var(--muted)", width: 2.0, dashes: "2 2" });
                if let Some(corner) = corners.first() {
                    names.add(*corner, "var(--muted)", format!("no-fly: {}", area.name));
                }
            }
        }
        for role in Role::BOTH {
            let path = path(facts, role, &axes);
            let dashes = if role == Role::I { "" } else { "7 3" };
            svg.line(&path, &Stroke { colour: colour(role), width: 1.5, dashes });
            path.windows(2).for_each(|ends| names.labels.avoid_line(ends[0], ends[1]));
        }
    });
    draw_nodes(&mut svg, facts, &axes, PAGE, &mut names);
    for role in Role::BOTH {
        draw_poses(&mut svg, facts, role, &axes, &mut names);
        let first = facts.timeline.samples.iter().find_map(|sample| sample.vehicles[role].as_ref());
        if let Some(home) = first {
            let at = axes.at(home.position_enu_m[0], home.position_enu_m[1]);
            svg.marker(at, Marker::Circle, colour(role), MARKER);
            names.add(at, colour(role), format!("{role} start"));
        }
    }
    draw_marks(&mut svg, facts, &axes, &mut names);
    frame(&mut svg, &axes);
    names.draw(&mut svg);
    svg.finish()
}

/// The planned poses; those at one place share a name.
fn draw_poses(svg: &mut Svg, facts: &Facts, role: Role, axes: &Axes, names: &mut Names) {
    let slots = &facts.timeline.scene.slots;
    let mut drawn: Vec<(Pose, Vec<usize>)> = Vec::new();
    for (number, slot) in slots.iter().enumerate() {
        let pose = pose(slot, role);
        match drawn.iter_mut().find(|(known, _)| *known == pose) {
            Some((_, numbers)) => numbers.push(number),
            None => drawn.push((pose, vec![number])),
        }
    }
    for (pose, numbers) in drawn {
        let at = draw_vehicle(svg, axes, &pose, role, colour(role));
        let numbers: Vec<String> = numbers.iter().take(3).map(usize::to_string).collect();
        let name = format!("{role} slot {}, {:.0} m", numbers.join("+"), pose.position_enu_m.z);
        names.add(at, colour(role), name);
    }
}

/// A vehicle's path, without points that nobody could tell apart.
fn path(facts: &Facts, role: Role, axes: &Axes) -> Vec<At> {
    let mut path: Vec<At> = Vec::new();
    for state in facts.timeline.samples.iter().filter_map(|sample| sample.vehicles[role].as_ref()) {
        let at = axes.at(state.position_enu_m[0], state.position_enu_m[1]);
        if path.last().is_none_or(|last| (last.0 - at.0).hypot(last.1 - at.1) >= 0.7) {
            path.push(at);
        }
    }
    path
}

/// Where the vehicle concerned was at each mark.
fn draw_marks(svg: &mut Svg, facts: &Facts, axes: &Axes, names: &mut Names) {
    let mut taken: Vec<At> = Vec::new();
    for mark in &facts.marks {
        let roles = facts.event(mark).vehicle.map_or(Role::BOTH.to_vec(), |role| vec![role]);
        let at_mark = facts.timeline.samples.iter().rfind(|sample| sample.at_s <= mark.at_s);
        for state in roles.iter().filter_map(|&role| at_mark?.vehicles[role].as_ref()) {
            let (x, y) = axes.at(state.position_enu_m[0], state.position_enu_m[1]);
            let mut at = (x - 17.0, y - 17.0);
            while taken.iter().any(|other| (other.0 - at.0).hypot(other.1 - at.1) < 16.0) {
                at.0 -= 16.0;
            }
            taken.push(at);
            svg.line(&[(x, y), at], &Stroke::solid("var(--fault)", 1.2));
            numbered_disc(svg, at, mark.number);
            names.labels.avoid(at, 8.5);
        }
    }
}
