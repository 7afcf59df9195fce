//! `veilwing radio-device`: the program by which a radio file of kind "command" drives a fake device of `veilwing sitl`.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use crate::cli::{Exit, print_text};

/// Whatever becomes of the device, this program ends: longer than any host waits.
const PATIENCE: Duration = Duration::from_secs(20);

/// Tell a fake device of a simulated flight something, and print what it answers.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example: veilwing radio-device 127.0.0.1:40000 set 20")]
pub(in crate::cli) struct Args {
    /// Where it is.
    device: SocketAddr,
    /// What it is told: set and a setting, on, off, read, or state.
    #[arg(required = true, allow_negative_numbers = true)]
    words: Vec<String>,
}

pub(in crate::cli) fn run(args: &Args) -> Exit {
    match ask(args) {
        Ok(answer) if answer == "refused" => {
            eprintln!("error: the device refuses");
            Exit::Bad
        }
        Ok(answer) => print_text(&format!("{answer}\n")),
        Err(error) => {
            eprintln!("error: {}: {error}", args.device);
            Exit::Bad
        }
    }
}

fn ask(args: &Args) -> std::io::Result<String> {
    let mut stream = TcpStream::connect_timeout(&args.device, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.write_all(format!("{}\n", args.words.join(" ")).as_bytes())?;
    let mut answer = String::new();
    if BufReader::new(stream).read_line(&mut answer)? == 0 {
        return Err(std::io::ErrorKind::UnexpectedEof.into());
    }
    Ok(answer.trim().to_owned())
}
