//! As much of HTTP as a radio's control page needs: one request a connection, HTTP/1.0, so that the answer is neither chunked
//! nor kept open.

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use super::{DeviceError, MOST_BYTES};
use crate::link::HostPort;

/// The body of the answer to a GET, or to a POST of JSON.
pub(super) async fn request(to: &HostPort, path: &str, json: Option<&str>) -> Result<String, DeviceError> {
    let mut stream = TcpStream::connect((to.host.as_str(), to.port)).await?;
    stream.set_nodelay(true)?;
    let head = match json {
        None => format!("GET {path} HTTP/1.0\r\nHost: {}\r\n\r\n", to.host),
        Some(body) => format!(
            "POST {path} HTTP/1.0\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
            to.host,
            body.len()
        ),
    };
    stream.write_all(head.as_bytes()).await?;
    let mut bytes = Vec::new();
    let mut buffer = [0; 4096];
    while !is_complete(&bytes) {
        match stream.read(&mut buffer).await? {
            0 => break,
            length => bytes.extend_from_slice(&buffer[..length]),
        }
        if bytes.len() > MOST_BYTES {
            return Err(DeviceError::TooMuch);
        }
    }
    body(&String::from_utf8_lossy(&bytes))
}

/// Whether head and body are there: some servers keep the connection open though they were asked not to.
fn is_complete(bytes: &[u8]) -> bool {
    let Some(head) = bytes.windows(4).position(|window| window == b"\r\n\r\n") else { return false };
    let text = String::from_utf8_lossy(&bytes[..head]);
    let length = text.lines().find_map(|line| {
        let (name, value) = line.split_once(':')?;
        name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse::<usize>().ok())?
    });
    length.is_some_and(|length| bytes.len() - head - 4 >= length)
}

/// The body of an answer whose status is 200. Simple servers answer a GET with the text alone.
fn body(answer: &str) -> Result<String, DeviceError> {
    if !answer.starts_with("HTTP/") {
        return if answer.is_empty() { Err(DeviceError::garbled("")) } else { Ok(answer.to_owned()) };
    }
    let Some((head, body)) = answer.split_once("\r\n\r\n") else { return Err(DeviceError::garbled(answer)) };
    let status = head.split(' ').nth(1).unwrap_or_default();
    if status == "200" {
        Ok(body.to_owned())
    } else {
        Err(DeviceError::refused(&format!("HTTP status {status}: {body}")))
    }
}
