//! How far a long command is: a bar with an estimate, on a terminal alone. A pipe, a file and a dumb terminal get none of it.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Fits 80 columns.
const TEMPLATE: &str = "{msg}: {pos} of {len} {bar:20} {elapsed}, about {eta} left";

/// A bar, or nothing. It is gone when it is dropped.
#[derive(Debug)]
pub(super) struct Progress(ProgressBar);

impl Progress {
    /// Of `what`, in so many steps.
    pub fn new(what: &str, steps: u64) -> Self {
        let target =
            if super::may_escape() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(steps), target).with_message(what.to_owned());
        if let Ok(style) = ProgressStyle::with_template(TEMPLATE) {
            bar.set_style(style.progress_chars("=> "));
        }
        if !bar.is_hidden() {
            bar.enable_steady_tick(Duration::from_secs(1));
        }
        Self(bar)
    }

    /// So many steps are done.
    #[cfg(feature = "desk")]
    pub fn at(&self, done: u64) {
        self.0.set_position(done);
    }

    /// One step more is done.
    pub fn step(&self) {
        self.0.inc(1);
    }

    /// Another line than the bar's own, for as long as `said` runs.
    #[cfg(feature = "desk")]
    pub fn aside<T>(&self, said: impl FnOnce() -> T) -> T {
        self.0.suspend(said)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
