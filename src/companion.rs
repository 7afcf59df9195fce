//! The one event loop: drains what the executive wants sent, then takes one input, with no other task between.
//!
//! Planning runs on a thread of its own and arrives as an input. Setpoints are due at instants of the executive's
//! choosing; the loop sleeps until the earliest (never between two of them for a fixed length).

mod health;
pub mod orders_file;
pub mod settings;

use std::future::Future;
use std::path::PathBuf;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::sync::{oneshot, watch};
use tracing::{debug, error, info, warn};

use crate::link::clock::Hold;
use crate::link::{Aboard, Clock, Form, Frame, Link, LinkAddress, LinkConfig, LinkError, PairLink};
use crate::mission::following::Flown;
use crate::mission::{Executive, Notice, Outcome, Outgoing, Settings};
use crate::planner::following::Moved;
use crate::planner::slots::Plan;
use crate::role::Role;
use crate::systemd::Manager;
use crate::transmitter::Transmitter;
use orders_file::OrdersFile;

/// A deadline met later than this was missed: the process was not run.
pub(crate) const WOKEN_LATE: Duration = Duration::from_millis(5);
/// Messages taken before such a deadline.
pub(crate) const MOST_WAITING: usize = 64;

/// What a companion needs besides the executive's settings.
pub struct Companion {
    /// The executive's settings.
    pub settings: Settings,
    /// The transmitter's driver.
    pub transmitter: Transmitter,
    /// Link to the autopilot.
    pub autopilot: (LinkAddress, LinkConfig),
    /// Link to the transmitter, if it has one of its own.
    pub radio: Option<(LinkAddress, LinkConfig)>,
    /// Link to the other companion.
    pub pair: (LinkAddress, LinkConfig, Form),
    /// Keeps the operator's orders for the next process; `None`: there is none.
    pub orders: Option<OrdersFile>,
    /// Tells the ground station how this computer and this directory's disk fare; `None`: says nothing of them.
    pub computer: Option<PathBuf>,
    /// Who started this process, and its watchdog.
    pub manager: Manager,
    /// Where those that move are in the mission file, each time that it was edited and is to be looked at.
    pub edited: UnboundedReceiver<Result<Vec<Moved>, String>>,
    /// Is told what both fly, and of I whether J flies the same, where motions are made anew; `None`: nobody wants to know.
    pub flown: Option<watch::Sender<Option<(Flown, bool)>>>,
    /// Makes the plan; runs on a thread of its own.
    pub planner: Box<dyn FnOnce() -> Result<Plan, String> + Send>,
}

/// Why a companion could not run.
#[derive(Debug, thiserror::Error)]
pub enum CompanionError {
    /// A link could not be opened.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// There is no plan to fly.
    #[error("no plan: {0}")]
    Plan(String),
}

impl Companion {
    /// Runs until the mission is over or `stop` completes; silent in both cases.
    ///
    /// # Errors
    /// A link that cannot be opened, or no plan.
    pub async fn run(self, clock: Clock, stop: impl Future<Output = ()>) -> Result<Outcome, CompanionError> {
        let role = self.settings.role;
        let mut autopilot: Link<Aboard> =
            Link::open(self.autopilot.0, self.autopilot.1, clock.clone()).await?;
        let mut radio: Option<Link<Aboard>> = match self.radio {
            Some((address, config)) => Some(Link::open(address, config, clock.clone()).await?),
            None => None,
        };
        let mut pair = PairLink::open(self.pair.0, self.pair.1, self.pair.2, clock.clone()).await?;
        let mut executive = Executive::new(self.settings, self.transmitter, clock.now());
        let mut planning = Some(start_planning(self.planner, clock.hold()));
        let mut stop = std::pin::pin!(stop);
        let mut stopping = false;
        let (mut orders, mut recording) = (self.orders, None);
        let mut health = self.computer.and_then(|directory| {
            let watch = health::Watch::begin(directory);
            watch.map_err(|error| warn!(%error, "the ground hears nothing of this computer")).ok()
        });
        let (mut manager, mut edited) = (self.manager, self.edited);
        let (answer, mut answers) = tokio::sync::mpsc::unbounded_channel();
        let mut standing = Standing::default();
        loop {
            if let Some(record) = executive.poll_record() {
                match &mut orders {
                    Some(orders) => {
                        orders.keep(record);
                        // Where time is given out, a disk takes none of it.
                        recording = Some((record, clock.hold()));
                    }
                    None => executive.handle_recorded(record, clock.now()),
                }
            }
            while let Some(outgoing) = executive.poll_transmit() {
                match outgoing {
                    Outgoing::Autopilot(message) => {
                        autopilot.send(executive.own(), &Aboard::Common(*message))
                    }
                    Outgoing::Radio(message) => {
                        if let Some(radio) = &mut radio {
                            radio.send(executive.own(), &Aboard::Common(*message));
                        }
                    }
                    Outgoing::Pair(message) => pair.send(executive.own(), &message),
                }
            }
            while let Some((ticket, question)) = executive.poll_question() {
                let (answer, hold) = (answer.clone(), clock.hold());
                tokio::task::spawn_blocking(move || {
                    // Nobody waits for it once the companion ends.
                    let _ = answer.send((ticket, question.answer()));
                    // Where time is given out, a motion takes none of it.
                    drop(hold);
                });
            }
            while let Some(notice) = executive.poll_notice() {
                log(role, executive.phase_name(), &notice);
                standing.hear(&notice);
            }
            if let Some(text) = standing.news(role, executive.phase_name()) {
                manager.status(&text);
            }
            if let Some(flown) = &self.flown {
                let alike = executive.flies_alike(clock.now());
                flown.send_replace(executive.flown().map(|flown| (flown, alike)));
            }
            let (deadline, why) = executive.poll_timeout();
            if executive.outcome().is_some() {
                manager.stopping();
            }
            manager.turn(clock.now(), deadline);
            if let Some(outcome) = executive.outcome() {
                debug!("autopilot link: {}", autopilot.counters());
                debug!("pair link: {}", pair.counters());
                if let Some(radio) = &radio {
                    debug!("transmitter link: {}", radio.counters());
                }
                for (system, count) in executive.refused_commands() {
                    debug!(system, count, "commands of a system that is no operator were refused");
                }
                return Ok(outcome);
            }
            tokio::select! {
                biased;
                () = &mut stop, if !stopping => {
                    stopping = true;
                    manager.stopping();
                    executive.shutdown(clock.now());
                }
                // Deadlines before messages: no flood can hold up a setpoint.
                () = clock.sleep_until(deadline) => {
                    tracing::trace!(why, "timeout");
                    if clock.now() > deadline + WOKEN_LATE {
                        take_waiting(&mut executive, (&mut autopilot, &mut radio, &mut pair), &clock).await;
                    }
                    executive.handle_timeout(clock.now());
                }
                frame = autopilot.recv() => hear(&mut executive, &frame, &clock),
                frame = Link::recv_of(&mut radio) => hear_radio(&mut executive, &frame, &clock),
                record = orders_file::written(&mut orders) => {
                    recording.take_if(|(last, _)| *last == record);
                    executive.handle_recorded(record, clock.now());
                }
                Some((ticket, answer)) = answers.recv() => executive.handle_answer(ticket, answer, clock.now()),
                frame = pair.recv() => executive.handle_pair(&frame.message, clock.now()),
                Some(edited) = edited.recv() => executive.handle_file(edited, clock.now()),
                look = health::next(&mut health) => {
                    let status = health::message(&look, clock.utc());
                    autopilot.send(executive.own(), &Aboard::Common(status));
                }
                plan = planned(&mut planning) => {
                    executive.handle_plan(plan.map_err(CompanionError::Plan)?);
                    // The links were open before.
                    manager.ready();
                }
            }
        }
    }
}

/// What a service manager shows of a companion: its phase, and the last that it said of weight.
#[derive(Debug, Default)]
struct Standing {
    phase: &'static str,
    said: String,
    is_news: bool,
}

impl Standing {
    fn hear(&mut self, notice: &Notice) {
        if notice.severity() as u8 <= MavSeverity::MAV_SEVERITY_INFO as u8 {
            self.said = notice.to_string();
            self.is_news = true;
        }
    }

    /// In words, where anything has changed.
    fn news(&mut self, role: Role, phase: &'static str) -> Option<String> {
        if !std::mem::take(&mut self.is_news) && self.phase == phase {
            return None;
        }
        self.phase = phase;
        let said = if self.said.is_empty() { String::new() } else { format!("; {}", self.said) };
        Some(format!("vehicle {role}: {phase}{said}"))
    }
}

/// Takes what somebody aboard has said.
fn hear(executive: &mut Executive, frame: &Frame<Aboard>, clock: &Clock) {
    match &frame.message {
        Aboard::Common(message) => executive.handle_autopilot(frame.header, message, clock.now()),
        Aboard::Radio(message) => executive.handle_radio(frame.header, message.message(), clock.now()),
    }
}

/// Takes what has come over the radio's own link.
fn hear_radio(executive: &mut Executive, frame: &Frame<Aboard>, clock: &Clock) {
    match &frame.message {
        Aboard::Common(message) => executive.handle_radio_link(frame.header, message, clock.now()),
        Aboard::Radio(message) => executive.handle_report(frame.header, message.message(), clock.now()),
    }
}

/// Takes what has arrived meanwhile. A process that slept too long must not call state lost that waits at its door; a
/// bounded number, so that a flood cannot hold up a setpoint here either.
async fn take_waiting(
    executive: &mut Executive,
    (autopilot, radio, pair): (&mut Link<Aboard>, &mut Option<Link<Aboard>>, &mut PairLink),
    clock: &Clock,
) {
    for _ in 0..MOST_WAITING {
        tokio::select! {
            biased;
            frame = autopilot.recv() => hear(executive, &frame, clock),
            frame = Link::recv_of(radio) => hear_radio(executive, &frame, clock),
            frame = pair.recv() => executive.handle_pair(&frame.message, clock.now()),
            () = std::future::ready(()) => break,
        }
    }
}

fn start_planning(
    planner: Box<dyn FnOnce() -> Result<Plan, String> + Send>,
    hold: Hold,
) -> oneshot::Receiver<Result<Plan, String>> {
    let (sender, receiver) = oneshot::channel();
    std::thread::spawn(move || {
        // The receiver is gone if the companion has ended: nobody wants the plan then.
        let _ = sender.send(planner());
        // Where time is given out, a plan takes none of it.
        drop(hold);
    });
    receiver
}

/// The plan, once; never completes afterwards.
async fn planned(planning: &mut Option<oneshot::Receiver<Result<Plan, String>>>) -> Result<Plan, String> {
    match planning {
        Some(receiver) => {
            let plan =
                receiver.await.unwrap_or_else(|_| Err("the planner's thread ended without a plan".into()));
            *planning = None;
            plan
        }
        None => std::future::pending().await,
    }
}

fn log(role: Role, phase: &str, notice: &Notice) {
    let text = notice.to_string();
    match notice.severity() {
        MavSeverity::MAV_SEVERITY_EMERGENCY
        | MavSeverity::MAV_SEVERITY_ALERT
        | MavSeverity::MAV_SEVERITY_CRITICAL
        | MavSeverity::MAV_SEVERITY_ERROR => error!(%role, phase, "{text}"),
        MavSeverity::MAV_SEVERITY_WARNING => warn!(%role, phase, "{text}"),
        MavSeverity::MAV_SEVERITY_NOTICE | MavSeverity::MAV_SEVERITY_INFO => info!(%role, phase, "{text}"),
        MavSeverity::MAV_SEVERITY_DEBUG => debug!(%role, phase, "{text}"),
    }
}
