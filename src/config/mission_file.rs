//! Every setting of the mission file, declared once: key, kind, range, unit, default, sentence.

use nalgebra::Vector2;

use super::area_file::AreaFile;
use super::draft::{
    Emission, JitterDraft, MissionDraft, Mode, MovesDraft, NoFlyDraft, NodeDraft, Optimise,
    PlannedVehicleDraft, PlannerSettings, RadioDraft, Tdma,
};
use super::kind::{
    Choice, Each, FieldFile, Flag, ID, Integer, List, Moment, Number, Numbers, Period, Text, byte,
};
use super::link_file;
use super::reader::Section;
use crate::geo::{Enu, Geodetic};
use crate::planner::following::Gait;
use crate::planner::problem::{Airframe, JitterAxes, JitterModel, Method, Objective};
use crate::planner::volume::Fairness;
use crate::role::PerVehicle;
use crate::schedule::order::Order;

/// How far from the origin anything may be, in metres: beyond, the mission's plane is no plane.
pub(super) const FAR_M: f64 = 50_000.0;

const HORIZONTAL: Number = Number::within("m", -FAR_M, FAR_M);
const HEIGHT: Number = Number::within("m", -1000.0, 10_000.0);
const POWER: Number = Number::within("W", 0.0, 1000.0);
const TILT: Number = Number::within("deg", 0.0, 90.0);
const POINT: Numbers<3> = Numbers([("east", HORIZONTAL), ("north", HORIZONTAL), ("up", HEIGHT)]);
const NAME: Text = Text { max_chars: 64 };
/// The origin where a mission gives none: nothing real may rest on it.
pub(super) const NOWHERE: Geodetic = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };
/// The words for planning methods, as in the mission file and on the command line.
pub const METHODS: &[(&str, Method)] = &[
    ("veilwing", Method::Veilwing),
    ("paper", Method::Paper),
    ("interior-point", Method::InteriorPoint),
    ("interior-point-multi-start", Method::InteriorPointMultiStart),
    ("conventional", Method::Conventional),
    ("conventional-multi-start", Method::ConventionalMultiStart),
    ("jammer-orientation", Method::JammerOrientation),
];

/// Reads, or checks, or describes, a whole mission file.
pub(super) fn describe(s: &mut Section<'_, '_>, draft: &mut MissionDraft) {
    s.required_table("mission", "What the mission is and where.", |s| identity(s, draft));
    s.set_optional_table(
        "emission",
        "The permission to radiate. Without this table nothing but simulated transmitters may radiate.",
        &mut draft.emission,
        emission,
    );
    s.table("radio", "The link budget, the same for every link.", |s| radio(s, &mut draft.radio));
    let mut field = None;
    s.table("airspace", "Where the vehicles may be.", |s| {
        let sentence = "The area, its no-fly areas and homes that are not given here, from a QGroundControl plan or a GeoJSON \
                        file, by its path from this file.";
        field = s.set_file("area_file", sentence, FieldFile { directory: s.directory() });
        airspace(s, draft, field.as_ref());
    });
    let homes = field.map_or_else(PerVehicle::default, |field| field.homes);
    s.table("vehicles", "What must be known of each vehicle to plan for it.", |s| {
        let vehicles = &mut draft.vehicles;
        s.table("i", "Vehicle I, the information transmitter.", |s| vehicle(s, &mut vehicles.i, homes.i));
        s.table("j", "Vehicle J, the friendly jammer.", |s| vehicle(s, &mut vehicles.j, homes.j));
    });
    s.table("jitter", "How steadily the vehicles hold their attitude.", |s| jitter(s, &mut draft.jitter));
    link_file::describe(s, draft);
    s.table("tdma", "The slot table: one user a slot.", |s| tdma(s, &mut draft.tdma));
    s.set_tables("user", "A ground user, served one a slot.", 1, &mut draft.users, unnamed("user"), node);
    s.set_tables(
        "eavesdropper",
        "A node that must not decode the users' traffic.",
        1,
        &mut draft.eavesdroppers,
        unnamed("eavesdropper"),
        node,
    );
    s.table("planner", "How each slot's poses and powers are found.", |s| planner(s, &mut draft.planner));
}

/// Where errors about what a file has drawn point.
const AREA_FILE: &str = "airspace.area_file";

/// The no-fly areas of the mission, and after them those of a file.
fn no_fly_areas(s: &mut Section<'_, '_>, areas: &mut Vec<NoFlyDraft>, field: Option<&AreaFile>) {
    s.set_tables(
        "no_fly",
        "A part of the area in which no vehicle may be.",
        0,
        areas,
        |index| NoFlyDraft { name: format!("no-fly-{}", index + 1), ..NoFlyDraft::default() },
        no_fly,
    );
    for area in field.into_iter().flat_map(|field| &field.no_fly) {
        let path = |key: &str| format!("no_fly[{}].{key}", areas.len());
        s.record_of_file(AREA_FILE, &path("name"), &NAME, &area.name);
        if let Some(corners) = &area.area_lat_lon {
            s.record_of_file(AREA_FILE, &path("area_lat_lon"), &corners_lat_lon(), corners);
        }
        for (key, height) in [("floor_m", area.floor_m), ("ceiling_m", area.ceiling_m)] {
            if let Some(height_m) = height {
                s.record_of_file(AREA_FILE, &path(key), &HEIGHT, &height_m);
            }
        }
        areas.push(area.clone());
    }
}

fn identity(s: &mut Section<'_, '_>, draft: &mut MissionDraft) {
    s.set("name", "Name of the mission, for people.", NAME, &mut draft.name);
    let seed = Integer { min: 0, max: i64::MAX.unsigned_abs() };
    s.set("seed", "Seed of everything random in planning: same mission, same plan.", seed, &mut draft.seed);
    let sentence = "Origin of the mission frame (ENU, WGS 84). Must be given, whole, once a node is placed by \
                    latitude and longitude or real transmitters may radiate.";
    if draft.origin.is_some() {
        s.present("origin");
    }
    let mut origin = draft.origin.unwrap_or(NOWHERE);
    s.table("origin", sentence, |s| {
        s.set("lat_deg", "Latitude, north positive.", latitude(), &mut origin.lat_deg);
        s.set("lon_deg", "Longitude, east positive.", longitude(), &mut origin.lon_deg);
        s.set("alt_amsl_m", "Altitude above mean sea level.", HEIGHT, &mut origin.alt_m);
        for part in ["lat_deg", "lon_deg", "alt_amsl_m"] {
            s.present(part);
        }
    });
    draft.origin = s.given("origin").then_some(origin);
}

const fn latitude() -> Number {
    // A tangent plane at a pole has no east.
    Number::within("deg", -89.0, 89.0)
}

const fn longitude() -> Number {
    Number::within("deg", -180.0, 180.0)
}

fn emission(s: &mut Section<'_, '_>, emission: &mut Emission) {
    let hertz = Number::positive("Hz", 300e9);
    s.set_required(
        "authorised_by",
        "Who permits the emission, and by what.",
        Text { max_chars: 200 },
        &mut emission.authorised_by,
    );
    s.set_required(
        "band_hz",
        "Lowest and highest permitted frequency.",
        Numbers([("lowest", hertz), ("highest", hertz)]),
        &mut emission.band_hz,
    );
    s.set_required("max_power_w", "Ceiling over every other power.", POWER, &mut emission.max_power_w);
    let text = || Text { max_chars: 200 };
    s.set_optional("licensee", "To whom the permission was given.", text(), &mut emission.licensee);
    s.set_optional("licence", "The permission's number, or its name.", text(), &mut emission.licence);
    s.set_optional(
        "valid",
        "From when and until when the permission holds. Nothing real is radiated without it, before, after, or by a mission \
         that does not end in time.",
        Period,
        &mut emission.valid,
    );
    s.set_optional("site", "Where the permission holds, for people.", text(), &mut emission.site);
}

fn radio(s: &mut Section<'_, '_>, radio: &mut RadioDraft) {
    s.set(
        "bandwidth_hz",
        "Bandwidth of the user's channel.",
        Number::positive("Hz", 100e9),
        &mut radio.bandwidth_hz,
    );
    s.set(
        "noise_power_w",
        "Noise power in that bandwidth, at the user and at every eavesdropper.",
        Number::within("W", 1e-30, 1.0),
        &mut radio.noise_power_w,
    );
    s.set(
        "max_power_w",
        "Largest transmit power of each vehicle: a number for both, or { i = ..., j = ... }.",
        Each(POWER),
        &mut radio.max_power_w,
    );
    s.set(
        "reference_gain",
        "Path gain at one metre in the antenna's plane of largest gain, linear; or give carrier_hz instead.",
        Number::within("", 1e-30, 1e6),
        &mut radio.reference_gain,
    );
    s.set_optional(
        "carrier_hz",
        "Carrier frequency: makes the reference gain (wavelength / 4 pi)^2 times the antenna gains.",
        Number::within("Hz", 1e6, 300e9),
        &mut radio.carrier_hz,
    );
    let gain = Number::within("dBi", -30.0, 60.0);
    s.set(
        "tx_gain_dbi",
        "Largest gain of the vehicles' antennas; 1.76 for a short dipole. Used with carrier_hz.",
        gain,
        &mut radio.tx_gain_dbi,
    );
    s.set(
        "rx_gain_dbi",
        "Gain of the users' and eavesdroppers' antennas. Used with carrier_hz.",
        gain,
        &mut radio.rx_gain_dbi,
    );
    s.alternatives(&[&["reference_gain"], &["carrier_hz"]], false);
}

fn airspace(s: &mut Section<'_, '_>, draft: &mut MissionDraft, field: Option<&AreaFile>) {
    let (airspace, area_lat_lon) = (&mut draft.airspace, &mut draft.area_lat_lon);
    s.set(
        "altitude_m",
        "Lowest and highest altitude of the vehicles above the mission origin.",
        Numbers([("lowest", HEIGHT), ("highest", HEIGHT)]),
        &mut airspace.altitude_m,
    );
    let (east_north, lat_lon) = (corners_enu(), corners_lat_lon());
    let mut area: Vec<[f64; 2]> = airspace.area_enu_m.iter().map(|corner| (*corner).into()).collect();
    s.set(
        "area_enu_m",
        "Corners [east, north] of the area that binds the vehicles, in order, the last joining the first. Nodes may lie outside.",
        east_north,
        &mut area,
    );
    airspace.area_enu_m = area.into_iter().map(Vector2::from).collect();
    s.set_optional(
        "area_lat_lon",
        "The same by [latitude, longitude], north and east positive, instead of area_enu_m.",
        lat_lon,
        area_lat_lon,
    );
    if let Some(field) = field.filter(|_| !s.given("area_enu_m") && !s.given("area_lat_lon")) {
        s.record_of_file(AREA_FILE, "area_lat_lon", &corners_lat_lon(), &field.area);
        *area_lat_lon = Some(field.area.clone());
    }
    s.alternatives(&[&["area_enu_m"], &["area_lat_lon"], &["area_file"]], false);
    s.set(
        "min_separation_m",
        "Least distance between the vehicles.",
        Number::within("m", 0.5, 1000.0),
        &mut airspace.min_separation_m,
    );
    let tilt = "Largest tilt of either vehicle from level.";
    s.set("max_tilt_deg", tilt, TILT, &mut draft.airspace_max_tilt_deg);
    no_fly_areas(s, &mut draft.no_fly, field);
}

fn corners_enu() -> List<Numbers<2>> {
    List { each: Numbers([("east", HORIZONTAL), ("north", HORIZONTAL)]), at_least: 3, at_most: 1000 }
}

fn corners_lat_lon() -> List<Numbers<2>> {
    List { each: Numbers([("latitude", latitude()), ("longitude", longitude())]), at_least: 3, at_most: 1000 }
}

fn no_fly(s: &mut Section<'_, '_>, area: &mut NoFlyDraft) {
    s.set("name", "Unique name. By default no-fly- and the number in the list.", NAME, &mut area.name);
    s.set_optional(
        "area_enu_m",
        "Its corners [east, north], in order, the last joining the first; they may lie outside the airspace's area.",
        corners_enu(),
        &mut area.area_enu_m,
    );
    s.set_optional(
        "area_lat_lon",
        "The same by [latitude, longitude], north and east positive, instead of area_enu_m.",
        corners_lat_lon(),
        &mut area.area_lat_lon,
    );
    s.alternatives(&[&["area_enu_m"], &["area_lat_lon"]], true);
    s.set_optional(
        "floor_m",
        "From this altitude above the mission origin on it is forbidden; without it from the ground.",
        HEIGHT,
        &mut area.floor_m,
    );
    s.set_optional(
        "ceiling_m",
        "Up to this altitude above the mission origin it is forbidden; without it to the sky.",
        HEIGHT,
        &mut area.ceiling_m,
    );
}

/// A home that a file has drawn: latitude and longitude, and its height if that is said.
type DrawnHome = Option<([f64; 2], Option<f64>)>;

fn vehicle(s: &mut Section<'_, '_>, vehicle: &mut PlannedVehicleDraft, drawn: DrawnHome) {
    let airframes =
        Choice(&[("omnidirectional", Airframe::Omnidirectional), ("conventional", Airframe::Conventional)]);
    s.set(
        "airframe",
        "\"omnidirectional\" tilts without moving; \"conventional\" stays level while it hovers, but for what it leans in the wind.",
        airframes,
        &mut vehicle.airframe,
    );
    s.set(
        "max_tilt_deg",
        "Largest tilt of this vehicle; the stricter of this and the airspace's holds.",
        TILT,
        &mut vehicle.max_tilt_deg,
    );
    s.set("speed_m_s", "Horizontal speed in transit.", speed(), &mut vehicle.speed_m_s);
    s.set("climb_m_s", "Vertical speed in transit.", climb(), &mut vehicle.climb_m_s);
    s.set(
        "acceleration_m_s2",
        "Acceleration in transit, in any direction.",
        Number::within("m/s^2", 0.1, 20.0),
        &mut vehicle.acceleration_m_s2,
    );
    s.set(
        "jerk_m_s3",
        "Change of acceleration in transit. No more than what the autopilot lets through: ArduCopter's PSC_JERK_XY is 5.",
        Number::within("m/s^3", 0.1, 1000.0),
        &mut vehicle.jerk_m_s3,
    );
    s.set("tilt_rate_deg_s", "How fast it turns its antenna.", tilt_rate(), &mut vehicle.tilt_rate_deg_s);
    place(
        s,
        "home_enu_m",
        "Where the simulated vehicle starts. A real one starts where it stands.",
        &mut vehicle.home_enu_m,
    );
    let lat_lon = Numbers([("latitude", latitude()), ("longitude", longitude())]);
    let drawn = drawn.filter(|_| vehicle.home_enu_m.is_none() && !s.given("home_lat_lon"));
    s.set_optional(
        "home_lat_lon",
        "The same by [latitude, longitude], north and east positive, instead of home_enu_m.",
        lat_lon,
        &mut vehicle.home_lat_lon,
    );
    if let Some((home, _)) = &drawn {
        let lat_lon = Numbers([("latitude", latitude()), ("longitude", longitude())]);
        s.record_of_file(AREA_FILE, "home_lat_lon", &lat_lon, home);
        vehicle.home_lat_lon = Some(*home);
    }
    s.set_optional(
        "home_alt_m",
        "Its altitude above the mission origin, with home_lat_lon; 0 if not given.",
        HEIGHT,
        &mut vehicle.home_alt_m,
    );
    if let Some((_, Some(up_m))) = &drawn
        && vehicle.home_alt_m.is_none()
    {
        s.record_of_file(AREA_FILE, "home_alt_m", &HEIGHT, up_m);
        vehicle.home_alt_m = Some(*up_m);
    }
    s.alternatives(&[&["home_enu_m"], &["home_lat_lon"]], false);
    s.excludes("home_alt_m", "home_enu_m");
    link_file::powers(s, vehicle);
}

/// A position in the mission frame, which may be left unset.
fn place(s: &mut Section<'_, '_>, key: &'static str, sentence: &str, position: &mut Option<Enu>) {
    let mut point = position.map(<[f64; 3]>::from);
    s.set_optional(key, sentence, POINT, &mut point);
    *position = point.map(Enu::from);
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

fn jitter(s: &mut Section<'_, '_>, jitter: &mut JitterDraft) {
    let std_deg = Number::within("deg", 0.0, 30.0);
    let models = Choice(&[("euler", JitterModel::Euler), ("body", JitterModel::Body)]);
    let axes = Choice(&[("roll-pitch", JitterAxes::RollPitch), ("roll-pitch-yaw", JitterAxes::RollPitchYaw)]);
    s.set("std_deg", "Standard deviation of each axis; 0 is none.", std_deg, &mut jitter.std_deg);
    s.set(
        "model",
        "\"euler\" adds it to the Euler angles, as the paper does; \"body\" turns about the body axes, as a vehicle does.",
        models,
        &mut jitter.model,
    );
    s.set("axes", "The axes that jitter.", axes, &mut jitter.axes);
}

fn tdma(s: &mut Section<'_, '_>, tdma: &mut Tdma) {
    let orders = Choice(&[("listed", Order::Listed), ("shortest", Order::Shortest)]);
    let mut superframes = u64::from(tdma.superframes);
    s.set(
        "superframes",
        "How often the whole list of users is served.",
        Integer { min: 1, max: 1000 },
        &mut superframes,
    );
    tdma.superframes = u16::try_from(superframes).unwrap_or(u16::MAX);
    s.set(
        "slot_s",
        "Length of a slot, without the transit before it.",
        Number::within("s", 1.0, 86_400.0),
        &mut tdma.slot_s,
    );
    s.set(
        "guard_s",
        "The part of a slot in which nobody radiates, against clock error; half of it at each end.",
        Number::within("s", 0.0, 60.0),
        &mut tdma.guard_s,
    );
    s.set(
        "settle_s",
        "Time to come to rest and catch up after each transit.",
        Number::within("s", 0.0, 60.0),
        &mut tdma.settle_s,
    );
    let length = || Number::within("s", 1.0, 86_400.0);
    s.set_optional(
        "slot_min_s",
        "The shortest slot, where fairness is \"max-min\". By default half of slot_s.",
        length(),
        &mut tdma.slot_min_s,
    );
    s.set_optional(
        "slot_max_s",
        "The longest slot, where fairness is \"max-min\"; slots are no longer than slot_s on average. By default twice slot_s.",
        length(),
        &mut tdma.slot_max_s,
    );
    s.set("order", "\"listed\": users as listed; \"shortest\": least transit.", orders, &mut tdma.order);
    s.set_optional(
        "wait_for_peer_s",
        "How long a vehicle in the air that does not hear the other waits for it, silent, before it goes home. By default 3.",
        Number::within("s", 3.0, 60.0),
        &mut tdma.wait_for_peer_s,
    );
    s.set_optional(
        "start_utc",
        "When the transit to the first slot begins; the vehicles take off by themselves in time. Unset: on MISSION_START.",
        Moment,
        &mut tdma.start_utc,
    );
}

/// A node before its table is read: the kind and the number in the list are its name.
fn unnamed(kind: &str) -> impl Fn(usize) -> NodeDraft {
    move |index| NodeDraft::unplaced(format!("{kind}-{}", index + 1))
}

/// A user or an eavesdropper: its name and position.
fn node(s: &mut Section<'_, '_>, node: &mut NodeDraft) {
    s.set("name", "Unique name. By default the kind and the number in the list.", NAME, &mut node.name);
    place(s, "enu_m", "Position [east, north, up] from the mission origin.", &mut node.enu_m);
    s.set_optional(
        "lat_deg",
        "Latitude, north positive; with lon_deg, instead of enu_m.",
        latitude(),
        &mut node.lat_deg,
    );
    s.set_optional(
        "lon_deg",
        "Longitude, east positive; with lat_deg, instead of enu_m.",
        longitude(),
        &mut node.lon_deg,
    );
    s.set_optional(
        "alt_m",
        "Altitude above the mission origin, with lat_deg and lon_deg; 0 if not given.",
        HEIGHT,
        &mut node.alt_m,
    );
    s.alternatives(&[&["enu_m"], &["lat_deg", "lon_deg"]], true);
    s.excludes("alt_m", "enu_m");
    let metres = Number::within("m", 0.0, 10_000.0);
    s.set_optional(
        "radius_m",
        "The position is anywhere in a horizontal disc of this radius; 0 is exact.",
        metres,
        &mut node.radius_m,
    );
    s.set_optional(
        "std_m",
        "The position is Gaussian with this deviation in east and in north; 0 is exact.",
        metres,
        &mut node.std_m,
    );
    s.alternatives(&[&["radius_m"], &["std_m"]], false);
    let sentence = "It moves, and is followed while a slot is served: positions that it, or somebody who sees it, reports in flight.";
    s.set_optional_table("moves", sentence, &mut node.moves, moves);
}

fn moves(s: &mut Section<'_, '_>, moves: &mut MovesDraft) {
    let mut system = moves.system_id.map(u64::from);
    s.set_optional(
        "system_id",
        "MAVLink system on the autopilot's link whose GLOBAL_POSITION_INT or FOLLOW_TARGET says where it is; else an operator does.",
        ID,
        &mut system,
    );
    moves.system_id = system.map(byte);
    let gaits = Choice(&[("walks", Gait::Walks), ("drives", Gait::Drives)]);
    s.set("gait", "\"walks\", some 1.5 m/s; \"drives\", some 8 m/s.", gaits, &mut moves.gait);
    s.set(
        "std_m",
        "Standard deviation of a reported position in east and in north, where the report does not say.",
        Number::within("m", 0.1, 1000.0),
        &mut moves.std_m,
    );
}

fn planner(s: &mut Section<'_, '_>, planner: &mut PlannerSettings) {
    let objectives = Choice(&[
        ("nominal", Objective::Nominal),
        ("mean", Objective::Mean),
        ("quantile", Objective::Quantile),
        ("worst-case", Objective::WorstCase),
    ]);
    s.set(
        "method",
        "The planning method; the others than \"veilwing\" are the paper's.",
        Choice(METHODS),
        &mut planner.method,
    );
    s.set(
        "objective",
        "Over what stays wrong during a slot (positions, poses): with nothing wrong, the mean, the 5% quantile, or the worst case over the eavesdroppers' discs.",
        objectives,
        &mut planner.objective,
    );
    s.set_newer(
        "optimise",
        "\"rate\": each slot's rate, by itself; \"volume\": what is delivered over a superframe, transits included.",
        Choice(&[("rate", Optimise::Rate), ("volume", Optimise::Volume)]),
        &Optimise::default(),
        &mut planner.optimise,
    );
    s.set_newer(
        "mode",
        "What a vehicle may do while it radiates: hold its pose (\"static\"), turn from one user to the next (\"turning\"), or move as well (\"moving\").",
        Choice(&[("static", Mode::Static), ("turning", Mode::Turning), ("moving", Mode::Moving)]),
        &Mode::default(),
        &mut planner.mode,
    );
    s.set_newer(
        "fairness",
        "Of a volume: \"slots\" are equal and the sum counts, or \"max-min\": the least-served user counts, slots as long as that asks for.",
        Choice(&[("slots", Fairness::Slots), ("max-min", Fairness::MaxMin)]),
        &Fairness::default(),
        &mut planner.fairness,
    );
    s.set_newer(
        "replan",
        "Make the plan anew in flight, between two slots, where vehicles jitter otherwise than stated, or the wind leaves them less speed.",
        Flag,
        &false,
        &mut planner.replan,
    );
    s.set("free_yaw", "Plan the yaw too, instead of 0.", Flag, &mut planner.free_yaw);
    s.set_optional(
        "target_rate_bps",
        "A secrecy rate that is counted on, as by a code of fixed rate: plans say how likely a slot misses it.",
        Number::positive("bit/s", 1e15),
        &mut planner.target_rate_bps,
    );
}
