//! An item of a list that the autopilot keeps: a corner of its fence, or a rally point.

use mavlink::dialects::ardupilotmega::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionType};

use super::super::outbox::Address;
use crate::geo::Geodetic;

/// Items are equal whose latitudes and longitudes differ by at most so many units of 1e-7 deg (11 mm of latitude): an
/// autopilot that keeps them in floating point may round the last one.
const TOLERANCE_E7: u32 = 1;

/// A place by MAVLink's integers: latitude and longitude in 1e-7 deg.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub lat_e7: i32,
    pub lon_e7: i32,
}

impl Place {
    pub fn of(point: Geodetic) -> Self {
        let e7 = |deg: f64| (deg * 1e7).round() as i32;
        Self { lat_e7: e7(point.lat_deg), lon_e7: e7(point.lon_deg) }
    }

    fn is(self, other: Self) -> bool {
        self.lat_e7.abs_diff(other.lat_e7) <= TOLERANCE_E7
            && self.lon_e7.abs_diff(other.lon_e7) <= TOLERANCE_E7
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.7}, {:.7}", f64::from(self.lat_e7) * 1e-7, f64::from(self.lon_e7) * 1e-7)
    }
}

/// What an item says, as far as the two lists have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Item {
    pub command: MavCmd,
    /// Of a corner, how many there are.
    pub param1: f32,
    pub place: Place,
}

impl Item {
    /// As the autopilot says it.
    pub fn heard(message: &MISSION_ITEM_INT_DATA) -> Self {
        let place = Place { lat_e7: message.x, lon_e7: message.y };
        Self { command: message.command, param1: message.param1, place }
    }

    /// Whether this is what `other` says.
    pub fn is(&self, other: &Self) -> bool {
        let same_count = self.command == MavCmd::MAV_CMD_NAV_RALLY_POINT || self.param1 == other.param1;
        self.command == other.command && same_count && self.place.is(other.place)
    }

    /// The item as number `seq` of the list `kind`. A rally point's height is above home: none, so that the return crosses
    /// at the altitude that the autopilot's parameters say; ArduCopter takes it in this frame alone.
    pub fn message(&self, kind: MavMissionType, seq: u16, to: Address) -> MISSION_ITEM_INT_DATA {
        let frame = match kind {
            MavMissionType::MAV_MISSION_TYPE_RALLY => MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
            _ => MavFrame::MAV_FRAME_GLOBAL,
        };
        MISSION_ITEM_INT_DATA {
            param1: self.param1,
            x: self.place.lat_e7,
            y: self.place.lon_e7,
            seq,
            command: self.command,
            target_system: to.0,
            target_component: to.1,
            frame,
            autocontinue: 1,
            mission_type: kind,
            ..MISSION_ITEM_INT_DATA::DEFAULT
        }
    }
}

/// The fence: one polygon that everything has to stay in, then those that nothing may enter. Where the first is empty there
/// is none.
pub(super) fn fence(area: &[Geodetic], zones: &[Vec<Geodetic>]) -> Vec<Item> {
    let polygon = |command: MavCmd, corners: &[Geodetic]| {
        let param1 = corners.len() as f32;
        let item = |point: &Geodetic| Item { command, param1, place: Place::of(*point) };
        corners.iter().map(item).collect::<Vec<_>>()
    };
    let mut items = polygon(MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, area);
    if !items.is_empty() {
        let exclusion = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION;
        items.extend(zones.iter().flat_map(|zone| polygon(exclusion, zone)));
    }
    items
}

/// The only rally point.
pub(super) fn rally(home: Geodetic) -> Item {
    Item { command: MavCmd::MAV_CMD_NAV_RALLY_POINT, param1: 0.0, place: Place::of(home) }
}
