//! No-fly areas through the whole chain: planned round, flown round, and found by the simulated world's own monitor where
//! nobody has told the companions of them; read from files that others draw, and written so that they can be read again.

#![cfg(feature = "desk")]
// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../command/mod.rs"]
mod command;
mod files;
mod flown;
mod judge;

use std::path::Path;

use nalgebra::Vector2;
use veilwing::config::{Mission, MissionDraft, NoFlyDraft};
use veilwing::geo::Enu;
use veilwing::planner::slots::Plan;
use veilwing::planning;
use veilwing::role::Role;

fn yard() -> Mission {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/flight/yard.toml");
    // Homes out of the way of what is put where the poses are.
    Mission::load(&file)
        .unwrap()
        .changed(|draft| {
            draft.vehicles.i.home_enu_m = Some(Enu::new(-30.0, -30.0, 0.0));
            draft.vehicles.j.home_enu_m = Some(Enu::new(10.0, -32.0, 0.0));
        })
        .unwrap()
}

fn square(centre: Vector2<f64>, half_m: f64) -> Vec<[f64; 2]> {
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[e, n]| [centre.x + half_m * e, centre.y + half_m * n])
        .to_vec()
}

fn pillar(name: &str, centre: Vector2<f64>, half_m: f64) -> NoFlyDraft {
    NoFlyDraft { name: name.into(), area_enu_m: Some(square(centre, half_m)), ..NoFlyDraft::default() }
}

fn poses(plan: &Plan, role: Role) -> Vec<Enu> {
    plan.slots.iter().map(|slot| slot.plan.vehicles[role].pose.position_enu_m).collect()
}

/// The yard with an area over I's ideal pose for its first user, and one on the straight way from there to the next; with what
/// the yard without them is planned as.
fn obstructed() -> (Mission, Plan, Plan) {
    let bare = yard();
    let ideal = planning::plan(&bare).unwrap();
    let over_pose = |draft: &mut MissionDraft| {
        draft.no_fly = vec![pillar("over the pose", poses(&ideal, Role::I)[0].xy(), 3.0)];
    };
    let first = planning::plan(&bare.changed(over_pose).unwrap()).unwrap();
    let [from, to] = poses(&first, Role::I)[..] else { panic!() };
    let mission = bare.changed(|draft| {
        over_pose(draft);
        draft.no_fly.push(pillar("on the way", (from.xy() + to.xy()) / 2.0, 2.0));
    });
    let mission = mission.unwrap();
    let plan = planning::plan(&mission).unwrap();
    (mission, plan, ideal)
}
