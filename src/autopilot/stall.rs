//! F2 after a stall: an autopilot whose stream of setpoints has ended leaves our mode, and PX4 takes it again, unasked, once
//! setpoints come. A companion that was not run for so long does not know, whatever waits at its door; nor does one that has
//! heard nothing for so long, since the link that kept the autopilot's words may have kept the setpoints too; nor one that sent
//! none for so long, since it did not know where the vehicle was. It sends none before a heartbeat that was sent since shows
//! the mode.

use std::time::Duration;

use crate::time::Instant;

/// The autopilot may have left our mode after so long without a setpoint: just within PX4's COM_OF_LOSS_T of 1 s.
const OUTLIVES: Duration = Duration::from_millis(950);
/// A link that is silent for so long may have stood still for as long, and what crossed it last may have been up to a tenth of
/// a second under way. PX4 goes back to our mode when setpoints have come for a second: if they end here they never have.
const SILENT: Duration = Duration::from_millis(850);
/// What came within this of the awakening may have been sent before.
const AT_THE_DOOR: Duration = Duration::from_millis(100);
/// So long after the last setpoint that certainly came it has left our mode, if it does: PX4's second, a tenth of one that the
/// setpoint may have been under way, and one for its own steps. Until then its mode says nothing of what it is about to do.
const LEFT: Duration = Duration::from_millis(1200);

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Stall {
    /// When one was due last: the companion was run.
    set_at: Option<Instant>,
    /// When one last went out, or none was wanted; none while in doubt, in which the companion may stand still as well.
    sent_at: Option<Instant>,
    doubt: Option<Doubt>,
}

/// The mode may be another.
#[derive(Debug, Clone, Copy)]
struct Doubt {
    /// What a heartbeat shows counts from here on.
    ends_from: Instant,
    /// One was asked for.
    asked: bool,
}

impl Stall {
    /// A setpoint is due, the autopilot is in our hands or not (`held`), and has said nothing for so long; whether the
    /// setpoint may go out.
    pub fn allows(&mut self, held: bool, silent_for: Duration, now: Instant) -> bool {
        let outlived = |at: &mut Instant| now.saturating_since(*at) > OUTLIVES;
        let stalled = self.set_at.take_if(outlived).max(self.sent_at.take_if(outlived));
        self.set_at = Some(now);
        let silent = (silent_for > SILENT).then(|| now - silent_for);
        if !held {
            self.doubt = None;
        } else if let Some(last_came) = stalled.max(silent) {
            let ends_from = (now + AT_THE_DOOR).max(last_came + LEFT);
            self.doubt = Some(Doubt { ends_from, asked: false });
        }
        self.doubt.is_none()
    }

    /// A setpoint has gone out, or none was wanted.
    pub fn sent(&mut self, now: Instant) {
        self.sent_at = Some(now);
    }

    /// Whether to ask the autopilot for a heartbeat: once, when its answer cannot have been sent before the awakening, nor before
    /// the mode was left.
    pub fn asks(&mut self, now: Instant) -> bool {
        let due = self.doubt.as_mut().filter(|doubt| !doubt.asked && now >= doubt.ends_from);
        due.map(|doubt| doubt.asked = true).is_some()
    }

    /// A heartbeat shows our mode.
    pub fn shown(&mut self, now: Instant) {
        self.doubt = self.doubt.filter(|doubt| now < doubt.ends_from);
    }

    /// Whether the mode may be another by now.
    pub fn is_in_doubt(&self) -> bool {
        self.doubt.is_some()
    }

    /// No setpoints are wanted.
    pub fn ends(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    /// An autopilot that is heard.
    fn heard(stall: &mut Stall, held: bool, now: Instant) -> bool {
        stall.allows(held, Duration::from_millis(20), now)
    }

    #[test]
    fn spec_after_a_stall_nothing_goes_out_before_a_heartbeat_sent_since() {
        let mut stall = Stall::default();
        assert!(
            heard(&mut stall, true, at(0))
                && heard(&mut stall, true, at(20))
                && heard(&mut stall, true, at(970))
        );
        assert!(!stall.asks(at(970)));
        assert!(!heard(&mut stall, true, at(1921)) && stall.is_in_doubt());
        // It waited at the door, or was sent by an autopilot that has not missed us yet.
        for early in [2020, 2169] {
            stall.shown(at(early));
            assert!(!heard(&mut stall, true, at(early)) && !stall.asks(at(early)));
        }
        assert!(stall.asks(at(2170)) && !stall.asks(at(2171)));
        stall.shown(at(2172));
        assert!(heard(&mut stall, true, at(2180)) && !stall.is_in_doubt());
        // Of a long stall it is the door that counts.
        assert!(!heard(&mut stall, true, at(9000)) && !stall.asks(at(9099)) && stall.asks(at(9100)));
    }

    #[test]
    fn spec_after_a_silence_of_the_autopilot_too() {
        let mut stall = Stall::default();
        let silent = |ms| Duration::from_millis(ms);
        assert!(stall.allows(true, silent(850), at(850)));
        assert!(!stall.allows(true, silent(870), at(870)));
        // As long as it lasts the door stays shut, and nobody is asked.
        assert!(!stall.allows(true, silent(980), at(980)) && !stall.asks(at(980)));
        // What the link held up comes out at once.
        stall.shown(at(985));
        assert!(!stall.allows(true, silent(15), at(1000)));
        // Nothing is known to have come since 0.
        assert!(!stall.asks(at(1199)) && stall.asks(at(1200)));
        stall.shown(at(1202));
        assert!(stall.allows(true, silent(0), at(1220)));
    }

    #[test]
    fn spec_after_setpoints_that_could_not_go_out_too() {
        let mut stall = Stall::default();
        stall.sent(at(0));
        assert!((0..=950).step_by(10).all(|ms| heard(&mut stall, true, at(ms))));
        // They could now: the autopilot may have left our mode, or be about to.
        assert!(!heard(&mut stall, true, at(960)) && !stall.asks(at(1199)) && stall.asks(at(1200)));
        stall.shown(at(1202));
        // Until one has gone out, it is known.
        assert!(heard(&mut stall, true, at(1220)) && heard(&mut stall, true, at(1900)));
        stall.sent(at(1900));
        assert!(heard(&mut stall, true, at(2850)) && !heard(&mut stall, true, at(2860)));
    }

    #[test]
    fn spec_nothing_is_in_doubt_that_is_not_held_or_no_more_wanted() {
        let mut stall = Stall::default();
        assert!(heard(&mut stall, false, at(0)) && heard(&mut stall, false, at(5000)));
        assert!(stall.allows(false, Duration::from_secs(2), at(5020)));
        assert!(!heard(&mut stall, true, at(9000)));
        stall.ends();
        assert!(heard(&mut stall, true, at(20_000)) && !stall.asks(at(30_000)));
    }
}
