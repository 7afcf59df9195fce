//! Where a vehicle has lately been: whether one that comes on the air out of its pose was there a moment ago.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};

use super::config::Off;
use super::monitor::{FAINT_REACTION, POSE_REACTION};

/// No command is carried out later: it expires.
const LATEST: Duration = Duration::from_millis(650);

/// One instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    /// When.
    pub at: Duration,
    /// Where it took itself to be, metres.
    pub position: Vector3<f64>,
    /// How it was turned, without the jitter.
    pub attitude: UnitQuaternion<f64>,
}

/// The last steps, as far back as anything may be overlooked.
#[derive(Debug, Clone, Default)]
pub(crate) struct Trail {
    steps: VecDeque<Step>,
}

impl Trail {
    /// Where it is now.
    pub fn keep(&mut self, now: Duration, position: Vector3<f64>, attitude: UnitQuaternion<f64>) {
        while self.steps.front().is_some_and(|step| step.at + FAINT_REACTION + LATEST < now) {
            self.steps.pop_front();
        }
        self.steps.push_back(Step { at: now, position, attitude });
    }

    /// Whether a vehicle that is now so far off has been so for longer than that may be overlooked, by a command that may
    /// have been under way for so long.
    pub fn was_out(
        &self,
        off: Off,
        judge: impl Fn(&Step) -> Off,
        now: Duration,
        under_way: Duration,
    ) -> bool {
        let reaction = match off {
            Off::Nothing => return false,
            Off::Little => FAINT_REACTION,
            Off::Much => POSE_REACTION,
        };
        let recent = self.steps.iter().rev().take_while(|step| step.at + reaction + under_way >= now);
        recent.map(judge).all(|was| was >= off)
    }
}
