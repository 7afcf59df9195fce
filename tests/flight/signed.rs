//! A pair whose autopilot links are signed: the key is set up on both software vehicles, and the mission is flown as
//! ever. Over loopback UDP, for it is sockets that links sign on; the world gives out the time. And what the service manager of
//! such a pair is told.

use std::net::UdpSocket;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, SETUP_SIGNING_DATA};
use veilwing::companion::Companion;
use veilwing::companion::settings::{pair_form, settings, transmitter_settings};
use veilwing::config::Vehicle;
use veilwing::desk::simulation::{vehicle_draft, world_config};
use veilwing::link::codec::Encoder;
use veilwing::link::{Clock, Key, LinkConfig, SigningConfig};
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing::systemd::Manager;
use veilwing::time::{Instant, Utc};
use veilwing::transmitter::Transmitter;
use veilwing_sitl::vehicle::TICK;
use veilwing_sitl::{FlightReport, World};

use crate::harness::{index, yard};

const KEY: [u8; 32] = [0xC3; 32];

/// What the watchdog of the flights' service manager allows.
const WATCHDOG: Duration = Duration::from_secs(2);

fn companion(role: Role, ports: [u16; 2], directory: &Path, clock: &Clock, manager: Manager) -> Companion {
    let planned = yard();
    let vehicle = Vehicle::new(vehicle_draft(&planned.mission, role, ports)).unwrap();
    let told = settings(&planned.mission, &vehicle, 1, true);
    let signing = SigningConfig {
        key: Key::new(KEY),
        link_id: 0,
        state_file: directory.join(format!("{role}.signing")),
        unsigned_allowed: Vec::new(),
    };
    let link = |name: &str, peer_system, signing| LinkConfig {
        name: name.into(),
        peer_system,
        accept_foreign: false,
        signing,
        tlog: None,
    };
    let plan = planned.plan.clone();
    Companion {
        autopilot: (
            vehicle.autopilot.link.clone(),
            link("autopilot", vehicle.autopilot.system_id, Some(signing)),
        ),
        radio: None,
        pair: (vehicle.pair_link.clone(), link("pair", vehicle.pair_peer_system, None), pair_form(&vehicle)),
        transmitter: Transmitter::new(transmitter_settings(&vehicle, 1), clock.now()),
        settings: told,
        orders: None,
        computer: None,
        manager,
        flown: None,
        edited: tokio::sync::mpsc::unbounded_channel().1,
        planner: Box::new(move || Ok(plan)),
    }
}

/// A socket, and the companion that was heard on it.
struct Port {
    socket: UdpSocket,
    companion: Option<std::net::SocketAddr>,
}

impl Port {
    fn bind() -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_nonblocking(true).unwrap();
        Self { socket, companion: None }
    }

    fn number(&self) -> u16 {
        self.socket.local_addr().unwrap().port()
    }

    fn receive(&mut self) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        let mut buffer = [0; 2048];
        while let Ok((length, from)) = self.socket.recv_from(&mut buffer) {
            self.companion = Some(from);
            all.push(buffer[..length].to_vec());
        }
        all
    }

    fn send(&self, bytes: &[u8]) {
        if let Some(companion) = self.companion {
            // A companion that has ended hears no more.
            let _ = self.socket.send_to(bytes, companion);
        }
    }
}

/// The world goes one step on, and hears what the companions have sent in it. Counts frames to companions: signed, and not.
fn advance(world: &mut World, autopilot: &mut [Port; 2], pair: &mut [Port; 2], sent: &mut [u32; 2]) {
    world.advance(world.now() + TICK);
    for k in 0..2 {
        autopilot[k].receive().iter().for_each(|bytes| world.handle(k, 0, bytes));
        pair[k].receive().iter().for_each(|bytes| pair[1 - k].send(bytes));
    }
    while let Some((vehicle, link, frame)) = world.poll_transmit() {
        if link == 0 {
            sent[usize::from(frame[2] & 1 == 0)] += 1;
            autopilot[vehicle].send(&frame);
        }
    }
}

/// A flight's ends, what the world says of it, frames by [signed, not], and what each companion's manager was told, when.
struct Flown {
    outcomes: [Outcome; 2],
    report: FlightReport,
    sent: [u32; 2],
    told: [Vec<(Duration, String)>; 2],
}

fn hear(socket: &UnixDatagram, now: Duration, told: &mut Vec<(Duration, String)>) {
    let mut datagram = [0; 512];
    while let Ok(length) = socket.recv(&mut datagram) {
        let text = std::str::from_utf8(&datagram[..length]).unwrap();
        told.extend(text.lines().map(|line| (now, line.to_owned())));
    }
}

fn fly(name: &str) -> Flown {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // There is none at the first run; timestamps of an earlier one are not this one's.
    let _ = std::fs::remove_dir_all(&directory);
    std::fs::create_dir_all(&directory).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let config = world_config(&yard().mission, &yard().plan).unwrap();
        let (clock, hand) = Clock::by_hand(Instant::ZERO, Utc { unix_us: config.utc_start_us });
        let mut world = World::new(config).unwrap();
        for role in Role::BOTH {
            let setup = SETUP_SIGNING_DATA {
                secret_key: KEY,
                target_system: 1 + index(role) as u8,
                target_component: 1,
                ..SETUP_SIGNING_DATA::DEFAULT
            };
            let frame = Encoder::default().encode((255, 190), &MavMessage::SETUP_SIGNING(setup));
            world.handle(index(role), 1, frame.raw_bytes());
        }
        let mut autopilot = [Port::bind(), Port::bind()];
        let mut pair = [Port::bind(), Port::bind()];
        let managers = [(); 2].map(|()| UnixDatagram::pair().unwrap());
        managers.iter().for_each(|(_, theirs)| theirs.set_nonblocking(true).unwrap());
        let flown = PerVehicle::from_fn(|role| {
            let ports = [&autopilot, &pair].map(|ports| ports[index(role)].number());
            let socket = managers[index(role)].0.try_clone().unwrap();
            let manager = Manager::at(socket, Some(WATCHDOG)).unwrap();
            companion(role, ports, &directory, &clock, manager).run(clock.clone(), std::future::pending())
        });
        let mut flown = std::pin::pin!(async { tokio::join!(flown.i, flown.j) });
        let (mut sent, mut told) = ([0; 2], [Vec::new(), Vec::new()]);
        let (i, j) = loop {
            let [from, to] = [world.now(), world.now() + TICK].map(Instant::from_start);
            let ends = hand.go(from, to, flown.as_mut()).await;
            for (told, (_, theirs)) in told.iter_mut().zip(&managers) {
                hear(theirs, to.since_start(), told);
            }
            match ends {
                Some(ends) => break ends,
                None => advance(&mut world, &mut autopilot, &mut pair, &mut sent),
            }
        };
        // What the companions sent before they had heard their vehicles' clocks is all that was turned away.
        for counters in world.counters() {
            let wire = counters.wire;
            assert!(wire.frames > 1000 && wire.unproven < 50, "{wire:?}");
        }
        Flown { outcomes: [i.unwrap(), j.unwrap()], report: world.report(), sent, told }
    })
}

#[test]
fn spec_a_pair_with_signed_autopilot_links_completes_its_mission() {
    let Flown { outcomes, report, sent, .. } = fly("signed-flight");
    assert_eq!(outcomes, [Outcome::Completed, Outcome::Completed], "{report:#?}");
    assert_eq!(report.violations, vec![]);
    assert!(report.slots.iter().all(|slot| slot.radiated_s.i > 1.0), "{:#?}", report.slots);
    let [signed, unsigned] = sent;
    assert!(signed > 1000 && unsigned == 0, "{signed} signed frames, {unsigned} without");
}

#[test]
fn spec_the_service_manager_is_told_of_start_phases_and_end_and_its_watchdog_is_fed_by_the_loop() {
    let Flown { outcomes, told, .. } = fly("managed-flight");
    assert_eq!(outcomes, [Outcome::Completed, Outcome::Completed]);
    for (told, role) in told.into_iter().zip(Role::BOTH) {
        let (fed, said): (Vec<_>, Vec<_>) = told.into_iter().partition(|(_, line)| line == "WATCHDOG=1");
        let said: Vec<&str> = said.iter().map(|(_, line)| line.as_str()).collect();
        assert_eq!(said.iter().filter(|line| **line == "READY=1").count(), 1, "{said:#?}");
        let phases: Vec<&str> = said
            .iter()
            .filter_map(|line| line.strip_prefix(&format!("STATUS=vehicle {role}: "))?.split(';').next())
            .collect();
        let expected =
            ["connecting", "standby", "arming", "climbing", "ready", "slot", "returning", "landing", "ended"];
        let mut rest = phases.iter();
        for phase in expected {
            assert!(rest.any(|told| *told == phase), "{phase} is not in {phases:?}");
        }
        assert_eq!(said.last(), Some(&format!("STATUS=vehicle {role}: ended; landed and disarmed").as_str()));
        assert_eq!(said.iter().filter(|line| **line == "STOPPING=1").count(), 1, "{said:#?}");
        assert!(said[said.len() - 2..].contains(&"STOPPING=1"), "{said:#?}");
        // From the first turn to the last, at a quarter of its time and a turn.
        assert!(fed[0].0 <= TICK, "{:?}", fed[0]);
        let apart: Vec<Duration> = fed.windows(2).map(|pair| pair[1].0 - pair[0].0).collect();
        let (least, most) = (WATCHDOG / 4 - TICK, WATCHDOG / 4 + Duration::from_millis(50));
        assert!(apart.len() > 50 && apart.iter().all(|gap| (least..=most).contains(gap)), "{apart:?}");
    }
}
