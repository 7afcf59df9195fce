//! What is legal in a mission file and dangerous to fly: mostly numbers in another unit than the key's, or in another frame.
//!
//! A warning does not keep a mission from being flown. So each says what is odd, by its number, and what was perhaps meant; and
//! none is given for what a mission may well be meant to be.

use super::document::Document;
use super::draft::{MissionDraft, NodeDraft, Position};
use super::mission_checks::{area_key, home_key};
use super::mission_file::NOWHERE;
use crate::geo::polygon::Polygon;
use crate::planner::problem::{Objective, Uncertainty};
use crate::role::Role;
use crate::time::Utc;
use crate::units::{Dbm, Watts};

/// Further from the area than this, in metres, hardly anybody is served or eavesdrops.
const FAR_M: f64 = 5_000.0;
/// An eavesdropper this near to a user hears what the user hears.
const BESIDE_M: f64 = 10.0;
/// A radio that a small vehicle carries gives less, in W.
const STRONG_W: f64 = 10.0;
/// An altitude is compared with the origin's from here on, in metres above the sea: lower, the two are alike anyway.
const HIGH_ORIGIN_M: f64 = 50.0;
/// A band that begins this far above the ground, in metres, is no usual one.
const HIGH_BAND_M: f64 = 120.0;
/// A home so far below the band is another place than the mission's.
const DEEP_HOME_M: f64 = 150.0;
/// Trees, masts and people are up to here.
const LOW_BAND_M: f64 = 8.0;
/// An angle that is meant in degrees is hardly less: 2 deg are 0.035 rad.
const SMALL_STD_DEG: f64 = 0.1;
/// 90 deg are 1.57 rad.
const SMALL_TILT_DEG: f64 = 2.0;
/// Faster is no multirotor's transit; 10 m/s are 36 km/h.
const FAST_M_S: f64 = 25.0;
/// Nearer, rotors' wash and the position's error decide whether two vehicles meet.
const CLOSE_M: f64 = 2.0;
/// An area less wide than this is given in another unit than metres.
const NARROW_M: f64 = 20.0;
/// Noise power density at 290 K, W/Hz.
const THERMAL_W_HZ: f64 = 1.380_649e-23 * 290.0;
/// So many times the thermal noise no receiver has of its own: 50 dB.
const NOISY: f64 = 1e5;
/// A channel is at least so wide, in Hz, and a band lies at least there.
const NARROW_HZ: f64 = 1e3;
const LOW_HZ: f64 = 1e6;
/// Nulls of antennas on vehicles are between these, in dB.
const NULL_DB: [f64; 2] = [6.0, 50.0];
/// No battery lifts a multirotor for longer, in s.
const LONG_S: f64 = 3_600.0;

/// Adds what is dangerous. Settings already refused are left out.
pub(super) fn check(draft: &MissionDraft, file: &mut Document) {
    origin(draft, file);
    let deep = !altitudes(draft, file);
    nodes(draft, file);
    homes(draft, deep, file);
    powers(draft, file);
    radio(draft, file);
    angles(draft, file);
    motion(draft, file);
    slots(draft, file);
    objective(draft, file);
}

/// What is odd about a start at `now`.
pub(super) fn of_start(start: Utc, now: Utc) -> Option<(String, String)> {
    (start < now).then(|| {
        let message = format!("`start_utc` is {start}, which has passed: it is {now}");
        let help = "give a start that is to come, with its offset from UTC (Z is none), or leave it out: then the \
                    operator starts the mission";
        (message, help.to_owned())
    })
}

/// What is odd about a permission at `now`.
pub(super) fn of_permission([_, until]: [Utc; 2], now: Utc) -> Option<(String, String)> {
    (until <= now).then(|| {
        let message =
            format!("the permission has expired at {until}: it is {now}, and nothing real may be radiated");
        (message, "give the permission that holds now".to_owned())
    })
}

fn warn(file: &mut Document, path: &str, message: String, help: impl Into<String>) {
    if file.sound(&[path]) {
        file.warning(file.at(path), message, help.into());
    }
}

fn origin(draft: &MissionDraft, file: &mut Document) {
    let Some(origin) = draft.origin else { return };
    if origin.lat_deg.abs() < 0.1 && origin.lon_deg.abs() < 0.1 {
        let message = format!(
            "the origin {}, {} lies in the sea south of Ghana: latitude and longitude were perhaps never filled in",
            origin.lat_deg, origin.lon_deg
        );
        warn(file, "mission.origin", message, "give lat_deg and lon_deg of the site");
    }
}

/// The origin's altitude, where it is high enough for a height above the sea to be told from one above the ground.
fn high_origin_m(draft: &MissionDraft) -> Option<f64> {
    draft.origin.map(|origin| origin.alt_m).filter(|alt_m| *alt_m >= HIGH_ORIGIN_M)
}

/// Whether the altitudes are perhaps above the sea.
fn altitudes(draft: &MissionDraft, file: &mut Document) -> bool {
    const BAND: &str = "airspace.altitude_m";
    let [low, high] = draft.airspace.altitude_m;
    if !file.given(BAND) {
        return false;
    }
    if let Some(alt_m) = high_origin_m(draft).filter(|alt_m| low >= *alt_m && low >= HIGH_BAND_M) {
        let message = format!(
            "`altitude_m` is from {low} to {high} m above the mission origin, which is itself {alt_m} m above the sea: the \
             vehicles would fly {low} m above the ground there"
        );
        let help = format!(
            "altitudes are above the origin; if these are above the sea, write [{}, {}]",
            low - alt_m,
            high - alt_m
        );
        warn(file, BAND, message, help);
        return true;
    }
    if low < LOW_BAND_M {
        let message = format!(
            "`altitude_m` lets the vehicles fly {low} m above the mission origin, among what stands there"
        );
        warn(
            file,
            BAND,
            message,
            format!("give a lowest altitude above all that stands in the area, {LOW_BAND_M} m or more"),
        );
    }
    false
}

fn nodes(draft: &MissionDraft, file: &mut Document) {
    let area = Polygon::new(&draft.area_m()).ok();
    let [low, _] = draft.airspace.altitude_m;
    let frame = draft.origin.unwrap_or(NOWHERE);
    let users = draft.users.iter().enumerate().map(|node| ("user", node));
    let eavesdroppers = draft.eavesdroppers.iter().enumerate().map(|node| ("eavesdropper", node));
    for (kind, (index, node)) in users.chain(eavesdroppers) {
        let path = key_of(kind, index, node);
        let place = node.position().enu(frame);
        let beyond_m = area.as_ref().map_or(0.0, |area| match area.encloses(place.xy()) {
            true => 0.0,
            false => (place.xy() - area.nearest_on_boundary(place.xy())).norm(),
        });
        if beyond_m > FAR_M && file.sound(&[area_key(draft), &format!("{kind}[{index}]")]) {
            let message = format!(
                "{kind} {:?} is {:.1} km from the area in which the vehicles fly: {}",
                node.name,
                beyond_m / 1e3,
                if kind == "user" { "next to nothing is received there" } else { "it hears next to nothing" }
            );
            warn(
                file,
                &path,
                message,
                "positions are in metres from the mission origin, or by lat_deg and lon_deg: check it",
            );
        }
        if let Some(alt_m) =
            high_origin_m(draft).filter(|alt_m| (place.z / alt_m - 1.0).abs() < 0.25 && place.z > low)
        {
            let message = format!(
                "{kind} {:?} is {} m above the mission origin, about as high as the origin is above the sea ({alt_m} m)",
                node.name, place.z
            );
            let key = if matches!(node.position(), Position::Geodetic(_)) && node.alt_m.is_some() {
                format!("{kind}[{index}].alt_m")
            } else {
                path.clone()
            };
            let help = format!(
                "heights are above the origin; if this one is above the sea, write {:.1}",
                place.z - alt_m
            );
            warn(file, &key, message, help);
        }
    }
    for (index, node) in draft.eavesdroppers.iter().enumerate() {
        let at = node.position().enu(frame);
        for (number, user) in draft.users.iter().enumerate() {
            let distance_m = (user.position().enu(frame) - at).norm();
            // Where it stands at the user, and where its disc reaches the user, is told already.
            let told = match node.uncertainty() {
                Uncertainty::Disc { radius_m } => distance_m < radius_m,
                Uncertainty::None | Uncertainty::Gaussian { .. } => distance_m == 0.0,
            };
            let both = [format!("user[{number}]"), format!("eavesdropper[{index}]")];
            if distance_m < BESIDE_M && !told && file.sound(&both.each_ref().map(String::as_str)) {
                let message = format!(
                    "eavesdropper {:?} stands {distance_m:.1} m beside user {:?}: whatever the plan, it hears nearly as much",
                    node.name, user.name
                );
                let help = "check both positions; a user so near to a listener is better served from elsewhere, or by a cable";
                warn(file, &key_of("eavesdropper", index, node), message, help);
            }
        }
    }
    if let Some(area) = area.filter(|area| area.diameter_m() < NARROW_M) {
        let message = format!(
            "the area is {:.1} m across: two vehicles and their paths hardly fit into it",
            area.diameter_m()
        );
        warn(
            file,
            area_key(draft),
            message,
            "corners are in metres east and north of the origin; check the unit",
        );
    }
}

/// Where a node's position is given.
fn key_of(kind: &str, index: usize, node: &NodeDraft) -> String {
    let key = if matches!(node.position(), Position::Geodetic(_)) { "lat_deg" } else { "enu_m" };
    format!("{kind}[{index}].{key}")
}

/// `deep`: homes far below the band are told of.
fn homes(draft: &MissionDraft, deep: bool, file: &mut Document) {
    let [low, high] = draft.airspace.altitude_m;
    for role in Role::BOTH {
        let Some(home) = draft.home_m(role) else { continue };
        let path = home_key(draft, role);
        let help = "a home is where the vehicle stands on the ground: [east, north, up] from the mission origin, in metres";
        if home.z >= low {
            let place = if home.z > high { "above" } else { "inside" };
            let message = format!(
                "the home of {role} is {} m above the origin, {place} the band of {low} to {high} m: it would take off where \
                 the vehicles fly",
                home.z
            );
            warn(file, &path, message, help);
        } else if deep && home.z < low - DEEP_HOME_M {
            let message = format!(
                "the home of {role} is {:.0} m below the lowest altitude of {low} m: each take-off and landing is that long",
                low - home.z
            );
            warn(file, &path, message, help);
        }
    }
}

fn powers(draft: &MissionDraft, file: &mut Document) {
    let most = draft.radio.max_power_w;
    strong(file, "radio.max_power_w", "max_power_w", most.i.max(most.j));
    if let Some(emission) = &draft.emission {
        strong(file, "emission.max_power_w", "max_power_w", emission.max_power_w);
    }
}

fn strong(file: &mut Document, path: &str, key: &str, power_w: f64) {
    if power_w > STRONG_W {
        let message = format!(
            "`{key}` is {power_w} W, which is {:.1} dBm: no radio on a small vehicle gives that",
            Dbm::from(Watts(power_w)).0
        );
        let help = format!(
            "powers are in W; if {power_w} dBm were meant, write {:.3e}",
            Watts::from(Dbm(power_w)).0
        );
        warn(file, path, message, help);
    }
}

fn radio(draft: &MissionDraft, file: &mut Document) {
    let radio = &draft.radio;
    let thermal_w = THERMAL_W_HZ * radio.bandwidth_hz;
    let noise_dbm = Dbm::from(Watts(radio.noise_power_w)).0;
    let thermal_dbm = Dbm::from(Watts(thermal_w)).0;
    if radio.bandwidth_hz < NARROW_HZ {
        let message = format!("`bandwidth_hz` is {} Hz, less than any voice needs", radio.bandwidth_hz);
        let help = format!(
            "it is in Hz; if {} MHz were meant, write {:e}",
            radio.bandwidth_hz,
            radio.bandwidth_hz * 1e6
        );
        warn(file, "radio.bandwidth_hz", message, help);
    } else if file.sound(&["radio.bandwidth_hz"]) && radio.noise_power_w > NOISY * thermal_w {
        let message = format!(
            "`noise_power_w` is {:e} W, {noise_dbm:.1} dBm: {:.0} dB above the thermal noise in that bandwidth, {thermal_dbm:.1} dBm",
            radio.noise_power_w,
            noise_dbm - thermal_dbm
        );
        let help =
            format!("it is in W: {thermal_dbm:.1} dBm are {thermal_w:.1e} W; a receiver adds 5 to 15 dB");
        warn(file, "radio.noise_power_w", message, help);
    } else if file.sound(&["radio.bandwidth_hz"]) && radio.noise_power_w < 0.5 * thermal_w {
        let message = format!(
            "`noise_power_w` is {:e} W, {noise_dbm:.1} dBm: less than the thermal noise in that bandwidth, {thermal_dbm:.1} dBm",
            radio.noise_power_w
        );
        let help = format!(
            "it is in W and over the whole bandwidth: {thermal_w:.1e} W, and 5 to 15 dB for the receiver"
        );
        warn(file, "radio.noise_power_w", message, help);
    }
    if let Some(emission) = draft.emission.as_ref().filter(|emission| emission.band_hz[1] < LOW_HZ) {
        let [low, high] = emission.band_hz;
        let message = format!("`band_hz` is {low} to {high} Hz: no radio of a vehicle works there");
        let help = format!("it is in Hz; if MHz were meant, write [{:e}, {:e}]", low * 1e6, high * 1e6);
        warn(file, "emission.band_hz", message, help);
    } else if draft.emission.is_some() && radio.carrier_hz.is_none() && radio.reference_gain >= 1e-2 {
        let message = format!(
            "something real is to be radiated, and `reference_gain` is {}: at 2.4 GHz a path has 1e-4 at 1 m, and plans promise \
             what no radio keeps",
            radio.reference_gain
        );
        let path = if file.given("radio.reference_gain") { "radio.reference_gain" } else { "emission" };
        if file.sound(&["emission"]) {
            warn(file, path, message, "give [radio] carrier_hz instead, and the antennas' gains");
        }
    }
    let antennas = [
        ("antenna", Some(&draft.antenna.both)),
        ("antenna.i", draft.antenna.i.as_ref()),
        ("antenna.j", draft.antenna.j.as_ref()),
    ];
    for (table, antenna) in antennas {
        let Some(depth_db) = antenna.and_then(|antenna| antenna.null_depth_db) else { continue };
        let [least_db, most_db] = NULL_DB;
        let message = if depth_db < least_db {
            format!("`null_depth_db` is {depth_db} dB, hardly a null: J's jamming would reach the user")
        } else if depth_db > most_db {
            format!(
                "`null_depth_db` is {depth_db} dB, deeper than any antenna's on a vehicle: plans would trust it"
            )
        } else {
            continue;
        };
        warn(
            file,
            &format!("{table}.null_depth_db"),
            message,
            "give what was measured, in dB; 20 to 30 is usual (docs/calibration.md)",
        );
    }
}

fn angles(draft: &MissionDraft, file: &mut Document) {
    let stds = [
        ("jitter.std_deg", Some(draft.jitter.std_deg)),
        ("pointing.heading_std_deg", draft.pointing.heading_std_deg),
    ];
    for (path, std_deg) in stds {
        let Some(std_deg) = std_deg.filter(|std_deg| *std_deg > 0.0 && *std_deg < SMALL_STD_DEG) else {
            continue;
        };
        let key = path.rsplit('.').next().unwrap_or(path);
        let message = format!("`{key}` is {std_deg} deg, steadier than any vehicle is");
        let help =
            format!("it is in degrees; if {std_deg} rad were meant, write {:.2}", std_deg.to_degrees());
        warn(file, path, message, help);
    }
    let tilts = [
        ("airspace.max_tilt_deg", draft.airspace_max_tilt_deg),
        ("vehicles.i.max_tilt_deg", draft.vehicles.i.max_tilt_deg),
        ("vehicles.j.max_tilt_deg", draft.vehicles.j.max_tilt_deg),
    ];
    for (path, tilt_deg) in
        tilts.into_iter().filter(|(_, tilt_deg)| *tilt_deg > 0.0 && *tilt_deg < SMALL_TILT_DEG)
    {
        let message = format!("`max_tilt_deg` is {tilt_deg} deg: less than the vehicle's own unrest");
        let help = format!(
            "it is in degrees; if {tilt_deg} rad were meant, write {:.0}; a vehicle that stays level is airframe = \"conventional\"",
            tilt_deg.to_degrees()
        );
        warn(file, path, message, help);
    }
}

fn motion(draft: &MissionDraft, file: &mut Document) {
    for role in Role::BOTH {
        let speed_m_s = draft.vehicles[role].speed_m_s;
        if speed_m_s > FAST_M_S {
            let message = format!(
                "`speed_m_s` is {speed_m_s} m/s, {:.0} km/h: no multirotor's transit",
                speed_m_s * 3.6
            );
            let help = format!("it is in m/s; if {speed_m_s} km/h were meant, write {:.1}", speed_m_s / 3.6);
            warn(file, &format!("vehicles.{}.speed_m_s", role.key()), message, help);
        }
    }
    let apart_m = draft.airspace.min_separation_m;
    if apart_m < CLOSE_M {
        let message =
            format!("`min_separation_m` is {apart_m} m: rotors' wash and the positions' errors reach as far");
        warn(
            file,
            "airspace.min_separation_m",
            message,
            "give at least two vehicles' widths and their positions' errors, 5 m or more",
        );
    }
}

fn slots(draft: &MissionDraft, file: &mut Document) {
    let tdma = &draft.tdma;
    let on_air_s = tdma.slot_s - tdma.guard_s;
    if file.sound(&["tdma.slot_s", "tdma.guard_s", "tdma.settle_s"])
        && on_air_s > 0.0
        && on_air_s < tdma.guard_s + tdma.settle_s
    {
        let message = format!(
            "of each slot of {} s {on_air_s:.1} s are on the air, less than the {:.1} s of its guard and settling",
            tdma.slot_s,
            tdma.guard_s + tdma.settle_s
        );
        let path = if file.given("tdma.slot_s") { "tdma.slot_s" } else { "tdma.guard_s" };
        warn(file, path, message, "give longer slots, or a shorter guard_s or settle_s");
    }
    // A superframe is served without a landing between.
    let slots = f64::from(tdma.superframes) * draft.users.len() as f64;
    let least_s = slots * (tdma.slot_s + tdma.settle_s);
    if least_s > LONG_S && file.sound(&["tdma.slot_s", "tdma.settle_s", "tdma.superframes"]) {
        let message = format!(
            "{slots} slots of {} s take {:.0} min at least, without a landing: longer than a multirotor flies",
            tdma.slot_s,
            least_s / 60.0
        );
        let path = if file.given("tdma.slot_s") { "tdma.slot_s" } else { "tdma.superframes" };
        warn(file, path, message, "slot_s is in seconds; give shorter slots, fewer users or superframes");
    }
}

fn objective(draft: &MissionDraft, file: &mut Document) {
    let discs = draft.eavesdroppers.iter().any(|node| node.uncertainty().is_present());
    let message = match draft.planner.objective {
        Objective::WorstCase if !discs => {
            "the worst case over the eavesdroppers' discs is asked for, and all are known exactly"
        }
        _ => return,
    };
    let help = "give each eavesdropper the radius_m within which it may be, or ask for another objective";
    warn(file, "planner.objective", message.to_owned(), help);
}
