//! Random ways and wishes, checked against true time.

use super::*;

/// A way whose manners are drawn.
fn way(rng: &mut ChaCha8Rng) -> Way {
    let seed = rng.random();
    Way {
        loss: if rng.random_bool(0.5) { rng.random_range(0.0..0.5) } else { 0.0 },
        duplication: if rng.random_bool(0.5) { rng.random_range(0.0..0.4) } else { 0.0 },
        delay: ms(if rng.random_bool(0.6) { rng.random_range(0..20) } else { rng.random_range(0..300) }),
        spread: if rng.random_bool(0.6) { ms(rng.random_range(1..200)) } else { Duration::ZERO },
        frozen_until: Instant::ZERO,
        rng: ChaCha8Rng::seed_from_u64(seed),
    }
}

/// One of the things that go wrong, now and then.
fn disturb(world: &mut World, rng: &mut ChaCha8Rng, radio_restarts: bool) {
    match rng.random_range(0..25) {
        0 => world.there.frozen_until = world.now + ms(rng.random_range(20..900)),
        1 => world.back.frozen_until = world.now + ms(rng.random_range(20..900)),
        2 => world.restart_companion(),
        3 if radio_restarts => world.radio.restart(),
        4 => (world.there, world.back) = (way(rng), way(rng)),
        _ => {}
    }
}

#[test]
fn prop_over_any_way_it_is_off_by_then_on_until_then_and_off_when_believed_off() {
    let (mut vouched, mut on, mut refused) = (0u32, 0u32, 0u32);
    for seed in 0..400u64 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut world = World::new(way(&mut rng), way(&mut rng));
        // What a radio that restarts had vouched for nobody can hold.
        let radio_restarts = seed % 4 == 0;
        world.radio = Radio::new(seed);
        world.radio.fast_ppm = rng.random_range(-100..=100);
        world.radio.early_ms = rng.random_range(0..=20);
        let context = format!("seed {seed}");
        for _ in 0..60 {
            disturb(&mut world, &mut rng, radio_restarts);
            if rng.random_range(0..8) == 0 {
                world.silence();
            } else {
                let (power_w, slot) = if rng.random_bool(0.8) { (0.1, 3) } else { (0.02, 4) };
                refused += u32::from(world.command(power_w, slot, rng.random_range(1..900)).is_err());
            }
            for step in 0..rng.random_range(1..120) {
                // The world asserts of each step that what is on may be on: off by then.
                world.step();
                on += u32::from(world.radio.on.is_some());
                if radio_restarts {
                    continue;
                }
                if world.transmitter.is_off(world.now) {
                    assert_eq!(world.radio.on, None, "{context}: believed off");
                }
                if step % 8 == 0 && world.vouched().is_some() {
                    vouched += 1;
                    world.assert_vouched(&context);
                }
            }
        }
        world.silence();
        (world.there, world.back) = (Way::steady(2), Way::steady(2));
        world.run(Duration::from_secs(4));
        assert!(world.radio.on.is_none() && world.transmitter.is_off(world.now), "{context}");
        assert_eq!(world.transmitter.ready(world.now), Ok(()), "{context}: all is well again");
    }
    assert!(vouched > 3_000 && on > 50_000 && refused > 100, "{vouched} {on} {refused}");
}
