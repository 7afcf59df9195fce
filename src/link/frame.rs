//! One MAVLink frame: its bytes, and what they mean in a dialect.

use mavlink::error::ParserError;
use mavlink::{
    MAV_STX, MAV_STX_V2, MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message, consts,
};

use super::counters::Rejection;

/// The fields in which zero says "not known": message id, the crate's name of the enum, offset in the payload.
/// A value newer than the dialect is read as zero there, because losing a HEARTBEAT, or the state of the
/// battery, over a vehicle type of tomorrow would be worse. Nowhere else: a COMMAND_ACK's zero is "accepted".
const NEUTRAL_ZERO: &[(u32, &str, usize)] = &[
    (0, "MavType", 4), // HEARTBEAT
    (0, "MavAutopilot", 5),
    (0, "MavState", 7),
    (24, "GpsFixType", 28),          // GPS_RAW_INT
    (147, "MavBatteryFunction", 33), // BATTERY_STATUS
    (147, "MavBatteryType", 34),
    (147, "MavBatteryChargeState", 40),
    (147, "MavBatteryMode", 49),
    (245, "MavVtolState", 0), // EXTENDED_SYS_STATE
    (245, "MavLandedState", 1),
];

/// The bytes of a whole frame whose checksum is right, or of one to be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawFrame {
    /// MAVLink 1.
    V1(MAVLinkV1MessageRaw),
    /// MAVLink 2.
    V2(MAVLinkV2MessageRaw),
}

impl RawFrame {
    /// The frame that `bytes` hold from first to last, its checksum not yet verified. `None` if they hold
    /// anything less or more, or a frame with incompatibility flags unknown to the crate.
    #[must_use]
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let raw = match *bytes.first()? {
            MAV_STX => {
                let mut buffer = [0; consts::v1::FRAME_SIZE];
                buffer.get_mut(..bytes.len())?.copy_from_slice(bytes);
                Self::V1(MAVLinkV1MessageRaw::from_bytes_unparsed(buffer))
            }
            MAV_STX_V2 => {
                let mut buffer = [0; consts::v2::FRAME_SIZE];
                buffer.get_mut(..bytes.len())?.copy_from_slice(bytes);
                let raw = MAVLinkV2MessageRaw::from_bytes_unparsed(buffer);
                if raw.incompatibility_flags() & !consts::v2::SUPPORTED_IFLAGS != 0 {
                    return None;
                }
                Self::V2(raw)
            }
            _ => return None,
        };
        (raw.bytes().len() == bytes.len()).then_some(raw)
    }

    /// The frame as it is on the wire.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::V1(raw) => raw.raw_bytes(),
            Self::V2(raw) => raw.raw_bytes(),
        }
    }

    /// Who sent it, and its place in the sender's sequence.
    #[must_use]
    pub fn header(&self) -> MavHeader {
        match self {
            Self::V1(raw) => MavHeader {
                system_id: raw.system_id().into(),
                component_id: raw.component_id(),
                sequence: raw.sequence(),
            },
            Self::V2(raw) => MavHeader {
                system_id: raw.system_id(),
                component_id: raw.component_id(),
                sequence: raw.sequence(),
            },
        }
    }

    /// The message's number in its dialect.
    #[must_use]
    pub fn message_id(&self) -> u32 {
        match self {
            Self::V1(raw) => raw.message_id().into(),
            Self::V2(raw) => raw.message_id(),
        }
    }

    /// Whether it carries a signature, true or false.
    #[must_use]
    pub fn is_signed(&self) -> bool {
        match self {
            Self::V1(_) => false,
            Self::V2(raw) => raw.incompatibility_flags() & consts::v2::IFLAG_SIGNED != 0,
        }
    }

    /// Whether the checksum is that of the message in dialect `M`.
    #[must_use]
    pub fn has_valid_crc<M: Message>(&self) -> bool {
        match self {
            Self::V1(raw) => raw.has_valid_crc::<M>(),
            Self::V2(raw) => raw.has_valid_crc::<M>(),
        }
    }

    /// The same frame without its signature, with the checksum that it would have had: what logs keep.
    #[must_use]
    pub fn without_signature<M: Message>(&self) -> Self {
        let Self::V2(signed) = self else { return *self };
        let mut raw = *signed;
        *raw.incompatibility_flags_mut() &= !consts::v2::IFLAG_SIGNED;
        let crc_at = raw.raw_bytes().len() - consts::CHECKSUM_SIZE;
        let crc =
            mavlink::calculate_crc(&raw.as_slice()[consts::STX_SIZE..crc_at], M::extra_crc(raw.message_id()));
        let tail = &mut raw.as_mut_slice()[crc_at..];
        tail.fill(0);
        tail[..consts::CHECKSUM_SIZE].copy_from_slice(&crc.to_le_bytes());
        Self::V2(raw)
    }

    /// Reads the message in dialect `M`.
    ///
    /// # Errors
    /// The reason why it cannot be read.
    pub fn parse<M: Message>(&self) -> Result<Frame<M>, Rejection> {
        let (version, wire_payload) = match self {
            Self::V1(raw) => (MavlinkVersion::V1, raw.payload()),
            Self::V2(raw) => (MavlinkVersion::V2, raw.payload()),
        };
        // MAVLink 2 cuts trailing zeros; the buffer restores them, so that an offset means a field.
        let mut payload = [0; consts::MAX_PAYLOAD_LEN];
        payload[..wire_payload.len()].copy_from_slice(wire_payload);
        let id = self.message_id();
        let mut neutralised = false;
        loop {
            match M::parse(version, id, &payload) {
                Ok(message) => {
                    let signed = self.is_signed();
                    return Ok(Frame { header: self.header(), message, signed, neutralised, raw: *self });
                }
                Err(ParserError::InvalidEnum { enum_type, .. }) => {
                    let field = NEUTRAL_ZERO.iter().find(|&&(of, name, _)| of == id && name == enum_type);
                    let Some(&(_, _, offset)) = field.filter(|field| payload[field.2] != 0) else {
                        return Err(Rejection::UnknownEnum);
                    };
                    payload[offset] = 0;
                    neutralised = true;
                }
                Err(ParserError::UnknownMessage { .. }) => return Err(Rejection::UnknownMessage),
                Err(ParserError::InvalidPayloadSize { .. } | ParserError::BytesError(_)) => {
                    return Err(Rejection::Unparsable);
                }
            }
        }
    }
}

/// A frame understood.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame<M> {
    /// Who sent it. A system id above 255 cannot be answered to (MAVLink 2 with 32-bit system ids).
    pub header: MavHeader,
    /// What it says.
    pub message: M,
    /// Whether it carried a signature; verified, if the link that yielded it has a key.
    pub signed: bool,
    /// Whether an enum value unknown to the dialect was read as the field's neutral one.
    pub neutralised: bool,
    /// The bytes as they came.
    pub raw: RawFrame,
}
