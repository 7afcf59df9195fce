//! Telemetry: asked for with SET_MESSAGE_INTERVAL, then counted, and asked for again where it does not come.

use std::time::Duration;

use mavlink::dialects::ardupilotmega as mav;
use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult};
use mavlink::{Message, MessageData};

use super::command::{CommandQueue, Purpose, long};
use super::firmware::Firmware;
use crate::time::Instant;

/// Arrivals are counted over this long.
const WINDOW: Duration = Duration::from_secs(2);
/// A stream that comes at less than this part of the rate asked for is asked for again.
const TOLERATED: f64 = 0.7;
const STATUS_RATE_HZ: f64 = 2.0;
/// As fast as receivers fix: the loss of a fix shows in nothing else for seconds.
const GPS_RATE_HZ: f64 = 5.0;
/// Position and attitude slower than this are not waited for.
const SLOWEST_STATE_HZ: f64 = 5.0;
/// One-shot requests are repeated this often until the message has come.
const REQUEST_INTERVAL: Duration = Duration::from_secs(1);
/// The local origin is asked for for ever: an estimator may move it.
const ORIGIN_INTERVAL: Duration = Duration::from_secs(5);

#[derive(Debug, Clone)]
struct Stream {
    id: u32,
    name: &'static str,
    rate_hz: f64,
    /// Position and attitude: nothing flies without them.
    essential: bool,
    supported: bool,
    arrived: u32,
    /// Rate over the last whole window.
    measured_hz: Option<f64>,
}

/// A message that is wanted once.
#[derive(Debug, Clone)]
struct Single {
    id: u32,
    known: bool,
}

/// The streams asked for and how they come.
#[derive(Debug, Clone, Default)]
pub(super) struct Streams {
    streams: Vec<Stream>,
    singles: Vec<Single>,
    window_since: Option<Instant>,
    request_at: Option<Instant>,
}

/// A stream that is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// The message's number.
    pub id: u32,
    /// Its name.
    pub name: &'static str,
    /// How many a second.
    pub rate_hz: f64,
    /// Position or attitude: nothing flies without them.
    pub essential: bool,
}

/// How a stream comes, for the preflight checks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StreamReport {
    pub(super) name: &'static str,
    pub(super) essential: bool,
    pub(super) wanted_hz: f64,
    pub(super) measured_hz: Option<f64>,
    pub(super) good: bool,
}

impl Streams {
    /// Asks for everything, forgetting what was measured.
    pub(super) fn start(
        &mut self,
        firmware: Firmware,
        rate_hz: f64,
        commands: &mut CommandQueue,
        now: Instant,
    ) {
        let (estimator_id, estimator) = firmware.estimator_message();
        let stream = |id, name, rate_hz, essential| Stream {
            id,
            name,
            rate_hz,
            essential,
            supported: true,
            arrived: 0,
            measured_hz: None,
        };
        self.streams = vec![
            stream(mav::LOCAL_POSITION_NED_DATA::ID, mav::LOCAL_POSITION_NED_DATA::NAME, rate_hz, true),
            stream(mav::ATTITUDE_QUATERNION_DATA::ID, mav::ATTITUDE_QUATERNION_DATA::NAME, rate_hz, true),
            stream(
                mav::EXTENDED_SYS_STATE_DATA::ID,
                mav::EXTENDED_SYS_STATE_DATA::NAME,
                STATUS_RATE_HZ,
                false,
            ),
            stream(estimator_id, estimator, STATUS_RATE_HZ, false),
            stream(mav::SYS_STATUS_DATA::ID, mav::SYS_STATUS_DATA::NAME, STATUS_RATE_HZ, false),
            stream(mav::BATTERY_STATUS_DATA::ID, mav::BATTERY_STATUS_DATA::NAME, STATUS_RATE_HZ, false),
            stream(mav::GPS_RAW_INT_DATA::ID, mav::GPS_RAW_INT_DATA::NAME, GPS_RATE_HZ, false),
            stream(mav::SYSTEM_TIME_DATA::ID, mav::SYSTEM_TIME_DATA::NAME, STATUS_RATE_HZ, false),
            stream(
                mav::GLOBAL_POSITION_INT_DATA::ID,
                mav::GLOBAL_POSITION_INT_DATA::NAME,
                STATUS_RATE_HZ,
                false,
            ),
            stream(mav::HOME_POSITION_DATA::ID, mav::HOME_POSITION_DATA::NAME, 1.0, false),
        ];
        let single = |id| Single { id, known: false };
        self.singles = vec![
            single(mav::GPS_GLOBAL_ORIGIN_DATA::ID),
            single(mav::HOME_POSITION_DATA::ID),
            single(mav::AUTOPILOT_VERSION_DATA::ID),
        ];
        self.streams.iter().for_each(|stream| ask(stream, commands));
        self.window_since = Some(now);
        self.request_at = Some(now);
    }

    /// Counts an arrival.
    pub(super) fn heard(&mut self, message: &MavMessage) {
        let id = message.message_id();
        self.streams.iter_mut().filter(|s| s.id == id).for_each(|s| s.arrived = s.arrived.saturating_add(1));
        self.singles.iter_mut().filter(|s| s.id == id).for_each(|s| s.known = true);
    }

    /// Takes the answer to SET_MESSAGE_INTERVAL: what is unsupported is not asked for again, and a rate that is
    /// refused (ArduCopter: above its loop rate) is halved.
    pub(super) fn answered(&mut self, id: u32, outcome: Option<MavResult>) {
        let Some(stream) = self.streams.iter_mut().find(|stream| stream.id == id) else { return };
        match outcome {
            None | Some(MavResult::MAV_RESULT_ACCEPTED | MavResult::MAV_RESULT_TEMPORARILY_REJECTED) => {}
            Some(MavResult::MAV_RESULT_UNSUPPORTED) if !stream.essential => stream.supported = false,
            Some(_) => stream.rate_hz = (stream.rate_hz / 2.0).max(STATUS_RATE_HZ),
        }
    }

    /// The longest time between two messages of an essential stream, at the rate granted or the rate that came,
    /// whichever is lower; `None` before anything was asked for.
    pub(super) fn state_period(&self) -> Option<Duration> {
        let rate = |s: &Stream| s.measured_hz.map_or(s.rate_hz, |measured| measured.min(s.rate_hz));
        let slowest = self.streams.iter().filter(|s| s.essential).map(rate).min_by(f64::total_cmp)?;
        Some(Duration::from_secs_f64(1.0 / slowest.max(SLOWEST_STATE_HZ)))
    }

    /// Closes the counting window and asks again for what does not come.
    pub(super) fn advance(&mut self, now: Instant, commands: &mut CommandQueue) {
        if let Some(since) = self.window_since
            && now.saturating_since(since) >= WINDOW
        {
            let span_s = now.saturating_since(since).as_secs_f64();
            for stream in &mut self.streams {
                stream.measured_hz = Some(f64::from(stream.arrived) / span_s);
                stream.arrived = 0;
                if stream.supported && !stream.good() {
                    ask(stream, commands);
                }
            }
            self.window_since = Some(now);
        }
        if self.request_at.is_some_and(|at| at <= now) {
            let missing = |single: &&Single| !single.known || single.id == mav::GPS_GLOBAL_ORIGIN_DATA::ID;
            let wanted: Vec<u32> = self.singles.iter().filter(missing).map(|single| single.id).collect();
            let all_known = self.singles.iter().all(|single| single.known);
            self.request_at = Some(now + if all_known { ORIGIN_INTERVAL } else { REQUEST_INTERVAL });
            for id in wanted {
                commands.push(request(id), Purpose::Request(id));
            }
        }
    }

    pub(super) fn timeout(&self) -> Option<Instant> {
        [self.window_since.map(|since| since + WINDOW), self.request_at].into_iter().flatten().min()
    }

    /// What is asked for.
    pub(super) fn wanted(&self) -> impl Iterator<Item = Wanted> {
        let supported = self.streams.iter().filter(|stream| stream.supported);
        supported.map(|s| Wanted { id: s.id, name: s.name, rate_hz: s.rate_hz, essential: s.essential })
    }

    /// How every stream comes.
    pub(super) fn report(&self) -> impl Iterator<Item = StreamReport> {
        self.streams.iter().map(|s| StreamReport {
            name: s.name,
            essential: s.essential,
            wanted_hz: s.rate_hz,
            measured_hz: s.measured_hz,
            good: s.good(),
        })
    }
}

impl Stream {
    fn good(&self) -> bool {
        // Slow streams are counted in whole messages: one may fall outside the window.
        self.measured_hz.is_some_and(|hz| {
            hz * WINDOW.as_secs_f64() + 1.0 >= TOLERATED * self.rate_hz * WINDOW.as_secs_f64()
        }) && self.measured_hz.is_some_and(|hz| hz > 0.0)
    }
}

/// The command that asks for one message.
pub(super) fn request(id: u32) -> COMMAND_LONG_DATA {
    long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [id as f32, 0.0])
}

fn ask(stream: &Stream, commands: &mut CommandQueue) {
    let interval_us = 1e6 / stream.rate_hz;
    let command = long(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [stream.id as f32, interval_us as f32]);
    commands.push(command, Purpose::Interval(stream.id));
}
