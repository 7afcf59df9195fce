//! Figure 3: where each method puts the vehicles and how it turns their antennas, in one scenario.

use nalgebra::Vector3;

use super::rates::STARTS;
use super::scenario::{self, Conditions, per_hz};
use super::{Failure, Progress, Settings, Work};
use crate::desk::csv_text::CsvText;
use crate::planner::expectation::sobol::mix;
use crate::planner::plan::VehiclePlan;
use crate::planner::problem::Method;
use crate::planner::{Options, parallel, plan_slot};
use crate::role::{PerVehicle, Role};

/// File name without extension.
pub const NAME: &str = "figure-3";
/// Power ceiling of both vehicles in W.
pub const MAX_POWER_W: f64 = 0.5;
/// The scenario of the figure: the first.
const SCENARIO: usize = 0;

/// The methods, the paper's panels in its order, then its level benchmark and ours: name in the CSV file, title.
pub const METHODS: [(Method, &str, &str); 5] = [
    (Method::InteriorPoint, "interior-point", "Interior point"),
    (Method::JammerOrientation, "jammer-orientation", "Jammer orientation"),
    (Method::Paper, "paper", "Paper"),
    (Method::Conventional, "conventional", "Conventional"),
    (Method::Veilwing, "veilwing", "Veilwing"),
];

/// One method's answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Panel {
    /// Name in the CSV file.
    pub name: &'static str,
    /// For a reader.
    pub title: &'static str,
    /// Poses and powers.
    pub vehicles: PerVehicle<VehiclePlan>,
    /// Secrecy rate in bit/s/Hz.
    pub rate_bit_s_hz: f64,
}

/// The figure's numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Poses {
    /// The served user.
    pub user_enu_m: Vector3<f64>,
    /// The eavesdroppers.
    pub eavesdroppers_enu_m: Vec<Vector3<f64>>,
    /// By method, in the order of [`METHODS`].
    pub panels: Vec<Panel>,
}

/// Plans the scenario by every method from [`STARTS`] starts, without jitter.
///
/// # Errors
/// [`Failure`] if the planner refuses the problem.
pub fn plan(settings: &Settings, progress: &Progress) -> Result<Poses, Failure> {
    let eavesdroppers_enu_m = scenario::eavesdroppers(settings.seed, SCENARIO);
    let conditions = Conditions { max_power_w: MAX_POWER_W, jitter_std_rad: 0.0, uncertainty_m: 0.0 };
    let problem = scenario::problem(&eavesdroppers_enu_m, &conditions);
    let work = Work::new(NAME, METHODS.len(), progress);
    let panels = parallel::map(settings.threads, METHODS.len(), |_: &mut (), index| {
        let (method, name, title) = METHODS[index];
        let seed = mix(settings.seed, SCENARIO as u64);
        let options = Options { method, seed, starts: Some(STARTS), ..Options::default() };
        let plan = plan_slot(&problem, &options).map_err(|error| Failure::Plan {
            figure: NAME,
            scenario: SCENARIO,
            error,
        })?;
        work.one_done();
        Ok(Panel { name, title, vehicles: plan.vehicles, rate_bit_s_hz: per_hz(plan.secrecy_rate_bps) })
    });
    Ok(Poses {
        user_enu_m: problem.user_enu_m,
        eavesdroppers_enu_m,
        panels: panels.into_iter().collect::<Result<_, _>>()?,
    })
}

impl Panel {
    /// Where J's null line, its antenna axis, meets the ground; `None` if it is horizontal.
    pub fn null_on_ground_enu_m(&self) -> Option<Vector3<f64>> {
        let pose = &self.vehicles.j.pose;
        let (p, axis) = (pose.position_enu_m, pose.antenna_axis());
        (axis.z.abs() > 1e-6).then(|| p - axis * (p.z / axis.z))
    }
}

impl Poses {
    /// Every number of the figure: a row for each node, vehicle, and point where J's null line meets the ground.
    pub fn csv(&self) -> String {
        let mut text = CsvText::new([
            "method",
            "secrecy_rate_bit_s_hz",
            "item",
            "east_m",
            "north_m",
            "up_m",
            "axis_east",
            "axis_north",
            "axis_up",
            "roll_rad",
            "pitch_rad",
            "tx_power_w",
        ]);
        for panel in &self.panels {
            let mut row = |item: &str, p: &Vector3<f64>, vehicle: Option<&VehiclePlan>| {
                let mut cells =
                    vec![panel.name.to_owned(), format!("{:.6}", panel.rate_bit_s_hz), item.into()];
                cells.extend([p.x, p.y, p.z].map(|metres| format!("{metres:.3}")));
                cells.extend(match vehicle {
                    Some(vehicle) => {
                        let axis = vehicle.pose.antenna_axis();
                        let (roll, pitch) = (vehicle.pose.roll_rad, vehicle.pose.pitch_rad);
                        [axis.x, axis.y, axis.z, roll, pitch, vehicle.tx_power_w].map(|v| format!("{v:.6}"))
                    }
                    None => [const { String::new() }; 6],
                });
                text.row(cells);
            };
            row("user", &self.user_enu_m, None);
            for (k, p) in self.eavesdroppers_enu_m.iter().enumerate() {
                row(&format!("eavesdropper-{}", k + 1), p, None);
            }
            for (role, item) in [(Role::I, "vehicle-i"), (Role::J, "vehicle-j")] {
                let vehicle = &panel.vehicles[role];
                row(item, &vehicle.pose.position_enu_m, Some(vehicle));
            }
            if let Some(p) = panel.null_on_ground_enu_m() {
                row("null-line-of-j-on-ground", &p, None);
            }
        }
        text.finish()
    }
}
