//! What a radio declares of itself.

use std::time::Duration;

/// The declaration, for the companion's preflight. Powers in dBm at the antenna connector, as far as the scale knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facts {
    /// The least power that it can give.
    pub least_dbm: f64,
    /// The largest power that it can give.
    pub most_dbm: f64,
    /// The longest time from an off, or from an expiry, to silence.
    pub off: Duration,
    /// The longest time from a command to the new power.
    pub change: Duration,
    /// Whether the power achieved is read back from the device; else it is what was set.
    pub reads_back: bool,
    /// The longest time until the device is silent by itself when this program dies; `None`: never.
    pub dead: Option<Duration>,
    /// The band in which the device radiates, in kHz, if it is known.
    pub band_khz: Option<[f64; 2]>,
}

impl Facts {
    /// Names and values as the parameter protocol has them.
    ///
    /// The least power is declared in thousandths, rounded down, as powers are asked for: asked for that, the device gives it.
    pub(super) fn parameters(&self) -> [(&'static str, f64); 8] {
        let ms = |time: Duration| time.as_secs_f64() * 1e3;
        let [low_khz, high_khz] = self.band_khz.unwrap_or([-1.0, -1.0]);
        [
            ("TX_MAX_DBM", self.most_dbm),
            ("TX_MIN_DBM", (self.least_dbm * 1e3).floor() * 1e-3),
            ("TX_OFF_MS", ms(self.off)),
            ("TX_CHANGE_MS", ms(self.change)),
            ("TX_READ_BACK", f64::from(u8::from(self.reads_back))),
            ("TX_DEAD_MS", self.dead.map_or(-1.0, ms)),
            ("TX_BAND_LO_KHZ", low_khz),
            ("TX_BAND_HI_KHZ", high_khz),
        ]
    }
}
