//! The reference scenarios, read from `tests/reference`.

use std::error::Error;
use std::path::PathBuf;

use nalgebra::{Vector2, Vector3};
use serde_json::Value;
use veilwing::geo::Pose;
use veilwing::planner::plan::VehiclePlan;
use veilwing::planner::problem::{
    Airframe, Airspace, Eavesdropper, Jitter, JitterAxes, JitterModel, Objective, Problem, Radio,
    Uncertainty, VehicleModel,
};
use veilwing::role::PerVehicle;

/// Anything that keeps a table from being printed.
pub type Failure = Box<dyn Error>;

fn read(name: &str) -> Result<String, Failure> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/reference").join(name);
    std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()).into())
}

fn csv(name: &str) -> Result<Vec<Vec<f64>>, Failure> {
    let text = read(name)?;
    let row = |line: &str| line.split(',').map(|c| c.trim().parse().map_err(Failure::from)).collect();
    text.lines().skip(1).filter(|l| !l.is_empty()).map(row).collect()
}

/// Eavesdroppers of every scenario with `n` of them.
pub fn eavesdroppers(n: usize) -> Result<Vec<Vec<Vector3<f64>>>, Failure> {
    let rows = csv(&format!("eavesdroppers_n{n}.csv"))?;
    Ok(rows.iter().map(|r| r[1..].chunks(2).map(|p| Vector3::new(p[0], p[1], 0.0)).collect()).collect())
}

/// The paper's set-up with these eavesdroppers.
pub fn paper(eavesdroppers: &[Vector3<f64>], max_power_w: f64, jitter_deg: f64) -> Problem {
    Problem::paper(eavesdroppers.iter().map(|p| [p.x, p.y]), max_power_w, jitter_deg.to_radians())
}

/// A row of `no_jitter.csv`.
pub struct NoJitter {
    pub n: usize,
    pub scenario: usize,
    pub max_power_w: f64,
    pub best: f64,
    pub cap: f64,
}

pub fn no_jitter() -> Result<Vec<NoJitter>, Failure> {
    let rows = csv("no_jitter.csv")?;
    let row = |r: &Vec<f64>| NoJitter {
        n: r[0] as usize,
        scenario: r[1] as usize,
        max_power_w: r[2],
        best: r[3],
        cap: r[4],
    };
    Ok(rows.iter().map(row).collect())
}

/// A row of `jitter.csv`.
pub struct Jittered {
    pub n: usize,
    pub scenario: usize,
    pub jitter_deg: f64,
    pub best_clipped: f64,
    pub paper: f64,
    pub plan: PerVehicle<VehiclePlan>,
}

pub fn jitter() -> Result<Vec<Jittered>, Failure> {
    let vehicle = |r: &[f64]| VehiclePlan {
        pose: Pose {
            position_enu_m: Vector3::new(r[0], r[1], r[2]),
            roll_rad: r[3],
            pitch_rad: r[4],
            yaw_rad: 0.0,
        },
        tx_power_w: r[5],
    };
    let row = |r: &Vec<f64>| Jittered {
        n: r[0] as usize,
        scenario: r[1] as usize,
        jitter_deg: r[2],
        best_clipped: r[4],
        paper: r[5],
        plan: PerVehicle { i: vehicle(&r[7..13]), j: vehicle(&r[13..19]) },
    };
    Ok(csv("jitter.csv")?.iter().map(row).collect())
}

/// A line of `variants.jsonl`.
pub struct Variant {
    pub name: String,
    pub problem: Problem,
    pub best: f64,
    pub plan: PerVehicle<VehiclePlan>,
}

pub fn variants() -> Result<Vec<Variant>, Failure> {
    read("variants.jsonl")?.lines().filter(|l| !l.is_empty()).map(variant).collect()
}

fn number(value: &Value) -> Result<f64, Failure> {
    value.as_f64().ok_or_else(|| format!("not a number: {value}").into())
}

fn numbers(value: &Value) -> Result<Vec<f64>, Failure> {
    value.as_array().ok_or("not a list")?.iter().map(number).collect()
}

fn point(value: &Value) -> Result<Vector3<f64>, Failure> {
    let v = numbers(value)?;
    Ok(Vector3::new(v[0], v[1], v.get(2).copied().unwrap_or(0.0)))
}

fn variant(line: &str) -> Result<Variant, Failure> {
    let v: Value = serde_json::from_str(line)?;
    let m = &v["mission"];
    let radius_m = number(&m["radius_m"])?;
    let uncertainty = if radius_m > 0.0 { Uncertainty::Disc { radius_m } } else { Uncertainty::None };
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let eavesdroppers = list(&m["eavesdroppers"])
        .iter()
        .map(|p| Ok(Eavesdropper { position_enu_m: point(p)?, uncertainty }))
        .collect::<Result<_, Failure>>()?;
    let air = &m["airspace"];
    let band = numbers(&air["altitude_m"])?;
    let max_tilt_rad = number(&air["max_tilt_deg"])?.to_radians();
    let vehicle = |key: &str| VehicleModel {
        airframe: match m["airframe"][key].as_str() {
            Some("conventional") => Airframe::Conventional,
            _ => Airframe::Omnidirectional,
        },
        max_tilt_rad,
    };
    let power = |key: &str| number(&m["radio"]["max_power_w"][key]);
    let area = list(&air["area_enu_m"]).iter().map(|p| Ok(point(p)?.xy())).collect::<Result<_, Failure>>()?;
    let problem = Problem {
        user_enu_m: point(&m["user"])?,
        eavesdroppers,
        radio: Radio {
            bandwidth_hz: number(&m["radio"]["bandwidth_hz"])?,
            noise_power_w: number(&m["radio"]["noise_power_w"])?,
            max_power_w: PerVehicle { i: power("i")?, j: power("j")? },
            reference_gain: number(&m["radio"]["reference_gain"])?,
        },
        airspace: Airspace {
            altitude_m: [band[0], band[1]],
            area_enu_m: area,
            no_fly: Vec::new(),
            min_separation_m: number(&air["min_separation_m"])?,
        },
        vehicles: PerVehicle { i: vehicle("i"), j: vehicle("j") },
        jitter: Jitter {
            std_rad: number(&m["jitter"]["std_deg"])?.to_radians(),
            model: if m["jitter"]["model"] == "body" { JitterModel::Body } else { JitterModel::Euler },
            axes: if m["jitter"]["axes"] == "roll-pitch-yaw" {
                JitterAxes::RollPitchYaw
            } else {
                JitterAxes::RollPitch
            },
        },
        objective: if m["objective"] == "worst-case" { Objective::WorstCase } else { Objective::Mean },
        free_yaw: false,
        ..Problem::paper([], 0.5, 0.0)
    };
    let plan = |key: &str| -> Result<VehiclePlan, Failure> {
        let p = &v["plan"][key];
        Ok(VehiclePlan {
            pose: Pose {
                position_enu_m: point(&p["position_enu_m"])?,
                roll_rad: number(&p["roll_rad"])?,
                pitch_rad: number(&p["pitch_rad"])?,
                yaw_rad: 0.0,
            },
            tx_power_w: number(&p["tx_power_w"])?,
        })
    };
    let name = format!("{} {}", v["variant"].as_str().unwrap_or("?"), v["scenario"]);
    let best = number(&v["best_known_bit_s_hz"])?;
    Ok(Variant { name, problem, best, plan: PerVehicle { i: plan("i")?, j: plan("j")? } })
}

/// Largest violation of a constraint, in its own unit (m, rad or W); 0 for a feasible plan. Written again from the
/// mission, not from the planner's own constraints.
pub fn violation(problem: &Problem, vehicles: &PerVehicle<VehiclePlan>) -> f64 {
    let area = &problem.airspace.area_enu_m;
    let outside = |p: Vector2<f64>| {
        let (mut inside, mut distance) = (false, f64::INFINITY);
        for (k, a) in area.iter().enumerate() {
            let b = area[(k + 1) % area.len()];
            if (a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x {
                inside = !inside;
            }
            let edge = b - a;
            let t = ((p - a).dot(&edge) / edge.norm_squared()).clamp(0.0, 1.0);
            distance = distance.min((p - a - t * edge).norm());
        }
        if inside { 0.0 } else { distance }
    };
    let apart = (vehicles.i.pose.position_enu_m - vehicles.j.pose.position_enu_m).norm();
    let mut worst = problem.airspace.min_separation_m - apart;
    for role in veilwing::role::Role::BOTH {
        let (plan, model) = (&vehicles[role], &problem.vehicles[role]);
        let tilt = plan.pose.antenna_axis().z.abs().min(1.0).acos();
        let limit = if model.airframe == Airframe::Conventional { 0.0 } else { model.max_tilt_rad };
        let [low, high] = problem.airspace.altitude_m;
        let z = plan.pose.position_enu_m.z;
        let excess = [
            tilt - limit,
            low - z,
            z - high,
            plan.tx_power_w - problem.radio.max_power_w[role],
            -plan.tx_power_w,
            outside(plan.pose.position_enu_m.xy()),
        ];
        worst = excess.into_iter().fold(worst, f64::max);
    }
    worst.max(0.0)
}
