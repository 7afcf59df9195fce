//! The tracked clock against a link whose delays are known, in virtual time.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

const AUTOPILOT: Address = (1, 1);
const MS: i64 = 1000;

fn at(us: i64) -> Instant {
    Instant::from_start(Duration::from_micros(us.unsigned_abs()))
}

/// What arrives: with us, or with the autopilot.
#[derive(Debug, Clone)]
enum Arrival {
    /// A sample and the instant at which it was taken.
    Sample(u32, i64),
    Question(TIMESYNC_DATA),
    Answer(TIMESYNC_DATA),
}

/// How long a message that is sent at an instant is under way, in microseconds; `None`: it is lost.
type Delay = Box<dyn FnMut(i64) -> Option<i64>>;

fn constant(us: i64) -> Delay {
    Box::new(move |_| Some(us))
}

/// An autopilot, the link, and us.
struct World {
    clock: BootClock,
    now: i64,
    /// What the autopilot's clock shows at our zero, and how much faster than ours it is.
    boot_at_zero_us: i64,
    ppm: i64,
    up: Delay,
    down: Delay,
    answers: bool,
    under_way: Vec<(i64, Arrival)>,
    /// The newest sample: its stamp, and when it was taken.
    newest: Option<(BootTime, i64)>,
}

impl World {
    fn new(up: Delay, down: Delay) -> Self {
        Self {
            clock: BootClock::default(),
            now: 1_000 * MS,
            boot_at_zero_us: 77_000_123,
            ppm: 0,
            up,
            down,
            answers: true,
            under_way: Vec::new(),
            newest: None,
        }
    }

    fn boot_us(&self, at: i64) -> i64 {
        self.boot_at_zero_us + at + at * self.ppm / 1_000_000
    }

    fn stamp(&self, at: i64) -> u32 {
        (self.boot_us(at) / MS) as u32
    }

    fn send_down(&mut self, arrival: Arrival) {
        if let Some(delay) = (self.down)(self.now) {
            self.under_way.push((self.now + delay, arrival));
        }
    }

    /// Lets a millisecond pass; telemetry comes every 20.
    fn step(&mut self) {
        self.now += MS;
        let now = self.now;
        if (now / MS) % 20 == 0 {
            let sample = Arrival::Sample(self.stamp(now), now);
            self.send_down(sample);
        }
        if let Some(MavMessage::TIMESYNC(question)) = self.clock.ask(AUTOPILOT, at(now))
            && let Some(delay) = (self.up)(now)
        {
            self.under_way.push((now + delay, Arrival::Question(question)));
        }
        self.under_way.sort_by_key(|(arrives, _)| *arrives);
        let due = self.under_way.partition_point(|(arrives, _)| *arrives <= now);
        for (_, arrival) in self.under_way.drain(..due).collect::<Vec<_>>() {
            match arrival {
                Arrival::Question(question) if self.answers => {
                    let tc1 = self.boot_us(now) * 1000;
                    self.send_down(Arrival::Answer(TIMESYNC_DATA { tc1, ..question }));
                }
                Arrival::Question(_) => {}
                Arrival::Answer(answer) => self.clock.handle_timesync(&answer, at(now)),
                Arrival::Sample(stamp, taken) => self.hear(stamp, taken),
            }
        }
    }

    fn hear(&mut self, stamp: u32, taken: i64) {
        assert!(!self.clock.shows_restart(stamp, at(self.now)), "{stamp} at {}", self.now);
        let time = self.clock.hear(stamp, at(self.now));
        if self.newest.is_none_or(|(newest, _)| time > newest) {
            self.newest = Some((time, taken));
        }
    }

    fn run(&mut self, ms: i64) {
        (0..ms).for_each(|_| self.step());
    }

    /// The age of the newest sample as it is held to be, if it is known, and as it is.
    fn age(&self) -> Option<(i64, i64)> {
        let (time, taken) = self.newest?;
        let held = self.clock.taken_from(time, at(self.now))?;
        Some((self.now - us(held), self.now - taken))
    }

    /// Asserts that the age is known, never understated, and overstated by `more` at most.
    fn assert_age(&self, more: i64) {
        let (held, real) = self.age().unwrap_or_else(|| panic!("not known at {}", self.now));
        assert!(held >= real, "at {}: {held} us, really {real} us", self.now);
        // The stamp is cut to a millisecond.
        assert!(held <= real + more + MS, "at {}: {held} us, really {real} us", self.now);
    }
}

/// Ten seconds of drift between two clocks, and again what is allowed for it.
const DRIFTED: i64 = 2 * 2000 + 2;

#[test]
fn val_a_constant_delay_is_seen_and_overstated_by_the_way_of_the_question() {
    for (up_ms, down_ms) in [(0, 0), (1, 1), (20, 0), (0, 20), (5, 200), (200, 5), (30, 1000)] {
        for ppm in [-200, 200] {
            let mut world = World::new(constant(up_ms * MS), constant(down_ms * MS));
            world.ppm = ppm;
            world.run(3_000);
            for _ in 0..12_000 {
                world.step();
                world.assert_age(up_ms * MS + DRIFTED);
            }
            // The world moves in steps of a millisecond.
            let shortest = (up_ms + down_ms..=up_ms + down_ms + 1).map(|ms| Duration::from_millis(ms as u64));
            let tracking = world.clock.tracking(at(world.now));
            assert!(shortest.map(Tracking::RoundTrip).any(|known| known == tracking), "{tracking:?}");
        }
    }
}

#[test]
fn val_a_step_of_the_delay_is_seen_with_the_first_message_after_it() {
    for step_ms in [100, 250, 500, 1000, 2000] {
        for ppm in [-200, 200] {
            let step_at = 20_000 * MS;
            let down = Box::new(move |now| Some(if now < step_at { 2 * MS } else { (2 + step_ms) * MS }));
            let mut world = World::new(constant(2 * MS), down);
            world.ppm = ppm;
            world.run(19_000);
            world.assert_age(2 * MS + DRIFTED);
            world.run(step_ms + 50);
            for _ in 0..30_000 {
                world.step();
                world.assert_age(2 * MS + DRIFTED);
                assert!(world.age().is_some_and(|(held, _)| held >= step_ms * MS));
            }
        }
    }
}

#[test]
fn val_after_a_freeze_the_burst_is_as_old_as_it_is() {
    for freeze_ms in [300, 1000, 3000, 5000] {
        let (from, until) = (20_000 * MS, (20_000 + freeze_ms) * MS);
        let down =
            Box::new(move |now| Some(if (from..until).contains(&now) { until - now } else { 0 } + 3 * MS));
        let mut world = World::new(constant(3 * MS), down);
        world.run(18_990);
        for _ in 0..freeze_ms + 10_000 {
            world.step();
            world.assert_age(3 * MS + DRIFTED);
        }
        let (held, _) = world.age().unwrap();
        assert!(held < 40 * MS, "fresh again: {held} us");
    }
}

/// Lost, repeated, late by up to `spread_ms`, and so out of order.
fn rough(seed: u64, least_ms: i64, spread_ms: i64, loss: f64) -> Delay {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    Box::new(move |_| {
        let delay = least_ms * MS + rng.random_range(0..=spread_ms * MS);
        (!rng.random_bool(loss)).then_some(delay)
    })
}

#[test]
fn prop_whatever_is_lost_late_or_overtaken_no_age_is_understated() {
    for seed in 0..12 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let spread_ms = rng.random_range(0..3000);
        let loss = rng.random_range(0.0..0.5);
        let (least_up, least_down) = (rng.random_range(0..300), rng.random_range(0..300));
        let mut world = World::new(
            rough(2 * seed, least_up, spread_ms, loss),
            rough(2 * seed + 1, least_down, spread_ms, loss),
        );
        world.ppm = rng.random_range(-200..=200);
        let mut known = 0;
        for _ in 0..25_000 {
            world.step();
            if matches!(world.clock.tracking(at(world.now)), Tracking::RoundTrip(_)) && world.newest.is_some()
            {
                known += 1;
                world.assert_age((least_up + spread_ms) * MS + DRIFTED);
            }
        }
        assert!(known > 18_000, "seed {seed}: known for {known} ms");
    }
}

#[test]
fn val_the_counter_wraps_after_49_days_and_the_answers_do_not() {
    let wrap_us = (i64::from(u32::MAX) + 1) * MS;
    for before_wrap_s in [0, 5, 15] {
        let mut world = World::new(constant(2 * MS), constant(2 * MS));
        world.boot_at_zero_us = wrap_us - before_wrap_s * 1_000_000;
        world.run(1_000);
        for _ in 0..30_000 {
            world.step();
            world.assert_age(2 * MS + DRIFTED);
        }
        // Two more turns of the counter that we were not there for.
        let mut world = World::new(constant(2 * MS), constant(2 * MS));
        world.boot_at_zero_us = 3 * wrap_us - before_wrap_s * 1_000_000;
        world.run(1_000);
        (0..20_000).for_each(|_| {
            world.step();
            world.assert_age(2 * MS + DRIFTED);
        });
    }
}

#[test]
fn spec_after_a_restart_nothing_is_fresh_until_the_new_clock_is_known() {
    let mut world = World::new(constant(100 * MS), constant(10 * MS));
    world.run(15_000);
    let restarted_at = world.now;
    // Two seconds of booting; what is heard first is 1.9 s old by its own clock.
    world.run_silently(2_000);
    world.boot_at_zero_us = -restarted_at - 100 * MS;
    let stamp = world.stamp(world.now);
    assert!(world.clock.shows_restart(stamp, at(world.now)));
    world.clock.clear();
    (world.newest, world.under_way) = (None, Vec::new());
    world.step();
    while world.newest.is_none() {
        world.step();
    }
    assert_eq!(world.age(), None, "its clock is not known");
    world.run(320);
    world.assert_age(100 * MS + DRIFTED);
}

#[test]
fn spec_a_message_that_was_overtaken_is_no_restart() {
    let mut world = World::new(constant(MS), constant(MS));
    world.run(60_000);
    let now = at(world.now);
    let stamp_of = |age_s: i64| world.stamp(world.now - age_s * 1_000_000);
    for age_s in [1, 3, 10, 50] {
        assert!(!world.clock.shows_restart(stamp_of(age_s), now), "{age_s} s");
    }
    // A clock that began anew shows no more than can have passed.
    for boot_ms in [0, 700, 5_000] {
        assert!(world.clock.shows_restart(boot_ms, now), "{boot_ms} ms");
        assert!(world.clock.shows_restart(boot_ms + 30_000, now + Duration::from_secs(30)), "{boot_ms} ms");
    }
    let (held, _) = world.age().unwrap();
    world.clock.hear(stamp_of(10), now);
    assert_eq!(world.age().unwrap().0, held, "nor does it make the newest one older or newer");
}

#[test]
fn val_an_autopilot_that_never_answers_is_judged_by_its_least_delayed_message() {
    for ppm in [-200, 0, 200] {
        let step_at = 30_000 * MS;
        let down = Box::new(move |now| Some(if now < step_at { 5 * MS } else { 1_005 * MS }));
        let mut world = World::new(constant(5 * MS), down);
        (world.answers, world.ppm) = (false, ppm);
        world.run(2_500);
        assert_eq!(world.clock.tracking(at(world.now)), Tracking::Asking);
        assert_eq!(world.age(), None, "it may still answer");
        world.run(26_000);
        assert_eq!(world.clock.tracking(at(world.now)), Tracking::OneWay);
        let error = |world: &World| world.age().map(|(held, real)| held - real).unwrap();
        // The constant delay is not seen; for drift, what a minute may make.
        let bounds = -6 * MS..=2 * 12 * MS;
        assert!(bounds.contains(&error(&world)), "{ppm}: {}", error(&world));
        world.run(1_600);
        for _ in 0..55_000 {
            world.step();
            assert!(bounds.contains(&error(&world)), "{ppm}: {}", error(&world));
        }
        world.run(10_000);
        assert!(error(&world) < -900 * MS, "after a minute it is taken for what it always was");
    }
}

#[test]
fn spec_who_answered_once_must_go_on_answering() {
    let mut world = World::new(constant(MS), constant(MS));
    world.run(5_000);
    world.answers = false;
    world.run(9_700);
    world.assert_age(MS + DRIFTED);
    world.run(600);
    assert_eq!(world.age(), None);
    assert_eq!(world.clock.tracking(at(world.now)), Tracking::Lost);
    world.answers = true;
    world.run(220);
    world.assert_age(MS + DRIFTED);
}

#[test]
fn val_a_clock_that_is_set_makes_nothing_fresh() {
    for by_ms in [20, 1000, 100_000] {
        let mut world = World::new(constant(2 * MS), constant(2 * MS));
        world.run(5_000);
        world.boot_at_zero_us += by_ms * MS;
        // What is still under way is of the old clock.
        world.under_way.clear();
        for _ in 0..1_000 {
            world.step();
            if world.age().is_some() {
                world.assert_age(2 * MS + DRIFTED);
            }
        }
        world.assert_age(2 * MS + DRIFTED);
    }
}

#[test]
fn spec_only_answers_to_our_own_questions_count_and_each_once() {
    let mut clock = BootClock::default();
    let question = |clock: &mut BootClock, now| match clock.ask(AUTOPILOT, at(now)) {
        Some(MavMessage::TIMESYNC(question)) => question,
        other => panic!("{other:?}"),
    };
    let ours = question(&mut clock, 1_000 * MS);
    assert_eq!((ours.tc1, ours.target_system, ours.target_component), (0, 1, 1));
    assert_eq!(clock.ask(AUTOPILOT, at(1_199 * MS)), None);
    assert_eq!(clock.timeout(), at(1_200 * MS));
    let time = clock.hear(50_000, at(1_000 * MS));
    let answered = |clock: &mut BootClock, tc1, ts1, now| {
        clock.handle_timesync(&TIMESYNC_DATA { tc1, ts1, ..ours.clone() }, at(now));
        clock.tracking(at(now))
    };
    let tc1 = 50_001_000_000;
    for (tc1, ts1) in
        [(0, ours.ts1), (-5, ours.ts1), (tc1, ours.ts1 + 1), (tc1, 0), (40_000_000_000, ours.ts1)]
    {
        assert_eq!(answered(&mut clock, tc1, ts1, 1_010 * MS), Tracking::Asking, "{tc1} {ts1}");
    }
    let second = question(&mut clock, 1_200 * MS);
    let known = answered(&mut clock, 50_201_000_000, second.ts1, 1_204 * MS);
    assert_eq!(known, Tracking::RoundTrip(Duration::from_millis(4)));
    let before = clock.taken_from(time, at(1_204 * MS));
    // Asked at 1200, shown 201 ms more than the sample's stamp; 200 ppm of it, rounded up.
    assert_eq!(before, Some(at(999 * MS - 41)));
    // A copy, an hour later by what it shows.
    answered(&mut clock, 3_600_000_000_000, second.ts1, 1_205 * MS);
    assert_eq!(clock.taken_from(time, at(1_205 * MS)), before);
}

#[test]
fn val_the_time_between_samples_is_the_autopilots_whatever_their_delays() {
    let mut world = World::new(constant(MS), rough(7, 0, 400, 0.2));
    world.run(5_000);
    let (time, taken) = world.newest.unwrap();
    world.run(5_000);
    let (later, taken_later) = world.newest.unwrap();
    let on_ours = |time| us(world.clock.on_our_clock(time).unwrap());
    assert!((on_ours(later) - on_ours(time) - (taken_later - taken)).abs() <= MS);
    assert!((later.seconds_since(time) * 1e6 - (taken_later - taken) as f64).abs() <= 1e3);
}

/// The first message came over a link that held it up, and was taken for one that came at once: what came later was of the future.
#[test]
fn regress_no_sample_is_of_the_future_where_the_first_was_long_under_way() {
    let mut clock = BootClock::default();
    let first = clock.hear(50_000, at(1_400 * MS));
    assert_eq!(clock.on_our_clock(first), Some(at(1_400 * MS)));
    let second = clock.hear(50_500, at(1_510 * MS));
    let held_up = clock.hear(51_000, at(2_600 * MS));
    let taken = [first, second, held_up].map(|time| clock.on_our_clock(time));
    assert_eq!(taken, [1_010, 1_510, 2_010].map(|ms| Some(at(ms * MS))));
}

impl World {
    /// Lets time pass in which nothing is said.
    fn run_silently(&mut self, ms: i64) {
        self.under_way.clear();
        self.now += ms * MS;
    }
}
