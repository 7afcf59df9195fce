//! What has been heard of one vehicle: its autopilot, and its companion.

use std::collections::{BTreeMap, VecDeque};
use std::str::FromStr;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, DEBUG_VECT_DATA, GpsFixType, HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag,
    MavSeverity, NAMED_VALUE_FLOAT_DATA, ONBOARD_COMPUTER_STATUS_DATA,
};

use crate::autopilot::Firmware;
use crate::autopilot::statustext::Assembly;
use crate::mission::{Figure, Vector};
use crate::role::Role;
use crate::time::Instant;

/// An autopilot's component.
pub(super) const AUTOPILOT: u8 = 1;
/// A figure that was not said again for so long is not known any more: several turns of the companion's.
const FIGURES_LAST: Duration = Duration::from_secs(8);
/// Rates of so long ago are forgotten.
const HISTORY: Duration = Duration::from_secs(600);

/// The phase in which a slot is agreed on, by its place in the phases' names.
pub(super) const SLOT: usize = 6;
/// What is said of a slot that is agreed on, and means nothing after it.
const OF_A_SLOT: [Figure; 4] = [Figure::Opens, Figure::Closes, Figure::Lease, Figure::PlannedPower];

/// On which of the addresses, and by which MAVLink system.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Id {
    /// The address, by its place on the command line.
    pub channel: usize,
    /// The system.
    pub system: u8,
}

/// Something, and when it was heard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct At<T> {
    pub value: T,
    pub at: Instant,
}

/// How a companion's computer fares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Computer {
    pub busy_percent: Option<u8>,
    pub degrees: Option<i8>,
    pub memory_percent: Option<u8>,
    pub disk_percent: Option<u8>,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Vehicle {
    /// Where it is heard.
    pub id: Id,
    /// As it says, or as the file says in which it was recorded.
    pub(super) role: Option<Role>,
    pub(super) companion_at: Option<Instant>,
    figures: BTreeMap<Figure, At<f64>>,
    vectors: Vec<(Vector, At<[f64; 3]>)>,
    live: BTreeMap<String, At<f64>>,
    /// Secrecy rates in bit/s.
    pub(super) rates: VecDeque<At<f64>>,
    /// Where it has been, east and north, in metres.
    pub(super) trail: VecDeque<[f64; 2]>,
    pub(super) computer: Option<At<Computer>>,
    pub(super) autopilot_at: Option<Instant>,
    firmware: Option<Firmware>,
    pub(super) mode: Option<&'static str>,
    pub(super) armed: Option<bool>,
    pub(super) battery_percent: Option<u8>,
    pub(super) battery_v: Option<f64>,
    pub(super) fix: Option<GpsFixType>,
    texts: BTreeMap<u8, Assembly>,
}

/// What a message has brought that is not of the vehicle's state.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum News {
    /// A line of text, by this component.
    Text(u8, MavSeverity, String),
    /// An answer to a command, by this component.
    Answer(u8, COMMAND_ACK_DATA),
}

impl Vehicle {
    pub(super) fn new(id: Id, role: Option<Role>) -> Self {
        Self {
            id,
            role,
            companion_at: None,
            figures: BTreeMap::new(),
            vectors: Vec::new(),
            live: BTreeMap::new(),
            rates: VecDeque::new(),
            trail: VecDeque::new(),
            computer: None,
            autopilot_at: None,
            firmware: None,
            mode: None,
            armed: None,
            battery_percent: None,
            battery_v: None,
            fix: None,
            texts: BTreeMap::new(),
        }
    }

    /// Whether a message is of a vehicle's autopilot or companion, and so makes one known.
    pub(super) fn makes_known(component: u8, companion: u8, message: &MavMessage) -> bool {
        match message {
            MavMessage::HEARTBEAT(m) => {
                component == companion
                    || component == AUTOPILOT && m.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
            }
            MavMessage::NAMED_VALUE_FLOAT(m) => {
                component == companion && m.name.to_str().is_ok_and(|name| Figure::from_str(name).is_ok())
            }
            _ => false,
        }
    }

    /// Takes a message of this vehicle's.
    pub(super) fn take(
        &mut self,
        component: u8,
        companion: u8,
        message: &MavMessage,
        now: Instant,
    ) -> Option<News> {
        if component == companion {
            self.companion_at = Some(now);
            self.take_companions(message, now);
        } else if component == AUTOPILOT {
            self.take_autopilots(message, now);
        }
        match message {
            MavMessage::STATUSTEXT(m) => {
                let text = self.texts.entry(component).or_default().handle(m)?;
                Some(News::Text(component, m.severity, text))
            }
            MavMessage::COMMAND_ACK(m) => Some(News::Answer(component, m.clone())),
            _ => None,
        }
    }

    fn take_companions(&mut self, message: &MavMessage, now: Instant) {
        match message {
            MavMessage::NAMED_VALUE_FLOAT(m) => self.take_value(m, now),
            MavMessage::DEBUG_VECT(m) => self.take_vector(m, now),
            MavMessage::ONBOARD_COMPUTER_STATUS(m) => {
                self.computer = Some(At { value: computer(m), at: now });
            }
            _ => {}
        }
    }

    fn take_value(&mut self, m: &NAMED_VALUE_FLOAT_DATA, now: Instant) {
        let value = f64::from(m.value);
        let (Ok(name), true) = (m.name.to_str(), value.is_finite()) else { return };
        let said = At { value, at: now };
        if let Ok(figure) = Figure::from_str(name) {
            self.figures.insert(figure, said);
            if figure == Figure::Phase && value as usize != SLOT {
                self.figures.retain(|figure, _| !OF_A_SLOT.contains(figure));
            }
            if figure == Figure::Role {
                self.role = Some(if value == 0.0 { Role::I } else { Role::J });
            }
        } else if name == "SEC_RATE" || name == "TX_DBM" || name.starts_with("SINR_") {
            self.live.insert(name.to_owned(), said);
            if name == "SEC_RATE" {
                self.rates.push_back(said);
                while self.rates.front().is_some_and(|first| first.at + HISTORY < now) {
                    self.rates.pop_front();
                }
            }
        }
    }

    fn take_vector(&mut self, m: &DEBUG_VECT_DATA, now: Instant) {
        let Some(vector) = m.name.to_str().ok().and_then(|name| Vector::from_str(name).ok()) else { return };
        let value = [m.x, m.y, m.z].map(f64::from);
        if value.iter().all(|part| part.is_finite()) {
            self.vectors.retain(|(other, _)| *other != vector);
            self.vectors.push((vector, At { value, at: now }));
            let [east, north, _] = value;
            let far = |last: &[f64; 2]| (last[0] - east).hypot(last[1] - north) > 0.5;
            if vector == Vector::Position && self.trail.back().is_none_or(far) {
                self.trail.push_back([east, north]);
                // Some kilometres of way.
                self.trail.drain(..self.trail.len().saturating_sub(4000));
            }
        }
    }

    fn take_autopilots(&mut self, message: &MavMessage, now: Instant) {
        match message {
            MavMessage::HEARTBEAT(m) => self.take_heartbeat(m, now),
            MavMessage::SYS_STATUS(m) => {
                self.battery_percent = u8::try_from(m.battery_remaining).ok();
                self.battery_v = (m.voltage_battery != u16::MAX).then(|| f64::from(m.voltage_battery) * 1e-3);
            }
            MavMessage::BATTERY_STATUS(m) if m.id == 0 => {
                self.battery_percent = u8::try_from(m.battery_remaining).ok().or(self.battery_percent);
            }
            MavMessage::GPS_RAW_INT(m) => self.fix = Some(m.fix_type),
            _ => {}
        }
    }

    fn take_heartbeat(&mut self, m: &HEARTBEAT_DATA, now: Instant) {
        self.autopilot_at = Some(now);
        self.firmware = Firmware::of(m).or(self.firmware);
        self.mode = self.firmware.map(|firmware| firmware.mode_name(firmware.mode(m.custom_mode)));
        self.armed = Some(m.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED));
    }

    /// A figure that the companion says, and when it said it; `None` if it has not of late.
    pub(super) fn said(&self, figure: Figure, now: Instant) -> Option<At<f64>> {
        self.figures.get(&figure).copied().filter(|said| said.at + FIGURES_LAST >= now)
    }

    /// The figure alone.
    pub(super) fn figure(&self, figure: Figure, now: Instant) -> Option<f64> {
        self.said(figure, now).map(|said| said.value)
    }

    /// A time that runs down: what is left of it now.
    pub(super) fn countdown(&self, figure: Figure, now: Instant) -> Option<f64> {
        self.said(figure, now).map(|said| said.value - now.saturating_since(said.at).as_secs_f64())
    }

    pub(super) fn vector(&self, vector: Vector, now: Instant) -> Option<[f64; 3]> {
        let (_, said) = self.vectors.iter().find(|(other, _)| *other == vector)?;
        (said.at + FIGURES_LAST >= now).then_some(said.value)
    }

    /// A live figure by its name.
    pub(super) fn live(&self, name: &str, now: Instant) -> Option<f64> {
        self.live.get(name).filter(|said| said.at + FIGURES_LAST >= now).map(|said| said.value)
    }

    /// What each eavesdropper hears, dB, in the mission file's order.
    pub(super) fn eavesdroppers(&self, now: Instant) -> Vec<f64> {
        (1..).map_while(|number| self.live(&format!("SINR_E{number}"), now)).collect()
    }

    /// Whether its companion was heard of late.
    pub(super) fn is_heard(&self, now: Instant) -> bool {
        self.companion_at.is_some_and(|at| at + LOST_AFTER >= now)
    }

    /// The phase's number.
    pub(super) fn phase(&self, now: Instant) -> Option<usize> {
        self.figure(Figure::Phase, now).map(|phase| phase as usize)
    }
}

/// A companion says something ten times a second, and its HEARTBEAT each second.
pub(super) const LOST_AFTER: Duration = Duration::from_secs(3);

fn computer(m: &ONBOARD_COMPUTER_STATUS_DATA) -> Computer {
    let share = |used: u32, total: u32| {
        let known = used != u32::MAX && total != u32::MAX && total > 0;
        known.then(|| u8::try_from(100 * u64::from(used) / u64::from(total)).unwrap_or(100))
    };
    Computer {
        busy_percent: Some(m.cpu_combined[0]).filter(|percent| *percent <= 100),
        degrees: Some(m.temperature_board).filter(|degrees| *degrees != i8::MAX),
        memory_percent: share(m.ram_usage, m.ram_total),
        disk_percent: share(m.storage_usage[0], m.storage_total[0]),
    }
}
