//! The fake devices: which protocol each speaks, how long each takes, and which settings it has.

use std::time::Duration;

use clap::ValueEnum;

use crate::desk::simulation::DeviceModel;
use crate::units::{Dbm, Watts};

/// What drives the device (docs/radios.md).
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(in crate::cli) enum Kind {
    /// Programs: this one, as `radio-device`.
    Command,
    /// A programmable attenuator, by lines of text.
    Attenuator,
    /// A radio that is set by JSON over HTTP, as StreamCaster's documents have it.
    #[value(name = "json_rpc")]
    JsonRpc,
    /// A modem, by AT commands.
    At,
}

/// Its settings: from the least to the largest number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Grid {
    pub least: f64,
    pub most: f64,
    pub step: f64,
    /// The larger the number, the weaker.
    pub attenuates: bool,
}

impl Kind {
    /// As the radio file spells it, and its table.
    pub fn key(self) -> &'static str {
        match self {
            Self::Command => "command",
            Self::Attenuator => "attenuator",
            Self::JsonRpc => "json_rpc",
            Self::At => "at",
        }
    }

    /// From an off to silence and from an order to the power, as the backends' documents have it where they say anything: an
    /// attenuator settles in less than a millisecond; a Wi-Fi card takes tens of milliseconds. Of radios by JSON and of modems
    /// those that do not restart their interface for a change; the others take seconds, which no slot's guard contains.
    fn times_ms(self) -> [u64; 2] {
        match self {
            Self::Command => [10, 30],
            Self::Attenuator => [1, 1],
            Self::JsonRpc => [20, 60],
            Self::At => [20, 50],
        }
    }

    /// What the host may take beside the device: processes to start, ways over loopback, and a machine that has more to do.
    pub fn beside_ms(self) -> [f64; 2] {
        match self {
            Self::Command => [85.0, 300.0],
            Self::Attenuator | Self::JsonRpc | Self::At => [70.0, 200.0],
        }
    }

    pub(super) fn grid(self) -> Grid {
        match self {
            Self::Command => Grid { least: -40.0, most: 40.0, step: 0.01, attenuates: false },
            // The largest attenuation is off.
            Self::Attenuator => Grid { least: 0.0, most: 89.75, step: 0.25, attenuates: true },
            Self::JsonRpc => Grid { least: 0.0, most: 40.0, step: 1.0, attenuates: false },
            Self::At => Grid { least: 7.0, most: 30.0, step: 1.0, attenuates: false },
        }
    }
}

/// What is said of the devices on the command line.
#[derive(Debug, Clone, Copy)]
pub(in crate::cli) struct Options {
    pub kind: Kind,
    /// From an off to silence, and from an order to the power.
    pub times_ms: Option<[f64; 2]>,
    /// Silent by itself so long after its host's death.
    pub dead_ms: Option<f64>,
    /// Dark when its own control dies.
    pub goes_dark: bool,
}

impl Options {
    /// The device.
    pub fn model(&self) -> DeviceModel {
        let [off, change] = match self.times_ms {
            Some(given) => given.map(milliseconds),
            None => self.kind.times_ms().map(Duration::from_millis),
        };
        DeviceModel { off, change, dead: self.dead_ms.map(milliseconds), outlives_control: !self.goes_dark }
    }
}

fn milliseconds(ms: f64) -> Duration {
    Duration::try_from_secs_f64(ms * 1e-3).unwrap_or_default()
}

/// A device's settings and what each gives: measured points, and lines between them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    grid: Grid,
    /// The weakest first: setting and dBm.
    points: Vec<(f64, f64)>,
}

impl Table {
    /// A device that gives these powers, in watts, each at a setting of its own.
    ///
    /// # Errors
    /// More powers than it has settings; in words.
    pub fn covering(kind: Kind, powers_w: &[f64]) -> Result<Self, String> {
        let grid = kind.grid();
        if kind == Kind::Command {
            // Its settings are powers, in hundredths of a dBm.
            return Ok(Self { grid, points: [grid.least, grid.most].map(|dbm| (dbm, dbm)).to_vec() });
        }
        let settings = ((grid.most - grid.least) / grid.step).round();
        // In thousandths, rounded down, as powers are asked for.
        let mut powers: Vec<f64> = powers_w
            .iter()
            .filter(|power_w| **power_w > 0.0)
            .map(|power_w| (Dbm::from(Watts(*power_w)).0 * 1e3).floor() * 1e-3)
            .collect();
        powers.sort_by(f64::total_cmp);
        powers.dedup();
        // One that is never to radiate has powers as well.
        let strongest = powers.last().copied().unwrap_or_default();
        if powers.is_empty() {
            powers.push(strongest);
        }
        // Room above, so that the strongest is not the device's ceiling.
        let mut below = settings - (3.0 / grid.step).round().min(settings / 4.0).max(1.0) + 1.0;
        let first = below - 1.0;
        let mut anchors = Vec::new();
        for (weaker, dbm) in powers.iter().enumerate().rev() {
            // As far apart as its steps are, or nearer where it has not so many: one setting each for those that are weaker still.
            let room = weaker as f64 + 1.0;
            let at = (first - ((strongest - dbm) / grid.step).round()).max(room).min(below - 1.0);
            if at < room {
                return Err(format!(
                    "a device of kind {:?} has no setting for each of {} powers: fly the mission with another kind",
                    kind.key(),
                    powers.len()
                ));
            }
            below = at;
            anchors.push((at, *dbm));
        }
        anchors.reverse();
        let (weakest, top) = (anchors[0], anchors[anchors.len() - 1]);
        let mut ranked = vec![(0.0, weakest.1 - weakest.0 * grid.step)];
        ranked.append(&mut anchors);
        ranked.push((settings, top.1 + (settings - top.0) * grid.step));
        let setting = |rank: f64| {
            let value = match grid.attenuates {
                true => grid.most - rank * grid.step,
                false => grid.least + rank * grid.step,
            };
            (value * 1e6).round() * 1e-6
        };
        Ok(Self { grid, points: ranked.into_iter().map(|(rank, dbm)| (setting(rank), dbm)).collect() })
    }

    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// As `veilwing radio calibrate` would have measured it.
    pub fn csv(&self, frequency_hz: f64) -> String {
        let line = |(setting, dbm): &(f64, f64)| format!("{frequency_hz},{setting},{dbm:.3}\n");
        ["frequency_hz,setting,dbm\n".to_owned()].into_iter().chain(self.points.iter().map(line)).collect()
    }

    /// What a setting gives; `None` for one that the device does not have.
    pub fn dbm(&self, setting: f64) -> Option<f64> {
        let between = |pair: &[(f64, f64)]| {
            let [(from, low), (to, high)] = *pair else { return None };
            let along = (setting - from) / (to - from);
            (0.0..=1.0).contains(&along).then_some(low + (high - low) * along)
        };
        self.points.windows(2).find_map(between)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio_host::{Scale, points_of_csv};

    #[test]
    fn spec_every_kind_gives_each_planned_power_by_its_own_calibration_and_no_more() {
        for kind in Kind::value_variants() {
            let powers_w = [0.5, 0.000_373_486, 0.000_859_225, 0.0, 0.5];
            let table = Table::covering(*kind, &powers_w).unwrap();
            let Grid { least, most, step, .. } = table.grid();
            let settings: Vec<f64> =
                (0..=((most - least) / step).round() as u32).map(|k| least + f64::from(k) * step).collect();
            let points = points_of_csv(&table.csv(2.4e9)).unwrap();
            let scale = Scale::measured(&settings, &points, None).unwrap();
            for power_w in powers_w.into_iter().filter(|power_w| *power_w > 0.0) {
                let asked = (Dbm::from(Watts(power_w)).0 * 1e3).floor() * 1e-3;
                let setting = scale.at_most(asked).unwrap();
                let gives = table.dbm(setting.value).unwrap();
                let given_w = Watts::from(Dbm(gives)).0;
                assert!(
                    given_w <= 1.0005 * power_w && given_w > 0.998 * power_w,
                    "{kind:?}: {given_w} {power_w}"
                );
                assert!((gives - setting.dbm).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn spec_powers_that_a_device_cannot_give_are_refused_with_a_remedy() {
        let many: Vec<f64> = (1..40).map(|k| 0.01 * f64::from(k)).collect();
        let error = Table::covering(Kind::At, &many).unwrap_err();
        assert!(error.contains("fly the mission with another kind"), "{error}");
    }
}
