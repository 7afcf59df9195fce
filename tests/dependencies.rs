//! What the dependencies are, by Cargo.lock and each package's own word: licences that `deny.toml` allows, from the registry
//! and nowhere else, in versions that are said. Cargo fetches those of other platforms that this machine lacks; advisories are
//! `cargo deny check advisories`.

#![cfg(feature = "companion")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::process::Command;

use serde_json::Value as Json;
use toml::Table;

fn metadata() -> Json {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked", "--manifest-path"])
        .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn rules() -> Table {
    include_str!("../deny.toml").parse().unwrap()
}

fn strings(list: &toml::Value) -> Vec<&str> {
    list.as_array().unwrap().iter().map(|entry| entry.as_str().unwrap()).collect()
}

/// Whether a licence expression can be met with these licences. Old manifests write `/` for OR.
fn is_met(expression: &str, allowed: &[&str]) -> bool {
    let expression = expression.replace('/', " OR ");
    let spaced = expression.replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut words = words.as_slice();
    let met = any(&mut words, allowed);
    assert!(words.is_empty(), "{expression:?} is no expression of licences");
    met
}

fn any(words: &mut &[&str], allowed: &[&str]) -> bool {
    let mut met = all(words, allowed);
    while let ["OR", rest @ ..] = *words {
        *words = rest;
        met |= all(words, allowed);
    }
    met
}

fn all(words: &mut &[&str], allowed: &[&str]) -> bool {
    let mut met = one(words, allowed);
    while let ["AND", rest @ ..] = *words {
        *words = rest;
        met &= one(words, allowed);
    }
    met
}

fn one(words: &mut &[&str], allowed: &[&str]) -> bool {
    match *words {
        ["(", rest @ ..] => {
            *words = rest;
            let met = any(words, allowed);
            let [")", rest @ ..] = *words else { panic!("no closing bracket") };
            *words = rest;
            met
        }
        [licence, "WITH", exception, rest @ ..] => {
            *words = rest;
            allowed.contains(&format!("{licence} WITH {exception}").as_str())
        }
        [licence, rest @ ..] => {
            *words = rest;
            allowed.contains(licence)
        }
        [] => false,
    }
}

#[test]
fn spec_every_dependency_has_a_licence_that_is_allowed() {
    let rules = rules();
    let licences = rules["licenses"].as_table().unwrap();
    let allowed = strings(&licences["allow"]);
    let exceptions = licences["exceptions"].as_array().unwrap();
    let metadata = metadata();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 100, "{}", packages.len());
    let mut used = 0;
    for package in packages {
        let name = package["name"].as_str().unwrap();
        let expression = package["license"].as_str().unwrap_or_default();
        if is_met(expression, &allowed) {
            continue;
        }
        let exception = exceptions.iter().find(|exception| exception["crate"].as_str() == Some(name));
        let met = exception.is_some_and(|exception| is_met(expression, &strings(&exception["allow"])));
        assert!(met, "{name} is under {expression:?}, which deny.toml does not allow");
        used += 1;
    }
    assert_eq!(used, exceptions.len(), "an exception that nobody needs");
}

#[test]
fn spec_every_dependency_is_of_the_registry_and_of_a_version_that_is_said() {
    for package in metadata()["packages"].as_array().unwrap() {
        let name = &package["name"];
        let source = package["source"].as_str();
        assert!(source.is_none_or(|source| source.starts_with("registry+")), "{name} is from {source:?}");
        if source.is_some() {
            continue;
        }
        for dependency in package["dependencies"].as_array().unwrap() {
            let asked = dependency["req"].as_str().unwrap();
            assert!(
                asked != "*" || dependency["path"].is_string(),
                "{name} takes any {}",
                dependency["name"]
            );
        }
    }
}

#[test]
fn spec_expressions_of_licences_are_read_as_spdx_means_them() {
    let allowed = ["MIT", "Unicode-3.0", "Apache-2.0 WITH LLVM-exception"];
    for (expression, met) in [
        ("MIT", true),
        ("GPL-3.0-only", false),
        ("MIT OR GPL-3.0-only", true),
        ("MIT/Apache-2.0", true),
        ("MIT AND GPL-3.0-only", false),
        // AND binds closer.
        ("MIT OR Apache-2.0 AND GPL-3.0-only", true),
        ("(MIT OR Apache-2.0) AND Unicode-3.0", true),
        ("(GPL-2.0 OR Apache-2.0) AND Unicode-3.0", false),
        ("Apache-2.0 WITH LLVM-exception OR GPL-2.0", true),
        ("Apache-2.0", false),
        ("", false),
    ] {
        assert_eq!(is_met(expression, &allowed), met, "{expression}");
    }
}
