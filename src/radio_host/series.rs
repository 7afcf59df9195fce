//! Whose command counts, and which is newer: one commander, one boot of it in force, rising numbers, and a series that the
//! radio draws anew at its start and whenever it takes a boot.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::transmitter::wire::WHOLE;

/// A command's place, as its fields name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub number: u32,
    pub boot: u32,
    pub series: u32,
}

impl Place {
    /// From param2 to param4; what is no whole number is none, and reads as 0.
    pub fn of([number, boot, series]: [f32; 3]) -> Self {
        let whole = |value: f32| {
            let is_whole = value >= 0.0 && value < WHOLE as f32 && value.fract() == 0.0;
            if is_whole { value as u32 } else { 0 }
        };
        Self { number: whole(number), boot: whole(boot), series: whole(series) }
    }
}

/// What a command's place makes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Standing {
    /// It counts, and its number is taken.
    Counts,
    /// It counts, and its boot is in force from now on.
    BeginsBoot,
    NotNewer,
    /// As [`Self::NotNewer`], but its boot was taken.
    BeginsBootNotNewer,
    OtherSeries,
}

/// See the module.
#[derive(Debug, Clone)]
pub(super) struct Series {
    random: ChaCha8Rng,
    /// (system, component) of the first that gave a command.
    commander: Option<(u8, u8)>,
    pub boot: u32,
    pub newest: u32,
    pub series: u32,
}

impl Series {
    pub fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let series = draw(&mut random);
        Self { random, commander: None, boot: 0, newest: 0, series }
    }

    /// Whether somebody commands.
    pub fn has_commander(&self) -> bool {
        self.commander.is_some()
    }

    /// Whether a command of `sender`'s is heard: the first that gives one is the commander from then on.
    pub fn is_heard(&mut self, sender: (u8, u8)) -> bool {
        *self.commander.get_or_insert(sender) == sender
    }

    /// Takes the place of a command of the commander's.
    pub fn take(&mut self, place: Place) -> Standing {
        let mut begins = false;
        if place.boot == 0 || place.boot != self.boot {
            if place.boot == 0 || place.series != self.series {
                return Standing::OtherSeries;
            }
            (self.boot, self.newest, begins) = (place.boot, 0, true);
            self.series = draw(&mut self.random);
        }
        if place.number <= self.newest {
            return if begins { Standing::BeginsBootNotNewer } else { Standing::NotNewer };
        }
        self.newest = place.number;
        if begins { Standing::BeginsBoot } else { Standing::Counts }
    }
}

fn draw(random: &mut impl Rng) -> u32 {
    random.random_range(1..WHOLE)
}
