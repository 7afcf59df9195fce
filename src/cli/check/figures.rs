//! What a mission states of its link and of its permission to radiate, in a line each.

use crate::config::{Emission, Mission};
use crate::planner::problem::{Fading, PowerSteps};
use crate::role::Role;
use crate::units::Watts;

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
        let text = format!("up to {}, by {}{steps}", Watts(power_w), limit.key());
        lines.push((format!("power of {role}"), text));
    }
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
    let most = Watts(emission.max_power_w);
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
