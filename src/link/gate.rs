//! Who is let in at one end of a link: the peer's system, its signature and its time, and whether it is where it says.
//! Without I/O or clock: [`super::Link`] hands it frames and instants, and sends what it wants sent.
//!
//! On a signed link a frame may be the peer's own and yet not be taken: its time may be one that only a replay could
//! have, or that of a machine whose clock nobody has set; and it may come from an address from which a replay could come as
//! well. Both are settled by a challenge ([`super::dialogue`]): a number never used before, to where the frame came from,
//! signed. The peer hears our time in it, and signs no earlier from then on; its answer shows that it is alive, and there.
//! Until then nothing it sends is taken, and nothing of ours goes to where it claims to be.

mod clocks;
mod nonce;
mod notice;
mod peer;

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::MAVLinkV2MessageRaw;

use self::clocks::Clocks;
use self::nonce::Nonces;
use self::peer::Peer;
use super::codec::Encoder;
use super::counters::Rejection;
use super::dialogue::{Dialogue, Said};
use super::frame::{Frame, RawFrame};
use super::signing::{NoTimestamp, Signing, Stamp};
use super::transport::Origin;
use crate::time::{Instant, Utc};

pub use notice::{Apart, Notice};

/// The same address is not challenged again before this: one that streams would be for each of its frames.
const AGAIN: Duration = Duration::from_millis(100);
/// Where the peer hears us anyway, a challenge does no more than tell clocks apart.
const AGAIN_TO_THE_PEER: Duration = Duration::from_secs(1);

/// What a gate is told.
#[derive(Debug, Default)]
pub struct GateConfig {
    /// The peer's system, if it is given.
    pub peer_system: Option<u8>,
    /// Anybody may speak here, so that a peer that is not given must be sought.
    pub open_to_anyone: bool,
    /// Frames of other systems are taken from where the peer is.
    pub accept_foreign: bool,
    /// Signs and verifies.
    pub signing: Option<Signing>,
}

/// One end's doorkeeper, for dialect `M`.
#[derive(Debug)]
pub struct Gate<M> {
    peer: Peer,
    accept_foreign: bool,
    signing: Option<Signing>,
    encoder: Encoder,
    /// As which (system, component) this end has spoken last. Who has said nothing challenges nobody.
    spoken_as: Option<(u8, u8)>,
    nonces: Nonces,
    /// Who was challenged last, and when.
    challenged: Option<(Origin, Instant)>,
    replies: VecDeque<(Origin, RawFrame)>,
    clocks: Clocks,
    notices: VecDeque<Notice>,
    admits: fn(&M) -> Result<(), Rejection>,
}

/// When and where a frame has come.
#[derive(Debug, Clone, Copy)]
pub struct Arrival {
    /// Where from.
    pub origin: Origin,
    /// On the monotonic clock.
    pub now: Instant,
    /// On this machine's other clock.
    pub utc: Utc,
}

impl<M: Dialogue> Gate<M> {
    /// A gate that has let nobody in yet, opened at `utc`.
    #[must_use]
    pub fn new(config: GateConfig, utc: Utc) -> Self {
        let GateConfig { peer_system, open_to_anyone, accept_foreign, signing } = config;
        let peer = match peer_system {
            Some(system) => Peer::System(system),
            None if open_to_anyone && !accept_foreign => Peer::sought(),
            None => Peer::Anyone,
        };
        let behind = signing.as_ref().map_or(Duration::ZERO, |signing| signing.clock_behind(utc));
        let mut gate = Self {
            peer,
            accept_foreign,
            signing,
            encoder: Encoder::default(),
            spoken_as: None,
            nonces: Nonces::default(),
            challenged: None,
            replies: VecDeque::new(),
            clocks: Clocks::default(),
            notices: VecDeque::new(),
            admits: |_| Ok(()),
        };
        if !behind.is_zero() {
            gate.clocks.here_was_later = true;
            gate.notices.push_back(Notice::OwnClock { behind, here: utc });
        }
        gate
    }

    /// Turns away, before it changes anything, what this function refuses.
    pub(super) fn admit_only(&mut self, admits: fn(&M) -> Result<(), Rejection>) {
        self.admits = admits;
    }

    /// This end speaks as `(system, component)`, whether or not it is heard.
    pub fn speak_as(&mut self, from: (u8, u8)) {
        self.spoken_as = Some(from);
    }

    /// The frame that says `message`, ready to be sent.
    ///
    /// # Errors
    /// [`NoTimestamp`]: it must not be sent.
    pub fn seal(&mut self, from: (u8, u8), message: &M, utc: Utc) -> Result<RawFrame, NoTimestamp> {
        self.speak_as(from);
        let raw: MAVLinkV2MessageRaw = match &mut self.signing {
            None => self.encoder.encode(from, message),
            Some(signing) => {
                let mut raw = self.encoder.encode_for_signing(from, message);
                signing.sign(&mut raw, utc)?;
                raw
            }
        };
        Ok(RawFrame::V2(raw))
    }

    /// Judges a frame whose checksum is right. What it says, unless that was for this gate alone; in either case it is the
    /// peer's, which therefore is where it came from.
    ///
    /// # Errors
    /// Why it is turned away. [`Self::poll_reply`] may have something to send for it.
    pub fn admit(&mut self, raw: &RawFrame, at: Arrival) -> Result<Option<Frame<M>>, Rejection> {
        let header = raw.header();
        let is_peer = self.peer.may_be(header.system_id);
        if !is_peer && (at.origin != Origin::Peer || !self.accept_foreign) {
            return Err(Rejection::ForeignSystem);
        }
        let stamp = match &self.signing {
            None => None,
            Some(signing) => match signing.prove(raw)? {
                None if at.origin != Origin::Peer => return Err(Rejection::Unsigned),
                None => None,
                Some(_)
                    if self.spoken_as.is_some_and(|(s, c)| {
                        (u32::from(s), c) == (header.system_id, header.component_id)
                    }) =>
                {
                    return Err(Rejection::Reflected);
                }
                proven => proven,
            },
        };
        if is_peer {
            self.hear_peer(header.system_id, at.now)?;
        }
        let frame = raw.parse::<M>()?;
        (self.admits)(&frame.message)?;
        match stamp {
            None => Ok(Some(frame)),
            Some(stamp) => self.admit_proven(frame, stamp, is_peer, at),
        }
    }

    /// What is to be sent for what has come, and where to.
    pub fn poll_reply(&mut self) -> Option<(Origin, RawFrame)> {
        self.replies.pop_front()
    }

    /// What the operator should know.
    pub fn poll_notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    /// How many timestamps went into use before they were on record.
    #[must_use]
    pub fn unrecorded(&self) -> u64 {
        self.signing.as_ref().map_or(0, Signing::unrecorded)
    }

    fn hear_peer(&mut self, system: u32, now: Instant) -> Result<(), Rejection> {
        let (notice, heard) = self.peer.hear(system, now);
        self.notices.extend(notice);
        heard
    }

    /// A frame of somebody who has the key: whether its time is one that it can have, and its sender where it came from.
    fn admit_proven(
        &mut self,
        frame: Frame<M>,
        stamp: Stamp,
        is_peer: bool,
        at: Arrival,
    ) -> Result<Option<Frame<M>>, Rejection> {
        let said = frame.message.said();
        let answers =
            matches!(said, Some(Said::Answer { nonce, .. }) if self.nonces.made(nonce, at.origin, at.now));
        let Some(signing) = &mut self.signing else { return Err(Rejection::Unsigned) };
        if let Err(reason) = signing.judge(stamp, answers, at.utc) {
            if is_peer {
                self.doubt(&frame, stamp, reason, at);
            }
            return Err(reason);
        }
        // Also where the path is not proven yet: the challenge must not seem old to its receiver.
        signing.keep_up(stamp);
        if at.origin != Origin::Peer && !answers {
            if let Some(Said::Challenge { nonce, .. }) = said {
                self.answer(&frame, nonce, at);
            }
            self.challenge(&frame, AGAIN, at);
            return Err(Rejection::Unproven);
        }
        signing.accept(stamp);
        self.take_said(frame, answers, at)
    }

    /// Acts on what an accepted frame says of the link; what says nothing of it is the caller's.
    fn take_said(
        &mut self,
        frame: Frame<M>,
        answers: bool,
        at: Arrival,
    ) -> Result<Option<Frame<M>>, Rejection> {
        match frame.message.said() {
            None | Some(Said::Answer { nothing_else: false, .. }) if !answers => Ok(Some(frame)),
            Some(Said::Challenge { nonce, clock }) => {
                self.compare(clock, at.utc);
                self.answer(&frame, nonce, at);
                Ok(None)
            }
            Some(Said::Answer { clock, .. }) if answers => {
                if let Some(clock) = clock {
                    self.compare(clock, at.utc);
                }
                Ok(None)
            }
            _ => Err(Rejection::Unasked),
        }
    }

    /// A frame of the peer's, but of a time that a replay may have: names the clock that may be to blame, and asks.
    fn doubt(&mut self, frame: &Frame<M>, stamp: Stamp, reason: Rejection, at: Arrival) {
        if matches!(reason, Rejection::TooOld | Rejection::TooNew) {
            let apart = match frame.message.said() {
                Some(Said::Challenge { clock, .. } | Said::Answer { clock: Some(clock), .. }) => {
                    self.clocks.heard(clock, at.utc, true)
                }
                _ => self.clocks.seen(stamp.utc(), at.utc, at.now),
            };
            self.notices.extend(apart.map(Notice::Clocks));
        }
        // Challenge for challenge would go on for ever where clocks are too far apart.
        let asks = frame.message.said().is_none();
        match (reason, at.origin) {
            (Rejection::TooOld | Rejection::TooNew, Origin::Peer) if asks => {
                self.challenge(frame, AGAIN_TO_THE_PEER, at);
            }
            (Rejection::TooOld | Rejection::TooNew | Rejection::Replayed, origin)
                if asks && origin != Origin::Peer =>
            {
                self.challenge(frame, AGAIN, at);
            }
            _ => {}
        }
    }

    fn compare(&mut self, there: Utc, here: Utc) {
        let apart = self.clocks.heard(there, here, false);
        self.notices.extend(apart.map(Notice::Clocks));
    }

    /// Asks whoever sent this frame to show that it is alive, and there.
    fn challenge(&mut self, frame: &Frame<M>, pause: Duration, at: Arrival) {
        let Some(from) = self.spoken_as else { return };
        let again = |(origin, asked_at): (Origin, Instant)| {
            origin == at.origin && at.now.saturating_since(asked_at) < pause
        };
        if self.challenged.is_some_and(again) {
            return;
        }
        self.challenged = Some((at.origin, at.now));
        let nonce = self.nonces.make(at.origin, at.now);
        let message = frame.message.challenge(from, system_of(frame), nonce, at.utc);
        self.reply(&message, from, at);
    }

    fn answer(&mut self, frame: &Frame<M>, nonce: u64, at: Arrival) {
        let Some(from) = self.spoken_as else { return };
        if let Some(message) = frame.message.answer(from, system_of(frame), nonce, at.utc) {
            self.reply(&message, from, at);
        }
    }

    fn reply(&mut self, message: &M, from: (u8, u8), at: Arrival) {
        // Without a timestamp nothing can be sent at all, which `seal` has the link report.
        if let Ok(raw) = self.seal(from, message, at.utc) {
            self.replies.push_back((at.origin, raw));
        }
    }
}

fn system_of<M>(frame: &Frame<M>) -> u8 {
    u8::try_from(frame.header.system_id).unwrap_or_default()
}
