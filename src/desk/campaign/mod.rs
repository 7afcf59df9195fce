//! Many flights of one mission: flown on several threads, told in one document, merged from parts.

pub mod coverage;
mod document;
mod line;
mod merge;
mod pool;

pub use super::quantile::Quantile;
pub use document::{CampaignDocument, Exposure, FORMAT, FollowingTotal, Identity, Mean, Times, UserTotal};
pub use line::{Ending, ExcusedLine, FaultLine, FlightLine, FollowingLine, UserLine, ViolationLine};
pub use merge::{MergeError, merge, part_file_name};
pub use pool::{Done, fly_all};
