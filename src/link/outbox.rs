//! Frames on their way out.

use std::collections::VecDeque;

use super::frame::RawFrame;

/// Frames that wait for a congested way out. More would only be staler when they arrive.
const CAPACITY: usize = 64;

/// A short queue that forgets its oldest frame rather than grow.
#[derive(Debug, Default)]
pub struct Outbox {
    frames: VecDeque<RawFrame>,
    /// How much of the first frame is out already, where bytes are a stream.
    written: usize,
}

impl Outbox {
    /// Queues a frame. Returns whether another was dropped for it.
    pub fn push(&mut self, frame: RawFrame) -> bool {
        let full = self.frames.len() >= CAPACITY;
        if full {
            // A frame half out must go on, or the peer reads the next one as its end.
            self.frames.remove(usize::from(self.written > 0));
        }
        self.frames.push_back(frame);
        full
    }

    /// What goes out next.
    pub fn next_bytes(&self) -> Option<&[u8]> {
        self.frames.front()?.bytes().get(self.written..)
    }

    /// Notes that `count` bytes more are out. Returns the frame that they complete.
    pub fn advance(&mut self, count: usize) -> Option<RawFrame> {
        self.written += count;
        if self.written < self.frames.front()?.bytes().len() {
            return None;
        }
        self.written = 0;
        self.frames.pop_front()
    }

    /// Forgets the frame that goes out next.
    pub fn drop_next(&mut self) {
        self.written = 0;
        self.frames.pop_front();
    }

    /// Forgets everything. Returns how many frames that was.
    pub fn clear(&mut self) -> usize {
        self.written = 0;
        let count = self.frames.len();
        self.frames.clear();
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::MAVLinkV2MessageRaw;
    use mavlink::dialects::ardupilotmega::MavMessage;

    fn frame(sequence: u8) -> RawFrame {
        let mut raw = MAVLinkV2MessageRaw::new();
        let header = mavlink::MavHeader { sequence, ..Default::default() };
        raw.serialize_message(header, &MavMessage::HEARTBEAT(Default::default()));
        RawFrame::V2(raw)
    }

    #[test]
    fn spec_the_oldest_frame_gives_way_but_not_one_half_out() {
        let mut outbox = Outbox::default();
        let capacity = u8::try_from(CAPACITY).unwrap();
        for sequence in 0..capacity {
            assert!(!outbox.push(frame(sequence)));
        }
        assert!(outbox.push(frame(capacity)));
        assert_eq!(outbox.next_bytes(), Some(frame(1).bytes()));

        assert_eq!(outbox.advance(3), None);
        assert!(outbox.push(frame(capacity + 1)));
        assert_eq!(outbox.next_bytes(), Some(&frame(1).bytes()[3..]));
        assert_eq!(outbox.advance(frame(1).bytes().len() - 3), Some(frame(1)));
        assert_eq!(outbox.next_bytes(), Some(frame(3).bytes()), "2 was dropped");
        assert_eq!(outbox.clear(), CAPACITY - 1);
        assert_eq!(outbox.next_bytes(), None);
    }
}
