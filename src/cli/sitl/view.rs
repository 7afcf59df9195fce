//! `sitl --watch`: the view of `veilwing watch` on a simulated flight, in a thread of its own, as one more ground station on
//! loopback. It says nothing that it is not told to, so that a flight in step stays what it is until the operator orders something.

use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use rustix::process::{Signal, getpid, kill_process};

use crate::cli::watch::{Port, Screen, Station, utc_of_zero};
use crate::desk::watch::{After, Source, State};
use crate::link::{Clock, HostPort};

pub(super) use crate::cli::watch::is_possible;

/// As the vehicle files that `sitl` writes have operators and companions.
const OPERATOR: (u8, u8) = (255, 190);
const COMPANION: u8 = 191;

/// The view, until it is dropped.
pub(super) struct View {
    address: HostPort,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl View {
    /// Takes the terminal over, for the flight of this mission at so many of its seconds in one.
    ///
    /// # Errors
    /// It cannot be taken over, or there is no port; in words.
    pub fn open(mission: &str, speed: f64) -> Result<Self, String> {
        let failed = |error: std::io::Error| format!("loopback UDP: {error}");
        let socket = UdpSocket::bind(("127.0.0.1", 0)).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        let port = socket.local_addr().map_err(failed)?.port();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
        let screen = Screen::open()?;
        let over = Arc::new(AtomicBool::new(false));
        let (told, mission) = (Arc::clone(&over), mission.to_owned());
        let thread =
            std::thread::spawn(move || runtime.block_on(show(screen, socket, mission, speed, &told)));
        Ok(Self { address: HostPort { host: "127.0.0.1".into(), port }, over, thread: Some(thread) })
    }

    /// Where it listens.
    pub fn address(&self) -> &HostPort {
        &self.address
    }
}

impl Drop for View {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            // A panic in it has been told, and the terminal given back.
            let _ = thread.join();
        }
    }
}

async fn show(mut screen: Screen, socket: UdpSocket, mission: String, speed: f64, over: &AtomicBool) {
    // What runs down between two words of a companion does so by the flight's time.
    let clock = Clock::start(speed).unwrap_or_else(|_| Clock::real());
    let Ok(socket) = tokio::net::UdpSocket::from_std(socket) else { return };
    let ports = vec![Port::on(socket, None, &clock)];
    let state = State::new(Source::Simulated(mission), COMPANION, utc_of_zero(&clock));
    let station = Station { own: OPERATOR, heartbeat: None };
    let left = screen.run(state, ports, &clock, Some(station), false, over).await;
    drop(screen);
    match left {
        // The flight goes on, with its log.
        Ok(Some(After::Leave | After::Stay)) => {}
        // To the end in order, as Ctrl-C has it everywhere; so too where the terminal is gone.
        Ok(Some(After::Interrupt) | None) | Err(_) => {
            let _ = kill_process(getpid(), Signal::INT);
        }
    }
}
