//! A number in what a device says.

/// Where the number stands: after the first `after`, and, if that is given, directly before `before`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reading {
    /// What precedes it; empty: the text's start.
    pub after: String,
    /// What follows it, spaces aside; empty: anything.
    pub before: String,
}

impl Reading {
    /// The number, if it is there. Spaces, colons and equals signs before it are skipped.
    #[must_use]
    pub fn of(&self, text: &str) -> Option<f64> {
        let rest = &text[text.find(&self.after)? + self.after.len()..];
        let rest = rest.trim_start_matches(|c: char| c.is_whitespace() || matches!(c, ':' | '=' | '"'));
        let end =
            rest.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '-' | '+'))).unwrap_or(rest.len());
        let followed = rest[end..].trim_start().starts_with(&self.before);
        rest[..end].parse().ok().filter(|value: &f64| value.is_finite() && followed)
    }
}

#[cfg(test)]
mod tests {
    use super::Reading;

    fn read(after: &str, before: &str, text: &str) -> Option<f64> {
        Reading { after: after.to_owned(), before: before.to_owned() }.of(text)
    }

    #[test]
    fn spec_a_number_is_read_where_it_is_said_to_be_and_nowhere_else() {
        let info =
            "Interface wlan0\n\tifindex 3\n\ttype managed\n\tchannel 36 (5180 MHz)\n\ttxpower 20.00 dBm\n";
        assert_eq!(read("txpower", "dBm", info), Some(20.0));
        assert_eq!(read("+MWTXPOWER:", "", "AT+MWTXPOWER?\r\n+MWTXPOWER: -3.5 dBm\r\nOK\r\n"), Some(-3.5));
        assert_eq!(read("", "", " 12.25"), Some(12.25));
        for text in
            ["", "txpower dBm", "txpower 20.0.0 dBm", "txpower 20 mW", "txpower - dBm", "txpower NaN dBm"]
        {
            assert_eq!(read("txpower", "dBm", text), None, "{text:?}");
        }
    }
}
