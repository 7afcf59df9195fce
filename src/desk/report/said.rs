//! What is meant by words: the only place of the report where prose is read to decide anything. A companion says on the
//! wire, in STATUSTEXT, what happens to it, and a log has nothing else of it.

use crate::service;

/// What a companion's notice says, as far as the report asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Said<'a> {
    /// It waits before take-off, for this: reasons, each apart from the next by a semicolon.
    Waiting(&'a str),
    /// It flies although its preflight found this.
    Warned(&'a str),
    /// Its preflight found nothing to wait for.
    Passed,
    /// Its transmitter fell silent, out of turn, for this reason.
    Silent(Silence<'a>),
    /// Its transmitter is on.
    OnAir,
    /// Its vehicle is on the ground.
    Landed,
    /// Anything else.
    Other,
}

/// Why a transmitter fell silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Silence<'a> {
    /// I has no promise of J's.
    NoLease,
    /// J does not know I on station.
    OffStation,
    /// What needs no comment.
    Plain(&'a str),
}

impl<'a> Said<'a> {
    /// What a notice of these words says.
    #[must_use]
    pub fn of(text: &'a str) -> Self {
        if let Some(reasons) = text.strip_prefix("waiting: ") {
            Self::Waiting(reasons)
        } else if let Some(warning) = text.strip_prefix("preflight warning: ") {
            Self::Warned(warning)
        } else if text.contains("preflight passed") {
            Self::Passed
        } else if text.starts_with("silent") {
            Self::Silent(Silence::of(text.split_once(": ").map_or(text, |(_, why)| why)))
        } else if text.starts_with("landed") {
            Self::Landed
        } else if text.contains(": on, ") {
            Self::OnAir
        } else {
            Self::Other
        }
    }
}

impl<'a> Silence<'a> {
    fn of(why: &'a str) -> Self {
        if why == service::Silence::NoLease.to_string() {
            Self::NoLease
        } else if why == service::Silence::NoPeer.to_string() {
            Self::OffStation
        } else {
            Self::Plain(why)
        }
    }
}

/// Whether a companion gives the mission, or its vehicle, up.
#[must_use]
pub fn gives_up(text: &str) -> bool {
    text.starts_with("mission aborted: ") || text.starts_with("silent, hands off: ")
}

/// Whether these are the words of an autopilot about a failsafe of its own.
#[must_use]
pub fn is_failsafe(text: &str) -> bool {
    text.strip_prefix("autopilot: ").is_some_and(|said| said.to_ascii_lowercase().contains("failsafe"))
}

/// How long a fault lasts, by the words that it was recorded with.
#[must_use]
pub fn lasting(fault: &str) -> Option<&str> {
    fault.rsplit_once(" for ").map(|(_, time)| time)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mission::{Cause, Notice};
    use crate::units::Watts;

    #[test]
    fn spec_the_companions_notices_are_known_by_their_words() {
        let silent = |why| Notice::Silent(why);
        let waiting = Notice::Waiting { text: "no GPS; no home".into(), again: false };
        for (notice, said) in [
            (waiting, Said::Waiting("no GPS; no home")),
            (Notice::PreflightWarning("battery at 60%".into()), Said::Warned("battery at 60%")),
            (Notice::TakingOff, Said::Passed),
            (silent(service::Silence::NoLease), Said::Silent(Silence::NoLease)),
            (silent(service::Silence::NoPeer), Said::Silent(Silence::OffStation)),
            (silent(service::Silence::Stale), Said::Silent(Silence::Plain("autopilot state is stale"))),
            (Notice::On(2, Watts(0.5)), Said::OnAir),
            (Notice::Landed, Said::Landed),
            (Notice::Airborne, Said::Other),
            (Notice::OnTheGround, Said::Other),
        ] {
            let text = notice.to_string();
            assert_eq!(Said::of(&text), said, "{text}");
        }
        let lost = || Cause::ControlLost("LOITER".into());
        let given_up = [Notice::Aborted(lost()), Notice::HandsOff(lost())];
        assert!(given_up.iter().all(|notice| gives_up(&notice.to_string())));
        assert!(![Notice::Landed, Notice::Airborne].iter().any(|notice| gives_up(&notice.to_string())));
        assert!(is_failsafe("autopilot: Failsafe: Offboard signal lost, switching to HOLD"));
        assert!(!is_failsafe("autopilot: Takeoff detected") && !is_failsafe("failsafe"));
        let hands_off = "silent, hands off: the pilot has it";
        assert_eq!(Said::of(hands_off), Said::Silent(Silence::Plain("the pilot has it")));
    }

    #[test]
    fn spec_a_faults_length_is_its_last_word() {
        assert_eq!(lasting("pair link cut for 2.500 s"), Some("2.500 s"));
        assert_eq!(lasting("pair link cut"), None);
    }
}
