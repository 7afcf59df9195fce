//! The preflight's checks of the radio.

use crate::preflight::{Check, Verdict, check};
use crate::time::Instant;
use crate::units::Watts;

use super::{Driver, Kind, NotReady, Transmitter};

impl Transmitter {
    /// What speaks for or against radiating.
    #[must_use]
    pub fn preflight(&self, now: Instant) -> Vec<Check> {
        let (system, component) = self.settings.target;
        match (&self.settings.kind, &self.driver) {
            (Kind::None, _) => {
                return vec![check("transmitter", Verdict::Warn, "none configured: nothing radiates")];
            }
            (Kind::Numbered { command } | Kind::Leased { command }, Driver::None) => {
                let detail = format!("command {command} is no MAV_CMD; use 31010 (MAV_CMD_USER_1) to 31014");
                return vec![check("transmitter", Verdict::Fail, detail)];
            }
            _ => {}
        }
        let heard = match self.heard_at {
            Some(_) => {
                check("transmitter", Verdict::Pass, format!("component {component} of system {system}"))
            }
            None => {
                let link = if self.settings.apart { "its own link" } else { "the autopilot's link" };
                let detail = format!("component {component} of system {system} was never heard on {link}");
                check("transmitter", Verdict::Fail, detail)
            }
        };
        let limit = match self.limit_w() {
            Some(limit_w) => check("transmitter limit", Verdict::Pass, Watts(limit_w).to_string()),
            None => check(
                "transmitter limit",
                Verdict::Warn,
                "the radio does not say; the configured caps alone hold",
            ),
        };
        let mut checks = vec![heard, self.expiry_check(), limit];
        checks.extend(self.delay_check(now));
        checks
    }

    /// Whether the radio falls silent by itself (S5).
    fn expiry_check(&self) -> Check {
        let (verdict, detail) = match (&self.driver, self.supports_expiry()) {
            (_, Some(true)) => (Verdict::Pass, "the radio falls silent by itself"),
            (Driver::Parameter(_), _) => (
                Verdict::Warn,
                "not supported by a power parameter: a dead companion leaves the radio on (S5)",
            ),
            (_, Some(false)) => {
                (Verdict::Fail, "the radio does not know the leased power command: use kind = \"parameter\"")
            }
            (Driver::Numbered(numbered), None) if numbered.has_acknowledged() => (
                Verdict::Fail,
                "the radio acknowledges power commands, but does not say its clock: it knows their first form alone, form = 1",
            ),
            (_, None) => (Verdict::Fail, "the radio has not answered yet"),
        };
        check("transmitter expiry", verdict, detail)
    }

    /// What delay on the way to the radio does.
    fn delay_check(&self, now: Instant) -> Option<Check> {
        let name = "transmitter delay";
        let round_trip_ms = self.round_trip(now).map(|round_trip| round_trip.as_millis());
        match &self.driver {
            Driver::Numbered(_) => Some(match self.ready(now) {
                Ok(()) => {
                    let round_trip_ms = round_trip_ms.unwrap_or_default();
                    check(
                        name,
                        Verdict::Pass,
                        format!("answers after {round_trip_ms} ms; no delay prolongs a power"),
                    )
                }
                // The check before says it.
                Err(NotReady::NotHeard) => return None,
                Err(reason) => check(name, Verdict::Fail, reason.to_string()),
            }),
            Driver::Leased(_) => {
                let measured = round_trip_ms.map_or_else(
                    || "no command was answered yet".to_owned(),
                    |ms| format!("it answers after {ms} ms, so that a power may outlast its leave by as much and more"),
                );
                let detail = format!(
                    "expiries count from receipt (form = 1): a command that is late by so many ms lasts so many ms too long; {measured}"
                );
                Some(check(name, Verdict::Warn, detail))
            }
            Driver::Parameter(_) | Driver::None => None,
        }
    }
}
