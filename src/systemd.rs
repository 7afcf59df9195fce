//! The service manager that started this process: what it is told, and how its watchdog is fed.
//!
//! An event loop calls [`Manager::turn`] once in each of its turns, and that alone sends anything. There is no timer and no
//! thread behind it: a loop that hangs, or whose process is stopped, feeds nothing, and systemd ends the process when
//! `WatchdogSec` is over (F3). A loop that goes round and round without getting on feeds nothing either: its next deadline
//! must have moved since the last time.
//!
//! Nothing here waits. A socket that takes nothing costs a turn nothing; what was to be said is said at the next one.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

use sd_notify::NotifyState;

use crate::time::Instant;

/// The watchdog is fed this many times in its time, as long as the loop turns that often.
const FED_IN_ITS_TIME: u32 = 4;

/// How far something is that is said once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Said {
    Not,
    Wanted,
    Yes,
}

impl Said {
    fn want(&mut self) {
        if *self == Self::Not {
            *self = Self::Wanted;
        }
    }

    fn is_wanted(self) -> bool {
        self == Self::Wanted
    }

    fn settle(&mut self) {
        if *self == Self::Wanted {
            *self = Self::Yes;
        }
    }
}

/// The service manager, or nobody.
#[derive(Debug)]
pub struct Manager {
    socket: Option<UnixDatagram>,
    /// From one feeding to the next.
    feed_every: Option<Duration>,
    /// The last feeding, and the loop's next deadline then.
    fed: Option<(Instant, Instant)>,
    ready: Said,
    stopping: Said,
    status: String,
    status_told: bool,
}

impl Manager {
    /// Nobody is told anything.
    #[must_use]
    pub fn none() -> Self {
        Self {
            socket: None,
            feed_every: None,
            fed: None,
            ready: Said::Not,
            stopping: Said::Not,
            status: String::new(),
            status_told: true,
        }
    }

    /// The one whose socket the environment names (`NOTIFY_SOCKET`), with its watchdog's time (`WATCHDOG_USEC`); nobody, if
    /// it names none.
    ///
    /// # Errors
    /// The socket that it names cannot be reached.
    pub fn from_environment() -> io::Result<Self> {
        let Some(path) = std::env::var_os("NOTIFY_SOCKET") else { return Ok(Self::none()) };
        let socket = UnixDatagram::unbound()?;
        socket.connect(path)?;
        Self::at(socket, sd_notify::watchdog_enabled())
    }

    /// The one at the other end of a connected socket, which ends this process if it is not fed for `watchdog`.
    ///
    /// # Errors
    /// The socket cannot be told not to wait.
    pub fn at(socket: UnixDatagram, watchdog: Option<Duration>) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        let feed_every = watchdog.map(|time| time / FED_IN_ITS_TIME);
        Ok(Self { socket: Some(socket), feed_every, ..Self::none() })
    }

    /// The service has started: said once.
    pub fn ready(&mut self) {
        self.ready.want();
    }

    /// The service is ending: said once.
    pub fn stopping(&mut self) {
        self.stopping.want();
    }

    /// What it is doing, in one line; said when it has changed.
    pub fn status(&mut self, text: &str) {
        if self.socket.is_some() && self.status != text {
            // A second line would be another word of the protocol.
            self.status = text.replace(['\n', '\r'], " ");
            self.status_told = false;
        }
    }

    /// The event loop has gone round: all that was due is done, and it is to be called again at `deadline`.
    pub fn turn(&mut self, now: Instant, deadline: Instant) {
        let Some(socket) = &self.socket else { return };
        let mut words = Vec::new();
        if self.ready.is_wanted() {
            words.push(NotifyState::Ready);
        }
        if self.stopping.is_wanted() {
            words.push(NotifyState::Stopping);
        }
        if !self.status_told {
            words.push(NotifyState::Status(&self.status));
        }
        let is_hungry = self.feed_every.is_some_and(|every| {
            self.fed.is_none_or(|(at, then)| now.saturating_since(at) >= every && deadline > then)
        });
        if is_hungry {
            words.push(NotifyState::Watchdog);
        }
        if words.is_empty() {
            return;
        }
        let text: String = words.iter().map(|word| format!("{word}\n")).collect();
        if socket.send(text.as_bytes()).is_ok_and(|sent| sent == text.len()) {
            self.ready.settle();
            self.stopping.settle();
            self.status_told = true;
            if is_hungry {
                self.fed = Some((now, deadline));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    /// Everything that has been said.
    fn heard(socket: &UnixDatagram) -> Vec<String> {
        let mut said = Vec::new();
        let mut datagram = [0; 512];
        while let Ok(length) = socket.recv(&mut datagram) {
            said.push(String::from_utf8(datagram[..length].to_vec()).unwrap());
        }
        said
    }

    fn manager(watchdog_ms: Option<u64>) -> (Manager, UnixDatagram) {
        let (ours, theirs) = UnixDatagram::pair().unwrap();
        theirs.set_nonblocking(true).unwrap();
        (Manager::at(ours, watchdog_ms.map(Duration::from_millis)).unwrap(), theirs)
    }

    #[test]
    fn spec_each_word_is_said_once_and_a_status_when_it_changes() {
        let (mut manager, socket) = manager(None);
        manager.turn(at(0), at(20));
        assert!(heard(&socket).is_empty());
        manager.status("I: connecting");
        manager.turn(at(20), at(40));
        manager.status("I: connecting");
        manager.turn(at(40), at(60));
        manager.ready();
        manager.status("I: standby\nREADY=1");
        manager.turn(at(60), at(80));
        manager.ready();
        manager.stopping();
        manager.turn(at(80), at(100));
        manager.stopping();
        manager.turn(at(100), at(120));
        let said = ["STATUS=I: connecting\n", "READY=1\nSTATUS=I: standby READY=1\n", "STOPPING=1\n"];
        assert_eq!(heard(&socket), said);
    }

    #[test]
    fn spec_the_watchdog_is_fed_by_turns_that_get_on_and_by_nothing_else() {
        let (mut manager, socket) = manager(Some(2000));
        for turn in 0..=100 {
            manager.turn(at(20 * turn), at(20 * turn + 20));
        }
        // At 0, 0.5, 1, 1.5 and 2 s.
        assert_eq!(heard(&socket), ["WATCHDOG=1\n"; 5]);
        // It turns, and what is due never gets done.
        for turn in 101..300 {
            manager.turn(at(20 * turn), at(2020));
        }
        assert!(heard(&socket).is_empty());
        manager.turn(at(6000), at(6020));
        assert_eq!(heard(&socket), ["WATCHDOG=1\n"]);
    }

    #[test]
    fn spec_a_socket_that_takes_nothing_delays_the_words_and_no_turn() {
        let (mut manager, socket) = manager(Some(2000));
        let mut full = 0;
        while manager.socket.as_ref().unwrap().send(b"X=1\n").is_ok() {
            full += 1;
        }
        manager.ready();
        manager.status("I: standby");
        manager.turn(at(0), at(20));
        assert_eq!(heard(&socket).len(), full);
        manager.turn(at(20), at(40));
        assert_eq!(heard(&socket), ["READY=1\nSTATUS=I: standby\nWATCHDOG=1\n"]);
    }

    #[test]
    fn spec_nobody_is_told_nothing() {
        let mut manager = Manager::none();
        manager.ready();
        manager.status("I: standby");
        manager.turn(at(0), at(20));
        assert_eq!((manager.ready, manager.status.as_str()), (Said::Wanted, ""));
    }
}
