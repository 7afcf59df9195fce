//! A device that is late, wrong, broken or gone.

use super::stand::*;
use crate::radio_host::{Fault, Notice, Order, Outcome};
use crate::transmitter::wire::VeilwingRadioResult as Is;

#[test]
fn spec_off_is_the_first_order_and_nothing_is_radiated_before_it_is_confirmed() {
    let mut stand = Stand::raw(settings());
    stand.obeys_after = None;
    stand.drain();
    assert_eq!(stand.orders.last().unwrap().1, Order::Off);
    assert_eq!(stand.power(), 30_000, "it may radiate all that it can");
    assert!(!stand.host.is_off());
    stand.on(20.0, 500);
    assert_eq!(stand.orders.len(), 1);
    stand.outcome(Outcome::Off);
    assert_eq!(stand.orders.last().unwrap().1, Order::Set(settings().scale.at_most(20.0).unwrap()));
    assert!(stand.notices.contains(&Notice::Silent));
}

#[test]
fn spec_whatever_the_device_does_wrong_it_is_told_off_and_the_answer_says_why() {
    let cases = [
        (Outcome::Failed(Fault::Unreachable), Is::VEILWING_RADIO_RESULT_DEVICE_ERROR),
        (Outcome::Failed(Fault::Refused), Is::VEILWING_RADIO_RESULT_DEVICE_ERROR),
        (Outcome::Failed(Fault::Garbled), Is::VEILWING_RADIO_RESULT_DEVICE_ERROR),
        (Outcome::Failed(Fault::Late), Is::VEILWING_RADIO_RESULT_DEVICE_LATE),
        (Outcome::Set { read_back: Some(21.0) }, Is::VEILWING_RADIO_RESULT_OTHER_POWER),
        (Outcome::Set { read_back: Some(19.0) }, Is::VEILWING_RADIO_RESULT_OTHER_POWER),
        (Outcome::Set { read_back: Some(f64::NAN) }, Is::VEILWING_RADIO_RESULT_OTHER_POWER),
        (Outcome::Off, Is::VEILWING_RADIO_RESULT_OTHER_POWER),
    ];
    for (outcome, is) in cases {
        let mut stand = Stand::new();
        stand.obeys_after = None;
        assert_eq!(stand.on(20.0, 500), None);
        stand.outcome(outcome);
        let answer = stand.reports.iter().find(|report| report.answers == 1).cloned();
        assert_eq!(result(&answer), is, "{outcome:?}");
        assert_ne!(answer.unwrap().power_mdbm, OFF, "off is not confirmed");
        assert_eq!(stand.orders.last().unwrap().1, Order::Off);
        // Until it is, nothing is tried.
        assert_eq!(result(&stand.on(20.0, 500)), is);
        assert_eq!(result(&stand.off()), is);
        stand.outcome(Outcome::Off);
        assert_eq!(stand.power(), OFF);
        let again = stand.on(20.0, 500);
        let tried = |stand: &Stand| matches!(stand.orders.last().unwrap().1, Order::Set(_));
        if matches!(outcome, Outcome::Set { .. }) {
            // It would radiate at that power with every renewal.
            assert!(!tried(&stand) && result(&again) == is, "{outcome:?}");
            stand.run(10_000);
            stand.on(20.0, 500);
        }
        assert!(tried(&stand), "it may try again");
    }
}

#[test]
fn spec_a_device_that_does_not_answer_is_late_at_its_declared_time_and_told_off_until_it_says_so() {
    let mut stand = Stand::new();
    stand.obeys_after = None;
    stand.on(20.0, 500);
    stand.run(CHANGE_MS - 1);
    assert!(matches!(stand.orders.last().unwrap().1, Order::Set(_)));
    stand.run(1);
    assert_eq!(stand.orders.last().unwrap().1, Order::Off);
    assert_eq!(
        stand.reports.iter().find(|report| report.answers == 1).unwrap().result,
        Is::VEILWING_RADIO_RESULT_DEVICE_LATE
    );
    let told = stand.orders.len();
    stand.run(10_000);
    assert!(stand.orders.len() > told + 5, "told again, and again");
    assert!(stand.orders[told..].iter().all(|(_, order)| *order == Order::Off));
    assert_ne!(stand.power(), OFF);
    assert!(stand.notices.contains(&Notice::Fault(Fault::Late)));
    assert!(stand.notices.contains(&Notice::MayRadiate(Fault::Late)));
    assert!(stand.notices.len() < 6, "and said once: {:?}", stand.notices);
    stand.outcome(Outcome::Off);
    assert_eq!(stand.power(), OFF);
}

#[test]
fn spec_an_off_that_fails_is_told_again_and_is_no_off() {
    let mut stand = Stand::new();
    stand.on(20.0, 500);
    stand.obeys_after = None;
    assert_eq!(stand.off(), None);
    for fault in [Fault::StillOn, Fault::Unreachable, Fault::Garbled] {
        stand.fails(fault);
        assert_eq!(stand.power(), 20_000);
        assert!(stand.notices.contains(&Notice::MayRadiate(fault)));
        let told = stand.orders.len();
        stand.run(200);
        assert_eq!(stand.orders.len(), told + 1);
    }
    stand.outcome(Outcome::Off);
    assert_eq!(stand.power(), OFF);
}

#[test]
fn spec_expiry_is_decided_while_the_device_hangs() {
    let mut stand = Stand::new();
    stand.on(20.0, 200);
    stand.obeys_after = None;
    // A change under way when the lease ends.
    stand.run(100);
    stand.on(25.0, 60);
    stand.run(42);
    assert_eq!(stand.orders.last().unwrap().1, Order::Off, "it pre-empts");
    let answer = stand.reports.iter().find(|report| report.answers == 2).unwrap();
    assert_eq!(
        (answer.result, answer.power_mdbm),
        (Is::VEILWING_RADIO_RESULT_EXPIRED, 25_000),
        "what it may radiate"
    );
}

#[test]
fn spec_an_off_that_cut_a_power_short_counts_when_that_can_no_longer_be_carried_out() {
    let mut stand = Stand::new();
    stand.obeys_after = Some(ms(20));
    stand.on(20.0, 500);
    stand.run(10);
    assert_eq!(stand.off(), None);
    stand.run(20);
    assert_eq!(stand.power(), 20_000, "read back off, but the power may be on its way");
    stand.run(CHANGE_MS);
    assert_eq!(stand.power(), OFF);
    let offs = stand.orders.iter().filter(|(_, order)| *order == Order::Off).count();
    assert_eq!(offs, 2);
    assert!(stand.reports.iter().any(|report| report.answers == 2 && report.power_mdbm == OFF));
}

#[test]
fn spec_the_outcome_of_an_order_that_was_pre_empted_means_nothing() {
    let mut stand = Stand::new();
    stand.obeys_after = None;
    stand.on(20.0, 500);
    let (set, _) = *stand.orders.last().unwrap();
    stand.off();
    stand.host.handle_outcome(set, Outcome::Set { read_back: Some(20.0) }, stand.now);
    stand.drain();
    assert!(!stand.host.is_off());
    assert_eq!(stand.orders.last().unwrap().1, Order::Off);
    assert_eq!(stand.host.counters().stale_outcomes, 1);
}

#[test]
fn spec_the_newest_power_wins_when_two_are_wanted_while_the_device_is_busy() {
    let mut stand = Stand::new();
    stand.obeys_after = Some(ms(30));
    stand.on(20.0, 500);
    stand.run(10);
    stand.on(10.0, 500);
    stand.run(60);
    assert_eq!(stand.power(), 10_000);
    let answered: Vec<u32> =
        stand.reports.iter().filter(|report| report.answers > 0).map(|report| report.answers).collect();
    assert_eq!(answered, [1, 2]);
    assert!(stand.reports.iter().all(|report| report.answers == 0 || report.power_mdbm == 10_000));
}

#[test]
fn spec_a_device_that_cannot_be_read_back_has_what_was_set() {
    let mut stand = Stand::new();
    stand.obeys_after = None;
    stand.on(20.7, 500);
    stand.outcome(Outcome::Set { read_back: None });
    assert_eq!(stand.power(), 20_000);
}

#[test]
fn spec_a_power_that_waited_for_an_off_that_came_too_late_is_not_radiated() {
    let mut stand = Stand::new();
    stand.obeys_after = None;
    stand.on(20.0, 300);
    stand.off();
    // It proves nothing yet, as the power may still be on its way; meanwhile a new one is wanted.
    stand.outcome(Outcome::Off);
    stand.on(10.0, 300);
    // The off that is told again hangs, past the lease.
    stand.run(300);
    assert!(stand.notices.contains(&Notice::Fault(Fault::Late)), "{:?}", stand.notices);
    stand.outcome(Outcome::Off);
    assert_eq!((stand.orders.last().unwrap().1, stand.power()), (Order::Off, OFF));
}
