//! A radio's device, as its host finds it: it does what it is told after a while, may stop or die, and goes on radiating
//! meanwhile. One device for virtual and for real time: it is told the time.

use std::time::Duration;

/// What a device is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceModel {
    /// From an off to silence.
    pub off: Duration,
    /// From an order to another power, or from off, to that power; meanwhile it radiates as before.
    pub change: Duration,
    /// Its supply is cut by itself this long after its host has died or stopped; `None`: never.
    pub dead: Option<Duration>,
    /// It radiates on when its own control dies.
    pub outlives_control: bool,
}

/// What takes its orders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Control {
    Runs,
    /// Since then.
    Stopped(Duration),
    Dead,
}

/// The device.
#[derive(Debug, Clone)]
pub struct SimulatedDevice {
    model: DeviceModel,
    radiates_dbm: Option<f64>,
    /// What it is about to do, and when that is done.
    turn: Option<(Duration, Option<f64>)>,
    control: Control,
    /// Its host has been dead or stopped since.
    host_lost_at: Option<Duration>,
    /// From then on nobody's orders explain what it radiates, and whether what failed is in order again.
    astray: Option<(Duration, bool)>,
    /// Every change of what it radiates, since the beginning.
    radiated: Vec<(Duration, Option<f64>)>,
}

impl SimulatedDevice {
    /// One that is silent.
    #[must_use]
    pub fn new(model: DeviceModel) -> Self {
        Self {
            model,
            radiates_dbm: None,
            turn: None,
            control: Control::Runs,
            host_lost_at: None,
            astray: None,
            radiated: Vec::new(),
        }
    }

    /// What it is.
    #[must_use]
    pub fn model(&self) -> DeviceModel {
        self.model
    }

    /// What it radiates.
    #[must_use]
    pub fn power_dbm(&self) -> Option<f64> {
        self.radiates_dbm
    }

    /// Every change of what it radiates so far, with its time.
    #[must_use]
    pub fn radiated(&self) -> &[(Duration, Option<f64>)] {
        &self.radiated
    }

    /// Whether its control takes orders.
    #[must_use]
    pub fn runs(&self) -> bool {
        self.control == Control::Runs
    }

    /// Whether its control is dead.
    #[must_use]
    pub fn is_dead(&self) -> bool {
        self.control == Control::Dead
    }

    /// Whether it has done what it was told last.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.turn.is_none()
    }

    /// Whether what it radiates is explained by nobody's orders: it, its line or its host has failed.
    #[must_use]
    pub fn is_astray(&self, now: Duration) -> bool {
        self.astray.is_some_and(|(from, _)| from <= now)
    }

    /// Tells it what to radiate; the newest order counts. What it does already takes no time.
    pub fn tell(&mut self, dbm: Option<f64>, now: Duration) {
        self.advance(now);
        let heading = self.turn.map_or(self.radiates_dbm, |(_, to)| to);
        if heading == dbm {
            return;
        }
        let takes = if dbm.is_some() { self.model.change } else { self.model.off };
        self.turn = Some((now + takes, dbm));
        self.advance(now);
    }

    /// Its control stops, or goes on with what it was about to do. A dead one does neither.
    pub fn stop(&mut self, stopped: bool, now: Duration) {
        self.advance(now);
        match (self.control, stopped) {
            (Control::Runs, true) => self.control = Control::Stopped(now),
            (Control::Stopped(since), false) => {
                self.control = Control::Runs;
                self.turn = self.turn.map(|(at, to)| (at + (now - since), to));
            }
            _ => {}
        }
    }

    /// Its control dies.
    pub fn die(&mut self, now: Duration) {
        self.advance(now);
        self.control = Control::Dead;
        self.turn = None;
        if !self.model.outlives_control {
            self.radiate(None, now);
        }
    }

    /// Its host has died or stopped, or goes on.
    pub fn lose_host(&mut self, lost: bool, now: Duration) {
        self.advance(now);
        self.host_lost_at = lost.then(|| self.host_lost_at.unwrap_or(now));
        // Within the time that it declares it is in order.
        self.fail(lost, now + self.model.dead.unwrap_or_default());
    }

    /// Something between its host's mind and its antenna fails, or is in order again.
    pub fn fail(&mut self, failed: bool, from: Duration) {
        self.astray = match (self.astray, failed) {
            (Some((since, _)), failed) => Some((since, !failed)),
            (None, true) => Some((from, false)),
            (None, false) => None,
        };
    }

    /// When it next does something by itself.
    #[must_use]
    pub fn next(&self) -> Option<Duration> {
        let turn = self.turn.filter(|_| self.runs()).map(|(at, _)| at);
        let cut = self.cut_at().filter(|_| self.radiates_dbm.is_some() || self.turn.is_some());
        [turn, cut].into_iter().flatten().min()
    }

    fn cut_at(&self) -> Option<Duration> {
        Some(self.host_lost_at? + self.model.dead?)
    }

    /// Does what is due, each at its own time.
    pub fn advance(&mut self, now: Duration) {
        let cut_at = self.cut_at();
        if let Some((at, to)) = self.turn.filter(|(at, _)| self.runs() && *at <= now)
            && cut_at.is_none_or(|cut| at < cut)
        {
            self.turn = None;
            self.radiate(to, at);
        }
        if let Some(at) = cut_at.filter(|at| *at <= now) {
            self.turn = None;
            self.radiate(None, at);
        }
        if self.radiates_dbm.is_none() && self.turn.is_none() {
            // What is off and in order does what it is told.
            self.astray = self.astray.filter(|(_, mended)| !mended);
        }
    }

    fn radiate(&mut self, dbm: Option<f64>, at: Duration) {
        if std::mem::replace(&mut self.radiates_dbm, dbm) != dbm {
            self.radiated.push((at, dbm));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    const MODEL: DeviceModel = DeviceModel {
        off: Duration::from_millis(20),
        change: Duration::from_millis(50),
        dead: None,
        outlives_control: true,
    };

    /// On since 50 ms.
    fn on(model: DeviceModel) -> SimulatedDevice {
        let mut device = SimulatedDevice::new(model);
        device.tell(Some(20.0), ms(0));
        device.advance(ms(49));
        assert_eq!(device.power_dbm(), None);
        device.advance(ms(60));
        assert_eq!(device.radiated(), [(ms(50), Some(20.0))]);
        device
    }

    #[test]
    fn spec_each_order_takes_its_time_and_the_newest_counts() {
        let mut device = on(MODEL);
        device.tell(Some(10.0), ms(100));
        device.tell(None, ms(120));
        assert_eq!(device.next(), Some(ms(140)));
        device.advance(ms(1000));
        assert_eq!(device.radiated()[1..], [(ms(140), None)]);
        assert!(device.is_done() && device.next().is_none());
    }

    #[test]
    fn spec_one_that_stops_radiates_on_and_does_the_rest_of_its_order_afterwards() {
        let mut device = on(MODEL);
        device.tell(None, ms(100));
        device.stop(true, ms(110));
        device.advance(ms(5000));
        assert_eq!((device.power_dbm(), device.runs(), device.next()), (Some(20.0), false, None));
        device.stop(false, ms(5000));
        assert_eq!(device.next(), Some(ms(5010)));
        device.advance(ms(5010));
        assert_eq!(device.power_dbm(), None);
    }

    #[test]
    fn spec_what_a_dead_control_leaves_on_is_the_models() {
        for outlives_control in [true, false] {
            let mut device = on(DeviceModel { outlives_control, ..MODEL });
            device.tell(None, ms(100));
            device.die(ms(110));
            device.stop(false, ms(120));
            device.advance(ms(9000));
            assert_eq!(device.power_dbm().is_some(), outlives_control);
            assert!(device.is_dead());
        }
    }

    #[test]
    fn spec_without_its_host_it_goes_on_for_ever_or_for_the_time_that_it_declares() {
        let mut device = on(MODEL);
        device.lose_host(true, ms(100));
        device.advance(ms(60_000));
        assert!(device.power_dbm().is_some() && device.is_astray(ms(100)));
        let mut device = on(DeviceModel { dead: Some(ms(400)), ..MODEL });
        device.lose_host(true, ms(100));
        assert_eq!(device.next(), Some(ms(500)));
        assert!(!device.is_astray(ms(499)));
        device.advance(ms(2000));
        assert_eq!(device.radiated()[1..], [(ms(500), None)]);
        // A host that goes on finds it off, and tells it anew.
        device.lose_host(false, ms(2000));
        device.tell(Some(20.0), ms(2100));
        device.advance(ms(2200));
        assert!(device.power_dbm().is_some() && !device.is_astray(ms(2200)));
    }

    #[test]
    fn spec_what_failed_is_astray_until_it_is_in_order_and_off() {
        let mut device = on(MODEL);
        device.fail(true, ms(100));
        device.fail(false, ms(300));
        device.advance(ms(400));
        assert!(device.is_astray(ms(400)));
        device.tell(None, ms(400));
        device.advance(ms(420));
        assert!(!device.is_astray(ms(420)));
    }
}
