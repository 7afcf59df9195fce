//! Timestamps put on record in blocks, ahead of their use. Pure: whoever writes them down is somebody else.

use std::fmt;

use super::TICKS_PER_SECOND;

/// How far ahead of use timestamps are put on record: a minute, asked for when half of it is used, so that a disk may take
/// half a minute for a write. After a crash the next run begins at the record, so much ahead of the clock at most.
pub const BLOCK: u64 = 60 * TICKS_PER_SECOND;

/// Keeps the ceiling of timestamps on record. Nobody waits for it.
pub trait Keeper: fmt::Debug + Send {
    /// Has the ceiling put on record, at once or later. `false`: busy with an earlier one; ask again.
    fn keep(&mut self, ceiling: u64) -> bool;

    /// The ceiling that is on record for certain.
    fn kept(&self) -> u64;

    /// The last word of this run, after which the next one need not skip anything.
    fn close(&mut self, latest: u64);
}

/// The timestamps of one link that are on record, or about to be.
#[derive(Debug)]
pub(super) struct Reserve {
    keeper: Box<dyn Keeper>,
    /// The ceiling last asked for.
    asked: u64,
    unrecorded: u64,
}

impl Reserve {
    pub(super) fn new(keeper: Box<dyn Keeper>) -> Self {
        Self { asked: keeper.kept(), keeper, unrecorded: 0 }
    }

    /// `timestamp` goes into use: sees to it that those after it will be on record in time.
    pub(super) fn use_up_to(&mut self, timestamp: u64) {
        let ceiling = timestamp.saturating_add(BLOCK);
        if timestamp.saturating_add(BLOCK / 2) > self.asked && self.keeper.keep(ceiling) {
            self.asked = ceiling;
        }
        if timestamp > self.keeper.kept() {
            self.unrecorded += 1;
            if self.unrecorded == 1 {
                tracing::warn!(
                    "signing: the disk is behind with timestamps, or a clock has leapt; should this program crash now, only the clock protects from replay"
                );
            }
        }
    }

    /// How many timestamps went into use before they were on record.
    pub(super) fn unrecorded(&self) -> u64 {
        self.unrecorded
    }

    pub(super) fn close(&mut self, latest: u64) {
        self.keeper.close(latest);
    }
}
