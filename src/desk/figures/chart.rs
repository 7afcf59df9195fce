//! Curves over one abscissa, in panels below one another, at the width of a printed column.

use super::scenario::Summary;
use crate::desk::drawing::axes::{Axes, step, ticks};
use crate::desk::drawing::svg::{Anchor, At, Marker, Stroke, Svg, TEXT_PT, text_width, wrapped};

/// Width of a column of the paper in points (3.5 inches).
const WIDTH: f64 = 252.0;
const LEFT: f64 = 32.0;
/// Free at the right, and to the left of the legend.
const MARGIN: f64 = 6.0;
/// Height of the first panel, and of every other.
const HEIGHTS: [f64; 2] = [150.0, 64.0];
/// Between two panels.
const SPACE: f64 = 9.0;
/// From the lowest frame to the end of the drawing: figures and label of the abscissa.
const FOOT: f64 = 29.0;
const LEGEND_ROW: f64 = 11.0;
const MARKER_PT: f64 = 2.7;
const BAND_OPACITY: f64 = 0.18;

/// How a curve is drawn: told apart by colour, by dashes and by marker, so that grey print will do.
#[derive(Debug, Clone, Copy)]
pub(super) struct Style {
    pub label: &'static str,
    pub stroke: Stroke,
    pub marker: Option<Marker>,
}

impl Style {
    pub const fn new(
        label: &'static str,
        colour: &'static str,
        width: f64,
        dashes: &'static str,
        marker: Option<Marker>,
    ) -> Self {
        Self { label, stroke: Stroke { colour, width, dashes }, marker }
    }
}

/// A curve in a panel: value and half width of its band by the value of the abscissa.
pub(super) struct Line {
    style: Style,
    points: Vec<(f64, f64)>,
}

impl Line {
    /// Means and their standard errors.
    pub fn new(style: Style, summaries: &[Summary]) -> Self {
        Self { style, points: summaries.iter().map(|s| (s.mean, s.standard_error)).collect() }
    }
}

/// Curves in a frame of their own, best first.
pub(super) struct Panel {
    pub label: String,
    pub lines: Vec<Line>,
    /// Parts that ticks cut its ordinate into, at most.
    pub most_ticks: f64,
}

/// See the module.
pub(super) struct Chart<'a> {
    pub title: String,
    /// Paragraphs.
    pub caption: Vec<String>,
    /// Row by row.
    pub legend: Vec<Vec<Style>>,
    pub abscissa: &'a str,
    /// Its values, rising.
    pub values: &'a [f64],
    /// One at least.
    pub panels: Vec<Panel>,
}

/// The drawing, as SVG.
pub(super) fn draw(chart: &Chart) -> String {
    let lines = chart.caption.iter().flat_map(|line| wrapped(line, TEXT_PT, WIDTH - 2.0 * MARGIN));
    let lines: Vec<String> = lines.collect();
    let top = 6.0 + LEGEND_ROW * (lines.len() + chart.legend.len()) as f64 + 3.0;
    let heights = || (0..chart.panels.len()).map(|panel| HEIGHTS[panel.min(1)]);
    let height = top + heights().map(|height| height + SPACE).sum::<f64>() - SPACE + FOOT;
    let mut svg = Svg::new(WIDTH, height, &chart.title, &lines.join(" "));
    for (row, line) in lines.iter().enumerate() {
        svg.text((MARGIN, 7.0 + LEGEND_ROW * row as f64), Anchor::Start, line);
    }
    draw_legend(&mut svg, &chart.legend, 7.0 + LEGEND_ROW * lines.len() as f64);

    let width = WIDTH - LEFT - MARGIN;
    let (first, last) = (chart.values[0], chart.values[chart.values.len() - 1]);
    // Free beyond the first and the last value, as a share of what lies between them.
    let free = 0.05 * (last - first);
    let mut corner = (LEFT, top);
    for (index, (panel, height)) in chart.panels.iter().zip(heights()).enumerate() {
        let (x, y) = ([first - free, last + free], range(panel));
        let axes = Axes { corner, size: (width, height), x, y };
        draw_panel(&mut svg, &axes, chart.values, panel, index + 1 == chart.panels.len());
        svg.text_upwards((7.5, corner.1 + height / 2.0), &panel.label);
        corner.1 = axes.bottom() + SPACE;
    }
    svg.text((LEFT + width / 2.0, height - 7.0), Anchor::Middle, chart.abscissa);
    svg.finish()
}

/// From 0, or the lowest value drawn if it is below, to a whole tick above the highest.
fn range(panel: &Panel) -> [f64; 2] {
    let all = || panel.lines.iter().flat_map(|line| &line.points);
    let low = all().map(|(v, half)| v - half).fold(0.0, f64::min);
    let high = all().map(|(v, half)| v + half).fold(1e-3, f64::max);
    let step = step(high - low, panel.most_ticks);
    [(low / step).floor() * step, (high / step + 0.1).ceil() * step]
}

fn draw_panel(svg: &mut Svg, axes: &Axes, values: &[f64], panel: &Panel, lettered: bool) {
    let lines = &panel.lines;
    let ys = ticks(axes.y, step(axes.y[1] - axes.y[0], panel.most_ticks));
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
