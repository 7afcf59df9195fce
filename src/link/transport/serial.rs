//! Serial ports.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use tokio::io::AsyncWrite;
use tokio_serial::{SerialPortBuilderExt, SerialStream};

use super::tcp::poll_read_stream;
use super::{Arrival, Origin, Transport};
use crate::time::Instant;

/// `serial:`: eight data bits, no parity, one stop bit, no flow control, as every autopilot has it.
pub struct Serial {
    stream: SerialStream,
}

impl Serial {
    /// Opens the device, for itself alone.
    pub fn open(path: &str, baud: u32) -> io::Result<Self> {
        Ok(Self { stream: tokio_serial::new(path, baud).open_native_async()? })
    }
}

impl Transport for Serial {
    fn poll_read(
        &mut self,
        cx: &mut Context<'_>,
        _: Instant,
        buffer: &mut [u8],
    ) -> Poll<io::Result<Arrival>> {
        let length = ready!(poll_read_stream(&mut self.stream, cx, buffer))?;
        Poll::Ready(Ok(Arrival::Bytes { origin: Origin::Peer, length, ends: false }))
    }

    fn poll_write(&mut self, cx: &mut Context<'_>, frame: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, frame)
    }
}
