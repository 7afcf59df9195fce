//! What each imperfection that a mission states costs its plan, slot by slot: bars, since single losses do not add up.

use super::Figure;
use crate::desk::csv_text::CsvText;
use crate::desk::drawing::axes::{Axes, step, ticks};
use crate::desk::drawing::svg::{Anchor, Stroke, Svg, TEXT_PT, wrapped};
use crate::planner::assessment::{Assessment, Cause};

/// File name without extension.
pub const NAME: &str = "figure-breakdown";

/// The row of what all imperfections cost together.
const ALL: &str = "all";

/// Width of a column of the paper in points (3.5 inches).
const WIDTH: f64 = 252.0;
const LEFT: f64 = 62.0;
const MARGIN: f64 = 6.0;
/// Free beyond the longest bar, as a share of the range: room for the figure at its end.
const FREE: f64 = 0.18;
const ROW: f64 = 10.0;
const BAR: f64 = 6.4;
const TEXT_ROW: f64 = 11.0;
/// Between two slots.
const SPACE: f64 = 9.0;
/// From the lowest frame to the end of the drawing: figures and label of the axis.
const FOOT: f64 = 29.0;
const ALONE: &str = "#0b5394";
const TOGETHER: &str = "#c8500a";

/// A slot's rates in bit/s/Hz.
#[derive(Debug, Clone, PartialEq)]
pub struct Slot {
    /// The user served.
    pub user: String,
    /// The plan's mean rate.
    pub rate: f64,
    /// What nineteen slots in twenty exceed.
    pub quantile_5pct: f64,
    /// By how much the mean would be higher without each imperfection alone, by [`Cause::name`]; `all` without all of them.
    /// Empty for an ideal mission.
    pub losses: Vec<(&'static str, f64)>,
}

impl Slot {
    /// Of a planned and assessed slot.
    #[must_use]
    pub fn new(user: &str, rate_bps: f64, assessment: &Assessment, bandwidth_hz: f64) -> Self {
        let mut losses: Vec<_> = assessment
            .losses_bps
            .iter()
            .map(|(cause, loss_bps)| (Cause::name(*cause), loss_bps / bandwidth_hz))
            .collect();
        if !losses.is_empty() {
            losses.push((ALL, assessment.loss_to_ideal_bps / bandwidth_hz));
        }
        Self {
            user: user.to_owned(),
            rate: rate_bps / bandwidth_hz,
            quantile_5pct: assessment.quantile_5pct_bps / bandwidth_hz,
            losses,
        }
    }
}

/// The figure of a mission, by its name.
#[must_use]
pub fn figure(mission: &str, slots: &[Slot]) -> Figure {
    Figure { name: NAME, svg: draw(mission, slots), csv: csv(slots) }
}

fn csv(slots: &[Slot]) -> String {
    let mut text =
        CsvText::new(["user", "rate_bit_s_hz", "quantile_5pct_bit_s_hz", "cause", "loss_bit_s_hz"]);
    for Slot { user, rate, quantile_5pct, losses } in slots {
        let of_slot = || [user.clone(), format!("{rate:.6}"), format!("{quantile_5pct:.6}")];
        if losses.is_empty() {
            text.row(of_slot().into_iter().chain([String::new(), String::new()]));
        }
        for (cause, loss) in losses {
            text.row(of_slot().into_iter().chain([(*cause).to_owned(), format!("{loss:.6}")]));
        }
    }
    text.finish()
}

fn draw(mission: &str, slots: &[Slot]) -> String {
    let heights = slots.iter().map(|slot| TEXT_ROW + ROW * slot.losses.len() as f64 + SPACE);
    let caption = format!(
        "Mission {mission}: what each imperfection costs the plan by itself, and all together (bit/s/Hz)"
    );
    let caption = wrapped(&caption, TEXT_PT, WIDTH - 2.0 * MARGIN);
    let top = 6.0 + caption.len() as f64 * TEXT_ROW + 3.0;
    let height = top + heights.sum::<f64>() - SPACE + FOOT;
    let mut svg = Svg::new(WIDTH, height, "What each imperfection costs", &caption.join(" "));
    for (row, line) in caption.iter().enumerate() {
        svg.text((6.0, 7.0 + TEXT_ROW * row as f64), Anchor::Start, line);
    }
    let x = range(slots);
    let xs = ticks(x, step(x[1] - x[0], 6.0));
    let mut at = top;
    for (index, slot) in slots.iter().enumerate() {
        let heading =
            format!("{}: {:.2}; 19 slots in 20 exceed {:.2}", slot.user, slot.rate, slot.quantile_5pct);
        svg.heading((6.0, at + 0.5 * TEXT_ROW), Anchor::Start, &heading);
        let rows = slot.losses.len() as f64;
        let axes = Axes {
            corner: (LEFT, at + TEXT_ROW),
            size: (WIDTH - LEFT - MARGIN, ROW * rows),
            x,
            y: [rows, 0.0],
        };
        bars(&mut svg, &axes, &slot.losses, &xs, index + 1 == slots.len());
        at = axes.bottom() + SPACE;
    }
    svg.text((LEFT + 0.5 * (WIDTH - LEFT - MARGIN), height - 7.0), Anchor::Middle, "rate lost (bit/s/Hz)");
    svg.finish()
}

/// From 0, or the largest gain, to beyond the largest loss.
fn range(slots: &[Slot]) -> [f64; 2] {
    let all = || slots.iter().flat_map(|slot| &slot.losses).map(|(_, loss)| *loss);
    let (low, high) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max));
    // Something to divide by where nothing costs anything.
    [low, high + FREE * (high - low).max(1e-3)]
}

fn bars(svg: &mut Svg, axes: &Axes, losses: &[(&str, f64)], xs: &[f64], lettered: bool) {
    axes.grid(svg, xs, &[]);
    for (row, (cause, loss)) in losses.iter().enumerate() {
        let middle = axes.corner.1 + ROW * (row as f64 + 0.5);
        let [from, to] = [loss.min(0.0), loss.max(0.0)].map(|loss| axes.at(loss, 0.0).0);
        let colour = if *cause == ALL { TOGETHER } else { ALONE };
        svg.rectangle((from, middle - 0.5 * BAR), (to - from, BAR), colour, None);
        svg.text((LEFT - 4.0, middle), Anchor::End, if *cause == ALL { "all together" } else { cause });
        svg.label((to + 3.0, middle), Anchor::Start, "#000000", &format!("{loss:.2}"));
    }
    axes.frame(svg, xs, &[], [lettered, false]);
    let zero = axes.at(0.0, 0.0).0;
    svg.line(&[(zero, axes.corner.1), (zero, axes.bottom())], &Stroke::solid("#000000", 0.8));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slot(user: &str, losses: &[(&'static str, f64)]) -> Slot {
        Slot { user: user.to_owned(), rate: 12.5, quantile_5pct: 11.25, losses: losses.to_vec() }
    }

    #[test]
    fn spec_every_loss_is_in_the_table_and_an_ideal_slot_has_a_row_too() {
        let slots = [slot("a,b", &[("antenna", 1.5), (ALL, 2.0)]), slot("c", &[])];
        assert_eq!(
            figure("m", &slots).csv,
            "user,rate_bit_s_hz,quantile_5pct_bit_s_hz,cause,loss_bit_s_hz\n\
             \"a,b\",12.500000,11.250000,antenna,1.500000\n\
             \"a,b\",12.500000,11.250000,all,2.000000\n\
             c,12.500000,11.250000,,\n"
        );
    }

    #[test]
    fn val_bars_are_as_long_as_their_losses() {
        let slots = [slot("alpha", &[("antenna", 4.0), ("jitter", -1.0), (ALL, 8.0)])];
        let svg = figure("m", &slots).svg;
        let width = |colour: &str| -> Vec<f64> {
            svg.lines()
                .filter(|line| line.starts_with("<rect") && line.contains(colour))
                .map(|line| {
                    line.split("width=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap()
                })
                .collect()
        };
        let (alone, together) = (width(ALONE), width(TOGETHER));
        assert_eq!((alone.len(), together.len()), (2, 1));
        // The frame is as wide as the range from -1 to 8, and what is free.
        let unit = (WIDTH - LEFT - MARGIN) / (9.0 * (1.0 + FREE));
        for (drawn, loss) in [(alone[0], 4.0), (alone[1], 1.0), (together[0], 8.0)] {
            assert!((drawn - unit * loss).abs() < 0.02, "{drawn} for {loss}");
        }
    }
}
