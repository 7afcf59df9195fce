//! A vehicle on a UDP address, in real time or faster: the thin shell around [`Vehicle`].

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use tokio::net::UdpSocket;
use veilwing_sitl::Vehicle;

/// How often the vehicle is advanced.
const PERIOD: Duration = Duration::from_millis(2);
/// A stall longer than this (a suspended laptop) is skipped instead of being caught up with.
const LONGEST_STALL: Duration = Duration::from_millis(500);

/// Where a client is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Link {
    /// Listens here; the client is whoever first sends a well-formed frame.
    In(SocketAddr),
    /// Sends there.
    Out(SocketAddr),
}

impl std::fmt::Display for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::In(address) => write!(f, "udpin:{address}"),
            Self::Out(address) => write!(f, "udpout:{address}"),
        }
    }
}

/// Why a link address was not understood.
#[derive(Debug, thiserror::Error)]
#[error("\"{0}\" is no link: write udpout:HOST:PORT or udpin:HOST:PORT, for example udpout:127.0.0.1:14550")]
pub struct LinkError(String);

impl std::str::FromStr for Link {
    type Err = LinkError;

    fn from_str(text: &str) -> Result<Self, LinkError> {
        use std::net::ToSocketAddrs;
        let wrong = || LinkError(text.to_owned());
        let (kind, address) = text.split_once(':').ok_or_else(wrong)?;
        let address = address.to_socket_addrs().ok().and_then(|mut all| all.next()).ok_or_else(wrong)?;
        match kind {
            "udpin" => Ok(Self::In(address)),
            "udpout" => Ok(Self::Out(address)),
            _ => Err(wrong()),
        }
    }
}

/// How long, and how fast.
#[derive(Debug, Clone, Copy)]
pub struct Pace {
    /// Simulated seconds per second of wall time.
    pub speed: f64,
    /// Simulated time after which to stop.
    pub duration: Option<Duration>,
}

/// One socket, and the client behind it.
pub struct Port {
    socket: UdpSocket,
    client: Option<SocketAddr>,
}

impl Port {
    /// Binds a link's socket.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub async fn bind(link: Link) -> std::io::Result<Self> {
        let (at, client) = match link {
            Link::In(address) => (address, None),
            Link::Out(address) if address.is_ipv4() => (SocketAddr::from(([0, 0, 0, 0], 0)), Some(address)),
            Link::Out(address) => (SocketAddr::from(([0u16; 8], 0)), Some(address)),
        };
        Ok(Self { socket: UdpSocket::bind(at).await?, client })
    }
}

/// Runs the vehicle until its time is up; the caller races this against a signal. The first port is the companion's
/// link, all others are ground stations'.
pub async fn run(vehicle: &mut Vehicle, ports: &mut [Port], pace: Pace) {
    for (link, port) in ports.iter().enumerate() {
        if port.client.is_some() {
            vehicle.open_link(link);
        }
    }
    let mut clock = Clock::new(pace.speed);
    let mut ticker = tokio::time::interval(PERIOD);
    ticker.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let mut buffer = vec![0u8; 4096];
    loop {
        ticker.tick().await;
        let now = clock.now();
        for (link, port) in ports.iter_mut().enumerate() {
            receive(vehicle, link, port, &mut buffer, now);
        }
        vehicle.advance(now);
        while let Some((link, frame)) = vehicle.poll_transmit() {
            if let Some(Port { socket, client: Some(client) }) = ports.get(link) {
                // UDP: what cannot be sent is lost.
                let _ = socket.try_send_to(&frame, *client);
            }
        }
        if pace.duration.is_some_and(|end| now >= end) {
            return;
        }
    }
}

/// Takes what has come. Whoever sends a well-formed frame is the link's client.
fn receive(vehicle: &mut Vehicle, link: usize, port: &mut Port, buffer: &mut [u8], now: Duration) {
    // An ICMP refusal from a client that is not there yet comes back as an error; it will come.
    while let Ok((length, from)) = port.socket.try_recv_from(buffer) {
        let frames = vehicle.counters().wire.frames;
        vehicle.handle(link, &buffer[..length], now);
        let well_formed = vehicle.counters().wire.frames > frames;
        if well_formed && port.client != Some(from) {
            tracing::info!("client {from}");
            port.client = Some(from);
        }
    }
}

/// Simulation time from wall time.
struct Clock {
    last: Instant,
    simulated: Duration,
    speed: f64,
}

impl Clock {
    fn new(speed: f64) -> Self {
        Self { last: wall(), simulated: Duration::ZERO, speed }
    }

    fn now(&mut self) -> Duration {
        let wall = wall();
        let passed = wall.saturating_duration_since(self.last).min(LONGEST_STALL);
        self.last = wall;
        self.simulated += passed.mul_f64(self.speed);
        self.simulated
    }
}

/// The one place of this crate that reads a clock.
#[allow(clippy::disallowed_methods)]
fn wall() -> Instant {
    Instant::now()
}

#[cfg(test)]
mod tests {
    use super::*;
    use veilwing_sitl::{JitterConfig, Origin, Role, VehicleConfig};

    fn vehicle() -> Vehicle {
        let origin = Origin { lat_deg: 50.0, lon_deg: 14.0, alt_amsl_m: 200.0 };
        Vehicle::new(VehicleConfig::new(Role::I), JitterConfig::default(), origin, 0, 1)
    }

    #[test]
    fn spec_links_are_read() {
        assert_eq!(
            "udpin:127.0.0.1:14550".parse::<Link>().unwrap(),
            Link::In(([127, 0, 0, 1], 14550).into())
        );
        assert_eq!("udpout:[::1]:9".parse::<Link>().unwrap(), Link::Out("[::1]:9".parse().unwrap()));
        for bad in ["", "udpin", "udpin:", "tcp:127.0.0.1:1", "udpout:127.0.0.1:99999", "udpout:nowhere"] {
            assert!(bad.parse::<Link>().is_err(), "{bad}");
        }
    }

    /// A HEARTBEAT, MAVLink 1, sequence 0, by hand.
    fn heartbeat(from: [u8; 2]) -> Vec<u8> {
        let mut frame = vec![0xFE, 9, 0, from[0], from[1], 0, 0, 0, 0, 0, 6, 8, 0, 0, 3];
        let crc = mavlink::calculate_crc(&frame[1..], 50);
        frame.extend(crc.to_le_bytes());
        frame
    }

    #[tokio::test]
    async fn spec_a_client_is_learnt_from_a_frame_and_not_from_junk() {
        let local: SocketAddr = ([127, 0, 0, 1], 0).into();
        let mut ports = [Port::bind(Link::In(local)).await.unwrap()];
        let address = ports[0].socket.local_addr().unwrap();
        let (junk, client) = (UdpSocket::bind(local).await.unwrap(), UdpSocket::bind(local).await.unwrap());
        junk.send_to(&[0xFD, 1, 2, 3], address).await.unwrap();
        client.send_to(&heartbeat([255, 190]), address).await.unwrap();
        let mut vehicle = vehicle();
        let pace = Pace { speed: 100.0, duration: Some(Duration::from_secs(10)) };
        run(&mut vehicle, &mut ports, pace).await;
        let mut buffer = [0u8; 300];
        client.recv_from(&mut buffer).await.unwrap();
        assert_eq!(buffer[0], 0xFD);
        assert_eq!(junk.try_recv(&mut buffer).unwrap_err().kind(), std::io::ErrorKind::WouldBlock);
    }

    #[tokio::test]
    async fn spec_a_ground_station_hears_the_vehicle_and_its_companion() {
        let local: SocketAddr = ([127, 0, 0, 1], 0).into();
        let (companion, ground) =
            (UdpSocket::bind(local).await.unwrap(), UdpSocket::bind(local).await.unwrap());
        let mut ports = [
            Port::bind(Link::In(local)).await.unwrap(),
            Port::bind(Link::Out(ground.local_addr().unwrap())).await.unwrap(),
        ];
        let address = ports[0].socket.local_addr().unwrap();
        companion.send_to(&heartbeat([1, 191]), address).await.unwrap();
        let pace = Pace { speed: 100.0, duration: Some(Duration::from_secs(5)) };
        run(&mut vehicle(), &mut ports, pace).await;
        let (mut buffer, mut heard) = ([0u8; 300], std::collections::BTreeSet::new());
        while let Ok(length) = ground.try_recv(&mut buffer) {
            let companions = length > 6 && buffer[0] == 0xFE;
            heard.insert(if companions { buffer[4] } else { buffer[6] });
        }
        // Autopilot, radio, and the companion, who speaks on the other link.
        assert!([1, 68, 191].iter().all(|component| heard.contains(component)), "{heard:?}");
    }
}
