//! The link as it is: what a mission says of antennas, scattering, poses, users and powers.

use super::*;

/// A mission whose files lie in a directory of its own.
fn in_directory(name: &str, files: &[(&str, &str)], text: &str) -> Result<Mission, Diagnostics> {
    let directory = std::env::temp_dir().join(format!("veilwing-link-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    for (file, content) in files {
        std::fs::write(directory.join(file), content).unwrap();
    }
    let mission = Mission::parse(&directory.join("m.toml").display().to_string(), text);
    std::fs::remove_dir_all(&directory).unwrap();
    mission
}

const CSV: &str = "angle_deg,gain_db\n0,-25\n45,-3\n90,0\n180,-22\n";

#[test]
fn val_every_key_is_what_the_planner_is_asked() {
    let text = format!(
        "{LEAST}[antenna]\nnull_depth_db = 20\n[antenna.j]\nnull_depth_db = 30\n\
         [fading]\nrician_k_db = {{ user = 10.0, eavesdropper = 0.0 }}\n\
         [pointing]\nheading_std_deg = 180e-2\nmounting_std_deg = 0.9\nposition_std_m = [0.5, 0.8]\n\
         [vehicles.i]\nmin_power_w = 0.01\n[vehicles.j]\npower_levels_w = [0.01, 0.1]\n\
         [planner]\ntarget_rate_bps = 2e6\n"
    )
    .replacen("enu_m = [0, 0, 0]\n", "enu_m = [0, 0, 0]\nstd_m = 1.5\n", 1);
    let mission = mission(&text);
    let problem = mission.problem(0).unwrap();
    assert!(
        (problem.antennas.i.least() - 1e-2).abs() < 1e-15
            && (problem.antennas.j.least() - 1e-3).abs() < 1e-15
    );
    assert!((problem.fading.user.factor() - 10.0).abs() < 1e-12);
    assert_eq!(problem.fading.eavesdropper.factor(), 1.0);
    assert!((problem.pointing.heading_std_rad - std::f64::consts::PI / 100.0).abs() < 1e-15);
    assert!((problem.pointing.mounting_std_rad - std::f64::consts::PI / 200.0).abs() < 1e-15);
    assert_eq!(problem.pointing.position_std_m, [0.5, 0.8]);
    assert_eq!(problem.user_uncertainty, Uncertainty::Gaussian { std_m: 1.5 });
    assert_eq!(problem.power_steps.i, PowerSteps::AtLeast(0.01));
    assert_eq!(problem.power_steps.j, PowerSteps::Levels(vec![0.01, 0.1]));
    assert_eq!(mission.planner.target_rate_bps, Some(2e6));
    assert!(!problem.has_ideal_link());
    // One number is both receivers'.
    let both = format!("{LEAST}[fading]\nrician_k_db = 10\n");
    let fading = super::mission(&both).fading;
    assert_eq!(fading.user, fading.eavesdropper);
    let spelt_out = both.replace("10", "{ user = 1e1, eavesdropper = 10.0 }");
    assert_eq!(super::mission(&spelt_out).digest(), super::mission(&both).digest());
}

#[test]
fn spec_a_patterns_contents_are_part_of_the_mission_and_its_path_is_not() {
    let text = |file: &str| format!("{LEAST}[antenna]\npattern_file = \"{file}\"\n");
    let first = in_directory("a", &[("a.csv", CSV)], &text("a.csv")).unwrap();
    let elsewhere = in_directory("b", &[("b.csv", &CSV.replace(",-25", ", -25.0"))], &text("b.csv")).unwrap();
    assert_eq!(first.digest(), elsewhere.digest());
    let other = in_directory("c", &[("a.csv", &CSV.replace("-25", "-26"))], &text("a.csv")).unwrap();
    assert_ne!(first.digest(), other.digest());
    let rows = format!("{LEAST}[antenna]\npattern_file = [[0, -25], [45, -3], [90, 0], [180, -22]]\n");
    assert_eq!(mission(&rows).digest(), first.digest());
    assert!(!first.antennas.i.is_symmetric() && first.antennas.i == first.antennas.j);
    // Elsewhere too, without the pattern's file.
    let alone = first.with_rows().unwrap();
    assert_eq!(mission(&alone).antennas, first.antennas, "{alone}");
    assert_eq!(mission(DEMO).with_rows(), None);
    // By value it is the same mission too.
    assert_eq!(first.changed(|_| {}).unwrap().digest(), first.digest());
}

#[test]
fn spec_what_makes_no_link_is_refused_by_line_key_value_and_remedy() {
    let cases = [
        (
            "[antenna]\nnull_depth_db = -3\n",
            "m.toml:7:17",
            "`null_depth_db` is -3 dB, below the minimum of 0 dB",
        ),
        (
            "[antenna]\nnull_depth_db = 20\npattern_file = \"a.csv\"\n",
            "pattern_file` is given together",
            "keep only one",
        ),
        (
            "[antenna]\npattern_file = \"none.csv\"\n",
            "none.csv\": the file cannot be read",
            "the path of a CSV file",
        ),
        (
            "[antenna]\npattern_file = \"bad.csv\"\n",
            "the file says \"90;0\" in line 3",
            "the path of a CSV file",
        ),
        ("[antenna]\npattern_file = \"up.csv\"\n", "largest gain of 3 dB", "subtract it from every gain"),
        ("[antenna]\npattern_file = [[0, -20], [90, 0]]\n", "has 2 entries, fewer than the 3", "its rows"),
        (
            "[antenna]\nnull_depth_db = 20\n[antenna.i]\n[antenna.j]\n",
            "`antenna.null_depth_db` has no effect",
            "remove it",
        ),
        (
            "[fading]\nrician_k_db = { user = 3 }\n",
            "`rician_k_db` has no `eavesdropper`",
            "{ user = ..., eavesdropper = ... }",
        ),
        (
            "[fading]\nrician_k_db = { user = 3, eavesdropper = inf }\n",
            "of an eavesdropper is inf, not a finite number",
            "give a number in dB",
        ),
        (
            "[pointing]\nheading_std_deg = 31\n",
            "`heading_std_deg` is 31 deg, above the maximum of 30 deg",
            "give a number in deg",
        ),
        ("[pointing]\nposition_std_m = 1.0\n", "must be 2 numbers [horizontal, vertical]", "give 2 numbers"),
        (
            "[pointing]\nheadin_std_deg = 1\n",
            "unknown key `headin_std_deg`",
            "did you mean `heading_std_deg`?",
        ),
        (
            "[vehicles.j]\nmin_power_w = 0.6\n",
            "`min_power_w` of 0.6 W is above the 0.5 W of radio.max_power_w",
            "raise the ceiling",
        ),
        (
            "[vehicles.j]\npower_levels_w = [0.1, 0.1]\n",
            "does not rise: 0.1 W comes before 0.1 W",
            "the least first",
        ),
        (
            "[vehicles.i]\npower_levels_w = [0.6]\n",
            "lowest of `power_levels_w`, 0.6 W, is above the 0.5 W",
            "list a level within",
        ),
        ("[vehicles.j]\nmin_power_w = 0.1\npower_levels_w = [0.1]\n", "is given together", "keep only one"),
        (
            "[vehicles.j]\nmin_power_w = 0.1\n[planner]\nmethod = \"paper\"\n",
            "`method` is \"paper\", which knows nothing of `vehicles.j.min_power_w`",
            "plan with \"veilwing\"",
        ),
        (
            "[planner]\ntarget_rate_bps = 0\n",
            "`target_rate_bps` is 0 bit/s, but must be more than 0",
            "give a number in bit/s",
        ),
    ];
    let files = [
        ("a.csv", CSV),
        ("bad.csv", "angle_deg,gain_db\n0,-20\n90;0\n"),
        ("up.csv", "angle_deg,gain_db\n0,-20\n90,3\n180,-20\n"),
    ];
    for (text, message, remedy) in cases {
        let findings = in_directory("bad", &files, &format!("{LEAST}{text}")).unwrap_err().to_string();
        assert!(findings.contains(message) && findings.contains(remedy), "{text}: {findings}");
    }
}

/// What a mission does not say is not in its digest: missions of before are themselves.
#[test]
fn spec_an_ideal_mission_says_nothing_of_its_link() {
    let ideal = mission(PAPER);
    assert!(ideal.problem(0).unwrap().has_ideal_link());
    let empty = mission(&format!("{PAPER}\n[antenna]\n[fading]\n[pointing]\n"));
    assert_eq!(empty.digest(), ideal.digest());
    let with = mission(&format!("{PAPER}\n[pointing]\nheading_std_deg = 0\n"));
    assert_ne!(with.digest(), ideal.digest());
}
