//! The drawing of figure 3: for each method the map from above and, below it at the same scale, the view to the north.
//!
//! A vehicle is a marker with a short line along its antenna axis, the direction of its null, drawn as it projects:
//! full length where the axis lies in the picture, none where it points at the reader. The two views together give the
//! axis in space.

use nalgebra::Vector3;

use super::poses::{Panel, Poses};
use super::rates::STARTS;
use super::scenario::ALTITUDE_M;
use crate::desk::drawing::axes::{Axes, step, ticks};
use crate::desk::drawing::labels::Labels;
use crate::desk::drawing::svg::{Anchor, At, Marker, Stroke, Svg, TEXT_PT, text_width};
use crate::role::Role;

/// Width of both columns of the paper in points (7.16 inches).
const WIDTH: f64 = 516.0;
const LEFT: f64 = 40.0;
const RIGHT: f64 = 8.0;
/// Panels in a row: the paper's three are the first.
const COLUMNS: usize = 3;
const BETWEEN_COLUMNS: f64 = 14.0;
const LEGEND: f64 = 45.0;
const TITLE: f64 = 15.0;
/// Between the two views of a panel.
const BETWEEN_VIEWS: f64 = 6.0;
/// Below a panel, for the figures of its axis.
const FOOT: f64 = 18.0;
/// Lowest height drawn, in metres.
const DOWN_M: f64 = -25.0;
/// Half the drawn length of an antenna axis in points.
const AXIS_PT: f64 = 14.0;
const MARKER_PT: f64 = 3.0;
/// Beyond every edge of the map.
const FAR_M: f64 = 5e3;

const USER: &str = "#000000";
const DROP: Stroke = Stroke { colour: "#999999", width: 0.6, dashes: "1 1.5" };
const PLANE: Stroke = Stroke { colour: "#0b5394", width: 0.9, dashes: "7 2.5" };
const NULL: Stroke = Stroke { colour: "#c8500a", width: 1.1, dashes: "1.2 1.8" };

fn colour(role: Role) -> &'static str {
    match role {
        Role::I => "#0b5394",
        Role::J => "#c8500a",
    }
}

fn marker(role: Role) -> Marker {
    match role {
        Role::I => Marker::Disc,
        Role::J => Marker::Diamond,
    }
}

/// From which side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum View {
    /// East to the right, north up.
    Above,
    /// East to the right, up up.
    ToNorth,
}

impl View {
    fn flat(self, v: &Vector3<f64>) -> (f64, f64) {
        match self {
            Self::Above => (v.x, v.y),
            Self::ToNorth => (v.x, v.z),
        }
    }
}

/// The figure.
pub fn draw(poses: &Poses) -> String {
    let reach_m = reach_m(poses);
    let side = (WIDTH - LEFT - RIGHT - BETWEEN_COLUMNS * (COLUMNS - 1) as f64) / COLUMNS as f64;
    let pt_per_m = side / (2.0 * reach_m);
    // An upright antenna at the ceiling is drawn in full.
    let up_m = [DOWN_M, ALTITUDE_M[1] + (AXIS_PT + 3.0) / pt_per_m];
    let strip = pt_per_m * (up_m[1] - up_m[0]);
    let panel_height = TITLE + side + BETWEEN_VIEWS + strip + FOOT;
    let rows = poses.panels.len().div_ceil(COLUMNS);
    let height = LEGEND + panel_height * rows as f64 + 10.0;
    let mut svg = Svg::new(
        WIDTH,
        height,
        "Positions and antenna axes of both vehicles",
        "One panel a method: the map from above, and below it the view to the north.",
    );
    draw_legend(&mut svg);
    for (k, panel) in poses.panels.iter().enumerate() {
        let (row, column) = (k / COLUMNS, k % COLUMNS);
        let x = LEFT + column as f64 * (side + BETWEEN_COLUMNS);
        let y = LEGEND + row as f64 * panel_height;
        let letter = char::from(b'a' + k as u8);
        svg.heading((x, y + TITLE / 2.0), Anchor::Start, &format!("({letter}) {}", panel.title));
        svg.text((x + side, y + TITLE / 2.0), Anchor::End, &format!("{:.2}", panel.rate_bit_s_hz));
        let map = Axes {
            corner: (x, y + TITLE),
            size: (side, side),
            x: [-reach_m, reach_m],
            y: [-reach_m, reach_m],
        };
        let elevation =
            Axes { corner: (x, map.bottom() + BETWEEN_VIEWS), size: (side, strip), y: up_m, ..map.clone() };
        let every = step(2.0 * reach_m, 6.0);
        let grounds = ticks(map.x, every);
        draw_view(&mut svg, poses, panel, View::Above, &map);
        map.frame(&mut svg, &grounds, &grounds, [false, column == 0]);
        draw_view(&mut svg, poses, panel, View::ToNorth, &elevation);
        elevation.frame(&mut svg, &grounds, &[0.0, 100.0, 200.0, 300.0], [true, column == 0]);
        if column == 0 {
            svg.text_upwards((7.5, map.corner.1 + side / 2.0), "north (m)");
            svg.text_upwards((7.5, elevation.corner.1 + strip / 2.0), "up (m)");
        }
        // Nothing is below it.
        if k + COLUMNS >= poses.panels.len() {
            let below = elevation.bottom() + FOOT + 3.0;
            svg.text((x + side / 2.0, below), Anchor::Middle, "east (m)");
        }
    }
    svg.finish()
}

/// Half the side of the map: everything, with room for labels, to a whole 50 m.
fn reach_m(poses: &Poses) -> f64 {
    let vehicles =
        poses.panels.iter().flat_map(|panel| Role::BOTH.map(|role| panel.vehicles[role].pose.position_enu_m));
    let places = poses.eavesdroppers_enu_m.iter().copied().chain(vehicles).chain([poses.user_enu_m]);
    let farthest = places.map(|p| p.x.abs().max(p.y.abs())).fold(200.0, f64::max);
    ((farthest + 50.0) / 50.0).ceil() * 50.0
}

fn draw_view(svg: &mut Svg, poses: &Poses, panel: &Panel, view: View, axes: &Axes) {
    let at = |p: &Vector3<f64>| {
        let (a, b) = view.flat(p);
        axes.at(a, b)
    };
    let mut labels = Labels::new(axes.corner, axes.size, TEXT_PT);
    svg.clipped(axes.corner, axes.size, |svg| {
        if view == View::ToNorth {
            svg.line(&[axes.at(axes.x[0], 0.0), axes.at(axes.x[1], 0.0)], &Stroke::solid("#999999", 0.6));
            for role in Role::BOTH {
                let p = panel.vehicles[role].pose.position_enu_m;
                svg.line(&[at(&p), at(&Vector3::new(p.x, p.y, 0.0))], &DROP);
            }
        } else if let Some(ends) = plane_on_ground(panel, axes.x[1] - axes.x[0]) {
            svg.line(&ends.map(|p| at(&p)), &PLANE);
            labels.avoid_line(at(&ends[0]), at(&ends[1]));
        }
        let j = &panel.vehicles.j.pose;
        let null = panel.null_on_ground_enu_m();
        let from = null.unwrap_or(j.position_enu_m - j.antenna_axis() * FAR_M);
        // From the ground through J and on.
        let up = j.antenna_axis() * if j.antenna_axis().z < 0.0 { -FAR_M } else { FAR_M };
        let ends = [at(&from), at(&(j.position_enu_m + up))];
        svg.line(&ends, &NULL);
        labels.avoid_line(ends[0], ends[1]);
    });
    svg.marker(at(&poses.user_enu_m), Marker::OpenSquare, USER, 1.8 * MARKER_PT);
    labels.avoid(at(&poses.user_enu_m), 2.0 * MARKER_PT);
    for p in &poses.eavesdroppers_enu_m {
        svg.marker(at(p), Marker::Cross, USER, 1.3 * MARKER_PT);
        labels.avoid(at(p), 1.6 * MARKER_PT);
    }
    for role in Role::BOTH {
        let pose = &panel.vehicles[role].pose;
        let ends = draw_vehicle(svg, at(&pose.position_enu_m), view.flat(&pose.antenna_axis()), role);
        labels.avoid_line(ends[0], ends[1]);
        labels.avoid(at(&pose.position_enu_m), 1.3 * MARKER_PT);
    }
    // Last, when all that they must keep clear of is known.
    for role in Role::BOTH {
        let p = panel.vehicles[role].pose.position_enu_m;
        let text = match view {
            View::Above => format!("{role}, {:.0} m", p.z),
            View::ToNorth => role.to_string(),
        };
        let place = labels.place(at(&p), &text);
        svg.label(place, Anchor::Middle, colour(role), &text);
    }
}

/// Marker and axis; the ends of the axis as drawn.
fn draw_vehicle(svg: &mut Svg, (x, y): At, (across, up): (f64, f64), role: Role) -> [At; 2] {
    let (dx, dy) = (AXIS_PT * across, -AXIS_PT * up);
    let ends = [(x - dx, y - dy), (x + dx, y + dy)];
    svg.line(&ends, &Stroke::solid(colour(role), 1.8));
    svg.marker((x, y), marker(role), colour(role), MARKER_PT);
    ends
}

/// Where I's plane of maximum gain cuts the ground, as two points far apart; `None` for a level I.
fn plane_on_ground(panel: &Panel, length_m: f64) -> Option<[Vector3<f64>; 2]> {
    let pose = &panel.vehicles.i.pose;
    let (p, axis) = (pose.position_enu_m, pose.antenna_axis());
    let slope = axis.xy().norm();
    if slope < 1e-6 {
        return None;
    }
    // The point of the line nearest to I, then both ways along it: (q - p) . Y = 0 with q on the ground.
    let across = axis.xy() / slope;
    let nearest = p.xy() + across * (p.z * axis.z / slope);
    let along = Vector3::new(-across.y, across.x, 0.0) * (2.0 * length_m);
    let nearest = Vector3::new(nearest.x, nearest.y, 0.0);
    Some([nearest - along, nearest + along])
}

fn draw_legend(svg: &mut Svg) {
    const SIGN: f64 = 21.0;
    const APART: f64 = 14.0;
    let rows = [8.0, 21.0];
    let labels = [
        ["user", "eavesdropper"],
        ["base station I, antenna axis", "jammer J, antenna axis"],
        ["I's plane of maximum gain at the ground", "J's null line, down to the ground"],
    ];
    let mut x = RIGHT;
    for (column, labels) in labels.iter().enumerate() {
        for (row, (label, y)) in labels.iter().zip(rows).enumerate() {
            match (column, row) {
                (0, 0) => svg.marker((x + 10.0, y), Marker::OpenSquare, USER, 1.8 * MARKER_PT),
                (0, _) => svg.marker((x + 10.0, y), Marker::Cross, USER, 1.3 * MARKER_PT),
                (1, row) => {
                    draw_vehicle(svg, (x + 9.0, y), (0.65, 0.0), if row == 0 { Role::I } else { Role::J });
                }
                (_, row) => svg.line(&[(x, y), (x + 17.0, y)], if row == 0 { &PLANE } else { &NULL }),
            }
            svg.text((x + SIGN, y), Anchor::Start, label);
        }
        x += SIGN + labels.map(|label| text_width(label, TEXT_PT)).into_iter().fold(0.0, f64::max) + APART;
    }
    let note = format!("Secrecy rate at each panel, bit/s/Hz: the best of {STARTS} starts, by every method.");
    svg.text((RIGHT, 34.0), Anchor::Start, &note);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::Pose;
    use crate::planner::plan::VehiclePlan;
    use crate::radio::pattern;
    use crate::role::PerVehicle;

    #[test]
    fn val_plane_on_ground_has_full_gain() {
        let pose = Pose {
            position_enu_m: Vector3::new(20.0, -7.0, 90.0),
            roll_rad: 0.7,
            pitch_rad: -0.4,
            yaw_rad: 0.0,
        };
        let vehicle = VehiclePlan { pose, tx_power_w: 0.5 };
        let panel = Panel {
            name: "",
            title: "",
            vehicles: PerVehicle { i: vehicle, j: vehicle },
            rate_bit_s_hz: 0.0,
        };
        for q in plane_on_ground(&panel, 100.0).unwrap() {
            let gain = pattern::gain(&(q - pose.position_enu_m), &pose.antenna_axis());
            assert!((gain - 1.0).abs() < 1e-12 && q.z == 0.0);
        }
        let q = panel.null_on_ground_enu_m().unwrap();
        assert!(q.z.abs() < 1e-12);
        assert!(pattern::gain(&(q - pose.position_enu_m), &pose.antenna_axis()) < 1e-12);
    }
}
