//! A kill line on the Linux kernel's GPIO character device (/dev/gpiochipN, its second uAPI: Linux 5.10 and later).
//!
//! Facts, of the kernel's documents (Documentation/userspace-api/gpio):
//! - A line is requested as an output together with its first level, so that no other level comes before. While it is held, nobody
//!   else can request it (EBUSY), and its level stays as it was driven.
//! - Once whoever holds it has closed it, or has died, "the state of the line becomes uncontrolled from userspace perspective, and
//!   may revert to its default state": the level is then NOT defined. Some controllers keep what was driven last, others make an
//!   input of it, and a restart of the computer does that to all. So the wiring decides what a dead host radiates: a pull resistor
//!   at the transmitter's enable, towards off, strong enough against the pad's own pull; or a retriggered one-shot, which is
//!   silent at either level (`oneshot_ms`).
//! - Reading a line that is driven gives the pad's level on some controllers, the register's on others, and an error where the
//!   controller cannot read its outputs at all. A pad that reads otherwise than driven is shorted, or driven by something else.
//! - Names of lines need not be unique, and numbers of chips may differ from one start of the computer to the next: where a board
//!   has names for its lines, they are the safer choice.
//!
//! The line's controller should be the computer's own. One behind I2C takes the bus's time, in which the radio host does nothing
//! else. On other systems than Linux a file with a kill line is refused.

use std::path::PathBuf;

/// Which line of a chip.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Which {
    /// By its offset.
    Offset(u32),
    /// By its name.
    Name(String),
}

/// The line's electrical level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Electrical {
    /// Ground.
    Low,
    /// The supply.
    High,
}

impl std::fmt::Display for Electrical {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Low => "low",
            Self::High => "high",
        })
    }
}

/// The line's settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// The chip's device file.
    pub chip: PathBuf,
    /// Which of its lines.
    pub line: Which,
    /// The level at which the transmitter is silent.
    pub off_level: Electrical,
}

/// Why a line cannot be had, or was not driven: by the key of the radio file, its value, and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// No such chip.
    #[error("`chip` is {chip:?}, and there is no such device; `gpiodetect` lists this computer's")]
    NoChip {
        /// Its device file.
        chip: PathBuf,
    },
    /// Something else than a chip.
    #[error("`chip` is {chip:?}, and {why}; give a /dev/gpiochipN")]
    NotAChip {
        /// Its device file.
        chip: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// Not allowed.
    #[error(
        "`chip` is {chip:?}, which this user may not open; add the user to the group that owns it, often `gpio`"
    )]
    Forbidden {
        /// Its device file.
        chip: PathBuf,
    },
    /// No such line.
    #[error("{key} is {value}, and {chip:?} has no such line among its {lines}; `gpioinfo` lists them")]
    NoLine {
        /// The chip's device file.
        chip: PathBuf,
        /// The key that names the line.
        key: &'static str,
        /// Its value.
        value: String,
        /// How many lines there are.
        lines: u32,
    },
    /// Several of that name.
    #[error(
        "`name` is {name:?}, and {chip:?} has several such lines: {offsets:?}; give `line`, the offset of the right one"
    )]
    Ambiguous {
        /// The chip's device file.
        chip: PathBuf,
        /// The name.
        name: String,
        /// The lines that have it.
        offsets: Vec<u32>,
    },
    /// Somebody else has it.
    #[error(
        "line {line} of {chip:?} is in use by {by:?}; end that program, or take the line out of the device tree or overlay"
    )]
    Busy {
        /// The chip's device file.
        chip: PathBuf,
        /// Its offset.
        line: u32,
        /// Who has it, as the kernel says.
        by: String,
    },
    /// It reads otherwise than it was driven.
    #[error(
        "line {line} of {chip:?} was driven {driven} and reads {reads}; look for a short, or for something else that drives it"
    )]
    ReadsOtherwise {
        /// The chip's device file.
        chip: PathBuf,
        /// Its offset.
        line: u32,
        /// What it was driven to.
        driven: Electrical,
        /// What it reads.
        reads: Electrical,
    },
    /// Anything else that the kernel says.
    #[error("line {line} of {chip:?}: {why}; a line must be one that can be an output")]
    Kernel {
        /// The chip's device file.
        chip: PathBuf,
        /// Its offset, or name.
        line: String,
        /// What the kernel says.
        why: String,
    },
    /// Not on this system.
    #[error("a kill line needs Linux; remove [kill_line], and drive the enable by other means")]
    NotLinux,
}

#[cfg(target_os = "linux")]
pub use linux::GpioLine;

#[cfg(target_os = "linux")]
mod linux {
    use std::path::{Path, PathBuf};

    use gpiocdev::line::Value;
    use gpiocdev::{Chip, Request};

    use super::{Electrical, LineError, Settings, Which};
    use crate::radio_device::Line;
    use crate::radio_host::Level;

    /// Errors of the kernel's (errno.h, the same on every machine that Linux runs on).
    const ENOENT: i32 = 2;
    const EACCES: i32 = 13;
    const EPERM: i32 = 1;

    /// Who has the line, as the kernel tells others.
    const CONSUMER: &str = "veilwing kill line";

    /// A line that is held, and was driven off when it was requested. Released when it is dropped.
    #[derive(Debug)]
    pub struct GpioLine {
        request: Request,
        chip: PathBuf,
        offset: u32,
        off_level: Electrical,
        /// Its controller can read what it drives.
        reads_back: bool,
    }

    impl GpioLine {
        /// Requests the line, driven off from its first moment as an output.
        ///
        /// # Errors
        /// It cannot be had, or does not read off.
        pub fn open(settings: &Settings) -> Result<Self, LineError> {
            let Settings { chip: path, line, off_level } = settings;
            let chip = Chip::from_path(path).map_err(|error| chip_error(path, &error))?;
            let offset = find(&chip, path, line)?;
            let mut builder = Request::builder();
            builder.on_chip(path).with_consumer(CONSUMER).with_line(offset).as_output(Value::Inactive);
            // Active is on: whatever has no value is off.
            match off_level {
                Electrical::Low => builder.as_active_high(),
                Electrical::High => builder.as_active_low(),
            };
            let request = builder.request().map_err(|error| match chip.line_info(offset) {
                Ok(info) if info.used => {
                    LineError::Busy { chip: path.clone(), line: offset, by: info.consumer }
                }
                _ => kernel(path, &offset.to_string(), &error),
            })?;
            let (chip, off_level) = (path.clone(), *off_level);
            let reads_back = request.lone_value().is_ok();
            if !reads_back {
                tracing::warn!(
                    chip = %chip.display(),
                    offset,
                    "the kill line cannot be read back: its controller does not read what it drives"
                );
            }
            let mut line = Self { request, chip, offset, off_level, reads_back };
            line.drive(Level::Off)?;
            Ok(line)
        }

        fn electrical(&self, value: Value) -> Electrical {
            match (value, self.off_level) {
                (Value::Inactive, level) => level,
                (Value::Active, Electrical::Low) => Electrical::High,
                (Value::Active, Electrical::High) => Electrical::Low,
            }
        }
    }

    impl Line for GpioLine {
        fn drive(&mut self, level: Level) -> Result<(), LineError> {
            let value = match level {
                Level::Off => Value::Inactive,
                Level::On => Value::Active,
            };
            let failed = |error| kernel(&self.chip, &self.offset.to_string(), &error);
            self.request.set_lone_value(value).map_err(failed)?;
            if !self.reads_back {
                return Ok(());
            }
            let found = self.request.lone_value().map_err(failed)?;
            if found == value {
                return Ok(());
            }
            Err(LineError::ReadsOtherwise {
                chip: self.chip.clone(),
                line: self.offset,
                driven: self.electrical(value),
                reads: self.electrical(found),
            })
        }
    }

    /// The line's offset, if there is exactly one such line.
    fn find(chip: &Chip, path: &Path, line: &Which) -> Result<u32, LineError> {
        let lines = chip.info().map_err(|error| chip_error(path, &error))?.num_lines;
        let none = |key, value| LineError::NoLine { chip: path.to_owned(), key, value, lines };
        match line {
            Which::Offset(offset) if *offset < lines => Ok(*offset),
            Which::Offset(offset) => Err(none("`line`", offset.to_string())),
            Which::Name(name) => {
                let mut offsets = Vec::new();
                for offset in 0..lines {
                    let info = chip.line_info(offset).map_err(|error| kernel(path, name, &error))?;
                    if info.name == *name {
                        offsets.push(offset);
                    }
                }
                match offsets.as_slice() {
                    [] => Err(none("`name`", format!("{name:?}"))),
                    [offset] => Ok(*offset),
                    _ => Err(LineError::Ambiguous { chip: path.to_owned(), name: name.clone(), offsets }),
                }
            }
        }
    }

    fn errno(error: &gpiocdev::Error) -> Option<i32> {
        match error {
            gpiocdev::Error::Os(errno) => Some(errno.0),
            _ => None,
        }
    }

    fn chip_error(chip: &Path, error: &gpiocdev::Error) -> LineError {
        let chip = chip.to_owned();
        match (errno(error), error) {
            (Some(ENOENT), _) => LineError::NoChip { chip },
            (Some(EACCES | EPERM), _) => LineError::Forbidden { chip },
            (_, gpiocdev::Error::GpioChip(_, why)) => LineError::NotAChip { chip, why: format!("it {why}") },
            _ => LineError::NotAChip { chip, why: error.to_string() },
        }
    }

    fn kernel(chip: &Path, line: &str, error: &gpiocdev::Error) -> LineError {
        LineError::Kernel { chip: chip.to_owned(), line: line.to_owned(), why: error.to_string() }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        /// As the kernel says them: a test that runs as root is allowed everything, and a machine may have no chip.
        #[test]
        fn spec_what_the_kernel_says_of_a_chip_is_said_by_key_and_with_a_remedy() {
            let path = Path::new("/dev/gpiochip0");
            let said = |errno| {
                let error = gpiocdev::Error::from(std::io::Error::from_raw_os_error(errno));
                chip_error(path, &error)
            };
            for errno in [EACCES, EPERM] {
                let error = said(errno);
                assert_eq!(error, LineError::Forbidden { chip: path.to_owned() });
                let text = error.to_string();
                assert!(
                    text.contains("`chip`") && text.contains("may not open") && text.contains("group"),
                    "{text}"
                );
            }
            assert_eq!(said(ENOENT), LineError::NoChip { chip: path.to_owned() });
            assert!(matches!(said(5), LineError::NotAChip { .. }));
        }
    }
}

/// The line of these settings, driven off.
///
/// # Errors
/// It cannot be had, or does not read off.
#[cfg(target_os = "linux")]
pub fn open(settings: &Settings) -> Result<Box<dyn super::Line>, LineError> {
    Ok(Box::new(GpioLine::open(settings)?))
}

/// There are none.
///
/// # Errors
/// Always.
#[cfg(not(target_os = "linux"))]
pub fn open(_: &Settings) -> Result<Box<dyn super::Line>, LineError> {
    Err(LineError::NotLinux)
}
