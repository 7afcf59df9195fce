//! What goes wrong.

use crate::vehicle::radio_hop::{Manners, Toward};

/// A fault, in force from the moment it is injected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// The companion's link to its vehicle is cut (`on`) or mended, both directions.
    LinkLoss {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Cut, or mended.
        on: bool,
    },
    /// The companion's link to its vehicle loses and delays datagrams from now on, both directions; zeros mend it.
    LinkDegraded {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Probability that a datagram is lost.
        loss: f64,
        /// Seconds, each way.
        delay_s: f64,
    },
    /// The hop between the autopilot and its radio behaves so from now on, in one direction.
    RadioHop {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Which direction.
        toward: Toward,
        /// How it behaves; the default mends it.
        manners: Manners,
    },
    /// Nothing arrives at the other end of that hop (`on`); what was held up arrives at once when it goes on.
    RadioHopFrozen {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Which direction.
        toward: Toward,
        /// Frozen, or going on.
        on: bool,
    },
    /// GPS is lost (`on`) or back: the position runs away at 0.06 m/s^2, is given up after 5 s, and jumps back with GPS.
    GpsLoss {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Lost, or back.
        on: bool,
    },
    /// The position estimate jumps, for good.
    EstimatorReset {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// East, north, up, metres.
        jump_enu_m: [f64; 3],
    },
    /// The autopilot's clock (SYSTEM_TIME) jumps.
    ClockJump {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Seconds, forward if positive.
        by_s: f64,
    },
    /// The autopilot's clock (SYSTEM_TIME) runs fast or slow from now on.
    ClockDrift {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Millionths, fast if positive.
        ppm: f64,
    },
    /// The autopilot restarts: its motors stop, it is silent for 3 s, and knows its parameters alone.
    AutopilotRestart {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The pilot takes the sticks.
    PilotMode {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The position estimate is lost.
    EstimatorFailure {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The mean wind changes at once.
    WindStep {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Where the air moves to, east, north, up.
        mean_enu_m_s: [f64; 3],
    },
    /// A rotor stops for good. PX4 does without it if CA_FAILURE_MODE says so; an autopilot that does not know falls.
    RotorLoss {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Its number in the geometry, from 0; one that is not there changes nothing.
        rotor: usize,
    },
    /// The battery's charge falls at once.
    BatteryLow {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// 0 to 1.
        charge: f64,
    },
    /// From now on the battery gives less than it should, as an old or a cold one does: its charge falls so many times faster.
    BatteryWeak {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// 1: as it should.
        times: f64,
    },
    /// What is said of the battery's charge stays as it is, whatever is left.
    BatteryLies {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The transmitter obeys commands, but what it radiates never ends by itself.
    TransmitterIgnoresExpiry {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The transmitter goes on with what it radiates, whatever it is told and whenever its lease ends.
    TransmitterStuck {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The transmitter loses its power (`on`), or has it again: it is off and silent meanwhile, and starts afterwards
    /// with a clock and a series of its own, and no commander.
    TransmitterRestart {
        /// 0 for I, 1 for J.
        vehicle: usize,
        /// Without power, or starting.
        on: bool,
    },
    /// The radio behind a power set from outside ([`World::set_device_power`](super::World::set_device_power)) fails, as by its
    /// host's death. Nothing else changes in the world.
    RadioFails {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
    /// The companion has been killed, and does not run until the host says so. Nothing else changes in the world.
    CompanionLost {
        /// 0 for I, 1 for J.
        vehicle: usize,
    },
}

impl Fault {
    /// Whether it is a failure of the vehicle itself: not of a message's way, of a clock, of a companion, of the air.
    #[must_use]
    pub const fn is_of_the_vehicle(&self) -> bool {
        matches!(
            self,
            Self::GpsLoss { .. }
                | Self::EstimatorReset { .. }
                | Self::EstimatorFailure { .. }
                | Self::AutopilotRestart { .. }
                | Self::PilotMode { .. }
                | Self::RotorLoss { .. }
                | Self::BatteryLow { .. }
                | Self::BatteryWeak { .. }
                | Self::BatteryLies { .. }
                | Self::RadioFails { .. }
        )
    }

    /// The vehicle concerned.
    #[must_use]
    pub const fn vehicle(&self) -> usize {
        match *self {
            Self::LinkLoss { vehicle, .. }
            | Self::LinkDegraded { vehicle, .. }
            | Self::RadioHop { vehicle, .. }
            | Self::RadioHopFrozen { vehicle, .. }
            | Self::GpsLoss { vehicle, .. }
            | Self::EstimatorReset { vehicle, .. }
            | Self::ClockJump { vehicle, .. }
            | Self::ClockDrift { vehicle, .. }
            | Self::TransmitterRestart { vehicle, .. }
            | Self::AutopilotRestart { vehicle }
            | Self::PilotMode { vehicle }
            | Self::EstimatorFailure { vehicle }
            | Self::WindStep { vehicle, .. }
            | Self::RotorLoss { vehicle, .. }
            | Self::BatteryLow { vehicle, .. }
            | Self::BatteryWeak { vehicle, .. }
            | Self::BatteryLies { vehicle }
            | Self::TransmitterIgnoresExpiry { vehicle }
            | Self::TransmitterStuck { vehicle }
            | Self::RadioFails { vehicle }
            | Self::CompanionLost { vehicle } => vehicle,
        }
    }
}
