//! Many flights of one mission: flown on several threads, told in one document, merged from parts.

pub mod coverage;
mod document;
mod merge;
mod pool;

pub use document::{
    CampaignDocument, Ending, ExcusedLine, Exposure, FORMAT, FaultLine, FlightLine, Identity, Mean, Times,
    ViolationLine,
};
pub use merge::{MergeError, merge, part_file_name};
pub use pool::{Done, fly_all};
