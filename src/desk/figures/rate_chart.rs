//! The drawing of all figures of rates.

use super::chart::{self, Chart, Line, Panel, Style};
use super::rates::{Curve, CurveRates, HEADING_DEG, JITTER_DEG, Rates, STARTS, Study, UNCERTAINTY_M};
use super::scenario::Summary;
use crate::desk::drawing::svg::Marker;

fn style(curve: &Curve) -> Style {
    match curve.name {
        "cap" => Style::new("upper bound (cap)", "#000000", 0.8, "6 1.5", None),
        "veilwing" => Style::new("veilwing", "#0b5394", 1.5, "", Some(Marker::Disc)),
        "knowing" => Style::new("plan that knows, mean", "#0b5394", 1.5, "", Some(Marker::Disc)),
        "knowing-5pct" => Style::new("its 5% quantile", "#3d9bd9", 1.2, "1.5 1.5", Some(Marker::Circle)),
        "unknowing" => Style::new("ideal plan, mean", "#c8500a", 1.2, "5 2", Some(Marker::OpenSquare)),
        "unknowing-5pct" => Style::new("its 5% quantile", "#7d7d7d", 1.2, "1.2 1.6", Some(Marker::Diamond)),
        "veilwing-on-estimates" => {
            Style::new("veilwing, on estimates", "#3d9bd9", 1.2, "1.5 1.5", Some(Marker::Circle))
        }
        "paper" => Style::new("paper", "#c8500a", 1.2, "5 2", Some(Marker::OpenSquare)),
        "interior-point" => Style::new("interior point", "#2f8f5b", 1.2, "6 2 1.2 2", Some(Marker::Triangle)),
        "conventional" => Style::new("conventional", "#7d7d7d", 1.2, "1.2 1.6", Some(Marker::Diamond)),
        // Beside its method's in the legend: thin, and without a marker.
        "paper-one-start" => Style::new("from one start", "#c8500a", 0.8, "3 1.5", None),
        "interior-point-one-start" => Style::new("from one start", "#2f8f5b", 0.8, "4 1.5 1 1.5", None),
        _ => Style::new("from one start", "#7d7d7d", 0.8, "1 1.2", None),
    }
}

/// The figure.
pub fn draw(rates: &Rates) -> String {
    let abscissa = rates.study.abscissa();
    let panel = |label: String, most_ticks: f64, of: fn(&CurveRates) -> &[Summary]| {
        let lines = rates.curves.iter().map(|curve| Line::new(style(&curve.curve), of(curve))).collect();
        Panel { label, lines, most_ticks }
    };
    chart::draw(&Chart {
        title: format!("Secrecy rate over {} ({})", abscissa.title, rates.study.name()),
        caption: caption(rates),
        legend: legend_rows(rates),
        abscissa: abscissa.title,
        values: &abscissa.values,
        panels: vec![
            panel("secrecy rate (bit/s/Hz)".to_owned(), 6.0, |curve| &curve.rates),
            panel(format!("below {}", rates.study.gap_to()), 3.0, |curve| &curve.gaps),
        ],
    })
}

fn caption(rates: &Rates) -> Vec<String> {
    let what = match rates.study {
        Study::Plain => "No jitter, positions known".to_owned(),
        Study::Jitter => format!("Roll and pitch jitter by {JITTER_DEG}\u{b0}, positions known"),
        Study::Uncertain => {
            format!("Jitter {JITTER_DEG}\u{b0}, eavesdroppers within {UNCERTAINTY_M} m of their estimates")
        }
        Study::NullDepth | Study::Scattering => {
            format!("Jitter {JITTER_DEG}\u{b0}, headings wrong by {HEADING_DEG}\u{b0} rms, 0.5 W")
        }
    };
    let mut lines =
        vec![what, format!("Mean of {} scenarios (bit/s/Hz); band: \u{b1} standard error", rates.scenarios)];
    if let Some(note) = rates.paper_to_interior_point() {
        lines.push(format!("Every method from {STARTS} starts, unless one is said. {note}"));
    }
    lines
}

/// The legend in rows of two: a method's curve with that from one start, the others as they come.
fn legend_rows(rates: &Rates) -> Vec<Vec<Style>> {
    let one_start = |of: &Curve| {
        let mut curves = rates.curves.iter().map(|c| &c.curve);
        curves.find(|curve| curve.from_more_starts() == Some(of.name))
    };
    let (mut alone, mut paired) = (Vec::new(), Vec::new());
    for curve in rates.curves.iter().map(|c| &c.curve).filter(|c| c.from_more_starts().is_none()) {
        match one_start(curve) {
            Some(other) => paired.push(vec![style(curve), style(other)]),
            None => alone.push(style(curve)),
        }
    }
    alone.chunks(2).map(<[Style]>::to_vec).chain(paired).collect()
}
