//! MAVLink FTP, of which this autopilot has nothing but the manners: a ground station that asks for a file (MAVProxy
//! begins with the parameters' file) must hear that there is none, or it waits for it.
//! <https://mavlink.io/en/services/ftp.html>

use mavlink::dialects::ardupilotmega::{FILE_TRANSFER_PROTOCOL_DATA, MavMessage};

use super::super::router::{Router, Sender, To};
use super::{Autopilot, COMPONENT};

const TERMINATE_SESSION: u8 = 1;
const RESET_SESSIONS: u8 = 2;
const LIST_DIRECTORY: u8 = 3;
const OPEN_FILE_READ_ONLY: u8 = 4;
const ACK: u8 = 128;
const NAK: u8 = 129;
const UNKNOWN_COMMAND: u8 = 7;
const FILE_NOT_FOUND: u8 = 10;

impl Autopilot {
    /// Answers a request; answers themselves and what is addressed to nobody get silence.
    pub(super) fn file_request(&self, from: Sender, m: &FILE_TRANSFER_PROTOCOL_DATA, router: &mut Router) {
        let [low, high, session, opcode, ..] = m.payload;
        if m.target_system != self.system_id || opcode >= ACK {
            return;
        }
        let error = match opcode {
            TERMINATE_SESSION | RESET_SESSIONS => None,
            LIST_DIRECTORY | OPEN_FILE_READ_ONLY => Some(FILE_NOT_FOUND),
            _ => Some(UNKNOWN_COMMAND),
        };
        let mut payload = [0; 251];
        let [next_low, next_high] = u16::from_le_bytes([low, high]).wrapping_add(1).to_le_bytes();
        let answer = if error.is_some() { NAK } else { ACK };
        // Sequence, session, opcode, size, the request's opcode, two bytes and an offset unused, then the data.
        let head = [next_low, next_high, session, answer, u8::from(error.is_some()), opcode];
        payload[..head.len()].copy_from_slice(&head);
        payload[12] = error.unwrap_or(0);
        let reply = FILE_TRANSFER_PROTOCOL_DATA {
            target_system: from.system_id,
            target_component: from.component_id,
            payload,
            ..FILE_TRANSFER_PROTOCOL_DATA::DEFAULT
        };
        router.send(To::Link(from.link), COMPONENT, &MavMessage::FILE_TRANSFER_PROTOCOL(reply));
    }
}
