//! The kill line on the kernel's own device: what cannot be had is refused at the start, and, where the kernel has its simulator of
//! GPIO chips (gpio-sim), a line is driven and read back.

use std::path::{Path, PathBuf};
use std::process::Command;

use veilwing::radio_device::gpio::{Electrical, LineError, Settings, Which, open};
use veilwing::radio_host::Level;

use crate::backends::directory;

fn line(chip: &Path, line: Which, off_level: Electrical) -> Settings {
    Settings { chip: chip.to_owned(), line, off_level }
}

#[test]
fn spec_a_chip_that_is_not_there_or_none_is_refused_by_its_key_with_a_remedy() {
    for (chip, says) in [
        ("/dev/gpiochip9999", "`chip` is \"/dev/gpiochip9999\", and there is no such device; `gpiodetect`"),
        (
            "/dev/null",
            "`chip` is \"/dev/null\", and it is not a GPIO character device; give a /dev/gpiochipN",
        ),
        ("/proc/self/stat", "`chip` is \"/proc/self/stat\", and it is not a character device"),
    ] {
        let error = open(&line(Path::new(chip), Which::Offset(1), Electrical::Low)).unwrap_err();
        assert!(error.to_string().contains(says), "{error}");
    }
}

#[test]
fn spec_a_host_without_its_kill_line_does_not_start_and_tells_the_device_off_and_nothing_else() {
    let path = directory("no-line");
    let at = path.display();
    let text = format!(
        "[radio]\nsystem_id = 1\n[link]\naddress = \"udpin:127.0.0.1:14571\"\n\
         [device]\nkind = \"command\"\nleast = 0\nmost = 4\noff_ms = 500\nchange_ms = 500\nfrequency_hz = 915e6\n\
         [calibration]\nfile = \"measured.csv\"\n\
         [command]\nset = [\"touch\", \"{at}/set\"]\noff = [\"touch\", \"{at}/off\"]\n\
         [kill_line]\nchip = \"/dev/gpiochip9999\"\nline = 4\noff_level = \"low\"\nsilent_ms = 2\n[log]\ndir = \"{at}/logs\"\n"
    );
    std::fs::write(path.join("radio.toml"), text).unwrap();
    let calibration = path.join("measured.csv");
    // A host may stand where one died on the air; nobody was there before who calibrates or measures.
    for (arguments, says_off) in
        [(vec!["calibrate", "--radiate"], false), (vec!["measure", "--radiate"], false), (vec![], true)]
    {
        if arguments.first() != Some(&"calibrate") {
            std::fs::write(&calibration, "frequency_hz,setting,dbm\n915e6,0,1\n915e6,4,5\n").unwrap();
        }
        let ended = Command::new(env!("CARGO_BIN_EXE_veilwing"))
            .arg("radio")
            .args(&arguments)
            .arg(path.join("radio.toml"))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(2), "{arguments:?}: {said}");
        let names = ["radio.toml: [kill_line]: `chip` is \"/dev/gpiochip9999\"", "gpiodetect"];
        assert!(names.iter().all(|name| said.contains(name)), "{said}");
        assert_eq!(said.contains("the device was turned off"), says_off, "{said}");
        assert_eq!(path.join("off").exists(), says_off, "{arguments:?}");
    }
    assert!(!path.join("set").exists());
    std::fs::remove_dir_all(path).unwrap();
}

/// A simulated chip of 8 lines, some with names, one of them in use.
struct Simulated {
    config: PathBuf,
    chip: PathBuf,
    lines: PathBuf,
}

const NAMED: [(u32, &str); 3] = [(3, "KILL"), (4, "TWICE"), (5, "TWICE")];
const IN_USE: u32 = 6;

impl Simulated {
    /// `None`, and a line about it, where the kernel has no simulator.
    fn new() -> Option<Self> {
        let root = Path::new("/sys/kernel/config/gpio-sim");
        if !root.exists() {
            println!("skipped: this kernel has no gpio-sim (CONFIG_GPIO_SIM, and configfs mounted)");
            return None;
        }
        let config = root.join(format!("veilwing-{}", std::process::id()));
        let bank = config.join("bank0");
        std::fs::create_dir(&config).unwrap();
        std::fs::create_dir(&bank).unwrap();
        std::fs::write(bank.join("num_lines"), "8").unwrap();
        for (offset, name) in NAMED {
            let line = bank.join(format!("line{offset}"));
            std::fs::create_dir(&line).unwrap();
            std::fs::write(line.join("name"), name).unwrap();
        }
        let hog = bank.join(format!("line{IN_USE}/hog"));
        std::fs::create_dir_all(&hog).unwrap();
        std::fs::write(hog.join("name"), "fan").unwrap();
        std::fs::write(hog.join("direction"), "output-low").unwrap();
        std::fs::write(config.join("live"), "1").unwrap();
        let says = |file: PathBuf| std::fs::read_to_string(file).unwrap().trim().to_owned();
        let chip = says(bank.join("chip_name"));
        let lines = Path::new("/sys/devices/platform").join(says(config.join("dev_name"))).join(&chip);
        Some(Self { chip: Path::new("/dev").join(chip), config, lines })
    }

    /// What the outside sees of a line.
    fn is_high(&self, offset: u32) -> bool {
        std::fs::read_to_string(self.lines.join(format!("sim_gpio{offset}/value"))).unwrap().trim() == "1"
    }
}

impl Drop for Simulated {
    fn drop(&mut self) {
        let _ = std::fs::write(self.config.join("live"), "0");
        let bank = self.config.join("bank0");
        let _ = std::fs::remove_dir(bank.join(format!("line{IN_USE}/hog")));
        for offset in 0..8 {
            let _ = std::fs::remove_dir(bank.join(format!("line{offset}")));
        }
        let _ = std::fs::remove_dir(bank);
        let _ = std::fs::remove_dir(&self.config);
    }
}

#[test]
fn spec_a_line_of_the_kernel_s_is_off_from_its_first_moment_driven_and_read_back() {
    let Some(simulated) = Simulated::new() else { return };
    for (which, off_level) in [
        (Which::Offset(3), Electrical::Low),
        (Which::Offset(3), Electrical::High),
        (Which::Name("KILL".to_owned()), Electrical::High),
    ] {
        let off = off_level == Electrical::High;
        let settings = line(&simulated.chip, which, off_level);
        let mut held = open(&settings).unwrap();
        assert_eq!(simulated.is_high(3), off, "{off_level:?}");
        for _ in 0..3 {
            held.drive(Level::On).unwrap();
            assert_eq!(simulated.is_high(3), !off);
            held.drive(Level::Off).unwrap();
            assert_eq!(simulated.is_high(3), off);
        }
        let by = |error| matches!(error, LineError::Busy { line: 3, by, .. } if by == "veilwing kill line");
        assert!(by(open(&settings).unwrap_err()), "it is held");
        // Dropped, and to be had again.
    }
    let refused = |which| open(&line(&simulated.chip, which, Electrical::Low)).unwrap_err();
    assert!(matches!(refused(Which::Offset(IN_USE)), LineError::Busy { by, .. } if by == "fan"));
    assert!(matches!(refused(Which::Offset(8)), LineError::NoLine { lines: 8, .. }));
    assert!(matches!(refused(Which::Name("KILLS".to_owned())), LineError::NoLine { .. }));
    let twice = refused(Which::Name("TWICE".to_owned()));
    assert!(matches!(&twice, LineError::Ambiguous { offsets, .. } if *offsets == [4, 5]), "{twice}");
}
