//! Every setting of the mission file, declared once: key, kind, range, unit, default, sentence.

use std::f64::consts::PI;

use nalgebra::{Vector2, Vector3};

use super::kind::{Choice, Each, Flag, Integer, List, Moment, Number, Numbers, Text};
use super::mission::{Draft, Emission, PlannerSettings, Position, Tdma, VehicleSettings};
use super::reader::Section;
use crate::geo::{Enu, Geodetic};
use crate::planner::problem::{
    Airframe, Airspace, Jitter, JitterAxes, JitterModel, Method, Objective, Radio, Uncertainty,
};
use crate::role::PerVehicle;
use crate::schedule::order::Order;

/// Speed of light in m/s.
const C_M_S: f64 = 299_792_458.0;
/// How far from the origin anything may be, in metres: beyond, the mission's plane is no plane.
pub(super) const FAR_M: f64 = 50_000.0;

const HORIZONTAL: Number = Number::within("m", -FAR_M, FAR_M);
const HEIGHT: Number = Number::within("m", -1000.0, 10_000.0);
const POWER: Number = Number::within("W", 0.0, 1000.0);
const TILT: Number = Number::within("deg", 0.0, 90.0);
const POINT: Numbers<3> = Numbers([("east", HORIZONTAL), ("north", HORIZONTAL), ("up", HEIGHT)]);
const NAME: Text = Text { max_chars: 64 };
/// The words for planning methods, as in the mission file and on the command line.
pub const METHODS: &[(&str, Method)] = &[
    ("veilwing", Method::Veilwing),
    ("paper", Method::Paper),
    ("interior-point", Method::InteriorPoint),
    ("conventional", Method::Conventional),
    ("jammer-orientation", Method::JammerOrientation),
];

/// Reads, or describes, a whole mission file.
pub(super) fn describe(s: &mut Section<'_, '_>) -> Draft {
    let (name, seed, origin) = s.required_table("mission", "What the mission is and where.", identity);
    let emission = s.optional_table(
        "emission",
        "The permission to radiate. Without this table nothing but simulated transmitters may radiate.",
        emission,
    );
    let (radio, carrier_hz) = s.table("radio", "The link budget, the same for every link.", radio);
    let (airspace, airspace_max_tilt_rad) = s.table("airspace", "Where the vehicles may be.", airspace);
    let vehicles =
        s.table("vehicles", "What must be known of each vehicle to plan for it.", |s| PerVehicle {
            i: s.table("i", "Vehicle I, the information transmitter.", vehicle),
            j: s.table("j", "Vehicle J, the friendly jammer.", vehicle),
        });
    let jitter = s.table("jitter", "How steadily the vehicles hold their attitude.", jitter);
    let tdma = s.table("tdma", "The slot table: one user a slot.", tdma);
    let users = s.tables("user", "A ground user, served one a slot.", 1, |s, index| node(s, "user", index));
    let eavesdroppers =
        s.tables("eavesdropper", "A node that must not decode the users' traffic.", 1, |s, index| {
            let (name, position) = node(s, "eavesdropper", index);
            (name, position, uncertainty(s))
        });
    let planner = s.table("planner", "How each slot's poses and powers are found.", planner);
    Draft {
        name,
        seed,
        origin,
        emission,
        radio,
        carrier_hz,
        airspace,
        airspace_max_tilt_rad,
        vehicles,
        jitter,
        tdma,
        users,
        eavesdroppers,
        planner,
    }
}

fn identity(s: &mut Section<'_, '_>) -> (String, u64, Geodetic) {
    let name = s.read("name", "Name of the mission, for people.", NAME, "mission".to_owned());
    let seed = Integer { min: 0, max: i64::MAX.unsigned_abs() };
    let seed = s.read("seed", "Seed of everything random in planning: same mission, same plan.", seed, 7);
    let sentence = "Origin of the mission frame (ENU, WGS 84). Must be given, whole, once a node is placed by \
                    latitude and longitude or real transmitters may radiate.";
    let origin = s.table("origin", sentence, |s| Geodetic {
        lat_deg: s.read("lat_deg", "Latitude, north positive.", latitude(), 50.0755),
        lon_deg: s.read("lon_deg", "Longitude, east positive.", longitude(), 14.4378),
        alt_m: s.read("alt_amsl_m", "Altitude above mean sea level.", HEIGHT, 200.0),
    });
    (name, seed, origin)
}

const fn latitude() -> Number {
    // A tangent plane at a pole has no east.
    Number::within("deg", -89.0, 89.0)
}

const fn longitude() -> Number {
    Number::within("deg", -180.0, 180.0)
}

fn emission(s: &mut Section<'_, '_>) -> Emission {
    let hertz = Number::positive("Hz", 300e9);
    Emission {
        authorised_by: s
            .required("authorised_by", "Who permits the emission, and by what.", Text { max_chars: 200 })
            .unwrap_or_default(),
        band_hz: s
            .required(
                "band_hz",
                "Lowest and highest permitted frequency.",
                Numbers([("lowest", hertz), ("highest", hertz)]),
            )
            .unwrap_or([0.0; 2]),
        max_power_w: s.required("max_power_w", "Ceiling over every other power.", POWER).unwrap_or_default(),
    }
}

fn radio(s: &mut Section<'_, '_>) -> (Radio, Option<f64>) {
    let bandwidth_hz =
        s.read("bandwidth_hz", "Bandwidth of the user's channel.", Number::positive("Hz", 100e9), 1e6);
    let noise_power_w = s.read(
        "noise_power_w",
        "Noise power in that bandwidth, at the user and at every eavesdropper.",
        Number::within("W", 1e-30, 1.0),
        1e-12,
    );
    let max_power_w = s.read(
        "max_power_w",
        "Largest transmit power of each vehicle: a number for both, or { i = ..., j = ... }.",
        Each(POWER),
        PerVehicle { i: 0.5, j: 0.5 },
    );
    let reference_gain = s.read(
        "reference_gain",
        "Path gain at one metre in the antenna's plane of largest gain, linear; or give carrier_hz instead.",
        Number::within("", 1e-30, 1e6),
        1.0,
    );
    let carrier_hz = s.optional(
        "carrier_hz",
        "Carrier frequency: makes the reference gain (wavelength / 4 pi)^2 times the antenna gains.",
        Number::within("Hz", 1e6, 300e9),
    );
    let gain = Number::within("dBi", -30.0, 60.0);
    let tx_gain_dbi = s.read(
        "tx_gain_dbi",
        "Largest gain of the vehicles' antennas; 1.76 for a short dipole. Used with carrier_hz.",
        gain,
        0.0,
    );
    let rx_gain_dbi = s.read(
        "rx_gain_dbi",
        "Gain of the users' and eavesdroppers' antennas. Used with carrier_hz.",
        gain,
        0.0,
    );
    s.alternatives(&[&["reference_gain"], &["carrier_hz"]], false);
    let reference_gain = carrier_hz.map_or(reference_gain, |carrier_hz| {
        (C_M_S / carrier_hz / (4.0 * PI)).powi(2) * 10f64.powf((tx_gain_dbi + rx_gain_dbi) / 10.0)
    });
    (Radio { bandwidth_hz, noise_power_w, max_power_w, reference_gain }, carrier_hz)
}

fn airspace(s: &mut Section<'_, '_>) -> (Airspace, f64) {
    let altitude_m = s.read(
        "altitude_m",
        "Lowest and highest altitude of the vehicles above the mission origin.",
        Numbers([("lowest", HEIGHT), ("highest", HEIGHT)]),
        [80.0, 300.0],
    );
    let square = vec![[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]];
    let area = s.read(
        "area_enu_m",
        "Corners [east, north] of the area that binds the vehicles, in order, the last joining the first. Nodes may lie outside.",
        List { each: Numbers([("east", HORIZONTAL), ("north", HORIZONTAL)]), at_least: 3, at_most: 1000 },
        square,
    );
    let min_separation_m = s.read(
        "min_separation_m",
        "Least distance between the vehicles.",
        Number::within("m", 0.5, 1000.0),
        5.0,
    );
    let max_tilt_deg = s.read("max_tilt_deg", "Largest tilt of either vehicle from level.", TILT, 90.0);
    let area_enu_m = area.into_iter().map(Vector2::from).collect();
    (Airspace { altitude_m, area_enu_m, min_separation_m }, max_tilt_deg.to_radians())
}

fn vehicle(s: &mut Section<'_, '_>) -> VehicleSettings {
    let airframes =
        Choice(&[("omnidirectional", Airframe::Omnidirectional), ("conventional", Airframe::Conventional)]);
    VehicleSettings {
        airframe: s.read(
            "airframe",
            "\"omnidirectional\" tilts without moving; \"conventional\" stays level while it hovers.",
            airframes,
            Airframe::Omnidirectional,
        ),
        max_tilt_rad: s
            .read(
                "max_tilt_deg",
                "Largest tilt of this vehicle; the stricter of this and the airspace's holds.",
                TILT,
                90.0,
            )
            .to_radians(),
        speed_m_s: s.read("speed_m_s", "Horizontal speed in transit.", speed(), 8.0),
        climb_m_s: s.read("climb_m_s", "Vertical speed in transit.", climb(), 3.0),
        acceleration_m_s2: s.read(
            "acceleration_m_s2",
            "Acceleration in transit, in any direction.",
            Number::within("m/s^2", 0.1, 20.0),
            2.5,
        ),
        tilt_rate_rad_s: s
            .read("tilt_rate_deg_s", "How fast it turns its antenna.", tilt_rate(), 45.0)
            .to_radians(),
        home_enu_m: s
            .optional(
                "home_enu_m",
                "Where the simulated vehicle starts. A real one starts where it stands.",
                POINT,
            )
            .map(Enu::from),
    }
}

pub(super) const fn speed() -> Number {
    Number::within("m/s", 0.1, 50.0)
}

pub(super) const fn climb() -> Number {
    Number::within("m/s", 0.1, 30.0)
}

pub(super) const fn tilt_rate() -> Number {
    Number::within("deg/s", 1.0, 1000.0)
}

pub(super) const fn tilt() -> Number {
    TILT
}

pub(super) const fn power() -> Number {
    POWER
}

fn jitter(s: &mut Section<'_, '_>) -> Jitter {
    let std_deg = Number::within("deg", 0.0, 30.0);
    let models = Choice(&[("euler", JitterModel::Euler), ("body", JitterModel::Body)]);
    let axes = Choice(&[("roll-pitch", JitterAxes::RollPitch), ("roll-pitch-yaw", JitterAxes::RollPitchYaw)]);
    Jitter {
        std_rad: s.read("std_deg", "Standard deviation of each axis; 0 is none.", std_deg, 2.0).to_radians(),
        model: s.read(
            "model",
            "\"euler\" adds it to the Euler angles, as the paper does; \"body\" turns about the body axes, as a vehicle does.",
            models,
            JitterModel::Euler,
        ),
        axes: s.read("axes", "The axes that jitter.", axes, JitterAxes::RollPitch),
    }
}

fn tdma(s: &mut Section<'_, '_>) -> Tdma {
    let orders = Choice(&[("listed", Order::Listed), ("shortest", Order::Shortest)]);
    let superframes = s.read(
        "superframes",
        "How often the whole list of users is served.",
        Integer { min: 1, max: 1000 },
        1,
    );
    Tdma {
        slot_s: s.read(
            "slot_s",
            "Length of a slot, without the transit before it.",
            Number::within("s", 1.0, 86_400.0),
            20.0,
        ),
        guard_s: s.read(
            "guard_s",
            "The part of a slot in which nobody radiates, against clock error; half of it at each end.",
            Number::within("s", 0.0, 60.0),
            1.0,
        ),
        settle_s: s.read(
            "settle_s",
            "Time to come to rest and catch up after each transit.",
            Number::within("s", 0.0, 60.0),
            3.0,
        ),
        order: s.read(
            "order",
            "\"listed\": users as listed; \"shortest\": least transit.",
            orders,
            Order::Listed,
        ),
        superframes: u16::try_from(superframes).unwrap_or(u16::MAX),
        start_utc: s.optional(
            "start_utc",
            "When the transit to the first slot begins; the vehicles take off by themselves in time. Unset: on MISSION_START.",
            Moment,
        ),
    }
}

/// A user or an eavesdropper: its name and position.
fn node(s: &mut Section<'_, '_>, kind: &str, index: usize) -> (String, Position) {
    let unnamed = format!("{kind}-{}", index + 1);
    let name = s.read("name", "Unique name. By default the kind and the number in the list.", NAME, unnamed);
    let enu = s.optional("enu_m", "Position [east, north, up] from the mission origin.", POINT);
    let lat_deg =
        s.optional("lat_deg", "Latitude, north positive; with lon_deg, instead of enu_m.", latitude());
    let lon_deg =
        s.optional("lon_deg", "Longitude, east positive; with lat_deg, instead of enu_m.", longitude());
    let alt_m = s.optional(
        "alt_m",
        "Altitude above the mission origin, with lat_deg and lon_deg; 0 if not given.",
        HEIGHT,
    );
    s.alternatives(&[&["enu_m"], &["lat_deg", "lon_deg"]], true);
    s.excludes("alt_m", "enu_m");
    let position = match (enu, lat_deg, lon_deg) {
        (None, Some(lat_deg), Some(lon_deg)) => {
            Position::Geodetic(Geodetic { lat_deg, lon_deg, alt_m: alt_m.unwrap_or(0.0) })
        }
        (enu, _, _) => Position::Enu(enu.map_or_else(Vector3::zeros, Enu::from)),
    };
    (name, position)
}

fn uncertainty(s: &mut Section<'_, '_>) -> Uncertainty {
    let metres = Number::within("m", 0.0, 10_000.0);
    let radius_m = s.optional(
        "radius_m",
        "The position is anywhere in a horizontal disc of this radius; 0 is exact.",
        metres,
    );
    let std_m = s.optional(
        "std_m",
        "The position is Gaussian with this deviation in east and in north; 0 is exact.",
        metres,
    );
    s.alternatives(&[&["radius_m"], &["std_m"]], false);
    match (radius_m.filter(|radius| *radius > 0.0), std_m.filter(|std| *std > 0.0)) {
        (Some(radius_m), _) => Uncertainty::Disc { radius_m },
        (None, Some(std_m)) => Uncertainty::Gaussian { std_m },
        (None, None) => Uncertainty::None,
    }
}

fn planner(s: &mut Section<'_, '_>) -> PlannerSettings {
    let objectives = Choice(&[
        ("nominal", Objective::Nominal),
        ("mean", Objective::Mean),
        ("quantile", Objective::Quantile),
        ("worst-case", Objective::WorstCase),
    ]);
    PlannerSettings {
        method: s.read(
            "method",
            "The planning method; the others than \"veilwing\" are the paper's.",
            Choice(METHODS),
            Method::Veilwing,
        ),
        objective: s.read(
            "objective",
            "Over uncertain positions: at the estimates, the mean, the 5% quantile, or the worst case.",
            objectives,
            Objective::Mean,
        ),
        free_yaw: s.read("free_yaw", "Plan the yaw too, instead of 0.", Flag, false),
    }
}
