//! Figures as an operator reads them.

use crate::time::Utc;

/// Seconds: with a tenth where that matters.
pub(super) fn seconds(time_s: f64) -> String {
    if time_s.abs() < 100.0 { format!("{time_s:.1} s") } else { span_of(time_s) }
}

/// Minutes and seconds.
pub(super) fn span_of(time_s: f64) -> String {
    let whole = time_s.abs().round() as u64;
    let sign = if time_s <= -0.5 { "-" } else { "" };
    format!("{sign}{}:{:02}", whole / 60, whole % 60)
}

/// A rate with the prefix that fits.
pub(super) fn rate(bps: f64) -> String {
    match bps {
        bps if bps >= 1e6 => format!("{:.3} Mbit/s", bps / 1e6),
        bps if bps >= 1e3 => format!("{:.1} kbit/s", bps / 1e3),
        bps => format!("{bps:.0} bit/s"),
    }
}

/// An age: milliseconds, or seconds.
pub(super) fn age(time_s: f64) -> String {
    if time_s < 1.0 { format!("{:.0} ms", time_s * 1e3) } else { format!("{time_s:.1} s") }
}

/// Date and time of day.
pub(super) fn clock_of(utc: Utc) -> String {
    let text = Utc { unix_us: utc.unix_us - utc.unix_us % 1_000_000 }.to_string();
    text.replace('T', " ")
}

/// Time of day with a tenth of a second.
pub(super) fn time_of(utc: Utc) -> String {
    let of_day = utc.unix_us / 100_000 % 864_000;
    let (hour, minute) = (of_day / 36_000, of_day / 600 % 60);
    format!("{hour:02}:{minute:02}:{:02}.{}", of_day / 10 % 60, of_day % 10)
}

/// No longer than this; what is cut off shows.
pub(super) fn cut(text: &str, width: usize) -> String {
    if text.chars().count() <= width {
        return text.to_owned();
    }
    let start: String = text.chars().take(width.saturating_sub(3)).collect();
    if width > 3 { start + "..." } else { String::new() }
}

/// Words in rows of at most so many characters; a longer word is cut.
pub(super) fn folded(text: &str, width: usize) -> Vec<String> {
    let mut rows = vec![String::new()];
    // What a device sends may be anything: nothing of it may move the cursor.
    let clean: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    for word in clean.split(' ').filter(|word| !word.is_empty()) {
        let word: Vec<char> = word.chars().collect();
        for piece in word.chunks(width.max(1)) {
            let piece: String = piece.iter().collect();
            let Some(row) = rows.last_mut() else { break };
            if row.is_empty() {
                *row = piece;
            } else if row.chars().count() + 1 + piece.chars().count() <= width {
                row.push(' ');
                row.push_str(&piece);
            } else {
                rows.push(piece);
            }
        }
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_figures_are_short_and_right() {
        assert_eq!([seconds(7.25), seconds(-3.0), seconds(133.4)], ["7.2 s", "-3.0 s", "2:13"]);
        assert_eq!([rate(1.2345e6), rate(512.4e3), rate(12.0)], ["1.234 Mbit/s", "512.4 kbit/s", "12 bit/s"]);
        assert_eq!([age(0.045), age(3.21)], ["45 ms", "3.2 s"]);
        let utc = Utc { unix_us: 1_795_284_123_456_000 };
        assert_eq!(clock_of(utc), "2026-11-21 18:02:03Z");
        assert_eq!(time_of(utc), "18:02:03.4");
    }

    #[test]
    fn spec_text_of_anybody_stays_in_its_rows() {
        assert_eq!(folded("a bc def", 4), ["a bc", "def"]);
        assert_eq!(folded("abcdefghij", 4), ["abcd", "efgh", "ij"]);
        assert_eq!(folded("a\u{1B}[2Jb\n", 20), ["a [2Jb"]);
        assert_eq!(folded("", 10), [""]);
        assert_eq!([cut("abcdef", 6), cut("abcdefg", 6), cut("abcd", 2)], ["abcdef", "abc...", ""]);
    }
}
