//! A fake device on its line: what it is told over TCP, when that is done, and what stands between.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::Notify;

use crate::desk::simulation::{Manners, OTHER_DB, RadioFault, SimulatedDevice};
use crate::link::Clock;
use crate::time::Instant;

use super::kind::{Grid, Kind, Table};

/// The device and its front panel.
#[derive(Debug)]
struct State {
    device: SimulatedDevice,
    setting: f64,
    on: bool,
    manners: Manners,
}

/// The device is dead.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Dead;

/// See the module. Times are the flight's.
#[derive(Debug)]
pub(super) struct Bench {
    kind: Kind,
    table: Table,
    clock: Clock,
    state: Mutex<State>,
    changed: Notify,
    /// Requests are heard in the order of their arrival, over whichever connection: none overtakes one that the device, stopped,
    /// has not heard yet.
    turn: tokio::sync::Mutex<()>,
}

impl Bench {
    pub fn new(kind: Kind, table: Table, mut device: SimulatedDevice, clock: Clock) -> Arc<Self> {
        let setting = table.grid().least;
        // What has no off goes on as it was left.
        let on = kind.has_no_off();
        if on {
            device.tell(table.dbm(setting), clock.now().since_start());
        }
        Arc::new(Self {
            kind,
            table,
            clock,
            state: Mutex::new(State { device, setting, on, manners: Manners::Good }),
            changed: Notify::new(),
            turn: tokio::sync::Mutex::new(()),
        })
    }

    pub fn kind(&self) -> Kind {
        self.kind
    }

    fn now(&self) -> Duration {
        self.clock.now().since_start()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Looks at the device, as of now.
    pub fn look<T>(&self, look: impl FnOnce(&SimulatedDevice) -> T) -> T {
        let mut state = self.state();
        state.device.advance(self.now());
        look(&state.device)
    }

    /// Its host has died or stopped, or goes on.
    pub fn lose_host(&self, lost: bool) {
        let now = self.now();
        self.state().device.lose_host(lost, now);
        self.changed.notify_waiters();
    }

    /// What befalls the device or its line begins (`on`), or is over.
    pub fn befall(&self, fault: RadioFault, on: bool) {
        let now = self.now();
        {
            let mut state = self.state();
            let State { device, manners, .. } = &mut *state;
            device.advance(now);
            manners.befall(device, fault, on, now);
        }
        self.changed.notify_waiters();
    }

    /// Everything in order again, for the end of a flight; a dead control stays dead.
    pub fn mend(&self) {
        self.lose_host(false);
        self.befall(RadioFault::DeviceStop, false);
        self.befall(RadioFault::DeviceLoss, false);
    }

    /// Until its control dies.
    pub async fn died(&self) {
        let _: Result<(), Dead> = self.until(|_| false).await;
    }

    /// Waits until the state is so.
    async fn until(&self, ready: impl Fn(&State) -> bool) -> Result<(), Dead> {
        loop {
            // Before the look: what changes in between is not missed.
            let changed = self.changed.notified();
            let next = {
                let mut state = self.state();
                state.device.advance(self.now());
                if state.device.is_dead() {
                    return Err(Dead);
                }
                if ready(&state) {
                    return Ok(());
                }
                state.device.next()
            };
            match next {
                Some(at) => tokio::select! {
                    () = changed => {}
                    () = self.clock.sleep_until(Instant::from_start(at)) => {}
                },
                None => changed.await,
            }
        }
    }

    /// Its kill line is driven.
    pub fn drive(&self, through: bool) {
        let now = self.now();
        self.state().device.drive(through, now);
        self.changed.notify_waiters();
    }

    /// Hears a request and carries it out; its answer, once that is done and can be heard.
    pub async fn answer(&self, asked: &str) -> Result<String, Dead> {
        let (answer, setting, on) = self.obey(super::protocol::request(self.kind, asked)).await?;
        Ok(super::protocol::answer(self.kind, answer, setting, on))
    }

    /// Carries out a request, or refuses it; what becomes of it with the setting, and whether it is on, once that is done and
    /// can be heard.
    pub async fn obey(&self, request: Result<Request, Answer>) -> Result<(Answer, f64, bool), Dead> {
        let answer = {
            let _turn = self.turn.lock().await;
            self.until(|state| state.device.runs() && state.manners != Manners::Cut).await?;
            let mut state = self.state();
            match request {
                Ok(Request::Set(_) | Request::Turn(_)) if state.manners == Manners::Refuses => {
                    Answer::Refused
                }
                Ok(request) => {
                    let answer = self.carry_out(request, &mut state);
                    let dbm = state.on.then(|| self.table.dbm(state.setting)).flatten();
                    state.device.tell(dbm, self.now());
                    answer
                }
                Err(refusal) => refusal,
            }
        };
        let heard = |manners| !matches!(manners, Manners::Cut | Manners::Mute);
        self.until(|state| state.device.runs() && state.device.is_done() && heard(state.manners)).await?;
        let state = self.state();
        let answer = if state.manners == Manners::Garbled { Answer::Garbage } else { answer };
        Ok((answer, state.setting, state.device.power_dbm().is_some()))
    }

    /// The setting that a device takes, which is told this one.
    fn given(&self, setting: f64, manners: Manners) -> f64 {
        let Grid { least, most, step, attenuates } = self.table.grid();
        let louder = (OTHER_DB / step).ceil() * step;
        match (manners, attenuates) {
            (Manners::Louder, true) => (setting - louder).max(least),
            (Manners::Louder, false) => (setting + louder).min(most),
            _ => setting,
        }
    }

    fn carry_out(&self, request: Request, state: &mut State) -> Answer {
        match request {
            Request::Set(setting) if self.table.dbm(setting).is_some() => {
                state.setting = self.given(setting, state.manners);
                // An attenuator has nothing else to turn it on.
                state.on |= self.kind.key() == Kind::Attenuator.key();
                Answer::Done
            }
            Request::Set(_) => Answer::Refused,
            Request::Turn(on) => {
                state.on = on;
                Answer::Done
            }
            Request::Setting => Answer::Setting,
            Request::State => Answer::State,
            Request::Say(text) => Answer::Text(text),
        }
    }
}

/// What a device can be asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Request {
    Set(f64),
    Turn(bool),
    /// The setting in force.
    Setting,
    /// Whether it is on.
    State,
    /// What it is.
    Say(&'static str),
}

/// What it answers, once it has done what it was told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Answer {
    Done,
    Refused,
    /// Nothing that its documents have.
    Garbage,
    Setting,
    State,
    Text(&'static str),
}
