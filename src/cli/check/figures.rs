//! What a mission states of its site, its slots, its link and its permission to radiate, in a line each.

use crate::config::{Emission, Mission};
use crate::geo::Enu;
use crate::planner::problem::{Fading, PowerSteps, Uncertainty};
use crate::planning::maps::NoFlyArea;
use crate::role::Role;
use crate::units::{Dbm, Watts};

/// Nodes of a kind that are listed one by one.
const LISTED: usize = 20;

/// Where everything is: origin, airspace, homes, users and eavesdroppers with the distances between them.
pub(super) fn of_the_site(mission: &Mission) -> Vec<(String, String)> {
    let mut lines = Vec::new();
    let mut line = |title: &str, text: String| lines.push((title.to_owned(), text));
    let origin = mission.origin;
    line(
        "origin",
        if mission.has_origin() {
            format!(
                "{:.6}, {:.6} deg, {} m above mean sea level",
                origin.lat_deg, origin.lon_deg, origin.alt_m
            )
        } else {
            "none: a place for simulations alone".to_owned()
        },
    );
    let air = &mission.airspace;
    let [low_m, high_m] = air.altitude_m;
    let extent = |axis: usize| {
        let along = air.area_enu_m.iter().map(|corner| corner[axis]);
        along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min)
    };
    line(
        "airspace",
        format!(
            "{low_m} to {high_m} m above it, {:.0} m east by {:.0} m north, {} corners, separation {} m",
            extent(0),
            extent(1),
            air.area_enu_m.len(),
            air.min_separation_m
        ),
    );
    for (index, area) in air.no_fly.iter().enumerate() {
        let corners = area.area_enu_m.len();
        let label = if index == 0 { "no-fly areas" } else { "" };
        line(label, format!("{}, {corners} corners, {}", area.name, NoFlyArea::new(area).heights()));
    }
    let homes = mission.vehicles.map(|vehicle| vehicle.home_enu_m);
    if let (Some(i), Some(j)) = (homes.i, homes.j) {
        line("homes", format!("I {}, J {}, {:.0} m apart", place(&i), place(&j), (i - j).norm()));
    }
    let names = |names: Vec<&str>| format!("{} ({})", names.len(), names.join(", "));
    line("users", names(mission.users.iter().map(|user| user.name.as_str()).collect()));
    for user in mission.users.iter().take(LISTED) {
        let others = mission.eavesdroppers.iter().map(|e| (e.name.as_str(), e.node.position_enu_m));
        let near = nearest(&user.position_enu_m, others);
        let known = known(&user.uncertainty);
        line("", format!("{} {}, {known}, {near}", user.name, place(&user.position_enu_m)));
    }
    line("eavesdroppers", names(mission.eavesdroppers.iter().map(|node| node.name.as_str()).collect()));
    for eavesdropper in mission.eavesdroppers.iter().take(LISTED) {
        let at = &eavesdropper.node.position_enu_m;
        let near = nearest(at, mission.users.iter().map(|user| (user.name.as_str(), user.position_enu_m)));
        let known = known(&eavesdropper.node.uncertainty);
        line("", format!("{} {}, {known}, {near}", eavesdropper.name, place(at)));
    }
    lines
}

fn place(at: &Enu) -> String {
    // Tenths of metres, and no minus before a zero.
    let [east, north, up] = [at.x, at.y, at.z].map(|metres| (metres * 10.0).round() / 10.0 + 0.0);
    format!("[{east}, {north}, {up}]")
}

fn known(uncertainty: &Uncertainty) -> String {
    match uncertainty {
        Uncertainty::None => "exact".to_owned(),
        Uncertainty::Disc { radius_m } => format!("within {radius_m} m"),
        Uncertainty::Gaussian { std_m } => format!("+- {std_m} m"),
    }
}

fn nearest<'n>(from: &Enu, others: impl Iterator<Item = (&'n str, Enu)>) -> String {
    let distances = others.map(|(name, at)| (name, (at - from).norm()));
    distances
        .min_by(|(_, a), (_, b)| a.total_cmp(b))
        .map_or(String::new(), |(name, distance_m)| format!("{distance_m:.0} m from {name}"))
}

/// When what is flown.
pub(super) fn of_the_slots(mission: &Mission) -> Vec<(&'static str, String)> {
    let tdma = &mission.tdma;
    let slots = mission.users.len() * usize::from(tdma.superframes);
    let on_air_s = tdma.slot_s - tdma.guard_s;
    let all = format!(
        "{slots} of {} s, guard {} s, settling {} s before each",
        tdma.slot_s, tdma.guard_s, tdma.settle_s
    );
    let on_air = format!("{on_air_s} s each on the air, {:.0} s in all", on_air_s * slots as f64);
    let start =
        tdma.start_utc.map_or_else(|| "when the operator says so".to_owned(), |start| start.to_string());
    vec![("slots", all), ("", on_air), ("start", start)]
}

/// A power in W and in dBm.
fn both_units(power: Watts) -> String {
    if power.0 > 0.0 { format!("{power} ({:.1} dBm)", Dbm::from(power).0) } else { power.to_string() }
}

/// Antennas, scattering, pointing and powers.
pub(super) fn of_the_link(mission: &Mission) -> Vec<(String, String)> {
    let mut lines = Vec::new();
    let antennas = mission.antennas_as_stated();
    for role in Role::BOTH {
        let stated = antennas[role];
        let text = match (&stated.pattern, stated.null_depth_db) {
            (Some(points), _) => measured(points),
            (None, Some(depth_db)) => format!("dipole, its null {depth_db} dB below the largest gain"),
            (None, None) => "ideal dipole, its null without a floor".to_owned(),
        };
        lines.push((format!("antenna of {role}"), text));
    }
    lines.push(("fading".to_owned(), fading(mission)));
    lines.push(("pointing".to_owned(), pointing(mission)));
    for role in Role::BOTH {
        let (power_w, limit) = mission.power_ceiling(role);
        let steps = match &mission.power_steps[role] {
            PowerSteps::Any => String::new(),
            PowerSteps::AtLeast(least_w) => format!(", at least {}", Watts(*least_w)),
            PowerSteps::Levels(levels_w) => {
                let levels: Vec<String> =
                    levels_w.iter().map(|level_w| Watts(*level_w).to_string()).collect();
                format!(", in levels of {}", levels.join(", "))
            }
        };
        let text = format!("up to {}, by {}{steps}", both_units(Watts(power_w)), limit.key());
        lines.push((format!("power of {role}"), text));
    }
    let radio = &mission.radio;
    let carrier = mission.carrier_hz.map_or(String::new(), |hz| format!(" at {} MHz", hz / 1e6));
    let text = format!(
        "{} kHz{carrier}, noise {:e} W ({:.1} dBm), path gain at 1 m {:.1} dB",
        radio.bandwidth_hz / 1e3,
        radio.noise_power_w,
        Dbm::from(Watts(radio.noise_power_w)).0,
        10.0 * radio.reference_gain.log10()
    );
    lines.push(("radio".to_owned(), text));
    lines
}

/// A measured pattern by its number of points and its least gain.
fn measured(points: &[[f64; 2]]) -> String {
    let deepest = points.iter().copied().min_by(|[_, a], [_, b]| a.total_cmp(b));
    let deepest = deepest.map_or(String::new(), |[angle_deg, gain_db]| {
        format!(", the least gain {gain_db} dB at {angle_deg} deg")
    });
    format!("measured in {} points{deepest}", points.len())
}

fn fading(mission: &Mission) -> String {
    let Fading { user, eavesdropper } = mission.fading;
    if !user.is_present() && !eavesdropper.is_present() {
        return "none: nothing is scattered".to_owned();
    }
    let [user_db, eavesdropper_db] = [user, eavesdropper].map(|rician| 10.0 * rician.factor().log10());
    format!("Rician, K {user_db:.1} dB at users, {eavesdropper_db:.1} dB at eavesdroppers")
}

fn pointing(mission: &Mission) -> String {
    let pointing = &mission.pointing;
    let [horizontal_m, vertical_m] = pointing.position_std_m;
    let (heading_deg, mounting_deg) =
        (pointing.heading_std_rad.to_degrees(), pointing.mounting_std_rad.to_degrees());
    if [heading_deg, mounting_deg, horizontal_m, vertical_m].iter().all(|std| *std == 0.0) {
        return "exact".to_owned();
    }
    format!(
        "heading {heading_deg:.2}, mounting {mounting_deg:.2} deg; position {horizontal_m} m, vertically {vertical_m} m"
    )
}

/// The permission, a line for each thing that it states.
pub(super) fn of_the_emission(emission: Option<&Emission>) -> Vec<(&'static str, String)> {
    let Some(emission) = emission else {
        return vec![("emission", "none: simulated transmitters only".to_owned())];
    };
    let [low_mhz, high_mhz] = emission.band_hz.map(|hz| hz / 1e6);
    let most = both_units(Watts(emission.max_power_w));
    let first =
        format!("{low_mhz} to {high_mhz} MHz, at most {most}, authorised by {}", emission.authorised_by);
    let mut lines = vec![("emission", first)];
    let stated = [("licensee", &emission.licensee), ("licence", &emission.licence), ("site", &emission.site)];
    lines.extend(stated.into_iter().filter_map(|(title, text)| Some((title, text.clone()?))));
    let valid = emission.valid.map_or_else(
        || "not stated: simulated transmitters only".to_owned(),
        |[from, until]| format!("{from} to {until}"),
    );
    lines.push(("valid", valid));
    lines
}
