//! Slots of which both make the poses anew.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

/// The first slot with the poses of this number.
fn anew(of: &Coordinator, number: u8) -> SlotTerms {
    let mut terms = of.slot_terms(0).unwrap().clone();
    terms.anew = Some([number; 8]);
    terms.vehicles.i.pose.position_enu_m.x = f64::from(number);
    terms
}

fn asked(proposal: u32, number: u8) -> AskedSlot {
    AskedSlot { proposal, slot: 0, places: Places::new(number.into()) }
}

/// I has made the first slot's poses of this number, and proposes it.
fn propose_anew(i: &mut Coordinator, number: u8, ms: u64) {
    let asked = asked(0, number);
    i.slot_planned(&asked, Some(vec![anew(i, number)]), at(ms));
    i.propose(0, utc(ms + 4000), Some(asked.places), at(ms));
    i.handle_timeout(at(ms));
}

#[test]
fn spec_j_makes_a_slot_s_poses_before_it_answers_and_agrees_where_it_finds_the_same() {
    for (found, expected) in [
        (Some(3), VeilwingAnswer::VEILWING_ANSWER_ACCEPTED),
        (Some(4), VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN),
        (None, VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN),
    ] {
        let (mut i, mut j) = following();
        propose_anew(&mut i, 3, 2000);
        let said: Vec<_> = sent(&mut i);
        // Without the places nothing is known of it, and nothing said.
        let propose = |m: &&MavMessage| matches!(m, MavMessage::VEILWING_PROPOSE(_));
        said.iter().filter(propose).for_each(|m| j.handle_message(m, at(2000)));
        assert_eq!((events(&mut j), answers(&mut j)), (vec![], vec![]));
        said.iter().for_each(|m| j.handle_message(m, at(2010)));
        assert_eq!(events(&mut j), vec![Event::PlanSlot(asked(1, 3))]);
        // Nor before it is made; and it is asked for once.
        said.iter().for_each(|m| j.handle_message(m, at(2020)));
        assert_eq!((events(&mut j), answers(&mut j)), (vec![], vec![]));
        let terms = found.map(|found| anew(&j, found));
        // Nor by what another question has found.
        j.slot_planned(&asked(1, 5), Some(vec![anew(&j, 5)]), at(2050));
        assert_eq!(answers(&mut j), vec![]);
        // It answers as soon as it is.
        j.slot_planned(&asked(1, 3), terms.map(|terms| vec![terms]), at(2060));
        assert_eq!(answers(&mut j), vec![expected], "{found:?}");
        said.iter().for_each(|m| j.handle_message(m, at(2070)));
        assert_eq!(answers(&mut j), vec![expected], "{found:?}");
    }
}

/// A plan that is made anew, of a mission in which nothing moves: from a slot on, all of them.
#[test]
fn spec_j_makes_the_slots_that_are_left_before_it_answers_where_it_is_told_for_what() {
    let (mut i, mut j) = pair();
    let renewed = |of: &Coordinator| {
        let slots = (0..).map_while(|slot| of.slot_terms(slot).cloned());
        slots.map(|terms| SlotTerms { anew: Some([9; 8]), ..terms }).collect::<Vec<_>>()
    };
    let terms = renewed(&i);
    assert!(terms.len() > 1 && !terms[0].follows());
    i.slot_planned(&asked(0, 3), Some(terms.clone()), at(2000));
    i.propose(0, utc(6000), Some(asked(0, 3).places), at(2000));
    i.handle_timeout(at(2000));
    let said = sent(&mut i);
    let places = |m: &&MavMessage| matches!(m, MavMessage::VEILWING_PLACES(_));
    // Without the word for what, it is another plan.
    said.iter().filter(|m| !places(m)).for_each(|m| j.handle_message(m, at(2000)));
    assert_eq!((events(&mut j), answers(&mut j)), (vec![], vec![VeilwingAnswer::VEILWING_ANSWER_WRONG_PLAN]));
    said.iter().for_each(|m| j.handle_message(m, at(2010)));
    assert_eq!((events(&mut j), answers(&mut j)), (vec![Event::PlanSlot(asked(1, 3))], vec![]));
    j.slot_planned(&asked(1, 3), Some(terms), at(2020));
    assert_eq!(answers(&mut j), vec![VeilwingAnswer::VEILWING_ANSWER_ACCEPTED]);
    assert_eq!(renewed(&j), (0..).map_while(|slot| j.slot_terms(slot).cloned()).collect::<Vec<_>>());
}

#[test]
fn spec_what_is_said_late_of_a_slot_that_is_over_takes_the_place_of_nothing() {
    let (mut i, mut j) = following();
    let proposed = |i: &mut Coordinator, number: u8, ms: u64| {
        propose_anew(i, number, ms);
        let digest = |m: &MavMessage| match m {
            MavMessage::VEILWING_PROPOSE(propose) => Some(propose.plan_digest),
            _ => None,
        };
        let said = sent(i);
        assert_eq!(said.iter().find_map(digest), Some([number; 8]));
        let of_poses = |m: &MavMessage| matches!(m, MavMessage::VEILWING_PLACES(_));
        let (places, rest): (Vec<_>, Vec<_>) = said.into_iter().partition(of_poses);
        assert!(!places.is_empty());
        (places, rest)
    };
    let hear = |j: &mut Coordinator, said: &[MavMessage], ms: u64| {
        said.iter().for_each(|m| j.handle_message(m, at(ms)));
        events(j)
    };
    let (old_places, old) = proposed(&mut i, 3, 2000);
    hear(&mut j, &old_places, 2010);
    assert_eq!(hear(&mut j, &old, 2010), vec![Event::PlanSlot(asked(1, 3))]);
    let terms = anew(&j, 3);
    j.slot_planned(&asked(1, 3), Some(vec![terms]), at(2020));
    assert_eq!(answers(&mut j), vec![VeilwingAnswer::VEILWING_ANSWER_ACCEPTED]);
    j.release(at(2030));
    j.set_readiness(Some(0));
    let Part::I(leader) = &mut i.part else { unreachable!() };
    leader.withdraw();
    let (places, rest) = proposed(&mut i, 4, 2100);
    hear(&mut j, &places, 2110);
    hear(&mut j, &old_places, 2110);
    assert_eq!(hear(&mut j, &rest, 2110), vec![Event::PlanSlot(asked(2, 4))]);
}

#[test]
fn spec_who_is_not_ready_for_a_slot_does_not_make_its_poses() {
    let (mut i, mut j) = following();
    j.set_readiness(None);
    propose_anew(&mut i, 3, 2000);
    sent(&mut i).iter().for_each(|m| j.handle_message(m, at(2010)));
    assert_eq!(events(&mut j), vec![]);
    assert_eq!(answers(&mut j), vec![VeilwingAnswer::VEILWING_ANSWER_NOT_READY]);
}

/// Words are lost, held up and repeated, and I proposes the slot again and again, each time with other poses: what both are
/// committed to, both serve from the same.
#[test]
fn prop_both_are_committed_to_the_same_poses() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut agreed = 0;
    for run in 0..400 {
        let (mut i, mut j) = following();
        let (lost, twice) = (rng.random_range(0.0..0.5), rng.random_range(0.0..0.3));
        let mut under_way: Vec<(u64, Role, MavMessage)> = Vec::new();
        let mut making: Option<(u64, AskedSlot)> = None;
        for ms in (2000..9000).step_by(10) {
            if !i.is_proposing() && i.commitment().is_none() && rng.random_bool(0.2)
                || i.is_proposing() && rng.random_bool(0.01)
            {
                if i.is_proposing() {
                    let Part::I(leader) = &mut i.part else { unreachable!() };
                    leader.withdraw();
                }
                propose_anew(&mut i, rng.random(), ms);
            }
            let (due, later) = under_way.into_iter().partition(|(arrives, ..)| *arrives <= ms);
            under_way = later;
            let due: Vec<(u64, Role, MavMessage)> = due;
            for (_, to, message) in due {
                let to = if to == Role::I { &mut i } else { &mut j };
                to.handle_message(&message, at(ms));
            }
            i.handle_timeout(at(ms));
            j.handle_timeout(at(ms));
            if let Some((_, asked)) = making.take_if(|(made, _)| *made <= ms) {
                let found = asked.places.begins_ms as u8;
                let terms = anew(&j, if rng.random_bool(0.1) { found.wrapping_add(1) } else { found });
                j.slot_planned(&asked, Some(vec![terms]), at(ms));
            }
            for event in events(&mut j) {
                if let Event::PlanSlot(asked) = event {
                    making = Some((ms + rng.random_range(0..120), asked));
                }
            }
            events(&mut i);
            for (to, from) in [(Role::J, &mut i), (Role::I, &mut j)] {
                for message in sent(from) {
                    let copies = if rng.random_bool(twice) { 2 } else { 1 };
                    for _ in 0..copies {
                        if !rng.random_bool(lost) {
                            under_way.push((ms + rng.random_range(0..400), to, message.clone()));
                        }
                    }
                }
            }
            if let (Some(of_i), Some(of_j)) = (i.commitment(), j.commitment()) {
                assert_eq!(of_i.proposal, of_j.proposal, "run {run}");
                assert_eq!(i.slot_terms(0), j.slot_terms(0), "run {run} at {ms} ms");
                agreed += 1;
                break;
            }
        }
    }
    assert!(agreed > 100, "{agreed}");
}
