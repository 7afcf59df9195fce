//! What was refused: by the autopilot, and by us.

/// What the autopilot refused, and how it said so.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("autopilot refused {what}: {answer} {text}")]
pub struct Refusal {
    /// What was asked.
    pub what: String,
    /// Its answer.
    pub answer: String,
    /// Its STATUSTEXT, if any came with it.
    pub text: String,
}

/// Why a parameter stays as it is.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParameterRefusal {
    /// It comes from elsewhere.
    #[error("{name} stays: it is given by {source_of_it}")]
    ReadOnly {
        /// The parameter.
        name: &'static str,
        /// From where.
        source_of_it: &'static str,
    },
    /// Whoever wrote it is no operator.
    #[error("{name} stays: system {system} is no operator")]
    NoOperator {
        /// The parameter.
        name: &'static str,
        /// The MAVLink system.
        system: u32,
    },
    /// It was sent as another type.
    #[error("{0} stays: it is written as a float (REAL32)")]
    NotAFloat(&'static str),
    /// Not one of the values it may have.
    #[error("{name} stays: {value} is not within {} to {}", range[0], range[1])]
    OutOfRange {
        /// The parameter.
        name: &'static str,
        /// What was asked for.
        value: f64,
        /// Least and greatest.
        range: [f64; 2],
    },
}
