//! STATUSTEXT: 50 bytes a message, longer texts in chunks under one id (MAVLink 2).

use mavlink::dialects::ardupilotmega::{MavMessage, MavSeverity, STATUSTEXT_DATA};

use super::event::Event;
use super::outbox::Outbox;
use super::state::Timed;
use crate::time::Instant;

const CHUNK: usize = 50;
/// Longer than any text an operator reads on a ground station; stops a sender that never ends.
const LONGEST: usize = 1000;

/// Splits a text into messages. `id` must not be zero and differ from the last long text's.
fn chunks(severity: MavSeverity, text: &str, id: u16) -> Vec<MavMessage> {
    let bytes: Vec<u8> =
        text.chars().take(LONGEST).map(|c| if c.is_ascii() && c != '\0' { c as u8 } else { b'?' }).collect();
    let alone = bytes.len() <= CHUNK;
    let mut parts: Vec<&[u8]> = bytes.chunks(CHUNK).collect();
    // A text ends with the first chunk that is not full.
    if !alone && bytes.len().is_multiple_of(CHUNK) || parts.is_empty() {
        parts.push(&[]);
    }
    parts
        .iter()
        .zip(0u8..)
        .map(|(part, chunk_seq)| {
            let mut padded = [0u8; CHUNK];
            padded[..part.len()].copy_from_slice(part);
            let id = if alone { 0 } else { id };
            MavMessage::STATUSTEXT(STATUSTEXT_DATA { severity, text: padded.into(), id, chunk_seq })
        })
        .collect()
}

/// Puts chunks together again.
#[derive(Debug, Clone, Default)]
pub(crate) struct Assembly {
    id: u16,
    next: u8,
    bytes: Vec<u8>,
}

impl Assembly {
    /// Takes a message and gives the text that it completes. A text with a lost chunk gets an ellipsis there.
    pub(crate) fn handle(&mut self, message: &STATUSTEXT_DATA) -> Option<String> {
        let end = message.text.iter().position(|byte| *byte == 0);
        let part = &message.text[..end.unwrap_or(CHUNK)];
        if message.id == 0 {
            return Some(String::from_utf8_lossy(part).into_owned());
        }
        if message.id != self.id || message.chunk_seq < self.next {
            *self = Self { id: message.id, next: 0, bytes: Vec::new() };
        }
        if message.chunk_seq != self.next {
            self.bytes.extend_from_slice(b"...");
        }
        self.next = message.chunk_seq.saturating_add(1);
        self.bytes.extend_from_slice(part);
        let complete = end.is_some() || self.bytes.len() >= LONGEST;
        complete.then(|| String::from_utf8_lossy(&std::mem::take(self).bytes).into_owned())
    }
}

/// The autopilot's texts and our own.
#[derive(Debug, Clone, Default)]
pub(super) struct Texts {
    assembly: Assembly,
    last: Option<Timed<String>>,
    /// Of our last text.
    id: u16,
}

impl Texts {
    /// The autopilot's last words.
    pub(super) fn last(&self) -> Option<&Timed<String>> {
        self.last.as_ref()
    }

    /// Takes a message of the autopilot and tells the text that it completes.
    pub(super) fn handle(&mut self, message: &STATUSTEXT_DATA, now: Instant, out: &mut Outbox) {
        if let Some(text) = self.assembly.handle(message) {
            self.last = Some(Timed::new(text.clone(), now));
            out.tell(Event::StatusText { severity: message.severity, text });
        }
    }

    /// Says something to whoever listens.
    pub(super) fn say(&mut self, severity: MavSeverity, text: &str, out: &mut Outbox) {
        self.id = self.id.checked_add(1).unwrap_or(1);
        chunks(severity, text, self.id).into_iter().for_each(|message| out.send(message));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_texts_of_every_length_survive_the_chunks() {
        for length in [0, 1, 49, 50, 51, 99, 100, 101, 250] {
            let text: String = ('a'..='z').cycle().take(length).collect();
            let messages = chunks(MavSeverity::MAV_SEVERITY_INFO, &text, 7);
            let mut assembly = Assembly::default();
            let mut texts = Vec::new();
            for message in &messages {
                let MavMessage::STATUSTEXT(part) = message else { panic!("{message:?}") };
                assert_eq!(part.id == 0, length <= 50);
                texts.extend(assembly.handle(part));
            }
            assert_eq!(texts, [text]);
        }
    }

    #[test]
    fn spec_a_lost_chunk_is_marked_and_strange_bytes_do_no_harm() {
        let messages = chunks(MavSeverity::MAV_SEVERITY_INFO, &"x".repeat(120), 3);
        let mut assembly = Assembly::default();
        let MavMessage::STATUSTEXT(first) = &messages[0] else { panic!() };
        let MavMessage::STATUSTEXT(last) = &messages[2] else { panic!() };
        assert_eq!(assembly.handle(first), None);
        assert_eq!(assembly.handle(last), Some(format!("{}...{}", "x".repeat(50), "x".repeat(20))));
        let odd = STATUSTEXT_DATA { text: [0xff; 50].into(), id: 0, ..first.clone() };
        assert_eq!(assembly.handle(&odd).map(|text| text.chars().count()), Some(50));
    }
}
