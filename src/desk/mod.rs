//! What a desk needs and a vehicle does not: flights in the simulated world, campaigns of them, calibrations, reports, the paper's
//! figures. The onboard build leaves the whole room out.

pub mod calibration;
pub mod campaign;
mod csv_text;
mod drawing;
pub mod figures;
mod order;
mod quantile;
pub mod report;
pub mod simulation;
pub mod watch;

pub use order::Order;
