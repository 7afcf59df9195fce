//! The device behind a radio's commands: it does what it is told after a while, and cannot give every power.

use std::time::Duration;

use super::Emission;
use crate::vehicle::parameters::Value;

/// What a radio's device is; a radio that [declares](Self::declares) says so by parameters (docs/radio.md of the companion's
/// repository). The default does everything at once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadioDevice {
    /// The least power above off that it can give, dBm: what is asked below it is off, and refused.
    pub least_dbm: f64,
    /// From an off, or from an expiry, to silence, seconds.
    pub off_s: f64,
    /// From a command to another power, or from off, to that power, seconds. Meanwhile it radiates as before.
    pub change_s: f64,
    /// The power in its answers is the device's; else what it was last told.
    pub read_back: bool,
    /// From its host's death to silence, seconds; `None`: never by itself. It is said, and nothing more.
    pub dead_s: Option<f64>,
    /// In which it radiates, lowest and highest, kHz; `None`: not known. It is said, and nothing more.
    pub band_khz: Option<[f64; 2]>,
    /// Whether it says all this. The first radios know no such parameters.
    pub declares: bool,
}

impl Default for RadioDevice {
    fn default() -> Self {
        Self {
            least_dbm: -100.0,
            off_s: 0.0,
            change_s: 0.0,
            read_back: true,
            dead_s: Some(0.0),
            band_khz: None,
            declares: true,
        }
    }
}

impl RadioDevice {
    /// What it declares, by the parameters' names.
    pub(super) fn parameters(&self) -> Vec<(&'static str, Value)> {
        if !self.declares {
            return Vec::new();
        }
        let real = |value: f64| Value::Real(value as f32);
        let [low_khz, high_khz] = self.band_khz.unwrap_or([-1.0; 2]);
        vec![
            ("TX_MIN_DBM", real(self.least_dbm)),
            ("TX_OFF_MS", real(self.off_s * 1e3)),
            ("TX_CHANGE_MS", real(self.change_s * 1e3)),
            ("TX_READ_BACK", real(f64::from(u8::from(self.read_back)))),
            ("TX_DEAD_MS", real(self.dead_s.map_or(-1.0, |s| s * 1e3))),
            ("TX_BAND_LO_KHZ", real(low_khz)),
            ("TX_BAND_HI_KHZ", real(high_khz)),
        ]
    }

    /// The values that must be finite, by name.
    pub(in crate::vehicle) fn values(&self) -> [(&'static str, f64); 3] {
        [
            ("radio_device.least_dbm", self.least_dbm),
            ("radio_device.off_s", self.off_s),
            ("radio_device.change_s", self.change_s),
        ]
    }
}

/// What the device does, and what it is about to do.
#[derive(Debug, Clone, Default)]
pub(super) struct Device {
    off: Duration,
    change: Duration,
    radiates: Option<Emission>,
    turns: Option<(Duration, Option<Emission>)>,
}

impl Device {
    pub fn new(model: &RadioDevice) -> Self {
        let seconds = |s| Duration::try_from_secs_f64(s).unwrap_or_default();
        Self { off: seconds(model.off_s), change: seconds(model.change_s), ..Self::default() }
    }

    /// What is on the air.
    pub fn emission(&self) -> Option<Emission> {
        self.radiates
    }

    /// Tells it what to radiate: the same power goes on for another slot, or for longer, at once.
    pub fn tell(&mut self, wanted: Option<Emission>, now: Duration) {
        let heading = match &mut self.turns {
            Some((_, to)) => to,
            None => &mut self.radiates,
        };
        if heading.map(|e| e.power_dbm) == wanted.map(|e| e.power_dbm) {
            *heading = wanted;
            return;
        }
        let takes = if wanted.is_some() { self.change } else { self.off };
        self.turns = Some((now + takes, wanted));
        self.turn(now);
    }

    /// Without power it is silent.
    pub fn cut(&mut self) {
        (self.radiates, self.turns) = (None, None);
    }

    /// When it next does something by itself.
    pub fn turns_at(&self) -> Option<Duration> {
        self.turns.map(|(at, _)| at)
    }

    /// Does what is due.
    pub fn turn(&mut self, now: Duration) {
        if let Some((_, to)) = self.turns.take_if(|(at, _)| *at <= now) {
            self.radiates = to;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn power(dbm: f64, slot: i32) -> Option<Emission> {
        Some(Emission::new(dbm, slot, ms(500), 500))
    }

    #[test]
    fn spec_each_turn_takes_its_time_and_the_same_power_none() {
        let mut device = Device::new(&RadioDevice { off_s: 0.08, change_s: 0.3, ..RadioDevice::default() });
        let on = |device: &Device| device.emission().map(|e| (e.power_dbm, e.slot));
        device.tell(power(20.0, 1), ms(0));
        assert_eq!((on(&device), device.turns_at()), (None, Some(ms(300))));
        // Told again on its way, it takes no longer.
        device.tell(power(20.0, 2), ms(100));
        device.turn(ms(299));
        assert_eq!(on(&device), None);
        device.turn(ms(300));
        assert_eq!(on(&device), Some((20.0, 2)));
        device.tell(power(20.0, 3), ms(400));
        assert_eq!(on(&device), Some((20.0, 3)));
        device.tell(None, ms(500));
        device.turn(ms(579));
        assert!(on(&device).is_some());
        device.turn(ms(580));
        assert_eq!((on(&device), device.turns_at()), (None, None));
        // Off before it was on.
        device.tell(power(20.0, 4), ms(600));
        device.tell(None, ms(610));
        device.turn(ms(2000));
        assert_eq!((on(&device), device.turns_at()), (None, None));
    }
}
