//! Notices an input that takes too long. What hangs cannot be taken back, so whoever asks ends the process.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use veilwing::time::Instant;

/// The input that runs, and since when.
type Running = Option<(Instant, Vec<u8>)>;

/// Shared by who runs inputs and who looks.
#[derive(Debug, Clone, Default)]
pub struct Watchdog(Arc<Mutex<Running>>);

impl Watchdog {
    fn running(&self) -> MutexGuard<'_, Running> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// An input begins.
    pub fn begins(&self, input: &[u8], now: Instant) {
        *self.running() = Some((now, input.to_vec()));
    }

    /// It has ended.
    pub fn ends(&self) {
        *self.running() = None;
    }

    /// The input that has run for longer than `limit`.
    #[must_use]
    pub fn overdue(&self, limit: Duration, now: Instant) -> Option<Vec<u8>> {
        let running = self.running();
        let (_, input) = running.as_ref().filter(|(since, _)| now.saturating_since(*since) > limit)?;
        Some(input.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_only_what_runs_too_long_is_overdue() {
        let at = |s| Instant::from_start(Duration::from_secs(s));
        let (watchdog, limit) = (Watchdog::default(), Duration::from_secs(10));
        assert_eq!(watchdog.overdue(limit, at(100)), None);
        watchdog.begins(b"slow", at(100));
        assert_eq!(watchdog.overdue(limit, at(110)), None);
        assert_eq!(watchdog.overdue(limit, at(111)).as_deref(), Some(&b"slow"[..]));
        watchdog.ends();
        assert_eq!(watchdog.overdue(limit, at(200)), None);
    }
}
