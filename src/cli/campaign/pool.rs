//! Flies the flights of a campaign on several threads.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use tokio::sync::mpsc;

use crate::link::clock::thread_cpu_time;

/// What a worker made of one flight, and the processor time it took in seconds.
pub(super) struct Done<T> {
    pub result: T,
    pub cpu_s: f64,
}

/// Runs `fly` for every one of `runs` on `threads` threads, and `note` with each result as it comes, until all are done
/// or Ctrl-C. Flights under way are finished. Whether it was interrupted.
///
/// # Errors
/// The event loop that waits for Ctrl-C cannot be started.
pub(super) fn fly_all<T: Send>(
    runs: &[u64],
    threads: usize,
    fly: impl Fn(u64) -> T + Sync,
    mut note: impl FnMut(Done<T>),
) -> Result<bool, String> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| format!("the event loop cannot start: {error}"))?;
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
            let mut interrupt = std::pin::pin!(crate::cli::interrupt::requested());
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
