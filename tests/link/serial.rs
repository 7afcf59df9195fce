//! A pseudo-terminal is the serial line: what is written to its controlling side, the link reads.

use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use veilwing::link::LinkAddress;
use veilwing::link::{Clock, Link, LinkConfig};

use crate::common::*;
use crate::tlog::directory;

/// The far end of a line whose near end is at `path`.
fn line_at(path: &Path) -> File {
    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&far).unwrap();
    unlockpt(&far).unwrap();
    std::fs::remove_file(path).ok();
    std::os::unix::fs::symlink(ptsname(&far, Vec::new()).unwrap().to_str().unwrap(), path).unwrap();
    far.into()
}

async fn open_serial(path: &Path) -> Link<M> {
    let address = LinkAddress::Serial { path: path.to_str().unwrap().to_owned(), baud: 921_600 };
    let config = LinkConfig { name: "serial".to_owned(), peer_system: Some(1), ..LinkConfig::default() };
    // A hundred times as fast, so that back-off takes no time.
    Link::open(address, config, Clock::start(100.0).unwrap()).await.unwrap()
}

#[tokio::test]
async fn prop_a_line_full_of_noise_still_carries_every_frame() {
    let path = directory("serial-noise").join("tty");
    let mut far = line_at(&path);
    let mut link = open_serial(&path).await;
    assert!(link.is_connected());
    let mut noise_bytes = 0;
    let writer = std::thread::spawn(move || {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        for mode in 0..500 {
            let mut noise = vec![0; rng.random_range(0..500)];
            rng.fill_bytes(&mut noise);
            noise_bytes += noise.len() as u64;
            far.write_all(&noise).unwrap();
            far.write_all(&heartbeat_bytes(1, mode)).unwrap();
        }
        (far, noise_bytes)
    });
    for mode in 0..500 {
        assert_eq!(mode_of(&link.recv().await), mode);
    }
    let (mut far, noise_bytes) = writer.join().unwrap();
    assert_eq!((link.counters().received, link.counters().noise_bytes), (500, noise_bytes));

    link.send((1, 191), &heartbeat(77));
    let reader = std::thread::spawn(move || {
        let mut frame = vec![0; heartbeat_bytes(1, 77).len()];
        far.read_exact(&mut frame).unwrap();
        (far, frame)
    });
    // Whatever the first attempt left over goes out while the link is polled.
    let frame = tokio::select! {
        frame = tokio::task::spawn_blocking(|| reader.join().unwrap()) => frame.unwrap().1,
        frame = link.recv() => panic!("{frame:?}"),
    };
    assert_eq!(mode_of(&decode(&frame).0[0].parse::<M>().unwrap()), 77);
}

#[tokio::test]
async fn spec_a_line_unplugged_and_plugged_in_again_goes_on() {
    let path = directory("serial-unplug").join("tty");
    let mut far = line_at(&path);
    let mut link = open_serial(&path).await;
    for mode in 0..5 {
        far.write_all(&heartbeat_bytes(1, mode)).unwrap();
        assert_eq!(mode_of(&link.recv().await), mode);
        // A second line at the same path, and the first one's plug is pulled, in the middle of a frame.
        far.write_all(&heartbeat_bytes(1, mode)[..9]).unwrap();
        let next = line_at(&path);
        drop(std::mem::replace(&mut far, next));
        let connections = link.counters().connections;
        while link.counters().connections == connections {
            tokio::select! {
                biased;
                frame = link.recv() => panic!("{frame:?}"),
                () = tokio::task::yield_now() => {}
            }
        }
    }
    assert_eq!(link.counters().received, 5);
    assert!(link.counters().io_errors >= 5);
}

#[tokio::test]
async fn spec_a_device_not_there_yet_is_waited_for() {
    let path = directory("serial-late").join("tty");
    let mut link = open_serial(&path).await;
    assert!(!link.is_connected());
    let mut far = line_at(&path);
    while !link.is_connected() {
        tokio::select! {
            biased;
            frame = link.recv() => panic!("{frame:?}"),
            () = tokio::task::yield_now() => {}
        }
    }
    far.write_all(&heartbeat_bytes(1, 9)).unwrap();
    assert_eq!(mode_of(&link.recv().await), 9);
}
