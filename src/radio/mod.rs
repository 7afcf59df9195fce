//! The paper's section II: antenna pattern, link budget, secrecy rate, attitude jitter.

pub mod pattern;
