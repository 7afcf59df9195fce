//! A disk that is slow: no frame waits for it, none is turned away for it. In virtual time, on a disk made up.
//!
//! `cargo test --test link stalls -- --nocapture` prints the table.

use std::sync::{Arc, Mutex};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::link::codec::Encoder;
use veilwing::link::signing::{BLOCK, Keeper, Signing, timestamp};
use veilwing::link::{Key, RawFrame, SigningConfig};
use veilwing::time::Utc;

use crate::common::*;

const TICKS_PER_SECOND: u64 = 100_000;

/// A disk that takes its time over each write, as the test's clock tells it.
#[derive(Debug, Default)]
struct Disk {
    now_us: u64,
    write_us: u64,
    /// Under way: the ceiling, and when it is on record.
    writing: Option<(u64, u64)>,
    kept: u64,
    writes: u64,
}

/// The link's hold of it.
#[derive(Debug, Clone, Default)]
struct Shared(Arc<Mutex<Disk>>);

impl Shared {
    fn at(&self, now_us: u64) {
        let mut disk = self.0.lock().unwrap();
        disk.now_us = now_us;
        if let Some((ceiling, _)) = disk.writing.filter(|(_, done_us)| *done_us <= now_us) {
            disk.kept = ceiling;
            disk.writing = None;
        }
    }

    /// A power cut: what was under way is lost.
    fn cut(&self) -> u64 {
        self.0.lock().unwrap().kept
    }
}

impl Keeper for Shared {
    fn keep(&mut self, ceiling: u64) -> bool {
        let mut disk = self.0.lock().unwrap();
        if disk.writing.is_some() {
            return false;
        }
        disk.writing = Some((ceiling, disk.now_us + disk.write_us));
        disk.writes += 1;
        true
    }

    fn kept(&self) -> u64 {
        self.0.lock().unwrap().kept
    }

    fn close(&mut self, latest: u64) {
        self.0.lock().unwrap().kept = latest;
    }
}

fn config(link_id: u8) -> SigningConfig {
    SigningConfig { key: Key::new(KEY), link_id, state_file: "none".into(), unsigned_allowed: Vec::new() }
}

/// As a link does at its start: its first block is on record before anything else.
fn start(link_id: u8, write_us: u64, recorded: u64, now_us: u64) -> (Signing, Shared) {
    let from = recorded.max(timestamp(Utc { unix_us: now_us }));
    let disk = Disk { now_us, write_us, kept: from + BLOCK, ..Disk::default() };
    let disk = Shared(Arc::new(Mutex::new(disk)));
    (Signing::with_keeper(config(link_id), Box::new(disk.clone()), from), disk)
}

fn sign(signing: &mut Signing, encoder: &mut Encoder, now_us: u64) -> (RawFrame, u64) {
    let mut raw = encoder.encode_for_signing((1, 1), &heartbeat(0));
    signing.sign(&mut raw, Utc { unix_us: now_us }).unwrap();
    (RawFrame::V2(raw), raw.signature_timestamp())
}

#[test]
fn spec_a_slow_disk_costs_no_frame() {
    println!(
        "a write takes   frames   turned away   before their record   writes   next run ahead after a crash"
    );
    for write_s in [0.0, 0.1, 0.5, 1.0, 1.5, 2.0, 5.0, 25.0] {
        let write_us = (write_s * 1e6) as u64;
        let begin_us = SIGNED_UNIX_US;
        let (mut sender, _) = start(3, 0, 0, begin_us - 1_000_000);
        let (mut receiver, disk) = start(4, write_us, 0, begin_us);
        let (mut encoder, mut ours) = (Encoder::default(), Encoder::default());
        let (mut frames, mut turned_away, mut ahead_s) = (0, 0, 0.0_f64);
        // Five minutes of fifty frames a second, both ways.
        for k in 1..=5 * 60 * 50_u64 {
            let now_us = begin_us + k * 20_000;
            disk.at(now_us);
            let (frame, _) = sign(&mut sender, &mut encoder, now_us);
            turned_away += u32::from(receiver.verify(&frame, Utc { unix_us: now_us }) != Ok(true));
            let (_, used) = sign(&mut receiver, &mut ours, now_us);
            frames += 2;
            // Should the power fail now, what was used is not used again.
            assert!(disk.cut() >= used, "{write_s} s: {} behind {used}", disk.cut());
            let next_run = disk.cut() - timestamp(Utc { unix_us: now_us });
            ahead_s = ahead_s.max(next_run as f64 / TICKS_PER_SECOND as f64);
        }
        let writes = disk.0.lock().unwrap().writes;
        println!(
            "{write_s:8.1} s {frames:12} {turned_away:13} {:21} {writes:8} {ahead_s:24.1} s at most",
            receiver.unrecorded()
        );
        assert_eq!((turned_away, receiver.unrecorded()), (0, 0));
        assert!(ahead_s <= 60.1 && writes <= 11);
    }
}

#[test]
fn spec_a_disk_that_hangs_for_ever_costs_no_frame_either() {
    let (mut sender, _) = start(3, 0, 0, SIGNED_UNIX_US - 1_000_000);
    let (mut receiver, disk) = start(4, u64::MAX / 2, 0, SIGNED_UNIX_US);
    let mut encoder = Encoder::default();
    for k in 1..600_u64 {
        let now_us = SIGNED_UNIX_US + k * 1_000_000;
        disk.at(now_us);
        let (frame, _) = sign(&mut sender, &mut encoder, now_us);
        assert_eq!(receiver.verify(&frame, Utc { unix_us: now_us }), Ok(true), "second {k}");
        assert!(receiver.verify(&frame, Utc { unix_us: now_us }).is_err(), "a replay, second {k}");
    }
    assert!(receiver.unrecorded() > 500, "and says so");
}

#[test]
fn prop_no_timestamp_is_used_twice_through_crashes_and_clocks_that_jump_back() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut last, mut recorded) = (0, 0);
    for run in 1..200 {
        // Forth and back between runs; within one, only forth.
        let mut now_us = SIGNED_UNIX_US + rng.random_range(0..20_000_000);
        let (mut signing, disk) = start(0, rng.random_range(0..5_000_000), recorded, now_us);
        let mut encoder = Encoder::default();
        for _ in 0..rng.random_range(1..2000) {
            now_us += rng.random_range(0..200_000);
            disk.at(now_us);
            let (_, used) = sign(&mut signing, &mut encoder, now_us);
            assert!(used > last, "run {run}");
            last = used;
        }
        recorded = if rng.random_bool(0.5) {
            disk.cut()
        } else {
            drop(signing);
            disk.cut()
        };
    }
}
