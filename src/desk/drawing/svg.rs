//! A small writer of SVG, for figures in print (one user unit is one point, 1/72 inch) and for pages; y down.
//!
//! Own, for what the plotting crates do not draw (ARCHITECTURE.md, "Figures"). The result names generic font families only
//! and refers to nothing outside itself; room is kept for the widest of the faces that it may be set in.

use std::fmt::Write as _;

/// A point of the drawing: x to the right and y down, in points.
pub type At = (f64, f64);

/// Size of lettering in print, in points: the least that stays legible in a printed column.
pub const TEXT_PT: f64 = 8.0;

/// Colours and lettering that a drawing shares. A colour is anything that SVG takes: in a page also `var(--name)`, so
/// that the page's style sheet decides between light and dark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Theme {
    /// Behind everything, in open markers and around labels.
    pub paper: &'static str,
    /// Lettering and frames.
    pub ink: &'static str,
    /// Grid lines.
    pub grid: &'static str,
    /// Size of lettering.
    pub text: f64,
}

impl Theme {
    /// Black on white.
    pub const PRINT: Self = Self { paper: "#ffffff", ink: "#000000", grid: "#dddddd", text: TEXT_PT };
}

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// `#rrggbb`, or what else a theme's colour may be.
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
    theme: Theme,
    /// Of a drawing in a page, whose identifiers must differ from those of the others.
    id: Option<String>,
}

impl Svg {
    /// An empty, white drawing. `title` and `description` are for readers who cannot see it.
    pub fn new(width: f64, height: f64, title: &str, description: &str) -> Self {
        let mut svg = Self { width, height, body: String::new(), clips: 0, theme: Theme::PRINT, id: None };
        svg.push(&format!("<title>{}</title>", escape(title)));
        svg.push(&format!("<desc>{}</desc>", escape(description)));
        svg.rectangle((0.0, 0.0), (width, height), "#ffffff", None);
        svg
    }

    /// A drawing inside a page: it fills the width that it is given, and has the page's background. `id` is the page's
    /// name for it.
    pub fn inline(id: &str, (width, height): At, theme: Theme, title: &str, description: &str) -> Self {
        let id = escape(id);
        let mut svg = Self { width, height, body: String::new(), clips: 0, theme, id: None };
        svg.push(&format!("<title id=\"{id}-title\">{}</title>", escape(title)));
        svg.push(&format!("<desc id=\"{id}-desc\">{}</desc>", escape(description)));
        svg.id = Some(id);
        svg
    }

    /// Its colours and lettering.
    pub fn theme(&self) -> Theme {
        self.theme
    }

    /// The document, or the element for the page.
    pub fn finish(self) -> String {
        let (w, h) = (number(self.width), number(self.height));
        if let Some(id) = &self.id {
            let text = number(self.theme.text);
            return format!(
                "<svg id=\"{id}\" role=\"img\" aria-labelledby=\"{id}-title {id}-desc\" viewBox=\"0 0 {w} {h}\" font-size=\"{text}\" fill=\"{}\">\n{}</svg>\n",
                self.theme.ink, self.body
            );
        }
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
            Marker::Circle => self.push(&disc(self.theme.paper, 0.9 * r)),
            Marker::OpenSquare => {
                let h = 0.85 * r;
                self.rectangle((x - h, y - h), (2.0 * h, 2.0 * h), self.theme.paper, Some(&rim));
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

    /// A line of text in a colour.
    pub fn coloured(&mut self, at: At, anchor: Anchor, colour: &str, text: &str) {
        self.lettering(at, anchor, &format!(" fill=\"{colour}\""), text);
    }

    /// A line of text with a rim of paper, legible across lines.
    pub fn label(&mut self, at: At, anchor: Anchor, colour: &str, text: &str) {
        let (x, y) = (number(at.0), number(at.1 + self.baseline()));
        let (paper, rim) = (self.theme.paper, number(0.3 * self.theme.text));
        let anchor = anchor_name(anchor);
        let text = escape(text);
        // Twice, because `paint-order` is not known to every program that prints SVG.
        self.push(&format!(
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\" fill=\"{paper}\" stroke=\"{paper}\" stroke-width=\"{rim}\" stroke-linejoin=\"round\">{text}</text>"
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
            number(self.baseline()),
            escape(text)
        ));
    }

    /// Draws inside a rectangle only.
    pub fn clipped(&mut self, (x, y): At, (w, h): At, draw: impl FnOnce(&mut Self)) {
        let [x, y, w, h] = [x, y, w, h].map(number);
        let page = self.id.as_ref().map_or(String::new(), |id| format!("{id}-"));
        let id = format!("{page}clip-{}", self.clips);
        self.clips += 1;
        self.push(&format!(
            "<clipPath id=\"{id}\"><rect x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/></clipPath>"
        ));
        self.push(&format!("<g clip-path=\"url(#{id})\">"));
        draw(self);
        self.push("</g>");
    }

    fn lettering(&mut self, (x, y): At, anchor: Anchor, attributes: &str, text: &str) {
        let (x, y, anchor) = (number(x), number(y + self.baseline()), anchor_name(anchor));
        self.push(&format!(
            "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\"{attributes}>{}</text>",
            escape(text)
        ));
    }

    /// A filled path in SVG's own language.
    pub fn path(&mut self, path: &str, fill: &str) {
        self.push(&format!("<path d=\"{path}\" fill=\"{fill}\"/>"));
    }

    /// A drawn path in SVG's own language.
    pub fn contour(&mut self, path: &str, stroke: &Stroke) {
        self.push(&format!("<path d=\"{path}\" fill=\"none\"{}/>", pen(stroke)));
    }

    /// A circle, open.
    pub fn circle(&mut self, (x, y): At, radius: f64, stroke: &Stroke) {
        let [x, y, r] = [x, y, radius].map(number);
        self.push(&format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\" fill=\"none\"{}/>", pen(stroke)));
    }

    /// What `draw` draws, as a group with a title of its own: what a pointer that rests on it is told.
    pub fn titled(&mut self, title: &str, draw: impl FnOnce(&mut Self)) {
        self.push(&format!("<g><title>{}</title>", escape(title)));
        draw(self);
        self.push("</g>");
    }

    /// From a text's vertical middle (of its lower-case letters and figures, about) down to its baseline.
    fn baseline(&self) -> f64 {
        0.35 * self.theme.text
    }

    fn push(&mut self, element: &str) {
        self.body.push_str(element);
        self.body.push('\n');
    }
}

/// Advances of DejaVu Sans in thousandths of the size, from the space to the tilde: the widest of the usual sans-serif faces,
/// and what a Linux machine without others sets `sans-serif` in. What has room in it has room in Helvetica and Arial.
const ADVANCES: [u16; 95] = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337, 636, 636, 636, 636, 636,
    636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531, 1000, 684, 686, 698, 770, 632, 575, 775, 752, 295,
    295, 656, 557, 863, 748, 787, 603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838,
    500, 500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612, 635, 635, 411, 521,
    392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838,
];
/// What lies beyond is taken to be as wide as the plus-minus and the minus sign, unless it is narrower and known.
const OTHER: u16 = 838;

/// Width of a line of text of this size, on the wide side: the drawing carries no font to measure.
pub fn text_width(text: &str, size: f64) -> f64 {
    let advance = |c: char| match c {
        '\u{b0}' => 500,
        c => {
            let place = (c as usize).checked_sub(' ' as usize);
            place.and_then(|place| ADVANCES.get(place)).copied().unwrap_or(OTHER)
        }
    };
    size * 1e-3 * text.chars().map(|c| f64::from(advance(c))).sum::<f64>()
}

/// A text in lines of at most this width, broken at spaces; a longer word has a line of its own.
pub fn wrapped(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let longer = lines.last().map(|line| format!("{line} {word}"));
        match longer.filter(|line| text_width(line, size) <= width) {
            Some(line) => {
                lines.pop();
                lines.push(line);
            }
            None => lines.push(word.to_owned()),
        }
    }
    lines
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
pub fn number(value: f64) -> String {
    let rounded = (value * 100.0).round() / 100.0;
    format!("{}", if rounded == 0.0 { 0.0 } else { rounded })
}

/// Text for a document: no markup, no character that XML forbids.
pub fn escape(text: &str) -> String {
    let allowed = |c: char| !matches!(c, '\0'..='\u{8}' | '\u{b}' | '\u{c}' | '\u{e}'..='\u{1f}' | '\u{fffe}' | '\u{ffff}');
    let text: String = text.chars().filter(|&c| allowed(c)).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_numbers_are_short_and_never_negative_zero() {
        assert_eq!(number(1.0 / 3.0), "0.33");
        assert_eq!(number(-0.001), "0");
        assert_eq!(number(252.0), "252");
    }

    #[test]
    fn spec_widths_are_those_of_the_widest_face() {
        // By DejaVuSans.ttf, whose units are 2048 to the em: "8.5" is 1303 + 651 + 1303 of them.
        assert!((text_width("8.5", 2048.0) - 3257.0).abs() < 2.5, "{}", text_width("8.5", 2048.0));
        assert_eq!(text_width("", 8.0), 0.0);
        assert_eq!(text_width("\u{2212}", 10.0), 8.38);
    }

    #[test]
    fn spec_lines_are_broken_where_they_are_full() {
        let width = text_width("one two", 8.0);
        assert_eq!(wrapped("one two three", 8.0, width), ["one two", "three"]);
        assert_eq!(wrapped("one two", 8.0, width - 0.01), ["one", "two"]);
        assert_eq!(wrapped("incomprehensibilities", 8.0, 1.0), ["incomprehensibilities"]);
        assert!(wrapped(" ", 8.0, 1.0).is_empty());
    }

    #[test]
    fn spec_text_is_escaped() {
        let mut svg = Svg::new(10.0, 10.0, "a < b & c", "");
        svg.text((1.0, 1.0), Anchor::Start, "\"R\" > 0");
        let document = svg.finish();
        assert!(document.contains("<title>a &lt; b &amp; c</title>"));
        assert!(document.contains(">&quot;R&quot; &gt; 0</text>"));
    }
}
