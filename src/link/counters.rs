//! What a link has carried and what it has turned away, by reason.

use std::fmt;

use serde::ser::{Serialize, SerializeMap, Serializer};

macro_rules! rejections {
    ($($name:ident, $text:literal, $doc:literal;)*) => {
        /// Why bytes or a frame were turned away. Nothing turned away changes any state.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Rejection {
            $(#[doc = $doc] $name,)*
        }

        impl Rejection {
            /// Every reason, in the order in which reports list them.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// The reason as reports spell it.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

impl Rejection {
    /// What the operator can do about it, where two ends are most likely configured differently.
    #[must_use]
    pub const fn remedy(self) -> Option<&'static str> {
        match self {
            Self::Unsigned | Self::WrongSignature => Some(
                "the other end signs with another key, or not at all: give both vehicle files the same key_file",
            ),
            Self::Reflected => Some(
                "both ends speak as the same MAVLink system and component, or what is sent comes back: give each autopilot a system of its own",
            ),
            Self::OtherForm => Some(
                "the other companion sends its pair messages in the other form: set [pair] tunnel alike in both vehicle files",
            ),
            _ => None,
        }
    }
}

rejections! {
    Truncated, "truncated", "A datagram or a connection ended inside a frame.";
    BadCrc, "bad_crc", "The checksum does not match.";
    UnknownFlags, "unknown_flags", "Incompatibility flags that this software does not know: the frame must not be read.";
    UnknownMessage, "unknown_message", "The message id is not in the link's dialect, so not even its checksum can be verified.";
    WrongLength, "wrong_length", "A MAVLink 1 payload that is not as long as its message.";
    UnknownEnum, "unknown_enum", "An enum field holds a value that the dialect does not know, in a message where it matters.";
    Unparsable, "unparsable", "The payload does not parse for any other reason.";
    Unsigned, "unsigned", "Signing is configured and the frame has no signature.";
    WrongSignature, "wrong_signature", "The signature was not made with this link's key.";
    Replayed, "replayed", "A signed frame whose timestamp is not later than its stream's last.";
    TooOld, "too_old", "The first signed frame of a stream, older than anything acceptable since this link's last run.";
    TooNew, "too_new", "The first signed frame of a stream, a month and more ahead of this machine's clock; or any that is beyond 2100.";
    OtherForm, "other_form", "A pair message in the form, plain or in TUNNEL, for which this end is not configured.";
    ForeignSystem, "foreign_system", "The frame is from a system other than the link's peer.";
    Reflected, "reflected", "A signed frame in our own name: our own, come back, or the other end speaks as the same system and component.";
    Unproven, "unproven", "A signed frame from a new address, which has yet to answer a challenge.";
    Unasked, "unasked", "An answer to a challenge that was never made, or made too long ago.";
    Unpinned, "unpinned", "The frame is from a system of which it is not known whether it is the link's peer.";
    Stranger, "stranger", "A datagram or a connection from an address other than the peer's.";
}

/// A link's counters since it was opened.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize)]
pub struct Counters {
    /// Frames accepted.
    pub received: u64,
    /// Bytes read, of whatever kind and from whomever.
    pub received_bytes: u64,
    /// Frames handed to the operating system.
    pub sent: u64,
    /// Bytes handed to the operating system.
    pub sent_bytes: u64,
    /// Frames dropped because the way out was congested, the oldest first.
    pub dropped_congested: u64,
    /// Frames dropped because there was no peer to send them to.
    pub dropped_unconnected: u64,
    /// Frames dropped because no signing timestamp is left: a clock is beyond 2100.
    pub dropped_unsigned: u64,
    /// Signing timestamps that went into use before they were on record: the disk was slow or full, or a clock leapt.
    pub unrecorded: u64,
    /// Accepted frames in which an unknown enum value was replaced by the field's neutral one.
    pub neutralised: u64,
    /// Bytes that belonged to no frame.
    pub noise_bytes: u64,
    /// Times that the peer was found: connected, or learnt from its frames.
    pub connections: u64,
    /// Times that a peer that had been found was found elsewhere.
    pub path_changes: u64,
    /// Errors of the operating system.
    pub io_errors: u64,
    /// Records that the `.tlog` missed: its disk was slow or full.
    pub tlog_dropped: u64,
    /// Turned away, by reason.
    pub rejected: Rejections,
}

/// A count for each [`Rejection`].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Rejections([u64; Rejection::ALL.len()]);

impl Rejections {
    /// How many were turned away for `reason`.
    #[must_use]
    pub fn get(&self, reason: Rejection) -> u64 {
        self.0[reason as usize]
    }

    /// How many were turned away in all.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.0.iter().sum()
    }

    /// Counts one more and returns how many that makes.
    pub fn count(&mut self, reason: Rejection) -> u64 {
        self.0[reason as usize] += 1;
        self.0[reason as usize]
    }

    fn non_zero(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Rejection::ALL
            .iter()
            .map(|&reason| (reason.as_str(), self.get(reason)))
            .filter(|&(_, count)| count > 0)
    }
}

impl Serialize for Rejections {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(Rejection::ALL.len()))?;
        for &reason in Rejection::ALL {
            map.serialize_entry(reason.as_str(), &self.get(reason))?;
        }
        map.end()
    }
}

impl fmt::Display for Counters {
    /// One line; what is zero is left out.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "received {} frames ({} bytes), sent {} ({} bytes)",
            self.received, self.received_bytes, self.sent, self.sent_bytes
        )?;
        let others = [
            ("dropped_congested", self.dropped_congested),
            ("dropped_unconnected", self.dropped_unconnected),
            ("dropped_unsigned", self.dropped_unsigned),
            ("unrecorded", self.unrecorded),
            ("neutralised", self.neutralised),
            ("noise_bytes", self.noise_bytes),
            ("connections", self.connections),
            ("path_changes", self.path_changes),
            ("io_errors", self.io_errors),
            ("tlog_dropped", self.tlog_dropped),
        ];
        for (name, count) in others.into_iter().filter(|&(_, count)| count > 0) {
            write!(f, ", {name} {count}")?;
        }
        for (index, (name, count)) in self.rejected.non_zero().enumerate() {
            write!(f, "{} {name} {count}", if index == 0 { "; rejected:" } else { "," })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_every_reason_has_its_own_count_and_name() {
        let mut counters = Counters { received: 2, received_bytes: 42, ..Counters::default() };
        for (index, &reason) in Rejection::ALL.iter().enumerate() {
            for _ in 0..=index {
                counters.rejected.count(reason);
            }
        }
        let json = serde_json::to_value(&counters).unwrap();
        for (index, reason) in Rejection::ALL.iter().enumerate() {
            assert_eq!(json["rejected"][reason.as_str()], index as u64 + 1, "{reason:?}");
        }
        let n = Rejection::ALL.len() as u64;
        assert_eq!(counters.rejected.total(), n * (n + 1) / 2);
        assert!(
            counters.to_string().starts_with(
                "received 2 frames (42 bytes), sent 0 (0 bytes); rejected: truncated 1, bad_crc 2"
            )
        );
    }
}
