//! How often each link is told what.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::MessageData;
use mavlink::dialects::ardupilotmega::*;

use crate::vehicle::config::{Firmware, Traps};

/// What a link is sent before anybody asks: message id and rate.
const DEFAULT_RATES_HZ: &[(u32, f64)] = &[
    (SYS_STATUS_DATA::ID, 1.0),
    (SYSTEM_TIME_DATA::ID, 1.0),
    (GPS_RAW_INT_DATA::ID, 1.0),
    (ATTITUDE_DATA::ID, 4.0),
    (ATTITUDE_QUATERNION_DATA::ID, 4.0),
    (LOCAL_POSITION_NED_DATA::ID, 4.0),
    (GLOBAL_POSITION_INT_DATA::ID, 4.0),
    (VFR_HUD_DATA::ID, 2.0),
    (BATTERY_STATUS_DATA::ID, 0.5),
    (ESTIMATOR_STATUS_DATA::ID, 1.0),
    (EKF_STATUS_REPORT_DATA::ID, 1.0),
    (HOME_POSITION_DATA::ID, 0.5),
    (EXTENDED_SYS_STATE_DATA::ID, 1.0),
];

/// MAV_DATA_STREAM_ALL.
const EVERY_GROUP: u8 = 0;
/// No group is sent faster than this.
const FASTEST_GROUP_HZ: u32 = 50;

/// What ArduCopter sends in each of MAV_DATA_STREAM's groups, as far as it is here: EXTENDED_STATUS, POSITION, EXTRA1
/// to EXTRA3.
const GROUPS: &[(u8, &[u32])] = &[
    (2, &[SYS_STATUS_DATA::ID, GPS_RAW_INT_DATA::ID]),
    (6, &[LOCAL_POSITION_NED_DATA::ID, GLOBAL_POSITION_INT_DATA::ID]),
    (10, &[ATTITUDE_DATA::ID]),
    (11, &[VFR_HUD_DATA::ID]),
    (12, &[SYSTEM_TIME_DATA::ID, BATTERY_STATUS_DATA::ID, EKF_STATUS_REPORT_DATA::ID]),
];

/// PX4's loop, on whose ticks a message leaves that is due.
const PX4_LOOP: Duration = Duration::from_millis(8);

/// A message sent again and again.
#[derive(Debug, Clone, Copy)]
struct Stream {
    interval: Duration,
    due: Duration,
}

/// The rates of one link.
#[derive(Debug, Clone)]
pub(super) struct Streams {
    streams: BTreeMap<u32, Stream>,
    next_due: Duration,
    /// What is due waits for the next tick of a loop of this period.
    tick: Option<Duration>,
}

impl Streams {
    pub fn new(firmware: Firmware, traps: &Traps, now: Duration) -> Self {
        let tick = (firmware == Firmware::Px4 && traps.uneven_telemetry).then_some(PX4_LOOP);
        let mut streams = Self { streams: BTreeMap::new(), next_due: now, tick };
        for (id, _) in DEFAULT_RATES_HZ {
            streams.set_default(*id, firmware, now);
        }
        streams
    }

    /// Back to the rate that the link began with.
    pub fn set_default(&mut self, id: u32, firmware: Firmware, now: Duration) {
        match DEFAULT_RATES_HZ.iter().find(|(i, _)| *i == id && *i != absent(firmware)) {
            Some((_, rate)) => self.set(id, Duration::from_secs_f64(1.0 / rate), now),
            None => self.stop(id),
        }
    }

    pub fn set(&mut self, id: u32, interval: Duration, now: Duration) {
        self.streams.insert(id, Stream { interval, due: now });
        self.next_due = now;
    }

    /// REQUEST_DATA_STREAM: one of ArduCopter's groups at a rate, or off. Messages outside all groups stay as they are.
    pub fn set_group(&mut self, group: u8, on: bool, rate_hz: u16, now: Duration) {
        let in_group = |g: u8| group == EVERY_GROUP || group == g;
        for id in GROUPS.iter().filter(|(g, _)| in_group(*g)).flat_map(|(_, ids)| ids.iter()) {
            if on && rate_hz > 0 {
                let fastest = u32::from(rate_hz).min(FASTEST_GROUP_HZ);
                self.set(*id, Duration::from_secs(1) / fastest, now);
            } else {
                self.stop(*id);
            }
        }
    }

    pub fn stop(&mut self, id: u32) {
        self.streams.remove(&id);
    }

    /// The interval of a message, if it is sent.
    pub fn interval(&self, id: u32) -> Option<Duration> {
        self.streams.get(&id).map(|s| s.interval)
    }

    /// The messages due at `now`, and when each goes out next. Their times stay on their own grid.
    pub fn due(&mut self, now: Duration) -> Vec<(u32, Duration)> {
        let tick_us = self.tick.map_or(1, |tick| tick.as_micros() as u64);
        let now_us = now.as_micros() as u64;
        // The loop's last tick.
        let by = Duration::from_micros(now_us - now_us % tick_us);
        if by < self.next_due {
            return Vec::new();
        }
        let mut due = Vec::new();
        self.next_due = Duration::MAX;
        for (id, stream) in &mut self.streams {
            if stream.due <= by {
                stream.due += stream.interval;
                if stream.due <= by {
                    stream.due = now + stream.interval;
                }
                let next_us = (stream.due.as_micros() as u64).next_multiple_of(tick_us);
                due.push((*id, Duration::from_micros(next_us)));
            }
            self.next_due = self.next_due.min(stream.due);
        }
        due
    }
}

/// The estimator's health is one message in PX4 and another in ArduCopter: the one that this firmware lacks.
fn absent(firmware: Firmware) -> u32 {
    match firmware {
        Firmware::Px4 => EKF_STATUS_REPORT_DATA::ID,
        Firmware::ArduCopter => ESTIMATOR_STATUS_DATA::ID,
    }
}

/// Does this firmware have a stream of this message?
pub(super) fn has_stream(id: u32, firmware: Firmware) -> bool {
    id != absent(firmware)
        && (DEFAULT_RATES_HZ.iter().any(|(i, _)| *i == id)
            || [GPS_GLOBAL_ORIGIN_DATA::ID, AUTOPILOT_VERSION_DATA::ID].contains(&id))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_streams_keep_their_rate() {
        let mut streams = Streams::new(Firmware::Px4, &Traps::default(), Duration::ZERO);
        let id = LOCAL_POSITION_NED_DATA::ID;
        streams.set(id, Duration::from_millis(20), Duration::ZERO);
        let mut count = 0;
        for tick in 0..4000u32 {
            let now = Duration::from_micros(2500) * tick;
            count += streams.due(now).iter().filter(|(i, _)| *i == id).count();
        }
        assert_eq!(count, 500);
        streams.stop(id);
        assert!(streams.due(Duration::from_secs(11)).iter().all(|(i, _)| *i != id));
        streams.set_default(id, Firmware::Px4, Duration::from_secs(11));
        assert_eq!(streams.interval(id), Some(Duration::from_millis(250)));
    }

    #[test]
    fn spec_px4_sends_on_the_ticks_of_its_loop() {
        let id = LOCAL_POSITION_NED_DATA::ID;
        for (uneven, steps_ms) in [(true, [24, 16, 24, 16, 24]), (false, [20; 5])] {
            let traps = Traps { uneven_telemetry: uneven, ..Traps::default() };
            let mut streams = Streams::new(Firmware::Px4, &traps, Duration::ZERO);
            streams.set(id, Duration::from_millis(20), Duration::ZERO);
            let sent = |ms: &u64| streams.due(Duration::from_millis(*ms)).iter().any(|(i, _)| *i == id);
            let at: Vec<u64> = (0..=110).filter(sent).collect();
            let steps: Vec<u64> = at.windows(2).map(|pair| pair[1] - pair[0]).collect();
            assert_eq!(steps, steps_ms, "{uneven}");
        }
    }

    #[test]
    fn spec_a_group_of_the_old_request() {
        let mut streams = Streams::new(Firmware::ArduCopter, &Traps::default(), Duration::ZERO);
        let interval = |streams: &Streams, id| streams.interval(id).map(|d| d.as_millis());
        streams.set_group(10, true, 20, Duration::ZERO);
        assert_eq!(interval(&streams, ATTITUDE_DATA::ID), Some(50));
        assert_eq!(interval(&streams, VFR_HUD_DATA::ID), Some(500));
        streams.set_group(0, true, 2, Duration::ZERO);
        assert_eq!(interval(&streams, ATTITUDE_DATA::ID), Some(500));
        assert_eq!(interval(&streams, SYS_STATUS_DATA::ID), Some(500));
        // In no group.
        assert_eq!(interval(&streams, HOME_POSITION_DATA::ID), Some(2000));
        streams.set_group(0, false, 2, Duration::ZERO);
        assert_eq!(interval(&streams, ATTITUDE_DATA::ID), None);
        assert_eq!(interval(&streams, HOME_POSITION_DATA::ID), Some(2000));
    }
}
