//! A linear coordinate system in a rectangle of a drawing: scales, ticks, frame.

use super::svg::{Anchor, At, Stroke, Svg, Theme};

/// Length of a tick outside the frame, in points.
const TICK_PT: f64 = 3.0;

/// A rectangle with scales.
#[derive(Debug, Clone, PartialEq)]
pub struct Axes {
    /// Upper left corner in points.
    pub corner: At,
    /// Width and height in points.
    pub size: At,
    /// Values at the left and right edges.
    pub x: [f64; 2],
    /// Values at the lower and upper edges.
    pub y: [f64; 2],
}

impl Axes {
    /// Where a value pair is in the drawing.
    pub fn at(&self, x: f64, y: f64) -> At {
        let along = |v: f64, [from, to]: [f64; 2]| (v - from) / (to - from);
        (
            self.corner.0 + self.size.0 * along(x, self.x),
            self.corner.1 + self.size.1 * (1.0 - along(y, self.y)),
        )
    }

    /// The lower edge in points.
    pub fn bottom(&self) -> f64 {
        self.corner.1 + self.size.1
    }

    /// Grid lines across the rectangle.
    pub fn grid(&self, svg: &mut Svg, xs: &[f64], ys: &[f64]) {
        let pen = Stroke::solid(svg.theme().grid, 0.5);
        for x in xs {
            svg.line(&[self.at(*x, self.y[0]), self.at(*x, self.y[1])], &pen);
        }
        for y in ys {
            svg.line(&[self.at(self.x[0], *y), self.at(self.x[1], *y)], &pen);
        }
    }

    /// The frame with ticks below and to the left; figures where `lettered` says so (x, y).
    pub fn frame(&self, svg: &mut Svg, xs: &[f64], ys: &[f64], lettered: [bool; 2]) {
        let Theme { ink, text, .. } = svg.theme();
        let pen = Stroke::solid(ink, 0.8);
        svg.rectangle(self.corner, self.size, "none", Some(&pen));
        for x in xs {
            let (px, py) = self.at(*x, self.y[0]);
            svg.line(&[(px, py), (px, py + TICK_PT)], &pen);
            if lettered[0] {
                svg.text((px, py + TICK_PT + 0.6875 * text), Anchor::Middle, &figure(*x));
            }
        }
        for y in ys {
            let (px, py) = self.at(self.x[0], *y);
            svg.line(&[(px, py), (px - TICK_PT, py)], &pen);
            if lettered[1] {
                svg.text((px - TICK_PT - 2.0, py), Anchor::End, &figure(*y));
            }
        }
    }
}

/// A step of 1, 2 or 5 times a power of ten that cuts `span` into at most `most` parts.
pub fn step(span: f64, most: f64) -> f64 {
    let least = span.max(f64::MIN_POSITIVE) / most;
    let power = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= least * (1.0 - 1e-9)).unwrap_or(power)
}

/// The multiples of `step` in a range.
pub fn ticks([from, to]: [f64; 2], step: f64) -> Vec<f64> {
    let slack = 1e-9 * step;
    let first = ((from - slack) / step).ceil();
    let count = ((to + slack) / step).floor() - first;
    (0..=count.clamp(-1.0, 1e3) as i64).map(|k| (first + k as f64) * step).collect()
}

/// A tick's figure: as short as it can be, with a true minus sign.
pub fn figure(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded }).replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_corners_map_to_corners() {
        let axes = Axes { corner: (10.0, 20.0), size: (100.0, 50.0), x: [-1.0, 1.0], y: [0.0, 5.0] };
        assert_eq!(axes.at(-1.0, 0.0), (10.0, 70.0));
        assert_eq!(axes.at(1.0, 5.0), (110.0, 20.0));
        assert_eq!(axes.at(0.0, 2.5), (60.0, 45.0));
    }

    #[test]
    fn spec_ticks_are_round() {
        assert_eq!(step(30.0, 6.0), 5.0);
        assert_eq!(step(0.25, 5.0), 0.05);
        assert_eq!(ticks([-12.0, 27.0], 10.0), [-10.0, 0.0, 10.0, 20.0]);
        assert_eq!(figure(-0.30000000000000004), "\u{2212}0.3");
    }
}
