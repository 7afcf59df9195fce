//! One campaign document from those of its parts.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::document::{CampaignDocument, FORMAT, Times};
use super::line::FlightLine;

/// Why there is no one document.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// A file or directory that cannot be read.
    #[error("{}: {error}", path.display())]
    Unreadable {
        /// Which one.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// A directory without parts.
    #[error("{}: holds no shard-*.json; give the --out of the parts", .0.display())]
    NoParts(PathBuf),
    /// A file that is no campaign document.
    #[error("{}: {error}; give documents that `veilwing campaign` wrote", path.display())]
    NoDocument {
        /// Which one.
        path: PathBuf,
        /// What is wrong with it.
        error: serde_json::Error,
    },
    /// A document of another format.
    #[error("{}: its format is {format:?}, not {FORMAT:?}", path.display())]
    Format {
        /// Which one.
        path: PathBuf,
        /// Its format.
        format: String,
    },
    /// Parts of different campaigns.
    #[error(
        "{}: part of another campaign: mission, plan, faults, --actuation, --seed and --runs must be the same in all parts",
        .0.display()
    )]
    AnotherCampaign(PathBuf),
    /// A flight that is there twice.
    #[error("{}: flight {run} is in another part too", path.display())]
    Twice {
        /// The second document with it.
        path: PathBuf,
        /// Its number.
        run: u64,
    },
    /// No document at all.
    #[error("there is nothing to merge")]
    Nothing,
}

/// What the names of parts' documents begin and end with.
const PART: [&str; 2] = ["shard-", ".json"];

/// The file name of the document of part `index`, from 1, of `of`.
#[must_use]
pub fn part_file_name(index: u64, of: u64) -> String {
    let [begin, end] = PART;
    format!("{begin}{index}-of-{of}{end}")
}

fn is_part(file_name: &str) -> bool {
    let [begin, end] = PART;
    file_name.starts_with(begin) && file_name.ends_with(end)
}

/// The documents that `paths` name: files, and of a directory its `shard-*.json`.
fn documents(paths: &[PathBuf]) -> Result<Vec<PathBuf>, MergeError> {
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let unreadable = |error| MergeError::Unreadable { path: path.clone(), error };
        let mut found = Vec::new();
        for entry in std::fs::read_dir(path).map_err(unreadable)? {
            let name = entry.map_err(unreadable)?.file_name();
            if is_part(&name.to_string_lossy()) {
                found.push(path.join(name));
            }
        }
        if found.is_empty() {
            return Err(MergeError::NoParts(path.clone()));
        }
        found.sort();
        all.append(&mut found);
    }
    Ok(all)
}

fn read(path: &Path) -> Result<CampaignDocument, MergeError> {
    let named = || path.to_path_buf();
    let text =
        std::fs::read_to_string(path).map_err(|error| MergeError::Unreadable { path: named(), error })?;
    let document: CampaignDocument =
        serde_json::from_str(&text).map_err(|error| MergeError::NoDocument { path: named(), error })?;
    if document.format != FORMAT {
        return Err(MergeError::Format { path: named(), format: document.format });
    }
    Ok(document)
}

/// One document from the parts: files, or directories that hold them.
///
/// # Errors
/// A file that is no campaign document, parts of different campaigns, a flight that is there twice.
pub fn merge(paths: &[PathBuf]) -> Result<CampaignDocument, MergeError> {
    let mut first = None;
    let mut flights: Vec<FlightLine> = Vec::new();
    let mut seen = BTreeSet::new();
    let mut times = Times::default();
    for path in documents(paths)? {
        let part = read(&path)?;
        let identity = first.get_or_insert_with(|| part.identity.clone());
        if part.identity != *identity {
            return Err(MergeError::AnotherCampaign(path));
        }
        if let Some(twice) = part.flights.iter().find(|flight| !seen.insert(flight.run)) {
            return Err(MergeError::Twice { path, run: twice.run });
        }
        flights.extend(part.flights);
        times.wall_s += part.wall_s;
        times.cpu_s += part.cpu_s;
    }
    let identity = first.ok_or(MergeError::Nothing)?;
    let complete = flights.len() as u64 >= identity.campaign_runs;
    Ok(CampaignDocument::new(identity, None, complete, flights, times))
}
