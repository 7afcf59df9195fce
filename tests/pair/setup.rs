//! The mission that is flown, and what the service is told of it.

use std::time::Duration;

use veilwing::geo::{Enu, Pose};
use veilwing::pair::{self, PlanTerms, SlotTerms};
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::track::{Followed, Track};
use veilwing::planner::turning::{Between, Course, Knot, Protected, Slot};
use veilwing::role::{PerVehicle, Role};
use veilwing::service::{self, Ceilings, Freshness, Settings, SlotService, Tolerance, Vehicle};
use veilwing::time::Instant;
use veilwing::transmitter::{self, Kind, Transmitter};

/// From the start of a transit to the opening of its slot; the vehicle has arrived after half of it.
pub const LEAD: Duration = Duration::from_secs(2);
pub const SLOT: Duration = Duration::from_secs(3);
pub const GUARD: Duration = Duration::from_secs(1);
pub const LEASE: Duration = Duration::from_millis(500);
pub const SLOTS: u16 = 8;
/// Between two messages of state, and between two decisions.
pub const TICK: Duration = Duration::from_millis(20);
/// Planned powers; I's vehicle file allows less (S6).
pub const PLANNED_W: PerVehicle<f64> = PerVehicle { i: 0.5, j: 0.25 };
pub const CAP_W: PerVehicle<f64> = PerVehicle { i: 0.4, j: 1.0 };

/// Poses and powers of a slot.
fn vehicles(slot: u16) -> PerVehicle<VehiclePlan> {
    let vehicle = |x: f64, tx_power_w| {
        let position_enu_m = Enu::new(x, 10.0, 80.0);
        VehiclePlan {
            pose: Pose { position_enu_m, roll_rad: 0.7, pitch_rad: -0.2, yaw_rad: 0.0 },
            tx_power_w,
        }
    };
    let slot = f64::from(slot);
    PerVehicle { i: vehicle(slot * 7.1, PLANNED_W.i), j: vehicle(100.0 + slot * 3.3, PLANNED_W.j) }
}

/// What is planned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flown {
    /// How many slots, and their length, of which [`GUARD`] is silence.
    pub slots: u16,
    pub length: Duration,
    /// Slots are served through the vehicles' turns from one place, and carry each other on.
    pub turning: bool,
    /// Motions are made anew in slots, this many in each.
    pub motions: u16,
    /// So are the poses of each slot.
    pub anew: bool,
    /// Slots that carry each other on are planned anew from the second on: who knows of that by itself.
    pub renews: Option<Role>,
}

/// Slots that are each agreed on.
impl Default for Flown {
    fn default() -> Self {
        Self { slots: SLOTS, length: SLOT, turning: false, motions: 0, anew: false, renews: None }
    }
}

impl Flown {
    fn plan(&self) -> PlanTerms {
        let tracks = self.turning.then(|| self.tracks());
        let terms = |slot: u16| SlotTerms {
            anew: None,
            vehicles: vehicles(if self.turning { 0 } else { slot }),
            tracks: match (&tracks, self.motions) {
                (Some(tracks), _) => Some(tracks[usize::from(slot)].clone()),
                (None, 0) if !self.anew => None,
                (None, _) => Some(at_rest(&vehicles(slot))),
            },
            lean_rad: PerVehicle { i: 0.0, j: 0.0 },
            jitter: None,
            opens: (LEAD + self.length) * u32::from(slot) + LEAD,
            lead: LEAD,
            carries_on_after: (self.turning && slot > 0).then_some(BETWEEN),
            radiate_from: GUARD / 2,
            radiate_until: self.length - GUARD / 2,
            length: self.length,
        };
        PlanTerms { digest: [7; 32], slots: (0..self.slots).map(terms).collect() }
    }

    /// A slot whose poses are made anew, or that is planned anew: the first, second, ... that is.
    pub fn terms_anew(&self, slot: u16, number: u32) -> Option<SlotTerms> {
        let is_anew = self.anew || self.renews.is_some();
        let mut terms = is_anew.then(|| self.plan().slots.into_iter().nth(usize::from(slot))).flatten()?;
        terms.anew = Some([number as u8; 8]);
        terms.vehicles.i.tx_power_w *= powered(number);
        if self.anew {
            terms.tracks = Some(at_rest(&terms.vehicles));
        } else {
            terms.carries_on_after = None;
        }
        Some(terms)
    }

    /// Both vehicles turn by 0.1 rad in the last quarter of the airtime, and by half a radian in the silence after it; J's power
    /// rises and falls meanwhile.
    fn tracks(&self) -> Vec<PerVehicle<Track>> {
        let (on_air_s, silence_s) = ((self.length - GUARD).as_secs_f64(), (GUARD + BETWEEN).as_secs_f64());
        let slots = (0..self.slots).map(|slot| {
            let begins_s = (on_air_s + silence_s) * f64::from(slot);
            let turned_rad = if slot % 2 == 0 { 0.0 } else { 0.6 };
            let knots = JAMMED.iter().enumerate().map(|(k, (share, power_w))| {
                let mut vehicles = vehicles(0);
                vehicles.i.pose.roll_rad -= turned_rad;
                vehicles.j.pose.roll_rad -= turned_rad;
                if k + 1 == JAMMED.len() {
                    let back_rad = if slot % 2 == 0 { -0.1 } else { 0.1 };
                    vehicles.i.pose.roll_rad += back_rad;
                    vehicles.j.pose.roll_rad += back_rad;
                }
                vehicles.j.tx_power_w = *power_w;
                let at_s = begins_s + share * on_air_s;
                Knot { at_s, vehicles, served: Some(usize::from(slot)), rate_bps: 1e6, tolerance: None }
            });
            let between = Between::Turn(PerVehicle { i: Course::Shortest, j: Course::EvenAngles });
            let (user, knots) = (usize::from(slot), knots.collect());
            Slot { user, on_air_s, silence_s, between, volume_bits: 1e6 * on_air_s, knots }
        });
        let superframe_s = (on_air_s + silence_s) * f64::from(self.slots);
        let mut tracks = Protected { slots: slots.collect(), superframe_s }.tracks(GUARD.as_secs_f64());
        if let Some(last) = tracks.last_mut() {
            *last = last.clone().map(Track::to_rest);
        }
        tracks
    }

    /// J's power in watts at a time since the opening: the share of the plan's that lies nearest.
    pub fn jammed_w(&self, since_opening_s: f64) -> f64 {
        if !self.turning {
            return PLANNED_W.j;
        }
        let share = (since_opening_s - GUARD.as_secs_f64() / 2.0) / (self.length - GUARD).as_secs_f64();
        let steps = &JAMMED[..JAMMED.len() - 1];
        steps[steps.partition_point(|(from, _)| *from <= share).max(1) - 1].1
    }
}

/// What poses of this number have I's power less by: nobody moves.
pub fn powered(number: u32) -> f64 {
    1.0 - 0.01 * f64::from(number)
}

/// Until a motion is taken up. Those of the model are numbers alone: nobody moves.
fn at_rest(vehicles: &PerVehicle<VehiclePlan>) -> PerVehicle<Track> {
    PerVehicle::from_fn(|role| Track::Followed(Followed::new(role, vehicles[role])))
}

/// Of a slot that is served through its turns: from these shares of the airtime on J radiates so many watts.
const JAMMED: [(f64, f64); 4] = [(0.0, 0.1), (0.5, PLANNED_W.j), (0.75, 0.15), (1.0, 0.0)];
/// From the close of a slot to the opening of the one that carries it on.
const BETWEEN: Duration = Duration::from_millis(200);

/// A vehicle whose state came last at `since`, in its pose for the slot, or ten metres off it.
pub fn vehicle(role: Role, slot: Option<&service::Slot>, since: Instant, pose_lost: bool) -> Vehicle {
    let turned = slot.and_then(|slot| {
        let since_s = since.seconds_since(slot.commitment.opens_at);
        slot.track.as_ref().map(|track| track.attitude(since_s))
    });
    let carried = |slot: &service::Slot| slot.track.as_ref().is_some_and(|track| track.followed().is_none());
    let place = slot.filter(|slot| !carried(slot)).map_or(0, |slot| slot.commitment.slot);
    let pose = vehicles(place)[role].pose;
    let off = Enu::new(if pose_lost { 10.0 } else { 0.0 }, 0.0, 0.0);
    Vehicle {
        state_received_at: Some(since),
        state_taken_from: Some(since),
        state_period: TICK,
        position: Some((pose.position_enu_m + off, since)),
        attitude: Some((turned.unwrap_or_else(|| pose.attitude()), since)),
        in_control: true,
        estimator_ok: true,
        home_enu_m: Some(Enu::zeros()),
        preflight_ok: true,
        ..Vehicle::default()
    }
}

/// MAVLink system of a vehicle.
pub fn system(role: Role) -> u8 {
    match role {
        Role::I => 1,
        Role::J => 2,
    }
}

/// A radio that takes numbered commands, as it is flown.
pub const NUMBERED: Kind = Kind::Numbered { command: 31010 };

/// The service of a companion that has just started, with this lease and plan.
pub fn service(role: Role, boot_id: u32, kind: Kind, lease: Duration, flown: &Flown) -> SlotService {
    let pair = pair::Settings {
        role,
        boot_id,
        mission_digest: [3; 32],
        lease,
        peer_timeout: Duration::from_secs(3),
        lost_after: Duration::from_secs(3),
        clock_tolerance: GUARD / 4,
        orders: pair::Record::default(),
    };
    let radio = transmitter::Settings {
        own: (system(role), 191),
        target: (system(role), 68),
        kind,
        boot: boot_id,
        longest_round_trip: LEASE * 3 / 10,
        apart: false,
        system_is_given: false,
        first_off_after: if role == Role::J { LEASE } else { Duration::ZERO },
    };
    let settings = Settings {
        pair,
        ceilings: Ceilings { mission_w: 1.0, vehicle_w: CAP_W[role] },
        emission_authorised: true,
        freshness: Freshness { limit: Duration::from_millis(250), scheduling_allowance: Duration::ZERO },
    };
    let transmitter = Transmitter::new(radio, Instant::ZERO);
    let mut service = SlotService::new(settings, transmitter, Tolerance::for_jitter(0.0), Instant::ZERO);
    service.set_plan(flown.plan());
    service
}
