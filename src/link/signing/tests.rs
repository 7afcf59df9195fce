//! Up to which timestamp, to the tick: what is signed, accepted, put on record, and called behind.

use std::sync::{Arc, Mutex};

use super::*;
use crate::link::codec::Encoder;

/// Takes every ceiling and has none on record but what it began with.
#[derive(Debug, Clone, Default)]
struct Stuck {
    kept: u64,
    asked: Arc<Mutex<Vec<u64>>>,
}

impl Keeper for Stuck {
    fn keep(&mut self, ceiling: u64) -> bool {
        self.asked.lock().unwrap().push(ceiling);
        true
    }

    fn kept(&self) -> u64 {
        self.kept
    }

    fn close(&mut self, _: u64) {}
}

fn signing(keeper: Stuck, recorded: u64) -> Signing {
    let config = SigningConfig {
        key: Key::new([3; 32]),
        link_id: 1,
        state_file: "none".into(),
        unsigned_allowed: Vec::new(),
    };
    Signing::with_keeper(config, Box::new(keeper), recorded)
}

/// 2026-01-01T00:00:00Z.
const NOW: u64 = (1_767_225_600_000_000 - EPOCH_UNIX_US) / 10;
const MINUTE: u64 = 60 * 100_000;

fn sign_at(signing: &mut Signing, timestamp: u64) -> Result<u64, NoTimestamp> {
    let heartbeat = mavlink::dialects::ardupilotmega::MavMessage::HEARTBEAT(Default::default());
    let mut raw = Encoder::default().encode_for_signing((1, 1), &heartbeat);
    signing.sign(&mut raw, utc_of(timestamp))?;
    Ok(raw.signature_timestamp())
}

#[test]
fn spec_the_last_timestamp_of_the_century_signs_and_none_after_it() {
    let mut signing = signing(Stuck::default(), NOW);
    assert_eq!(sign_at(&mut signing, LATEST), Ok(LATEST));
    assert_eq!(sign_at(&mut signing, LATEST), Err(NoTimestamp), "none is used twice");
    assert_eq!(sign_at(&mut signing, LATEST + 7), Err(NoTimestamp));
}

#[test]
fn spec_streams_begin_up_to_a_month_ahead_and_go_on_up_to_the_end_of_the_century() {
    let mut signing = signing(Stuck::default(), NOW);
    let utc = utc_of(NOW);
    let stamp = |timestamp| Stamp { stream: (1, 1, 0), timestamp };
    let month = 30 * 86_400 * 100_000;
    assert_eq!(signing.judge(stamp(NOW + month + 1), false, utc), Err(Rejection::TooNew));
    assert_eq!(signing.judge(stamp(NOW + month), false, utc), Ok(()));
    signing.accept(stamp(NOW + month));
    assert_eq!(signing.judge(stamp(LATEST), false, utc), Ok(()));
    assert_eq!(signing.judge(stamp(LATEST + 1), false, utc), Err(Rejection::TooNew));
}

#[test]
fn spec_a_timestamp_that_goes_into_use_before_its_record_is_counted_once() {
    let keeper = Stuck { kept: NOW + 5, ..Stuck::default() };
    let mut signing = signing(keeper, NOW);
    let stamp = |timestamp| Stamp { stream: (1, 1, 0), timestamp };
    signing.keep_up(stamp(NOW + 5));
    assert_eq!(signing.unrecorded(), 0, "on record to the tick");
    signing.keep_up(stamp(NOW + 6));
    signing.accept(stamp(NOW + 6));
    assert_eq!(signing.unrecorded(), 1);
    sign_at(&mut signing, NOW + 7).unwrap();
    assert_eq!(signing.unrecorded(), 2);
}

#[test]
fn spec_the_next_minute_is_asked_for_when_half_of_the_last_is_used() {
    let keeper = Stuck { kept: NOW + MINUTE, ..Stuck::default() };
    let mut signing = signing(keeper.clone(), NOW);
    sign_at(&mut signing, NOW + MINUTE / 2).unwrap();
    assert!(keeper.asked.lock().unwrap().is_empty());
    sign_at(&mut signing, NOW + MINUTE / 2 + 1).unwrap();
    sign_at(&mut signing, NOW + MINUTE / 2 + 2).unwrap();
    assert_eq!(*keeper.asked.lock().unwrap(), [NOW + MINUTE + MINUTE / 2 + 1]);
}

/// A crash leaves a minute that was on record ahead, and a peer's clock may have been another ahead.
#[test]
fn val_a_clock_is_behind_by_what_no_crash_explains() {
    let signing = signing(Stuck::default(), NOW + 2 * MINUTE);
    assert_eq!(signing.clock_behind(utc_of(NOW)), Duration::ZERO);
    assert_eq!(signing.clock_behind(utc_of(NOW - 1)), Duration::from_secs(120) + Duration::from_micros(10));
}

#[test]
fn spec_the_recorder_says_what_is_on_disk_and_puts_there_what_it_takes() {
    let directory = std::env::temp_dir().join(format!("veilwing-recorder-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let path = directory.join("state");
    let on_disk = || std::fs::read_to_string(&path).unwrap();
    let (mut recorder, start) = Recorder::open(path.clone(), NOW).unwrap();
    assert_eq!((start, recorder.kept(), on_disk()), (NOW, NOW + MINUTE, format!("{}\n", NOW + MINUTE)));
    assert!(recorder.keep(NOW + 2 * MINUTE), "nothing is under way");
    recorder.finish();
    assert_eq!((recorder.kept(), on_disk()), (NOW + 2 * MINUTE, format!("{}\n", NOW + 2 * MINUTE)));
    assert!(!recorder.keep(NOW + 3 * MINUTE), "it is closed");
    std::fs::remove_dir_all(&directory).ok();
}

#[test]
fn spec_a_clock_that_was_never_set_follows_any_and_one_that_was_a_month_at_the_most() {
    assert_eq!(furthest(CLOCK_SET - 1), LATEST);
    assert_eq!(furthest(CLOCK_SET), CLOCK_SET + CLOCKS_APART);
    assert_eq!(furthest(LATEST), LATEST);
}

#[test]
fn spec_a_record_that_cannot_be_read_is_not_taken_for_none() {
    let directory = std::env::temp_dir().join(format!("veilwing-unreadable-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let path = directory.join("state");
    std::fs::write(&path, [0xff, 0xfe]).unwrap();
    let opened = Recorder::open(path, NOW);
    assert!(matches!(opened, Err(SigningError::StateFile { .. })), "{:?}", opened.err());
    std::fs::remove_dir_all(&directory).ok();
}
