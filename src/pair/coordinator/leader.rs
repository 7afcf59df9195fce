//! I's half: proposes slots, and asks for leases in them.
//!
//! I flies only when J's status has told it that J is committed, and J commits only while there is time for that status
//! to arrive. A proposal that is not agreed on when its transit should begin is void on I's side; should J have
//! committed to it all the same (every one of its statuses lost), J sees I's status without that commitment, says
//! [`Event::PeerLeft`](super::Event::PeerLeft) and goes no further.

use std::time::Duration;

use crate::geo::Pose;
use crate::time::{Instant, Utc};

use super::super::lease::Holder;
use super::super::wire::{self, MavMessage, VeilwingAnswer};
use super::terms::{Commitment, Places, PlanTerms};
use super::{micros, narrow};

const PROPOSE_EVERY: Duration = Duration::from_millis(200);
const COMMIT_EVERY: Duration = Duration::from_millis(100);
const REQUEST_EVERY: Duration = Duration::from_millis(50);
/// What clocks are told in on the wire.
const MICROSECOND: Duration = Duration::from_micros(1);
/// I commits only if this and once more the time that the answer took are left.
const COMMIT_MARGIN: Duration = Duration::from_millis(500);

/// How far a proposal has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Awaits J's answer.
    Proposed,
    /// Accepted; awaits J's word that it is committed.
    Committing,
}

/// A slot being agreed on.
#[derive(Debug, Clone, Copy)]
struct Proposal {
    commitment: Commitment,
    /// For whom the slot's poses were made anew.
    places: Option<Places>,
    stage: Stage,
    first_sent: Instant,
    next_send: Instant,
}

/// A proposal that came to nothing: of this slot, for this reason.
pub(super) type Refused = (u16, VeilwingAnswer);

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Leader {
    boot_id: u32,
    /// How many have been made in this boot.
    proposals: u32,
    proposal: Option<Proposal>,
    pub holder: Holder,
    /// When the next lease is asked for; `None` while none is wanted.
    next_request: Option<Instant>,
}

impl Leader {
    pub fn new(boot_id: u32) -> Self {
        Self { boot_id, ..Self::default() }
    }

    /// A new proposal, in the place of one not yet agreed on.
    pub fn propose(
        &mut self,
        slot: u16,
        opens: Utc,
        (leaves_at, opens_at): (Instant, Instant),
        places: Option<Places>,
        now: Instant,
    ) {
        self.proposals += 1;
        let commitment = Commitment { proposal: self.proposals, slot, opens_at, opens, leaves_at };
        let stage = Stage::Proposed;
        self.proposal = Some(Proposal { commitment, places, stage, first_sent: now, next_send: now });
    }

    pub fn withdraw(&mut self) {
        self.proposal = None;
    }

    pub fn is_proposing(&self) -> bool {
        self.proposal.is_some()
    }

    /// When the proposal is due again, or void.
    pub fn proposal_due(&self) -> Option<Instant> {
        self.proposal.map(|p| p.next_send.min(p.commitment.leaves_at))
    }

    /// What is due of the proposal; one that was not agreed on in time is withdrawn.
    pub fn advance(&mut self, plan: &PlanTerms, now: Instant) -> Result<[Option<MavMessage>; 2], Refused> {
        const NOTHING: [Option<MavMessage>; 2] = [None, None];
        let Some(proposal) = self.proposal.as_mut() else { return Ok(NOTHING) };
        let commitment = proposal.commitment;
        if now >= commitment.leaves_at {
            self.proposal = None;
            return Err((commitment.slot, VeilwingAnswer::VEILWING_ANSWER_TOO_LATE));
        }
        if proposal.next_send > now {
            return Ok(NOTHING);
        }
        let every = match proposal.stage {
            Stage::Committing => COMMIT_EVERY,
            Stage::Proposed => PROPOSE_EVERY,
        };
        proposal.next_send = now + every;
        let proposal = *proposal;
        Ok(match proposal.stage {
            Stage::Committing => [
                Some(MavMessage::VEILWING_COMMIT(wire::VEILWING_COMMIT_DATA {
                    boot_id: self.boot_id,
                    proposal: commitment.proposal,
                    slot: commitment.slot,
                })),
                None,
            ],
            Stage::Proposed => {
                let places = proposal.places.map(|places| places.to_wire(self.boot_id, commitment.proposal));
                [places.map(MavMessage::VEILWING_PLACES), self.in_full(&proposal, plan)]
            }
        })
    }

    fn in_full(&self, proposal: &Proposal, plan: &PlanTerms) -> Option<MavMessage> {
        let slot = proposal.commitment.slot;
        let terms = plan.slots.get(usize::from(slot))?;
        let vehicles = &terms.vehicles;
        let euler = |pose: &Pose| narrow([pose.roll_rad, pose.pitch_rad, pose.yaw_rad].into());
        Some(MavMessage::VEILWING_PROPOSE(wire::VEILWING_PROPOSE_DATA {
            opens_utc_us: proposal.commitment.opens.unix_us,
            boot_id: self.boot_id,
            proposal: proposal.commitment.proposal,
            i_position_enu_m: narrow(vehicles.i.pose.position_enu_m),
            i_euler_rad: euler(&vehicles.i.pose),
            i_power_w: vehicles.i.tx_power_w as f32,
            j_position_enu_m: narrow(vehicles.j.pose.position_enu_m),
            j_euler_rad: euler(&vehicles.j.pose),
            j_power_w: vehicles.j.tx_power_w as f32,
            slot,
            plan_digest: plan.digest_of(terms),
        }))
    }

    /// An answer to the proposal that awaits one. Once committing, a refusal of an earlier copy says nothing: J may have
    /// committed.
    pub fn take_answer(&mut self, answer: &wire::VEILWING_ANSWER_DATA, now: Instant) -> Result<(), Refused> {
        let awaited = |p: &&mut Proposal| {
            p.commitment.proposal == answer.proposal
                && p.stage == Stage::Proposed
                && answer.boot_id == self.boot_id
        };
        let Some(proposal) = self.proposal.as_mut().filter(awaited) else { return Ok(()) };
        let commitment = proposal.commitment;
        let took = now.saturating_since(proposal.first_sent);
        let refused = match answer.answer {
            VeilwingAnswer::VEILWING_ANSWER_ACCEPTED
                if now + took + COMMIT_MARGIN <= commitment.leaves_at =>
            {
                proposal.stage = Stage::Committing;
                proposal.next_send = now;
                return Ok(());
            }
            // Not committed, since J could not be heard to be so in time.
            VeilwingAnswer::VEILWING_ANSWER_ACCEPTED => VeilwingAnswer::VEILWING_ANSWER_TOO_LATE,
            refused => refused,
        };
        self.proposal = None;
        Err((commitment.slot, refused))
    }

    /// J has said that it is committed to the proposal `theirs`: ours, if that is in time.
    pub fn confirmed(&mut self, theirs: Option<u32>, now: Instant) -> Option<Commitment> {
        let confirmed = self.proposal.take_if(|p| {
            p.stage == Stage::Committing
                && theirs == Some(p.commitment.proposal)
                && now < p.commitment.leaves_at
        });
        confirmed.map(|proposal| proposal.commitment)
    }

    /// Whether leases are asked for.
    pub fn want_lease(&mut self, wanted: bool, now: Instant) {
        match (wanted, self.next_request) {
            // What is asked for in the very instant of giving up is given up with it.
            (true, None) => {
                let given_up_at = self.holder.given_up_at();
                self.next_request = Some(given_up_at.map_or(now, |at| now.max(at + MICROSECOND)));
            }
            (false, Some(_)) => self.give_up(now),
            (true, Some(_)) | (false, None) => {}
        }
    }

    pub fn wants_lease(&self) -> bool {
        self.next_request.is_some()
    }

    /// Asks for no more leases, and holds none.
    pub fn give_up(&mut self, now: Instant) {
        self.next_request = None;
        self.holder.give_up(now);
    }

    /// Up to when every lease that was asked for is given up; `None` while one is held. Said by who is off, and who asks for
    /// none gives up all until now by saying so: what J is told binds I.
    pub fn released_at(&mut self, now: Instant) -> Option<Instant> {
        if !self.wants_lease() {
            self.holder.give_up(now);
        }
        self.holder.given_up_at()
    }

    pub fn request_due(&self) -> Option<Instant> {
        self.next_request
    }

    /// The request for a lease in the committed slot, if one is due.
    pub fn request(&mut self, commitment: Commitment, now: Instant) -> Option<MavMessage> {
        self.next_request.filter(|due| *due <= now)?;
        self.next_request = Some(now + REQUEST_EVERY);
        Some(MavMessage::VEILWING_LEASE_REQUEST(wire::VEILWING_LEASE_REQUEST_DATA {
            time_us: micros(now),
            boot_id: self.boot_id,
            proposal: commitment.proposal,
            slot: commitment.slot,
        }))
    }

    /// A lease of J for the committed slot; `false` if it is not for that, or none is wanted. No lease is longer than
    /// `longest`.
    pub fn take_grant(
        &mut self,
        grant: &wire::VEILWING_LEASE_GRANT_DATA,
        commitment: Commitment,
        plan: &PlanTerms,
        longest: Duration,
        now: Instant,
    ) -> bool {
        let ours = self.wants_lease()
            && grant.boot_id == self.boot_id
            && grant.proposal == commitment.proposal
            && grant.slot == commitment.slot
            && grant.plan_digest == wire::short(&plan.digest);
        if ours {
            let asked_at = Instant::from_start(Duration::from_micros(grant.time_us));
            let duration = Duration::from_millis(grant.duration_ms.into()).min(longest);
            self.holder.take(asked_at, duration, now);
        }
        ours
    }
}
