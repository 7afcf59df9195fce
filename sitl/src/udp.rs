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

/// Binds the link's socket.
///
/// # Errors
/// The address cannot be bound.
pub async fn bind(link: Link) -> std::io::Result<UdpSocket> {
    UdpSocket::bind(match link {
        Link::In(address) => address,
        Link::Out(address) if address.is_ipv4() => SocketAddr::from(([0, 0, 0, 0], 0)),
        Link::Out(_) => SocketAddr::from(([0u16; 8], 0)),
    })
    .await
}

/// Runs the vehicle until its time is up; the caller races this against a signal.
pub async fn run(vehicle: &mut Vehicle, socket: &UdpSocket, link: Link, pace: Pace) {
    let mut client = match link {
        Link::In(_) => None,
        Link::Out(address) => Some(address),
    };
    let mut clock = Clock::new(pace.speed);
    let mut ticker = tokio::time::interval(PERIOD);
    ticker.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let mut buffer = vec![0u8; 4096];
    loop {
        tokio::select! {
            _ = ticker.tick() => {}
            // An ICMP refusal from a client that is not there yet comes back as an error; it will come.
            received = socket.recv_from(&mut buffer) => if let Ok((len, from)) = received {
                let frames = vehicle.counters().wire.frames;
                vehicle.handle(0, &buffer[..len], clock.now());
                let well_formed = vehicle.counters().wire.frames > frames;
                if well_formed && client != Some(from) {
                    tracing::info!("client {from}");
                    client = Some(from);
                }
            }
        }
        let now = clock.now();
        vehicle.advance(now);
        while let Some((_, frame)) = vehicle.poll_transmit() {
            if let Some(client) = client {
                // UDP: what cannot be sent is lost.
                let _ = socket.send_to(&frame, client).await;
            }
        }
        if pace.duration.is_some_and(|end| now >= end) {
            return;
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
    fn val_links_are_read() {
        assert_eq!(
            "udpin:127.0.0.1:14550".parse::<Link>().unwrap(),
            Link::In(([127, 0, 0, 1], 14550).into())
        );
        assert_eq!("udpout:[::1]:9".parse::<Link>().unwrap(), Link::Out("[::1]:9".parse().unwrap()));
        for bad in ["", "udpin", "udpin:", "tcp:127.0.0.1:1", "udpout:127.0.0.1:99999", "udpout:nowhere"] {
            assert!(bad.parse::<Link>().is_err(), "{bad}");
        }
    }

    #[tokio::test]
    async fn prop_a_client_is_learnt_from_a_frame_and_not_from_junk() {
        let local: SocketAddr = ([127, 0, 0, 1], 0).into();
        let socket = bind(Link::In(local)).await.unwrap();
        let address = socket.local_addr().unwrap();
        let (junk, client) = (UdpSocket::bind(local).await.unwrap(), UdpSocket::bind(local).await.unwrap());
        junk.send_to(&[0xFD, 1, 2, 3], address).await.unwrap();
        // A HEARTBEAT of a ground station, MAVLink 1, sequence 0, by hand.
        let mut frame = vec![0xFE, 9, 0, 255, 190, 0, 0, 0, 0, 0, 6, 8, 0, 0, 3];
        let crc = mavlink::calculate_crc(&frame[1..], 50);
        frame.extend(crc.to_le_bytes());
        client.send_to(&frame, address).await.unwrap();
        let mut vehicle = vehicle();
        let pace = Pace { speed: 100.0, duration: Some(Duration::from_secs(10)) };
        run(&mut vehicle, &socket, Link::In(local), pace).await;
        let mut buffer = [0u8; 300];
        client.recv_from(&mut buffer).await.unwrap();
        assert_eq!(buffer[0], 0xFD);
        assert_eq!(junk.try_recv(&mut buffer).unwrap_err().kind(), std::io::ErrorKind::WouldBlock);
    }
}
