//! One vehicle.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::GpsFixType;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

use super::words::{age, cut, seconds, span_of};
use super::{Theme, left};
use crate::desk::watch::state::State;
use crate::desk::watch::vehicle::{self, Vehicle};
use crate::mission::{Figure, PHASES, Vector, silence_words};
use crate::role::Role;
use crate::time::Instant;

/// Phases in which something has gone wrong, or is over: by their place in [`PHASES`].
const HOLDING: usize = 7;
const SURRENDERED: usize = 10;
/// Where a slot is agreed on.
const SLOT: usize = vehicle::SLOT;
/// A row's name takes so many columns.
const NAME: usize = 7;
/// A lease is said again within this.
const LEASES_LAST: Duration = Duration::from_secs(2);
/// A state older than this silences.
const OLD_S: f64 = 0.25;

pub(super) fn draw(
    state: &State,
    role: Role,
    at: Instant,
    theme: Theme,
    wide: bool,
    frame: &mut Frame<'_>,
    area: Rect,
) {
    let Some(vehicle) = state.vehicle(role) else {
        let block = Block::bordered().title(format!(" vehicle {role} ")).border_style(theme.quiet());
        let text = vec![Line::raw(""), Line::styled("  not heard yet", theme.warn())];
        return frame.render_widget(Paragraph::new(text).block(block), area);
    };
    let heard = vehicle.is_heard(at);
    let who = match vehicle.role {
        Some(role) => format!(" vehicle {role}, system {} ", vehicle.id.system),
        None => format!(" system {} (I or J: not said yet) ", vehicle.id.system),
    };
    let border = if heard { Style::new() } else { theme.bad() };
    let block = Block::bordered()
        .title(Span::styled(who, Style::new().add_modifier(Modifier::BOLD)))
        .border_style(border);
    let width = usize::from(area.width).saturating_sub(2);
    let rows = Rows { vehicle, role, at, theme, width };
    let mut lines =
        vec![if heard { rows.phase() } else { rows.lost() }, rows.bar(), rows.radio(), rows.why()];
    lines.push(rows.lease());
    lines.extend([rows.place("at", Vector::Position), rows.place("plan", Vector::Planned)]);
    if wide {
        lines.extend([rows.turn("turned", Vector::Attitude), rows.turn("plan", Vector::PlannedAttitude)]);
    }
    lines.extend([rows.off(), rows.autopilot(), rows.battery(), rows.links()]);
    if wide {
        lines.extend([rows.landing(), rows.computer(), rows.answers()]);
    }
    frame.render_widget(Paragraph::new(lines).block(block), area);
}

struct Rows<'a> {
    vehicle: &'a Vehicle,
    role: Role,
    at: Instant,
    theme: Theme,
    width: usize,
}

impl Rows<'_> {
    fn row(&self, name: &str, text: impl Into<String>, style: Style) -> Line<'static> {
        let text = cut(&text.into(), self.width.saturating_sub(NAME + 1));
        Line::from(vec![
            Span::styled(format!(" {name:<NAME$}"), self.theme.quiet()),
            Span::styled(text, style),
        ])
    }

    fn figure(&self, figure: Figure) -> Option<f64> {
        self.vehicle.figure(figure, self.at)
    }

    fn lost(&self) -> Line<'static> {
        let text = match self.vehicle.companion_at {
            Some(heard) => {
                format!(" NOT HEARD for {}", seconds(self.at.saturating_since(heard).as_secs_f64()))
            }
            None => " its companion is not heard; the autopilot is".to_owned(),
        };
        Line::styled(cut(&text, self.width), self.theme.bad())
    }

    fn phase(&self) -> Line<'static> {
        let Some(number) = self.vehicle.phase(self.at) else {
            return Line::styled(" says no phase", self.theme.warn());
        };
        let name = PHASES.get(number).map_or_else(|| format!("phase {number}"), |name| (*name).to_owned());
        let slots = self.figure(Figure::Slots);
        let slot = self.figure(Figure::Slot).zip(slots).filter(|_| number + 1 == SLOT || number == SLOT);
        let which = slot.map(|(slot, slots)| format!("{slot}, {} of {slots}", slot + 1.0));
        let text = match (number, which) {
            (SLOT, Some(which)) => match self.vehicle.countdown(Figure::Opens, self.at) {
                Some(opens) if opens > 0.0 => format!("on its way to slot {which}"),
                _ => format!("in slot {which}"),
            },
            (_, Some(which)) => format!("{name}, next is slot {which}"),
            (_, None) => name,
        };
        let style = match number {
            HOLDING | SURRENDERED => self.theme.bad(),
            SLOT => self.theme.good(),
            _ => Style::new().add_modifier(Modifier::BOLD),
        };
        Line::styled(format!(" {}", cut(&text, self.width.saturating_sub(1))), style)
    }

    /// What the clock says: how far the slot is, or how long all of it may take yet.
    fn bar(&self) -> Line<'static> {
        let opens = self.vehicle.countdown(Figure::Opens, self.at);
        let closes = self.vehicle.countdown(Figure::Closes, self.at);
        match opens.zip(closes) {
            Some((opens, _)) if opens > 0.0 => self.row("opens", seconds(opens), Style::new()),
            Some((opens, closes)) if closes > 0.0 => {
                let done = (-opens / (closes - opens)).clamp(0.0, 1.0);
                let columns = self.width.saturating_sub(NAME + 12);
                let full = (done * columns as f64).round() as usize;
                let bar = format!("{}{}", "#".repeat(full), ".".repeat(columns - full.min(columns)));
                self.row("closes", format!("{:>6}  {bar}", seconds(closes)), Style::new())
            }
            _ => self.landing(),
        }
    }

    fn landing(&self) -> Line<'static> {
        let text = match self.vehicle.countdown(Figure::Left, self.at) {
            Some(left) => format!("in about {}", span_of(left.max(0.0))),
            None => "-".to_owned(),
        };
        self.row("landing", text, Style::new())
    }

    fn radio(&self) -> Line<'static> {
        let plan = self.figure(Figure::PlannedPower).map_or(String::new(), |dbm| format!(" (plan {dbm:.1})"));
        match self.figure(Figure::Radio).map(|state| state as u8) {
            Some(0) => self.row("RADIO", format!("off{plan}"), Style::new().add_modifier(Modifier::BOLD)),
            Some(2) => {
                let power = self.figure(Figure::Power).map_or(String::new(), |dbm| format!(" {dbm:.1} dBm"));
                self.row("RADIO", format!("ON{power}{plan}"), self.theme.good())
            }
            Some(_) => self.row("RADIO", format!("not known off{plan}"), self.theme.warn()),
            None => self.row("RADIO", "-", Style::new()),
        }
    }

    fn why(&self) -> Line<'static> {
        let (text, style) = match self.figure(Figure::Silent).map(|number| number as u8) {
            Some(0) if self.figure(Figure::Radio) == Some(2.0) => ("no".to_owned(), Style::new()),
            Some(0) => ("no: it may be on the air".to_owned(), Style::new()),
            // In a slot's time each of these has a cost.
            Some(number) => {
                let words = silence_words(number).unwrap_or_else(|| format!("reason {number}"));
                let open = self.vehicle.countdown(Figure::Opens, self.at).is_some_and(|opens| opens <= 0.0);
                (words, if open { self.theme.warn() } else { Style::new() })
            }
            None => ("-".to_owned(), Style::new()),
        };
        self.row("silent", text, style)
    }

    fn lease(&self) -> Line<'static> {
        let what = if self.role == Role::I { "held" } else { "granted" };
        // It is renewed twenty times a second: one that was not told of for two seconds is nothing to show.
        let told = self.vehicle.said(Figure::Lease, self.at).filter(|said| said.at + LEASES_LAST >= self.at);
        match told.map(|said| said.value) {
            Some(left) if left > 0.0 => {
                self.row("lease", format!("{what}, {} left", age(left)), self.theme.good())
            }
            Some(_) => self.row("lease", "none", Style::new()),
            None => self.row("lease", "-", Style::new()),
        }
    }

    fn place(&self, name: &str, vector: Vector) -> Line<'static> {
        let text = match self.vehicle.vector(vector, self.at) {
            Some([e, n, u]) => format!("{e:6.1} E {n:6.1} N {u:6.1} m"),
            None => "-".to_owned(),
        };
        self.row(name, text, Style::new())
    }

    fn turn(&self, name: &str, vector: Vector) -> Line<'static> {
        let text = match self.vehicle.vector(vector, self.at) {
            Some([roll, pitch, yaw]) => format!("roll {roll:6.1} pitch {pitch:6.1} yaw {yaw:6.1} deg"),
            None => "-".to_owned(),
        };
        self.row(name, text, Style::new())
    }

    fn off(&self) -> Line<'static> {
        let (metres, degrees) = (self.figure(Figure::PositionOff), self.figure(Figure::AttitudeOff));
        let text = match (metres, degrees) {
            (Some(metres), Some(degrees)) => format!("{metres:.2} m, {degrees:.1} deg from plan"),
            (Some(metres), None) => format!("{metres:.2} m from plan"),
            _ => "-".to_owned(),
        };
        // The widest tolerance of position there is.
        let style = if metres.is_some_and(|metres| metres > 1.0) { self.theme.warn() } else { Style::new() };
        self.row("off", text, style)
    }

    fn autopilot(&self) -> Line<'static> {
        let Some(heard) = self.vehicle.autopilot_at else {
            return self.row("pilot", "not heard", self.theme.warn());
        };
        let ago = self.at.saturating_since(heard).as_secs_f64();
        if ago > 3.0 {
            return self.row("pilot", format!("NOT HEARD for {}", seconds(ago)), self.theme.bad());
        }
        let armed = match self.vehicle.armed {
            Some(true) => "armed",
            Some(false) => "disarmed",
            None => "",
        };
        let state_s = self.figure(Figure::State);
        let state = state_s.map_or(String::new(), |state_s| format!(" {} old", age(state_s)));
        let style =
            if state_s.is_some_and(|state_s| state_s > OLD_S) { self.theme.warn() } else { Style::new() };
        self.row("pilot", format!("{} {armed}{state}", self.vehicle.mode.unwrap_or("-")), style)
    }

    fn battery(&self) -> Line<'static> {
        let percent = self.vehicle.battery_percent;
        let charge = percent.map_or("-".to_owned(), |percent| format!("{percent}%"));
        let volts = self.vehicle.battery_v.map_or(String::new(), |volts| format!(" {volts:.1} V"));
        let fix = match self.vehicle.fix {
            None => "",
            Some(GpsFixType::GPS_FIX_TYPE_NO_GPS | GpsFixType::GPS_FIX_TYPE_NO_FIX) => ", NO GPS FIX",
            Some(GpsFixType::GPS_FIX_TYPE_2D_FIX) => ", GPS 2D",
            Some(_) => ", GPS 3D",
        };
        let poor = percent.is_some_and(|percent| percent < 30) || fix == ", NO GPS FIX";
        self.row(
            "battery",
            format!("{charge}{volts}{fix}"),
            if poor { self.theme.warn() } else { Style::new() },
        )
    }

    fn links(&self) -> Line<'static> {
        let peer = self.role.peer();
        let silent_s = self.figure(Figure::Peer);
        let heard =
            silent_s.map_or(format!("{peer} not heard"), |silent_s| format!("{peer} {}", age(silent_s)));
        let clock = self
            .figure(Figure::Clock)
            .map_or(String::new(), |ahead| format!(" clock {:+} ms", (ahead * 1e3).round() as i64));
        let radio = self.figure(Figure::RoundTrip).map_or(String::new(), |ms| format!(" rtt {ms:.0} ms"));
        let lost = silent_s.is_none_or(|silent_s| silent_s > 1.0);
        self.row(
            "links",
            format!("{heard}{clock}{radio}"),
            if lost { self.theme.warn() } else { Style::new() },
        )
    }

    fn computer(&self) -> Line<'static> {
        let Some(computer) = self.vehicle.computer.map(|computer| computer.value) else {
            return self.row("cpu", "-", Style::new());
        };
        let share = |name: &str, percent: Option<u8>| percent.map(|percent| format!("{name} {percent}%"));
        let parts = [
            share("busy", computer.busy_percent),
            share("memory", computer.memory_percent),
            share("disk", computer.disk_percent),
            computer.degrees.map(|degrees| format!("{degrees} C")),
        ];
        let text = parts.into_iter().flatten().collect::<Vec<_>>().join(", ");
        self.row("cpu", text, Style::new())
    }

    fn answers(&self) -> Line<'static> {
        let heard = |at: Option<Instant>| left(at.map(|heard| self.at.saturating_since(heard).as_secs_f64()));
        let text = format!(
            "companion {}, autopilot {} ago",
            heard(self.vehicle.companion_at),
            heard(self.vehicle.autopilot_at)
        );
        self.row("heard", text, Style::new())
    }
}
