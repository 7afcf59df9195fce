//! A clock that is moved by hand: for simulations in which nobody may be late because the machine is busy.
//!
//! A move goes from deadline to deadline. At each of them the work under the hand is polled until it waits for nothing that
//! is there already: no waker has been called, and the operating system has nothing more for its sockets. So everything that
//! is due happens, at its own instant and in its own order, whatever that takes by the wall.

use std::collections::BTreeMap;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Wake, Waker};

use crate::time::Instant;

/// What a clock shares with its hand.
#[derive(Debug)]
pub(super) struct Dial(Mutex<State>);

#[derive(Debug)]
struct State {
    now: Instant,
    /// Who sleeps, by deadline and number.
    sleepers: BTreeMap<(Instant, u64), Waker>,
    numbered: u64,
    /// So many keep the time where it is.
    holds: usize,
    /// The work is to be polled again.
    stirred: bool,
    /// Who moves the hand, while it waits for the work to stir.
    mover: Option<Waker>,
}

impl Dial {
    pub(super) fn new(now: Instant) -> Self {
        Self(Mutex::new(State {
            now,
            sleepers: BTreeMap::new(),
            numbered: 0,
            holds: 0,
            stirred: false,
            mover: None,
        }))
    }

    pub(super) fn now(&self) -> Instant {
        self.state().now
    }

    pub(super) fn sleep_until(self: &Arc<Self>, deadline: Instant) -> Sleep {
        let number = {
            let mut state = self.state();
            state.numbered += 1;
            state.numbered
        };
        Sleep { dial: Arc::clone(self), key: (deadline, number) }
    }

    /// Sets the time, never back, and wakes whose deadline has come.
    fn set(&self, now: Instant) {
        let due = {
            let mut state = self.state();
            state.now = state.now.max(now);
            let after = (state.now, u64::MAX);
            let later = state.sleepers.split_off(&after);
            std::mem::replace(&mut state.sleepers, later)
        };
        due.into_values().for_each(Waker::wake);
    }

    fn first_deadline(&self) -> Option<Instant> {
        self.state().sleepers.first_key_value().map(|((deadline, _), _)| *deadline)
    }

    /// The work is to be polled again.
    fn stir(&self) {
        let mover = {
            let mut state = self.state();
            state.stirred = true;
            state.mover.take()
        };
        if let Some(mover) = mover {
            mover.wake();
        }
    }

    /// Whether the work is to be polled again; not known while somebody holds the time.
    fn poll_stirred(&self, cx: &Context<'_>) -> Poll<bool> {
        let mut state = self.state();
        let stirred = std::mem::take(&mut state.stirred);
        if !stirred && state.holds > 0 {
            state.mover = Some(cx.waker().clone());
            return Poll::Pending;
        }
        Poll::Ready(stirred)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Whoever panicked left nothing half done.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wake for Dial {
    fn wake(self: Arc<Self>) {
        self.stir();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.stir();
    }
}

/// Completes at its deadline.
pub(super) struct Sleep {
    dial: Arc<Dial>,
    key: (Instant, u64),
}

impl Future for Sleep {
    type Output = ();

    fn poll(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<()> {
        let mut state = self.dial.state();
        if state.now >= self.key.0 {
            return Poll::Ready(());
        }
        state.sleepers.insert(self.key, cx.waker().clone());
        Poll::Pending
    }
}

impl Drop for Sleep {
    fn drop(&mut self) {
        self.dial.state().sleepers.remove(&self.key);
    }
}

/// Keeps a clock that is moved by hand where it is.
#[derive(Debug)]
#[must_use = "time goes on when it is dropped"]
pub struct Hold(Option<Arc<Dial>>);

impl Hold {
    pub(super) fn none() -> Self {
        Self(None)
    }

    pub(super) fn of(dial: &Arc<Dial>) -> Self {
        dial.state().holds += 1;
        Self(Some(Arc::clone(dial)))
    }
}

impl Drop for Hold {
    fn drop(&mut self) {
        if let Some(dial) = &self.0 {
            dial.state().holds -= 1;
            dial.stir();
        }
    }
}

/// Moves a clock.
#[derive(Debug)]
pub struct Hand(Arc<Dial>);

impl Hand {
    pub(super) fn new(dial: Arc<Dial>) -> Self {
        Self(dial)
    }

    /// Puts the clock to `from`, and lets it go on to `to` while `work` does all that is due by then. What became due before
    /// `from` is late then, as for a process that was not run. `Some`: what the work ended with, as soon as it did.
    ///
    /// To be awaited in the tokio runtime that the work's sockets belong to, and not beside other work.
    pub async fn go<W: Future>(
        &self,
        from: Instant,
        to: Instant,
        mut work: Pin<&mut W>,
    ) -> Option<W::Output> {
        self.0.set(from);
        // Who is late finds at once what waits for him.
        tokio::task::yield_now().await;
        loop {
            if let Poll::Ready(ended) = self.settle(work.as_mut()).await {
                return Some(ended);
            }
            match self.0.first_deadline().filter(|deadline| *deadline <= to) {
                Some(deadline) => self.0.set(deadline),
                None => {
                    self.0.set(to);
                    return None;
                }
            }
        }
    }

    /// Polls `work` until it waits for something that is not there yet.
    async fn settle<W: Future>(&self, mut work: Pin<&mut W>) -> Poll<W::Output> {
        let waker = Waker::from(Arc::clone(&self.0));
        loop {
            if let Poll::Ready(ended) = work.as_mut().poll(&mut Context::from_waker(&waker)) {
                return Poll::Ready(ended);
            }
            // The runtime asks the operating system what has arrived, and wakes whose it is.
            tokio::task::yield_now().await;
            if !poll_fn(|cx| self.0.poll_stirred(cx)).await {
                return Poll::Pending;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Duration;

    use tokio::net::UdpSocket;

    use super::*;
    use crate::link::Clock;
    use crate::time::Utc;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    #[tokio::test]
    async fn spec_who_sleeps_is_woken_at_its_own_instant_in_order_and_not_before_the_hand_is_there() {
        let utc = Utc { unix_us: 1_800_000_000_000_000 };
        let (clock, hand) = Clock::by_hand(at(1000), utc);
        let woken = Mutex::new(Vec::new());
        let sleeper = |name: &'static str, deadlines: [u64; 2]| {
            let (clock, woken) = (clock.clone(), &woken);
            async move {
                for deadline in deadlines {
                    clock.sleep_until(at(deadline)).await;
                    woken.lock().unwrap().push((name, clock.now()));
                }
            }
        };
        let mut work = std::pin::pin!(async {
            tokio::join!(biased; sleeper("a", [1003, 1009]), sleeper("b", [1001, 1007]));
        });
        assert_eq!(hand.go(at(1000), at(1000), work.as_mut()).await, None);
        assert!(woken.lock().unwrap().is_empty());
        assert_eq!(hand.go(at(1000), at(1005), work.as_mut()).await, None);
        assert_eq!(*woken.lock().unwrap(), [("b", at(1001)), ("a", at(1003))]);
        assert_eq!((clock.now(), clock.utc().unix_us - utc.unix_us), (at(1005), 5000));
        // It was not run for 3 s: what was due meanwhile is late, and time never goes back.
        assert_eq!(hand.go(at(4005), at(4010), work.as_mut()).await, Some(()));
        assert_eq!(woken.lock().unwrap()[2..], [("a", at(4005)), ("b", at(4005))]);
        assert_eq!(hand.go(at(1), at(2), std::pin::pin!(std::future::pending::<()>())).await, None);
        assert_eq!(clock.now(), at(4005));
    }

    #[tokio::test]
    async fn spec_what_has_arrived_in_a_socket_is_heard_before_time_goes_on() {
        let (clock, hand) = Clock::by_hand(Instant::ZERO, Utc::default());
        let inbox = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(inbox.local_addr().unwrap()).unwrap();
        let heard = Mutex::new(Vec::new());
        let mut work = std::pin::pin!(async {
            let mut buffer = [0; 4];
            loop {
                let length = inbox.recv(&mut buffer).await.unwrap();
                heard.lock().unwrap().push((clock.now(), buffer[..length].to_vec()));
            }
        });
        let mut expected = Vec::new();
        for step in 0..200_u64 {
            for number in 0..step % 7 {
                let datagram = vec![step as u8, number as u8];
                sender.send(&datagram).unwrap();
                expected.push((at(5 * step), datagram));
            }
            let ended: Option<()> = hand.go(at(5 * step), at(5 * step + 5), work.as_mut()).await;
            assert_eq!(ended, None);
            assert_eq!(*heard.lock().unwrap(), expected);
        }
    }

    #[tokio::test]
    async fn spec_work_that_was_not_run_finds_what_waits_for_it_when_it_wakes_late() {
        let (clock, hand) = Clock::by_hand(Instant::ZERO, Utc::default());
        let inbox = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut work = std::pin::pin!(async {
            clock.sleep_until(at(10)).await;
            let mut buffer = [0; 4];
            let waiting = tokio::select! {
                biased;
                read = inbox.recv(&mut buffer) => Some(read.unwrap()),
                () = std::future::ready(()) => None,
            };
            (clock.now(), waiting)
        });
        assert_eq!(hand.go(at(0), at(5), work.as_mut()).await, None);
        sender.send_to(&[1, 2, 3], inbox.local_addr().unwrap()).unwrap();
        assert_eq!(hand.go(at(3000), at(3005), work.as_mut()).await, Some((at(3000), Some(3))));
    }

    #[tokio::test]
    async fn spec_time_stands_still_for_work_on_another_thread_that_holds_it() {
        let (clock, hand) = Clock::by_hand(Instant::ZERO, Utc::default());
        let (answer, answered) = tokio::sync::oneshot::channel();
        let (begin, begun) = std::sync::mpsc::channel::<()>();
        let hold = clock.hold();
        let thread = std::thread::spawn(move || {
            begun.recv().unwrap();
            answer.send(42).unwrap();
            drop(hold);
        });
        let mut work = std::pin::pin!(async {
            // Only now may the thread begin: the work waits for it already.
            begin.send(()).unwrap();
            (answered.await.unwrap(), clock.now())
        });
        assert_eq!(hand.go(at(3), at(1000), work.as_mut()).await, Some((42, at(3))));
        thread.join().unwrap();
    }
}
