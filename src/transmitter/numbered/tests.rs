//! The driver of numbered commands against a radio that does what docs/radio.md says, over ways of every manner, and
//! against true time: the companion's clock is true, the radio's drifts.

mod bounds;
mod defects;
mod property;
mod rules;

use std::collections::BTreeMap;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::COMMAND_INT_DATA;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::wire::{MavMessage as RadioMessage, WHOLE};
use super::super::{Driver, Kind, NotReady, Settings, Transmitter};
use super::*;

const OWN: (u8, u8) = (1, 191);
const RADIO: (u8, u8) = (1, 68);
const STEP: Duration = Duration::from_millis(1);
/// The longest that the radio lets an expiry be ahead.
const LONGEST_MS: i32 = 5000;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// What a radio radiates.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Emission {
    number: u32,
    boot: u32,
    dbm: f64,
    slot: i32,
    expires_ms: u32,
}

/// The radio's side, stated anew.
#[derive(Debug, Clone)]
struct Radio {
    /// What its clock showed at the start of time, in microseconds, and by how much it is fast.
    began_us: i64,
    fast_ppm: i64,
    /// How much before its expiry it falls silent.
    early_ms: u32,
    boot: u32,
    newest: u32,
    series: u32,
    on: Option<Emission>,
    refuses: Option<VeilwingRadioResult>,
    received: Vec<COMMAND_INT_DATA>,
    rng: ChaCha8Rng,
}

impl Radio {
    fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        Self {
            began_us: 1000 * i64::from(rng.random_range(0..u32::MAX)),
            fast_ppm: 0,
            early_ms: 0,
            boot: 0,
            newest: 0,
            series: rng.random_range(1..WHOLE),
            on: None,
            refuses: None,
            received: Vec::new(),
            rng,
        }
    }

    fn restart(&mut self) {
        let seed = self.rng.random();
        *self = Self { fast_ppm: self.fast_ppm, early_ms: self.early_ms, ..Self::new(seed) };
    }

    fn clock_ms(&self, now: Instant) -> u32 {
        let true_us = i64::try_from(now.since_start().as_micros()).unwrap();
        let us = self.began_us + true_us + true_us * self.fast_ppm / 1_000_000;
        (us.div_euclid(1000) & i64::from(u32::MAX)) as u32
    }

    /// Positive: so much of its time is left.
    fn left_ms(&self, expires_ms: u32, now: Instant) -> i32 {
        expires_ms.wrapping_sub(self.clock_ms(now)) as i32
    }

    fn advance(&mut self, now: Instant) {
        let early = i32::try_from(self.early_ms).unwrap();
        self.on = self.on.filter(|on| self.left_ms(on.expires_ms, now) > early);
    }

    fn command(&mut self, c: &COMMAND_INT_DATA, now: Instant) -> VEILWING_RADIO_DATA {
        assert_eq!((c.target_system, c.target_component), RADIO);
        self.advance(now);
        self.received.push(c.clone());
        let [number, boot, series] = [c.param2, c.param3, c.param4].map(|whole| whole as u32);
        let result = self.carry_out(c, number, boot, series, now);
        let mut report = self.report(now);
        (report.answers_boot, report.answers, report.result) = (boot, number, result);
        report
    }

    fn carry_out(
        &mut self,
        c: &COMMAND_INT_DATA,
        number: u32,
        boot: u32,
        series: u32,
        now: Instant,
    ) -> VeilwingRadioResult {
        use VeilwingRadioResult as Is;
        if boot != self.boot {
            if series != self.series {
                return Is::VEILWING_RADIO_RESULT_OTHER_SERIES;
            }
            (self.boot, self.newest, self.on) = (boot, 0, None);
            self.series = self.rng.random_range(1..WHOLE);
        }
        if number <= self.newest {
            return Is::VEILWING_RADIO_RESULT_NOT_NEWER;
        }
        self.newest = number;
        if c.param1 == f32::NEG_INFINITY {
            self.on = None;
            return Is::VEILWING_RADIO_RESULT_ACCEPTED;
        }
        let expires_ms = c.y.cast_unsigned();
        if let Some(result) = self.refuses {
            return result;
        }
        match self.left_ms(expires_ms, now) {
            left if !c.param1.is_finite() || left > LONGEST_MS => Is::VEILWING_RADIO_RESULT_DENIED,
            left if left <= 0 => {
                self.on = None;
                Is::VEILWING_RADIO_RESULT_EXPIRED
            }
            _ => {
                let dbm = (f64::from(c.param1) * 1e3).round() * 1e-3;
                self.on = Some(Emission { number, boot, dbm, slot: c.x, expires_ms });
                Is::VEILWING_RADIO_RESULT_ACCEPTED
            }
        }
    }

    fn report(&mut self, now: Instant) -> VEILWING_RADIO_DATA {
        self.advance(now);
        VEILWING_RADIO_DATA {
            time_ms: self.clock_ms(now),
            boot: self.boot,
            newest: self.newest,
            answers_boot: 0,
            answers: 0,
            series: self.series,
            expires_ms: self.on.map_or(0, |on| on.expires_ms),
            power_mdbm: self.on.map_or(OFF, |on| (on.dbm * 1e3).round() as i32),
            result: VeilwingRadioResult::VEILWING_RADIO_RESULT_ACCEPTED,
        }
    }
}

/// What a way does to what goes over it.
#[derive(Debug, Clone)]
struct Way {
    loss: f64,
    duplication: f64,
    delay: Duration,
    /// Uniform addition, each copy's own.
    spread: Duration,
    /// Nothing arrives before this: what was sent meanwhile arrives at once.
    frozen_until: Instant,
    rng: ChaCha8Rng,
}

impl Way {
    fn steady(delay_ms: u64) -> Self {
        Self {
            loss: 0.0,
            duplication: 0.0,
            delay: ms(delay_ms),
            spread: Duration::ZERO,
            frozen_until: Instant::ZERO,
            rng: ChaCha8Rng::seed_from_u64(delay_ms),
        }
    }

    fn arrivals(&mut self, now: Instant) -> Vec<Instant> {
        if self.loss > 0.0 && self.rng.random_bool(self.loss) {
            return Vec::new();
        }
        let copies = if self.duplication > 0.0 && self.rng.random_bool(self.duplication) { 2 } else { 1 };
        let spread = self.spread;
        let delayed =
            (0..copies).map(|_| now + self.delay + spread.mul_f64(self.rng.random_range(0.0..=1.0)));
        delayed.map(|at| at.max(self.frozen_until)).collect()
    }
}

#[derive(Clone)]
struct World {
    now: Instant,
    radio: Radio,
    transmitter: Transmitter,
    there: Way,
    back: Way,
    commands: Vec<(Instant, COMMAND_INT_DATA)>,
    reports: Vec<(Instant, VEILWING_RADIO_DATA)>,
    report_at: Instant,
    /// The companion does not run.
    dead: bool,
    boot: u32,
    /// What the last command said, for the messages that come of it.
    off_by: Instant,
    /// By boot and number: the instant by which what it commands must be off.
    must_end: BTreeMap<(u32, u32), Instant>,
    /// The limit was asked for.
    asked: usize,
}

fn transmitter(boot: u32, now: Instant) -> Transmitter {
    let settings = Settings {
        own: OWN,
        target: RADIO,
        kind: Kind::Numbered { command: 31010 },
        boot,
        longest_round_trip: ms(300),
        apart: false,
        system_is_given: false,
        first_off_after: Duration::ZERO,
    };
    Transmitter::new(settings, now)
}

impl World {
    fn new(there: Way, back: Way) -> Self {
        let now = Instant::from_start(Duration::from_secs(5));
        Self {
            now,
            radio: Radio::new(1),
            transmitter: transmitter(77, now),
            there,
            back,
            commands: Vec::new(),
            reports: Vec::new(),
            report_at: now,
            dead: false,
            boot: 77,
            off_by: now,
            must_end: BTreeMap::new(),
            asked: 0,
        }
    }

    /// Taken for its commander, off, measured.
    fn settled(delay_ms: u64) -> Self {
        let mut world = Self::new(Way::steady(delay_ms), Way::steady(delay_ms));
        world.run(ms(1000) + 8 * ms(delay_ms));
        assert!(world.transmitter.is_off(world.now));
        world
    }

    fn command(&mut self, power_w: f64, slot: u16, for_ms: u64) -> Result<(), NotReady> {
        self.off_by = self.now + ms(for_ms);
        let given = self.transmitter.command(power_w, slot, self.off_by, self.now);
        self.send();
        given
    }

    fn silence(&mut self) {
        self.transmitter.silence(self.now);
        self.send();
    }

    fn hear(&mut self, report: &VEILWING_RADIO_DATA) {
        let header = MavHeader { system_id: RADIO.0.into(), component_id: RADIO.1, sequence: 0 };
        self.transmitter.handle_radio(header, &RadioMessage::VEILWING_RADIO(report.clone()), self.now);
        self.send();
    }

    fn restart_companion(&mut self) {
        self.boot += 1;
        self.transmitter = transmitter(self.boot, self.now);
    }

    fn send(&mut self) {
        while let Some(message) = self.transmitter.poll_transmit() {
            match message {
                MavMessage::COMMAND_INT(c) => {
                    self.must_end.insert((c.param3 as u32, c.param2 as u32), self.off_by);
                    let arrivals = self.there.arrivals(self.now);
                    self.commands.extend(arrivals.into_iter().map(|at| (at, c.clone())));
                }
                MavMessage::PARAM_REQUEST_READ(_) => self.asked += 1,
                other => panic!("{other:?}"),
            }
        }
    }

    fn step(&mut self) {
        self.now = self.now + STEP;
        let now = self.now;
        if !self.dead {
            while self.transmitter.poll_timeout().is_some_and(|(at, _)| at <= now) {
                self.transmitter.handle_timeout(now);
            }
            self.send();
        }
        self.radio.advance(now);
        let mut said = Vec::new();
        for command in due(&mut self.commands, now) {
            said.push(self.radio.command(&command, now));
        }
        if self.report_at <= now {
            self.report_at = now + ms(200);
            said.push(self.radio.report(now));
        }
        for report in said {
            let arrivals = self.back.arrivals(now);
            self.reports.extend(arrivals.into_iter().map(|at| (at, report.clone())));
        }
        for report in due(&mut self.reports, now) {
            if !self.dead {
                self.hear(&report);
            }
        }
        if let Some(on) = self.radio.on {
            let must_end = self.must_end.get(&(on.boot, on.number)).copied();
            assert!(must_end.is_some_and(|end| now < end), "{on:?} at {now:?}, to end by {must_end:?}");
        }
    }

    fn run(&mut self, span: Duration) {
        let end = self.now + span;
        while self.now < end {
            self.step();
        }
    }

    fn vouched(&self) -> Option<Vouched> {
        self.transmitter.on_until_at_least(self.now)
    }

    /// If the companion died now: whether the radio would be as is vouched for, to the end.
    fn assert_vouched(&self, context: &str) {
        let Some(vouched) = self.vouched() else { return };
        let mut alone = self.clone();
        alone.dead = true;
        while alone.now < vouched.until {
            let on = alone.radio.on;
            let held = on.is_some_and(|on| {
                let power_w = Watts::from(Dbm(on.dbm)).0;
                on.slot == i32::from(vouched.slot) && power_w >= vouched.power_w * (1.0 - 1e-9)
            });
            assert!(held, "{context}: {vouched:?} is not held at {:?}: {on:?}", alone.now);
            alone.step();
        }
    }
}

/// What is due, in the order of arrival.
fn due<T>(under_way: &mut Vec<(Instant, T)>, now: Instant) -> Vec<T> {
    let (mut here, later): (Vec<_>, Vec<_>) =
        std::mem::take(under_way).into_iter().partition(|(at, _)| *at <= now);
    *under_way = later;
    here.sort_by_key(|(at, _)| *at);
    here.into_iter().map(|(_, what)| what).collect()
}
