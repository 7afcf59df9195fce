//! One vehicle's mission from power-up to landing.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::MavMessage;

use crate::autopilot::Autopilot;
use crate::geo::Enu;
use crate::pair::{Record, wire};
use crate::planner::slots::Plan;
use crate::service::{self, Freshness, SlotService, Standing, Tolerance};
use crate::time::Instant;
use crate::transmitter::Transmitter;
use crate::transmitter::wire::MavMessage as RadioMessage;

use super::asked::AskedFor;
use super::cause::Cause;
use super::endurance::Endurance;
use super::following::Followers;
use super::ground::Ground;
use super::ground_station::GroundStation;
use super::itinerary::Itinerary;
use super::jitter::Jitter;
use super::lag::{AttitudeLag, PlaceLag};
use super::lean;
use super::notice::Notice;
use super::pace::Progress;
use super::phase::Phase;
use super::renewal::Renewal;
use super::settings::Settings;
use super::start::Start;

const HEARTBEAT_EVERY: Duration = Duration::from_secs(1);
/// Asked to end, the process gives its transmitter this long to confirm that it is off.
const LAST_OFF: Duration = Duration::from_secs(1);
/// And this long to the autopilot to level the vehicle and take back what only a companion that flies it may have changed.
const PUT_BACK: Duration = Duration::from_secs(10);

/// A message for one of the two links.
#[derive(Debug, Clone, PartialEq)]
pub enum Outgoing {
    /// To the autopilot link, from our own system and component.
    Autopilot(Box<MavMessage>),
    /// To the radio's own link, likewise ([`Settings::radio_apart`]).
    Radio(Box<MavMessage>),
    /// To the pair link.
    Pair(Box<wire::MavMessage>),
}

/// How the mission ended for this vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// Every slot flown, landed.
    Completed,
    /// Something went wrong; the first cause.
    Aborted(Cause),
    /// Ended by a signal.
    Interrupted,
}

/// How far an end that was asked for from outside has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stopping {
    No,
    /// J: as soon as I is off (S3).
    Wanted,
    /// Silent and hands off since then.
    Since(Instant),
    /// The process may end.
    Over,
}

/// Owns the machines below it (autopilot, pair service with its transmitter) and drives them by the phase of the flight.
///
/// # Calling contract
/// Feed it what happens, at the instant at which it happens: `handle_autopilot`, `handle_pair`, `handle_radio`,
/// `handle_radio_link`, `handle_report`, `handle_plan`, `handle_motion`, `handle_timeout`, `shutdown`. After each, drain
/// `poll_record`, `poll_transmit`, `poll_notice` and `poll_question`, ask `outcome` whether the process may end, and call `handle_timeout` at
/// `poll_timeout`, which any call may have moved. Everything happens in these calls: if nobody calls, nothing is sent
/// (F3). `now` never goes back.
///
/// Every input ends in the service's decision on power, so that a fault silences the transmitter at the message that
/// shows it (S4).
#[derive(Debug, Clone)]
pub struct Executive {
    pub(super) settings: Settings,
    pub(super) autopilot: Autopilot,
    pub(super) service: SlotService,
    pub(super) phase: Phase,
    pub(super) lag: AttitudeLag,
    pub(super) place_lag: PlaceLag,
    pub(super) jitter: Jitter,
    pub(super) progress: Progress,
    /// What is on disk of the operator's orders, as far as a disk takes it.
    pub(super) recorded: Record,
    pub(super) plan: Option<Plan>,
    pub(super) itinerary: Option<Itinerary>,
    pub(super) home_enu_m: Option<Enu>,
    pub(super) ground: Ground,
    pub(super) endurance: Endurance,
    pub(super) ground_station: GroundStation,
    pub(super) followers: Followers,
    pub(super) renewal: Renewal,
    /// Operator's commands that are to be answered.
    pub(super) asked_for: AskedFor,
    pub(super) abort_cause: Option<Cause>,
    pub(super) outcome: Option<Outcome>,
    pub(super) stopping: Stopping,
    next_tick: Instant,
    next_heartbeat: Instant,
    notices: VecDeque<Notice>,
    /// Commands refused, by the system that is no operator.
    pub(super) strangers: BTreeMap<u8, u64>,
    /// The HEARTBEAT for the radio's own link.
    radio_heartbeat: Option<MavMessage>,
    /// Messages of our own for the autopilot link.
    pub(super) outbox: VecDeque<MavMessage>,
}

impl Executive {
    /// An executive that has heard nothing yet.
    #[must_use]
    pub fn new(settings: Settings, transmitter: Transmitter, now: Instant) -> Self {
        let service = service::Settings {
            pair: settings.pair.clone(),
            ceilings: settings.ceilings,
            emission_authorised: settings.emission_authorised,
            freshness: Freshness {
                limit: settings.autopilot.freshness,
                scheduling_allowance: settings.autopilot.scheduling_allowance,
            },
        };
        let tolerance = Tolerance::for_jitter(settings.jitter.std_rad);
        let start = Start::new(settings.start_unasked, settings.start_utc, settings.pair.orders.spent, now);
        Self {
            autopilot: Autopilot::new(settings.autopilot.clone(), now),
            service: SlotService::new(service, transmitter, tolerance, now),
            phase: Phase::Connecting,
            lag: AttitudeLag::default(),
            place_lag: PlaceLag::default(),
            jitter: Jitter::new(settings.jitter),
            progress: Progress::new(settings.limits[settings.role].speed_m_s, settings.replanner.is_some()),
            recorded: settings.pair.orders,
            plan: None,
            itinerary: None,
            home_enu_m: None,
            ground: Ground::new(start),
            endurance: Endurance::new(settings.battery),
            ground_station: GroundStation::new(now),
            followers: Followers::new(settings.following.as_deref(), now),
            renewal: Renewal::default(),
            asked_for: AskedFor::default(),
            abort_cause: None,
            outcome: None,
            stopping: Stopping::No,
            next_tick: now,
            next_heartbeat: now,
            notices: VecDeque::new(),
            strangers: BTreeMap::new(),
            radio_heartbeat: None,
            outbox: VecDeque::new(),
            settings,
        }
    }

    /// The plan, made elsewhere (planning never blocks the loop).
    pub fn handle_plan(&mut self, plan: Plan) {
        self.notice(Notice::Planned(plan.slots.len()));
        let tolerance = self.ground_station.tolerance(self.settings.jitter.std_rad);
        if let Some(leans) = lean::told(&plan, self.settings.role, tolerance) {
            self.notice(Notice::MayLean(leans));
        }
        self.ground.judge_plan(&plan, &self.settings, tolerance);
        self.plan = Some(plan);
    }

    /// A message from the autopilot link, whoever on it sent it.
    pub fn handle_autopilot(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        self.autopilot.handle_message(header, message, now);
        if !self.settings.radio_apart {
            self.service.handle_radio(header, message, now);
        }
        self.hear_of_movers(header, message, now);
        self.handle_operator(header, message, now);
        self.handle_parameters(header, message);
        self.handle_files(header, message, now);
        self.react(now);
    }

    /// The radio's own message, from the autopilot link: where the radio has a link of its own, nobody's.
    pub fn handle_radio(&mut self, header: MavHeader, message: &RadioMessage, now: Instant) {
        if !self.settings.radio_apart {
            self.handle_report(header, message, now);
        }
    }

    /// A message of the common dialect from the radio's own link.
    pub fn handle_radio_link(&mut self, header: MavHeader, message: &MavMessage, now: Instant) {
        self.service.handle_radio(header, message, now);
        self.react(now);
    }

    /// The radio's own message, from the radio's own link.
    pub fn handle_report(&mut self, header: MavHeader, message: &RadioMessage, now: Instant) {
        self.service.handle_report(header, message, now);
        self.react(now);
    }

    /// A message from the pair link.
    pub fn handle_pair(&mut self, message: &wire::MavMessage, now: Instant) {
        self.service.handle_pair(message, now);
        self.react(now);
    }

    /// Does what is due at `now`.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.autopilot.handle_timeout(now);
        self.service.handle_timeout(now);
        self.react(now);
        if self.next_tick <= now {
            let period = Duration::from_secs_f64(1.0 / self.settings.autopilot.rate_hz);
            self.next_tick = (self.next_tick + period).max(now);
            self.feed_setpoint(now);
            self.show(now);
        }
        if self.next_heartbeat <= now {
            self.next_heartbeat = now + HEARTBEAT_EVERY;
            let heartbeat = self.heartbeat();
            self.radio_heartbeat = self.settings.radio_apart.then(|| heartbeat.clone());
            self.outbox.push_back(heartbeat);
        }
    }

    /// When `handle_timeout` must be called next, and why.
    #[must_use]
    pub fn poll_timeout(&self) -> (Instant, &'static str) {
        let own = [(self.next_tick, "tick"), (self.next_heartbeat, "heartbeat"), self.service.poll_timeout()];
        own.into_iter().chain(self.autopilot.poll_timeout()).min_by_key(|(at, _)| *at).unwrap_or(own[0])
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<Outgoing> {
        // The service first: nothing may delay an off.
        let service = self.service.poll_transmit().map(|outgoing| match outgoing {
            service::Outgoing::Radio(message) if self.settings.radio_apart => Outgoing::Radio(message),
            service::Outgoing::Radio(message) => Outgoing::Autopilot(message),
            service::Outgoing::Pair(message) => Outgoing::Pair(message),
        });
        service
            .or_else(|| self.radio_heartbeat.take().map(|m| Outgoing::Radio(Box::new(m))))
            .or_else(|| self.outbox.pop_front().map(|m| Outgoing::Autopilot(Box::new(m))))
            .or_else(|| self.autopilot.poll_transmit().map(|m| Outgoing::Autopilot(Box::new(m))))
    }

    /// The next line for the log; it has gone out as STATUSTEXT already.
    pub fn poll_notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    /// Of the operator's orders, what a later process must be given as [`orders`](crate::pair::Settings::orders), if that
    /// has changed. To be kept before messages are sent, as far as the disk allows; then [`Self::handle_recorded`].
    pub fn poll_record(&mut self) -> Option<Record> {
        self.service.orders_mut().poll_record()
    }

    /// This record is on disk, or the disk did not take it.
    pub fn handle_recorded(&mut self, record: Record, now: Instant) {
        self.recorded = record;
        self.arm_once_recorded(now);
    }

    /// The process is asked to end: silent, the peer told, the autopilot left in its own hold, level, and with its own
    /// parameters. J first lets I go off, for a lease's length at most.
    pub fn shutdown(&mut self, now: Instant) {
        if self.is_stopping() {
            return;
        }
        if !self.service.shut_down(now) {
            self.stopping = Stopping::Wanted;
            return;
        }
        self.stopping = Stopping::Since(now);
        if self.autopilot.in_control() {
            self.autopilot.hold(now);
        } else {
            self.autopilot.release(now);
        }
        self.notice(Notice::Ending);
    }

    /// Set once the process may end: landed, or asked to end, known to be silent (or a second has passed), and nothing left
    /// behind in the autopilot (or ten have, which is said).
    #[must_use]
    pub fn outcome(&self) -> Option<Outcome> {
        match self.stopping {
            Stopping::No | Stopping::Wanted => self.outcome.clone(),
            Stopping::Since(_) => None,
            Stopping::Over => Some(self.outcome.clone().unwrap_or(Outcome::Interrupted)),
        }
    }

    /// Whether an end that was asked for has begun: nothing is flown or radiated from here any more.
    pub(super) fn is_stopping(&self) -> bool {
        matches!(self.stopping, Stopping::Since(_) | Stopping::Over)
    }

    fn stop(&mut self, since: Instant, now: Instant) {
        let waited = now.saturating_since(since);
        let silent = waited > Duration::ZERO && self.service.interlock().is_off(now);
        // The peer, too, is to know that it is put back.
        let untold = self.service.says_guarding() || self.service.poll_timeout().0 <= now;
        let guarding = self.autopilot.is_guarding();
        if (silent || waited >= LAST_OFF) && (!guarding && !untold || waited >= PUT_BACK) {
            self.stopping = Stopping::Over;
            if guarding {
                self.notice(Notice::LeftGuarded(self.settings.role));
            }
        }
    }

    /// The MAVLink system and component we speak as: the autopilot's system, once it is found.
    #[must_use]
    pub fn own(&self) -> (u8, u8) {
        self.settings.own
    }

    /// A name of the present phase, for logs and progress.
    #[must_use]
    pub fn phase_name(&self) -> &'static str {
        self.phase.name(self.service.slot().is_some())
    }

    /// What the pair's service is doing, likewise.
    #[must_use]
    pub fn standing(&self) -> Standing {
        self.service.standing()
    }

    pub(super) fn notice(&mut self, notice: Notice) {
        self.autopilot.statustext(notice.severity(), &notice.to_string());
        self.notices.push_back(notice);
    }

    /// Takes in what has changed, lets the phase act on it, then lets the service decide on power.
    pub(super) fn react(&mut self, now: Instant) {
        while let Some(event) = self.autopilot.poll_event() {
            self.on_autopilot(event, now);
        }
        let utc = self.autopilot.utc(now);
        self.service.set_permitted(self.settings.permission.holds(utc));
        self.service.set_renewing(self.renews());
        self.service.advance(utc, now);
        self.take_service_events(now);
        if self.stopping == Stopping::Wanted {
            self.shutdown(now);
        }
        match self.stopping {
            Stopping::No | Stopping::Wanted => self.step(now),
            Stopping::Since(since) => self.stop(since, now),
            Stopping::Over => {}
        }
        let vehicle = self.vehicle(now);
        self.service.decide(&vehicle, now);
        self.take_service_events(now);
        self.answer_operator(now);
    }

    fn take_service_events(&mut self, now: Instant) {
        while let Some(event) = self.service.poll_event() {
            self.on_service(event, now);
        }
    }

    /// No word against the estimate: an autopilot that does not report its health is judged by its state's freshness.
    pub(super) fn estimator_ok(&self) -> bool {
        self.autopilot.state().estimator.is_none_or(|estimator| estimator.value.is_ok())
    }

    /// The autopilot's newest position.
    pub(super) fn position(&self) -> Option<Enu> {
        self.autopilot.state().position_enu_m.map(|p| p.value)
    }
}
