//! What the two vehicles said to each other of jam leases.

use std::collections::BTreeMap;
use std::path::Path;

use super::{TelemetryError, frames};
use crate::link::{Envelope, RawFrame, TlogReader};
use crate::pair::wire::MavMessage;
use crate::role::Role;

/// Requests are remembered this long: a grant for an older one is of no use to anybody.
const REMEMBERED_US: u64 = 5_000_000;

/// Something that was said of leases, at the side of the vehicle whose log tells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lease {
    /// Flight seconds.
    pub at_s: f64,
    /// What was said.
    pub what: Said,
    /// Its slot.
    pub slot: u16,
    /// The length granted, from the request on; 0 unless it is a grant.
    pub duration_ms: u16,
    /// How much of the lease in force is left then, as long as nobody gives it up.
    pub left_s: f64,
}

/// What was said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Said {
    /// I asked.
    Asked,
    /// J granted.
    Granted,
    /// I said that it is off and has given up every lease.
    GivenUp,
}

/// The leases of a flight by the pair's log of vehicle I, or of J where I's has none; none without such a log.
///
/// # Errors
/// [`TelemetryError`]: a log that is none.
pub fn leases(directory: &Path) -> Result<Vec<Lease>, TelemetryError> {
    let Some(zero_us) = zero_us(directory)? else { return Ok(Vec::new()) };
    for role in Role::BOTH {
        let path = directory.join(format!("{}-pair.tlog", role.key()));
        // That a log was cut off is told by the report.
        let said = follow(&frames(&path, role, &mut Vec::new())?, zero_us);
        if !said.is_empty() {
            return Ok(said);
        }
    }
    Ok(Vec::new())
}

/// The first instant of any log: flight second zero.
fn zero_us(directory: &Path) -> Result<Option<u64>, TelemetryError> {
    let mut zero = None;
    for role in Role::BOTH {
        for link in ["autopilot", "pair", "transmitter"] {
            let path = directory.join(format!("{}-{link}.tlog", role.key()));
            if !path.exists() {
                continue;
            }
            let failed = |source| TelemetryError::Log { path: path.clone(), source };
            let first = TlogReader::open(&path).map_err(failed)?.next();
            if let Some(Ok((utc, _))) = first {
                zero = Some(zero.map_or(utc.unix_us, |zero: u64| zero.min(utc.unix_us)));
            }
        }
    }
    Ok(zero)
}

fn follow(log: &[(u64, RawFrame)], zero_us: u64) -> Vec<Lease> {
    let mut said = Vec::new();
    // When I asked, by the number that it asked with.
    let mut asked: BTreeMap<u64, u64> = BTreeMap::new();
    let mut leader = None;
    let (mut until_us, mut given_up_us) = (0, None);
    for (us, frame) in log {
        let Ok(message) = frame.parse::<Envelope>() else { continue };
        let (what, slot, duration_ms) = match message.message.message() {
            MavMessage::VEILWING_LEASE_REQUEST(m) => {
                leader = Some(message.header.system_id);
                if asked.contains_key(&m.time_us) {
                    continue;
                }
                asked.retain(|_, at_us| *at_us + REMEMBERED_US >= *us);
                asked.insert(m.time_us, *us);
                (Said::Asked, m.slot, 0)
            }
            MavMessage::VEILWING_LEASE_GRANT(m) => {
                let Some(asked_us) = asked.get(&m.time_us) else { continue };
                if given_up_us.is_none_or(|given_up| *asked_us > given_up) {
                    until_us = until_us.max(asked_us + 1000 * u64::from(m.duration_ms));
                }
                (Said::Granted, m.slot, m.duration_ms)
            }
            MavMessage::VEILWING_STATUS(m)
                if leader == Some(message.header.system_id) && m.released_us > 0 && until_us > 0 =>
            {
                (until_us, given_up_us) = (0, Some(*us));
                (Said::GivenUp, m.slot, 0)
            }
            _ => continue,
        };
        let left_s = until_us.saturating_sub(*us) as f64 * 1e-6;
        said.push(Lease { at_s: us.saturating_sub(zero_us) as f64 * 1e-6, what, slot, duration_ms, left_s });
    }
    said
}
