//! Frames made by pymavlink 2.4.50 (`tests/stranger/vectors.py` prints them), and small helpers.

use mavlink::Message;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage};
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::{Clock, Counters, Frame, Link, LinkConfig, RawFrame, Rejection};
use veilwing::link::{HostPort, LinkAddress};

pub type M = MavMessage;

/// From system 1, component 1, sequence 7: quadrotor, PX4, base mode 81, custom mode 0x04030201, active.
pub const HEARTBEAT_V1: &str = "fe090701010001020304020c5104037d95";
pub const HEARTBEAT_V2: &str = "fd09000007010100000001020304020c5104032394";
/// The same with vehicle type 250, autopilot 251 and state 252, which nobody has defined.
pub const HEARTBEAT_UNKNOWN: &str = "fd09000007010100000001020304fafb51fc035490";
/// A COMMAND_ACK of command 400 with the result 77, which nobody has defined.
pub const COMMAND_ACK_UNKNOWN: &str = "fd0300000701014d000090014defe1";
pub const STATUSTEXT_HELLO: &str = "fd060000000101fd00000668656c6c6f4795";
/// From a SiK radio: system 51, component 68.
pub const RADIO_STATUS_V1: &str = "fe090033446d02000100968c5a1e230137";
pub const SCALED_IMU2_V1: &str = "fe160001017401000000020003000400050006000700080009000a00f968";
pub const SCALED_IMU2_V2: &str = "fd18000000010174000001000000020003000400050006000700080009000a00c409bade";

/// The key of the signed vectors: 1, 2, ... 32.
pub const KEY: [u8; 32] = {
    let mut key = [0; 32];
    let mut i = 0;
    while i < 32 {
        key[i] = i as u8 + 1;
        i += 1;
    }
    key
};
/// The UTC of the signed vectors: timestamp 36,992,960,000,000.
pub const SIGNED_UNIX_US: u64 = 1_790_000_000_000_000;
/// [`HEARTBEAT_V2`] signed with link id 5.
pub const HEARTBEAT_SIGNED: &str = "fd09010007010100000001020304020c510403c46c0500703d18a521406a4aae193f";
/// PARAM_VALUE from system 42, component 191, sequence 255, link id 0.
pub const PARAM_VALUE_SIGNED: &str =
    "fd190100ff2abf1600000000803f00000100434f4d5f4f465f4c4f53535f5400000009fc0e0000703d18a521c6fdc4e2e8f3";

pub fn bytes(hex: &str) -> Vec<u8> {
    assert!(hex.len().is_multiple_of(2));
    (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
}

/// Everything that a decoder finds in one datagram.
pub fn decode(datagram: &[u8]) -> (Vec<RawFrame>, Counters) {
    let (mut decoder, mut counters) = (Decoder::<M>::default(), Counters::default());
    decoder.feed(datagram);
    decoder.end();
    let frames = std::iter::from_fn(|| decoder.next_frame(&mut counters)).collect();
    (frames, counters)
}

pub fn heartbeat(custom_mode: u32) -> M {
    M::HEARTBEAT(HEARTBEAT_DATA { custom_mode, mavlink_version: 3, ..HEARTBEAT_DATA::default() })
}

/// The custom mode by which a test's HEARTBEAT is told from others.
pub fn mode_of(frame: &Frame<M>) -> u32 {
    match &frame.message {
        M::HEARTBEAT(heartbeat) => heartbeat.custom_mode,
        other => panic!("not a HEARTBEAT but {}", other.message_name()),
    }
}

/// The bytes of a HEARTBEAT, unsigned.
pub fn heartbeat_bytes(system: u8, custom_mode: u32) -> Vec<u8> {
    Encoder::default().encode((system, 1), &heartbeat(custom_mode)).raw_bytes().to_vec()
}

pub fn loopback(port: u16) -> HostPort {
    HostPort { host: "127.0.0.1".to_owned(), port }
}

/// A link with a peer of system 1.
pub async fn open(address: LinkAddress) -> Link<M> {
    let config = LinkConfig { name: "test".to_owned(), peer_system: Some(1), ..LinkConfig::default() };
    Link::open(address, config, Clock::real()).await.unwrap()
}

/// The reasons counted and how often, without the zeros.
pub fn reasons(counters: &Counters) -> Vec<(Rejection, u64)> {
    let counts = Rejection::ALL.iter().map(|&reason| (reason, counters.rejected.get(reason)));
    counts.filter(|&(_, count)| count > 0).collect()
}
