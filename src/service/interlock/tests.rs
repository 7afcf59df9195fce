//! What becomes of decisions: what is renewed and when, and what silences on its own.

use mavlink::dialects::ardupilotmega::MavMessage;

use super::*;
use crate::transmitter::{Kind, Settings};

const LEASE: Duration = Duration::from_millis(500);

fn at(ms: u64) -> Instant {
    Instant::from_start(Duration::from_millis(ms))
}

fn interlock(role: Role) -> Interlock {
    let settings = Settings {
        own: (1, 191),
        target: (1, 68),
        kind: Kind::Leased { command: 31010 },
        boot: 1,
        longest_round_trip: Duration::from_millis(150),
        apart: false,
        system_is_given: false,
        first_off_after: Duration::ZERO,
    };
    let ceilings = Ceilings { mission_w: 1.0, vehicle_w: 1.0 };
    let mut interlock = Interlock::new(role, Transmitter::new(settings, at(0)), ceilings, LEASE, true);
    offs(&mut interlock);
    interlock
}

/// How many of the commands that wait to be sent are offs.
fn offs(interlock: &mut Interlock) -> usize {
    let sent = std::iter::from_fn(|| interlock.poll_transmit());
    sent.filter(|message| matches!(message, MavMessage::COMMAND_INT(command) if command.y == 0)).count()
}

/// Nothing speaks against this power in this slot; vehicle I holds a lease to `lease_ms`.
fn facts(power_w: f64, slot: u16, lease_ms: u64) -> Facts {
    Facts {
        window: Some(Window { slot, from: at(0), until: at(60_000), power_w }),
        state_fresh: true,
        in_control: true,
        estimator_ok: true,
        pose_ok: true,
        jam_lease: Some(at(lease_ms)),
        peer_on_station: true,
        leases_outstanding: false,
    }
}

#[test]
fn spec_a_permit_is_renewed_every_100_ms_and_at_once_when_it_changes_or_ends_soon() {
    let long = facts(0.1, 1, 1400);
    let short = facts(0.1, 1, 1200);
    for (first, then, ms, renewed, why) in [
        (long, long, 1099, false, "as it was"),
        (long, long, 1100, true, "its time has come"),
        (long, facts(0.2, 1, 1400), 1001, true, "another power"),
        (long, facts(0.1, 2, 1400), 1001, true, "another slot"),
        (long, facts(0.1, 1, 1399), 1001, true, "it is to end sooner"),
        (long, facts(0.1, 1, 1450), 1001, false, "longer, and there is time"),
        (short, facts(0.1, 1, 1450), 1000, false, "it ends in 200 ms"),
        (short, facts(0.1, 1, 1450), 1001, true, "it ends within 200 ms"),
        (short, short, 1001, false, "it cannot be lengthened"),
    ] {
        let mut interlock = interlock(Role::I);
        assert!(interlock.apply(&first, at(1000)).is_ok());
        interlock.standing = interlock.standing.map(|(permit, _)| (permit, at(1000)));
        let permit = interlock.apply(&then, at(ms)).unwrap();
        let expected = if renewed { (permit, at(ms)) } else { (interlock.standing.unwrap().0, at(1000)) };
        assert_eq!(interlock.standing, Some(expected), "{why}");
    }
}

#[test]
fn spec_a_kill_silences_at_once_and_holds_until_it_is_lifted() {
    let mut interlock = interlock(Role::I);
    let on = facts(0.1, 1, 1400);
    assert!(interlock.may_radiate() && interlock.apply(&on, at(1000)).is_ok());
    interlock.set_killed(false, at(1001));
    assert!(interlock.is_on(), "nobody has killed it");
    offs(&mut interlock);
    interlock.set_killed(true, at(1010));
    assert!(!interlock.is_on() && !interlock.may_radiate());
    assert_eq!(offs(&mut interlock), 1, "in the same call");
    interlock.set_killed(true, at(1011));
    assert_eq!(offs(&mut interlock), 0, "it is known");
    assert_eq!(interlock.apply(&on, at(1020)), Err(Silence::Killed));
    interlock.set_killed(false, at(1030));
    assert!(interlock.may_radiate() && interlock.apply(&on, at(1040)).is_ok());
}

#[test]
fn spec_without_permission_nothing_radiates() {
    let mut interlock = interlock(Role::I);
    let on = facts(0.1, 1, 1400);
    assert!(interlock.apply(&on, at(1000)).is_ok());
    offs(&mut interlock);
    interlock.set_permitted(false);
    assert!(!interlock.may_radiate());
    assert_eq!(interlock.silence_for(&on, at(1010)), Some(Silence::NotAuthorised));
    assert_eq!(interlock.apply(&on, at(1010)), Err(Silence::NotAuthorised));
    assert_eq!((interlock.is_on(), offs(&mut interlock)), (false, 1));
    interlock.set_permitted(true);
    assert!(interlock.may_radiate() && interlock.apply(&on, at(1020)).is_ok());
}

/// Where answers do not name their commands, an off may overtake the on that followed it.
#[test]
fn spec_j_rests_for_a_lease_after_it_was_on_and_i_does_not() {
    let on = facts(0.1, 1, 9000);
    let after = |role, was_on, ms| {
        let mut interlock = interlock(role);
        if was_on {
            assert!(interlock.apply(&on, at(1000)).is_ok());
        }
        interlock.silence(at(1100));
        assert!(!interlock.is_on());
        interlock.apply(&on, at(ms)).err()
    };
    assert_eq!(after(Role::J, true, 1599), Some(Silence::Resting));
    assert_eq!(after(Role::J, true, 1600), None);
    assert_eq!(after(Role::J, false, 1101), None, "it was off before");
    assert_eq!(after(Role::I, true, 1101), None);
}
