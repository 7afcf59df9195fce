//! What the charts over time show.

use super::time::{Chart, Series};
use super::{colour, faint};
use crate::desk::drawing::svg::Stroke;
use crate::desk::report::facts::Facts;
use crate::desk::report::timeline::{Heard, Sample, Source, VehicleState};
use crate::role::Role;
use crate::units::{Dbm, Watts};

/// Jittering quantities are shown as a mean over this time on either side, before their own thin line.
const SMOOTHING_S: f64 = 0.5;
/// More eavesdroppers than this are shown by the strongest alone.
const MOST_EAVESDROPPERS: usize = 4;
/// Tells eavesdroppers apart without colour.
const DASHES: [&str; MOST_EAVESDROPPERS] = ["", "7 3", "2 2.5", "9 3 2 3"];
/// The pose is compared with a slot's plan from this long before its first emission.
const LEAD_S: f64 = 1.0;

type Points = Vec<(f64, Option<f64>)>;

/// The charts of a flight, in the order of the page; those with nothing to show are left out.
#[must_use]
pub fn charts(facts: &Facts) -> Vec<Chart> {
    let mut all: Vec<Chart> = rates(facts).into_iter().chain(sinrs(facts)).collect();
    all.extend([
        powers(facts),
        position_errors(facts),
        attitude_errors(facts),
        heights(facts),
        separation(facts),
    ]);
    all.retain(|chart| !chart.is_empty());
    all
}

fn line(label: &str, colour: &'static str, width: f64, dashes: &'static str, points: Points) -> Series {
    Series { label: label.into(), stroke: Stroke { colour, width, dashes }, points }
}

fn over_time(facts: &Facts, value: impl Fn(&Sample) -> Option<f64>) -> Points {
    facts.timeline.samples.iter().map(|sample| (sample.at_s, value(sample))).collect()
}

fn of_vehicle(facts: &Facts, role: Role, value: impl Fn(&VehicleState) -> Option<f64>) -> Points {
    over_time(facts, |sample| sample.vehicles[role].as_ref().and_then(&value))
}

/// How the truth is called.
fn how(facts: &Facts) -> &'static str {
    match facts.timeline.scene.source {
        Source::Simulation => "true positions, attitudes and powers",
        Source::Telemetry => {
            "estimated from the vehicles' own telemetry and the mission's eavesdropper positions"
        }
    }
}

fn rates(facts: &Facts) -> Option<Chart> {
    let bandwidth_hz = facts.timeline.scene.radio?.bandwidth_hz;
    let achieved = over_time(facts, |s| s.heard.as_ref().map(|heard| heard.secrecy_rate_bps / bandwidth_hz));
    let mut planned = Points::new();
    for slot in &facts.slots {
        if let (Some([from_s, until_s]), Some(bps)) = (slot.window_s, slot.planned_bps) {
            let rate = Some(bps / bandwidth_hz);
            planned.extend([(from_s, rate), (until_s, rate), (until_s, None)]);
        }
    }
    Some(Chart {
        id: "chart-rate",
        title: "Secrecy rate (bit/s/Hz)".into(),
        about: format!("While I is on the air, against the plan's expectation; {}.", how(facts)),
        series: vec![
            line("", "var(--i-faint)", 0.8, "", achieved.clone()),
            line("achieved, mean over 1 s", colour(Role::I), 2.0, "", smoothed(&achieved)),
            line("planned", "var(--ink)", 1.4, "6 3", planned),
        ],
        include: vec![0.0],
    })
}

fn sinrs(facts: &Facts) -> Option<Chart> {
    let listeners = &facts.timeline.scene.eavesdroppers;
    let db = |linear: f64| (linear > 0.0).then(|| 10.0 * linear.log10());
    let heard = |value: &dyn Fn(&Heard) -> Option<f64>| {
        over_time(facts, |s| s.heard.as_ref().and_then(value).and_then(db))
    };
    let user = heard(&|heard| Some(heard.user_sinr));
    let mut series = vec![
        line("", "var(--user-faint)", 0.8, "", user.clone()),
        line("user served", "var(--user)", 2.0, "", smoothed(&user)),
    ];
    if listeners.len() > MOST_EAVESDROPPERS {
        let strongest = heard(&|heard| heard.eavesdropper_sinr.iter().copied().reduce(f64::max));
        let label = format!("strongest of {} eavesdroppers", listeners.len());
        series.push(line("", "var(--eve-faint)", 0.8, "", strongest.clone()));
        series.push(line(&label, "var(--eve)", 1.8, "", smoothed(&strongest)));
    } else {
        for (k, listener) in listeners.iter().enumerate() {
            let points = heard(&|heard| heard.eavesdropper_sinr.get(k).copied());
            let label = format!("eavesdropper {}", listener.name);
            series.push(line(&label, "var(--eve)", 1.5, DASHES[k % DASHES.len()], smoothed(&points)));
        }
    }
    let about = format!("Signal of I over the jamming of J and the noise; means over 1 s; {}.", how(facts));
    Some(Chart { id: "chart-sinr", title: "SINR (dB)".into(), about, series, include: Vec::new() })
}

fn powers(facts: &Facts) -> Chart {
    let series = |role: Role| {
        let steps = of_vehicle(facts, role, |v| v.tx_power_w.map(|watts| Dbm::from(Watts(watts)).0));
        // A power holds until the next sample.
        let mut points = Points::new();
        for (k, &(at_s, value)) in steps.iter().enumerate() {
            points.push((at_s, value));
            if let Some(&(next_s, next)) = steps.get(k + 1).filter(|next| next.1 != value) {
                points.push((next_s, value));
                points.extend(next.is_none().then_some((next_s, None)));
            }
        }
        line(
            &format!("{role} ({})", job(role)),
            colour(role),
            2.2,
            if role == Role::I { "" } else { "7 3" },
            points,
        )
    };
    let about = match facts.timeline.scene.source {
        Source::Simulation => "Radiated power; no line: silent.",
        Source::Telemetry => {
            "Power that the transmitter acknowledged, until its expiry or its off; no line: silent."
        }
    };
    Chart {
        id: "chart-power",
        title: "Transmit power (dBm)".into(),
        about: about.into(),
        series: Role::BOTH.map(series).into(),
        include: vec![0.0],
    }
}

fn job(role: Role) -> &'static str {
    match role {
        Role::I => "information",
        Role::J => "jamming",
    }
}

/// A pose error over time, in and just before the slots.
fn error_points(
    facts: &Facts,
    role: Role,
    pick: impl Fn(&super::super::facts::PoseError) -> Option<f64>,
) -> Points {
    let windows: Vec<(u16, [f64; 2])> =
        facts.slots.iter().filter_map(|slot| Some((slot.number, slot.window_s?))).collect();
    over_time(facts, |sample| {
        let inside = |[from_s, until_s]: &[f64; 2]| sample.at_s >= from_s - LEAD_S && sample.at_s <= *until_s;
        let (slot, _) = windows.iter().find(|(_, window)| inside(window))?;
        facts.pose_error(*slot, role, sample.vehicles[role].as_ref()).as_ref().and_then(&pick)
    })
}

fn position_errors(facts: &Facts) -> Chart {
    let series = |role: Role| {
        let dashes = if role == Role::I { "" } else { "7 3" };
        let points = error_points(facts, role, |error| Some(error.position_m));
        line(&role.to_string(), colour(role), 1.8, dashes, points)
    };
    Chart {
        id: "chart-position",
        title: "Position error (m)".into(),
        about: "Distance from the slot's planned position, from a second before its first emission.".into(),
        series: Role::BOTH.map(series).into(),
        include: vec![0.0, 0.1],
    }
}

fn attitude_errors(facts: &Facts) -> Chart {
    let mut series = Vec::new();
    let mut bold = Vec::new();
    for role in Role::BOTH {
        let dashes = if role == Role::I { "" } else { "7 3" };
        let whole = error_points(facts, role, |error| Some(error.attitude_deg));
        let held = error_points(facts, role, |error| error.held_deg);
        series.push(line("", faint(role), 0.8, "", whole.clone()));
        if held.iter().any(|(_, value)| value.is_some()) {
            bold.push(line(&format!("{role}, without the jitter"), colour(role), 1.8, dashes, held));
        } else {
            bold.push(line(&format!("{role}, mean over 1 s"), colour(role), 1.8, dashes, smoothed(&whole)));
        }
    }
    series.extend(bold);
    Chart {
        id: "chart-attitude",
        title: "Attitude error (deg)".into(),
        about: "Angle to the slot's planned attitude; thin: of the antenna, jitter included.".into(),
        series,
        include: vec![0.0, 1.0],
    }
}

fn heights(facts: &Facts) -> Chart {
    let height = |role: Role| {
        let dashes = if role == Role::I { "" } else { "7 3" };
        line(
            &role.to_string(),
            colour(role),
            1.8,
            dashes,
            of_vehicle(facts, role, |v| Some(v.position_enu_m[2])),
        )
    };
    let mut series: Vec<Series> = Role::BOTH.map(height).into();
    let mut about = String::from("Above the mission's origin.");
    if let Some(airspace) = &facts.timeline.scene.airspace {
        let [low, high] = airspace.altitude_m;
        about = format!("Above the mission's origin. Slots are flown between {low:.0} and {high:.0} m.");
        let floor = vec![(0.0, Some(low)), (facts.end_s, Some(low))];
        series.push(line("lowest height of a slot", "var(--muted)", 1.0, "2 3", floor));
    }
    Chart { id: "chart-height", title: "Height (m)".into(), about, series, include: vec![0.0] }
}

fn separation(facts: &Facts) -> Chart {
    let apart = over_time(facts, |sample| {
        let (i, j) = (sample.vehicles.i.as_ref()?, sample.vehicles.j.as_ref()?);
        let squares = (0..3).map(|k| (i.position_enu_m[k] - j.position_enu_m[k]).powi(2));
        Some(squares.sum::<f64>().sqrt())
    });
    let mut series = vec![line("distance between I and J", "var(--ink)", 1.8, "", apart)];
    if let Some(airspace) = &facts.timeline.scene.airspace {
        let least = Some(airspace.min_separation_m);
        series.push(line(
            "least allowed",
            "var(--fault)",
            1.2,
            "6 3",
            vec![(0.0, least), (facts.end_s, least)],
        ));
    }
    let about = "Between the two vehicles, in space.".into();
    Chart { id: "chart-separation", title: "Separation (m)".into(), about, series, include: vec![0.0] }
}

/// A mean over [`SMOOTHING_S`] on either side, not across gaps.
fn smoothed(points: &Points) -> Points {
    let mut smooth = Points::with_capacity(points.len());
    let mut begin = 0;
    while begin < points.len() {
        let gap = points[begin..].iter().position(|(_, value)| value.is_none());
        let end = gap.map_or(points.len(), |length| begin + length);
        let (mut low, mut high, mut sum) = (begin, begin, 0.0);
        for &(at_s, _) in &points[begin..end] {
            while high < end && points[high].0 <= at_s + SMOOTHING_S {
                sum += points[high].1.unwrap_or(0.0);
                high += 1;
            }
            while points[low].0 < at_s - SMOOTHING_S {
                sum -= points[low].1.unwrap_or(0.0);
                low += 1;
            }
            smooth.push((at_s, Some(sum / (high - low) as f64)));
        }
        if end < points.len() {
            smooth.push((points[end].0, None));
        }
        begin = end + 1;
    }
    smooth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_smoothing_is_a_mean_and_respects_gaps() {
        let mut points: Points =
            (0..100).map(|k| (f64::from(k) * 0.1, Some(if k % 2 == 0 { 1.0 } else { 3.0 }))).collect();
        points[50].1 = None;
        let smooth = smoothed(&points);
        assert_eq!(smooth.len(), points.len());
        assert_eq!(smooth[50].1, None);
        // Eleven values about an even one: six of its own kind and five of the other, or the reverse.
        assert!((smooth[20].1.unwrap() - 2.0).abs() < 0.1 && (smooth[75].1.unwrap() - 2.0).abs() < 0.1);
        // The gap is not bridged: the last value before it has seen nothing behind it.
        assert!((smooth[49].1.unwrap() - 2.0).abs() < 0.4);
    }
}
