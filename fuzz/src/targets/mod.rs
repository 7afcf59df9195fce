//! One file a target, or a family of them.

pub mod autopilot;
pub mod executive;
pub mod files;
pub mod frames;
pub mod recording;
pub mod report;
pub mod signing;
pub mod slot;
pub mod tlog;
pub mod transmitter;
