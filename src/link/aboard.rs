//! What is said on the link to everything aboard: the common dialect, and the radio's own message in either form.

use mavlink::dialects::ardupilotmega::{MavMessage, TUNNEL_DATA};
use mavlink::error::ParserError;
use mavlink::{MavlinkVersion, Message, MessageData};

use super::envelope::Enclosed;
use crate::transmitter::wire as radio;

/// A message on the autopilot's link.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "most are of the common dialect")]
pub enum Aboard {
    /// Of the common dialect.
    Common(MavMessage),
    /// The radio's: as it is, where the radio is on a wire of its own, or in TUNNEL, across an autopilot.
    Radio(Enclosed<radio::MavMessage>),
}

impl Message for Aboard {
    fn message_id(&self) -> u32 {
        match self {
            Self::Common(message) => message.message_id(),
            Self::Radio(message) => message.message_id(),
        }
    }

    fn message_name(&self) -> &'static str {
        match self {
            Self::Common(message) => message.message_name(),
            Self::Radio(message) => message.message_name(),
        }
    }

    fn target_system_id(&self) -> Option<u8> {
        match self {
            Self::Common(message) => message.target_system_id(),
            Self::Radio(message) => message.target_system_id(),
        }
    }

    fn target_component_id(&self) -> Option<u8> {
        match self {
            Self::Common(message) => message.target_component_id(),
            Self::Radio(message) => message.target_component_id(),
        }
    }

    fn target_system_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::Common(message) => message.target_system_id_mut(),
            Self::Radio(message) => message.target_system_id_mut(),
        }
    }

    fn target_component_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::Common(message) => message.target_component_id_mut(),
            Self::Radio(message) => message.target_component_id_mut(),
        }
    }

    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        match self {
            Self::Common(message) => message.ser(version, bytes),
            Self::Radio(message) => message.ser(version, bytes),
        }
    }

    /// A TUNNEL of another type than the radio's stays what it is.
    fn parse(version: MavlinkVersion, id: u32, payload: &[u8]) -> Result<Self, ParserError> {
        let radio = matches!(id, TUNNEL_DATA::ID | radio::VEILWING_RADIO_DATA::ID);
        match radio.then(|| Enclosed::parse(version, id, payload)) {
            None | Some(Err(ParserError::UnknownMessage { .. })) => {
                MavMessage::parse(version, id, payload).map(Self::Common)
            }
            Some(found) => found.map(Self::Radio),
        }
    }

    fn message_id_from_name(name: &str) -> Option<u32> {
        let radio = radio::MavMessage::message_id_from_name(name);
        radio.or_else(|| MavMessage::message_id_from_name(name))
    }

    fn default_message_from_id(id: u32) -> Option<Self> {
        let radio = radio::MavMessage::default_message_from_id(id);
        let radio = radio.map(|message| Self::Radio(Enclosed::Plain(message)));
        radio.or_else(|| MavMessage::default_message_from_id(id).map(Self::Common))
    }

    fn extra_crc(id: u32) -> u8 {
        if id == radio::VEILWING_RADIO_DATA::ID {
            radio::VEILWING_RADIO_DATA::EXTRA_CRC
        } else {
            MavMessage::extra_crc(id)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::codec::{Decoder, Encoder};
    use crate::link::{Counters, Form};
    use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavTunnelPayloadType};

    fn read(frame: &[u8]) -> Option<Aboard> {
        let (mut decoder, mut counters) = (Decoder::<Aboard>::default(), Counters::default());
        decoder.feed(frame);
        decoder.end();
        decoder.next_frame(&mut counters)?.parse().ok().map(|frame| frame.message)
    }

    #[test]
    fn spec_the_radio_is_understood_in_either_form_and_everything_else_is_as_before() {
        let report = radio::VEILWING_RADIO_DATA {
            time_ms: 0xF000_0001,
            boot: 7,
            newest: 9,
            answers_boot: 7,
            answers: 8,
            series: 12,
            expires_ms: 44,
            power_mdbm: i32::MIN,
            result: radio::VeilwingRadioResult::VEILWING_RADIO_RESULT_NOT_NEWER,
        };
        let report = radio::MavMessage::VEILWING_RADIO(report);
        for form in [Form::Plain, Form::Tunnel { to_system: 1 }] {
            let envelope = Enclosed::new(form, (1, 68), 3, report.clone());
            let message = Aboard::Radio(envelope);
            let raw = Encoder::default().encode((1, 68), &message);
            assert_eq!(read(raw.raw_bytes()), Some(message), "{form:?}");
        }
        let mut other = TUNNEL_DATA::DEFAULT;
        other.payload_type = MavTunnelPayloadType::MAV_TUNNEL_PAYLOAD_TYPE_STORM32_RESERVED0;
        for common in [MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT), MavMessage::TUNNEL(other)] {
            let message = Aboard::Common(common);
            let raw = Encoder::default().encode((1, 1), &message);
            assert_eq!(read(raw.raw_bytes()), Some(message));
        }
    }
}
