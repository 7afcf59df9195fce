//! Charts over flight time: slots shaded, marks numbered.

use super::{Format, THEME};
use crate::desk::drawing::axes::{Axes, step, ticks};
use crate::desk::drawing::svg::{Anchor, At, Stroke, Svg, text_width};
use crate::desk::report::facts::Facts;

/// Room for the figures at the left, and free at the right.
const LEFT: f64 = 46.0;
const RIGHT: f64 = 10.0;
/// Room for the marks' numbers.
const TOP: f64 = 20.0;
const BOTTOM: f64 = 22.0;
/// Radius of a mark's disc.
const DISC: f64 = 7.5;

/// One line of a chart.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// For the legend; lines without one are not in it.
    pub label: String,
    /// How it is drawn.
    pub stroke: Stroke,
    /// Flight seconds and value; `None` interrupts the line.
    pub points: Vec<(f64, Option<f64>)>,
}

/// A chart over flight time.
#[derive(Debug, Clone, PartialEq)]
pub struct Chart {
    /// Unique in the page.
    pub id: &'static str,
    /// With the unit.
    pub title: String,
    /// What to look for.
    pub about: String,
    /// Drawn in this order.
    pub series: Vec<Series>,
    /// This value is in the chart whatever the series say.
    pub include: Vec<f64>,
}

impl Chart {
    /// Whether there is anything to show.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.series.iter().any(|series| series.points.iter().any(|(_, value)| value.is_some()))
    }

    /// The drawing.
    #[must_use]
    pub fn draw(&self, facts: &Facts, format: Format) -> String {
        let height = match format {
            Format::Wide => 190.0,
            Format::Narrow => 170.0,
        };
        let size = (format.width(), height);
        let mut svg =
            Svg::inline(&format!("{}-{}", self.id, format.name()), size, THEME, &self.title, &self.about);
        let axes = Axes { y: self.range(), ..time_axes(facts, format, TOP, height - TOP - BOTTOM) };
        let ys = ticks(axes.y, step(axes.y[1] - axes.y[0], 5.0));
        let xs = time_ticks(&axes, format);
        shade_slots(&mut svg, facts, &axes);
        axes.grid(&mut svg, &xs, &ys);
        svg.clipped(axes.corner, axes.size, |svg| {
            for series in &self.series {
                for part in decimated(&series.points, &axes) {
                    svg.line(&part, &series.stroke);
                }
            }
        });
        axes.frame(&mut svg, &xs, &ys, [true, true]);
        draw_marks(&mut svg, facts, &axes);
        svg.finish()
    }

    /// From a whole tick to a whole tick about all values.
    fn range(&self) -> [f64; 2] {
        let values = || {
            let all =
                self.series.iter().flat_map(|series| series.points.iter().filter_map(|(_, value)| *value));
            all.chain(self.include.iter().copied()).filter(|value| value.is_finite())
        };
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        if low > high {
            return [0.0, 1.0];
        }
        let span = (high - low).max(1e-3);
        let step = step(span, 5.0);
        [(low / step + 1e-6).floor() * step, ((high / step + 0.02).ceil() * step).max(low + step)]
    }
}

/// Axes over the whole flight; the values' range is still to be set.
#[must_use]
pub fn time_axes(facts: &Facts, format: Format, top: f64, height: f64) -> Axes {
    let size = (format.width() - LEFT - RIGHT, height);
    Axes { corner: (LEFT, top), size, x: [0.0, facts.end_s.max(1.0)], y: [0.0, 1.0] }
}

/// Ticks of the time axis, as many as there is room for.
#[must_use]
pub fn time_ticks(axes: &Axes, format: Format) -> Vec<f64> {
    let most = match format {
        Format::Wide => 14.0,
        Format::Narrow => 6.0,
    };
    ticks(axes.x, step(axes.x[1] - axes.x[0], most))
}

/// The time in which somebody was on the air for a slot.
pub fn shade_slots(svg: &mut Svg, facts: &Facts, axes: &Axes) {
    for [from_s, until_s] in facts.slots.iter().filter_map(|slot| slot.window_s) {
        let (x, y) = axes.at(from_s, axes.y[1]);
        let (right, bottom) = axes.at(until_s, axes.y[0]);
        svg.rectangle((x, y), (right - x, bottom - y), "var(--slot)", None);
    }
}

/// A line at each mark, with its number above.
pub fn draw_marks(svg: &mut Svg, facts: &Facts, axes: &Axes) {
    let mut taken = f64::NEG_INFINITY;
    for mark in &facts.marks {
        let (x, top) = axes.at(mark.at_s, axes.y[1]);
        let pen = Stroke { colour: "var(--fault)", width: 1.3, dashes: "4 2" };
        svg.line(&[(x, top), (x, axes.bottom())], &pen);
        // Numbers of marks that are close together stand beside each other.
        let at = (x.max(taken + 2.0 * DISC + 1.0), top - DISC - 2.0);
        taken = at.0;
        numbered_disc(svg, at, mark.number);
    }
}

/// A mark's number.
pub fn numbered_disc(svg: &mut Svg, (x, y): At, number: usize) {
    svg.titled(&format!("mark {number}"), |svg| {
        svg.circle((x, y), 0.5 * DISC, &Stroke::solid("var(--fault)", DISC));
        svg.coloured((x, y), Anchor::Middle, "var(--on-fault)", &number.to_string());
    });
}

/// Where a text fits into a stretch of the time axis, if it does.
#[must_use]
pub fn fits(text: &str, from: f64, until: f64) -> bool {
    text_width(text, THEME.text) + 4.0 <= until - from
}

/// The parts of a line, with no more points than can be told apart: of each pixel's values the first, the extremes
/// and the last.
fn decimated(points: &[(f64, Option<f64>)], axes: &Axes) -> Vec<Vec<At>> {
    let mut parts: Vec<Vec<At>> = Vec::new();
    let mut part: Vec<At> = Vec::new();
    let mut pixel: Vec<At> = Vec::new();
    for &(at_s, value) in points {
        let Some(value) = value.filter(|value| value.is_finite()) else {
            flush(&mut part, &mut pixel);
            parts.push(std::mem::take(&mut part));
            continue;
        };
        let at = axes.at(at_s, value);
        if pixel.first().is_some_and(|first| first.0.floor() != at.0.floor()) {
            flush(&mut part, &mut pixel);
        }
        pixel.push(at);
    }
    flush(&mut part, &mut pixel);
    parts.push(part);
    parts.retain(|part| part.len() > 1);
    parts
}

fn flush(part: &mut Vec<At>, pixel: &mut Vec<At>) {
    if pixel.len() > 4 {
        let extreme = |pick: fn(f64, f64) -> bool| {
            (1..pixel.len()).fold(0, |best, k| if pick(pixel[k].1, pixel[best].1) { k } else { best })
        };
        let mut kept = vec![0, extreme(|a, b| a < b), extreme(|a, b| a > b), pixel.len() - 1];
        kept.sort_unstable();
        kept.dedup();
        part.extend(kept.into_iter().map(|k| pixel[k]));
    } else {
        part.append(pixel);
    }
    pixel.clear();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_decimation_keeps_extremes_and_gaps() {
        let axes = Axes { corner: (0.0, 0.0), size: (100.0, 100.0), x: [0.0, 100.0], y: [0.0, 1.0] };
        let mut points: Vec<(f64, Option<f64>)> =
            (0..10_000).map(|k| (f64::from(k) * 0.01, Some(0.5))).collect();
        points[5_050].1 = Some(1.0);
        points[7_070].1 = None;
        let parts = decimated(&points, &axes);
        assert_eq!(parts.len(), 2);
        let all: Vec<At> = parts.concat();
        assert!(all.len() < 500 && all.iter().any(|at| at.1 == 0.0));
        assert!(all[0].0 == 0.0 && (all[all.len() - 1].0 - 99.99).abs() < 1e-9);
    }
}
