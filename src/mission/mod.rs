//! mission.
