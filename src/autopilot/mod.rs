//! autopilot.
