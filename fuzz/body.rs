//! What the fuzz target and the test suite's smoke run do with bytes from the pair link: both companions, in the middle
//! of a slot, take them, and whatever they say must not raise a power, lengthen a lease or call for a flood of answers.

use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};
use veilwing::geo::{Enu, Pose};
use veilwing::link::codec::{Decoder, Encoder};
use veilwing::link::{Counters, Envelope, Form, Rejection};
use veilwing::pair::wire;
use veilwing::pair::{self, PlanTerms, SlotTerms};
use veilwing::planner::plan::VehiclePlan;
use veilwing::role::{PerVehicle, Role};
use veilwing::service::{Ceilings, Freshness, Outgoing, Settings, SlotService, Tolerance, Vehicle};
use veilwing::time::{Instant, Utc};
use veilwing::transmitter::{self, Kind, Transmitter};

const LEASE: Duration = Duration::from_millis(500);
const NEEDS: Duration = Duration::from_secs(1);
const POWER_W: f64 = 0.5;
const TICK: Duration = Duration::from_millis(10);
/// The slot stays open longer than any input lasts.
const SLOT: Duration = Duration::from_secs(100_000);
const POSE: Pose =
    Pose { position_enu_m: Enu::new(1.0, 2.0, 80.0), roll_rad: 0.5, pitch_rad: 0.1, yaw_rad: 0.0 };

/// One companion as far as the pair link can reach: the service that flies.
struct Companion {
    role: Role,
    service: SlotService,
    said: Vec<wire::MavMessage>,
    decoder: Decoder<Envelope>,
    encoder: Encoder,
}

/// Two companions that radiate in a slot, and what their links have counted.
pub struct Target {
    companions: PerVehicle<Companion>,
    now: Instant,
    /// What was turned away and why.
    pub counters: Counters,
    /// Messages that were taken.
    pub taken: u64,
    /// A frame of every kind that each has sent, as it was on the wire.
    pub recorded: PerVehicle<Vec<Vec<u8>>>,
}

/// Three slots, all alike.
fn plan() -> PlanTerms {
    let vehicle = VehiclePlan { pose: POSE, tx_power_w: POWER_W };
    let terms = SlotTerms {
        vehicles: PerVehicle { i: vehicle, j: vehicle },
        opens: NEEDS,
        lead: NEEDS,
        radiate_from: Duration::ZERO,
        radiate_until: SLOT,
        length: SLOT,
    };
    PlanTerms { digest: [2; 32], slots: vec![terms; 3] }
}

impl Companion {
    fn new(role: Role) -> Self {
        let pair = pair::Settings {
            role,
            boot_id: 1 + role as u32,
            mission_digest: [1; 32],
            lease: LEASE,
            peer_timeout: Duration::from_secs(3),
            clock_tolerance: Duration::from_millis(250),
            orders: pair::Record::default(),
        };
        let radio = transmitter::Settings {
            own: (1, 191),
            target: (1, 68),
            kind: Kind::Leased { command: 31010 },
            boot: 1 + role as u32,
            longest_round_trip: LEASE,
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
        service.set_plan(plan());
        service.join(0, None, now);
        Self { role, service, said: Vec::new(), decoder: Decoder::default(), encoder: Encoder::default() }
    }

    /// What is due, and what the present state allows.
    fn run(&mut self, now: Instant) {
        self.service.handle_timeout(now);
        assert!(self.service.poll_timeout().0 > now, "{} is never satisfied", self.role);
        self.react(now);
    }

    fn react(&mut self, now: Instant) {
        self.service.advance(Some(utc(now)), now);
        let events = std::iter::from_fn(|| self.service.poll_event()).count();
        assert!(events <= 3, "{}: {events} events at once", self.role);
        let vehicle = Vehicle {
            state_received_at: Some(now),
            state_taken_from: Some(now),
            state_period: TICK,
            position_enu_m: Some(POSE.position_enu_m),
            attitude: Some((POSE.attitude(), now)),
            in_control: true,
            estimator_ok: true,
            arrived: true,
            preflight_ok: true,
            ..Vehicle::default()
        };
        self.service.decide(&vehicle, now);
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

fn utc(now: Instant) -> Utc {
    Utc { unix_us: 1_800_000_000_000_000 } + now.since_start()
}

impl Target {
    /// Both on the air in slot 0.
    ///
    /// # Panics
    /// If a pair on a perfect link does not come to radiate.
    #[must_use]
    pub fn new() -> Self {
        let mut target = Self {
            companions: PerVehicle::from_fn(Companion::new),
            now: Instant::ZERO,
            counters: Counters::default(),
            taken: 0,
            recorded: PerVehicle::default(),
        };
        while !Role::BOTH.iter().all(|&role| target.companions[role].service.interlock().is_on()) {
            assert!(target.now.since_start() < Duration::from_secs(10), "the pair does not come to radiate");
            target.pass(true);
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

    /// Takes a string of datagrams: to whom (the lowest bit of a byte; the next four: ticks that pass before), the
    /// length, the bytes.
    pub fn take(&mut self, mut input: &[u8]) {
        while let [head, length, rest @ ..] = input {
            for _ in 0..(head >> 1) & 0xF {
                self.pass(false);
            }
            let (datagram, rest) = rest.split_at(rest.len().min(usize::from(*length)));
            self.datagram(if head & 1 == 0 { Role::I } else { Role::J }, datagram);
            input = rest;
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
                    let answers = companion.say().len();
                    assert!(answers <= 4, "{answers} answers to {message:?}");
                }
                Err(reason) => {
                    self.counters.rejected.count(reason);
                }
            }
        }
    }
}
