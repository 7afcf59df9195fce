//! The setpoints of a whole flight, against the trajectory that they follow: each at its own `time_boot_ms`.

use std::sync::Arc;
use std::time::Duration;

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    GPS_GLOBAL_ORIGIN_DATA, MavMessage, SET_ATTITUDE_TARGET_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use veilwing::autopilot::Firmware;
use veilwing::companion::settings::settings;
use veilwing::desk::simulation::{Flight, Given, Observer, Path, Setup, vehicle, world_config};
use veilwing::geo::{Attitude, Enu, EnuVelocity, Geodetic, LocalFrame, Ned, NedVelocity};
use veilwing::mission::{Notice, Outgoing};
use veilwing::pair::wire;
use veilwing::role::{PerVehicle, Role};
use veilwing::schedule::table::Table;
use veilwing::schedule::trajectory::{Start, Trajectory};
use veilwing::schedule::transit::{Router, Separation};
use veilwing_sitl::World;

use crate::harness::{LONGEST, yard};

/// `time_boot_ms` is cut off to whole milliseconds.
const MILLISECOND: Duration = Duration::from_millis(1);
/// What single precision and a home in units of 1e-7 degrees take from a position, in metres.
const WIRE_M: f64 = 1e-4;

/// What one companion was told and said.
#[derive(Debug, Default, Clone)]
struct Heard {
    firmware: Option<Firmware>,
    origin: Option<Geodetic>,
    /// As exchanged with the peer, to the last bit.
    home_enu_m: Option<Enu>,
    /// Simulation time at which it set off for its home.
    returns_at: Option<Duration>,
    /// With the simulation time of sending.
    positions: Vec<(Duration, SET_POSITION_TARGET_LOCAL_NED_DATA)>,
    attitudes: Vec<(Duration, SET_ATTITUDE_TARGET_DATA)>,
}

#[derive(Debug, Default)]
struct Recorder(PerVehicle<Heard>);

impl Observer for Recorder {
    fn said(&mut self, at: Duration, role: Role, _phase: Option<&'static str>, notice: &Notice) {
        if *notice == Notice::AllSlotsOver {
            self.0[role].returns_at = Some(at);
        }
    }

    fn sent(&mut self, at: Duration, role: Role, message: &Outgoing) {
        let heard = &mut self.0[role];
        match message {
            Outgoing::Pair(message) => {
                if let wire::MavMessage::VEILWING_HELLO(hello) = &**message
                    && hello.flags.contains(wire::VeilwingFlags::VEILWING_FLAGS_HOME)
                {
                    heard.home_enu_m = Some(Enu::from(hello.home_enu_m));
                }
            }
            Outgoing::Autopilot(message) | Outgoing::Radio(message) => match &**message {
                MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => heard.positions.push((at, m.clone())),
                MavMessage::SET_ATTITUDE_TARGET(m) => heard.attitudes.push((at, m.clone())),
                _ => {}
            },
        }
    }

    fn received(&mut self, _at: Duration, role: Role, header: MavHeader, message: &MavMessage) {
        let heard = &mut self.0[role];
        match message {
            MavMessage::HEARTBEAT(m) if header.component_id == 1 => heard.firmware = Firmware::of(m),
            MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
                latitude, longitude, altitude, ..
            }) => {
                heard.origin = Some(Geodetic {
                    lat_deg: f64::from(*latitude) * 1e-7,
                    lon_deg: f64::from(*longitude) * 1e-7,
                    alt_m: f64::from(*altitude) * 1e-3,
                });
            }
            _ => {}
        }
    }
}

/// The way home of both, as the plan and the homes give it: from the last slot's poses to above the homes.
fn ways_home(homes: &PerVehicle<Enu>) -> PerVehicle<Trajectory> {
    let planned = yard();
    let settings = settings(&planned.mission, &vehicle(&planned.mission, Role::I).unwrap(), 1, true);
    let router = Router::new(&settings.airspace, &settings.limits).unwrap();
    let floor_m = settings.airspace.altitude_m[0];
    let start = homes
        .map(|home| Start { position_enu_m: Enu::new(home.x, home.y, floor_m), attitude: Attitude::level() });
    let users: Vec<_> =
        planned.plan.slots.iter().map(|slot| vec![slot.plan.vehicles.map(|v| v.pose)]).collect();
    let table = Table::build(&router, &start, &users, &settings.timing, settings.order).unwrap();
    let last = table.entries.last().unwrap();
    let home = router.home(&PerVehicle::from_fn(|role| last.transit[role].end()), homes).unwrap();
    assert_eq!(home.separation, Separation::Paths, "both fly at once");
    home.trajectories
}

/// Milliseconds between `time_boot_ms` and the simulation's time: a companion's time begins at a whole second.
fn boot_offset(boot_ms: u32, at: Duration) -> Duration {
    Duration::from_secs_f64((f64::from(boot_ms) * 1e-3 - at.as_secs_f64()).round())
}

#[test]
fn spec_each_setpoint_of_a_transit_is_the_trajectory_at_its_own_time() {
    let planned = yard();
    let given = PerVehicle::from_fn(|role| {
        let (mission, plan) = (planned.mission.clone(), planned.plan.clone());
        Arc::new(Given { mission, plan, vehicle: vehicle(&yard().mission, role).unwrap() })
    });
    let setup = Setup { given, start_unasked: true, autopilot: Path::GOOD, pair: Path::GOOD, seed: 1 };
    let world = World::new(world_config(&planned.mission, &planned.plan).unwrap()).unwrap();
    let mut flight = Flight::new(world, setup);
    let mut recorder = Recorder::default();
    while Role::BOTH.iter().any(|role| flight.outcomes[*role].is_none()) {
        assert!(flight.now() < LONGEST, "{:?}", flight.outcomes);
        flight.step(LONGEST, &mut recorder).unwrap();
    }
    let homes = PerVehicle::from_fn(|role| recorder.0[role].home_enu_m.unwrap());
    let limits = settings(&planned.mission, &vehicle(&planned.mission, Role::I).unwrap(), 1, true).limits;
    for (role, way) in Role::BOTH.into_iter().map(|role| (role, ways_home(&homes)[role].clone())) {
        let heard = &recorder.0[role];
        let returns_at = heard.returns_at.unwrap();
        let frame = LocalFrame {
            mission: planned.mission.origin,
            autopilot: heard.origin.unwrap(),
            projection: heard.firmware.unwrap().projection(),
        };
        let (mut compared, mut fastest_m_s, mut worst_m) = (0, 0.0_f64, 0.0_f64);
        // On the trajectory's own time.
        let when = |at: Duration, boot_ms: u32| {
            let begins = returns_at + boot_offset(boot_ms, at);
            Duration::from_millis(boot_ms.into()).saturating_sub(begins)
        };
        for (at, m) in heard.positions.iter().filter(|(at, _)| *at >= returns_at) {
            let t = when(*at, m.time_boot_ms);
            let (wanted, a_moment_later) = (way.sample(t), way.sample(t + MILLISECOND));
            let there = frame.position_to_enu(Ned::new(m.x.into(), m.y.into(), m.z.into()));
            let speeds = [wanted, a_moment_later].map(|sample| sample.velocity_enu_m_s.vector().norm());
            let speed_m_s = speeds[0].max(speeds[1]);
            let off_m = (there - wanted.position_enu_m).norm();
            assert!(off_m <= speed_m_s * 1e-3 + WIRE_M, "{role} at {at:?}: {off_m} m at {speed_m_s} m/s");
            let velocity = EnuVelocity::from(NedVelocity::new(m.vx.into(), m.vy.into(), m.vz.into()));
            let off_m_s = (velocity.vector() - wanted.velocity_enu_m_s.vector()).norm();
            assert!(
                off_m_s <= limits[role].acceleration_m_s2 * 1e-3 + 1e-5,
                "{role} at {at:?}: {off_m_s} m/s"
            );
            (compared, fastest_m_s, worst_m) = (compared + 1, fastest_m_s.max(speed_m_s), worst_m.max(off_m));
        }
        for (at, m) in heard.attitudes.iter().filter(|(at, _)| *at >= returns_at) {
            let wanted = way.sample(when(*at, m.time_boot_ms)).attitude;
            let off_rad = Attitude::from_mavlink(m.q.map(f64::from)).unwrap().angle_to(&wanted);
            // An angle from quaternions of single precision is good to a milliradian.
            assert!(off_rad <= limits[role].tilt_rate_rad_s * 1e-3 + 1e-3, "{role} at {at:?}: {off_rad} rad");
        }
        println!("{role}: {compared} setpoints, up to {fastest_m_s:.2} m/s, at most {worst_m:.6} m off");
        // A setpoint of the tick before would be off by 20 ms of travel.
        assert!(compared > 100 && fastest_m_s > 2.0, "{role}: {compared} setpoints, {fastest_m_s} m/s");
        assert!(heard.attitudes.iter().any(|(at, _)| *at >= returns_at));
    }
}
