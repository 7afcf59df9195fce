//! Fuzzing with memory, on the stable compiler: targets that take whatever bytes there are, a corpus of inputs that each
//! reached something different, and the loop that makes new inputs of them (docs/fuzzing.md).
//!
//! There is no instrumentation: what an input reached is what its target says of it ([`reached`]): reasons of refusals,
//! states, events, kinds of messages. So the loop needs no nightly compiler and no sanitizer, and a corpus entry says
//! what it stands for.

pub mod corpus;
pub mod fuzzer;
pub mod mutator;
pub mod reached;
pub mod scratch;
pub mod target;
pub mod targets;
pub mod watchdog;
pub mod wire;

pub use reached::Reached;
pub use target::{TARGETS, Target};
