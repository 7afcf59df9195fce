//! J's half: judges proposals, and grants leases on what it vouches for.

use std::time::Duration;

use crate::planner::plan::VehiclePlan;
use crate::time::Instant;

use super::super::lease::Book;
use super::super::wire::{self, MavMessage, VeilwingAnswer};
use super::shared_time::SharedTime;
use super::terms::{AskedSlot, Commitment, Event, Places, PlanTerms, SlotTerms, Vouch};

/// J commits no later than this before its transit begins: time for several statuses, of which I must hear one.
const CONFIRM: Duration = Duration::from_millis(300);
/// Poses and powers travel as f32: what is equal in f64 differs by this much relative to its size after the trip.
const WIRE_TOLERANCE: f64 = 1e-6;

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Follower {
    /// The slot that comes next, if we are ready for one.
    pub readiness: Option<u16>,
    /// Accepted; awaits I's commit.
    accepted: Option<Commitment>,
    /// Proposals up to this one of I's present boot are over.
    finished: u32,
    /// The slot that I proposed last, since the last one was over.
    pub asked: Option<u16>,
    /// For whom the poses of the slot of this proposal are made.
    told: Option<(u32, Places)>,
    /// The slot that is made anew for a proposal, and whether that is done.
    anew: Option<(AskedSlot, bool)>,
    /// The proposal that waits for it.
    waits: Option<Box<wire::VEILWING_PROPOSE_DATA>>,
    pub vouch: Option<Vouch>,
    pub book: Book,
}

impl Follower {
    /// Whether a proposal awaits its commit.
    pub fn is_accepting(&self) -> bool {
        self.accepted.is_some()
    }

    /// What was agreed on, or about to be, is over.
    pub fn release(&mut self, commitment: Option<Commitment>) {
        let over = [commitment, self.accepted.take()].into_iter().flatten().map(|c| c.proposal).max();
        self.finished = self.finished.max(over.unwrap_or(0));
        self.vouch = None;
        (self.asked, self.told, self.anew, self.waits) = (None, None, None, None);
    }

    /// I restarted: its proposals and its clock begin anew.
    pub fn new_boot(&mut self) {
        self.finished = 0;
        self.book.new_boot();
    }

    /// For whom the poses of a slot that I proposes are made.
    pub fn take_places(&mut self, proposal: u32, places: Places) {
        if proposal > self.finished {
            self.told = Some((proposal, places));
        }
    }

    /// Whether the slot that is asked for is to be made anew still, and for that proposal: then it is done with this. What was
    /// accepted before is none any more.
    pub fn made_anew(&mut self, asked: &AskedSlot) -> bool {
        let awaited = self.anew.as_ref() == Some(&(*asked, false));
        if awaited {
            (self.anew, self.accepted) = (Some((*asked, true)), None);
        }
        awaited
    }

    /// The proposal that waited for it, to be judged now.
    pub fn take_waiting(&mut self) -> Option<Box<wire::VEILWING_PROPOSE_DATA>> {
        self.waits.take()
    }

    /// What is to be planned before a proposal can be judged, if that is not under way: a slot whose poses are made anew for it.
    /// `None`: it can be judged.
    fn awaits(
        &mut self,
        propose: &wire::VEILWING_PROPOSE_DATA,
        plan: Option<&PlanTerms>,
    ) -> Option<Option<Event>> {
        let places = self.told.filter(|(proposal, _)| *proposal == propose.proposal);
        let terms = plan?.slots.get(usize::from(propose.slot));
        let terms = terms.filter(|terms| terms.follows() || places.is_some())?;
        let as_planned = propose.plan_digest == wire::short(&plan?.digest) && terms.anew.is_none();
        if self.readiness != Some(propose.slot) || as_planned {
            return None;
        }
        match &self.anew {
            Some((asked, done)) if asked.proposal == propose.proposal => (!done).then_some(None),
            _ => {
                let (proposal, slot) = (propose.proposal, propose.slot);
                let asked = places.map(|(_, places)| AskedSlot { proposal, slot, places });
                self.anew = asked.map(|asked| (asked, false)).or(self.anew);
                self.waits = asked.map(|_| Box::new(propose.clone()));
                Some(asked.map(Event::PlanSlot))
            }
        }
    }

    /// Answers a copy of a proposal, or says what is to be planned first; nothing for one that is over.
    pub fn take_proposal(
        &mut self,
        propose: &wire::VEILWING_PROPOSE_DATA,
        committed: Option<Commitment>,
        plan: Option<&PlanTerms>,
        time: &SharedTime,
        now: Instant,
    ) -> (Option<Event>, Option<MavMessage>) {
        if propose.proposal <= self.finished {
            return (None, None);
        }
        self.asked = Some(propose.slot);
        if committed.is_none()
            && let Some(event) = self.awaits(propose, plan)
        {
            return (event, None);
        }
        let answer = match committed {
            Some(commitment) if commitment.proposal == propose.proposal => {
                VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
            }
            // A late copy of an earlier proposal must not displace the slot that is being flown.
            Some(commitment) if commitment.proposal > propose.proposal => return (None, None),
            _ => match self.judge(propose, plan, time, now) {
                Ok(commitment) => {
                    let newer = self.accepted.is_none_or(|known| known.proposal < propose.proposal);
                    if newer && committed.is_none() {
                        self.accepted = Some(commitment);
                    }
                    VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
                }
                Err(refusal) => refusal,
            },
        };
        let answer =
            wire::VEILWING_ANSWER_DATA { boot_id: propose.boot_id, proposal: propose.proposal, answer };
        (None, Some(MavMessage::VEILWING_ANSWER(answer)))
    }

    /// Judges a proposal by our own plan, readiness and clock.
    fn judge(
        &self,
        propose: &wire::VEILWING_PROPOSE_DATA,
        plan: Option<&PlanTerms>,
        time: &SharedTime,
        now: Instant,
    ) -> Result<Commitment, VeilwingAnswer> {
        let (Some(plan), Some(next)) = (plan, self.readiness) else {
            return Err(VeilwingAnswer::VEILWING_ANSWER_NOT_READY);
        };
        let terms = plan.slots.get(usize::from(propose.slot));
        let digest = terms.map_or(wire::short(&plan.digest), |terms| plan.digest_of(terms));
        if propose.plan_digest != digest {
            return Err(VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN);
        }
        // Only the very next: the transit to any other begins where J is not.
        let terms: Option<&SlotTerms> = terms.filter(|_| plan.can_follow(propose.slot, next));
        let terms = terms.ok_or(VeilwingAnswer::VEILWING_ANSWER_WRONG_SLOT)?;
        let vehicles = &terms.vehicles;
        if !same(&propose.i_position_enu_m, &propose.i_euler_rad, propose.i_power_w, &vehicles.i)
            || !same(&propose.j_position_enu_m, &propose.j_euler_rad, propose.j_power_w, &vehicles.j)
        {
            return Err(VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN);
        }
        let opens = crate::time::Utc { unix_us: propose.opens_utc_us };
        let opens_at = match &terms.tracks {
            // Who turns on the air does so by I's clock.
            Some(_) => time.instant_by_peer(opens),
            None => time.instant_of(opens),
        };
        let opens_at = opens_at.filter(|_| time.agrees());
        let opens_at = opens_at.ok_or(VeilwingAnswer::VEILWING_ANSWER_CLOCK)?;
        if opens_at < now + terms.lead + CONFIRM {
            return Err(VeilwingAnswer::VEILWING_ANSWER_TOO_LATE);
        }
        let leaves_at = opens_at - terms.lead;
        Ok(Commitment { proposal: propose.proposal, slot: propose.slot, opens_at, opens, leaves_at })
    }

    /// Commits, if it is still ready and there is still time to say so.
    pub fn take_commit(
        &mut self,
        commit: &wire::VEILWING_COMMIT_DATA,
        plan: Option<&PlanTerms>,
        now: Instant,
    ) -> Option<Commitment> {
        let commitment = self.accepted.take_if(|accepted| accepted.proposal == commit.proposal)?;
        let ready =
            self.readiness.zip(plan).is_some_and(|(next, plan)| plan.can_follow(commitment.slot, next));
        if !ready || now + CONFIRM > commitment.leaves_at {
            self.finished = self.finished.max(commitment.proposal);
            return None;
        }
        Some(commitment)
    }

    /// Grants what can be vouched for; `None` if that is nothing.
    pub fn take_request(
        &mut self,
        request: &wire::VEILWING_LEASE_REQUEST_DATA,
        commitment: Commitment,
        plan: &PlanTerms,
        longest: Duration,
        now: Instant,
    ) -> Option<MavMessage> {
        let vouch = self.vouch?;
        let granted = self.book.grant(request.time_us, vouch.until, longest, vouch.closes_at, now)?;
        Some(MavMessage::VEILWING_LEASE_GRANT(wire::VEILWING_LEASE_GRANT_DATA {
            time_us: request.time_us,
            boot_id: request.boot_id,
            proposal: commitment.proposal,
            slot: commitment.slot,
            duration_ms: u16::try_from(granted.as_millis()).ok()?,
            plan_digest: wire::short(&plan.digest),
        }))
    }
}

/// Whether a pose and a power that came by wire are those of our own plan.
fn same(position: &[f32; 3], euler: &[f32; 3], power_w: f32, own: &VehiclePlan) -> bool {
    let close = |wire: &[f32], ours: &[f64]| {
        wire.iter().zip(ours).all(|(&w, &o)| (f64::from(w) - o).abs() <= WIRE_TOLERANCE * o.abs().max(1.0))
    };
    close(position, own.pose.position_enu_m.as_slice())
        && close(euler, &[own.pose.roll_rad, own.pose.pitch_rad, own.pose.yaw_rad])
        && close(&[power_w], &[own.tx_power_w])
}
