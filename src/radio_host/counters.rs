//! What became of all commands, for the log and for tests.

use crate::transmitter::wire::VeilwingRadioResult as Result;

/// How many, since the start. What a signed link turns away (forged, unsigned, recorded and sent again) is counted by the
/// link, and never comes here.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Power commands that were carried out, off included.
    pub accepted: u64,
    /// Not above the newest number: copies, replays, and what was overtaken.
    pub not_newer: u64,
    /// Of another boot, without the present series.
    pub other_series: u64,
    /// Expired on arrival.
    pub expired: u64,
    /// Beyond the limits, or no number.
    pub denied: u64,
    /// Below the least power.
    pub too_low: u64,
    /// While killed, or stopping.
    pub not_now: u64,
    /// The device did not do it.
    pub failed: u64,
    /// Power commands and kills of somebody who may not give them.
    pub strangers: u64,
    /// Times that a lease's end turned the radio off.
    pub ran_out: u64,
    /// Outcomes of orders that the device was no longer wanted to carry out.
    pub stale_outcomes: u64,
}

impl Counters {
    /// Counts what became of a power command.
    pub(super) fn count(&mut self, result: Result) {
        let counter = match result {
            Result::VEILWING_RADIO_RESULT_ACCEPTED => &mut self.accepted,
            Result::VEILWING_RADIO_RESULT_NOT_NEWER => &mut self.not_newer,
            Result::VEILWING_RADIO_RESULT_OTHER_SERIES => &mut self.other_series,
            Result::VEILWING_RADIO_RESULT_EXPIRED => &mut self.expired,
            Result::VEILWING_RADIO_RESULT_DENIED => &mut self.denied,
            Result::VEILWING_RADIO_RESULT_NOT_NOW => &mut self.not_now,
            Result::VEILWING_RADIO_RESULT_TOO_LOW => &mut self.too_low,
            Result::VEILWING_RADIO_RESULT_FAILED
            | Result::VEILWING_RADIO_RESULT_DEVICE_LATE
            | Result::VEILWING_RADIO_RESULT_DEVICE_ERROR
            | Result::VEILWING_RADIO_RESULT_OTHER_POWER => &mut self.failed,
        };
        *counter += 1;
    }
}

impl std::fmt::Display for Counters {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { accepted, not_newer, other_series, expired, denied, too_low, not_now, failed, .. } = self;
        write!(
            f,
            "{accepted} accepted; refused: {not_newer} not newer, {other_series} of another series, {expired} expired, \
             {denied} denied, {too_low} below the least power, {not_now} not now, {failed} failed, {} of strangers; \
             {} leases ran out",
            self.strangers, self.ran_out
        )
    }
}
