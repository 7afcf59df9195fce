//! MAVLink FTP (<https://mavlink.io/en/services/ftp.html>): a companion has no files, and says so. MAVProxy asks every
//! component for a file of its parameters first, and waits for the answer before it asks for them one by one.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{FILE_TRANSFER_PROTOCOL_DATA, MavMessage};

use crate::mission::executive::Executive;

const TERMINATE_SESSION: u8 = 1;
const RESET_SESSIONS: u8 = 2;
const LIST_DIRECTORY: u8 = 3;
const OPEN_FILE_READ_ONLY: u8 = 4;
const ACK: u8 = 128;
const NAK: u8 = 129;
const UNKNOWN_COMMAND: u8 = 7;
const FILE_NOT_FOUND: u8 = 10;
/// Of a payload: sequence (2), session, opcode, size, opcode asked for, burst, padding, offset (4), then the data.
const DATA: usize = 12;

/// The payload that answers a request's; `None` for what is itself an answer.
fn answer(request: &[u8; 251]) -> Option<[u8; 251]> {
    let [low, high, session, opcode, ..] = *request;
    let error = match opcode {
        ACK.. => return None,
        TERMINATE_SESSION | RESET_SESSIONS => None,
        LIST_DIRECTORY | OPEN_FILE_READ_ONLY => Some(FILE_NOT_FOUND),
        _ => Some(UNKNOWN_COMMAND),
    };
    let mut payload = [0; 251];
    payload[..2].copy_from_slice(&u16::from_le_bytes([low, high]).wrapping_add(1).to_le_bytes());
    payload[2] = session;
    payload[3] = if error.is_some() { NAK } else { ACK };
    payload[4] = u8::from(error.is_some());
    payload[5] = opcode;
    payload[DATA] = error.unwrap_or(0);
    Some(payload)
}

impl Executive {
    /// Takes a file request that is addressed to us alone: what is addressed to all is the autopilot's to answer.
    pub(in crate::mission) fn handle_files(&mut self, header: MavHeader, message: &MavMessage) {
        let MavMessage::FILE_TRANSFER_PROTOCOL(m) = message else { return };
        if (m.target_system, m.target_component) != self.settings.own {
            return;
        }
        self.outbox.extend(answer(&m.payload).map(|payload| {
            MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
                target_network: 0,
                target_system: u8::try_from(header.system_id).unwrap_or_default(),
                target_component: header.component_id,
                payload,
            })
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_what_is_not_there_is_refused_and_answers_are_not_answered() {
        let ask = |opcode| {
            let mut request = [0; 251];
            request[..4].copy_from_slice(&[0xFF, 0x01, 9, opcode]);
            answer(&request).map(|a| [a[0], a[1], a[2], a[3], a[4], a[5], a[DATA]])
        };
        assert_eq!(
            ask(OPEN_FILE_READ_ONLY),
            Some([0x00, 0x02, 9, NAK, 1, OPEN_FILE_READ_ONLY, FILE_NOT_FOUND])
        );
        // 14: the checksum of a file.
        assert_eq!(ask(14), Some([0x00, 0x02, 9, NAK, 1, 14, UNKNOWN_COMMAND]));
        assert_eq!(ask(RESET_SESSIONS), Some([0x00, 0x02, 9, ACK, 0, RESET_SESSIONS, 0]));
        assert_eq!((ask(ACK), ask(NAK)), (None, None));
    }
}
