//! The secrecy map: for every point of the ground, the secrecy rate of a slot as flown if the only eavesdropper were
//! there; and both antennas' patterns on the ground.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::GROUND_THEME;
use super::ground::{Colours, Names, Square, draw_nodes, draw_vehicle, frame, pose};
use crate::desk::drawing::axes::Axes;
use crate::desk::drawing::svg::{Stroke, Svg, number};
use crate::desk::report::facts::{Facts, SlotRun};
use crate::desk::report::timeline::{RadioScene, Sample};
use crate::geo::Pose;
use crate::radio::antenna::Pattern;
use crate::radio::fading::Rician;
use crate::radio::link::{Transmitter, sinr};
use crate::radio::pattern;
use crate::role::Role;

/// Points of the map in each direction.
const GRID: usize = 128;
/// Instants of a slot that are averaged over, at most.
const INSTANTS: usize = 48;
/// From little to much secrecy: told apart in grey and by colour-blind eyes (after cividis).
pub const SHADES: [&str; 10] = [
    "#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55",
    "#fee838",
];
/// Legible on all of them, with a white rim.
const COLOURS: Colours =
    Colours { user: "#005c43", eavesdropper: "#8a2061", vehicles: ["#00508a", "#b23c00"] };
/// Contours of gain: half power, and a hundredth.
const CONTOURS: [(Role, f64, &str); 3] =
    [(Role::I, 0.5, "6 3"), (Role::J, 0.5, "6 3"), (Role::J, 0.01, "1.5 2")];

/// One slot's map.
#[derive(Debug, Clone, PartialEq)]
pub struct SecrecyMap {
    /// Number of the slot.
    pub slot: u16,
    /// Bit/s/Hz by row (from south) and column (from west).
    pub rates: Vec<f64>,
}

impl SecrecyMap {
    /// The map of a slot as flown; `None` if I was not on the air, or the channel is unknown.
    #[must_use]
    pub fn new(facts: &Facts, run: &SlotRun, square: &Square) -> Option<Self> {
        let radio = facts.timeline.scene.radio?;
        let user = facts.timeline.scene.users.iter().find(|user| user.name == run.user)?;
        let user = Vector3::from(user.position_enu_m);
        let flown: Vec<[Transmitter<'_>; 2]> =
            facts.timeline.samples.iter().filter_map(|sample| transmitters(sample, run.number)).collect();
        let every = flown.len().div_ceil(INSTANTS).max(1);
        let instants: Vec<&[Transmitter<'_>; 2]> = flown.iter().step_by(every).collect();
        if instants.is_empty() {
            return None;
        }
        let heard: Vec<f64> = instants.iter().map(|pair| bits(pair, &user, &radio)).collect();
        let mut rates = Vec::with_capacity(GRID * GRID);
        for row in 0..GRID {
            for column in 0..GRID {
                let [east, north] = cell_middle(square, row, column);
                let ground = Vector3::new(east, north, 0.0);
                let sum: f64 = instants
                    .iter()
                    .zip(&heard)
                    .map(|(pair, user)| (user - bits(pair, &ground, &radio)).max(0.0))
                    .sum();
                rates.push(sum / instants.len() as f64);
            }
        }
        Some(Self { slot: run.number, rates })
    }

    /// The highest rate on the map.
    #[must_use]
    pub fn highest(&self) -> f64 {
        self.rates.iter().copied().fold(0.0, f64::max)
    }

    /// The drawing; `top` is the rate of the last shade's upper end.
    #[must_use]
    pub fn draw(&self, facts: &Facts, run: &SlotRun, square: &Square, top: f64) -> String {
        let width = 440.0;
        let axes = square.axes(width);
        let mut svg = Svg::inline(
            &format!("secrecy-{}", self.slot),
            Square::size(width),
            GROUND_THEME,
            &format!("Secrecy map of slot {}, user {}", self.slot, run.user),
            "For every point of the ground, the mean secrecy rate while the slot was flown if the only eavesdropper were there; the brighter, the more secret. Contours: the antennas' patterns on the ground.",
        );
        for (level, shade) in SHADES.iter().enumerate() {
            let path = self.shade(level, &axes, top);
            if !path.is_empty() {
                svg.path(&path, shade);
            }
        }
        let mut names = Names::new(&axes);
        if let Some(planned) = facts.timeline.scene.slots.get(usize::from(run.number)) {
            for (role, gain, dashes) in CONTOURS {
                let path = contour(&pose(planned, role), gain, square, &axes);
                svg.contour(&path, &Stroke::solid("#ffffff", 3.2));
                svg.contour(&path, &Stroke { colour: COLOURS.vehicles[role as usize], width: 1.6, dashes });
            }
            draw_nodes(&mut svg, facts, &axes, COLOURS, &mut names);
            for role in Role::BOTH {
                let colour = COLOURS.vehicles[role as usize];
                let pose = pose(planned, role);
                let at = draw_vehicle(&mut svg, &axes, &pose, role, colour);
                names.add(at, colour, format!("{role}, {:.0} m", pose.position_enu_m.z));
            }
        } else {
            draw_nodes(&mut svg, facts, &axes, COLOURS, &mut names);
        }
        names.draw(&mut svg);
        frame(&mut svg, &axes);
        svg.finish()
    }

    /// The cells of one shade as runs, row by row.
    fn shade(&self, level: usize, axes: &Axes, top: f64) -> String {
        let shade = |rate: f64| ((rate / top * SHADES.len() as f64) as usize).min(SHADES.len() - 1);
        let (w, h) = (axes.size.0 / GRID as f64, axes.size.1 / GRID as f64);
        let mut path = String::new();
        for (row, rates) in self.rates.chunks(GRID).enumerate() {
            let mut column = 0;
            while column < GRID {
                let length = rates[column..].iter().take_while(|rate| shade(**rate) == level).count();
                if length > 0 {
                    let x = axes.corner.0 + w * column as f64;
                    let y = axes.bottom() - h * (row + 1) as f64;
                    // A little overlap hides the seams that anti-aliasing leaves between neighbours.
                    let (run, tall) = (w * length as f64 + 0.3, h + 0.3);
                    let [x, y, run, tall] = [x, y, run, tall].map(number);
                    path += &format!("M{x} {y}h{run}v{tall}h-{run}z");
                }
                column += length.max(1);
            }
        }
        path
    }
}

fn cell_middle(square: &Square, row: usize, column: usize) -> [f64; 2] {
    let along = |k: usize| ((k as f64 + 0.5) / GRID as f64 * 2.0 - 1.0) * square.reach_m;
    [square.middle_m[0] + along(column), square.middle_m[1] + along(row)]
}

/// Both transmitters at an instant at which I serves the slot.
fn transmitters(sample: &Sample, slot: u16) -> Option<[Transmitter<'static>; 2]> {
    let i = sample.vehicles.i.as_ref().filter(|i| i.slot == Some(slot) && i.tx_power_w.is_some())?;
    let j = sample.vehicles.j.as_ref()?;
    Some([i, j].map(|state| Transmitter {
        position_enu_m: Vector3::from(state.position_enu_m),
        axis: state.attitude.antenna_axis(),
        tx_power_w: state.tx_power_w.unwrap_or(0.0),
        // The record of a flight says nothing of patterns: the map is the ideal dipoles'.
        antenna: &Pattern::IDEAL,
    }))
}

fn bits([i, j]: &[Transmitter<'_>; 2], node: &Vector3<f64>, radio: &RadioScene) -> f64 {
    (1.0 + sinr(i, j, node, Rician::NONE, radio.reference_gain, radio.noise_power_w)).log2()
}

/// A side of a cell: its lower or left end, and whether it runs north.
type Side = (usize, usize, bool);

/// Where the antenna's gain on the ground has this value: marching squares, joined to lines.
fn contour(pose: &Pose, gain: f64, square: &Square, axes: &Axes) -> String {
    let axis = pose.antenna_axis();
    let value = |row: usize, column: usize| {
        let [east, north] = cell_middle(square, row, column);
        pattern::gain(&(Vector3::new(east, north, 0.0) - pose.position_enu_m), &axis) - gain
    };
    let values: Vec<f64> = (0..GRID * GRID).map(|k| value(k / GRID, k % GRID)).collect();
    let at = |row: usize, column: usize| values[row * GRID + column];
    let ends = |&(row, column, north): &Side| {
        [(row, column), if north { (row + 1, column) } else { (row, column + 1) }]
    };
    // For each side that the contour crosses, the sides that it comes from and goes to.
    let mut next: BTreeMap<Side, Vec<Side>> = BTreeMap::new();
    for row in 0..GRID - 1 {
        for column in 0..GRID - 1 {
            let sides = [
                (row, column, false),
                (row, column + 1, true),
                (row + 1, column, false),
                (row, column, true),
            ];
            let crossed: Vec<Side> = sides
                .into_iter()
                .filter(|side| {
                    let [(r, c), (s, d)] = ends(side);
                    (at(r, c) < 0.0) != (at(s, d) < 0.0)
                })
                .collect();
            // A saddle's two segments join its crossings in turn.
            for pair in crossed.chunks_exact(2) {
                next.entry(pair[0]).or_default().push(pair[1]);
                next.entry(pair[1]).or_default().push(pair[0]);
            }
        }
    }
    let place = |side: &Side| {
        let [(r, c), (s, d)] = ends(side);
        let t = at(r, c) / (at(r, c) - at(s, d));
        let (p, q) = (cell_middle(square, r, c), cell_middle(square, s, d));
        axes.at(p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]))
    };
    let mut path = String::new();
    // Open lines from one of their ends first, then what is closed.
    while let Some(start) =
        next.iter().find(|(_, to)| to.len() == 1).or(next.iter().next()).map(|(side, _)| *side)
    {
        let mut side = start;
        let mut letter = 'M';
        loop {
            let (x, y) = place(&side);
            path += &format!("{letter}{} {}", number(x), number(y));
            letter = 'L';
            let Some(to) = next.remove(&side).and_then(|to| to.first().copied()) else { break };
            // Both ends of a segment know of it.
            if let Some(back) = next.get_mut(&to)
                && let Some(index) = back.iter().position(|other| *other == side)
            {
                back.remove(index);
            }
            side = to;
        }
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_half_power_of_an_upright_dipole_is_a_circle_below_it() {
        let square = Square { middle_m: [5.0, -3.0], reach_m: 100.0 };
        let axes = square.axes(440.0);
        let pose = Pose {
            position_enu_m: Vector3::new(5.0, -3.0, 40.0),
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: 0.0,
        };
        let path = contour(&pose, 0.5, &square, &axes);
        let points: Vec<f64> = path
            .split(['M', 'L', ' '])
            .filter(|part| !part.is_empty())
            .map(|part| part.parse().unwrap())
            .collect();
        // Gain 1/2 is at 45 degrees: 40 m from the point below.
        let per_m = axes.size.0 / 200.0;
        let (x, y) = axes.at(5.0, -3.0);
        assert!(points.len() > 100);
        for at in points.chunks_exact(2) {
            let radius_m = (at[0] - x).hypot(at[1] - y) / per_m;
            assert!((radius_m - 40.0).abs() < 0.3, "{radius_m}");
        }
    }
}
