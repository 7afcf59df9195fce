//! The paper's section II, antenna pattern, link budget, secrecy rate and attitude jitter; and the link as it is: null
//! floors, measured patterns and scattering.

pub mod antenna;
pub(crate) mod exponential;
pub mod fading;
pub mod jitter;
pub mod link;
pub mod measured;
pub mod pattern;
pub mod secrecy;
