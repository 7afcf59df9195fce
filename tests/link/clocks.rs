//! Two companions whose clocks differ, and one that is found at another address: in virtual time, both ends' gates with a
//! wire between them, the listening end's path as UDP has it.
//!
//! `cargo test --test link clocks -- --nocapture` prints the table of clocks.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage as Common, TIMESYNC_DATA};
use veilwing::link::gate::{Arrival, Gate, GateConfig};
use veilwing::link::signing::{Keeper, Signing, timestamp};
use veilwing::link::{Envelope, Form, Key, LearntPath, Origin, RawFrame, Rejection, SigningConfig};
use veilwing::pair::wire::{MavMessage, VEILWING_COMMIT_DATA};
use veilwing::time::{Instant, Utc};

use crate::common::*;

const DELAY: Duration = Duration::from_millis(40);
const TICK: Duration = Duration::from_millis(10);
const HOUR: i64 = 3_600_000_000;
const DAY: i64 = 24 * HOUR;
const YEAR: i64 = 365 * DAY;

/// A record that is always in time.
#[derive(Debug)]
struct Prompt(u64);

impl Keeper for Prompt {
    fn keep(&mut self, ceiling: u64) -> bool {
        self.0 = ceiling;
        true
    }

    fn kept(&self) -> u64 {
        self.0
    }

    fn close(&mut self, _: u64) {}
}

fn address(port: u16) -> SocketAddr {
    SocketAddr::from(([10, 0, 0, 1], port))
}

fn signing(link_id: u8, recorded: u64) -> Signing {
    let config = SigningConfig {
        key: Key::new(KEY),
        link_id,
        state_file: "none".into(),
        unsigned_allowed: Vec::new(),
    };
    Signing::with_keeper(config, Box::new(Prompt(recorded)), recorded)
}

/// One companion: its gate, its clock's error, and where it sends.
struct End {
    gate: Gate<Envelope>,
    system: u8,
    off_us: i64,
    /// The end that listens learns where the other is; the other one knows.
    path: Option<LearntPath>,
    said: Vec<String>,
    delivered: Vec<(Duration, u32)>,
    rejected: Vec<Rejection>,
}

fn utc_at(now: Duration, off_us: i64) -> Utc {
    let us = SIGNED_UNIX_US as i64 + now.as_micros() as i64 + off_us;
    Utc { unix_us: us as u64 }
}

impl End {
    fn new(system: u8, off_us: i64, listens: bool, recorded: Option<u64>, now: Duration) -> Self {
        let utc = utc_at(now, off_us);
        let recorded = recorded.unwrap_or(0).max(timestamp(utc));
        let signing = Some(signing(0, recorded));
        let config = GateConfig {
            peer_system: Some(3 - system),
            open_to_anyone: listens,
            accept_foreign: false,
            signing,
        };
        let mut gate = Gate::new(config, utc);
        gate.speak_as((system, 191));
        let path = listens.then(LearntPath::default);
        Self { gate, system, off_us, path, said: Vec::new(), delivered: Vec::new(), rejected: Vec::new() }
    }

    fn origin(&self, from: SocketAddr, now: Instant) -> Option<Origin> {
        self.path.as_ref().map_or(Some(Origin::Peer), |path| path.origin(from, now))
    }

    /// Takes a datagram, and gives back what goes out for it, and where to: `None` to the peer.
    fn take(
        &mut self,
        from: SocketAddr,
        raw: &RawFrame,
        now: Duration,
    ) -> Vec<(Option<SocketAddr>, RawFrame)> {
        let at = Instant::from_start(now);
        let Some(origin) = self.origin(from, at) else {
            self.rejected.push(Rejection::Stranger);
            return Vec::new();
        };
        match self.gate.admit(raw, Arrival { origin, now: at, utc: utc_at(now, self.off_us) }) {
            Ok(frame) => {
                if let Some(path) = &mut self.path {
                    path.heard(origin, at);
                }
                if let Some(frame) = frame {
                    let MavMessage::VEILWING_COMMIT(commit) = frame.message.message() else { panic!() };
                    self.delivered.push((now, commit.proposal));
                }
            }
            Err(reason) => self.rejected.push(reason),
        }
        self.said.extend(std::iter::from_fn(|| self.gate.poll_notice()).map(|notice| notice.to_string()));
        let replies = std::iter::from_fn(|| self.gate.poll_reply());
        let to = |origin| match origin {
            Origin::Address(to) => Some(to),
            _ => None,
        };
        replies.map(|(origin, raw)| (to(origin), raw)).collect()
    }

    fn speak(&mut self, number: u32, now: Duration) -> RawFrame {
        let message =
            MavMessage::VEILWING_COMMIT(VEILWING_COMMIT_DATA { boot_id: 1, proposal: number, slot: 0 });
        let from = (self.system, 191);
        self.gate.seal(from, &Envelope::new(Form::Plain, from, 0, message), utc_at(now, self.off_us)).unwrap()
    }
}

/// A datagram under way.
struct Flying {
    at: Duration,
    from: SocketAddr,
    to: SocketAddr,
    raw: RawFrame,
}

const LISTENER: u16 = 1;
const CALLER: u16 = 2;

/// The listening end at port 1, the other at `caller_port`, and what is under way.
struct Wire {
    listener: End,
    caller: End,
    caller_port: u16,
    flying: Vec<Flying>,
    /// All that was ever sent, for whoever listens in.
    recorded: Vec<Flying>,
    now: Duration,
    number: u32,
}

impl Wire {
    fn new(listener: End, caller: End) -> Self {
        Self {
            listener,
            caller,
            caller_port: CALLER,
            flying: Vec::new(),
            recorded: Vec::new(),
            now: Duration::ZERO,
            number: 0,
        }
    }

    fn send(&mut self, from: SocketAddr, to: SocketAddr, raw: RawFrame) {
        self.recorded.push(Flying { at: self.now, from, to, raw });
        self.flying.push(Flying { at: self.now + DELAY, from, to, raw });
    }

    /// Both speak ten times a second, as long as this lasts.
    fn pass(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.now += TICK;
            if self.now.as_millis().is_multiple_of(100) {
                self.number += 1;
                let raw = self.caller.speak(self.number, self.now);
                self.send(address(self.caller_port), address(LISTENER), raw);
                if let Some(to) = self.listener.path.as_ref().and_then(LearntPath::peer) {
                    let raw = self.listener.speak(self.number, self.now);
                    self.send(address(LISTENER), to, raw);
                }
            }
            self.deliver();
        }
    }

    fn deliver(&mut self) {
        let now = self.now;
        let (due, rest) = std::mem::take(&mut self.flying).into_iter().partition(|f| f.at <= now);
        self.flying = rest;
        let due: Vec<Flying> = due;
        for Flying { from, to, raw, .. } in due {
            let replies = match to.port() {
                LISTENER => self.listener.take(from, &raw, now),
                port if port == self.caller_port => self.caller.take(from, &raw, now),
                _ => continue,
            };
            for (reply_to, raw) in replies {
                let back = reply_to.unwrap_or(from);
                self.send(to, back, raw);
            }
        }
    }

    /// Somebody sends what is not the ends' own.
    fn inject(&mut self, from: u16, raw: RawFrame) {
        let (now, to) = (self.now, address(LISTENER));
        self.flying.push(Flying { at: now, from: address(from), to, raw });
        self.deliver();
    }

    /// Lets what is under way arrive, and its answers.
    fn settle(&mut self) {
        for _ in 0..3 {
            self.now += DELAY;
            self.deliver();
        }
    }

    fn path(&self) -> Option<u16> {
        self.listener.path.as_ref().and_then(LearntPath::peer).map(|at| at.port())
    }
}

/// The line about clocks, cut to the words that matter.
fn named(said: &[String]) -> String {
    let line = said.iter().find(|line| line.contains("clock"));
    line.map_or("nothing".to_owned(), |line| {
        let cut = line.find(" (there").map_or(line.len(), |at| at);
        let refused = if line.contains("turned away") { ", refused" } else { "" };
        format!("{}{refused}", &line["the other end's clock is ".len()..cut])
    })
}

#[test]
fn spec_clocks_that_differ_are_served_or_refused_by_name() {
    println!("J's clock     J         served within   I says of J's clock, J of I's");
    for (off_us, text) in [
        (-YEAR, "-1 year"),
        (-DAY, "-1 day"),
        (-HOUR, "-1 hour"),
        (0, "right"),
        (HOUR, "+1 hour"),
        (DAY, "+1 day"),
        (YEAR, "+1 year"),
    ] {
        for j_listens in [false, true] {
            let i = End::new(1, 0, !j_listens, None, Duration::ZERO);
            let j = End::new(2, off_us, j_listens, None, Duration::ZERO);
            let mut wire = if j_listens { Wire::new(j, i) } else { Wire::new(i, j) };
            wire.pass(Duration::from_secs(10));
            let (i, j) =
                if j_listens { (&wire.caller, &wire.listener) } else { (&wire.listener, &wire.caller) };
            let first = |end: &End| end.delivered.first().map(|(at, _)| *at);
            let served = first(i).and_then(|first_i| Some(first_i.max(first(j)?)));
            println!(
                "{text:10} {:10} {:>12}   {}; {}",
                if j_listens { "listens" } else { "calls" },
                served.map_or("refused".to_owned(), |at| format!("{} ms", at.as_millis())),
                named(&i.said),
                named(&j.said)
            );
            if off_us.abs() == YEAR {
                assert!(i.delivered.is_empty() && j.delivered.is_empty());
                let ahead = if off_us > 0 { "ahead of" } else { "behind" };
                let behind = if off_us > 0 { "behind" } else { "ahead of" };
                assert_eq!(named(&i.said), format!("365.0 days {ahead} this machine's, refused"));
                assert_eq!(named(&j.said), format!("365.0 days {behind} this machine's, refused"));
                continue;
            }
            assert!(served.is_some_and(|at| at <= Duration::from_millis(500)), "{served:?}");
            // Everything from then on.
            for end in [i, j] {
                let numbers: Vec<u32> = end.delivered.iter().map(|(_, number)| *number).collect();
                assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{numbers:?}");
            }
            let unit = if off_us.abs() == DAY { "24.0 h" } else { "1.0 h" };
            for end in [i, j] {
                assert_eq!(named(&end.said).starts_with(unit), off_us != 0, "{:?}", end.said);
            }
        }
    }
}

#[test]
fn spec_a_listener_after_a_crash_begins_ahead_and_is_served_at_once() {
    // A minute ahead of its clock, by the record; and once with a clock that a power cut has set back by a day.
    for (off_us, ahead_us) in [(0, 60_000_000), (-DAY, DAY + 60_000_000)] {
        let recorded = timestamp(utc_at(Duration::ZERO, off_us + ahead_us));
        let i = End::new(1, 0, false, None, Duration::ZERO);
        let j = End::new(2, off_us, true, Some(recorded), Duration::ZERO);
        let mut wire = Wire::new(j, i);
        wire.pass(Duration::from_secs(2));
        assert!(wire.listener.delivered.first().is_some_and(|(at, _)| *at <= Duration::from_millis(500)));
        assert!(wire.caller.delivered.first().is_some_and(|(at, _)| *at <= Duration::from_millis(500)));
        let told = wire
            .listener
            .said
            .iter()
            .any(|line| line.contains("behind what it was in an earlier run: set it"));
        let blamed = wire.listener.said.iter().any(|line| line.contains("which has been later before"));
        assert_eq!((told, blamed), (off_us != 0, off_us != 0), "{:?}", wire.listener.said);
    }
}

#[test]
fn spec_nothing_recorded_answers_a_challenge_or_is_taken_twice() {
    let i = || End::new(1, 0, false, None, Duration::ZERO);
    let mut wire = Wire::new(End::new(2, HOUR, true, None, Duration::ZERO), i());
    wire.pass(Duration::from_secs(5));
    wire.settle();
    let delivered = wire.listener.delivered.len();
    assert!(delivered > 40);
    let recorded: Vec<RawFrame> = wire.recorded.iter().map(|flying| flying.raw).collect();
    assert!(recorded.len() > 90);
    // To the same end, from where the peer is and from elsewhere, soon and after its silence.
    for silence in [0, 4] {
        wire.now += Duration::from_secs(silence);
        for (k, raw) in recorded.iter().enumerate() {
            wire.inject(CALLER, *raw);
            wire.inject(100 + k as u16, *raw);
        }
        assert_eq!((wire.listener.delivered.len(), wire.path()), (delivered, Some(CALLER)));
    }
    // To a new run of it, whose record a clean end or a crash has left, whatever its clock.
    for (off_us, ahead_us) in [(HOUR, 0), (HOUR, 60_000_000), (0, HOUR), (-DAY, DAY + HOUR)] {
        let last = timestamp(utc_at(wire.now, off_us + ahead_us));
        let mut next = Wire::new(End::new(2, off_us, true, Some(last), wire.now), i());
        next.now = wire.now;
        for (k, raw) in recorded.iter().enumerate() {
            next.inject(100 + k as u16, *raw);
        }
        assert_eq!((next.listener.delivered.len(), next.path()), (0, None));
        assert_eq!(next.listener.rejected.len(), recorded.len());
    }
}

#[test]
fn spec_a_path_moves_only_to_who_answers_and_only_after_silence() {
    let mut wire =
        Wire::new(End::new(1, 0, true, None, Duration::ZERO), End::new(2, 0, false, None, Duration::ZERO));
    wire.pass(Duration::from_secs(2));
    wire.settle();
    assert_eq!(wire.path(), Some(CALLER));
    // A frame of the peer's own, never seen before, that another has caught: while the peer speaks, and when it is silent.
    let number = wire.number;
    let caught = wire.caller.speak(1000, wire.now);
    wire.inject(66, caught);
    assert_eq!(wire.listener.rejected.last(), Some(&Rejection::Stranger));
    wire.now += Duration::from_secs(4);
    for k in 0..50 {
        let caught = wire.caller.speak(1001 + k, wire.now);
        wire.inject(66, caught);
        wire.now += TICK;
        assert_eq!(wire.listener.rejected.last(), Some(&Rejection::Unproven));
    }
    assert!(wire.listener.delivered.iter().all(|(_, n)| *n <= number), "nothing of it was taken");
    assert_eq!(wire.path(), Some(CALLER));
    // It was asked, now and then and not for each frame, and nothing else went there.
    let asked = wire.recorded.iter().filter(|flying| flying.to == address(66)).count();
    assert!((2..=6).contains(&asked), "{asked}");
    // The peer itself has moved: it answers, and the path follows.
    wire.caller_port = 7;
    let moved_at = wire.now;
    wire.pass(Duration::from_secs(1));
    assert_eq!(wire.path(), Some(7));
    let (first, _) = wire.listener.delivered.iter().find(|(at, _)| *at > moved_at).unwrap();
    assert!(*first - moved_at <= Duration::from_millis(400), "{first:?}");
}

#[test]
fn spec_what_comes_back_in_our_own_name_is_nobodys() {
    let mut wire =
        Wire::new(End::new(1, 0, true, None, Duration::ZERO), End::new(2, 0, false, None, Duration::ZERO));
    wire.listener.gate = {
        // Whoever is at the other end: the system does not tell them apart.
        let config = GateConfig { signing: Some(signing(0, 1)), ..GateConfig::default() };
        let mut gate = Gate::new(config, utc_at(Duration::ZERO, 0));
        gate.speak_as((1, 191));
        gate
    };
    let own = wire.listener.speak(5, Duration::ZERO);
    wire.inject(66, own);
    assert_eq!(wire.listener.rejected, [Rejection::Reflected]);
    assert!(wire.recorded.is_empty() && wire.path().is_none());
}

/// An autopilot as the reference implementation of MAVLink signs: its timestamps never fall behind those it has heard.
struct Autopilot {
    signing: Signing,
    encoder: veilwing::link::codec::Encoder,
    utc_off_us: i64,
}

impl Autopilot {
    fn sign(&mut self, message: &Common, now: Duration) -> RawFrame {
        let mut raw = self.encoder.encode_for_signing((1, 1), message);
        self.signing.sign(&mut raw, utc_at(now, self.utc_off_us)).unwrap();
        RawFrame::V2(raw)
    }

    /// What PX4 and ArduPilot say to a TIMESYNC request; nothing to what does not prove its key.
    fn answer(&mut self, raw: &RawFrame, now: Duration) -> Option<RawFrame> {
        self.signing.verify(raw, utc_at(now, self.utc_off_us)).ok()?;
        let Common::TIMESYNC(m) = raw.parse::<Common>().ok()?.message else { return None };
        let answer = TIMESYNC_DATA { tc1: 77, ts1: m.ts1, ..TIMESYNC_DATA::DEFAULT };
        Some(self.sign(&Common::TIMESYNC(answer), now))
    }
}

/// An autopilot that calls a listening companion, its time by its own means, and GPS ten seconds later.
#[test]
fn spec_an_autopilot_is_heard_before_and_after_it_knows_the_time() {
    println!("autopilot's time            heard after");
    for (text, companion_off_us, before_gps_us, after_gps_us) in [
        ("right throughout", 0, 0, 0),
        ("last flight's, then GPS", 0, -20 * DAY, 0),
        ("never set, then GPS", 0, -11 * YEAR, 0),
        ("ours, a day late; then GPS", -DAY, -20 * DAY, 0),
        ("ours, a year late; then GPS", -YEAR, -11 * YEAR, 0),
    ] {
        let utc = |now| utc_at(now, companion_off_us);
        let config = GateConfig {
            peer_system: Some(1),
            open_to_anyone: true,
            accept_foreign: true,
            signing: Some(signing(1, timestamp(utc(Duration::ZERO)))),
        };
        let mut gate = Gate::<Common>::new(config, utc(Duration::ZERO));
        gate.speak_as((1, 191));
        let mut path = LearntPath::default();
        let mut autopilot = Autopilot {
            signing: signing(0, timestamp(utc_at(Duration::ZERO, before_gps_us))),
            encoder: veilwing::link::codec::Encoder::default(),
            utc_off_us: before_gps_us,
        };
        let (mut first, mut lost) = (None, 0);
        for k in 1..2000_u64 {
            let now = TICK * k as u32;
            if k == 1000 {
                autopilot.utc_off_us = after_gps_us;
            }
            let mut to_hear = vec![autopilot.sign(&heartbeat(k as u32), now)];
            while let Some(raw) = to_hear.pop() {
                let at = Instant::from_start(now);
                let origin = path.origin(address(3), at).unwrap();
                match gate.admit(&raw, Arrival { origin, now: at, utc: utc(now) }) {
                    Ok(frame) => {
                        path.heard(origin, at);
                        first = first.or(frame.map(|_| now));
                    }
                    Err(_) => lost += u32::from(first.is_some()),
                }
                while let Some((_, challenge)) = gate.poll_reply() {
                    to_hear.extend(autopilot.answer(&challenge, now));
                }
            }
            // What the companion says anyway, once it knows where to.
            if path.peer().is_some() && k % 10 == 0 {
                let heartbeat = gate.seal((1, 191), &heartbeat(0), utc(now)).unwrap();
                autopilot.answer(&heartbeat, now);
            }
        }
        println!("{text:27} {} ms, {lost} frames turned away after", first.unwrap_or_default().as_millis());
        assert!(first.is_some_and(|at| at <= Duration::from_millis(150)), "{text}: {first:?}");
        assert_eq!(lost, 0, "{text}");
    }
}

/// The same for a third party's TIMESYNC, which is not ours to keep.
#[test]
fn spec_a_timesync_that_nobody_asked_for_is_delivered() {
    let mut gate = Gate::<Common>::new(
        GateConfig { signing: Some(signing(1, 1)), ..GateConfig::default() },
        utc_at(Duration::ZERO, 0),
    );
    let mut autopilot = Autopilot { signing: signing(0, 1), encoder: Default::default(), utc_off_us: 0 };
    for (tc1, ts1) in [(0, 5), (9, 5), (9, -5), (9, i64::MAX)] {
        let message = Common::TIMESYNC(TIMESYNC_DATA { tc1, ts1, ..TIMESYNC_DATA::DEFAULT });
        let raw = autopilot.sign(&message, Duration::ZERO);
        let at = Arrival { origin: Origin::Peer, now: Instant::ZERO, utc: utc_at(Duration::ZERO, 0) };
        assert_eq!(gate.admit(&raw, at).unwrap().map(|frame| frame.message), Some(message));
    }
}

#[test]
fn spec_a_peer_that_is_not_named_is_the_only_one_heard_or_none() {
    let utc = utc_at(Duration::ZERO, 0);
    let seek = || Gate::<Common>::new(GateConfig { open_to_anyone: true, ..GateConfig::default() }, utc);
    let from = |system| RawFrame::from_bytes(&heartbeat_bytes(system, 0)).unwrap();
    let hear = |gate: &mut Gate<Common>, system: u8, ms: u64| {
        let now = Instant::from_start(Duration::from_millis(ms));
        let at = Arrival { origin: Origin::Address(address(9)), now, utc };
        gate.admit(&from(system), at).map(|frame| frame.is_some())
    };
    let mut alone = seek();
    for ms in [0, 1000, 2900] {
        assert_eq!(hear(&mut alone, 7, ms), Err(Rejection::Unpinned));
    }
    assert_eq!(hear(&mut alone, 7, 3000), Ok(true));
    assert!(alone.poll_notice().unwrap().to_string().contains("peer_system_id = 7"));
    assert_eq!(hear(&mut alone, 8, 3100), Err(Rejection::ForeignSystem));
    let mut several = seek();
    for (system, ms) in [(7, 0), (9, 1000), (7, 5000), (8, 6000), (9, 60_000)] {
        assert_eq!(hear(&mut several, system, ms), Err(Rejection::Unpinned));
    }
    let told: Vec<String> = std::iter::from_fn(|| several.poll_notice()).map(|n| n.to_string()).collect();
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[1].starts_with("systems 7, 8, 9 speak here"), "{told:?}");
}
