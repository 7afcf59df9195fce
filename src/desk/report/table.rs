//! `timeline.csv`: a row an instant, at 20 Hz and at each change of a mode, a power or a slot.
//!
//! | column | meaning |
//! |---|---|
//! | `at_s` | flight seconds |
//! | `i_east_m`, `i_north_m`, `i_up_m` | vehicle I's position, mission ENU |
//! | `i_roll_deg`, `i_pitch_deg`, `i_yaw_deg` | its antenna's attitude with the jitter, the paper's Euler angles |
//! | `i_held_roll_deg`, `i_held_pitch_deg`, `i_held_yaw_deg` | the same without the jitter; empty if not told apart |
//! | `i_mode`, `i_armed`, `i_landed` | the autopilot's mode; 1 or 0 |
//! | `i_battery` | 0 to 1 |
//! | `i_power_w`, `i_slot` | radiated power and the slot it is for; empty when silent |
//! | `j_...` | the same of vehicle J |
//! | `user_sinr`, `secrecy_rate_bps` | at the slot's user, linear; empty while I is silent |
//! | `sinr_0`, `sinr_1`, ... | at the eavesdroppers, in the order of `scene.json`, linear |
//!
//! A vehicle of which nothing is known yet has an empty position.

use csv::{ReaderBuilder, StringRecord};

use super::timeline::{Heard, Sample, VehicleState};
use crate::desk::csv_text::CsvText;
use crate::geo::Attitude;
use crate::role::{PerVehicle, Role};

/// Columns of one vehicle, without its prefix.
const VEHICLE: [&str; 15] = [
    "east_m",
    "north_m",
    "up_m",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "held_roll_deg",
    "held_pitch_deg",
    "held_yaw_deg",
    "mode",
    "armed",
    "landed",
    "battery",
    "power_w",
    "slot",
];
/// Where the radio's columns begin.
const RADIO: usize = 1 + 2 * VEHICLE.len();
/// Where the eavesdroppers' begin.
const EAVESDROPPERS: usize = RADIO + 2;

/// Why a table cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// No table at all.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// The first line is not a header of ours.
    #[error("line 1: column {column} is {found:?}, should be {expected:?}: this is no flight's timeline")]
    Header {
        /// From 1.
        column: usize,
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// A line with too few or too many cells.
    #[error("line {line}: {found} cells where the header has {expected}: the file is cut off or damaged")]
    Cells {
        /// From 1.
        line: u64,
        /// How many it has.
        found: usize,
        /// How many it should have.
        expected: usize,
    },
    /// A cell that cannot be.
    #[error("line {line}, column {column}: {value:?} is not {expected}: the file is damaged")]
    Cell {
        /// From 1.
        line: u64,
        /// The column's name.
        column: String,
        /// The cell.
        value: String,
        /// What should be there.
        expected: &'static str,
    },
    /// Time runs backwards.
    #[error("line {line}: at_s = {at_s} is before the line above: the file is damaged")]
    Order {
        /// From 1.
        line: u64,
        /// The cell.
        at_s: String,
    },
}

fn header(eavesdroppers: usize) -> Vec<String> {
    let mut names = vec!["at_s".to_owned()];
    for prefix in ["i", "j"] {
        names.extend(VEHICLE.iter().map(|name| format!("{prefix}_{name}")));
    }
    names.extend(["user_sinr".to_owned(), "secrecy_rate_bps".to_owned()]);
    names.extend((0..eavesdroppers).map(|k| format!("sinr_{k}")));
    names
}

/// The table of a flight with this many eavesdroppers.
#[must_use]
pub fn write(samples: &[Sample], eavesdroppers: usize) -> String {
    let mut text = CsvText::new(header(eavesdroppers));
    for sample in samples {
        let mut cells = vec![format!("{:.4}", sample.at_s)];
        for role in Role::BOTH {
            match sample.vehicles[role].as_ref() {
                Some(state) => vehicle(&mut cells, state),
                None => cells.extend([const { String::new() }; VEHICLE.len()]),
            }
        }
        let heard = sample.heard.as_ref();
        cells.push(heard.map_or(String::new(), |heard| format!("{:.6e}", heard.user_sinr)));
        cells.push(heard.map_or(String::new(), |heard| format!("{:.1}", heard.secrecy_rate_bps)));
        cells.extend((0..eavesdroppers).map(|k| {
            let sinr = heard.and_then(|heard| heard.eavesdropper_sinr.get(k));
            sinr.map_or(String::new(), |sinr| format!("{sinr:.6e}"))
        }));
        text.row(cells);
    }
    text.finish()
}

fn vehicle(cells: &mut Vec<String>, state: &VehicleState) {
    cells.extend(state.position_enu_m.map(|metres| format!("{metres:.4}")));
    cells.extend(angles(Some(&state.attitude)));
    cells.extend(angles(state.held.as_ref()));
    cells.push(state.mode.clone());
    cells.extend([state.armed, state.landed].map(|flag| u8::from(flag).to_string()));
    let rest = [(state.battery, 4), (state.tx_power_w, 9), (state.slot.map(f64::from), 0)];
    cells.extend(rest.map(|(value, decimals)| value.map_or(String::new(), |v| format!("{v:.decimals$}"))));
}

fn angles(attitude: Option<&Attitude>) -> [String; 3] {
    let Some(attitude) = attitude else { return Default::default() };
    let (roll, pitch, yaw) = attitude.euler();
    [roll, pitch, yaw].map(|angle| format!("{:.4}", angle.to_degrees()))
}

/// Reads a table; the samples and the number of eavesdroppers.
///
/// # Errors
/// [`TableError`], with line and column.
pub fn read(text: &str) -> Result<(Vec<Sample>, usize), TableError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut records = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let mut found = StringRecord::new();
    records.read_record(&mut found)?;
    let expected = header(found.len().saturating_sub(EAVESDROPPERS));
    for (k, name) in expected.iter().enumerate() {
        let cell = found.get(k).unwrap_or_default();
        if cell != name {
            return Err(TableError::Header { column: k + 1, found: cell.into(), expected: name.clone() });
        }
    }
    let mut samples: Vec<Sample> = Vec::new();
    for record in records.records() {
        let cells = record?;
        let line = cells.position().map_or(0, csv::Position::line);
        let row = Row { line, cells, names: &expected };
        if row.cells.len() != expected.len() {
            let (found, expected) = (row.cells.len(), expected.len());
            return Err(TableError::Cells { line, found, expected });
        }
        let sample = row.sample()?;
        if samples.last().is_some_and(|last| last.at_s > sample.at_s) {
            return Err(TableError::Order { line, at_s: row.cells[0].into() });
        }
        samples.push(sample);
    }
    Ok((samples, expected.len() - EAVESDROPPERS))
}

/// One line, cut up.
struct Row<'a> {
    line: u64,
    cells: StringRecord,
    names: &'a [String],
}

impl Row<'_> {
    fn sample(&self) -> Result<Sample, TableError> {
        let heard = match (self.number(RADIO)?, self.number(RADIO + 1)?) {
            (Some(user_sinr), Some(secrecy_rate_bps)) => {
                let all = (EAVESDROPPERS..self.cells.len()).map(|k| self.needed(k));
                let eavesdropper_sinr = all.collect::<Result<_, _>>()?;
                Some(Heard { user_sinr, eavesdropper_sinr, secrecy_rate_bps })
            }
            _ => None,
        };
        let vehicles = PerVehicle { i: self.vehicle(1)?, j: self.vehicle(1 + VEHICLE.len())? };
        Ok(Sample { at_s: self.needed(0)?, vehicles, heard })
    }

    fn vehicle(&self, at: usize) -> Result<Option<VehicleState>, TableError> {
        if self.cells[at].is_empty() {
            return Ok(None);
        }
        let attitude = self.attitude(at + 3)?.ok_or_else(|| self.bad(at + 3, "a finite number"))?;
        let slot = match &self.cells[at + 14] {
            "" => None,
            text => Some(text.parse().map_err(|_| self.bad(at + 14, "a slot number"))?),
        };
        Ok(Some(VehicleState {
            position_enu_m: [self.needed(at)?, self.needed(at + 1)?, self.needed(at + 2)?],
            attitude,
            held: self.attitude(at + 6)?,
            mode: self.cells[at + 9].to_owned(),
            armed: self.flag(at + 10)?,
            landed: self.flag(at + 11)?,
            battery: self.number(at + 12)?,
            tx_power_w: self.number(at + 13)?,
            slot,
        }))
    }

    fn attitude(&self, at: usize) -> Result<Option<Attitude>, TableError> {
        let angles = (self.number(at)?, self.number(at + 1)?, self.number(at + 2)?);
        Ok(match angles {
            (Some(roll), Some(pitch), Some(yaw)) => {
                Some(Attitude::from_euler(roll.to_radians(), pitch.to_radians(), yaw.to_radians()))
            }
            _ => None,
        })
    }

    fn number(&self, at: usize) -> Result<Option<f64>, TableError> {
        match &self.cells[at] {
            "" => Ok(None),
            text => {
                let value = text.parse().ok().filter(|value: &f64| value.is_finite());
                value.map(Some).ok_or_else(|| self.bad(at, "a finite number"))
            }
        }
    }

    fn needed(&self, at: usize) -> Result<f64, TableError> {
        self.number(at)?.ok_or_else(|| self.bad(at, "a finite number"))
    }

    fn flag(&self, at: usize) -> Result<bool, TableError> {
        match &self.cells[at] {
            "0" => Ok(false),
            "1" => Ok(true),
            _ => Err(self.bad(at, "0 or 1")),
        }
    }

    fn bad(&self, at: usize, expected: &'static str) -> TableError {
        TableError::Cell {
            line: self.line,
            column: self.names[at].clone(),
            value: self.cells[at].chars().take(40).collect(),
            expected,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(east_m: f64) -> VehicleState {
        VehicleState {
            position_enu_m: [east_m, -2.5, 30.0],
            attitude: Attitude::from_euler(0.5, -0.25, 0.125),
            held: Some(Attitude::from_euler(0.4, -0.2, 0.1)),
            mode: "OFFBOARD".into(),
            armed: true,
            landed: false,
            battery: Some(0.75),
            tx_power_w: Some(0.003_245),
            slot: Some(1),
        }
    }

    fn samples() -> Vec<Sample> {
        let silent = VehicleState { tx_power_w: None, slot: None, held: None, battery: None, ..state(3.0) };
        let heard = Heard { user_sinr: 1e6, eavesdropper_sinr: vec![2.0, 0.5], secrecy_rate_bps: 1.6e7 };
        vec![
            Sample { at_s: 0.0, vehicles: PerVehicle { i: None, j: Some(silent) }, heard: None },
            Sample {
                at_s: 0.05,
                vehicles: PerVehicle { i: Some(state(1.0)), j: Some(state(2.0)) },
                heard: Some(heard),
            },
        ]
    }

    #[test]
    fn spec_a_table_reads_as_it_was_written() {
        let text = write(&samples(), 2);
        let (read_back, eavesdroppers) = read(&text).unwrap();
        assert_eq!(eavesdroppers, 2);
        // Angles have four decimals; everything else here is exact.
        let flat = |samples: &[Sample]| write(samples, 2);
        assert_eq!(flat(&read_back), text);
        let (one, other) = (&read_back[1], &samples()[1]);
        assert_eq!((one.at_s, &one.heard), (other.at_s, &other.heard));
        let (one, other) = (one.vehicles.i.as_ref().unwrap(), other.vehicles.i.as_ref().unwrap());
        assert_eq!(
            (one.position_enu_m, one.tx_power_w, one.slot),
            (other.position_enu_m, other.tx_power_w, other.slot)
        );
        assert!(one.attitude.angle_to(&other.attitude).to_degrees() < 1e-3);
        assert!(read_back[0].vehicles.i.is_none() && read_back[0].heard.is_none());
    }

    #[test]
    fn spec_damaged_tables_name_line_and_column() {
        let good = write(&samples(), 2);
        let damage = |from: &str, to: &str| read(&good.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(damage("at_s", "time").contains("line 1: column 1"));
        assert!(
            damage("OFFBOARD,1,0", "OFFBOARD,x,0").contains("line 2, column j_armed: \"x\" is not 0 or 1")
        );
        assert!(damage("0.0500", "NaN").contains("line 3, column at_s"));
        assert!(damage("0.0500", "-1").contains("line 3: at_s = -1 is before"));
        let cut = &good[..good.len() - 20];
        assert!(read(cut).unwrap_err().to_string().starts_with("line 3"), "{:?}", read(cut));
        assert!(read("").is_err());
        assert!(read("\u{0}\u{1}garbage").is_err());
    }
}
