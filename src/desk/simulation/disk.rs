//! The disk under a companion's telemetry logs and its record of orders, in virtual time.

use crate::mission::Notice;
use crate::pair::Record;

/// Takes records, or is full. As the companion's own writer, it says so once, and the flight goes on.
#[derive(Debug, Clone, Default)]
pub(super) struct Disk {
    pub full: bool,
    /// The last record was lost.
    failing: bool,
    /// Records that were lost.
    pub lost: u64,
    /// Of the operator's orders, for the next process.
    pub orders: Record,
    /// It takes what is given to it once it no longer stalls.
    pub stalled: bool,
    /// Given to it and not on it yet.
    waiting: Option<Record>,
}

impl Disk {
    /// The operator's orders are to be kept.
    pub fn keep(&mut self, orders: Record) {
        self.waiting = Some(orders);
    }

    /// The orders that are on it since this was asked last, or that it did not take.
    pub fn kept(&mut self) -> Option<Record> {
        let orders = self.waiting.take_if(|_| !self.stalled)?;
        if !self.full {
            self.orders = orders;
        }
        Some(orders)
    }

    /// The process that wrote is no more, and what was not on it yet is lost.
    pub fn forget(&mut self) {
        self.waiting = None;
    }

    /// A record is to be written: whether it is, and what there is to say about it.
    pub fn write(&mut self) -> (bool, Option<Notice>) {
        self.lost += u64::from(self.full);
        let changed = std::mem::replace(&mut self.failing, self.full) != self.full;
        let notice = changed.then_some(match self.full {
            true => Notice::LosingLog,
            false => Notice::LogTakenAgain,
        });
        (!self.full, notice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_orders_are_kept_once_the_disk_takes_them_and_lost_with_who_wrote_them() {
        let [first, second] = [1, 2].map(|newest| Record { newest, ..Record::default() });
        let mut disk = Disk { stalled: true, ..Disk::default() };
        disk.keep(first);
        assert_eq!((disk.kept(), disk.orders), (None, Record::default()));
        disk.keep(second);
        disk.stalled = false;
        assert_eq!((disk.kept(), disk.kept(), disk.orders), (Some(second), None, second));
        disk.full = true;
        disk.keep(first);
        assert_eq!((disk.kept(), disk.orders), (Some(first), second), "told, and not kept");
        disk.keep(first);
        disk.forget();
        assert_eq!(disk.kept(), None);
    }

    #[test]
    fn spec_a_full_disk_loses_records_and_says_so_once() {
        let mut disk = Disk::default();
        assert_eq!(disk.write(), (true, None));
        disk.full = true;
        assert_eq!(disk.write(), (false, Some(Notice::LosingLog)));
        assert_eq!(disk.write(), (false, None));
        disk.full = false;
        assert_eq!(disk.write(), (true, Some(Notice::LogTakenAgain)));
        assert_eq!((disk.write(), disk.lost), ((true, None), 2));
    }
}
