//! How this computer fares: processors, memory, temperature, disk, as the kernel tells them in /proc and /sys. Four small
//! files and one call; crates for them read a hundred times as much, and none is needed in the air for the rest.

use std::fs;
use std::io;
use std::path::Path;

/// Processor time since the computer started, in ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ticks {
    /// At work.
    pub busy: u64,
    /// Altogether.
    pub all: u64,
}

impl Ticks {
    /// The share that was work since an earlier reading; `None` where no time has passed.
    #[must_use]
    pub fn share_since(self, earlier: Self) -> Option<f64> {
        let all = self.all.checked_sub(earlier.all).filter(|all| *all > 0)?;
        // A processor that was away may count back.
        #[allow(clippy::cast_precision_loss)]
        Some((self.busy.saturating_sub(earlier.busy) as f64 / all as f64).min(1.0))
    }
}

/// A part of something, in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Room {
    /// What can be used still.
    pub free: u64,
    /// All of it.
    pub total: u64,
}

/// What one look tells; what a computer does not say is absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reading {
    /// All processors together.
    pub processors: Option<Ticks>,
    /// Each.
    pub cores: Vec<Ticks>,
    /// What programs can still have.
    pub memory: Option<Room>,
    /// The disk of the directory that was asked for, for those who are not its owner.
    pub disk: Option<Room>,
    /// The hottest sensor, in degrees Celsius.
    pub hottest_c: Option<f64>,
    /// Since the computer started, in milliseconds.
    pub uptime_ms: Option<u64>,
}

impl Reading {
    /// Looks. A disk that hangs holds it up: not for an event loop.
    #[must_use]
    pub fn take(directory: &Path) -> Self {
        let text = |path: &str| fs::read_to_string(path).unwrap_or_default();
        let (processors, cores) = processors(&text("/proc/stat"));
        Self {
            processors,
            cores,
            memory: memory(&text("/proc/meminfo")),
            disk: disk(directory).ok(),
            hottest_c: hottest_c(Path::new("/sys/class/thermal")),
            uptime_ms: uptime_ms(&text("/proc/uptime")),
        }
    }
}

/// Of /proc/stat: the lines `cpu` and `cpuN`, user, nice, system, idle, iowait, irq, softirq, steal.
fn processors(stat: &str) -> (Option<Ticks>, Vec<Ticks>) {
    let (mut together, mut cores) = (None, Vec::new());
    for line in stat.lines() {
        let mut words = line.split_whitespace();
        let Some(name) = words.next().and_then(|word| word.strip_prefix("cpu")) else { continue };
        let counts: Vec<u64> = words.take(8).map_while(|word| word.parse().ok()).collect();
        let (Some(idle), true) = (counts.get(3), counts.len() >= 4) else { continue };
        let all = counts.iter().fold(0u64, |sum, count| sum.saturating_add(*count));
        let waiting = idle.saturating_add(counts.get(4).copied().unwrap_or(0));
        let ticks = Ticks { busy: all.saturating_sub(waiting), all };
        if name.is_empty() { together = Some(ticks) } else { cores.push(ticks) }
    }
    (together, cores)
}

/// Of /proc/meminfo, in kB: what the kernel reckons that programs can have without swapping.
fn memory(meminfo: &str) -> Option<Room> {
    let of = |name: &str| -> Option<u64> {
        let line = meminfo.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(':'))?;
        line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
    };
    Some(Room { free: of("MemAvailable")?, total: of("MemTotal")? })
}

fn uptime_ms(uptime: &str) -> Option<u64> {
    let seconds: f64 = uptime.split_whitespace().next()?.parse().ok()?;
    (seconds.is_finite() && seconds >= 0.0).then_some((seconds * 1e3) as u64)
}

/// The disk of a directory: what is free on it is so for those who are not its owner.
///
/// # Errors
/// The system's.
pub fn disk(directory: &Path) -> io::Result<Room> {
    let disk = rustix::fs::statvfs(directory)?;
    let bytes = |blocks: u64| blocks.saturating_mul(disk.f_frsize);
    Ok(Room { free: bytes(disk.f_bavail), total: bytes(disk.f_blocks) })
}

/// The hottest of the kernel's thermal zones, which are in thousandths of a degree.
fn hottest_c(zones: &Path) -> Option<f64> {
    let zones = fs::read_dir(zones).ok()?.flatten();
    let read = zones.filter_map(|zone| fs::read_to_string(zone.path().join("temp")).ok());
    let celsius =
        read.filter_map(|text| text.trim().parse::<f64>().ok()).map(|thousandths| thousandths * 1e-3);
    celsius.filter(|celsius| (-60.0..200.0).contains(celsius)).max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_processors_and_memory_are_read_as_the_kernel_documents_them() {
        let stat = "cpu  100 10 50 800 40 3 2 5 7 0\ncpu0 60 5 25 400 20 3 2 5 7 0\ncpu1 40 5 25 400 20 0 0 0\nintr 9\n";
        let (together, cores) = processors(stat);
        // Guest time is in user time already; waiting for a disk is not work.
        assert_eq!(together, Some(Ticks { busy: 170, all: 1010 }));
        assert_eq!(cores, [Ticks { busy: 100, all: 520 }, Ticks { busy: 70, all: 490 }]);
        let later = Ticks { busy: 245, all: 1110 };
        assert_eq!(later.share_since(together.unwrap()), Some(0.75));
        assert_eq!(later.share_since(later), None);
        let meminfo = "MemTotal:        8000000 kB\nMemFree:          100 kB\nMemAvailable:    2000000 kB\n";
        assert_eq!(memory(meminfo), Some(Room { free: 2_048_000_000, total: 8_192_000_000 }));
        assert_eq!(uptime_ms("350735.47 234388.90\n"), Some(350_735_470));
        for nothing in ["", "cpu", "cpu x y", "MemTotal: kB", "\u{0}"] {
            assert_eq!(
                (processors(nothing), memory(nothing), uptime_ms(nothing)),
                ((None, vec![]), None, None)
            );
        }
    }

    #[test]
    fn spec_the_hottest_zone_counts_and_nonsense_does_not() {
        let zones = std::env::temp_dir().join(format!("veilwing-zones-{}", std::process::id()));
        for (zone, text) in [("a", "41000\n"), ("b", "63500\n"), ("c", "-274000\n"), ("d", "hot\n")] {
            fs::create_dir_all(zones.join(zone)).unwrap();
            fs::write(zones.join(zone).join("temp"), text).unwrap();
        }
        assert_eq!(hottest_c(&zones), Some(63.5));
        fs::remove_dir_all(&zones).unwrap();
        assert_eq!(hottest_c(&zones), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn spec_this_computer_tells_of_itself() {
        let reading = Reading::take(Path::new("/"));
        let memory = reading.memory.unwrap();
        assert!(memory.free > 0 && memory.free <= memory.total, "{reading:?}");
        assert!(!reading.cores.is_empty() && reading.processors.is_some() && reading.uptime_ms.is_some());
        assert!(reading.disk.unwrap().total > 0, "{reading:?}");
    }
}
