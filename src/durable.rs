//! Files that outlive a power cut: small ones, replaced as a whole, and (`append`) those that grow.

pub mod append;

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

/// The file beside `path` that is named as it is, with `suffix` at the end.
#[must_use]
pub fn sibling(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

/// Replaces a file as a whole: at any instant the disk holds the old contents or the new ones. Waits for the disk.
///
/// # Errors
/// The file cannot be written; the old one is as it was.
pub fn replace(path: &Path, contents: &str) -> io::Result<()> {
    let new = sibling(path, ".new");
    let mut file = File::create(&new)?;
    file.write_all(contents.as_bytes())?;
    file.sync_all()?;
    fs::rename(&new, path)?;
    // The rename is on disk when the directory is.
    sync_directory_of(path)
}

/// Waits until the names in a file's directory are on disk.
///
/// # Errors
/// The directory cannot be opened, or the disk does not take it.
pub fn sync_directory_of(path: &Path) -> io::Result<()> {
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    File::open(directory.unwrap_or(Path::new(".")))?.sync_all()
}

/// Keeps the newest contents of a small file on disk, in the order given, by a thread of its own: a slow disk delays nobody.
#[derive(Debug)]
pub struct Keeper {
    contents: Option<Sender<String>>,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    /// A keeper of `path`. `lost` says, for the log, what it means when the disk takes nothing; `done` hears of contents that are on disk,
    /// or that it did not take.
    ///
    /// # Errors
    /// No thread can be started.
    pub fn spawn(
        path: PathBuf,
        lost: &'static str,
        done: impl Fn(&str) + Send + 'static,
    ) -> io::Result<Self> {
        let (contents, queue) = channel();
        let thread = std::thread::Builder::new()
            .name("keeper".to_owned())
            .spawn(move || keep_newest(&path, &queue, lost, done))?;
        Ok(Self { contents: Some(contents), thread: Some(thread) })
    }

    /// Has this written. Never waits.
    pub fn keep(&self, contents: String) {
        if let Some(queue) = &self.contents {
            // The thread ends after this.
            queue.send(contents).ok();
        }
    }
}

impl Drop for Keeper {
    /// Waits until the last contents are on disk.
    fn drop(&mut self) {
        self.contents = None;
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn keep_newest(path: &Path, queue: &Receiver<String>, lost: &str, done: impl Fn(&str)) {
    let mut failing = false;
    while let Ok(first) = queue.recv() {
        // The newest counts.
        let contents = queue.try_iter().last().unwrap_or(first);
        let failed = replace(path, &contents).err();
        if let Some(error) = failed.as_ref().filter(|_| !failing) {
            tracing::warn!(path = %path.display(), %error, "{lost}");
        }
        failing = failed.is_some();
        done(&contents);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A kill and its lifting, written by two threads, might have been kept the other way round.
    #[test]
    fn regress_what_is_given_last_is_on_disk_last() {
        let path = std::env::temp_dir().join(format!("veilwing-keeper-{}", std::process::id()));
        for round in 0..20 {
            let keeper = Keeper::spawn(path.clone(), "lost", |_| ()).unwrap();
            (0..=round).for_each(|n| keeper.keep(format!("{n}")));
            drop(keeper);
            assert_eq!(fs::read_to_string(&path).unwrap(), format!("{round}"));
        }
        fs::remove_file(&path).unwrap();
    }
}
