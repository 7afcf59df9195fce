//! Which boot a hello is of, and how long it is heard, up to the edges of each.

use super::super::wire::{VEILWING_HELLO_DATA, VeilwingRole};
use super::*;

const OWN: u32 = 11;

/// A hello of `boot_id` at its `time_us`, which echoes one that we sent at `echo_us`.
fn hello(boot_id: u32, time_us: u64, echo_us: u64) -> VEILWING_HELLO_DATA {
    VEILWING_HELLO_DATA {
        boot_id,
        time_us,
        echo_us,
        echo_boot_id: OWN,
        role: VeilwingRole::VEILWING_ROLE_J,
        ..Default::default()
    }
}

fn at(us: u64) -> Instant {
    Instant::from_start(Duration::from_micros(us))
}

fn take(peer: &mut Peer, hello: &VEILWING_HELLO_DATA, now_us: u64) -> Boot {
    peer.take_hello(hello, OWN, now_us, at(now_us))
}

/// Of boot 7, taken in at 200 us.
fn known() -> Peer {
    let mut peer = Peer::default();
    assert_eq!(take(&mut peer, &hello(7, 100, 50), 200), Boot::First);
    peer
}

#[test]
fn spec_only_who_echoes_a_hello_of_ours_that_was_sent_is_believed() {
    let first = |hello: &VEILWING_HELLO_DATA| take(&mut Peer::default(), hello, 200);
    assert_eq!(first(&hello(7, 100, 200)), Boot::First, "in the same microsecond");
    assert_eq!(first(&hello(7, 100, 201)), Boot::Unproven);
    assert_eq!(first(&VEILWING_HELLO_DATA { echo_boot_id: 12, ..hello(7, 100, 50) }), Boot::Unproven);
}

#[test]
fn spec_a_copy_of_the_last_hello_is_known_and_an_older_one_late() {
    for (time_us, boot) in [(99, Boot::Late), (100, Boot::Known), (101, Boot::Known)] {
        assert_eq!(take(&mut known(), &hello(7, time_us, 50), 300), boot, "{time_us}");
    }
}

#[test]
fn spec_another_boot_must_echo_what_was_sent_after_the_known_one_was_taken_in() {
    for (echo_us, boot) in [(200, Boot::Unproven), (201, Boot::Restarted)] {
        let mut peer = known();
        // What it says later does not make it younger.
        assert_eq!(take(&mut peer, &hello(7, 150, 60), 400), Boot::Known);
        assert_eq!(take(&mut peer, &hello(8, 1, echo_us), 500), boot, "{echo_us}");
        assert!(peer.is_boot(if boot == Boot::Restarted { 8 } else { 7 }));
    }
}

#[test]
fn spec_it_is_heard_up_to_the_end_of_the_timeout() {
    let timeout = Duration::from_micros(1000);
    assert!(!Peer::default().heard_within(timeout, Instant::ZERO));
    assert!(known().heard_within(timeout, at(1200)));
    assert!(!known().heard_within(timeout, at(1201)));
}

#[test]
fn spec_a_status_counts_once_and_its_flags_are_what_it_says() {
    let mut peer = known();
    let status = VEILWING_STATUS_DATA {
        boot_id: 7,
        sequence: 4,
        flags: VeilwingFlags::VEILWING_FLAGS_LANDED,
        ..Default::default()
    };
    assert!(peer.take_status(&status, at(300)));
    assert!(!peer.take_status(&status, at(400)), "a copy");
    assert_eq!(peer.last_heard, Some(at(300)));
    assert!(peer.says(VeilwingFlags::VEILWING_FLAGS_LANDED));
    assert!(!peer.says(VeilwingFlags::VEILWING_FLAGS_AIRBORNE));
}

#[test]
fn spec_a_word_that_was_held_up_is_heard_now_and_was_said_before() {
    let mut peer = known();
    let ms = Duration::from_millis;
    let status = |sequence: u32, time_us: u64| VEILWING_STATUS_DATA {
        boot_id: 7,
        sequence,
        time_us,
        ..Default::default()
    };
    // Its clock shows 100 us less than ours.
    assert!(peer.take_status(&status(1, 1_000_000), at(1_000_100)));
    assert!(peer.spoke_within(ms(500), at(1_500_100)) && !peer.spoke_within(ms(500), at(1_500_101)));
    // Held up for 800 ms, of which 100 ms may be anybody's; and one of a companion that names no time.
    assert!(peer.take_status(&status(2, 1_200_000), at(2_000_100)));
    assert!(peer.heard_within(ms(0), at(2_000_100)) && !peer.spoke_within(ms(699), at(2_000_100)));
    assert!(peer.spoke_within(ms(701), at(2_000_100)));
    assert!(peer.take_status(&status(3, 0), at(2_000_200)));
    assert!(peer.spoke_within(ms(0), at(2_000_200)));
}

#[test]
fn val_a_peer_is_silent_since_its_last_word() {
    assert_eq!(Peer::default().silent_for(at(300)), None);
    assert_eq!(known().silent_for(at(300)), Some(Duration::from_micros(100)));
}

#[test]
fn spec_a_place_beyond_the_earth_is_none() {
    let mut peer = known();
    let said = |x: f64| VEILWING_HELLO_DATA {
        flags: VeilwingFlags::VEILWING_FLAGS_HOME,
        home_enu_m: [x, 2.0, 3.0],
        ..hello(7, 150, 60)
    };
    for x in [f64::NAN, f64::INFINITY, 1e30, -2e7] {
        assert_eq!(take(&mut peer, &said(x), 400), Boot::Known);
        assert_eq!(peer.home_enu_m, None, "{x}");
    }
    assert_eq!(take(&mut peer, &said(-9e6), 400), Boot::Known);
    assert_eq!(peer.home_enu_m, Some(Enu::new(-9e6, 2.0, 3.0)));
    for (sequence, x) in [(1, -9e6), (2, 1e30), (3, f32::NAN)] {
        let status = VEILWING_STATUS_DATA { sequence, position_enu_m: [x, 0.0, 0.0], ..Default::default() };
        assert!(peer.take_status(&status, at(500)));
        assert_eq!(peer.position_enu_m, Some(Enu::new(-9e6, 0.0, 0.0)), "{x}");
    }
}
