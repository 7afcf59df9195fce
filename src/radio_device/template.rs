//! Text with placeholders for a setting.

/// `text` with `{level}` and `{dbm}` (the setting as it is), `{mbm}` (its hundredfold, whole, rounded down) and `{mw}` (taken
/// as dBm, in milliwatts) filled in.
pub(super) fn fill(text: &str, setting: f64) -> String {
    let plain = decimals(setting);
    text.replace("{level}", &plain)
        .replace("{dbm}", &plain)
        // The grid's rounding is no reason for the next hundredth below.
        .replace("{mbm}", &format!("{}", (setting * 100.0 + 1e-6).floor()))
        .replace("{mw}", &decimals(10f64.powf(setting / 10.0)))
}

/// Up to six decimals, and no more than it takes.
fn decimals(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::fill;

    #[test]
    fn val_settings_in_every_unit() {
        for (setting, filled) in [
            (20.0, "20 20 2000 100"),
            (19.99, "19.99 19.99 1999 99.770006"),
            (0.29, "0.29 0.29 29 1.069055"),
            (-3.5, "-3.5 -3.5 -350 0.446684"),
            (-0.0, "0 0 0 1"),
        ] {
            assert_eq!(fill("{level} {dbm} {mbm} {mw}", setting), filled);
        }
    }
}
