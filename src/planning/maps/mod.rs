//! A mission and its plan, or a flight, as files of maps that people know: GeoJSON for geographic information systems, KML for
//! globes, and a QGroundControl plan for each vehicle.
//!
//! They are to be looked at, and say so. A companion flies by its mission file alone, which may have its area and no-fly areas
//! from such a file (`airspace.area_file`), and nothing else.

mod geojson;
mod kml;
mod qgc;

use serde::{Deserialize, Serialize};

use crate::config::Mission;
use crate::geo::{Enu, Geodetic};
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::{NoFly, Uncertainty};
use crate::planner::slots::Plan;
use crate::role::{PerVehicle, Role};

/// What a map shows. Positions are in the mission's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// The mission's name.
    pub name: String,
    /// The frame's origin; altitude above mean sea level.
    pub origin: Geodetic,
    /// Where vehicles may be.
    pub area: Option<Area>,
    /// Where in it no vehicle may be.
    pub no_fly: Vec<NoFlyArea>,
    /// Whom the mission serves.
    pub users: Vec<Node>,
    /// From whom it hides.
    pub eavesdroppers: Vec<Node>,
    /// Where the vehicles start, where that is known.
    pub homes: PerVehicle<Option<Enu>>,
    /// Poses and powers, in the order in which they are shown.
    pub slots: Vec<Slot>,
    /// Where the vehicles have been, if they have flown.
    pub tracks: PerVehicle<Vec<Enu>>,
}

/// Where vehicles may be.
#[derive(Debug, Clone, PartialEq)]
pub struct Area {
    /// East and north, in order, not closed.
    pub corners_m: Vec<[f64; 2]>,
    /// Lowest and highest, above the origin.
    pub altitude_m: [f64; 2],
}

/// Where no vehicle may be. A scene keeps it by the mission's own keys.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NoFlyArea {
    /// As in the mission.
    pub name: String,
    /// East and north, in order, not closed.
    #[serde(rename = "area_enu_m")]
    pub corners_m: Vec<[f64; 2]>,
    /// From this height above the origin; `None`: from the ground.
    pub floor_m: Option<f64>,
    /// Up to this one; `None`: to the sky.
    pub ceiling_m: Option<f64>,
}

impl NoFlyArea {
    /// Of a mission's.
    #[must_use]
    pub fn new(area: &NoFly) -> Self {
        Self {
            name: area.name.clone(),
            corners_m: area.area_enu_m.iter().map(|corner| [corner.x, corner.y]).collect(),
            floor_m: area.floor_m,
            ceiling_m: area.ceiling_m,
        }
    }

    /// Its heights in words.
    #[must_use]
    pub fn heights(&self) -> String {
        match (self.floor_m, self.ceiling_m) {
            (None, None) => "at all heights".to_owned(),
            (Some(floor_m), None) => format!("from {floor_m} m above the mission origin on"),
            (None, Some(ceiling_m)) => format!("up to {ceiling_m} m above the mission origin"),
            (Some(floor_m), Some(ceiling_m)) => {
                format!("from {floor_m} to {ceiling_m} m above the mission origin")
            }
        }
    }
}

/// A user or an eavesdropper.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// As in the mission.
    pub name: String,
    /// Where it is, as far as is known.
    pub at: Enu,
    /// It may be anywhere in a disc of this radius, metres.
    pub radius_m: Option<f64>,
    /// Standard deviation of its position in east and in north, metres.
    pub std_m: Option<f64>,
}

/// One slot's poses and powers.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// The user served.
    pub user: String,
    /// Seconds that the vehicles stay.
    pub length_s: Option<f64>,
    /// Poses and powers.
    pub vehicles: PerVehicle<VehiclePlan>,
}

impl Node {
    /// A node of a mission.
    #[must_use]
    pub fn new(name: &str, at: Enu, uncertainty: Uncertainty) -> Self {
        let (radius_m, std_m) = match uncertainty {
            Uncertainty::None => (None, None),
            Uncertainty::Disc { radius_m } => (Some(radius_m), None),
            Uncertainty::Gaussian { std_m } => (None, Some(std_m)),
        };
        Self { name: name.to_owned(), at, radius_m, std_m }
    }
}

impl Map {
    /// Of a mission and its plan; `None` where the mission has no origin, so that nothing of it lies anywhere on earth.
    #[must_use]
    pub fn of_plan(mission: &Mission, plan: &Plan) -> Option<Self> {
        let users = mission.users.iter().map(|u| Node::new(&u.name, u.position_enu_m, u.uncertainty));
        let eavesdroppers = mission.eavesdroppers.iter();
        mission.has_origin().then(|| Self {
            name: mission.name.clone(),
            origin: mission.origin,
            area: Some(Area {
                corners_m: mission.airspace.area_enu_m.iter().map(|corner| [corner.x, corner.y]).collect(),
                altitude_m: mission.airspace.altitude_m,
            }),
            no_fly: mission.airspace.no_fly.iter().map(NoFlyArea::new).collect(),
            users: users.collect(),
            eavesdroppers: eavesdroppers
                .map(|e| Node::new(&e.name, e.node.position_enu_m, e.node.uncertainty))
                .collect(),
            homes: mission.vehicles.map(|vehicle| vehicle.home_enu_m),
            slots: plan
                .slots
                .iter()
                .map(|slot| Slot {
                    user: slot.user.clone(),
                    length_s: Some(slot.length.map_or(mission.tdma.slot_s, |length| length.as_secs_f64())),
                    vehicles: slot.plan.vehicles,
                })
                .collect(),
            tracks: PerVehicle { i: Vec::new(), j: Vec::new() },
        })
    }

    /// The files, each with its name, which begins with `stem`.
    #[must_use]
    pub fn files(&self, stem: &str) -> Vec<(String, String)> {
        let mut files =
            vec![(format!("{stem}.geojson"), geojson::text(self)), (format!("{stem}.kml"), kml::text(self))];
        for role in Role::BOTH {
            files.push((format!("{stem}-{}.plan", role.key()), qgc::text(self, role)));
        }
        files
    }

    /// On earth, with the altitude above mean sea level.
    fn place(&self, at: &Enu) -> Geodetic {
        let place = Geodetic::from_enu(*at, self.origin);
        // A hundred-millionth of a degree is a millimetre, and a figure that can be read.
        let round = |value: f64, to: f64| (value * to).round() / to;
        Geodetic {
            lat_deg: round(place.lat_deg, 1e8),
            lon_deg: round(place.lon_deg, 1e8),
            alt_m: round(place.alt_m, 1e3),
        }
    }

    /// An area's corners on earth at an altitude above the origin, counter-clockwise, not closed.
    fn corners(&self, corners_m: &[[f64; 2]], up_m: f64) -> Vec<Geodetic> {
        let mut corners: Vec<Geodetic> =
            corners_m.iter().map(|[east, north]| self.place(&Enu::new(*east, *north, up_m))).collect();
        let next = corners_m.iter().cycle().skip(1);
        let twice: f64 = corners_m.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum();
        if twice < 0.0 {
            corners.reverse();
        }
        corners
    }
}
