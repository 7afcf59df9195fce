//! Ctrl-C and SIGTERM: exit code 130, whatever is going on.
//!
//! A flight under way stops by itself, in order; so does a campaign. Everything else only computes and prints, and writes
//! files whole or not at all: it ends at once.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::process::{Signal, getpid, kill_process};
use tokio::signal::unix::{self, SignalKind, signal};
use tokio::sync::Notify;

use super::Exit;

/// One thread alone hears the signals: two that did could each leave one to the other.
static STOP: Stop = Stop::new();

/// Who is to stop in order.
struct Stop {
    /// Somebody stops in order: this process must not just end.
    awaited: AtomicBool,
    /// A signal has come since.
    asked: Notify,
}

impl Stop {
    const fn new() -> Self {
        Self { awaited: AtomicBool::new(false), asked: Notify::const_new() }
    }

    /// A signal has come; whether somebody stops in order now.
    fn ask(&self) -> bool {
        let awaited = self.awaited.load(Ordering::SeqCst);
        if awaited {
            // Kept until it is waited for.
            self.asked.notify_one();
        }
        awaited
    }

    async fn requested(&self) {
        self.awaited.store(true, Ordering::SeqCst);
        self.asked.notified().await;
    }
}

/// Ends the process at the first signal that nobody waits for by [`requested`].
///
/// Where that cannot be set up, the signal's default ends the process, only with another exit code.
pub(super) fn watch() {
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
    let signals = {
        let _inside = runtime.enter();
        Signals::new()
    };
    let Ok(mut signals) = signals else { return };
    std::thread::spawn(move || {
        runtime.block_on(async {
            loop {
                signals.next().await;
                if !STOP.ask() {
                    eprintln!("interrupted");
                    std::process::exit(Exit::Interrupted.code().into());
                }
            }
        });
    });
}

/// Asks this process to stop, in order, when stdin ends: with the program that started it, however that ended.
pub(super) fn when_stdin_ends() {
    std::thread::spawn(|| {
        // However the reading ends, nobody is at the other end.
        let _ = io::copy(&mut io::stdin().lock(), &mut io::sink());
        let _ = kill_process(getpid(), Signal::TERM);
    });
}

/// Completes on Ctrl-C or SIGTERM. Once it has been waited for, ending is the caller's business.
pub(super) async fn requested() {
    STOP.requested().await;
}

struct Signals {
    interrupt: unix::Signal,
    terminate: unix::Signal,
}

impl Signals {
    fn new() -> io::Result<Self> {
        Ok(Self { interrupt: signal(SignalKind::interrupt())?, terminate: signal(SignalKind::terminate())? })
    }

    async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn regress_a_signal_is_left_to_nobody_or_kept_for_who_stops_in_order() {
        let stop = Stop::new();
        assert!(!stop.ask(), "nobody stops in order: the process ends");
        let mut requested = std::pin::pin!(stop.requested());
        // Said that it will stop, and was not run again before the signal came.
        let awaited =
            tokio::select! { biased; () = &mut requested => false, () = std::future::ready(()) => true };
        assert!(awaited && stop.ask());
        requested.await;
        // One that comes between two waits is not lost either.
        assert!(stop.ask());
        stop.requested().await;
    }
}
