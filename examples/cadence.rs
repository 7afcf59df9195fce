//! Setpoint cadence of real companions over real UDP, at real speed, with every core kept busy:
//! `cargo run --release --example cadence -- --seconds 600`.
//!
//! Two companions run as processes of their own, as `veilwing fly` runs them; this process is their simulated world.
//! A receiving thread stamps every datagram of vehicle I's companion, and as many threads as there are cores do
//! nothing but compute. Printed: the time between position setpoints as received (median, p99, worst), and the
//! companion's share of one core and its resident memory, from /proc. Linux alone.
//!
//! `--idle` leaves the cores alone; `--flood N` sends N random datagrams a second to the companion's pair link, from a
//! stranger, all the while.

#![allow(clippy::expect_used, clippy::panic, clippy::disallowed_methods, missing_docs)]

use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use mavlink::dialects::ardupilotmega::MavMessage;
use veilwing::companion::Companion;
use veilwing::companion::settings::{pair_form, settings, transmitter_settings};
use veilwing::config::{Mission, Vehicle};
use veilwing::desk::simulation::{index, vehicle_draft, world_config};
use veilwing::link::codec::Decoder;
use veilwing::link::counters::Counters;
use veilwing::link::tlog::TlogWriter;
use veilwing::link::{Clock, LinkAddress, LinkConfig};
use veilwing::planner::slots::Plan;
use veilwing::planning;
use veilwing::role::Role;
use veilwing::systemd::Manager;
use veilwing::transmitter::Transmitter;
use veilwing_sitl::World;

/// Not counted: take-off and landing change the stream's owner.
const SETTLE: Duration = Duration::from_secs(2);

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seconds = value(&arguments, "--seconds").map_or(600.0, |text| text.parse().expect("seconds"));
    match value(&arguments, "--companion") {
        Some(role) => fly(role, seconds, value(&arguments, "--links").expect("--links A,B")),
        None => {
            let flood_hz = value(&arguments, "--flood").map_or(0.0, |text| text.parse().expect("a rate"));
            measure(seconds, !arguments.iter().any(|argument| argument == "--idle"), flood_hz);
        }
    }
}

fn value<'a>(arguments: &'a [String], name: &str) -> Option<&'a str> {
    let at = arguments.iter().position(|argument| argument == name)?;
    arguments.get(at + 1).map(String::as_str)
}

/// One user, one slot as long as asked for.
fn mission(seconds: f64) -> Mission {
    let yard = Mission::parse("yard.toml", include_str!("../tests/flight/yard.toml"));
    let long = yard.and_then(|yard| {
        yard.changed(|m| {
            m.users.truncate(1);
            m.tdma.slot_s = seconds;
        })
    });
    long.unwrap_or_else(|errors| panic!("{errors}"))
}

fn plan(mission: &Mission) -> Plan {
    planning::plan(mission).expect("a plan")
}

/// A companion process: autopilot link and pair link by address, logs in the directory for temporary files.
fn fly(role: &str, seconds: f64, links: &str) {
    let mission = mission(seconds);
    let role = if role == "i" { Role::I } else { Role::J };
    let (autopilot, pair) = links.split_once(',').expect("two links");
    let mut draft = vehicle_draft(&mission, role, [1, 2]);
    (draft.autopilot.link, draft.pair_link) = (address(autopilot), address(pair));
    let vehicle = Vehicle::new(draft).unwrap_or_else(|errors| panic!("{errors}"));
    let clock = Clock::start(1.0).expect("a clock");
    let link = |name: &str, peer_system, accept_foreign| {
        let path = std::env::temp_dir().join(format!("cadence-{}-{name}.tlog", std::process::id()));
        let tlog = Some(TlogWriter::create(&path).expect("a log file"));
        LinkConfig { name: name.into(), peer_system, accept_foreign, signing: None, tlog }
    };
    let companion = Companion {
        autopilot: (vehicle.autopilot.link.clone(), link("autopilot", vehicle.autopilot.system_id, true)),
        radio: None,
        pair: (
            vehicle.pair_link.clone(),
            link("pair", Some(if role == Role::I { 2 } else { 1 }), false),
            pair_form(&vehicle),
        ),
        transmitter: Transmitter::new(transmitter_settings(&vehicle, std::process::id()), clock.now()),
        settings: settings(&mission, &vehicle, std::process::id(), true),
        orders: None,
        computer: Some(std::env::temp_dir()),
        manager: Manager::none(),
        flown: None,
        edited: tokio::sync::mpsc::unbounded_channel().1,
        planner: Box::new(move || Ok(plan(&mission))),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    let outcome = runtime.block_on(companion.run(clock, std::future::pending())).expect("a flight");
    println!("vehicle {role}: {outcome:?}");
}

fn address(text: &str) -> LinkAddress {
    text.parse().unwrap_or_else(|error| panic!("{text}: {error}"))
}

/// A datagram, when it came.
struct Arrival {
    at: Instant,
    vehicle: usize,
    bytes: Vec<u8>,
}

fn receive(socket: &UdpSocket, vehicle: usize, peers: &Sender<(usize, SocketAddr)>, to: &Sender<Arrival>) {
    let mut buffer = [0; 2048];
    let mut known = None;
    while let Ok((length, from)) = socket.recv_from(&mut buffer) {
        let at = Instant::now();
        if known != Some(from) {
            known = Some(from);
            let _ = peers.send((vehicle, from));
        }
        if to.send(Arrival { at, vehicle, bytes: buffer[..length].to_vec() }).is_err() {
            return;
        }
    }
}

fn measure(seconds: f64, loaded: bool, flood_hz: f64) {
    let mission = mission(seconds);
    let world = World::new(world_config(&mission, &plan(&mission)).expect("a world")).expect("a world");
    let sockets = [0, 1].map(|_| UdpSocket::bind("127.0.0.1:0").expect("a socket"));
    let pair_port = {
        let free = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        free.local_addr().expect("an address").port()
    };
    let mut companions: Vec<Child> = Vec::new();
    for (role, pair) in [("i", "udpin"), ("j", "udpout")] {
        let port = sockets[companions.len()].local_addr().expect("an address").port();
        let links = format!("udpout:127.0.0.1:{port},{pair}:127.0.0.1:{pair_port}");
        let program = std::env::current_exe().expect("this program");
        let child = Command::new(program)
            .args(["--companion", role, "--links", &links, "--seconds", &seconds.to_string()])
            .stdin(Stdio::null())
            .spawn();
        companions.push(child.expect("a companion process"));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let stop = AtomicBool::new(false);
    let ((peer_sender, peers), (sender, arrivals)) = (channel(), channel());
    for (vehicle, socket) in sockets.iter().enumerate() {
        let socket = socket.try_clone().expect("a socket");
        let (peer_sender, sender) = (peer_sender.clone(), sender.clone());
        std::thread::spawn(move || receive(&socket, vehicle, &peer_sender, &sender));
    }
    std::thread::scope(|scope| {
        if loaded {
            for _ in 0..cores {
                scope.spawn(|| burn(&stop));
            }
        }
        let mut load = if loaded { format!("{cores} of {cores} cores busy") } else { "idle".into() };
        if flood_hz > 0.0 {
            scope.spawn(|| flood(pair_port, flood_hz, &stop));
            load += &format!(", {flood_hz:.0} junk datagrams a second");
        }
        eprintln!("flying one slot of {seconds} s, {load} ...");
        // Take-off, the way there and back, and landing take a minute.
        let longest = Duration::from_secs_f64(seconds) + Duration::from_secs(180);
        let measured = host(world, &sockets, &peers, &arrivals, &mut companions, longest);
        stop.store(true, Ordering::Relaxed);
        for child in &mut companions {
            // It has ended already unless the flight did not.
            let _ = child.kill();
            let _ = child.wait();
        }
        measured.print(&load);
    });
}

/// Keeps a core busy.
fn burn(stop: &AtomicBool) {
    let mut x = 1.0_f64;
    while !stop.load(Ordering::Relaxed) {
        for _ in 0..10_000 {
            x = std::hint::black_box(x.mul_add(1.000_000_1, 1e-9).sqrt());
        }
    }
}

/// Random datagrams from a stranger, a hundredth of a second's worth at a time.
fn flood(port: u16, rate_hz: f64, stop: &AtomicBool) {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let started = Instant::now();
    let (mut sent, mut seed) = (0_u64, 1_u64);
    let mut junk = [0; 280];
    while !stop.load(Ordering::Relaxed) {
        while (sent as f64) < rate_hz * started.elapsed().as_secs_f64() {
            for byte in &mut junk {
                // A linear congruential generator (Knuth's MMIX): junk need not be better.
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                *byte = (seed >> 33) as u8;
            }
            // Now and then it looks like the beginning of a frame.
            junk[0] = if sent % 4 == 0 { 0xFD } else { junk[0] };
            let length = 1 + (seed >> 40) as usize % (junk.len() - 1);
            let _ = socket.send_to(&junk[..length], ("127.0.0.1", port));
            sent += 1;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    eprintln!("{:.0} junk datagrams a second were sent", sent as f64 / started.elapsed().as_secs_f64());
}

#[derive(Default)]
struct Measured {
    /// Arrivals of position setpoints of vehicle I.
    setpoints: Vec<Instant>,
    /// The longest pass of this process's own loop: a simulated vehicle that stalls is lost to its companion.
    worst_stall: Duration,
    /// Processor time and instant at the first and at the last setpoint.
    used: Option<[(Duration, Instant); 2]>,
    resident_kib: Option<[u64; 2]>,
    peak_kib: u64,
}

fn host(
    mut world: World,
    sockets: &[UdpSocket; 2],
    peers: &Receiver<(usize, SocketAddr)>,
    arrivals: &Receiver<Arrival>,
    companions: &mut [Child],
    longest: Duration,
) -> Measured {
    let started = Instant::now();
    let mut to: [Option<SocketAddr>; 2] = [None; 2];
    let mut decoder: Decoder<MavMessage> = Decoder::default();
    let mut counters = Counters::default();
    let mut measured = Measured::default();
    let mut ended = [false; 2];
    let mut passed = started;
    while ended != [true; 2] && started.elapsed() < longest {
        measured.worst_stall = measured.worst_stall.max(passed.elapsed());
        passed = Instant::now();
        while let Ok((vehicle, from)) = peers.try_recv() {
            to[vehicle] = Some(from);
        }
        world.advance(started.elapsed());
        while let Ok(arrival) = arrivals.try_recv() {
            world.handle(arrival.vehicle, 0, &arrival.bytes);
            if arrival.vehicle == index(Role::I) && is_setpoint(&mut decoder, &mut counters, &arrival.bytes) {
                measured.setpoint(arrival.at, companions[0].id());
            }
        }
        while let Some((vehicle, link, frame)) = world.poll_transmit() {
            if let (0, Some(address)) = (link, to[vehicle]) {
                // A companion that has ended refuses; the rest is UDP's to lose.
                let _ = sockets[vehicle].send_to(&frame, address);
            }
        }
        for (ended, child) in ended.iter_mut().zip(companions.iter_mut()) {
            *ended |= child.try_wait().expect("a child process").is_some();
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    measured
}

fn is_setpoint(decoder: &mut Decoder<MavMessage>, counters: &mut Counters, bytes: &[u8]) -> bool {
    decoder.feed(bytes);
    decoder.end();
    let mut found = false;
    while let Some(raw) = decoder.next_frame(counters) {
        let frame = raw.parse::<MavMessage>();
        found |=
            frame.is_ok_and(|frame| matches!(frame.message, MavMessage::SET_POSITION_TARGET_LOCAL_NED(_)));
    }
    found
}

impl Measured {
    fn setpoint(&mut self, at: Instant, pid: u32) {
        self.setpoints.push(at);
        // Once a second is enough, and costs the host little.
        if self.setpoints.len() % 50 != 1 {
            return;
        }
        let Some(used) = processor_time(pid) else { return };
        let first = self.used.map_or((used, at), |[first, _]| first);
        self.used = Some([first, (used, at)]);
        if let Some(now_kib) = status_kib(pid, "VmRSS:") {
            self.resident_kib = Some([self.resident_kib.map_or(now_kib, |[first, _]| first), now_kib]);
        }
        self.peak_kib = status_kib(pid, "VmHWM:").unwrap_or(self.peak_kib);
    }

    fn print(&self, load: &str) {
        println!(
            "the simulated vehicles' own loop was held up by {:.1} ms at worst",
            self.worst_stall.as_secs_f64() * 1e3
        );
        let (Some(first), Some(last)) = (self.setpoints.first(), self.setpoints.last()) else {
            return println!(
                "no setpoint came: the machine is too busy to simulate the vehicles in real time"
            );
        };
        let settled = |at: &&Instant| **at > *first + SETTLE && **at + SETTLE < *last;
        let times: Vec<_> = self.setpoints.iter().filter(settled).collect();
        let mut intervals: Vec<f64> =
            times.windows(2).map(|pair| pair[1].duration_since(*pair[0]).as_secs_f64() * 1e3).collect();
        intervals.sort_unstable_by(f64::total_cmp);
        if intervals.is_empty() {
            return println!("setpoints came for {:.1} s alone", last.duration_since(*first).as_secs_f64());
        }
        let at = |share: f64| intervals[((intervals.len() - 1) as f64 * share) as usize];
        println!(
            "setpoints of vehicle I over {:.0} s at 50 Hz, {load}: {} intervals, median {:.2} ms, p99 {:.2} ms, worst {:.2} ms",
            last.duration_since(*first).as_secs_f64(),
            intervals.len(),
            at(0.5),
            at(0.99),
            at(1.0)
        );
        if let (Some([(from, since), (to, until)]), Some([at_first, at_last])) =
            (self.used, self.resident_kib)
        {
            let share = (to - from).as_secs_f64() / until.duration_since(since).as_secs_f64();
            println!(
                "its companion: {:.2}% of one core; resident {:.1} MiB at the first setpoint, {:.1} MiB at the last, {:.1} MiB at most",
                share * 100.0,
                at_first as f64 / 1024.0,
                at_last as f64 / 1024.0,
                self.peak_kib as f64 / 1024.0
            );
        }
    }
}

/// User and system time of a process. Linux counts in hundredths of a second, whatever its own tick.
fn processor_time(pid: u32) -> Option<Duration> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // After the name, which is in parentheses: state is field 3, utime 14, stime 15.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: u64 = fields.get(11)?.parse::<u64>().ok()? + fields.get(12)?.parse::<u64>().ok()?;
    Some(Duration::from_millis(10 * ticks))
}

fn status_kib(pid: u32, key: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    status.lines().find_map(|line| line.strip_prefix(key))?.split_whitespace().next()?.parse().ok()
}
