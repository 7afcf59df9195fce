//! The invariants, watched from outside: from true states and true powers, never from anybody's word.

mod conduct;
mod jammer;
mod protection;

use std::mem::{Discriminant, discriminant};
use std::time::Duration;

use nalgebra::Vector3;

use super::config::{AirspaceConfig, NoFlyConfig, Off, Reference};
use super::excuse::{Cause, Excused};
use super::violation::{Breach, Violation};
use crate::vehicle::autopilot::Traces;
use conduct::{Emitting, Side};
use jammer::Jammer;
use protection::{Measured, Protection};

/// A vehicle that leaves its pose while it radiates has S4's 100 ms from the first evidence on the wire; the evidence
/// itself may be one telemetry period and a few steps old.
pub(super) const POSE_REACTION: Duration = Duration::from_millis(150);
/// What is off by so little that the jitter hides it at first has time for a longer mean to show it.
pub(super) const FAINT_REACTION: Duration = Duration::from_millis(1500);
/// The longest lease that J grants I, and the longest power command of either, as every mission has them.
const LEASE: Duration = Duration::from_millis(500);
/// What a lease ends is off so much later at most: the steps of all who take part, and the wire.
const WIRE: Duration = Duration::from_millis(50);
/// Relative. Powers travel as dBm in single precision and are set in steps of 0.001 dB (0.023%).
const POWER_MARGIN: f64 = 1e-3;
/// Plans lie on the geofence and on the band's edges, and a vehicle holds a pose to the tolerance, not better.
const FENCE_MARGIN_M: f64 = 1.0;
/// The same for heights, where a climb also ends with a small overshoot.
const BAND_MARGIN_M: f64 = 3.0;
/// A no-fly area that is lower than this many of those margins is judged with less of them.
const MARGINS_IN_HEIGHT: f64 = 4.0;
/// Take-off and landing: within this distance of home a vehicle may be below the band.
const HOME_COLUMN_M: f64 = 10.0;

/// I, which is not to be on the air when the pair is out of step.
const I: Option<usize> = Some(0);

/// One vehicle at one instant.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    pub power_w: Option<f64>,
    /// How long the power command in force lasts.
    pub lasts: Option<Duration>,
    /// The slot named with the power, and its plan for this vehicle; `None` outside the plan's slots.
    pub slot: Option<usize>,
    pub plan: Option<Reference>,
    /// How it compares with that plan; without one there is no pose to be in.
    pub off: Off,
    /// How far off it is by what it is judged by, metres and degrees.
    pub error: (f64, f64),
    pub position: Vector3<f64>,
    /// Where an estimator that a fault has misled takes it to be. Poses are judged there, and the geofence and no-fly areas there
    /// and at the truth: a lie that nobody aboard can see through is nobody's violation. Distances between vehicles are judged at
    /// the truth.
    pub supposed: Vector3<f64>,
    pub home: Vector3<f64>,
    pub airborne: bool,
    /// Its path is nobody's but the companion's or the autopilot's: not the pilot's, not a forced landing, and its
    /// motors turn.
    pub confined: bool,
    /// Its autopilot knows where it is.
    pub estimate_ok: bool,
    /// Its motors turn, all of those that the autopilot counts on.
    pub powered: bool,
    /// What its radio does by itself, against what it was told.
    pub radio: Option<Cause>,
    /// It radiates what the plan of I's slot asks of it, within the radio's steps.
    pub full_power: bool,
    /// It has just come on the air, and has not been in its pose for so long that nobody can have overlooked it.
    pub begins_out: bool,
}

/// What is going on: with which vehicle, and which breach. A violation is reported when one of these begins.
type Condition = (Option<usize>, Discriminant<Breach>);

/// Where a break of an invariant is kept.
#[derive(Debug, Clone, Copy)]
enum Entry {
    Violation(usize),
    Excused(usize),
}

/// Keeps what must be remembered between two looks.
#[derive(Debug, Clone, Default)]
pub(crate) struct Monitor {
    active: Vec<(Condition, Entry)>,
    pub violations: Vec<Violation>,
    excused: Vec<Excused>,
    measured: Measured,
    pub min_separation_m: Option<f64>,
    radiating: [bool; 2],
    /// What the radios do by themselves.
    radios: [Option<Cause>; 2],
    /// Out of pose while radiating since, and whether it began so.
    out_since: [Option<(Duration, bool)>; 2],
    /// Out of it by what must be seen at once, since.
    far_out_since: [Option<Duration>; 2],
    /// Below the band, and not by its companion.
    lowered: [bool; 2],
    jammer: Jammer,
    protection: Protection,
    sides: [Side; 2],
    /// From when on both companions can know that J has fallen silent.
    followed_from: Duration,
    /// By how much later than in real time the companions may be run.
    allowance: Duration,
}

/// What the monitor has found by an instant.
#[derive(Debug, Clone)]
pub(crate) struct Findings {
    /// In the order of their times.
    pub violations: Vec<Violation>,
    /// Likewise.
    pub excused: Vec<Excused>,
    pub measured: Measured,
}

impl Monitor {
    /// J's vehicle fails in a way that nothing on the wire shows at once.
    pub fn vehicle_fails(&mut self, v: usize, now: Duration) {
        if v == 1 {
            self.jammer.fails(now);
        }
    }

    /// The companions may be run by so much later than in real time.
    pub fn allow_for_scheduling(&mut self, allowance: Duration) {
        self.allowance = allowance;
        self.jammer.allowance = allowance;
    }

    /// Whether a vehicle is on the air since before this look.
    pub fn radiated(&self, v: usize) -> bool {
        self.radiating[v]
    }

    /// What has been found by `now`, with what goes on.
    pub fn findings(&self, now: Duration) -> Findings {
        let mut settled = self.clone();
        settled.settle(now);
        for (_, entry) in std::mem::take(&mut settled.active) {
            settled.ends(entry, now);
        }
        let Self { mut violations, mut excused, measured, .. } = settled;
        violations.sort_by_key(|violation| violation.at);
        excused.sort_by_key(|excused| excused.violation.at);
        Findings { violations, excused, measured }
    }

    fn goes_on(&self, vehicle: Option<usize>, breach: Breach) -> bool {
        self.active.iter().any(|(condition, _)| *condition == (vehicle, discriminant(&breach)))
    }

    /// Takes note of whether a breach goes on: it is a violation when it begins, unless it is a radio's own doing.
    fn set(&mut self, now: Duration, vehicle: Option<usize>, breach: Breach, holds: bool) {
        let condition = (vehicle, discriminant(&breach));
        let known = self.active.iter().position(|(active, _)| *active == condition);
        match known {
            Some(k) if !holds => {
                let (_, entry) = self.active.swap_remove(k);
                self.ends(entry, now);
            }
            None if holds => {
                let violation = Violation { at: now, vehicle, breach, lasted: Duration::ZERO };
                let radio = vehicle.and_then(|v| *self.radios.get(v)?);
                let entry = match radio.filter(|_| violation.invariant().is_of_emission()) {
                    Some(cause) => {
                        self.excused.push(Excused { violation, cause });
                        Entry::Excused(self.excused.len() - 1)
                    }
                    None => {
                        self.violations.push(violation);
                        Entry::Violation(self.violations.len() - 1)
                    }
                };
                self.active.push((condition, entry));
            }
            _ => {}
        }
    }

    fn ends(&mut self, entry: Entry, now: Duration) {
        let violation = match entry {
            Entry::Violation(k) => self.violations.get_mut(k),
            Entry::Excused(k) => self.excused.get_mut(k).map(|excused| &mut excused.violation),
        };
        if let Some(violation) = violation {
            violation.lasted = now.saturating_sub(violation.at);
        }
    }

    /// Looks at both vehicles: at every radio sample, and whenever a power changes.
    /// `planned_silent`: the plan of I's slot keeps J silent, so that I needs no jammer.
    pub fn observe(
        &mut self,
        now: Duration,
        seen: &[Seen; 2],
        traces: [&Traces; 2],
        planned_silent: bool,
        max_power_w: [f64; 2],
        airspace: &AirspaceConfig,
    ) {
        self.radios = [seen[0].radio, seen[1].radio];
        for v in 0..2 {
            self.emission(v, now, &seen[v], max_power_w[v]);
        }
        self.protection(now, seen, planned_silent, traces[1]);
        let emitting = |v: usize| Emitting { radiates: seen[v].power_w.is_some(), lasts: seen[v].lasts };
        self.conduct(now, [emitting(0), emitting(1)], traces);
        self.radiating = [seen[0].power_w.is_some(), seen[1].power_w.is_some()];
        self.separation(now, seen, airspace.min_separation_m);
        for (v, vehicle) in seen.iter().enumerate() {
            self.airspace(v, now, vehicle, airspace);
        }
    }

    /// S1, S2 and S6 of one emitter.
    fn emission(&mut self, v: usize, now: Duration, seen: &Seen, max_power_w: f64) {
        let radiates = seen.power_w.is_some();
        self.set(now, Some(v), Breach::NoSlot, radiates && seen.slot.is_none());

        let posed = radiates && seen.slot.is_some();
        let out = posed && seen.off != Off::Nothing;
        self.out_since[v] = out.then(|| self.out_since[v].unwrap_or((now, seen.begins_out)));
        let far_out = posed && seen.off == Off::Much;
        self.far_out_since[v] = far_out.then(|| self.far_out_since[v].unwrap_or(now));
        // Nobody turns on out of pose.
        let under_way = self.sign_and_command(v, now);
        let for_longer = |since: Duration, than: Duration| now.saturating_sub(since) > than + under_way;
        let too_long = self.out_since[v]
            .is_some_and(|(since, from_start)| from_start || for_longer(since, FAINT_REACTION))
            || self.far_out_since[v].is_some_and(|since| for_longer(since, POSE_REACTION));
        let (off_m, off_deg) = seen.error;
        self.set(now, Some(v), Breach::OutOfPose { off_m, off_deg }, too_long);

        let allowed_w = seen.plan.map_or(max_power_w, |plan| plan.most_w.min(max_power_w));
        let power_w = seen.power_w.unwrap_or(0.0);
        let too_much = radiates && power_w > allowed_w * (1.0 + POWER_MARGIN);
        self.set(now, Some(v), Breach::Power { power_w, allowed_w }, too_much);
    }

    fn separation(&mut self, now: Duration, seen: &[Seen; 2], least_m: f64) {
        let both = seen.iter().all(|s| s.airborne);
        let distance_m = (seen[0].position - seen[1].position).norm();
        if both {
            self.min_separation_m =
                Some(self.min_separation_m.map_or(distance_m, |least| least.min(distance_m)));
        }
        self.set(now, None, Breach::Near { distance_m, least_m }, both && distance_m < least_m);
    }

    /// F1 of one vehicle: the geofence, the no-fly areas and the altitude band.
    fn airspace(&mut self, v: usize, now: Duration, seen: &Seen, airspace: &AirspaceConfig) {
        let p = seen.supposed;
        let at_home = (p.xy() - seen.home.xy()).norm() <= HOME_COLUMN_M;
        let free = seen.airborne && seen.confined;
        // A jump of the estimate puts nobody out of bounds; it has to be both in truth and by what is known aboard.
        let least = |beyond: &dyn Fn(Vector3<f64>) -> f64| beyond(p).min(beyond(seen.position));
        let beyond_m = least(&|p| beyond_fence_m(&airspace.area_enu_m, p.x, p.y));
        let beyond_m = if free && !at_home { beyond_m } else { 0.0 };
        let breach = Breach::Fence { beyond_m, position_m: [p.x, p.y] };
        self.set(now, Some(v), breach, beyond_m > FENCE_MARGIN_M);
        let inside = airspace.no_fly.iter().map(|area| least(&|p| inside_no_fly_m(area, p))).enumerate();
        let deepest = inside.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, inside_m)| *inside_m > 0.0);
        let (area, inside_m) = deepest.unwrap_or_default();
        let breach = Breach::NoFly { area, inside_m, position_m: p.into() };
        self.set(now, Some(v), breach, free && deepest.is_some());
        let [low, high] = airspace.altitude_m;
        let under = p.z < low - BAND_MARGIN_M;
        // On its way up from where its companion had no hand in bringing it: a pilot's landing, or the fall of a tilted
        // vehicle whose stream of setpoints has ended.
        self.lowered[v] = under && (self.lowered[v] || !seen.confined || self.cannot_act(v));
        let below = under && !at_home && !self.lowered[v];
        let above = p.z > high + BAND_MARGIN_M;
        let breach = Breach::Band { height_m: p.z, band_m: airspace.altitude_m };
        self.set(now, Some(v), breach, free && (below || above));
    }
}

/// How far a point lies inside a prism, metres, where that is more than a vehicle at its face is off; else 0.
fn inside_no_fly_m(area: &NoFlyConfig, p: Vector3<f64>) -> f64 {
    let across_m = within_m(&area.area_enu_m, p.x, p.y);
    let above_m = area.floor_m.map_or(f64::INFINITY, |floor_m| p.z - floor_m);
    let below_m = area.ceiling_m.map_or(f64::INFINITY, |ceiling_m| ceiling_m - p.z);
    // Of both faces together where there are both: the height of a prism.
    let height_margin_m = BAND_MARGIN_M.min((above_m + below_m) / MARGINS_IN_HEIGHT);
    let is_inside = across_m > FENCE_MARGIN_M && above_m.min(below_m) > height_margin_m;
    if is_inside { across_m.min(above_m).min(below_m) } else { 0.0 }
}

/// How far a point lies inside a polygon, metres; 0 outside, and where there is no polygon. By the angle at which its sides
/// are seen, summed: all round from inside, nothing from outside.
fn within_m(corners: &[[f64; 2]], x: f64, y: f64) -> f64 {
    if corners.len() < 3 {
        return 0.0;
    }
    let (mut turned, mut nearest) = (0.0, f64::INFINITY);
    for (k, &[x1, y1]) in corners.iter().enumerate() {
        let [x0, y0] = corners[(k + corners.len() - 1) % corners.len()];
        let (ax, ay, bx, by) = (x0 - x, y0 - y, x1 - x, y1 - y);
        turned += (ax * by - ay * bx).atan2(ax * bx + ay * by);
        let (dx, dy) = (x1 - x0, y1 - y0);
        let length_squared = dx * dx + dy * dy;
        let along = if length_squared > 0.0 { -(ax * dx + ay * dy) / length_squared } else { 0.0 };
        let along = along.clamp(0.0, 1.0);
        nearest = nearest.min((ax + along * dx).hypot(ay + along * dy));
    }
    if turned.abs() > std::f64::consts::PI { nearest } else { 0.0 }
}

/// How far a point lies outside a polygon, metres; 0 inside, and where there is no polygon.
fn beyond_fence_m(corners: &[[f64; 2]], x: f64, y: f64) -> f64 {
    if corners.len() < 3 {
        return 0.0;
    }
    let mut inside = false;
    let mut nearest = f64::INFINITY;
    for (k, &[x1, y1]) in corners.iter().enumerate() {
        let [x0, y0] = corners[(k + corners.len() - 1) % corners.len()];
        if (y0 > y) != (y1 > y) && x < x0 + (y - y0) / (y1 - y0) * (x1 - x0) {
            inside = !inside;
        }
        let (dx, dy) = (x1 - x0, y1 - y0);
        let length_squared = dx * dx + dy * dy;
        let along = if length_squared > 0.0 { ((x - x0) * dx + (y - y0) * dy) / length_squared } else { 0.0 };
        let along = along.clamp(0.0, 1.0);
        nearest = nearest.min((x - x0 - along * dx).hypot(y - y0 - along * dy));
    }
    if inside { 0.0 } else { nearest }
}
