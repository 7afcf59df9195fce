//! MAVLink FTP (<https://mavlink.io/en/services/ftp.html>), to read what describes our parameters and nothing else: there is no
//! disk behind it, and nothing can be written. Whoever may read a parameter may read it. MAVProxy asks every component for a
//! file of its parameters first, and asks for them one by one when there is none.
//!
//! A request is answered at once with one message. A burst leaves in pieces, one at a time at the executive's ticks, so that a
//! station that reads delays no setpoint and floods no telemetry radio. A request that is repeated has the answer that it had.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{FILE_TRANSFER_PROTOCOL_DATA, MavFtpErr, MavFtpOpcode, MavMessage};
use num_traits::FromPrimitive;

use crate::mission::executive::Executive;
use crate::mission::ground_station::metadata::{File, files};
use crate::time::Instant;

/// Of a payload: sequence (2), session, opcode, size, opcode asked for, burst complete, padding, offset (4), then the data.
const DATA: usize = 12;
/// The most data of one message.
const MOST: usize = 251 - DATA;
/// Stations that may have files open at a time, and how many each.
const STATIONS: usize = 4;
const SESSIONS: usize = 4;
/// A station that asks for nothing this long has gone: its files are closed.
const SILENT: Duration = Duration::from_secs(10);
/// Between two pieces of bursts. With all its data a piece has about 270 bytes: 20 a second are what a slow radio carries.
const BETWEEN_PIECES: Duration = Duration::from_millis(50);
/// Of one burst; then the station asks on, if it is still there.
const PIECES: u32 = 64;

type Payload = [u8; 251];
/// System and component.
type Who = (u8, u8);

/// A station that has opened a file.
#[derive(Debug, Clone)]
struct Station {
    who: Who,
    heard_at: Instant,
    /// Files by session. The number is the station's: MAVProxy holds several, and knows its answers by it.
    open: BTreeMap<u8, &'static File>,
    burst: Option<Burst>,
    /// Its last request and the answer to it.
    last: Option<(Payload, Payload)>,
}

/// What is left of a burst.
#[derive(Debug, Clone, Copy)]
struct Burst {
    session: u8,
    file: &'static File,
    /// Of the next piece.
    sequence: u16,
    offset: usize,
    size: usize,
    pieces: u32,
}

/// Who has what open.
#[derive(Debug, Clone)]
pub(super) struct FileServer {
    stations: Vec<Station>,
    next_piece_at: Instant,
}

/// What was asked for, as far as it can be read.
struct Request<'a> {
    sequence: u16,
    session: u8,
    opcode: Option<MavFtpOpcode>,
    /// How much data it has, or wants.
    size: usize,
    offset: usize,
    data: &'a [u8],
}

impl<'a> Request<'a> {
    /// `None` for what is itself an answer.
    fn of(payload: &'a Payload) -> Option<Result<Self, MavFtpErr>> {
        let [low, high, session, opcode, size, ..] = *payload;
        let [.., a, b, c, d] = *payload.first_chunk::<DATA>()?;
        if opcode >= MavFtpOpcode::MAV_FTP_OPCODE_ACK as u8 {
            return None;
        }
        let size = usize::from(size);
        let data = payload.get(DATA..DATA + size);
        Some(data.ok_or(MavFtpErr::MAV_FTP_ERR_INVALIDDATASIZE).map(|data| Self {
            sequence: u16::from_le_bytes([low, high]),
            session,
            opcode: MavFtpOpcode::from_u8(opcode),
            size,
            offset: u32::from_le_bytes([a, b, c, d]) as usize,
            data,
        }))
    }

    /// Its path without what may stand before a name in the only directory there is. What is not UTF-8 names nothing.
    fn path(&self) -> Option<&'a str> {
        let end = self.data.iter().position(|byte| *byte == 0).unwrap_or(self.data.len());
        let path = std::str::from_utf8(self.data.get(..end)?).ok()?;
        Some(path.strip_prefix('/').unwrap_or(path))
    }

    fn file(&self, files: &'static [File]) -> Result<&'static File, MavFtpErr> {
        let path = self.path();
        files.iter().find(|file| Some(file.name) == path).ok_or(MavFtpErr::MAV_FTP_ERR_FILENOTFOUND)
    }

    /// Names and sizes, from entry `offset` on.
    fn directory(&self, files: &'static [File]) -> Result<Vec<u8>, MavFtpErr> {
        if !matches!(self.path(), Some("" | ".")) {
            return Err(MavFtpErr::MAV_FTP_ERR_FILENOTFOUND);
        }
        let mut listed = Vec::new();
        for file in files.iter().skip(self.offset) {
            let entry = format!("F{}\t{}\0", file.name, file.text.len());
            if listed.len() + entry.len() > MOST {
                break;
            }
            listed.extend_from_slice(entry.as_bytes());
        }
        if listed.is_empty() { Err(MavFtpErr::MAV_FTP_ERR_EOF) } else { Ok(listed) }
    }

    /// How much data each answer is to have at most; who does not say it gets all that fits.
    fn piece(&self) -> usize {
        if self.size == 0 { MOST } else { self.size.min(MOST) }
    }
}

/// The bytes of a file from there on.
fn part(file: &'static File, offset: usize, size: usize) -> Result<&'static [u8], MavFtpErr> {
    let left = file.text.get(offset..).filter(|left| !left.is_empty());
    let left = left.ok_or(MavFtpErr::MAV_FTP_ERR_EOF)?;
    Ok(left.get(..size).unwrap_or(left))
}

/// The answer to a request: its data, or why there are none.
fn answered(request: &Payload, answer: Result<&[u8], MavFtpErr>) -> Payload {
    let [low, high, session, opcode, ..] = *request;
    let (kind, error);
    let data = match answer {
        Ok(data) => {
            kind = MavFtpOpcode::MAV_FTP_OPCODE_ACK;
            data
        }
        Err(why) => {
            kind = MavFtpOpcode::MAV_FTP_OPCODE_NAK;
            error = [why as u8];
            &error
        }
    };
    let mut payload = [0; 251];
    payload[..2].copy_from_slice(&u16::from_le_bytes([low, high]).wrapping_add(1).to_le_bytes());
    payload[2] = session;
    payload[3] = kind as u8;
    payload[5] = opcode;
    payload[8..DATA].copy_from_slice(&request[8..DATA]);
    fill(&mut payload, data);
    payload
}

fn fill(payload: &mut Payload, data: &[u8]) {
    let size = data.len().min(MOST);
    payload[4] = size as u8;
    payload[DATA..DATA + size].copy_from_slice(&data[..size]);
}

impl FileServer {
    pub fn new(now: Instant) -> Self {
        Self { stations: Vec::new(), next_piece_at: now }
    }

    /// The answer to a request; `None` to what is none, and to a burst, whose pieces follow.
    fn answer(
        &mut self,
        files: &'static [File],
        who: Who,
        payload: &Payload,
        now: Instant,
    ) -> Option<Payload> {
        let request = Request::of(payload)?;
        self.stations.retain(|station| now.saturating_since(station.heard_at) < SILENT);
        if let Some(station) = self.station(who) {
            station.heard_at = now;
            if let Some((_, answer)) = station.last.as_ref().filter(|(last, _)| last == payload) {
                return Some(*answer);
            }
        }
        let done = request.and_then(|request| self.carry_out(files, who, &request, now));
        // A burst that is asked for again begins again.
        let answer = done.transpose().map(|done| match done {
            Ok(data) => answered(payload, Ok(&data)),
            Err(error) => answered(payload, Err(error)),
        });
        if let Some(station) = self.station(who) {
            station.last = answer.map(|answer| (*payload, answer));
        }
        answer
    }

    fn station(&mut self, who: Who) -> Option<&mut Station> {
        self.stations.iter_mut().find(|station| station.who == who)
    }

    fn opened(&mut self, who: Who, session: u8) -> Result<(&mut Station, &'static File), MavFtpErr> {
        let station = self.station(who);
        let opened =
            station.and_then(|station| station.open.get(&session).copied().map(|file| (station, file)));
        opened.ok_or(MavFtpErr::MAV_FTP_ERR_INVALIDSESSION)
    }

    /// The data that answers it; `None`: they come in pieces.
    fn carry_out(
        &mut self,
        files: &'static [File],
        who: Who,
        request: &Request<'_>,
        now: Instant,
    ) -> Result<Option<Vec<u8>>, MavFtpErr> {
        use MavFtpOpcode as Do;
        let data = match request.opcode.ok_or(MavFtpErr::MAV_FTP_ERR_UNKNOWNCOMMAND)? {
            Do::MAV_FTP_OPCODE_NONE => Vec::new(),
            Do::MAV_FTP_OPCODE_TERMINATESESSION => {
                let (station, _) = self.opened(who, request.session)?;
                station.open.remove(&request.session);
                station.burst = station.burst.filter(|burst| burst.session != request.session);
                Vec::new()
            }
            Do::MAV_FTP_OPCODE_RESETSESSION => {
                if let Some(station) = self.station(who) {
                    station.open.clear();
                    station.burst = None;
                }
                Vec::new()
            }
            Do::MAV_FTP_OPCODE_LISTDIRECTORY => request.directory(files)?,
            Do::MAV_FTP_OPCODE_OPENFILERO => {
                let file = request.file(files)?;
                self.open(who, request.session, file, now)?;
                (file.text.len() as u32).to_le_bytes().to_vec()
            }
            Do::MAV_FTP_OPCODE_READFILE => {
                let (_, file) = self.opened(who, request.session)?;
                part(file, request.offset, request.piece())?.to_vec()
            }
            Do::MAV_FTP_OPCODE_CALCFILECRC => request.file(files)?.crc.to_le_bytes().to_vec(),
            Do::MAV_FTP_OPCODE_BURSTREADFILE => {
                let (station, file) = self.opened(who, request.session)?;
                part(file, request.offset, 1)?;
                station.burst = Some(Burst {
                    session: request.session,
                    file,
                    sequence: request.sequence.wrapping_add(1),
                    offset: request.offset,
                    size: request.piece(),
                    pieces: 0,
                });
                return Ok(None);
            }
            Do::MAV_FTP_OPCODE_CREATEFILE
            | Do::MAV_FTP_OPCODE_WRITEFILE
            | Do::MAV_FTP_OPCODE_REMOVEFILE
            | Do::MAV_FTP_OPCODE_CREATEDIRECTORY
            | Do::MAV_FTP_OPCODE_REMOVEDIRECTORY
            | Do::MAV_FTP_OPCODE_OPENFILEWO
            | Do::MAV_FTP_OPCODE_TRUNCATEFILE
            | Do::MAV_FTP_OPCODE_RENAME => return Err(MavFtpErr::MAV_FTP_ERR_FILEPROTECTED),
            _ => return Err(MavFtpErr::MAV_FTP_ERR_UNKNOWNCOMMAND),
        };
        Ok(Some(data))
    }

    /// Opens a file, or another one in its place, for it is the station that gives the number.
    fn open(&mut self, who: Who, session: u8, file: &'static File, now: Instant) -> Result<(), MavFtpErr> {
        if self.station(who).is_none() {
            if self.stations.len() >= STATIONS {
                // One that has closed everything is remembered for its last answer alone.
                let idle = self.stations.iter().position(|station| station.open.is_empty());
                self.stations.remove(idle.ok_or(MavFtpErr::MAV_FTP_ERR_NOSESSIONSAVAILABLE)?);
            }
            let open = BTreeMap::new();
            self.stations.push(Station { who, heard_at: now, open, burst: None, last: None });
        }
        let station = self.station(who).ok_or(MavFtpErr::MAV_FTP_ERR_FAIL)?;
        if station.open.len() >= SESSIONS && !station.open.contains_key(&session) {
            return Err(MavFtpErr::MAV_FTP_ERR_NOSESSIONSAVAILABLE);
        }
        station.burst = station.burst.filter(|burst| burst.session != session);
        station.open.insert(session, file);
        Ok(())
    }

    /// The next piece of a burst and whose it is, if one is due; the stations by turns.
    fn piece(&mut self, tick: Duration, now: Instant) -> Option<(Who, Payload)> {
        if now < self.next_piece_at {
            return None;
        }
        let index = self.stations.iter().position(|station| station.burst.is_some())?;
        // Every other tick at most, so that a slow vehicle's figures go on.
        self.next_piece_at = now + BETWEEN_PIECES.max(tick * 2);
        let station = self.stations.get_mut(index)?;
        let who = station.who;
        let burst = station.burst.take()?;
        let data = part(burst.file, burst.offset, burst.size).ok()?;
        let next = Burst {
            sequence: burst.sequence.wrapping_add(1),
            offset: burst.offset + data.len(),
            pieces: burst.pieces + 1,
            ..burst
        };
        let complete = next.offset >= burst.file.text.len() || next.pieces >= PIECES;
        station.burst = (!complete).then_some(next);
        self.stations.rotate_left(index + 1);
        let mut payload = [0; 251];
        payload[..2].copy_from_slice(&burst.sequence.to_le_bytes());
        payload[2] = burst.session;
        payload[3] = MavFtpOpcode::MAV_FTP_OPCODE_ACK as u8;
        payload[5] = MavFtpOpcode::MAV_FTP_OPCODE_BURSTREADFILE as u8;
        payload[6] = u8::from(complete);
        payload[8..DATA].copy_from_slice(&(burst.offset as u32).to_le_bytes());
        fill(&mut payload, data);
        Some((who, payload))
    }
}

fn message((target_system, target_component): Who, payload: Payload) -> MavMessage {
    MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
        target_network: 0,
        target_system,
        target_component,
        payload,
    })
}

impl Executive {
    /// Takes a file request that is addressed to us alone: what is addressed to all is the autopilot's to answer.
    pub(in crate::mission) fn handle_files(
        &mut self,
        header: MavHeader,
        message_in: &MavMessage,
        now: Instant,
    ) {
        let MavMessage::FILE_TRANSFER_PROTOCOL(m) = message_in else { return };
        // A system id of MAVLink 2's wider form cannot be answered.
        let Ok(system) = u8::try_from(header.system_id) else { return };
        if (m.target_system, m.target_component) != self.settings.own {
            return;
        }
        let who = (system, header.component_id);
        let files = files(self.settings.role);
        let answer = self.ground_station.files.answer(files, who, &m.payload, now);
        self.outbox.extend(answer.map(|payload| message(who, payload)));
    }

    /// The next piece of a burst, if one is due.
    pub(super) fn file_piece(&mut self, now: Instant) -> Option<MavMessage> {
        let tick = Duration::from_secs_f64(1.0 / self.settings.autopilot.rate_hz);
        self.ground_station.files.piece(tick, now).map(|(who, payload)| message(who, payload))
    }
}

#[cfg(test)]
mod tests;
