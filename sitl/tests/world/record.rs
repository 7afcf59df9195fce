//! The recorder: steady in time, and prompt where something changes.

use std::time::Duration;

use crate::common::*;
use veilwing_sitl::*;

#[test]
fn spec_a_recorder_is_steady_and_misses_no_change() {
    let mut config = config();
    // Jitter would make the SINRs of two instants differ.
    config.jitter.std_deg = 0.0;
    let mut world = World::new(config).unwrap();
    let mut recorder = Recorder::new(Duration::from_millis(50));
    let mut companion = Client::companion(0);
    for ms in 0..=1000 {
        world.advance(Duration::from_millis(ms));
        if ms == 310 {
            companion.power(&mut world, 20.0, 0, 75);
        }
        recorder.observe(&world);
    }
    let records = recorder.finish();
    let on: Vec<&Record> = records.iter().filter(|r| r.snapshot.vehicles[0].tx_power_w.is_some()).collect();
    let at = |k: usize| on[k].snapshot.now_s;
    assert_eq!(on.len(), 2, "at 310 and at 350 ms");
    assert!((at(0) - 0.31).abs() < 1e-9 && (at(1) - 0.35).abs() < 1e-9, "{} {}", at(0), at(1));
    // 0, 50, ..., 1000 ms, and both changes.
    assert_eq!(records.len(), 21 + 2);
    let off = records.iter().position(|r| r.snapshot.now_s > 0.35).unwrap();
    assert!((records[off].snapshot.now_s - 0.385).abs() < 1e-9);

    // The rate of the record's SINRs is the rate that the world scores.
    let heard = on[1].heard.as_ref().unwrap();
    let strongest = heard.eavesdropper_sinr.iter().copied().fold(0.0, f64::max);
    let rate = 1e6 * ((1.0 + heard.user_sinr).log2() - (1.0 + strongest).log2()).max(0.0);
    let scored = on[1].snapshot.secrecy_rate_bps.unwrap();
    assert!(heard.eavesdropper_sinr.len() == 2 && (rate - scored).abs() <= 1e-9 * scored.max(1.0));
    assert!(records.iter().all(|r| r.heard.is_some() == r.snapshot.vehicles[0].tx_power_w.is_some()));
    assert_eq!(world.eavesdroppers_enu_m(), [[120.0, -40.0, 0.0], [-60.0, 100.0, 0.0]]);
}
