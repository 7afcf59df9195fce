//! The log of this process as a file of the flight that is being recorded: the lines of stderr as JSON, and what a terminal
//! is spared.

use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use tracing::Subscriber;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::registry::LookupSpan;

use crate::durable::append::{Appender, Keeping};
use crate::link::tlog;

/// The file, once there is one.
static FILE: Mutex<Option<Arc<Appender<Vec<u8>>>>> = Mutex::new(None);

/// What goes there: of other crates no more than on stderr.
pub(super) fn layer<S: Subscriber + for<'a> LookupSpan<'a>>() -> impl Layer<S> {
    let kept = Targets::new().with_default(LevelFilter::INFO).with_target("veilwing", LevelFilter::DEBUG);
    let lines = tracing_subscriber::fmt::layer().json().with_target(false).with_writer(Lines);
    lines.log_internal_errors(false).with_filter(kept)
}

/// From now on into this file.
pub(super) fn begin(path: &Path, keeping: Keeping) -> Result<(), String> {
    let file = Appender::start(path, keeping, tlog::told)
        .map_err(|error| crate::config::file::unwritable(path, &error))?;
    *FILE.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(file));
    Ok(())
}

/// Waits until it is written.
pub(super) fn end() {
    // Dropped without the lock: its thread may have something to log.
    let file = FILE.lock().unwrap_or_else(PoisonError::into_inner).take();
    drop(file);
}

/// Takes lines for the file, or for nobody.
struct Lines;

impl<'a> MakeWriter<'a> for Lines {
    type Writer = Line;

    fn make_writer(&'a self) -> Line {
        Line(FILE.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }
}

/// One line, which comes in one piece.
struct Line(Option<Arc<Appender<Vec<u8>>>>);

impl Write for Line {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some(file) = &self.0 {
            file.push(bytes.to_vec());
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
