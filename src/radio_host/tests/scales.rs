//! Settings and powers.

use proptest::prelude::*;

use crate::radio_host::{Scale, ScaleError, points_of_csv};

const CSV: &str = "frequency_hz,setting,dbm\n# attenuation\n915e6,0,27.0\n915e6,10,16.8\n\n915e6, 20 ,7.1\n";

#[test]
fn val_a_power_between_two_measurements_is_on_the_line_between_them() {
    let values: Vec<f64> = (0..=80).map(|k| f64::from(k) * 0.25).collect();
    let scale = Scale::measured(&values, &points_of_csv(CSV).unwrap(), None).unwrap();
    // By hand: 27 - 1.02 s up to 10, then 16.8 - 0.97 (s - 10).
    for (setting, dbm) in [(0.0, 27.0), (5.0, 21.9), (10.0, 16.8), (15.0, 11.95), (20.0, 7.1)] {
        assert!((scale.dbm_of(setting) - dbm).abs() < 1e-9, "{setting}");
    }
    // 20 dBm: s = 7 / 1.02 = 6.863, and the next on the grid that is no stronger is 7.
    let chosen = scale.at_most(20.0).unwrap();
    assert!(chosen.value == 7.0 && (chosen.dbm - 19.86).abs() < 1e-9, "{chosen:?}");
    assert_eq!(scale.at_most(7.0), None);
    assert_eq!(scale.at_most(99.0).unwrap().value, 0.0);
    assert_eq!((scale.least_dbm(), scale.most_dbm()), (7.1, 27.0));
}

#[test]
fn val_between_two_frequencies_it_is_between_their_curves() {
    let csv = "frequency_hz,setting,dbm\n1e9,0,0\n1e9,10,10\n2e9,0,-4\n2e9,10,8\n";
    let points = points_of_csv(csv).unwrap();
    let scale = Scale::measured(&[0.0, 5.0, 10.0], &points, Some(1.25e9)).unwrap();
    for (setting, dbm) in [(0.0, -1.0), (5.0, 4.25), (10.0, 9.5)] {
        assert!((scale.dbm_of(setting) - dbm).abs() < 1e-12, "{setting}");
    }
    assert_eq!(Scale::measured(&[0.0], &points, None), Err(ScaleError::WhichFrequency { count: 2 }));
    assert!(matches!(Scale::measured(&[0.0], &points, Some(3e9)), Err(ScaleError::Frequency { .. })));
}

#[test]
fn spec_a_calibration_that_cannot_be_used_is_refused_with_its_line_and_a_remedy() {
    let head = "frequency_hz,setting,dbm\n";
    let cases = [
        ("9e8,0,1\n9e8,1,2\n9e8,2,1.5\n9e8,3,4\n", Some(4), "throughout"),
        ("9e8,0,1\n9e8,1,1\n", Some(3), "throughout"),
        ("9e8,0,1\n9e8,1,NaN\n", Some(3), "\"NaN\" is no finite number"),
        ("9e8,0,inf\n", Some(2), "finite"),
        ("9e8,0,1\n9e8,1,2,5\n", Some(3), "4 fields"),
        ("9e8;0;1\n", Some(2), "1 fields"),
        ("9e8,0,one\n", Some(2), "\"one\""),
        ("9e8,0,1\n9e8,0,2\n", Some(3), "twice"),
        ("9e8,0,1\n", Some(2), "one setting alone"),
        ("", None, "nothing is measured"),
        ("9e8,0,1\n9e8,4,2\n", None, "only 0 to 4 was measured"),
        ("9e8,0,1\n9e8,5,2\n9e9,0,2\n9e9,5,1\n", None, "falls at another"),
    ];
    for (rows, line, says) in cases {
        let measured = points_of_csv(&format!("{head}{rows}"))
            .and_then(|points| Scale::measured(&[0.0, 5.0], &points, None));
        let error = measured.unwrap_err();
        assert_eq!(error.line(), line, "{rows:?}: {error}");
        assert!(error.to_string().contains(says) && error.remedy().len() > 10, "{rows:?}: {error}");
    }
    assert!(matches!(points_of_csv("setting,dbm\n1,2\n"), Err(ScaleError::Header { .. })));
}

proptest! {
    #[test]
    fn prop_no_setting_is_stronger_than_asked_and_the_next_one_would_be(
        steps in prop::collection::vec(0.01..3.0f64, 2..40), falls in any::<bool>(), asked in -10.0..60.0f64,
    ) {
        let mut dbm = 0.0;
        let mut text = "frequency_hz,setting,dbm\n".to_owned();
        for (k, step) in steps.iter().enumerate() {
            dbm += step;
            let setting = if falls { -(k as f64) } else { k as f64 };
            text += &format!("1e9,{setting},{dbm}\n");
        }
        let sign = if falls { -0.5 } else { 0.5 };
        let values: Vec<f64> = (0..2 * steps.len() - 1).map(|k| sign * k as f64).collect();
        let scale = Scale::measured(&values, &points_of_csv(&text).unwrap(), None).unwrap();
        match scale.at_most(asked) {
            Some(chosen) => {
                prop_assert!(chosen.dbm <= asked + 0.0015);
                prop_assert!(scale.settings().iter().all(|other| other.dbm <= chosen.dbm || other.dbm > asked));
            }
            None => prop_assert!(scale.least_dbm() > asked),
        }
    }
}
