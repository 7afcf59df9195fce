//! The pair link's messages, generated from `message_definitions/veilwing.xml`.

#[allow(missing_docs, unexpected_cfgs, clippy::all, clippy::unwrap_used, clippy::expect_used, clippy::panic)]
mod generated {
    include!(concat!(env!("OUT_DIR"), "/pair/mod.rs"));
}

pub use generated::veilwing::*;

/// The bytes of a digest that the frequent messages carry.
pub type ShortDigest = [u8; 8];

/// The first bytes of a digest.
#[must_use]
pub fn short(digest: &[u8; 32]) -> ShortDigest {
    let mut short = [0; 8];
    short.copy_from_slice(&digest[..8]);
    short
}
