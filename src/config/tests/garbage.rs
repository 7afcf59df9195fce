//! Text that is no settings file.

use super::*;

#[test]
fn spec_garbage_of_the_largest_size_is_told_in_bounded_space() {
    for piece in ["=\n", "[[user]]\n", "[ 1 ", "a.", "\"", "x=[[", "user=1\n"] {
        let findings = Mission::parse("m.toml", &piece.repeat((1 << 20) / piece.len())).unwrap_err();
        assert!(findings.has_errors() && findings.list().len() <= 1000);
        assert!(findings.to_string().len() < 1 << 20);
    }
}

fn mutated() -> impl Strategy<Value = String> {
    let edit = (
        0..5usize,
        any::<prop::sample::Index>(),
        any::<prop::sample::Index>(),
        "[\\PC\\n\\[\\]{}=\"'.,#0-9e-]{0,6}",
    );
    (prop::sample::select(vec![DEMO, VEHICLE_I, VEHICLE_J]), prop::collection::vec(edit, 1..8)).prop_map(
        |(text, edits)| {
            let mut chars: Vec<char> = text.chars().collect();
            for (kind, a, b, insert) in edits {
                if chars.is_empty() {
                    break;
                }
                let (a, b) = (a.index(chars.len()), b.index(chars.len()));
                let (low, high) = (a.min(b), a.max(b).min(a.min(b) + 200));
                match kind {
                    0 => chars.truncate(a.max(1)),
                    1 => drop(chars.splice(a..a, insert.chars())),
                    2 => drop(chars.splice(low..high, insert.chars())),
                    3 => {
                        let copy: Vec<char> = chars[low..high].to_vec();
                        drop(chars.splice(b..b, copy));
                    }
                    _ => chars.swap(a, b),
                }
            }
            chars.into_iter().collect()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn prop_no_text_makes_the_parser_panic_or_err_without_a_place(text in mutated()) {
        let lines = text.lines().count() + 1;
        for findings in [Mission::parse("m", &text).map(|m| m.warnings), Vehicle::parse("v", &text).map(|v| v.warnings)] {
            match findings {
                Ok(warnings) => prop_assert!(!warnings.has_errors()),
                Err(findings) => {
                    prop_assert!(findings.has_errors() && !findings.to_string().is_empty());
                    for finding in findings.list() {
                        prop_assert!((1..=lines).contains(&finding.line) && finding.column >= 1);
                        prop_assert!(!finding.message.is_empty() && !finding.help.is_empty());
                    }
                }
            }
        }
    }

    #[test]
    fn prop_what_the_parser_accepts_the_schema_accepts(text in mutated()) {
        if Mission::parse("m", &text).is_ok() {
            let schema = schema();
            prop_assert_eq!(validate(&schema, &schema["definitions"]["mission"], &as_json(&text)), Ok(()));
        }
    }
}
