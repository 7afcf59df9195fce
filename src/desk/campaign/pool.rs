//! Flies the flights of a campaign on several threads.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use tokio::sync::mpsc;

use crate::link::clock::thread_cpu_time;

/// What a worker made of one flight.
pub struct Done<T> {
    /// What it made.
    pub result: T,
    /// Processor time, seconds.
    pub cpu_s: f64,
}

/// Runs `fly` for every one of `runs` on `threads` threads, and `note` with each result as it comes, until all are done
/// or `interrupt` completes. Flights under way are finished. Whether it was interrupted.
///
/// # Errors
/// The event loop that waits for the interruption cannot be started.
pub fn fly_all<T: Send>(
    runs: &[u64],
    threads: usize,
    interrupt: impl Future<Output = ()>,
    fly: impl Fn(u64) -> T + Sync,
    mut note: impl FnMut(Done<T>),
) -> io::Result<bool> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let next = AtomicUsize::new(0);
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (sender, mut results) = mpsc::unbounded_channel();
        for _ in 0..threads.clamp(1, runs.len().max(1)) {
            let sender = sender.clone();
            let (next, stop, fly) = (&next, &stop, &fly);
            scope.spawn(move || {
                while !stop.load(Ordering::Relaxed)
                    && let Some(run) = runs.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    let before = thread_cpu_time();
                    let result = fly(*run);
                    let cpu_s = (thread_cpu_time().saturating_sub(before)).as_secs_f64();
                    if sender.send(Done { result, cpu_s }).is_err() {
                        return;
                    }
                }
            });
        }
        // The channel ends with its last worker.
        drop(sender);
        Ok(runtime.block_on(async {
            let mut interrupt = std::pin::pin!(interrupt);
            let mut interrupted = false;
            loop {
                tokio::select! {
                    done = results.recv() => match done {
                        Some(done) => note(done),
                        None => return interrupted,
                    },
                    () = &mut interrupt, if !interrupted => {
                        interrupted = true;
                        stop.store(true, Ordering::Relaxed);
                    }
                }
            }
        }))
    })
}
