//! The fake devices' servers: lines over TCP or on a serial line, one HTTP request a connection, or MAVLink.

use std::sync::Arc;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UdpSocket};

use super::bench::Bench;
use super::kind::{Kind, Speech};
use super::parameter;

/// More than this in one request is none of a host's.
const MOST_BYTES: usize = 16 * 1024;

/// Where a device is spoken to.
#[derive(Debug)]
pub(super) enum Socket {
    Tcp(TcpListener),
    Udp(UdpSocket),
    #[cfg(feature = "serial")]
    Serial {
        device: tokio_serial::SerialStream,
        /// Held, so that the line stays when a host has gone.
        _host: tokio_serial::SerialStream,
    },
}

impl Socket {
    /// A new one, and the address that a radio file has for it.
    ///
    /// # Errors
    /// It cannot be had; in words.
    pub async fn open(speech: Speech) -> Result<(Self, String), String> {
        let failed = |error: std::io::Error| format!("loopback: {error}");
        let loopback = ("127.0.0.1", 0);
        match speech {
            Speech::Words | Speech::Lines | Speech::Http => {
                let listener = TcpListener::bind(loopback).await.map_err(failed)?;
                let address = listener.local_addr().map_err(failed)?;
                Ok((Self::Tcp(listener), format!("tcpout:{address}")))
            }
            Speech::Mavlink => {
                let socket = UdpSocket::bind(loopback).await.map_err(failed)?;
                let address = socket.local_addr().map_err(failed)?;
                Ok((Self::Udp(socket), format!("udpout:{address}")))
            }
            Speech::Serial => Self::serial(),
        }
    }

    #[cfg(feature = "serial")]
    fn serial() -> Result<(Self, String), String> {
        use tokio_serial::SerialPort;
        let failed = |error: tokio_serial::Error| format!("a pseudo-terminal: {error}");
        let (device, host) = tokio_serial::SerialStream::pair().map_err(failed)?;
        let path = host.name().ok_or("a pseudo-terminal has no name")?;
        Ok((Self::Serial { device, _host: host }, format!("serial:{path}:115200")))
    }

    #[cfg(not(feature = "serial"))]
    fn serial() -> Result<(Self, String), String> {
        Err("this build has no serial lines: build it with the feature `serial`".to_owned())
    }
}

/// Serves until the device dies: connections end then, and none is taken.
pub(super) async fn serve(socket: Socket, bench: Arc<Bench>) {
    let served = async {
        match socket {
            Socket::Tcp(listener) => {
                while let Ok((stream, _)) = listener.accept().await {
                    // Loopback without it waits for more as well.
                    let _ = stream.set_nodelay(true);
                    tokio::spawn(until_dead(stream, Arc::clone(&bench)));
                }
            }
            Socket::Udp(socket) => parameter::serve(&socket, &bench).await,
            #[cfg(feature = "serial")]
            Socket::Serial { mut device, _host } => while lines(&mut device, &bench).await.is_some() {},
        }
    };
    tokio::select! {
        () = bench.died() => {}
        () = served => {}
    }
}

/// Takes what a simulated kill line is driven to: one word a datagram.
pub(super) async fn serve_line(socket: UdpSocket, bench: Arc<Bench>) {
    let mut word = [0; 8];
    while let Ok(length) = socket.recv(&mut word).await {
        bench.drive(&word[..length] == b"on");
    }
}

async fn until_dead(mut stream: TcpStream, bench: Arc<Bench>) {
    let served = async {
        match bench.kind().speech() {
            Speech::Http => http(&mut stream, &bench).await,
            _ => lines(&mut stream, &bench).await,
        }
    };
    tokio::select! {
        () = bench.died() => {}
        _ = served => {}
    }
}

/// `None`: the conversation is over.
async fn lines(stream: &mut (impl AsyncRead + AsyncWrite + Unpin), bench: &Bench) -> Option<()> {
    let mut text = Vec::new();
    loop {
        while let Some(end) = text.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = text.drain(..=end).collect();
            let line = String::from_utf8_lossy(&line).trim().to_owned();
            let answer = bench.answer(&line).await.ok()?;
            let echoes = matches!(bench.kind(), Kind::At | Kind::AtSerial);
            let echo = if echoes { format!("{line}\r\n") } else { String::new() };
            stream.write_all(format!("{echo}{answer}\r\n").as_bytes()).await.ok()?;
        }
        more(stream, &mut text).await?;
    }
}

/// What is asked for is the body, or, where there is none, the path.
async fn http(stream: &mut TcpStream, bench: &Bench) -> Option<()> {
    let mut bytes = Vec::new();
    let asked = loop {
        let text = String::from_utf8_lossy(&bytes);
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let length = head.lines().find_map(|line| line.strip_prefix("Content-Length: ")?.parse().ok());
            match length.unwrap_or(0_usize) {
                0 => break head.split(' ').nth(1)?.to_owned(),
                length if body.len() >= length => break body.to_owned(),
                _ => {}
            }
        }
        more(stream, &mut bytes).await?;
    };
    let body = bench.answer(&asked).await.ok()?;
    let answer = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{body}", body.len());
    stream.write_all(answer.as_bytes()).await.ok()
}

async fn more(stream: &mut (impl AsyncRead + Unpin), bytes: &mut Vec<u8>) -> Option<()> {
    let mut buffer = [0; 2048];
    let length = stream.read(&mut buffer).await.ok().filter(|length| *length > 0)?;
    bytes.extend_from_slice(&buffer[..length]);
    (bytes.len() <= MOST_BYTES).then_some(())
}
