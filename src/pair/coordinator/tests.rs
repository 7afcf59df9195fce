//! What a single odd datagram must not do. Whole pairs are simulated in tests/pair.

mod bounds;
mod carrying;
mod following;
mod saying;

use super::super::wire::VeilwingAnswer;

use super::*;
use crate::geo::{Enu, Pose};
use crate::planner::plan::VehiclePlan;
use crate::planner::track::{Followed, Track};
use crate::role::PerVehicle;

const NEEDS: Duration = Duration::from_secs(2);

fn at(ms: u64) -> Instant {
    Instant::from_start(Duration::from_millis(ms))
}

fn utc(ms: u64) -> Utc {
    Utc { unix_us: 1_800_000_000_000_000 + ms * 1000 }
}

fn coordinator(role: Role, boot_id: u32) -> Coordinator {
    coordinator_of(role, boot_id, [1; 32], [2; 32])
}

fn coordinator_of(role: Role, boot_id: u32, mission_digest: [u8; 32], plan_digest: [u8; 32]) -> Coordinator {
    let settings = Settings {
        role,
        boot_id,
        mission_digest,
        lease: Duration::from_millis(500),
        peer_timeout: Duration::from_secs(3),
        lost_after: Duration::from_secs(3),
        clock_tolerance: Duration::from_millis(250),
        orders: super::super::orders::Record::default(),
    };
    let mut coordinator = Coordinator::new(settings, Instant::ZERO);
    coordinator.set_plan(PlanTerms { digest: plan_digest, slots: vec![terms(); 3] });
    coordinator
}

/// Of a slot that is served from a standstill.
pub(super) fn terms() -> SlotTerms {
    let pose = Pose { position_enu_m: Enu::new(1.0, 2.3, 80.7), roll_rad: 0.7, pitch_rad: 0.1, yaw_rad: 0.0 };
    let vehicle = VehiclePlan { pose, tx_power_w: 0.5 };
    SlotTerms {
        anew: None,
        vehicles: PerVehicle { i: vehicle, j: vehicle },
        tracks: None,
        lean_rad: PerVehicle { i: 0.0, j: 0.0 },
        jitter: None,
        opens: NEEDS,
        lead: NEEDS,
        carries_on_after: None,
        radiate_from: Duration::ZERO,
        radiate_until: Duration::from_secs(1),
        length: Duration::from_secs(1),
    }
}

/// The same of one in which motions are made anew.
pub(super) fn followed(terms: SlotTerms) -> SlotTerms {
    let track = |role: Role| Track::Followed(Followed::new(role, terms.vehicles[role]));
    SlotTerms { tracks: Some(PerVehicle::from_fn(track)), ..terms }
}

fn sent(from: &mut Coordinator) -> Vec<MavMessage> {
    std::iter::from_fn(|| from.poll_transmit()).collect()
}

fn of_kind<T>(messages: Vec<MavMessage>, kind: impl Fn(MavMessage) -> Option<T>) -> Vec<T> {
    messages.into_iter().filter_map(kind).collect()
}

fn answers(of: &mut Coordinator) -> Vec<VeilwingAnswer> {
    of_kind(sent(of), |m| if let MavMessage::VEILWING_ANSWER(a) = m { Some(a.answer) } else { None })
}

fn events(of: &mut Coordinator) -> Vec<Event> {
    std::iter::from_fn(|| of.poll_event()).collect()
}

/// Ten milliseconds of both, all messages delivered; what was sent.
fn run(i: &mut Coordinator, j: &mut Coordinator, ms: u64) -> Vec<MavMessage> {
    let mut all = Vec::new();
    for side in [&mut *i, &mut *j] {
        side.set_utc(Some(utc(ms)), at(ms));
        side.handle_timeout(at(ms));
    }
    for _ in 0..4 {
        let (from_i, from_j) = (sent(i), sent(j));
        from_i.iter().for_each(|m| j.handle_message(m, at(ms)));
        from_j.iter().for_each(|m| i.handle_message(m, at(ms)));
        all.extend(from_i.into_iter().chain(from_j));
    }
    all
}

/// Acquainted, clocks compared, J ready for slot 0, at 2 s.
fn pair() -> (Coordinator, Coordinator) {
    let (mut i, mut j) = (coordinator(Role::I, 11), coordinator(Role::J, 22));
    // Both transmitters are found off.
    i.set_local(Local::default(), Instant::ZERO);
    j.set_local(Local::default(), Instant::ZERO);
    for ms in (0..2000).step_by(10) {
        run(&mut i, &mut j, ms);
    }
    assert!(i.agrees() && j.agrees());
    j.set_readiness(Some(0));
    events(&mut i);
    events(&mut j);
    (i, j)
}

/// In whose slots motions are made anew.
fn following() -> (Coordinator, Coordinator) {
    let (mut i, mut j) = pair();
    for one in [&mut i, &mut j] {
        let plan = one.plan.as_mut().unwrap();
        plan.slots.iter_mut().for_each(|slot| *slot = followed(slot.clone()));
    }
    (i, j)
}

#[test]
fn spec_a_dead_boot_s_late_hello_changes_nothing_and_a_new_boot_is_believed() {
    let (mut i, mut j) = pair();
    i.acquaintance.due = at(2000);
    i.handle_timeout(at(2000));
    let late: Vec<_> =
        sent(&mut i).into_iter().filter(|m| matches!(m, MavMessage::VEILWING_HELLO(_))).collect();
    assert_eq!(late.len(), 1);
    let mut reborn = coordinator(Role::I, 12);
    for ms in (3000..4000).step_by(10) {
        run(&mut reborn, &mut j, ms);
    }
    assert!(events(&mut j).contains(&Event::PeerRestarted));
    assert!(j.peer().is_boot(12));
    j.handle_message(&late[0], at(4000));
    assert!(j.peer().is_boot(12));
    assert_eq!(events(&mut j), vec![]);

    // J restarts as well and hears the dead boot first.
    let mut j = coordinator(Role::J, 23);
    j.handle_message(&late[0], at(10));
    for ms in (4010..5000).step_by(10) {
        run(&mut reborn, &mut j, ms);
    }
    assert!(j.peer().is_boot(12));
}

#[test]
fn spec_both_commit_and_i_only_when_j_has_said_so() {
    let (mut i, mut j) = pair();
    i.propose(0, utc(6000), None, at(2000));
    i.handle_timeout(at(2000));
    sent(&mut i).iter().for_each(|m| j.handle_message(m, at(2000)));
    sent(&mut j).iter().for_each(|m| i.handle_message(m, at(2000)));
    assert_eq!(i.commitment(), None, "accepted is not committed");
    run(&mut i, &mut j, 2010);
    run(&mut i, &mut j, 2020);
    assert_eq!(i.commitment().map(|c| c.opens_at), Some(at(6000)));
    assert_eq!(j.commitment().map(|c| c.opens_at), Some(at(6000)));
}

#[test]
fn spec_a_copy_of_a_proposal_does_not_move_what_was_accepted() {
    let (mut i, mut j) = pair();
    i.propose(0, utc(6000), None, at(2000));
    i.handle_timeout(at(2000));
    let proposal = sent(&mut i);
    proposal.iter().for_each(|m| j.handle_message(m, at(2000)));
    // J's clock is set, by less than voids the comparison; then the copy comes.
    j.set_utc(Some(utc(2110)), at(2010));
    proposal.iter().for_each(|m| j.handle_message(m, at(2010)));
    sent(&mut j).iter().for_each(|m| i.handle_message(m, at(2010)));
    sent(&mut i).iter().for_each(|m| j.handle_message(m, at(2010)));
    assert_eq!(j.commitment().map(|c| c.opens_at), Some(at(6000)));
}

#[test]
fn spec_a_delayed_commit_commits_nobody() {
    let (mut i, mut j) = pair();
    i.propose(0, utc(6000), None, at(2000));
    i.handle_timeout(at(2000));
    sent(&mut i).iter().for_each(|m| j.handle_message(m, at(2000)));
    sent(&mut j).iter().for_each(|m| i.handle_message(m, at(2000)));
    let commits: Vec<_> =
        sent(&mut i).into_iter().filter(|m| matches!(m, MavMessage::VEILWING_COMMIT(_))).collect();
    // The transit begins at 4 s; 200 ms before is too late for J's word to come through.
    commits.iter().for_each(|m| j.handle_message(m, at(3800)));
    assert_eq!((commits.len(), j.commitment()), (1, None));
    i.handle_timeout(at(4000));
    assert!(events(&mut i).contains(&Event::Refused(0, VeilwingAnswer::VEILWING_ANSWER_TOO_LATE)));
    assert!(!i.is_proposing());
}

#[test]
fn spec_only_the_very_next_slot_is_accepted() {
    let (mut i, mut j) = pair();
    i.propose(1, utc(6000), None, at(2000));
    run(&mut i, &mut j, 2000);
    assert_eq!(events(&mut i), vec![Event::Refused(1, VeilwingAnswer::VEILWING_ANSWER_WRONG_SLOT)]);
}

#[test]
fn spec_a_step_of_utc_voids_what_was_compared() {
    let (mut i, mut j) = pair();
    i.set_utc(Some(utc(9000)), at(2000));
    i.propose(0, utc(13_000), None, at(2000));
    assert_eq!(events(&mut i), vec![Event::Refused(0, VeilwingAnswer::VEILWING_ANSWER_CLOCK)]);
    // J's steps back between two comparisons.
    let (mut i2, _) = pair();
    j.set_utc(Some(utc(0)), at(2000));
    i2.propose(0, utc(6000), None, at(2000));
    i2.handle_timeout(at(2000));
    sent(&mut j);
    sent(&mut i2).iter().for_each(|m| j.handle_message(m, at(2000)));
    let refused = sent(&mut j).into_iter().any(
        |m| matches!(m, MavMessage::VEILWING_ANSWER(a) if a.answer == VeilwingAnswer::VEILWING_ANSWER_CLOCK),
    );
    assert!(refused);
}

#[test]
fn spec_j_committed_alone_says_so() {
    let (mut i, mut j) = pair();
    i.propose(0, utc(6000), None, at(2000));
    i.handle_timeout(at(2000));
    sent(&mut i).iter().for_each(|m| j.handle_message(m, at(2000)));
    sent(&mut j).iter().for_each(|m| i.handle_message(m, at(2000)));
    // From here on nothing of J's arrives.
    let mut left = Vec::new();
    for ms in (2000..5200).step_by(50) {
        i.set_utc(Some(utc(ms)), at(ms));
        i.handle_timeout(at(ms));
        sent(&mut i).iter().for_each(|m| j.handle_message(m, at(ms)));
        left.extend(events(&mut j).into_iter().filter(|e| *e == Event::PeerLeft).map(|_| ms));
    }
    assert_eq!(i.commitment(), None, "I does not fly unconfirmed");
    assert!(left.len() == 1 && (5000..5200).contains(&left[0]), "{left:?}");
}

/// In slot 0, J vouching for a second, at 6.1 s: I has asked for a lease, J has granted it, and I has not heard it yet.
fn granted() -> (Coordinator, Coordinator, wire::VEILWING_LEASE_REQUEST_DATA, wire::VEILWING_LEASE_GRANT_DATA)
{
    let (mut i, mut j) = pair();
    i.propose(0, utc(6000), None, at(2000));
    for ms in (2000..6100).step_by(50) {
        run(&mut i, &mut j, ms);
    }
    assert!(i.commitment().is_some() && j.commitment().is_some());
    j.set_vouch(Some(Vouch { until: at(7000), closes_at: at(7000) }));
    i.want_lease(true, at(6100));
    i.handle_timeout(at(6100));
    let request = sent(&mut i).into_iter().find_map(|m| match m {
        MavMessage::VEILWING_LEASE_REQUEST(request) => Some(request),
        _ => None,
    });
    let request = request.unwrap();
    j.handle_message(&MavMessage::VEILWING_LEASE_REQUEST(request.clone()), at(6100));
    let grant = sent(&mut j).into_iter().find_map(|m| match m {
        MavMessage::VEILWING_LEASE_GRANT(grant) => Some(grant),
        _ => None,
    });
    (i, j, request, grant.unwrap())
}

#[test]
fn spec_a_grant_of_which_one_field_is_another_s_is_none() {
    let (i, _, _, grant) = granted();
    let hear = |grant: wire::VEILWING_LEASE_GRANT_DATA| {
        let mut i = i.clone();
        i.handle_message(&MavMessage::VEILWING_LEASE_GRANT(grant), at(6110));
        i.lease(at(6110))
    };
    assert_eq!(hear(grant.clone()), Some(at(6600)));
    let mut other_plan = grant.clone();
    other_plan.plan_digest[0] ^= 1;
    let others = [
        other_plan,
        wire::VEILWING_LEASE_GRANT_DATA { boot_id: 12, ..grant.clone() },
        wire::VEILWING_LEASE_GRANT_DATA { proposal: grant.proposal + 1, ..grant.clone() },
        wire::VEILWING_LEASE_GRANT_DATA { slot: 1, ..grant.clone() },
        wire::VEILWING_LEASE_GRANT_DATA { time_us: grant.time_us + 100_000, ..grant.clone() },
        wire::VEILWING_LEASE_GRANT_DATA { duration_ms: 0, ..grant.clone() },
    ];
    for other in others {
        assert_eq!(hear(other.clone()), None, "{other:?}");
    }
    // Longer than any lease may be, it is no longer than that.
    assert!(hear(wire::VEILWING_LEASE_GRANT_DATA { duration_ms: 60_000, ..grant }) <= Some(at(6600)));
}

#[test]
fn spec_a_request_of_which_one_field_is_another_s_is_granted_nothing() {
    let (_, j, request, _) = granted();
    let answers = |request: wire::VEILWING_LEASE_REQUEST_DATA| {
        let mut j = j.clone();
        j.handle_message(&MavMessage::VEILWING_LEASE_REQUEST(request), at(6110));
        sent(&mut j).len()
    };
    assert_eq!(answers(request.clone()), 1);
    for other in [
        wire::VEILWING_LEASE_REQUEST_DATA { boot_id: 12, ..request.clone() },
        wire::VEILWING_LEASE_REQUEST_DATA { proposal: request.proposal + 1, ..request.clone() },
        wire::VEILWING_LEASE_REQUEST_DATA { slot: 1, ..request },
    ] {
        assert_eq!(answers(other.clone()), 0, "{other:?}");
    }
}

#[test]
fn spec_a_proposal_of_which_one_field_is_another_plan_s_is_refused() {
    let (mut i, j) = pair();
    i.propose(0, utc(6000), None, at(2000));
    i.handle_timeout(at(2000));
    let propose = sent(&mut i).into_iter().find_map(|m| match m {
        MavMessage::VEILWING_PROPOSE(propose) => Some(propose),
        _ => None,
    });
    let propose = propose.unwrap();
    let answer = |propose: wire::VEILWING_PROPOSE_DATA| {
        let mut j = j.clone();
        j.handle_message(&MavMessage::VEILWING_PROPOSE(propose), at(2010));
        sent(&mut j).into_iter().find_map(|m| match m {
            MavMessage::VEILWING_ANSWER(answer) => Some(answer.answer),
            _ => None,
        })
    };
    assert_eq!(propose.plan_digest, wire::short(&[2; 32]));
    assert_eq!(answer(propose.clone()), Some(VeilwingAnswer::VEILWING_ANSWER_ACCEPTED));
    let changes: [fn(&mut wire::VEILWING_PROPOSE_DATA); 7] = [
        |p| p.plan_digest[7] ^= 1,
        |p| p.i_position_enu_m[2] += 0.01,
        |p| p.i_euler_rad[0] += 0.001,
        |p| p.i_power_w *= 1.001,
        |p| p.j_position_enu_m[0] += 0.01,
        |p| p.j_euler_rad[1] += 0.001,
        |p| p.j_power_w *= 0.999,
    ];
    for (k, change) in changes.into_iter().enumerate() {
        let mut other = propose.clone();
        change(&mut other);
        assert_eq!(answer(other), Some(VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN), "{k}");
    }
    assert_eq!(answer(wire::VEILWING_PROPOSE_DATA { boot_id: 12, ..propose }), None);
}

#[test]
fn spec_two_of_one_role_say_so_once_and_never_agree() {
    for role in Role::BOTH {
        let (mut one, mut other) = (coordinator(role, 11), coordinator(role, 22));
        (0..500).for_each(|k| drop(run(&mut one, &mut other, 10 * k)));
        for side in [&mut one, &mut other] {
            assert_eq!(events(side), vec![Event::SameRole], "{role}");
            assert!(!side.agrees() && side.commitment().is_none());
        }
    }
}
