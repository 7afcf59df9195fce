//! The links, seen from outside: bytes made by pymavlink, real sockets, hostile peers.

#![cfg(feature = "companion")]
// Clippy's own exception for tests does not reach their helpers.
#![allow(clippy::unwrap_used, clippy::panic)]

mod clocks;
mod codec;
mod common;
mod dialect;
mod gate;
#[cfg(all(unix, feature = "serial"))]
mod serial;
mod signing;
mod smoke;
mod stalls;
mod tlog;
mod transports;
mod trust;
mod tunnel;
mod wire;
