//! Propose, answer, commit: how the two agree on a slot.
//!
//! I flies only when J's status has told it that J is committed, and J commits only while there is time for that
//! status to arrive. A proposal that is not agreed on when its transit should begin is void on I's side; should J
//! have committed to it all the same (every one of its statuses lost), J sees I's status without that commitment,
//! says [`Event::PeerLeft`] and goes no further.

use std::time::Duration;

use crate::geo::Pose;
use crate::planner::plan::VehiclePlan;
use crate::role::Role;
use crate::time::{Instant, Utc};

use super::super::clock::Offset;
use super::super::wire::{self, MavMessage, VeilwingAnswer};
use super::{Commitment, Coordinator, Event, Stage, narrow};

const PROPOSE_EVERY: Duration = Duration::from_millis(200);
const COMMIT_EVERY: Duration = Duration::from_millis(100);
/// J commits no later than this before its transit begins: time for several statuses, of which I must hear one.
const CONFIRM: Duration = Duration::from_millis(300);
/// I commits only if this and once more the time that the answer took are left.
const COMMIT_MARGIN: Duration = Duration::from_millis(500);
/// After its transit should have begun, the peer gets this long to say that it is committed as well.
const PEER_LATE: Duration = Duration::from_secs(1);
/// Poses and powers travel as f32: what is equal in f64 differs by this much relative to its size after the trip.
const WIRE_TOLERANCE: f64 = 1e-6;

/// A slot being agreed on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Proposal {
    pub commitment: Commitment,
    pub opens: Utc,
    pub stage: Stage,
    pub first_sent: Instant,
    pub next_send: Instant,
}

impl Coordinator {
    /// I: proposes that `slot` opens at `opens`, `needs` after the transit to it begins. Replaces a proposal not
    /// yet agreed on. Without our UTC and plan nothing is proposed; with clocks that differ too much, or are not
    /// compared yet, it is refused at once.
    pub fn propose(&mut self, slot: u16, opens: Utc, needs: Duration, now: Instant) {
        let Some(opens_at) = self.instant_of(opens) else { return };
        if self.plan.is_none() {
            return;
        }
        self.commitment = None;
        if !self.clocks_agree() {
            self.proposal = None;
            self.events.push_back(Event::Refused(slot, VeilwingAnswer::VEILWING_ANSWER_CLOCK));
            return;
        }
        self.proposals += 1;
        let commitment = Commitment { proposal: self.proposals, slot, opens_at, leaves_at: opens_at - needs };
        self.proposal =
            Some(Proposal { commitment, opens, stage: Stage::Proposed, first_sent: now, next_send: now });
    }

    /// I: sends what is due, and withdraws what was not agreed on in time.
    pub(super) fn advance_proposal(&mut self, now: Instant) {
        if !self.leads() {
            return;
        }
        let Some(proposal) = self.proposal.as_mut() else { return };
        let commitment = proposal.commitment;
        if now >= commitment.leaves_at {
            self.proposal = None;
            let late = VeilwingAnswer::VEILWING_ANSWER_TOO_LATE;
            self.events.push_back(Event::Refused(commitment.slot, late));
            return;
        }
        if proposal.next_send > now {
            return;
        }
        let (message, every) = match proposal.stage {
            Stage::Committing => (Some(self.commit(commitment)), COMMIT_EVERY),
            Stage::Proposed => (self.proposal_message(), PROPOSE_EVERY),
        };
        self.transmit.extend(message);
        if let Some(proposal) = self.proposal.as_mut() {
            proposal.next_send = now + every;
        }
    }

    fn proposal_message(&self) -> Option<MavMessage> {
        let (plan, proposal) = (self.plan.as_ref()?, self.proposal?);
        let slot = proposal.commitment.slot;
        let terms = plan.slots.get(usize::from(slot))?;
        let euler = |pose: &Pose| narrow([pose.roll_rad, pose.pitch_rad, pose.yaw_rad].into());
        Some(MavMessage::VEILWING_PROPOSE(wire::VEILWING_PROPOSE_DATA {
            opens_utc_us: proposal.opens.unix_us,
            boot_id: self.settings.boot_id,
            proposal: proposal.commitment.proposal,
            i_position_enu_m: narrow(terms.i.pose.position_enu_m),
            i_euler_rad: euler(&terms.i.pose),
            i_power_w: terms.i.tx_power_w as f32,
            j_position_enu_m: narrow(terms.j.pose.position_enu_m),
            j_euler_rad: euler(&terms.j.pose),
            j_power_w: terms.j.tx_power_w as f32,
            slot,
            plan_digest: wire::short(&plan.digest),
        }))
    }

    fn commit(&self, commitment: Commitment) -> MavMessage {
        MavMessage::VEILWING_COMMIT(wire::VEILWING_COMMIT_DATA {
            boot_id: self.settings.boot_id,
            proposal: commitment.proposal,
            slot: commitment.slot,
        })
    }

    /// J: answers each copy of a proposal.
    pub(super) fn take_proposal(&mut self, propose: &wire::VEILWING_PROPOSE_DATA, now: Instant) {
        if self.leads() || !self.peer.is_boot(propose.boot_id) || propose.proposal <= self.finished {
            return;
        }
        let accepted = VeilwingAnswer::VEILWING_ANSWER_ACCEPTED;
        let answer = match self.commitment {
            Some(commitment) if commitment.proposal == propose.proposal => accepted,
            // A late copy of an earlier proposal must not displace the slot that is being flown.
            Some(commitment) if commitment.proposal > propose.proposal => return,
            _ => self.judge(propose, now),
        };
        let opens = Utc { unix_us: propose.opens_utc_us };
        let newer = self.proposal.is_none_or(|known| known.commitment.proposal < propose.proposal);
        if answer == accepted
            && newer
            && self.commitment.is_none()
            && let (Some(opens_at), Some(readiness)) = (self.instant_of(opens), self.readiness)
        {
            let leaves_at = opens_at - readiness.needs;
            let commitment =
                Commitment { proposal: propose.proposal, slot: propose.slot, opens_at, leaves_at };
            let stage = Stage::Proposed;
            self.proposal = Some(Proposal { commitment, opens, stage, first_sent: now, next_send: now });
        }
        self.transmit.push_back(MavMessage::VEILWING_ANSWER(wire::VEILWING_ANSWER_DATA {
            boot_id: propose.boot_id,
            proposal: propose.proposal,
            answer,
        }));
    }

    /// J judges a proposal by its own plan, readiness and clock.
    fn judge(&self, propose: &wire::VEILWING_PROPOSE_DATA, now: Instant) -> VeilwingAnswer {
        let (Some(plan), Some(readiness)) = (&self.plan, self.readiness) else {
            return VeilwingAnswer::VEILWING_ANSWER_NOT_READY;
        };
        if propose.plan_digest != wire::short(&plan.digest) {
            return VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN;
        }
        // Only the very next: the transit to any other begins where J is not.
        let Some(terms) =
            plan.slots.get(usize::from(propose.slot)).filter(|_| propose.slot == readiness.next_slot)
        else {
            return VeilwingAnswer::VEILWING_ANSWER_WRONG_SLOT;
        };
        let close = |wire: &[f32], ours: &[f64]| {
            wire.iter()
                .zip(ours)
                .all(|(&w, &o)| (f64::from(w) - o).abs() <= WIRE_TOLERANCE * o.abs().max(1.0))
        };
        let same = |position: &[f32; 3], euler: &[f32; 3], power_w: f32, own: &VehiclePlan| {
            close(position, own.pose.position_enu_m.as_slice())
                && close(euler, &[own.pose.roll_rad, own.pose.pitch_rad, own.pose.yaw_rad])
                && close(&[power_w], &[own.tx_power_w])
        };
        if !same(&propose.i_position_enu_m, &propose.i_euler_rad, propose.i_power_w, &terms.i)
            || !same(&propose.j_position_enu_m, &propose.j_euler_rad, propose.j_power_w, &terms.j)
        {
            return VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN;
        }
        let opens = Utc { unix_us: propose.opens_utc_us };
        let Some(opens_at) = self.instant_of(opens).filter(|_| self.clocks_agree()) else {
            return VeilwingAnswer::VEILWING_ANSWER_CLOCK;
        };
        if opens_at < now + readiness.needs + CONFIRM {
            return VeilwingAnswer::VEILWING_ANSWER_TOO_LATE;
        }
        VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
    }

    /// Whether the clocks were compared, and are not certain to differ by more than the guard time covers.
    fn clocks_agree(&self) -> bool {
        let certain = |offset: Offset| {
            Duration::from_micros(offset.offset_us.unsigned_abs()).saturating_sub(offset.uncertainty)
        };
        self.clock.offset().is_some_and(|offset| certain(offset) <= self.settings.clock_tolerance)
    }

    /// I: an answer to the proposal that awaits one. Once committing, a refusal of an earlier copy says nothing:
    /// J may have committed.
    pub(super) fn take_answer(&mut self, answer: &wire::VEILWING_ANSWER_DATA, now: Instant) {
        if self.settings.role != Role::I || answer.boot_id != self.settings.boot_id {
            return;
        }
        let Some(proposal) = self
            .proposal
            .as_mut()
            .filter(|p| p.commitment.proposal == answer.proposal && p.stage == Stage::Proposed)
        else {
            return;
        };
        let commitment = proposal.commitment;
        let took = now.saturating_since(proposal.first_sent);
        let refused = match answer.answer {
            VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
                if now + took + COMMIT_MARGIN <= commitment.leaves_at =>
            {
                proposal.stage = Stage::Committing;
                proposal.next_send = now;
                return self.advance_proposal(now);
            }
            // Not committed, since J could not be heard to be so in time.
            VeilwingAnswer::VEILWING_ANSWER_ACCEPTED => VeilwingAnswer::VEILWING_ANSWER_TOO_LATE,
            refused => refused,
        };
        self.proposal = None;
        self.events.push_back(Event::Refused(commitment.slot, refused));
    }

    /// J: commits, if it is still ready and there is still time to say so.
    pub(super) fn take_commit(&mut self, commit: &wire::VEILWING_COMMIT_DATA, now: Instant) {
        if self.leads() || !self.peer.is_boot(commit.boot_id) {
            return;
        }
        if self.commitment.is_some_and(|c| c.proposal == commit.proposal) {
            self.next_status = now; // I has not heard yet.
            return;
        }
        let Some(proposal) = self.proposal.take_if(|p| p.commitment.proposal == commit.proposal) else {
            return;
        };
        let commitment = proposal.commitment;
        let ready = self.readiness.is_some_and(|readiness| readiness.next_slot == commitment.slot);
        if !ready || now + CONFIRM > commitment.leaves_at {
            self.finished = self.finished.max(commitment.proposal);
            return;
        }
        self.commitment = Some(commitment);
        self.next_status = now;
        self.events.push_back(Event::Committed(commitment));
    }

    /// After a status of the peer: I learns that J is committed; both, that the other is (no longer) with them.
    pub(super) fn compare_commitments(&mut self, now: Instant) {
        let theirs = self.peer.committed;
        if self.leads()
            && let Some(proposal) = self.proposal
            && proposal.stage == Stage::Committing
            && theirs == Some(proposal.commitment.proposal)
            && now < proposal.commitment.leaves_at
        {
            self.proposal = None;
            self.commitment = Some(proposal.commitment);
            self.next_status = now;
            self.events.push_back(Event::Committed(proposal.commitment));
        }
        let Some(commitment) = self.commitment else { return };
        if theirs == Some(commitment.proposal) {
            self.peer_went_along = true;
        } else if (self.peer_went_along || now >= commitment.leaves_at + PEER_LATE) && !self.peer_left {
            self.peer_left = true;
            self.events.push_back(Event::PeerLeft);
        }
    }
}
