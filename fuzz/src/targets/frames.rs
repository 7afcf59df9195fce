//! Bytes to frames to messages and back, in all three dialects, in TUNNEL and out of it.

use arbitrary::Unstructured;
use mavlink::Message;
use mavlink::dialects::ardupilotmega::MavMessage;
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::envelope::PAYLOAD_TYPE;
use veilwing::link::{Aboard, Counters, Envelope, RawFrame, Rejection};
use veilwing::transmitter::wire::TUNNEL_TYPE;

use crate::reached::Reached;
use crate::target::Target;
use crate::wire::{bytes, frame_v1, frame_v2, tunnel};

/// The decoder of frames.
pub const TARGET: Target = Target {
    name: "frames",
    what: "bytes, framed or not, to the decoders of the autopilot's link, the pair's and the common dialect",
    words: &[],
    seeds,
    run,
    generated: 20_000,
};

const RADIO: u32 = 42_120;
const TUNNEL: u32 = 385;

fn seeds() -> Vec<Vec<u8>> {
    let kinds = 0..9_u8;
    let mut all: Vec<Vec<u8>> = kinds.map(|kind| [&[kind, 9, 30][..], &[7; 30], &[0; 40]].concat()).collect();
    all.push(frame_v2::<MavMessage>((1, 1), 7, 0, &[1, 2, 3, 4, 2, 12, 81, 4, 3]));
    all
}

/// The bytes that an input stands for: raw ones, and frames of which it gives the contents.
fn stream(u: &mut Unstructured<'_>) -> arbitrary::Result<Vec<u8>> {
    let mut stream = Vec::new();
    while !u.is_empty() {
        let kind = u.arbitrary::<u8>()? % 9;
        let id: u8 = u.arbitrary()?;
        let payload = bytes(u)?;
        let from = (1 + id % 2, 1);
        let pair = 42_100 + u32::from(id % 11);
        let frame = match kind {
            0 => payload.to_vec(),
            1 => frame_v2::<Aboard>(from, id, id.into(), payload),
            2 => frame_v1::<Aboard>(from, id, id, payload),
            3 => frame_v2::<Envelope>(from, id, pair, payload),
            4 => frame_v2::<Aboard>(from, id, RADIO, payload),
            5 => {
                let inside = frame_v2::<Envelope>(from, id, pair, &payload[..payload.len().min(116)]);
                frame_v2::<Envelope>(from, id, TUNNEL, &tunnel(PAYLOAD_TYPE, &inside))
            }
            6 => {
                let inside = frame_v2::<Aboard>(from, id, RADIO, &payload[..payload.len().min(116)]);
                frame_v2::<Aboard>(from, id, TUNNEL, &tunnel(TUNNEL_TYPE, &inside))
            }
            7 => frame_v2::<Aboard>(from, id, TUNNEL, payload),
            // Any flags, a system id of 32 bits and a signature among them.
            _ => {
                let mut frame = frame_v2::<Aboard>(from, 0, 0, payload);
                frame[2] = id;
                let end = frame.len() - 2;
                let crc = mavlink::calculate_crc(&frame[1..end], MavMessage::extra_crc(0));
                frame[end..].copy_from_slice(&crc.to_le_bytes());
                frame.extend([id; 13]);
                frame
            }
        };
        stream.extend(frame);
    }
    Ok(stream)
}

fn run(input: &[u8], reached: &mut Reached) {
    let mut u = Unstructured::new(input);
    let Ok(stream) = stream(&mut u) else { return };
    check::<MavMessage>("common", input, reached);
    check::<Aboard>("aboard", &stream, reached);
    check::<Envelope>("pair", &stream, reached);
    check::<MavMessage>("common", &stream, reached);
}

/// Finds the frames of a stream, whole and cut, and the messages in them.
fn check<M: Message + std::fmt::Debug>(dialect: &str, stream: &[u8], reached: &mut Reached) {
    let mut counters = Counters::default();
    let whole = decode::<M>(&[stream], &mut counters);
    let in_frames: usize = whole.iter().map(|raw| raw.bytes().len()).sum();
    assert_eq!(counters.noise_bytes, (stream.len() - in_frames) as u64, "each byte is a frame's or noise");
    // However the bytes come, the same frames are in them.
    let pieces: Vec<&[u8]> =
        stream.chunks(1 + usize::from(stream.first().copied().unwrap_or_default())).collect();
    let mut cut_counters = Counters::default();
    assert_eq!(decode::<M>(&pieces, &mut cut_counters), whole);
    assert_eq!(cut_counters.rejected, counters.rejected);
    for reason in Rejection::ALL {
        reached.count(&format!("{dialect} {reason:?}"), counters.rejected.get(*reason));
    }
    for raw in &whole {
        assert_eq!(RawFrame::from_bytes(raw.bytes()).as_ref(), Some(raw));
        let unsigned = raw.without_signature::<M>();
        assert!(!unsigned.is_signed() && unsigned.has_valid_crc::<M>(), "{raw:?}");
        match raw.parse::<M>() {
            Err(reason) => reached.note(format_args!("{dialect} {} {reason:?}", raw.message_id())),
            Ok(frame) => {
                let form = (frame.signed, frame.neutralised, matches!(raw, RawFrame::V1(_)));
                reached.note(format_args!("{dialect} {} {form:?}", frame.message.message_name()));
                says_the_same_again(&frame.message);
            }
        }
    }
}

fn decode<M: Message>(pieces: &[&[u8]], counters: &mut Counters) -> Vec<RawFrame> {
    let mut decoder = Decoder::<M>::default();
    let mut frames = Vec::new();
    for piece in pieces {
        decoder.feed(piece);
        frames.extend(std::iter::from_fn(|| decoder.next_frame(counters)));
    }
    decoder.end();
    frames.extend(std::iter::from_fn(|| decoder.next_frame(counters)));
    frames
}

/// What is written of a message reads back as what is written: compared as bytes, for a NaN is not itself.
fn says_the_same_again<M: Message + std::fmt::Debug>(message: &M) {
    let written = Encoder::default().encode((1, 1), message);
    let again = RawFrame::V2(written).parse::<M>();
    assert!(again.is_ok(), "{message:?} is written as {again:?}");
    let Ok(again) = again else { return };
    assert_eq!(
        Encoder::default().encode((1, 1), &again.message).raw_bytes(),
        written.raw_bytes(),
        "{message:?}"
    );
}
