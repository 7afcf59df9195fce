//! The bridge script of ArduCopter's 6DoF frame, which gives it a roll and pitch of its own, and the guard beside it.
//!
//! Scripting hands every command of any link to the script, and removes for good a script that takes too many instructions
//! in one run. Its offsets stay as they are then, in every mode; its commands remain blocked, so that nobody answers them.
//! A second script, the guard, goes level in its place.

use std::collections::VecDeque;
use std::time::Duration;

/// Between two runs of the script.
const RUN: Duration = Duration::from_millis(10);
/// Commands in one run that a script which decodes them all survives: ten ended one on ArduCopter 4.7-dev, with 10000
/// instructions a run.
const SURVIVED: usize = 9;
/// The guard waits so long for a pulse,
const PULSELESS: Duration = Duration::from_millis(300);
/// and levels this fast, rad/s.
const LEVELS_RAD_S: f64 = std::f64::consts::FRAC_PI_4;

/// Its state.
#[derive(Debug, Clone, Default)]
pub(super) struct Script {
    /// Roll and pitch (FRD) as commanded, and whether they are followed.
    wanted_rad: [f64; 2],
    on: bool,
    /// When the commands of the last run came.
    recent: VecDeque<Duration>,
    died_at: Option<Duration>,
}

impl Script {
    /// Takes note of a command of whatever kind; `true` if that was one too many.
    pub fn dies_of(&mut self, now: Duration) -> bool {
        self.recent.retain(|at| now.saturating_sub(*at) < RUN);
        self.recent.push_back(now);
        let dies = !self.is_dead() && self.recent.len() > SURVIVED;
        if dies {
            self.died_at = Some(now);
        }
        dies
    }

    pub fn is_dead(&self) -> bool {
        self.died_at.is_some()
    }

    pub fn want(&mut self, roll_pitch_rad: [f64; 2]) {
        self.wanted_rad = roll_pitch_rad;
    }

    pub fn switch(&mut self, on: bool) {
        self.on = on;
    }

    /// GUIDED has ended: a script that lives goes level.
    pub fn guided_ends(&mut self) {
        self.on &= self.is_dead();
    }

    /// The roll and pitch that the attitude controller was given, `None` while it was given none.
    pub fn offsets_rad(&self, guarded: bool, now: Duration) -> Option<[f64; 2]> {
        let levelled_rad = match self.died_at {
            Some(at) if guarded => now.saturating_sub(at + PULSELESS).as_secs_f64() * LEVELS_RAD_S,
            _ => 0.0,
        };
        let [roll, pitch] = self.wanted_rad;
        let far_rad = roll.hypot(pitch);
        let left = if far_rad > levelled_rad { 1.0 - levelled_rad / far_rad } else { 0.0 };
        self.on.then(|| self.wanted_rad.map(|angle| angle * left))
    }
}
