//! The manners of the real firmwares that catch a companion out, each of which can be switched off.

/// Which traps are set. All of a firmware's own are by default; what is off by default would keep the autopilot from
/// tracking position and attitude apart, which a stock PX4 cannot either.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Traps {
    /// PX4: OFFBOARD is acknowledged while disarmed without any stream.
    pub ack_without_stream: bool,
    /// PX4: a stream that comes back takes the vehicle back, from any mode, unasked.
    pub resume_takes_over: bool,
    /// PX4: a lost stream with COM_OBL_RC_ACT 0 to 2 leaves the vehicle to the pilot's sticks, and without any it goes away
    /// sideways and down. Off: it lands.
    pub sticks_missing: bool,
    /// PX4: a second after disarming it goes back to the last mode asked for that can be armed in: OFFBOARD, after a landing.
    pub armable_mode_returns: bool,
    /// PX4: telemetry leaves on the ticks of an 8 ms loop: 50 Hz comes in steps of 16 and 24 ms.
    pub uneven_telemetry: bool,
    /// PX4 in simulation: the battery that it reports loses its charge in SIM_BAT_DRAIN seconds of being armed, whatever is
    /// flown, down to SIM_BAT_MIN_PCT and no further, and is full again once disarmed.
    pub simulated_battery: bool,
    /// PX4: the land detector takes little body-z thrust without motion for the ground, and disarms in mid-air.
    pub land_detector: bool,
    /// PX4: with the roll and pitch rate bits of an attitude target clear, its rates and scalar thrust are flown too,
    /// against the attitude.
    pub rates_fight_attitude: bool,
    /// ArduCopter: setpoints before GUIDED, and before its take-off, are ignored.
    pub guided_first: bool,
    /// ArduCopter: one ignored axis drops its whole group.
    pub whole_groups: bool,
    /// ArduCopter: a position target is kept for ever after the stream's end, without a word. Off: the vehicle stops
    /// where it is after GUID_TIMEOUT.
    pub position_kept: bool,
    /// ArduCopter: it moves a target of its own after the companion's, whose corrections are bounded by WPNAV_ACCEL and
    /// WPNAV_SPEED and whose acceleration changes by PSC_JERK_XY and PSC_JERK_Z: what does not say when it slows down is
    /// flown past. Off: the companion's target is followed as it is.
    pub targets_shaped: bool,
    /// ArduCopter: a target goes on with its last velocity and acceleration until GUID_TIMEOUT. Off: for a tenth of a
    /// second.
    pub velocity_kept: bool,
    /// ArduCopter: a position target in a frame that it does not know stops the vehicle. Off: it is ignored.
    pub odd_frame_stops: bool,
    /// ArduCopter: SET_MESSAGE_INTERVAL above the loop rate is refused. Off: it is cut down to it.
    pub fast_interval_refused: bool,
    /// ArduCopter: an attitude quaternion sent to a 6DoF frame (FRAME_CLASS 16) ends the autopilot's program.
    pub six_dof_panics: bool,
    /// ArduCopter 6DoF: ten commands at once end a bridge script that decodes them all: its offsets stay, and nobody
    /// answers its commands.
    pub script_dies_of_bursts: bool,
    /// ArduCopter 6DoF: no guard script levels the vehicle when the bridge script is gone.
    pub script_without_guard: bool,
    /// ArduCopter: SETUP_SIGNING is refused while armed. Off: it is carried out, and whoever has not the key is heard no
    /// more in mid-air.
    pub signing_refused_while_armed: bool,
    /// Both: an unknown parameter gets silence. Off: a STATUSTEXT says so.
    pub silent_unknown_parameter: bool,
    /// Both: SYS_STATUS calls a GPS receiver healthy that talks, whatever it says. Off: one that has a fix.
    pub gps_health_is_talk: bool,
    /// Either: the first change to the companion's mode is acknowledged and not carried out.
    pub mode_ack_alone: bool,
    /// Stock ArduCopter: an attitude target is a lean with a climb rate (0.5 holds the height, unless GUID_OPTIONS bit
    /// 3 makes it thrust), `thrust_body` is ignored, the position is nobody's, and a quaternion of another length or an
    /// ignored throttle stops the vehicle in silence. Off: it turns the body apart from its position.
    pub angle_control: bool,
    /// Stock PX4: an attitude target without thrust is no offboard signal and turns nothing. Off: it turns the body
    /// apart from its position.
    pub attitude_needs_thrust: bool,
}

impl Default for Traps {
    fn default() -> Self {
        Self {
            ack_without_stream: true,
            resume_takes_over: true,
            sticks_missing: true,
            armable_mode_returns: true,
            uneven_telemetry: true,
            simulated_battery: false,
            land_detector: true,
            rates_fight_attitude: true,
            guided_first: true,
            whole_groups: true,
            position_kept: true,
            targets_shaped: true,
            velocity_kept: true,
            odd_frame_stops: true,
            fast_interval_refused: true,
            six_dof_panics: true,
            script_dies_of_bursts: false,
            script_without_guard: false,
            signing_refused_while_armed: true,
            silent_unknown_parameter: true,
            gps_health_is_talk: true,
            mode_ack_alone: false,
            angle_control: false,
            attitude_needs_thrust: false,
        }
    }
}
