//! Every fault of the world, and what it does to a vehicle that is left alone with it.

use crate::common::*;
use mavlink::dialects::ardupilotmega::*;
use veilwing_sitl::*;

fn height(f: &Flight) -> f64 {
    f.position(0)[2]
}

fn off_goal_m(f: &Flight) -> f64 {
    let goal = f.goals(0)[0];
    (0..3).map(|k| (f.position(0)[k] - goal[k]).powi(2)).sum::<f64>().sqrt()
}

fn count(f: &Flight, pick: impl Fn(&MavMessage) -> bool) -> usize {
    f.clients[0].received.iter().filter(|(component, m)| *component == 1 && pick(m)).count()
}

#[test]
fn spec_a_degraded_link_loses_and_delays_both_ways() {
    let mut f = on_station(config());
    let goals = f.goals(0);
    f.clients[0].received.clear();
    f.stream(10_000, goals, Some(0), |_| {});
    let is_position = |m: &MavMessage| matches!(m, MavMessage::LOCAL_POSITION_NED(_));
    let before = (count(&f, is_position), f.world.counters()[0].setpoints.accepted);
    f.world.inject(Fault::LinkDegraded { vehicle: 0, loss: 0.4, delay_s: 0.2 });
    f.clients[0].received.clear();
    f.stream(10_000, goals, Some(0), |_| {});
    let accepted = f.world.counters()[0].setpoints.accepted - before.1;
    assert!((500..700).contains(&accepted), "{accepted} of 1000");
    assert!((15..33).contains(&count(&f, is_position)), "{} of {}", count(&f, is_position), before.0);
    // Off commands arrive late as well.
    f.world.inject(Fault::LinkDegraded { vehicle: 0, loss: 0.0, delay_s: 0.2 });
    f.pass(500);
    f.clients[0].power(&mut f.world, 10.0, 0, 5000);
    f.pass(190);
    assert_eq!(f.world.snapshot().vehicles[0].tx_power_w, None);
    f.pass(20);
    assert!(f.world.snapshot().vehicles[0].tx_power_w.is_some());
    f.world.inject(Fault::LinkDegraded { vehicle: 0, loss: 0.0, delay_s: 0.0 });
    f.pass(10);
    f.off(0);
    assert_eq!(f.world.snapshot().vehicles[0].tx_power_w, None);
}

#[test]
fn spec_without_gps_the_vehicle_drifts_and_then_comes_down() {
    let mut f = on_station(config());
    let goals = f.goals(0);
    f.world.inject(Fault::GpsLoss { vehicle: 0, on: true });
    f.stream(4000, goals, Some(0), |_| {});
    let fix = |f: &Flight| {
        f.clients[0].last(|m| match m {
            MavMessage::GPS_RAW_INT(g) => Some(g.fix_type),
            _ => None,
        })
    };
    assert_eq!(fix(&f), Some(GpsFixType::GPS_FIX_TYPE_NO_FIX));
    // The companion is told that all is well, while 4 s at 0.06 m/s^2 have carried it off.
    assert!((0.3..0.7).contains(&off_goal_m(&f)), "{}", off_goal_m(&f));
    f.stream(2500, goals, Some(0), |_| {});
    assert_eq!(f.world.snapshot().vehicles[0].mode, "LAND");
    f.world.inject(Fault::GpsLoss { vehicle: 0, on: false });
    f.pass(1500);
    assert_eq!(fix(&f), Some(GpsFixType::GPS_FIX_TYPE_3D_FIX));
}

#[test]
fn spec_an_estimator_reset_moves_the_vehicle_not_the_report() {
    let mut f = on_station(config());
    let goals = f.goals(0);
    f.world.inject(Fault::EstimatorReset { vehicle: 0, jump_enu_m: [4.0, 0.0, -1.0] });
    f.stream(8000, goals, Some(0), |_| {});
    let off: [f64; 3] = std::array::from_fn(|k| f.position(0)[k] - goals[0][k]);
    assert!((off[0] + 4.0).abs() < 0.05 && off[1].abs() < 0.05 && (off[2] - 1.0).abs() < 0.05, "{off:?}");
    let told = f.clients[0].last(|m| match m {
        MavMessage::LOCAL_POSITION_NED(p) => Some([p.x, p.y, p.z]),
        _ => None,
    });
    // Its origin lies at (-27, 8, 0.5) of the mission.
    let [n, e, d] = told.unwrap();
    assert!((n - 7.0).abs() < 0.1 && (e - 7.0).abs() < 0.1 && (d + 29.5).abs() < 0.1, "{told:?}");
}

#[test]
fn spec_a_lost_rotor_is_survived_where_the_autopilot_knows_it() {
    for (mode, survives) in [(1, true), (0, false)] {
        let mut f = on_station(config());
        f.set_int("CA_FAILURE_MODE", mode);
        f.world.inject(Fault::RotorLoss { vehicle: 0, rotor: 5 });
        let goals = f.goals(0);
        f.stream(10_000, goals, Some(0), |_| {});
        assert_eq!(off_goal_m(&f) < 0.1, survives, "{}", off_goal_m(&f));
    }
}

#[test]
fn spec_a_low_battery_calls_the_vehicle_home_and_an_empty_one_drops_it() {
    let mut f = on_station(config());
    let goals = f.goals(0);
    f.world.inject(Fault::BatteryLow { vehicle: 0, charge: 0.12 });
    f.stream(1500, goals, Some(0), |_| {});
    assert_eq!(f.world.snapshot().vehicles[0].mode, "OFFBOARD");
    assert!(f.clients[0].texts().iter().any(|t| t.contains("Battery low")));
    f.world.inject(Fault::BatteryLow { vehicle: 0, charge: 0.06 });
    f.stream(200, goals, Some(0), |_| {});
    assert_eq!(f.world.snapshot().vehicles[0].mode, "RTL");
    f.world.inject(Fault::BatteryLow { vehicle: 0, charge: 0.04 });
    f.stream(200, goals, Some(0), |_| {});
    assert_eq!(f.world.snapshot().vehicles[0].mode, "LAND");
    let before = height(&f);
    f.world.inject(Fault::BatteryLow { vehicle: 0, charge: 0.0 });
    f.pass(1500);
    assert!(before - height(&f) > 8.0, "it falls");
}

#[test]
fn spec_the_battery_drains_with_the_load() {
    // Half an hour of hovering; 60 s of it are a thirtieth. Standing costs nothing, climbing more.
    let mut f = on_station(config());
    let goals = f.goals(0);
    f.stream(5000, goals, None, |_| {});
    let start = f.world.snapshot().vehicles[0].battery;
    f.stream(60_000, goals, None, |_| {});
    let used = start - f.world.snapshot().vehicles[0].battery;
    assert!((used * 30.0 - 1.0).abs() < 0.01, "{used}");
    let standing = Flight::new(config());
    let mut standing = standing;
    standing.pass(10_000);
    assert_eq!(standing.world.snapshot().vehicles[0].battery, 1.0);
}

#[test]
fn spec_a_clock_jump_shows_in_system_time_alone() {
    let mut f = Flight::new(config());
    f.pass(2500);
    f.world.inject(Fault::ClockJump { vehicle: 0, by_s: -3.5 });
    f.pass(1000);
    let told = f.clients[0].last(|m| match m {
        MavMessage::SYSTEM_TIME(t) => Some((t.time_unix_usec, t.time_boot_ms)),
        _ => None,
    });
    let (utc_us, boot_ms) = told.unwrap();
    assert_eq!(utc_us, f.config.utc_start_us - 3_500_000 + u64::from(boot_ms) * 1000);
}

#[test]
fn spec_a_restarted_autopilot_is_silent_falls_and_begins_anew() {
    let mut f = on_station(config());
    let goals = f.goals(0);
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, &[32.0, 20_000.0]);
    f.stream(100, goals, Some(0), |_| {});
    let before = height(&f);
    f.world.inject(Fault::AutopilotRestart { vehicle: 0 });
    f.clients[0].received.clear();
    f.stream(1000, goals, Some(0), |_| {});
    assert_eq!(count(&f, |_| true), 0, "silent");
    assert!(before - height(&f) > 3.0, "its motors have stopped");
    f.stream(3500, goals, Some(0), |_| {});
    let heartbeat = f.clients[0].heartbeat();
    assert!(!heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED));
    // Time since boot begins again, and what was asked for is forgotten: 4 Hz, not 50.
    let boot_ms = f.clients[0].last(|m| match m {
        MavMessage::ATTITUDE(a) => Some(a.time_boot_ms),
        _ => None,
    });
    assert!(boot_ms.unwrap() < 5000, "{boot_ms:?}");
    assert!(count(&f, |m| matches!(m, MavMessage::LOCAL_POSITION_NED(_))) < 10);
}

#[test]
fn spec_a_transmitter_that_ignores_its_expiry_radiates_on() {
    let mut f = Flight::new(config());
    f.pass(1000);
    f.world.inject(Fault::TransmitterIgnoresExpiry { vehicle: 1 });
    f.clients[1].power(&mut f.world, 10.0, 0, 100);
    f.pass(5000);
    assert!(f.world.snapshot().vehicles[1].tx_power_w.is_some());
    f.off(1);
    assert_eq!(f.world.snapshot().vehicles[1].tx_power_w, None);
}

#[test]
fn spec_a_transmitter_without_power_is_off_and_starts_with_a_series_of_its_own() {
    let mut f = Flight::new(config());
    f.pass(1000);
    f.clients[1].numbered(&mut f.world, 10.0, 1, 400);
    f.clients[1].numbered(&mut f.world, 10.0, 2, 400);
    assert!(f.world.snapshot().vehicles[1].tx_power_w.is_some());
    f.pass(200);
    let (before, _) = *f.clients[1].reports.last().unwrap();
    f.world.inject(Fault::TransmitterRestart { vehicle: 1, on: true });
    assert_eq!(f.world.snapshot().vehicles[1].tx_power_w, None);
    f.clients[1].reports.clear();
    f.clients[1].numbered_as(&mut f.world, &before, 10.0, 3, 400);
    f.pass(1000);
    assert_eq!((f.clients[1].reports.len(), f.world.snapshot().vehicles[1].tx_power_w), (0, None));
    f.world.inject(Fault::TransmitterRestart { vehicle: 1, on: false });
    f.pass(200);
    let (after, _) = *f.clients[1].reports.last().unwrap();
    assert!(after.time_ms < 250 && after.series != before.series && after.boot == 0, "{after:?}");
    // What is still under way from before counts for nothing.
    f.clients[1].numbered_as(&mut f.world, &before, 10.0, 4, 400);
    f.pass(20);
    assert_eq!(f.world.snapshot().vehicles[1].tx_power_w, None);
    f.clients[1].numbered(&mut f.world, 10.0, 5, 400);
    assert!(f.world.snapshot().vehicles[1].tx_power_w.is_some());
}

#[test]
fn val_a_clock_that_drifts_gains_what_it_is_told() {
    let mut f = Flight::new(config());
    let utc_us = |f: &Flight| {
        f.clients[0].last(|m| match m {
            MavMessage::SYSTEM_TIME(t) => Some((t.time_unix_usec, t.time_boot_ms)),
            _ => None,
        })
    };
    f.clients[0].command(&mut f.world, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, &[2.0, 100_000.0]);
    f.pass(2000);
    let (utc, boot) = utc_us(&f).unwrap();
    f.world.inject(Fault::ClockDrift { vehicle: 0, ppm: -500.0 });
    f.pass(10_000);
    f.world.inject(Fault::ClockDrift { vehicle: 0, ppm: 0.0 });
    f.pass(5000);
    let (later, later_boot) = utc_us(&f).unwrap();
    let gained_us = (later - utc) as f64 - f64::from(later_boot - boot) * 1e3;
    // 10 s at -500 millionths; the boot clock is told in whole ms.
    assert!((gained_us + 5000.0).abs() <= 1000.0, "{gained_us}");
}

#[test]
fn spec_noise_and_lag_show_in_the_truth_and_stay_small() {
    let mut config = config();
    for vehicle in &mut config.vehicles {
        vehicle.sensors = SensorConfig::typical();
        vehicle.wind = WindConfig { mean_enu_m_s: [3.0, -1.0, 0.0], turbulence_m_s: 4.0 };
    }
    let mut f = Flight::at_slot(config);
    f.hold(0, 500, [false, true]);
    f.hold(0, 20_000, [true, true]);
    let report = f.world.report();
    let slot = &report.slots[0];
    for (metres, degrees) in [
        (slot.position_rms_m.i, slot.attitude_control_rms_deg.i),
        (slot.position_rms_m.j, slot.attitude_control_rms_deg.j),
    ] {
        let (metres, degrees) = (metres.unwrap(), degrees.unwrap());
        assert!((0.02..0.3).contains(&metres) && (0.05..0.6).contains(&degrees), "{metres} {degrees}");
    }
    assert_eq!(report.violations, vec![]);
}
