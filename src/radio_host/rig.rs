//! The device: what it is wanted to do, what it was told, and what is known of it.
//!
//! One order is under way at a time, and off pre-empts. A power is in force when the device was read back at it; off is when
//! off was. An order to radiate that was cut short may still be on its way into the device: an off that was told before such
//! an order's time has passed is told again after it, and only that one counts. Whatever the device does otherwise than told,
//! or later than it declares, ends in off, and nothing is radiated until off is confirmed.
//!
//! A kill line ([`super::line`]), where there is one, goes off with every off. It makes silence certain whatever the device does,
//! but says nothing of the device: before another power is tried, that must have confirmed off too.

use std::collections::VecDeque;
use std::time::Duration;

use super::line::{Level, Line, LineTimes, LineTurn};
use super::scale::{Scale, Setting};
use crate::time::Instant;

/// A power that was read back may be above the one that was set by no more than a device rounds what it prints.
const ABOVE_DB: f64 = 0.0055;
/// An off that failed is told again after this.
const OFF_AGAIN: Duration = Duration::from_millis(200);
/// An off that is not answered is given up and told anew after three times the longest that it takes, and this.
const PATIENCE: Duration = Duration::from_secs(1);

/// What the device is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// To be silent, and to be read back so.
    Off,
    /// To radiate by this setting, and to be read back.
    Set(Setting),
}

/// Names an order, for its outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct OrderId(u64);

/// What became of an order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// It is silent, as far as it can be read.
    Off,
    /// It was set.
    Set {
        /// The setting in force, as the device says; `None` where it cannot be read.
        read_back: Option<f64>,
    },
    /// It was not done, or not for certain.
    Failed(Fault),
}

/// What the device did wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error, strum::IntoStaticStr)]
pub enum Fault {
    /// No answer within the time that it declares.
    #[error("the device is late")]
    Late,
    /// It cannot be reached, or broke off.
    #[error("the device cannot be reached")]
    Unreachable,
    /// It says that it will not, or cannot.
    #[error("the device refuses")]
    Refused,
    /// What it says cannot be understood, or is too much.
    #[error("the device answers garbage")]
    Garbled,
    /// It was read back at another power than was set.
    #[error("the device has another power")]
    OtherPower,
    /// It was told off and was read back on.
    #[error("the device is still on")]
    StillOn,
    /// The kill line cannot be driven, reads otherwise than it was driven, or was not fed in time.
    #[error("the kill line fails")]
    Line,
}

/// The longest that the device takes, by its declaration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Times {
    /// From an off to silence that was read back.
    pub off: Duration,
    /// From an order to the new power that was read back.
    pub change: Duration,
}

/// What is known of the device.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Known {
    Off,
    On {
        setting: Setting,
        achieved_dbm: f64,
    },
    /// It may radiate as much as this.
    Unsure {
        at_most_dbm: f64,
    },
}

impl Known {
    fn at_most_dbm(self) -> f64 {
        match self {
            Self::Off => f64::NEG_INFINITY,
            Self::On { achieved_dbm, .. } => achieved_dbm,
            Self::Unsure { at_most_dbm } => at_most_dbm,
        }
    }
}

/// An order under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Flight {
    id: OrderId,
    order: Order,
    at: Instant,
    /// It has taken longer than the device declares.
    late: bool,
}

/// What an outcome or the time has brought about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// Nothing that anybody waits for.
    Nothing,
    /// Of no order under way.
    Stale,
    /// Silent.
    Silent,
    /// Silent by the kill line.
    Cut,
    /// At the power that is wanted.
    Reached,
    /// It did not do what it was told, and is told off.
    Failed(Fault),
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Rig {
    scale: Scale,
    times: Times,
    /// How far below the power that was set it may be read back.
    below_db: f64,
    /// `None`: off.
    wanted: Option<Setting>,
    known: Known,
    flight: Option<Flight>,
    /// Stands until off is confirmed.
    fault: Option<Fault>,
    /// An off was not confirmed when it should have been.
    in_doubt: bool,
    line: Option<Line>,
    off_again_at: Option<Instant>,
    /// An off that was told before this proves nothing: an order that was cut short may follow it.
    settled_from: Instant,
    orders: VecDeque<(OrderId, Order)>,
    last_id: u64,
}

impl Rig {
    /// A device of which nothing is known; it is told off first of all.
    pub fn new(scale: Scale, times: Times, below_db: f64, line: Option<LineTimes>, now: Instant) -> Self {
        let at_most_dbm = scale.most_dbm();
        let mut rig = Self {
            scale,
            times,
            below_db,
            wanted: None,
            known: Known::Unsure { at_most_dbm },
            flight: None,
            fault: None,
            in_doubt: false,
            line: line.map(Line::new),
            off_again_at: None,
            settled_from: now,
            orders: VecDeque::new(),
            last_id: 0,
        };
        rig.tell(Order::Off, now);
        rig
    }

    pub fn scale(&self) -> &Scale {
        &self.scale
    }

    /// Off, at once.
    pub fn want_off(&mut self, now: Instant) {
        self.wanted = None;
        match self.flight {
            Some(Flight { order: Order::Off, .. }) => {}
            None if self.known == Known::Off || self.off_again_at.is_some() => {}
            _ => self.tell_off(now),
        }
    }

    /// This power, as soon as the device does it.
    ///
    /// # Errors
    /// What the device did wrong, until it is known to be off again.
    pub fn want(&mut self, setting: Setting, now: Instant) -> Result<(), Fault> {
        if let Some(fault) = self.fault() {
            return Err(fault);
        }
        self.wanted = Some(setting);
        self.go_on(now);
        Ok(())
    }

    /// Takes what became of an order.
    pub fn handle_outcome(&mut self, id: OrderId, outcome: Outcome, now: Instant) -> Turn {
        let Some(flight) = self.flight.filter(|flight| flight.id == id) else { return Turn::Stale };
        self.flight = None;
        match (flight.order, outcome) {
            (Order::Off, Outcome::Off) => self.confirm_off(flight.at, now),
            (Order::Off, Outcome::Failed(fault)) => self.off_failed(fault, now),
            (Order::Off, Outcome::Set { .. }) => self.off_failed(Fault::StillOn, now),
            (Order::Set(setting), Outcome::Set { read_back }) => self.is_set(setting, read_back, now),
            (Order::Set(setting), Outcome::Failed(fault)) => self.fail(fault, setting.dbm, now),
            (Order::Set(setting), Outcome::Off) => self.fail(Fault::OtherPower, setting.dbm, now),
        }
    }

    /// Takes whether the kill line was driven as [`Self::poll_line`] said.
    pub fn handle_line(&mut self, level: Level, obeyed: bool, now: Instant) -> Turn {
        let turn = self.line.as_mut().map_or(LineTurn::Nothing, |line| line.handle(level, obeyed, now));
        self.follow_line(turn, now)
    }

    /// Does what is due; what is left is due at once.
    pub fn handle_timeout(&mut self, now: Instant) -> Turn {
        let line = self.line.as_mut().map_or(LineTurn::Nothing, |line| line.advance(now));
        let turn = self.follow_line(line, now);
        if turn != Turn::Nothing {
            return turn;
        }
        if self.off_again_at.is_some_and(|at| at <= now) {
            self.tell(Order::Off, now);
        }
        let Some(flight) = self.flight.filter(|flight| self.ends_at(flight) <= now) else {
            return Turn::Nothing;
        };
        match flight.order {
            Order::Set(setting) => {
                let turn = self.fail(Fault::Late, setting.dbm, now);
                // As late as it is, it may be carried out later still.
                self.settled_from = self.settled_from.max(now + self.times.change);
                turn
            }
            Order::Off if flight.late => {
                self.tell(Order::Off, now);
                Turn::Nothing
            }
            Order::Off => {
                self.flight = Some(Flight { late: true, ..flight });
                // Else a power would follow whose lease is over when the device answers at last.
                self.wanted = None;
                self.doubt(Fault::Late)
            }
        }
    }

    /// When [`Self::handle_timeout`] is next to be called.
    pub fn timeout(&self) -> Option<Instant> {
        let flight = self.flight.map(|flight| self.ends_at(&flight));
        let line = self.line.as_ref().and_then(Line::timeout);
        [flight, self.off_again_at, line].into_iter().flatten().min()
    }

    /// The next level of the kill line.
    pub fn poll_line(&mut self) -> Option<Level> {
        self.line.as_mut()?.poll()
    }

    pub fn poll_order(&mut self) -> Option<(OrderId, Order)> {
        self.orders.pop_front()
    }

    /// What it radiates, in dBm, as it was read back; while that is not known, the most that it may. `None`: it is off.
    pub fn power_dbm(&self) -> Option<f64> {
        (!self.is_silent()).then(|| self.known.at_most_dbm())
    }

    /// Whether off was confirmed, by the line where the device has none of its own, and nothing else was told since.
    pub fn is_off(&self) -> bool {
        self.known == Known::Off && self.flight.is_none() && (self.is_cut() || !self.is_line_alone())
    }

    /// Whether nothing is radiated; something else may be under way.
    pub fn is_silent(&self) -> bool {
        self.is_cut() || self.known == Known::Off && !self.is_line_alone()
    }

    /// Whether the kill line keeps it silent, whatever the device does.
    pub fn is_cut(&self) -> bool {
        self.line.as_ref().is_some_and(Line::is_cut)
    }

    fn is_line_alone(&self) -> bool {
        self.line.as_ref().is_some_and(Line::is_alone)
    }

    /// Whether it was read back at what is wanted.
    pub fn is_reached(&self) -> bool {
        let at = match self.known {
            Known::On { setting, .. } => Some(setting),
            Known::Off | Known::Unsure { .. } => None,
        };
        let through = self.line.as_ref().is_none_or(Line::is_through);
        self.flight.is_none() && self.wanted.is_some() && at == self.wanted && through
    }

    /// Whether a power is wanted of it.
    pub fn is_wanted_on(&self) -> bool {
        self.wanted.is_some()
    }

    pub fn fault(&self) -> Option<Fault> {
        self.fault.or(self.line.as_ref().filter(|line| line.has_failed()).map(|_| Fault::Line))
    }

    fn ends_at(&self, flight: &Flight) -> Instant {
        match flight.order {
            Order::Set(_) => flight.at + self.times.change,
            Order::Off if flight.late => flight.at + 3 * self.times.off + PATIENCE,
            Order::Off => flight.at + self.times.off,
        }
    }

    fn tell(&mut self, order: Order, now: Instant) {
        self.last_id += 1;
        let id = OrderId(self.last_id);
        self.off_again_at = None;
        self.flight = Some(Flight { id, order, at: now, late: false });
        if let (Order::Off, Some(line)) = (order, &mut self.line) {
            line.off();
        }
        // What was not taken yet is pre-empted.
        self.orders.clear();
        self.orders.push_back((id, order));
    }

    fn tell_off(&mut self, now: Instant) {
        if let Some(Flight { order: Order::Set(setting), at, .. }) = self.flight {
            self.settled_from = self.settled_from.max(at + self.times.change);
            self.known = Known::Unsure { at_most_dbm: self.known.at_most_dbm().max(setting.dbm) };
        }
        self.tell(Order::Off, now);
    }

    /// Tells the device what is wanted, if nothing is under way and it is known what it does.
    fn go_on(&mut self, now: Instant) {
        let (Some(wanted), None) = (self.wanted, self.flight) else { return };
        match self.known {
            Known::On { setting, .. } if setting == wanted => {}
            Known::On { .. } | Known::Off => self.tell(Order::Set(wanted), now),
            Known::Unsure { .. } => {}
        }
    }

    fn confirm_off(&mut self, told_at: Instant, now: Instant) -> Turn {
        if told_at < self.settled_from {
            self.off_again_at = Some(self.settled_from.max(now));
            return Turn::Nothing;
        }
        (self.known, self.fault, self.in_doubt) = (Known::Off, None, false);
        self.go_on(now);
        if self.is_silent() { Turn::Silent } else { Turn::Nothing }
    }

    fn follow_line(&mut self, turn: LineTurn, now: Instant) -> Turn {
        match turn {
            LineTurn::Nothing => Turn::Nothing,
            LineTurn::Cut => Turn::Cut,
            LineTurn::Through if self.is_reached() => Turn::Reached,
            LineTurn::Through => Turn::Nothing,
            LineTurn::Failed => match self.wanted {
                Some(setting) => self.fail(Fault::Line, setting.dbm, now),
                None => Turn::Failed(Fault::Line),
            },
        }
    }

    fn off_failed(&mut self, fault: Fault, now: Instant) -> Turn {
        self.known = Known::Unsure { at_most_dbm: self.known.at_most_dbm().max(self.scale.least_dbm()) };
        self.off_again_at = Some(now + OFF_AGAIN);
        self.doubt(fault)
    }

    /// An off is not confirmed: told once, and again when it is for another reason. Whoever wanted a power is told so, and has no
    /// lease any more: once off is confirmed after all, nothing is wanted.
    fn doubt(&mut self, fault: Fault) -> Turn {
        self.wanted = None;
        let same = self.fault.replace(fault) == Some(fault);
        let first = !std::mem::replace(&mut self.in_doubt, true);
        if first || !same { Turn::Failed(fault) } else { Turn::Nothing }
    }

    fn is_set(&mut self, setting: Setting, read_back: Option<f64>, now: Instant) -> Turn {
        let achieved_dbm = read_back.map_or(setting.dbm, |value| self.scale.dbm_of(value));
        // False for NaN.
        let as_set = (setting.dbm - self.below_db..=setting.dbm + ABOVE_DB).contains(&achieved_dbm);
        if !as_set {
            return self.fail(Fault::OtherPower, setting.dbm.max(achieved_dbm), now);
        }
        self.known = Known::On { setting, achieved_dbm };
        if let (Some(line), true) = (&mut self.line, self.wanted.is_some()) {
            line.let_through();
        }
        self.go_on(now);
        if self.is_reached() { Turn::Reached } else { Turn::Nothing }
    }

    /// The device may radiate as much as `at_most_dbm`, and is not to.
    fn fail(&mut self, fault: Fault, at_most_dbm: f64, now: Instant) -> Turn {
        (self.wanted, self.fault, self.flight) = (None, Some(fault), None);
        self.known = Known::Unsure { at_most_dbm: self.known.at_most_dbm().max(at_most_dbm) };
        self.tell(Order::Off, now);
        Turn::Failed(fault)
    }
}
