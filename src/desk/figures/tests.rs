//! That the lettering of all figures has room in the widest face that it may be set in.

use super::breakdown::{self, Slot};
use super::regret::Regret;
use super::scenario::Summary;
use super::service::{self, Volumes, WAYS};
use super::{Settings, make, poses, rates};
use crate::desk::drawing::svg::{TEXT_PT, text_width};

/// Bold against regular: DejaVu Sans Bold's letters are wider by 8 to 20%.
const BOLD: f64 = 1.2;

/// The boxes of all lettering, left, top, right and bottom, with the text; each once, and what stands upright left out.
fn lettering(svg: &str) -> Vec<([f64; 4], String)> {
    let attribute = |line: &str, name: &str| -> Option<String> {
        Some(line.split(&format!(" {name}=\"")).nth(1)?.split('"').next()?.to_owned())
    };
    let mut found: Vec<([f64; 4], String)> = Vec::new();
    for line in svg.lines().filter(|line| line.starts_with("<text") && !line.contains("rotate")) {
        let text = line.split('>').nth(1).unwrap().split('<').next().unwrap();
        let text =
            text.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        let [x, y] = ["x", "y"].map(|name| attribute(line, name).unwrap().parse::<f64>().unwrap());
        let bold = line.contains("font-weight");
        let width = if bold { BOLD } else { 1.0 } * text_width(&text, TEXT_PT);
        let left = match attribute(line, "text-anchor").unwrap().as_str() {
            "start" => x,
            "middle" => x - width / 2.0,
            _ => x - width,
        };
        // Of capitals and figures, from the baseline up.
        let place = [left, y - 0.73 * TEXT_PT, left + width, y];
        if !found.contains(&(place, text.clone())) {
            found.push((place, text));
        }
    }
    found
}

#[test]
fn spec_no_lettering_collides_in_the_widest_face() {
    let of_rates =
        |name: &str| name == poses::NAME || rates::Study::ALL.iter().any(|study| study.name() == name);
    let mut figures = make(&Settings { scenarios: 2, threads: 2, seed: 1 }, of_rates, &|_, _, _| {}).unwrap();
    let losses = vec![("antenna", 1.65), ("mounting", 0.04), ("all", 6.58)];
    let slot =
        |user: &str| Slot { user: user.to_owned(), rate: 10.66, quantile_5pct: 10.0, losses: losses.clone() };
    let summaries = |mean: f64| {
        vec![Summary { mean, standard_error: 0.1 * mean, quartiles: [0.9 * mean, mean, 1.1 * mean] }; 5]
    };
    for study in service::Study::ALL {
        let ways = (1..=WAYS.len()).map(|k| [4.5 * k as f64, 24.9 * k as f64].map(summaries)).collect();
        figures.push(Volumes { study, scenarios: 1000, ways }.figure());
    }
    let lost = [0.4, 88.0].map(summaries);
    figures.push(Regret { flights: 100, lost }.figure());
    figures.push(breakdown::figure("a-courtyard-with-a-longer-name", &[slot("alpha"), slot("bravo")]));
    for figure in &figures {
        let view = figure.svg.split("viewBox=\"0 0 ").nth(1).unwrap().split('"').next().unwrap();
        let size: Vec<f64> = view.split(' ').map(|number| number.parse().unwrap()).collect();
        let boxes = lettering(&figure.svg);
        assert!(boxes.len() > 10);
        for (k, (a, text)) in boxes.iter().enumerate() {
            let inside = a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= size[0] && a[3] <= size[1];
            assert!(inside, "{}: {text:?} leaves the drawing: {a:?} {size:?}", figure.name);
            for (b, other) in &boxes[k + 1..] {
                let apart = a[2] <= b[0] || b[2] <= a[0] || a[3] <= b[1] || b[3] <= a[1];
                assert!(apart, "{}: {text:?} and {other:?} collide: {a:?} {b:?}", figure.name);
            }
        }
    }
}
