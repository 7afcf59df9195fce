//! `veilwing ground-station`: buttons for the orders to the companions, in ground stations that others wrote.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Exit, print_text};
use crate::config::file::write_whole;

/// QGroundControl's, and MAVProxy's.
const ACTIONS: &str = include_str!("../../ground_station/veilwing.json");
const MODULE: &str = include_str!("../../ground_station/mavproxy_veilwing.py");
const ACTIONS_NAME: &str = "veilwing.json";
const MODULE_NAME: &str = "mavproxy_veilwing.py";
/// In every version of a file of ours, and in nobody else's by chance.
const OURS: [&str; 2] = ["\"Veilwing start\"", "MAVProxy module of veilwing"];

const EXAMPLES: &str = "Examples:
  veilwing ground-station install
      where QGroundControl and MAVProxy look, as far as they are on this computer
  veilwing ground-station install --dir buttons
      both files there, to be copied by hand (docs/ground-station.md)";

/// Buttons for start, pause, continue, return and kill in QGroundControl and MAVProxy.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Args {
    #[command(subcommand)]
    command: Task,
}

#[derive(Debug, clap::Subcommand)]
enum Task {
    /// Write QGroundControl's actions and MAVProxy's module where these look for them.
    #[command(after_help = EXAMPLES)]
    Install(Install),
}

#[derive(Debug, clap::Args)]
struct Install {
    /// Write both files into this directory instead.
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
    /// Replace files of these names that this command did not write.
    #[arg(long)]
    overwrite: bool,
}

pub(super) fn run(args: &Args) -> Exit {
    let Task::Install(install) = &args.command;
    match self::install(install) {
        Ok(said) => print_text(&said),
        Err(message) => {
            eprintln!("error: {message}");
            Exit::Unusable
        }
    }
}

fn install(args: &Install) -> Result<String, String> {
    if let Some(directory) = &args.dir {
        std::fs::create_dir_all(directory)
            .map_err(|error| format!("cannot make {}: {error}", directory.display()))?;
        let actions = put(&directory.join(ACTIONS_NAME), ACTIONS, OURS[0], args.overwrite)?;
        let module = put(&directory.join(MODULE_NAME), MODULE, OURS[1], args.overwrite)?;
        return Ok(format!("{actions}{module}docs/ground-station.md says where they belong\n"));
    }
    let home = std::env::var_os("HOME").filter(|home| !home.is_empty()).map(PathBuf::from);
    let mut said = String::new();
    let mut found = 0;
    let stations = home.iter().flat_map(|home| actions_directories(home));
    for directory in stations {
        found += 1;
        said += &put(&directory.join(ACTIONS_NAME), ACTIONS, OURS[0], args.overwrite)?;
        said += "  QGroundControl: choose veilwing.json in Application Settings, Fly View, MAVLink Actions; the buttons are\n  under Actions in the Fly View's tool strip\n";
    }
    if let Some(directory) = modules_directory() {
        found += 1;
        said += &put(&directory.join(MODULE_NAME), MODULE, OURS[1], args.overwrite)?;
        said += "  MAVProxy: `module load veilwing` at its prompt, or as a line of ~/.mavinit.scr\n";
    }
    if found == 0 {
        return Err("neither QGroundControl's directory (Documents/QGroundControl) nor MAVProxy (mavproxy.py) is found: start QGroundControl once, or give --dir and copy by hand (docs/ground-station.md)".into());
    }
    Ok(said)
}

/// Where QGroundControl keeps actions: below its directory in the user's documents, that of its daily builds likewise.
fn actions_directories(home: &Path) -> Vec<PathBuf> {
    let names = ["QGroundControl", "QGroundControl Daily"];
    let roots = names.into_iter().flat_map(|name| [home.join("Documents").join(name), home.join(name)]);
    roots.filter(|root| root.is_dir()).map(|root| root.join("MavlinkActions")).collect()
}

/// Where the MAVProxy of this user's path has its modules, by its own interpreter's word.
fn modules_directory() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let program =
        std::env::split_paths(&path).map(|directory| directory.join("mavproxy.py")).find(|p| p.is_file())?;
    let script = std::fs::read_to_string(&program).ok()?;
    let named = script.lines().next().and_then(|line| line.strip_prefix("#!")).map(str::trim);
    let mut words = named.filter(|line| line.contains("python")).unwrap_or("python3").split_whitespace();
    let interpreter = words.next()?;
    let output = Command::new(interpreter)
        .args(words)
        .args(["-c", "import os, MAVProxy.modules as m; print(os.path.dirname(os.path.abspath(m.__file__)))"])
        .output()
        .ok()?;
    let directory = PathBuf::from(String::from_utf8(output.stdout).ok()?.trim());
    directory.is_dir().then_some(directory)
}

/// Writes a file, unless somebody else's is there; what was done, in a line.
fn put(path: &Path, text: &str, ours: &str, overwrite: bool) -> Result<String, String> {
    let shown = path.display();
    let there = match std::fs::read_to_string(path) {
        Ok(there) => Some(there),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        // What is no text was not written here.
        Err(_) => Some(String::new()),
    };
    let word = match there {
        Some(there) if there == text => return Ok(format!("{shown}: is as it should be\n")),
        Some(there) if !there.contains(ours) && !overwrite => {
            return Err(format!(
                "{shown} is there, and was not written by this command: move it away, or give --overwrite"
            ));
        }
        Some(_) => "replaced",
        None => "written",
    };
    if let Some(directory) = path.parent() {
        std::fs::create_dir_all(directory)
            .map_err(|error| format!("cannot make {}: {error}", directory.display()))?;
    }
    write_whole(path, text)?;
    Ok(format!("{shown}: {word}\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// QGroundControl's reader of such a file asks for these, and sends what it finds to the vehicle that is active.
    #[test]
    fn spec_the_actions_are_what_qgroundcontrol_reads_and_the_companion_obeys() {
        let file: serde_json::Value = serde_json::from_str(ACTIONS).unwrap();
        assert_eq!((file["fileType"].as_str(), file["version"].as_i64()), (Some("MavlinkActions"), Some(1)));
        let actions = file["actions"].as_array().unwrap();
        let read: Vec<(u64, u64, f64)> = actions
            .iter()
            .map(|action| {
                assert!(action["label"].is_string() && action["description"].is_string(), "{action}");
                let param1 = action["param1"].as_f64().unwrap_or(0.0);
                (action["mavCmd"].as_u64().unwrap(), action["compId"].as_u64().unwrap(), param1)
            })
            .collect();
        let orders = [(300, 0.0), (193, 0.0), (193, 1.0), (20, 0.0), (31011, 0.0), (31011, 1.0)];
        assert_eq!(read, orders.map(|(command, param1)| (command, 191, param1)));
        assert!(ACTIONS.contains(OURS[0]) && MODULE.contains(OURS[1]));
    }

    #[test]
    fn spec_a_file_of_somebody_else_is_left_alone_unless_told() {
        let directory = std::env::temp_dir().join(format!("veilwing-buttons-{}", std::process::id()));
        std::fs::create_dir_all(&directory).unwrap();
        let path = directory.join(ACTIONS_NAME);
        let install = |overwrite| self::install(&Install { dir: Some(directory.clone()), overwrite });
        assert!(install(false).unwrap().contains("veilwing.json: written"));
        assert!(install(false).unwrap().contains("veilwing.json: is as it should be"));
        std::fs::write(&path, ACTIONS.replace("Pause", "An older word")).unwrap();
        assert!(install(false).unwrap().contains("veilwing.json: replaced"));
        std::fs::write(&path, "{}").unwrap();
        assert!(install(false).unwrap_err().contains("--overwrite"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "{}");
        assert!(install(true).unwrap().contains("veilwing.json: replaced"));
        std::fs::remove_dir_all(&directory).unwrap();
    }
}
