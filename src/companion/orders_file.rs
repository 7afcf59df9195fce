//! The operator's orders on disk, for the companion's next process: a kill holds over a restart, and a START counts once
//! (S7, F4). Written by a thread of its own, so that a slow disk delays nothing in the air.

use std::io;
use std::path::{Path, PathBuf};

use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};

use crate::durable::{Keeper, replace};
use crate::pair::Record;
use crate::role::Role;

/// What stands above the numbers.
const HEADER: &str = "# The operator's orders as this vehicle's companion knows them (docs/pair-protocol.md), kept over a restart.\n";

/// Why the orders of the last process are not known.
#[derive(Debug, thiserror::Error)]
pub enum OrdersFileError {
    /// The file cannot be read or written.
    #[error(
        "{}: {source}: the operator's orders must be kept over a restart; give [log] dir a directory that can be written",
        path.display()
    )]
    Io {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It is not what was written.
    #[error(
        "{}: {source}help: a radio kill or a flight may be recorded in it; with the vehicle on the ground and disarmed, remove it",
        path.display()
    )]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        source: Box<toml::de::Error>,
    },
}

/// The file, the thread that writes it, and what that has written, or not been able to.
#[derive(Debug)]
pub struct OrdersFile {
    keeper: Keeper,
    written: UnboundedReceiver<Record>,
}

/// Where a vehicle's orders are kept.
#[must_use]
pub fn path(log_dir: &Path, role: Role) -> PathBuf {
    log_dir.join(format!("{}.orders", role.key()))
}

impl OrdersFile {
    /// Reads what the last process kept, and writes it again: what cannot be written is known before the flight.
    ///
    /// # Errors
    /// The file cannot be read or written, or is not what was written.
    pub fn open(path: PathBuf) -> Result<(Self, Record), OrdersFileError> {
        let io = |source| OrdersFileError::Io { path: path.clone(), source };
        let record = match std::fs::read_to_string(&path) {
            Ok(text) => toml::from_str(&text)
                .map_err(|source| OrdersFileError::Content { path: path.clone(), source: source.into() })?,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Record::default(),
            Err(error) => return Err(io(error)),
        };
        contents(&record).and_then(|contents| replace(&path, &contents)).map_err(io)?;
        let lost = "the operator's orders cannot be recorded: after a restart they count no more";
        let (sender, written) = unbounded_channel();
        let done = move |contents: &str| {
            // Nobody waits for it once the companion ends.
            let _ = toml::from_str(contents).map(|record| sender.send(record));
        };
        let keeper = Keeper::spawn(path.clone(), lost, done).map_err(io)?;
        Ok((Self { keeper, written }, record))
    }

    /// Has this written. Never waits; what was given last is on disk when this is dropped.
    pub fn keep(&mut self, record: Record) {
        match contents(&record) {
            Ok(contents) => self.keeper.keep(contents),
            Err(error) => tracing::warn!(%error, "the operator's orders cannot be written down"),
        }
    }
}

/// The next record that is on disk, or that the disk did not take; never, without a file.
pub async fn written(file: &mut Option<OrdersFile>) -> Record {
    let next = match file {
        Some(file) => file.written.recv().await,
        None => None,
    };
    match next {
        Some(record) => record,
        None => std::future::pending().await,
    }
}

fn contents(record: &Record) -> io::Result<String> {
    let text = toml::to_string(record).map_err(io::Error::other)?;
    Ok(format!("{HEADER}{text}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_what_is_kept_is_found_by_the_next_process_and_what_is_broken_is_named() {
        let directory = std::env::temp_dir().join(format!("veilwing-orders-{}", std::process::id()));
        std::fs::create_dir_all(&directory).unwrap();
        let path = path(&directory, Role::J);
        let (mut file, record) = OrdersFile::open(path.clone()).unwrap();
        assert_eq!(record, Record::default());
        let kept = Record { newest: 7, kill: 7, begun: 5, spent: true, ..Record::default() };
        file.keep(Record::default());
        file.keep(kept);
        drop(file);
        assert_eq!(OrdersFile::open(path.clone()).unwrap().1, kept);
        std::fs::write(&path, "newest = -1\n").unwrap();
        let error = OrdersFile::open(path.clone()).unwrap_err().to_string();
        assert!(
            error.contains("j.orders") && error.contains("newest") && error.contains("remove it"),
            "{error}"
        );
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(matches!(OrdersFile::open(path), Err(OrdersFileError::Io { .. })));
        std::fs::remove_dir_all(&directory).unwrap();
    }
}
