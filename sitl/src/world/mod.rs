//! Two vehicles in one air: they fly, radiate and are judged.

pub mod circumstances;
pub mod config;
pub mod excuse;
pub mod fault;
pub mod followed;
mod monitor;
mod radio;
mod receiver;
pub mod record;
pub mod report;
pub mod roaming;
pub mod scattering;
mod score;
mod trail;
pub mod turning;
pub mod violation;

use std::time::Duration;

use nalgebra::{UnitQuaternion, Vector3};
use serde::Serialize;

use crate::vehicle::autopilot::Mode;
use crate::vehicle::bias::Bias;
use crate::vehicle::transmitter::DevicePower;
use crate::vehicle::{TICKS_PER_SAMPLE, Vehicle, VehicleCounters, VehicleSnapshot, tick_time};
use circumstances::{Circumstances, Passage};
use config::{Error, Off, Reference, WorldConfig};
use excuse::Cause;
use fault::Fault;
use followed::{Flown, Followed};
use monitor::{Findings, Monitor, Seen};
use radio::Emitter;
use receiver::{Kind, Receiver};
use report::FlightReport;
use score::{PoseError, SlotScore};
use trail::{Step, Trail};
use turning::Openings;

/// Relative difference from the planned power that still protects (INTERFACES: "at its planned power").
const PLANNED_POWER_MARGIN: f64 = 0.01;
/// J's place among the vehicles.
const J: usize = 1;

/// The world at one instant.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Snapshot {
    /// Simulation time.
    pub now_s: f64,
    /// I and J.
    pub vehicles: [VehicleSnapshot; 2],
    /// Metres.
    pub separation_m: f64,
    /// In the last radio sample in which I radiated for a user; `None` while it does not.
    pub secrecy_rate_bps: Option<f64>,
    /// Violations so far.
    pub violations: usize,
}

/// The simulated world. No I/O, no clock: bytes and simulation time go in, frames come out.
///
/// The caller's loop: [`World::advance`] to the present simulation time, [`World::handle`] what has arrived (it is
/// taken to have arrived at the time last advanced to), send what [`World::poll_transmit`] gives until it gives no
/// more. Advancing in small or in large steps simulates the same.
#[derive(Debug, Clone)]
pub struct World {
    config: WorldConfig,
    vehicles: [Vehicle; 2],
    users: Vec<Receiver>,
    eavesdroppers: Vec<Receiver>,
    /// I's and J's poses in each slot, and the index of the slot's user.
    plans: Vec<([Reference; 2], usize)>,
    openings: Openings,
    followed: Followed,
    scores: Vec<SlotScore>,
    /// Samples of radiation in no slot of the plan.
    outside_slots: [u32; 2],
    monitor: Monitor,
    trails: [Trail; 2],
    secrecy_rate_bps: Option<f64>,
    now: Duration,
    ticks: u64,
}

impl World {
    /// A world at simulation time zero, both vehicles on the ground.
    ///
    /// # Errors
    /// The first value of the configuration that makes no world.
    pub fn new(config: WorldConfig) -> Result<Self, Error> {
        config.check()?;
        let vehicle = |k: usize| {
            Vehicle::new(
                config.vehicles[k].clone(),
                config.jitter,
                config.origin,
                config.utc_start_us,
                config.seed,
            )
        };
        let user_of = |name: &str| config.users.iter().position(|u| u.name == name).unwrap_or(0);
        let plans = config
            .slots
            .iter()
            .map(|s| ([Reference::from(&s.poses[0]), Reference::from(&s.poses[1])], user_of(&s.user)))
            .collect();
        Ok(Self {
            vehicles: [vehicle(0), vehicle(1)],
            users: Receiver::all(&config.users, Kind::User, config.fading.user, config.seed),
            eavesdroppers: Receiver::all(
                &config.eavesdroppers,
                Kind::Eavesdropper,
                config.fading.eavesdropper,
                config.seed,
            ),
            plans,
            openings: Openings::default(),
            followed: Followed::default(),
            scores: vec![SlotScore::default(); config.slots.len()],
            outside_slots: [0; 2],
            monitor: Monitor::default(),
            trails: Default::default(),
            secrecy_rate_bps: None,
            now: Duration::ZERO,
            ticks: 0,
            config,
        })
    }

    /// Bytes from a client of a vehicle (0 for I, 1 for J), on one of its links (0 is the companion's).
    pub fn handle(&mut self, vehicle: usize, link: usize, bytes: &[u8]) {
        let Some(target) = self.vehicles.get_mut(vehicle) else { return };
        let before = target.transmitter().emission();
        target.handle(link, bytes, self.now);
        let (ordered, after) = (target.take_order_to_fly(), target.transmitter().emission());
        if ordered {
            self.vehicles.iter_mut().for_each(Vehicle::operator_ordered);
        }
        if after != before {
            self.watch();
        }
    }

    /// Telemetry of a vehicle on a link from now on, for a ground station that waits to hear something.
    pub fn open_link(&mut self, vehicle: usize, link: usize) {
        if let Some(vehicle) = self.vehicles.get_mut(vehicle) {
            vehicle.open_link(link);
        }
    }

    /// The next MAVLink frame to send: vehicle, link, bytes.
    pub fn poll_transmit(&mut self) -> Option<(usize, usize, Vec<u8>)> {
        self.vehicles
            .iter_mut()
            .enumerate()
            .find_map(|(k, v)| v.poll_transmit().map(|(link, f)| (k, link, f)))
    }

    /// Simulates up to `to`, the time since the start. Going back does nothing.
    pub fn advance(&mut self, to: Duration) {
        loop {
            let tick = tick_time(self.ticks);
            let changes = self.vehicles.iter().filter_map(|v| v.transmitter().changes_at());
            if let Some(at) = changes.min().filter(|at| *at <= tick.min(to)) {
                self.now = self.now.max(at);
                self.vehicles.iter_mut().for_each(|v| v.transmitter_mut().expire(at));
                self.watch();
                continue;
            }
            if tick > to {
                break;
            }
            self.now = tick;
            if self.ticks.is_multiple_of(TICKS_PER_SAMPLE) {
                self.sample();
            }
            let before = self.vehicles.each_ref().map(|v| v.transmitter().emission());
            self.vehicles.iter_mut().for_each(|v| v.tick(tick));
            // A delayed command may have been carried out.
            if self.vehicles.each_ref().map(|v| v.transmitter().emission()) != before {
                self.watch();
            }
            self.ticks += 1;
        }
        self.now = self.now.max(to);
    }

    /// Simulation time since the start.
    #[must_use]
    pub fn now(&self) -> Duration {
        self.now
    }

    /// Makes something go wrong, now.
    pub fn inject(&mut self, fault: Fault) {
        let Some(vehicle) = self.vehicles.get_mut(fault.vehicle()) else { return };
        if fault.is_of_the_vehicle() {
            self.monitor.vehicle_fails(fault.vehicle(), self.now);
        }
        match fault {
            Fault::LinkLoss { vehicle: k, on } => {
                vehicle.cut_companion_link(on);
                self.monitor.world_link(k, if on { Passage::Cut } else { Passage::Good }, self.now);
            }
            Fault::LinkDegraded { vehicle: k, loss, delay_s } => {
                vehicle.degrade_companion_link(loss, delay_s);
                let whole = loss == 0.0 && delay_s == 0.0;
                self.monitor.world_link(k, if whole { Passage::Good } else { Passage::Impaired }, self.now);
            }
            Fault::RadioHop { vehicle: k, toward, manners } => {
                vehicle.trouble_radio_hop(toward, manners);
                let late = vehicle.radio_commands_arrive_by();
                self.monitor.radio_hop(k, vehicle.radio_hop_is_troubled(), late);
            }
            Fault::RadioHopFrozen { vehicle: k, toward, on } => {
                vehicle.freeze_radio_hop(toward, on);
                let late = vehicle.radio_commands_arrive_by();
                self.monitor.radio_hop(k, vehicle.radio_hop_is_troubled(), late);
            }
            Fault::GpsLoss { on, .. } => vehicle.lose_gps(on, self.now),
            Fault::EstimatorReset { jump_enu_m, .. } => vehicle.reset_estimator(jump_enu_m.into()),
            Fault::ClockJump { by_s, .. } => vehicle.jump_clock(by_s),
            Fault::ClockDrift { ppm, .. } => vehicle.let_clock_drift(ppm, self.now),
            Fault::TransmitterRestart { on, .. } => {
                vehicle.cut_radio_power(on, self.now);
                self.watch();
            }
            Fault::AutopilotRestart { .. } => vehicle.restart_autopilot(self.now),
            Fault::PilotMode { .. } => vehicle.pilot_takes_over(),
            Fault::EstimatorFailure { .. } => vehicle.fail_estimator(),
            Fault::WindStep { mean_enu_m_s, .. } => vehicle.set_wind(mean_enu_m_s.into()),
            Fault::RotorLoss { rotor, .. } => vehicle.lose_rotor(rotor),
            Fault::BatteryLow { charge, .. } => vehicle.set_battery(charge),
            Fault::BatteryWeak { times, .. } => vehicle.weaken_battery(times),
            Fault::BatteryLies { .. } => vehicle.freeze_battery_report(),
            Fault::TransmitterIgnoresExpiry { .. } => vehicle.transmitter_mut().endless = true,
            Fault::TransmitterStuck { .. } => vehicle.transmitter_mut().stuck = true,
            // Said to the monitor above.
            Fault::RadioFails { .. } => {}
            Fault::CompanionLost { vehicle } => self.monitor.companion_gone(vehicle, self.now),
        }
    }

    /// The companions are processes of a busy machine, whose clocks run faster than its own: S4, F2 and F3 leave them so
    /// much more time.
    pub fn allow_for_scheduling(&mut self, allowance: Duration) {
        self.monitor.allow_for_scheduling(allowance);
    }

    /// What the host knows of a vehicle's companion from now on; until it says something, all is well with it.
    pub fn set_circumstances(&mut self, vehicle: usize, circumstances: Circumstances) {
        if vehicle < self.vehicles.len() {
            self.monitor.tell(vehicle, circumstances, self.now);
        }
    }

    /// I's companion proposes that a slot opens at this UTC: by its clock as it has told it, else by its vehicle's. A plan whose
    /// vehicles turn on the air counts from there.
    pub fn propose(&mut self, slot: usize, opens_utc_us: u64) {
        let told = self.openings.time_of(opens_utc_us);
        let at = told.unwrap_or_else(|| self.vehicles[0].time_of(opens_utc_us, self.now));
        self.openings.propose(slot, at, &self.config.slots);
    }

    /// What both fly now in a slot whose motion is made anew while it is served, as I's companion has it.
    pub fn follow(&mut self, slot: usize, flown: Flown) {
        self.followed.tell(slot, flown, self.now);
    }

    /// I's companion tells the other one its UTC.
    pub fn hear_clock(&mut self, utc_us: u64) {
        self.openings.hear_clock(utc_us, self.now);
    }

    /// From now on a vehicle radiates what another device does, as its host says, and not what its own radio was told by MAVLink.
    pub fn set_device_power(&mut self, vehicle: usize, power: DevicePower) {
        let Some(target) = self.vehicles.get_mut(vehicle) else { return };
        let before = (target.transmitter().emission(), target.transmitter().is_out_of_order());
        target.transmitter_mut().radiate_by(power);
        if (target.transmitter().emission(), target.transmitter().is_out_of_order()) != before {
            self.watch();
        }
    }

    /// The slot that a vehicle's power command names, if the plan has it.
    fn slot_of(&self, vehicle: usize) -> Option<usize> {
        let emission = self.vehicles[vehicle].transmitter().emission()?;
        usize::try_from(emission.slot).ok().filter(|slot| *slot < self.plans.len())
    }

    /// What the plan has a vehicle do in a slot at an instant.
    fn reference(&self, slot: usize, vehicle: usize, at: Duration) -> Reference {
        let standing = self.plans[slot].0[vehicle];
        if let Some(flown) = self.followed.reference(slot, vehicle, at) {
            return flown;
        }
        match &self.config.slots[slot].turns {
            Some(turns) => self.openings.reference(slot, turns, standing, vehicle, at),
            None => standing,
        }
    }

    /// How far a vehicle in this pose is from where a slot has it at an instant, and where that is: as the newest motion has it, or of
    /// J the one before.
    fn judge(
        &self,
        newest: Reference,
        (slot, vehicle): (usize, usize),
        at: Duration,
        position: &Vector3<f64>,
        attitude: &UnitQuaternion<f64>,
    ) -> (Off, Reference) {
        let judged = |plan: Reference| (self.config.tolerance.judge(&plan, position, attitude), plan);
        let newest = judged(newest);
        let behind = (vehicle == J).then(|| self.followed.behind(slot, at)).flatten().map(judged);
        behind.filter(|(off, _)| *off < newest.0).unwrap_or(newest)
    }

    /// `of_i`: what the plan of I's slot asks of this vehicle.
    fn seen(&self, k: usize, of_i: Option<Reference>) -> Seen {
        let vehicle = &self.vehicles[k];
        let supposed = vehicle.supposed_position_enu_m();
        let slot = self.slot_of(k);
        let plan = slot.map(|s| self.reference(s, k, self.now));
        let mode = vehicle.mode();
        let power_w = vehicle.transmitter().power_w();
        let own = vehicle.own_attitude();
        let (off, error) = slot.zip(plan).map_or((Off::Much, (0.0, 0.0)), |(slot, plan)| {
            let (off, held_to) = self.judge(plan, (slot, k), self.now, &supposed, &own);
            let error = (supposed - held_to.position).norm();
            (off, (error, own.angle_to(&held_to.attitude).to_degrees()))
        });
        let turns_on = power_w.is_some() && !self.monitor.radiated(k);
        Seen {
            power_w,
            lasts: vehicle.transmitter().lasts(self.now),
            slot,
            plan,
            off,
            error,
            position: vehicle.position_enu_m(),
            supposed,
            home: vehicle.home_enu_m(),
            airborne: vehicle.airborne(),
            confined: vehicle.powered() && ![Mode::Position, Mode::Stabilize, Mode::Land].contains(&mode),
            estimate_ok: vehicle.estimate_ok(),
            powered: vehicle.powered(),
            radio: vehicle.transmitter().is_out_of_order().then_some(match vehicle.radio_expires() {
                true => Cause::RadioOutOfOrder,
                false => Cause::RadioWithoutExpiry,
            }),
            full_power: of_i.is_some_and(|plan| {
                let power_w = power_w.unwrap_or(0.0);
                let [least_w, most_w] =
                    [plan.power_w * (1.0 - PLANNED_POWER_MARGIN), plan.most_w * (1.0 + PLANNED_POWER_MARGIN)];
                (least_w..=most_w).contains(&power_w)
            }),
            begins_out: turns_on
                && slot.is_some_and(|slot| {
                    let late = self.monitor.command_is_late_by(k, self.now);
                    let judge = |step: &Step| {
                        let plan = self.reference(slot, k, step.at);
                        self.judge(plan, (slot, k), step.at, &step.position, &step.attitude).0
                    };
                    self.trails[k].was_out(off, judge, self.now, late)
                }),
        }
    }

    /// The monitor's look at this instant.
    fn watch(&mut self) -> [Seen; 2] {
        let slot = self.slot_of(0);
        let planned_w = |k: usize| slot.map(|slot| self.reference(slot, k, self.now));
        let [of_i, of_j] = [planned_w(0), planned_w(1)];
        let seen = [self.seen(0, of_i), self.seen(1, of_j)];
        let planned_silent = of_j.is_some_and(|plan| plan.power_w == 0.0);
        self.monitor.observe(
            self.now,
            &seen,
            [self.vehicles[0].traces(), self.vehicles[1].traces()],
            planned_silent,
            self.config.radio.max_power_w,
            &self.config.airspace,
        );
        seen
    }

    /// One radio sample: jitter, scattering, SINR, score.
    fn sample(&mut self) {
        for k in 0..2 {
            // While it radiates in pose, the angles that the body is meant to have are the plan's.
            let meant = self.slot_of(k).map(|s| self.reference(s, k, self.now)).filter(|plan| {
                let v = &self.vehicles[k];
                let off = self.config.tolerance.judge(plan, &v.own_position_enu_m(), &v.own_attitude());
                off == Off::Nothing
            });
            self.vehicles[k].sample(meant.map(|plan| plan.euler));
            let vehicle = &self.vehicles[k];
            self.trails[k].keep(self.now, vehicle.supposed_position_enu_m(), vehicle.own_attitude());
        }
        for receiver in self.users.iter_mut().chain(&mut self.eavesdroppers) {
            receiver.advance(self.now);
            if let Some(frame) = receiver.report(self.config.origin, self.now) {
                self.vehicles[0].relay(frame);
            }
        }
        let seen = self.watch();
        for (k, vehicle) in seen.iter().enumerate().filter(|(_, v)| v.power_w.is_some()) {
            self.score_emitter(k, vehicle);
        }
        self.secrecy_rate_bps = None;
        let (Some(power_i), Some(slot)) = (seen[0].power_w, seen[0].slot) else { return };
        let (i, j) = (self.emitter(0, power_i), self.emitter(1, seen[1].power_w.unwrap_or(0.0)));
        let user = self.plans[slot].1;
        let rate =
            radio::secrecy_rate_bps(&self.config.radio, &i, &j, &self.users[user], &self.eavesdroppers);
        self.secrecy_rate_bps = Some(rate);
        let score = &mut self.scores[slot];
        score.rate.add(rate);
    }

    /// A vehicle as it radiates.
    fn emitter(&self, k: usize, power_w: f64) -> Emitter<'_> {
        let vehicle = &self.vehicles[k];
        Emitter {
            vehicle: k,
            position_enu_m: vehicle.position_enu_m(),
            axis: vehicle.antenna_axis(),
            power_w,
            pattern: vehicle.pattern(),
        }
    }

    fn score_emitter(&mut self, k: usize, seen: &Seen) {
        let (Some(slot), Some(plan)) = (seen.slot, seen.plan) else {
            self.outside_slots[k] += 1;
            return;
        };
        let vehicle = &self.vehicles[k];
        let off_deg = |attitude: &UnitQuaternion<f64>| attitude.angle_to(&plan.attitude).to_degrees();
        let error = PoseError {
            position_m: (vehicle.position_enu_m() - plan.position).norm(),
            attitude_deg: off_deg(vehicle.attitude()),
            control_deg: off_deg(vehicle.nominal_attitude()),
        };
        let score = &mut self.scores[slot];
        score.radiated(k, error);
        if k == 1 && seen.off != Off::Nothing {
            score.jam_out_of_tolerance += 1;
        }
    }

    /// The world at this instant.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let distance = self.vehicles[0].position_enu_m() - self.vehicles[1].position_enu_m();
        Snapshot {
            now_s: self.now.as_secs_f64(),
            vehicles: [self.vehicles[0].snapshot(), self.vehicles[1].snapshot()],
            separation_m: distance.norm(),
            secrecy_rate_bps: self.secrecy_rate_bps,
            violations: self.monitor.violations.len(),
        }
    }

    /// What both are meant to do, as told last ([`World::follow`]).
    #[must_use]
    pub fn flown(&self) -> Option<Flown> {
        self.followed.last()
    }

    /// Where users and eavesdroppers truly are now, metres in mission ENU, in the order in which they were told.
    #[must_use]
    pub fn places(&self) -> [Vec<Vector3<f64>>; 2] {
        [&self.users, &self.eavesdroppers].map(|all| all.iter().map(|one| one.position_enu_m).collect())
    }

    /// By how much the truth is off what each vehicle believes, in this flight.
    #[must_use]
    pub fn biases(&self) -> [Bias; 2] {
        self.vehicles.each_ref().map(Vehicle::bias)
    }

    /// What each vehicle has counted.
    #[must_use]
    pub fn counters(&self) -> [VehicleCounters; 2] {
        [self.vehicles[0].counters(), self.vehicles[1].counters()]
    }

    /// The world's part of the flight document.
    #[must_use]
    pub fn report(&self) -> FlightReport {
        let Findings { violations, excused, measured } = self.monitor.findings(self.now);
        let scores = self.scores.iter().zip(&self.config.slots).enumerate();
        let slots: Vec<_> =
            scores.map(|(k, (score, plan))| score.report(plan, measured.unprotected_in(k))).collect();
        FlightReport {
            flight_s: self.now.as_secs_f64(),
            secrecy_volume_bits: slots.iter().map(|s| s.achieved_secrecy_rate_bps * s.radiated_s.i).sum(),
            on_air_s: slots.iter().map(|s| s.radiated_s.i).sum(),
            slots,
            outside_slots_s: self.outside_slots.map(score::seconds).into(),
            unprotected_s: measured.unprotected().as_secs_f64(),
            emitted_out_of_pose_s: measured.out_of_pose.map(|time| time.as_secs_f64()).into(),
            violations,
            excused,
            min_separation_m: self.monitor.min_separation_m,
            battery_left: self.vehicles.each_ref().map(|vehicle| vehicle.snapshot().battery).into(),
        }
    }
}
