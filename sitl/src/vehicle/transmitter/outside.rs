//! A device that is simulated elsewhere, or is none: whoever has it says what it radiates.

use std::time::Duration;

use super::Emission;

/// No slot of any plan.
const NO_SLOT: i32 = -1;

/// What such a device radiates; the default is one in order that is off.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DevicePower {
    /// At the antenna connector, dBm; `None`: it is off.
    pub dbm: Option<f64>,
    /// The slot for which its host was last told to radiate; `None`: for none.
    pub slot: Option<u16>,
    /// Its host, or itself, has failed: what it radiates, or that it is off, is not what it was told by anybody.
    pub astray: bool,
}

impl DevicePower {
    pub(super) fn emission(self) -> Option<Emission> {
        Some(Emission::new(self.dbm?, self.slot.map_or(NO_SLOT, i32::from), Duration::MAX, 0))
    }
}
