//! From a mission file and a vehicle file to what the state machines of one companion are told.

use std::sync::Arc;
use std::time::Duration;

use crate::autopilot::{self, Fence, FenceDuty};
use crate::config::{ExposedLink, FenceShape, Mission, Optimise, Transmitter, User, Vehicle, fence_corners};
use crate::link::Form;
use crate::mission::following::Following;
use crate::mission::{Battery, Measured, Operators, Permission, Replanner, Scene, Settings};
use crate::pair::{self, Record};
use crate::planner::problem::{Airframe, Airspace};
use crate::planning;
use crate::preflight::{Check, Verdict, check};
use crate::role::{PerVehicle, Role};
use crate::schedule::outset::Outset;
use crate::service::Ceilings;
use crate::transmitter::{self, Demands, Permitted};

/// The longest jam lease and transmitter lease: the time in which everything falls silent by itself.
pub const LEASE: Duration = Duration::from_millis(500);
/// A radio that answers later than this serves no slot. J's lease of [`LEASE`] runs while its command is answered, the
/// answer vouches for a round trip less than that, and it is renewed every 100 ms: at 150 ms a fifth of it is left for
/// the pair link and I's radio. Of what I is granted its own radio takes one round trip.
const LONGEST_ROUND_TRIP: PerVehicle<Duration> =
    PerVehicle { i: Duration::from_millis(250), j: Duration::from_millis(150) };
/// How late a busy machine may run a process that is due.
const SCHEDULING_DELAY: Duration = Duration::from_millis(25);
/// Without a word for this long the other vehicle is not heard any more, and unless the mission waits longer for it, given up.
pub const PEER_TIMEOUT: Duration = Duration::from_secs(3);

/// What the executive of `vehicle` is told. `boot_id` differs at each start of a companion; `start_unasked` begins
/// the mission without waiting for MISSION_START.
#[must_use]
pub fn settings(mission: &Mission, vehicle: &Vehicle, boot_id: u32, start_unasked: bool) -> Settings {
    let role = vehicle.role;
    let own = own(vehicle);
    let limits = mission.transit_limits();
    let mut autopilot = autopilot::Settings::new(own, mission.origin);
    autopilot.autopilot_system = vehicle.autopilot.system_id;
    autopilot.rate_hz = vehicle.autopilot.rate_hz;
    autopilot.planned_tilt_rad = match mission.vehicles[role].airframe {
        Airframe::Omnidirectional => mission.vehicles[role].max_tilt_rad.min(mission.airspace_max_tilt_rad),
        Airframe::Conventional => 0.0,
    };
    autopilot.transit = limits[role];
    autopilot.return_altitude_m = return_altitude_m(role, &mission.airspace);
    autopilot.fence = Some(fence(mission, vehicle));
    autopilot.tilt_rate_rad_s = limits[role].tilt_rate_rad_s;
    autopilot.firmware = vehicle.autopilot.firmware;
    autopilot.actuation = vehicle.autopilot.actuation;
    autopilot.tracks_pose = vehicle.autopilot.tracks_pose;
    autopilot.position_control.thrust_n = vehicle.autopilot.thrust_n;
    Settings {
        role,
        own,
        autopilot,
        battery: Battery {
            endurance: vehicle.battery.endurance_s.map(Duration::from_secs_f64),
            reserve: vehicle.battery.reserve,
        },
        pair: pair::Settings {
            role,
            boot_id,
            mission_digest: mission.digest(),
            lease: LEASE,
            peer_timeout: PEER_TIMEOUT,
            lost_after: mission.tdma.wait_for_peer_s.map_or(PEER_TIMEOUT, Duration::from_secs_f64),
            clock_tolerance: Duration::from_secs_f64(mission.tdma.guard_s / 4.0),
            orders: Record::default(),
        },
        airspace: mission.airspace.clone(),
        limits,
        timing: mission.timing(),
        order: mission.tdma.order,
        jitter: mission.jitter,
        ceilings: Ceilings {
            mission_w: mission.power_ceiling(role).0,
            vehicle_w: vehicle.limits.max_power_w.unwrap_or(f64::INFINITY),
        },
        emission_authorised: vehicle.transmitter.simulated
            || (mission.emission.is_some() && vehicle.exposed_links().is_empty()),
        permission: permission(mission, vehicle),
        demands: demands(mission, vehicle),
        given_checks: link_checks(vehicle).into_iter().chain(return_check(&mission.airspace)).collect(),
        radio_apart: vehicle.transmitter.link.is_some(),
        operators: match vehicle.autopilot.key_file {
            Some(_) => Operators::Proven,
            None => Operators::Systems(vehicle.operators.clone()),
        },
        scene: Scene {
            users_enu_m: mission.users.iter().map(|user| user.position_enu_m).collect(),
            eavesdroppers_enu_m: mission.eavesdroppers.iter().map(|e| e.node.position_enu_m).collect(),
            radio: mission.radio,
            antennas: mission.antennas.clone(),
            fading: mission.fading,
        },
        following: following(mission),
        replanner: replanner(mission),
        start_unasked,
        start_utc: mission.tdma.start_utc,
    }
}

/// Those that move, if any do.
fn following(mission: &Mission) -> Option<Arc<Following>> {
    let problem = |index: usize, user: &User| Some((user.name.clone(), Arc::new(mission.problem(index)?)));
    let problems = mission.users.iter().enumerate().filter_map(|(index, user)| problem(index, user));
    (!mission.movers.is_empty()).then(|| {
        let (problems, movers) = (problems.collect(), mission.movers.clone());
        let by_volume = mission.planner.optimise == Optimise::Volume;
        Arc::new(Following { problems, movers, options: planning::options(mission), by_volume })
    })
}

/// Makes the plan anew, where nothing moves and the mission asks for it.
fn replanner(mission: &Mission) -> Option<Replanner> {
    let asked = mission.planner.replan && mission.movers.is_empty();
    let mission = asked.then(|| mission.clone())?;
    Some(Replanner::new(move |measured: &Measured, order| {
        planning::again(&mission, measured.jitter_rad(mission.jitter.std_rad), &measured.shares(), order)
    }))
}

/// Where a vehicle's autopilot crosses when it returns by itself, in metres above the origin: I in the lower half of the band,
/// J in the upper, the separation apart, and I that much above its lower end, up to which either takes off and lands.
/// `None` where the band is too thin for that.
fn return_altitude_m(role: Role, airspace: &Airspace) -> Option<[f64; 2]> {
    let [low_m, high_m] = airspace.altitude_m;
    let (middle_m, apart_m) = (0.5 * (low_m + high_m), airspace.min_separation_m);
    let band_m = match role {
        Role::I => [low_m + apart_m, middle_m - 0.5 * apart_m],
        Role::J => [middle_m + 0.5 * apart_m, high_m],
    };
    (low_m + apart_m <= middle_m - 0.5 * apart_m).then_some(band_m)
}

/// Whether there is room for the two altitudes. No place of the homes would do instead: each lies in the other's area, and on
/// the straight way home from somewhere.
fn return_check(airspace: &Airspace) -> Option<Check> {
    let [low_m, high_m] = airspace.altitude_m;
    let least_m = 3.0 * airspace.min_separation_m;
    return_altitude_m(Role::I, airspace).is_none().then(|| {
        let detail = format!(
            "the altitude band is {} m thick, should be at least {least_m} m, in the mission on both vehicles: there is no room for two \
             that are the separation apart and above the other's home, so that an autopilot's own return may meet the other vehicle",
            high_m - low_m
        );
        check("return altitudes", Verdict::Warn, detail)
    })
}

/// The fence that the autopilot is to have: none where no autopilot keeps so many corners, which
/// [`Vehicle::check_against`] refuses unless the vehicle file asks for none.
fn fence(mission: &Mission, vehicle: &Vehicle) -> Fence {
    let (duty, FenceShape { area: Outset { corners, tight }, zones, untold }) = match fence_corners(mission) {
        Ok(fence) => (vehicle.autopilot.fence, fence),
        Err(_) => (FenceDuty::None, FenceShape::default()),
    };
    Fence {
        duty,
        corners_enu_m: corners,
        zones_enu_m: zones,
        untold,
        tight,
        top_m: mission.airspace.altitude_m[1],
        home_within_m: mission.airspace.min_separation_m,
    }
}

/// The mission's permission to radiate, as far as this vehicle needs it.
fn permission(mission: &Mission, vehicle: &Vehicle) -> Permission {
    let emission = mission.emission.as_ref();
    Permission {
        real: vehicle.is_real(),
        valid: emission.and_then(|emission| emission.valid),
        statement: match emission {
            Some(emission) if vehicle.is_real() => emission.to_string(),
            Some(emission) => format!("simulated transmitter; the mission's is {emission}"),
            None => "simulated transmitter, no [emission] table".to_owned(),
        },
    }
}

/// What is asked of the vehicle's radio.
fn demands(mission: &Mission, vehicle: &Vehicle) -> Demands {
    Demands {
        role: vehicle.role,
        real: vehicle.is_real(),
        guard: mission.timing().guard,
        lease: LEASE,
        permitted: mission
            .emission
            .as_ref()
            .map(|emission| Permitted { band_hz: emission.band_hz, max_power_w: emission.max_power_w }),
        accept_orphaned: vehicle.transmitter.accept_orphaned_radio,
    }
}

/// Whether anybody can speak on the links of a real transmitter (T1). [`Vehicle::check_against`] refuses the same.
fn link_checks(vehicle: &Vehicle) -> Vec<Check> {
    if !vehicle.is_real() {
        return Vec::new();
    }
    let exposed = vehicle.exposed_links();
    let failed = exposed.iter().map(|link| {
        let ExposedLink { name, key_setting, .. } = link;
        let detail = format!(
            "the transmitter is real, and {name} is neither signed nor a serial line: give {key_setting}"
        );
        check("links", Verdict::Fail, detail)
    });
    let mut all: Vec<Check> = failed.collect();
    if vehicle.key_file.is_none() && !vehicle.pair_link.is_point_to_point() {
        let detail = "the transmitter is real, and whoever reaches the pair's link can speak as the other vehicle: give [pair] key_file";
        all.push(check("links", Verdict::Warn, detail));
    }
    all
}

/// How pair messages go over the pair link.
#[must_use]
pub fn pair_form(vehicle: &Vehicle) -> Form {
    if vehicle.pair_tunnel {
        // The vehicle file names the peer's system then.
        Form::Tunnel { to_system: vehicle.pair_peer_system.unwrap_or_default() }
    } else {
        Form::Plain
    }
}

/// Allows for this machine's own delays where the companion's clock runs `rate` times as fast as the machine's: they
/// last so many times longer on it.
pub fn allow_for_clock_rate(settings: &mut Settings, rate: f64) {
    settings.autopilot.scheduling_allowance = scheduling_allowance(rate);
}

/// How much later than at the machine's own rate a busy machine may run a process, on a clock that runs `rate` times as
/// fast.
#[must_use]
pub fn scheduling_allowance(rate: f64) -> Duration {
    SCHEDULING_DELAY.mul_f64((rate - 1.0).clamp(0.0, 1e3))
}

/// What the driver of the vehicle's transmitter is told; `boot_id` as for [`settings`].
#[must_use]
pub fn transmitter_settings(vehicle: &Vehicle, boot_id: u32) -> transmitter::Settings {
    let own = own(vehicle);
    let Transmitter { kind, link, component_id, system_id, .. } = &vehicle.transmitter;
    // J may have promised to jam before its companion died; its radio's own lease ends that promise.
    let first_off_after = match vehicle.role {
        Role::I => Duration::ZERO,
        Role::J => LEASE,
    };
    transmitter::Settings {
        own,
        target: (system_id.unwrap_or(own.0), *component_id),
        apart: link.is_some(),
        system_is_given: system_id.is_some(),
        kind: kind.clone(),
        boot: boot_id,
        longest_round_trip: LONGEST_ROUND_TRIP[vehicle.role],
        first_off_after,
    }
}

/// The companion's own MAVLink system and component.
fn own(vehicle: &Vehicle) -> (u8, u8) {
    // Where the vehicle file names no system.
    let default = match vehicle.role {
        Role::I => 1,
        Role::J => 2,
    };
    (vehicle.autopilot.system_id.unwrap_or(default), vehicle.autopilot.component_id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::VehicleDraft;
    use crate::link::{HostPort, LinkAddress};

    #[test]
    fn spec_the_two_return_at_altitudes_that_are_apart_and_above_where_either_lands() {
        let mission = Mission::parse("mission.toml", include_str!("../../config/mission.toml")).unwrap();
        // A band of 20 to 80 m and 5 m of separation.
        assert_eq!(return_altitude_m(Role::I, &mission.airspace), Some([25.0, 47.5]));
        assert_eq!(return_altitude_m(Role::J, &mission.airspace), Some([52.5, 80.0]));
        let mut thin = mission.airspace.clone();
        thin.altitude_m = [20.0, 30.0];
        assert_eq!(Role::BOTH.map(|role| return_altitude_m(role, &thin)), [None; 2]);
        // Then the preflight warns, with what would do.
        assert_eq!(return_check(&mission.airspace), None);
        let warning = return_check(&thin).unwrap();
        assert!(warning.result == Verdict::Warn, "{warning:?}");
        assert!(warning.detail.contains("10 m thick, should be at least 15 m"), "{warning:?}");
        thin.altitude_m = [20.0, 35.0];
        assert_eq!(return_check(&thin), None);
    }

    #[test]
    fn spec_each_vehicle_s_ceilings_are_its_own() {
        let mission = Mission::parse("mission.toml", include_str!("../../config/mission.toml")).unwrap();
        let watts = PerVehicle { i: 0.3, j: 0.2 };
        let mission = mission.changed(|draft| draft.radio.max_power_w = watts).unwrap();
        for role in Role::BOTH {
            let link = LinkAddress::UdpOut(HostPort { host: "127.0.0.1".into(), port: 1 });
            let mut draft = VehicleDraft::new(role, link);
            draft.autopilot.system_id = Some(1);
            assert_eq!(
                settings(&mission, &Vehicle::new(draft.clone()).unwrap(), 1, false).ceilings.vehicle_w,
                f64::INFINITY
            );
            draft.limits.max_power_w = Some(watts[role] / 2.0);
            let ceilings = settings(&mission, &Vehicle::new(draft).unwrap(), 1, false).ceilings;
            assert_eq!((ceilings.mission_w, ceilings.vehicle_w), (watts[role], watts[role] / 2.0));
        }
    }
}
