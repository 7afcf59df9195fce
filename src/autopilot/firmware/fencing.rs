//! What the autopilot does at its fence, and how high it may fly: parameters of its owner's, which are looked at and never
//! written. A fence that would end an ordinary flight fails; one on which the autopilot does not act is warned of.

use super::Firmware;
use crate::autopilot::fence::{Fence, MARGIN_M};
use crate::autopilot::parameter::{Knowledge, Parameters};
use crate::geo::Enu;
use crate::preflight::Verdict::{Fail, Pass, Warn};
use crate::preflight::{Check, Verdict, check};

const PX4: &[&str] = &["GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"];
const ARDUCOPTER: &[&str] =
    &["FENCE_ENABLE", "FENCE_TYPE", "FENCE_ACTION", "FENCE_ALT_MAX", "FENCE_RADIUS", "FENCE_MARGIN"];

/// FENCE_TYPE: bits for the ceiling, the circle about home, polygons, and the floor.
const CEILING: i64 = 1;
const CIRCLE: i64 = 2;
const POLYGONS: i64 = 4;
const FLOOR: i64 = 8;
/// A ceiling higher than this above the least that serves keeps nothing in, in metres.
const HIGH_M: f64 = 25.0;
/// ArduPilot keeps so far away from its fence by itself, at the most that leaves the area's edge free, in metres.
const WIDEST_KEPT_M: f64 = 3.0;

/// Asks for what the checks look at.
pub(in crate::autopilot::firmware) fn read(firmware: Firmware, parameters: &mut Parameters) {
    let names = match firmware {
        Firmware::Px4 => PX4,
        Firmware::ArduPilot => ARDUCOPTER,
    };
    parameters.read_also(names.iter().map(ToString::to_string));
}

/// All of them; `home` is the autopilot's.
pub(in crate::autopilot) fn checks(
    firmware: Firmware,
    parameters: &Parameters,
    fence: &Fence,
    home: Option<Enu>,
) -> Vec<Check> {
    // Without a home there is no flight: that is a check of its own.
    let home = home.unwrap_or_default();
    let bounds =
        Bounds { least_ceiling_m: fence.top_m + MARGIN_M - home.z, reach_m: fence.reach_m(home), parameters };
    match firmware {
        Firmware::Px4 => bounds.px4(),
        Firmware::ArduPilot => bounds.arducopter(),
    }
}

/// What an ordinary flight needs, above home and around it.
struct Bounds<'a> {
    least_ceiling_m: f64,
    reach_m: f64,
    parameters: &'a Parameters,
}

impl Bounds<'_> {
    fn px4(&self) -> Vec<Check> {
        vec![
            self.parameters.check("GF_ACTION", |value| match value {
                2.0 | 3.0 | 5.0 => (Pass, ""),
                4.0 => (Fail, "2 (hold) or 3 (return): this one stops the motors at the fence"),
                _ => (Warn, "2 (hold) or 3 (return): this one lets the vehicle fly on across the fence"),
            }),
            self.judged("GF_MAX_VER_DIST", |value| match value {
                0.0 => Err((Warn, "so that there is a ceiling")),
                _ => self.ceiling(value),
            }),
            self.circle("GF_MAX_HOR_DIST", true),
        ]
    }

    fn arducopter(&self) -> Vec<Check> {
        let enabled = self.parameters.check("FENCE_ENABLE", |value| match value {
            0.0 => (Warn, "1: the fence is kept, and not acted on"),
            _ => (Pass, ""),
        });
        // What a fence does that is off matters to nobody.
        if enabled.result != Pass {
            return vec![enabled];
        }
        let kinds = match self.parameters.get("FENCE_TYPE") {
            Knowledge::Known(value) => value.as_f64() as i64,
            Knowledge::Pending | Knowledge::Unknown => CEILING | CIRCLE | POLYGONS,
        };
        let mut all = vec![
            enabled,
            self.parameters.check("FENCE_TYPE", |value| match value as i64 {
                v if v & POLYGONS == 0 => (Warn, "with bit 2 (4): polygons do not count otherwise"),
                v if v & FLOOR != 0 => {
                    (Warn, "without bit 3 (8): take-off and landing are below that floor")
                }
                v if v & CEILING == 0 => (Warn, "with bit 0 (1), so that there is a ceiling"),
                _ => (Pass, ""),
            }),
            self.parameters.check("FENCE_ACTION", |value| match value {
                0.0 => (Warn, "1 (return): this one lets the vehicle fly on across the fence"),
                _ => (Pass, ""),
            }),
            self.parameters.check("FENCE_MARGIN", |value| match value {
                v if v <= WIDEST_KEPT_M => (Pass, ""),
                _ => (Warn, "at most 3 m: the autopilot keeps so far inside its fence, and that is the mission's area"),
            }),
        ];
        if kinds & CEILING != 0 {
            // It lowers its own return, too: to FENCE_MARGIN below.
            all.push(self.judged("FENCE_ALT_MAX", |value| self.ceiling(value)));
        }
        if kinds & CIRCLE != 0 {
            all.push(self.circle("FENCE_RADIUS", false));
        }
        all
    }

    fn ceiling(&self, value_m: f64) -> Result<(), (Verdict, &'static str)> {
        if value_m < self.least_ceiling_m {
            Err((Fail, "or the flight ends there"))
        } else if value_m > self.least_ceiling_m + HIGH_M {
            Err((Warn, "so that it keeps a lost vehicle low"))
        } else {
            Ok(())
        }
    }

    /// A parameter that should be a ceiling for this flight.
    fn judged(
        &self,
        name: &'static str,
        judge: impl FnOnce(f64) -> Result<(), (Verdict, &'static str)>,
    ) -> Check {
        let (lowest_m, highest_m) = (self.least_ceiling_m.ceil(), self.least_ceiling_m + HIGH_M);
        self.told(name, |value| match judge(value) {
            Ok(()) => check(name, Pass, format!("{value} m above home")),
            Err((verdict, why)) => {
                let detail =
                    format!("{value} m above home, should be {lowest_m:.0} to {highest_m:.0} m, {why}");
                check(name, verdict, detail)
            }
        })
    }

    /// A circle about home, if there is one, must not cut the area.
    fn circle(&self, name: &'static str, zero_is_none: bool) -> Check {
        self.told(name, |value| match value {
            0.0 if zero_is_none => check(name, Pass, "0: none"),
            v if v >= self.reach_m => check(name, Pass, format!("{v} m around home")),
            v => {
                let detail = format!(
                    "{v} m around home, should be at least {:.0} m, or switched off: it cuts the mission's area",
                    self.reach_m.ceil()
                );
                check(name, Fail, detail)
            }
        })
    }

    fn told(&self, name: &'static str, judge: impl FnOnce(f64) -> Check) -> Check {
        match self.parameters.get(name) {
            Knowledge::Pending => check(name, Fail, "not read yet"),
            Knowledge::Unknown => check(name, Warn, "the autopilot does not answer: not known"),
            Knowledge::Known(value) => judge(value.as_f64()),
        }
    }
}
