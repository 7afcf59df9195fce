//! The log as records of systemd's journal, each field by its own name: `journalctl VEILWING_PHASE=slot`.
//!
//! One datagram a record, by the journal's native protocol. The socket does not wait: a journal that takes nothing costs
//! records, and no setpoint.

use std::fmt::{self, Write as _};
use std::io;
use std::os::unix::net::UnixDatagram;

use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// Where the journal listens.
const SOCKET: &str = "/run/systemd/journal/socket";

/// The journal.
#[derive(Debug)]
pub(super) struct Journal(UnixDatagram);

impl Journal {
    /// This machine's.
    pub fn open() -> io::Result<Self> {
        let socket = UnixDatagram::unbound()?;
        socket.connect(SOCKET)?;
        Self::at(socket)
    }

    /// The one at the other end of a connected socket.
    fn at(socket: UnixDatagram) -> io::Result<Self> {
        socket.set_nonblocking(true)?;
        Ok(Self(socket))
    }
}

impl<S: Subscriber> Layer<S> for Journal {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut record = Record::default();
        event.record(&mut record);
        record.add("PRIORITY", priority(*event.metadata().level()));
        record.add("SYSLOG_IDENTIFIER", "veilwing");
        record.add("TARGET", event.metadata().target());
        // It may be lost; what it tells of may not wait.
        let _ = self.0.send(&record.0);
    }
}

/// As syslog counts.
fn priority(level: Level) -> &'static str {
    match level {
        Level::ERROR => "3",
        Level::WARN => "4",
        Level::INFO => "6",
        _ => "7",
    }
}

/// A record's bytes.
#[derive(Debug, Default)]
struct Record(Vec<u8>);

impl Record {
    fn add(&mut self, name: &str, value: &str) {
        self.0.extend(name.as_bytes());
        if value.contains('\n') {
            // Its length, in place of its end.
            self.0.push(b'\n');
            self.0.extend((value.len() as u64).to_le_bytes());
        } else {
            self.0.push(b'=');
        }
        self.0.extend(value.as_bytes());
        self.0.push(b'\n');
    }
}

impl Visit for Record {
    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => self.add("MESSAGE", value),
            name => {
                let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_uppercase() } else { '_' };
                self.add(&format!("VEILWING_{}", name.chars().map(plain).collect::<String>()), value);
            }
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        let mut text = String::new();
        // Writing to a String fails only where the value's own words do.
        let _ = write!(text, "{value:?}");
        self.record_str(field, &text);
    }
}

#[cfg(test)]
mod tests {
    use tracing_subscriber::layer::SubscriberExt;

    use super::*;
    use crate::role::Role;

    fn heard(socket: &UnixDatagram) -> Vec<u8> {
        let mut datagram = vec![0; 4096];
        let length = socket.recv(&mut datagram).unwrap();
        datagram.truncate(length);
        datagram
    }

    #[test]
    fn spec_a_record_has_its_message_its_priority_and_each_field_by_name() {
        let (ours, theirs) = UnixDatagram::pair().unwrap();
        let subscriber = tracing_subscriber::registry().with(Journal::at(ours).unwrap());
        tracing::subscriber::with_default(subscriber, || {
            tracing::warn!(role = %Role::I, phase = "slot", "slot 0: on, 0.5 W");
            tracing::info!(round_trip_ms = 3_u32, "two\nlines");
        });
        let first = String::from_utf8(heard(&theirs)).unwrap();
        for line in [
            "MESSAGE=slot 0: on, 0.5 W",
            "VEILWING_ROLE=I",
            "VEILWING_PHASE=slot",
            "PRIORITY=4",
            "SYSLOG_IDENTIFIER=veilwing",
        ] {
            assert!(first.lines().any(|found| found == line), "{line} is not in {first}");
        }
        let second = heard(&theirs);
        assert!(second.starts_with(b"MESSAGE\n\x09\0\0\0\0\0\0\0two\nlines\n"), "{second:?}");
        assert!(String::from_utf8_lossy(&second).contains("\nVEILWING_ROUND_TRIP_MS=3\nPRIORITY=6\n"));
    }

    #[test]
    fn spec_a_journal_that_takes_nothing_costs_records_and_no_time() {
        let (ours, _theirs) = UnixDatagram::pair().unwrap();
        let subscriber = tracing_subscriber::registry().with(Journal::at(ours).unwrap());
        // Far more than a socket holds that nobody reads.
        tracing::subscriber::with_default(subscriber, || {
            (0..100_000).for_each(|n| tracing::info!(n, "said"))
        });
    }
}
