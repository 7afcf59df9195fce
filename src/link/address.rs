//! Addresses of MAVLink links, written as the mavlink crate writes them.

use std::fmt;
use std::str::FromStr;

/// Where a link goes. Host names are resolved by whoever opens the link.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum LinkAddress {
    /// `udpin:HOST:PORT`: bind here, and talk to the peer whose frames arrive.
    UdpIn(HostPort),
    /// `udpout:HOST:PORT`: send there.
    UdpOut(HostPort),
    /// `tcpin:HOST:PORT`: listen here for one peer.
    TcpIn(HostPort),
    /// `tcpout:HOST:PORT`: connect there.
    TcpOut(HostPort),
    /// `serial:PATH:BAUD`.
    Serial {
        /// The device, such as `/dev/ttyACM0`.
        path: String,
        /// Symbols per second.
        baud: u32,
    },
}

/// A host and a port. An IPv6 host is written in brackets.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct HostPort {
    /// Host name or address, without brackets.
    pub host: String,
    /// Port, not 0.
    pub port: u16,
}

/// Why an address is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// The part before the first colon names no kind of link.
    #[error("the scheme {0:?} is none of udpin, udpout, tcpin, tcpout, serial")]
    Scheme(String),
    /// No port.
    #[error("there is no port; write {0}:HOST:PORT")]
    NoPort(String),
    /// The port is no number from 1 to 65535.
    #[error("the port {0:?} is not a number from 1 to 65535")]
    Port(String),
    /// The host is empty or holds what no host can.
    #[error("the host {0:?} is neither a name nor an address; an IPv6 address goes in brackets, [::1]")]
    Host(String),
    /// No device or no rate.
    #[error("there is no device or no baud rate; write serial:/dev/ttyACM0:57600")]
    Serial,
    /// The rate is no number from 1200 to 4000000.
    #[error("the baud rate {0:?} is not a number from 1200 to 4000000")]
    Baud(String),
}

impl LinkAddress {
    /// Whether it waits for its peer, wherever that is, instead of naming it.
    #[must_use]
    pub fn learns_its_peer(&self) -> bool {
        matches!(self, Self::UdpIn(_) | Self::TcpIn(_))
    }

    /// Whether it is a wire that ends at one peer, so that nobody else can speak on it.
    #[must_use]
    pub fn is_point_to_point(&self) -> bool {
        matches!(self, Self::Serial { .. })
    }
}

impl FromStr for LinkAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let (scheme, rest) = text.split_once(':').unwrap_or((text, ""));
        match scheme {
            "udpin" => host_port(scheme, rest).map(Self::UdpIn),
            "udpout" => host_port(scheme, rest).map(Self::UdpOut),
            "tcpin" => host_port(scheme, rest).map(Self::TcpIn),
            "tcpout" => host_port(scheme, rest).map(Self::TcpOut),
            "serial" => serial(rest),
            other => Err(AddressError::Scheme(other.to_owned())),
        }
    }
}

fn host_port(scheme: &str, rest: &str) -> Result<HostPort, AddressError> {
    let (host, port) = rest.rsplit_once(':').ok_or_else(|| AddressError::NoPort(scheme.to_owned()))?;
    let bad_host = || AddressError::Host(host.to_owned());
    let host = match host.strip_prefix('[') {
        Some(bracketed) => {
            let inner = bracketed.strip_suffix(']').ok_or_else(bad_host)?;
            // A scope such as `fe80::1%eth0` belongs to the address.
            let address = inner.split('%').next().unwrap_or_default();
            address.parse::<std::net::Ipv6Addr>().map_err(|_| bad_host())?;
            inner
        }
        None => host,
    };
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
    if host.is_empty() || !(host.contains(':') || host.chars().all(plain)) {
        return Err(bad_host());
    }
    if host.contains(':') && !rest.starts_with('[') {
        return Err(bad_host());
    }
    let number =
        port.parse().ok().filter(|port| *port != 0).ok_or_else(|| AddressError::Port(port.to_owned()))?;
    Ok(HostPort { host: host.to_owned(), port: number })
}

fn serial(rest: &str) -> Result<LinkAddress, AddressError> {
    let (path, baud) =
        rest.rsplit_once(':').filter(|(path, _)| !path.is_empty()).ok_or(AddressError::Serial)?;
    let rate = baud.parse().ok().filter(|rate| (1200..=4_000_000).contains(rate));
    let baud = rate.ok_or_else(|| AddressError::Baud(baud.to_owned()))?;
    Ok(LinkAddress::Serial { path: path.to_owned(), baud })
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]:{}", self.host, self.port)
        } else {
            write!(f, "{}:{}", self.host, self.port)
        }
    }
}

impl fmt::Display for LinkAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UdpIn(at) => write!(f, "udpin:{at}"),
            Self::UdpOut(at) => write!(f, "udpout:{at}"),
            Self::TcpIn(at) => write!(f, "tcpin:{at}"),
            Self::TcpOut(at) => write!(f, "tcpout:{at}"),
            Self::Serial { path, baud } => write!(f, "serial:{path}:{baud}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_addresses_read_and_print_the_same() {
        for text in [
            "udpin:0.0.0.0:14550",
            "udpout:vehicle-j.local:14600",
            "tcpin:[::]:5760",
            "tcpout:[fe80::1%eth0]:5760",
            "serial:/dev/ttyACM0:57600",
            "serial:/dev/serial/by-path/pci-0:1.0:921600",
        ] {
            assert_eq!(text.parse::<LinkAddress>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn spec_what_is_no_address_is_refused_by_its_part() {
        for (text, part) in [
            ("", "scheme"),
            ("udp:1.2.3.4:5", "scheme"),
            ("udpin", "no port"),
            ("udpin:1.2.3.4", "no port"),
            ("udpin:1.2.3.4:0", "port \"0\""),
            ("udpin:1.2.3.4:65536", "port \"65536\""),
            ("udpin::14550", "host"),
            ("udpin:::1:14550", "brackets"),
            ("udpin:[::1:14550", "brackets"),
            ("udpin:a b:14550", "host"),
            ("serial:/dev/ttyACM0", "serial:/dev"),
            ("serial::57600", "no device"),
            ("serial:/dev/ttyACM0:fast", "baud rate \"fast\""),
        ] {
            let message = text.parse::<LinkAddress>().unwrap_err().to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }
}
