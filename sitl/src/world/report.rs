//! What the world measured of a flight: its part of the flight document.

use serde::Serialize;

/// A value of each vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct PerVehicle<T> {
    /// Of the aerial base station.
    pub i: T,
    /// Of the jammer.
    pub j: T,
}

impl<T> From<[T; 2]> for PerVehicle<T> {
    fn from([i, j]: [T; 2]) -> Self {
        Self { i, j }
    }
}

/// One slot as it was flown.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SlotReport {
    /// The user served.
    pub user: String,
    /// The plan's expectation.
    pub planned_secrecy_rate_bps: f64,
    /// Mean over the time in which I radiated; 0 if it never did.
    pub achieved_secrecy_rate_bps: f64,
    /// Of that mean, from the means of half-second batches, so that slow errors count.
    pub standard_error_bps: f64,
    /// Seconds on the air.
    pub radiated_s: PerVehicle<f64>,
    /// I radiated without J on at its planned power and in its pose.
    pub unprotected_s: f64,
    /// J radiated out of its pose.
    pub jam_out_of_tolerance_s: f64,
    /// True position against the plan while radiating; `null` if it never did.
    pub position_rms_m: PerVehicle<Option<f64>>,
    /// True attitude, jitter included, against the plan while radiating.
    pub attitude_rms_deg: PerVehicle<Option<f64>>,
    /// The same without the injected jitter: what control and wind leave.
    pub attitude_control_rms_deg: PerVehicle<Option<f64>>,
}

/// An invariant that was broken.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Violation {
    /// S1 to S6, F1 to F3.
    pub invariant: &'static str,
    /// Simulation time.
    pub at_s: f64,
    /// What happened, with the number that matters.
    pub detail: String,
}

/// The world's account of a flight.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlightReport {
    /// Simulation time.
    pub flight_s: f64,
    /// In the plan's order.
    pub slots: Vec<SlotReport>,
    /// Seconds on the air in no slot of the plan.
    pub outside_slots_s: PerVehicle<f64>,
    /// In the order of their times.
    pub violations: Vec<Violation>,
    /// Least distance while both were in the air; `null` if they never were.
    pub min_separation_m: Option<f64>,
}
