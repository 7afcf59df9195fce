//! A small writer of SVG, for figures in print: one user unit is one point (1/72 inch), y down.
//!
//! Own, because the plotting crates' SVG backends round to whole pixels and have neither dashes nor clipping. The
//! result names generic font families only and refers to nothing outside itself.

use std::fmt::Write as _;

/// A point of the drawing: x to the right and y down, in points.
pub type At = (f64, f64);

/// Size of all lettering, in points: the least that stays legible in a printed column.
pub const TEXT_PT: f64 = 8.0;

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// `#rrggbb`.
    pub colour: &'static str,
    /// In points.
    pub width: f64,
    /// Lengths of dashes and gaps in points, as SVG's `stroke-dasharray`; empty for a solid line.
    pub dashes: &'static str,
}

impl Stroke {
    /// A solid line.
    pub const fn solid(colour: &'static str, width: f64) -> Self {
        Self { colour, width, dashes: "" }
    }
}

/// Which part of a text is at its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// Its left end.
    Start,
    /// Its middle.
    Middle,
    /// Its right end.
    End,
}

/// The sign of a data point or a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marker {
    /// Disc.
    Disc,
    /// Square, open.
    OpenSquare,
    /// Triangle.
    Triangle,
    /// Diamond.
    Diamond,
    /// Circle, open.
    Circle,
    /// Diagonal cross.
    Cross,
}

/// A drawing in the making.
#[derive(Debug, Clone)]
pub struct Svg {
    width: f64,
    height: f64,
    body: String,
    clips: usize,
}

impl Svg {
    /// An empty, white drawing. `title` and `description` are for readers who cannot see it.
    pub fn new(width: f64, height: f64, title: &str, description: &str) -> Self {
        let mut svg = Self { width, height, body: String::new(), clips: 0 };
        svg.push(&format!("<title>{}</title>", escape(title)));
        svg.push(&format!("<desc>{}</desc>", escape(description)));
        svg.rectangle((0.0, 0.0), (width, height), "#ffffff", None);
        svg
    }

    /// The document.
    pub fn finish(self) -> String {
        let (w, h) = (number(self.width), number(self.height));
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" version=\"1.1\" width=\"{w}pt\" height=\"{h}pt\" viewBox=\"0 0 {w} {h}\" font-family=\"Helvetica, Arial, sans-serif\" font-size=\"{TEXT_PT}\" fill=\"#000000\">\n{}</svg>\n",
            self.body
        )
    }

    /// A line through points.
    pub fn line(&mut self, points: &[At], stroke: &Stroke) {
        self.push(&format!("<polyline points=\"{}\" fill=\"none\"{}/>", list(points), pen(stroke)));
    }

    /// A filled area, `opacity` 0 to 1.
    pub fn area(&mut self, points: &[At], colour: &str, opacity: f64) {
        self.push(&format!(
            "<polygon points=\"{}\" fill=\"{colour}\" fill-opacity=\"{}\"/>",
            list(points),
            number(opacity)
        ));
    }

    /// A rectangle from its upper left corner and its size.
    pub fn rectangle(&mut self, (x, y): At, (w, h): At, fill: &str, stroke: Option<&Stroke>) {
        let [x, y, w, h] = [x, y, w, h].map(number);
        let pen = stroke.map(pen).unwrap_or_default();
        self.push(&format!("<rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" fill=\"{fill}\"{pen}/>"));
    }

    /// A marker about a point.
    pub fn marker(&mut self, (x, y): At, marker: Marker, colour: &'static str, radius: f64) {
        let r = radius;
        let rim = Stroke::solid(colour, 1.1);
        let disc = |fill: &str, r: f64| {
            let [x, y, r] = [x, y, r].map(number);
            format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\" fill=\"{fill}\"{}/>", pen(&rim))
        };
        match marker {
            Marker::Disc => self.push(&disc(colour, 0.85 * r)),
            Marker::Circle => self.push(&disc("#ffffff", 0.9 * r)),
            Marker::OpenSquare => {
                let h = 0.85 * r;
                self.rectangle((x - h, y - h), (2.0 * h, 2.0 * h), "#ffffff", Some(&rim));
            }
            Marker::Triangle => {
                let (w, down) = (1.1 * r, 0.75 * r);
                self.area(&[(x, y - 1.2 * r), (x + w, y + down), (x - w, y + down)], colour, 1.0);
            }
            Marker::Diamond => {
                let h = 1.25 * r;
                self.area(&[(x, y - h), (x + h, y), (x, y + h), (x - h, y)], colour, 1.0);
            }
            Marker::Cross => {
                let rim = Stroke::solid(colour, 1.6);
                self.line(&[(x - r, y - r), (x + r, y + r)], &rim);
                self.line(&[(x - r, y + r), (x + r, y - r)], &rim);
            }
        }
    }

    /// A line of text whose vertical middle is at the point.
    pub fn text(&mut self, at: At, anchor: Anchor, text: &str) {
        self.lettering(at, anchor, "", text);
    }

    /// A line of bold text.
    pub fn heading(&mut self, at: At, anchor: Anchor, text: &str) {
        self.lettering(at, anchor, " font-weight=\"bold\"", text);
    }

    /// A line of text with a white rim, legible across lines.
    pub fn label(&mut self, at: At, anchor: Anchor, colour: &str, text: &str) {
        let (x, y) = (number(at.0), number(at.1 + baseline()));
        let anchor = anchor_name(anchor);
        let text = escape(text);
        // Twice, because `paint-order` is not known to every program that prints SVG.
        self.push(&format!(
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" fill=\"#ffffff\" stroke=\"#ffffff\" stroke-width=\"2.4\" stroke-linejoin=\"round\">{text}</text>"
        ));
        self.push(&format!(
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>"
        ));
    }

    /// A line of text, upwards, whose middle is at the point.
    pub fn text_upwards(&mut self, (x, y): At, text: &str) {
        let [x, y] = [x, y].map(number);
        self.push(&format!(
            "<text transform=\"translate({x} {y}) rotate(-90)\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            number(baseline()),
            escape(text)
        ));
    }

    /// Draws inside a rectangle only.
    pub fn clipped(&mut self, (x, y): At, (w, h): At, draw: impl FnOnce(&mut Self)) {
        let [x, y, w, h] = [x, y, w, h].map(number);
        let id = self.clips;
        self.clips += 1;
        self.push(&format!(
            "<clipPath id=\"clip-{id}\"><rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/></clipPath>"
        ));
        self.push(&format!("<g clip-path=\"url(#clip-{id})\">"));
        draw(self);
        self.push("</g>");
    }

    fn lettering(&mut self, (x, y): At, anchor: Anchor, attributes: &str, text: &str) {
        let (x, y, anchor) = (number(x), number(y + baseline()), anchor_name(anchor));
        self.push(&format!(
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\"{attributes}>{}</text>",
            escape(text)
        ));
    }

    fn push(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }
}

/// Width of a text in points, as a sans-serif face of [`TEXT_PT`] sets it, on the wide side: the drawing carries no font
/// to measure.
pub fn text_width(text: &str) -> f64 {
    let em = |c: char| match c {
        'i' | 'j' | 'l' | 'I' | '.' | ',' | ':' | '\'' | ' ' | '(' | ')' | '/' | 't' | 'f' | 'r' | '-' => {
            0.33
        }
        'm' | 'w' | 'M' | 'W' => 0.86,
        c if c.is_uppercase() => 0.7,
        _ => 0.56,
    };
    TEXT_PT * text.chars().map(em).sum::<f64>()
}

/// From a text's vertical middle (of its lower-case letters and figures, about) down to its baseline.
fn baseline() -> f64 {
    0.35 * TEXT_PT
}

fn anchor_name(anchor: Anchor) -> &'static str {
    match anchor {
        Anchor::Start => "start",
        Anchor::Middle => "middle",
        Anchor::End => "end",
    }
}

fn pen(stroke: &Stroke) -> String {
    let mut pen = format!(" stroke=\"{}\" stroke-width=\"{}\"", stroke.colour, number(stroke.width));
    if !stroke.dashes.is_empty() {
        // Writing to a String cannot fail.
        let _ = write!(pen, " stroke-dasharray=\"{}\"", stroke.dashes);
    }
    pen
}

fn list(points: &[At]) -> String {
    let points: Vec<String> = points.iter().map(|(x, y)| format!("{},{}", number(*x), number(*y))).collect();
    points.join(" ")
}

/// A hundredth of a point is finer than any printer; no "-0" and no exponent.
fn number(value: f64) -> String {
    let rounded = (value * 100.0).round() / 100.0;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_numbers_are_short_and_never_negative_zero() {
        assert_eq!(number(1.0 / 3.0), "0.33");
        assert_eq!(number(-0.001), "0");
        assert_eq!(number(252.0), "252");
    }

    #[test]
    fn val_text_is_escaped() {
        let mut svg = Svg::new(10.0, 10.0, "a < b & c", "");
        svg.text((1.0, 1.0), Anchor::Start, "\"R\" > 0");
        let document = svg.finish();
        assert!(document.contains("<title>a &lt; b &amp; c</title>"));
        assert!(document.contains(">&quot;R&quot; &gt; 0</text>"));
    }
}
