//! Directories for as long as an input runs.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// In memory where there is such a place: nothing here has to outlive the machine.
const IN_MEMORY: &str = "/dev/shm";
static DIRECTORIES: AtomicU64 = AtomicU64::new(0);

/// An empty directory of one's own, gone when it is dropped.
#[derive(Debug)]
pub struct Scratch(PathBuf);

impl Scratch {
    /// A new one.
    ///
    /// # Panics
    /// If there is no place for it.
    #[must_use]
    pub fn new() -> Self {
        let number = DIRECTORIES.fetch_add(1, Ordering::Relaxed);
        let in_memory = Path::new(IN_MEMORY);
        let base = if in_memory.is_dir() { in_memory.to_owned() } else { std::env::temp_dir() };
        let path = base.join(format!("veilwing-fuzz-{}-{number}", std::process::id()));
        let made = std::fs::create_dir_all(&path);
        assert!(made.is_ok(), "{}: {made:?}", path.display());
        Self(path)
    }

    /// One with these files.
    ///
    /// # Panics
    /// If they cannot be written.
    #[must_use]
    pub fn with(files: &[(&str, &[u8])]) -> Self {
        let scratch = Self::new();
        for (name, content) in files {
            let written = std::fs::write(scratch.0.join(name), content);
            assert!(written.is_ok(), "{name}: {written:?}");
        }
        scratch
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Default for Scratch {
    fn default() -> Self {
        Self::new()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What is left behind is in a directory for temporary files.
        drop(std::fs::remove_dir_all(&self.0));
    }
}
