//! The manners of the real firmwares that catch a companion out, each of which can be switched off.

/// Which traps are set. All of a firmware's own are by default; what is off by default would keep the autopilot from
/// tracking position and attitude apart, which a stock PX4 cannot either.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traps {
    /// PX4: OFFBOARD is acknowledged while disarmed without any stream.
    pub ack_without_stream: bool,
    /// PX4: a stream that comes back takes the vehicle back, from any mode, unasked.
    pub resume_takes_over: bool,
    /// PX4: the land detector takes little body-z thrust without motion for the ground, and disarms in mid-air.
    pub land_detector: bool,
    /// PX4: with the roll and pitch rate bits of an attitude target clear, its rates and scalar thrust are flown too,
    /// against the attitude.
    pub rates_fight_attitude: bool,
    /// Stock PX4: an attitude target without thrust is no offboard signal and turns nothing. Off: it turns the body
    /// apart from its position.
    pub attitude_needs_thrust: bool,
}

impl Default for Traps {
    fn default() -> Self {
        Self {
            ack_without_stream: true,
            resume_takes_over: true,
            land_detector: true,
            rates_fight_attitude: true,
            attitude_needs_thrust: false,
        }
    }
}
