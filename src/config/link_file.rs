//! The settings of the link as it is: antennas, scattering, what stays wrong with a pose, and what a radio can give.

use super::draft::{AntennaDraft, FadingDraft, MissionDraft, PlannedVehicleDraft, PointingDraft};
use super::kind::{List, Number, Numbers, PatternRows, Receivers};
use super::mission_file::power;
use super::reader::Section;

const ANGLE: Number = Number::within("deg", 0.0, 30.0);

/// Reads, or checks, or describes, the tables of the link.
pub(super) fn describe(s: &mut Section<'_, '_>, draft: &mut MissionDraft) {
    let sentence = "How good the antennas are; with nothing given, ideal dipoles. For both vehicles, or [antenna.i] and \
                    [antenna.j] for one of them.";
    let antennas = &mut draft.antenna;
    s.table("antenna", sentence, |s| {
        antenna(s, &mut antennas.both);
        s.set_optional_table(
            "i",
            "Vehicle I's antenna, in place of that for both.",
            &mut antennas.i,
            antenna,
        );
        s.set_optional_table(
            "j",
            "Vehicle J's antenna, in place of that for both.",
            &mut antennas.j,
            antenna,
        );
    });
    s.table(
        "fading",
        "What reaches a receiver beside the direct path; with nothing given, nothing does.",
        |s| {
            fading(s, &mut draft.fading);
        },
    );
    let sentence = "What stays wrong with a vehicle's pose during a slot: standard deviations, the same for both; with \
                    nothing given, nothing is wrong.";
    s.table("pointing", sentence, |s| pointing(s, &mut draft.pointing));
}

fn antenna(s: &mut Section<'_, '_>, antenna: &mut AntennaDraft) {
    s.set_optional(
        "null_depth_db",
        "How far the dipole's null lies below its largest gain, by what the frame and the feed leak.",
        Number::within("dB", 0.0, 100.0),
        &mut antenna.null_depth_db,
    );
    let rows = PatternRows { directory: s.directory() };
    s.set_optional(
        "pattern_file",
        "The measured pattern instead: a CSV file, by its path from this file, with the columns angle_deg (0 along the \
         axis to 180) and gain_db (below the largest); or its rows.",
        rows,
        &mut antenna.pattern,
    );
    s.alternatives(&[&["null_depth_db"], &["pattern_file"]], false);
}

fn fading(s: &mut Section<'_, '_>, fading: &mut FadingDraft) {
    s.set_optional(
        "rician_k_db",
        "Rician factor: the direct path's power over that of all others, about each kind of receiver.",
        Receivers(Number::within("dB", -40.0, 100.0)),
        &mut fading.rician_k_db,
    );
}

fn pointing(s: &mut Section<'_, '_>, pointing: &mut PointingDraft) {
    s.set_optional(
        "heading_std_deg",
        "Of the heading: what the compass is wrong by.",
        ANGLE,
        &mut pointing.heading_std_deg,
    );
    s.set_optional(
        "mounting_std_deg",
        "Of the antenna's mounting, about each of body x and y.",
        ANGLE,
        &mut pointing.mounting_std_deg,
    );
    let metres = Number::within("m", 0.0, 100.0);
    s.set_optional(
        "position_std_m",
        "Of the position: in east and in north each, and vertically.",
        Numbers([("horizontal", metres), ("vertical", metres)]),
        &mut pointing.position_std_m,
    );
}

/// What a vehicle's transmitter can give.
pub(super) fn powers(s: &mut Section<'_, '_>, vehicle: &mut PlannedVehicleDraft) {
    s.set_optional(
        "min_power_w",
        "The least power above off that its transmitter can give.",
        power(),
        &mut vehicle.min_power_w,
    );
    s.set_optional(
        "power_levels_w",
        "The only powers above off that its transmitter can give, rising.",
        List { each: Number::positive("W", 1000.0), at_least: 1, at_most: 64 },
        &mut vehicle.power_levels_w,
    );
    s.alternatives(&[&["min_power_w"], &["power_levels_w"]], false);
}
