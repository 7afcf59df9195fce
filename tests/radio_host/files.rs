//! The radio file and its calibration.

use veilwing::config::RadioFile;
use veilwing::link::Clock;
use veilwing::radio_device::gpio::{Electrical, Settings, Which};
use veilwing::radio_host::{LineTimes, Silence};

use crate::backends::directory;

const EXAMPLE: &str = include_str!("../../config/radio.toml");

const LEAST: &str = "[radio]\nsystem_id = 1\n[link]\naddress = \"udpin:127.0.0.1:14570\"\n[device]\nkind = \"attenuator\"\n\
                     least = 0\nmost = 30\nstep = 0.25\nsource_dbm = 27\noff_ms = 20\nchange_ms = 20\n\
                     [attenuator]\naddress = \"tcpout:10.0.0.9:23\"\noff_db = 90\n";

#[test]
fn spec_the_example_is_a_radio_file() {
    let radio = RadioFile::parse("radio.toml", EXAMPLE).unwrap();
    assert!(radio.device(&Clock::real()).is_some() && radio.facts().reads_back);
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

/// A radio without an off, and the line that is its off.
pub const BY_LINE: &str = "[radio]\nsystem_id = 1\n[link]\naddress = \"udpin:127.0.0.1:14570\"\n[device]\nkind = \"parameter\"\n\
                           levels = [10, 14, 20]\noff_ms = 100\nchange_ms = 200\n\
                           [parameter]\naddress = \"udpin:127.0.0.1:14580\"\nsystem_id = 51\nname = \"TX_POWER\"\nprotocol = \"bytewise\"\n\
                           [kill_line]\nchip = \"/dev/gpiochip0\"\nline = 17\noff_level = \"low\"\nsilent_ms = 5\n";

#[test]
fn spec_a_kill_line_says_which_line_and_what_its_hardware_does() {
    let read = |text: &str| RadioFile::parse("radio.toml", text).unwrap();
    let file = read(BY_LINE);
    let settings =
        Settings { chip: "/dev/gpiochip0".into(), line: Which::Offset(17), off_level: Electrical::Low };
    let ms = std::time::Duration::from_millis;
    assert_eq!(
        file.kill_line(),
        Some((settings, LineTimes { silence: Silence::AtLevel(ms(5)), alone: true }))
    );
    assert_eq!(file.facts().dead, None);
    let one_shot = BY_LINE
        .replace("line = 17", "name = \"KILL\"")
        .replace("silent_ms = 5", "oneshot_ms = 80")
        .replace("name = \"TX_POWER\"", "name = \"TX_POWER\"\noff_value = 0");
    let file = read(&one_shot);
    let (settings, times) = file.kill_line().unwrap();
    assert_eq!(settings.line, Which::Name("KILL".to_owned()));
    assert_eq!(times, LineTimes { silence: Silence::WithoutEdges(ms(80)), alone: false });
    assert_eq!(file.facts().dead, Some(ms(80)), "the hardware's own lease");
    assert_eq!(
        read(&one_shot.replace("change_ms = 200", "change_ms = 200\ndead_ms = 90")).facts().dead,
        Some(ms(90))
    );
    assert_eq!(read(LEAST).kill_line(), None);
}

#[test]
fn spec_a_radio_that_nothing_certainly_silences_is_refused_with_a_remedy() {
    let line = "[kill_line]\nchip = \"/dev/gpiochip0\"\nline = 17\noff_level = \"low\"\nsilent_ms = 5\n";
    let cases = [
        ((line, ""), 10, "nothing silences the radio", "off_value"),
        (("silent_ms = 5\n", ""), 15, "nothing says how long it takes", "oneshot_ms"),
        (("off_ms = 100", "off_ms = 4"), 8, "which takes 5 ms", "off_ms = 5 or more"),
        (("line = 17\n", ""), 15, "has neither", "`name`"),
        (("line = 17", "line = 17\nname = \"KILL\""), 18, "together with", "keep only one"),
        (("silent_ms = 5", "silent_ms = 5\noneshot_ms = 80"), 20, "together with", "keep only one"),
        (("off_level = \"low\"\n", ""), 15, "`off_level`", "add"),
        (("off_level = \"low\"", "off_level = \"off\""), 18, "none of its values", ""),
        (("line = 17", "line = -1"), 17, "outside 0", ""),
        (("protocol = \"bytewise\"", "protocol = \"bytes\""), 14, "none of its values", ""),
        (("name = \"TX_POWER\"", "name = \"TX_POWER_IN_WATTS\""), 13, "more than 16", ""),
        (("system_id = 51\n", ""), 10, "`system_id`", "add"),
    ];
    for ((this, by), line, says, help) in cases {
        assert!(BY_LINE.contains(this), "{this}");
        let errors = RadioFile::parse("radio.toml", &BY_LINE.replace(this, by)).unwrap_err();
        let found = errors.list().iter().find(|found| found.message.contains(says));
        let found = found.unwrap_or_else(|| panic!("{says:?} is not in\n{errors}"));
        assert!(found.line == line && found.help.contains(help), "{errors}");
    }
}

#[test]
fn spec_a_line_whose_time_is_not_known_and_a_death_sooner_than_the_one_shot_are_warned_of() {
    let warned = |text: &str| RadioFile::parse("radio.toml", text).unwrap().warnings.to_string();
    let own_off =
        LEAST.to_owned() + "[kill_line]\nchip = \"/dev/gpiochip0\"\nline = 17\noff_level = \"low\"\n";
    assert!(warned(&own_off).contains("nothing says how long the line takes"), "{}", warned(&own_off));
    let sooner = own_off.replace("change_ms = 20", "change_ms = 20\ndead_ms = 50") + "oneshot_ms = 80\n";
    assert!(warned(&sooner).contains("`dead_ms` is 50"), "{}", warned(&sooner));
    assert!(!warned(&(own_off.clone() + "silent_ms = 2\n")).contains("kill_line"));
    let later = warned(&(own_off + "silent_ms = 60\n"));
    assert!(
        later.contains("off by the kill line alone takes 60 ms") && later.contains("off_ms = 60"),
        "{later}"
    );
}
