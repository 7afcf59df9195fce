//! Where the companion stands, in every phase, for a ground station that watches: NAMED_VALUE_FLOAT, and DEBUG_VECT for
//! what has three parts. One at a time in turn, as often as the live figures and beside them; what an operator must know
//! at once (phase, silence, radio, orders) as soon as it has changed. What is not known is not said.
//!
//! Messages of the common dialect alone, because autopilots pass on no others.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{DEBUG_VECT_DATA, MavMessage, NAMED_VALUE_FLOAT_DATA};

use crate::geo::{Attitude, Enu};
use crate::mission::executive::Executive;
use crate::mission::ground_station::information::boot_ms;
use crate::mission::phase::Phase;
use crate::role::Role;
use crate::schedule::trajectory::Sample;
use crate::service::Silence;
use crate::time::Instant;
use crate::transmitter::NotReady;

/// A figure, by its name on the wire.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
pub enum Figure {
    /// 0 for I, 1 for J.
    #[strum(serialize = "VW_ROLE")]
    Role,
    /// Of the flight: its place in [`NAMES`](crate::mission::phase::NAMES).
    #[strum(serialize = "VW_PHASE")]
    Phase,
    /// The slot under way, or the next one.
    #[strum(serialize = "VW_SLOT")]
    Slot,
    /// How many slots the table has.
    #[strum(serialize = "VW_SLOTS")]
    Slots,
    /// Seconds to the opening of the slot that is agreed on; below 0 since.
    #[strum(serialize = "VW_OPENS")]
    Opens,
    /// Seconds to its end.
    #[strum(serialize = "VW_CLOSES")]
    Closes,
    /// Seconds until about the landing begins; on the ground, from a START on.
    #[strum(serialize = "VW_LEFT")]
    Left,
    /// Metres from where the plan has the vehicle now.
    #[strum(serialize = "VW_POS_OFF")]
    PositionOff,
    /// Degrees from how the plan has it turned now.
    #[strum(serialize = "VW_ATT_OFF")]
    AttitudeOff,
    /// Why the vehicle must be silent: [`silence_words`]; 0: it may be on the air.
    #[strum(serialize = "VW_SILENT")]
    Silent,
    /// The radio: 0 known to be off, 1 not known to be off, 2 certainly on.
    #[strum(serialize = "VW_RADIO")]
    Radio,
    /// The power that the radio has achieved, dBm, while it is certainly on.
    #[strum(serialize = "VW_DBM")]
    Power,
    /// The plan's power in the slot that is agreed on, dBm.
    #[strum(serialize = "VW_PLANDBM")]
    PlannedPower,
    /// Seconds left of the lease that I holds, or that J has granted; 0: none.
    #[strum(serialize = "VW_LEASE")]
    Lease,
    /// Seconds since the other companion was heard.
    #[strum(serialize = "VW_PEER")]
    Peer,
    /// Seconds by which the other autopilot's UTC is ahead.
    #[strum(serialize = "VW_CLOCK")]
    Clock,
    /// Seconds since the older of position and attitude was taken, at the most.
    #[strum(serialize = "VW_STATE")]
    State,
    /// Milliseconds from a command to the radio to its answer.
    #[strum(serialize = "VW_RTT")]
    RoundTrip,
    /// The operator's orders in force: 1 killed, 2 paused, 4 a START pending, added up.
    #[strum(serialize = "VW_ORDERS")]
    Orders,
}

/// What has three parts, by its name on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumString, strum::IntoStaticStr, strum::VariantArray)]
pub enum Vector {
    /// Where it is: east, north, up of the mission's origin in metres.
    #[strum(serialize = "VW_POS")]
    Position,
    /// Where the plan has it now, likewise.
    #[strum(serialize = "VW_PLAN")]
    Planned,
    /// How it is turned: roll, pitch, yaw as in mission files, in degrees.
    #[strum(serialize = "VW_RPY")]
    Attitude,
    /// How the plan has it turned now, likewise.
    #[strum(serialize = "VW_PLANRPY")]
    PlannedAttitude,
}

#[derive(Debug, Clone, Copy)]
enum Shown {
    Figure(Figure),
    Vector(Vector),
}

/// What is said as soon as it has changed.
const AT_ONCE: [Figure; 4] = [Figure::Phase, Figure::Silent, Figure::Radio, Figure::Orders];

/// The order in which all is said. What moves quickly comes three times.
const TURN: [Shown; 35] = {
    use Figure as F;
    use Shown::{Figure as Is, Vector as At};
    use Vector as V;
    [
        Is(F::Role),
        Is(F::Phase),
        Is(F::Slot),
        Is(F::Opens),
        Is(F::Closes),
        Is(F::Silent),
        Is(F::Radio),
        Is(F::Power),
        Is(F::Lease),
        Is(F::PositionOff),
        Is(F::AttitudeOff),
        At(V::Position),
        Is(F::Orders),
        Is(F::Slots),
        Is(F::PlannedPower),
        At(V::Planned),
        At(V::PlannedAttitude),
        Is(F::Silent),
        Is(F::Radio),
        Is(F::Power),
        Is(F::Lease),
        Is(F::PositionOff),
        Is(F::AttitudeOff),
        At(V::Attitude),
        Is(F::Left),
        Is(F::Peer),
        Is(F::Clock),
        Is(F::State),
        Is(F::RoundTrip),
        Is(F::Silent),
        Is(F::Radio),
        Is(F::Power),
        Is(F::Lease),
        Is(F::PositionOff),
        At(V::Position),
    ]
};

/// What is remembered of it.
#[derive(Debug, Clone)]
pub(super) struct Saying {
    at: Instant,
    next: usize,
    /// As it was said last.
    said: [Option<f64>; AT_ONCE.len()],
}

impl Saying {
    pub fn new(now: Instant) -> Self {
        Self { at: now, next: 0, said: [None; AT_ONCE.len()] }
    }
}

/// Reasons for silence by number, from 1. Never reordered: stations show them by number.
fn number_of(silence: Silence) -> u8 {
    match silence {
        Silence::Killed => 1,
        Silence::NotAuthorised => 2,
        Silence::Resting => 3,
        Silence::NoSlot => 4,
        Silence::Stale => 5,
        Silence::NotInControl => 6,
        Silence::Estimator => 7,
        Silence::Pose => 8,
        Silence::NoLease => 9,
        Silence::NoPeer => 10,
        Silence::NoPower => 11,
        Silence::Transmitter(_) => 12,
    }
}

/// The words for a number of [`Figure::Silent`]; `None` for 0 and for a number of tomorrow.
#[must_use]
pub fn silence_words(number: u8) -> Option<String> {
    // Of the transmitter's reasons the number tells none: the log and STATUSTEXT do.
    let any = Silence::Transmitter(NotReady::NotHeard);
    let all = [
        Silence::Killed,
        Silence::NotAuthorised,
        Silence::Resting,
        Silence::NoSlot,
        Silence::Stale,
        Silence::NotInControl,
        Silence::Estimator,
        Silence::Pose,
        Silence::NoLease,
        Silence::NoPeer,
        Silence::NoPower,
    ];
    if number == number_of(any) {
        return Some("the radio is not ready".into());
    }
    all.into_iter().find(|silence| number_of(*silence) == number).map(|silence| silence.to_string())
}

impl Executive {
    /// The next of it, if something is due.
    pub(super) fn show_standing(&mut self, now: Instant) {
        let hertz = self.ground_station.live_hz;
        if hertz <= 0.0 {
            return;
        }
        for (k, figure) in AT_ONCE.into_iter().enumerate() {
            let value = self.figure(figure, now);
            if value.is_some() && self.ground_station.saying.said[k] != value {
                return self.say_figure(figure, now);
            }
        }
        if now < self.ground_station.saying.at {
            return;
        }
        self.ground_station.saying.at = now + Duration::from_secs_f64(1.0 / hertz);
        // What is not known is passed over.
        for _ in 0..TURN.len() {
            let next = self.ground_station.saying.next;
            self.ground_station.saying.next = (next + 1) % TURN.len();
            match TURN[next] {
                Shown::Figure(figure) if self.figure(figure, now).is_some() => {
                    return self.say_figure(figure, now);
                }
                Shown::Vector(vector) if self.say_vector(vector, now) => return,
                Shown::Figure(_) | Shown::Vector(_) => {}
            }
        }
    }

    fn say_figure(&mut self, figure: Figure, now: Instant) {
        let Some(value) = self.figure(figure, now) else { return };
        if let Some(k) = AT_ONCE.iter().position(|other| *other == figure) {
            self.ground_station.saying.said[k] = Some(value);
        }
        let name: &'static str = figure.into();
        self.outbox.push_back(MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
            time_boot_ms: boot_ms(now),
            value: value as f32,
            name: name.into(),
        }));
    }

    fn say_vector(&mut self, vector: Vector, now: Instant) -> bool {
        let Some([x, y, z]) = self.vector(vector, now) else { return false };
        let name: &'static str = vector.into();
        self.outbox.push_back(MavMessage::DEBUG_VECT(DEBUG_VECT_DATA {
            time_usec: now.since_start().as_micros() as u64,
            x: x as f32,
            y: y as f32,
            z: z as f32,
            name: name.into(),
        }));
        true
    }

    fn figure(&self, figure: Figure, now: Instant) -> Option<f64> {
        let slot = self.service.slot();
        let until = |at: Instant| {
            if at >= now {
                at.saturating_since(now).as_secs_f64()
            } else {
                -now.saturating_since(at).as_secs_f64()
            }
        };
        let interlock = self.service.interlock();
        let vouched = interlock.transmitter().on_until_at_least(now);
        let dbm = |watts: f64| Some(10.0 * (watts * 1e3).log10()).filter(|dbm| dbm.is_finite());
        let finite = match figure {
            Figure::Role => Some(if self.settings.role == Role::I { 0.0 } else { 1.0 }),
            Figure::Phase => Some(self.phase.number(slot.is_some()).into()),
            Figure::Slot => self.itinerary.as_ref().map(|_| self.service.slot_number().into()),
            Figure::Slots => self.itinerary.as_ref().map(|itinerary| itinerary.slots() as f64),
            Figure::Opens => slot.map(|slot| until(slot.commitment.opens_at)),
            Figure::Closes => slot.map(|slot| until(slot.closes_at)),
            Figure::Left => self.left(now).map(|left| left.as_secs_f64()),
            Figure::PositionOff => Some((self.position()? - self.planned_now(now)?.position_enu_m).norm()),
            Figure::AttitudeOff => {
                Some(self.turned()?.angle_to(&self.planned_now(now)?.attitude).to_degrees())
            }
            Figure::Silent => {
                Some(self.service.silence(now).map_or(0.0, |silence| number_of(silence).into()))
            }
            Figure::Radio => Some(match vouched {
                Some(_) if interlock.is_on() => 2.0,
                _ if interlock.is_off(now) => 0.0,
                _ => 1.0,
            }),
            Figure::Power => dbm(vouched.filter(|_| interlock.is_on())?.power_w),
            Figure::PlannedPower => dbm(slot?.power_w(now)),
            Figure::Lease => slot.map(|_| self.service.lease_end(now).map_or(0.0, |end| until(end).max(0.0))),
            Figure::Peer => self.service.peer().silent_for(now).map(|silent| silent.as_secs_f64()),
            Figure::Clock => self.service.clock_offset_s(),
            Figure::State => self.autopilot.state_age(now).map(|age| age.as_secs_f64()),
            Figure::RoundTrip => interlock.transmitter().round_trip(now).map(|way| way.as_secs_f64() * 1e3),
            Figure::Orders => {
                let orders = self.service.orders();
                let set = [orders.is_killed(), orders.is_paused(), orders.pending_start().is_some()];
                Some([1.0, 2.0, 4.0].into_iter().zip(set).filter(|(_, set)| *set).map(|(bit, _)| bit).sum())
            }
        };
        finite.filter(|value| value.is_finite())
    }

    fn vector(&self, vector: Vector, now: Instant) -> Option<[f64; 3]> {
        let position = |at: Enu| [at.x, at.y, at.z];
        let euler = |attitude: Attitude| {
            let (roll, pitch, yaw) = attitude.euler();
            [roll, pitch, yaw].map(f64::to_degrees)
        };
        let parts = match vector {
            Vector::Position => position(self.position()?),
            Vector::Planned => position(self.planned_now(now)?.position_enu_m),
            Vector::Attitude => euler(self.turned()?),
            Vector::PlannedAttitude => euler(self.planned_now(now)?.attitude),
        };
        Some(parts).filter(|parts| parts.iter().all(|part| part.is_finite()))
    }

    /// Where the plan has the vehicle now, and how turned.
    fn planned_now(&self, now: Instant) -> Option<Sample> {
        self.phase.motion().map(|motion| motion.sample(now))
    }

    /// The autopilot's newest attitude.
    fn turned(&self) -> Option<Attitude> {
        self.autopilot.state().attitude.map(|attitude| attitude.value)
    }
}

/// How long it may take yet.
impl Executive {
    /// Until about the landing begins, if all goes by the plan; `None` where that is not known, or past.
    fn left(&self, now: Instant) -> Option<Duration> {
        let itinerary = self.itinerary.as_ref()?;
        let ways_home = itinerary.ways_home.as_ref();
        let way_home = ways_home.map_or(Duration::ZERO, |ways| ways[self.settings.role].duration());
        let next = self.service.slot_number();
        let slots =
            |slot, from_opening| itinerary.to_the_end(slot, from_opening).unwrap_or_default() + way_home;
        match &self.phase {
            Phase::Connecting | Phase::Standby | Phase::TakingControl(_) | Phase::Arming(_) => {
                Some(self.climb_time() + slots(0, false))
            }
            Phase::Climbing(motion) => Some(motion.ends_at().saturating_since(now) + slots(0, false)),
            Phase::InService { .. } => match self.service.slot() {
                None => Some(slots(next, false)),
                Some(slot) => {
                    let opens_at = slot.commitment.opens_at;
                    let whole = slots(slot.commitment.slot, true);
                    Some((opens_at + whole).saturating_since(now))
                }
            },
            Phase::Returning(motion) => Some(motion.ends_at().saturating_since(now)),
            Phase::Holding { .. } | Phase::Landing | Phase::Surrendered { .. } | Phase::Ended => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::str::FromStr;

    use strum::VariantArray;

    use super::*;

    #[test]
    fn spec_every_figure_and_vector_is_said_and_known_by_a_name_that_fits() {
        for figure in Figure::VARIANTS {
            let name: &'static str = figure.into();
            assert!(name.len() <= 10 && Figure::from_str(name) == Ok(*figure), "{name}");
            assert!(TURN.iter().any(|shown| matches!(shown, Shown::Figure(f) if f == figure)), "{name}");
        }
        for vector in Vector::VARIANTS {
            let name: &'static str = vector.into();
            assert!(name.len() <= 10 && Vector::from_str(name) == Ok(*vector), "{name}");
            assert!(TURN.iter().any(|shown| matches!(shown, Shown::Vector(v) if v == vector)), "{name}");
        }
    }

    #[test]
    fn spec_each_reason_for_silence_has_a_number_and_its_words() {
        let words: Vec<String> = (1..=12).map_while(silence_words).collect();
        assert_eq!(words.len(), 12);
        assert_eq!(words[8], Silence::NoLease.to_string());
        assert_eq!((silence_words(0), silence_words(13)), (None, None));
    }
}
