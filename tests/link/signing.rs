use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use mavlink::MAVLinkV2MessageRaw;
use veilwing::link::codec::Encoder;
use veilwing::link::signing::{RADIO_STATUS_ID, Signing, SigningError};
use veilwing::link::{Key, RawFrame, Rejection, SigningConfig};
use veilwing::time::Utc;

use crate::common::*;
use crate::tlog::directory;

const SECOND: u64 = 1_000_000;
const NEW_YEAR_2100: u64 = 4_102_444_800 * SECOND;

/// The signing timestamp of an instant, by another road.
fn ticks(unix_us: u64) -> u64 {
    (unix_us - 1_420_070_400 * SECOND) / 10
}

fn utc(unix_us: u64) -> Utc {
    Utc { unix_us }
}

fn config(state_file: PathBuf) -> SigningConfig {
    SigningConfig { key: Key::new(KEY), link_id: 5, state_file, unsigned_allowed: vec![RADIO_STATUS_ID] }
}

fn open_at(state_file: &Path, unix_us: u64) -> Signing {
    Signing::open(config(state_file.to_owned()), utc(unix_us)).unwrap()
}

/// A frame signed by the peer at `unix_us` with the given link id.
fn signed(state_file: &Path, link_id: u8, unix_us: u64) -> RawFrame {
    let peer = SigningConfig { link_id, ..config(state_file.to_owned()) };
    let mut peer = Signing::open(peer, utc(unix_us - 10)).unwrap();
    let mut raw = heartbeat_for_signing();
    peer.sign(&mut raw, utc(unix_us)).unwrap();
    RawFrame::V2(raw)
}

fn heartbeat_for_signing() -> MAVLinkV2MessageRaw {
    Encoder::default().encode_for_signing((1, 1), &heartbeat(0))
}

fn frame(hex: &str) -> RawFrame {
    RawFrame::from_bytes(&bytes(hex)).unwrap()
}

#[test]
fn val_signatures_are_those_of_pymavlink() {
    let state = directory("signing-vectors").join("state");
    let mut signing = open_at(&state, SIGNED_UNIX_US - SECOND);
    assert_eq!(signing.verify(&frame(HEARTBEAT_SIGNED), utc(SIGNED_UNIX_US)), Ok(true));
    assert_eq!(signing.verify(&frame(PARAM_VALUE_SIGNED), utc(SIGNED_UNIX_US)), Ok(true));

    let mut signing = open_at(&state.with_extension("2"), SIGNED_UNIX_US - SECOND);
    let message = frame(HEARTBEAT_V2).parse::<M>().unwrap().message;
    let mut encoder = Encoder::default();
    for _ in 0..7 {
        encoder.encode((1, 1), &message);
    }
    let mut raw = encoder.encode_for_signing((1, 1), &message);
    signing.sign(&mut raw, utc(SIGNED_UNIX_US)).unwrap();
    assert_eq!(raw.raw_bytes(), bytes(HEARTBEAT_SIGNED));
}

#[test]
fn spec_what_is_not_proven_is_refused_by_its_reason() {
    let directory = directory("signing-refused");
    let mut signing = open_at(&directory.join("state"), SIGNED_UNIX_US - SECOND);
    let now = utc(SIGNED_UNIX_US);
    let mut verify = |frame: RawFrame| signing.verify(&frame, now);
    assert_eq!(verify(frame(HEARTBEAT_V1)), Err(Rejection::Unsigned));
    assert_eq!(verify(frame(HEARTBEAT_V2)), Err(Rejection::Unsigned));
    assert_eq!(verify(frame(RADIO_STATUS_V1)), Ok(false));

    // Each byte of a signed frame is covered; a wrong one spoils nothing for the right frame afterwards.
    let good = bytes(HEARTBEAT_SIGNED);
    for at in 3..good.len() {
        let mut forged = good.clone();
        forged[at] ^= 0x10;
        let forged = RawFrame::from_bytes(&forged).unwrap();
        assert_eq!(verify(forged), Err(Rejection::WrongSignature), "byte {at}");
    }
    assert_eq!(verify(frame(HEARTBEAT_SIGNED)), Ok(true));
    assert_eq!(verify(frame(HEARTBEAT_SIGNED)), Err(Rejection::Replayed));
    // Another stream has a timestamp of its own.
    assert_eq!(verify(frame(PARAM_VALUE_SIGNED)), Ok(true));

    let other_key = SigningConfig { key: Key::new([7; 32]), ..config(directory.join("other")) };
    let mut stranger = Signing::open(other_key, now).unwrap();
    let mut raw = heartbeat_for_signing();
    stranger.sign(&mut raw, utc(SIGNED_UNIX_US + SECOND)).unwrap();
    assert_eq!(verify(RawFrame::V2(raw)), Err(Rejection::WrongSignature));
}

#[test]
fn spec_a_stream_may_start_a_minute_behind_and_not_before_this_run() {
    let directory = directory("signing-start");
    let start = SIGNED_UNIX_US;
    let mut signing = open_at(&directory.join("state"), start);
    let at = |link_id: u8, unix_us| signed(&directory.join("peer"), link_id, unix_us);
    assert_eq!(signing.verify(&at(0, start - SECOND), utc(start)), Err(Rejection::TooOld));
    assert_eq!(signing.verify(&at(0, start), utc(start)), Err(Rejection::TooOld));
    assert_eq!(signing.verify(&at(0, start + 10), utc(start)), Ok(true));

    let later = start + 1000 * SECOND;
    std::fs::remove_file(directory.join("peer")).unwrap();
    assert_eq!(signing.verify(&at(1, later - 61 * SECOND), utc(later)), Err(Rejection::TooOld));
    let in_time = at(1, later - 59 * SECOND);
    assert_eq!(signing.verify(&in_time, utc(later)), Ok(true));
    // A stream that was heard before goes on from where it was, however late.
    assert_eq!(signing.verify(&at(0, later - 58 * SECOND), utc(later)), Ok(true));
}

#[test]
fn spec_nothing_is_replayed_after_a_restart_or_a_crash() {
    let directory = directory("signing-restart");
    let (state, copy) = (directory.join("state"), directory.join("crashed"));
    let start = SIGNED_UNIX_US - SECOND;
    let mut signing = open_at(&state, start);
    assert_eq!(signing.verify(&frame(HEARTBEAT_SIGNED), utc(SIGNED_UNIX_US)), Ok(true));
    // What a power cut would leave behind now.
    std::fs::copy(&state, &copy).unwrap();
    drop(signing);
    // Also with a clock that starts anew, in 1970 or where it was.
    for path in [state, copy] {
        for clock in [0, start, SIGNED_UNIX_US] {
            let attempt = path.with_extension(clock.to_string());
            std::fs::copy(&path, &attempt).unwrap();
            let mut signing = open_at(&attempt, clock);
            assert_eq!(
                signing.verify(&frame(HEARTBEAT_SIGNED), utc(clock)),
                Err(Rejection::TooOld),
                "{attempt:?}"
            );
        }
    }
}

#[test]
fn spec_after_a_clean_restart_the_next_frame_is_welcome() {
    let directory = directory("signing-clean");
    let state = directory.join("state");
    let mut signing = open_at(&state, SIGNED_UNIX_US - SECOND);
    signing.verify(&frame(HEARTBEAT_SIGNED), utc(SIGNED_UNIX_US)).unwrap();
    drop(signing);
    let mut signing = open_at(&state, SIGNED_UNIX_US);
    let next = signed(&directory.join("peer"), 5, SIGNED_UNIX_US + 10);
    assert_eq!(signing.verify(&next, utc(SIGNED_UNIX_US)), Ok(true));
}

#[test]
fn val_a_peer_far_ahead_is_heard_at_once_and_followed() {
    let directory = directory("signing-ahead");
    let state = directory.join("state");
    let mut signing = open_at(&state, SIGNED_UNIX_US);
    let ahead = SIGNED_UNIX_US + 3600 * SECOND;
    let from_ahead = signed(&directory.join("peer"), 0, ahead);
    assert_eq!(signing.verify(&from_ahead, utc(SIGNED_UNIX_US)), Ok(true));
    assert_eq!(signing.verify(&from_ahead, utc(SIGNED_UNIX_US)), Err(Rejection::Replayed));
    // From now on we sign as late as the peer does, or it would turn us away.
    let mut raw = heartbeat_for_signing();
    signing.sign(&mut raw, utc(SIGNED_UNIX_US)).unwrap();
    let RawFrame::V2(peer) = from_ahead else { panic!() };
    assert!(raw.signature_timestamp() > peer.signature_timestamp());
    drop(signing);
    let on_record: u64 = std::fs::read_to_string(&state).unwrap().trim().parse().unwrap();
    assert!(on_record >= ticks(ahead));
}

#[test]
fn spec_a_stream_begins_within_a_month_of_our_clock_and_leaps_within_this_century() {
    const DAY: u64 = 86_400 * SECOND;
    let directory = directory("signing-leap");
    let mut signing = open_at(&directory.join("state"), SIGNED_UNIX_US);
    let now = utc(SIGNED_UNIX_US);
    let at = |link_id: u8, unix_us: u64| {
        signed(&directory.join(format!("peer-{link_id}-{unix_us}")), link_id, unix_us)
    };
    assert_eq!(signing.verify(&at(0, SIGNED_UNIX_US + 31 * DAY), now), Err(Rejection::TooNew));
    assert_eq!(signing.verify(&at(0, SIGNED_UNIX_US + SECOND), now), Ok(true));
    // As an autopilot's does that hears GPS, a year after our clock.
    assert_eq!(signing.verify(&at(0, SIGNED_UNIX_US + 365 * DAY), now), Ok(true));
    // Another component of it then begins there too.
    assert_eq!(signing.verify(&at(1, SIGNED_UNIX_US + 365 * DAY + SECOND), now), Ok(true));
    assert_eq!(signing.verify(&at(2, SIGNED_UNIX_US + SECOND), now), Err(Rejection::TooOld));
    assert_eq!(signing.verify(&at(0, NEW_YEAR_2100 - DAY), now), Ok(true));
    let mut beyond = heartbeat_for_signing();
    beyond.signature_timestamp_bytes_mut().copy_from_slice(&ticks(NEW_YEAR_2100 + DAY).to_le_bytes()[..6]);
    let mut signature = [0; 6];
    beyond.calculate_signature(&KEY, &mut signature);
    beyond.signature_value_mut().copy_from_slice(&signature);
    assert_eq!(signing.verify(&RawFrame::V2(beyond), now), Err(Rejection::TooNew));
    // A clock that has never been set is no measure.
    let mut unset = open_at(&directory.join("unset"), 1_000 * SECOND);
    assert_eq!(unset.verify(&at(0, SIGNED_UNIX_US), utc(1_000 * SECOND)), Ok(true));
}

#[test]
fn spec_a_disk_that_fails_does_not_silence_the_link() {
    let directory = directory("signing-disk");
    let home = directory.join("home");
    std::fs::create_dir(&home).unwrap();
    let mut signing = open_at(&home.join("state"), SIGNED_UNIX_US);
    std::fs::remove_dir_all(&home).unwrap();
    let later = SIGNED_UNIX_US + 3600 * SECOND;
    let from_peer = signed(&directory.join("peer"), 0, later);
    assert_eq!(signing.verify(&from_peer, utc(later)), Ok(true));
    let mut raw = heartbeat_for_signing();
    signing.sign(&mut raw, utc(later)).unwrap();
    assert_eq!(signing.verify(&from_peer, utc(later)), Err(Rejection::Replayed));
    assert_eq!(signing.unrecorded(), 2);
}

#[test]
fn spec_a_record_of_another_time_is_refused_with_what_to_do() {
    let state = directory("signing-record-ahead").join("state");
    let month = 30 * 86_400 * SECOND;
    // With each: what is on record, this machine's clock, whether it starts.
    for (record, clock, sound) in [
        ((1 << 48) - 1, SIGNED_UNIX_US, false),
        ((1 << 48) - 1, 0, false),
        (u64::MAX, SIGNED_UNIX_US, false),
        (ticks(NEW_YEAR_2100) + 1, 0, false),
        (ticks(SIGNED_UNIX_US + month) + 1, SIGNED_UNIX_US, false),
        (ticks(SIGNED_UNIX_US + month), SIGNED_UNIX_US, true),
        (ticks(SIGNED_UNIX_US), 0, true),
    ] {
        std::fs::write(&state, record.to_string()).unwrap();
        let opened = Signing::open(config(state.clone()), utc(clock));
        assert_eq!(opened.is_ok(), sound, "{record} at {clock}: {opened:?}");
        let Err(error) = opened else { continue };
        assert!(matches!(error, SigningError::StateFileAhead { .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains("set the clock") && text.contains("delete the file"), "{text}");
        assert!(text.contains(&state.display().to_string()), "{text}");
        // What is wrong is not overwritten.
        assert_eq!(std::fs::read_to_string(&state).unwrap(), record.to_string());
    }
}

#[test]
fn spec_one_record_serves_one_link_and_a_damaged_one_none() {
    let state = directory("signing-record").join("state");
    let first = open_at(&state, SIGNED_UNIX_US);
    let second = Signing::open(config(state.clone()), utc(SIGNED_UNIX_US));
    assert!(matches!(second, Err(SigningError::StateFileInUse { .. })), "{second:?}");
    drop((first, second));
    std::fs::write(&state, "soon").unwrap();
    let damaged = Signing::open(config(state), utc(SIGNED_UNIX_US));
    assert!(matches!(damaged, Err(SigningError::StateFileContent { .. })), "{damaged:?}");
    let nowhere = Signing::open(config("/nonexistent/state".into()), utc(SIGNED_UNIX_US));
    assert!(matches!(nowhere, Err(SigningError::StateFile { .. })), "{nowhere:?}");
}

#[test]
fn spec_a_key_file_is_the_owners_and_holds_a_key() {
    let path = directory("signing-key").join("key");
    let hex: String = KEY.iter().map(|byte| format!("{byte:02X}")).collect();
    let write = |content: &[u8], mode: u32| {
        std::fs::remove_file(&path).ok();
        std::fs::write(&path, content).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
    };
    for content in [KEY.as_slice(), hex.as_bytes(), format!("{}\n", hex.to_lowercase()).as_bytes()] {
        write(content, 0o600);
        assert_eq!(Key::load(&path).unwrap(), Key::new(KEY));
    }
    for mode in [0o640, 0o604, 0o620, 0o644] {
        write(&KEY, mode);
        let error = Key::load(&path).unwrap_err();
        assert!(matches!(error, SigningError::KeyFileMode { mode: found, .. } if found == mode), "{error}");
        assert!(error.to_string().contains("chmod 600"), "{error}");
    }
    for content in ["", "secret", &hex[1..], &hex.replace('0', "g"), &"0".repeat(64), &format!("{hex}00")] {
        write(content.as_bytes(), 0o600);
        assert!(matches!(Key::load(&path), Err(SigningError::KeyFileContent { .. })), "{content:?}");
    }
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(Key::load(&path), Err(SigningError::KeyFile { .. })));
    assert_eq!(format!("{:?}", Key::new(KEY)), "Key(..)");
}
