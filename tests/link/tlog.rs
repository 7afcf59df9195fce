use std::io::Write;
use std::path::PathBuf;

use veilwing::link::tlog::TlogError;
use veilwing::link::{
    Clock, Key, Link, LinkConfig, MemoryEnd, RawFrame, SigningConfig, TlogReader, TlogWriter,
};
use veilwing::time::Utc;

use crate::common::*;

/// A directory of the test's own, empty.
pub fn directory(name: &str) -> PathBuf {
    let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("link-{name}"));
    std::fs::remove_dir_all(&path).ok();
    std::fs::create_dir_all(&path).unwrap();
    path
}

fn raw(hex: &str) -> RawFrame {
    RawFrame::from_bytes(&bytes(hex)).unwrap()
}

#[test]
fn val_a_record_is_a_big_endian_stamp_and_the_frame_unsigned() {
    let path = directory("tlog-layout").join("a.tlog");
    let writer = TlogWriter::create(&path).unwrap();
    writer.record(Utc { unix_us: 0x0006_0001_0203_0405 }, raw(HEARTBEAT_SIGNED).without_signature::<M>());
    writer.record(Utc { unix_us: 1 }, raw(RADIO_STATUS_V1).without_signature::<M>());
    drop(writer);
    // Without its signature the frame is, checksum included, what pymavlink makes without a key.
    let expected = format!("0006000102030405{HEARTBEAT_V2}0000000000000001{RADIO_STATUS_V1}");
    assert_eq!(std::fs::read(&path).unwrap(), bytes(&expected));

    let records: Vec<_> = TlogReader::open(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(records[0], (Utc { unix_us: 0x0006_0001_0203_0405 }, raw(HEARTBEAT_V2)));
    assert_eq!(records[1], (Utc { unix_us: 1 }, raw(RADIO_STATUS_V1)));
    assert_eq!(records.len(), 2);
}

#[tokio::test]
async fn spec_a_link_logs_both_directions_and_no_signature() {
    let directory = directory("tlog-link");
    let config = |name: &str, tlog| LinkConfig {
        name: name.to_owned(),
        signing: Some(SigningConfig {
            key: Key::new(KEY),
            link_id: 0,
            state_file: directory.join(name),
            unsigned_allowed: vec![],
        }),
        tlog,
        ..LinkConfig::default()
    };
    let path = directory.join("a.tlog");
    let (a, b) = MemoryEnd::pair();
    let tlog = TlogWriter::create(&path).unwrap();
    let mut a = Link::<M>::in_memory(a, config("a", Some(tlog)), Clock::real()).unwrap();
    let mut b = Link::<M>::in_memory(b, config("b", None), Clock::real()).unwrap();
    for mode in 0..50 {
        a.send((1, 191), &heartbeat(mode));
        assert_eq!(mode_of(&b.recv().await), mode);
        b.send((2, 191), &heartbeat(mode));
        let received = a.recv().await;
        assert!(received.signed && mode_of(&received) == mode);
    }
    drop(a);
    let records: Vec<_> = TlogReader::open(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(records.len(), 100);
    for (index, (utc, raw)) in records.iter().enumerate() {
        assert!(!raw.is_signed() && raw.has_valid_crc::<M>());
        let system = if index.is_multiple_of(2) { 1 } else { 2 };
        assert_eq!(raw.header().system_id, system, "record {index}");
        assert!(index == 0 || records[index - 1].0 <= *utc);
    }
}

#[test]
fn spec_a_full_disk_costs_records_and_nothing_else() {
    // Whatever is written to /dev/full finds no space left.
    let writer = TlogWriter::create("/dev/full".as_ref()).unwrap();
    let frame = raw(HEARTBEAT_V2);
    for unix_us in 0..20_000 {
        writer.record(Utc { unix_us }, frame);
    }
    while writer.dropped() < 20_000 {
        std::thread::yield_now();
    }
    assert_eq!(writer.dropped(), 20_000);
}

#[test]
fn prop_a_log_cut_off_reads_up_to_the_cut() {
    let whole = bytes(&format!("0000000000000001{HEARTBEAT_V2}0000000000000002{HEARTBEAT_SIGNED}"));
    let first = 8 + bytes(HEARTBEAT_V2).len();
    for length in 0..=whole.len() {
        let records: Vec<_> = TlogReader::new(&whole[..length]).collect();
        let good = records.iter().filter(|record| record.is_ok()).count();
        assert_eq!(good, usize::from(length >= first) + usize::from(length == whole.len()), "{length}");
        match records.last() {
            Some(Err(TlogError::Truncated { offset })) => {
                assert_eq!(*offset, if length < first { 0 } else { first as u64 });
            }
            Some(Err(error)) => panic!("{error}"),
            _ => assert!(length == 0 || length == first || length == whole.len(), "{length}"),
        }
    }
}

#[test]
fn spec_a_damaged_log_ends_with_the_place() {
    let mut log = bytes(&format!("0000000000000001{HEARTBEAT_V2}"));
    let offset_of_damage = log.len() as u64;
    log.write_all(&[7; 40]).unwrap();
    let last = TlogReader::new(log.as_slice()).last().unwrap();
    assert!(matches!(last, Err(TlogError::Damaged { offset }) if offset == offset_of_damage), "{last:?}");
}
