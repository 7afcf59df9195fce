//! The radio's own message, generated from `message_definitions/veilwing_radio.xml`, and the command that it answers.

#[allow(missing_docs, unexpected_cfgs, clippy::all, clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/transmitter/mod.rs"));
}

pub use generated::veilwing_radio::*;

/// TUNNEL's payload type for a message of the radio's, across an autopilot that drops what it does not know; from the
/// range above 32767 that is nobody's registered type.
pub const TUNNEL_TYPE: u16 = 42_120;
/// What boots, series and numbers stay below: they ride in single precision, which holds whole numbers up to here.
pub const WHOLE: u32 = 1 << 24;
