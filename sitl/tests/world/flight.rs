//! Whole flights in virtual time, flown by the least of companions.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use veilwing_sitl::*;

#[test]
fn spec_a_slot_flown_well_scores_its_plan_without_violation() {
    let mut flight = Flight::at_slot(config());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 10_000, [true, true]);
    flight.off(0);
    flight.hold(0, 500, [false, true]);
    flight.off(1);
    flight.hold(0, 500, [false, false]);

    // By hand: I at (-20, 15, 30), roll 60, pitch -20; J level, straight dipole, its line to each node.
    let poses = &flight.config.slots[0].poses;
    let axis = |p: &PlannedPose| {
        [p.roll_rad.cos() * p.pitch_rad.sin(), -p.roll_rad.sin(), p.roll_rad.cos() * p.pitch_rad.cos()]
    };
    let reach = |p: &PlannedPose, node: [f64; 3]| {
        let d: [f64; 3] = std::array::from_fn(|k| node[k] - p.position_enu_m[k]);
        let squared: f64 = d.iter().map(|x| x * x).sum();
        let along: f64 = d.iter().zip(axis(p)).map(|(x, a)| x * a).sum();
        p.tx_power_w * (1.0 - along * along / squared) / squared
    };
    let sinr = |node| reach(&poses[0], node) / (reach(&poses[1], node) + 1e-12);
    let heard = f64::max(sinr([120.0, -40.0, 0.0]), sinr([-60.0, 100.0, 0.0]));
    let expected = 1e6 * ((1.0 + sinr([0.0; 3])).log2() - (1.0 + heard).log2());

    let report = flight.world.report();
    let slot = &report.slots[0];
    assert_eq!(report.violations, vec![]);
    assert!((slot.achieved_secrecy_rate_bps / expected - 1.0).abs() < 5e-3, "{slot:?}\n{expected}");
    assert!((slot.radiated_s.i - 10.0).abs() < 0.05 && (slot.radiated_s.j - 11.0).abs() < 0.05, "{slot:?}");
    assert_eq!((slot.unprotected_s, slot.jam_out_of_tolerance_s), (0.0, 0.0));
    assert!(slot.position_rms_m.i.unwrap() < 0.03 && slot.position_rms_m.j.unwrap() < 0.03, "{slot:?}");
    assert!(slot.attitude_control_rms_deg.i.unwrap() < 0.1, "{slot:?}");
    assert!(report.min_separation_m.unwrap() > 5.0);

    // Home, and disarmed by the landing.
    for k in 0..2 {
        flight.clients[k].command(&mut flight.world, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, &[]);
    }
    flight.pass(60_000);
    let snapshot = flight.world.snapshot();
    for (k, vehicle) in snapshot.vehicles.iter().enumerate() {
        let home = flight.config.vehicles[k].home_enu_m;
        let off = (vehicle.position_enu_m[0] - home[0]).hypot(vehicle.position_enu_m[1] - home[1]);
        assert!(off < 0.5 && vehicle.landed && !vehicle.armed, "{vehicle:?}");
    }
    assert_eq!(flight.invariants(), vec![]);
}

#[test]
fn spec_injected_jitter_shows_in_the_attitude_and_not_in_the_control() {
    let mut config = config();
    config.jitter.std_deg = 2.0;
    let mut flight = Flight::at_slot(config);
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 10_000, [true, true]);
    let slot = &flight.world.report().slots[0];
    // Two axes of 2 degrees: 2.83 degrees rms, over 2000 samples each.
    for rms in [slot.attitude_rms_deg.i.unwrap(), slot.attitude_rms_deg.j.unwrap()] {
        assert!((rms / 8f64.sqrt() - 1.0).abs() < 4.0 * (1.0f64 / 4000.0).sqrt(), "{slot:?}");
    }
    assert!(slot.attitude_control_rms_deg.i.unwrap() < 0.1 && slot.standard_error_bps > 0.0, "{slot:?}");
    assert_eq!(flight.invariants(), vec![]);
}

#[test]
fn spec_the_same_seed_gives_the_same_flight() {
    let fly = || {
        let mut config = config();
        config.jitter.std_deg = 2.0;
        config.vehicles[0].wind = WindConfig { mean_enu_m_s: [4.0, 1.0, 0.0], turbulence_m_s: 8.0 };
        let mut flight = Flight::at_slot(config);
        flight.hold(0, 1000, [true, true]);
        (flight.world.report(), flight.world.snapshot())
    };
    let (first, second) = (fly(), fly());
    assert_eq!(first, second);
    assert!(first.0.slots[0].position_rms_m.i.unwrap() > 0.0);
}

#[test]
fn spec_wind_is_held_against_and_measured() {
    let mut config = config();
    let wind = WindConfig { mean_enu_m_s: [6.0, -3.0, 0.0], turbulence_m_s: 8.0 };
    config.vehicles.iter_mut().for_each(|v| v.wind = wind);
    let mut flight = Flight::at_slot(config);
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 10_000, [true, true]);
    let slot = &flight.world.report().slots[0];
    let rms = slot.position_rms_m.i.unwrap();
    assert!(rms < 0.1 && rms > 0.002, "{rms}");
    assert_eq!(flight.invariants(), vec![]);
}

#[test]
fn spec_a_conventional_vehicle_leans_to_move_and_ignores_attitude_targets() {
    let mut config = config();
    config.vehicles[0].airframe = Airframe::Conventional;
    config.slots[0].poses[0].roll_rad = 0.0;
    config.slots[0].poses[0].pitch_rad = 0.0;
    let mut flight = Flight::at_slot(config.clone());
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 2000, [true, true]);
    assert_eq!(flight.invariants(), vec![]);
    // Told to roll by 60 degrees it stays level, and out of the pose.
    let tilted =
        attitude_target(&config.vehicles[0], &PlannedPose { roll_rad: 1.0, ..config.slots[0].poses[0] });
    for _ in 0..100 {
        flight.target(0, config.slots[0].poses[0].position_enu_m, None);
        flight.clients[0].send(&mut flight.world, &tilted);
        flight.pass(20);
    }
    let [w, x, y, _] = flight.world.snapshot().vehicles[0].attitude_wxyz;
    assert!(x.hypot(y) < 0.02 && w.abs() > 0.0);
}

#[test]
fn spec_small_and_large_steps_simulate_the_same() {
    let run = |step_us: u64| {
        let mut config = config();
        config.jitter.std_deg = 2.0;
        config.vehicles[0].wind.turbulence_m_s = 10.0;
        let mut flight = Flight::new(config);
        flight.take_off();
        flight.clients[1].power(&mut flight.world, 10.0, 0, 777);
        let (start, mut frames) = (flight.world.now(), Vec::new());
        for k in 1..=3_000_000 / step_us {
            flight.world.advance(start + std::time::Duration::from_micros(k * step_us));
            frames.extend(std::iter::from_fn(|| flight.world.poll_transmit()));
        }
        // Frames of different vehicles may interleave otherwise.
        frames.sort_by_key(|(vehicle, link, _)| (*vehicle, *link));
        (flight.world.snapshot(), flight.world.report(), frames)
    };
    let large = run(1_000_000);
    assert!(large.1.outside_slots_s.j == 0.0 && large.1.slots[0].radiated_s.j > 0.7, "{:?}", large.1);
    assert_eq!(run(1000), large);
    assert_eq!(run(300_000), large);
}
