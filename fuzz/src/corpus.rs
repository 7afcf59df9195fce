//! The inputs that each reached something that no other had: in memory, and as files of a directory.

use std::io;
use std::path::{Path, PathBuf};

use crate::reached::{Fingerprint, Reached};
use crate::target::Target;

/// Where the repository keeps a target's corpus.
#[must_use]
pub fn directory(target: &Target) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target.name)
}

/// The file name of an input.
#[must_use]
pub fn name_of(input: &[u8]) -> String {
    format!("{:016x}", Fingerprint::of(input))
}

/// The inputs of a directory in the order of their names; none if it is not there.
///
/// # Errors
/// What cannot be read.
pub fn load(directory: &Path) -> io::Result<Vec<Vec<u8>>> {
    let entries = match std::fs::read_dir(directory) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error),
    };
    let mut paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<io::Result<Vec<_>>>()?;
    paths.sort();
    paths.iter().map(std::fs::read).collect()
}

/// Writes an input; its path.
///
/// # Errors
/// What cannot be written.
pub fn store(directory: &Path, input: &[u8]) -> io::Result<PathBuf> {
    std::fs::create_dir_all(directory)?;
    let path = directory.join(name_of(input));
    std::fs::write(&path, input)?;
    Ok(path)
}

/// Those of `inputs` that together reach all that they reach beyond `known`, the shorter ones first.
#[must_use]
pub fn distilled(target: &Target, mut inputs: Vec<Vec<u8>>, known: &Reached) -> Vec<Vec<u8>> {
    inputs.sort_by(|a, b| (a.len(), a).cmp(&(b.len(), b)));
    let mut known = known.clone();
    inputs.retain(|input| {
        let reached = target.reach(input);
        let new = !known.covers(&reached);
        known.join(&reached);
        new
    });
    inputs
}

/// A shorter input that reaches all of `wanted` as well, as far as a bounded search finds one.
#[must_use]
pub fn trimmed(input: &[u8], wanted: &Reached, reach: impl Fn(&[u8]) -> Option<Reached>) -> Vec<u8> {
    /// Attempts: enough to halve a long input many times, few enough not to hold up the search.
    const ATTEMPTS: usize = 300;
    let mut best = input.to_vec();
    let mut part = best.len() / 2;
    let mut attempts = 0;
    while part > 0 && attempts < ATTEMPTS {
        let mut at = 0;
        while at < best.len() && attempts < ATTEMPTS {
            let mut shorter = best.clone();
            shorter.drain(at..(at + part).min(best.len()));
            attempts += 1;
            if reach(&shorter).is_some_and(|reached| reached.covers(wanted)) {
                best = shorter;
            } else {
                at += part;
            }
        }
        part /= 2;
    }
    best
}
