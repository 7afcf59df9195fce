//! A measured antenna pattern: the path of its file, or its rows.

use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};

use super::compound::{List, Numbers};
use super::scalar::Number;
use super::value::{Fault, Item, Kind};
use crate::config::file::{MAX_BYTES, read_text};
use crate::radio::measured::{LEAST_DB, Measured, POINTS, points_of_csv};

/// The points of a pattern, degrees and dB: read from the CSV file that a string names, or given as rows. Whichever way, they
/// are the setting: two vehicles whose files differ have different missions.
pub(crate) struct PatternRows {
    /// Where a relative path begins.
    pub(crate) directory: PathBuf,
}

/// The rows in the mission file itself.
const ROWS: List<Numbers<2>> = List {
    each: Numbers([
        ("angle_deg", Number::within("deg", 0.0, 180.0)),
        ("gain_db", Number::within("dB", LEAST_DB, 0.0)),
    ]),
    at_least: *POINTS.start(),
    at_most: *POINTS.end(),
};

impl PatternRows {
    fn of_file(&self, path: &str) -> Result<Vec<[f64; 2]>, String> {
        let text = read_text(&self.directory.join(Path::new(path)), MAX_BYTES).map_err(|findings| {
            findings.list().iter().map(|found| found.message.as_str()).collect::<String>()
        })?;
        let points = points_of_csv(&text).map_err(|error| error.to_string())?;
        Measured::new(&points).map(|_| points).map_err(|error| error.to_string())
    }
}

impl Kind for PatternRows {
    type Out = Vec<[f64; 2]>;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Vec<[f64; 2]>> {
        let Some(path) = item.get_ref().as_str() else {
            let rows = ROWS.read(item, faults)?;
            if let Some(clause) = self.fault(&rows) {
                faults.push(Fault { at: item.span(), clause });
                return None;
            }
            return Some(rows);
        };
        self.of_file(path)
            .map_err(|why| {
                faults.push(Fault { at: item.span(), clause: format!("is {path:?}: the file {why}") })
            })
            .ok()
    }

    fn fault(&self, value: &Vec<[f64; 2]>) -> Option<String> {
        Measured::new(value).err().map(|error| error.to_string())
    }

    fn expected(&self) -> String {
        "the path of a CSV file with the columns angle_deg,gain_db, from 0 to 180 deg, the largest gain 0 dB; or its rows, [[0.0, -25.0], ...]".to_owned()
    }

    fn schema(&self) -> Json {
        json!({ "oneOf": [{ "type": "string", "minLength": 1 }, ROWS.schema()] })
    }

    fn canonical(&self, value: &Vec<[f64; 2]>) -> Json {
        ROWS.canonical(value)
    }
}
