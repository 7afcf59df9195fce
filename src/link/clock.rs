//! The one place that reads a clock. Everything else is handed [`Instant`]s.
//!
//! A [`Clock`] shows the machine's time, at its own rate or another, or the time that a [`Hand`] sets: then it stands still
//! between two moves, and whoever sleeps is woken at its own instant, however long that takes by the wall.

// The rule that this module is the exception to (clippy.toml).
#![allow(clippy::disallowed_methods)]

mod hand;

use std::future::Future;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

pub use hand::{Hand, Hold};

use crate::time::{Instant, Utc};
use hand::Dial;

/// Why a clock cannot run.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ClockError {
    /// The rate is not a number that a clock can run at.
    #[error("the clock cannot run at {rate} simulated seconds a second: choose between {min} and {max}", min = Clock::RATE_MIN, max = Clock::RATE_MAX)]
    Rate {
        /// The rate asked for, in simulated seconds per second.
        rate: f64,
    },
}

/// A monotonic clock that may run faster or slower than the wall's, or be moved by hand, and UTC beside it. Clones share
/// one start.
#[derive(Debug, Clone)]
pub struct Clock {
    time: Time,
    /// When it read zero.
    started_utc: Utc,
}

/// Where a clock's time comes from.
#[derive(Debug, Clone)]
enum Time {
    /// The machine's monotonic clock.
    Wall { started: std::time::Instant, rate: f64, timers: Arc<precise::Timers> },
    /// Somebody's hand.
    Moved(Arc<Dial>),
}

impl Clock {
    /// The slowest rate, in simulated seconds per second.
    pub const RATE_MIN: f64 = 1e-3;
    /// The fastest rate, in simulated seconds per second.
    pub const RATE_MAX: f64 = 1e3;

    /// Starts a clock at the wall's own rate.
    #[must_use]
    pub fn real() -> Self {
        Self::wall(1.0)
    }

    /// Starts a clock that runs `rate` simulated seconds for each second on the wall.
    ///
    /// # Errors
    /// [`ClockError::Rate`] outside [`Self::RATE_MIN`] to [`Self::RATE_MAX`].
    pub fn start(rate: f64) -> Result<Self, ClockError> {
        // `contains` is false for NaN.
        if !(Self::RATE_MIN..=Self::RATE_MAX).contains(&rate) {
            return Err(ClockError::Rate { rate });
        }
        Ok(Self::wall(rate))
    }

    /// A clock that reads `now`, at `utc`, and goes on when its hand is moved and not otherwise. For simulation alone: it
    /// shows nobody's time.
    #[must_use]
    pub fn by_hand(now: Instant, utc: Utc) -> (Self, Hand) {
        let dial = Arc::new(Dial::new(now));
        let started_utc = Utc { unix_us: utc.unix_us.saturating_sub(now.since_start().as_micros() as u64) };
        (Self { time: Time::Moved(Arc::clone(&dial)), started_utc }, Hand::new(dial))
    }

    fn wall(rate: f64) -> Self {
        let time = Time::Wall { started: std::time::Instant::now(), rate, timers: Arc::default() };
        Self { time, started_utc: wall_utc() }
    }

    /// The time since the start, scaled by the rate; or what the hand points to.
    #[must_use]
    pub fn now(&self) -> Instant {
        match &self.time {
            Time::Wall { started, rate, .. } => Instant::from_start(scaled(started.elapsed(), *rate)),
            Time::Moved(dial) => dial.now(),
        }
    }

    /// UTC for logs and signatures: the wall's, steps and all, at rate 1; otherwise that of the start plus [`Self::now`].
    #[must_use]
    pub fn utc(&self) -> Utc {
        match &self.time {
            Time::Wall { rate, .. } if !is_scaled(*rate) => wall_utc(),
            _ => self.started_utc + self.now().since_start(),
        }
    }

    /// Completes at `deadline`, never before it: on Linux within the scheduler's latency, elsewhere within a
    /// millisecond more; by hand, exactly then. Dropping it is free, waiting for the same deadline again loses nothing.
    pub fn sleep_until(&self, deadline: Instant) -> impl Future<Output = ()> + Send + use<> {
        let clock = self.clone();
        async move {
            match &clock.time {
                Time::Wall { rate, timers, .. } => loop {
                    let left = deadline.saturating_since(clock.now());
                    if left.is_zero() {
                        return;
                    }
                    // Rounded up: a timer that fires a nanosecond early would go round the loop for nothing.
                    let wall = if is_scaled(*rate) { left.div_f64(*rate) } else { left };
                    timers.sleep(wall + Duration::from_nanos(1)).await;
                },
                Time::Moved(dial) => dial.sleep_until(deadline).await,
            }
        }
    }

    /// Keeps a clock that is moved by hand where it is for as long as the returned value lives: for work on another
    /// thread that takes no time there. Any other clock goes on.
    pub fn hold(&self) -> Hold {
        match &self.time {
            Time::Wall { .. } => Hold::none(),
            Time::Moved(dial) => Hold::of(dial),
        }
    }
}

#[allow(clippy::float_cmp, reason = "exactly 1 is the rate that `real` stores")]
fn is_scaled(rate: f64) -> bool {
    rate != 1.0
}

fn scaled(wall: Duration, rate: f64) -> Duration {
    if is_scaled(rate) { wall.mul_f64(rate) } else { wall }
}

/// The processor time that the calling thread has used: what a calculation costs, whoever else uses the machine.
#[must_use]
pub fn thread_cpu_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), u32::try_from(time.tv_nsec).unwrap_or(0))
}

fn wall_utc() -> Utc {
    // A clock set before 1970 reads as 1970.
    let since_epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    Utc::default() + since_epoch
}

/// Tokio's timers round up to a millisecond, which is 20 ms of simulated time at rate 20. The kernel's do not.
#[cfg(target_os = "linux")]
mod precise {
    use std::os::fd::OwnedFd;
    use std::sync::{Mutex, PoisonError};
    use std::time::Duration;

    use rustix::time::{
        Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
        timerfd_settime,
    };
    use tokio::io::unix::AsyncFd;

    /// Timers at rest, for the next sleeper.
    #[derive(Debug, Default)]
    pub struct Timers(Mutex<Vec<AsyncFd<OwnedFd>>>);

    impl Timers {
        /// Sleeps for `wall`.
        pub async fn sleep(&self, wall: Duration) {
            if self.sleep_precisely(wall).await.is_err() {
                // No file descriptor left, or an odd kernel: a coarse timer is better than none.
                tokio::time::sleep(wall).await;
            }
        }

        async fn sleep_precisely(&self, wall: Duration) -> std::io::Result<()> {
            let lease = Lease { timers: self, timer: Some(self.take()?) };
            let Some(timer) = &lease.timer else { return Ok(()) };
            let zero = Timespec { tv_sec: 0, tv_nsec: 0 };
            let it_value = Timespec {
                tv_sec: i64::try_from(wall.as_secs()).unwrap_or(i64::MAX),
                tv_nsec: wall.subsec_nanos().into(),
            };
            timerfd_settime(
                timer.get_ref(),
                TimerfdTimerFlags::empty(),
                &Itimerspec { it_interval: zero, it_value },
            )?;
            loop {
                let mut ready = timer.readable().await?;
                // A timer used before may still be marked ready: reading it tells.
                let mut expirations = [0_u8; 8];
                if let Ok(read) = ready.try_io(|fd| Ok(rustix::io::read(fd, &mut expirations)?)) {
                    return read.map(drop);
                }
            }
        }

        // Its successor is unsafe for the sake of types whose descriptor may change; an OwnedFd's does not.
        #[allow(deprecated, reason = "sound for OwnedFd")]
        fn take(&self) -> std::io::Result<AsyncFd<OwnedFd>> {
            if let Some(timer) = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop() {
                return Ok(timer);
            }
            let flags = TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC;
            AsyncFd::new(timerfd_create(TimerfdClockId::Monotonic, flags)?)
        }
    }

    /// Gives its timer back, also when the sleeper is dropped half-way.
    struct Lease<'a> {
        timers: &'a Timers,
        timer: Option<AsyncFd<OwnedFd>>,
    }

    impl Drop for Lease<'_> {
        fn drop(&mut self) {
            self.timers.0.lock().unwrap_or_else(PoisonError::into_inner).extend(self.timer.take());
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod precise {
    /// Nothing to keep.
    #[derive(Debug, Default)]
    pub struct Timers;

    impl Timers {
        /// Sleeps for `wall`.
        pub async fn sleep(&self, wall: std::time::Duration) {
            tokio::time::sleep(wall).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_rate_that_is_no_rate_is_refused() {
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e4] {
            assert!(Clock::start(rate).is_err(), "{rate}");
        }
        assert!(Clock::start(20.0).is_ok());
    }

    #[tokio::test]
    async fn spec_no_sleeper_wakes_early_at_any_rate() {
        for rate in [1.0, 50.0, 0.5] {
            let clock = Clock::start(rate).unwrap();
            for _ in 0..20 {
                let deadline = clock.now() + Duration::from_micros(700);
                clock.sleep_until(deadline).await;
                assert!(clock.now() >= deadline);
            }
        }
    }

    #[tokio::test]
    async fn spec_a_dropped_sleeper_leaves_nothing_behind() {
        let clock = Clock::real();
        let first = clock.now() + Duration::from_millis(2);
        tokio::select! {
            biased;
            () = clock.sleep_until(first + Duration::from_secs(3600)) => panic!("an hour has not passed"),
            () = clock.sleep_until(first) => {}
        }
        // Both timers are used again, one of them still armed for an hour and one just fired.
        let next = clock.now() + Duration::from_millis(1);
        tokio::join!(clock.sleep_until(next), clock.sleep_until(next));
        assert!(clock.now() >= next);
    }

    #[test]
    fn spec_scaled_utc_is_the_start_plus_the_scaled_time() {
        let clock = Clock::start(100.0).unwrap();
        let before = clock.now();
        let utc_us = clock.utc().unix_us;
        let after = clock.now();
        let since = Duration::from_micros(utc_us - clock.started_utc.unix_us);
        let slack = Duration::from_micros(1);
        assert!(since + slack >= before.since_start() && since <= after.since_start() + slack);
    }
}
