//! How much the attitude jitters in a slot, and whether the mission knows of it.
//!
//! The plan counts on `[jitter] std_deg`: at 2 deg more than that the demonstration carries 1 bit/s/Hz less than it promises, and at a
//! tenth of it other poses would carry more. Of the error of attitude `e` about the body's x and y axes, which is what turns an antenna,
//! the mean over a slot is a lean or a bias, and what is left is the jitter: `s^2 = (mean |e|^2 - |mean e|^2) / (2 share)`, with
//! the share of it that turns an antenna where the attitude is meant to be ([`radio::jitter`](crate::radio::jitter)).
//!
//! Where a mission follows what moves, the next poses and motions are planned for the jitter that was measured: J tells I of its own
//! in VEILWING_STATUS, and I tells J for which of the two both plan, with those that move ([`Places`](crate::pair::Places)). There each
//! judges its own pose by its own jitter too, or its limits would be those of a calmer vehicle. What these bear is independent from
//! sample to sample, so it is that part of the jitter that counts as more: `s^2 = mean |e_k - e_(k-1)|^2 / (4 share)`. Who swings more
//! slowly is out of its pose.

use nalgebra::Vector2;

use super::executive::Executive;
use crate::geo::Attitude;
use crate::pair::MeasuredJitter;
use crate::radio::jitter::Jitter as Law;
use crate::role::Role;
use crate::time::Instant;

/// Samples of a slot that say something: three seconds at 50 Hz, which tell a deviation to 4%.
const LEAST_SAMPLES: u32 = 150;
/// So many times what is expected, and so much beyond, is more; and less than half of what is expected is less.
const MORE: f64 = 1.5;
const BEYOND_RAD: f64 = 0.3f64.to_radians();
const LESS: f64 = 0.5;
/// A pose is judged by so many times what was measured: that may be less than it is by twice the error of a slot's few seconds.
const MEASURED_WITHIN: f64 = 1.06;

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Jitter {
    /// What the mission expects.
    expected: Law,
    heard: Option<Instant>,
    slot: Sums,
    told: bool,
    /// To plan for, where it is not what is expected.
    other_rad: Option<f64>,
}

/// Of a slot's errors, and of their shares.
#[derive(Debug, Clone, Default)]
struct Sums {
    samples: u32,
    errors: Vector2<f64>,
    squares: f64,
    last: Option<Vector2<f64>>,
    steps: f64,
    shares: f64,
}

impl Jitter {
    pub fn new(expected: Law) -> Self {
        Self { expected, heard: None, slot: Sums::default(), told: false, other_rad: None }
    }

    /// Takes the attitude that was measured at `at`, in a slot, where it is meant to be so.
    pub fn hear(&mut self, measured: &Attitude, meant: &Attitude, at: Instant) {
        if self.heard.replace(at).is_some_and(|heard| at <= heard) {
            return;
        }
        let error = (meant.rotation().inverse() * measured.rotation()).scaled_axis().xy();
        let (roll_rad, pitch_rad, _) = meant.euler();
        let slot = &mut self.slot;
        slot.samples += 1;
        slot.errors += error;
        slot.squares += error.norm_squared();
        slot.steps += slot.last.replace(error).map_or(0.0, |last| (error - last).norm_squared());
        slot.shares += self.expected.share_across(roll_rad, pitch_rad);
    }

    /// A slot is over. Its jitter per axis in radians, if it is another than is expected; told once.
    pub fn slot_over(&mut self) -> Option<f64> {
        let slot = std::mem::take(&mut self.slot);
        self.heard = None;
        let (std_rad, other_rad) = self.judged(&slot)?;
        self.other_rad = other_rad;
        let is_another = std_rad < LESS * self.expected.std_rad || self.is_more(std_rad);
        let tells = !self.told && is_another;
        self.told |= tells;
        tells.then_some(std_rad)
    }

    fn is_more(&self, std_rad: f64) -> bool {
        std_rad > MORE * self.expected.std_rad + BEYOND_RAD
    }

    /// The jitter of a slot that says something, and what is to be planned for by it.
    fn judged(&self, slot: &Sums) -> Option<(f64, Option<f64>)> {
        let Sums { samples, errors, squares, steps, shares, .. } = *slot;
        if samples < LEAST_SAMPLES {
            return None;
        }
        let squares = squares - errors.norm_squared() / f64::from(samples);
        let std_rad = (squares / (2.0 * shares)).max(0.0).sqrt();
        let quick_rad = (steps / (4.0 * shares)).sqrt();
        let other_rad = match std_rad < LESS * self.expected.std_rad {
            true => Some(std_rad),
            false => Some(quick_rad).filter(|rad| self.is_more(*rad)),
        };
        Some((std_rad, other_rad))
    }

    /// What was measured in the last slot that says something, per axis in radians, if that is to be planned for.
    pub fn other_rad(&self) -> Option<f64> {
        self.other_rad
    }

    /// The same if the slot under way were over.
    pub fn would_be_rad(&self) -> Option<f64> {
        self.judged(&self.slot).map_or(self.other_rad, |(_, other_rad)| other_rad)
    }
}

impl Executive {
    /// I: what both vehicles plan for; `None`: what the mission says. A plan has one jitter for both: that of the less steady one.
    pub(super) fn agreed_jitter(&self) -> Option<MeasuredJitter> {
        self.larger_jitter(self.jitter.other_rad()).filter(|_| self.settings.role == Role::I)
    }

    /// The jitter of the less steady vehicle, with this as what was measured here; `None`: what the mission says.
    pub(super) fn larger_jitter(&self, own_rad: Option<f64>) -> Option<MeasuredJitter> {
        let stated = MeasuredJitter::of(self.settings.jitter.std_rad);
        let peer = self.service.peer().jitter;
        let larger = own_rad.map_or(stated, MeasuredJitter::of).max(peer.unwrap_or(stated));
        (larger != stated).then_some(larger)
    }

    /// What the other is told. Where no slot is to carry on one after which all is planned anew, that has to be known by its end.
    pub(super) fn told_jitter(&self) -> Option<MeasuredJitter> {
        match self.may_replan() {
            true => self.jitter.would_be_rad().map(MeasuredJitter::of),
            false => self.own_jitter(),
        }
    }

    /// By which jitter our own poses are judged in slots that are planned for this one.
    pub(super) fn judged_by(&self, planned_for: Option<MeasuredJitter>) -> Option<MeasuredJitter> {
        let own = self.own_jitter()?.min(planned_for?);
        Some(MeasuredJitter::of(MEASURED_WITHIN * own.std_rad()))
    }

    /// What was measured here, if it is to be planned for.
    pub(super) fn own_jitter(&self) -> Option<MeasuredJitter> {
        self.jitter.other_rad().map(MeasuredJitter::of)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::radio::jitter::{JitterAxes, JitterModel};

    fn expecting(std_deg: f64) -> Jitter {
        let std_rad = std_deg.to_radians();
        Jitter::new(Law { std_rad, model: JitterModel::Body, axes: JitterAxes::RollPitch })
    }

    /// What is told after a slot of so many samples, of an attitude that is to and fro by `std_deg` about either axis and leans by 5 deg.
    fn told(jitter: &mut Jitter, std_deg: f64, samples: u32) -> Option<f64> {
        let meant = Attitude::from_euler(0.7, -0.4, 0.2);
        for k in 0..samples {
            // Every other time the same again, as often as not in what is independent.
            let side = |k: u32| if k >> 1 & 1 == 0 { std_deg } else { -std_deg };
            let off = nalgebra::Vector3::new(side(k) + 5.0, side(k + 1), 3.0).map(f64::to_radians);
            let measured =
                Attitude::from_rotation(meant.rotation() * nalgebra::UnitQuaternion::from_scaled_axis(off));
            let at = Instant::from_start(Duration::from_millis(20) * k);
            jitter.hear(&measured, &meant, at);
            // The same again says nothing new.
            jitter.hear(&meant, &meant, at);
        }
        jitter.slot_over().map(f64::to_degrees)
    }

    #[test]
    fn val_the_jitter_is_measured_beside_a_lean_and_told_once_where_it_is_another() {
        for (std_deg, is_told) in [(0.5, true), (1.5, false), (2.0, false), (3.0, false), (4.0, true)] {
            let mut jitter = expecting(2.0);
            assert_eq!(told(&mut jitter, std_deg, 100), None, "too short");
            let first = told(&mut jitter, std_deg, 400);
            assert_eq!(first.is_some(), is_told, "{std_deg}: {first:?}");
            assert!(first.is_none_or(|deg| (deg - std_deg).abs() < 0.02), "{std_deg}: {first:?}");
            assert_eq!(told(&mut jitter, std_deg, 400), None);
            assert_eq!(
                jitter.other_rad().map(|rad| (50.0 * rad.to_degrees()).round() / 50.0),
                is_told.then_some(std_deg)
            );
            // One that is as expected again is planned for no more, and one that was too short to say changes nothing.
            told(&mut jitter, 1.9, 100);
            assert_eq!(jitter.other_rad().is_some(), is_told);
            told(&mut jitter, 1.9, 400);
            assert_eq!(jitter.other_rad(), None);
        }
    }

    #[test]
    fn spec_who_expects_none_is_told_of_none_that_a_good_vehicle_has() {
        let mut jitter = expecting(0.0);
        told(&mut jitter, 0.2, 0);
        for k in 0..400 {
            let off = Attitude::from_euler(if k % 2 == 0 { 0.003 } else { -0.003 }, 0.0, 0.0);
            jitter.hear(&off, &Attitude::level(), Instant::from_start(Duration::from_millis(20) * k));
        }
        assert_eq!(jitter.slot_over(), None);
    }

    /// Noise along Euler angles, turned as the vehicle would be.
    #[test]
    fn val_the_jitter_of_angles_is_measured_at_steep_poses_too() {
        for axes in [JitterAxes::RollPitch, JitterAxes::RollPitchYaw] {
            let law = Law { std_rad: 0.0, model: JitterModel::Euler, axes };
            for (roll, pitch) in [(0.0, 0.0), (1.3, 0.2), (-0.9, 1.0)] {
                let mut jitter = Jitter::new(law);
                for k in 0..512 {
                    let side = |bit: u32| if k >> bit & 1 == 0 { 0.05 } else { -0.05 };
                    let yaw = if axes == JitterAxes::RollPitch { 0.0 } else { side(2) };
                    let meant = Attitude::from_euler(roll, pitch, 0.4);
                    let measured = Attitude::from_euler(roll + side(0), pitch + side(1), 0.4 + yaw);
                    jitter.hear(&measured, &meant, Instant::from_start(Duration::from_millis(20) * k));
                }
                let std_rad = jitter.slot_over().unwrap();
                assert!((std_rad / 0.05 - 1.0).abs() < 0.01, "{axes:?} {roll} {pitch}: {std_rad}");
            }
        }
    }

    #[test]
    fn spec_who_swings_slowly_is_told_of_and_not_planned_for() {
        let mut jitter = expecting(1.0);
        for k in 0..400 {
            let off = Attitude::from_euler(0.1 * libm::sin(0.125 * f64::from(k)), 0.0, 0.0);
            jitter.hear(&off, &Attitude::level(), Instant::from_start(Duration::from_millis(20) * k));
        }
        let told_deg = jitter.slot_over().unwrap().to_degrees();
        assert!((told_deg - 2.86).abs() < 0.1 && jitter.other_rad().is_none(), "{told_deg}");
    }
}
