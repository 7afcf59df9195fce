//! What the executive tells the coordinator, and what it is told.

use std::num::{NonZeroU8, NonZeroU16};
use std::time::Duration;

use super::super::orders::{Change, Record};
use super::super::wire::{self, ShortDigest, VeilwingAnswer, VeilwingFlags, VeilwingSilence};
use crate::geo::{Attitude, Enu, EnuVelocity, has_meaning};
use crate::planner::following::{Belief, Drift, MOST_MOVERS};
use crate::planner::plan::VehiclePlan;
use crate::planner::track::Track;
use crate::role::{PerVehicle, Role};
use crate::time::{Instant, Utc};

/// What does not change while the companion runs.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Our part; I leads.
    pub role: Role,
    /// Drawn anew at each start.
    pub boot_id: u32,
    /// SHA-256 of the mission's meaning.
    pub mission_digest: [u8; 32],
    /// The longest lease J grants, and the longest silence of the peer that J jams through.
    pub lease: Duration,
    /// After this long without a message the peer is not heard any more.
    pub peer_timeout: Duration,
    /// After this long it is lost, no sooner than that.
    pub lost_after: Duration,
    /// The largest difference between the two UTC clocks that the guard time covers.
    pub clock_tolerance: Duration,
    /// What an earlier process kept of the operator's orders.
    pub orders: Record,
}

/// The plan both sides must share.
#[derive(Debug, Clone)]
pub struct PlanTerms {
    /// SHA-256 of the plan.
    pub digest: [u8; 32],
    /// By slot number, over all superframes.
    pub slots: Vec<SlotTerms>,
}

impl PlanTerms {
    /// What a proposal of a slot is known by.
    pub(super) fn digest_of(&self, terms: &SlotTerms) -> ShortDigest {
        terms.anew.unwrap_or_else(|| wire::short(&self.digest))
    }

    /// Whether `slot` can follow where `next` is to be agreed on: that one, or the one before where it carries on another: the
    /// other side may not have begun it, and both are where it is served, unless they move.
    #[must_use]
    pub fn can_follow(&self, slot: u16, next: u16) -> bool {
        let again = || {
            self.slots
                .get(usize::from(slot))
                .is_some_and(|terms| terms.carries_on_after.is_some() && !terms.is_in_motion())
        };
        slot == next || slot.checked_add(1) == Some(next) && again()
    }
}

/// One slot of the plan, as the slot table has it.
#[derive(Debug, Clone, PartialEq)]
pub struct SlotTerms {
    /// Of a slot whose poses were made anew: first bytes of a digest over all that they and the way to them depend on.
    pub anew: Option<ShortDigest>,
    /// Poses and powers; of a slot that is served through its turns those between two turns.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// How the vehicles turn, and J's power with them, in a slot that is served through its turns.
    pub tracks: Option<PerVehicle<Track>>,
    /// The largest tilt from its pose that the slot bears of each vehicle, radians; 0 of one that has no reason to lean.
    pub lean_rad: PerVehicle<f64>,
    /// How much our own vehicle jitters, where the slot is planned for that.
    pub jitter: Option<MeasuredJitter>,
    /// From the instant that the slot table counts from to the slot's opening.
    pub opens: Duration,
    /// The transit to the slot begins this long before its opening.
    pub lead: Duration,
    /// The slot carries on the one before, from the same positions: where that one ends by the clock on both sides, it opens so
    /// long after, under the same proposal.
    pub carries_on_after: Option<Duration>,
    /// I may radiate from this long after the opening ...
    pub radiate_from: Duration,
    /// ... to this long after it.
    pub radiate_until: Duration,
    /// From the opening to the close.
    pub length: Duration,
}

/// Somebody that moves, as the wire has it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Drifting {
    /// 0 the slot's user, from 1 on the eavesdroppers in the mission's order.
    pub who: u8,
    /// Where it is believed to be, in decimetres, ENU.
    pub position_enu_dm: [i16; 3],
    /// In cm/s, ENU.
    pub velocity_enu_cm_s: [i16; 3],
    /// Standard deviations of the place in quarters of a metre: of east and of north, and of up.
    pub std_quarter_m: [u8; 2],
}

impl Drifting {
    /// To the nearest of what the wire can say; `None` of a place, or a speed, beyond that, and of what is no number.
    #[must_use]
    pub fn of(who: u8, belief: &Belief) -> Option<Self> {
        let whole = |value: f64| {
            let value = value.round();
            (f64::from(i16::MIN)..=f64::from(i16::MAX)).contains(&value).then_some(value as i16)
        };
        let all = |v: &Enu, times: f64| Some([whole(times * v.x)?, whole(times * v.y)?, whole(times * v.z)?]);
        Some(Self {
            who,
            position_enu_dm: all(&belief.position_enu_m, 10.0)?,
            velocity_enu_cm_s: all(&belief.velocity_enu_m_s.vector(), 100.0)?,
            // No less than it is.
            std_quarter_m: belief.std_m.map(|std_m| (4.0 * std_m).ceil().clamp(0.0, 255.0) as u8),
        })
    }

    /// What is believed of it from then on, by the time since the slot's opening: the same numbers on both vehicles.
    #[must_use]
    pub fn drift(&self, begins_s: f64) -> Drift {
        let vector = |v: [i16; 3], unit: f64| Enu::from(v.map(|c| f64::from(c) * unit));
        Drift {
            at_s: begins_s,
            belief: Belief {
                position_enu_m: vector(self.position_enu_dm, 0.1),
                velocity_enu_m_s: EnuVelocity::from_vector(vector(self.velocity_enu_cm_s, 0.01)),
                std_m: self.std_quarter_m.map(|quarters| 0.25 * f64::from(quarters)),
            },
        }
    }
}

/// The number of a motion that VEILWING_PLACES has where it is for the poses of a slot, and for no motion in it.
pub const OF_POSES: u16 = 0;

/// A jitter that was measured, per axis, in hundredths of a degree: both companions reckon with this number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MeasuredJitter(NonZeroU16);

impl MeasuredJitter {
    /// Who jitters more than this tumbles, degrees.
    const MOST_DEG: f64 = 10.0;

    /// To the nearest of what the wire can say, of a standard deviation in radians.
    #[must_use]
    pub fn of(std_rad: f64) -> Self {
        let deg = std_rad.to_degrees().clamp(0.0, Self::MOST_DEG);
        Self(NonZeroU16::new((100.0 * deg).round() as u16).unwrap_or(NonZeroU16::MIN))
    }

    /// Standard deviation in radians.
    #[must_use]
    pub fn std_rad(self) -> f64 {
        (0.01 * f64::from(self.0.get())).to_radians()
    }

    pub(in super::super) fn of_wire(cdeg: u16) -> Option<Self> {
        NonZeroU16::new(cdeg).map(|cdeg| Self::of((0.01 * f64::from(cdeg.get())).to_radians()))
    }

    pub(in super::super) fn to_wire(told: Option<Self>) -> u16 {
        told.map_or(0, |Self(cdeg)| cdeg.get())
    }
}

/// What a vehicle makes in this wind of the largest speed that the mission lets it have, in percent: both companions reckon with this
/// number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pace(NonZeroU8);

impl Pace {
    /// Who makes less is not planned for: it may not get there at all.
    const LEAST_PERCENT: f64 = 10.0;
    /// Added after a slot in which it kept up.
    const STEP: f64 = 0.1;

    /// To the nearest of what the wire can say; `None` of one that makes all of it.
    #[must_use]
    pub fn of(share: f64) -> Option<Self> {
        let percent = (100.0 * share).round().max(Self::LEAST_PERCENT);
        NonZeroU8::new(percent as u8).filter(|_| percent < 100.0).map(Self)
    }

    /// Of the largest speed.
    #[must_use]
    pub fn share(self) -> f64 {
        0.01 * f64::from(self.0.get())
    }

    /// The next that is tried.
    #[must_use]
    pub fn faster(self) -> Option<Self> {
        Self::of(self.share() + Self::STEP)
    }

    pub(in super::super) fn of_wire(percent: u8) -> Option<Self> {
        NonZeroU8::new(percent).and_then(|percent| Self::of(0.01 * f64::from(percent.get())))
    }

    pub(in super::super) fn to_wire(told: Option<Self>) -> u8 {
        told.map_or(0, |Self(percent)| percent.get())
    }
}

/// What is believed of those that move in a slot, at an instant, and of the vehicles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Places {
    /// The instant, after the slot's opening.
    pub begins_ms: u32,
    /// The jitter to be planned for, where it is not what the mission says.
    pub jitter: Option<MeasuredJitter>,
    /// The speeds to be planned for, where they are not what the mission says.
    pub paces: PerVehicle<Option<Pace>>,
    count: usize,
    moving: [Drifting; MOST_MOVERS],
}

impl Places {
    /// Nobody moves.
    #[must_use]
    pub fn new(begins_ms: u32) -> Self {
        Self {
            begins_ms,
            jitter: None,
            paces: PerVehicle::default(),
            count: 0,
            moving: [Drifting::default(); MOST_MOVERS],
        }
    }

    /// Another one that moves; one too many is left out.
    pub fn push(&mut self, drifting: Drifting) {
        if let Some(place) = self.moving.get_mut(self.count) {
            *place = drifting;
            self.count += 1;
        }
    }

    /// Those that move.
    pub fn moving(&self) -> impl Iterator<Item = &Drifting> {
        self.moving[..self.count].iter()
    }

    /// The instant after the slot's opening.
    #[must_use]
    pub fn begins(&self) -> Duration {
        Duration::from_millis(self.begins_ms.into())
    }
}

/// Where a vehicle rests, as the wire has it: both companions reckon with these numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    /// Its place in metres, ENU.
    pub position_enu_m: [f32; 3],
    /// Its attitude as MAVLink has it: body FRD to NED, w, x, y, z.
    pub wxyz: [f32; 4],
}

impl Rest {
    /// Of a vehicle that is to be there.
    #[must_use]
    pub fn of(position_enu_m: &Enu, attitude: &Attitude) -> Self {
        let position_enu_m = [position_enu_m.x, position_enu_m.y, position_enu_m.z].map(|m| m as f32);
        Self { position_enu_m, wxyz: attitude.to_mavlink().map(|part| part as f32) }
    }

    /// What is said by wire; `None` of a vehicle that does not rest, and of what has no meaning.
    pub(in super::super) fn of_wire(position_enu_m: [f32; 3], wxyz: [f32; 4]) -> Option<Self> {
        let rest = Self { position_enu_m, wxyz };
        let (place, _) = rest.pose()?;
        has_meaning(&place).then_some(rest)
    }

    /// Place and attitude; `None` of one that is none.
    #[must_use]
    pub fn pose(&self) -> Option<(Enu, Attitude)> {
        let attitude = Attitude::from_mavlink(self.wxyz.map(f64::from))?;
        Some((Enu::from(self.position_enu_m.map(f64::from)), attitude))
    }
}

/// A slot whose poses are to be made anew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AskedSlot {
    /// The proposal that it is for; 0 where it is not proposed yet.
    pub proposal: u32,
    /// Its number over superframes.
    pub slot: u16,
    /// For whom, at its opening.
    pub places: Places,
}

/// Local facts that the peer is told.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Local {
    /// Our home.
    pub home_enu_m: Option<Enu>,
    /// Our position.
    pub position_enu_m: Option<Enu>,
    /// Where we rest, between slots whose poses are made anew.
    pub rests: Option<Rest>,
    /// Our jitter in the last slot, where it is another than the mission says.
    pub jitter: Option<MeasuredJitter>,
    /// What we make in this wind, where it is less than the mission says.
    pub pace: Option<Pace>,
    /// No preflight check fails.
    pub preflight_ok: bool,
    /// In the air and in control.
    pub airborne: bool,
    /// Own pose inside tolerance for the committed slot.
    pub on_station: bool,
    /// Own transmitter not known to be off.
    pub radiating: bool,
    /// Mission over for us.
    pub ended: bool,
    /// On the ground.
    pub landed: bool,
    /// Flying home under our control, or about to.
    pub returning: bool,
    /// Our autopilot's land detector is held off: without our companion the vehicle cannot land by itself.
    pub guarding: bool,
}

impl Local {
    /// As the wire has them. `planned`: our plan is made; `committed`: to a slot.
    pub(super) fn flags(&self, planned: bool, committed: bool) -> VeilwingFlags {
        let mut flags = VeilwingFlags::empty();
        flags.set(VeilwingFlags::VEILWING_FLAGS_PLANNED, planned);
        flags.set(VeilwingFlags::VEILWING_FLAGS_HOME, self.home_enu_m.is_some());
        flags.set(VeilwingFlags::VEILWING_FLAGS_PREFLIGHT_OK, self.preflight_ok);
        flags.set(VeilwingFlags::VEILWING_FLAGS_AIRBORNE, self.airborne);
        flags.set(VeilwingFlags::VEILWING_FLAGS_ON_STATION, self.on_station);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RADIATING, self.radiating);
        flags.set(VeilwingFlags::VEILWING_FLAGS_COMMITTED, committed);
        flags.set(VeilwingFlags::VEILWING_FLAGS_ENDED, self.ended);
        flags.set(VeilwingFlags::VEILWING_FLAGS_LANDED, self.landed);
        flags.set(VeilwingFlags::VEILWING_FLAGS_RETURNING, self.returning);
        flags.set(VeilwingFlags::VEILWING_FLAGS_GUARDING, self.guarding);
        flags
    }
}

impl SlotTerms {
    /// Whether the motion in it is made anew while it is served.
    #[must_use]
    pub fn follows(&self) -> bool {
        self.tracks.as_ref().is_some_and(|tracks| tracks.i.followed().is_some())
    }

    /// Whether the vehicles move while it is served.
    #[must_use]
    pub fn is_in_motion(&self) -> bool {
        self.tracks.as_ref().is_some_and(|tracks| tracks.i.is_in_motion())
    }
}

/// A slot both sides have agreed on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Commitment {
    /// The proposal's number in I's boot.
    pub proposal: u32,
    /// Slot number over superframes.
    pub slot: u16,
    /// When it opens, on our monotonic clock; frozen here, so that a step of UTC cannot move a running slot.
    pub opens_at: Instant,
    /// The same by I's clock.
    pub opens: Utc,
    /// When the transit to it begins.
    pub leaves_at: Instant,
}

/// J's vouching: what a lease may rest on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vouch {
    /// Not before this does J's own transmitter fall silent, whatever becomes of J's companion.
    pub until: Instant,
    /// No lease reaches past this.
    pub closes_at: Instant,
}

/// What the executive must know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Event {
    /// First message of the peer.
    PeerFound,
    /// Nothing heard for this long.
    PeerLost(Duration),
    /// The peer's companion restarted; whatever was agreed is void.
    PeerRestarted,
    /// The peer flies another mission.
    MissionDiffers,
    /// The peer made another plan of the same mission.
    PlanDiffers,
    /// Both companions are configured for the same role.
    SameRole,
    /// Our proposal of this slot was refused, or not agreed on in time.
    Refused(u16, VeilwingAnswer),
    /// A slot is agreed.
    Committed(Commitment),
    /// The peer is not, or no longer, committed to the slot that we are committed to.
    PeerLeft,
    /// The peer fell silent out of turn.
    PeerSilent(VeilwingSilence),
    /// What has come about by an operator's order, given here or at the peer.
    Ordered(Change),
    /// The motion that is asked for ([`super::Coordinator::asked_motion`]) is to be planned, and what is found to be told by
    /// [`super::Coordinator::motion_planned`].
    PlanMotion,
    /// The motion of this number is flown from its beginning on.
    TakeUp(u16),
    /// J: I proposes a slot whose poses are to be made anew, for those that move, and what is found to be told by
    /// [`super::Coordinator::slot_planned`].
    PlanSlot(AskedSlot),
}

#[cfg(test)]
mod tests {
    use super::super::tests::{followed, terms as still};
    use super::*;

    fn terms(carries_on_after: Option<Duration>, follows: bool) -> SlotTerms {
        let terms = SlotTerms { carries_on_after, ..still() };
        if follows { followed(terms) } else { terms }
    }

    #[test]
    fn spec_the_slot_before_can_follow_where_it_carries_on_another_and_both_stay_where_they_are() {
        let carries = Some(Duration::from_secs(3));
        let slots = vec![terms(None, false), terms(carries, false), terms(carries, true), terms(None, false)];
        let plan = PlanTerms { digest: [0; 32], slots };
        let follows: Vec<(u16, u16)> = (0..4)
            .flat_map(|slot| (0..5).map(move |next| (slot, next)))
            .filter(|(slot, next)| plan.can_follow(*slot, *next))
            .collect();
        assert_eq!(follows, [(0, 0), (1, 1), (1, 2), (2, 2), (3, 3)]);
        assert!(plan.can_follow(u16::MAX, u16::MAX) && !plan.can_follow(u16::MAX, 0));
    }

    #[test]
    fn spec_a_jitter_comes_back_from_the_wire_and_none_is_told_by_nothing() {
        for (deg, cdeg) in [(6.0, 600), (1.234, 123), (0.0, 1), (90.0, 1000), (f64::NAN, 1)] {
            let jitter = MeasuredJitter::of(f64::to_radians(deg));
            assert_eq!(MeasuredJitter::to_wire(Some(jitter)), cdeg);
            assert_eq!(MeasuredJitter::of_wire(cdeg), Some(jitter));
        }
        assert_eq!(MeasuredJitter::of_wire(u16::MAX), Some(MeasuredJitter::of(9.0)));
        assert_eq!((MeasuredJitter::of_wire(0), MeasuredJitter::to_wire(None)), (None, 0));
        assert!((MeasuredJitter::of(0.1).std_rad() - 0.1).abs() < 1e-4);
    }

    #[test]
    fn spec_a_pace_comes_back_from_the_wire_and_none_is_told_by_nothing() {
        for (share, percent) in
            [(0.3, 30), (0.234, 23), (0.04, 10), (-3.0, 10), (f64::NAN, 10), (0.999, 0), (1.0, 0), (9.0, 0)]
        {
            let pace = Pace::of(share);
            assert_eq!(Pace::to_wire(pace), percent, "{share}");
            assert_eq!(Pace::of_wire(percent), pace);
        }
        assert_eq!((Pace::of_wire(1), Pace::of_wire(u8::MAX)), (Pace::of(0.1), None));
        assert_eq!(Pace::of(0.5).and_then(Pace::faster), Pace::of(0.6));
        assert_eq!(Pace::of(0.95).and_then(Pace::faster), None);
    }

    #[test]
    fn spec_who_follows_moves_and_who_has_no_track_does_not() {
        assert!(terms(None, true).follows() && terms(None, true).is_in_motion());
        assert!(!terms(None, false).follows() && !terms(None, false).is_in_motion());
    }

    #[test]
    fn spec_a_rest_comes_back_from_the_wire_and_what_is_none_does_not() {
        let attitude = Attitude::from_euler(0.3, -0.4, 0.5);
        let place = Enu::new(1.5, -2.25, 80.0);
        let rest = Rest::of(&place, &attitude);
        assert_eq!(Rest::of_wire(rest.position_enu_m, rest.wxyz), Some(rest));
        let (back, turned) = rest.pose().unwrap();
        assert!(back == place && turned.rotation().angle_to(&attitude.rotation()) < 1e-6);
        assert_eq!(Rest::of_wire(rest.position_enu_m, [0.0; 4]), None);
        assert_eq!(Rest::of_wire([f32::NAN, 0.0, 0.0], rest.wxyz), None);
        assert_eq!(Rest::of_wire([1e30, 0.0, 0.0], rest.wxyz), None);
    }
}
