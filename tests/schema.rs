//! What editors are given: a schema for each kind of file, the same in the tree as the program prints, with a description of
//! every key, and named by every file that is shipped.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod command;

use std::path::Path;

use serde_json::Value;

use command::veilwing;

const KINDS: [&str; 4] = ["mission", "vehicle", "radio", "faults"];

fn printed(arguments: &[&str]) -> String {
    let output = veilwing(&[&["schema"], arguments].concat()).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn kept(kind: &str) -> String {
    std::fs::read_to_string(format!("config/schema/{kind}.json")).unwrap()
}

#[test]
fn spec_the_schemas_in_the_tree_are_those_that_the_program_prints() {
    for kind in KINDS {
        let remedy = format!("run: veilwing schema {kind} > config/schema/{kind}.json");
        assert!(kept(kind) == printed(&[kind]), "config/schema/{kind}.json is another one; {remedy}");
    }
    let files = std::fs::read_dir("config/schema").unwrap().count();
    assert_eq!(files, KINDS.len());
}

#[test]
fn spec_a_document_is_draft_07_and_all_of_them_are_definitions_of_one() {
    let all: Value = serde_json::from_str(&printed(&[])).unwrap();
    let draft = "http://json-schema.org/draft-07/schema#";
    assert_eq!(all["$schema"], draft);
    for kind in KINDS {
        let text = kept(kind);
        for word in ["$defs", "prefixItems", "unevaluated", "dependent"] {
            assert!(!text.contains(word), "{word} is of a later draft, in {kind}.json");
        }
        let mut one: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(one.as_object_mut().unwrap().remove("$schema").unwrap(), draft);
        assert_eq!(one, all["definitions"][kind], "{kind}");
    }
    assert_eq!(all["definitions"].as_object().unwrap().len(), KINDS.len());
}

/// Every property under a schema, by path; with it whether it is described.
fn properties(path: &str, schema: &Value, found: &mut Vec<(String, bool)>) {
    match schema {
        Value::Object(fields) => {
            for (key, value) in fields {
                match value.as_object().filter(|_| key == "properties") {
                    Some(all) => {
                        for (name, property) in all {
                            let path = format!("{path}.{name}");
                            let said = property["description"].as_str().unwrap_or_default();
                            // A sentence, not a word.
                            found.push((path.clone(), said.ends_with(['.', ')', '"']) && said.contains(' ')));
                            properties(&path, property, found);
                        }
                    }
                    None => properties(path, value, found),
                }
            }
        }
        Value::Array(all) => all.iter().for_each(|value| properties(path, value, found)),
        _ => {}
    }
}

#[test]
fn spec_every_key_is_described() {
    for (kind, least) in KINDS.into_iter().zip([60, 30, 40, 15]) {
        let mut found = Vec::new();
        properties(kind, &serde_json::from_str(&kept(kind)).unwrap(), &mut found);
        assert!(found.len() >= least, "{kind}: {} keys", found.len());
        let bare: Vec<_> = found.iter().filter(|(_, described)| !described).collect();
        assert!(bare.is_empty(), "{bare:?}");
    }
}

#[test]
fn spec_every_shipped_file_names_the_schema_of_its_kind() {
    let mut seen = 0;
    for directory in ["config", "packaging/etc"] {
        for entry in std::fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            let line = text.lines().next().unwrap();
            let named =
                line.strip_prefix("#:schema ").unwrap_or_else(|| panic!("{}: {line}", path.display()));
            let schema = path.parent().unwrap().join(named);
            let kind = schema.file_stem().unwrap().to_str().unwrap().to_owned();
            assert!(schema.is_file(), "{}: {} is not there", path.display(), schema.display());
            assert!(Path::new(named).ends_with(format!("schema/{kind}.json")), "{named}");
            let name = path.file_stem().unwrap().to_str().unwrap();
            let own = if name == "paper" { "mission" } else { name.split('-').next().unwrap() };
            assert_eq!(kind, own, "{}", path.display());
            seen += 1;
        }
    }
    assert!(seen >= 9, "{seen}");
}
