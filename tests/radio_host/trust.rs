//! A signed host: what is not signed, signed with another key, or recorded and sent again changes nothing, and is counted.

use std::net::UdpSocket;
use std::sync::Arc;

use mavlink::dialects::ardupilotmega::MavMessage;
use veilwing::link::Aboard;
use veilwing::link::codec::Encoder;
use veilwing::transmitter::wire::VeilwingRadioResult as Is;

use crate::host::{COMPANION, Companion, Program, key};
use crate::server::{Shared, shared};

/// What lies between companion and host, and hears all that the companion says.
async fn tap(to: u16) -> (Arc<tokio::net::UdpSocket>, Shared<Vec<Vec<u8>>>) {
    let socket = Arc::new(tokio::net::UdpSocket::bind("127.0.0.1:0").await.unwrap());
    let heard = shared(Vec::new());
    let (kept, own) = (heard.clone(), Arc::clone(&socket));
    tokio::spawn(async move {
        let mut companion = None;
        let mut buffer = vec![0; 65_536];
        loop {
            let (length, from) = socket.recv_from(&mut buffer).await.unwrap();
            if from.port() == to {
                if let Some(companion) = companion {
                    socket.send_to(&buffer[..length], companion).await.unwrap();
                }
            } else {
                companion = Some(from);
                kept.lock().unwrap().push(buffer[..length].to_vec());
                let _ = socket.send_to(&buffer[..length], ("127.0.0.1", to)).await;
            }
        }
    });
    (own, heard)
}

#[tokio::test]
async fn spec_forged_replayed_and_unsigned_leases_change_nothing_and_are_counted() {
    let path = crate::backends::directory("keys");
    let key_file = path.join("radio.key");
    std::fs::write(&key_file, [7; 32]).unwrap();
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(&key_file, std::fs::Permissions::from_mode(0o600)).unwrap();
    }
    let mut program = Program::start("trust", &format!("key_file = \"{}\"", key_file.display()));
    let (way, heard) = tap(program.port).await;
    let port = way.local_addr().unwrap().port();
    let mut companion = Companion::new(port, 5, Some(key(7, path.join("companion.signing")))).await;
    companion.report().await;
    let answer = companion.give(10.0, 4500).await;
    assert_eq!(
        (answer.result, answer.power_mdbm),
        (Is::VEILWING_RADIO_RESULT_ACCEPTED, 10_000),
        "{}",
        program.said()
    );
    let forged = companion.command(30.0, 4500);

    // Unsigned, signed with another key, and everything that was said so far once more: from elsewhere, and on the
    // companion's own way.
    let recorded = heard.lock().unwrap().clone();
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let unsigned =
        Encoder::default().encode(COMPANION, &Aboard::Common(MavMessage::COMMAND_INT(forged.clone())));
    let mut other = Companion::new(port, 5, Some(key(8, path.join("other.signing")))).await;
    for _ in 0..20 {
        stranger.send_to(unsigned.raw_bytes(), ("127.0.0.1", program.port)).unwrap();
        way.send_to(unsigned.raw_bytes(), ("127.0.0.1", program.port)).await.unwrap();
        other.say(MavMessage::COMMAND_INT(forged.clone()));
    }
    // What it said goes out while it listens.
    while heard.lock().unwrap().len() < recorded.len() + 20 {
        tokio::select! {
            biased;
            frame = other.link.recv() => panic!("the radio answers a wrong key: {frame:?}"),
            () = tokio::task::yield_now() => {}
        }
    }
    for frame in &recorded {
        stranger.send_to(frame, ("127.0.0.1", program.port)).unwrap();
        way.send_to(frame, ("127.0.0.1", program.port)).await.unwrap();
    }
    // Answered, so that all of it was taken before.
    let answer = companion.give(10.0, 4500).await;
    assert_eq!((answer.result, answer.power_mdbm), (Is::VEILWING_RADIO_RESULT_ACCEPTED, 10_000));
    assert_eq!(program.terminate(), Some(130));
    assert_eq!(program.history(), ["off", "on 10", "off"], "{}", program.said());
    let said = program.said();
    let counted = said.lines().find(|line| line.contains("link: ")).unwrap_or_else(|| panic!("{said}"));
    for reason in [" unsigned ", " wrong_signature ", " replayed "] {
        assert!(counted.contains(reason), "{reason} is not in {counted}");
    }
    std::fs::remove_dir_all(path).unwrap();
}
