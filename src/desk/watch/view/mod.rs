//! The view: a state, drawn into a terminal of any size. 80 by 24 shows everything that an operator needs; more room shows a
//! map, what each eavesdropper hears, and more of what was said.

mod map;
mod panel;
mod words;

use mavlink::dialects::ardupilotmega::MavSeverity;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Clear, Paragraph, Sparkline};

use super::state::{Source, State, Whom};
use super::vehicle::Vehicle;
use crate::desk::Order;
use crate::mission::{Figure, silence_words};
use crate::role::Role;
use crate::time::Instant;
use words::{clock_of, rate, seconds, span_of};

/// Below this nothing is shown but the wish for more.
const LEAST: [u16; 2] = [60, 20];
/// From here on there is a map.
const WIDE: [u16; 2] = [130, 34];
/// A panel's rows with its borders, narrow and wide.
const PANEL: [u16; 2] = [13, 18];

/// Whether colours may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Theme {
    /// They may.
    pub colours: bool,
}

impl Theme {
    fn of(self, colour: Color, without: Modifier) -> Style {
        if self.colours { Style::new().fg(colour) } else { Style::new().add_modifier(without) }
    }

    fn good(self) -> Style {
        self.of(Color::Green, Modifier::empty()).add_modifier(Modifier::BOLD)
    }

    fn warn(self) -> Style {
        self.of(Color::Yellow, Modifier::BOLD)
    }

    fn bad(self) -> Style {
        self.of(Color::Red, Modifier::REVERSED).add_modifier(Modifier::BOLD)
    }

    /// Of what is read last.
    fn quiet(self) -> Style {
        self.of(Color::DarkGray, Modifier::empty())
    }

    fn band(self) -> Style {
        Style::new().add_modifier(Modifier::REVERSED)
    }

    fn alarm(self) -> Style {
        let style = if self.colours { Style::new().fg(Color::White).bg(Color::Red) } else { self.band() };
        style.add_modifier(Modifier::BOLD)
    }

    fn of_severity(self, severity: MavSeverity) -> Style {
        match severity {
            MavSeverity::MAV_SEVERITY_EMERGENCY
            | MavSeverity::MAV_SEVERITY_ALERT
            | MavSeverity::MAV_SEVERITY_CRITICAL
            | MavSeverity::MAV_SEVERITY_ERROR => self.bad(),
            MavSeverity::MAV_SEVERITY_WARNING => self.warn(),
            MavSeverity::MAV_SEVERITY_NOTICE => Style::new().add_modifier(Modifier::BOLD),
            MavSeverity::MAV_SEVERITY_INFO | MavSeverity::MAV_SEVERITY_DEBUG => Style::new(),
        }
    }
}

/// Draws the state as it is at `now`.
pub fn draw(state: &State, now: Instant, theme: Theme, frame: &mut Frame<'_>) {
    let area = frame.area();
    if area.width < LEAST[0] || area.height < LEAST[1] {
        let text = format!(
            "{} by {} is too small: 80 by 24 shows everything. q leaves, K then y kills.",
            area.width, area.height
        );
        frame.render_widget(Paragraph::new(text).wrap(ratatui::widgets::Wrap { trim: true }), area);
        return;
    }
    let wide = area.width >= WIDE[0] && area.height >= WIDE[1];
    let panel = PANEL[usize::from(wide)];
    let [title, top, secrecy, lines, foot] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(panel),
        Constraint::Length(2),
        Constraint::Fill(1),
        Constraint::Length(1),
    ])
    .areas(area);
    let at = state.time(now);
    draw_title(state, now, theme, frame, title);
    if wide {
        let [i, j, right] =
            Layout::horizontal([Constraint::Length(50), Constraint::Length(50), Constraint::Fill(1)])
                .areas(top);
        panel::draw(state, Role::I, at, theme, wide, frame, i);
        panel::draw(state, Role::J, at, theme, wide, frame, j);
        map::draw(state, at, theme, frame, right);
    } else {
        let [i, j] = Layout::horizontal([Constraint::Fill(1); 2]).areas(top);
        panel::draw(state, Role::I, at, theme, wide, frame, i);
        panel::draw(state, Role::J, at, theme, wide, frame, j);
    }
    draw_secrecy(state, at, theme, frame, secrecy);
    draw_lines(state, now, theme, frame, lines);
    draw_foot(state, theme, frame, foot);
    if state.helps {
        draw_help(state, theme, frame, area);
    }
}

/// What is watched, the time, and the orders that are in force.
fn draw_title(state: &State, now: Instant, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let at = state.time(now);
    let what = match &state.source {
        Source::Live(addresses) => addresses.join(" "),
        Source::Simulated(mission) => format!("simulated: {mission}"),
        Source::Recorded(name) => format!("recorded: {name}"),
    };
    let mut left = vec![Span::styled(" veilwing  ", theme.band().add_modifier(Modifier::BOLD))];
    let in_force = Role::BOTH
        .into_iter()
        .filter_map(|role| state.vehicle(role)?.figure(Figure::Orders, at))
        .fold(0, |all, orders| all | orders as u8);
    for (bit, text) in [(1, " RADIO KILL IN FORCE "), (2, " PAUSED "), (4, " START PENDING ")] {
        if in_force & bit != 0 {
            left.push(Span::styled(
                text,
                if bit == 1 { theme.alarm() } else { theme.band().patch(theme.warn()) },
            ));
            left.push(Span::styled("  ", theme.band()));
        }
    }
    let right = match &state.replay {
        None => format!("{} ", clock_of(state.utc(at))),
        Some(replay) => format!(
            "{} x{}  {} of {}  {} ",
            if replay.plays(now) { "plays" } else { "stands" },
            replay.speed(),
            span_of(replay.at(now).as_secs_f64()),
            span_of(replay.length().as_secs_f64()),
            clock_of(state.utc(at)),
        ),
    };
    let taken = left.iter().map(Span::width).sum::<usize>() + right.chars().count() + 1;
    let room = usize::from(area.width).saturating_sub(taken);
    left.push(Span::styled(words::cut(&what, room), theme.band()));
    let used: usize = left.iter().map(Span::width).sum();
    let gap = usize::from(area.width).saturating_sub(used + right.chars().count());
    left.push(Span::styled(format!("{}{right}", " ".repeat(gap)), theme.band()));
    frame.render_widget(Paragraph::new(Line::from(left)), area);
}

/// What is served, or why nothing is.
fn draw_secrecy(state: &State, at: Instant, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let [words, history] = Layout::vertical([Constraint::Length(1); 2]).areas(area);
    // Either's model knows both; I's own position and power are the more exact half.
    let mut told = Role::BOTH.into_iter().filter_map(|role| state.vehicle(role));
    let told = told.find(|vehicle| vehicle.live("SEC_RATE", at).is_some());
    // A figure of a second ago means nothing once I is off, which is said at once.
    let i_off = state.vehicle(Role::I).is_some_and(|i| i.figure(Figure::Radio, at) == Some(0.0));
    let now_bps = told.filter(|_| !i_off).and_then(|vehicle| vehicle.live("SEC_RATE", at)).unwrap_or(0.0);
    let mut spans = vec![Span::raw(" secrecy ")];
    if now_bps > 0.0 {
        spans.push(Span::styled(rate(now_bps), theme.good()));
        let db = |name: &str| told.and_then(|vehicle| vehicle.live(name, at));
        if let (Some(user), Some(eve)) = (db("SINR_USER"), db("SINR_EVE")) {
            spans.push(Span::raw(format!("  user {user:.1} dB, strongest eavesdropper {eve:.1} dB")));
        }
        let each = told.map(|vehicle| vehicle.eavesdroppers(at)).unwrap_or_default();
        if area.width >= WIDE[0] && !each.is_empty() {
            let each: Vec<String> = each.iter().map(|db| format!("{db:.1}")).collect();
            spans.push(Span::raw(format!("; eavesdroppers 1 to {}: {} dB", each.len(), each.join(", "))));
        }
    } else {
        spans.push(Span::styled("none  ", theme.warn()));
        let [(_, i), (_, j)] = why_silent(state, at);
        let first = if i == j { format!("both: {i}") } else { format!("I: {i}") };
        spans.push(Span::raw(first));
        let second = if i == j { String::new() } else { format!("{:15}J: {j}", "") };
        frame.render_widget(Paragraph::new(Line::from(spans)), words);
        return frame.render_widget(Paragraph::new(second), history);
    }
    frame.render_widget(Paragraph::new(Line::from(spans)), words);
    let label = " 2 minutes ";
    let [left, right] =
        Layout::horizontal([Constraint::Length(label.len() as u16), Constraint::Fill(1)]).areas(history);
    frame.render_widget(Paragraph::new(Span::styled(label, theme.quiet())), left);
    if let Some(vehicle) = told {
        let bars = past(vehicle, at, usize::from(right.width));
        frame.render_widget(
            Sparkline::default().data(bars).style(theme.of(Color::Green, Modifier::empty())),
            right,
        );
    }
}

/// Two minutes of rates in so many columns, the newest last.
fn past(vehicle: &Vehicle, at: Instant, columns: usize) -> Vec<u64> {
    const SPAN_S: f64 = 120.0;
    let mut bars = vec![0; columns];
    for rate in &vehicle.rates {
        let ago = at.saturating_since(rate.at).as_secs_f64();
        let column = (columns as f64 * (1.0 - ago / SPAN_S)).ceil() - 1.0;
        if rate.at <= at
            && column >= 0.0
            && let Some(bar) = bars.get_mut(column as usize)
        {
            *bar = rate.value.max(0.0) as u64;
        }
    }
    // A figure comes each second or so: what is between two of them is as the first.
    for column in 1..columns {
        if bars[column] == 0 && bars[column - 1] > 0 && bars.get(column + 1).is_some_and(|next| *next > 0) {
            bars[column] = bars[column - 1];
        }
    }
    bars
}

fn why_silent(state: &State, at: Instant) -> [(Role, String); 2] {
    Role::BOTH.map(|role| {
        let why = match state.vehicle(role) {
            None => "is not heard".to_owned(),
            Some(vehicle) if vehicle.companion_at.is_none() => "its companion is not heard".to_owned(),
            Some(vehicle) if !vehicle.is_heard(at) => "is not heard any more".to_owned(),
            Some(vehicle) => match vehicle.figure(Figure::Silent, at) {
                None => "says nothing of it".to_owned(),
                Some(0.0) => "may be on the air".to_owned(),
                Some(number) => {
                    silence_words(number as u8).unwrap_or_else(|| format!("silent for reason {number}"))
                }
            },
        };
        (role, why)
    })
}

/// What was said, the newest last; above it how orders stand.
fn draw_lines(state: &State, now: Instant, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let [head, body] = Layout::vertical([Constraint::Length(1), Constraint::Fill(1)]).areas(area);
    let mut spans = Vec::new();
    if let Some(remark) = state.remarked(now) {
        spans.push(Span::styled(format!(" {remark} "), theme.warn()));
    }
    for asked in state.asked.iter().rev() {
        let style = match (asked.failed(), asked.end.is_some()) {
            (true, _) => theme.bad(),
            (false, true) => theme.good(),
            (false, false) => theme.warn(),
        };
        spans.push(Span::styled(format!(" {} ", asked.words(now)), style));
    }
    if spans.is_empty() {
        let below =
            if state.scrolled > 0 { format!(" ({} more below: Esc)", state.scrolled) } else { String::new() };
        spans.push(Span::styled(format!(" messages{below}"), theme.quiet()));
    }
    let used: usize = spans.iter().map(Span::width).sum();
    let rule = "\u{2500}".repeat(usize::from(head.width).saturating_sub(used + 1));
    spans.push(Span::styled(format!(" {rule}"), theme.quiet()));
    frame.render_widget(Paragraph::new(Line::from(spans)), head);

    let rows = usize::from(body.height);
    let width = usize::from(body.width);
    let mut shown: Vec<Line<'_>> = Vec::new();
    // From the newest up, each in as many rows as it takes.
    for line in state.lines.iter().rev().skip(state.scrolled) {
        let style = theme.of_severity(line.severity);
        let stamp = format!(" {} {:<5} ", words::time_of(state.utc(line.at)), line.who);
        let indent = stamp.chars().count();
        let parts = words::folded(&line.text, width.saturating_sub(indent).max(20));
        for (k, part) in parts.into_iter().enumerate().rev() {
            let start = if k == 0 { stamp.clone() } else { " ".repeat(indent) };
            shown.push(Line::from(vec![Span::styled(start, theme.quiet()), Span::styled(part, style)]));
        }
        if shown.len() >= rows {
            break;
        }
    }
    shown.truncate(rows);
    shown.reverse();
    frame.render_widget(Paragraph::new(shown), body);
}

/// The question that waits for a yes, or what the keys do.
fn draw_foot(state: &State, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let line = match (&state.question, &state.replay) {
        (Some((order, _)), _) => {
            let whom = match state.whom {
                Whom::One(role) if *order != Order::Kill => format!(" (vehicle {role} alone)"),
                _ => String::new(),
            };
            let text = format!(" {}{whom}   y or Enter: yes    any other key: no ", order.question());
            Line::styled(format!("{text:<width$}", width = usize::from(area.width)), theme.alarm())
        }
        (None, Some(_)) => keys(
            theme,
            &[
                ("Space", "play"),
                ("\u{2190} \u{2192}", "10 s"),
                ("[ ]", "1 s"),
                ("+ -", "speed"),
                ("Home End", ""),
                ("?", ""),
                ("q", "quit"),
            ],
        ),
        (None, None) => {
            let whom = match state.whom {
                Whom::Pair => "both".to_owned(),
                Whom::One(role) => format!("{role} only"),
            };
            keys(
                theme,
                &[
                    ("S", "start"),
                    ("P", "pause"),
                    ("C", "continue"),
                    ("R", "return"),
                    ("K", "KILL"),
                    ("L", "lift"),
                    ("Tab", &whom),
                    ("?", ""),
                    ("q", "quit"),
                ],
            )
        }
    };
    frame.render_widget(Paragraph::new(line), area);
}

fn keys(theme: Theme, keys: &[(&str, &str)]) -> Line<'static> {
    let mut spans = Vec::new();
    for (key, does) in keys {
        spans.push(Span::styled(format!(" {key} "), theme.band()));
        if !does.is_empty() {
            spans.push(Span::raw(format!("{does} ")));
        }
    }
    Line::from(spans)
}

fn draw_help(state: &State, theme: Theme, frame: &mut Frame<'_>, area: Rect) {
    let orders = [
        "S  start (on the ground)      Every order is asked for once more: y or Enter.",
        "P  pause: silent, holding     It is said again until the companion answers;",
        "C  continue after a pause     a refusal is told in words, among the messages.",
        "R  return: silent, both home",
        "K  KILL both radios, until lifted: K y, K Enter or K K. Said to both.",
        "L  lift the kill at both (on the ground, disarmed)",
        "Tab  whom orders go to: the pair (one takes them for both), I, or J alone.",
        "     A vehicle in another hand heeds what is for it alone: Tab, then R.",
    ];
    let replay = [
        "Space  play, stand; at the end: from the beginning",
        "left right  10 s back, on      [ ]  1 s back, on      Home End",
        "+ - (or up, down)  faster, slower",
    ];
    let common = ["PgUp PgDn  earlier and later messages; Esc: the newest", "q  leave     ?  this help"];
    let own: &[&str] = if state.replay.is_some() { &replay } else { &orders };
    let figures = [
        "",
        "RADIO    ON: its radio has answered with this power; off: known to be off",
        "lease    what is left of I's leave to radiate, which J grants while it jams",
        "off      from where the plan has it, and is turned, at this moment",
        "pilot    mode, and how old the state is that the companion flies by",
        "links    since the other companion was heard, by how much its autopilot's",
        "         clock is ahead, and how long the radio takes to answer",
        "lands    when the landing begins, about, if all goes by the plan",
    ];
    let lines: Vec<Line<'_>> =
        own.iter().chain(&common).chain(&figures).map(|line| Line::raw(format!(" {line}"))).collect();
    let width = area.width.min(80);
    let height = (lines.len() as u16 + 2).min(area.height);
    let middle =
        Rect { x: area.x + (area.width - width) / 2, y: area.y + (area.height - height) / 2, width, height };
    frame.render_widget(Clear, middle);
    let block = Block::bordered().title(" keys ").border_style(theme.quiet());
    frame.render_widget(Paragraph::new(lines).block(block), middle);
}

/// What is left of a time, in words, or a dash.
fn left(time_s: Option<f64>) -> String {
    time_s.map_or("-".to_owned(), seconds)
}
