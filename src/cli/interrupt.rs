//! Ctrl-C and SIGTERM: exit code 130, whatever is going on.
//!
//! A flight under way stops by itself, in order; so does a campaign. Everything else only computes and prints, and writes
//! files whole or not at all: it ends at once.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::signal::unix::{Signal, SignalKind, signal};

use super::Exit;

/// Somebody stops in order: this process must not just end.
static AWAITED: AtomicBool = AtomicBool::new(false);

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
                if !AWAITED.load(Ordering::SeqCst) {
                    eprintln!("interrupted");
                    std::process::exit(Exit::Interrupted.code().into());
                }
            }
        });
    });
}

/// Completes on Ctrl-C or SIGTERM. Once it has been waited for, ending is the caller's business.
pub(super) async fn requested() {
    match Signals::new() {
        Ok(mut signals) => {
            AWAITED.store(true, Ordering::SeqCst);
            signals.next().await;
        }
        // The process ends by the signal's default, or by `watch`; the radio's expiry makes it silent.
        Err(_) => std::future::pending().await,
    }
}

struct Signals {
    interrupt: Signal,
    terminate: Signal,
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
