//! What is left in the battery, in time: whether a mission fits into it before it begins, and when the pair has to go home
//! to land with its reserve.
//!
//! *Charge.* The lower of what the autopilot says and of what the endurance of the vehicle file leaves of the charge at
//! take-off: a gauge that stands still does not hide the time.
//!
//! *Rate.* The fastest of the file's, of the autopilot's own forecast, and of the fall as flown: an old battery, a cold one or a heavy tilt shows in it. A gauge
//! counts in steps of a percent, so the fall is taken from one step to another; the sag of the first seconds is left out. PX4's
//! simulated battery loses half of its charge in half a minute and then nothing more: its fall is no rate.
//!
//! *Need.* A vehicle that gives up holds, lets the other land first if it is J, flies home and lands. As soon as the time down
//! to the reserve is less than that from where it is, or than the next slot and the way home from there, it gives up, and the
//! other with it: neither is left alone in the air.

use std::collections::VecDeque;
use std::time::Duration;

use crate::preflight::{Check, Verdict, check};
use crate::time::Instant;

/// The fall is that of the last minute ...
const WINDOW: Duration = Duration::from_secs(60);
/// ... over this time at least; or that of so long, if it is deep: what sags for a moment is no rate.
const SHORTEST: Duration = Duration::from_secs(5);
const DEEP: f64 = 0.03;
/// After take-off the voltage sags, and the gauge with it.
const SETTLES: Duration = Duration::from_secs(10);
/// How often it is asked whether it is enough.
const EVERY: Duration = Duration::from_secs(1);
/// An autopilot comes down so fast down to [`SLOW_M`] above the ground, m/s: PX4's MPC_Z_V_AUTO_DN and ArduCopter's WPNAV_SPEED_DN
/// are 1.5.
const DESCENT_M_S: f64 = 1.0;
/// And below, m/s: MPC_LAND_SPEED is 0.7, LAND_SPEED 0.5.
const LAST_DESCENT_M_S: f64 = 0.5;
const SLOW_M: f64 = 10.0;

/// What is known of a vehicle's battery.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Battery {
    /// Time in the air from full to empty; `None`: not stated.
    pub endurance: Option<Duration>,
    /// The charge to land with, of 1.
    pub reserve: f64,
}

/// How long an autopilot takes to land from so many metres above its home.
pub(super) fn landing(height_m: f64) -> Duration {
    let height_m = height_m.max(0.0);
    let slow_m = height_m.min(SLOW_M);
    Duration::from_secs_f64((height_m - slow_m) / DESCENT_M_S + slow_m / LAST_DESCENT_M_S)
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Endurance {
    battery: Battery,
    /// When it took off, and with which charge.
    took_off: Option<(Instant, f64)>,
    said: Option<f64>,
    /// What empties the battery when the autopilot says that it will be empty, a second, by its last word.
    forecast_per_s: Option<f64>,
    /// The lowest that was said since the gauge has settled.
    lowest: Option<f64>,
    /// When it was last asked whether it is enough.
    asked_at: Option<Instant>,
    /// When the gauge fell to what, oldest first.
    steps: VecDeque<(Instant, f64)>,
}

impl Endurance {
    pub fn new(battery: Battery) -> Self {
        Self {
            battery,
            took_off: None,
            said: None,
            forecast_per_s: None,
            lowest: None,
            asked_at: None,
            steps: VecDeque::new(),
        }
    }

    /// The charge to land with, of 1.
    pub fn reserve(&self) -> f64 {
        self.battery.reserve
    }

    /// What the autopilot says of the charge, of 1, and of how long it lasts. `floor`: of a simulated battery the charge down to
    /// which its fall is no forecast.
    pub fn feed(
        &mut self,
        said: Option<(f64, Option<Duration>)>,
        floor: Option<f64>,
        flies: bool,
        now: Instant,
    ) {
        self.said = said.map(|(charge, _)| charge);
        self.forecast_per_s = None;
        let Some((said, lasts)) = said.filter(|_| flies) else {
            (self.took_off, self.lowest) = (None, None);
            return self.steps.clear();
        };
        let (took_off, _) = *self.took_off.get_or_insert((now, said));
        let settled = floor.is_none_or(|floor| said < floor) && now >= took_off + SETTLES;
        self.forecast_per_s = lasts.filter(|_| settled).map(|lasts| said / lasts.as_secs_f64());
        if !settled || self.lowest.is_some_and(|lowest| said >= lowest) {
            return;
        }
        // The first is no step: nobody knows since when it has been so much.
        if self.lowest.replace(said).is_none() {
            return;
        }
        self.steps.push_back((now, said));
        while self.steps.len() > 2 && self.steps[0].0 + WINDOW < now {
            self.steps.pop_front();
        }
    }

    /// Whether it is time to ask again whether it is enough.
    pub fn is_due(&mut self, now: Instant) -> bool {
        let due = self.asked_at.is_none_or(|at| now >= at + EVERY);
        if due {
            self.asked_at = Some(now);
        }
        due
    }

    /// The charge, of 1; `None` where nobody says anything of it.
    pub fn charge(&self, now: Instant) -> Option<f64> {
        let reckoned = self.took_off.zip(self.battery.endurance).map(|((since, charge), endurance)| {
            charge - now.saturating_since(since).as_secs_f64() / endurance.as_secs_f64()
        });
        let said = self.said?;
        Some(reckoned.map_or(said, |reckoned| said.min(reckoned)))
    }

    /// Of the charge, a second.
    fn rate_per_s(&self) -> Option<f64> {
        let stated = self.battery.endurance.map(|endurance| 1.0 / endurance.as_secs_f64());
        let (to, low) = self.steps.back().copied().unzip();
        let fall = |(from, high): &(Instant, f64)| {
            let (time, fall) = (to?.saturating_since(*from), high - low?);
            (time >= SHORTEST).then(|| (fall, fall / time.as_secs_f64()))
        };
        let flown = self.steps.front().and_then(fall).map(|(_, rate)| rate);
        let of_late = self.steps.iter().rev().filter_map(fall).find(|(fall, _)| *fall >= DEEP);
        stated
            .into_iter()
            .chain(self.forecast_per_s)
            .chain(flown)
            .chain(of_late.map(|(_, rate)| rate))
            .reduce(f64::max)
    }

    /// How long until the reserve is all that is left; `None` where that is not known.
    pub fn left(&self, now: Instant) -> Option<Duration> {
        let above = (self.charge(now)? - self.battery.reserve).max(0.0);
        match self.rate_per_s() {
            _ if above <= 0.0 => Some(Duration::ZERO),
            Some(rate) => Duration::try_from_secs_f64(above / rate).ok(),
            None => None,
        }
    }

    /// Whether a mission of so long, from take-off to landing, fits.
    pub fn check(&self, mission: Duration, now: Instant) -> Check {
        let name = "endurance";
        let minutes = |time: Duration| time.as_secs_f64() / 60.0;
        let Some(left) = self.left(now).filter(|_| self.battery.endurance.is_some()) else {
            let unknown = match self.battery.endurance {
                Some(_) => "the autopilot does not say what is in the battery".to_owned(),
                None => "[battery] endurance_s is not stated in the vehicle file".to_owned(),
            };
            let detail = format!(
                "{unknown}: whether {:.1} min in the air fit into it shows in flight alone",
                minutes(mission)
            );
            return check(name, Verdict::Warn, detail);
        };
        let reserve = format!("{:.0}%", self.battery.reserve * 100.0);
        if left < mission {
            let detail = format!(
                "the mission takes up to {:.1} min in the air, the battery gives {:.1} down to its reserve of {reserve}: charge it",
                minutes(mission),
                minutes(left)
            );
            return check(name, Verdict::Fail, detail);
        }
        let fits = (left.as_secs_f64() / mission.as_secs_f64().max(1.0)).floor();
        let detail = format!(
            "{:.1} min down to the reserve of {reserve}: the mission, up to {:.1} min in the air, fits {fits} times",
            minutes(left),
            minutes(mission)
        );
        check(name, Verdict::Pass, detail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(s: f64) -> Instant {
        Instant::from_start(Duration::from_secs_f64(s))
    }

    fn of(endurance_s: Option<u64>) -> Endurance {
        Endurance::new(Battery { endurance: endurance_s.map(Duration::from_secs), reserve: 0.2 })
    }

    /// Flown from `charge` for so long by a gauge that says whole percents of a battery that is empty after `true_s`.
    fn flown(endurance: &mut Endurance, charge: f64, true_s: f64, seconds: u32) -> Option<f64> {
        for s in (0..=seconds * 2).map(|s| f64::from(s) / 2.0) {
            let left = charge - s / true_s;
            endurance.feed(Some(((left * 100.0).ceil() / 100.0, None)), None, true, at(s));
        }
        endurance.left(at(f64::from(seconds))).map(|left| left.as_secs_f64())
    }

    #[test]
    fn spec_a_healthy_battery_gives_what_the_file_says_of_it() {
        let left_s = flown(&mut of(Some(1000)), 0.9, 1000.0, 100).unwrap();
        assert!((left_s - (0.9 - 0.1 - 0.2) * 1000.0).abs() < 10.0, "{left_s}");
        // One that gives more than the file says is not trusted with it.
        let left_s = flown(&mut of(Some(1000)), 0.9, 3000.0, 100).unwrap();
        assert!((left_s - 600.0).abs() < 10.0, "{left_s}");
    }

    #[test]
    fn spec_a_weak_battery_shows_as_it_is_flown_with_and_without_a_word_of_the_file() {
        for file in [None, Some(1800)] {
            let left_s = flown(&mut of(file), 0.9, 200.0, 60).unwrap();
            assert!((left_s - (0.9 - 0.3 - 0.2) * 200.0).abs() < 4.0, "{left_s}");
        }
    }

    #[test]
    fn spec_what_gets_worse_on_the_way_shows_at_once_if_it_is_much() {
        let mut endurance = of(None);
        let mut charge = 1.0;
        for half_s in 0..=130 {
            let s = f64::from(half_s) / 2.0;
            charge -= 0.5 * if s < 55.0 { 0.001 } else { 0.01 };
            endurance.feed(Some(((charge * 100.0_f64).ceil() / 100.0, None)), None, true, at(s));
        }
        // Ten seconds later, of a window of sixty.
        let left_s = endurance.left(at(65.0)).unwrap().as_secs_f64();
        assert!((left_s - (charge - 0.2) / 0.01).abs() < 10.0, "{left_s}");
    }

    #[test]
    fn spec_what_the_gauge_falls_by_while_it_settles_says_nothing() {
        let mut endurance = of(None);
        for (s, charge) in [(0.0, 0.9), (1.0, 0.87), (3.0, 0.84), (11.0, 0.84), (20.0, 0.83)] {
            endurance.feed(Some((charge, None)), None, true, at(s));
        }
        assert_eq!(endurance.left(at(20.0)), None, "one step is no rate");
        // At the reserve nothing is left, whatever the rate.
        let mut endurance = of(None);
        endurance.feed(Some((0.2, None)), None, true, at(0.0));
        assert_eq!(endurance.left(at(0.0)), Some(Duration::ZERO));
        assert_eq!(endurance.reserve(), 0.2);
    }

    #[test]
    fn spec_from_when_on_and_for_how_long_a_step_of_the_gauge_counts() {
        let left = |floor: Option<f64>, said: &[(f64, f64)]| {
            let mut endurance = of(None);
            said.iter().for_each(|(s, charge)| endurance.feed(Some((*charge, None)), floor, true, at(*s)));
            endurance.left(at(said.last().unwrap().0)).map(|left| left.as_secs_f64().round())
        };
        // The first is no step, from ten seconds on, and below a floor.
        assert_eq!(left(None, &[(0.0, 0.9), (10.0, 0.85), (20.0, 0.84), (30.0, 0.83)]), Some(630.0));
        assert_eq!(left(Some(0.5), &[(0.0, 0.9), (20.0, 0.5), (30.0, 0.49), (40.0, 0.48)]), None);
        // Two are kept however old they are, and those of a minute with both its ends.
        assert_eq!(left(None, &[(0.0, 0.9), (12.0, 0.89), (20.0, 0.88), (100.0, 0.87)]), Some(5360.0));
        let minute = [(0.0, 0.9), (12.0, 0.89), (20.0, 0.88), (40.0, 0.87), (80.0, 0.86)];
        assert_eq!(left(None, &minute), Some(1980.0));
        // What takes all that is left fits.
        let mut endurance = of(Some(1000));
        endurance.feed(Some((0.9, None)), None, false, at(0.0));
        let all = endurance.left(at(0.0)).unwrap();
        assert_eq!(endurance.check(all, at(0.0)).result, Verdict::Pass);
    }

    #[test]
    fn spec_it_is_asked_once_a_second_whether_it_is_enough() {
        let mut endurance = of(None);
        let asked = (0..30).filter(|tenths| endurance.is_due(at(f64::from(*tenths) / 10.0)));
        assert_eq!(asked.collect::<Vec<_>>(), [0, 10, 20]);
    }

    #[test]
    fn spec_what_was_lost_more_than_a_minute_ago_is_no_rate_any_more() {
        let mut endurance = of(None);
        let mut charge = 1.0;
        for s in 0..=200 {
            charge -= if (10..30).contains(&s) { 0.01 } else { 0.001 };
            endurance.feed(Some(((charge * 100.0_f64).ceil() / 100.0, None)), None, true, at(f64::from(s)));
        }
        let left_s = endurance.left(at(200.0)).unwrap().as_secs_f64();
        assert!((left_s / ((charge - 0.2) / 0.001) - 1.0).abs() < 0.05, "{left_s}");
    }

    #[test]
    fn spec_a_gauge_that_stands_still_does_not_hide_the_time() {
        let mut endurance = of(Some(500));
        for s in 0..=200 {
            endurance.feed(Some((0.8, None)), None, true, at(f64::from(s)));
        }
        assert!((endurance.charge(at(200.0)).unwrap() - 0.4).abs() < 1e-9);
        assert!((endurance.left(at(200.0)).unwrap().as_secs_f64() - 100.0).abs() < 1e-6);
        // Nothing shows it where the file does not say how long the battery lasts.
        let mut endurance = of(None);
        (0..=200).for_each(|s| endurance.feed(Some((0.8, None)), None, true, at(f64::from(s))));
        assert_eq!(endurance.left(at(200.0)), None);
    }

    #[test]
    fn spec_the_sag_at_take_off_is_no_rate_and_a_fall_to_the_reserve_is_the_end() {
        let mut endurance = of(None);
        for (s, charge) in [(0.0, 0.9), (1.0, 0.87), (3.0, 0.84), (11.0, 0.84), (60.0, 0.83), (110.0, 0.82)] {
            endurance.feed(Some((charge, None)), None, true, at(s));
        }
        let left_s = endurance.left(at(110.0)).unwrap().as_secs_f64();
        assert!((left_s - 0.62 * 5000.0).abs() < 1.0, "{left_s}");
        endurance.feed(Some((0.2, None)), None, true, at(111.0));
        assert_eq!(endurance.left(at(111.0)), Some(Duration::ZERO));
        endurance.feed(None, None, true, at(112.0));
        assert_eq!(endurance.left(at(112.0)), None, "who says nothing is not asked");
    }

    #[test]
    fn spec_the_fall_of_a_simulated_battery_to_its_floor_is_no_rate_and_what_falls_below_is() {
        let px4 = |s: f64| (1.0 - s / 60.0).max(0.5);
        for (file, left_s) in [(None, None), (Some(1000), Some(300.0))] {
            let mut endurance = of(file);
            for s in (0..=100).map(f64::from) {
                endurance.feed(Some(((px4(s) * 100.0).floor() / 100.0, None)), Some(0.5), true, at(s));
            }
            assert_eq!(endurance.left(at(100.0)).map(|left| left.as_secs_f64().round()), left_s);
            for s in (0..=20).map(f64::from) {
                endurance.feed(Some((0.5 - s / 100.0, None)), Some(0.5), true, at(100.0 + s));
            }
            let left_s = endurance.left(at(120.0)).unwrap().as_secs_f64();
            assert!((left_s - 10.0).abs() < 1.0, "{left_s}");
        }
        // The same of a real battery is one.
        let mut endurance = of(None);
        (0..=20).map(f64::from).for_each(|s| endurance.feed(Some((px4(s), None)), None, true, at(s)));
        assert!(endurance.left(at(20.0)).unwrap() < Duration::from_secs(40));
    }

    #[test]
    fn spec_the_autopilot_s_own_forecast_counts_where_it_is_the_shorter_one() {
        let left = |file: Option<u64>, floor: Option<f64>, lasts_s: u64, s: f64| {
            let mut endurance = of(file);
            let lasts = Some(Duration::from_secs(lasts_s));
            endurance.feed(Some((0.8, lasts)), floor, true, at(0.0));
            endurance.feed(Some((0.8, lasts)), floor, true, at(s));
            endurance.left(at(s)).map(|left| left.as_secs_f64().round())
        };
        // From 80% down to nothing in 400 s: 300 s down to 20%.
        assert_eq!(left(None, None, 400, 20.0), Some(300.0));
        assert_eq!(left(Some(10_000), None, 400, 20.0), Some(299.0));
        assert_eq!(left(Some(100), None, 400, 20.0), Some(40.0));
        // Not while the voltage sags, nor of a simulated battery above its floor.
        assert_eq!(left(None, None, 400, 5.0), None);
        assert_eq!(left(None, Some(0.5), 400, 20.0), None);
    }

    #[test]
    fn spec_before_take_off_it_is_said_what_fits() {
        let mut endurance = of(Some(1000));
        endurance.feed(Some((0.9, None)), None, false, at(0.0));
        let fits = endurance.check(Duration::from_secs(200), at(100.0));
        assert_eq!(fits.result, Verdict::Pass, "time on the ground costs nothing");
        assert!(fits.detail.contains("11.7 min") && fits.detail.contains("fits 3 times"), "{}", fits.detail);
        let fails = endurance.check(Duration::from_secs(701), at(100.0));
        assert_eq!(fails.result, Verdict::Fail);
        endurance.feed(None, None, false, at(101.0));
        assert_eq!(endurance.check(Duration::from_secs(1), at(101.0)).result, Verdict::Warn);
        assert_eq!(of(None).check(Duration::from_secs(1), at(0.0)).result, Verdict::Warn);
    }

    #[test]
    fn spec_landing_is_slow_near_the_ground() {
        assert_eq!(landing(-1.0), Duration::ZERO);
        assert_eq!(landing(5.0), Duration::from_secs(10));
        assert_eq!(landing(40.0), Duration::from_secs(50));
    }
}
