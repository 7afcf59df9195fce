//! The radio file and its calibration.

use veilwing::config::RadioFile;

use crate::backends::directory;

const EXAMPLE: &str = include_str!("../../config/radio.toml");

const LEAST: &str = "[radio]\nsystem_id = 1\n[link]\naddress = \"udpin:127.0.0.1:14570\"\n[device]\nkind = \"attenuator\"\n\
                     least = 0\nmost = 30\nstep = 0.25\nsource_dbm = 27\noff_ms = 20\nchange_ms = 20\n\
                     [attenuator]\naddress = \"tcpout:10.0.0.9:23\"\noff_db = 90\n";

#[test]
fn spec_the_example_is_a_radio_file() {
    let radio = RadioFile::parse("radio.toml", EXAMPLE).unwrap();
    assert!(radio.device().is_some() && radio.facts().reads_back);
}

#[test]
fn val_an_attenuator_gives_what_enters_it_less_what_it_takes() {
    let facts = RadioFile::parse("radio.toml", LEAST).unwrap().facts();
    assert_eq!((facts.least_dbm, facts.most_dbm, facts.dead), (-3.0, 27.0, None));
}

#[test]
fn spec_a_file_that_cannot_be_used_is_refused_with_its_line_and_a_remedy() {
    let cases = [
        (("off_ms = 20\n", ""), 5, "`off_ms`", "add"),
        (("off_db = 90", "off_dp = 90"), 15, "unknown key", "did you mean `off_db`"),
        (("source_dbm = 27\n", ""), 6, "what power an attenuation gives", "source_dbm"),
        (("kind = \"attenuator\"", "kind = \"at\""), 6, "no [at] table", "add [at]"),
        (("least = 0\nmost = 30", "least = 30\nmost = 0"), 7, "above `most`", "swap"),
        (("most = 30\n", ""), 7, "without", "belong together"),
        (("udpin:127.0.0.1:14570", "udp:127.0.0.1:14570"), 4, "scheme", "udpin"),
        (("tcpout:10.0.0.9:23", "udpin:10.0.0.9:23"), 14, "is called", "tcpout"),
        (("change_ms = 20", "change_ms = 0"), 12, "more than 0", "ms"),
    ];
    for ((this, by), line, says, help) in cases {
        assert!(LEAST.contains(this), "{this}");
        let errors = RadioFile::parse("radio.toml", &LEAST.replace(this, by)).unwrap_err();
        let found = errors.list().iter().find(|found| found.message.contains(says));
        let found = found.unwrap_or_else(|| panic!("{says:?} is not in\n{errors}"));
        assert!(found.line == line && found.help.contains(help), "{errors}");
    }
}

#[test]
fn spec_an_unsigned_link_is_warned_of() {
    let warnings = RadioFile::parse("radio.toml", LEAST).unwrap().warnings.to_string();
    assert!(warnings.contains("radio.toml:4:11: warning") && warnings.contains("key_file"), "{warnings}");
    let serial = LEAST.replace("udpin:127.0.0.1:14570", "serial:/dev/ttyS1:115200");
    assert!(RadioFile::parse("radio.toml", &serial).unwrap().warnings.is_empty());
}

#[test]
fn spec_a_calibration_is_refused_by_the_line_in_its_own_file() {
    let path = directory("calibration");
    let file = path.join("radio.toml");
    let text = LEAST.replace("source_dbm = 27\n", "frequency_hz = 915e6\n")
        + "[calibration]\nfile = \"measured.csv\"\n";
    std::fs::write(&file, text).unwrap();
    let load = |csv: &str| {
        std::fs::write(path.join("measured.csv"), csv).unwrap();
        RadioFile::load(&file).map_err(|errors| errors.to_string())
    };
    let good = load("frequency_hz,setting,dbm\n915e6,0,26.5\n915e6,15,11.9\n915e6,30,-3.25\n").unwrap();
    assert_eq!((good.facts().least_dbm, good.facts().most_dbm), (-3.25, 26.5));
    for (csv, place, says) in [
        (
            "frequency_hz,setting,dbm\n915e6,0,26.5\n915e6,15,27.0\n915e6,30,-3\n",
            "measured.csv:3:1",
            "throughout",
        ),
        ("frequency_hz,setting,dbm\n915e6,0,nan\n", "measured.csv:2:1", "no finite number"),
        ("frequency_hz,setting,dbm\n915e6,0,26,5\n", "measured.csv:2:1", "4 fields"),
        (
            "frequency_hz,setting,dbm\n915e6,0,26.5\n915e6,20,6.5\n",
            "measured.csv:1:1",
            "only 0 to 20 was measured",
        ),
        (
            "frequency_hz,setting,dbm\n5e9,0,26.5\n5e9,30,-3\n",
            "measured.csv:1:1",
            "outside of what was measured",
        ),
    ] {
        let errors = load(csv).unwrap_err();
        assert!(errors.contains(place) && errors.contains(says) && errors.contains("help: "), "{errors}");
    }
    std::fs::remove_file(path.join("measured.csv")).unwrap();
    assert!(RadioFile::load(&file).unwrap_err().to_string().contains("there is no such file"));
    std::fs::remove_dir_all(path).unwrap();
}
