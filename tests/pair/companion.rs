//! One companion as far as the pair's service goes: the service that flies, on a vehicle that is where it is told to be.

use std::time::Duration;

use mavlink::MavHeader;
use veilwing::pair::wire::{MavMessage, VeilwingFlags};
use veilwing::pair::{AskedSlot, Drifting, Order, Places};
use veilwing::role::Role;
use veilwing::service::{Event, Slot, SlotService, Vehicle};
use veilwing::time::Instant;

use super::clocks::Clocks;
use super::radio::Said;
use super::setup::{Flown, LEAD, TICK, system, vehicle};

#[derive(Debug, Clone)]
pub struct Companion {
    pub role: Role,
    pub clocks: Clocks,
    pub service: SlotService,
    /// Has given up, or come back in the air: takes no part.
    pub aborted: Option<String>,
    pub pose_lost: bool,
    /// No state comes from the autopilot since then.
    pub stale_since: Option<Instant>,
    /// What else is amiss with the vehicle.
    pub amiss: fn(&mut Vehicle),
    /// What the service had to say, where that is looked at.
    pub events: Option<Vec<Event>>,
    /// Slots given up or flown, for the counting: their numbers.
    pub finished: Vec<u16>,
    /// To take part as soon as the peer does not say any more that it has ended.
    pub joining: bool,
    /// What is flown; I: how often it has made poses anew.
    flown: Flown,
    poses_made: u32,
    /// A slot that was planned anew is agreed on.
    renewed: bool,
    /// The motion that it flies: its number, when it begins, and what each flew when it was asked for.
    pub flies: (u16, Instant, [u16; 2]),
    /// How many it may ask for yet, and those that it has made.
    pub to_ask: u16,
    /// From so long before the end of a slot's airtime.
    pub to_ask_from: Duration,
    made: Vec<(u16, Instant, [u16; 2])>,
    next_tick: Instant,
}

impl Companion {
    pub fn new(role: Role, clocks: Clocks, service: SlotService, flown: &Flown) -> Self {
        Self {
            flown: *flown,
            poses_made: 0,
            renewed: false,
            role,
            clocks,
            service,
            aborted: None,
            pose_lost: false,
            stale_since: None,
            amiss: |_| {},
            events: None,
            finished: Vec::new(),
            joining: true,
            flies: (0, Instant::ZERO, [0; 2]),
            to_ask: 0,
            to_ask_from: Duration::ZERO,
            made: Vec::new(),
            next_tick: Instant::ZERO,
        }
    }

    pub fn handle_pair(&mut self, message: &MavMessage, t: Duration) {
        self.service.handle_pair(message, self.clocks.local(t));
        self.react(t);
    }

    pub fn handle_radio(&mut self, said: &Said, t: Duration) {
        let header = MavHeader { system_id: system(self.role).into(), component_id: 68, sequence: 0 };
        said.reach(&mut self.service, header, self.clocks.local(t));
        self.react(t);
    }

    pub fn handle_timeout(&mut self, t: Duration) {
        let now = self.clocks.local(t);
        self.service.handle_timeout(now);
        self.next_tick = if self.next_tick <= now { now + TICK } else { self.next_tick };
        self.react(t);
    }

    /// True time of the next timeout.
    pub fn wake_at(&self) -> Duration {
        self.clocks.true_time(self.service.poll_timeout().0.min(self.next_tick))
    }

    /// The mission begins (again).
    pub fn begin(&mut self, t: Duration) {
        (self.aborted, self.pose_lost, self.joining) = (None, false, true);
        self.react(t);
    }

    pub fn order(&mut self, pause: bool, t: Duration) {
        let order = if pause { Order::Pause } else { Order::Continue };
        self.service.orders_mut().give(order, self.clocks.local(t));
        self.react(t);
    }

    /// How far it is turned from where its user is served, in radians: on the silent way from one to the next.
    pub fn off_user_rad(&self, t: Duration) -> f64 {
        let Some((slot, track)) = self.service.slot().and_then(|slot| Some((slot, slot.track.as_ref()?)))
        else {
            return 0.0;
        };
        let opens_at = slot.commitment.opens_at;
        let now = self.clocks.local(t);
        let served = now.clamp(slot.radiate_from, slot.radiate_until - Duration::from_nanos(1));
        let [here, there] = [now, served].map(|at| track.attitude(at.seconds_since(opens_at)));
        here.angle_to(&there)
    }

    /// J's power by the plan at this time, in watts.
    pub fn jammed_w(&self, flown: &Flown, t: Duration) -> f64 {
        let opens_at = self.service.slot().map(|slot| slot.commitment.opens_at);
        opens_at.map_or(0.0, |opens_at| flown.jammed_w(self.clocks.local(t).seconds_since(opens_at)))
    }

    pub fn abort(&mut self, cause: String, now: Instant) {
        if self.aborted.is_none() && !self.service.is_abandoning() {
            self.finished.push(self.service.slot_number());
            self.aborted = self.service.abandon(now).then_some(cause);
        }
    }

    /// Somebody who stays, from a little more than a step of the model on.
    fn places(&self, now: Instant) -> Places {
        let opens_at = self.service.slot().map_or(now, |slot| slot.commitment.opens_at);
        let begins = (now + Duration::from_millis(350)).saturating_since(opens_at);
        let mut places = Places::new(begins.as_millis() as u32);
        places.push(Drifting::default());
        places
    }

    fn react(&mut self, t: Duration) {
        let now = self.clocks.local(t);
        if self.joining && !self.service.peer().says(VeilwingFlags::VEILWING_FLAGS_ENDED) {
            self.joining = false;
            self.service.join(0, None, now);
        }
        let measures = self.service.slot().is_some() || self.service.slot_number() > 0;
        self.service.set_renewing(self.flown.renews == Some(self.role) && measures && !self.renewed);
        self.service.advance(Some(self.clocks.utc(t)), now);
        while let Some(event) = self.service.poll_event() {
            self.events.iter_mut().for_each(|events| events.push(event));
            match event {
                Event::Over(slot, _) => self.finished.push(slot),
                Event::AllOver => self.joining = true,
                Event::Agreed(commitment) => self.renewed |= commitment.slot > 0,
                Event::GiveUp(why) => self.abort(format!("{why:?}"), now),
                Event::PlanMotion => {
                    let Some(asked) = self.service.asked_motion().copied() else { continue };
                    self.made.push((asked.number, asked.begins_at, asked.from));
                    let [i, j] = asked.from.map(u64::from);
                    self.service.motion_planned(
                        asked.number,
                        Some(u64::from(asked.number) << 32 | i << 16 | j),
                        now,
                    );
                }
                // Poses are numbers too, which the places carry: I makes others each time.
                Event::PlanSlot(slot, asked) => {
                    let asked = asked.unwrap_or_else(|| {
                        self.poses_made += 1;
                        AskedSlot { proposal: 0, slot, places: Places::new(self.poses_made) }
                    });
                    let terms = self.flown.terms_anew(slot, asked.places.begins_ms);
                    self.service.slot_planned(&asked, terms.map(|terms| vec![terms]), now);
                }
                // One that it has not made would be a motion of nobody's.
                Event::TakeUp(number) => {
                    let made = self.made.iter().find(|(made, ..)| *made == number);
                    self.flies = made.copied().unwrap_or((u16::MAX, now, [0; 2]));
                }
                Event::Abandoned => self.aborted = Some("once the other was off".into()),
                _ => {}
            }
        }
        let late = |slot: &Slot| now + self.to_ask_from >= slot.radiate_until;
        if self.to_ask > 0 && self.service.slot().is_some_and(late) && self.service.may_ask_motion(now) {
            self.to_ask -= 1;
            self.service.ask_motion(self.places(now), now);
            return self.react(t);
        }
        let slot = self.service.slot();
        let on_its_way = |slot: &Slot| !slot.carried_on && now < slot.commitment.leaves_at + LEAD / 2;
        let arrived = !slot.is_some_and(on_its_way);
        let since = self.stale_since.unwrap_or(now);
        let here = vehicle(self.role, slot, since, self.pose_lost);
        let mut here = Vehicle { arrived, at_rest: arrived, ended: self.aborted.is_some(), ..here };
        (self.amiss)(&mut here);
        self.service.decide(&here, now);
    }
}
