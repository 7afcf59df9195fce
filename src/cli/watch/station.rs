//! The addresses of a ground station. Unlike a companion it takes whoever speaks: both vehicles may send to one port.

use std::collections::BTreeMap;
use std::net::SocketAddr;

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MavHeader, Message};
use tokio::net::UdpSocket;

use crate::link::codec::{Decoder, Encoder};
use crate::link::signing::{Key, RADIO_STATUS_ID, Signing, SigningConfig};
use crate::link::{Aboard, Clock, Counters, Frame, Link, LinkAddress, LinkConfig};

/// More senders than these are no vehicles.
const MOST_SENDERS: usize = 16;
/// One UDP datagram at its largest.
const DATAGRAM: usize = 65_536;

/// Who this station is.
pub(in crate::cli) struct Station {
    /// System and component.
    pub own: (u8, u8),
    /// What it says once a second, if it says that it is there.
    pub heartbeat: Option<MavMessage>,
}

/// One address.
pub(in crate::cli) enum Port {
    /// To one peer.
    Link(Box<Link<Aboard>>),
    /// To whoever sends here.
    Open(Box<Open>),
}

/// A UDP port that anybody may send to.
pub(in crate::cli) struct Open {
    socket: UdpSocket,
    signing: Option<Signing>,
    encoder: Encoder,
    senders: BTreeMap<SocketAddr, Sender>,
    /// Whose bytes are being decoded.
    draining: Option<SocketAddr>,
    counters: Counters,
    clock: Clock,
    buffer: Vec<u8>,
}

#[derive(Default)]
struct Sender {
    decoder: Decoder<Aboard>,
    /// The systems that were heard from there, by frames that passed.
    systems: Vec<u8>,
}

impl Port {
    /// Opens an address, the `place`th of this station's. With a key, nothing unsigned passes.
    ///
    /// # Errors
    /// An address that cannot be had, or signing that cannot be set up; in words.
    pub async fn open(
        address: &LinkAddress,
        place: usize,
        key: Option<&Key>,
        clock: &Clock,
    ) -> Result<Self, String> {
        let signing = match key {
            None => None,
            Some(key) => Some(SigningConfig {
                key: key.clone(),
                link_id: u8::try_from(place).unwrap_or(u8::MAX),
                state_file: state_file(address)?,
                unsigned_allowed: vec![RADIO_STATUS_ID],
            }),
        };
        if let LinkAddress::UdpIn(at) = address {
            let failed = |error: std::io::Error| {
                format!(
                    "cannot listen on {address}: {error}; another ground station may have the port: end it, or let it pass MAVLink on to another port"
                )
            };
            let socket = UdpSocket::bind((at.host.as_str(), at.port)).await.map_err(failed)?;
            let signing = signing.map(|signing| Signing::open(signing, clock.utc())).transpose();
            return Ok(Self::on(socket, signing.map_err(|error| error.to_string())?, clock));
        }
        let config = LinkConfig {
            name: address.to_string(),
            peer_system: None,
            accept_foreign: true,
            signing,
            tlog: None,
        };
        let link = Link::open(address.clone(), config, clock.clone()).await;
        link.map(|link| Self::Link(Box::new(link))).map_err(|error| error.to_string())
    }

    /// On a socket that is bound already.
    pub fn on(socket: UdpSocket, signing: Option<Signing>, clock: &Clock) -> Self {
        Self::Open(Box::new(Open {
            socket,
            signing,
            encoder: Encoder::default(),
            senders: BTreeMap::new(),
            draining: None,
            counters: Counters::default(),
            clock: clock.clone(),
            buffer: vec![0; DATAGRAM],
        }))
    }

    /// The next message, and whose it is. Safe to cancel.
    pub async fn recv(&mut self) -> (MavHeader, Aboard) {
        let frame = match self {
            Self::Link(link) => link.recv().await,
            Self::Open(open) => open.recv().await,
        };
        (frame.header, frame.message)
    }

    /// Sends a message to whoever it is for.
    pub fn send(&mut self, from: (u8, u8), message: &MavMessage) {
        match self {
            Self::Link(link) => link.send(from, &Aboard::Common(message.clone())),
            Self::Open(open) => open.send(from, message),
        }
    }
}

impl Open {
    async fn recv(&mut self) -> Frame<Aboard> {
        loop {
            if let Some(frame) = self.next_frame() {
                return frame;
            }
            // An error is an earlier datagram's that nobody took: of no account to who listens.
            let Ok((length, from)) = self.socket.recv_from(&mut self.buffer).await else {
                tokio::task::yield_now().await;
                continue;
            };
            if self.senders.len() >= MOST_SENDERS && !self.senders.contains_key(&from) {
                continue;
            }
            let decoder = &mut self.senders.entry(from).or_default().decoder;
            decoder.feed(&self.buffer[..length]);
            decoder.end();
            self.draining = Some(from);
        }
    }

    /// The next frame of what was read last that passes.
    fn next_frame(&mut self) -> Option<Frame<Aboard>> {
        let from = self.draining?;
        let utc = self.clock.utc();
        let sender = self.senders.get_mut(&from)?;
        while let Some(raw) = sender.decoder.next_frame(&mut self.counters) {
            let passes = self.signing.as_mut().is_none_or(|signing| signing.verify(&raw, utc).is_ok());
            let Some(frame) = raw.parse::<Aboard>().ok().filter(|_| passes) else { continue };
            if let Ok(system) = u8::try_from(frame.header.system_id)
                && !sender.systems.contains(&system)
            {
                sender.systems.push(system);
            }
            return Some(frame);
        }
        // Who has never said anything that passes is nobody, and takes no place.
        if sender.systems.is_empty() {
            self.senders.remove(&from);
        }
        self.draining = None;
        None
    }

    fn send(&mut self, from: (u8, u8), message: &MavMessage) {
        let to = message.target_system_id().filter(|system| *system != 0);
        let raw = match &mut self.signing {
            None => self.encoder.encode(from, message),
            Some(signing) => {
                let mut raw = self.encoder.encode_for_signing(from, message);
                if signing.sign(&mut raw, self.clock.utc()).is_err() {
                    return;
                }
                raw
            }
        };
        for (address, sender) in &self.senders {
            if to.is_none_or(|system| sender.systems.contains(&system)) {
                // A full buffer, or nobody there any more: lost, as on any radio link, and said again.
                let _ = self.socket.try_send_to(raw.raw_bytes(), *address);
            }
        }
    }
}

/// Where the timestamps of a signed address are kept, so that nothing is taken twice.
fn state_file(address: &LinkAddress) -> Result<std::path::PathBuf, String> {
    let home = |name: &str, below: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(|value| std::path::PathBuf::from(value).join(below))
    };
    let base = home("XDG_STATE_HOME", "").or_else(|| home("HOME", ".local/state"));
    let directory =
        base.ok_or("neither XDG_STATE_HOME nor HOME says where the signing timestamps can be kept")?;
    let directory = directory.join("veilwing");
    std::fs::create_dir_all(&directory)
        .map_err(|error| format!("cannot make {}: {error}", directory.display()))?;
    let name: String =
        address.to_string().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    Ok(directory.join(format!("watch-{name}.signing")))
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd};

    use super::*;
    use crate::link::RawFrame;

    const OPERATOR: (u8, u8) = (255, 190);

    fn signing(name: &str, key: u8) -> Signing {
        let directory = std::env::temp_dir().join(format!("veilwing-station-{}", std::process::id()));
        std::fs::create_dir_all(&directory).unwrap();
        let config = SigningConfig {
            key: Key::new([key; 32]),
            link_id: 0,
            state_file: directory.join(name),
            unsigned_allowed: Vec::new(),
        };
        Signing::open(config, Clock::real().utc()).unwrap()
    }

    async fn port(signing: Option<Signing>) -> (Port, SocketAddr) {
        let socket = UdpSocket::bind(("127.0.0.1", 0)).await.unwrap();
        let at = socket.local_addr().unwrap();
        (Port::on(socket, signing, &Clock::real()), at)
    }

    /// A vehicle of this system, which speaks to a port.
    async fn vehicle(system: u8, to: SocketAddr, signing: Option<&mut Signing>) -> UdpSocket {
        let socket = UdpSocket::bind(("127.0.0.1", 0)).await.unwrap();
        socket.connect(to).await.unwrap();
        say(&socket, system, signing).await;
        socket
    }

    async fn say(socket: &UdpSocket, system: u8, signing: Option<&mut Signing>) {
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let mut encoder = Encoder::default();
        let raw = match signing {
            None => encoder.encode((system, 191), &heartbeat),
            Some(signing) => {
                let mut raw = encoder.encode_for_signing((system, 191), &heartbeat);
                signing.sign(&mut raw, Clock::real().utc()).unwrap();
                raw
            }
        };
        socket.send(raw.raw_bytes()).await.unwrap();
    }

    fn kill(target_system: u8) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_USER_2,
            target_system,
            target_component: 191,
            ..COMMAND_LONG_DATA::default()
        })
    }

    async fn received(socket: &UdpSocket) -> RawFrame {
        let mut buffer = [0; 512];
        let length = socket.recv(&mut buffer).await.unwrap();
        RawFrame::from_bytes(&buffer[..length]).unwrap()
    }

    #[tokio::test]
    async fn spec_two_vehicles_on_one_port_are_both_heard_and_each_is_told_what_is_for_it() {
        let (mut port, at) = port(None).await;
        let first = vehicle(1, at, None).await;
        assert_eq!(port.recv().await.0.system_id, 1);
        let second = vehicle(2, at, None).await;
        assert_eq!(port.recv().await.0.system_id, 2);
        port.send(OPERATOR, &kill(2));
        port.send(OPERATOR, &kill(1));
        // Nothing of the order to the second came to the first before its own.
        for (socket, system) in [(&first, 1), (&second, 2)] {
            let frame = received(socket).await.parse::<Aboard>().unwrap();
            assert_eq!(frame.message.target_system_id(), Some(system));
        }
        port.send(OPERATOR, &kill(0));
        received(&first).await;
        received(&second).await;
    }

    #[tokio::test]
    async fn spec_with_a_key_only_what_is_signed_by_it_is_heard_and_orders_are_signed() {
        let (mut port, at) = port(Some(signing("own", 7))).await;
        let (mut theirs, mut other) = (signing("theirs", 7), signing("other", 8));
        let stranger = vehicle(3, at, None).await;
        let forger = vehicle(4, at, Some(&mut other)).await;
        let vehicle = vehicle(1, at, Some(&mut theirs)).await;
        assert_eq!(port.recv().await.0.system_id, 1);
        port.send(OPERATOR, &kill(0));
        let order = received(&vehicle).await;
        assert_eq!(theirs.verify(&order, Clock::real().utc()), Ok(true));
        // Who is not heard is not spoken to either.
        for socket in [&stranger, &forger] {
            let mut buffer = [0; 512];
            assert!(socket.try_recv(&mut buffer).is_err());
        }
    }
}
