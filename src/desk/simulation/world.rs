//! A mission and its plan, told to the simulated world in the world's own terms.

use nalgebra::Vector2;
use veilwing_sitl as sim;

use crate::config::Mission;
use crate::geo::Attitude;
use crate::mission::following::Due;
use crate::planner::following::Who;
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::{Airframe, JitterAxes, JitterModel, NoFly};
use crate::planner::slots::Plan;
use crate::role::{PerVehicle, Role};
use crate::schedule::table::Table;
use crate::schedule::trajectory::Start;
use crate::schedule::transit::Router;
use crate::units::{Dbm, Watts};

use super::imperfections::{Imperfections, uncertainty};
use super::station::companion;
use super::turning;

/// The air where nothing is said of it: its mean velocity, and the wind at 6 m that its turbulence belongs to.
const BREEZE_ENU_M_S: [f64; 3] = [2.0, -1.0, 0.0];
const TURBULENCE_M_S: f64 = 2.2;
/// An owner sets the autopilot's ceiling so far above the altitude band.
const CEILING_M: f64 = 15.0;
/// Homes lie this far apart, or three separations if that is more.
const HOMES_APART_M: f64 = 20.0;

/// The world in which `mission` is flown as planned.
///
/// # Errors
/// A plan whose slots cannot be flown one after the other, or no room for two homes; in words.
pub fn world_config(mission: &Mission, plan: &Plan) -> Result<sim::WorldConfig, String> {
    world_over(&Imperfections::of(mission), mission, plan)
}

/// The same over a link with these imperfections, whatever the mission states.
pub(super) fn world_over(
    link: &Imperfections,
    mission: &Mission,
    plan: &Plan,
) -> Result<sim::WorldConfig, String> {
    let homes = homes(mission)?;
    Ok(sim::WorldConfig {
        seed: mission.seed,
        origin: sim::Origin {
            lat_deg: mission.origin.lat_deg,
            lon_deg: mission.origin.lon_deg,
            alt_amsl_m: mission.origin.alt_m,
        },
        // A Saturday noon; any instant serves, as long as both vehicles are told the same.
        utc_start_us: 1_800_014_400_000_000,
        vehicles: [vehicle(mission, Role::I, homes[0], link), vehicle(mission, Role::J, homes[1], link)],
        users: mission
            .users
            .iter()
            .enumerate()
            .map(|(index, user)| sim::Node {
                name: user.name.clone(),
                position_enu_m: user.position_enu_m.into(),
                uncertainty: link.user(index),
                roams: roams(mission, Who::User(index)),
            })
            .collect(),
        eavesdroppers: mission
            .eavesdroppers
            .iter()
            .enumerate()
            .map(|(index, e)| sim::Node {
                name: e.name.clone(),
                position_enu_m: e.node.position_enu_m.into(),
                uncertainty: uncertainty(e.node.uncertainty),
                roams: roams(mission, Who::Eavesdropper(index)),
            })
            .collect(),
        radio: sim::RadioConfig {
            bandwidth_hz: mission.radio.bandwidth_hz,
            noise_power_w: mission.radio.noise_power_w,
            reference_gain: mission.radio.reference_gain,
            max_power_w: [mission.power_ceiling(Role::I).0, mission.power_ceiling(Role::J).0],
        },
        fading: link.fading(),
        airspace: sim::AirspaceConfig {
            altitude_m: mission.airspace.altitude_m,
            area_enu_m: mission.airspace.area_enu_m.iter().map(|v| [v.x, v.y]).collect(),
            no_fly: mission.airspace.no_fly.iter().map(no_fly).collect(),
            min_separation_m: mission.airspace.min_separation_m,
        },
        jitter: sim::JitterConfig {
            std_deg: mission.jitter.std_rad.to_degrees(),
            model: match mission.jitter.model {
                JitterModel::Euler => sim::JitterModel::Euler,
                JitterModel::Body => sim::JitterModel::Body,
            },
            axes: match mission.jitter.axes {
                JitterAxes::RollPitch => sim::JitterAxes::RollPitch,
                JitterAxes::RollPitchYaw => sim::JitterAxes::RollPitchYaw,
            },
            correlation_s: 0.0,
        },
        slots: slots(mission, plan, homes)?,
        tolerance: sim::Tolerance::under_jitter(mission.jitter.std_rad.to_degrees()),
    })
}

/// What both fly, in the world's words.
#[must_use]
pub fn flown(due: &Due) -> sim::Flown {
    let pose = |VehiclePlan { pose, tx_power_w }: VehiclePlan| sim::PlannedPose {
        position_enu_m: pose.position_enu_m.into(),
        roll_rad: pose.roll_rad,
        pitch_rad: pose.pitch_rad,
        yaw_rad: pose.yaw_rad,
        tx_power_w,
        lean_deg: 0.0,
    };
    sim::Flown {
        poses: Role::BOTH.map(|role| pose(due.vehicles[role])),
        j_behind: pose(due.behind),
        most_w: Role::BOTH.map(|role| due.most_w[role]),
    }
}

/// How somebody moves, if it does.
fn roams(mission: &Mission, who: Who) -> Option<sim::Roams> {
    let mover = mission.movers.iter().find(|mover| mover.who == who)?;
    let (index, eavesdrops) = match who {
        Who::User(index) => (index, false),
        Who::Eavesdropper(index) => (index, true),
    };
    let number = u16::try_from(index + 1).unwrap_or(u16::MAX);
    let operator = sim::Reporter::Operator { to: companion(Role::I), number, eavesdrops };
    let reporter = mover.system_id.map_or(operator, sim::Reporter::Handset);
    let speed_m_s = mover.gait.speed_m_s();
    Some(sim::Roams { speed_m_s, track: Vec::new(), reporter, noise_m: mover.std_m })
}

fn no_fly(area: &NoFly) -> sim::NoFlyConfig {
    sim::NoFlyConfig {
        name: area.name.clone(),
        area_enu_m: area.area_enu_m.iter().map(|v| [v.x, v.y]).collect(),
        floor_m: area.floor_m,
        ceiling_m: area.ceiling_m,
    }
}

/// The slots in the order in which they are flown, over all superframes.
fn slots(mission: &Mission, plan: &Plan, homes: [Vector2<f64>; 2]) -> Result<Vec<sim::PlannedSlot>, String> {
    let bottom_m = mission.airspace.altitude_m[0];
    let start = PerVehicle { i: homes[0], j: homes[1] }
        .map(|home| Start { position_enu_m: home.push(bottom_m), attitude: Attitude::level() });
    let router =
        Router::new(&mission.airspace, &mission.transit_limits()).map_err(|error| error.to_string())?;
    let timing = mission.timing();
    let table =
        Table::of_plan(&router, &start, plan, &timing, mission.tdma.order).map_err(|e| e.to_string())?;
    let slots = table.entries.iter().filter_map(|entry| {
        let slot = plan.slots.get(entry.user_index)?;
        let turns = plan.turns.as_ref();
        let turned = turns.and_then(|turns| turns.slots.get(usize::from(entry.slot) % turns.slots.len()));
        Some(sim::PlannedSlot {
            user: slot.user.clone(),
            secrecy_rate_bps: turned
                .map_or(slot.plan.secrecy_rate_bps, |turned| turned.volume_bits / turned.on_air_s),
            poses: [Role::I, Role::J]
                .map(|role| pose(&slot.plan.vehicles[role], slot.lean_rad[role].unwrap_or_default())),
            turns: turned.map(|turned| {
                turning::planned(turned, plan.ways.as_ref(), entry, timing.guard.as_secs_f64())
            }),
        })
    });
    Ok(slots.collect())
}

fn pose(vehicle: &VehiclePlan, lean_rad: f64) -> sim::PlannedPose {
    sim::PlannedPose {
        position_enu_m: vehicle.pose.position_enu_m.into(),
        roll_rad: vehicle.pose.roll_rad,
        pitch_rad: vehicle.pose.pitch_rad,
        yaw_rad: vehicle.pose.yaw_rad,
        tx_power_w: vehicle.tx_power_w,
        lean_deg: lean_rad.to_degrees(),
    }
}

fn vehicle(mission: &Mission, role: Role, home: Vector2<f64>, link: &Imperfections) -> sim::VehicleConfig {
    let (sim_role, sign) = match role {
        Role::I => (sim::Role::I, 1.0),
        Role::J => (sim::Role::J, -1.0),
    };
    let ceiling = Dbm::from(Watts(mission.power_ceiling(role).0)).0;
    sim::VehicleConfig {
        home_enu_m: [home.x, home.y, 0.0],
        // Each autopilot has an origin of its own: where it was switched on, not where it stands.
        local_origin_offset_enu_m: [sign * 7.0, -3.0 * sign, sign],
        heading_rad: 0.6 * sign,
        airframe: match mission.vehicles[role].airframe {
            Airframe::Omnidirectional => sim::Airframe::Omnidirectional,
            Airframe::Conventional => sim::Airframe::Conventional,
        },
        // A light breeze with its gusts, and an estimator that errs: a simulated flight is not flown in a vacuum.
        wind: sim::WindConfig { mean_enu_m_s: BREEZE_ENU_M_S, turbulence_m_s: TURBULENCE_M_S },
        sensors: sim::SensorConfig::typical(),
        errors: link.errors[role],
        antenna: link.antennas[role].clone(),
        transmitter_max_dbm: ceiling.max(30.0),
        // What the preflight asks for.
        flies_below_m: mission.airspace.altitude_m[1] + CEILING_M,
        ..sim::VehicleConfig::new(sim_role)
    }
}

/// Where the two vehicles stand: the mission's homes, or side by side near the middle of the area.
fn homes(mission: &Mission) -> Result<[Vector2<f64>; 2], String> {
    if let (Some(i), Some(j)) = (mission.vehicles.i.home_enu_m, mission.vehicles.j.home_enu_m) {
        return Ok([i.xy(), j.xy()]);
    }
    let router =
        Router::new(&mission.airspace, &mission.transit_limits()).map_err(|error| error.to_string())?;
    let apart = HOMES_APART_M.max(3.0 * mission.airspace.min_separation_m);
    let area = &mission.airspace.area_enu_m;
    let middle = area.iter().sum::<Vector2<f64>>() / area.len().max(1) as f64;
    let vertices = area.iter().map(|vertex| middle + (vertex - middle) * 0.5);
    let candidates = [Vector2::zeros(), middle].into_iter().chain(vertices);
    let offsets = [Vector2::new(apart / 2.0, 0.0), Vector2::new(0.0, apart / 2.0)];
    let pairs = candidates.flat_map(|c| offsets.map(|offset| [c - offset, c + offset]));
    let mut inside = pairs.into_iter().filter(|pair| pair.iter().all(|&p| router.can_be_home(&p.push(0.0))));
    inside.next().ok_or_else(|| {
        format!("no room for two homes {apart:.0} m apart inside the area and outside its no-fly areas: give [vehicles.i] and [vehicles.j] home_enu_m")
    })
}
