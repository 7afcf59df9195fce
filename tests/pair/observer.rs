//! Judges a simulated pair: S1 to S6 on true powers, poses and deaths.

use std::time::Duration;

use veilwing::role::{PerVehicle, Role};

use super::companion::Companion;
use super::radio::{Emission, Radio};
use super::setup::{CAP_W, Flown, LEASE, PLANNED_W};
use super::world::Seen;

/// Sees true powers and true faults.
#[derive(Default)]
pub struct Observer {
    pub seen: Seen,
    flown: Flown,
    /// J's grants: the slot, and until when J promised to jam, in true time.
    pub granted: Option<(u16, Duration)>,
    pub served_now: bool,
    since: Duration,
    i_protected: bool,
    bare_since: Option<Duration>,
    pub j_fault_at: Option<Duration>,
    pub died_at: PerVehicle<Option<Duration>>,
    pub pose_lost_at: PerVehicle<Option<Duration>>,
    pub stale_since: PerVehicle<Option<Duration>>,
    /// By the operator, at this vehicle.
    pub paused_at: Option<(Role, Duration)>,
    uncommitted_since: PerVehicle<Option<Duration>>,
    off_user_since: Option<Duration>,
}

/// A fault of J excuses I's lack of protection for the longest lease and the wire.
const EXCUSE: Duration = Duration::from_millis(520);
/// S4: own pose; a tick and the radio's wire on top of nothing, since evidence is immediate here.
const POSE_REACTION: Duration = Duration::from_millis(100);
/// Between two messages of state.
const PERIOD: Duration = Duration::from_millis(20);
/// No state is older than this that is used for anything, and the way of a command.
const STATE_LIMIT: Duration = Duration::from_millis(250 + 20);
/// What a vehicle holds of an attitude while nothing jitters.
const OFF_USER_RAD: f64 = 0.05;
/// Longest way of a command to a radio.
pub const RADIO_WAY_MS: f64 = 15.0;

impl Observer {
    pub fn new(flown: Flown) -> Self {
        Self { flown, ..Self::default() }
    }

    /// Looks at the state that holds from `t` on.
    pub fn look(&mut self, t: Duration, world: &PerVehicle<Option<Companion>>, radios: &PerVehicle<Radio>) {
        let on = PerVehicle::from_fn(|role| radios[role].emission(t));
        if self.i_protected {
            self.seen.airtime += t - self.since;
        }
        self.since = t;
        for role in Role::BOTH {
            let Some(emission) = on[role] else {
                // What a companion that died left on is over; from here on its successor answers for the radio.
                if world[role].is_some() {
                    self.died_at[role] = None;
                }
                self.uncommitted_since[role] = None;
                continue;
            };
            let cap = PLANNED_W[role].min(CAP_W[role]);
            if emission.power_w > cap * (1.0 + 1e-9) {
                self.violate(t, format!("S6: {role} radiates {} W, {cap} W is allowed", emission.power_w));
            }
            // What was commanded before a fault or an abort is on its way, or on: off follows within S4's time.
            let slot = world[role].as_ref().and_then(|c| c.service.slot());
            let slot = slot.map(|slot| slot.commitment.slot.into());
            if world[role].is_none() || self.died_at[role].is_some() || slot == Some(emission.slot) {
                self.uncommitted_since[role] = None;
            } else {
                let since = *self.uncommitted_since[role].get_or_insert(t);
                if t > since + POSE_REACTION {
                    let name = if role == Role::I { "S1" } else { "S2" };
                    self.violate(
                        t,
                        format!("{name}: {role} radiates in slot {}, committed to {slot:?}", emission.slot),
                    );
                }
            }
            if let Some(died) = self.died_at[role] {
                self.seen.dead = self.seen.dead.max(t - died);
                if t > died + LEASE + Duration::from_millis(20) {
                    self.violate(t, format!("S5: {role} radiates {:?} after its companion died", t - died));
                }
            }
            self.judge_silence(t, role);
            if let Some(lost) = self.pose_lost_at[role] {
                self.seen.out_of_pose = self.seen.out_of_pose.max(t - lost);
                let dead = self.died_at[role].is_some();
                if t > lost + POSE_REACTION && !dead {
                    self.violate(t, format!("S4: {role} radiates {:?} after it left its pose", t - lost));
                }
            }
        }
        if let Some(j) = world.j.as_ref().filter(|_| on.j.is_some()) {
            self.judge_turn(t, j.off_user_rad(t));
        }
        // Where it changes, the plan's power is what J's clock says; of one that has died it is what it was.
        let jammed_w = match &world.j {
            _ if !self.flown.turning => PLANNED_W.j,
            Some(j) => j.jammed_w(&self.flown, t),
            None => 0.0,
        };
        self.order(t, on.i, on.j, jammed_w);
    }

    /// A jammer that is on has its null where the user is; what it turns before it hears that I is off is the wire's.
    fn judge_turn(&mut self, t: Duration, off_user_rad: f64) {
        self.off_user_since = (off_user_rad > OFF_USER_RAD).then(|| self.off_user_since.unwrap_or(t));
        if self.off_user_since.is_some_and(|since| t > since + POSE_REACTION) {
            self.violate(t, format!("S2: J radiates {off_user_rad} rad off its user"));
        }
    }

    /// A radio that is on while there is no state, or while the operator has paused the pair.
    fn judge_silence(&mut self, t: Duration, role: Role) {
        if self.died_at[role].is_some() {
            return;
        }
        // The first message that does not come is the evidence; what J has granted it keeps, on state that is not old.
        let owed = self.granted.is_some_and(|(_, until)| role == Role::J && t < until + POSE_REACTION);
        let reaction =
            if owed { STATE_LIMIT.saturating_sub(PERIOD) } else { Duration::ZERO }.max(POSE_REACTION);
        if let Some(stale) = self.stale_since[role].filter(|since| t > *since + PERIOD + reaction) {
            self.violate(t, format!("S4: {role} radiates {:?} after its state stopped", t - stale));
        }
        let promised = if role == Role::J { LEASE } else { Duration::ZERO };
        let paused =
            self.paused_at.filter(|(at_role, at)| *at_role == role && t > *at + promised + POSE_REACTION);
        if let Some((_, at)) = paused {
            self.violate(t, format!("S2: {role} radiates {:?} after the operator's pause", t - at));
        }
    }

    /// S1 and S3 on true powers.
    fn order(&mut self, t: Duration, i: Option<Emission>, j: Option<Emission>, jammed_w: f64) {
        // The wire counts thousandths of a decibel.
        let full_w = 0.999 * jammed_w.min(CAP_W.j);
        let protected = i.is_some_and(|i| j.is_some_and(|j| i.slot == j.slot && j.power_w >= full_w));
        self.i_protected = protected;
        self.served_now |= protected;
        let Some(i) = i else {
            self.bare_since = None;
            return;
        };
        let lease = self.granted.filter(|(slot, until)| i32::from(*slot) == i.slot && t < *until);
        if lease.is_none() {
            self.violate(
                t,
                format!("S1: I radiates in slot {} on no lease of J: {:?}", i.slot, self.granted),
            );
        }
        if protected {
            self.bare_since = None;
            return;
        }
        let since = *self.bare_since.get_or_insert(t);
        let excused = self.j_fault_at.is_some_and(|at| t <= at + EXCUSE);
        self.seen.exposed = self.seen.exposed.max(t - since);
        if !excused {
            self.violate(t, format!("S3: I radiates without J in slot {}", i.slot));
        }
    }

    pub fn violate(&mut self, t: Duration, what: String) {
        if self.seen.violations.len() < 20 {
            self.seen.violations.push(format!("{:.4} s: {what}", t.as_secs_f64()));
        }
    }
}
