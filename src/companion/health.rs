//! How this computer fares, once a second, for the ground station: ONBOARD_COMPUTER_STATUS.
//!
//! A thread looks, since a disk may hang; the event loop sends, so that nothing goes out when the loop does not turn (F3).

use std::io;
use std::path::PathBuf;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, ONBOARD_COMPUTER_STATUS_DATA};
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

use crate::computer::{Reading, Room, Ticks};
use crate::time::Utc;

/// From one look to the next.
const EVERY: Duration = Duration::from_secs(1);
/// What a byte says where nothing is known, a sensor that is not there, and a count.
const NO_SHARE: u8 = u8::MAX;
const NO_DEGREES: i8 = i8::MAX;
const NO_COUNT: u32 = u32::MAX;

/// Looks at the computer, until it is dropped.
#[derive(Debug)]
pub(super) struct Watch {
    looks: UnboundedReceiver<[Reading; 2]>,
    /// Its end ends the thread.
    _alive: Sender<()>,
}

impl Watch {
    /// Of the disk of this directory, too.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn begin(directory: PathBuf) -> io::Result<Self> {
        let (send, looks) = unbounded_channel();
        let (alive, ended) = channel::<()>();
        std::thread::Builder::new().name("health".to_owned()).spawn(move || {
            let mut before = Reading::take(&directory);
            while ended.recv_timeout(EVERY) == Err(RecvTimeoutError::Timeout) {
                let now = Reading::take(&directory);
                if send.send([before, now.clone()]).is_err() {
                    break;
                }
                before = now;
            }
        })?;
        Ok(Self { looks, _alive: alive })
    }
}

/// The next look, and the one before it. Never, where nobody looks; of several that wait, the newest.
pub(super) async fn next(watch: &mut Option<Watch>) -> [Reading; 2] {
    let Some(watch) = watch else { return std::future::pending().await };
    match watch.looks.recv().await {
        Some(mut look) => {
            while let Ok(newer) = watch.looks.try_recv() {
                look = newer;
            }
            look
        }
        None => std::future::pending().await,
    }
}

/// The message of two looks.
pub(super) fn message([before, now]: &[Reading; 2], utc: Utc) -> MavMessage {
    let mut status = ONBOARD_COMPUTER_STATUS_DATA {
        time_usec: utc.unix_us,
        uptime: now.uptime_ms.map_or(0, |ms| u32::try_from(ms).unwrap_or(u32::MAX)),
        ram_usage: now.memory.map_or(NO_COUNT, |memory| mib(memory.total.saturating_sub(memory.free))),
        ram_total: now.memory.map_or(NO_COUNT, |memory| mib(memory.total)),
        storage_type: [NO_COUNT; 4],
        storage_usage: [NO_COUNT; 4],
        storage_total: [NO_COUNT; 4],
        link_type: [NO_COUNT; 6],
        link_tx_rate: [NO_COUNT; 6],
        link_rx_rate: [NO_COUNT; 6],
        link_tx_max: [NO_COUNT; 6],
        link_rx_max: [NO_COUNT; 6],
        fan_speed: [i16::MAX; 4],
        cpu_cores: [NO_SHARE; 8],
        cpu_combined: [NO_SHARE; 10],
        gpu_cores: [NO_SHARE; 4],
        gpu_combined: [NO_SHARE; 10],
        temperature_board: now
            .hottest_c
            .map_or(NO_DEGREES, |celsius| celsius.clamp(-127.0, 126.0).round() as i8),
        temperature_core: [NO_DEGREES; 8],
        ..ONBOARD_COMPUTER_STATUS_DATA::default()
    };
    if let Some(Room { free, total }) = now.disk {
        (status.storage_usage[0], status.storage_total[0]) = (mib(total.saturating_sub(free)), mib(total));
    }
    for (core, (before, now)) in status.cpu_cores.iter_mut().zip(before.cores.iter().zip(&now.cores)) {
        *core = percent(*now, *before);
    }
    if let Some((before, now)) = before.processors.zip(now.processors) {
        status.cpu_combined[0] = percent(now, before);
    }
    MavMessage::ONBOARD_COMPUTER_STATUS(status)
}

fn percent(now: Ticks, before: Ticks) -> u8 {
    now.share_since(before).map_or(NO_SHARE, |share| (share * 100.0).round() as u8)
}

/// The message counts in MiB.
fn mib(bytes: u64) -> u32 {
    u32::try_from(bytes >> 20).unwrap_or(NO_COUNT - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_the_ground_hears_shares_degrees_and_mib_and_of_what_is_not_known_that() {
        let before = Reading {
            processors: Some(Ticks { busy: 100, all: 1000 }),
            cores: vec![Ticks { busy: 50, all: 500 }; 2],
            ..Reading::default()
        };
        let now = Reading {
            processors: Some(Ticks { busy: 150, all: 1200 }),
            cores: vec![Ticks { busy: 50, all: 600 }, Ticks { busy: 100, all: 600 }],
            memory: Some(Room { free: 1 << 30, total: 4 << 30 }),
            disk: Some(Room { free: 10 << 30, total: 30 << 30 }),
            hottest_c: Some(61.6),
            uptime_ms: Some(5000),
        };
        let utc = Utc { unix_us: 7 };
        let MavMessage::ONBOARD_COMPUTER_STATUS(status) = message(&[before, now], utc) else { panic!() };
        assert_eq!((status.time_usec, status.uptime), (7, 5000));
        assert_eq!((status.cpu_combined[0], status.cpu_combined[1]), (25, u8::MAX));
        assert_eq!((status.cpu_cores[..3]), [0, 50, u8::MAX]);
        assert_eq!((status.ram_usage, status.ram_total), (3072, 4096));
        assert_eq!((status.storage_usage[0], status.storage_total[0]), (20_480, 30_720));
        assert_eq!(status.temperature_board, 62);
        let nothing = message(&[Reading::default(), Reading::default()], utc);
        let MavMessage::ONBOARD_COMPUTER_STATUS(status) = nothing else { panic!() };
        assert_eq!((status.cpu_combined[0], status.temperature_board), (u8::MAX, i8::MAX));
        assert_eq!((status.ram_total, status.storage_total[0]), (u32::MAX, u32::MAX));
    }
}
