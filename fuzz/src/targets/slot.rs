//! The service of a slot on both vehicles: in the middle of a slot they take what comes over the pair link, and whatever
//! is said must not raise a power, lengthen a lease or call for a flood of answers; nor may a vehicle that is not fit
//! radiate. Once in a slot that is held, once through slots that carry each other on, once in one whose motion is made anew.

mod terms;

use std::sync::OnceLock;
use std::time::Duration;

use arbitrary::Unstructured;
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};
use mavlink::{MavHeader, Message};
use veilwing::geo::Enu;
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::envelope::PAYLOAD_TYPE;
use veilwing::link::{Counters, Envelope, Form, Rejection};
use veilwing::pair::wire;
use veilwing::pair::{self, AskedSlot, Places, PlanTerms, SlotTerms};
use veilwing::role::{PerVehicle, Role};
use veilwing::service::{
    Ceilings, Event, Freshness, Outgoing, Settings, Slot, SlotService, Tolerance, Vehicle,
};
use veilwing::time::{Instant, Utc};
use veilwing::transmitter::{self, Kind, Transmitter};

use crate::reached::Reached;
use crate::target::Target;
use crate::wire::{bytes as wire_bytes, frame_v2, tunnel};
use terms::{POSE, POWER_W};

const LEASE: Duration = Duration::from_millis(500);
const TICK: Duration = Duration::from_millis(10);
/// A motion begins so long after it is asked for.
const BEGINS: Duration = Duration::from_millis(100);

/// One companion as far as the pair link can reach: the service that flies.
#[derive(Clone)]
struct Companion {
    role: Role,
    service: SlotService,
    vehicle: Fitness,
    /// Motions are asked for.
    follows: bool,
    reached: Reached,
    said: Vec<wire::MavMessage>,
    decoder: Decoder<Envelope>,
    encoder: Encoder,
}

/// Two companions that radiate in a slot, and what their links have counted.
#[derive(Clone)]
pub struct Pair {
    companions: PerVehicle<Companion>,
    now: Instant,
    /// What was turned away and why.
    pub counters: Counters,
    /// Messages that were taken.
    pub taken: u64,
    /// A frame of every kind that each has sent, as it was on the wire.
    pub recorded: PerVehicle<Vec<Vec<u8>>>,
}

/// What there is to say against a vehicle; nothing at first.
#[derive(Debug, Clone, Copy, Default)]
struct Fitness(u8);

impl Fitness {
    const STALE: u8 = 1;
    const LOST_CONTROL: u8 = 2;
    const BAD_ESTIMATE: u8 = 4;
    const ASTRAY: u8 = 8;
    const UNPREPARED: u8 = 16;

    fn has(self, what: u8) -> bool {
        self.0 & what != 0
    }

    /// Whether it must be silent for it.
    fn is_unfit(self) -> bool {
        self.has(Self::STALE | Self::LOST_CONTROL | Self::BAD_ESTIMATE | Self::ASTRAY)
    }

    /// What is known of a vehicle that keeps to its slot's pose, or turns as its slot asks for.
    fn evidence(self, slot: Option<&Slot>, now: Instant) -> Vehicle {
        let turned = |slot: &Slot| {
            let since_s = now.seconds_since(slot.commitment.opens_at);
            slot.track.as_ref().map(|track| track.attitude(since_s))
        };
        let sampled = if self.has(Self::STALE) { Instant::ZERO } else { now };
        let aside_m = if self.has(Self::ASTRAY) { 2.0 } else { 0.0 };
        Vehicle {
            state_received_at: Some(sampled),
            state_taken_from: Some(sampled),
            state_period: TICK,
            position: Some((POSE.position_enu_m + Enu::new(aside_m, 0.0, 0.0), sampled)),
            attitude: Some((slot.and_then(turned).unwrap_or_else(|| POSE.attitude()), sampled)),
            in_control: !self.has(Self::LOST_CONTROL),
            estimator_ok: !self.has(Self::BAD_ESTIMATE),
            arrived: true,
            at_rest: true,
            preflight_ok: !self.has(Self::UNPREPARED),
            ..Vehicle::default()
        }
    }
}

impl Companion {
    fn new(role: Role, plan: PlanTerms) -> Self {
        let pair = pair::Settings {
            role,
            boot_id: 1 + role as u32,
            mission_digest: [1; 32],
            lease: LEASE,
            peer_timeout: Duration::from_secs(3),
            lost_after: Duration::from_secs(3),
            clock_tolerance: Duration::from_millis(250),
            orders: pair::Record::default(),
        };
        let radio = transmitter::Settings {
            own: (1, 191),
            target: (1, 68),
            kind: Kind::Leased { command: 31010 },
            boot: 1 + role as u32,
            longest_round_trip: LEASE,
            apart: false,
            system_is_given: false,
            first_off_after: Duration::ZERO,
        };
        let settings = Settings {
            pair,
            ceilings: Ceilings { mission_w: 1.0, vehicle_w: 1.0 },
            emission_authorised: true,
            freshness: Freshness { limit: LEASE, scheduling_allowance: Duration::ZERO },
        };
        let now = Instant::ZERO;
        let mut service =
            SlotService::new(settings, Transmitter::new(radio, now), Tolerance::for_jitter(0.0), now);
        service.set_plan(plan);
        service.join(0, None, now);
        Self {
            role,
            service,
            vehicle: Fitness::default(),
            follows: false,
            reached: Reached::default(),
            said: Vec::new(),
            decoder: Decoder::default(),
            encoder: Encoder::default(),
        }
    }

    /// What is due, and what the present state allows.
    fn run(&mut self, now: Instant) {
        self.service.handle_timeout(now);
        assert!(self.service.poll_timeout().0 > now, "{} is never satisfied", self.role);
        self.react(now);
    }

    fn react(&mut self, now: Instant) {
        self.service.advance(Some(utc(now)), now);
        let mut events = Vec::new();
        while let Some(event) = self.service.poll_event() {
            events.push(event);
            self.reached.sentence("event", &format!("{} {event:?}", self.role));
            // Motions are numbers here: nobody moves.
            if event == Event::PlanMotion
                && let Some(asked) = self.service.asked_motion().copied()
            {
                let found = (asked.number % 5 != 4).then_some(u64::from(asked.number));
                self.service.motion_planned(asked.number, found, now);
            }
            // So are poses: now and then the two find different ones.
            if let Event::PlanSlot(slot, asked) = event {
                let places = Places::new(0);
                let asked = asked.unwrap_or(AskedSlot { proposal: 0, slot, places });
                let anew = Some([u8::from(asked.proposal % 5 == 4); 8]);
                let terms = terms::followed().slots.pop().map(|terms| SlotTerms { anew, ..terms });
                self.service.slot_planned(&asked, terms.map(|terms| vec![terms]), now);
            }
        }
        assert!(events.len() <= 5, "{} at once: {events:?}", self.role);
        if self.follows && self.service.may_ask_motion(now) {
            let opens_at = self.service.slot().map_or(now, |slot| slot.commitment.opens_at);
            let begins = (now + BEGINS).saturating_since(opens_at);
            self.service.ask_motion(Places::new(begins.as_millis() as u32), now);
        }
        let evidence = self.vehicle.evidence(self.service.slot(), now);
        self.service.decide(&evidence, now);
        let unfit = self.vehicle.is_unfit();
        assert!(!(unfit && self.service.interlock().is_on()), "{}: on with {:?}", self.role, self.vehicle);
        self.check(now);
    }

    /// No lease longer than it may be; every power within the plan's, with an expiry.
    fn check(&mut self, now: Instant) {
        let lease = self.service.jam_lease(now);
        assert!(lease.is_none_or(|end| end <= now + LEASE), "{}: a lease to {lease:?} at {now:?}", self.role);
        let mut commands = 0;
        while let Some(outgoing) = self.service.poll_transmit() {
            let command = match outgoing {
                Outgoing::Pair(message) => {
                    self.reached.note(format_args!("{} says {}", self.role, message.message_name()));
                    self.said.push(*message);
                    continue;
                }
                Outgoing::Radio(message) => message,
            };
            let MavMessage::COMMAND_INT(command) = *command else { continue };
            commands += 1;
            let on = command.y > 0 && command.param1.is_finite();
            if on {
                let power_w = 1e-3 * 10f64.powf(f64::from(command.param1) / 10.0);
                assert!(power_w <= POWER_W, "{}: {power_w} W", self.role);
                let until = now + Duration::from_millis(command.y.unsigned_abs().into());
                let allowed = if self.role == Role::I { lease } else { Some(now + LEASE) };
                assert!(allowed.is_some_and(|end| until <= end), "{}: on to {until:?}, {lease:?}", self.role);
            }
            // A radio that obeys at once.
            let dbm_e3 = if on { (command.param1 * 1e3).round() as i32 } else { i32::MIN };
            let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                command: MavCmd::MAV_CMD_USER_1,
                result: MavResult::MAV_RESULT_ACCEPTED,
                result_param2: dbm_e3,
                ..COMMAND_ACK_DATA::DEFAULT
            });
            let radio = MavHeader { system_id: 1, component_id: 68, sequence: 0 };
            self.service.handle_radio(radio, &ack, now);
        }
        assert!(commands <= 8, "{}: {commands} commands at once", self.role);
    }

    fn say(&mut self) -> Vec<wire::MavMessage> {
        std::mem::take(&mut self.said)
    }
}

/// The service of a slot that is held.
pub const HELD: Target = Target {
    name: "slot",
    what: "the pair link's frames, a vehicle's state and time to both vehicles' service of a slot",
    words: &[],
    seeds,
    run: run_held,
    generated: 1500,
};

/// The service of slots that carry each other on.
pub const CARRIED_ON: Target = Target {
    name: "slot-carried-on",
    what: "the same to slots that are served through turns and carry each other on",
    words: &[],
    seeds,
    run: run_carried_on,
    generated: 500,
};

/// The service of a slot whose motion is made anew.
pub const FOLLOWED: Target = Target {
    name: "slot-followed",
    what: "the same to a slot whose motion is made anew",
    words: &[],
    seeds,
    run: run_followed,
    generated: 500,
};

fn seeds() -> Vec<Vec<u8>> {
    // Both on a good link for a while; each kind of frame of either, as it was; either unfit and fit again.
    let linked = vec![0x3E; 80];
    let repeated = (0..8).flat_map(|which| [0x60, which, 255, 0, 0x61, which, 255, 0]).collect();
    let unfit = [1, 2, 4, 8, 16].iter().flat_map(|what| [0x43, *what, 0x3E, 0x5F, 0, 0x3E]).collect();
    vec![linked, repeated, unfit]
}

fn run_held(input: &[u8], reached: &mut Reached) {
    static FRESH: OnceLock<Pair> = OnceLock::new();
    run(FRESH.get_or_init(Pair::new), input, reached);
}

fn run_carried_on(input: &[u8], reached: &mut Reached) {
    static FRESH: OnceLock<Pair> = OnceLock::new();
    run(FRESH.get_or_init(|| Pair::radiating(terms::through_turns)), input, reached);
}

fn run_followed(input: &[u8], reached: &mut Reached) {
    static FRESH: OnceLock<Pair> = OnceLock::new();
    run(FRESH.get_or_init(|| Pair::radiating(terms::followed)), input, reached);
}

fn run(fresh: &Pair, input: &[u8], reached: &mut Reached) {
    let mut pair = fresh.clone();
    // An input that ends within an event has none there.
    let _ = pair.take(&mut Unstructured::new(input));
    pair.note(reached);
}

fn utc(now: Instant) -> Utc {
    Utc { unix_us: 1_800_000_000_000_000 } + now.since_start()
}

impl Pair {
    /// Both on the air in slot 0, which they hold.
    ///
    /// # Panics
    /// If a pair on a perfect link does not come to radiate.
    #[must_use]
    #[allow(clippy::new_without_default, reason = "it flies to where it begins, and may fail on the way")]
    pub fn new() -> Self {
        Self::radiating(terms::held)
    }

    fn radiating(plan: fn() -> PlanTerms) -> Self {
        let mut target = Self {
            companions: PerVehicle::from_fn(|role| Companion::new(role, plan())),
            now: Instant::ZERO,
            counters: Counters::default(),
            taken: 0,
            recorded: PerVehicle::default(),
        };
        while !Role::BOTH.iter().all(|&role| target.companions[role].service.interlock().is_on()) {
            assert!(target.now.since_start() < Duration::from_secs(10), "the pair does not come to radiate");
            target.pass(true);
        }
        if plan().slots[0].follows() {
            target.companions.i.follows = true;
            (0..50).for_each(|_| target.pass(true));
        }
        for role in Role::BOTH {
            let frames = &mut target.recorded[role];
            // The newest of each.
            frames.reverse();
            frames.sort_by_key(|frame| frame.get(7..10).map(<[u8]>::to_vec));
            frames.dedup_by_key(|frame| frame.get(7..10).map(<[u8]>::to_vec));
        }
        target
    }

    /// A tick of both; on a perfect link, or with each deaf to the other.
    fn pass(&mut self, linked: bool) {
        self.now = self.now + TICK;
        for role in Role::BOTH {
            self.companions[role].run(self.now);
        }
        for role in [Role::I, Role::J, Role::I, Role::J] {
            for message in self.companions[role].say() {
                if linked {
                    let envelope = Envelope::Plain(message.clone());
                    let frame = self.companions[role].encoder.encode((1 + role as u8, 191), &envelope);
                    self.recorded[role].push(frame.raw_bytes().to_vec());
                    let peer = &mut self.companions[role.peer()];
                    peer.service.handle_pair(&message, self.now);
                    peer.react(self.now);
                }
            }
        }
    }

    /// Takes a string of events: of whom (the lowest bit of a byte), after how many ticks (the next four) and of which
    /// kind (the rest), then what its kind needs.
    ///
    /// # Errors
    /// When the input ends within one.
    pub fn take(&mut self, u: &mut Unstructured<'_>) -> arbitrary::Result<()> {
        while !u.is_empty() {
            let head: u8 = u.arbitrary()?;
            let role = if head & 1 == 0 { Role::I } else { Role::J };
            let (ticks, kind) = ((head >> 1) & 0xF, head >> 5);
            (0..ticks).for_each(|_| self.pass(kind == 1));
            let from = (1 + role.peer() as u8, 191);
            match kind {
                0 | 1 => {}
                2 => {
                    self.companions[role].vehicle = Fitness(u.arbitrary()?);
                    let now = self.now;
                    self.companions[role].react(now);
                }
                3 => {
                    // A frame that the peer has sent, some of its payload other than it was.
                    let (which, at, to): (u8, u8, u8) = u.arbitrary()?;
                    let recorded = &self.recorded[role.peer()];
                    let Some(frame) = recorded.get(usize::from(which) % recorded.len().max(1)) else {
                        continue;
                    };
                    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
                    let mut payload = frame[10..frame.len() - 2].to_vec();
                    if let Some(byte) = payload.get_mut(usize::from(at)) {
                        *byte = to;
                    }
                    self.datagram(role, &frame_v2::<Envelope>(from, 0, id, &payload));
                }
                4 | 5 => {
                    let id = 42_100 + u32::from(u.arbitrary::<u8>()? % 12);
                    let payload = wire_bytes(u)?;
                    let plain = frame_v2::<Envelope>(from, 0, id, payload);
                    let tunnelled = frame_v2::<Envelope>(from, 0, 385, &tunnel(PAYLOAD_TYPE, &plain));
                    self.datagram(role, if kind == 4 { &plain } else { &tunnelled });
                }
                _ => {
                    let datagram = wire_bytes(u)?;
                    self.datagram(role, datagram);
                }
            }
        }
        Ok(())
    }

    /// What the inputs have come to.
    fn note(&self, reached: &mut Reached) {
        for reason in Rejection::ALL {
            reached.count(&format!("{reason:?}"), self.counters.rejected.get(*reason));
        }
        for role in Role::BOTH {
            let service = &self.companions[role].service;
            let slot = service.slot().map(|_| ());
            let (on, killed) = (service.interlock().is_on(), service.orders().is_killed());
            let state =
                (slot, on, killed, service.orders().is_paused(), service.agrees(), service.is_abandoning());
            reached.note(format_args!("{role} {state:?} {}", service.slot_number()));
            reached.note(format_args!("{role} lease {}", service.jam_lease(self.now).is_some()));
            reached.join(&self.companions[role].reached);
        }
    }

    /// One datagram from the pair link's peer to the companion of `to`.
    pub fn datagram(&mut self, to: Role, datagram: &[u8]) {
        let companion = &mut self.companions[to];
        companion.decoder.feed(datagram);
        companion.decoder.end();
        while let Some(raw) = companion.decoder.next_frame(&mut self.counters) {
            let peer = 1 + to.peer() as u32;
            let taken = if raw.header().system_id == peer {
                // Either form is taken here, so that what is inside a TUNNEL is fuzzed as well.
                raw.parse::<Envelope>().and_then(|frame| {
                    let form = if frame.message.is_tunnelled() {
                        Form::Tunnel { to_system: 0 }
                    } else {
                        Form::Plain
                    };
                    form.open(frame.message)
                })
            } else {
                Err(Rejection::ForeignSystem)
            };
            match taken {
                Ok(message) => {
                    self.taken += 1;
                    companion.service.handle_pair(&message, self.now);
                    companion.react(self.now);
                    let answers = companion.say();
                    // A silence is said three times; beside it a status, an answer, and a word on the motion.
                    assert!(answers.len() <= 6, "{answers:?} to {message:?}");
                }
                Err(reason) => {
                    self.counters.rejected.count(reason);
                }
            }
        }
    }
}
