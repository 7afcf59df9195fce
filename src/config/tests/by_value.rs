//! Missions and vehicles that were filled in instead of read.

use super::*;

/// A change of a draft, and what is said of it.
type Wrong<T> = (fn(&mut T), &'static str);

fn least() -> MissionDraft {
    MissionDraft {
        users: vec![NodeDraft::new("user-1", Enu::zeros())],
        eavesdroppers: vec![NodeDraft::new("eavesdropper-1", Enu::new(120.0, -40.0, 0.0))],
        ..MissionDraft::default()
    }
}

/// One of everything that a file may leave out.
const ALL: &str = "[mission]\nname = \"all\"\norigin = { lat_deg = 50.1, lon_deg = 14.1, alt_amsl_m = 210.5 }\n\
    [emission]\nauthorised_by = \"me\"\nband_hz = [2.4e9, 2.41e9]\nmax_power_w = 0.3\n\
    [radio]\ncarrier_hz = 2.405e9\ntx_gain_dbi = 1.76\nmax_power_w = { i = 0.5, j = 0.2 }\n\
    [airspace]\nmax_tilt_deg = 60.1\n[vehicles]\ni = { max_tilt_deg = 45.3, tilt_rate_deg_s = 33.3 }\n\
    j = { airframe = \"conventional\", home_enu_m = [1, 2, 3] }\n[jitter]\nstd_deg = 1.1\nmodel = \"body\"\n\
    [tdma]\norder = \"shortest\"\nsuperframes = 3\nstart_utc = 2026-11-21T18:00:00Z\n\
    [[user]]\nlat_deg = 50.1001\nlon_deg = 14.1002\nalt_m = 1.5\n[[user]]\nenu_m = [9, 9, 0]\n\
    [[eavesdropper]]\nenu_m = [120, -40, 0]\nradius_m = 0\n\
    [[eavesdropper]]\nlat_deg = 50.1\nlon_deg = 14.101\nstd_m = 4.5\n[planner]\nobjective = \"quantile\"\n";

#[test]
fn spec_a_mission_by_value_has_the_digest_of_the_file_that_says_the_same() {
    let built = Mission::new(least()).unwrap();
    assert_eq!(built.digest(), mission(LEAST).digest(), "{:?}", built.differences(&mission(LEAST)));
    // Whatever a file says, its draft says again.
    for text in [LEAST, DEMO, PAPER, ALL] {
        let read = mission(text);
        let again = read.changed(|_| ()).unwrap();
        assert_eq!(again.digest(), read.digest(), "{:?}", again.differences(&read));
        assert_eq!((again.problem(0), again.tdma), (read.problem(0), read.tdma));
        assert_eq!(again.vehicles, read.vehicles);
        assert_eq!(again.has_origin(), read.has_origin());
    }
}

#[test]
fn spec_a_changed_mission_has_another_digest() {
    let read = mission(DEMO);
    let changes: [fn(&mut MissionDraft); 5] = [
        |m| m.jitter.std_deg = 5.0,
        |m| m.tdma.order = Order::Shortest,
        |m| m.users[1].enu_m = Some(Enu::new(1.0, 2.0, 0.0)),
        |m| m.planner.optimise = Optimise::Rate,
        |m| m.eavesdroppers[0].radius_m = Some(1.5),
    ];
    for (number, change) in changes.into_iter().enumerate() {
        let changed = read.changed(change).unwrap_or_else(|findings| panic!("{number}: {findings}"));
        assert_ne!(changed.digest(), read.digest(), "{number}");
        assert_eq!(changed.differences(&read).len(), 1, "{number}: {:?}", changed.differences(&read));
    }
    assert_eq!(read.changed(|m| m.jitter.std_deg = 5.0).unwrap().jitter.std_rad, 5f64.to_radians());
}

#[test]
fn spec_what_a_file_may_not_say_a_draft_may_not() {
    let wrong: [Wrong<MissionDraft>; 12] = [
        (|m| m.name.clear(), "`mission.name` is empty"),
        (|m| m.tdma.slot_s = f64::NAN, "`tdma.slot_s` is NaN, not a finite number"),
        (|m| m.tdma.superframes = 0, "`tdma.superframes` is 0, outside 1 to 1000"),
        (|m| m.tdma.guard_s = 20.0, "leaves nothing of a slot"),
        (|m| m.radio.max_power_w.j = -0.5, "`radio.max_power_w` of J is -0.5 W, below the minimum"),
        (|m| m.airspace.area_enu_m.truncate(2), "`airspace.area_enu_m` has 2 entries, fewer than the 3"),
        (|m| m.airspace.area_enu_m.swap(1, 2), "crosses itself"),
        (|m| m.vehicles.i.max_tilt_deg = 91.0, "`vehicles.i.max_tilt_deg` is 91 deg, above the maximum"),
        (|m| m.users.clear(), "the list of `user` has 0 entries"),
        (|m| m.users[0].enu_m = None, "[[user]] number 1 has neither `enu_m` nor `lat_deg`, `lon_deg`"),
        (|m| m.users[0].alt_m = Some(1.0), "`alt_m` is given together with `enu_m`"),
        (
            |m| (m.eavesdroppers[0].radius_m, m.eavesdroppers[0].std_m) = (Some(1.0), Some(2.0)),
            "`std_m` is given together with `radius_m`",
        ),
    ];
    for (change, says) in wrong {
        let mut draft = least();
        change(&mut draft);
        let findings = Mission::new(draft).unwrap_err();
        assert!(
            findings.has_errors() && findings.to_string().contains(says),
            "{says:?} is not in {findings}"
        );
    }
}

#[test]
fn spec_a_vehicle_by_value_is_the_vehicle_of_its_file() {
    let link = |text: &str| text.parse::<crate::link::LinkAddress>().unwrap();
    let levels = vec![Level { value: 2.0, power_w: 0.1 }, Level { value: 3.0, power_w: 0.5 }];
    let parameter = PowerParameter {
        name: "TX_POWER".to_owned(),
        protocol: Protocol::Classic,
        unit: Unit::Levels(levels),
        off_value: -1.0,
    };
    for kind in [Kind::Leased { command: 31_011 }, Kind::Parameter(parameter), Kind::None] {
        let mut draft = VehicleDraft::new(Role::J, link("udpout:10.0.0.1:14600"));
        draft.transmitter.kind = kind;
        draft.autopilot.system_id = Some(2);
        draft.autopilot.actuation = Actuation::ThrustVector;
        draft.autopilot.thrust_n = Some([1.0, 2.0, 3.0]);
        draft.autopilot.key_file = Some("autopilot.key".into());
        draft.transmitter.link = Some(link("serial:/dev/ttyUSB0:57600"));
        draft.transmitter.key_file = Some("radio.key".into());
        draft.transmitter.system_id = Some(51);
        draft.operators = vec![255, 245];
        draft.pair_peer_system = Some(1);
        draft.limits.max_tilt_rad = Some(std::f64::consts::FRAC_PI_2);
        draft.log_dir = "logs of \"J\"".into();
        let built = Vehicle::new(draft.clone()).unwrap();
        assert_eq!(*built, draft);
        assert_eq!(*vehicle(&built.to_toml()), draft, "{}", built.to_toml());
    }
    for file in [VEHICLE_I, VEHICLE_J] {
        assert_eq!(*vehicle(&vehicle(file).to_toml()), *vehicle(file));
    }
}

#[test]
fn spec_what_a_vehicle_file_may_not_say_a_draft_may_not() {
    let wrong: [Wrong<VehicleDraft>; 4] = [
        (|v| v.autopilot.rate_hz = 401.0, "`autopilot.rate_hz` is 401 Hz, above the maximum"),
        (|v| v.autopilot.thrust_n = Some([1.0; 3]), "`thrust_n` means nothing with actuation \"pose\""),
        (|v| v.pair_tunnel = true, "whom TUNNEL is addressed to"),
        (
            |v| {
                let levels = Vec::new();
                v.transmitter.kind = Kind::Parameter(PowerParameter {
                    name: "P".to_owned(),
                    protocol: Protocol::Classic,
                    unit: Unit::Levels(levels),
                    off_value: 0.0,
                });
            },
            "there is no [[transmitter.level]]",
        ),
    ];
    for (change, says) in wrong {
        let mut draft = VehicleDraft::new(Role::I, "udpout:10.0.0.1:14600".parse().unwrap());
        change(&mut draft);
        let findings = Vehicle::new(draft).unwrap_err();
        assert!(findings.to_string().contains(says), "{says:?} is not in {findings}");
    }
}
