//! What no single setting of a mission file can be wrong about: settings against each other.

use std::collections::BTreeMap;

use super::document::Document;
use super::draft::{MissionDraft, Mode, NoFlyDraft, Optimise, PlannerSettings, Position};
use super::mission_file::{FAR_M, NOWHERE};
use super::{link_checks, mission_warnings};
use crate::geo::polygon::{Polygon, check_simple};
use crate::geo::{Enu, Geodetic};
use crate::planner::following::MOST_MOVERS;
use crate::planner::problem::{Airspace, Method, NoFly, Objective, Uncertainty};
use crate::planner::region::Region;
use crate::planner::volume::Fairness;
use crate::role::{PerVehicle, Role};

pub(super) const ORIGIN: &str = "mission.origin";
pub(super) const ORIGIN_HELP: &str =
    "give [mission] origin = { lat_deg = ..., lon_deg = ..., alt_amsl_m = ... }";

/// Adds what is wrong with the settings together. Settings already refused are left out.
pub(super) fn check(draft: &MissionDraft, file: &mut Document) {
    origin(file);
    airspace(draft, file);
    no_fly(draft, file);
    emission(draft, file);
    names(draft.users.iter().map(|user| &user.name), "user", file);
    names(draft.eavesdroppers.iter().map(|e| &e.name), "eavesdropper", file);
    names(draft.no_fly.iter().map(|area| &area.name), "airspace.no_fly", file);
    nodes(draft, file);
    homes(draft, file);
    link_checks::check(draft, file);
    tdma(draft, file);
    volume(draft, file);
    following(draft, file);
    hints(draft, file);
    // Of a file that cannot be used, errors come first: half of what is odd about it follows from them.
    if !file.has_errors() {
        mission_warnings::check(draft, file);
    }
}

fn origin(file: &mut Document) {
    let keys = ["lat_deg", "lon_deg", "alt_amsl_m"].map(|key| format!("{ORIGIN}.{key}"));
    if file.given(ORIGIN) && file.sound(&[ORIGIN]) && !keys.iter().all(|key| file.given(key)) {
        let message = "`origin` is given only in part: the rest would be somewhere else's".to_owned();
        file.fail(ORIGIN);
        file.missing(file.at(ORIGIN), message, ORIGIN_HELP.to_owned());
    }
}

/// The key by which the area is given.
pub(super) fn area_key(draft: &MissionDraft) -> &'static str {
    if draft.area_lat_lon.is_some() { "airspace.area_lat_lon" } else { "airspace.area_enu_m" }
}

/// The key by which a vehicle's home is given.
pub(super) fn home_key(draft: &MissionDraft, role: Role) -> String {
    let key = if draft.vehicles[role].home_lat_lon.is_some() { "home_lat_lon" } else { "home_enu_m" };
    format!("vehicles.{}.{key}", role.key())
}

/// Whether a setting that may be by latitude and longitude has a place in the mission's frame.
fn frame(draft: &MissionDraft, geodetic: bool, path: &str, file: &mut Document) -> bool {
    if !geodetic {
        return true;
    }
    if !file.given(ORIGIN) && draft.origin.is_none() {
        let message = "a position by latitude and longitude needs the mission's `origin`".to_owned();
        file.fail(path);
        file.missing(file.at(path), message, ORIGIN_HELP.to_owned());
        return false;
    }
    file.sound(&[ORIGIN])
}

fn airspace(draft: &MissionDraft, file: &mut Document) {
    const BAND: &str = "airspace.altitude_m";
    let area_key = area_key(draft);
    const SEPARATION: &str = "airspace.min_separation_m";
    let airspace = &draft.airspace;
    let [low, high] = airspace.altitude_m;
    if file.sound(&[BAND]) && low >= high {
        let message = format!(
            "`altitude_m` is inverted or empty: the lowest, {low} m, is not below the highest, {high} m"
        );
        refuse(file, BAND, message, "write [lowest, highest], in metres above the mission origin");
    }
    if !frame(draft, draft.area_lat_lon.is_some(), area_key, file) {
        return;
    }
    if draft.area_lat_lon.is_some() && file.sound(&[area_key]) {
        let farthest_m = draft.area_m().iter().map(|corner| corner.norm()).fold(0.0, f64::max);
        if farthest_m > FAR_M {
            let message = format!(
                "a corner of `area_lat_lon` is {:.0} km from the mission origin, further than {:.0} km",
                farthest_m / 1e3,
                FAR_M / 1e3
            );
            let help = "check the signs and the order of latitude and longitude, here and in `origin`";
            refuse(file, area_key, message, help);
        }
    }
    let key = area_key.rsplit('.').next().unwrap_or(area_key);
    if file.sound(&[area_key])
        && let Err(error) = check_simple(&draft.area_m())
    {
        let help = "list the corners once each, in order around the area, at least three of them";
        refuse(file, area_key, format!("`{key}` {error}"), help);
    }
    if file.sound(&[BAND, area_key, SEPARATION])
        && let Ok(area) = Polygon::new(&draft.area_m())
    {
        let widest = area.diameter_m().hypot(high - low);
        if airspace.min_separation_m > widest {
            let message = format!(
                "`min_separation_m` of {} m cannot be met: no two points of the airspace are further apart than {widest:.1} m",
                airspace.min_separation_m
            );
            refuse(file, SEPARATION, message, "lower it, or enlarge area_enu_m or altitude_m");
        }
    }
}

/// Corners of all no-fly areas together: far above any mission's, and few enough to plan ways round.
const MOST_CORNERS: usize = 200;

fn no_fly(draft: &MissionDraft, file: &mut Document) {
    const LIST: &str = "airspace.no_fly";
    if !draft.airspace.no_fly.is_empty() {
        let message = "no-fly areas were put into the draft's `airspace`, where nobody reads them".to_owned();
        refuse(file, LIST, message, "put them into the draft's own `no_fly`");
    }
    for (index, area) in draft.no_fly.iter().enumerate() {
        no_fly_area(draft, index, area, file);
    }
    let corners: usize = draft.no_fly_m().iter().map(|area| area.area_enu_m.len()).sum();
    if corners > MOST_CORNERS {
        let message = format!("the no-fly areas have {corners} corners in all, more than {MOST_CORNERS}");
        refuse(file, LIST, message, "draw them with fewer corners, a little larger, or join neighbours");
    }
    // The planner's own cells know what is left.
    if file.sound(&["airspace"]) && !draft.no_fly.is_empty() {
        let airspace =
            Airspace { area_enu_m: draft.area_m(), no_fly: draft.no_fly_m(), ..draft.airspace.clone() };
        if Region::new(&airspace).is_some_and(|region| region.cells().is_empty()) {
            let [low, high] = airspace.altitude_m;
            let message =
                format!("the no-fly areas leave nothing of the airspace between {low} and {high} m");
            let help = "make them smaller, give them a floor_m or ceiling_m, or enlarge airspace's area or altitude_m";
            refuse(file, LIST, message, help);
        }
    }
}

fn no_fly_area(draft: &MissionDraft, index: usize, area: &NoFlyDraft, file: &mut Document) {
    let path = format!("airspace.no_fly[{index}]");
    let key = if area.area_lat_lon.is_some() { "area_lat_lon" } else { "area_enu_m" };
    let (corners, floor, ceiling) =
        (format!("{path}.{key}"), format!("{path}.floor_m"), format!("{path}.ceiling_m"));
    if let (Some(floor_m), Some(ceiling_m)) = (area.floor_m, area.ceiling_m)
        && file.sound(&[&floor, &ceiling])
        && floor_m >= ceiling_m
    {
        let message = format!(
            "the heights of the no-fly area {:?} are inverted or empty: `floor_m`, {floor_m} m, is not below `ceiling_m`, \
             {ceiling_m} m",
            area.name
        );
        let at = if file.given(&floor) { &floor } else { &ceiling };
        refuse(file, at, message, "give both in metres above the mission origin, or leave one out");
    }
    if !file.sound(&[&path]) && !file.sound(&[&corners]) {
        return;
    }
    if !frame(draft, area.area_lat_lon.is_some(), &corners, file) || !file.sound(&[&corners]) {
        return;
    }
    let Some(settled) = draft.no_fly_m().into_iter().nth(index) else { return };
    let farthest_m = settled.area_enu_m.iter().map(|corner| corner.norm()).fold(0.0, f64::max);
    if area.area_lat_lon.is_some() && farthest_m > FAR_M {
        let message = format!(
            "a corner of `area_lat_lon` is {:.0} km from the mission origin, further than {:.0} km",
            farthest_m / 1e3,
            FAR_M / 1e3
        );
        let help = "check the signs and the order of latitude and longitude, here and in `origin`";
        refuse(file, &corners, message, help);
    } else if (area.area_lat_lon.is_some() || area.area_enu_m.is_some())
        && let Err(error) = check_simple(&settled.area_enu_m)
    {
        let help = "list the corners once each, in order around the area, at least three of them; two areas that only touch \
                    are two tables";
        refuse(file, &corners, format!("`{key}` of the no-fly area {:?} {error}", area.name), help);
    }
}

/// The no-fly area in or under which a home lies, so that the vehicle would climb through it.
fn over_home(draft: &MissionDraft, home: Enu) -> Option<(usize, NoFly)> {
    let low = draft.airspace.altitude_m[0];
    draft.no_fly_m().into_iter().enumerate().find(|(_, area)| {
        let [floor, ceiling] = area.heights_m();
        // From the home up into the band, both ends included.
        let meets = floor < low.max(home.z) && home.z < ceiling;
        meets && Polygon::new(&area.area_enu_m).is_ok_and(|polygon| polygon.encloses(home.xy()))
    })
}

fn emission(draft: &MissionDraft, file: &mut Document) {
    const BAND: &str = "emission.band_hz";
    let Some(emission) = &draft.emission else { return };
    let [low, high] = emission.band_hz;
    if file.sound(&[BAND]) && low >= high {
        let message = format!(
            "`band_hz` is inverted or empty: the lowest, {low:e} Hz, is not below the highest, {high:e} Hz"
        );
        refuse(file, BAND, message, "write [lowest, highest], in Hz");
    }
    if let Some(carrier_hz) = draft.radio.carrier_hz
        && file.sound(&[BAND, "radio.carrier_hz", "radio.bandwidth_hz"])
    {
        let half_hz = draft.radio.bandwidth_hz / 2.0;
        if carrier_hz - half_hz < low || carrier_hz + half_hz > high {
            let message = format!(
                "`carrier_hz` with the bandwidth reaches from {:e} to {:e} Hz, outside the permitted {low:e} to {high:e} Hz",
                carrier_hz - half_hz,
                carrier_hz + half_hz
            );
            refuse(
                file,
                "radio.carrier_hz",
                message,
                "choose a carrier and bandwidth inside emission.band_hz",
            );
        }
    }
    if !file.given(ORIGIN) {
        let message = "[emission] without the mission's `origin`: no real transmitter may radiate".to_owned();
        file.warning(file.at("emission"), message, ORIGIN_HELP.to_owned());
    }
}

fn names<'n>(names: impl Iterator<Item = &'n String>, kind: &str, file: &mut Document) {
    let mut seen = BTreeMap::new();
    for (index, name) in names.enumerate() {
        let path = format!("{kind}[{index}].name");
        if let Some(first) = seen.get(name) {
            let message = format!("{kind} {} has the same name as {kind} {}: {name:?}", index + 1, first + 1);
            refuse(file, &path, message, "give each its own name");
        } else {
            seen.insert(name, index);
        }
    }
}

fn nodes(draft: &MissionDraft, file: &mut Document) {
    let users = draft.users.iter().enumerate().map(|(index, user)| ("user", index, user));
    let eavesdroppers = draft.eavesdroppers.iter().enumerate().map(|(index, e)| ("eavesdropper", index, e));
    for (kind, index, at) in users.chain(eavesdroppers) {
        let path = format!("{kind}[{index}]");
        if file.sound(&[&path]) {
            node(draft, file, kind, &path, at.position());
        }
    }
    secrecy(draft, file);
}

/// Warns of eavesdroppers where users are, or may be: nothing is secret there whatever the plan.
fn secrecy(draft: &MissionDraft, file: &mut Document) {
    let origin = draft.origin.unwrap_or(NOWHERE);
    for (index, node) in draft.eavesdroppers.iter().enumerate() {
        let at = node.position().enu(origin);
        let radius_m = if let Uncertainty::Disc { radius_m } = node.uncertainty() { radius_m } else { 0.0 };
        for (number, user) in draft.users.iter().enumerate() {
            let distance_m = (user.position().enu(origin) - at).norm();
            let path = format!("eavesdropper[{index}]");
            if !file.sound(&[&format!("user[{number}]"), &path]) {
                continue;
            }
            if distance_m == 0.0 {
                let message = format!(
                    "eavesdropper {:?} stands where user {:?} does: no secrecy is possible",
                    node.name, user.name
                );
                file.warning(file.at(&path), message, "check both positions".to_owned());
            } else if distance_m < radius_m {
                let message = format!(
                    "eavesdropper {:?} may stand where user {:?} does, {distance_m:.0} m from where it is said to be: in the \
                     worst case no secrecy is possible",
                    node.name, user.name
                );
                let help = "give a smaller radius_m if more is known; the objectives \"mean\" and \"quantile\" count such \
                            places by their share";
                file.warning(file.at(&format!("{path}.radius_m")), message, help.to_owned());
            }
        }
    }
}

fn node(draft: &MissionDraft, file: &mut Document, kind: &str, path: &str, position: Position) {
    let place = |key: &str| format!("{path}.{key}");
    let enu = position.enu(draft.origin.unwrap_or(NOWHERE));
    let key = match position {
        Position::Enu(_) => place("enu_m"),
        Position::Geodetic(_) => place("lat_deg"),
    };
    if let Position::Geodetic(Geodetic { lat_deg, lon_deg, .. }) = position {
        if !file.given(ORIGIN) {
            let message = "a position by latitude and longitude needs the mission's `origin`".to_owned();
            file.missing(file.at(&key), message, ORIGIN_HELP.to_owned());
            return;
        }
        if !file.sound(&[ORIGIN]) {
            return;
        }
        let distance_m = enu.xy().norm();
        if distance_m > FAR_M {
            let message = format!(
                "the position {lat_deg}, {lon_deg} is {:.0} km from the mission origin, further than {:.0} km",
                distance_m / 1e3,
                FAR_M / 1e3
            );
            // As far as the swapped place exists: a longitude beyond a right angle is no latitude.
            let swapped = Geodetic { lat_deg: lon_deg, lon_deg: lat_deg, alt_m: 0.0 };
            let near =
                lon_deg.abs() <= 89.0 && swapped.to_enu(draft.origin.unwrap_or(NOWHERE)).xy().norm() <= FAR_M;
            let help = if near {
                "latitude and longitude are swapped, here or in `origin`: the other way round it is near"
            } else {
                "check the signs and the order of latitude and longitude, here and in `origin`"
            };
            refuse(file, &key, message, help);
            return;
        }
    }
    let [low, high] = draft.airspace.altitude_m;
    let inside = (low..=high).contains(&enu.z) && encloses(draft, enu);
    if file.sound(&["airspace.altitude_m", area_key(draft)]) && inside {
        let message = format!(
            "the {kind} stands inside the airspace, at {} m of {low} to {high} m: a vehicle could meet it",
            enu.z
        );
        refuse(
            file,
            &key,
            message,
            "raise the lower end of airspace.altitude_m above every node in the area",
        );
    }
}

fn homes(draft: &MissionDraft, file: &mut Document) {
    let homes = PerVehicle::from_fn(|role| draft.home_m(role));
    let keys = PerVehicle::from_fn(|role| home_key(draft, role));
    for role in Role::BOTH {
        let path = &keys[role];
        if !frame(draft, draft.vehicles[role].home_lat_lon.is_some(), path, file) {
            continue;
        }
        if let Some(home) = homes[role]
            && file.sound(&[path, area_key(draft)])
            && !encloses(draft, home)
        {
            let at = place(home);
            let area = area_key(draft).rsplit('.').next().unwrap_or_default();
            let message = format!("the home of {role}, [{}, {}] m, lies outside `{area}`", at[0], at[1]);
            refuse(
                file,
                path,
                message,
                "vehicles stay inside the area from take-off to landing: move one or enlarge the other",
            );
        }
    }
    for role in Role::BOTH {
        let path = &keys[role];
        if let Some(home) = homes[role]
            && file.sound(&[path, "airspace.no_fly", "airspace.altitude_m"])
            && let Some((index, area)) = over_home(draft, home)
        {
            let at = place(home);
            let message = format!(
                "the home of {role}, [{}, {}] m, lies in or under the no-fly area {:?}: it would climb and land through it",
                at[0], at[1], area.name
            );
            let help = format!("move the home, or change [[airspace.no_fly]] number {}", index + 1);
            refuse(file, path, message, &help);
        }
    }
    if let (Some(i), Some(j)) = (homes.i, homes.j)
        && file.sound(&[&keys.i, &keys.j, "airspace.min_separation_m"])
        && (i - j).norm() < draft.airspace.min_separation_m
    {
        let message = format!(
            "the homes are {:.1} m apart, closer than `min_separation_m` of {} m",
            (i - j).norm(),
            draft.airspace.min_separation_m
        );
        refuse(file, &keys.j, message, "move one of them");
    }
}

/// East and north for people, to the millimetre.
fn place(at: Enu) -> [f64; 2] {
    [at.x, at.y].map(|metres| (metres * 1e3).round() / 1e3)
}

/// Whether a point is above, in or below the area.
fn encloses(draft: &MissionDraft, point: Enu) -> bool {
    Polygon::new(&draft.area_m()).is_ok_and(|area| area.encloses(point.xy()))
}

fn tdma(draft: &MissionDraft, file: &mut Document) {
    let tdma = draft.tdma;
    if file.sound(&["tdma.slot_s", "tdma.guard_s"]) && tdma.guard_s >= tdma.slot_s {
        let path = if file.given("tdma.guard_s") { "tdma.guard_s" } else { "tdma.slot_s" };
        let message =
            format!("the guard time of {} s leaves nothing of a slot of {} s", tdma.guard_s, tdma.slot_s);
        refuse(file, path, message, "make guard_s shorter than slot_s");
    }
    let slots = draft.users.len() * usize::from(tdma.superframes);
    if file.sound(&["tdma.superframes"]) && slots > usize::from(u16::MAX) {
        let message =
            format!("`superframes` makes {slots} slots, more than the {} that can be numbered", u16::MAX);
        refuse(file, "tdma.superframes", message, "lower it, or serve fewer users");
    }
}

/// What following asks of other settings.
fn following(draft: &MissionDraft, file: &mut Document) {
    let nodes = [("user", &draft.users), ("eavesdropper", &draft.eavesdroppers)];
    let movers: Vec<(String, Option<u8>)> = nodes
        .into_iter()
        .flat_map(|(kind, nodes)| nodes.iter().enumerate().map(move |(index, node)| (kind, index, node)))
        .filter_map(|(kind, index, node)| Some((format!("{kind}[{index}].moves"), node.moves?.system_id)))
        .collect();
    let Some((first, _)) = movers.first().cloned() else { return };
    if draft.planner.mode != Mode::Static {
        let message = "somebody `moves`, and is followed from a pose that is held; `planner.mode` has the pair turn or move by a plan that \
                       knows of no such thing"
            .to_owned();
        refuse(file, &first, message, "set planner.mode = \"static\"");
    }
    // A slot is told of its user and of eavesdroppers.
    let at_once = usize::from(draft.users.iter().any(|user| user.moves.is_some()))
        + draft.eavesdroppers.iter().filter(|eavesdropper| eavesdropper.moves.is_some()).count();
    if at_once > MOST_MOVERS {
        let message = format!("{at_once} of those in a slot move; {MOST_MOVERS} can be followed at once");
        refuse(file, &first, message, "leave `moves` out for those farthest away");
    }
    for (k, (path, system_id)) in movers.iter().enumerate() {
        if let Some(system_id) = system_id
            && movers[..k].iter().any(|(_, other)| *other == Some(*system_id))
        {
            let message = format!("MAVLink system {system_id} says where two are");
            refuse(file, path, message, "give each a system_id of its own");
        }
    }
}

/// What a plan for volume, or for the least-served user, asks of other settings.
fn volume(draft: &MissionDraft, file: &mut Document) {
    const LIMITS: [&str; 2] = ["tdma.slot_min_s", "tdma.slot_max_s"];
    let PlannerSettings { method, objective, optimise, mode, fairness, .. } = draft.planner;
    if optimise == Optimise::Rate && fairness == Fairness::MaxMin {
        let message =
            "`fairness` is about volumes, and `optimise` is \"rate\": every slot is planned by itself"
                .to_owned();
        refuse(file, "planner.fairness", message, "set optimise = \"volume\", or leave fairness out");
    }
    let together = match (optimise, mode) {
        (_, Mode::Turning) => Some(("turns", "turns are", "mode = \"static\"")),
        (_, Mode::Moving) => Some(("motion", "a motion is", "mode = \"static\"")),
        (Optimise::Volume, Mode::Static) => Some(("volume", "a volume is", "optimise = \"rate\"")),
        (Optimise::Rate, Mode::Static) => None,
    };
    if let Some((what, it_is, instead)) = together {
        if method != Method::Veilwing {
            let message = format!("this `method` plans each slot by itself, and knows nothing of {what}");
            refuse(file, "planner.method", message, &format!("use \"veilwing\", or set {instead}"));
        }
        if matches!(objective, Objective::Quantile | Objective::WorstCase) {
            let message = format!(
                "`objective` is about what goes wrong in one slot; {it_is} over many slots, and planned for the mean"
            );
            refuse(
                file,
                "planner.objective",
                message,
                &format!("use \"mean\" or \"nominal\", or set {instead}"),
            );
        }
    }
    if optimise == Optimise::Rate && mode == Mode::Moving {
        let message =
            "`mode` is \"moving\", about a superframe as a whole, and `optimise` is \"rate\": every slot is planned by itself"
                .to_owned();
        refuse(file, "planner.mode", message, "set optimise = \"volume\", or mode = \"turning\"");
    }
    if fairness != Fairness::MaxMin {
        for path in LIMITS.into_iter().filter(|path| file.given(path)).collect::<Vec<_>>() {
            let key = path.trim_start_matches("tdma.");
            let message = format!("`{key}` has no effect: all slots are slot_s long");
            let help = "set planner.fairness = \"max-min\" for slots of different lengths".to_owned();
            file.warning(file.at(path), message, help);
        }
        return;
    }
    let tdma = draft.tdma;
    let [shortest_s, longest_s] = tdma.slot_limits_s();
    if !file.sound(&["tdma.slot_s", "tdma.guard_s", LIMITS[0], LIMITS[1]]) {
        return;
    }
    if shortest_s > tdma.slot_s {
        let message = format!(
            "`slot_min_s` of {shortest_s} s is more than slot_s, {} s, which is the mean",
            tdma.slot_s
        );
        refuse(file, LIMITS[0], message, "lower it, or raise slot_s");
    }
    if longest_s < tdma.slot_s {
        let message = format!(
            "`slot_max_s` of {longest_s} s is less than slot_s, {} s, which is the mean",
            tdma.slot_s
        );
        refuse(file, LIMITS[1], message, "raise it, or lower slot_s");
    }
    if tdma.guard_s >= shortest_s {
        let path = if file.given(LIMITS[0]) { LIMITS[0] } else { "tdma.guard_s" };
        let message = format!(
            "the guard time of {} s leaves nothing of the shortest slot, {shortest_s} s",
            tdma.guard_s
        );
        refuse(file, path, message, "make guard_s shorter than slot_min_s");
    }
}

fn hints(draft: &MissionDraft, file: &mut Document) {
    if file.sound(&["jitter"]) && draft.jitter.std_deg == 0.0 {
        let message = "`std_deg` is 0: plans will trust attitudes that no vehicle holds".to_owned();
        file.warning(
            file.at("jitter.std_deg"),
            message,
            "give the attitude error measured in flight; 1 to 3 deg is usual".to_owned(),
        );
    }
    if file.sound(&["radio.max_power_w"]) && draft.radio.max_power_w.i == 0.0 {
        let message = "`max_power_w` of I is 0: the mission transmits nothing".to_owned();
        file.warning(file.at("radio.max_power_w"), message, "give vehicle I a power".to_owned());
    }
    if file.given("radio.carrier_hz") {
        return;
    }
    for key in ["tx_gain_dbi", "rx_gain_dbi"].map(|key| format!("radio.{key}")) {
        if file.given(&key) {
            let message = "an antenna gain without `carrier_hz` has no effect".to_owned();
            file.warning(
                file.at(&key),
                message,
                "give carrier_hz, or put the gain into reference_gain".to_owned(),
            );
        }
    }
}

pub(super) fn refuse(file: &mut Document, path: &str, message: String, help: &str) {
    file.fail(path);
    file.error(file.at(path), message, help.to_owned());
}
