//! The `veilwing` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    veilwing::cli::main()
}
