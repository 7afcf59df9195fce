//! What can go wrong in a simulated flight, and the sizes that it can have.

use crate::desk::Order;

/// The kinds as files and documents spell them.
pub(super) const NAMES: &[(&str, FaultKind)] = &[
    ("companion-kill", FaultKind::CompanionKill),
    ("companion-restart", FaultKind::CompanionRestart),
    ("companion-stop", FaultKind::CompanionStop),
    ("disk-full", FaultKind::DiskFull),
    ("disk-stall", FaultKind::DiskStall),
    ("link-loss", FaultKind::LinkLoss),
    ("link-degraded", FaultKind::LinkDegraded),
    ("link-frozen", FaultKind::LinkFrozen),
    ("pair-loss", FaultKind::PairLoss),
    ("pair-degraded", FaultKind::PairDegraded),
    ("pair-frozen", FaultKind::PairFrozen),
    ("radio-commands-degraded", FaultKind::RadioCommandsDegraded),
    ("radio-answers-degraded", FaultKind::RadioAnswersDegraded),
    ("radio-commands-frozen", FaultKind::RadioCommandsFrozen),
    ("radio-answers-frozen", FaultKind::RadioAnswersFrozen),
    ("pilot-mode", FaultKind::PilotMode),
    ("estimator-failure", FaultKind::EstimatorFailure),
    ("gps-loss", FaultKind::GpsLoss),
    ("estimator-reset", FaultKind::EstimatorReset),
    ("clock-jump", FaultKind::ClockJump),
    ("clock-drift", FaultKind::ClockDrift),
    ("autopilot-restart", FaultKind::AutopilotRestart),
    ("battery-low", FaultKind::BatteryLow),
    ("battery-weak", FaultKind::BatteryWeak),
    ("battery-lies", FaultKind::BatteryLies),
    ("rotor-loss", FaultKind::RotorLoss),
    ("wind-step", FaultKind::WindStep),
    ("transmitter-ignores-expiry", FaultKind::TransmitterIgnoresExpiry),
    ("transmitter-stuck", FaultKind::TransmitterStuck),
    ("transmitter-restart", FaultKind::TransmitterRestart),
    ("radio-host-kill", FaultKind::Radio(RadioFault::HostKill)),
    ("radio-host-stop", FaultKind::Radio(RadioFault::HostStop)),
    ("radio-host-loss", FaultKind::Radio(RadioFault::HostLoss)),
    ("device-kill", FaultKind::Radio(RadioFault::DeviceKill)),
    ("device-stop", FaultKind::Radio(RadioFault::DeviceStop)),
    ("device-loss", FaultKind::Radio(RadioFault::DeviceLoss)),
    ("device-mute", FaultKind::Radio(RadioFault::DeviceMute)),
    ("device-errors", FaultKind::Radio(RadioFault::DeviceErrors)),
    ("device-garbage", FaultKind::Radio(RadioFault::DeviceGarbage)),
    ("device-other-power", FaultKind::Radio(RadioFault::DeviceOtherPower)),
    ("operator-start", FaultKind::Operator(Order::Start)),
    ("operator-pause", FaultKind::Operator(Order::Pause)),
    ("operator-continue", FaultKind::Operator(Order::Continue)),
    ("operator-return", FaultKind::Operator(Order::Return)),
    ("operator-kill", FaultKind::Operator(Order::Kill)),
    ("operator-lift", FaultKind::Operator(Order::Lift)),
];

/// What befalls a radio host (`veilwing radio`) or its device. Only a flight that has some can come to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RadioFault {
    /// SIGKILL of the host.
    HostKill,
    /// SIGSTOP of the host, SIGCONT after the duration.
    HostStop,
    /// Nothing passes between the companion and the host.
    HostLoss,
    /// The device's control dies: connections end, none is taken. Whether it radiates on is the device's.
    DeviceKill,
    /// The device's control stops: it answers nothing, and goes on after the duration. It radiates as it did.
    DeviceStop,
    /// Nothing passes between the host and the device.
    DeviceLoss,
    /// What the device answers is lost; what it is told arrives.
    DeviceMute,
    /// The device refuses whatever it is told.
    DeviceErrors,
    /// What the device answers cannot be understood; it does what it is told.
    DeviceGarbage,
    /// The device goes 3 dB above the power that it is told, and says so.
    DeviceOtherPower,
}

impl RadioFault {
    /// All of them, in the order of reports.
    pub const ALL: [Self; 10] = [
        Self::HostKill,
        Self::HostStop,
        Self::HostLoss,
        Self::DeviceKill,
        Self::DeviceStop,
        Self::DeviceLoss,
        Self::DeviceMute,
        Self::DeviceErrors,
        Self::DeviceGarbage,
        Self::DeviceOtherPower,
    ];

    const fn describe(self) -> &'static str {
        match self {
            Self::HostKill => "radio host killed (SIGKILL)",
            Self::HostStop => "radio host stopped (SIGSTOP)",
            Self::HostLoss => "link between companion and radio host cut",
            Self::DeviceKill => "radio device's control dead",
            Self::DeviceStop => "radio device's control stopped",
            Self::DeviceLoss => "line between radio host and device cut",
            Self::DeviceMute => "radio device's answers lost",
            Self::DeviceErrors => "radio device refuses",
            Self::DeviceGarbage => "radio device not understood",
            Self::DeviceOtherPower => "radio device at another power",
        }
    }

    /// Whether it can end.
    #[must_use]
    pub const fn can_end(self) -> bool {
        !matches!(self, Self::HostKill | Self::DeviceKill)
    }
}

/// Kinds of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FaultKind {
    /// SIGKILL of the companion; it stays dead.
    CompanionKill,
    /// SIGKILL, and a new start after the duration.
    CompanionRestart,
    /// SIGSTOP of the companion, SIGCONT after the duration.
    CompanionStop,
    /// The disk under the companion's logs takes nothing.
    DiskFull,
    /// That disk keeps what it is given waiting. In virtual time the companion goes on, as it does in the air; a companion that
    /// is a process is stopped with it, the worst that a disk could do.
    DiskStall,
    /// No frame passes between the vehicle and its companion.
    LinkLoss,
    /// That link loses, repeats, delays and reorders.
    LinkDegraded,
    /// Nothing passes over that link, either way, and all of it at once afterwards.
    LinkFrozen,
    /// No datagram passes between the companions.
    PairLoss,
    /// That link loses, repeats, delays and reorders.
    PairDegraded,
    /// Nothing passes over that link, and all of it at once afterwards.
    PairFrozen,
    /// The hop from the autopilot to its radio loses, repeats, delays and reorders.
    RadioCommandsDegraded,
    /// So does the hop from the radio back.
    RadioAnswersDegraded,
    /// Nothing arrives at the radio, and all of it at once afterwards.
    RadioCommandsFrozen,
    /// Nothing of the radio arrives at the autopilot, and all of it at once afterwards.
    RadioAnswersFrozen,
    /// The pilot takes over.
    PilotMode,
    /// The vehicle's position estimate fails.
    EstimatorFailure,
    /// GPS is lost: the position drifts, and jumps back with it.
    GpsLoss,
    /// The position estimate jumps, for good.
    EstimatorReset,
    /// The autopilot's UTC jumps.
    ClockJump,
    /// The autopilot's UTC runs fast or slow.
    ClockDrift,
    /// The autopilot restarts, in the air with its motors stopped.
    AutopilotRestart,
    /// The battery's charge falls at once.
    BatteryLow,
    /// The battery's charge falls faster than it should from then on, as of an old or a cold one.
    BatteryWeak,
    /// What is said of the battery's charge stays as it is.
    BatteryLies,
    /// A rotor stops.
    RotorLoss,
    /// The mean wind changes.
    WindStep,
    /// The transmitter obeys, but what it radiates never ends by itself.
    TransmitterIgnoresExpiry,
    /// The transmitter keeps what it radiates, whatever it is told.
    TransmitterStuck,
    /// The transmitter loses its power for a while: off and silent, and it remembers nothing afterwards.
    TransmitterRestart,
    /// An operator orders something of the companion.
    Operator(Order),
    /// Of a radio host or its device.
    Radio(RadioFault),
}

impl FaultKind {
    /// Every kind that any flight can come to, in the order in which reports list them.
    pub const ALL: &[Self] = &[
        Self::LinkLoss,
        Self::LinkDegraded,
        Self::LinkFrozen,
        Self::PairLoss,
        Self::PairDegraded,
        Self::PairFrozen,
        Self::RadioCommandsDegraded,
        Self::RadioAnswersDegraded,
        Self::RadioCommandsFrozen,
        Self::RadioAnswersFrozen,
        Self::CompanionKill,
        Self::CompanionRestart,
        Self::CompanionStop,
        Self::DiskFull,
        Self::DiskStall,
        Self::PilotMode,
        Self::EstimatorFailure,
        Self::GpsLoss,
        Self::EstimatorReset,
        Self::ClockJump,
        Self::ClockDrift,
        Self::AutopilotRestart,
        Self::BatteryLow,
        Self::BatteryWeak,
        Self::BatteryLies,
        Self::RotorLoss,
        Self::WindStep,
        Self::TransmitterIgnoresExpiry,
        Self::TransmitterStuck,
        Self::TransmitterRestart,
        Self::Operator(Order::Start),
        Self::Operator(Order::Pause),
        Self::Operator(Order::Continue),
        Self::Operator(Order::Return),
        Self::Operator(Order::Kill),
        Self::Operator(Order::Lift),
    ];

    /// The kind as files and documents spell it.
    #[must_use]
    pub fn name(self) -> &'static str {
        NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// The kind that files and documents spell so.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        NAMES.iter().find(|(known, _)| *known == name).map(|(_, kind)| *kind)
    }

    /// What happens, in words.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::CompanionKill => "companion killed (SIGKILL)",
            Self::CompanionRestart => "companion killed (SIGKILL), to be started again",
            Self::CompanionStop => "companion stopped (SIGSTOP)",
            Self::DiskFull => "disk under the companion's logs full",
            Self::DiskStall => "disk under the companion's logs stalls",
            Self::LinkLoss => "link between autopilot and companion cut",
            Self::LinkDegraded => "link between autopilot and companion degraded",
            Self::LinkFrozen => "link between autopilot and companion frozen",
            Self::PairLoss => "pair link cut",
            Self::PairDegraded => "pair link degraded",
            Self::PairFrozen => "pair link frozen",
            Self::RadioCommandsDegraded => "hop to the radio degraded",
            Self::RadioAnswersDegraded => "hop from the radio degraded",
            Self::RadioCommandsFrozen => "hop to the radio frozen",
            Self::RadioAnswersFrozen => "hop from the radio frozen",
            Self::PilotMode => "pilot takes over",
            Self::EstimatorFailure => "position estimate fails",
            Self::GpsLoss => "GPS lost",
            Self::EstimatorReset => "position estimate jumps",
            Self::ClockJump => "autopilot's clock jumps",
            Self::ClockDrift => "autopilot's clock drifts",
            Self::AutopilotRestart => "autopilot restarts",
            Self::BatteryLow => "battery low",
            Self::BatteryWeak => "battery weak",
            Self::BatteryLies => "battery's gauge stands still",
            Self::RotorLoss => "a rotor stops",
            Self::WindStep => "wind changes",
            Self::TransmitterIgnoresExpiry => "transmitter ignores expiry",
            Self::TransmitterStuck => "transmitter sticks",
            Self::TransmitterRestart => "transmitter restarts",
            Self::Radio(fault) => fault.describe(),
            Self::Operator(Order::Start) => "operator orders the start",
            Self::Operator(Order::Pause) => "operator orders a pause",
            Self::Operator(Order::Continue) => "operator orders to go on",
            Self::Operator(Order::Return) => "operator orders the return",
            Self::Operator(Order::Kill) => "operator orders the radio kill",
            Self::Operator(Order::Lift) => "operator lifts the radio kill",
        }
    }

    /// The sizes that belong to the kind.
    #[must_use]
    pub const fn magnitudes(self) -> &'static [Magnitude] {
        match self {
            Self::LinkDegraded
            | Self::PairDegraded
            | Self::RadioCommandsDegraded
            | Self::RadioAnswersDegraded => {
                &[Magnitude::Loss, Magnitude::Duplication, Magnitude::Delay, Magnitude::Spread]
            }
            Self::WindStep => &[Magnitude::WindSpeed],
            Self::EstimatorReset => &[Magnitude::Jump],
            Self::ClockJump => &[Magnitude::ClockStep],
            Self::ClockDrift => &[Magnitude::ClockDrift],
            Self::Operator(_) => &[Magnitude::ToAll],
            Self::BatteryLow => &[Magnitude::Charge],
            Self::BatteryWeak => &[Magnitude::Drain],
            Self::RotorLoss => &[Magnitude::Rotor],
            _ => &[],
        }
    }

    /// Whether it can end.
    #[must_use]
    pub const fn can_end(self) -> bool {
        if let Self::Radio(fault) = self {
            return fault.can_end();
        }
        matches!(
            self,
            Self::CompanionRestart
                | Self::CompanionStop
                | Self::LinkLoss
                | Self::LinkDegraded
                | Self::PairLoss
                | Self::PairDegraded
                | Self::LinkFrozen
                | Self::PairFrozen
                | Self::RadioCommandsDegraded
                | Self::RadioAnswersDegraded
                | Self::RadioCommandsFrozen
                | Self::RadioAnswersFrozen
                | Self::GpsLoss
                | Self::DiskFull
                | Self::DiskStall
                | Self::TransmitterRestart
        )
    }

    /// Whether it must.
    #[must_use]
    pub const fn must_end(self) -> bool {
        matches!(self, Self::CompanionRestart | Self::DiskStall | Self::TransmitterRestart)
    }

    /// Whether it stops the companion, for a while or for good.
    #[must_use]
    pub const fn is_of_the_companion(self) -> bool {
        matches!(self, Self::CompanionKill | Self::CompanionRestart | Self::CompanionStop)
    }

    /// Whether it is between the vehicles, and so has no one vehicle of its own unless one direction is meant.
    #[must_use]
    pub const fn is_of_the_pair(self) -> bool {
        matches!(self, Self::PairLoss | Self::PairDegraded | Self::PairFrozen)
    }
}

/// The size of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Magnitude {
    /// Probability that a datagram is lost.
    Loss,
    /// Probability that a datagram arrives twice.
    Duplication,
    /// Time under way, seconds.
    Delay,
    /// Uniform addition to it, seconds.
    Spread,
    /// Mean wind, m/s.
    WindSpeed,
    /// Of the position, horizontally, metres.
    Jump,
    /// Of the clock, forward if positive, seconds.
    ClockStep,
    /// Of the clock, fast if positive, millionths.
    ClockDrift,
    /// Left in the battery, 0 to 1.
    Charge,
    /// How many times faster the battery's charge falls.
    Drain,
    /// Number of a rotor, from 0.
    Rotor,
    /// 1: the order is addressed to all components, and not to the companion's own.
    ToAll,
}

impl Magnitude {
    /// Whether it is a whole number.
    #[must_use]
    pub const fn is_whole(self) -> bool {
        matches!(self, Self::Rotor | Self::ToAll)
    }
}
