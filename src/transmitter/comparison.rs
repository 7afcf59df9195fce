//! What the radio declares, against what the flight asks of it: a named check for each.
//!
//! What protection rests on refuses every flight: times to off and to a new power, and a plan that the radio cannot give.
//! What the permission to radiate rests on refuses where something real is radiated.

use std::time::Duration;

use crate::preflight::{Check, Verdict, check};
use crate::role::Role;
use crate::units::{Dbm, Watts};

use super::declared::Fact;
use super::{Driver, Transmitter, power_dbm};

/// S4: what fails silences within this.
const REACTION: Duration = Duration::from_millis(100);
/// J vouches for the plan's power alone, less what a radio's steps and the wire's rounding take away.
pub const FULL_POWER: f64 = 0.99;
/// Weaker than any payload radio's least: -60 dBm.
const FAINT_W: f64 = 1e-9;
/// Single precision carries thousandths of a dBm so well.
const ROUNDING_DB: f32 = 1e-5;
/// Single precision carries frequencies and powers so well.
const ROUNDING: f64 = 1e-6;

/// What a flight asks of its radio, beside the powers of its plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Demands {
    /// Which vehicle's radio it is.
    pub role: Role,
    /// Something real is radiated.
    pub real: bool,
    /// The part of a slot in which nobody radiates for the user, half of it at each end; J begins with the slot.
    pub guard: Duration,
    /// The longest lease.
    pub lease: Duration,
    /// What may be radiated, if the mission says.
    pub permitted: Option<Permitted>,
    /// A radio that goes on when its host dies is accepted.
    pub accept_orphaned: bool,
}

/// What may be radiated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Permitted {
    /// Lowest and highest frequency, in Hz.
    pub band_hz: [f64; 2],
    /// The largest power, in W.
    pub max_power_w: f64,
}

impl Transmitter {
    /// What it declares, compared. `plan`: for whom each slot is, and the power in W planned for it; `ceiling`: over what is
    /// commanded.
    #[must_use]
    pub fn compare(&self, demands: &Demands, plan: &[(&str, f64)], ceiling: Watts) -> Vec<Check> {
        if matches!(self.driver, Driver::None) || self.heard_at.is_none() {
            return Vec::new();
        }
        let mut all = Vec::new();
        all.extend(self.completeness(demands));
        all.extend(self.off_time());
        all.extend(self.change_time(demands));
        all.extend(self.powers(demands, plan, ceiling));
        all.extend(self.read_back());
        all.extend(self.orphaned(demands));
        if let Some(permitted) = demands.permitted.filter(|_| demands.real) {
            all.extend(self.band(&permitted));
            all.extend(self.permitted_power(&permitted));
        }
        all
    }

    fn fact(&self, fact: Fact) -> Option<f64> {
        self.declared.get(fact).map(f64::from)
    }

    /// Whether it has declared everything.
    fn completeness(&self, demands: &Demands) -> Option<Check> {
        let name = "transmitter facts";
        let awaited = self.declared.awaited();
        if awaited > 0 {
            return Some(check(name, Verdict::Fail, format!("the radio is asked for {awaited} of them")));
        }
        let missing: Vec<&str> = self.declared.missing().map(Fact::parameter).collect();
        if missing.is_empty() || !(demands.real || self.declared.is_made()) {
            return None;
        }
        let detail = format!(
            "the radio does not declare {}: nothing is known of it, and nothing compared",
            missing.join(", ")
        );
        Some(check(name, Verdict::Warn, detail))
    }

    fn off_time(&self) -> Option<Check> {
        let (fact, ms) = (Fact::OffMs, self.fact(Fact::OffMs)?);
        let most_ms = REACTION.as_millis();
        let detail = format!("{ms} ms");
        Some(match (0.0..=REACTION.as_secs_f64() * 1e3).contains(&ms) {
            true => check(fact.parameter(), Verdict::Pass, format!("{detail} from an off to silence")),
            false => check(
                fact.parameter(),
                Verdict::Fail,
                format!(
                    "{detail}, should be 0 to {most_ms}: a fault must silence it within {most_ms} ms (S4)"
                ),
            ),
        })
    }

    /// J is on from a slot's opening, half a guard before I may be; I is commanded then.
    fn change_time(&self, demands: &Demands) -> Option<Check> {
        let (name, ms) = (Fact::ChangeMs.parameter(), self.fact(Fact::ChangeMs)?);
        let guard_ms = demands.guard.as_secs_f64() * 1e3;
        let delay_ms = match demands.role {
            Role::I => ms,
            Role::J => (ms - 0.5 * guard_ms).max(0.0),
        };
        Some(if (0.0..=guard_ms).contains(&ms) {
            let detail = format!(
                "{ms} ms, within the guard of {guard_ms:.0} ms: what a slot serves begins {delay_ms:.0} ms later"
            );
            check(name, Verdict::Pass, detail)
        } else {
            let detail = format!(
                "{ms} ms, should be 0 to {guard_ms:.0}, the guard (tdma.guard_s): what a slot serves would begin {delay_ms:.0} ms later"
            );
            check(name, Verdict::Fail, detail)
        })
    }

    /// Whether the radio gives every power of the plan: what is below its least is off, and nothing is vouched for by a
    /// jammer that is weaker than planned.
    fn powers(&self, demands: &Demands, plan: &[(&str, f64)], ceiling: Watts) -> Option<Check> {
        let name = "transmitter power";
        let asked = || plan.iter().filter(|(_, planned_w)| *planned_w > 0.0);
        let given = |planned_w: f64| self.gives(planned_w.min(ceiling.0));
        if let Some((user, planned_w)) = asked().find(|(_, planned_w)| given(*planned_w) <= 0.0) {
            let commanded = planned_w.min(ceiling.0);
            let least = match self.least_w() {
                Some(least_w) => format!(", should be at least {}, the radio's least", shown(least_w)),
                None => String::new(),
            };
            let detail = format!(
                "{} for {user}{least}: it would be off in that slot; give the mission's vehicles.{}.min_power_w",
                shown(commanded),
                demands.role.key()
            );
            return Some(check(name, Verdict::Fail, detail));
        }
        let short = |planned_w: f64| given(planned_w) < FULL_POWER * planned_w;
        if demands.role == Role::J
            && let Some((user, planned_w)) = asked().find(|(_, planned_w)| short(*planned_w))
        {
            let detail = format!(
                "{} for {user}, should be the planned {}: a jammer weaker than that vouches for nothing, and the slot is not served",
                shown(given(*planned_w)),
                shown(*planned_w)
            );
            return Some(check(name, Verdict::Warn, detail));
        }
        let (user, weakest) = asked().min_by(|a, b| f64::total_cmp(&a.1, &b.1))?;
        let weakest = *weakest;
        let Some(least) = self.least_w() else {
            let detail = format!(
                "{} for {user}, should be at least {}: the radio does not say its least, and none that is made for this is so weak; give the mission's vehicles.{}.min_power_w",
                shown(weakest),
                shown(FAINT_W),
                demands.role.key()
            );
            return (weakest < FAINT_W).then(|| check(name, Verdict::Warn, detail));
        };
        let detail = format!("{} and above, the radio's least is {}", shown(weakest), shown(least));
        Some(check(name, Verdict::Pass, detail))
    }

    /// The power in W that a command of this one gives, as far as is known: the same or less.
    fn gives(&self, power_w: f64) -> f64 {
        match &self.driver {
            Driver::Parameter(parameter) => parameter.gives_w(power_w),
            Driver::Numbered(_) | Driver::Leased(_) => {
                let too_weak = self
                    .declared
                    .get(Fact::MinDbm)
                    .is_some_and(|least| power_dbm(power_w) < least - ROUNDING_DB);
                if too_weak { 0.0 } else { power_w }
            }
            Driver::None => 0.0,
        }
    }

    /// The least power above off, in W, if it is known.
    fn least_w(&self) -> Option<f64> {
        match &self.driver {
            Driver::Parameter(parameter) => parameter.least_w(),
            _ => self.fact(Fact::MinDbm).map(|dbm| Watts::from(Dbm(dbm)).0),
        }
    }

    fn read_back(&self) -> Option<Check> {
        let name = Fact::ReadBack.parameter();
        Some(if self.fact(Fact::ReadBack)? > 0.0 {
            check(name, Verdict::Pass, "the power achieved is read back from the device")
        } else {
            check(
                name,
                Verdict::Warn,
                "0, should be 1: the radio says what was set, and not what its device does",
            )
        })
    }

    /// What the device does when its host dies. I's must be as quick as at an off: J protects it until its lease and that time are
    /// over, and no longer. J's may take a lease: until then I may be on, and J's noise harms nobody but the eavesdroppers.
    fn orphaned(&self, demands: &Demands) -> Option<Check> {
        let (name, ms) = (Fact::DeadMs.parameter(), self.fact(Fact::DeadMs)?);
        let lease_ms = demands.lease.as_secs_f64() * 1e3;
        let (most_ms, why) = match demands.role {
            Role::I => (self.fact(Fact::OffMs)?.min(lease_ms), "its TX_OFF_MS"),
            Role::J => (lease_ms, "a lease"),
        };
        // Both have come in single precision.
        if (0.0..=most_ms * (1.0 + ROUNDING)).contains(&ms) {
            return Some(check(name, Verdict::Pass, format!("silent {ms} ms after its host's death")));
        }
        let is = if ms < 0.0 { "never by itself".to_owned() } else { format!("{ms} ms") };
        let detail = format!(
            "{is}, should be at most {most_ms:.0} ms ({why}): a device whose host dies radiates on, unprotected"
        );
        Some(match (demands.real, demands.accept_orphaned) {
            (true, false) => {
                let detail = format!("{detail}; [transmitter] accept_orphaned_radio = true accepts that");
                check(name, Verdict::Fail, detail)
            }
            (true, true) => {
                check(name, Verdict::Warn, format!("{detail}; accepted by accept_orphaned_radio"))
            }
            (false, _) => check(name, Verdict::Warn, detail),
        })
    }

    fn band(&self, permitted: &Permitted) -> Option<Check> {
        let name = "TX_BAND";
        let [low_khz, high_khz] = [self.fact(Fact::BandLowKhz)?, self.fact(Fact::BandHighKhz)?];
        let [least_khz, most_khz] = permitted.band_hz.map(|hz| hz * 1e-3);
        let should = format!("should be within {least_khz} to {most_khz} kHz (emission.band_hz)");
        Some(if low_khz < 0.0 || high_khz < 0.0 {
            check(name, Verdict::Warn, format!("not known, {should}"))
        } else if low_khz <= high_khz
            && low_khz >= least_khz * (1.0 - ROUNDING)
            && high_khz <= most_khz * (1.0 + ROUNDING)
        {
            check(name, Verdict::Pass, format!("{low_khz} to {high_khz} kHz, within emission.band_hz"))
        } else {
            check(name, Verdict::Fail, format!("{low_khz} to {high_khz} kHz, {should}"))
        })
    }

    /// The radio's own ceiling holds where everything else fails. Of a radio that declares nothing else it cannot be asked.
    fn permitted_power(&self, permitted: &Permitted) -> Option<Check> {
        let limit_w = self.limit_w()?;
        let most_w = permitted.max_power_w;
        let name = Fact::MaxDbm.parameter();
        if limit_w <= most_w * (1.0 + ROUNDING) {
            return Some(check(
                name,
                Verdict::Pass,
                format!("{}, within emission.max_power_w", Watts(limit_w)),
            ));
        }
        let detail = format!(
            "{}, should be at most {} (emission.max_power_w): the companion's ceiling alone keeps it below",
            shown(limit_w),
            shown(most_w)
        );
        let verdict = if self.declared.is_made() { Verdict::Fail } else { Verdict::Warn };
        Some(check(name, verdict, detail))
    }
}

/// A power as people write it who set up radios.
fn shown(power_w: f64) -> String {
    format!("{} ({:.3} dBm)", Watts(power_w), Dbm::from(Watts(power_w)).0)
}
