use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use veilwing::link::codec::Decoder;
use veilwing::link::{Clock, Counters, Link, LinkConfig, LinkError, Rejection};
use veilwing::link::{HostPort, LinkAddress};

use crate::common::*;

/// A link whose time-outs and back-off pass a hundred times as fast.
async fn open_fast(address: LinkAddress) -> (Link<M>, Clock) {
    let clock = Clock::start(100.0).unwrap();
    let config = LinkConfig { name: "fast".to_owned(), peer_system: Some(1), ..LinkConfig::default() };
    (Link::open(address, config, clock.clone()).await.unwrap(), clock)
}

/// Polls `link`, which receives nothing, until `done`.
async fn drive_until(link: &mut Link<M>, done: impl Fn(&Link<M>) -> bool) {
    while !done(link) {
        tokio::select! {
            biased;
            frame = link.recv() => panic!("{frame:?}"),
            () = tokio::task::yield_now() => {}
        }
    }
}

#[tokio::test]
async fn spec_udp_carries_frames_both_ways_over_ipv4_and_ipv6() {
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

#[tokio::test]
async fn spec_an_address_in_use_is_an_error_with_the_address() {
    let first = open(LinkAddress::UdpIn(loopback(0))).await;
    let address = LinkAddress::UdpIn(loopback(first.local_address().unwrap().port()));
    let second = Link::<M>::open(address.clone(), LinkConfig::default(), Clock::real()).await;
    assert!(matches!(&second, Err(LinkError::Bind { address: at, .. }) if *at == address));
}

#[tokio::test]
async fn spec_a_udp_peer_that_is_not_up_yet_is_no_fault() {
    // An address of its own, so that no other test can be given the port.
    let host = "127.0.0.77";
    let port = UdpSocket::bind((host, 0)).await.unwrap().local_addr().unwrap().port();
    let mut link = open(LinkAddress::UdpOut(HostPort { host: host.to_owned(), port })).await;
    // Each frame is answered by an ICMP refusal, of which the system tells on the next one.
    for sent in 1..=10 {
        link.send((1, 191), &heartbeat(1));
        drive_until(&mut link, |link| link.counters().sent == sent).await;
    }
    assert!(link.is_connected());
    let peer = UdpSocket::bind((host, port)).await.unwrap();
    link.send((1, 191), &heartbeat(2));
    let mut datagram = [0; 300];
    let (length, from) = tokio::select! {
        received = peer.recv_from(&mut datagram) => received.unwrap(),
        frame = link.recv() => panic!("{frame:?}"),
    };
    assert_eq!(mode_of(&decode(&datagram[..length]).0[0].parse::<M>().unwrap()), 2);
    peer.send_to(&heartbeat_bytes(1, 3), from).await.unwrap();
    assert_eq!(mode_of(&link.recv().await), 3);
    assert_eq!(link.counters().connections, 1);
}

#[tokio::test]
async fn spec_a_udp_peer_that_comes_back_from_another_port_is_found_after_its_silence() {
    let (mut link, clock) = open_fast(LinkAddress::UdpIn(loopback(0))).await;
    let to = link.local_address().unwrap();
    for mode in 0..5 {
        let peer = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        peer.send_to(&heartbeat_bytes(1, mode), to).await.unwrap();
        assert_eq!(mode_of(&link.recv().await), mode);
        link.send((1, 191), &heartbeat(100 + mode));
        let mut datagram = [0; 300];
        let length = tokio::select! {
            received = peer.recv(&mut datagram) => received.unwrap(),
            frame = link.recv() => panic!("{frame:?}"),
        };
        assert_eq!(mode_of(&decode(&datagram[..length]).0[0].parse::<M>().unwrap()), 100 + mode);
        // 31 ms on the wall.
        clock.sleep_until(clock.now() + Duration::from_millis(3100)).await;
    }
    assert_eq!((link.counters().connections, link.counters().rejected.total()), (5, 0));
}

#[tokio::test]
async fn spec_a_tcp_client_reconnects_whenever_the_server_hangs_up() {
    let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (mut link, _) = open_fast(LinkAddress::TcpOut(loopback(server.local_addr().unwrap().port()))).await;
    for mode in 0..5 {
        let (mut stream, _) = tokio::select! {
            accepted = server.accept() => accepted.unwrap(),
            frame = link.recv() => panic!("{frame:?}"),
        };
        let connections = u64::from(mode) + 1;
        drive_until(&mut link, |link| link.counters().connections == connections).await;
        stream.write_all(&heartbeat_bytes(1, mode)).await.unwrap();
        assert_eq!(mode_of(&link.recv().await), mode);
        link.send((1, 191), &heartbeat(100 + mode));
        let mut frame = vec![0; heartbeat_bytes(1, 100 + mode).len()];
        tokio::select! {
            read = stream.read_exact(&mut frame) => drop(read.unwrap()),
            frame = link.recv() => panic!("{frame:?}"),
        }
        assert_eq!(mode_of(&decode(&frame).0[0].parse::<M>().unwrap()), 100 + mode);
        // Cut off inside a frame.
        stream.write_all(&heartbeat_bytes(1, 0)[..12]).await.unwrap();
        drop(stream);
        drive_until(&mut link, |link| !link.is_connected()).await;
    }
    assert_eq!(reasons(link.counters()), [(Rejection::Truncated, 5)]);
    assert!(link.counters().io_errors >= 5);
}

#[tokio::test]
async fn spec_a_tcp_server_that_refuses_is_tried_again() {
    let address = TcpListener::bind("127.0.0.78:0").await.unwrap().local_addr().unwrap();
    let to = HostPort { host: address.ip().to_string(), port: address.port() };
    let (mut link, _) = open_fast(LinkAddress::TcpOut(to)).await;
    assert!(!link.is_connected());
    drive_until(&mut link, |link| link.counters().io_errors >= 3).await;
    let server = TcpListener::bind(address).await.unwrap();
    let (mut stream, _) = tokio::select! {
        accepted = server.accept() => accepted.unwrap(),
        frame = link.recv() => panic!("{frame:?}"),
    };
    stream.write_all(&heartbeat_bytes(1, 8)).await.unwrap();
    assert_eq!(mode_of(&link.recv().await), 8);
}

#[tokio::test]
async fn spec_a_silent_tcp_server_is_given_up_and_connected_anew() {
    let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (mut link, _) = open_fast(LinkAddress::TcpOut(loopback(server.local_addr().unwrap().port()))).await;
    let (_silent, _) = server.accept().await.unwrap();
    let (mut second, _) = loop {
        // As an event loop does, come back to the link now and then though it has nothing to say.
        tokio::select! {
            biased;
            accepted = server.accept() => break accepted.unwrap(),
            frame = link.recv() => panic!("{frame:?}"),
            () = tokio::task::yield_now() => {}
        }
    };
    second.write_all(&heartbeat_bytes(1, 4)).await.unwrap();
    assert_eq!(mode_of(&link.recv().await), 4);
}

#[tokio::test]
async fn spec_a_tcp_peer_is_served_however_many_slow_ones_there_are() {
    let mut link = open(LinkAddress::TcpIn(loopback(0))).await;
    let to = link.local_address().unwrap();
    // Twenty connections that start a frame and never end it, and twenty that only say nothing.
    let mut slow = Vec::new();
    for round in 0..40 {
        let mut stream = TcpStream::connect(to).await.unwrap();
        if round % 2 == 0 {
            stream.write_all(&heartbeat_bytes(1, 0)[..11]).await.unwrap();
        }
        slow.push(stream);
        drive_until(&mut link, |link| link.counters().received_bytes > 0).await;
    }
    assert!(!link.is_connected());
    let mut peer = TcpStream::connect(to).await.unwrap();
    for mode in 0..20 {
        peer.write_all(&heartbeat_bytes(1, mode)).await.unwrap();
        assert_eq!(mode_of(&link.recv().await), mode);
        link.send((1, 191), &heartbeat(mode));
        let mut frame = vec![0; heartbeat_bytes(1, mode).len()];
        tokio::select! {
            read = peer.read_exact(&mut frame) => drop(read.unwrap()),
            frame = link.recv() => panic!("{frame:?}"),
        }
        assert_eq!(mode_of(&decode(&frame).0[0].parse::<M>().unwrap()), mode);
        // More of them while the peer is alive: hung up on at once.
        let mut late = TcpStream::connect(to).await.unwrap();
        let strangers = link.counters().rejected.get(Rejection::Stranger);
        drive_until(&mut link, |link| link.counters().rejected.get(Rejection::Stranger) > strangers).await;
        assert_eq!(late.read(&mut [0]).await.unwrap(), 0);
    }
    assert_eq!(link.counters().connections, 1);

    drop(peer);
    drive_until(&mut link, |link| !link.is_connected()).await;
    let mut peer = TcpStream::connect(to).await.unwrap();
    peer.write_all(&heartbeat_bytes(1, 99)).await.unwrap();
    assert_eq!(mode_of(&link.recv().await), 99);
    assert_eq!(link.counters().connections, 2);
}

#[tokio::test]
async fn spec_a_tcp_peer_that_does_not_read_costs_frames_and_no_wait() {
    let server = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let mut link = open(LinkAddress::TcpOut(loopback(server.local_addr().unwrap().port()))).await;
    let (mut stream, _) = server.accept().await.unwrap();
    drive_until(&mut link, Link::is_connected).await;
    let mut sent = 0;
    while link.counters().dropped_congested < 1000 {
        link.send((1, 191), &heartbeat(sent));
        sent += 1;
        if sent.is_multiple_of(100) {
            tokio::select! { biased; frame = link.recv() => panic!("{frame:?}"), () = tokio::task::yield_now() => {} }
        }
    }
    // What does arrive is whole frames in order, the newest among them.
    let (mut decoder, mut counters) = (Decoder::<M>::default(), Counters::default());
    let (mut last, mut received, mut buffer) = (None, 0, vec![0; 65_536]);
    while last != Some(sent - 1) {
        let length = tokio::select! {
            read = stream.read(&mut buffer) => read.unwrap(),
            frame = link.recv() => panic!("{frame:?}"),
        };
        decoder.feed(&buffer[..length]);
        while let Some(raw) = decoder.next_frame(&mut counters) {
            let mode = mode_of(&raw.parse::<M>().unwrap());
            assert!(last.is_none_or(|last| mode > last));
            (last, received) = (Some(mode), received + 1);
        }
    }
    assert_eq!((counters.noise_bytes, received), (0, link.counters().sent));
    assert_eq!(u64::from(sent), link.counters().sent + link.counters().dropped_congested);
}
