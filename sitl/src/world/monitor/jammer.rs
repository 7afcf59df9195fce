//! When J's vehicle or radio has failed while a lease of I's ran: the one failure that leaves I unprotected whatever the
//! companions do, for as long as the lease still runs.
//!
//! The world sees no lease. It sees when J fails, and when J's radio falls silent: from the failure on J has S4's time
//! to fall silent, granting until then; and what it granted last runs for a lease's length at most from when its radio
//! is off. A failure counts from when it is there, and again from when the wire first shows it: until then nobody aboard
//! can know of it.

use std::time::Duration;

use super::{FAINT_REACTION, LEASE, POSE_REACTION, Seen};
use crate::vehicle::autopilot::Traces;
use crate::world::config::Off;

/// A sign that J fails: each counts from when it begins.
const SIGNS: usize = 6;

/// The failures of J's vehicle and radio.
#[derive(Debug, Clone, Default)]
pub(super) struct Jammer {
    signs: [bool; SIGNS],
    /// In the slot named, it was on the air and in its pose at the last look; or how far out of it.
    posed: Option<(usize, Off)>,
    radiated: bool,
    /// What it granted before it failed has run out by then: after a failure that nobody can overlook, and after one
    /// that the jitter hides at first.
    sudden_until: Duration,
    faint_until: Duration,
    /// By how much later than in real time its companion may be run.
    pub allowance: Duration,
}

impl Jammer {
    /// Until when what it granted before it failed may run; of the past if it is well.
    pub fn leased_until(&self) -> Duration {
        self.sudden_until.max(self.faint_until)
    }

    /// Its vehicle fails in a way that no sign shows yet.
    pub fn fails(&mut self, now: Duration) {
        self.sudden_until = now + POSE_REACTION + LEASE + self.allowance;
    }

    /// A look at it.
    pub fn look(&mut self, now: Duration, seen: &Seen, traces: &Traces) {
        let signs = [
            traces.taken.is_some(),
            traces.taken.is_some_and(|taken| taken.shown.is_some()),
            !seen.estimate_ok,
            traces.bad_estimate.is_some() || traces.bad_gps.is_some(),
            !seen.powered && seen.airborne,
            seen.radio.is_some(),
        ];
        if signs.iter().zip(self.signs).any(|(is, was)| *is && !was) {
            self.fails(now);
        }
        self.signs = signs;
        self.look_at_pose(now, seen);
        let radiates = seen.power_w.is_some();
        if self.radiated && !radiates {
            let last = now + LEASE + self.allowance;
            self.sudden_until = self.sudden_until.min(last);
            self.faint_until = self.faint_until.min(last);
        }
        self.radiated = radiates;
    }

    /// It leaves the pose that it held.
    fn look_at_pose(&mut self, now: Duration, seen: &Seen) {
        let posed = seen.slot.filter(|_| seen.power_w.is_some()).map(|slot| (slot, seen.off));
        if let (Some((before, was)), Some((slot, is))) = (self.posed, posed)
            && before == slot
        {
            if was == Off::Nothing && is != Off::Nothing {
                self.faint_until = now + FAINT_REACTION + LEASE + self.allowance;
            }
            if was != Off::Much && is == Off::Much {
                self.fails(now);
                self.faint_until = self.faint_until.min(self.sudden_until);
            }
        }
        self.posed = posed;
    }
}
