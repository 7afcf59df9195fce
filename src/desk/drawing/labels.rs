//! Places labels beside their points, clear of what is drawn already.

use super::svg::{At, text_width};

/// A box: left, top, right, bottom, in points.
type Box = [f64; 4];

/// What is taken, in a rectangle of the drawing.
#[derive(Debug, Clone)]
pub struct Labels {
    frame: Box,
    /// Size of the lettering.
    text: f64,
    taken: Vec<Box>,
    lines: Vec<Box>,
}

/// Distances of a label's box from its point, in points, near ones first.
const DISTANCES: [f64; 7] = [6.0, 9.0, 13.0, 18.0, 25.0, 34.0, 46.0];
/// Directions tried at each distance.
const DIRECTIONS: usize = 16;
/// A marker or another label that is covered counts as so many lines: what is written over cannot be read at all.
const WRITTEN: f64 = 12.0;
/// Area in square points that a point of distance is worth.
const NEARNESS: f64 = 0.4;

impl Labels {
    /// Nothing drawn yet; lettering of size `text`.
    pub fn new((x, y): At, (w, h): At, text: f64) -> Self {
        Self {
            frame: [x + 1.0, y + 1.0, x + w - 1.0, y + h - 1.0],
            text,
            taken: Vec::new(),
            lines: Vec::new(),
        }
    }

    /// Keeps clear of a marker.
    pub fn avoid(&mut self, (x, y): At, radius: f64) {
        self.taken.push([x - radius, y - radius, x + radius, y + radius]);
    }

    /// Keeps clear of a line's part in the frame.
    pub fn avoid_line(&mut self, from: At, to: At) {
        let length = (to.0 - from.0).hypot(to.1 - from.1);
        let parts = (length / 3.0).ceil().clamp(1.0, 4000.0) as usize;
        for k in 0..=parts {
            let t = k as f64 / parts as f64;
            let (x, y) = (from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1));
            let part = [x - 1.5, y - 1.5, x + 1.5, y + 1.5];
            if overlap(&part, &self.frame) > 0.0 {
                self.lines.push(part);
            }
        }
    }

    /// The middle of a label for `point`, which is taken from now on: the candidate that covers least, and of those the
    /// nearest.
    pub fn place(&mut self, (x, y): At, text: &str) -> At {
        let (half_w, half_h) = (text_width(text, self.text) / 2.0, self.text / 2.0);
        let around = |(cx, cy): At| [cx - half_w, cy - half_h, cx + half_w, cy + half_h];
        let mut best = ((x, y), f64::INFINITY);
        for distance in DISTANCES {
            for k in 0..DIRECTIONS {
                let (s, c) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
                let centre = (x + c * (half_w + distance), y - s * (half_h + distance));
                let label = around(centre);
                let outside = area(&label) - overlap(&label, &self.frame);
                let covered = |boxes: &[Box]| boxes.iter().map(|b| overlap(&label, b)).sum::<f64>();
                let covered = WRITTEN * covered(&self.taken) + covered(&self.lines);
                let cost = covered + 10.0 * outside + NEARNESS * distance;
                if cost < best.1 {
                    best = (centre, cost);
                }
            }
        }
        self.taken.push(around(best.0));
        best.0
    }
}

fn area(b: &Box) -> f64 {
    (b[2] - b[0]) * (b[3] - b[1])
}

fn overlap(a: &Box, b: &Box) -> f64 {
    let w = a[2].min(b[2]) - a[0].max(b[0]);
    let h = a[3].min(b[3]) - a[1].max(b[1]);
    w.max(0.0) * h.max(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::svg::TEXT_PT;
    use super::*;

    #[test]
    fn spec_labels_keep_clear_of_each_other_and_of_lines() {
        let mut labels = Labels::new((0.0, 0.0), (200.0, 200.0), TEXT_PT);
        labels.avoid_line((0.0, 100.0), (200.0, 100.0));
        let first = labels.place((100.0, 100.0), "I, 80 m");
        let second = labels.place((103.0, 100.0), "J, 80 m");
        let (half_w, half_h) = (text_width("I, 80 m", TEXT_PT) / 2.0, TEXT_PT / 2.0);
        assert!((first.1 - 100.0).abs() > half_h && (second.1 - 100.0).abs() > half_h);
        assert!((first.0 - second.0).abs() >= half_w || (first.1 - second.1).abs() >= 2.0 * half_h);
    }

    #[test]
    fn spec_labels_of_a_crowd_do_not_collide() {
        let mut labels = Labels::new((0.0, 0.0), (300.0, 300.0), TEXT_PT);
        labels.avoid_line((0.0, 150.0), (300.0, 150.0));
        let texts: Vec<String> = (0..10).map(|k| format!("slot {k}, 20 m")).collect();
        let at = |k: usize| (140.0 + 3.0 * k as f64, 150.0);
        (0..texts.len()).for_each(|k| labels.avoid(at(k), 4.0));
        let half_h = TEXT_PT / 2.0;
        let mut boxes: Vec<Box> = Vec::new();
        for (k, text) in texts.iter().enumerate() {
            let (x, y) = labels.place(at(k), text);
            let half_w = text_width(text, TEXT_PT) / 2.0;
            let own = [x - half_w, y - half_h, x + half_w, y + half_h];
            assert!(boxes.iter().all(|other| overlap(&own, other) < 1e-9), "{text} collides");
            boxes.push(own);
        }
    }

    #[test]
    fn spec_labels_stay_in_the_frame() {
        let mut labels = Labels::new((0.0, 0.0), (100.0, 100.0), TEXT_PT);
        let (x, y) = labels.place((99.0, 1.0), "corner");
        assert!(x + text_width("corner", TEXT_PT) / 2.0 <= 100.0 && y - TEXT_PT / 2.0 >= 0.0);
    }
}
