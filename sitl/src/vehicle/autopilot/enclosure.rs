//! What an autopilot does at its fence: inclusion polygons, exclusion polygons, which have no heights, and a ceiling above home.
//! Circles it keeps for those who gave them, and does not fly by.
//!
//! PX4: GF_ACTION, in whatever mode but on the way home or down; polygons around which home does not lie are dropped, without a
//! word to whoever gave them. ArduCopter: FENCE_ENABLE, FENCE_TYPE, FENCE_ACTION; further than 100 m outside it lands. Each acts once,
//! when the vehicle crosses.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MISSION_ITEM_INT_DATA, MavCmd, MavSeverity};
use nalgebra::Vector3;

use super::super::router::Router;
use super::failsafe::Action;
use super::{Autopilot, Mode, Sensed};
use crate::geodesy::LocalFrame;
use crate::vehicle::config::Firmware;

/// PX4 looks five times a second; ArduCopter's newer versions more often, its older ones once.
const LOOKS_EVERY: Duration = Duration::from_millis(200);
/// ArduCopter lands where it is further outside than this, in metres.
const GIVES_UP_M: f64 = 100.0;
/// FENCE_TYPE.
const CEILING: i32 = 1;
const POLYGONS: i32 = 4;

/// The fence as it is flown by.
#[derive(Debug, Clone, Default)]
pub(super) struct Enclosure {
    /// In the mission's plane; of the lists' revision.
    polygons: Vec<Vec<[f64; 2]>>,
    /// Those that it must stay out of, likewise.
    zones: Vec<Vec<[f64; 2]>>,
    revision: u32,
    looks_at: Duration,
    outside: bool,
}

impl Autopilot {
    /// Acts once a fence is crossed.
    pub(super) fn watch_fence(&mut self, sensed: &Sensed, router: &mut Router) {
        if sensed.now < self.enclosure.looks_at {
            return;
        }
        self.enclosure.looks_at = sensed.now + LOOKS_EVERY;
        if self.enclosure.revision != self.plans.revision {
            self.enclosure.revision = self.plans.revision;
            let of = |command| polygons(self.plans.fence(), command, &self.frame);
            self.enclosure.polygons = of(MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION);
            self.enclosure.zones = of(MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION);
        }
        let outside = self.armed && !self.landed && self.is_outside(sensed.position_enu_m);
        let crosses = outside && !self.enclosure.outside;
        self.enclosure.outside = outside;
        if crosses {
            self.act_at_the_fence(sensed, router);
        }
    }

    fn is_outside(&self, at: Vector3<f64>) -> bool {
        let above_home_m = at.z - self.home_enu_m.z;
        let home = [self.home_enu_m.x, self.home_enu_m.y];
        let real = |name: &str| f64::from(self.parameters.real(name));
        let (polygons, ceiling_m) = match self.firmware {
            Firmware::Px4 => (true, Some(real("GF_MAX_VER_DIST")).filter(|m| *m > 0.0)),
            Firmware::ArduCopter => {
                let kinds = self.fence_kinds();
                (kinds & POLYGONS != 0, (kinds & CEILING != 0).then(|| real("FENCE_ALT_MAX")))
            }
        };
        let left = |polygon: &Vec<[f64; 2]>| {
            let counts = self.firmware == Firmware::ArduCopter || encloses(polygon, home);
            counts && !encloses(polygon, [at.x, at.y])
        };
        let entered = |zone: &Vec<[f64; 2]>| encloses(zone, [at.x, at.y]);
        polygons && (self.enclosure.polygons.iter().any(left) || self.enclosure.zones.iter().any(entered))
            || ceiling_m.is_some_and(|m| above_home_m > m)
    }

    /// FENCE_TYPE, where the fence is on.
    fn fence_kinds(&self) -> i32 {
        match self.parameters.real("FENCE_ENABLE") {
            0.0 => 0,
            _ => self.parameters.real("FENCE_TYPE") as i32,
        }
    }

    /// ArduCopter's return stays FENCE_MARGIN below its ceiling.
    pub(super) fn highest_return_m(&self) -> Option<f64> {
        let real = |name: &str| f64::from(self.parameters.real(name));
        let has_ceiling = self.firmware == Firmware::ArduCopter && self.fence_kinds() & CEILING != 0;
        has_ceiling.then(|| real("FENCE_ALT_MAX") - real("FENCE_MARGIN"))
    }

    fn act_at_the_fence(&mut self, sensed: &Sensed, router: &mut Router) {
        if [Mode::ReturnToLaunch, Mode::Land].contains(&self.mode) {
            return;
        }
        let (action, text) = match self.firmware {
            Firmware::Px4 => {
                let action = match self.parameters.real("GF_ACTION") as i32 {
                    0 => return,
                    2 => Action::Go(Mode::Hold),
                    3 => Action::Go(Mode::ReturnToLaunch),
                    4 => return self.terminate("Geofence violation, terminating", router),
                    5 => Action::Go(Mode::Land),
                    _ => Action::Nothing,
                };
                (action, "Geofence violation")
            }
            Firmware::ArduCopter => {
                let far = self.enclosure.polygons.iter().any(|polygon| {
                    let at = [sensed.position_enu_m.x, sensed.position_enu_m.y];
                    !encloses(polygon, at) && distance_m(polygon, at) > GIVES_UP_M
                });
                let action = match self.parameters.real("FENCE_ACTION") as i32 {
                    0 => Action::Nothing,
                    2 => Action::Go(Mode::Land),
                    _ if far => Action::Go(Mode::Land),
                    4 => Action::Go(Mode::Brake),
                    _ => Action::Go(Mode::ReturnToLaunch),
                };
                (action, "Fence Breached")
            }
        };
        if action == Action::Nothing {
            return self.text(MavSeverity::MAV_SEVERITY_CRITICAL, text, router);
        }
        self.fall_back(action, text, sensed, router);
    }

    /// Where the return goes: to the rally point, if there is one that is nearer than home.
    pub(super) fn return_point(&self, here: Vector3<f64>) -> Vector3<f64> {
        let rally = self.plans.rally().iter().map(|item| place(item, &self.frame));
        let points = rally.map(|[x, y]| Vector3::new(x, y, self.home_enu_m.z));
        let away = |point: &Vector3<f64>| (point - here).xy().norm();
        points.fold(self.home_enu_m, |best, point| if away(&point) < away(&best) { point } else { best })
    }
}

/// Where an item lies in the mission's plane.
fn place(item: &MISSION_ITEM_INT_DATA, frame: &LocalFrame) -> [f64; 2] {
    let point = crate::geodesy::Origin::from_wire(item.x, item.y, 0);
    let enu = frame.position_to_enu(frame.ned_of(point));
    [enu.x, enu.y]
}

/// The polygons of a list whose corners are given by `command`.
fn polygons(items: &[MISSION_ITEM_INT_DATA], command: MavCmd, frame: &LocalFrame) -> Vec<Vec<[f64; 2]>> {
    let mut all = Vec::new();
    let mut at = 0;
    while let Some(item) = items.get(at) {
        let is_polygon = matches!(
            item.command,
            MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
                | MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
        );
        let corners = if is_polygon { (item.param1 as usize).max(1) } else { 1 };
        if item.command == command
            && let Some(polygon) = items.get(at..at + corners)
        {
            all.push(polygon.iter().map(|corner| place(corner, frame)).collect());
        }
        at += corners;
    }
    all
}

/// By the number of sides that a ray to the north crosses.
fn encloses(polygon: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let next = polygon.iter().cycle().skip(1);
    let crossed = polygon
        .iter()
        .zip(next)
        .filter(|([ax, ay], [bx, by])| (*ax > x) != (*bx > x) && y < ay + (by - ay) * (x - ax) / (bx - ax));
    crossed.count() % 2 == 1
}

/// From the nearest side.
fn distance_m(polygon: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let next = polygon.iter().cycle().skip(1);
    let away = polygon.iter().zip(next).map(|([ax, ay], [bx, by])| {
        let (dx, dy) = (bx - ax, by - ay);
        let along = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy).max(1e-9)).clamp(0.0, 1.0);
        (x - ax - along * dx).hypot(y - ay - along * dy)
    });
    away.fold(f64::INFINITY, f64::min)
}
