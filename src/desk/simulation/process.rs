//! One companion as its operating system would run it: its clock, its codecs, and whether it is running at all.

use std::collections::VecDeque;
use std::time::Duration;

use crate::companion::settings::{pair_form, settings, transmitter_settings};
use crate::config::{Mission, Vehicle};
use crate::link::codec::{Decoder, Encoder};
use crate::link::{Aboard, Envelope, Form};
use crate::mission::Executive;
use crate::mission::following::{Answer, Ticket};
use crate::pair::Record;
use crate::planner::slots::Plan;
use crate::role::Role;
use crate::service::Standing;
use crate::time::Instant;
use crate::transmitter::Transmitter;

use super::reads_at_start;

/// What a companion is given.
#[derive(Debug, Clone)]
pub struct Given {
    /// Its copy of the mission.
    pub mission: Mission,
    /// The plan it made.
    pub plan: Plan,
    /// Its vehicle file.
    pub vehicle: Vehicle,
}

/// A companion process.
#[derive(Debug)]
pub(super) struct Process {
    pub executive: Executive,
    pub encoder: Encoder,
    /// Of the link that the radio has of its own, which counts its own frames.
    pub to_radio: Encoder,
    from_vehicle: Decoder<Aboard>,
    from_radio: Decoder<Aboard>,
    pub from_peer: Decoder<Envelope>,
    /// In which form it speaks to its peer.
    pub form: Form,
    /// Stopped by a signal: it does nothing, and its sockets fill up.
    pub frozen: bool,
    /// Its phase and what its service is doing, as an observer was last told.
    pub stands: Option<(&'static str, Standing)>,
    /// What it is planning: made at this time of its clock.
    pub planning: VecDeque<(Instant, Ticket, Answer)>,
    /// The simulation time at which it wants to be called, as it said when it was last called.
    pub wakes_at: Duration,
    role: Role,
    /// Simulation time of its start.
    began: Duration,
}

impl Process {
    /// A process that starts at `now`, with its plan made. `start`: unasked, and the orders on record.
    pub fn start(given: &Given, role: Role, boot_id: u32, start: (bool, Record), now: Duration) -> Self {
        let (start_unasked, orders) = start;
        let mut settings = settings(&given.mission, &given.vehicle, boot_id, start_unasked);
        settings.pair.orders = orders;
        let started = Instant::from_start(reads_at_start(role));
        let transmitter = Transmitter::new(transmitter_settings(&given.vehicle, boot_id), started);
        let mut executive = Executive::new(settings, transmitter, started);
        executive.handle_plan(given.plan.clone());
        Self {
            executive,
            encoder: Encoder::default(),
            to_radio: Encoder::default(),
            from_vehicle: Decoder::default(),
            from_radio: Decoder::default(),
            from_peer: Decoder::default(),
            form: pair_form(&given.vehicle),
            frozen: false,
            stands: None,
            planning: VecDeque::new(),
            wakes_at: now,
            role,
            began: now,
        }
    }

    /// What reads the datagrams of the radio's own link, or of the vehicle's.
    pub fn aboard(&mut self, radio: bool) -> &mut Decoder<Aboard> {
        if radio { &mut self.from_radio } else { &mut self.from_vehicle }
    }

    /// What its clock reads at simulation time `now`.
    pub fn instant(&self, now: Duration) -> Instant {
        Instant::from_start(now.saturating_sub(self.began) + reads_at_start(self.role))
    }

    /// The simulation time at which its clock reads `instant`.
    pub fn simulation_time(&self, instant: Instant) -> Duration {
        instant.since_start().saturating_sub(reads_at_start(self.role)) + self.began
    }
}
