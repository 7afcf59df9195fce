//! The drawing of all figures of rates, at the width of a printed column.

use super::rates::{Curve, HEADING_DEG, JITTER_DEG, Rates, STARTS, Study, UNCERTAINTY_M};
use super::scenario::Summary;
use crate::desk::drawing::axes::{Axes, step, ticks};
use crate::desk::drawing::svg::{Anchor, At, Marker, Stroke, Svg, TEXT_PT, text_width, wrapped};

/// Width of a column of the paper in points (3.5 inches).
const WIDTH: f64 = 252.0;
const LEFT: f64 = 32.0;
/// Free at the right, and to the left of the legend.
const MARGIN: f64 = 6.0;
const PLOT_HEIGHT: f64 = 150.0;
/// Height of the panel of gaps, and of the space above it.
const GAP_HEIGHT: f64 = 64.0;
const GAP_SPACE: f64 = 9.0;
/// From the lowest frame to the end of the drawing: figures and label of the power axis.
const FOOT: f64 = 29.0;
const LEGEND_ROW: f64 = 11.0;
const MARKER_PT: f64 = 2.7;
const BAND_OPACITY: f64 = 0.18;

/// How a curve is drawn: told apart by colour, by dashes and by marker, so that grey print will do.
#[derive(Debug, Clone, Copy)]
struct Style {
    label: &'static str,
    stroke: Stroke,
    marker: Option<Marker>,
}

fn style(curve: &Curve) -> Style {
    let style = |label, colour, width, dashes, marker| Style {
        label,
        stroke: Stroke { colour, width, dashes },
        marker,
    };
    match curve.name {
        "cap" => style("upper bound (cap)", "#000000", 0.8, "6 1.5", None),
        "veilwing" => style("veilwing", "#0b5394", 1.5, "", Some(Marker::Disc)),
        "knowing" => style("plan that knows, mean", "#0b5394", 1.5, "", Some(Marker::Disc)),
        "knowing-5pct" => style("its 5% quantile", "#3d9bd9", 1.2, "1.5 1.5", Some(Marker::Circle)),
        "unknowing" => style("ideal plan, mean", "#c8500a", 1.2, "5 2", Some(Marker::OpenSquare)),
        "unknowing-5pct" => style("its 5% quantile", "#7d7d7d", 1.2, "1.2 1.6", Some(Marker::Diamond)),
        "veilwing-on-estimates" => {
            style("veilwing, on estimates", "#3d9bd9", 1.2, "1.5 1.5", Some(Marker::Circle))
        }
        "paper" => style("paper", "#c8500a", 1.2, "5 2", Some(Marker::OpenSquare)),
        "interior-point" => style("interior point", "#2f8f5b", 1.2, "6 2 1.2 2", Some(Marker::Triangle)),
        "conventional" => style("conventional", "#7d7d7d", 1.2, "1.2 1.6", Some(Marker::Diamond)),
        // Beside its method's in the legend: thin, and without a marker.
        "paper-one-start" => style("from one start", "#c8500a", 0.8, "3 1.5", None),
        "interior-point-one-start" => style("from one start", "#2f8f5b", 0.8, "4 1.5 1 1.5", None),
        _ => style("from one start", "#7d7d7d", 0.8, "1 1.2", None),
    }
}

/// The figure.
pub fn draw(rates: &Rates) -> String {
    let lines = caption(rates);
    let legend = legend_rows(rates);
    let top = 6.0 + LEGEND_ROW * (lines.len() + legend.len()) as f64 + 3.0;
    let height = top + PLOT_HEIGHT + GAP_SPACE + GAP_HEIGHT + FOOT;
    let abscissa = rates.study.abscissa();
    let title = format!("Secrecy rate over {} ({})", abscissa.title, rates.study.name());
    let mut svg = Svg::new(WIDTH, height, &title, &lines.join(" "));
    for (row, line) in lines.iter().enumerate() {
        svg.text((MARGIN, 7.0 + LEGEND_ROW * row as f64), Anchor::Start, line);
    }
    draw_legend(&mut svg, &legend, 7.0 + LEGEND_ROW * lines.len() as f64);

    let width = WIDTH - LEFT - MARGIN;
    let values = abscissa.values;
    let (first, last) = (values[0], values[values.len() - 1]);
    // Free beyond the first and the last value, as a share of what lies between them.
    let free = 0.05 * (last - first);
    let axes = |top: f64, height: f64, y: [f64; 2]| Axes {
        corner: (LEFT, top),
        size: (width, height),
        x: [first - free, last + free],
        y,
    };
    let means = rates.curves.iter().map(|c| Line::new(&c.curve, &c.rates)).collect::<Vec<_>>();
    let gaps = rates.curves.iter().map(|c| Line::new(&c.curve, &c.gaps)).collect::<Vec<_>>();
    let above = axes(top, PLOT_HEIGHT, range(&means, 6.0));
    panel(&mut svg, &above, &values, &means, false, 6.0);
    svg.text_upwards((7.5, top + PLOT_HEIGHT / 2.0), "secrecy rate (bit/s/Hz)");
    let below = axes(above.bottom() + GAP_SPACE, GAP_HEIGHT, range(&gaps, 3.0));
    panel(&mut svg, &below, &values, &gaps, true, 3.0);
    svg.text_upwards((7.5, below.corner.1 + GAP_HEIGHT / 2.0), &format!("below {}", rates.study.gap_to()));
    svg.text((LEFT + width / 2.0, height - 7.0), Anchor::Middle, abscissa.title);
    svg.finish()
}

/// A curve in a panel: value and half width of its band by the value of the abscissa.
struct Line {
    style: Style,
    points: Vec<(f64, f64)>,
}

impl Line {
    fn new(curve: &Curve, summaries: &[Summary]) -> Self {
        Self { style: style(curve), points: summaries.iter().map(|s| (s.mean, s.standard_error)).collect() }
    }
}

/// From 0, or the lowest value drawn if it is below, to a whole tick above the highest.
fn range(lines: &[Line], most_ticks: f64) -> [f64; 2] {
    let all = || lines.iter().flat_map(|line| &line.points);
    let low = all().map(|(v, half)| v - half).fold(0.0, f64::min);
    let high = all().map(|(v, half)| v + half).fold(1e-3, f64::max);
    let step = step(high - low, most_ticks);
    [(low / step).floor() * step, (high / step + 0.1).ceil() * step]
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
    lines.iter().flat_map(|line| wrapped(line, TEXT_PT, WIDTH - 2.0 * MARGIN)).collect()
}

fn panel(svg: &mut Svg, axes: &Axes, values: &[f64], lines: &[Line], lettered: bool, most_ticks: f64) {
    let ys = ticks(axes.y, step(axes.y[1] - axes.y[0], most_ticks));
    axes.grid(svg, &[], &ys);
    let at = |rates: &mut dyn Iterator<Item = f64>| -> Vec<At> {
        values.iter().zip(rates).map(|(value, rate)| axes.at(*value, rate)).collect()
    };
    svg.clipped(axes.corner, axes.size, |svg| {
        for line in lines.iter().filter(|line| line.style.marker.is_some()) {
            let mut band = at(&mut line.points.iter().map(|(v, half)| v + half));
            band.extend(at(&mut line.points.iter().map(|(v, half)| v - half)).into_iter().rev());
            svg.area(&band, line.style.stroke.colour, BAND_OPACITY);
        }
        // Best first in the list: drawn last, on top.
        for line in lines.iter().rev() {
            svg.line(&at(&mut line.points.iter().map(|p| p.0)), &line.style.stroke);
        }
    });
    for line in lines.iter().rev() {
        let Some(marker) = line.style.marker else { continue };
        for place in at(&mut line.points.iter().map(|p| p.0)) {
            svg.marker(place, marker, line.style.stroke.colour, MARKER_PT);
        }
    }
    axes.frame(svg, values, &ys, [lettered, true]);
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

fn draw_legend(svg: &mut Svg, rows: &[Vec<Style>], top: f64) {
    let first_column = rows.iter().filter_map(|row| row.first());
    let widest = first_column.map(|style| text_width(style.label, TEXT_PT)).fold(0.0, f64::max);
    for (r, row) in rows.iter().enumerate() {
        for (column, style) in row.iter().enumerate() {
            let (x, y) = (MARGIN + column as f64 * (24.0 + widest + 8.0), top + LEGEND_ROW * r as f64);
            svg.line(&[(x, y), (x + 20.0, y)], &style.stroke);
            if let Some(marker) = style.marker {
                svg.marker((x + 10.0, y), marker, style.stroke.colour, MARKER_PT);
            }
            svg.text((x + 24.0, y), Anchor::Start, style.label);
        }
    }
}
