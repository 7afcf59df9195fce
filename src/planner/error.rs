//! Why the planner has no answer.

/// Why a problem has no plan.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Nobody to hide from.
    #[error("no eavesdropper is given; name at least one")]
    NoEavesdropper,
    /// Without noise every SINR is infinite or undefined.
    #[error(
        "noise power is 0 W, with which rates are unbounded; give the receivers' noise (variance) in W, for instance 1e-12"
    )]
    NoNoise,
    /// A number outside its range, or not finite.
    #[error("{what} is {value}, outside {least} to {most}")]
    OutOfRange {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Least allowed.
        least: f64,
        /// Most allowed.
        most: f64,
    },
    /// The paper's methods vary powers from 0 to the ceiling.
    #[error(
        "this method plans any power up to the ceiling, and knows nothing of power_levels_w and min_power_w; plan with \"veilwing\", or leave the key out"
    )]
    PowerSteps,
    /// The paper's methods plan one slot at a time.
    #[error(
        "this method plans each slot by itself, and knows nothing of what is delivered over a superframe; plan with \"veilwing\", or set planner.optimise = \"rate\" and planner.mode = \"static\""
    )]
    VolumeMethod,
    /// A volume is a mean over what stays wrong in many slots.
    #[error(
        "a volume is planned for the mean over what stays wrong during a slot, or with nothing wrong: set planner.objective = \"mean\" or \"nominal\", or planner.optimise = \"rate\""
    )]
    VolumeObjective,
    /// A static plan whose positions cannot be left for each other.
    #[error(
        "the pair finds no way from the positions of user {from} to those of user {to}, counted from 0; give others"
    )]
    NoTransit {
        /// Who is served before.
        from: usize,
        /// Who is served afterwards.
        to: usize,
    },
    /// The geofence has no interior.
    #[error(
        "the area of {vertices} vertices has no interior or crosses itself; give the corners of a simple polygon in order"
    )]
    EmptyArea {
        /// Vertices given.
        vertices: usize,
    },
    /// The no-fly areas cover all of the airspace.
    #[error(
        "the {areas} no-fly areas leave nothing of the airspace, or one of them crosses itself; make them smaller or lower, or enlarge the area or its altitudes"
    )]
    NothingLeft {
        /// How many there are.
        areas: usize,
    },
    /// The airspace is smaller than the separation.
    #[error(
        "a separation of {separation_m} m does not fit into an airspace {reach_m} m across; enlarge the area or lower the separation"
    )]
    SeparationImpossible {
        /// Separation asked for, in metres.
        separation_m: f64,
        /// Largest distance in the airspace, in metres.
        reach_m: f64,
    },
}
