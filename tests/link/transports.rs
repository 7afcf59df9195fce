use veilwing::config::{HostPort, LinkAddress};

use crate::common::*;

#[tokio::test]
async fn val_udp_carries_frames_both_ways_over_ipv4_and_ipv6() {
    for host in ["127.0.0.1", "::1", "localhost"] {
        let at = |port| HostPort { host: host.to_owned(), port };
        let mut server = open(LinkAddress::UdpIn(at(0))).await;
        let port = server.local_address().unwrap().port();
        let mut client = open(LinkAddress::UdpOut(at(port))).await;
        assert!(client.is_connected() && !server.is_connected());

        server.send((1, 1), &heartbeat(0));
        assert_eq!(server.counters().dropped_unconnected, 1);
        for mode in 0..100 {
            client.send((1, 2), &heartbeat(mode));
            // Until the socket is known to be writable, a frame waits for the sender's own recv.
            let frame = tokio::select! { frame = server.recv() => frame, _ = client.recv() => panic!() };
            assert_eq!(mode_of(&frame), mode);
            server.send((1, 1), &heartbeat(mode));
            let frame = tokio::select! { frame = client.recv() => frame, _ = server.recv() => panic!() };
            assert_eq!(mode_of(&frame), mode);
        }
        assert_eq!((server.counters().sent, server.counters().received), (100, 100));
        assert_eq!((server.counters().connections, server.counters().rejected.total()), (1, 0));
    }
}
