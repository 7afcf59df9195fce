//! What stands for a kill line in simulation: a word a datagram, to whoever simulates the hardware behind it.

use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;

use crate::radio_device::Line;
use crate::radio_device::gpio::LineError;
use crate::radio_host::Level;

/// See the module.
#[derive(Debug)]
struct SimulatedLine {
    socket: UdpSocket,
    to: SocketAddr,
}

/// Driven off.
///
/// # Errors
/// It is not on this machine, or cannot be had; in words.
pub(super) fn open(to: SocketAddr) -> Result<Box<dyn Line>, String> {
    if !to.ip().is_loopback() {
        return Err(format!("--simulated-line {to}: give an address of this machine's own"));
    }
    let socket =
        UdpSocket::bind(("127.0.0.1", 0)).map_err(|error| format!("--simulated-line {to}: {error}"))?;
    socket.set_nonblocking(true).map_err(|error| format!("--simulated-line {to}: {error}"))?;
    let mut line = SimulatedLine { socket, to };
    line.drive(Level::Off).map_err(|error| error.to_string())?;
    Ok(Box::new(line))
}

impl Line for SimulatedLine {
    fn drive(&mut self, level: Level) -> Result<(), LineError> {
        let word: &[u8] = match level {
            Level::Off => b"off",
            Level::On => b"on",
        };
        self.socket.send_to(word, self.to).map(|_| ()).map_err(|error| LineError::Kernel {
            chip: PathBuf::from(self.to.to_string()),
            line: "simulated".to_owned(),
            why: error.to_string(),
        })
    }
}
