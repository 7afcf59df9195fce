//! Where a link leads. Host names are resolved when the link is opened, and again each time it reopens.

/// A link's address.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum LinkAddress {
    /// Bind here, and learn the peer from its frames.
    UdpIn(HostPort),
    /// Send there, hear nobody else.
    UdpOut(HostPort),
    /// Listen here for one peer.
    TcpIn(HostPort),
    /// Connect there, again whenever the connection is lost.
    TcpOut(HostPort),
    /// A serial port.
    Serial {
        /// The device.
        path: String,
        /// Symbols per second.
        baud: u32,
    },
}

/// A host and a port.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct HostPort {
    /// Host name or address, without brackets.
    pub host: String,
    /// Port.
    pub port: u16,
}
