//! Which setting of a device gives which power.
//!
//! A device takes settings on a grid of its own: dBm, decibels of attenuation, a gain, a level. What each gives is measured
//! (`frequency_hz,setting,dbm`), or what the device says of itself; between measured settings it is interpolated linearly, in
//! dB over the setting, and, where the radiated frequency lies between two measured ones, linearly over frequency. Power must
//! rise with the setting, or fall with it: then a power asked for lies between two settings, and the weaker one is taken.

/// Most settings that a device may have.
pub const MOST_SETTINGS: usize = 20_000;
/// A power is asked for in thousandths of a dB, rounded down, of what was watts: a setting that is above it by no more than
/// that rounding is the one that was meant.
const ROUNDING_DB: f64 = 0.0015;

/// One setting, and the power that it gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// As the device takes it.
    pub value: f64,
    /// In dBm.
    pub dbm: f64,
}

/// Why settings and powers do not fit. Lines count from 1.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ScaleError {
    /// The first line names other columns.
    #[error("the first line is {found:?}")]
    Header {
        /// What it says.
        found: String,
    },
    /// A line is not three numbers.
    #[error("the line has {found} fields, not three")]
    Fields {
        /// The line.
        line: usize,
        /// How many fields it has.
        found: usize,
    },
    /// A field is no finite number.
    #[error("{text:?} is no finite number")]
    Number {
        /// The line.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// A setting is measured twice at one frequency.
    #[error("setting {setting} at {frequency_hz} Hz is there twice")]
    Twice {
        /// The line of the second.
        line: usize,
        /// The setting.
        setting: f64,
        /// The frequency.
        frequency_hz: f64,
    },
    /// Power neither rises nor falls throughout.
    #[error(
        "{dbm} dBm at setting {setting} after {before_dbm} dBm at the setting before: power does not rise, or fall, throughout"
    )]
    NotMonotone {
        /// The line.
        line: usize,
        /// The setting.
        setting: f64,
        /// Its power.
        dbm: f64,
        /// The power of the setting before.
        before_dbm: f64,
    },
    /// Power rises with the setting at one frequency, and falls at another.
    #[error("power rises with the setting at one frequency, and falls at another")]
    Directions,
    /// Fewer than two settings at one frequency.
    #[error("at {frequency_hz} Hz there is one setting alone")]
    TooFew {
        /// The frequency.
        frequency_hz: f64,
        /// Its line.
        line: usize,
    },
    /// There is nothing.
    #[error("nothing is measured")]
    Empty,
    /// More than one frequency, and none said to be radiated.
    #[error("it has {count} frequencies, and [device] does not say which is radiated")]
    WhichFrequency {
        /// How many.
        count: usize,
    },
    /// The frequency radiated is outside of those measured.
    #[error("{frequency_hz} Hz is outside of what was measured, {low_hz} to {high_hz} Hz")]
    Frequency {
        /// The frequency radiated.
        frequency_hz: f64,
        /// The lowest measured.
        low_hz: f64,
        /// The highest measured.
        high_hz: f64,
    },
    /// The device's settings reach beyond those measured.
    #[error("the device is set from {least} to {most}, and only {low} to {high} was measured")]
    NotCovered {
        /// The device's least setting.
        least: f64,
        /// Its largest.
        most: f64,
        /// The least measured.
        low: f64,
        /// The largest measured.
        high: f64,
    },
    /// The device has no settings, or too many.
    #[error("the device has {count} settings, and may have 1 to {MOST_SETTINGS}")]
    Settings {
        /// How many.
        count: usize,
    },
}

impl ScaleError {
    /// What to do about it.
    #[must_use]
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Header { .. } => "write frequency_hz,setting,dbm",
            Self::Fields { .. } => "write three numbers with commas between them, and decimals with a point",
            Self::Number { .. } => "measure it again, write decimals with a point, or remove the line",
            Self::Twice { .. } => "keep one of the two",
            Self::NotMonotone { .. } | Self::Directions => {
                "measure again; `veilwing radio calibrate` checks each as it comes"
            }
            Self::TooFew { .. } => "measure at least the least and the largest setting",
            Self::Empty => "run `veilwing radio calibrate`",
            Self::WhichFrequency { .. } => "give [device] frequency_hz",
            Self::Frequency { .. } => "measure on both sides of it, or at it",
            Self::NotCovered { .. } => "measure the ends too, or give [device] what was measured",
            Self::Settings { .. } => "give [device] least, most and step, or levels",
        }
    }

    /// The line that it is about, if it is about one.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        match self {
            Self::Fields { line, .. }
            | Self::Number { line, .. }
            | Self::Twice { line, .. }
            | Self::NotMonotone { line, .. }
            | Self::TooFew { line, .. } => Some(*line),
            _ => None,
        }
    }
}

/// One measurement, and the line that it stands on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// The frequency radiated.
    pub frequency_hz: f64,
    /// The setting.
    pub setting: f64,
    /// The power measured.
    pub dbm: f64,
    /// The line in its file, from 1.
    pub line: usize,
}

/// The measurements of a CSV file `frequency_hz,setting,dbm`. Empty lines and such that begin with `#` say nothing.
///
/// # Errors
/// The first line that is no measurement.
pub fn points_of_csv(text: &str) -> Result<Vec<Point>, ScaleError> {
    let lines = (1..).zip(text.lines().map(str::trim));
    let mut said = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let header = said.next().map(|(_, line)| line).unwrap_or_default();
    let columns: Vec<&str> = header.split(',').map(str::trim).collect();
    if columns != ["frequency_hz", "setting", "dbm"] {
        return Err(ScaleError::Header { found: header.chars().take(60).collect() });
    }
    said.map(|(line, text)| point(line, text)).collect()
}

fn point(line: usize, text: &str) -> Result<Point, ScaleError> {
    let fields: Vec<&str> = text.split(',').map(str::trim).collect();
    let number = |text: &str| {
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| ScaleError::Number { line, text: text.chars().take(40).collect() })
    };
    match fields.as_slice() {
        [frequency_hz, setting, dbm] => Ok(Point {
            frequency_hz: number(frequency_hz)?,
            setting: number(setting)?,
            dbm: number(dbm)?,
            line,
        }),
        other => Err(ScaleError::Fields { line, found: other.len() }),
    }
}

/// All settings of a device with their powers, the weakest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Scale {
    settings: Vec<Setting>,
}

impl Scale {
    /// A device whose power is `at_zero_dbm + slope * setting`: slope 1 where the setting is the power, -1 where it
    /// attenuates `at_zero_dbm`.
    ///
    /// # Errors
    /// [`ScaleError::Settings`].
    pub fn linear(values: &[f64], at_zero_dbm: f64, slope: f64) -> Result<Self, ScaleError> {
        Self::of(values, |value| at_zero_dbm + slope * value)
    }

    /// A device that was measured: `points` in any order, at the frequency radiated or around it.
    ///
    /// # Errors
    /// Why the measurements cannot be used, or do not cover the settings.
    pub fn measured(values: &[f64], points: &[Point], frequency_hz: Option<f64>) -> Result<Self, ScaleError> {
        let curve = curve_at(points, frequency_hz)?;
        let (Some(low), Some(high)) = (curve.first(), curve.last()) else { return Err(ScaleError::Empty) };
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if least < low.0 || most > high.0 {
            return Err(ScaleError::NotCovered { least, most, low: low.0, high: high.0 });
        }
        Self::of(values, |value| interpolate(&curve, value))
    }

    fn of(values: &[f64], dbm: impl Fn(f64) -> f64) -> Result<Self, ScaleError> {
        if values.is_empty() || values.len() > MOST_SETTINGS {
            return Err(ScaleError::Settings { count: values.len() });
        }
        let mut settings: Vec<Setting> =
            values.iter().map(|value| Setting { value: *value, dbm: dbm(*value) }).collect();
        settings.sort_by(|a, b| a.dbm.total_cmp(&b.dbm));
        settings.dedup_by(|a, b| a.value == b.value);
        Ok(Self { settings })
    }

    /// All settings, the weakest first.
    #[must_use]
    pub fn settings(&self) -> &[Setting] {
        &self.settings
    }

    /// The strongest setting that gives no more than `dbm`; `None` below the least power.
    #[must_use]
    pub fn at_most(&self, dbm: f64) -> Option<Setting> {
        let above = self.settings.partition_point(|setting| setting.dbm <= dbm + ROUNDING_DB);
        above.checked_sub(1).map(|index| self.settings[index])
    }

    /// The power of the setting that was read back, interpolated between those of the grid; the nearest end's beyond them.
    #[must_use]
    pub fn dbm_of(&self, value: f64) -> f64 {
        let mut by_value: Vec<(f64, f64)> =
            self.settings.iter().map(|setting| (setting.value, setting.dbm)).collect();
        by_value.sort_by(|a, b| a.0.total_cmp(&b.0));
        interpolate(&by_value, value)
    }

    /// The least power that can be given, in dBm.
    #[must_use]
    pub fn least_dbm(&self) -> f64 {
        self.settings.first().map_or(f64::NAN, |setting| setting.dbm)
    }

    /// The largest power that can be given, in dBm.
    #[must_use]
    pub fn most_dbm(&self) -> f64 {
        self.settings.last().map_or(f64::NAN, |setting| setting.dbm)
    }
}

/// Power over setting at a frequency, by rising setting.
fn curve_at(points: &[Point], frequency_hz: Option<f64>) -> Result<Vec<(f64, f64)>, ScaleError> {
    let mut frequencies: Vec<f64> = points.iter().map(|point| point.frequency_hz).collect();
    frequencies.sort_by(f64::total_cmp);
    frequencies.dedup();
    let curves: Vec<Vec<(f64, f64)>> =
        frequencies.iter().map(|frequency| curve_of(points, *frequency)).collect::<Result<_, _>>()?;
    let (Some(low_hz), Some(high_hz)) = (frequencies.first().copied(), frequencies.last().copied()) else {
        return Err(ScaleError::Empty);
    };
    let rises = |curve: &[(f64, f64)]| curve[0].1 < curve[curve.len() - 1].1;
    if curves.windows(2).any(|pair| rises(&pair[0]) != rises(&pair[1])) {
        return Err(ScaleError::Directions);
    }
    let Some(wanted_hz) = frequency_hz else {
        return match curves.len() {
            1 => curves.into_iter().next().ok_or(ScaleError::Empty),
            count => Err(ScaleError::WhichFrequency { count }),
        };
    };
    if !(low_hz..=high_hz).contains(&wanted_hz) {
        return Err(ScaleError::Frequency { frequency_hz: wanted_hz, low_hz, high_hz });
    }
    let above = frequencies.partition_point(|frequency| *frequency < wanted_hz);
    let below = if frequencies[above] == wanted_hz { above } else { above.saturating_sub(1) };
    Ok(between(&curves[below], &curves[above], share(frequencies[below], frequencies[above], wanted_hz)))
}

/// What was measured at one frequency, by rising setting, rising or falling throughout.
fn curve_of(points: &[Point], frequency_hz: f64) -> Result<Vec<(f64, f64)>, ScaleError> {
    let mut here: Vec<&Point> = points.iter().filter(|point| point.frequency_hz == frequency_hz).collect();
    here.sort_by(|a, b| a.setting.total_cmp(&b.setting));
    let (Some(first), Some(last)) = (here.first(), here.last()) else { return Err(ScaleError::Empty) };
    if here.len() < 2 {
        return Err(ScaleError::TooFew { frequency_hz, line: first.line });
    }
    let rises = last.dbm > first.dbm;
    for pair in here.windows(2) {
        let (before, after) = (pair[0], pair[1]);
        if before.setting == after.setting {
            let line = before.line.max(after.line);
            return Err(ScaleError::Twice { line, setting: after.setting, frequency_hz });
        }
        let in_order = if rises { after.dbm > before.dbm } else { after.dbm < before.dbm };
        if !in_order {
            let Point { line, setting, dbm, .. } = *after;
            return Err(ScaleError::NotMonotone { line, setting, dbm, before_dbm: before.dbm });
        }
    }
    Ok(here.iter().map(|point| (point.setting, point.dbm)).collect())
}

/// The curve at a share of the way from one frequency's to the next one's, on the settings that both cover.
fn between(below: &[(f64, f64)], above: &[(f64, f64)], share: f64) -> Vec<(f64, f64)> {
    let low = below[0].0.max(above[0].0);
    let high = below[below.len() - 1].0.min(above[above.len() - 1].0);
    let mut values: Vec<f64> = below.iter().chain(above).map(|point| point.0).collect();
    values.retain(|value| (low..=high).contains(value));
    values.sort_by(f64::total_cmp);
    values.dedup();
    let dbm = |value| (1.0 - share) * interpolate(below, value) + share * interpolate(above, value);
    values.into_iter().map(|value| (value, dbm(value))).collect()
}

/// The way from `a` to `b` that `x` has gone, 0 to 1; 0 where they are one.
fn share(a: f64, b: f64, x: f64) -> f64 {
    if b > a { ((x - a) / (b - a)).clamp(0.0, 1.0) } else { 0.0 }
}

/// Linear between the points of a curve by rising first coordinate; the ends' values beyond them.
fn interpolate(curve: &[(f64, f64)], x: f64) -> f64 {
    let after = curve.partition_point(|point| point.0 < x).min(curve.len() - 1);
    let before = after.saturating_sub(1);
    let ((x0, y0), (x1, y1)) = (curve[before], curve[after]);
    y0 + (y1 - y0) * share(x0, x1, x)
}
