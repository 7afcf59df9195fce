//! What goes wrong with a vehicle.

use std::time::Duration;

use nalgebra::Vector3;

use super::Vehicle;
use super::autopilot::Autopilot;
use super::radio_hop::{Manners, Toward};

impl Vehicle {
    pub(crate) fn cut_companion_link(&mut self, down: bool) {
        self.link.down = down;
    }

    pub(crate) fn degrade_companion_link(&mut self, loss: f64, delay_s: f64) {
        self.link.degrade(loss, Duration::try_from_secs_f64(delay_s).unwrap_or_default());
    }

    pub(crate) fn trouble_radio_hop(&mut self, toward: Toward, manners: Manners) {
        self.hop.behave(toward, manners);
    }

    pub(crate) fn freeze_radio_hop(&mut self, toward: Toward, frozen: bool) {
        self.hop.freeze(toward, frozen);
    }

    pub(crate) fn radio_hop_is_troubled(&self) -> bool {
        self.hop.is_troubled()
    }

    pub(crate) fn radio_commands_arrive_by(&self) -> Option<Duration> {
        self.hop.commands_arrive_by()
    }

    pub(crate) fn pilot_takes_over(&mut self) {
        self.autopilot.pilot_takes_over(&mut self.router);
    }

    pub(crate) fn fail_estimator(&mut self) {
        self.estimator_failed = true;
    }

    pub(crate) fn reset_estimator(&mut self, jump_enu_m: Vector3<f64>) {
        self.estimator.reset(jump_enu_m);
    }

    pub(crate) fn lose_gps(&mut self, lost: bool, now: Duration) {
        self.estimator.set_gps(lost, now);
    }

    pub(crate) fn set_wind(&mut self, mean_enu_m_s: Vector3<f64>) {
        self.wind.set_mean(mean_enu_m_s);
    }

    pub(crate) fn lose_rotor(&mut self, rotor: usize) {
        self.dynamics.rotors.lose(rotor);
        if self.autopilot.drops_lost_rotors() {
            self.controller.drop_rotor(rotor);
        } else {
            self.crippled = true;
        }
    }

    pub(crate) fn set_battery(&mut self, charge: f64) {
        self.battery = charge.clamp(0.0, 1.0);
    }

    pub(crate) fn weaken_battery(&mut self, times: f64) {
        self.drain_per_s *= times.max(0.0);
    }

    pub(crate) fn freeze_battery_report(&mut self) {
        self.battery_said = Some(self.battery);
    }

    pub(crate) fn jump_clock(&mut self, by_s: f64) {
        self.autopilot.jump_clock(by_s);
    }

    pub(crate) fn let_clock_drift(&mut self, ppm: f64, now: Duration) {
        self.autopilot.let_clock_drift(ppm, now);
    }

    pub(crate) fn cut_radio_power(&mut self, cut: bool, now: Duration) {
        match cut {
            true => self.transmitter.lose_power(),
            false => self.transmitter.start(now),
        }
    }

    /// The autopilot starts afresh: its motors stop, what it was told since power-on is forgotten, its parameters and
    /// the vehicle's motion stay.
    pub(crate) fn restart_autopilot(&mut self, now: Duration) {
        let mut fresh = Autopilot::new(&self.config, self.mission, self.utc_start_us);
        fresh.boot(&self.autopilot, self.mission, &self.sensed(now));
        self.autopilot = fresh;
    }
}
