//! The log of a calibration flight: CSV with the columns of [`COLUMNS`], in any order, among others.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// What is read: time in seconds; the vehicle's own position, metres ENU; its own attitude, the quaternion w, x, y, z that
/// turns body axes (forward, left, up) into ENU; received power, dBm, empty where nothing was heard.
pub const COLUMNS: [&str; 9] =
    ["time_s", "east_m", "north_m", "up_m", "qw", "qx", "qy", "qz", "received_dbm"];

/// One line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Seconds, from any beginning.
    pub at_s: f64,
    /// Where the vehicle believed to be, metres.
    pub position_enu_m: Vector3<f64>,
    /// Its attitude as it believed: body (forward, left, up) to ENU.
    pub attitude: UnitQuaternion<f64>,
    /// What the receiver heard, dBm.
    pub received_dbm: f64,
}

/// Why a text is no log.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// A column is not there.
    #[error("there is no column {name:?}; the first line must name {}", COLUMNS.join(", "))]
    Column {
        /// Which one.
        name: &'static str,
    },
    /// A cell is no finite number.
    #[error("line {line}: {name} is {text:?}, which is no finite number")]
    Number {
        /// Of the file, from 1.
        line: u64,
        /// The column.
        name: &'static str,
        /// What it says.
        text: String,
    },
    /// A quaternion that is no rotation.
    #[error("line {line}: the quaternion's length is {length:.3}; it must be 1")]
    Quaternion {
        /// Of the file, from 1.
        line: u64,
        /// Its length.
        length: f64,
    },
    /// Time that does not go on.
    #[error("line {line}: time_s falls to {at_s}")]
    Time {
        /// Of the file, from 1.
        line: u64,
        /// What it says.
        at_s: f64,
    },
    /// Not CSV.
    #[error(transparent)]
    Csv(#[from] csv::Error),
}

/// A quaternion's length may be off by the rounding of its digits.
const LENGTH_SLACK: f64 = 0.01;

/// The readings of a log in which something was heard.
///
/// # Errors
/// The first line that is wrong.
pub fn read(text: &str) -> Result<Vec<Reading>, LogError> {
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers()?.clone();
    let mut places = [0; COLUMNS.len()];
    for (place, name) in places.iter_mut().zip(COLUMNS) {
        *place = header.iter().position(|cell| cell == name).ok_or(LogError::Column { name })?;
    }
    let mut readings: Vec<Reading> = Vec::new();
    for record in reader.records() {
        let record = record?;
        let line = record.position().map_or(0, csv::Position::line);
        // Not heard.
        if record.get(places[COLUMNS.len() - 1]).is_none_or(str::is_empty) {
            continue;
        }
        let mut values = [0.0; COLUMNS.len()];
        for ((value, place), name) in values.iter_mut().zip(places).zip(COLUMNS) {
            let text = record.get(place).unwrap_or_default();
            let parsed = text.parse().ok().filter(|number: &f64| number.is_finite());
            *value = parsed.ok_or_else(|| LogError::Number { line, name, text: text.to_owned() })?;
        }
        let [at_s, east, north, up, w, x, y, z, received_dbm] = values;
        let quaternion = Quaternion::new(w, x, y, z);
        let length = quaternion.norm();
        if (length - 1.0).abs() > LENGTH_SLACK {
            return Err(LogError::Quaternion { line, length });
        }
        if readings.last().is_some_and(|last| at_s < last.at_s) {
            return Err(LogError::Time { line, at_s });
        }
        readings.push(Reading {
            at_s,
            position_enu_m: Vector3::new(east, north, up),
            attitude: UnitQuaternion::from_quaternion(quaternion),
            received_dbm,
        });
    }
    Ok(readings)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "time_s,received_dbm,east_m,north_m,up_m,qw,qx,qy,qz,more\n";

    #[test]
    fn spec_columns_are_found_by_name_and_what_was_not_heard_is_left_out() {
        let text = format!(
            "{HEAD}# a remark\n0.0,-50.5,1,2,3,1,0,0,0,x\n0.1,,1,2,3,1,0,0,0,x\n0.2,-51,1,2,3,0,0,0,-1,x\n"
        );
        let readings = read(&text).unwrap();
        assert_eq!(readings.len(), 2);
        assert_eq!(readings[0].position_enu_m, Vector3::new(1.0, 2.0, 3.0));
        assert_eq!((readings[1].at_s, readings[1].received_dbm), (0.2, -51.0));
    }

    #[test]
    fn spec_a_wrong_line_is_named() {
        let say =
            |line: &str| read(&format!("{HEAD}0,-50,1,2,3,1,0,0,0,x\n{line}\n")).unwrap_err().to_string();
        assert!(say("1,-50,1,2,nan,1,0,0,0,x").contains("line 3: up_m is \"nan\""));
        assert!(say("1,-50,1,2,3,1,1,0,0,x").contains("line 3: the quaternion's length is 1.414"));
        assert!(say("-1,-50,1,2,3,1,0,0,0,x").contains("line 3: time_s falls to -1"));
        let missing = read("time_s,east_m\n1,2\n").unwrap_err().to_string();
        assert!(missing.contains("no column \"north_m\""), "{missing}");
    }
}
