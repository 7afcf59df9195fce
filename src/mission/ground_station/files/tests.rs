use proptest::prelude::*;

use super::*;
use crate::role::Role;

const ME: Who = (255, 190);
const OTHER: Who = (254, 190);
const TICK: Duration = Duration::from_millis(20);

const OPEN: u8 = 4;
const READ: u8 = 5;
const CRC: u8 = 14;
const BURST: u8 = 15;

/// Stations at a server, and what time it is.
struct Desk {
    server: FileServer,
    now: Instant,
    sequence: u16,
}

/// What an answer says: whether it is an ACK, and its data.
type Said = (bool, Vec<u8>);

fn payload(sequence: u16, session: u8, opcode: u8, size: u8, offset: u32, data: &[u8]) -> Payload {
    let mut payload = [0; 251];
    payload[..2].copy_from_slice(&sequence.to_le_bytes());
    payload[2..5].copy_from_slice(&[session, opcode, size]);
    payload[8..DATA].copy_from_slice(&offset.to_le_bytes());
    payload[DATA..DATA + data.len()].copy_from_slice(data);
    payload
}

fn data(answer: &Payload) -> &[u8] {
    &answer[DATA..DATA + usize::from(answer[4])]
}

fn the_files() -> &'static [File; 2] {
    files(Role::I)
}

fn no(why: MavFtpErr) -> Said {
    (false, vec![why as u8])
}

fn yes(data: &[u8]) -> Said {
    (true, data.to_vec())
}

impl Desk {
    fn new() -> Self {
        Self { server: FileServer::new(Instant::ZERO), now: Instant::ZERO, sequence: 65_530 }
    }

    fn ask(&mut self, who: Who, request: &Payload) -> Option<Payload> {
        self.server.answer(the_files(), who, request, self.now)
    }

    /// Asks with a sequence number of its own, and looks at all of the answer's head.
    fn asked(&mut self, who: Who, session: u8, opcode: u8, size: u8, offset: u32, given: &[u8]) -> Said {
        self.sequence = self.sequence.wrapping_add(1);
        let request = payload(self.sequence, session, opcode, size, offset, given);
        let answer = self.ask(who, &request).unwrap();
        assert_eq!(answer[..2], self.sequence.wrapping_add(1).to_le_bytes());
        assert_eq!((answer[2], answer[5], answer[6]), (session, opcode, 0));
        assert_eq!(answer[8..DATA], offset.to_le_bytes());
        assert!([128, 129].contains(&answer[3]), "{}", answer[3]);
        (answer[3] == 128, data(&answer).to_vec())
    }

    fn path(&mut self, who: Who, session: u8, opcode: u8, path: &[u8]) -> Said {
        self.asked(who, session, opcode, path.len() as u8, 0, path)
    }

    /// The pieces that come within `time`, and when.
    fn pieces(&mut self, time: Duration) -> Vec<(Instant, Who, Payload)> {
        let end = self.now + time;
        let mut pieces = Vec::new();
        while self.now < end {
            self.now = self.now + TICK;
            pieces.extend(self.server.piece(TICK, self.now).map(|(who, piece)| (self.now, who, piece)));
        }
        pieces
    }
}

#[test]
fn spec_the_directory_lists_both_files_with_their_sizes() {
    let mut desk = Desk::new();
    let [general, parameters] = the_files();
    let [first, second] =
        [general, parameters].map(|file| format!("F{}\t{}\0", file.name, file.text.len()).into_bytes());
    for root in ["", "/", "."] {
        assert_eq!(
            desk.path(ME, 0, 3, root.as_bytes()),
            yes(&[first.as_slice(), &second].concat()),
            "{root}"
        );
    }
    assert_eq!(desk.asked(ME, 0, 3, 1, 1, b"/"), yes(&second));
    for past in [2, u32::MAX] {
        assert_eq!(desk.asked(ME, 0, 3, 1, past, b"/"), no(MavFtpErr::MAV_FTP_ERR_EOF));
    }
    assert_eq!(desk.path(ME, 0, 3, b"/etc"), no(MavFtpErr::MAV_FTP_ERR_FILENOTFOUND));
}

#[test]
fn spec_a_file_is_opened_read_to_its_end_and_closed() {
    let mut desk = Desk::new();
    let [_, file] = the_files();
    let length = file.text.len() as u32;
    assert_eq!(desk.path(ME, 7, OPEN, b"parameter.json"), yes(&length.to_le_bytes()));
    let mut read = Vec::new();
    while read.len() < file.text.len() {
        // Who does not say how much it wants gets all that fits.
        let size = if read.is_empty() { 0 } else { 80 };
        let (true, part) = desk.asked(ME, 7, READ, size, read.len() as u32, &[]) else { panic!("refused") };
        assert!(
            part.len() == if size == 0 { MOST } else { 80 } || read.len() + part.len() == file.text.len()
        );
        read.extend(part);
    }
    assert_eq!(read, file.text);
    for past in [length, length + 1, u32::MAX] {
        assert_eq!(desk.asked(ME, 7, READ, 239, past, &[]), no(MavFtpErr::MAV_FTP_ERR_EOF));
        assert_eq!(desk.asked(ME, 7, BURST, 239, past, &[]), no(MavFtpErr::MAV_FTP_ERR_EOF));
    }
    assert_eq!(desk.asked(ME, 7, READ, 240, 0, &[]), no(MavFtpErr::MAV_FTP_ERR_INVALIDDATASIZE));
    assert_eq!(desk.asked(ME, 7, 1, 0, 0, &[]), yes(&[]));
    assert_eq!(desk.asked(ME, 7, READ, 80, 0, &[]), no(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
}

#[test]
fn spec_a_checksum_is_that_of_the_file() {
    let mut desk = Desk::new();
    for file in the_files() {
        assert_eq!(desk.path(ME, 0, CRC, file.name.as_bytes()), yes(&file.crc.to_le_bytes()));
    }
    assert_eq!(desk.path(ME, 0, CRC, b"else.json"), no(MavFtpErr::MAV_FTP_ERR_FILENOTFOUND));
}

#[test]
fn spec_no_other_path_names_anything() {
    let mut desk = Desk::new();
    let too_long = [b'a'; 239];
    for path in [
        b"../general.json".as_slice(),
        b"..",
        b"/../general.json",
        b"//general.json",
        b"@PARAM/param.pck?withdefaults=1",
        b"/etc/passwd",
        b"",
        b"\0general.json",
        b"general.json\xff",
        b"\xc3\x28",
        &too_long,
    ] {
        assert_eq!(desk.path(ME, 0, OPEN, path), no(MavFtpErr::MAV_FTP_ERR_FILENOTFOUND), "{path:?}");
        assert_eq!(desk.path(ME, 0, CRC, path), no(MavFtpErr::MAV_FTP_ERR_FILENOTFOUND), "{path:?}");
    }
    for path in [b"/general.json".as_slice(), b"general.json\0", b"general.json"] {
        assert!(desk.path(ME, 0, OPEN, path).0, "{path:?}");
    }
}

#[test]
fn spec_nothing_can_be_written_and_what_is_unknown_is_said_to_be() {
    let mut desk = Desk::new();
    assert!(desk.path(ME, 0, OPEN, b"general.json").0);
    for opcode in 6..=13 {
        let said = desk.path(ME, 0, opcode, b"general.json");
        assert_eq!(said, no(MavFtpErr::MAV_FTP_ERR_FILEPROTECTED), "{opcode}");
    }
    for opcode in 16..128 {
        let said = desk.path(ME, 0, opcode, b"general.json");
        assert_eq!(said, no(MavFtpErr::MAV_FTP_ERR_UNKNOWNCOMMAND), "{opcode}");
    }
    assert_eq!(desk.asked(ME, 0, 0, 0, 0, &[]), yes(&[]));
    // Answers are not answered.
    for opcode in 128..=255 {
        assert_eq!(desk.ask(ME, &payload(1, 0, opcode, 0, 0, &[])), None);
    }
}

#[test]
fn spec_a_session_is_its_station_s_alone() {
    let mut desk = Desk::new();
    assert!(desk.path(ME, 3, OPEN, b"general.json").0);
    for opcode in [READ, BURST, 1] {
        assert_eq!(desk.asked(OTHER, 3, opcode, 0, 0, &[]), no(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
        assert_eq!(desk.asked(ME, 4, opcode, 0, 0, &[]), no(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
    }
    // Another's reset closes nothing of ours; our own closes everything.
    assert_eq!(desk.asked(OTHER, 3, 2, 0, 0, &[]), yes(&[]));
    assert!(desk.asked(ME, 3, READ, 1, 0, &[]).0);
    assert_eq!(desk.asked(ME, 0, 2, 0, 0, &[]), yes(&[]));
    assert_eq!(desk.asked(ME, 3, READ, 1, 0, &[]), no(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
}

#[test]
fn spec_what_is_open_is_bounded_and_closed_when_its_station_is_silent() {
    let mut desk = Desk::new();
    let station = |k: u8| (100 + k, 190);
    for k in 0..4 {
        for session in 0..4 {
            assert!(desk.path(station(k), session, OPEN, b"general.json").0);
        }
        // One more is one too many; one of the same number takes its place.
        let full = no(MavFtpErr::MAV_FTP_ERR_NOSESSIONSAVAILABLE);
        assert_eq!(desk.path(station(k), 4, OPEN, b"general.json"), full);
        assert!(desk.path(station(k), 3, OPEN, b"parameter.json").0);
    }
    let fifth = desk.path(station(4), 0, OPEN, b"general.json");
    assert_eq!(fifth, no(MavFtpErr::MAV_FTP_ERR_NOSESSIONSAVAILABLE));
    // What needs no session is for everybody.
    assert!(desk.path(station(4), 0, CRC, b"general.json").0);
    // A station that has closed its files makes room.
    assert!(desk.asked(station(2), 0, 2, 0, 0, &[]).0);
    assert!(desk.path(station(4), 0, OPEN, b"general.json").0);
    desk.now = desk.now + SILENT / 2;
    assert!(desk.asked(station(0), 1, READ, 1, 0, &[]).0);
    desk.now = desk.now + SILENT / 2;
    assert!(desk.asked(station(0), 1, READ, 1, 0, &[]).0, "was heard in between");
    assert_eq!(desk.asked(station(1), 1, READ, 1, 0, &[]), no(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION));
    assert_eq!(desk.server.stations.len(), 1);
}

#[test]
fn spec_a_request_that_is_repeated_has_the_answer_that_it_had() {
    let mut desk = Desk::new();
    for request in [
        payload(1, 5, OPEN, 12, 0, b"general.json"),
        payload(2, 5, READ, 10, 3, &[]),
        payload(3, 5, 1, 0, 0, &[]),
        payload(4, 5, 1, 0, 0, &[]),
        payload(5, 0, 9, 1, 0, b"x"),
    ] {
        let first = desk.ask(ME, &request);
        assert!(first.is_some());
        assert_eq!(desk.ask(ME, &request), first);
    }
    // The same number alone is not the same request: a station that began again counts from 0, too.
    assert_ne!(desk.ask(ME, &payload(5, 0, CRC, 12, 0, b"general.json")).unwrap()[3], 129);
}

#[test]
fn spec_a_burst_comes_in_pieces_one_at_a_time_and_begins_again_when_asked_again() {
    let mut desk = Desk::new();
    let [_, file] = the_files();
    assert!(desk.path(ME, 9, OPEN, b"parameter.json").0);
    let request = payload(65_530, 9, BURST, 100, 200, &[]);
    assert_eq!(desk.ask(ME, &request), None);
    let lost = desk.pieces(Duration::from_millis(300));
    assert!(lost.len() >= 3, "{}", lost.len());
    assert_eq!(desk.ask(ME, &request), None);
    let mut pieces = desk.pieces(Duration::from_secs(9));
    for ((_, _, lost), (_, _, piece)) in lost.iter().zip(&pieces) {
        assert_eq!(lost, piece);
    }
    let mut read = file.text[..200].to_vec();
    let apart = pieces.windows(2).map(|pair| pair[1].0.saturating_since(pair[0].0));
    assert!(apart.min().unwrap() >= BETWEEN_PIECES);
    let last = pieces.pop().unwrap().2;
    for (k, (_, who, piece)) in pieces.iter().enumerate() {
        assert_eq!((*who, piece[2], piece[3], piece[5], piece[6]), (ME, 9, 128, BURST, 0));
        assert_eq!(piece[..2], 65_531_u16.wrapping_add(k as u16).to_le_bytes());
        assert_eq!(piece[8..DATA], (read.len() as u32).to_le_bytes());
        assert_eq!(piece[4], 100);
        read.extend(data(piece));
    }
    assert_eq!(last[6], 1, "the last one says so");
    read.extend(data(&last));
    assert_eq!(read, file.text);
}

#[test]
fn spec_a_burst_ends_with_its_session_and_is_bounded() {
    let mut desk = Desk::new();
    for close in [payload(3, 1, 1, 0, 0, &[]), payload(3, 0, 2, 0, 0, &[])] {
        assert!(desk.path(ME, 1, OPEN, b"parameter.json").0);
        assert_eq!(desk.ask(ME, &payload(2, 1, BURST, 1, 0, &[])), None);
        assert!(!desk.pieces(Duration::from_millis(200)).is_empty());
        assert!(desk.ask(ME, &close).is_some());
        assert_eq!(desk.pieces(Duration::from_secs(1)).len(), 0);
    }
    assert!(desk.path(ME, 1, OPEN, b"parameter.json").0);
    assert_eq!(desk.ask(ME, &payload(2, 1, BURST, 1, 0, &[])), None);
    let pieces = desk.pieces(Duration::from_secs(20));
    assert_eq!(pieces.len(), PIECES as usize);
    assert_eq!(pieces.last().unwrap().2[6], 1, "complete, as far as it goes");
}

#[test]
fn spec_a_session_that_is_opened_anew_ends_its_own_burst_alone_and_a_slow_vehicle_s_pieces_come_slowly() {
    for (opened, goes_on) in [(1, false), (2, true)] {
        let mut desk = Desk::new();
        desk.path(ME, 1, OPEN, b"parameter.json");
        desk.sequence += 1;
        let burst = payload(desk.sequence, 1, BURST, 10, 0, &[]);
        assert_eq!(desk.ask(ME, &burst), None);
        desk.path(ME, opened, OPEN, b"general.json");
        assert_eq!(!desk.pieces(Duration::from_secs(1)).is_empty(), goes_on, "{opened}");
    }
    let mut desk = Desk::new();
    desk.path(ME, 1, OPEN, b"parameter.json");
    let burst = payload(7, 1, BURST, 10, 0, &[]);
    desk.ask(ME, &burst);
    let tick = Duration::from_secs(1);
    let at = |s: u64| Instant::from_start(Duration::from_secs(s));
    let comes = [1, 2, 3, 4].map(|s| desk.server.piece(tick, at(s)).is_some());
    assert_eq!(comes, [true, false, true, false], "at every other tick");
}

#[test]
fn spec_stations_take_turns() {
    let mut desk = Desk::new();
    for who in [ME, OTHER] {
        assert!(desk.path(who, 0, OPEN, b"parameter.json").0);
        assert_eq!(desk.ask(who, &payload(2, 0, BURST, 50, 0, &[])), None);
    }
    let pieces = desk.pieces(Duration::from_secs(1));
    let of = |who| pieces.iter().filter(|(_, to, _)| *to == who).count();
    assert!(of(ME) > 3 && of(ME).abs_diff(of(OTHER)) <= 1, "{} {}", of(ME), of(OTHER));
}

proptest! {
    /// Whatever comes: every request has one answer or a burst, every answer is whole, and what it reads is the file.
    #[test]
    fn prop_garbage_is_answered_and_nothing_grows(
        asked in prop::collection::vec(
            (0..6u8, 0..3u16, 0..6u8, any::<u8>(), any::<u8>(), 0..7000u32, any::<bool>(), 0..3000u64),
            1..200,
        )
    ) {
        let mut desk = Desk::new();
        let files = the_files();
        for (who, sequence, session, opcode, size, offset, named, millis) in asked {
            let who = (who, 190);
            let name = files[usize::from(offset % 2 == 0)].name.as_bytes();
            let given = if named { name } else { &[0xFF, 0x2E, 0x2E] };
            let size = if named && size < 128 { name.len() as u8 } else { size };
            let opcode = opcode % 20;
            let request = payload(sequence, session, opcode, size, offset, given);
            let answer = desk.ask(who, &request);
            match answer {
                None => prop_assert_eq!(opcode, BURST),
                Some(answer) => {
                    prop_assert!(usize::from(answer[4]) <= MOST);
                    prop_assert_eq!(answer[5], opcode);
                    match answer[3] {
                        129 => prop_assert!(answer[4] == 1 && (1..=10).contains(&answer[DATA])),
                        128 if opcode == READ => {
                            let at = offset as usize;
                            let reads = |file: &File| file.text[at.min(file.text.len())..].starts_with(data(&answer));
                            prop_assert!(!data(&answer).is_empty() && files.iter().any(reads));
                        }
                        kind => prop_assert_eq!(kind, 128),
                    }
                }
            }
            for (_, _, piece) in desk.pieces(Duration::from_millis(millis)) {
                let at = u32::from_le_bytes([piece[8], piece[9], piece[10], piece[11]]) as usize;
                prop_assert!(files.iter().any(|file| file.text.get(at..).is_some_and(|text| text.starts_with(data(&piece)))));
            }
            prop_assert!(desk.server.stations.len() <= STATIONS);
            prop_assert!(desk.server.stations.iter().all(|station| station.open.len() <= SESSIONS));
        }
    }
}
