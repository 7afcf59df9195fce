//! What is meant by words: the only place of the report where prose is read to decide anything. A companion says on the
//! wire, in STATUSTEXT, what happens to it, and a log has nothing else of it.

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
        match why {
            "no jam lease in force" => Self::NoLease,
            "vehicle I is not on station" => Self::OffStation,
            why => Self::Plain(why),
        }
    }
}

/// How long a fault lasts, by the words that it was recorded with.
#[must_use]
pub fn lasting(fault: &str) -> Option<&str> {
    fault.rsplit_once(" for ").map(|(_, time)| time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_notices_are_known_by_their_words() {
        for (text, said) in [
            ("waiting: no GPS; no home", Said::Waiting("no GPS; no home")),
            ("preflight warning: battery at 60%", Said::Warned("battery at 60%")),
            ("preflight passed, taking off", Said::Passed),
            ("silent: no jam lease in force", Said::Silent(Silence::NoLease)),
            ("silent: vehicle I is not on station", Said::Silent(Silence::OffStation)),
            ("silent, hands off: the pilot has it", Said::Silent(Silence::Plain("the pilot has it"))),
            ("slot 2: on, 500 mW", Said::OnAir),
            ("landed and disarmed", Said::Landed),
            ("the vehicle landed", Said::Other),
        ] {
            assert_eq!(Said::of(text), said, "{text}");
        }
    }

    #[test]
    fn val_a_faults_length_is_its_last_word() {
        assert_eq!(lasting("pair link cut for 2.500 s"), Some("2.500 s"));
        assert_eq!(lasting("pair link cut"), None);
    }
}
