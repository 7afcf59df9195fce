//! A message of a private dialect in either of its two forms: as it is, or inside a TUNNEL message.
//!
//! An autopilot forwards only messages that it can parse (PX4) or knows the checksum of (ArduPilot), so a private
//! dialect, the pair's or the radio's, does not cross one. TUNNEL (385) does. Its payload is then the whole frame,
//! unsigned, that would have been sent otherwise: the largest, VEILWING_HELLO, has 127 bytes of TUNNEL's 128, so
//! nothing is ever split. The signature, if any, is the TUNNEL frame's.

use mavlink::dialects::ardupilotmega::TUNNEL_DATA;
use mavlink::error::ParserError;
use mavlink::{MAV_STX_V2, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, MessageData, consts};

use super::counters::Rejection;
use crate::pair::wire;
use crate::transmitter::wire as radio;

/// TUNNEL's payload type for a pair message; from the range above 32767 that is nobody's registered type.
pub const PAYLOAD_TYPE: u16 = 42_100;
/// Bytes of TUNNEL before its payload: type, target system and component, length.
const HEADER: usize = 5;
/// Bytes of TUNNEL's payload.
const ROOM: usize = 128;

/// Which form a message has on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// In frames of its own.
    Plain,
    /// In TUNNEL, addressed to all components of this system; 0: to every system.
    Tunnel {
        /// The peer's MAVLink system.
        to_system: u8,
    },
}

impl Form {
    /// The message of an envelope that came in this form.
    ///
    /// # Errors
    /// [`Rejection::OtherForm`].
    pub fn open<M>(self, envelope: Enclosed<M>) -> Result<M, Rejection> {
        match (self, envelope) {
            (Self::Plain, Enclosed::Plain(message))
            | (Self::Tunnel { .. }, Enclosed::Tunnel { message, .. }) => Ok(message),
            _ => Err(Rejection::OtherForm),
        }
    }
}

/// A dialect whose messages may ride in TUNNEL.
pub trait Tunnelled: Message {
    /// TUNNEL's payload type for it.
    const PAYLOAD_TYPE: u16;
    /// A message of it, to stand for any.
    const SAMPLE_ID: u32;
}

impl Tunnelled for wire::MavMessage {
    const PAYLOAD_TYPE: u16 = PAYLOAD_TYPE;
    const SAMPLE_ID: u32 = wire::VEILWING_HELLO_DATA::ID;
}

impl Tunnelled for radio::MavMessage {
    const PAYLOAD_TYPE: u16 = radio::TUNNEL_TYPE;
    const SAMPLE_ID: u32 = radio::VEILWING_RADIO_DATA::ID;
}

/// A message of the pair's and its form.
pub type Envelope = Enclosed<wire::MavMessage>;

/// A message of dialect `M` and the form in which it came or goes.
#[derive(Debug, Clone, PartialEq)]
pub enum Enclosed<M> {
    /// In a frame of its own.
    Plain(M),
    /// In TUNNEL.
    Tunnel {
        /// The addressed system and component; 0 for all.
        to: (u8, u8),
        /// Of the frame inside.
        header: MavHeader,
        /// What the frame inside says.
        message: M,
    },
}

impl<M> Enclosed<M> {
    /// `message` in `form`, to be sent from `(system, component)` with this sequence number inside, where there is an
    /// inside.
    #[must_use]
    pub fn new(form: Form, from: (u8, u8), sequence: u8, message: M) -> Self {
        match form {
            Form::Plain => Self::Plain(message),
            Form::Tunnel { to_system } => {
                let header = MavHeader { system_id: from.0.into(), component_id: from.1, sequence };
                Self::Tunnel { to: (to_system, 0), header, message }
            }
        }
    }

    /// The message, whatever its form.
    #[must_use]
    pub fn message(&self) -> &M {
        match self {
            Self::Plain(message) | Self::Tunnel { message, .. } => message,
        }
    }

    /// Whether it came in TUNNEL.
    #[must_use]
    pub fn is_tunnelled(&self) -> bool {
        matches!(self, Self::Tunnel { .. })
    }
}

/// The frame inside a TUNNEL's payload. One of our type that does not hold exactly one sound frame is unparsable.
fn unpack<M: Tunnelled>(payload: &[u8]) -> Result<Enclosed<M>, ParserError> {
    let id = TUNNEL_DATA::ID;
    let unsound = |actual| ParserError::InvalidPayloadSize { id, maximum: ROOM, actual };
    let mut whole = [0; HEADER + ROOM];
    let length = payload.len().min(whole.len());
    whole[..length].copy_from_slice(&payload[..length]);
    let [type_low, type_high, to_system, to_component, length, inside @ ..] = whole;
    if u16::from_le_bytes([type_low, type_high]) != M::PAYLOAD_TYPE {
        return Err(ParserError::UnknownMessage { id });
    }
    let length = usize::from(length);
    let bytes = inside.get(..length).filter(|bytes| bytes.first() == Some(&MAV_STX_V2));
    let mut frame = [0; consts::v2::FRAME_SIZE];
    frame[..length.min(ROOM)].copy_from_slice(bytes.ok_or(unsound(length))?);
    let raw = MAVLinkV2MessageRaw::from_bytes_unparsed(frame);
    let sound =
        raw.incompatibility_flags() == 0 && raw.raw_bytes().len() == length && raw.has_valid_crc::<M>();
    if !sound {
        return Err(unsound(length));
    }
    let header =
        MavHeader { system_id: raw.system_id(), component_id: raw.component_id(), sequence: raw.sequence() };
    let message = M::parse(MavlinkVersion::V2, raw.message_id(), raw.payload())?;
    Ok(Enclosed::Tunnel { to: (to_system, to_component), header, message })
}

/// Writes TUNNEL's payload around the frame of `message`; how many bytes that makes.
fn pack<M: Tunnelled>(to: (u8, u8), header: MavHeader, message: &M, bytes: &mut [u8]) -> usize {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message(header, message);
    let inside = raw.raw_bytes();
    let [type_low, type_high] = M::PAYLOAD_TYPE.to_le_bytes();
    // No message is longer than 127 bytes with its frame (a test holds the dialects to it).
    let length = u8::try_from(inside.len()).unwrap_or(u8::MAX);
    bytes[..HEADER].copy_from_slice(&[type_low, type_high, to.0, to.1, length]);
    bytes[HEADER..HEADER + inside.len()].copy_from_slice(inside);
    HEADER + inside.len()
}

impl<M: Tunnelled> Message for Enclosed<M> {
    fn message_id(&self) -> u32 {
        match self {
            Self::Plain(message) => message.message_id(),
            Self::Tunnel { .. } => TUNNEL_DATA::ID,
        }
    }

    fn message_name(&self) -> &'static str {
        match self {
            Self::Plain(message) => message.message_name(),
            Self::Tunnel { .. } => TUNNEL_DATA::NAME,
        }
    }

    fn target_system_id(&self) -> Option<u8> {
        match self {
            Self::Plain(message) => message.target_system_id(),
            Self::Tunnel { to, .. } => Some(to.0),
        }
    }

    fn target_component_id(&self) -> Option<u8> {
        match self {
            Self::Plain(message) => message.target_component_id(),
            Self::Tunnel { to, .. } => Some(to.1),
        }
    }

    fn target_system_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::Plain(message) => message.target_system_id_mut(),
            Self::Tunnel { to, .. } => Some(&mut to.0),
        }
    }

    fn target_component_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::Plain(message) => message.target_component_id_mut(),
            Self::Tunnel { to, .. } => Some(&mut to.1),
        }
    }

    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        match self {
            Self::Plain(message) => message.ser(version, bytes),
            Self::Tunnel { to, header, message } => {
                let length = pack(*to, *header, message, bytes);
                // MAVLink 2 cuts zeros off the end: those of the checksum inside, should it have any.
                bytes[..length].iter().rposition(|&byte| byte != 0).map_or(1, |last| last + 1)
            }
        }
    }

    fn parse(version: MavlinkVersion, id: u32, payload: &[u8]) -> Result<Self, ParserError> {
        if id == TUNNEL_DATA::ID { unpack(payload) } else { M::parse(version, id, payload).map(Self::Plain) }
    }

    fn message_id_from_name(name: &str) -> Option<u32> {
        let tunnel = (name == TUNNEL_DATA::NAME).then_some(TUNNEL_DATA::ID);
        tunnel.or_else(|| M::message_id_from_name(name))
    }

    fn default_message_from_id(id: u32) -> Option<Self> {
        if id == TUNNEL_DATA::ID {
            let message = M::default_message_from_id(M::SAMPLE_ID)?;
            return Some(Self::new(Form::Tunnel { to_system: 0 }, (0, 0), 0, message));
        }
        M::default_message_from_id(id).map(Self::Plain)
    }

    fn extra_crc(id: u32) -> u8 {
        if id == TUNNEL_DATA::ID { TUNNEL_DATA::EXTRA_CRC } else { M::extra_crc(id) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every message at its longest: no zero to cut off.
    fn longest(id: u32) -> Option<wire::MavMessage> {
        // Enums hold small numbers, and a valid one everywhere.
        wire::MavMessage::parse(MavlinkVersion::V2, id, &[1; 255]).ok()
    }

    #[test]
    fn prop_every_pair_message_fits_a_tunnel_whole() {
        let mut sizes = Vec::new();
        for &id in wire::MavMessage::all_ids() {
            let message = longest(id).unwrap();
            let envelope = Envelope::new(Form::Tunnel { to_system: 2 }, (1, 191), 255, message.clone());
            let mut bytes = [0; 255];
            let length = envelope.ser(MavlinkVersion::V2, &mut bytes);
            assert!(length <= HEADER + ROOM, "{} takes {length}", message.message_name());
            assert_eq!(
                Envelope::parse(MavlinkVersion::V2, 385, &bytes[..length]).ok(),
                Some(envelope.clone())
            );
            // A parser that restores the zeros that were cut sees the same.
            assert_eq!(Envelope::parse(MavlinkVersion::V2, 385, &bytes).ok(), Some(envelope));
            sizes.push((length - HEADER, message.message_name()));
        }
        assert_eq!(sizes.iter().max(), Some(&(127, "VEILWING_HELLO")));
    }

    #[test]
    fn spec_what_is_not_one_sound_frame_is_refused() {
        let message = longest(42_104).unwrap();
        let envelope = Envelope::new(Form::Tunnel { to_system: 2 }, (1, 191), 7, message);
        let mut good = [0; 255];
        let length = envelope.ser(MavlinkVersion::V2, &mut good);
        let parse = |bytes: &[u8]| Envelope::parse(MavlinkVersion::V2, 385, bytes);
        let changed = |at: usize, to: u8| {
            let mut bytes = good;
            bytes[at] = to;
            parse(&bytes)
        };
        assert!(parse(&good).is_ok());
        let others = |result| matches!(result, Err(ParserError::UnknownMessage { id: 385 }));
        assert!(others(changed(0, 0)) && others(changed(1, 0)) && others(parse(&[])), "another's type");
        let unsound = |result| matches!(result, Err(ParserError::InvalidPayloadSize { id: 385, .. }));
        for (at, to, why) in [
            (4, 0, "empty"),
            (4, 255, "longer than there is room"),
            (4, good[4] - 1, "cut short"),
            (4, good[4] + 1, "something behind the frame"),
            (HEADER, 0xFE, "MAVLink 1 inside"),
            (HEADER + 1, 0xFF, "a length that is a lie"),
            (HEADER + 2, 1, "a flag that promises a signature"),
            (HEADER + 8, 0xFF, "a message of another dialect"),
            (length - 1, !good[length - 1], "a checksum that is wrong"),
        ] {
            assert!(unsound(changed(at, to)), "{why}");
        }
    }
}
