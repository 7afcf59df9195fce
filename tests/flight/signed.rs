//! A pair whose autopilot links are signed: the key is set up on both software vehicles, and the mission is flown as
//! ever. Over loopback UDP and by the wall's clock, for it is sockets that links sign on.

use std::path::Path;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, SETUP_SIGNING_DATA};
use tokio::net::UdpSocket;
use veilwing::companion::Companion;
use veilwing::companion::settings::{
    allow_for_clock_rate, pair_form, scheduling_allowance, settings, transmitter_settings,
};
use veilwing::config::Vehicle;
use veilwing::desk::simulation::{Late, judge, vehicle_draft, world_config};
use veilwing::link::codec::Encoder;
use veilwing::link::{Clock, Key, LinkConfig, SigningConfig};
use veilwing::mission::Outcome;
use veilwing::role::{PerVehicle, Role};
use veilwing::transmitter::Transmitter;
use veilwing_sitl::World;

use crate::harness::{index, yard};

const KEY: [u8; 32] = [0xC3; 32];
const RATE: f64 = 4.0;
const STEP: Duration = Duration::from_millis(2);
/// A step that takes longer upsets what the companions expect of each other.
const LATE: Duration = Duration::from_millis(20);

fn companion(role: Role, ports: [u16; 2], directory: &Path, clock: &Clock) -> Companion {
    let planned = yard();
    let vehicle = Vehicle::new(vehicle_draft(&planned.mission, role, ports)).unwrap();
    let mut told = settings(&planned.mission, &vehicle, 1, true);
    allow_for_clock_rate(&mut told, RATE);
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
        planner: Box::new(move || Ok(plan)),
    }
}

/// A socket, and the companion that was heard on it.
struct Port {
    socket: UdpSocket,
    companion: Option<std::net::SocketAddr>,
}

impl Port {
    async fn bind() -> Self {
        Self { socket: UdpSocket::bind("127.0.0.1:0").await.unwrap(), companion: None }
    }

    fn number(&self) -> u16 {
        self.socket.local_addr().unwrap().port()
    }

    fn receive(&mut self) -> Vec<Vec<u8>> {
        let mut all = Vec::new();
        let mut buffer = [0; 2048];
        while let Ok((length, from)) = self.socket.try_recv_from(&mut buffer) {
            self.companion = Some(from);
            all.push(buffer[..length].to_vec());
        }
        all
    }

    fn send(&self, bytes: &[u8]) {
        if let Some(companion) = self.companion {
            // A companion that has ended hears no more.
            let _ = self.socket.try_send_to(bytes, companion);
        }
    }
}

/// The world and the pair link, in step with the clock, for ever. Counts frames to companions: signed, and not.
async fn run_world(
    world: &mut World,
    autopilot: &mut [Port; 2],
    pair: &mut [Port; 2],
    (clock, sent, late): (&Clock, &mut [u32; 2], &mut Vec<Late>),
) {
    let mut step = tokio::time::interval(STEP);
    step.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    loop {
        step.tick().await;
        for k in 0..2 {
            autopilot[k].receive().iter().for_each(|bytes| world.handle(k, 0, bytes));
            pair[k].receive().iter().for_each(|bytes| pair[1 - k].send(bytes));
        }
        let to = clock.now().since_start();
        let by = to.saturating_sub(world.now()).saturating_sub(STEP.mul_f64(RATE));
        if by > LATE {
            late.push(Late { from: world.now(), by });
        }
        world.advance(to);
        while let Some((vehicle, link, frame)) = world.poll_transmit() {
            if link == 0 {
                sent[usize::from(frame[2] & 1 == 0)] += 1;
                autopilot[vehicle].send(&frame);
            }
        }
    }
}

#[test]
fn spec_a_pair_with_signed_autopilot_links_completes_its_mission() {
    let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join("signed-flight");
    // There is none at the first run; timestamps of an earlier one are not this one's.
    let _ = std::fs::remove_dir_all(&directory);
    std::fs::create_dir_all(&directory).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let clock = Clock::start(RATE).unwrap();
        let mut config = world_config(&yard().mission, &yard().plan).unwrap();
        config.utc_start_us = clock.utc().unix_us;
        let mut world = World::new(config).unwrap();
        world.allow_for_scheduling(scheduling_allowance(RATE));
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
        let mut autopilot = [Port::bind().await, Port::bind().await];
        let mut pair = [Port::bind().await, Port::bind().await];
        let flown = PerVehicle::from_fn(|role| {
            let ports = [&autopilot, &pair].map(|ports| ports[index(role)].number());
            companion(role, ports, &directory, &clock).run(clock.clone(), std::future::pending())
        });
        let (mut sent, mut late) = ([0; 2], Vec::new());
        let (i, j) = tokio::select! {
            ends = async { tokio::join!(flown.i, flown.j) } => ends,
            () = run_world(&mut world, &mut autopilot, &mut pair, (&clock, &mut sent, &mut late)) => unreachable!(),
        };
        let mut report = world.report();
        assert_eq!((i.unwrap(), j.unwrap()), (Outcome::Completed, Outcome::Completed), "{report:#?}");
        let _ = judge(&mut report, &late);
        assert_eq!(report.violations, vec![]);
        assert!(report.slots.iter().all(|slot| slot.radiated_s.i > 1.0), "{:#?}", report.slots);
        let [signed, unsigned] = sent;
        assert!(signed > 1000 && unsigned == 0, "{signed} signed frames, {unsigned} without");
        // What the companions sent before they had heard their vehicles' clocks is all that was turned away.
        for counters in world.counters() {
            let wire = counters.wire;
            assert!(wire.frames > 1000 && wire.unproven < 50, "{wire:?}");
        }
    });
}
