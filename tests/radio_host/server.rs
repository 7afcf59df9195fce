//! Devices that are spoken to over TCP, line by line or by HTTP.

use std::sync::{Arc, Mutex};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use veilwing::link::{HostPort, LinkAddress};

/// What a device does when it is asked.
#[derive(Debug, Clone)]
pub enum Reply {
    Text(String),
    /// Nothing, ever; the connection stays.
    Hang,
    /// So much, and then the connection ends.
    Cut(String),
    /// 10 MB.
    Flood,
}

/// What is asked for, as the device sees it: a line; or, by HTTP, the body, or without one the path.
pub type Handler = Box<dyn FnMut(&str) -> Reply + Send>;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    Lines,
    Http,
}

/// Serves until the runtime ends. Where it is.
pub async fn serve(form: Form, greeting: &'static [u8], handler: Handler) -> HostPort {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    let handler = Arc::new(Mutex::new(handler));
    tokio::spawn(async move {
        loop {
            let (mut stream, _) = listener.accept().await.unwrap();
            let handler = Arc::clone(&handler);
            tokio::spawn(async move {
                let _ = stream.write_all(greeting).await;
                match form {
                    Form::Lines => lines(stream, &handler).await,
                    Form::Http => http(stream, &handler).await,
                }
            });
        }
    });
    HostPort { host: "127.0.0.1".to_owned(), port }
}

pub fn tcp(to: &HostPort) -> LinkAddress {
    LinkAddress::TcpOut(to.clone())
}

async fn lines(mut stream: TcpStream, handler: &Mutex<Handler>) {
    let mut text = Vec::new();
    let mut buffer = [0; 512];
    loop {
        while let Some(end) = text.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = text.drain(..=end).collect();
            // What refuses a telnet option is no line.
            let line: Vec<u8> = line.into_iter().filter(u8::is_ascii).collect();
            let line = String::from_utf8(line).unwrap();
            let line: String = line.chars().filter(|c| !c.is_control()).collect();
            let reply = (handler.lock().unwrap())(&line);
            if !act(&mut stream, reply).await {
                return;
            }
        }
        match stream.read(&mut buffer).await {
            Ok(0) | Err(_) => return,
            Ok(length) => text.extend_from_slice(&buffer[..length]),
        }
    }
}

async fn http(mut stream: TcpStream, handler: &Mutex<Handler>) {
    let mut text = String::new();
    let mut buffer = [0; 4096];
    let asked = loop {
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let length = head
                .lines()
                .find_map(|line| line.strip_prefix("Content-Length: "))
                .map_or(0, |n| n.parse().unwrap());
            if body.len() >= length {
                let path = head.split(' ').nth(1).unwrap();
                break if length > 0 { body.to_owned() } else { path.to_owned() };
            }
        }
        match stream.read(&mut buffer).await {
            Ok(0) | Err(_) => return,
            Ok(length) => text += std::str::from_utf8(&buffer[..length]).unwrap(),
        }
    };
    let reply = (handler.lock().unwrap())(&asked);
    let reply = match reply {
        Reply::Text(body) if !body.starts_with("HTTP/") => {
            Reply::Text(format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{body}", body.len()))
        }
        other => other,
    };
    act(&mut stream, reply).await;
}

/// Whether the connection goes on.
async fn act(stream: &mut TcpStream, reply: Reply) -> bool {
    match reply {
        Reply::Text(text) => stream.write_all(text.as_bytes()).await.is_ok(),
        Reply::Hang => std::future::pending().await,
        Reply::Cut(text) => {
            let _ = stream.write_all(text.as_bytes()).await;
            false
        }
        Reply::Flood => {
            // No line's end in it.
            let _ = stream.write_all(&vec![b'7'; 10_000_000]).await;
            false
        }
    }
}

/// What a device is set to, for the test to look at.
pub type Shared<T> = Arc<Mutex<T>>;

pub fn shared<T>(value: T) -> Shared<T> {
    Arc::new(Mutex::new(value))
}
