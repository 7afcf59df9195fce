//! A lossy relay between the two companions, over real sockets.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::link::Clock;

/// It loses as many datagrams, in either direction, at all times.
pub const LOSS: f64 = 0.1;
const NEVER: u64 = u64::MAX;

/// Passes datagrams between the companions, loses some, and all of one side's from an instant on.
pub struct Relay {
    /// Where it listens for vehicle I and for vehicle J.
    pub ports: [u16; 2],
    clock: Clock,
    /// By sender, microseconds of the clock.
    cut_from_us: Arc<[AtomicU64; 2]>,
    over: Arc<AtomicBool>,
    lost: Arc<AtomicU64>,
    threads: Vec<std::thread::JoinHandle<()>>,
}

impl Relay {
    pub fn open(seed: u64) -> Self {
        let sockets = [0, 1].map(|_| Arc::new(UdpSocket::bind("127.0.0.1:0").unwrap()));
        let ports = [0, 1].map(|side: usize| sockets[side].local_addr().unwrap().port());
        let addresses: Arc<[Mutex<Option<SocketAddr>>; 2]> = Arc::default();
        let cut_from_us = Arc::new([AtomicU64::new(NEVER), AtomicU64::new(NEVER)]);
        let (over, lost) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let clock = Clock::real();
        let mut threads = Vec::new();
        for from in 0..2 {
            let (near, far) = (Arc::clone(&sockets[from]), Arc::clone(&sockets[1 - from]));
            let (addresses, cut, clock) = (Arc::clone(&addresses), Arc::clone(&cut_from_us), clock.clone());
            let (over, lost) = (Arc::clone(&over), Arc::clone(&lost));
            let mut rng = ChaCha8Rng::seed_from_u64(2 * seed + from as u64);
            near.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
            threads.push(std::thread::spawn(move || {
                let mut datagram = [0; 2048];
                while !over.load(Ordering::Relaxed) {
                    let Ok((length, sender)) = near.recv_from(&mut datagram) else { continue };
                    *addresses[from].lock().unwrap() = Some(sender);
                    let cut = micros(&clock) >= cut[from].load(Ordering::Relaxed);
                    match *addresses[1 - from].lock().unwrap() {
                        Some(to) if !cut && !rng.random_bool(LOSS) => {
                            // A companion that is gone refuses: lost.
                            let _ = far.send_to(&datagram[..length], to);
                        }
                        _ => {
                            lost.fetch_add(1, Ordering::Relaxed);
                        }
                    }
                }
            }));
        }
        Self { ports, clock, cut_from_us, over, lost, threads }
    }

    /// From `after` on nothing of this side passes.
    pub fn cut(&self, side: usize, after: Duration) {
        let at = micros(&self.clock) + u64::try_from(after.as_micros()).unwrap();
        self.cut_from_us[side].store(at, Ordering::Relaxed);
    }

    /// Ends it; how many datagrams were lost.
    pub fn close(self) -> u64 {
        self.over.store(true, Ordering::Relaxed);
        self.threads.into_iter().for_each(|thread| thread.join().unwrap());
        self.lost.load(Ordering::Relaxed)
    }
}

fn micros(clock: &Clock) -> u64 {
    u64::try_from(clock.now().since_start().as_micros()).unwrap()
}
