//! The bench against a software vehicle, over a link that may lose and delay, in virtual time.

// Helpers of tests fail as tests do.
#![allow(clippy::unwrap_used, clippy::panic)]

use veilwing_sitl as sim;

use super::*;
use crate::desk::simulation::{Path, Pipe};
use crate::geo::Geodetic;
use crate::link::codec::Decoder;
use crate::link::{Aboard, Counters};

const UTC: Utc = Utc { unix_us: 1_795_433_997_000_000 };

struct Stand {
    bench: Bench,
    vehicle: sim::Vehicle,
    there: Pipe,
    back: Pipe,
    decoder: Decoder<Aboard>,
    now: Duration,
    /// What has gone out.
    said: BTreeMap<&'static str, u64>,
    peer: Option<Bench>,
}

impl Stand {
    /// A vehicle whose clock is ahead of ours by so much, behind a link of these manners.
    fn new(path: Path, ahead_us: u64) -> Self {
        let origin = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };
        let mut autopilot = autopilot::Settings::new((1, 191), origin);
        autopilot.autopilot_system = Some(1);
        autopilot.tracks_pose = true;
        autopilot.planned_tilt_rad = 0.0;
        let transmitter = transmitter::Settings {
            own: (1, 191),
            target: (1, 68),
            apart: false,
            system_is_given: false,
            kind: Kind::Numbered { command: 31_010 },
            boot: 7,
            longest_round_trip: Duration::from_millis(250),
            first_off_after: Duration::ZERO,
        };
        let settings = Settings { role: Role::I, own: (1, 191), autopilot, transmitter, radio_apart: false };
        let config = sim::VehicleConfig::new(sim::Role::I);
        let home = sim::Origin { lat_deg: 50.0755, lon_deg: 14.4378, alt_amsl_m: 200.0 };
        let jitter = sim::JitterConfig { std_deg: 0.0, ..sim::JitterConfig::default() };
        let vehicle = sim::Vehicle::new(config, jitter, home, UTC.unix_us + ahead_us, 1);
        Self {
            bench: Bench::new(settings, Instant::ZERO),
            vehicle,
            there: Pipe::new(path, 1, 0),
            back: Pipe::new(path, 1, 1),
            decoder: Decoder::default(),
            now: Duration::ZERO,
            said: BTreeMap::new(),
            peer: None,
        }
    }

    fn healthy() -> Self {
        Self::new(Path { delay: Duration::from_millis(2), ..Path::GOOD }, 0)
    }

    fn run(&mut self, seconds: u64) {
        let end = self.now + Duration::from_secs(seconds);
        while self.now < end {
            self.now += Duration::from_millis(1);
            let (now, utc) = (Instant::from_start(self.now), UTC + self.now);
            self.vehicle.advance(self.now);
            while let Some((_, bytes)) = self.vehicle.poll_transmit() {
                self.back.send(&bytes, self.now);
            }
            while let Some(bytes) = self.back.receive(self.now) {
                self.decoder.feed(&bytes);
                while let Some(raw) = self.decoder.next_frame(&mut Counters::default()) {
                    let Ok(frame) = raw.parse::<Aboard>() else { continue };
                    match &frame.message {
                        Aboard::Common(message) => {
                            self.bench.handle_autopilot(frame.header, message, now, utc)
                        }
                        Aboard::Radio(enclosed) => {
                            self.bench.handle_report(frame.header, enclosed.message(), now)
                        }
                    }
                }
            }
            if self.bench.poll_timeout() <= now {
                self.bench.handle_timeout(now, utc);
            }
            if let Some(peer) = self.peer.as_mut().filter(|peer| peer.poll_timeout() <= now) {
                peer.handle_timeout(now, utc);
            }
            self.carry(now, utc);
        }
    }

    fn carry(&mut self, now: Instant, utc: Utc) {
        while let Some(outgoing) = self.bench.poll_transmit() {
            match outgoing {
                Outgoing::Autopilot(message) => {
                    *self.said.entry(message.message_name()).or_default() += 1;
                    let header = MavHeader { system_id: 1, component_id: 191, sequence: 0 };
                    let mut bytes = Vec::new();
                    mavlink::write_v2_msg(&mut bytes, header, &Aboard::Common(*message)).unwrap();
                    self.there.send(&bytes, self.now);
                }
                Outgoing::Radio(message) => panic!("{message:?}"),
                Outgoing::Pair(message) => {
                    if let Some(peer) = &mut self.peer {
                        peer.handle_pair(&message, now, utc);
                    }
                }
            }
        }
        let said: Vec<Outgoing> =
            self.peer.iter_mut().flat_map(|peer| std::iter::from_fn(|| peer.poll_transmit())).collect();
        for outgoing in said {
            if let Outgoing::Pair(message) = outgoing {
                self.bench.handle_pair(&message, now, utc);
            }
        }
        while let Some(bytes) = self.there.receive(self.now) {
            self.vehicle.handle(0, &bytes, self.now);
        }
    }

    /// All lines, by name; the worst where several have one name.
    fn verdicts(&self) -> BTreeMap<String, Verdict> {
        let mut all = BTreeMap::new();
        for line in self.bench.lines(Instant::from_start(self.now)) {
            let worst = all.entry(line.name).or_insert(line.verdict);
            *worst = (*worst).max(line.verdict);
        }
        all
    }
}

/// Lines that do not pass.
fn complaints(verdicts: &BTreeMap<String, Verdict>) -> Vec<(&str, Verdict)> {
    let not_passed = verdicts.iter().filter(|(_, verdict)| **verdict != Verdict::Pass);
    not_passed.map(|(name, verdict)| (name.as_str(), *verdict)).collect()
}

#[test]
fn spec_a_healthy_vehicle_passes_on_its_link_its_messages_its_clocks_and_its_radio() {
    let mut stand = Stand::healthy();
    stand.run(16);
    stand.bench.set_under_load();
    stand.run(8);
    let verdicts = stand.verdicts();
    for name in [
        "autopilot link",
        "autopilot link loss",
        "LOCAL_POSITION_NED",
        "ATTITUDE_QUATERNION",
        "GPS_RAW_INT",
        "age of state",
        "clock",
        "clock drift",
        "cadence at rest",
        "cadence under load",
        "radio",
        "transmitter expiry",
        "telemetry",
    ] {
        assert_eq!(
            verdicts.get(name),
            Some(&Verdict::Pass),
            "{name}: {:#?}",
            stand.bench.lines(Instant::from_start(stand.now))
        );
    }
    assert!(
        complaints(&verdicts).iter().all(|(_, verdict)| *verdict == Verdict::Warn),
        "{:?}",
        complaints(&verdicts)
    );
    // The other vehicle is not there.
    assert_eq!(verdicts["pair link"], Verdict::Warn);
    // Nothing was flown, set or radiated: the vehicle stands disarmed, with its radio off.
    let snapshot = stand.vehicle.snapshot();
    assert!(!snapshot.armed && snapshot.tx_power_w.unwrap_or(0.0) == 0.0, "{snapshot:?}");
    let may = [
        "HEARTBEAT",
        "TIMESYNC",
        "PARAM_REQUEST_READ",
        "COMMAND_LONG",
        "COMMAND_INT",
        "MISSION_ACK",
        "MISSION_REQUEST_INT",
        "MISSION_REQUEST_LIST",
    ];
    assert!(stand.said.keys().all(|name| may.contains(name)), "{:?}", stand.said);
    assert!(stand.said["COMMAND_INT"] > 20, "off, again and again: {:?}", stand.said);
    assert_eq!(stand.vehicle.counters().setpoints.accepted, 0);
}

#[test]
fn spec_a_lossy_and_slow_link_fails_in_its_own_lines() {
    let mut stand = Stand::new(Path { loss: 0.2, delay: Duration::from_millis(80), ..Path::GOOD }, 0);
    stand.run(30);
    let verdicts = stand.verdicts();
    assert_eq!(verdicts["autopilot link"], Verdict::Warn, "160 ms there and back");
    assert_eq!(verdicts["autopilot link loss"], Verdict::Fail, "36 of 100, both ways together");
    assert_ne!(verdicts["ATTITUDE_QUATERNION"], Verdict::Pass, "{verdicts:?}");
    assert_ne!(verdicts["age of state"], Verdict::Pass, "{verdicts:?}");
    assert_eq!((verdicts["clock"], verdicts["cadence at rest"]), (Verdict::Pass, Verdict::Pass));
}

#[test]
fn spec_a_clock_two_seconds_off_is_warned_of_alone() {
    let mut healthy = Stand::healthy();
    let mut stand = Stand::new(Path { delay: Duration::from_millis(2), ..Path::GOOD }, 2_000_000);
    healthy.run(24);
    stand.run(24);
    let (before, verdicts) = (healthy.verdicts(), stand.verdicts());
    assert_eq!(verdicts["clock"], Verdict::Warn);
    let others = |all: &BTreeMap<String, Verdict>| {
        all.iter()
            .filter(|(name, _)| *name != "clock")
            .map(|(name, verdict)| (name.clone(), *verdict))
            .collect::<Vec<_>>()
    };
    assert_eq!(others(&verdicts), others(&before));
    let line = stand
        .bench
        .lines(Instant::from_start(stand.now))
        .into_iter()
        .find(|line| line.name == "clock")
        .unwrap();
    assert!(
        line.seen.starts_with("2.0") && line.seen.contains("behind") && line.remedy.is_some(),
        "{line:?}"
    );
}

#[test]
fn spec_two_benches_measure_the_pair_s_link_between_them() {
    let mut stand = Stand::healthy();
    stand.peer = Some(Stand::healthy().bench);
    stand.run(6);
    let verdicts = stand.verdicts();
    for name in ["pair link", "pair link loss", "pair clocks"] {
        assert_eq!(verdicts[name], Verdict::Pass, "{verdicts:?}");
    }
}

#[test]
fn spec_nothing_that_answers_is_told_and_an_armed_vehicle_is_seen() {
    let mut stand = Stand::new(Path::CUT, 0);
    stand.run(8);
    let verdicts = stand.verdicts();
    assert_eq!((verdicts["autopilot link"], verdicts["autopilot"]), (Verdict::Fail, Verdict::Fail));
    assert!(!stand.bench.is_armed());
    let mut stand = Stand::healthy();
    stand.run(2);
    let armed = mavlink::dialects::ardupilotmega::HEARTBEAT_DATA {
        autopilot: mavlink::dialects::ardupilotmega::MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: mavlink::dialects::ardupilotmega::MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
        ..Default::default()
    };
    let header = MavHeader { system_id: 1, component_id: 1, sequence: 0 };
    stand.bench.handle_autopilot(header, &MavMessage::HEARTBEAT(armed), Instant::from_start(stand.now), UTC);
    assert!(stand.bench.is_armed());
}
