//! How much recorded flights may take: the oldest go first, never one that is being recorded, nor the last before it.

use std::collections::BTreeMap;
use std::io;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use super::entry::Entry;
use super::{Logbook, LogbookError, Writer};
use crate::computer;
use crate::durable::append::Room;

/// The flight that is being recorded has grown by so much before room is looked for again.
const LOOK_AFTER_BYTES: u64 = 16 << 20;
/// After the disk was found full with nothing to remove, so many writes fail before it is looked at again.
const PATIENCE: u32 = 256;
/// Of each writer so many newest are kept whatever they take: the one that is being recorded and the last before it, which
/// somebody may be about to ask for.
const KEPT: usize = 2;
/// Of each writer at most so many: a process that is started again and again makes as many directories.
const MOST: usize = 1000;

/// What recorded flights may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// All together, in bytes.
    pub max_bytes: u64,
    /// What they leave free on their disk, in bytes.
    pub min_free_bytes: u64,
}

/// Keeps a log directory within its limits.
#[derive(Debug)]
pub struct Quota {
    book: Logbook,
    limits: Limits,
    grown: AtomicU64,
    /// Writes that will fail before the disk is looked at again.
    patience: AtomicU32,
}

impl Quota {
    /// Of this log directory.
    #[must_use]
    pub fn new(book: Logbook, limits: Limits) -> Self {
        Self { book, limits, grown: AtomicU64::new(0), patience: AtomicU32::new(0) }
    }

    /// Removes what is too much, and says so in the log.
    pub fn keep(&self) {
        match self.book.prune(self.limits, false) {
            Ok(removed) => removed.iter().for_each(tell),
            // A log directory that is not there yet holds nothing.
            Err(LogbookError::Read { source, .. }) if source.kind() == io::ErrorKind::NotFound => {}
            Err(error) => tracing::warn!("{error}"),
        }
    }
}

impl Room for Quota {
    fn grown(&self, bytes: u64) {
        let grown = self.grown.fetch_add(bytes, Ordering::Relaxed) + bytes;
        if grown >= LOOK_AFTER_BYTES {
            self.grown.store(0, Ordering::Relaxed);
            self.keep();
        }
    }

    fn make(&self) -> bool {
        let waits =
            self.patience.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
        if waits.is_ok() {
            return false;
        }
        // The disk is full, whatever it says: one flight more than the limits ask for.
        let limits = Limits { min_free_bytes: u64::MAX, ..self.limits };
        let removed = self.book.prune_some(limits, false, Some(1)).unwrap_or_default();
        removed.iter().for_each(tell);
        if removed.is_empty() {
            self.patience.store(PATIENCE, Ordering::Relaxed);
        }
        !removed.is_empty()
    }
}

fn tell(removed: &Entry) {
    let Entry { name, bytes, .. } = removed;
    tracing::warn!(
        flight = name,
        bytes,
        "an old flight's log was removed to make room: [log] max_mb, min_free_mb"
    );
}

impl Logbook {
    /// Removes the oldest flights until the others are within the limits, as far as they may go; `dry`: only says which.
    /// Returns them.
    ///
    /// # Errors
    /// [`LogbookError::Read`]. One that cannot be removed is passed over, with a warning.
    pub fn prune(&self, limits: Limits, dry: bool) -> Result<Vec<Entry>, LogbookError> {
        self.prune_some(limits, dry, None)
    }

    fn prune_some(&self, limits: Limits, dry: bool, most: Option<usize>) -> Result<Vec<Entry>, LogbookError> {
        let entries = self.entries()?;
        // Where that cannot be told, it does not count.
        let free = computer::disk(&self.root).map_or(u64::MAX, |disk| disk.free);
        let mut chosen = choose(&entries, free, limits);
        chosen.truncate(most.unwrap_or(usize::MAX));
        let chosen = chosen.into_iter().map(|index| entries[index].clone());
        let removed = chosen.filter(|entry| {
            dry || self
                .remove(entry)
                .map_err(
                    |error| tracing::warn!(flight = entry.name, %error, "an old flight cannot be removed"),
                )
                .is_ok()
        });
        Ok(removed.collect())
    }
}

/// Which of the flights go, given in the order of their starts, with so much free on their disk.
fn choose(entries: &[Entry], free: u64, limits: Limits) -> Vec<usize> {
    let mut bytes: u64 = entries.iter().map(|entry| entry.bytes).sum();
    let mut free = free;
    let mut counts = BTreeMap::<Writer, usize>::new();
    for entry in entries {
        *counts.entry(entry.writer).or_default() += 1;
    }
    let mut chosen = Vec::new();
    for (index, entry) in entries.iter().enumerate() {
        let newer = entries[index + 1..].iter().filter(|other| other.writer == entry.writer).count();
        if entry.running || newer < KEPT {
            continue;
        }
        let count = counts.entry(entry.writer).or_default();
        if bytes > limits.max_bytes || free < limits.min_free_bytes || *count > MOST {
            *count -= 1;
            bytes = bytes.saturating_sub(entry.bytes);
            free = free.saturating_add(entry.bytes);
            chosen.push(index);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::role::Role;

    fn entry(number: u64, writer: Writer, bytes: u64) -> Entry {
        let (path, name, mission) = (number.to_string().into(), number.to_string(), String::new());
        Entry { path, name, mission, writer, number, record: None, running: false, bytes }
    }

    fn numbers(entries: &[Entry], free: u64, max_bytes: u64, min_free_bytes: u64) -> Vec<u64> {
        let chosen = choose(entries, free, Limits { max_bytes, min_free_bytes });
        chosen.into_iter().map(|index| entries[index].number).collect()
    }

    #[test]
    fn spec_the_oldest_go_first_by_bytes_and_by_what_is_free() {
        let companion = Writer::Companion(Role::I);
        let mut all: Vec<Entry> = (1..=6).map(|number| entry(number, companion, 10)).collect();
        assert_eq!(numbers(&all, 100, 60, 100), [0u64; 0]);
        assert_eq!(numbers(&all, 100, 59, 0), [1]);
        assert_eq!(numbers(&all, 100, 40, 0), [1, 2]);
        assert_eq!(numbers(&all, 5, 60, 21), [1, 2]);
        // The last two stay whatever they take, and so does what is being recorded.
        assert_eq!(numbers(&all, 0, 0, 1000), [1, 2, 3, 4]);
        all[0].running = true;
        assert_eq!(numbers(&all, 0, 0, 1000), [2, 3, 4]);
        assert_eq!(numbers(&all, 100, 59, 0), [2]);
    }

    #[test]
    fn spec_each_writer_keeps_its_last_two_and_no_more_than_a_thousand() {
        let (i, radio) = (Writer::Companion(Role::I), Writer::Radio);
        // One flight, then a radio host that is started again and again.
        let mut all = vec![entry(1, i, 10), entry(2, i, 10)];
        all.extend((3..=1005).map(|number| entry(number, radio, 0)));
        assert_eq!(numbers(&all, 100, 100, 0), [3, 4, 5]);
        assert_eq!(numbers(&all, 100, 5, 0).len(), 1001, "the companion's two stay");
    }
}
