//! Where the vehicles are, from above: north is up, and both axes have one scale.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::Line;
use ratatui::widgets::Block;
use ratatui::widgets::canvas::{Canvas, Line as Stroke, Points};

use super::Theme;
use crate::desk::watch::state::State;
use crate::mission::Vector;
use crate::role::Role;
use crate::time::Instant;

/// No less than this is shown, in metres.
const LEAST_M: f64 = 20.0;
/// Dots of a cell, across and up.
const DOTS: [f64; 2] = [2.0, 4.0];

pub(super) fn draw(state: &State, at: Instant, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let of = |role: Role| {
        let vehicle = state.vehicle(role)?;
        let place = |vector| vehicle.vector(vector, at).map(|[e, n, _]| [e, n]);
        let trail: Vec<(f64, f64)> = vehicle.trail.iter().map(|[e, n]| (*e, *n)).collect();
        Some((role, place(Vector::Position), place(Vector::Planned), trail))
    };
    let vehicles: Vec<_> = Role::BOTH.into_iter().filter_map(of).collect();
    let places = vehicles.iter().flat_map(|(_, now, plan, trail)| {
        let ends = [now, plan].into_iter().flatten().map(|[e, n]| (*e, *n));
        ends.chain(trail.iter().copied())
    });
    let (low, high) = places.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(low, high), (e, n)| {
        ([low[0].min(e), low[1].min(n)], [high[0].max(e), high[1].max(n)])
    });
    let inner = [f64::from(area.width.saturating_sub(2)), f64::from(area.height.saturating_sub(2))];
    let empty = low[0] > high[0] || inner[0] < 1.0 || inner[1] < 1.0;
    if empty {
        let block = Block::bordered().title(" from above ").border_style(theme.quiet());
        return frame.render_widget(block, area);
    }
    let middle = [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0);
    let dots = [inner[0] * DOTS[0], inner[1] * DOTS[1]];
    // A little more than what there is.
    let metres_a_dot = [0, 1].map(|axis| 1.15 * (high[axis] - low[axis]).max(LEAST_M) / dots[axis]);
    let metres_a_dot = metres_a_dot[0].max(metres_a_dot[1]);
    let bounds = [0, 1].map(|axis| {
        let half = metres_a_dot * dots[axis] / 2.0;
        [middle[axis] - half, middle[axis] + half]
    });
    let title =
        format!(" from above, {:.0} m by {:.0} m, north up ", metres_a_dot * dots[0], metres_a_dot * dots[1]);
    let canvas = Canvas::default()
        .block(Block::bordered().title(title).border_style(theme.quiet()))
        .marker(Marker::Braille)
        .x_bounds(bounds[0])
        .y_bounds(bounds[1])
        .paint(|context| {
            for (role, now, plan, trail) in &vehicles {
                let colour = match role {
                    _ if !theme.colours => Color::Reset,
                    Role::I => Color::Cyan,
                    Role::J => Color::Magenta,
                };
                context.draw(&Points { coords: trail, color: colour });
                if let (Some([e, n]), Some([x, y])) = (now, plan) {
                    context.draw(&Stroke { x1: *e, y1: *n, x2: *x, y2: *y, color: colour });
                }
            }
            context.layer();
            for (role, now, plan, _) in &vehicles {
                let letter = role.to_string();
                if let Some([x, y]) = plan {
                    context.print(*x, *y, Line::raw(letter.to_lowercase()));
                }
                if let Some([e, n]) = now {
                    context.print(*e, *n, Line::styled(letter, Style::new().add_modifier(Modifier::BOLD)));
                }
            }
        });
    frame.render_widget(canvas, area);
}
