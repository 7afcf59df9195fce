//! A ground station that watches a simulated flight: one UDP address for both vehicles.

use tokio::net::UdpSocket;

use crate::link::{HostPort, LinkAddress};

/// The link of each vehicle's router that goes to the ground station; link 0 is the companion's.
pub(super) const GROUND_LINK: usize = crate::desk::simulation::STATION_LINK;

/// The address of an option: only `udpout:` makes sense, for ground stations listen.
pub(super) fn parse_ground_station(text: &str) -> Result<HostPort, String> {
    match text.parse() {
        Ok(LinkAddress::UdpOut(at)) => Ok(at),
        Ok(_) => Err("only udpout:HOST:PORT, where the ground station listens".into()),
        Err(error) => Err(format!("{error}; write udpout:HOST:PORT, for example udpout:127.0.0.1:14550")),
    }
}

/// A socket connected to the ground station, so that the kernel turns away everybody else.
pub(super) struct GroundStation {
    socket: UdpSocket,
}

impl GroundStation {
    pub async fn connect(to: &HostPort) -> Result<Self, String> {
        let failed = |error: std::io::Error| format!("ground station udpout:{to}: {error}");
        let mut addresses = tokio::net::lookup_host((to.host.as_str(), to.port)).await.map_err(failed)?;
        let address =
            addresses.next().ok_or_else(|| format!("ground station udpout:{to}: the name has no address"))?;
        let local = if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let socket = UdpSocket::bind(local).await.map_err(failed)?;
        socket.connect(address).await.map_err(failed)?;
        Ok(Self { socket })
    }

    /// The next datagram, if one is there. A refusal (nobody listens yet) is none.
    pub fn receive<'b>(&self, buffer: &'b mut [u8]) -> Option<&'b [u8]> {
        let length = self.socket.try_recv(buffer).ok()?;
        Some(&buffer[..length])
    }

    pub fn send(&self, frame: &[u8]) {
        // Nobody there yet, or a full buffer: lost, as on any radio link.
        let _ = self.socket.try_send(frame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_only_an_address_to_send_to_is_taken() {
        assert_eq!(parse_ground_station("udpout:[::1]:14550").map(|at| at.port), Ok(14550));
        for (bad, says) in [("udpin:0.0.0.0:14550", "only udpout"), ("14550", "udpout:127.0.0.1:14550")] {
            assert!(parse_ground_station(bad).is_err_and(|error| error.contains(says)), "{bad}");
        }
    }
}
