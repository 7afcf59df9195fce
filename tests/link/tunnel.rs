//! The pair link in both its forms: what crosses, what is turned away and for which reason.

use mavlink::Message;
use mavlink::dialects::ardupilotmega::{MavMessage as Common, MavTunnelPayloadType, TUNNEL_DATA};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::net::UdpSocket;
use veilwing::link::LinkAddress;
use veilwing::link::codec::Encoder;
use veilwing::link::dialogue::Dialogue;
use veilwing::link::envelope::PAYLOAD_TYPE;
use veilwing::link::{
    Clock, Counters, Envelope, Form, Key, LinkConfig, MemoryEnd, PairLink, RawFrame, Rejection, SigningConfig,
};
use veilwing::pair::wire::{MavMessage, VEILWING_COMMIT_DATA};

use crate::common::{KEY, loopback, reasons};
use crate::tlog::directory;

const THROUGH: Form = Form::Tunnel { to_system: 1 };

fn commit(proposal: u32) -> MavMessage {
    MavMessage::VEILWING_COMMIT(VEILWING_COMMIT_DATA { boot_id: 1, proposal, slot: 3 })
}

fn proposal(message: &MavMessage) -> u32 {
    match message {
        MavMessage::VEILWING_COMMIT(commit) => commit.proposal,
        other => panic!("{other:?}"),
    }
}

/// A link of system 1 to system 2, and the other end by hand.
fn link(form: Form, signing: Option<SigningConfig>) -> (PairLink, MemoryEnd) {
    let (near, far) = MemoryEnd::pair();
    let config =
        LinkConfig { name: "pair".to_owned(), peer_system: Some(2), signing, ..LinkConfig::default() };
    (PairLink::in_memory(near, config, form, Clock::real()).unwrap(), far)
}

fn frame(form: Form, system: u8, message: MavMessage) -> Vec<u8> {
    let envelope = Envelope::new(form, (system, 191), 0, message);
    Encoder::default().encode((system, 191), &envelope).raw_bytes().to_vec()
}

/// A TUNNEL frame of system 2 with this payload, its checksum right.
fn tunnel(payload_type: u16, payload: &[u8]) -> Vec<u8> {
    let mut wire = vec![0; 5];
    wire[..2].copy_from_slice(&payload_type.to_le_bytes());
    wire[4] = u8::try_from(payload.len()).unwrap();
    wire.extend(payload);
    let mut frame = vec![0xFD, u8::try_from(wire.len()).unwrap(), 0, 0, 0, 2, 191, 0x81, 0x01, 0];
    frame.extend(wire);
    let crc = mavlink::calculate_crc(&frame[1..], Envelope::extra_crc(385));
    frame.extend(crc.to_le_bytes());
    frame
}

/// What `by` hears of `from`, whose socket may not have taken the datagram yet.
async fn heard(by: &mut PairLink, from: &mut PairLink) -> MavMessage {
    tokio::select! {
        frame = by.recv() => frame.message,
        frame = from.recv() => panic!("{frame:?}"),
    }
}

#[test]
fn val_tunnel_is_that_of_the_common_dialect() {
    // Where the crate can read the payload type at all: one that it knows, with our frame inside.
    let ours = frame(THROUGH, 2, commit(7));
    let inside = ours[15..ours.len() - 2].to_vec();
    let known = MavTunnelPayloadType::MAV_TUNNEL_PAYLOAD_TYPE_STORM32_RESERVED0;
    let raw = RawFrame::from_bytes(&tunnel(known as u16, &inside)).unwrap();
    assert!(raw.has_valid_crc::<Common>());
    let Common::TUNNEL(TUNNEL_DATA { payload, payload_length, payload_type, .. }) =
        raw.parse::<Common>().unwrap().message
    else {
        panic!("{raw:?}");
    };
    assert_eq!((payload_type, usize::from(payload_length)), (known, inside.len()));
    assert_eq!(payload[..inside.len()], inside);
    // The frame inside is one of the pair's dialect, addressed as the outer one is.
    let inner = RawFrame::from_bytes(&inside).unwrap();
    assert!(inner.has_valid_crc::<MavMessage>());
    assert_eq!(inner.parse::<MavMessage>().unwrap().message, commit(7));
    const { assert!(PAYLOAD_TYPE >= 32_768) };
    let raw = RawFrame::from_bytes(&ours).unwrap();
    assert!(raw.has_valid_crc::<Common>(), "an autopilot can forward it");
    assert_eq!(raw.parse::<Envelope>().unwrap().message.target_system_id(), Some(1));
}

#[tokio::test]
async fn prop_both_forms_carry_every_message_over_udp_signed() {
    for (form, back) in [(Form::Plain, Form::Plain), (THROUGH, Form::Tunnel { to_system: 2 })] {
        let directory = directory("tunnel-udp");
        let config = |name: &str, peer| LinkConfig {
            name: name.to_owned(),
            peer_system: Some(peer),
            signing: Some(SigningConfig {
                key: Key::new(KEY),
                link_id: 0,
                state_file: directory.join(name),
                unsigned_allowed: Vec::new(),
            }),
            ..LinkConfig::default()
        };
        let clock = Clock::real();
        let mut near =
            PairLink::open(LinkAddress::UdpIn(loopback(0)), config("near", 2), back, clock.clone())
                .await
                .unwrap();
        let port = near.local_address().unwrap().port();
        let mut far =
            PairLink::open(LinkAddress::UdpOut(loopback(port)), config("far", 1), form, clock).await.unwrap();
        // The listener has a name, and the caller proves that it is there.
        near.send((1, 191), &commit(0));
        far.send((2, 191), &commit(0));
        while !near.is_connected() {
            tokio::select! {
                biased;
                frame = near.recv() => panic!("{frame:?}"),
                frame = far.recv() => panic!("{frame:?}"),
                () = tokio::task::yield_now() => {}
            }
        }
        let messages =
            MavMessage::all_ids().iter().map(|id| MavMessage::default_message_from_id(*id).unwrap());
        // What is of the link itself it keeps.
        for message in messages.filter(|message| message.said().is_none()) {
            far.send((2, 191), &message);
            assert_eq!(heard(&mut near, &mut far).await, message, "{form:?}");
            near.send((1, 191), &message);
            assert_eq!(heard(&mut far, &mut near).await, message, "{form:?}");
        }
        assert_eq!(reasons(near.counters()), [(Rejection::Unproven, 1)]);
        assert_eq!(far.counters().rejected.total(), 0);
    }
}

#[tokio::test]
async fn spec_the_other_form_is_turned_away_and_teaches_no_address() {
    for (form, other) in [(Form::Plain, THROUGH), (THROUGH, Form::Plain)] {
        let config = LinkConfig { name: "pair".to_owned(), peer_system: Some(2), ..LinkConfig::default() };
        let mut link =
            PairLink::open(LinkAddress::UdpIn(loopback(0)), config, form, Clock::real()).await.unwrap();
        let to = link.local_address().unwrap();
        let [one, another] =
            [UdpSocket::bind("127.0.0.1:0").await.unwrap(), UdpSocket::bind("127.0.0.1:0").await.unwrap()];
        one.send_to(&frame(other, 2, commit(1)), to).await.unwrap();
        another.send_to(&frame(form, 2, commit(2)), to).await.unwrap();
        assert_eq!(proposal(&link.recv().await.message), 2);
        assert_eq!(reasons(link.counters()), [(Rejection::OtherForm, 1)]);
        link.send((1, 191), &commit(3));
        let mut datagram = [0; 300];
        let length = tokio::select! {
            received = another.recv(&mut datagram) => received.unwrap(),
            frame = link.recv() => panic!("{frame:?}"),
        };
        assert!(length > 0, "the answer goes to the right one");
        assert!(one.try_recv(&mut datagram).is_err());
    }
}

#[tokio::test]
async fn spec_what_is_in_a_tunnel_and_not_ours_is_counted_and_changes_nothing() {
    let (mut link, far) = link(THROUGH, None);
    let good = frame(THROUGH, 2, commit(1));
    let inside = &good[15..good.len() - 2];
    let mut flipped = inside.to_vec();
    flipped[12] ^= 1;
    let heartbeat = crate::common::heartbeat_bytes(2, 0);
    let cases: [(Vec<u8>, Rejection); 9] = [
        (tunnel(PAYLOAD_TYPE, &[]), Rejection::Unparsable),
        (tunnel(PAYLOAD_TYPE, &[0xFD]), Rejection::Unparsable),
        (tunnel(PAYLOAD_TYPE, &inside[..inside.len() - 1]), Rejection::Unparsable),
        (tunnel(PAYLOAD_TYPE, &flipped), Rejection::Unparsable),
        (tunnel(PAYLOAD_TYPE, &heartbeat), Rejection::Unparsable),
        (tunnel(PAYLOAD_TYPE, &[0xFF; 128]), Rejection::Unparsable),
        (tunnel(PAYLOAD_TYPE + 1, inside), Rejection::UnknownMessage),
        (tunnel(0, inside), Rejection::UnknownMessage),
        (frame(THROUGH, 3, commit(1)), Rejection::ForeignSystem),
    ];
    let mut expected = Counters::default();
    for (number, (datagram, reason)) in (2..).zip(cases) {
        assert!(far.send(datagram.clone()));
        assert!(far.send(frame(THROUGH, 2, commit(number))));
        assert_eq!(proposal(&link.recv().await.message), number, "{datagram:02x?}");
        expected.rejected.count(reason);
        assert_eq!(link.counters().rejected, expected.rejected, "{datagram:02x?}");
    }
}

#[tokio::test]
async fn prop_random_payloads_in_sound_tunnels_are_all_turned_away() {
    let (mut link, far) = link(THROUGH, None);
    let mut rng = ChaCha8Rng::seed_from_u64(385);
    let mut turned_away = 0;
    for round in 0..500 {
        for _ in 0..20 {
            let mut payload = vec![0; rng.random_range(0..=128)];
            rng.fill_bytes(&mut payload);
            if rng.random_bool(0.5) && payload.len() > 12 {
                // A head that promises a frame of the right length.
                payload[0] = 0xFD;
                payload[1] = u8::try_from(payload.len() - 12).unwrap();
                payload[2] = 0;
                payload[7..10].copy_from_slice(&rng.random_range(42_100_u32..42_111).to_le_bytes()[..3]);
            }
            assert!(far.send(tunnel(PAYLOAD_TYPE, &payload)));
            turned_away += 1;
        }
        assert!(far.send(frame(THROUGH, 2, commit(round))));
        assert_eq!(proposal(&link.recv().await.message), round);
    }
    assert_eq!(reasons(link.counters()), [(Rejection::Unparsable, turned_away)]);
}

#[tokio::test]
async fn spec_an_unsigned_tunnel_is_turned_away_where_a_key_is_configured() {
    let directory = directory("tunnel-unsigned");
    let signing = |name: &str| SigningConfig {
        key: Key::new(KEY),
        link_id: 0,
        state_file: directory.join(name),
        unsigned_allowed: Vec::new(),
    };
    let (mut near, far) = link(THROUGH, Some(signing("near")));
    assert!(far.send(frame(THROUGH, 2, commit(1))));
    let mut far = PairLink::in_memory(
        far,
        LinkConfig { peer_system: Some(1), signing: Some(signing("far")), ..LinkConfig::default() },
        Form::Tunnel { to_system: 1 },
        Clock::real(),
    )
    .unwrap();
    far.send((2, 191), &commit(2));
    assert_eq!(proposal(&near.recv().await.message), 2);
    assert_eq!(reasons(near.counters()), [(Rejection::Unsigned, 1)]);
}
