//! The digest sees the meaning of a mission, and all of it.

use super::*;

#[test]
fn spec_the_digest_sees_the_meaning_and_not_the_writing() {
    let demo = mission(DEMO);
    let rewritten = DEMO.parse::<toml::Table>().unwrap().to_string();
    assert!(!rewritten.contains('#'));
    assert_eq!(mission(&rewritten).digest(), demo.digest());
    let spelt_out = DEMO.replace("max_power_w = 0.5 ", "max_power_w = { j = 0.5, i = 5e-1 } ");
    assert_ne!(spelt_out, DEMO);
    assert_eq!(mission(&spelt_out).digest(), demo.digest());
    assert_eq!(mission(&format!("{LEAST}[tdma]\nguard_s = 1\n")).digest(), mission(LEAST).digest());
    assert_eq!(demo.digest_hex().len(), 64);
    assert!(demo.differences(&mission(&rewritten)).is_empty());
}

/// Paths to every value of a document that is no table.
fn leaves(value: &toml::Value, path: &mut Vec<String>, out: &mut Vec<Vec<String>>) {
    let nested: Vec<(String, &toml::Value)> = match value {
        toml::Value::Table(table) => table.iter().map(|(key, value)| (key.clone(), value)).collect(),
        toml::Value::Array(items) => {
            items.iter().enumerate().map(|(i, value)| (i.to_string(), value)).collect()
        }
        _ => return out.push(path.clone()),
    };
    for (key, value) in nested {
        path.push(key);
        leaves(value, path, out);
        path.pop();
    }
}

fn leaf<'v>(value: &'v mut toml::Value, path: &[String]) -> &'v mut toml::Value {
    path.iter().fold(value, |value, key| match value {
        toml::Value::Array(items) => &mut items[key.parse::<usize>().unwrap()],
        other => &mut other[key.as_str()],
    })
}

#[test]
fn spec_the_digest_changes_with_every_single_value() {
    let document = toml::Value::Table(DEMO.parse().unwrap());
    let mut paths = Vec::new();
    leaves(&document, &mut Vec::new(), &mut paths);
    assert!(paths.len() > 50, "{} values", paths.len());
    let words = [
        "other",
        "conventional",
        "body",
        "roll-pitch-yaw",
        "shortest",
        "paper",
        "nominal",
        "rate",
        "max-min",
        "turning",
    ];
    // The paper's methods plan for rates alone.
    let rates = DEMO.replace("optimise = \"volume\"", "optimise = \"rate\"");
    assert_ne!(rates, DEMO);
    for path in paths {
        let text = if path.ends_with(&["method".to_owned()]) { &rates } else { DEMO };
        let (demo, document) = (mission(text), toml::Value::Table(text.parse().unwrap()));
        let changes: Vec<toml::Value> = match leaf(&mut document.clone(), &path) {
            toml::Value::Float(x) => [*x * 0.99, *x - 1.0, *x + 1.0].map(toml::Value::Float).into(),
            toml::Value::Integer(x) => vec![toml::Value::Integer(*x + 1)],
            toml::Value::Boolean(flag) => vec![toml::Value::Boolean(!*flag)],
            _ => words.map(|word| toml::Value::String(word.to_owned())).into(),
        };
        let changed = changes.into_iter().find_map(|change| {
            let mut document = document.clone();
            let before = std::mem::replace(leaf(&mut document, &path), change.clone());
            let mission = Mission::parse("m.toml", &toml::to_string(&document).unwrap()).ok();
            mission.filter(|_| before != change)
        });
        let changed = changed.unwrap_or_else(|| panic!("no change of {path:?} is accepted"));
        assert_ne!(changed.digest(), demo.digest(), "{path:?}");
        assert_eq!(demo.differences(&changed).len(), 1, "{path:?}: {:?}", demo.differences(&changed));
    }
}

#[test]
fn spec_differences_name_what_only_one_side_has() {
    let more = mission(&format!("{LEAST}[radio]\ncarrier_hz = 2.4e9\n"));
    let difference = Difference {
        key: "radio.carrier_hz".to_owned(),
        ours: None,
        theirs: Some("2400000000.0".to_owned()),
    };
    assert_eq!(mission(LEAST).differences(&more), std::slice::from_ref(&difference));
    let swapped = Difference { ours: difference.theirs, theirs: difference.ours, ..difference };
    assert_eq!(more.differences(&mission(LEAST)), [swapped]);
}
