//! A gate alone: what it lets in, turns away and sends for it, to the frame and the instant.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage as Common, RADIO_STATUS_DATA};
use veilwing::link::codec::Encoder;
use veilwing::link::gate::{Arrival, Gate, GateConfig};
use veilwing::link::signing::{Keeper, RADIO_STATUS_ID, Signing, timestamp};
use veilwing::link::{Envelope, Form, Frame, Key, Origin, RawFrame, Rejection, SigningConfig};
use veilwing::pair::wire::{
    MavMessage, VEILWING_CHALLENGE_DATA, VEILWING_COMMIT_DATA, VEILWING_RESPONSE_DATA,
};
use veilwing::time::{Instant, Utc};

use crate::common::*;

/// A record that nothing is put on.
#[derive(Debug)]
struct Stuck(u64);

impl Keeper for Stuck {
    fn keep(&mut self, _: u64) -> bool {
        false
    }

    fn kept(&self) -> u64 {
        self.0
    }

    fn close(&mut self, _: u64) {}
}

const YEAR: Duration = Duration::from_secs(365 * 86_400);
const ELSEWHERE: Origin =
    Origin::Address(SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1)), 66));

fn at_start() -> Utc {
    Utc { unix_us: SIGNED_UNIX_US }
}

fn signing(utc: Utc) -> Signing {
    let config = SigningConfig {
        key: Key::new(KEY),
        link_id: 0,
        state_file: "none".into(),
        unsigned_allowed: vec![RADIO_STATUS_ID],
    };
    Signing::with_keeper(config, Box::new(Stuck(timestamp(utc))), timestamp(utc))
}

/// Of system 1, to a peer of system 2.
fn gate<M: veilwing::link::dialogue::Dialogue>() -> Gate<M> {
    let config = GateConfig {
        peer_system: Some(2),
        open_to_anyone: true,
        accept_foreign: false,
        signing: Some(signing(at_start())),
    };
    let mut gate = Gate::new(config, at_start());
    gate.speak_as((1, 191));
    gate
}

/// The peer, its clock at `utc`, which only the number of its frames moves.
struct Peer {
    encoder: Encoder,
    signing: Signing,
    utc: Utc,
}

impl Peer {
    fn at(utc: Utc) -> Self {
        Self { encoder: Encoder::default(), signing: signing(utc), utc }
    }

    fn sign<M: mavlink::Message>(&mut self, message: &M) -> RawFrame {
        let mut raw = self.encoder.encode_for_signing((2, 191), message);
        self.signing.sign(&mut raw, self.utc).unwrap();
        RawFrame::V2(raw)
    }
}

fn commit() -> MavMessage {
    MavMessage::VEILWING_COMMIT(VEILWING_COMMIT_DATA { boot_id: 1, proposal: 1, slot: 0 })
}

fn challenge(peer: &Peer) -> MavMessage {
    MavMessage::VEILWING_CHALLENGE(VEILWING_CHALLENGE_DATA { nonce: 5, utc_us: peer.utc.unix_us })
}

fn admit<M: veilwing::link::dialogue::Dialogue>(
    gate: &mut Gate<M>,
    raw: &RawFrame,
    origin: Origin,
    now: Duration,
) -> Result<Option<Frame<M>>, Rejection> {
    gate.admit(raw, Arrival { origin, now: Instant::from_start(now), utc: at_start() + now })
}

fn replies<M: veilwing::link::dialogue::Dialogue>(gate: &mut Gate<M>) -> usize {
    std::iter::from_fn(|| gate.poll_reply()).count()
}

#[test]
fn spec_what_needs_no_signature_is_taken_from_where_the_peer_is_and_from_nowhere_else() {
    let mut gate = gate::<Common>();
    let raw = Encoder::default().encode((2, 68), &Common::RADIO_STATUS(RADIO_STATUS_DATA::DEFAULT));
    let raw = RawFrame::V2(raw);
    assert!(matches!(admit(&mut gate, &raw, Origin::Peer, Duration::ZERO), Ok(Some(_))));
    assert!(matches!(admit(&mut gate, &raw, ELSEWHERE, Duration::ZERO), Err(Rejection::Unsigned)));
}

#[test]
fn spec_what_was_signed_before_it_is_on_record_is_counted() {
    let mut gate = gate::<MavMessage>();
    for count in 0..3 {
        assert_eq!(gate.unrecorded(), count);
        gate.seal((1, 191), &commit(), at_start()).unwrap();
    }
}

#[test]
fn spec_an_answer_that_nobody_asked_for_is_turned_away() {
    let (mut gate, mut peer) = (gate::<MavMessage>(), Peer::at(at_start()));
    let answer = MavMessage::VEILWING_RESPONSE(VEILWING_RESPONSE_DATA { nonce: 5, utc_us: peer.utc.unix_us });
    let taken = admit(&mut gate, &peer.sign(&answer), Origin::Peer, Duration::ZERO);
    assert!(matches!(taken, Err(Rejection::Unasked)), "{taken:?}");
}

#[test]
fn spec_a_peer_of_another_time_is_asked_and_one_that_asks_is_named_and_not_asked_back() {
    for origin in [Origin::Peer, ELSEWHERE] {
        let (mut gate, mut peer) = (gate::<MavMessage>(), Peer::at(Utc { unix_us: SIGNED_UNIX_US / 2 }));
        let asks = peer.sign(&challenge(&peer));
        assert!(matches!(admit(&mut gate, &asks, origin, Duration::ZERO), Err(Rejection::TooOld)));
        assert_eq!(replies(&mut gate), 0, "{origin:?}: challenge for challenge would never end");
        let told = gate.poll_notice().map(|notice| notice.to_string()).unwrap_or_default();
        assert!(told.contains("its frames are turned away"), "{told:?}");
        let says = peer.sign(&commit());
        assert!(matches!(admit(&mut gate, &says, origin, Duration::ZERO), Err(Rejection::TooOld)));
        assert_eq!(replies(&mut gate), 1, "{origin:?}");
    }
}

#[test]
fn spec_a_replay_draws_a_challenge_to_where_the_peer_may_be_and_none_to_where_it_is() {
    for (origin, asked) in [(Origin::Peer, 0), (ELSEWHERE, 1)] {
        let (mut gate, mut peer) = (gate::<MavMessage>(), Peer::at(at_start()));
        let raw = peer.sign(&commit());
        assert!(matches!(admit(&mut gate, &raw, Origin::Peer, Duration::ZERO), Ok(Some(_))));
        assert!(matches!(admit(&mut gate, &raw, origin, Duration::ZERO), Err(Rejection::Replayed)));
        assert_eq!(replies(&mut gate), asked, "{origin:?}");
    }
}

#[test]
fn spec_an_address_is_asked_again_after_100_ms_and_the_peer_after_a_second() {
    let ms = Duration::from_millis;
    for (origin, pause) in [(Origin::Peer, ms(1000)), (ELSEWHERE, ms(100))] {
        let (mut gate, mut peer) = (gate::<MavMessage>(), Peer::at(Utc { unix_us: SIGNED_UNIX_US / 2 }));
        let asked = [ms(0), pause - ms(1), pause, pause + ms(1), pause * 2].map(|now| {
            admit(&mut gate, &peer.sign(&commit()), origin, now).unwrap_err();
            replies(&mut gate)
        });
        assert_eq!(asked, [1, 0, 1, 0, 1], "{origin:?}");
    }
}

/// Two years apart: a time that only shows in a signature is told once it has been refused for a second.
#[test]
fn spec_a_time_that_shows_in_a_signature_is_told_after_a_second() {
    let ms = Duration::from_millis;
    let (mut gate, mut peer) = (gate::<MavMessage>(), Peer::at(at_start() + YEAR * 2));
    let told = [ms(0), ms(999), ms(1000), ms(1500)].map(|now| {
        let refused = admit(&mut gate, &peer.sign(&commit()), Origin::Peer, now);
        assert!(matches!(refused, Err(Rejection::TooNew)), "{refused:?}");
        std::iter::from_fn(|| gate.poll_notice()).count()
    });
    assert_eq!(told, [0, 0, 1, 0]);
}

#[test]
fn spec_a_challenge_in_a_tunnel_goes_to_the_system_that_has_spoken() {
    let (mut gate, mut peer) = (gate::<Envelope>(), Peer::at(at_start()));
    let said = Envelope::new(Form::Tunnel { to_system: 1 }, (2, 191), 0, commit());
    admit(&mut gate, &peer.sign(&said), ELSEWHERE, Duration::ZERO).unwrap_err();
    let (origin, raw) = gate.poll_reply().unwrap();
    let Envelope::Tunnel { to: (to_system, _), .. } = raw.parse::<Envelope>().unwrap().message else {
        panic!()
    };
    assert_eq!((origin, to_system), (ELSEWHERE, 2));
}
