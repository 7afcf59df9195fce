//! What an input reached: the outcomes by which one input is told from another, in place of the coverage that an
//! instrumented build would give.

use std::collections::BTreeSet;
use std::fmt::{self, Write};

/// FNV-1a with 64 bits: the same on every machine and with every compiler.
#[derive(Debug, Clone, Copy)]
pub struct Fingerprint(u64);

impl Default for Fingerprint {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fingerprint {
    /// Of these bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> u64 {
        let mut all = Self::default();
        all.take(bytes);
        all.0
    }

    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

impl Write for Fingerprint {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.take(text.as_bytes());
        Ok(())
    }
}

/// An input without backticks: errors quote by them whatever they quote, and with some of its own every value would be an outcome.
#[must_use]
pub fn unquoted(input: &[u8]) -> Vec<u8> {
    input.iter().map(|byte| if *byte == b'`' { b'_' } else { *byte }).collect()
}

/// A set of outcomes. A target notes kinds (a reason, a state, an event), never values that any input has of its own.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Reached(BTreeSet<u64>);

impl Reached {
    /// Notes an outcome by its words.
    pub fn note(&mut self, outcome: fmt::Arguments<'_>) {
        let mut all = Fingerprint::default();
        if all.write_fmt(outcome).is_ok() {
            self.0.insert(all.0);
        }
    }

    /// Notes an outcome and about how often it came: once, twice, up to 4, 8, ...
    pub fn count(&mut self, outcome: &str, times: u64) {
        if times > 0 {
            self.note(format_args!("{outcome} x 2^{}", u64::BITS - (times - 1).leading_zeros()));
        }
    }

    /// Notes an error's sentence without its particulars: numbers, and whatever stands between quotes.
    pub fn sentence(&mut self, outcome: &str, text: &str) {
        let (mut quoted, mut escaped) = (None, false);
        let kind = text.chars().filter(|c| match (quoted, *c) {
            (Some(_), _) if escaped => {
                escaped = false;
                false
            }
            (Some(end), c) => {
                escaped = c == '\\';
                if c == end {
                    quoted = None;
                }
                false
            }
            (None, '`' | '"') => {
                quoted = Some(*c);
                false
            }
            (None, c) => c.is_alphabetic() || c == ' ',
        });
        self.note(format_args!("{outcome}: {}", kind.take(120).collect::<String>()));
    }

    /// How many outcomes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// What is here and not in `known`.
    #[must_use]
    pub fn beyond(&self, known: &Self) -> Self {
        Self(self.0.difference(&known.0).copied().collect())
    }

    /// Whether all of `part` is here.
    #[must_use]
    pub fn covers(&self, part: &Self) -> bool {
        part.0.is_subset(&self.0)
    }

    /// Takes in what another input reached.
    pub fn join(&mut self, other: &Self) {
        self.0.extend(&other.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_fingerprint_is_fnv_1a() {
        // From the test vectors of its authors.
        assert_eq!(Fingerprint::of(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(Fingerprint::of(b"foobar"), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn spec_outcomes_of_one_kind_are_one() {
        let mut reached = Reached::default();
        reached.sentence("refused", "`speed_m_s` is 7, above the maximum of 5");
        reached.sentence("refused", "`climb_m_s` is 99.5, above the maximum of 20");
        reached.sentence("refused", r#""a \" b" is 7, above the maximum of 5"#);
        let value = unquoted(b"climb`m`s");
        let told = format!("`{}` is 7, above the maximum of 5", String::from_utf8_lossy(&value));
        reached.sentence("refused", &told);
        assert_eq!(reached.len(), 1);
        for (times, kinds) in [(0, 1), (1, 2), (2, 3), (3, 4), (4, 4), (5, 5)] {
            reached.count("frames", times);
            assert_eq!(reached.len(), kinds, "{times}");
        }
        let before = reached.clone();
        reached.note(format_args!("{:?}", Some(3)));
        assert!(reached.covers(&before) && !before.covers(&reached));
        assert_eq!(reached.beyond(&before).len(), 1);
    }
}
