//! One vehicle's part of a slot that is served through its turns, and perhaps in motion: attitudes, places and powers by the time since
//! the slot opens.
//!
//! A slot opens half a guard before its user is served, and closes half a guard after. What a vehicle turns in silence, from one
//! user's last attitude to the next one's first, lies in the two half guards and in what there is between them: the tracks of
//! both slots know their end of it. A jammer is silent in it too: its null is on nobody.

mod followed;
mod planned;
#[cfg(test)]
pub(crate) mod samples;
mod way;

pub use followed::Followed;
pub use planned::{Planned, tracks};
pub use way::{Glide, Way};

use super::moving::{Instant, Limits};
use super::turning::Angles;
use crate::geo::Attitude;

/// The two vehicles' clocks agree within this, in seconds: about a knot the larger of its two powers protects.
pub const APART_S: f64 = 0.1;
/// A power that rises is asked for so much before it has to be there, in seconds: until then the command is on its way to the radio.
const UNDER_WAY_S: f64 = 0.15;

/// A position loop closes in on a position no faster, 1/s, and the loop of velocities in it is twice as fast.
const CLOSES_IN_1_S: f64 = 2.0;
/// How far ahead a vehicle is looked for that is told nothing more, in seconds, and how often.
const LOOKED_AHEAD_S: f64 = 0.6;
const LOOKS: u32 = 30;

/// How wrong a pose may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slack {
    /// Of the antenna's axis, radians.
    pub pointing_rad: f64,
    /// Of the position, metres.
    pub position_m: f64,
}

/// See the module. Cheap to clone.
#[derive(Debug, Clone, PartialEq)]
pub enum Track {
    /// All of it is known before the slot.
    Planned(Planned),
    /// It is made anew while the slot is served, as those move that it is made for.
    Followed(Followed),
}

impl Track {
    /// The same for a vehicle that has come to rest in the first attitude before the slot opens, and before it moves.
    #[must_use]
    pub fn from_rest(self) -> Self {
        match self {
            Self::Planned(track) => Self::Planned(track.from_rest()),
            followed @ Self::Followed(_) => followed,
        }
    }

    /// The same for a vehicle that comes to rest afterwards, in the last attitude.
    #[must_use]
    pub fn to_rest(self) -> Self {
        match self {
            Self::Planned(track) => Self::Planned(track.to_rest()),
            followed @ Self::Followed(_) => followed,
        }
    }

    /// The way round on which the vehicle moves, if it does so on one.
    #[must_use]
    pub fn way(&self) -> Option<&Way> {
        match self {
            Self::Planned(track) => track.way(),
            Self::Followed(_) => None,
        }
    }

    /// The motions that are made anew, if they are.
    #[must_use]
    pub fn followed(&self) -> Option<&Followed> {
        match self {
            Self::Planned(_) => None,
            Self::Followed(track) => Some(track),
        }
    }

    /// Where the vehicle is at a time since the opening, if it moves.
    #[must_use]
    pub fn place(&self, since_opening_s: f64) -> Option<Instant> {
        match self {
            Self::Planned(track) => track.place(since_opening_s),
            Self::Followed(track) => Some(track.place(since_opening_s)),
        }
    }

    /// Whether it moves in the slot.
    #[must_use]
    pub fn is_in_motion(&self) -> bool {
        self.way().is_some() || self.followed().is_some()
    }

    /// Whether the vehicle is under way at a time since the opening.
    #[must_use]
    pub fn moves(&self, since_opening_s: f64) -> bool {
        match self {
            Self::Planned(track) => track.way().is_some_and(|way| way.moves(since_opening_s)),
            Self::Followed(track) => track.moves(since_opening_s),
        }
    }

    /// How the vehicle stops that is under way at a time since the opening, and since when it does so, likewise; `None` where it
    /// rests, or comes to rest as soon if it goes on.
    #[must_use]
    pub fn stop(&self, since_opening_s: f64, limits: &Limits) -> Option<(Glide, f64)> {
        match self {
            Self::Planned(track) => {
                let way = track.way().filter(|way| way.moves(since_opening_s))?;
                Some(way.stop(since_opening_s, limits))
            }
            Self::Followed(track) => track.stop(since_opening_s, limits),
        }
    }

    /// The attitude at a time since the opening: before the track begins its first one, after its end its last one.
    #[must_use]
    pub fn attitude(&self, since_opening_s: f64) -> Attitude {
        match self {
            Self::Planned(track) => track.attitude(since_opening_s),
            Self::Followed(track) => track.attitude(since_opening_s),
        }
    }

    /// The power in watts that is to be commanded: before the user is served that of the first step, afterwards that of the last;
    /// and of one that is just over, or about to begin, where that is more.
    #[must_use]
    pub fn tx_power_w(&self, since_opening_s: f64) -> f64 {
        match self {
            Self::Planned(track) => track.tx_power_w(since_opening_s),
            Self::Followed(track) => track.tx_power_w(since_opening_s),
        }
    }

    /// The power in watts that protects at a time since the opening; before the user is served, and afterwards, as commanded then.
    #[must_use]
    pub fn protects_w(&self, since_opening_s: f64) -> f64 {
        match self {
            Self::Planned(track) => track.protects_w(since_opening_s),
            Self::Followed(track) => track.vehicle(since_opening_s).tx_power_w,
        }
    }

    /// The power that protects exceeds this one from then on, in seconds since the opening, if it does at this time or later.
    #[must_use]
    pub fn outgrows(&self, tx_power_w: f64, since_opening_s: f64) -> Option<f64> {
        match self {
            Self::Planned(track) => track.outgrows(tx_power_w, since_opening_s),
            Self::Followed(track) => track.outgrows(tx_power_w, since_opening_s),
        }
    }

    /// From when on the track leaves a vehicle behind, or before, by more than this that is told nothing more after `since_opening_s`, if
    /// it does so within 0.6 s. Its attitude was told it `ahead_s` before it was due, and it follows so much late: it turns
    /// that much further. It goes straight on, or as the position that it was told last lets it.
    #[must_use]
    pub fn leaves_behind(&self, since_opening_s: f64, ahead_s: f64, far: Slack) -> Option<f64> {
        let told = self.place(since_opening_s);
        let looked_s = |look: u32| LOOKED_AHEAD_S * f64::from(look) / f64::from(LOOKS);
        let is_far = |look: &u32| {
            let after_s = looked_s(*look);
            let at_s = since_opening_s + after_s;
            let turned_s = if ahead_s > 0.0 { -ahead_s * libm::expm1(-after_s / ahead_s) } else { 0.0 };
            let off_rad = self.attitude(since_opening_s + turned_s).angle_to(&self.attitude(at_s));
            // x'' = 2k (v + k (p - x) - x').
            let decay = libm::exp(-CLOSES_IN_1_S * after_s) * libm::cos(CLOSES_IN_1_S * after_s);
            let held_s = (1.0 - decay) / CLOSES_IN_1_S;
            let off_m = told.zip(self.place(at_s)).map_or(0.0, |(told, now)| {
                let off_m = |for_s: f64| {
                    let goes = told.position_enu_m + told.velocity_enu_m_s.vector() * for_s;
                    (goes - now.position_enu_m).norm()
                };
                off_m(after_s).max(off_m(held_s))
            });
            off_rad > far.pointing_rad || off_m > far.position_m
        };
        (1..=LOOKS).find(is_far).map(|look| since_opening_s + looked_s(look - 1))
    }

    /// The time since the opening from which the vehicle has the attitudes in which the user is served, and until which.
    #[must_use]
    pub fn in_place(&self) -> [Option<f64>; 2] {
        match self {
            Self::Planned(track) => track.in_place(),
            Self::Followed(_) => [None; 2],
        }
    }

    /// How wrong the pose may be, by the stricter of the knots before and after; `None` where nobody is served, or nothing is asked.
    #[must_use]
    pub fn slack(&self, since_opening_s: f64) -> Option<Slack> {
        match self {
            Self::Planned(track) => track.slack(since_opening_s),
            Self::Followed(track) => track.slack(since_opening_s),
        }
    }

    /// Roll, pitch and yaw in radians where the user's service begins, and where it ends.
    #[must_use]
    pub fn ends(&self) -> [Angles; 2] {
        match self {
            Self::Planned(track) => track.ends(),
            Self::Followed(track) => [track.begins(); 2],
        }
    }
}
