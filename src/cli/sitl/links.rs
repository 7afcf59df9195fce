//! The links of a simulated flight over loopback UDP: each companion to its vehicle, to its peer, and to its radio where
//! that has a link of its own; and a ground station to both vehicles.

use std::time::Duration;

use veilwing_sitl::vehicle::RADIO_LINK;
use veilwing_sitl::{Passage, World};

use crate::desk::simulation::{Asked, Path, Proposals, index};
use crate::link::HostPort;
use crate::role::{PerVehicle, Role};

use super::ground::{GROUND_LINK, GroundStation};
use super::port::{DIRECT, Port};

/// The sockets of this process.
pub(super) struct Links {
    autopilot: PerVehicle<Port>,
    pair: PerVehicle<Port>,
    /// Radios that have links of their own.
    radio: PerVehicle<Option<Port>>,
    /// Where the radio hosts are, which take what comes over these; without one it is for the simulated radio.
    hosts: PerVehicle<Option<Port>>,
    /// What the hosts were asked for.
    asked: PerVehicle<Asked>,
    /// What vehicle I's companion proposes to the other.
    proposals: Proposals,
    ground: Vec<GroundStation>,
}

/// Who is at the other end of the companions' links to their radios.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RadioEnd {
    /// There are no such links: the simulated radio is behind the autopilot.
    BehindAutopilot,
    /// The simulated radio.
    OnItsOwn,
    /// A radio host.
    Hosted,
}

/// What has passed over the companions' links.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Traffic {
    /// Datagrams that companions sent to their vehicle or to each other.
    pub sent: u64,
    /// Frames that companions were sent by their vehicles.
    pub received: u64,
    /// Datagrams that a fault swallowed.
    pub swallowed: u64,
}

impl Links {
    /// Opens the sockets; degraded links draw from `seed`. With ground stations, both vehicles speak to them at once.
    pub async fn open(
        seed: u64,
        radios: RadioEnd,
        stations: &[&HostPort],
        world: &mut World,
    ) -> Result<Self, String> {
        let mut ground = Vec::new();
        for address in stations {
            ground.push(GroundStation::connect(address).await?);
        }
        if !ground.is_empty() {
            Role::BOTH.into_iter().for_each(|role| world.open_link(index(role), GROUND_LINK));
        }
        Ok(Self {
            autopilot: PerVehicle { i: Port::bind(seed, 0)?, j: Port::bind(seed, 1)? },
            pair: PerVehicle { i: Port::bind(seed, 2)?, j: Port::bind(seed, 3)? },
            radio: match radios {
                RadioEnd::BehindAutopilot => PerVehicle::default(),
                RadioEnd::OnItsOwn | RadioEnd::Hosted => {
                    PerVehicle { i: Some(Port::bind(seed, 4)?), j: Some(Port::bind(seed, 5)?) }
                }
            },
            hosts: match radios {
                RadioEnd::BehindAutopilot | RadioEnd::OnItsOwn => PerVehicle::default(),
                RadioEnd::Hosted => {
                    PerVehicle { i: Some(Port::bind(seed, 6)?), j: Some(Port::bind(seed, 7)?) }
                }
            },
            asked: PerVehicle::default(),
            proposals: Proposals::default(),
            ground,
        })
    }

    /// Where a companion reaches its vehicle and its peer: UDP ports.
    pub fn numbers(&self, role: Role) -> Result<[u16; 2], String> {
        Ok([self.autopilot[role].number()?, self.pair[role].number()?])
    }

    /// Where a companion reaches its radio, if that has a link of its own.
    pub fn radio_number(&self, role: Role) -> Result<Option<u16>, String> {
        self.radio[role].as_ref().map(Port::number).transpose()
    }

    /// Where a radio host reaches its companion, if there is one.
    pub fn host_number(&self, role: Role) -> Result<Option<u16>, String> {
        self.hosts[role].as_ref().map(Port::number).transpose()
    }

    /// The slot for which a radio host was asked to radiate last.
    pub fn asked_slot(&self, role: Role) -> Option<u16> {
        self.asked[role].slot()
    }

    /// Cuts both directions between a companion and its radio host, or mends them.
    pub fn cut_host(&mut self, role: Role, cut: bool) {
        let path = if cut { Path { delay: Duration::ZERO, ..Path::CUT } } else { DIRECT };
        for port in [&mut self.radio[role], &mut self.hosts[role]].into_iter().flatten() {
            port.set_path_from(path);
        }
    }

    /// Takes in what has arrived: for the vehicles at once, from companion to companion by the path between them.
    pub fn listen(&mut self, world: &mut World) {
        let now = world.now();
        for role in Role::BOTH {
            self.autopilot[role].listen(now);
            while let Some(bytes) = self.autopilot[role].receive(now) {
                world.handle(index(role), 0, &bytes);
            }
            if let Some(radio) = &mut self.radio[role] {
                radio.listen(now);
                while let Some(bytes) = radio.receive(now) {
                    match &mut self.hosts[role] {
                        None => world.handle(index(role), RADIO_LINK, &bytes),
                        Some(host) => {
                            self.asked[role].hear(&bytes);
                            host.send(&bytes, now);
                        }
                    }
                }
                if let Some(host) = &mut self.hosts[role] {
                    host.listen(now);
                    while let Some(bytes) = host.receive(now) {
                        radio.send(&bytes, now);
                    }
                }
            }
            self.pair[role].listen(now);
            while let Some(bytes) = self.pair[role].receive(now) {
                if role == Role::I {
                    self.proposals.hear(&bytes, world);
                }
                self.pair[role.peer()].send(&bytes, now);
            }
        }
        let mut buffer = [0; 2048];
        for ground in &self.ground {
            while let Some(bytes) = ground.receive(&mut buffer) {
                Role::BOTH.into_iter().for_each(|role| world.handle(index(role), GROUND_LINK, bytes));
            }
        }
    }

    /// Hands out what the vehicles have to say, and what is through.
    pub fn deliver(&mut self, world: &mut World) {
        while let Some((vehicle, link, frame)) = world.poll_transmit() {
            let role = Role::BOTH[vehicle];
            if link == RADIO_LINK && self.hosts[role].is_some() {
                // Of the simulated radio, which is not aboard.
                continue;
            }
            match &mut self.radio[role] {
                Some(radio) if link == RADIO_LINK => radio.send(&frame, world.now()),
                _ if link != GROUND_LINK => self.autopilot[role].send(&frame, world.now()),
                // Without a station: what a fault file's operator is answered.
                _ => self.ground.iter().for_each(|ground| ground.send(&frame)),
            }
        }
        for role in Role::BOTH {
            self.autopilot[role].deliver(world.now());
            if let Some(radio) = &mut self.radio[role] {
                radio.deliver(world.now());
            }
            if let Some(host) = &mut self.hosts[role] {
                host.deliver(world.now());
            }
            self.pair[role].deliver(world.now());
        }
    }

    /// Changes what happens to what the companion `from` sends to its peer; `None`: nothing does.
    pub fn set_pair_path(&mut self, from: Role, path: Option<Path>) {
        self.pair[from].set_path_from(path.unwrap_or(DIRECT));
    }

    /// Changes what happens to both directions of a companion's autopilot link; `None`: nothing does.
    pub fn set_autopilot_path(&mut self, role: Role, path: Option<Path>) {
        self.autopilot[role].set_path_from(path.unwrap_or(DIRECT));
        self.autopilot[role].set_path_to(path.unwrap_or(DIRECT));
    }

    /// How datagrams fare between a companion and its vehicle.
    pub fn vehicle_passage(&self, role: Role) -> Passage {
        self.autopilot[role].passage()
    }

    /// How datagrams fare from a companion to its peer.
    pub fn pair_passage(&self, from: Role) -> Passage {
        self.pair[from].passage()
    }

    /// For how long what a companion and its vehicle send each other is held up here, and what its peer sends it.
    pub fn longest_ways(&self, role: Role) -> [Duration; 2] {
        [self.autopilot[role].longest_way(), self.pair[role.peer()].longest_way()]
    }

    pub fn traffic(&self) -> Traffic {
        let ports = || {
            let both = |role| [&self.autopilot[role], &self.pair[role]].into_iter().chain(&self.radio[role]);
            Role::BOTH.into_iter().flat_map(both)
        };
        Traffic {
            sent: ports().map(|port| port.sent).sum(),
            received: Role::BOTH
                .into_iter()
                .flat_map(|role| [&self.autopilot[role]].into_iter().chain(&self.radio[role]))
                .map(|port| port.received)
                .sum(),
            swallowed: ports().map(|port| port.swallowed).sum(),
        }
    }
}
