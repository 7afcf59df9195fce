//! The invariants, watched from outside: from true states and true powers, never from anybody's word.

mod conduct;

use std::mem::{Discriminant, discriminant};
use std::time::Duration;

use nalgebra::Vector3;

use super::config::{AirspaceConfig, Off, Reference};
use super::violation::{Breach, Violation};
use crate::vehicle::autopilot::Traces;
use conduct::{Emitting, Side};

/// A vehicle that leaves its pose while it radiates has S4's 100 ms from the first evidence on the wire; the evidence
/// itself may be one telemetry period and a few steps old.
const POSE_REACTION: Duration = Duration::from_millis(150);
/// What is off by so little that the jitter hides it at first has time for a longer mean to show it.
const FAINT_REACTION: Duration = Duration::from_millis(1500);
/// I may outlast a jammer that a fault has silenced by its lease (500 ms by default), plus the wire.
const LEASE: Duration = Duration::from_millis(550);
/// A jammer that was out of its pose this recently was right to fall silent out of turn (S4).
const EXCUSE: Duration = Duration::from_secs(1);
/// Relative. Powers travel as dBm in single precision and are set in steps of 0.001 dB (0.023%).
const POWER_MARGIN: f64 = 1e-3;
/// Plans lie on the geofence and on the band's edges, and a vehicle holds a pose to the tolerance, not better.
const FENCE_MARGIN_M: f64 = 1.0;
/// The same for heights, where a climb also ends with a small overshoot.
const BAND_MARGIN_M: f64 = 3.0;
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
    /// How far off it is, metres and degrees.
    pub error: (f64, f64),
    pub position: Vector3<f64>,
    /// Where an estimator that a fault has misled takes it to be. Poses and the geofence are judged there: a lie that
    /// nobody aboard can see through is nobody's violation. Distances between vehicles are judged at the truth.
    pub supposed: Vector3<f64>,
    pub home: Vector3<f64>,
    pub airborne: bool,
    /// Its path is nobody's but the companion's or the autopilot's: not the pilot's, not a forced landing, and its
    /// motors turn.
    pub confined: bool,
    /// It is the companion that flies it.
    pub companion: bool,
}

/// What is going on: with which vehicle, and which breach. A violation is reported when one of these begins.
type Condition = (Option<usize>, Discriminant<Breach>);

/// Keeps what must be remembered between two looks.
#[derive(Debug, Clone, Default)]
pub(crate) struct Monitor {
    active: Vec<Condition>,
    pub violations: Vec<Violation>,
    pub min_separation_m: Option<f64>,
    faulted: bool,
    radiating: [bool; 2],
    /// Out of pose while radiating since, and whether it began so.
    out_since: [Option<(Duration, bool)>; 2],
    /// Out of it by what must be seen at once, since.
    far_out_since: [Option<Duration>; 2],
    /// I without a jammer since, and whether there was one before.
    bare_since: Option<(Duration, bool)>,
    jammer_last_out: Option<Duration>,
    /// When I was, or would have been, protected last.
    jammed_last: Option<Duration>,
    sides: [Side; 2],
    /// By how much later than in real time the companions may be run.
    pub allowance: Duration,
}

impl Monitor {
    /// From now on silence out of turn is what S4 asks for.
    pub fn fault(&mut self) {
        self.faulted = true;
    }

    /// Takes note of whether a breach goes on: it is a violation when it begins.
    fn set(&mut self, now: Duration, vehicle: Option<usize>, breach: Breach, holds: bool) {
        let condition = (vehicle, discriminant(&breach));
        let known = self.active.iter().position(|active| *active == condition);
        match known {
            Some(k) if !holds => {
                self.active.swap_remove(k);
            }
            None if holds => {
                self.active.push(condition);
                self.violations.push(Violation { at: now, vehicle, breach });
            }
            _ => {}
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
        for v in 0..2 {
            self.emission(v, now, &seen[v], max_power_w[v]);
        }
        self.order(now, seen, planned_silent);
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
        if v == 1 && seen.slot.is_some() && seen.off != Off::Nothing {
            self.jammer_last_out = Some(now);
        }
        let begins = !self.radiating[v];
        self.out_since[v] = out.then(|| self.out_since[v].unwrap_or((now, begins)));
        let far_out = posed && seen.off == Off::Much;
        self.far_out_since[v] = far_out.then(|| self.far_out_since[v].unwrap_or(now));
        // Nobody turns on out of pose, but that a fault tears off the pose at that moment (S4).
        let too_long = self.out_since[v].is_some_and(|(since, from_start)| {
            from_start && !self.faulted || now.saturating_sub(since) > FAINT_REACTION
        }) || self.far_out_since[v]
            .is_some_and(|since| now.saturating_sub(since) > POSE_REACTION);
        let (off_m, off_deg) = seen.error;
        self.set(now, Some(v), Breach::OutOfPose { off_m, off_deg }, too_long);

        let allowed_w = seen.plan.map_or(max_power_w, |plan| plan.power_w.min(max_power_w));
        let power_w = seen.power_w.unwrap_or(0.0);
        let too_much = radiates && power_w > allowed_w * (1.0 + POWER_MARGIN);
        self.set(now, Some(v), Breach::Power { power_w, allowed_w }, too_much);
    }

    /// S1's jam and S3's order.
    fn order(&mut self, now: Duration, seen: &[Seen; 2], planned_silent: bool) {
        let [i, j] = seen;
        let i_on = i.power_w.is_some();
        let protected = planned_silent || j.power_w.is_some() && j.slot == i.slot;
        let bare = i_on && i.slot.is_some() && !protected;
        let excused = self.faulted
            || !j.companion
            || self.jammer_last_out.is_some_and(|at| now.saturating_sub(at) <= EXCUSE);
        if planned_silent || j.power_w.is_some() {
            self.jammed_last = Some(now);
        }
        if !bare {
            self.bare_since = None;
        } else if self.bare_since.is_none() {
            // A jammer that a fault has silenced: what it granted before lasts, whether I is on already or not yet.
            let leased = self.jammed_last.filter(|at| excused && now.saturating_sub(*at) <= LEASE);
            self.bare_since = Some(match leased {
                Some(at) if !self.radiating[0] => (at, true),
                _ => (now, self.radiating[0]),
            });
        }
        let (starts_bare, loses_jam) = match self.bare_since {
            Some((since, had_jam)) => (!had_jam, had_jam && since == now),
            None => (false, false),
        };
        self.set(now, I, Breach::InfoFirst, bare && starts_bare);
        let left = self.active.contains(&(I, discriminant(&Breach::JamLeft))) || loses_jam && !excused;
        self.set(now, I, Breach::JamLeft, bare && left);
        let too_long = self
            .bare_since
            .is_some_and(|(since, had_jam)| !had_jam || left || now.saturating_sub(since) > LEASE);
        self.set(now, I, Breach::Unprotected, too_long);
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

    /// F1 of one vehicle: the geofence and the altitude band.
    fn airspace(&mut self, v: usize, now: Duration, seen: &Seen, airspace: &AirspaceConfig) {
        let p = seen.supposed;
        let at_home = (p.xy() - seen.home.xy()).norm() <= HOME_COLUMN_M;
        let free = seen.airborne && seen.confined;
        let beyond_m = if free && !at_home { beyond_fence_m(&airspace.area_enu_m, p.x, p.y) } else { 0.0 };
        let breach = Breach::Fence { beyond_m, position_m: [p.x, p.y] };
        self.set(now, Some(v), breach, beyond_m > FENCE_MARGIN_M);
        let [low, high] = airspace.altitude_m;
        let below = p.z < low - BAND_MARGIN_M && !at_home;
        let above = p.z > high + BAND_MARGIN_M;
        let breach = Breach::Band { height_m: p.z, band_m: airspace.altitude_m };
        self.set(now, Some(v), breach, free && (below || above));
    }
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
