//! `veilwing manuals`: manual pages and completions of this very build, for its package.

use std::io;
use std::path::{Path, PathBuf};

use clap::CommandFactory;
use clap_complete::Shell;

use super::{Cli, Exit};

/// The shells that are completed for.
const SHELLS: [Shell; 3] = [Shell::Bash, Shell::Zsh, Shell::Fish];

/// Write manual pages and shell completions into a directory.
#[derive(Debug, clap::Args)]
#[command(hide = true, after_help = "Example: veilwing manuals target/manuals")]
pub(super) struct Args {
    /// Directory to write into; made if it is not there.
    out: PathBuf,
}

pub(super) fn run(args: &Args) -> Exit {
    match write(&args.out) {
        Ok(()) => Exit::Done,
        Err(error) => {
            eprintln!("error: cannot write {}: {error}", args.out.display());
            Exit::Unusable
        }
    }
}

fn write(out: &Path) -> io::Result<()> {
    std::fs::create_dir_all(out)?;
    // Without commit and target: the same on every architecture.
    let command = || Cli::command().version(env!("CARGO_PKG_VERSION"));
    for shell in SHELLS {
        clap_complete::generate_to(shell, &mut command(), "veilwing", out)?;
    }
    clap_mangen::generate_to(command(), out)
}
