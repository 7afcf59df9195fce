//! The kill line: a wire to the transmitter's enable that needs no answer of the device's, and so is a second road to off.
//!
//! It is driven off with every off that the device is told, and lets the device through only when that was read back at the
//! power that is wanted. Off by the line counts so long after it was driven off as its hardware is declared to take. A line that
//! feeds a one-shot is a lease of its own: the hardware falls silent unless the line goes on having edges, whatever level it is
//! left at.

use std::time::Duration;

use crate::time::Instant;

/// A line that did not obey is driven off again after this.
const OFF_AGAIN: Duration = Duration::from_millis(200);
/// A one-shot is triggered by every second edge, and three times in the time that it holds.
const EDGES: u32 = 6;

/// What the line says to the hardware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// The level at which the transmitter is silent.
    Off,
    /// The other one.
    On,
}

/// What the hardware behind a line does, by its declaration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineTimes {
    /// From the line's off to silence.
    pub silence: Silence,
    /// The device has no off of its own: off is what the line does.
    pub alone: bool,
}

/// When the transmitter is silent by the line alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Silence {
    /// Not known: the line is driven, and proves nothing.
    Unknown,
    /// So long after the line was driven off.
    AtLevel(Duration),
    /// So long after the last edge away from off: a one-shot, which must be fed.
    WithoutEdges(Duration),
}

impl Silence {
    /// From the line's off to silence, where that is known.
    #[must_use]
    pub fn after(self) -> Option<Duration> {
        match self {
            Self::Unknown => None,
            Self::AtLevel(time) | Self::WithoutEdges(time) => Some(time),
        }
    }

    /// For how long an edge holds, where edges are what holds.
    #[must_use]
    pub fn holds(self) -> Option<Duration> {
        match self {
            Self::WithoutEdges(time) => Some(time),
            Self::Unknown | Self::AtLevel(_) => None,
        }
    }
}

/// A line that is fed: when it has its next edge, and when it had its last ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feed {
    holds: Duration,
    level: Level,
    on_at: Instant,
    next_at: Instant,
}

impl Feed {
    /// Of a line that was driven on at `now`, if edges are what holds it.
    #[must_use]
    pub fn begun(silence: Silence, now: Instant) -> Option<Self> {
        let holds = silence.holds()?;
        Some(Self { holds, level: Level::On, on_at: now, next_at: now + holds / EDGES })
    }

    /// When the next edge is due.
    #[must_use]
    pub fn due(&self) -> Instant {
        self.next_at
    }

    /// The level of the next edge, if it is due.
    #[must_use]
    pub fn edge(&mut self, now: Instant) -> Option<Level> {
        if now < self.next_at {
            return None;
        }
        self.next_at = now + self.holds / EDGES;
        self.level = match self.level {
            Level::Off => Level::On,
            Level::On => Level::Off,
        };
        Some(self.level)
    }

    /// The edge was made at `now`.
    pub fn made(&mut self, level: Level, now: Instant) {
        if level == Level::On {
            self.on_at = now;
        }
    }

    /// Whether the hardware may have fallen silent for want of an edge.
    #[must_use]
    pub fn may_have_lapsed(&self, now: Instant) -> bool {
        now >= self.on_at + self.holds
    }
}

/// What is known of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Unknown,
    Off,
    Through(Option<Feed>),
}

/// What a step of the line's, or the time, has brought about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LineTurn {
    Nothing,
    /// It lets the device through.
    Through,
    /// Nothing is radiated, whatever the device does.
    Cut,
    /// It does not obey, or was not fed in time.
    Failed,
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Line {
    times: LineTimes,
    wanted_through: bool,
    /// To be driven, and not taken yet.
    told: Option<Level>,
    state: State,
    cut: bool,
    cut_at: Option<Instant>,
    again_at: Option<Instant>,
    failed: bool,
}

impl Line {
    /// A line that is driven off first of all.
    pub fn new(times: LineTimes) -> Self {
        Self {
            times,
            wanted_through: false,
            told: Some(Level::Off),
            state: State::Unknown,
            cut: false,
            cut_at: None,
            again_at: None,
            failed: false,
        }
    }

    /// The device has no off of its own.
    pub fn is_alone(&self) -> bool {
        self.times.alone
    }

    /// Nothing is radiated, whatever the device does.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    pub fn is_through(&self) -> bool {
        self.wanted_through && self.told.is_none() && matches!(self.state, State::Through(_))
    }

    pub fn has_failed(&self) -> bool {
        self.failed
    }

    pub fn off(&mut self) {
        self.wanted_through = false;
        self.told = (self.state != State::Off && self.again_at.is_none()).then_some(Level::Off);
    }

    pub fn let_through(&mut self) {
        (self.wanted_through, self.cut, self.cut_at, self.again_at) = (true, false, None, None);
        self.told = (!matches!(self.state, State::Through(_))).then_some(Level::On);
    }

    pub fn poll(&mut self) -> Option<Level> {
        self.told.take()
    }

    /// Takes whether the line was driven, and read back where that can be.
    pub fn handle(&mut self, level: Level, obeyed: bool, now: Instant) -> LineTurn {
        if !obeyed {
            self.state = State::Unknown;
            (self.cut, self.cut_at, self.told) = (false, None, None);
            // One that does not let through is driven off at once.
            self.again_at = (!self.wanted_through).then(|| now + OFF_AGAIN);
            let known = std::mem::replace(&mut self.failed, true) && !self.wanted_through;
            return if known { LineTurn::Nothing } else { LineTurn::Failed };
        }
        if !self.wanted_through {
            if level == Level::On {
                // It was called back in between.
                self.told = Some(Level::Off);
                return LineTurn::Nothing;
            }
            (self.state, self.failed) = (State::Off, false);
            self.cut_at = self.times.silence.after().map(|after| now + after);
            return LineTurn::Nothing;
        }
        match &mut self.state {
            State::Through(feed) => {
                if let Some(feed) = feed {
                    feed.made(level, now);
                }
                LineTurn::Nothing
            }
            State::Unknown | State::Off => {
                self.state = State::Through(Feed::begun(self.times.silence, now));
                LineTurn::Through
            }
        }
    }

    /// Does what is due.
    pub fn advance(&mut self, now: Instant) -> LineTurn {
        if self.again_at.is_some_and(|at| at <= now) {
            self.again_at = None;
            self.told = Some(Level::Off);
        }
        if self.cut_at.is_some_and(|at| at <= now) {
            (self.cut, self.cut_at) = (true, None);
            return LineTurn::Cut;
        }
        if self.wanted_through
            && let State::Through(Some(feed)) = &mut self.state
        {
            if feed.may_have_lapsed(now) {
                return LineTurn::Failed;
            }
            if let Some(level) = feed.edge(now) {
                self.told = Some(level);
            }
        }
        LineTurn::Nothing
    }

    /// When [`Self::advance`] is next to be called.
    pub fn timeout(&self) -> Option<Instant> {
        let feed = match self.state {
            State::Through(feed) if self.wanted_through => feed.map(|feed| feed.due()),
            _ => None,
        };
        [feed, self.cut_at, self.again_at].into_iter().flatten().min()
    }
}
