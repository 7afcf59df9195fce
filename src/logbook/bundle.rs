//! Both vehicles' recordings of one mission as one archive: what a report is made of, in one directory.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::entry::files;
use super::{Entry, Writer};
use crate::role::Role;
use crate::time::Utc;

/// Why there is no bundle.
#[derive(Debug, thiserror::Error)]
pub enum BundleError {
    /// No companion recorded anything.
    #[error(
        "no flight of a companion in {searched}: give the directories that [log] dir names, of both vehicles"
    )]
    Nothing {
        /// Where was looked.
        searched: String,
    },
    /// There is no flight of that name.
    #[error("no flight is called {name:?}: `veilwing logs` lists them")]
    Unknown {
        /// The name asked for.
        name: String,
    },
    /// The flights asked for are of several missions.
    #[error("the flights are of different missions ({first}, {second}): bundle those of one mission")]
    Missions {
        /// A flight.
        first: String,
        /// One of another mission.
        second: String,
    },
    /// The archive cannot be written, or a log not be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// What goes into an archive.
#[derive(Debug)]
pub struct Bundle {
    /// Its directory in the archive.
    pub name: String,
    /// The flights in it.
    pub flights: Vec<Entry>,
    /// What the operator should know.
    pub notes: Vec<String>,
    /// Names in that directory, and the files.
    files: Vec<(String, PathBuf)>,
}

impl Bundle {
    /// Of these flights, by name, or if none is named of the newest, the other vehicle's that goes with it, and whatever was
    /// recorded meanwhile.
    ///
    /// # Errors
    /// [`BundleError`].
    pub fn choose(entries: &[Entry], named: &[String], searched: &str) -> Result<Self, BundleError> {
        let mut notes = Vec::new();
        let flights = match named {
            [] => chosen(entries, &mut notes)
                .ok_or_else(|| BundleError::Nothing { searched: searched.to_owned() })?,
            named => by_name(entries, named)?,
        };
        for role in Role::BOTH {
            if !flights.iter().any(|flight| flight.writer == Writer::Companion(role)) {
                notes.push(format!(
                    "no flight of vehicle {role} is in it: give its log directory too, copied from that vehicle"
                ));
            }
        }
        for flight in flights.iter().filter(|flight| flight.running) {
            notes.push(format!("{} is being recorded still: what is in it ends here", flight.name));
        }
        let first = &flights[0];
        let name = format!("{}-{}", first.mission, first.name.split('-').next().unwrap_or_default());
        Ok(Self { name, files: laid_out(&flights), flights, notes })
    }

    /// Writes the archive, which must not be there yet: tar, packed by gzip.
    ///
    /// # Errors
    /// [`BundleError::Io`].
    pub fn write(&self, out: &Path) -> Result<(), BundleError> {
        let fault = |path: &Path, source| BundleError::Io { path: path.to_owned(), source };
        let file = File::create_new(out).map_err(|error| fault(out, error))?;
        let written = self.write_into(file);
        if written.is_err() {
            // Half an archive is none.
            std::fs::remove_file(out).ok();
        }
        written.map_err(|(path, error)| fault(&path.unwrap_or_else(|| out.to_owned()), error))
    }

    fn write_into(&self, file: File) -> Result<(), (Option<PathBuf>, io::Error)> {
        let mut archive = tar::Builder::new(GzEncoder::new(file, Compression::default()));
        for (name, path) in &self.files {
            let (data, header) = read(path).map_err(|error| (Some(path.clone()), error))?;
            let name = format!("{}/{name}", self.name);
            let mut header = header;
            archive.append_data(&mut header, name, data).map_err(|error| (Some(path.clone()), error))?;
        }
        let file = archive.into_inner().and_then(GzEncoder::finish);
        file.and_then(|mut file| file.flush().and_then(|()| file.sync_all())).map_err(|error| (None, error))
    }
}

/// A file as it is now, though it may grow meanwhile.
fn read(path: &Path) -> io::Result<(impl Read, tar::Header)> {
    let file = File::open(path)?;
    let data = file.metadata()?;
    let mut header = tar::Header::new_gnu();
    header.set_size(data.len());
    header.set_mode(0o644);
    let changed = data.modified()?.duration_since(UNIX_EPOCH).unwrap_or_default();
    header.set_mtime(changed.as_secs());
    Ok((file.take(data.len()), header))
}

fn by_name(entries: &[Entry], named: &[String]) -> Result<Vec<Entry>, BundleError> {
    let mut flights = Vec::<Entry>::new();
    for name in named {
        let found = entries.iter().find(|entry| entry.name == *name);
        let found = found.ok_or_else(|| BundleError::Unknown { name: name.clone() })?;
        if let Some(other) = flights.iter().find(|flight| of_other_missions(flight, found)) {
            return Err(BundleError::Missions { first: other.name.clone(), second: found.name.clone() });
        }
        flights.push(found.clone());
    }
    Ok(flights)
}

fn digest(entry: &Entry) -> Option<&str> {
    entry.record.as_ref()?.mission_digest.as_deref()
}

fn of_other_missions(a: &Entry, b: &Entry) -> bool {
    matches!((digest(a), digest(b)), (Some(a), Some(b)) if a != b)
}

/// The newest flight of a companion, and all that goes with it: the first is I's, if there is one.
fn chosen(entries: &[Entry], notes: &mut Vec<String>) -> Option<Vec<Entry>> {
    let companions = entries
        .iter()
        .filter(|entry| matches!(entry.writer, Writer::Companion(_)) && digest(entry).is_some());
    let newest = companions.clone().max_by_key(|entry| (start(entry), entry.number))?;
    let others: Vec<&Entry> = companions
        .clone()
        .filter(|entry| entry.writer != newest.writer && digest(entry) == digest(newest))
        .collect();
    let together = |entry: &Entry| overlap(newest, entry);
    let mut partner = others.iter().copied().max_by_key(|entry| (together(entry), start(entry)));
    if let Some(entry) = partner.filter(|entry| together(entry).is_zero()) {
        notes.push(format!(
            "{} and {} do not overlap by the two computers' clocks: they are the newest of that mission; --flight names others",
            newest.name, entry.name
        ));
    }
    // Other starts of the same two, and radios, that were on record at the same time.
    let main: Vec<&Entry> = [Some(newest), partner.take()].into_iter().flatten().collect();
    let beside = entries.iter().filter(|entry| {
        let own = main.iter().any(|flight| flight.path == entry.path);
        !own && !of_other_missions(newest, entry)
            && main.iter().any(|flight| !overlap(flight, entry).is_zero())
    });
    let mut flights: Vec<Entry> = main.iter().copied().cloned().collect();
    flights.sort_by_key(|flight| flight.writer);
    flights.extend(beside.cloned());
    Some(flights)
}

fn start(entry: &Entry) -> Option<Utc> {
    entry.record.as_ref().map(|record| Utc { unix_us: record.started_unix_us })
}

/// How long both were on record, by their computers' clocks.
fn overlap(a: &Entry, b: &Entry) -> Duration {
    match (a.interval(), b.interval()) {
        (Some([a_begins, a_ends]), Some([b_begins, b_ends])) => {
            a_ends.min(b_ends).saturating_since(a_begins.max(b_begins))
        }
        _ => Duration::ZERO,
    }
}

/// Each vehicle's first flight where a report looks for it; every other under its own name. What both have, such as the
/// mission, is there once.
fn laid_out(flights: &[Entry]) -> Vec<(String, PathBuf)> {
    let (mut taken, mut firsts) = (BTreeSet::new(), BTreeSet::new());
    let mut laid = Vec::new();
    for flight in flights {
        let first = flight.writer != Writer::Radio && firsts.insert(flight.writer);
        for path in files(&flight.path) {
            let Some(file) = path.file_name().and_then(|name| name.to_str()) else { continue };
            let name = if first { file.to_owned() } else { format!("{}/{file}", flight.name) };
            if taken.insert(name.clone()) {
                laid.push((name, path));
            }
        }
    }
    laid
}
