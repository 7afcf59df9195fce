//! What can be wrong with a transit.

use crate::geo::polygon::{MAX_COORDINATE_M, PolygonError};
use crate::role::Role;
use crate::schedule::trajectory::LIMIT_RANGE;

/// Why there is no transit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TransitError {
    /// The area is no geofence.
    #[error(transparent)]
    Fence(#[from] PolygonError),
    /// The altitude band is empty or beyond [`MAX_COORDINATE_M`], or the separation is no distance.
    #[error(
        "altitude band {low_m} m to {high_m} m with a separation of {separation_m} m: give a rising finite band and a separation of 0 or more"
    )]
    Airspace {
        /// Lower end in metres.
        low_m: f64,
        /// Upper end in metres.
        high_m: f64,
        /// `min_separation_m`.
        separation_m: f64,
    },
    /// A limit is outside [`LIMIT_RANGE`].
    #[error("vehicle {role}: {key} is {value}; give a number from {} to {}", LIMIT_RANGE.start(), LIMIT_RANGE.end())]
    Limit {
        /// Whose.
        role: Role,
        /// Which.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// A position or attitude is not finite, or beyond [`MAX_COORDINATE_M`].
    #[error("vehicle {role}: the {end} is not finite or more than {MAX_COORDINATE_M:e} m away")]
    NotUsable {
        /// Whose.
        role: Role,
        /// Which end.
        end: End,
    },
    /// An end is outside the geofence or the altitude band.
    #[error(
        "vehicle {role}: the {end} ({east_m:.2}, {north_m:.2}, {up_m:.2}) is {outside_m:.2} m outside the airspace, allowed are {allowed_m} m: move it, or enlarge [airspace]"
    )]
    Outside {
        /// Whose.
        role: Role,
        /// Which end.
        end: End,
        /// East, metres.
        east_m: f64,
        /// North, metres.
        north_m: f64,
        /// Up, metres.
        up_m: f64,
        /// Distance to the airspace in metres.
        outside_m: f64,
        /// How far it may be outside.
        allowed_m: f64,
    },
    /// An end is inside a no-fly area.
    #[error(
        "vehicle {role}: the {end} ({east_m:.2}, {north_m:.2}, {up_m:.2}) is {outside_m:.2} m inside the no-fly area {area:?}, allowed are {allowed_m} m: move it, or change the area in [[airspace.no_fly]]"
    )]
    NoFly {
        /// Whose.
        role: Role,
        /// Which end.
        end: End,
        /// The area's name.
        area: String,
        /// East, metres.
        east_m: f64,
        /// North, metres.
        north_m: f64,
        /// Up, metres.
        up_m: f64,
        /// Distance to where it may be, in metres.
        outside_m: f64,
        /// How far it may be inside.
        allowed_m: f64,
    },
    /// The no-fly areas cover all of the airspace, or one of them, or the geofence, crosses itself.
    #[error(
        "the {areas} no-fly areas leave nothing of the airspace, or one of them crosses itself: change [[airspace.no_fly]]"
    )]
    NothingLeft {
        /// How many there are.
        areas: usize,
    },
    /// No-fly areas leave no way between a vehicle's ends.
    #[error(
        "vehicle {role}: no way past the no-fly area{} {}, neither round nor over nor under: leave room beside, or give a floor_m or ceiling_m in [[airspace.no_fly]]", if .areas.len() == 1 { "" } else { "s" }, quoted(.areas)
    )]
    Barred {
        /// Whose.
        role: Role,
        /// The names of those on the straight way.
        areas: Vec<String>,
    },
    /// A vehicle would climb from its home, or land there, through a no-fly area.
    #[error(
        "vehicle {role}: its home ({east_m:.2}, {north_m:.2}) lies in or under the no-fly area {area:?}, through which it would climb and land: move the vehicle, or change the area in [[airspace.no_fly]]"
    )]
    HomeBarred {
        /// Whose.
        role: Role,
        /// The area's name.
        area: String,
        /// East, metres.
        east_m: f64,
        /// North, metres.
        north_m: f64,
    },
    /// Both vehicles' starts or goals are too close to each other.
    #[error(
        "the vehicles are {distance_m:.2} m apart at the {end}, needed are {needed_m:.2} m: move one, or lower airspace.min_separation_m"
    )]
    TooClose {
        /// Which ends.
        end: End,
        /// How far apart they are.
        distance_m: f64,
        /// How far apart they must be.
        needed_m: f64,
    },
    /// The geofence has no way between a vehicle's ends: it crosses itself.
    #[error("vehicle {role}: no way inside the geofence: does airspace.area_enu_m cross itself?")]
    NoPath {
        /// Whose.
        role: Role,
    },
    /// Neither paths apart nor any order of moves was found.
    #[error(
        "no transit keeps {clearance_m:.2} m between the vehicles ({direct_m:.2} m on the direct paths), not even one after the other: widen the airspace or lower airspace.min_separation_m"
    )]
    NoWay {
        /// What was to be kept.
        clearance_m: f64,
        /// Distance between the direct paths.
        direct_m: f64,
    },
}

/// Names as a message lists them.
fn quoted(names: &[String]) -> String {
    names.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ")
}

/// An end of a transit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Where it starts.
    Start,
    /// Where it leads.
    Goal,
}

impl std::fmt::Display for End {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Start => "start",
            Self::Goal => "goal",
        })
    }
}
