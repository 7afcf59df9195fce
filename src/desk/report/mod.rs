//! The flight report: what a flight was meant to do, what it did and why, for somebody who was not there.
//!
//! | file of a flight's directory | holds |
//! |---|---|
//! | `scene.json` | what does not change: nodes, radio, airspace, planned slots ([`timeline::Scene`]) |
//! | `timeline.csv` | both vehicles and the radio over time ([`timeline::Sample`]; columns in [`table`]) |
//! | `events.jsonl` | faults, notices of the companions, violations, one JSON object a line ([`timeline::Event`]) |
//! | `summary.json` | the flight document (`veilwing-flight/1`) |
//!
//! A [`timeline::Timeline`] is all of them in memory. It comes from a simulated world, from such a directory, or from the
//! telemetry logs of both companions alone.

mod charts;
pub mod directory;
pub mod facts;
pub mod maps;
pub mod mcap;
mod page;
mod said;
pub mod simulated;
pub mod story;
pub mod table;
pub mod telemetry;
pub mod timeline;
pub mod verdict;
mod words;

pub use page::html;

pub use directory::{RecordError, load, store};
pub use timeline::{Event, EventKind, Sample, Scene, Severity, Source, Timeline};
