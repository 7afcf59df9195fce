//! Bytes to frames and back. Pure: no clock, no socket.

use std::collections::BTreeMap;
use std::marker::PhantomData;

use mavlink::{MAV_STX, MAV_STX_V2, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, consts};

use super::counters::{Counters, Rejection};
use super::frame::RawFrame;

/// Finds the frames of dialect `M`, MAVLink 1 and 2, in a stream of bytes or in datagrams.
///
/// Only a frame whose checksum is right moves the search past its end. From anything else it moves on by one
/// byte, so noise never swallows a frame that follows or is inside it. A start byte in noise is unmasked by
/// its header (flags, message id, MAVLink 1 length) rather than by its checksum, so that noise does not hold
/// up the frame behind it either. The price: bytes of an unknown message are searched like noise.
#[derive(Debug, Clone)]
pub struct Decoder<M> {
    buffer: Vec<u8>,
    start: usize,
    ended: bool,
    dialect: PhantomData<fn() -> M>,
}

impl<M> Default for Decoder<M> {
    fn default() -> Self {
        Self { buffer: Vec::new(), start: 0, ended: false, dialect: PhantomData }
    }
}

#[allow(clippy::large_enum_variant, reason = "it lives for one look")]
enum Verdict {
    Frame(RawFrame),
    Incomplete,
    Noise,
    Rejected(Rejection),
}

impl<M: Message> Decoder<M> {
    /// Takes the next bytes of a stream, or a part of a datagram. What is held afterwards is what `bytes` add
    /// to at most one frame, if [`Self::next_frame`] was called until it returned `None`.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.start);
        self.start = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// Says that the datagram or the connection ends here: what is held will not be completed.
    pub fn end(&mut self) {
        self.ended = true;
    }

    /// The next frame whose checksum is right, or `None` until more is fed. Counts what it passes over.
    pub fn next_frame(&mut self, counters: &mut Counters) -> Option<RawFrame> {
        while let Some(held) = self.buffer.get(self.start..).filter(|held| !held.is_empty()) {
            let rejection = match examine::<M>(held) {
                Verdict::Frame(frame) => {
                    self.start += frame.bytes().len();
                    return Some(frame);
                }
                Verdict::Incomplete if !self.ended => return None,
                Verdict::Incomplete => Some(Rejection::Truncated),
                Verdict::Rejected(reason) => Some(reason),
                Verdict::Noise => None,
            };
            if let Some(reason) = rejection {
                counters.rejected.count(reason);
            }
            counters.noise_bytes += 1;
            self.start += 1;
        }
        self.ended = false;
        None
    }
}

/// What `held`, which is not empty, starts with.
fn examine<M: Message>(held: &[u8]) -> Verdict {
    let length = match held[0] {
        MAV_STX => frame_length_v1::<M>(held),
        MAV_STX_V2 => frame_length_v2::<M>(held),
        _ => return Verdict::Noise,
    };
    match length {
        Err(reason) => Verdict::Rejected(reason),
        Ok(None) => Verdict::Incomplete,
        Ok(Some(length)) => match held.get(..length) {
            None => Verdict::Incomplete,
            Some(bytes) => match RawFrame::from_bytes(bytes) {
                Some(frame) if frame.has_valid_crc::<M>() => Verdict::Frame(frame),
                _ => Verdict::Rejected(Rejection::BadCrc),
            },
        },
    }
}

/// The frame's length if enough of the header is there to tell.
fn frame_length_v1<M: Message>(held: &[u8]) -> Result<Option<usize>, Rejection> {
    const MESSAGE_ID_AT: usize = 5;
    let (Some(&payload), Some(&id)) = (held.get(consts::PAYLOAD_LEN_OFFSET), held.get(MESSAGE_ID_AT)) else {
        return Ok(None);
    };
    let message = M::default_message_from_id(id.into()).ok_or(Rejection::UnknownMessage)?;
    // MAVLink 1 has neither extensions nor cut zeros: a message has one length.
    if message.ser(MavlinkVersion::V1, &mut [0; consts::MAX_PAYLOAD_LEN]) != usize::from(payload) {
        return Err(Rejection::WrongLength);
    }
    let header = consts::STX_SIZE + consts::v1::HEADER_SIZE;
    Ok(Some(header + usize::from(payload) + consts::CHECKSUM_SIZE))
}

/// The frame's length if enough of the header is there to tell.
fn frame_length_v2<M: Message>(held: &[u8]) -> Result<Option<usize>, Rejection> {
    let Some(&flags) = held.get(consts::v2::INCOMPAT_FLAGS_OFFSET) else { return Ok(None) };
    if flags & !consts::v2::SUPPORTED_IFLAGS != 0 {
        return Err(Rejection::UnknownFlags);
    }
    let mut header = consts::STX_SIZE + consts::v2::MIN_HEADER_SIZE;
    if flags & consts::v2::IFLAG_SYSID32 != 0 {
        header += consts::v2::SYSID32_EXTRA_HEADER_SIZE;
    }
    let Some(&[a, b, c]) = held.get(header - 3..header) else { return Ok(None) };
    let id = u32::from_le_bytes([a, b, c, 0]);
    // The extra byte is 0 for what the dialect does not know, and for a few that it knows.
    if M::extra_crc(id) == 0 && M::default_message_from_id(id).is_none() {
        return Err(Rejection::UnknownMessage);
    }
    let signature = if flags & consts::v2::IFLAG_SIGNED == 0 { 0 } else { consts::v2::SIGNATURE_SIZE };
    let payload = usize::from(held[consts::PAYLOAD_LEN_OFFSET]);
    Ok(Some(header + payload + consts::CHECKSUM_SIZE + signature))
}

/// Writes MAVLink 2 frames, with a sequence of its own for each (system, component) that speaks.
#[derive(Debug, Clone, Default)]
pub struct Encoder {
    sequences: BTreeMap<(u8, u8), u8>,
}

impl Encoder {
    /// The frame that says `message`, from `(system, component)`, unsigned.
    pub fn encode<M: Message>(&mut self, from: (u8, u8), message: &M) -> MAVLinkV2MessageRaw {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(self.next_header(from), message);
        raw
    }

    /// The same, with room for a signature that [`super::signing::Signing::sign`] fills in.
    pub fn encode_for_signing<M: Message>(&mut self, from: (u8, u8), message: &M) -> MAVLinkV2MessageRaw {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_for_signing(self.next_header(from), message);
        raw
    }

    fn next_header(&mut self, from: (u8, u8)) -> MavHeader {
        let next = self.sequences.entry(from).or_default();
        let sequence = *next;
        *next = next.wrapping_add(1);
        MavHeader { system_id: from.0.into(), component_id: from.1, sequence }
    }
}
