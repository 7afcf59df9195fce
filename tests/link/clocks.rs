//! Two companions whose clocks differ, and one that is found at another address.
//!
//! `cargo test --test link clocks -- --nocapture` prints the table of clocks.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage as Common, TIMESYNC_DATA};
use veilwing::link::gate::{Arrival, Gate, GateConfig};
use veilwing::link::signing::{Signing, timestamp};
use veilwing::link::{LearntPath, Origin, RawFrame, Rejection};
use veilwing::time::Instant;

use crate::common::*;
use crate::wire::*;

const HOUR: i64 = 3_600_000_000;
const DAY: i64 = 24 * HOUR;
const YEAR: i64 = 365 * DAY;

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
