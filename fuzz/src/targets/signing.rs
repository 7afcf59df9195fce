//! The check of signatures: what is not proven, not new or not this key's is never accepted, through restarts and clocks
//! that jump.

use std::collections::BTreeSet;
use std::path::Path;

use arbitrary::Unstructured;
use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAVLinkV2MessageRaw, Message};
use veilwing::link::codec::Encoder;
use veilwing::link::signing::{RADIO_STATUS_ID, Signing};
use veilwing::link::{Key, RawFrame, SigningConfig};
use veilwing::time::Utc;

use crate::reached::Reached;
use crate::scratch::Scratch;
use crate::target::Target;

/// Signatures.
pub const TARGET: Target = Target {
    name: "signing",
    what: "frames signed, forged, altered, repeated and late to the check of signatures, with restarts and jumping clocks",
    words: &[],
    seeds,
    run,
    // Each keeps records on the disk.
    generated: 200,
};

const SECOND: u64 = 1_000_000;
const BEGAN: u64 = 1_800_000_000 * SECOND;

fn seeds() -> Vec<Vec<u8>> {
    vec![vec![0, 0, 1, 0, 0, 0, 2, 1, 0, 0, 3, 9, 4, 0, 5, 200, 6, 1, 0, 0, 7, 0], (0..64).collect()]
}

fn open(directory: &Path, name: &str, key: u8, unix_us: u64) -> Option<Signing> {
    let config = SigningConfig {
        key: Key::new([key; 32]),
        link_id: 0,
        state_file: directory.join(name),
        unsigned_allowed: vec![RADIO_STATUS_ID],
    };
    Signing::open(config, Utc { unix_us }).ok()
}

struct Ends {
    directory: Scratch,
    /// Who checks, who signs with the key, and who signs with another.
    checks: Option<Signing>,
    peer: Option<Signing>,
    forger: Option<Signing>,
    encoder: Encoder,
    sent: Vec<MAVLinkV2MessageRaw>,
    accepted: BTreeSet<Vec<u8>>,
    unix_us: u64,
}

impl Ends {
    fn new() -> Self {
        let directory = Scratch::new();
        let [checks, peer, forger] = [("checks", 7), ("peer", 7), ("forger", 9)]
            .map(|(name, key)| open(directory.path(), name, key, BEGAN));
        Self {
            directory,
            checks,
            peer,
            forger,
            encoder: Encoder::default(),
            sent: Vec::new(),
            accepted: BTreeSet::new(),
            unix_us: BEGAN + SECOND,
        }
    }

    fn sign(&mut self, by_forger: bool, ahead_us: i64) -> Option<MAVLinkV2MessageRaw> {
        let message = MavMessage::default_message_from_id(0)?;
        let mut raw = self.encoder.encode_for_signing((2, 191), &message);
        let signer = if by_forger { &mut self.forger } else { &mut self.peer };
        let utc = Utc { unix_us: self.unix_us.saturating_add_signed(ahead_us) };
        signer.as_mut()?.sign(&mut raw, utc).ok()?;
        Some(raw)
    }

    /// Lets a frame arrive; `genuine`: it is as somebody with the key has signed it.
    fn arrive(&mut self, raw: MAVLinkV2MessageRaw, genuine: bool, reached: &mut Reached) {
        let Some(checks) = &mut self.checks else { return };
        let frame = RawFrame::V2(raw);
        let judged = checks.verify(&frame, Utc { unix_us: self.unix_us });
        reached.note(format_args!("{judged:?}"));
        if judged == Ok(true) {
            assert!(genuine, "forged: {frame:?}");
            assert!(self.accepted.insert(frame.bytes().to_vec()), "accepted twice: {frame:?}");
        }
    }
}

fn run(input: &[u8], reached: &mut Reached) {
    let mut u = Unstructured::new(input);
    let mut ends = Ends::new();
    while !u.is_empty() && step(&mut ends, &mut u, reached).is_ok() {}
}

fn step(ends: &mut Ends, u: &mut Unstructured<'_>, reached: &mut Reached) -> arbitrary::Result<()> {
    match u.arbitrary::<u8>()? % 8 {
        0 | 1 => {
            let ahead_us = i64::from(u.arbitrary::<i16>()?) * 10_000;
            if let Some(raw) = ends.sign(false, ahead_us) {
                ends.sent.push(raw);
                ends.arrive(raw, true, reached);
            }
        }
        2 => {
            if let Some(raw) = ends.sign(true, 0) {
                ends.arrive(raw, false, reached);
            }
        }
        3 => {
            // Again, or an older one for the first time.
            let at = usize::from(u.arbitrary::<u8>()?);
            if let Some(raw) = ends.sent.get(at % ends.sent.len().max(1)).copied() {
                ends.arrive(raw, true, reached);
            }
        }
        4 => {
            let (at, to) = (usize::from(u.arbitrary::<u8>()?), u.arbitrary::<u8>()?);
            if let Some(raw) = ends.sign(false, 0) {
                let mut bytes = raw.raw_bytes().to_vec();
                let at = at % bytes.len();
                let changed = bytes[at] != to;
                bytes[at] = to;
                if let Some(RawFrame::V2(altered)) = RawFrame::from_bytes(&bytes) {
                    ends.arrive(altered, !changed, reached);
                }
            }
        }
        5 => ends.unix_us = ends.unix_us.saturating_add_signed(i64::from(u.arbitrary::<i32>()?) * 1000),
        6 => {
            // Killed and started again: first the old one goes.
            ends.checks = None;
            ends.checks = open(ends.directory.path(), "checks", 7, ends.unix_us);
            reached.note(format_args!("opened {}", ends.checks.is_some()));
        }
        _ => {
            if let Some(raw) = ends.sign(false, 0) {
                ends.sent.push(raw);
            }
        }
    }
    Ok(())
}
