//! Defaults and shipped files: what the interface promises.

use super::*;

#[test]
fn spec_defaults_are_those_of_the_interface() {
    let least = mission(LEAST);
    assert_eq!((least.name.as_str(), least.seed), ("mission", 7));
    assert_eq!(least.origin, Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 });
    assert_eq!((least.emission.as_ref(), least.carrier_hz), (None, None));
    let radio = Radio {
        bandwidth_hz: 1e6,
        noise_power_w: 1e-12,
        max_power_w: PerVehicle { i: 0.5, j: 0.5 },
        reference_gain: 1.0,
    };
    assert_eq!(least.radio, radio);
    assert_eq!(least.airspace.altitude_m, [80.0, 300.0]);
    let corners: Vec<[f64; 2]> =
        least.airspace.area_enu_m.iter().map(|corner| [corner.x, corner.y]).collect();
    assert_eq!(corners, [[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]]);
    assert_eq!(least.airspace.min_separation_m, 5.0);
    assert_eq!(least.airspace_max_tilt_rad.to_degrees(), 90.0);
    let vehicle = VehicleSettings {
        airframe: Airframe::Omnidirectional,
        max_tilt_rad: 90f64.to_radians(),
        speed_m_s: 8.0,
        climb_m_s: 3.0,
        acceleration_m_s2: 2.5,
        jerk_m_s3: 4.0,
        tilt_rate_rad_s: 45f64.to_radians(),
        home_enu_m: None,
    };
    assert_eq!(least.vehicles, PerVehicle { i: vehicle, j: vehicle });
    let std_rad = 2f64.to_radians();
    assert_eq!(least.jitter, Jitter { std_rad, model: JitterModel::Euler, axes: JitterAxes::RollPitch });
    assert_eq!(
        least.tdma,
        Tdma {
            slot_s: 20.0,
            guard_s: 1.0,
            settle_s: 3.0,
            slot_min_s: None,
            slot_max_s: None,
            order: Order::Listed,
            superframes: 1,
            wait_for_peer_s: None,
            start_utc: None
        }
    );
    let planner = PlannerSettings {
        method: Method::Veilwing,
        objective: Objective::Mean,
        optimise: Optimise::Rate,
        mode: Mode::Static,
        fairness: Fairness::Slots,
        replan: false,
        free_yaw: false,
        target_rate_bps: None,
    };
    assert_eq!(least.planner, planner);
    assert_eq!(
        (least.users[0].name.as_str(), least.eavesdroppers[0].name.as_str()),
        ("user-1", "eavesdropper-1")
    );
    assert_eq!(least.eavesdroppers[0].node.uncertainty, Uncertainty::None);
    assert!(least.problem(0).unwrap().has_ideal_link());
    assert_eq!(least.power_steps, PerVehicle::default());
    assert!(least.warnings.is_empty());
}

#[test]
fn spec_vehicle_defaults_are_those_of_the_interface() {
    let least =
        vehicle("vehicle.role = \"j\"\nautopilot.system_id = 2\npair.link = \"udpout:10.0.0.1:14600\"\n");
    assert_eq!((least.role, least.key_file.as_ref()), (Role::J, None));
    assert_eq!(least.autopilot.link.to_string(), "udpin:0.0.0.0:14540");
    assert_eq!(
        (least.autopilot.firmware, least.autopilot.actuation),
        (FirmwareChoice::Auto, Actuation::Pose)
    );
    assert_eq!((least.autopilot.system_id, least.autopilot.component_id), (Some(2), 191));
    assert_eq!(least.autopilot.rate_hz, 50.0);
    assert_eq!(least.autopilot.fence, crate::autopilot::FenceDuty::Upload);
    let leased = Transmitter {
        kind: Kind::Numbered { command: 31010 },
        simulated: true,
        link: None,
        key_file: None,
        system_id: None,
        component_id: 68,
        accept_late_commands: false,
        accept_orphaned_radio: false,
    };
    assert_eq!(least.transmitter, leased);
    assert_eq!(least.limits, Limits::default());
    assert_eq!((&least.autopilot.key_file, &least.operators), (&None, &vec![255]));
    assert_eq!((least.pair_peer_system, least.pair_tunnel), (None, false));
}

#[test]
fn val_a_start_is_one_instant_however_it_is_written() {
    let start = |text: &str| mission(&format!("{LEAST}[tdma]\nstart_utc = {text}\n"));
    let utc = start("2026-11-21T18:00:00Z");
    assert_eq!(utc.tdma.start_utc.map(|utc| utc.unix_us), Some(1_795_284_000_000_000));
    for same in [
        "2026-11-21 18:00:00Z",
        "2026-11-21T19:30:00+01:30",
        "2026-11-21T10:00:00.000-08:00",
        "\"2026-11-21T18:00:00Z\"",
    ] {
        assert_eq!(start(same).tdma.start_utc, utc.tdma.start_utc, "{same}");
        assert_eq!(start(same).digest(), utc.digest(), "{same}");
    }
    assert_ne!(start("2026-11-21T18:00:00.000001Z").digest(), utc.digest());
    assert_ne!(mission(LEAST).digest(), utc.digest());
    for (wrong, fragment) in [
        ("2026-11-21T18:00:00", "offset from UTC open"),
        ("2026-11-21", "offset from UTC open"),
        ("\"six in the evening\"", "with its offset, such as"),
        ("1969-12-31T23:59:59Z", "before 1970"),
        ("1795284000", "with its offset, such as"),
    ] {
        let text = format!("{LEAST}[tdma]\nstart_utc = {wrong}\n");
        let findings = Mission::parse("m.toml", &text).unwrap_err().to_string();
        assert!(findings.contains(fragment) && findings.contains("start_utc"), "{findings}");
    }
}

#[test]
fn spec_the_demo_is_what_the_interface_promises() {
    let demo = mission(DEMO);
    assert!(demo.users.len() >= 2 && demo.eavesdroppers.len() >= 3, "two users and three eavesdroppers");
    assert!((demo.jitter.std_rad.to_degrees() - 2.0).abs() < 1e-12);
    assert!(demo.warnings.is_empty() && demo.emission.is_none());
    for file in [VEHICLE_I, VEHICLE_J] {
        assert!(vehicle(file).check_against(&demo).is_empty());
    }
}

#[test]
fn val_the_paper_mission_is_reference_scenario_0() {
    let problem = mission(PAPER).problem(0).unwrap();
    assert_eq!(problem.user_enu_m, Enu::zeros());
    let nodes: Vec<_> = problem.eavesdroppers.iter().map(|node| node.position_enu_m).collect();
    let s1 = Enu::new(21.385_737_975_062_74, 103.841_847_006_329_54, 0.0);
    let s2 = Enu::new(-29.058_202_677_746_067, -296.752_057_455_321_16, 0.0);
    assert_eq!(nodes, [s1, s2]);
    assert_eq!((problem.airspace.altitude_m, problem.jitter.std_rad), ([80.0, 300.0], 0.0));
    assert_eq!((problem.radio.noise_power_w, problem.radio.reference_gain), (1e-12, 1.0));
}

#[test]
fn spec_a_problem_has_the_strictest_power_and_tilt() {
    let text = LEAST.replacen("[mission]\n", &format!("[mission]\n{ORIGIN}"), 1)
        + "[emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.3\n\
           [radio]\nmax_power_w = { i = 0.5, j = 0.2 }\n[airspace]\nmax_tilt_deg = 60\n\
           [vehicles]\ni = { max_tilt_deg = 45 }\nj = { airframe = \"conventional\" }\n";
    let mission = mission(&text);
    let problem = mission.problem(0).unwrap();
    assert_eq!(problem.radio.max_power_w, PerVehicle { i: 0.3, j: 0.2 });
    assert_eq!(mission.power_ceiling(Role::I).1, PowerLimit::Emission);
    assert_eq!(mission.power_ceiling(Role::J).1, PowerLimit::Radio);
    let tilts = problem.vehicles.map(|vehicle| vehicle.max_tilt_rad.to_degrees());
    assert!((tilts.i - 45.0).abs() < 1e-12 && (tilts.j - 60.0).abs() < 1e-12);
    assert_eq!(problem.vehicles.j.airframe, Airframe::Conventional);
    assert_eq!(mission.problem(1), None);
}

#[test]
fn val_the_reference_gain_of_a_carrier_is_free_space_loss_at_one_metre() {
    // Free-space path loss: 20 log10(f) - 147.55 dB at one metre.
    let radio =
        mission(&format!("{LEAST}[radio]\ncarrier_hz = 2.4e9\ntx_gain_dbi = 1.76\nrx_gain_dbi = -3.0\n"))
            .radio;
    let loss_db = 20.0 * 2.4e9f64.log10() - 147.552;
    assert!((10.0 * radio.reference_gain.log10() - (1.76 - 3.0 - loss_db)).abs() < 1e-3);
}

#[test]
fn spec_a_geodetic_position_is_the_same_place() {
    let origin = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.0 };
    let there = Geodetic::from_enu(Enu::new(120.0, -40.0, 3.0), origin);
    let (lat, lon, alt) = (there.lat_deg, there.lon_deg, there.alt_m - 200.0);
    let text = LEAST.replacen("[mission]\n", &format!("[mission]\n{ORIGIN}"), 1).replace(
        "enu_m = [120, -40, 0]",
        &format!("lat_deg = {lat}\nlon_deg = {lon}\nalt_m = {alt}\nstd_m = 4"),
    );
    let node = mission(&text).eavesdroppers[0].node;
    assert!((node.position_enu_m - Enu::new(120.0, -40.0, 3.0)).norm() < 1e-6);
    assert_eq!(node.uncertainty, Uncertainty::Gaussian { std_m: 4.0 });
}

#[test]
fn spec_all_settings_of_the_interface_are_there() {
    let mut found = Vec::new();
    settings(&Mission::schema(), "", &mut found);
    let found: BTreeSet<String> = found.into_iter().map(|(path, _)| path).collect();
    for path in [
        "mission.name",
        "mission.seed",
        "mission.origin.lat_deg",
        "mission.origin.lon_deg",
        "mission.origin.alt_amsl_m",
        "emission.authorised_by",
        "emission.band_hz",
        "emission.max_power_w",
        "radio.bandwidth_hz",
        "radio.noise_power_w",
        "radio.max_power_w",
        "radio.reference_gain",
        "radio.carrier_hz",
        "airspace.altitude_m",
        "airspace.area_enu_m",
        "airspace.min_separation_m",
        "airspace.max_tilt_deg",
        "vehicles.i.airframe",
        "vehicles.j.max_tilt_deg",
        "jitter.std_deg",
        "jitter.model",
        "jitter.axes",
        "tdma.slot_s",
        "tdma.guard_s",
        "tdma.order",
        "tdma.superframes",
        "user.name",
        "user.enu_m",
        "user.lat_deg",
        "user.lon_deg",
        "user.alt_m",
        "eavesdropper.name",
        "eavesdropper.enu_m",
        "eavesdropper.radius_m",
        "eavesdropper.std_m",
        "planner.method",
        "planner.objective",
        "planner.optimise",
        "planner.mode",
        "planner.fairness",
        "planner.replan",
        "tdma.slot_min_s",
        "tdma.slot_max_s",
    ] {
        assert!(found.contains(path), "{path}");
    }
}
