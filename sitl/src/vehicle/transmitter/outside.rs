//! A device that is simulated elsewhere, or is none: whoever has it says what it radiates.

use std::time::Duration;

use super::Emission;

/// No slot of any plan.
const NO_SLOT: i32 = -1;

/// What such a device radiates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DevicePower {
    /// At the antenna connector, dBm.
    pub dbm: f64,
    /// The slot for which its host was last told to radiate; `None`: for none.
    pub slot: Option<u16>,
    /// Its host, or itself, has failed: what it radiates is not what it was told by anybody.
    pub astray: bool,
}

/// What stands in for the vehicle's own device; nothing: off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Outside(pub Option<DevicePower>);

impl Outside {
    pub fn emission(self) -> Option<Emission> {
        let DevicePower { dbm, slot, .. } = self.0?;
        Some(Emission::new(dbm, slot.map_or(NO_SLOT, i32::from), Duration::MAX, 0))
    }

    pub fn is_out_of_order(self) -> bool {
        self.0.is_some_and(|power| power.astray)
    }
}
