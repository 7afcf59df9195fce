//! Parts of a campaign, for batch systems: which flights are a part's, and one document from many.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::document::{CampaignDocument, FORMAT, FlightLine, Times};

/// Part `index`, from 1, of `of`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shard {
    pub index: u64,
    pub of: u64,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "give I/K, the I-th of K parts, such as 1/3".to_owned();
        let (index, of) = text.split_once('/').ok_or_else(wrong)?;
        let (index, of) = (index.parse().map_err(|_| wrong())?, of.parse().map_err(|_| wrong())?);
        if index < 1 || index > of {
            return Err(format!("{index} is not from 1 to {of}: parts are counted from 1"));
        }
        Ok(Self { index, of })
    }
}

impl Shard {
    /// The numbers of the part's flights of `runs`: every K-th, so that parts are alike.
    pub fn runs(self, runs: u64) -> Vec<u64> {
        (0..runs).filter(|run| run % self.of == self.index - 1).collect()
    }

    /// As on the command line.
    pub fn name(self) -> String {
        format!("{}/{}", self.index, self.of)
    }

    /// The name of the part's document.
    pub fn file_name(self) -> String {
        format!("shard-{}-of-{}.json", self.index, self.of)
    }
}

/// The documents that `paths` name: files, and of a directory its `shard-*.json`.
fn documents(paths: &[PathBuf]) -> Result<Vec<PathBuf>, String> {
    let mut all = Vec::new();
    for path in paths {
        if !path.is_dir() {
            all.push(path.clone());
            continue;
        }
        let unreadable = |error| format!("{}: {error}", path.display());
        let mut found = Vec::new();
        for entry in std::fs::read_dir(path).map_err(unreadable)? {
            let name = entry.map_err(unreadable)?.file_name();
            if name.to_string_lossy().starts_with("shard-") && name.to_string_lossy().ends_with(".json") {
                found.push(path.join(name));
            }
        }
        if found.is_empty() {
            return Err(format!("{}: holds no shard-*.json; give the --out of the parts", path.display()));
        }
        found.sort();
        all.append(&mut found);
    }
    Ok(all)
}

fn read(path: &Path) -> Result<CampaignDocument, String> {
    let name = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| format!("{name}: {error}"))?;
    let document: CampaignDocument = serde_json::from_str(&text)
        .map_err(|error| format!("{name}: {error}; give documents that `veilwing campaign` wrote"))?;
    if document.format != FORMAT {
        return Err(format!("{name}: its format is {:?}, not {FORMAT:?}", document.format));
    }
    Ok(document)
}

/// One document from the parts.
///
/// # Errors
/// A file that is no campaign document, parts of different campaigns, a flight that is there twice.
pub(super) fn merge(paths: &[PathBuf]) -> Result<CampaignDocument, String> {
    let mut first = None;
    let mut flights: Vec<FlightLine> = Vec::new();
    let mut seen = BTreeSet::new();
    let mut times = Times::default();
    for path in documents(paths)? {
        let part = read(&path)?;
        let identity = first.get_or_insert_with(|| part.identity.clone());
        if part.identity != *identity {
            return Err(format!(
                "{}: part of another campaign: mission, plan, faults, --seed and --runs must be the same in all parts",
                path.display()
            ));
        }
        if let Some(twice) = part.flights.iter().find(|flight| !seen.insert(flight.run)) {
            return Err(format!("{}: flight {} is in another part too", path.display(), twice.run));
        }
        flights.extend(part.flights);
        times.wall_s += part.wall_s;
        times.cpu_s += part.cpu_s;
    }
    let identity = first.ok_or("there is nothing to merge")?;
    let missing = identity.campaign_runs.saturating_sub(flights.len() as u64);
    if missing > 0 {
        eprintln!("warning: {missing} of {} flights are in none of the parts", identity.campaign_runs);
    }
    Ok(CampaignDocument::new(identity, None, missing == 0, flights, times))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_parts_cover_every_flight_once() {
        for of in 1..=7u64 {
            let parts = (1..=of).map(|index| format!("{index}/{of}").parse::<Shard>().unwrap());
            let mut all: Vec<u64> = parts.flat_map(|part| part.runs(20)).collect();
            all.sort_unstable();
            assert_eq!(all, (0..20).collect::<Vec<_>>());
        }
    }

    #[test]
    fn val_bad_parts_are_refused() {
        for text in ["0/3", "4/3", "1", "a/b", "1/0", "-1/3", "1/3/5"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
