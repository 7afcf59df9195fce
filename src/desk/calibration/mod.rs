//! Calibration of a vehicle's antenna from a flight round a receiver whose place is known: what the receiver heard against
//! the angle at which the vehicle believed to show it its antenna.
//!
//! `log` reads the flight, `model` says what should be heard, `fit` finds what makes the two agree and how well that is
//! known, by `least_squares`; `curve` is the pattern itself, angle by angle.

mod curve;
mod fit;
mod least_squares;
mod log;
mod model;

pub use curve::PatternPoint;
pub use fit::{Calibration, Estimate, FitError, fit};
pub use log::{LogError, Reading, read};
pub use model::Site;
