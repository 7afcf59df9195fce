//! Two omnidirectional multirotors protect a ground user's radio traffic: an aerial base station (vehicle I)
//! and a friendly jammer (vehicle J). This crate is the planner and the onboard companion; see README.md and
//! ARCHITECTURE.md. Built with `--no-default-features` it is the planner alone: no tokio, no MAVLink, no TOML.

pub mod geo;
pub mod planner;
pub mod radio;
pub mod role;
pub mod schedule;
pub mod time;
pub mod units;

#[cfg(feature = "companion")]
pub mod autopilot;
#[cfg(feature = "companion")]
pub mod cli;
#[cfg(feature = "companion")]
pub mod companion;
#[cfg(feature = "companion")]
pub mod config;
#[cfg(feature = "desk")]
pub mod desk;
#[cfg(feature = "companion")]
pub mod durable;
#[cfg(feature = "companion")]
pub mod link;
#[cfg(feature = "companion")]
pub mod mission;
#[cfg(feature = "companion")]
pub mod pair;
#[cfg(feature = "companion")]
pub mod planning;
#[cfg(feature = "companion")]
pub mod preflight;
#[cfg(feature = "companion")]
pub mod radio_device;
#[cfg(feature = "companion")]
pub mod radio_host;
#[cfg(feature = "companion")]
pub mod radio_loop;
#[cfg(feature = "companion")]
pub mod reply;
#[cfg(feature = "companion")]
pub mod service;
#[cfg(feature = "companion")]
pub mod systemd;
#[cfg(feature = "companion")]
pub mod transmitter;
