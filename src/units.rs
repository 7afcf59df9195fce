//! Units that are easy to confuse. Everything else is SI with the unit in the name.

use std::fmt;

/// A power in watts.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Watts(pub f64);

/// A power in dB relative to one milliwatt. Not a linear unit: convert before adding or scaling.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Dbm(pub f64);

impl From<Watts> for Dbm {
    /// `10 log10(P / 1 mW)`; zero power is minus infinity.
    fn from(power: Watts) -> Self {
        Self(10.0 * (power.0 * 1e3).log10())
    }
}

impl From<Dbm> for Watts {
    fn from(power: Dbm) -> Self {
        Self(10f64.powf(power.0 / 10.0) * 1e-3)
    }
}

impl fmt::Display for Watts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            p if p == 0.0 || p >= 1.0 => write!(f, "{p:.3} W"),
            p if p >= 1e-3 => write!(f, "{:.3} mW", p * 1e3),
            p => write!(f, "{:.3} uW", p * 1e6),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_dbm_of_known_powers() {
        for (watts, dbm) in [(1e-3, 0.0), (1.0, 30.0), (0.5, 26.989_700_043_360_187), (1e-12, -90.0)] {
            assert!((Dbm::from(Watts(watts)).0 - dbm).abs() < 1e-12);
            assert!((Watts::from(Dbm(dbm)).0 / watts - 1.0).abs() < 1e-12);
        }
        assert_eq!(Dbm::from(Watts(0.0)).0, f64::NEG_INFINITY);
        assert_eq!(Watts::from(Dbm(f64::NEG_INFINITY)).0, 0.0);
    }
}
