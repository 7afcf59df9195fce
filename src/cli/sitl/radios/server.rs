//! The fake devices' servers: lines over TCP, or one HTTP request a connection.

use std::sync::Arc;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use super::bench::Bench;
use super::kind::Kind;

/// More than this in one request is none of a host's.
const MOST_BYTES: usize = 16 * 1024;

/// Serves until the device dies: connections end then, and none is taken.
pub(super) async fn serve(listener: TcpListener, bench: Arc<Bench>) {
    let taken = async {
        while let Ok((stream, _)) = listener.accept().await {
            // Loopback without it waits for more as well.
            let _ = stream.set_nodelay(true);
            tokio::spawn(until_dead(stream, Arc::clone(&bench)));
        }
    };
    tokio::select! {
        () = bench.died() => {}
        () = taken => {}
    }
}

async fn until_dead(mut stream: TcpStream, bench: Arc<Bench>) {
    let served = async {
        match bench.kind() {
            Kind::JsonRpc => http(&mut stream, &bench).await,
            Kind::Command | Kind::Attenuator | Kind::At => lines(&mut stream, &bench).await,
        }
    };
    tokio::select! {
        () = bench.died() => {}
        _ = served => {}
    }
}

/// `None`: the conversation is over.
async fn lines(stream: &mut TcpStream, bench: &Bench) -> Option<()> {
    let mut text = Vec::new();
    loop {
        while let Some(end) = text.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = text.drain(..=end).collect();
            let line = String::from_utf8_lossy(&line).trim().to_owned();
            let answer = bench.answer(&line).await.ok()?;
            let echo = if bench.kind() == Kind::At { format!("{line}\r\n") } else { String::new() };
            stream.write_all(format!("{echo}{answer}\r\n").as_bytes()).await.ok()?;
        }
        more(stream, &mut text).await?;
    }
}

async fn http(stream: &mut TcpStream, bench: &Bench) -> Option<()> {
    let mut bytes = Vec::new();
    let asked = loop {
        let text = String::from_utf8_lossy(&bytes);
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let length = head.lines().find_map(|line| line.strip_prefix("Content-Length: ")?.parse().ok());
            if body.len() >= length.unwrap_or(0_usize) {
                break body.to_owned();
            }
        }
        more(stream, &mut bytes).await?;
    };
    let body = bench.answer(&asked).await.ok()?;
    let answer = format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{body}", body.len());
    stream.write_all(answer.as_bytes()).await.ok()
}

async fn more(stream: &mut TcpStream, bytes: &mut Vec<u8>) -> Option<()> {
    let mut buffer = [0; 2048];
    let length = stream.read(&mut buffer).await.ok().filter(|length| *length > 0)?;
    bytes.extend_from_slice(&buffer[..length]);
    (bytes.len() <= MOST_BYTES).then_some(())
}
