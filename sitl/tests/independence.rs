//! The second opinion stays one: nothing of the main crate in here.

#![allow(clippy::unwrap_used)] // A test: it may fail by panicking.

use std::path::Path;

fn sources(folder: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

#[test]
fn spec_the_main_crate_is_neither_a_dependency_nor_named() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifest = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
    assert!(!manifest.lines().any(|l| l.split(['.', '=', ' ']).next() == Some("veilwing")), "{manifest}");
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    assert!(files.len() > 20);
    let main = ["veilwing", "::"].concat();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(!text.contains(&main), "{} imports the main crate", file.display());
    }
}
