//! The links, seen from outside: bytes made by pymavlink, real sockets, hostile peers.

mod codec;
mod common;
mod tlog;
mod transports;
