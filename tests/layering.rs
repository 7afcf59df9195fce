//! The house rules that the compiler does not check: imports point down, only the clock reads a clock, the planner's
//! library stays free of what a ground computer does not need. A scan of the source text, comments and strings left out.

// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// From the ground up; what shares a row does not know each other.
const LAYERS: [&[&str]; 16] = [
    &["role", "time", "units", "durable"],
    // A pose knows its antenna's axis: `geo` uses `radio::pattern` and nothing else of it.
    &["geo", "radio"],
    &["planner"],
    &["schedule"],
    &["preflight", "reply"],
    &["pair", "autopilot", "transmitter"],
    &["service", "radio_host"],
    &["mission"],
    &["link", "systemd", "computer"],
    &["radio_device", "logbook"],
    &["config"],
    &["planning"],
    &["companion", "radio_loop"],
    &["desk"],
    &["bench"],
    &["cli"],
];
/// Everything the planner's library is made of.
const PLANNING: [&str; 7] = ["role", "time", "units", "geo", "radio", "planner", "schedule"];

fn level(module: &str) -> Option<usize> {
    LAYERS.iter().position(|row| row.contains(&module))
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Every Rust file below `directory`, by path.
fn sources(directory: &Path) -> BTreeSet<PathBuf> {
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.append(&mut sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.insert(path);
        }
    }
    found
}

/// The text without comments, and with the contents of strings and of character literals blanked.
fn code_of(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut code = String::new();
    let mut at = 0;
    let find = |from: usize, what: &str| text[from..].find(what).map_or(bytes.len(), |found| from + found);
    while at < bytes.len() {
        let rest = &text[at..];
        if rest.starts_with("//") {
            at = find(at, "\n");
        } else if rest.starts_with("/*") {
            at = end_of_block_comment(text, at);
        } else if let Some(hashes) = raw_string(text, at) {
            let close = format!("\"{}", "#".repeat(hashes));
            let open = at + 1 + hashes + 1;
            at = (find(open, &close) + close.len()).min(bytes.len());
            code.push_str("\"\"");
        } else if bytes[at] == b'"' {
            at = end_of_string(bytes, at + 1);
            code.push_str("\"\"");
        } else if let Some(length) = character_literal(rest) {
            at += length;
            code.push_str("' '");
        } else {
            let next = rest.chars().next().unwrap();
            code.push(next);
            at += next.len_utf8();
        }
    }
    code
}

fn end_of_block_comment(text: &str, start: usize) -> usize {
    let mut depth = 0;
    let mut at = start;
    while at < text.len() {
        if text[at..].starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if text[at..].starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
            if depth == 0 {
                return at;
            }
        } else {
            at += text[at..].chars().next().unwrap().len_utf8();
        }
    }
    at
}

/// The number of hashes, if a raw string begins here.
fn raw_string(text: &str, at: usize) -> Option<usize> {
    let in_a_word = text[..at].chars().next_back().is_some_and(|c| c.is_alphanumeric() || c == '_');
    let after = text[at..].strip_prefix('r').filter(|_| !in_a_word)?;
    let hashes = after.len() - after.trim_start_matches('#').len();
    after[hashes..].starts_with('"').then_some(hashes)
}

fn end_of_string(bytes: &[u8], mut at: usize) -> usize {
    while at < bytes.len() {
        match bytes[at] {
            b'\\' => at += 2,
            b'"' => return at + 1,
            _ => at += 1,
        }
    }
    bytes.len()
}

/// The length of a character literal, if one begins here; a lifetime is none.
fn character_literal(rest: &str) -> Option<usize> {
    let inside = rest.strip_prefix('\'')?;
    if inside.starts_with('\\') {
        return inside[2..].find('\'').map(|end| end + 4);
    }
    let character = inside.chars().next()?;
    inside[character.len_utf8()..].starts_with('\'').then(|| character.len_utf8() + 2)
}

/// The top-level modules that a file of top-level module `own`, `depth` modules deep, names through `crate::` or
/// enough `super::`.
fn imports(code: &str, own: &str, depth: usize) -> BTreeSet<String> {
    let flat: String =
        code.split_whitespace().collect::<Vec<_>>().join(" ").replace(" ::", "::").replace(":: ", "::");
    let to_the_root = "super::".repeat(depth);
    let mut found = BTreeSet::new();
    for anchor in ["crate::", to_the_root.as_str()].into_iter().filter(|anchor| !anchor.is_empty()) {
        for (at, _) in flat.match_indices(anchor) {
            let before = flat[..at].chars().next_back();
            // `$crate::`, `other_crate::`, or in the middle of a longer row of `super::`.
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':' || c == '$') {
                continue;
            }
            // In a file's inner module, tests say, the same row of `super::` ends one module lower, at the file's own
            // items: of those names only the modules' count. A crate has no items of its own beside its modules.
            let names = first_names(&flat[at + anchor.len()..]);
            found.extend(names.into_iter().filter(|name| anchor == "crate::" || level(name).is_some()));
        }
    }
    found.remove(own);
    found
}

/// The first path segment, or those of each branch of a braced list.
fn first_names(path: &str) -> Vec<String> {
    let word = |text: &str| -> String {
        text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let Some(list) = path.strip_prefix('{') else { return vec![word(path)] };
    let mut names = vec![word(list)];
    let mut depth = 0;
    for (at, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => names.push(word(&list[at + 1..])),
            _ => {}
        }
    }
    names.retain(|name| !name.is_empty());
    names
}

/// What is wrong with a file at `path` (from `src/`) with this text.
fn upward_imports(path: &str, text: &str) -> Vec<String> {
    let own = path.split('/').next().unwrap().trim_end_matches(".rs");
    if ["lib", "main"].contains(&own) {
        return Vec::new();
    }
    let Some(own_level) = level(own) else { return vec![format!("{path}: module {own} has no layer")] };
    let depth = path.split('/').count() - usize::from(path.ends_with("/mod.rs"));
    let code = code_of(text);
    let wrong = |name: &String| match level(name) {
        None => Some(format!("{path}: imports {name}, which has no layer")),
        Some(_) if own == "geo" && name == "radio" && !code.contains("radio::{") => {
            let others = code.matches("radio::").count() != code.matches("radio::pattern").count();
            others.then(|| format!("{path}: geo uses more of radio than its pattern"))
        }
        Some(_) if own == "radio" && name == "geo" => None,
        Some(other) if other >= own_level => {
            Some(format!("{path}: {own} imports {name}, which is not below it"))
        }
        Some(_) => None,
    };
    imports(&code, own, depth).iter().filter_map(wrong).collect()
}

fn in_src() -> Vec<(String, String)> {
    let src = root().join("src");
    let named = |path: &PathBuf| path.strip_prefix(&src).unwrap().to_str().unwrap().to_owned();
    sources(&src).iter().map(|path| (named(path), std::fs::read_to_string(path).unwrap())).collect()
}

#[test]
fn spec_imports_point_down() {
    let files = in_src();
    assert!(files.len() > 80, "only {} files were looked at", files.len());
    let wrong: Vec<String> = files.iter().flat_map(|(path, text)| upward_imports(path, text)).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn spec_the_checker_catches_a_planted_upward_import() {
    let planted = [
        ("planner/model.rs", "use crate::mission::Executive;", true),
        ("planner/model.rs", "fn f() { crate :: link::clock::Clock::real(); }", true),
        ("planner/model.rs", "use crate::{geo::Pose, schedule::{table::Table, route}};", true),
        ("planner/solver/mod.rs", "use super::super::pair::Coordinator;", true),
        ("planner/solver/newton.rs", "use super::super::super::config::Mission;", true),
        ("pair/lease.rs", "use crate::autopilot::Autopilot;", true),
        ("transmitter/mod.rs", "use crate::pair::wire;", true),
        ("mission/slot.rs", "use crate::config::Mission;", true),
        ("preflight.rs", "use crate::autopilot::Event;", true),
        ("geo.rs", "use crate::radio::secrecy::rate;", true),
        ("somewhere.rs", "", true),
        ("geo.rs", "use crate::radio::pattern::antenna_axis;", false),
        (
            "mission/slot.rs",
            "use crate::pair::wire; use super::flight::Phase; use crate::{role::Role, time::Instant};",
            false,
        ),
        (
            "planner/model.rs",
            "// use crate::mission::Executive;\n/* crate::cli /* crate::link */ */ use crate::geo::Pose;",
            false,
        ),
        (
            "planner/model.rs",
            r##"const S: &str = "crate::cli"; const T: &str = r#"crate::link"#; const C: char = '"';"##,
            false,
        ),
        ("planner/solver/newton.rs", "use super::super::problem::Problem;", false),
        ("schedule/table.rs", "macro_rules! m { () => { $crate::cli::run() } }", false),
    ];
    for (path, text, caught) in planted {
        assert_eq!(!upward_imports(path, text).is_empty(), caught, "{path}: {text}");
    }
}

#[test]
fn spec_only_the_link_clock_reads_a_clock() {
    let clocks = ["std::time::Instant", "SystemTime", "tokio::time", "clock_gettime", "Instant::now("];
    let read = |code: &str| clocks.iter().find(|clock| code.contains(**clock)).copied();
    for (path, text) in in_src() {
        // The simulated flight's host paces its steps by tokio's timer, and its lockstep gives up companions that hang; the
        // time itself they take from the clock.
        let allowed = ["link/clock.rs", "cli/sitl/host.rs", "cli/sitl/lockstep.rs"].contains(&path.as_str())
            || path.starts_with("link/transport");
        let code = code_of(&text);
        assert!(allowed || read(&code).is_none(), "{path} reads {:?}", read(&code));
    }
    assert!(read("let now = std::time::Instant::now();").is_some());
}

#[test]
fn spec_planning_knows_no_wire_no_runtime_and_no_file_format() {
    for (path, text) in in_src() {
        let own = path.split('/').next().unwrap().trim_end_matches(".rs");
        let code = code_of(&text);
        for foreign in ["mavlink", "tokio", "toml"] {
            let named = code.contains(&format!("{foreign}::")) || code.contains(&format!("use {foreign}"));
            assert!(!(PLANNING.contains(&own) && named), "{path} mentions {foreign}");
        }
    }
}

#[test]
fn spec_the_simulated_world_never_mentions_the_main_crate() {
    let files = sources(&root().join("sitl"));
    assert!(files.len() > 10);
    for path in files {
        let code = code_of(&std::fs::read_to_string(&path).unwrap());
        assert!(!code.contains("veilwing::") && !code.contains("use veilwing;"), "{}", path.display());
    }
    let manifest = std::fs::read_to_string(root().join("sitl/Cargo.toml")).unwrap();
    let depends = |line: &str| line.split(['=', '.', ' ']).next() == Some("veilwing");
    assert!(!manifest.lines().any(depends), "{manifest}");
}

/// The packages that the library and the program are built of.
fn packages(more: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args([
            "tree",
            "--edges",
            "normal",
            "--prefix",
            "none",
            "--locked",
            "--offline",
            "--package",
            "veilwing",
        ])
        .args(more)
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect()
}

#[test]
fn spec_the_planner_library_has_no_tokio_mavlink_or_toml() {
    let (library, program) = (packages(&["--no-default-features"]), packages(&[]));
    for foreign in ["tokio", "mavlink", "mavlink-core", "toml", "veilwing-sitl"] {
        assert!(!library.contains(foreign), "{foreign} in {library:?}");
        assert!(program.contains(foreign), "{foreign} is not even in the program: {program:?}");
    }
    assert!(library.contains("nalgebra"));
}

#[test]
fn spec_the_onboard_build_has_no_desk() {
    let onboard = packages(&["--no-default-features", "--features", "companion,serial"]);
    let program = packages(&[]);
    for foreign in ["veilwing-sitl", "csv"] {
        assert!(!onboard.contains(foreign), "{foreign} in {onboard:?}");
        assert!(program.contains(foreign), "{foreign} is not even in the program: {program:?}");
    }
    assert!(onboard.contains("mavlink"));
    // No file below it names the desk, and the desk itself is behind its feature.
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    assert!(lib.contains("#[cfg(feature = \"desk\")]\npub mod desk;"), "{lib}");
}
