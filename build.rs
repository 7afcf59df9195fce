//! Generates the private dialects' Rust code from `message_definitions/`: the pair link's and the radio's. Says what
//! `--version` shows.

use std::process::Command;

fn main() {
    version();
    println!("cargo:rerun-if-changed=message_definitions");
    #[cfg(feature = "companion")]
    generate();
}

/// The version with commit and target: the commit from the environment (`VEILWING_COMMIT`), or of a release build from git.
/// Where neither is there, the target alone, so that the same sources give the same program.
///
/// Git is not asked for a debug build: each commit would build everything anew for the tests.
fn version() {
    println!("cargo:rerun-if-env-changed=VEILWING_COMMIT");
    let variable = |name| std::env::var(name).ok().filter(|value| !value.is_empty());
    let is_release = variable("PROFILE").as_deref() == Some("release");
    let commit = variable("VEILWING_COMMIT").or_else(|| is_release.then(commit_of_git).flatten());
    let target = variable("TARGET").unwrap_or_default();
    let built = commit.map_or(target.clone(), |commit| format!("{commit}, {target}"));
    println!(
        "cargo:rustc-env=VEILWING_VERSION={} ({built})",
        variable("CARGO_PKG_VERSION").unwrap_or_default()
    );
}

fn commit_of_git() -> Option<String> {
    let git = |arguments: &[&str]| {
        let output =
            Command::new("git").args(arguments).output().ok().filter(|output| output.status.success());
        output.and_then(|output| String::from_utf8(output.stdout).ok()).map(|text| text.trim().to_owned())
    };
    // Of this tree, and not of one that it lies in without being part of it.
    git(&["ls-files", "--error-unmatch", "build.rs"])?;
    let log = git(&["rev-parse", "--git-path", "logs/HEAD"])?;
    if std::path::Path::new(&log).exists() {
        println!("cargo:rerun-if-changed={log}");
    }
    git(&["rev-parse", "--short=12", "HEAD"])
}

#[cfg(feature = "companion")]
fn generate() {
    // The generated mod.rs hides each dialect behind a feature of its name; ours are always wanted.
    println!("cargo:rustc-cfg=feature=\"dialect-veilwing\"");
    println!("cargo:rustc-cfg=feature=\"dialect-veilwing_radio\"");
    let out = std::path::PathBuf::from(std::env::var_os("OUT_DIR").unwrap_or_default());
    // Each in a directory of its own: every room includes its dialect alone.
    for (room, xml) in [("pair", "veilwing.xml"), ("transmitter", "veilwing_radio.xml")] {
        let path = format!("message_definitions/{xml}");
        let out = out.join(room);
        if let Err(error) = std::fs::create_dir_all(&out) {
            println!("cargo::error={}: {error}", out.display());
        }
        let xml = mavlink_bindgen::XmlDefinitions::Files(vec![path.as_str()]);
        if let Err(error) = mavlink_bindgen::generate(xml, &out) {
            println!("cargo::error={path}: {error}");
        }
    }
}
