//! How long before its transit a slot is proposed.

use std::time::Duration;

use crate::pair::Coordinator;
use crate::pair::wire::VeilwingAnswer;

/// Time for the agreement: longer on a slow link, and doubled each time it was not enough.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct AgreementTime {
    doublings: u32,
}

impl AgreementTime {
    const SHORTEST: Duration = Duration::from_secs(1);
    const LONGEST: Duration = Duration::from_secs(16);
    const MOST_DOUBLINGS: u32 = 4;

    /// The time to leave.
    pub fn time(self, pair: &Coordinator) -> Duration {
        // Twice the round trip, which is twice the uncertainty of the best comparison of clocks.
        let link = pair.clock_offset().map_or(Duration::ZERO, |offset| 4 * offset.uncertainty);
        (Self::SHORTEST * (1 << self.doublings) + link).min(Self::LONGEST)
    }

    /// The proposal was refused, or not agreed on in time.
    pub fn refused(&mut self, answer: VeilwingAnswer) {
        if answer == VeilwingAnswer::VEILWING_ANSWER_TOO_LATE {
            self.doublings = (self.doublings + 1).min(Self::MOST_DOUBLINGS);
        }
    }

    /// A slot was agreed on.
    pub fn agreed(&mut self) {
        self.doublings = self.doublings.saturating_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::role::Role;
    use crate::time::Instant;

    #[test]
    fn val_what_came_too_late_doubles_the_time_up_to_16_s_and_each_slot_agreed_on_halves_it() {
        let settings = crate::pair::Settings {
            role: Role::I,
            boot_id: 1,
            mission_digest: [0; 32],
            lease: Duration::from_millis(500),
            peer_timeout: Duration::from_secs(3),
            lost_after: Duration::from_secs(3),
            clock_tolerance: Duration::from_millis(250),
            orders: crate::pair::orders::Record::default(),
        };
        let pair = Coordinator::new(settings, Instant::ZERO);
        let mut time = AgreementTime::default();
        let mut seconds = |answer: Option<VeilwingAnswer>| {
            match answer {
                Some(answer) => time.refused(answer),
                None => time.agreed(),
            }
            time.time(&pair).as_secs()
        };
        let late = Some(VeilwingAnswer::VEILWING_ANSWER_TOO_LATE);
        assert_eq!([late; 6].map(&mut seconds), [2, 4, 8, 16, 16, 16]);
        assert_eq!(seconds(Some(VeilwingAnswer::VEILWING_ANSWER_NOT_READY)), 16);
        assert_eq!([None; 5].map(&mut seconds), [8, 4, 2, 1, 1]);
        assert_eq!(seconds(Some(VeilwingAnswer::VEILWING_ANSWER_NOT_READY)), 1);
    }
}
