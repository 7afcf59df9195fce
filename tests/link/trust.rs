//! T1: nothing unauthenticated gets through, everything is counted, no link is redirected.

use std::path::Path;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::TIMESYNC_DATA;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::net::UdpSocket;
use veilwing::link::LinkAddress;
use veilwing::link::codec::Encoder;
use veilwing::link::signing::{RADIO_STATUS_ID, Signing};
use veilwing::link::{Clock, Key, Link, LinkConfig, MemoryEnd, Rejection, SigningConfig};
use veilwing::time::{Instant, Utc};

use crate::common::*;
use crate::tlog::directory;

fn signing(directory: &Path, name: &str, key: [u8; 32]) -> SigningConfig {
    let unsigned_allowed = vec![RADIO_STATUS_ID];
    SigningConfig { key: Key::new(key), link_id: 0, state_file: directory.join(name), unsigned_allowed }
}

/// A link that signs, to a peer of system 1.
fn config(directory: &Path, name: &str) -> LinkConfig {
    LinkConfig {
        name: name.to_owned(),
        peer_system: Some(1),
        signing: Some(signing(directory, name, KEY)),
        ..LinkConfig::default()
    }
}

/// The peer, by hand: what it sends and what might be made of it.
struct Peer {
    encoder: Encoder,
    signing: Signing,
    clock: Clock,
}

impl Peer {
    fn new(directory: &Path, name: &str, key: [u8; 32], clock: &Clock) -> Self {
        let signing = Signing::open(signing(directory, name, key), clock.utc()).unwrap();
        Self { encoder: Encoder::default(), signing, clock: clock.clone() }
    }

    fn signed(&mut self, system: u8, mode: u32) -> Vec<u8> {
        self.sign(system, &heartbeat(mode))
    }

    /// The answer to the challenge in this datagram.
    fn answer(&mut self, datagram: &[u8]) -> Vec<u8> {
        let (frames, _) = decode(datagram);
        let M::TIMESYNC(asked) = frames[0].parse::<M>().unwrap().message else { panic!("{frames:?}") };
        assert_eq!(asked.tc1, 0);
        self.sign(1, &M::TIMESYNC(TIMESYNC_DATA { tc1: 1, ts1: asked.ts1, ..TIMESYNC_DATA::DEFAULT }))
    }

    fn sign(&mut self, system: u8, message: &M) -> Vec<u8> {
        let mut raw = self.encoder.encode_for_signing((system, 1), message);
        // Ahead of the link's start, whose record reaches further.
        let utc = self.clock.utc() + Duration::from_millis(100);
        self.signing.sign(&mut raw, utc).unwrap();
        raw.raw_bytes().to_vec()
    }

    /// A frame of a quarter of an hour ago, from a stream of its own.
    fn recorded_long_ago(&self, directory: &Path) -> Vec<u8> {
        let then = Utc { unix_us: self.clock.utc().unix_us - 900_000_000 };
        let config = SigningConfig { link_id: 5, ..signing(directory, "old", KEY) };
        let mut signing = Signing::open(config, then).unwrap();
        let mut raw = Encoder::default().encode_for_signing((1, 1), &heartbeat(666));
        signing.sign(&mut raw, then).unwrap();
        raw.raw_bytes().to_vec()
    }
}

/// Hostile datagrams, each with the reason for which it must be turned away. `seen` was accepted before.
fn hostile(directory: &Path, peer: &mut Peer, forger: &mut Peer, seen: &[u8]) -> Vec<(Vec<u8>, Rejection)> {
    let good = peer.signed(1, 666);
    let mut flipped = good.clone();
    flipped[12] ^= 4;
    let mut wrong_signature = good.clone();
    *wrong_signature.last_mut().unwrap() ^= 1;
    vec![
        (heartbeat_bytes(1, 666), Rejection::Unsigned),
        (bytes(HEARTBEAT_V1), Rejection::Unsigned),
        (forger.signed(1, 666), Rejection::WrongSignature),
        (wrong_signature, Rejection::WrongSignature),
        (seen.to_vec(), Rejection::Replayed),
        (peer.signed(2, 666), Rejection::ForeignSystem),
        (heartbeat_bytes(2, 666), Rejection::ForeignSystem),
        (good[..good.len() - 1].to_vec(), Rejection::Truncated),
        (good[..12].to_vec(), Rejection::Truncated),
        (flipped, Rejection::BadCrc),
        (peer.recorded_long_ago(directory), Rejection::TooOld),
    ]
}

#[tokio::test]
async fn spec_each_hostile_frame_is_counted_by_its_reason_and_changes_nothing() {
    let directory = directory("trust-memory");
    // At a time of our own: what is left of a frame cut short is searched for another, and a signature of another
    // microsecond may hold what looks like the beginning of one.
    let (clock, _hand) = Clock::by_hand(Instant::ZERO, Utc { unix_us: 1_790_000_000_000_000 });
    let (near, far) = MemoryEnd::pair();
    let mut link = Link::<M>::in_memory(near, config(&directory, "link"), clock.clone()).unwrap();
    let mut peer = Peer::new(&directory, "peer", KEY, &clock);
    let mut forger = Peer::new(&directory, "forger", [9; 32], &clock);

    let first = peer.signed(1, 0);
    assert!(far.send(first.clone()));
    assert_eq!(mode_of(&link.recv().await), 0);
    let mut expected = vec![0; Rejection::ALL.len()];
    for (mode, (datagram, reason)) in (1..).zip(hostile(&directory, &mut peer, &mut forger, &first)) {
        assert!(far.send(datagram.clone()));
        // The same frames before the good one that ends the wait: it alone comes out.
        assert!(far.send(peer.signed(1, mode)));
        assert_eq!(mode_of(&link.recv().await), mode, "{reason:?}");
        expected[reason as usize] += 1;
        let counted: Vec<_> =
            Rejection::ALL.iter().map(|&reason| link.counters().rejected.get(reason)).collect();
        assert_eq!(counted, expected, "{reason:?}: {datagram:02x?}");
    }
}

#[tokio::test]
async fn spec_nothing_is_replayed_to_a_restarted_link() {
    let directory = directory("trust-restart");
    let clock = Clock::real();
    let mut peer = Peer::new(&directory, "peer", KEY, &clock);
    let mut recorded = Vec::new();
    for run in 0..3 {
        let (near, far) = MemoryEnd::pair();
        let mut link = Link::<M>::in_memory(near, config(&directory, "link"), clock.clone()).unwrap();
        for datagram in &recorded {
            assert!(far.send(Vec::clone(datagram)));
        }
        for mode in 0..20 {
            recorded.push(peer.signed(1, mode));
            assert!(far.send(recorded[recorded.len() - 1].clone()));
            assert_eq!(mode_of(&link.recv().await), mode);
        }
        assert_eq!(link.counters().rejected.total(), 20 * run);
        assert_eq!(link.counters().rejected.get(Rejection::TooOld), 20 * run);
    }
}

#[tokio::test]
async fn spec_no_hostile_datagram_teaches_an_address_or_takes_one_away() {
    let directory = directory("trust-udp");
    let clock = Clock::real();
    let mut peer = Peer::new(&directory, "peer", KEY, &clock);
    let mut forger = Peer::new(&directory, "forger", [9; 32], &clock);
    let mut link =
        Link::<M>::open(LinkAddress::UdpIn(loopback(0)), config(&directory, "link"), clock.clone())
            .await
            .unwrap();
    let to = link.local_address().unwrap();
    let friend = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let stranger = UdpSocket::bind("127.0.0.1:0").await.unwrap();

    // Before the peer is known. The allowed unsigned message and one junk byte are no proof either.
    let seen = peer.signed(1, 0);
    for (datagram, _) in hostile(&directory, &mut peer, &mut forger, &[]) {
        stranger.send_to(&datagram, to).await.unwrap();
    }
    stranger.send_to(&[0x55], to).await.unwrap();
    stranger.send_to(&[], to).await.unwrap();
    let mut radio = bytes(RADIO_STATUS_V1);
    radio[3] = 1;
    let crc = mavlink::calculate_crc(&radio[1..15], 185);
    radio[15..].copy_from_slice(&crc.to_le_bytes());
    stranger.send_to(&radio, to).await.unwrap();
    // The peer is asked whether it is there, and answers; then it is heard.
    link.send((1, 191), &heartbeat(0));
    friend.send_to(&peer.signed(1, 0), to).await.unwrap();
    let mut challenge = [0; 300];
    let length = tokio::select! {
        received = friend.recv(&mut challenge) => received.unwrap(),
        frame = link.recv() => panic!("{frame:?}"),
    };
    assert!(!link.is_connected());
    friend.send_to(&peer.answer(&challenge[..length]), to).await.unwrap();
    friend.send_to(&peer.signed(1, 1), to).await.unwrap();
    assert_eq!(mode_of(&link.recv().await), 1);
    let before = link.counters().clone();
    assert_eq!((before.received, before.connections), (2, 1));
    assert_eq!(before.rejected.get(Rejection::Unproven), 1);
    assert_eq!(before.rejected.get(Rejection::Unsigned), 3, "{before}");

    // While it is alive, nobody else is heard, not even with a frame of the peer's that has not been seen yet.
    for mode in 2..20 {
        for (datagram, _) in hostile(&directory, &mut peer, &mut forger, &seen) {
            stranger.send_to(&datagram, to).await.unwrap();
        }
        stranger.send_to(&peer.signed(1, 666), to).await.unwrap();
        friend.send_to(&peer.signed(1, mode), to).await.unwrap();
        assert_eq!(mode_of(&link.recv().await), mode);
        link.send((1, 191), &heartbeat(mode));
        let mut datagram = [0; 300];
        let length = tokio::select! {
            received = friend.recv(&mut datagram) => received.unwrap(),
            frame = link.recv() => panic!("{frame:?}"),
        };
        assert_eq!(mode_of(&decode(&datagram[..length]).0[0].parse::<M>().unwrap()), mode);
    }
    let after = link.counters();
    assert_eq!(after.rejected.get(Rejection::Stranger), 18 * 12);
    assert_eq!(after.rejected.total() - before.rejected.total(), 18 * 12, "{after}");
    assert_eq!(after.connections, 1);
    // Nothing but one question was sent to the stranger, for an old frame of the peer's.
    let mut datagram = [0; 300];
    let length = stranger.recv(&mut datagram).await.unwrap();
    peer.answer(&datagram[..length]);
    assert!(stranger.try_recv(&mut datagram).is_err());
}

#[tokio::test]
async fn spec_a_ground_station_behind_the_autopilot_is_heard_but_is_not_the_peer() {
    let foreign = |mode| {
        let raw = Encoder::default().encode((255, 190), &heartbeat(mode));
        raw.raw_bytes().to_vec()
    };
    let config = LinkConfig { peer_system: Some(1), accept_foreign: true, ..LinkConfig::default() };
    let mut link = Link::<M>::open(LinkAddress::UdpIn(loopback(0)), config, Clock::real()).await.unwrap();
    let to = link.local_address().unwrap();
    let [autopilot, station] =
        [UdpSocket::bind("127.0.0.1:0").await.unwrap(), UdpSocket::bind("127.0.0.1:0").await.unwrap()];
    station.send_to(&foreign(1), to).await.unwrap();
    autopilot.send_to(&heartbeat_bytes(1, 2), to).await.unwrap();
    autopilot.send_to(&foreign(3), to).await.unwrap();
    station.send_to(&foreign(4), to).await.unwrap();
    autopilot.send_to(&foreign(5), to).await.unwrap();
    for mode in [2, 3, 5] {
        assert_eq!(mode_of(&link.recv().await), mode);
    }
    assert_eq!(reasons(link.counters()), [(Rejection::ForeignSystem, 1), (Rejection::Stranger, 1)]);
}

#[tokio::test]
async fn prop_a_flood_of_junk_loses_no_frame_of_the_peers() {
    let mut link = open(LinkAddress::UdpIn(loopback(0))).await;
    let to = link.local_address().unwrap();
    let friend = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let stranger = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(10_000);
    // 20,000 random datagrams, fifty between two frames: as many as the socket's buffer surely holds.
    for mode in 0..400 {
        for _ in 0..50 {
            let mut junk = vec![0; rng.random_range(1..200)];
            rng.fill_bytes(&mut junk);
            stranger.send_to(&junk, to).await.unwrap();
        }
        friend.send_to(&heartbeat_bytes(1, mode), to).await.unwrap();
        assert_eq!(mode_of(&link.recv().await), mode);
    }
    let counters = link.counters();
    assert_eq!((counters.received, counters.connections), (400, 1));
    // The first fifty came before the peer was known, and were searched.
    assert_eq!(counters.rejected.get(Rejection::Stranger), 399 * 50);
}

/// `cargo test --test link starve -- --nocapture` prints how late a 50 Hz deadline was under the flood.
#[tokio::test]
async fn spec_a_flood_does_not_starve_the_event_loop() {
    for known in [false, true] {
        let clock = Clock::real();
        let config = LinkConfig { peer_system: Some(1), ..LinkConfig::default() };
        let mut link = Link::<M>::open(LinkAddress::UdpIn(loopback(0)), config, clock.clone()).await.unwrap();
        let to = link.local_address().unwrap();
        let friend = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        if known {
            friend.send_to(&heartbeat_bytes(1, 1), to).await.unwrap();
            link.recv().await;
        }
        let stop = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        let (stopped, mut rng) = (stop.clone(), ChaCha8Rng::seed_from_u64(1));
        let flood = std::thread::spawn(move || {
            let stranger = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
            let mut junk = [0; 280];
            let mut sent = 0_u64;
            while !stopped.load(std::sync::atomic::Ordering::Relaxed) {
                rng.fill_bytes(&mut junk);
                junk[0] = 0xFD;
                // As fast as it goes; what the socket has no room for is lost, which is its receiver's concern.
                sent += u64::from(stranger.send_to(&junk, to).is_ok());
            }
            sent
        });
        let started = clock.now();
        let (mut deadline, mut worst) = (started, Duration::ZERO);
        for _ in 0..25 {
            deadline = deadline + Duration::from_millis(20);
            // The worst case for the deadline: the flooded link is always asked first.
            tokio::select! {
                biased;
                frame = link.recv() => panic!("{frame:?}"),
                () = clock.sleep_until(deadline) => {}
            }
            worst = worst.max(clock.now().saturating_since(deadline));
        }
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        let sent = flood.join().unwrap();
        let seconds = clock.now().saturating_since(started).as_secs_f64();
        println!(
            "peer known: {known}; flood of {:.0} datagrams a second; 50 Hz deadline late by {:.2} ms at worst; {}",
            sent as f64 / seconds,
            worst.as_secs_f64() * 1e3,
            link.counters()
        );
        assert!(link.counters().received_bytes > 0);
    }
}
