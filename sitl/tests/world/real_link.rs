//! The link as it is, in whole flights: what a floor, a compass, a mount, a misplaced position and a misplaced user cost, by
//! hand from the true poses; and that nobody aboard is blamed for what nobody aboard can see.

use crate::common::*;
use nalgebra::{UnitQuaternion, Vector3};
use veilwing_sitl::*;

/// Flies slot 0 for ten seconds on the air.
fn fly(config: WorldConfig) -> Flight {
    let mut flight = Flight::at_slot(config);
    flight.hold(0, 500, [false, true]);
    flight.hold(0, 10_000, [true, true]);
    flight
}

/// The secrecy rate by hand: poses of the plan moved by the biases, a floor under both dipoles, the receivers' true places.
fn expected_bps(flight: &Flight, floor: f64) -> f64 {
    let biases = flight.world.biases();
    let reach = |k: usize, node: [f64; 3]| {
        let (pose, bias) = (&flight.config.slots[0].poses[k], biases[k]);
        let turn = |axis: [f64; 3], angle: f64| UnitQuaternion::from_scaled_axis(Vector3::from(axis) * angle);
        let body = turn([0.0, 0.0, 1.0], bias.heading_deg.to_radians() + pose.yaw_rad)
            * turn([0.0, 1.0, 0.0], pose.pitch_rad)
            * turn([1.0, 0.0, 0.0], pose.roll_rad);
        let [x, y] = bias.mounting_deg.map(f64::to_radians);
        // A rotation by a small vector (x, y, 0) carries z to (sin a) (y, -x, 0)/a + (cos a) z.
        let a = x.hypot(y).max(1e-300);
        let antenna = Vector3::new(y / a * a.sin(), -x / a * a.sin(), a.cos());
        let axis = body * antenna;
        let line =
            Vector3::from(node) - Vector3::from(pose.position_enu_m) - Vector3::from(bias.position_enu_m);
        let cosine = axis.dot(&line) / line.norm();
        pose.tx_power_w * (1.0 - (1.0 - floor) * cosine * cosine) / line.norm_squared()
    };
    let sinr = |node| reach(0, node) / (reach(1, node) + 1e-12);
    let user = sinr(flight.world.users_enu_m()[0]);
    let heard = flight.world.eavesdroppers_enu_m().into_iter().map(sinr).fold(0.0, f64::max);
    1e6 * ((1.0 + user).log2() - (1.0 + heard).log2()).max(0.0)
}

/// J above the user, its null straight down: where everything that is off shows at once.
fn above_the_user() -> WorldConfig {
    let mut config = config();
    config.slots[0].poses[1].position_enu_m = [0.0, 0.0, 40.0];
    config
}

fn errors() -> PointingErrors {
    PointingErrors { heading_std_deg: 4.0, mounting_std_deg: 2.0, position_std_m: [1.5, 1.5] }
}

#[test]
fn val_each_imperfection_costs_what_it_costs_by_hand() {
    type Change = fn(&mut WorldConfig);
    let each: [(&str, f64, Change); 6] = [
        ("ideal", 0.0, |_| {}),
        ("floor", 0.01, |c| {
            c.vehicles.iter_mut().for_each(|v| v.antenna = Antenna::NullDepth { depth_db: 20.0 });
        }),
        ("heading", 0.0, |c| {
            c.vehicles.iter_mut().for_each(|v| v.errors.heading_std_deg = 6.0);
        }),
        ("mounting", 0.0, |c| {
            c.vehicles.iter_mut().for_each(|v| v.errors.mounting_std_deg = 2.0);
        }),
        ("position", 0.0, |c| {
            c.vehicles.iter_mut().for_each(|v| v.errors.position_std_m = [1.5, 1.5]);
        }),
        ("user", 0.0, |c| c.users[0].uncertainty = Uncertainty::Disc { radius_m: 4.0 }),
    ];
    let mut rates = Vec::new();
    for (what, floor, change) in each {
        let mut config = above_the_user();
        change(&mut config);
        let flight = fly(config);
        let report = flight.world.report();
        let (achieved, expected) = (report.slots[0].achieved_secrecy_rate_bps, expected_bps(&flight, floor));
        println!("{what}: {achieved:.4e} bit/s, by hand {expected:.4e}");
        // Centimetres and hundredths of a degree of control error matter in a null alone.
        assert!((achieved / expected - 1.0).abs() < 0.02, "{what}: {achieved} {expected}");
        assert_eq!(report.violations, vec![], "{what}");
        rates.push(achieved);
    }
    // Each of them costs, heading apart: it does not turn J, which is level.
    assert!(rates[1..].iter().enumerate().all(|(k, rate)| k == 1 || *rate < 0.95 * rates[0]), "{rates:?}");
}

#[test]
fn spec_no_companion_is_blamed_for_what_its_vehicle_cannot_know() {
    let mut config = config();
    // Far more than the tolerance of a pose, 1 m and 5 degrees.
    let large = PointingErrors { heading_std_deg: 15.0, mounting_std_deg: 10.0, position_std_m: [4.0, 1.0] };
    config.vehicles.iter_mut().for_each(|v| v.errors = large);
    let flight = fly(config);
    let [i, j] = flight.world.biases();
    let worst = |b: Bias| b.position_enu_m.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!(
        worst(i).max(worst(j)) > 2.0 && i.heading_deg.abs().max(j.heading_deg.abs()) > 6.0,
        "{i:?} {j:?}"
    );
    let slot = &flight.world.report().slots[0];
    // The truth is told: each vehicle is off by its bias.
    assert!((slot.position_rms_m.i.unwrap() - worst(i)).abs() < 0.05, "{slot:?} {i:?}");
    assert!((slot.attitude_control_rms_deg.j.unwrap() - j.heading_deg.abs()).abs() < 0.1, "{slot:?} {j:?}");
    assert_eq!(flight.world.report().violations, vec![]);
}

#[test]
fn val_scattering_lowers_a_null_to_its_share_of_the_mean() {
    // J's null is on the user and I is far louder there: E ln of what J lets through is that of an exponential.
    let mut config = above_the_user();
    config.fading.user = Some(Rician { k_db: 20.0, coherence_s: 0.0 });
    let flight = fly(config);
    let slot = &flight.world.report().slots[0];
    // P/d^2 of both; I's gain at the user, 2/3 scattered; the noise is far below.
    let pose = &flight.config.slots[0].poses[0];
    let axis = [
        pose.roll_rad.cos() * pose.pitch_rad.sin(),
        -pose.roll_rad.sin(),
        pose.roll_rad.cos() * pose.pitch_rad.cos(),
    ];
    let squared: f64 = pose.position_enu_m.iter().map(|x| x * x).sum();
    let along: f64 = pose.position_enu_m.iter().zip(axis).map(|(x, a)| x * a).sum();
    let gain = 1.0 - along * along / squared;
    let k = 100.0 / 101.0;
    let scattered = (1.0 - k) * 2.0 / 3.0;
    // E ln |a + z|^2 = ln s + ln x + E_1(x), x = a^2/s; at this x the exponential integral is nothing.
    let ratio = k * gain / scattered;
    assert!(ratio > 20.0);
    let signal = (pose.tx_power_w / squared * scattered).ln() + ratio.ln();
    const EULER: f64 = 0.577_215_664_901_532_9;
    let jamming = (0.01 / 1600.0 * scattered).ln() - EULER;
    let user_bits = (signal - jamming) / std::f64::consts::LN_2;
    let direct = fly(above_the_user());
    // Eavesdroppers have no scattering, so what they hear is what they hear without.
    let without = direct.world.report().slots[0].achieved_secrecy_rate_bps;
    let sinr = 1.0 + pose.tx_power_w * gain / squared / 1e-12;
    let heard_bits = sinr.log2() - without / 1e6;
    let expected = 1e6 * (user_bits - heard_bits);
    let found = slot.achieved_secrecy_rate_bps;
    // ln of an exponential has deviation pi/sqrt 6, 1.85 bit: of 2000 samples 0.041 bit. J's control errors and the
    // noise, which keep its null from being perfect without scattering, stay below that.
    assert!((found - expected).abs() < 4.0 * 0.041e6, "{found} {expected}, without {without}");
}

#[test]
fn spec_the_stated_errors_change_no_other_draw() {
    // Everything else that is random in a flight stays: with errors of no size a flight is itself, bit for bit.
    let mut jittered = config();
    jittered.jitter.std_deg = 2.0;
    jittered.eavesdroppers[0].uncertainty = Uncertainty::Gaussian { std_m: 5.0 };
    jittered.vehicles.iter_mut().for_each(|v| v.sensors = SensorConfig::typical());
    let plain = fly(jittered.clone());
    let mut other = jittered;
    // A floor that is no floor, a user whose place is drawn with no spread.
    other.vehicles.iter_mut().for_each(|v| v.antenna = Antenna::NullDepth { depth_db: 4000.0 });
    other.users[0].uncertainty = Uncertainty::Gaussian { std_m: 0.0 };
    assert!(!other.has_ideal_link() && plain.config.has_ideal_link());
    let other = fly(other);
    assert_eq!(other.world.eavesdroppers_enu_m(), plain.world.eavesdroppers_enu_m());
    assert_eq!(other.world.snapshot(), plain.world.snapshot());
    assert_eq!(other.world.report(), plain.world.report());
    // Scattering is heard and nothing else.
    let mut scattering = plain.config.clone();
    scattering.fading.user = Some(Rician { k_db: 10.0, coherence_s: 0.1 });
    scattering.fading.eavesdropper = scattering.fading.user;
    let scattering = fly(scattering);
    assert_eq!(scattering.world.eavesdroppers_enu_m(), plain.world.eavesdroppers_enu_m());
    assert_eq!(scattering.world.snapshot().vehicles, plain.world.snapshot().vehicles);
    assert_ne!(scattering.world.report().slots, plain.world.report().slots);
    // Errors of a size leave the eavesdroppers where they were.
    let mut erring = plain.config.clone();
    erring.vehicles.iter_mut().for_each(|v| v.errors = errors());
    assert_eq!(fly(erring).world.eavesdroppers_enu_m(), plain.world.eavesdroppers_enu_m());
}
