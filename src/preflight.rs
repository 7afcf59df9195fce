//! Preflight checks: what they are called, how they came out, and what to do about it.

use std::fmt;

/// How a check came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// As it should be.
    Pass,
    /// Not as it should be, or not known; flying is possible.
    Warn,
    /// Refuses to arm.
    Fail,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pass => "pass",
            Self::Warn => "warn",
            Self::Fail => "fail",
        })
    }
}

/// One preflight check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Check {
    /// What was checked: an aspect of the vehicle, or the parameter's name.
    pub name: &'static str,
    /// How it came out.
    pub result: Verdict,
    /// The value, and what it should be if it is not that.
    pub detail: String,
}

/// Builds a check.
pub(crate) fn check(name: &'static str, result: Verdict, detail: impl Into<String>) -> Check {
    Check { name, result, detail: detail.into() }
}
