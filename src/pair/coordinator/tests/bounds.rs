//! Agreement and leases up to their edges: the last instant at which something is in time, and what comes twice, late
//! or for another.

use super::*;

fn proposals(of: &mut Coordinator) -> Vec<wire::VEILWING_PROPOSE_DATA> {
    of_kind(sent(of), |m| if let MavMessage::VEILWING_PROPOSE(p) = m { Some(p) } else { None })
}

fn commits(of: &mut Coordinator) -> Vec<wire::VEILWING_COMMIT_DATA> {
    of_kind(sent(of), |m| if let MavMessage::VEILWING_COMMIT(c) = m { Some(c) } else { None })
}

/// I's proposal of slot 0 at 2 s, to open at 6 s: its transit begins at 4 s. Nobody has heard it yet.
fn proposed() -> (Coordinator, Coordinator, wire::VEILWING_PROPOSE_DATA) {
    let (mut i, mut j) = pair();
    sent(&mut i);
    sent(&mut j);
    i.propose(0, utc(6000), None, at(2000));
    i.handle_timeout(at(2000));
    let propose = proposals(&mut i).pop().unwrap();
    (i, j, propose)
}

fn answer(propose: &wire::VEILWING_PROPOSE_DATA, answer: VeilwingAnswer) -> wire::VEILWING_ANSWER_DATA {
    wire::VEILWING_ANSWER_DATA { boot_id: propose.boot_id, proposal: propose.proposal, answer }
}

fn hear(of: &mut Coordinator, message: MavMessage, ms: u64) {
    of.handle_message(&message, at(ms));
}

const ACCEPTED: VeilwingAnswer = VeilwingAnswer::VEILWING_ANSWER_ACCEPTED;
const NOT_READY: VeilwingAnswer = VeilwingAnswer::VEILWING_ANSWER_NOT_READY;
const TOO_LATE: VeilwingAnswer = VeilwingAnswer::VEILWING_ANSWER_TOO_LATE;

#[test]
fn spec_a_proposal_is_repeated_five_times_a_second_and_a_commit_ten_times() {
    let (mut i, _, propose) = proposed();
    assert!(i.is_proposing());
    let mut times = Vec::new();
    for ms in 2001..2410 {
        i.handle_timeout(at(ms));
        times.extend(proposals(&mut i).iter().map(|_| ms));
    }
    assert_eq!(times, [2200, 2400]);
    hear(&mut i, MavMessage::VEILWING_ANSWER(answer(&propose, ACCEPTED)), 2410);
    let mut times = vec![];
    for ms in 2410..2620 {
        times.extend(commits(&mut i).iter().map(|_| ms));
        i.handle_timeout(at(ms));
    }
    assert_eq!(times, [2410, 2511, 2611]);
}

#[test]
fn spec_a_proposal_is_due_at_once_and_void_when_its_transit_begins() {
    let (mut i, _, _) = proposed();
    i.propose(0, utc(6000), None, at(2001));
    assert_eq!(i.poll_timeout(), (at(2001), Timer::Proposal));
    i.handle_timeout(at(3999));
    assert_eq!(events(&mut i), []);
    i.acquaintance.due = at(9000);
    i.time.due = at(9000);
    i.next_status = at(9000);
    assert_eq!(i.poll_timeout(), (at(4000), Timer::Proposal));
    i.handle_timeout(at(4000));
    assert_eq!(events(&mut i), [Event::Refused(0, TOO_LATE)]);
    assert!(!i.is_proposing());
}

#[test]
fn spec_i_commits_only_with_half_a_second_and_the_time_of_an_answer_left() {
    for (ms, commits_it) in [(2750, true), (2751, false)] {
        let (mut i, _, propose) = proposed();
        hear(&mut i, MavMessage::VEILWING_ANSWER(answer(&propose, ACCEPTED)), ms);
        assert_eq!(commits(&mut i).len(), usize::from(commits_it));
        let refused = if commits_it { vec![] } else { vec![Event::Refused(0, TOO_LATE)] };
        assert_eq!((i.is_proposing(), events(&mut i)), (commits_it, refused), "{ms}");
    }
}

#[test]
fn spec_an_answer_counts_for_its_own_proposal_and_the_first_decides() {
    let (mut i, _, propose) = proposed();
    let refusal = answer(&propose, NOT_READY);
    for another_s in [
        wire::VEILWING_ANSWER_DATA { proposal: propose.proposal + 1, ..refusal.clone() },
        wire::VEILWING_ANSWER_DATA { boot_id: 12, ..refusal.clone() },
    ] {
        hear(&mut i, MavMessage::VEILWING_ANSWER(another_s), 2010);
        assert!(i.is_proposing() && events(&mut i).is_empty());
    }
    let mut accepted = i.clone();
    hear(&mut accepted, MavMessage::VEILWING_ANSWER(answer(&propose, ACCEPTED)), 2010);
    hear(&mut accepted, MavMessage::VEILWING_ANSWER(refusal.clone()), 2020);
    assert!(accepted.is_proposing(), "J may have committed by now");
    hear(&mut i, MavMessage::VEILWING_ANSWER(refusal), 2010);
    assert_eq!((i.is_proposing(), events(&mut i)), (false, vec![Event::Refused(0, NOT_READY)]));
}

#[test]
fn spec_a_proposal_is_withdrawn_when_the_clocks_do_not_agree_any_more() {
    let (mut i, _, _) = proposed();
    i.set_utc(Some(utc(60_000)), at(2010));
    i.propose(0, utc(66_000), None, at(2010));
    assert!(!i.is_proposing());
}

/// J's statuses around its commit: one from before it, one from after it.
fn committing() -> (Coordinator, MavMessage, MavMessage) {
    let (mut i, mut j, propose) = proposed();
    let status = |j: &mut Coordinator| j.status(at(2000));
    let before = status(&mut j);
    assert!(!j.is_proposing());
    hear(&mut j, MavMessage::VEILWING_PROPOSE(propose.clone()), 2000);
    assert!(j.is_proposing(), "it awaits the commit");
    hear(&mut i, MavMessage::VEILWING_ANSWER(answer(&propose, ACCEPTED)), 2010);
    hear(&mut j, MavMessage::VEILWING_COMMIT(commits(&mut i).remove(0)), 2020);
    (i, before, status(&mut j))
}

#[test]
fn spec_i_is_committed_by_j_s_word_before_the_transit() {
    for (ms, in_time) in [(3999, true), (4000, false)] {
        let (mut i, before, after) = committing();
        hear(&mut i, before, ms);
        assert_eq!(i.commitment(), None);
        hear(&mut i, after, ms);
        assert_eq!(i.commitment().is_some(), in_time, "{ms}");
    }
}

#[test]
fn spec_j_accepts_and_commits_up_to_300_ms_before_the_transit() {
    for (ms, expected) in [(3700, ACCEPTED), (3701, TOO_LATE)] {
        let (_, mut j, propose) = proposed();
        hear(&mut j, MavMessage::VEILWING_PROPOSE(propose), ms);
        assert_eq!(answers(&mut j), [expected], "{ms}");
    }
    for (ms, commits_it) in [(3700, true), (3701, false)] {
        let (_, mut j, propose) = proposed();
        hear(&mut j, MavMessage::VEILWING_PROPOSE(propose.clone()), 2000);
        let commit = wire::VEILWING_COMMIT_DATA { boot_id: 11, proposal: propose.proposal, slot: 0 };
        hear(&mut j, MavMessage::VEILWING_COMMIT(commit), ms);
        assert_eq!(j.commitment().is_some(), commits_it, "{ms}");
    }
}

#[test]
fn spec_another_plan_s_proposal_is_refused() {
    let (_, _, mut propose) = proposed();
    let (_, mut j, _) = proposed();
    propose.plan_digest = wire::short(&[3; 32]);
    hear(&mut j, MavMessage::VEILWING_PROPOSE(propose), 2000);
    assert_eq!(answers(&mut j), [VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN]);
}

#[test]
fn spec_the_newest_proposal_counts_in_whatever_order_they_come() {
    for order in [[0, 1], [1, 0]] {
        let (mut i, mut j, first) = proposed();
        i.propose(0, utc(6100), None, at(2001));
        i.handle_timeout(at(2001));
        let both = [first, proposals(&mut i).remove(0)];
        for k in order {
            hear(&mut j, MavMessage::VEILWING_PROPOSE(both[k].clone()), 2010);
        }
        assert_eq!(answers(&mut j).len(), 2);
        let commit = |proposal| wire::VEILWING_COMMIT_DATA { boot_id: 11, proposal, slot: 0 };
        hear(&mut j, MavMessage::VEILWING_COMMIT(commit(both[1].proposal)), 2020);
        assert_eq!(j.commitment().map(|c| (c.proposal, c.opens_at)), Some((2, at(6100))), "{order:?}");
        // Committed: a copy of it is accepted whatever has become of our readiness, an older one is not answered, and a
        // newer one is judged.
        j.set_readiness(None);
        sent(&mut j);
        for (proposal, expected) in [(2, vec![ACCEPTED]), (1, vec![]), (3, vec![NOT_READY])] {
            let copy = wire::VEILWING_PROPOSE_DATA { proposal, ..both[1].clone() };
            hear(&mut j, MavMessage::VEILWING_PROPOSE(copy), 2030);
            assert_eq!(answers(&mut j), expected, "{proposal}");
        }
        assert_eq!(j.commitment().map(|c| c.proposal), Some(2));
    }
}

#[test]
fn spec_j_says_again_that_it_is_committed_when_i_asks_again() {
    let (mut i, mut j, propose) = proposed();
    hear(&mut j, MavMessage::VEILWING_PROPOSE(propose.clone()), 2000);
    hear(&mut i, MavMessage::VEILWING_ANSWER(answer(&propose, ACCEPTED)), 2010);
    let commit = commits(&mut i).remove(0);
    hear(&mut j, MavMessage::VEILWING_COMMIT(commit.clone()), 2020);
    j.handle_timeout(at(2020));
    assert!(j.poll_timeout().0 > at(2030));
    hear(&mut j, MavMessage::VEILWING_COMMIT(commit), 2030);
    assert_eq!(j.poll_timeout(), (at(2030), Timer::Status));
}

#[test]
fn spec_j_gives_up_on_i_a_second_after_its_transit_began() {
    let (mut i, mut j, propose) = proposed();
    hear(&mut j, MavMessage::VEILWING_PROPOSE(propose.clone()), 2000);
    let commit = wire::VEILWING_COMMIT_DATA { boot_id: 11, proposal: propose.proposal, slot: 0 };
    hear(&mut j, MavMessage::VEILWING_COMMIT(commit), 2020);
    events(&mut j);
    for (ms, told) in [(4999, vec![]), (5000, vec![Event::PeerLeft]), (5001, vec![])] {
        let status = i.status(at(ms));
        hear(&mut j, status, ms);
        assert_eq!(events(&mut j), told, "{ms}");
    }
}

#[test]
fn spec_what_is_over_is_told_at_once_and_comes_back_by_no_copy() {
    let (mut i, mut j, request, grant) = granted();
    hear(&mut i, MavMessage::VEILWING_LEASE_GRANT(grant.clone()), 6110);
    assert_eq!(i.lease(at(6110)), Some(at(6600)));
    for side in [&mut i, &mut j] {
        side.handle_timeout(at(6120));
        sent(side);
        side.release(at(6121));
        assert_eq!(side.commitment(), None);
        assert_eq!(side.poll_timeout(), (at(6121), Timer::Status));
    }
    assert_eq!(i.lease(at(6121)), None);
    hear(&mut i, MavMessage::VEILWING_LEASE_GRANT(grant), 6122);
    assert_eq!(i.lease(at(6122)), None);
    let (_, _, copy) = proposed();
    assert_eq!(copy.proposal, request.proposal);
    hear(&mut j, MavMessage::VEILWING_PROPOSE(copy), 6122);
    assert_eq!(answers(&mut j), []);
}

/// The numbers of a new boot begin anew.
#[test]
fn spec_another_boot_s_first_proposal_is_not_over() {
    let (_, mut j, _, _) = granted();
    let mut reborn = coordinator(Role::I, 12);
    for ms in (6200..9000).step_by(10) {
        run(&mut reborn, &mut j, ms);
    }
    assert!(j.peer().is_boot(12) && j.commitment().is_none());
    j.set_readiness(Some(0));
    reborn.propose(0, utc(13_000), None, at(9000));
    (9000..9100).step_by(10).for_each(|ms| drop(run(&mut reborn, &mut j, ms)));
    assert!(j.commitment().is_some());
}

#[test]
fn spec_a_lease_belongs_to_the_slot_agreed_on() {
    let (mut i, _, _, grant) = granted();
    hear(&mut i, MavMessage::VEILWING_LEASE_GRANT(grant), 6110);
    assert_eq!(i.lease(at(6110)), Some(at(6600)));
    i.propose(1, utc(12_000), None, at(6120));
    assert_eq!(i.lease(at(6120)), None);
}

#[test]
fn spec_leases_are_asked_for_twenty_times_a_second_until_none_is_wanted() {
    let (mut i, _, _, grant) = granted();
    hear(&mut i, MavMessage::VEILWING_LEASE_GRANT(grant), 6101);
    let mut times = Vec::new();
    for ms in 6101..6210 {
        i.handle_timeout(at(ms));
        let asked = sent(&mut i).into_iter().filter(|m| matches!(m, MavMessage::VEILWING_LEASE_REQUEST(_)));
        times.extend(asked.map(|_| ms));
    }
    assert_eq!(times, [6150, 6200]);
    i.acquaintance.due = at(9000);
    i.time.due = at(9000);
    i.next_status = at(9000);
    assert_eq!(i.poll_timeout(), (at(6250), Timer::LeaseRequest));
    i.want_lease(false, at(6220));
    assert_eq!(i.lease(at(6220)), None);
    assert_eq!(i.poll_timeout().0, at(9000));
}

#[test]
fn spec_j_knows_how_long_i_may_hold_a_lease() {
    let (i, j, _, _) = granted();
    assert_eq!(j.longest_lease(), Duration::from_millis(500));
    assert_eq!((i.leases_end(), j.leases_end()), (None, Some(at(6600))));
    assert!(j.leases_outstanding(at(6599)) && !j.leases_outstanding(at(6600)));
    assert!(!i.leases_outstanding(at(6500)));
}
