//! Frames and messages of any content, their checksums right.

use arbitrary::Unstructured;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavlinkVersion, Message};

/// What an autopilot, a ground station or a radio says to a companion, in the common dialect.
pub const HEARD: &[u32] = &[
    0, 1, 2, 20, 21, 22, 23, 24, 31, 32, 33, 49, 69, 75, 76, 77, 109, 110, 111, 147, 148, 193, 230, 242, 245,
    253, 322, 323, 324, 385,
];

/// A MAVLink 2 frame from `(system, component)`, unsigned.
#[must_use]
pub fn frame_v2<M: Message>(from: (u8, u8), sequence: u8, id: u32, payload: &[u8]) -> Vec<u8> {
    let payload = &payload[..payload.len().min(255)];
    let [a, b, c, _] = id.to_le_bytes();
    let mut frame = vec![0xFD, payload.len() as u8, 0, 0, sequence, from.0, from.1, a, b, c];
    frame.extend_from_slice(payload);
    let crc = mavlink::calculate_crc(&frame[1..], M::extra_crc(id));
    frame.extend(crc.to_le_bytes());
    frame
}

/// A MAVLink 1 frame.
#[must_use]
pub fn frame_v1<M: Message>(from: (u8, u8), sequence: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let payload = &payload[..payload.len().min(255)];
    let mut frame = vec![0xFE, payload.len() as u8, sequence, from.0, from.1, id];
    frame.extend_from_slice(payload);
    let crc = mavlink::calculate_crc(&frame[1..], M::extra_crc(id.into()));
    frame.extend(crc.to_le_bytes());
    frame
}

/// The payload of a TUNNEL of this type with `inside`.
#[must_use]
pub fn tunnel(payload_type: u16, inside: &[u8]) -> Vec<u8> {
    let inside = &inside[..inside.len().min(128)];
    let mut payload = payload_type.to_le_bytes().to_vec();
    payload.extend([0, 0, inside.len() as u8]);
    payload.extend_from_slice(inside);
    payload
}

/// A message of the common dialect with any content, if the next bytes make one.
///
/// # Errors
/// When the bytes are used up.
pub fn message(u: &mut Unstructured<'_>) -> arbitrary::Result<Option<MavMessage>> {
    let id = match u.arbitrary::<u8>()? {
        known if usize::from(known) < 4 * HEARD.len() => HEARD[usize::from(known) % HEARD.len()],
        _ => u.arbitrary::<u16>()?.into(),
    };
    let mut payload = [0; 255];
    let given = bytes(u)?;
    payload[..given.len().min(255)].copy_from_slice(&given[..given.len().min(255)]);
    Ok(MavMessage::parse(MavlinkVersion::V2, id, &payload).ok())
}

/// So many bytes as a first one says.
///
/// # Errors
/// When the bytes are used up.
pub fn bytes<'a>(u: &mut Unstructured<'a>) -> arbitrary::Result<&'a [u8]> {
    let length = usize::from(u.arbitrary::<u8>()?);
    u.bytes(length.min(u.len()))
}
