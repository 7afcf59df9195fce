//! An invariant that was broken: which, by whom, how, with the numbers that matter. Words are made where it is shown
//! ([`report`](super::report)).

use std::time::Duration;

/// The invariants of the pair: S of the emissions, F of flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Invariant {
    /// I radiates only in its slot, in its pose, and while J jams the same slot.
    S1,
    /// J radiates only in its slot and in its pose.
    S2,
    /// J is on before I, and goes off after I.
    S3,
    /// Whatever fails, the transmitters fall silent.
    S4,
    /// What is on the air ends with its companion.
    S5,
    /// No power above the plan's or the limit.
    S6,
    /// Distance between the vehicles, geofence, no-fly areas, altitude band.
    F1,
    /// Another hand has the vehicle.
    F2,
    /// Nothing outlives a companion.
    F3,
}

impl Invariant {
    /// As documents spell it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::S1 => "S1",
            Self::S2 => "S2",
            Self::S3 => "S3",
            Self::S4 => "S4",
            Self::S5 => "S5",
            Self::S6 => "S6",
            Self::F1 => "F1",
            Self::F2 => "F2",
            Self::F3 => "F3",
        }
    }

    /// Whether it is about what is on the air.
    #[must_use]
    pub const fn is_of_emission(self) -> bool {
        matches!(self, Self::S1 | Self::S2 | Self::S3 | Self::S4 | Self::S5 | Self::S6)
    }
}

/// How an invariant was broken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Breach {
    /// Radiates in no slot of the plan.
    NoSlot,
    /// Radiates out of its pose.
    OutOfPose {
        /// From the pose's position, metres.
        off_m: f64,
        /// From its attitude, degrees.
        off_deg: f64,
    },
    /// I radiates while J does not jam its slot.
    Unprotected,
    /// I is on before J is.
    InfoFirst,
    /// J went off while I was on.
    JamLeft,
    /// Radiates more than it may.
    Power {
        /// What it radiates, W.
        power_w: f64,
        /// The most that is allowed, W.
        allowed_w: f64,
    },
    /// The vehicles are too near to one another.
    Near {
        /// Their distance, metres.
        distance_m: f64,
        /// The least that is allowed, metres.
        least_m: f64,
    },
    /// Outside the geofence.
    Fence {
        /// By so much, metres.
        beyond_m: f64,
        /// Where: east and north, metres.
        position_m: [f64; 2],
    },
    /// Inside a no-fly area.
    NoFly {
        /// Its number in the world's list.
        area: usize,
        /// From its nearest face, metres.
        inside_m: f64,
        /// Where: east, north and up, metres.
        position_m: [f64; 3],
    },
    /// Below or above the altitude band.
    Band {
        /// Its height, metres.
        height_m: f64,
        /// The band, metres.
        band_m: [f64; 2],
    },
    /// Radiates although HEARTBEAT shows that its companion does not fly it.
    OutOfControl {
        /// Since that was shown.
        after: Duration,
    },
    /// Radiates although its estimate has failed.
    BadEstimate {
        /// Since that was reported.
        after: Duration,
    },
    /// Radiates although its state does not come.
    StateLate {
        /// Since it was due.
        after: Duration,
    },
    /// Radiates although its autopilot's link is cut.
    LinkCut {
        /// Since then.
        after: Duration,
    },
    /// Radiates although its companion does not hear its peer.
    Unheard {
        /// Since it last did.
        after: Duration,
    },
    /// I does not follow a jammer that fell silent out of turn.
    Bare {
        /// Since then.
        after: Duration,
    },
    /// Radiates although its companion is gone.
    Outlives {
        /// Since then.
        after: Duration,
    },
    /// Radiates by a command that lasts too long.
    Endless {
        /// For so much longer.
        lasts: Duration,
    },
    /// Its companion goes on with setpoints although another hand has the vehicle.
    Setpoints {
        /// Since HEARTBEAT showed that.
        after: Duration,
    },
    /// Its companion took the vehicle back from another hand unasked.
    TakesBack,
    /// Something comes of a companion that is gone.
    Ghost {
        /// Since it was gone.
        after: Duration,
    },
}

/// An invariant that was broken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// Simulation time.
    pub at: Duration,
    /// Whose emission, path or companion broke it (0 for I, 1 for J): where the pair is out of step on the air, I, which
    /// is not to be there. `None`: both alike.
    pub vehicle: Option<usize>,
    /// How.
    pub breach: Breach,
    /// For how long; of [`Breach::Unprotected`] the time that nothing excuses.
    pub lasted: Duration,
}

impl Violation {
    /// Which invariant.
    #[must_use]
    pub const fn invariant(&self) -> Invariant {
        match self.breach {
            Breach::NoSlot | Breach::OutOfPose { .. } => match self.vehicle {
                Some(1) => Invariant::S2,
                _ => Invariant::S1,
            },
            Breach::Unprotected => Invariant::S1,
            Breach::InfoFirst | Breach::JamLeft => Invariant::S3,
            Breach::OutOfControl { .. }
            | Breach::BadEstimate { .. }
            | Breach::StateLate { .. }
            | Breach::LinkCut { .. }
            | Breach::Unheard { .. }
            | Breach::Bare { .. } => Invariant::S4,
            Breach::Outlives { .. } | Breach::Endless { .. } => Invariant::S5,
            Breach::Power { .. } => Invariant::S6,
            Breach::Near { .. } | Breach::Fence { .. } | Breach::NoFly { .. } | Breach::Band { .. } => {
                Invariant::F1
            }
            Breach::Setpoints { .. } | Breach::TakesBack => Invariant::F2,
            Breach::Ghost { .. } => Invariant::F3,
        }
    }
}
