//! Lines of text to and from a device, over telnet (TCP) or a serial line.

use std::io;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::TcpStream;

use super::{DeviceError, MOST_BYTES};
use crate::link::LinkAddress;

/// A stream of bytes in both directions.
trait Wire: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<S: AsyncRead + AsyncWrite + Send + Sync + Unpin> Wire for S {}

/// A conversation. It ends with the order that it is for, unless that succeeded.
pub(super) struct Lines {
    wire: Box<dyn Wire>,
    /// Options are negotiated in the stream (RFC 854).
    telnet: bool,
    /// What was read and not taken yet, negotiation aside.
    text: Vec<u8>,
    /// An option under negotiation: what of its three bytes has come.
    option: Vec<u8>,
    read_bytes: usize,
}

impl std::fmt::Debug for Lines {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Lines").field("telnet", &self.telnet).finish_non_exhaustive()
    }
}

/// Interpret as command (RFC 854), and what asks or offers, and what refuses.
const IAC: u8 = 255;
const DONT: u8 = 254;
const DO: u8 = 253;
const WONT: u8 = 252;
const WILL: u8 = 251;

impl Lines {
    /// Connects, or opens the port.
    pub async fn open(address: &LinkAddress) -> Result<Self, DeviceError> {
        let (wire, telnet): (Box<dyn Wire>, bool) = match address {
            LinkAddress::TcpOut(to) => {
                let stream = TcpStream::connect((to.host.as_str(), to.port)).await?;
                stream.set_nodelay(true)?;
                (Box::new(stream), true)
            }
            LinkAddress::Serial { path, baud } => (serial(path, *baud)?, false),
            other => return Err(io::Error::new(io::ErrorKind::InvalidInput, other.to_string()).into()),
        };
        Ok(Self { wire, telnet, text: Vec::new(), option: Vec::new(), read_bytes: 0 })
    }

    /// A new question: what was said before does not belong to its answer.
    pub async fn ask(&mut self, line: &str, end: &str) -> Result<(), DeviceError> {
        self.text.clear();
        self.read_bytes = 0;
        self.wire.write_all(format!("{line}{end}").as_bytes()).await?;
        Ok(self.wire.flush().await?)
    }

    /// The next line that says anything, without its end.
    pub async fn line(&mut self) -> Result<String, DeviceError> {
        loop {
            if let Some(end) = self.text.iter().position(|byte| matches!(byte, b'\n' | b'\r' | 0)) {
                let line: Vec<u8> = self.text.drain(..=end).collect();
                let line = String::from_utf8_lossy(&line[..end]).trim().to_owned();
                if !line.is_empty() {
                    return Ok(line);
                }
            } else {
                self.read_more().await?;
            }
        }
    }

    /// Reads until one of these is there, at the end of a line or not; which one.
    pub async fn until(&mut self, marks: &[&str]) -> Result<usize, DeviceError> {
        loop {
            let text = String::from_utf8_lossy(&self.text);
            if let Some(which) = marks.iter().position(|mark| text.contains(mark)) {
                self.text.clear();
                return Ok(which);
            }
            self.read_more().await?;
        }
    }

    async fn read_more(&mut self) -> Result<(), DeviceError> {
        let mut buffer = [0; 2048];
        let length = self.wire.read(&mut buffer).await?;
        if length == 0 {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        self.read_bytes += length;
        if self.read_bytes > MOST_BYTES {
            return Err(DeviceError::TooMuch);
        }
        let mut replies = Vec::new();
        for byte in &buffer[..length] {
            self.take(*byte, &mut replies);
        }
        if !replies.is_empty() {
            self.wire.write_all(&replies).await?;
        }
        Ok(())
    }

    /// Text is kept; every option is refused, which leaves a plain line of text.
    fn take(&mut self, byte: u8, replies: &mut Vec<u8>) {
        match (self.option.as_slice(), byte) {
            ([], IAC) if self.telnet => self.option.push(byte),
            ([], _) => self.text.push(byte),
            ([_], DO | DONT | WILL | WONT) => self.option.push(byte),
            ([_], IAC) => {
                self.text.push(IAC);
                self.option.clear();
            }
            ([_, DO], option) => {
                replies.extend([IAC, WONT, option]);
                self.option.clear();
            }
            ([_, WILL], option) => {
                replies.extend([IAC, DONT, option]);
                self.option.clear();
            }
            _ => self.option.clear(),
        }
    }
}

#[cfg(feature = "serial")]
fn serial(path: &str, baud: u32) -> io::Result<Box<dyn Wire>> {
    use tokio_serial::SerialPortBuilderExt;
    Ok(Box::new(tokio_serial::new(path, baud).open_native_async()?))
}

#[cfg(not(feature = "serial"))]
fn serial(_: &str, _: u32) -> io::Result<Box<dyn Wire>> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "this build has no serial ports (feature `serial`)"))
}
