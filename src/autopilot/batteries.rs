//! The batteries that a vehicle flies on: what SYS_STATUS says of all of them, and BATTERY_STATUS of each.
//!
//! A vehicle flies as long as the weakest of them. SYS_STATUS tells of one alone, and neither how long it lasts nor that it has failed.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    BATTERY_STATUS_DATA, MavBatteryChargeState as State, MavBatteryFunction as Function,
};

use super::state::{Battery, Timed};
use crate::time::Instant;

/// A battery that is not heard of for so long is none any more.
const SILENT: Duration = Duration::from_secs(10);
/// No vehicle has more.
const MOST: usize = 16;

/// What BATTERY_STATUS says of one.
#[derive(Debug, Clone, Copy, PartialEq)]
struct One {
    id: u8,
    /// Of 1; 0 of one that has failed.
    remaining: Option<f64>,
    lasts: Option<Duration>,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Batteries {
    each: Vec<Timed<One>>,
    /// As SYS_STATUS has it.
    all: Option<Battery>,
}

/// A charge in percent, of 1.
pub(super) fn charge(percent: i8) -> Option<f64> {
    (0..=100).contains(&percent).then(|| f64::from(percent) / 100.0)
}

impl Batteries {
    /// What SYS_STATUS says.
    pub fn take_all(&mut self, battery: Battery) {
        self.all = Some(battery);
    }

    /// What BATTERY_STATUS says of one; of one that no motor runs on, nothing.
    pub fn take(&mut self, m: &BATTERY_STATUS_DATA, now: Instant) {
        if matches!(
            m.battery_function,
            Function::MAV_BATTERY_FUNCTION_AVIONICS | Function::MAV_BATTERY_FUNCTION_PAYLOAD
        ) {
            return;
        }
        let failed = matches!(
            m.charge_state,
            State::MAV_BATTERY_CHARGE_STATE_EMERGENCY
                | State::MAV_BATTERY_CHARGE_STATE_FAILED
                | State::MAV_BATTERY_CHARGE_STATE_UNHEALTHY
        );
        let lasts = u64::try_from(m.time_remaining).ok().filter(|s| *s > 0).map(Duration::from_secs);
        let remaining = if failed { Some(0.0) } else { charge(m.battery_remaining) };
        self.each.retain(|one| one.value.id != m.id && one.received_at + SILENT >= now);
        if self.each.len() < MOST {
            self.each.push(Timed::new(One { id: m.id, remaining, lasts }, now));
        }
    }

    /// The weakest of those that are heard of.
    pub fn weakest(&self, now: Instant) -> Option<Battery> {
        let heard = self.each.iter().filter(|one| one.received_at + SILENT >= now).map(|one| one.value);
        let all = self.all.into_iter().chain(heard.map(|one| Battery {
            remaining: one.remaining,
            voltage_v: None,
            lasts: one.lasts,
        }));
        all.reduce(|a, b| {
            let least = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::min);
            Battery {
                remaining: least(a.remaining, b.remaining),
                voltage_v: a.voltage_v.or(b.voltage_v),
                lasts: a.lasts.into_iter().chain(b.lasts).min(),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: u64) -> Instant {
        Instant::from_start(Duration::from_secs(s))
    }

    fn status(id: u8, percent: i8, time_remaining: i32) -> BATTERY_STATUS_DATA {
        BATTERY_STATUS_DATA {
            id,
            battery_remaining: percent,
            time_remaining,
            charge_state: State::MAV_BATTERY_CHARGE_STATE_OK,
            battery_function: Function::MAV_BATTERY_FUNCTION_ALL,
            ..Default::default()
        }
    }

    fn weakest(batteries: &Batteries, s: u64) -> (Option<f64>, Option<u64>) {
        let battery = batteries.weakest(at(s)).unwrap();
        (battery.remaining, battery.lasts.map(|lasts| lasts.as_secs()))
    }

    #[test]
    fn spec_the_weakest_of_those_that_are_heard_of_counts() {
        let mut batteries = Batteries::default();
        assert_eq!(batteries.weakest(at(0)), None);
        batteries.take_all(Battery { remaining: Some(0.8), voltage_v: Some(22.2), lasts: None });
        batteries.take(&status(0, 79, 900), at(0));
        batteries.take(&status(1, 61, 0), at(0));
        batteries.take(&status(2, -1, 700), at(1));
        assert_eq!(weakest(&batteries, 1), (Some(0.61), Some(700)));
        assert_eq!(batteries.weakest(at(1)).unwrap().voltage_v, Some(22.2));
        // The newest word of each.
        batteries.take(&status(1, 60, 400), at(2));
        assert_eq!(weakest(&batteries, 2), (Some(0.6), Some(400)));
        // Of one that falls silent nothing is known any more; SYS_STATUS has a freshness of its own.
        batteries.take(&status(0, 78, 880), at(9));
        assert_eq!(weakest(&batteries, 13), (Some(0.78), Some(880)));
    }

    #[test]
    fn spec_a_battery_that_fails_is_empty_and_one_that_no_motor_runs_on_is_none() {
        for state in [
            State::MAV_BATTERY_CHARGE_STATE_EMERGENCY,
            State::MAV_BATTERY_CHARGE_STATE_FAILED,
            State::MAV_BATTERY_CHARGE_STATE_UNHEALTHY,
        ] {
            let mut batteries = Batteries::default();
            batteries.take(&BATTERY_STATUS_DATA { charge_state: state, ..status(0, 80, 0) }, at(0));
            assert_eq!(weakest(&batteries, 0), (Some(0.0), None), "{state:?}");
        }
        for function in [Function::MAV_BATTERY_FUNCTION_AVIONICS, Function::MAV_BATTERY_FUNCTION_PAYLOAD] {
            let mut batteries = Batteries::default();
            batteries.take(&BATTERY_STATUS_DATA { battery_function: function, ..status(0, 3, 5) }, at(0));
            assert_eq!(batteries.weakest(at(0)), None, "{function:?}");
        }
    }

    #[test]
    fn spec_whoever_makes_up_batteries_fills_no_memory() {
        let mut batteries = Batteries::default();
        (0..=255).for_each(|id| batteries.take(&status(id, 50, -7), at(0)));
        assert_eq!((batteries.each.len(), weakest(&batteries, 0)), (MOST, (Some(0.5), None)));
    }
}
