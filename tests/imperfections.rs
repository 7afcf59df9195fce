//! The link as it is, through the whole chain: flights over a link with imperfections that neither plan nor companions know,
//! scored by the simulated world and by this test's own arithmetic, and told by the campaign's document.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::path::Path;

use nalgebra::{Complex, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::config::Mission;
use veilwing::desk::campaign::coverage::Tally;
use veilwing::desk::campaign::{CampaignDocument, FlightLine, Identity, Times};
use veilwing::desk::simulation::{Flown, Imperfections, Scenario, Towards};
use veilwing::planner::slots::Plan;
use veilwing::planning;
use veilwing::role::PerVehicle;
use veilwing_sitl::{Antenna, Bias, PointingErrors, Uncertainty};

fn yard() -> (Mission, Plan) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/flight/yard.toml");
    let mission = Mission::load(&file).unwrap();
    let plan = planning::plan(&mission).unwrap();
    (mission, plan)
}

const DEPTHS_DB: [f64; 2] = [22.0, 25.0];
const K_DB: [f64; 2] = [15.0, 10.0];

/// Everything at once.
fn all() -> Imperfections {
    let errors = PointingErrors { heading_std_deg: 3.0, mounting_std_deg: 1.0, position_std_m: [0.4, 0.6] };
    let [i, j] = DEPTHS_DB.map(|depth_db| Antenna::NullDepth { depth_db });
    let [user, eavesdropper] = K_DB.map(Some);
    Imperfections {
        antennas: PerVehicle { i, j },
        errors: PerVehicle { i: errors, j: errors },
        rician_k_db: Towards { user, eavesdropper },
        users: vec![Uncertainty::Disc { radius_m: 2.0 }, Uncertainty::Gaussian { std_m: 1.0 }],
    }
}

/// The secrecy rate in slot `slot` by this test's own arithmetic, bit/s: plain Monte Carlo over jitter and scattering, at the
/// plan's poses moved by what this flight has drawn.
fn expected_bps(mission: &Mission, flown: &Flown, slot: usize) -> f64 {
    let (config, biases) = (flown.world.config(), flown.world.biases());
    let planned = &config.slots[slot];
    let user = config.users.iter().position(|user| user.name == planned.user).unwrap();
    let nodes: Vec<(Vector3<f64>, f64)> = std::iter::once((flown.world.users_enu_m()[user], K_DB[0]))
        .chain(flown.world.eavesdroppers_enu_m().into_iter().map(|place| (place, K_DB[1])))
        .map(|(place, k_db)| (Vector3::from(place), k_db))
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(77);
    let mut normal = || {
        // Box and Muller.
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    };
    let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
    let n = 60_000;
    let mut sum = 0.0;
    for _ in 0..n {
        let mut powers = vec![[0.0; 2]; nodes.len()];
        for k in 0..2 {
            let pose = &planned.poses[k];
            let Bias { heading_deg, mounting_deg: [x, y], position_enu_m } = biases[k];
            let (roll, pitch) = (
                pose.roll_rad + mission.jitter.std_rad * normal(),
                pose.pitch_rad + mission.jitter.std_rad * normal(),
            );
            let axis = about(Vector3::z(), heading_deg.to_radians() + pose.yaw_rad)
                * about(Vector3::y(), pitch)
                * about(Vector3::x(), roll)
                * about(Vector3::new(x.to_radians(), y.to_radians(), 0.0), 1.0)
                * Vector3::z();
            let from = Vector3::from(pose.position_enu_m) + Vector3::from(position_enu_m);
            let floor = 10f64.powf(-DEPTHS_DB[k] / 10.0);
            for ((node, k_db), power) in nodes.iter().zip(&mut powers) {
                let line = node - from;
                let gain = 1.0 - (1.0 - floor) * (axis.dot(&line) / line.norm()).powi(2);
                let share = 1.0 / (1.0 + 10f64.powf(k_db / 10.0));
                let z = Complex::new(normal(), normal()) / 2f64.sqrt();
                let mean = 1.0 - (1.0 - floor) / 3.0;
                let field = Complex::from(((1.0 - share) * gain).sqrt()) + z * (share * mean).sqrt();
                power[k] =
                    mission.radio.reference_gain * pose.tx_power_w * field.norm_sqr() / line.norm_squared();
            }
        }
        let bits: Vec<f64> =
            powers.iter().map(|[i, j]| (1.0 + i / (j + mission.radio.noise_power_w)).log2()).collect();
        sum += (bits[0] - bits[1..].iter().copied().fold(0.0, f64::max)).max(0.0);
    }
    mission.radio.bandwidth_hz * sum / f64::from(n)
}

#[test]
fn val_flights_over_a_real_link_achieve_what_their_draws_leave() {
    let (mission, plan) = yard();
    let scenario = Scenario::over(&all(), &mission, &plan, None).unwrap();
    let (mut off, mut variance, mut total) = (0.0, 0.0, 0.0);
    for seed in 40..44 {
        let flown = scenario.fly(seed, Vec::new(), &mut ()).unwrap();
        assert!(flown.completed(), "{:?}", flown.outcomes);
        assert_eq!(flown.report.violations, vec![]);
        for (k, slot) in flown.report.slots.iter().enumerate() {
            let expected = expected_bps(&mission, &flown, k);
            let (achieved, error) = (slot.achieved_secrecy_rate_bps, slot.standard_error_bps);
            println!(
                "seed {seed} {}: {achieved:.3e} bit/s, expected {expected:.3e}, error {error:.1e}, planned {:.3e}",
                slot.user, slot.planned_secrecy_rate_bps
            );
            // Eight half-second means know a standard error to a quarter.
            assert!((achieved - expected).abs() < 6.0 * error + 0.05 * expected, "{slot:?}");
            off += achieved - expected;
            variance += error * error;
            total += expected;
        }
    }
    assert!(off.abs() < 4.0 * variance.sqrt() + 0.02 * total, "{off} of {total}, error {}", variance.sqrt());
}

#[test]
fn spec_a_campaign_over_a_real_link_states_its_quantile_and_an_ideal_one_does_not() {
    let (mission, plan) = yard();
    let campaign = |link: &Imperfections, seeds: std::ops::Range<u64>| {
        let scenario = Scenario::over(link, &mission, &plan, None).unwrap();
        let lines = seeds.clone().enumerate().map(|(run, seed)| {
            let flown = scenario.fly(seed, Vec::new(), &mut ()).unwrap();
            FlightLine::new(run as u64, seed, &flown, Tally::default().finish())
        });
        let identity = Identity {
            mission: mission.name.clone(),
            mission_digest: mission.digest_hex(),
            plan_digest: String::new(),
            actuation: None,
            tracks_digest: None,
            faults_digest: None,
            seed: seeds.start,
            campaign_runs: seeds.end - seeds.start,
        };
        CampaignDocument::new(identity, None, true, lines.collect(), Times::default())
    };
    let real = campaign(&all(), 3..6);
    let ratios: Vec<f64> = real.flights.iter().filter_map(|flight| flight.achieved_over_planned).collect();
    let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    let quantile = real.achieved_over_planned.quantile_5pct.unwrap();
    assert!(quantile.value >= least && quantile.value < real.achieved_over_planned.mean.unwrap());
    assert!(real.achieved_over_planned.mean.unwrap() < 0.8, "{ratios:?}");
    let names: Vec<&str> = real.users.iter().map(|user| &*user.user).collect();
    assert_eq!(names, ["alpha", "bravo"]);
    for (k, user) in real.users.iter().enumerate() {
        let rates: Vec<f64> = real.flights.iter().map(|f| f.users[k].achieved_secrecy_rate_bps).collect();
        let mean = rates.iter().sum::<f64>() / 3.0;
        assert!((user.achieved_secrecy_rate_bps.mean.unwrap() / mean - 1.0).abs() < 1e-12);
        assert_eq!(user.achieved_secrecy_rate_bps.flights, 3);
    }
    assert!(real.table("").contains("exceeded in 95% of the flights"));
    // It reads back as it was written.
    let text = serde_json::to_string(&real).unwrap();
    assert_eq!(serde_json::from_str::<CampaignDocument>(&text).unwrap(), real);

    let ideal = campaign(&Imperfections::default(), 3..4);
    let text = serde_json::to_string(&ideal).unwrap();
    assert!(!text.contains("quantile") && !text.contains("\"users\""), "{text}");
    assert!(!ideal.table("").contains("95%"));
}
