//! Live figures: NAMED_VALUE_FLOAT, one at a time in turn.
//!
//! | name | what |
//! |---|---|
//! | `SEC_RATE` | secrecy rate now, bit/s; 0 outside slots |
//! | `SINR_USER` | SINR of the slot's user, dB |
//! | `SINR_EVE` | SINR of the strongest eavesdropper, dB |
//! | `SINR_E1`, ... | SINR of each eavesdropper, in the mission file's order, dB |
//! | `TX_DBM` | own power as the transmitter acknowledged it, dBm |
//!
//! They are the mission's model at what this companion knows: its own estimated pose and acknowledged power, the
//! peer's reported position, and the plan's power while the peer says that it radiates. The peer does not report its
//! attitude: it counts as the plan's, jittering as the mission expects, by its mean gain (J's null on the user would
//! otherwise look perfect). What an eavesdropper really hears nobody aboard can know.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, NAMED_VALUE_FLOAT_DATA};

use crate::geo::Enu;
use crate::mission::executive::Executive;
use crate::mission::ground_station::information::boot_ms;
use crate::pair::wire::VeilwingFlags;
use crate::planner::problem::Radio;
use crate::radio::fading::Rician;
use crate::radio::link::{Transmitter, power_at_gain_w, received_power_w};
use crate::radio::pattern;
use crate::radio::secrecy;
use crate::role::Role;
use crate::time::Instant;

/// Nothing received at all is shown as this, in dB or dBm.
const FLOOR_DB: f64 = -100.0;

/// The model at this moment.
#[derive(Debug, Clone, PartialEq)]
struct Figures {
    rate_bps: f64,
    user_sinr: f64,
    eavesdropper_sinr: Vec<f64>,
    own_power_w: f64,
}

impl Figures {
    fn strongest(&self) -> f64 {
        self.eavesdropper_sinr.iter().copied().fold(0.0, f64::max)
    }

    /// The figure at `index` of the turn; `None` past its end.
    fn named(&self, index: usize) -> Option<(String, f64)> {
        let db = |ratio: f64| (10.0 * ratio.log10()).max(FLOOR_DB);
        Some(match index {
            0 => ("SEC_RATE".into(), self.rate_bps),
            1 => ("SINR_USER".into(), db(self.user_sinr)),
            2 => ("SINR_EVE".into(), db(self.strongest())),
            3 => ("TX_DBM".into(), db(self.own_power_w * 1e3)),
            _ => {
                let number = index - 4;
                (format!("SINR_E{}", number + 1), db(*self.eavesdropper_sinr.get(number)?))
            }
        })
    }
}

impl Executive {
    /// The next figure, if one is due.
    pub(super) fn show_live(&mut self, now: Instant) {
        if self.ground_station.live_hz <= 0.0
            || now < self.ground_station.live_at
            || !self.phase.is_in_service()
        {
            return;
        }
        self.ground_station.live_at = now + Duration::from_secs_f64(1.0 / self.ground_station.live_hz);
        let figures = self.figures(now);
        let next = figures.as_ref().and_then(|figures| figures.named(self.ground_station.live_next));
        let (name, value) = match (next, &figures) {
            (Some(next), _) => next,
            // Round again.
            (None, Some(figures)) => {
                self.ground_station.live_next = 0;
                ("SEC_RATE".into(), figures.rate_bps)
            }
            // Between slots nothing is protected, for nothing is sent.
            (None, None) => ("SEC_RATE".into(), 0.0),
        };
        self.ground_station.live_next = if figures.is_some() { self.ground_station.live_next + 1 } else { 0 };
        self.outbox.push_back(MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
            time_boot_ms: boot_ms(now),
            value: value as f32,
            name: name.as_str().into(),
        }));
    }

    /// The model at what is known now; `None` outside slots, and while a position is unknown or old.
    fn figures(&self, now: Instant) -> Option<Figures> {
        let (itinerary, slot) = (self.itinerary.as_ref()?, self.service.slot()?.commitment);
        let entry = itinerary.entry(slot.slot)?;
        let planned = self.plan.as_ref()?.slots.get(entry.user_index)?.plan.vehicles;
        let (role, peer) = (self.settings.role, self.service.peer());
        if !self.autopilot.fresh(now) || !peer.heard_within(self.settings.pair.peer_timeout, now) {
            return None;
        }
        let scene = &self.settings.scene;
        let interlock = self.service.interlock();
        let radiates = interlock.transmitter().on_until_at_least(now).filter(|_| interlock.is_on());
        let own = Transmitter {
            position_enu_m: self.position()?,
            axis: self.autopilot.state().attitude?.value.antenna_axis(),
            tx_power_w: radiates.map_or(0.0, |radiates| radiates.power_w),
            antenna: &scene.antennas[role],
        };
        let (other_plan, since_opening_s) = (planned[role.peer()], now.seconds_since(slot.opens_at));
        let (axis, tx_power_w) = match itinerary.tracks(slot.slot).map(|tracks| &tracks[role.peer()]) {
            Some(track) => {
                (track.attitude(since_opening_s).antenna_axis(), track.tx_power_w(since_opening_s))
            }
            None => (other_plan.pose.antenna_axis(), other_plan.tx_power_w),
        };
        let radiates = peer.says(VeilwingFlags::VEILWING_FLAGS_RADIATING);
        let other = Transmitter {
            position_enu_m: peer.position_enu_m?,
            axis,
            tx_power_w: if radiates { tx_power_w } else { 0.0 },
            antenna: &scene.antennas[role.peer()],
        };
        let Radio { reference_gain, noise_power_w, .. } = scene.radio;
        let at = |node: &Enu, rician: Rician| {
            let from_own = received_power_w(&own, node, rician, reference_gain);
            let jitter_rad = self.settings.jitter.std_rad;
            let from_other = mean_received_power_w(&other, node, rician, reference_gain, jitter_rad);
            let (i, j) = match role {
                Role::I => (from_own, from_other),
                Role::J => (from_other, from_own),
            };
            i / (j + noise_power_w)
        };
        let user_sinr = at(scene.users_enu_m.get(entry.user_index)?, scene.fading.user);
        let eavesdropper_sinr: Vec<f64> =
            scene.eavesdroppers_enu_m.iter().map(|node| at(node, scene.fading.eavesdropper)).collect();
        let heard = eavesdropper_sinr.iter().copied();
        let rate_bps = secrecy::rate_bps(scene.radio.bandwidth_hz, user_sinr, heard);
        Some(Figures { rate_bps, user_sinr, eavesdropper_sinr, own_power_w: own.tx_power_w })
    }
}

/// Mean power received from a transmitter whose axis jitters by `jitter_rad` about each of its two transverse axes, to
/// second order: with `t` the cosine between axis and direction, `E t^2 = t^2 + s^2 (1 - 3 t^2)`, so that for a dipole
/// `E G = G + s^2 (2 - 3 G)`, and its depth times as much of one with a floor. A measured pattern is taken to bend as an
/// ideal dipole's null does.
fn mean_received_power_w(
    from: &Transmitter<'_>,
    node: &Enu,
    rician: Rician,
    reference_gain: f64,
    jitter_rad: f64,
) -> f64 {
    let path = node - from.position_enu_m;
    let still = from.antenna.gain(&path, &from.axis);
    let dipole = pattern::gain(&path, &from.axis);
    let bend = (1.0 - from.antenna.least()) * jitter_rad * jitter_rad * (2.0 - 3.0 * dipole);
    let mean = rician.mean_gain((still + bend).clamp(0.0, 1.0), from.antenna.mean());
    power_at_gain_w(from, node, mean, reference_gain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::antenna::Pattern;

    #[test]
    fn val_the_mean_gain_is_that_of_many_jittered_axes() {
        use crate::geo::Attitude;
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let jitter_rad = 2f64.to_radians();
        let mut gauss = || jitter_rad * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
        for node in [Enu::zeros(), Enu::new(30.0, 0.0, 0.0), Enu::new(100.0, 20.0, 50.0)] {
            let level = Transmitter {
                position_enu_m: Enu::new(0.0, 0.0, 50.0),
                axis: Enu::z(),
                tx_power_w: 0.5,
                antenna: &Pattern::IDEAL,
            };
            let n = 20_000;
            let powers = (0..n).map(|_| {
                let axis = Attitude::from_euler(gauss(), gauss(), 0.0).antenna_axis();
                received_power_w(&Transmitter { axis, ..level }, &node, Rician::NONE, 1.0)
            });
            let mean = powers.sum::<f64>() / f64::from(n);
            let formula = mean_received_power_w(&level, &node, Rician::NONE, 1.0, jitter_rad);
            // A null that is filled to a quarter bends by three quarters.
            let floored = Transmitter { antenna: &Pattern::Dipole { floor: 0.25 }, ..level };
            let filled = mean_received_power_w(&floored, &node, Rician::NONE, 1.0, jitter_rad);
            let full = power_at_gain_w(&level, &node, 1.0, 1.0);
            assert!((filled / (0.25 * full + 0.75 * formula) - 1.0).abs() < 1e-9, "{node}: {filled}");
            // At the null the power's standard deviation is its mean: 0.7% of it for the mean of 20,000.
            let within = if node == Enu::zeros() { 0.03 } else { 0.004 };
            assert!((formula / mean - 1.0).abs() < within, "{node}: {formula} {mean}");
        }
    }

    #[test]
    fn spec_names_fit_and_come_round() {
        let figures =
            Figures { rate_bps: 2e6, user_sinr: 100.0, eavesdropper_sinr: vec![0.0; 99], own_power_w: 0.5 };
        let louder = Figures { eavesdropper_sinr: vec![0.0, 10.0, 1.0], ..figures.clone() };
        assert_eq!(louder.named(2), Some(("SINR_EVE".into(), 10.0)));
        assert_eq!(louder.named(6), Some(("SINR_E3".into(), 0.0)));
        assert_eq!(louder.named(7), None);
        let all: Vec<_> = (0..).map_while(|index| figures.named(index)).collect();
        assert_eq!(all.len(), 4 + 99);
        assert!(all.iter().all(|(name, value)| name.len() <= 10 && value.is_finite()), "{all:?}");
        assert_eq!(all[1], ("SINR_USER".into(), 20.0));
        assert_eq!(all[2], ("SINR_EVE".into(), FLOOR_DB));
        assert!((all[3].1 - 26.99).abs() < 0.01);
        assert_eq!(all[0], ("SEC_RATE".into(), 2e6));
        assert_eq!(all[4].0, "SINR_E1");
    }
}
