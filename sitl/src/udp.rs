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

/// Runs the vehicle until its time is up; the caller races this against a signal.
///
/// # Errors
/// The socket cannot be bound.
pub async fn run(vehicle: &mut Vehicle, link: Link, pace: Pace) -> std::io::Result<()> {
    let (bind, mut client) = match link {
        Link::In(address) => (address, None),
        Link::Out(address) if address.is_ipv4() => (SocketAddr::from(([0, 0, 0, 0], 0)), Some(address)),
        Link::Out(address) => (SocketAddr::from(([0u16; 8], 0)), Some(address)),
    };
    let socket = UdpSocket::bind(bind).await?;
    let mut clock = Clock::new(pace.speed);
    let mut ticker = tokio::time::interval(PERIOD);
    ticker.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    let mut buffer = vec![0u8; 4096];
    loop {
        tokio::select! {
            _ = ticker.tick() => {}
            received = socket.recv_from(&mut buffer) => {
                // An ICMP refusal from a client that is not there yet comes back as an error; it will come.
                if let Ok((len, from)) = received {
                    let frames = vehicle.counters().wire.frames;
                    vehicle.handle(0, &buffer[..len], clock.now());
                    let well_formed = vehicle.counters().wire.frames > frames;
                    if well_formed && client != Some(from) {
                        tracing::info!("client {from}");
                        client = Some(from);
                    }
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
            return Ok(());
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
