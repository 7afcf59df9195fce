//! One end of a link, owned by the event loop.

use std::collections::BTreeMap;
use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, Waker, ready};
use std::time::Duration;

use super::LinkError;
use super::clock::Clock;
use super::codec::Decoder;
use super::counters::{Counters, Rejection};
use super::dialogue::Dialogue;
use super::frame::{Frame, RawFrame};
use super::gate::{self, Gate, GateConfig};
use super::outbox::Outbox;
use super::signing::{Signing, SigningConfig};
use super::tlog::TlogWriter;
use super::transport::{self, Arrival, MemoryEnd, Origin, Transport};
use crate::link::LinkAddress;

/// Reads after which the event loop gets its turn, whatever else waits in the socket.
const READS_PER_POLL: usize = 64;
/// One UDP datagram at its largest, and so the most read at once.
const READ_BYTES: usize = 65_536;
const BACKOFF_FIRST: Duration = Duration::from_millis(100);
const BACKOFF_MAX: Duration = Duration::from_secs(5);

/// What a link is told besides its address.
#[derive(Debug, Default)]
pub struct LinkConfig {
    /// What logs call it.
    pub name: String,
    /// The peer's system id. A peer whose address is not given is learnt from this system's frames alone.
    /// `None`: from those of the only system heard in three seconds, or, with [`Self::accept_foreign`], from any.
    pub peer_system: Option<u8>,
    /// Whether frames of other systems are accepted from the peer's address: on an autopilot's link, behind
    /// which ground stations speak. They never tell where the peer is.
    pub accept_foreign: bool,
    /// Signing, in both directions.
    pub signing: Option<SigningConfig>,
    /// Where what is sent and accepted is logged.
    pub tlog: Option<TlogWriter>,
}

type Opening = Pin<Box<dyn Future<Output = io::Result<Box<dyn Transport>>> + Send>>;
type Sleeping = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Where a link stands. Attempts live here, not in the caller's future: they survive its cancellation.
enum Way {
    Up(Box<dyn Transport>),
    Opening(Opening),
    Waiting(Sleeping),
}

/// One end of a link that speaks dialect `M`.
pub struct Link<M> {
    name: String,
    /// `None` in memory, where nothing ever has to be reopened.
    address: Option<LinkAddress>,
    gate: Gate<M>,
    tlog: Option<TlogWriter>,
    clock: Clock,
    way: Way,
    backoff: Duration,
    outbox: Outbox,
    decoders: BTreeMap<Origin, Decoder<M>>,
    /// Whose bytes are being decoded, and whether nothing will follow them.
    draining: Option<(Origin, bool)>,
    buffer: Vec<u8>,
    counters: Counters,
}

impl<M: Dialogue> Link<M> {
    /// Opens a link. What cannot be reached yet is tried again by [`Self::recv`].
    ///
    /// # Errors
    /// [`LinkError::Bind`] if `udpin:` or `tcpin:` cannot be bound, [`LinkError::Signing`].
    pub async fn open(address: LinkAddress, config: LinkConfig, clock: Clock) -> Result<Self, LinkError> {
        let opened = transport::open(address.clone(), clock.clone()).await;
        let way = Way::Waiting(Box::pin(std::future::ready(())));
        let name = config.name.clone();
        let mut link = Self::new(Some(address.clone()), config, clock, way)?;
        match opened {
            Ok(transport) => link.go_up(transport),
            Err(source) if matches!(address, LinkAddress::UdpIn(_) | LinkAddress::TcpIn(_)) => {
                return Err(LinkError::Bind { name, address, source });
            }
            Err(error) => link.go_down(&error),
        }
        Ok(link)
    }

    /// A link inside the process.
    ///
    /// # Errors
    /// [`LinkError::Signing`].
    pub fn in_memory(end: MemoryEnd, config: LinkConfig, clock: Clock) -> Result<Self, LinkError> {
        let mut link = Self::new(None, config, clock, Way::Waiting(Box::pin(std::future::pending())))?;
        link.go_up(Box::new(end));
        Ok(link)
    }

    fn new(
        address: Option<LinkAddress>,
        config: LinkConfig,
        clock: Clock,
        way: Way,
    ) -> Result<Self, LinkError> {
        let LinkConfig { name, peer_system, accept_foreign, signing, tlog } = config;
        let signing = signing.map(|signing| Signing::open(signing, clock.utc())).transpose();
        let signing = signing.map_err(|source| LinkError::Signing { name: name.clone(), source })?;
        let open_to_anyone = address.as_ref().is_some_and(LinkAddress::learns_its_peer);
        let gate = GateConfig { peer_system, open_to_anyone, accept_foreign, signing };
        Ok(Self {
            name,
            address,
            gate: Gate::new(gate, clock.utc()),
            tlog,
            clock,
            way,
            backoff: BACKOFF_FIRST,
            outbox: Outbox::default(),
            decoders: BTreeMap::new(),
            draining: None,
            buffer: vec![0; READ_BYTES],
            counters: Counters::default(),
        })
    }

    /// Turns away, before it changes anything, what this function refuses. Nothing, unless it is told.
    pub(super) fn admit_only(&mut self, admits: fn(&M) -> Result<(), Rejection>) {
        self.gate.admit_only(admits);
    }

    /// The next frame of the peer's. Never ends: a link that is down is reopened in here. Safe to cancel, and
    /// to be polled among others: after a bounded amount of work without a frame it lets them go first. Silence
    /// is noticed when this is called, so call it every second or more often.
    pub async fn recv(&mut self) -> Frame<M> {
        std::future::poll_fn(|cx| self.poll_recv(cx)).await
    }

    /// [`Self::recv`] of a link that there may be; of none it never ends.
    pub async fn recv_of(link: &mut Option<Self>) -> Frame<M> {
        match link {
            Some(link) => link.recv().await,
            None => std::future::pending().await,
        }
    }

    /// Sends `message` from `(system, component)`. Never waits: without a peer the message is dropped, on a
    /// congested way the oldest one that waits, and either is counted.
    pub fn send(&mut self, from: (u8, u8), message: &M) {
        if !self.is_connected() {
            // Those who ask at the gate are asked back in this name.
            self.gate.speak_as(from);
            self.counters.dropped_unconnected += 1;
            return;
        }
        let sealed = self.gate.seal(from, message, self.clock.utc());
        self.counters.unrecorded = self.gate.unrecorded();
        match sealed {
            Ok(raw) => self.counters.dropped_congested += u64::from(self.outbox.push(raw)),
            Err(error) => {
                self.counters.dropped_unsigned += 1;
                if self.counters.dropped_unsigned.is_power_of_two() {
                    tracing::warn!(link = self.name, %error, "frames are not sent");
                }
                return;
            }
        }
        // What does not go out at once does in `recv`, which also registers for a wake-up.
        self.flush(&mut Context::from_waker(Waker::noop()));
    }

    /// What the link has carried and turned away since it was opened.
    #[must_use]
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Whether there is a peer to send to: an open connection or port, or an address learnt.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        matches!(&self.way, Way::Up(transport) if transport.has_peer())
    }

    /// The link's own address, with the port that the system chose if 0 was asked for.
    #[must_use]
    pub fn local_address(&self) -> Option<SocketAddr> {
        match &self.way {
            Way::Up(transport) => transport.local_address(),
            _ => None,
        }
    }

    fn poll_recv(&mut self, cx: &mut Context<'_>) -> Poll<Frame<M>> {
        for _ in 0..READS_PER_POLL {
            if let Some(frame) = self.next_frame() {
                return Poll::Ready(frame);
            }
            ready!(self.poll_step(cx));
        }
        cx.waker().wake_by_ref();
        Poll::Pending
    }

    /// Makes some headway: reads once, or comes a step closer to being able to.
    fn poll_step(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        self.flush(cx);
        match &mut self.way {
            Way::Up(transport) => match ready!(transport.poll_read(cx, self.clock.now(), &mut self.buffer)) {
                Ok(arrival) => self.take(arrival),
                Err(error) => self.take_error(&error),
            },
            Way::Waiting(sleep) => {
                ready!(sleep.as_mut().poll(cx));
                if let Some(address) = self.address.clone() {
                    self.way = Way::Opening(Box::pin(transport::open(address, self.clock.clone())));
                }
            }
            Way::Opening(attempt) => match ready!(attempt.as_mut().poll(cx)) {
                Ok(transport) => self.go_up(transport),
                Err(error) => self.go_down(&error),
            },
        }
        Poll::Ready(())
    }

    fn go_up(&mut self, transport: Box<dyn Transport>) {
        if transport.has_peer() {
            self.counters.connections += 1;
        }
        let address = self.address.as_ref().map(tracing::field::display);
        tracing::info!(link = self.name, address, "link is open");
        self.way = Way::Up(transport);
    }

    /// Waits before the next attempt, longer each time until a frame of the peer's is accepted again.
    fn go_down(&mut self, error: &io::Error) {
        self.counters.io_errors += 1;
        let (link, wait_ms) = (&self.name, self.backoff.as_millis());
        if matches!(self.way, Way::Up(_)) || self.counters.io_errors.is_power_of_two() {
            let to = self.address.as_ref().map_or_else(String::new, |address| format!(" to {address}"));
            tracing::warn!(link, %error, wait_ms, "link{to} is down, trying again");
        }
        self.counters.dropped_unconnected += self.outbox.clear() as u64;
        if let Some(decoder) = self.decoders.get_mut(&Origin::Peer) {
            decoder.end();
            self.draining = Some((Origin::Peer, true));
        }
        self.way = Way::Waiting(Box::pin(self.clock.sleep_until(self.clock.now() + self.backoff)));
        self.backoff = BACKOFF_MAX.min(self.backoff * 2);
    }

    fn take_error(&mut self, error: &io::Error) {
        // Nobody listens at the peer's port yet. It is there when it is there.
        if error.kind() == io::ErrorKind::ConnectionRefused {
            self.counters.io_errors += 1;
        } else {
            self.go_down(error);
        }
    }

    fn take(&mut self, arrival: Arrival) {
        match arrival {
            Arrival::Bytes { origin, length, ends } => {
                self.counters.received_bytes += length as u64;
                let decoder = self.decoders.entry(origin).or_default();
                decoder.feed(&self.buffer[..length]);
                if ends {
                    decoder.end();
                }
                self.draining = Some((origin, ends));
            }
            Arrival::Headway => {}
            Arrival::Stranger { length } => {
                self.counters.received_bytes += length as u64;
                self.reject(Rejection::Stranger);
            }
        }
    }

    /// The next acceptable frame of what was read last.
    fn next_frame(&mut self) -> Option<Frame<M>> {
        // Accepting a candidate's frame makes its origin the peer's.
        while let Some((origin, ends)) = self.draining {
            let before = self.counters.rejected.total();
            let raw =
                self.decoders.get_mut(&origin).and_then(|decoder| decoder.next_frame(&mut self.counters));
            self.report_rejections_since(before);
            let Some(raw) = raw else {
                if ends {
                    self.decoders.remove(&origin);
                }
                self.draining = None;
                return None;
            };
            let admitted = self.admit(&raw, origin);
            self.follow_up();
            match admitted {
                Ok(Some(frame)) => return Some(frame),
                Ok(None) => {}
                Err(reason) => self.reject(reason),
            }
        }
        None
    }

    /// Has a frame whose checksum is right judged, and notes what follows for the peer's whereabouts.
    fn admit(&mut self, raw: &RawFrame, origin: Origin) -> Result<Option<Frame<M>>, Rejection> {
        let at = gate::Arrival { origin, now: self.clock.now(), utc: self.clock.utc() };
        let frame = self.gate.admit(raw, at)?;
        self.note_peer(origin)?;
        self.backoff = BACKOFF_FIRST;
        self.counters.received += 1;
        self.counters.neutralised += u64::from(frame.as_ref().is_some_and(|frame| frame.neutralised));
        self.log(at.utc, raw);
        Ok(frame)
    }

    /// Sends and tells what the gate wants sent and told.
    fn follow_up(&mut self) {
        self.counters.unrecorded = self.gate.unrecorded();
        while let Some((origin, raw)) = self.gate.poll_reply() {
            let Way::Up(transport) = &mut self.way else { continue };
            if origin == Origin::Peer {
                self.counters.dropped_congested += u64::from(self.outbox.push(raw));
            } else if transport.send_to(origin, raw.bytes()) {
                self.counters.sent += 1;
                self.counters.sent_bytes += raw.bytes().len() as u64;
                self.log(self.clock.utc(), &raw);
            } else {
                self.counters.dropped_unconnected += 1;
            }
        }
        while let Some(notice) = self.gate.poll_notice() {
            tracing::warn!(link = self.name, "{notice}");
        }
    }

    /// Notes that the peer is alive, and is where `origin` says.
    fn note_peer(&mut self, origin: Origin) -> Result<(), Rejection> {
        let Way::Up(transport) = &mut self.way else { return Ok(()) };
        let before = transport.peer_address();
        let moved = transport.peer_heard(origin, self.clock.now());
        if moved {
            self.counters.connections += 1;
            let at = transport.peer_address().map(tracing::field::display);
            match before {
                Some(before) => {
                    self.counters.path_changes += 1;
                    tracing::warn!(link = self.name, %before, at, path_changes = self.counters.path_changes, "the peer was silent where it was, and is elsewhere now");
                }
                None => tracing::info!(
                    link = self.name,
                    at,
                    connections = self.counters.connections,
                    "peer found"
                ),
            }
            // What was meant for the place where it was is stale.
            self.counters.dropped_unconnected += self.outbox.clear() as u64;
            let decoder = self.decoders.remove(&origin).unwrap_or_default();
            self.decoders = BTreeMap::from([(Origin::Peer, decoder)]);
            self.draining = self.draining.map(|(_, ends)| (Origin::Peer, ends));
        }
        if moved || origin == Origin::Peer { Ok(()) } else { Err(Rejection::Stranger) }
    }

    fn reject(&mut self, reason: Rejection) {
        let before = self.counters.rejected.total();
        let first = self.counters.rejected.count(reason) == 1;
        if let Some(remedy) = reason.remedy().filter(|_| first) {
            tracing::warn!(link = self.name, reason = reason.as_str(), "a frame was turned away: {remedy}");
        }
        self.report_rejections_since(before);
    }

    /// Reports each time that the number of rejections has doubled: soon, and not too often.
    fn report_rejections_since(&self, before: u64) {
        let total = self.counters.rejected.total();
        if before.checked_ilog2() != total.checked_ilog2() {
            tracing::warn!(link = self.name, counters = %self.counters, "frames or bytes were turned away");
        }
    }

    fn log(&mut self, utc: crate::time::Utc, raw: &RawFrame) {
        if let Some(tlog) = &self.tlog {
            tlog.record(utc, raw.without_signature::<M>());
            self.counters.tlog_dropped = tlog.dropped();
        }
    }

    /// Writes what waits, as far as the way is free.
    fn flush(&mut self, cx: &mut Context<'_>) {
        while let (Way::Up(transport), Some(bytes)) = (&mut self.way, self.outbox.next_bytes()) {
            if !transport.has_peer() {
                self.counters.dropped_unconnected += self.outbox.clear() as u64;
                return;
            }
            match transport.poll_write(cx, bytes) {
                Poll::Pending => return,
                Poll::Ready(Ok(0)) => return self.go_down(&io::ErrorKind::WriteZero.into()),
                Poll::Ready(Ok(written)) => {
                    self.counters.sent_bytes += written as u64;
                    if let Some(frame) = self.outbox.advance(written) {
                        self.counters.sent += 1;
                        self.log(self.clock.utc(), &frame);
                    }
                }
                Poll::Ready(Err(error)) => {
                    self.outbox.drop_next();
                    self.take_error(&error);
                }
            }
        }
    }
}
