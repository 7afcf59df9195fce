//! Fake radios whose power is a MAVLink parameter: as OpenHD's and mLRS's sources have theirs, encoded here by hand.

use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamExtType, MavParamType, PARAM_EXT_ACK_DATA, PARAM_EXT_VALUE_DATA, PARAM_VALUE_DATA,
    ParamAck,
};
use mavlink::types::CharArray;
use tokio::net::UdpSocket;

use super::bench::{Answer, Bench, Dead, Request};
use super::kind::Kind;
use crate::link::Aboard;
use crate::link::codec::{Decoder, Encoder};
use crate::link::counters::Counters;

/// Where a fake radio is in MAVLink, and what its parameter is.
pub(super) struct Parameter {
    pub own: (u8, u8),
    pub name: &'static str,
    /// As the radio file has it.
    pub protocol: &'static str,
}

/// The one of such a radio.
pub(super) fn parameter(kind: Kind) -> Parameter {
    match kind {
        Kind::ParameterBytewise => Parameter { own: (51, 68), name: "TX_POWER", protocol: "bytewise" },
        _ => Parameter { own: (101, 191), name: "TX_POWER_I", protocol: "ext" },
    }
}

/// Answers each message when what it asks for is done.
pub(super) async fn serve(socket: &UdpSocket, bench: &Bench) {
    let (mut frames, mut counters, mut encoder) =
        (Decoder::<Aboard>::default(), Counters::default(), Encoder::default());
    let own = parameter(bench.kind()).own;
    let mut datagram = [0; 2048];
    while let Ok((length, from)) = socket.recv_from(&mut datagram).await {
        frames.feed(&datagram[..length]);
        frames.end();
        while let Some(raw) = frames.next_frame(&mut counters) {
            let Ok(Aboard::Common(message)) = raw.parse::<Aboard>().map(|frame| frame.message) else {
                continue;
            };
            let answer = match answer(&message, bench).await {
                Ok(Some(answer)) => Aboard::Common(answer),
                Ok(None) => continue,
                Err(Dead) => return,
            };
            // What cannot be sent is lost.
            let _ = socket.send_to(encoder.encode(own, &answer).raw_bytes(), from).await;
        }
    }
}

async fn answer(message: &MavMessage, bench: &Bench) -> Result<Option<MavMessage>, Dead> {
    let Parameter { own, name, .. } = parameter(bench.kind());
    let to_us = |to: (u8, u8), id: &CharArray<16>| to == own && id.to_str() == Ok(name);
    let set = match (message, bench.kind()) {
        (MavMessage::PARAM_EXT_REQUEST_READ(m), Kind::Parameter)
            if to_us((m.target_system, m.target_component), &m.param_id) =>
        {
            None
        }
        (MavMessage::PARAM_EXT_SET(m), Kind::Parameter)
            if to_us((m.target_system, m.target_component), &m.param_id) =>
        {
            let mut bytes = [0; 4];
            bytes.copy_from_slice(&m.param_value[..4]);
            Some(f64::from(i32::from_le_bytes(bytes)))
        }
        (MavMessage::PARAM_REQUEST_READ(m), Kind::ParameterBytewise)
            if to_us((m.target_system, m.target_component), &m.param_id) =>
        {
            None
        }
        // The first byte of the float is the integer.
        (MavMessage::PARAM_SET(m), Kind::ParameterBytewise)
            if to_us((m.target_system, m.target_component), &m.param_id) =>
        {
            Some(f64::from(m.param_value.to_le_bytes()[0]))
        }
        _ => return Ok(None),
    };
    let (became, setting, _) = bench.obey(Ok(set.map_or(Request::Setting, Request::Set))).await?;
    if became == Answer::Garbage {
        // What cannot be understood is no message.
        return Ok(None);
    }
    let param_id = name.into();
    Ok(Some(match (bench.kind(), set) {
        (Kind::Parameter, set) => {
            let mut value = [0; 128];
            value[..4].copy_from_slice(&(setting as i32).to_le_bytes());
            let (param_value, param_type) = (value.into(), MavParamExtType::MAV_PARAM_EXT_TYPE_INT32);
            let param_result = match became {
                Answer::Refused => ParamAck::PARAM_ACK_VALUE_UNSUPPORTED,
                _ => ParamAck::PARAM_ACK_ACCEPTED,
            };
            match set {
                Some(_) => MavMessage::PARAM_EXT_ACK(PARAM_EXT_ACK_DATA {
                    param_id,
                    param_value,
                    param_type,
                    param_result,
                }),
                None => MavMessage::PARAM_EXT_VALUE(PARAM_EXT_VALUE_DATA {
                    param_count: 1,
                    param_index: 0,
                    param_id,
                    param_value,
                    param_type,
                }),
            }
        }
        _ => MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: f32::from_le_bytes([setting as u8, 0, 0, 0]),
            param_count: 1,
            param_index: 0,
            param_id,
            param_type: MavParamType::MAV_PARAM_TYPE_UINT8,
        }),
    }))
}
