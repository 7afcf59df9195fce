//! The paper's section II: antenna pattern, link budget, secrecy rate, attitude jitter.

pub mod jitter;
pub mod link;
pub mod pattern;
pub mod secrecy;
