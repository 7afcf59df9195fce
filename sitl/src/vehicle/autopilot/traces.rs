//! What has passed between an autopilot and its companion, as far as the invariants ask for it.

use std::time::Duration;

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::*;

use super::{Autopilot, Mode};

/// Since when something has been shown on the wire without a break, and when it was shown last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shown {
    pub first: Duration,
    pub latest: Duration,
}

/// A vehicle that another hand than the companion's has taken, after HEARTBEAT had shown that it was the companion's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Taken {
    pub at: Duration,
    /// When HEARTBEAT has shown that.
    pub shown: Option<Shown>,
    /// An operator has ordered something of the companion since: it may take the vehicle.
    pub ordered: bool,
    /// The vehicle has been disarmed since.
    pub disarmed: bool,
}

/// Times of what the companion's link has carried.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Traces {
    /// When the next position and the next attitude are due at the companion.
    position_due: Option<Duration>,
    attitude_due: Option<Duration>,
    /// HEARTBEAT shows that the companion flies no more.
    pub out_of_control: Option<Shown>,
    /// The estimator's own messages show that it failed.
    pub bad_estimate: Option<Shown>,
    /// The GPS receiver's fix that is told shows that it is lost, or that the estimator failed.
    pub bad_gps: Option<Shown>,
    /// The companion's last setpoint.
    pub setpoint_at: Option<Duration>,
    /// The companion's last HEARTBEAT.
    pub heartbeat_at: Option<Duration>,
    /// HEARTBEAT has shown the companion's mode since it was chosen.
    chosen_shown: bool,
    /// Another hand than the companion's ended its mode, and it has not been chosen again.
    pub taken: Option<Taken>,
    /// The companion chose its mode again, and nobody had asked it to: what it took back.
    pub taken_back: Option<Taken>,
    /// What is being carried out is the companion's word.
    companion_speaks: bool,
}

impl Traces {
    /// When position or attitude was due that has not come.
    pub fn state_due(&self) -> Option<Duration> {
        Some(self.position_due?.min(self.attitude_due?))
    }

    /// A message of this id goes to the companion, who is sent the next one at `next`.
    pub fn sends(&mut self, id: u32, next: Duration, [estimator_ok, gps_ok]: [bool; 2], now: Duration) {
        // Of two streams that tell the same, the faster one's promise holds.
        let promise = |due: Option<Duration>| Some(due.filter(|due| *due > now).unwrap_or(next));
        match id {
            LOCAL_POSITION_NED_DATA::ID | GLOBAL_POSITION_INT_DATA::ID => {
                self.position_due = promise(self.position_due);
            }
            ATTITUDE_DATA::ID | ATTITUDE_QUATERNION_DATA::ID => {
                self.attitude_due = promise(self.attitude_due);
            }
            ESTIMATOR_STATUS_DATA::ID | EKF_STATUS_REPORT_DATA::ID | SYS_STATUS_DATA::ID => {
                show(&mut self.bad_estimate, !estimator_ok, now);
            }
            GPS_RAW_INT_DATA::ID => show(&mut self.bad_gps, !estimator_ok || !gps_ok, now),
            _ => {}
        }
    }

    /// A HEARTBEAT goes out.
    pub fn beats(&mut self, mode: Mode, armed: bool, now: Duration) {
        self.chosen_shown |= mode == Mode::Companion;
        show(&mut self.out_of_control, mode != Mode::Companion || !armed, now);
        if let Some(taken) = &mut self.taken {
            show(&mut taken.shown, true, now);
        }
    }

    /// Whose word the next changes are.
    pub fn listen_to(&mut self, companion: bool) {
        self.companion_speaks = companion;
    }

    /// A message of the companion has come.
    pub fn heard(&mut self, message: &MavMessage, now: Duration) {
        if !self.companion_speaks {
            return;
        }
        match message {
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)
            | MavMessage::SET_POSITION_TARGET_GLOBAL_INT(_)
            | MavMessage::SET_ATTITUDE_TARGET(_) => self.setpoint_at = Some(now),
            MavMessage::HEARTBEAT(_) => self.heartbeat_at = Some(now),
            _ => {}
        }
    }

    /// The mode changes.
    pub fn changes(&mut self, from: Mode, to: Mode, now: Duration) {
        if to == Mode::Companion {
            let taken = self.taken.take().filter(|taken| self.companion_speaks && !taken.ordered);
            self.taken_back = self.taken_back.or(taken);
            self.chosen_shown &= from == Mode::Companion;
        } else if from == Mode::Companion && !self.companion_speaks && self.chosen_shown {
            self.taken = Some(Taken { at: now, shown: None, ordered: false, disarmed: false });
        }
    }

    /// An operator's order to the companion has passed.
    pub fn ordered(&mut self) {
        if let Some(taken) = &mut self.taken {
            taken.ordered = true;
        }
    }

    /// The motors are off.
    pub fn disarms(&mut self) {
        if let Some(taken) = &mut self.taken {
            taken.disarmed = true;
        }
    }
}

fn show(shown: &mut Option<Shown>, holds: bool, now: Duration) {
    *shown = holds.then(|| Shown { first: shown.map_or(now, |shown| shown.first), latest: now });
}

impl Autopilot {
    /// What has passed between it and its companion.
    pub fn traces(&self) -> &Traces {
        &self.traces
    }

    /// An operator's order to the companion has passed.
    pub fn operator_ordered(&mut self) {
        self.traces.ordered();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn spec_only_another_hand_takes_and_only_the_companion_takes_back() {
        let mut traces = Traces::default();
        traces.listen_to(true);
        traces.beats(Mode::Companion, true, Duration::ZERO);
        traces.changes(Mode::Companion, Mode::Land, MS);
        assert_eq!(traces.taken, None, "its own landing");
        traces.changes(Mode::Land, Mode::Companion, 2 * MS);
        traces.listen_to(false);
        let mut unseen = traces;
        unseen.changes(Mode::Companion, Mode::Position, 3 * MS);
        assert_eq!(unseen.taken, None, "nobody aboard knew that it had it");
        traces.beats(Mode::Companion, true, 2 * MS);
        traces.changes(Mode::Companion, Mode::Position, 3 * MS);
        let taken = Taken { at: 3 * MS, shown: None, ordered: false, disarmed: false };
        assert_eq!((traces.taken, traces.taken_back), (Some(taken), None));
        let mut pilots_own = traces;
        pilots_own.changes(Mode::Position, Mode::Companion, 4 * MS);
        assert_eq!((pilots_own.taken, pilots_own.taken_back), (None, None));
        traces.listen_to(true);
        let mut ordered = traces;
        ordered.ordered();
        ordered.changes(Mode::Position, Mode::Companion, 4 * MS);
        assert_eq!(ordered.taken_back, None);
        let mut gone_back = traces;
        // PX4 itself went back to OFFBOARD, and the companion asks for what is there already.
        gone_back.changes(Mode::Companion, Mode::Companion, 4 * MS);
        assert_eq!(gone_back.taken_back, Some(taken));
        traces.disarms();
        traces.changes(Mode::Position, Mode::Companion, 4 * MS);
        assert_eq!(traces.taken_back, Some(Taken { disarmed: true, ..taken }));
    }

    #[test]
    fn spec_what_is_shown_has_a_first_and_a_latest_time() {
        let mut traces = Traces::default();
        for (ms, ok) in [(1, true), (2, false), (3, false)] {
            traces.sends(ESTIMATOR_STATUS_DATA::ID, (ms + 1) * MS, [ok, true], ms * MS);
            traces.beats(if ok { Mode::Companion } else { Mode::Hold }, true, ms * MS);
        }
        let shown = Some(Shown { first: 2 * MS, latest: 3 * MS });
        assert_eq!((traces.bad_estimate, traces.out_of_control), (shown, shown));
        traces.beats(Mode::Companion, false, 4 * MS);
        assert_eq!(traces.out_of_control.map(|shown| shown.first), Some(2 * MS), "disarmed");
        traces.beats(Mode::Companion, true, 5 * MS);
        assert_eq!(traces.out_of_control, None);
        assert_eq!(traces.state_due(), None);
        traces.sends(ATTITUDE_QUATERNION_DATA::ID, 25 * MS, [true; 2], 5 * MS);
        traces.sends(LOCAL_POSITION_NED_DATA::ID, 27 * MS, [true; 2], 7 * MS);
        traces.sends(ATTITUDE_DATA::ID, 258 * MS, [true; 2], 8 * MS);
        assert_eq!(traces.state_due(), Some(25 * MS));
        traces.sends(ATTITUDE_QUATERNION_DATA::ID, 45 * MS, [true; 2], 25 * MS);
        assert_eq!(traces.state_due(), Some(27 * MS));
    }
}
