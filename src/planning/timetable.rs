//! When the slots of a plan are flown, for whoever reads the plan. The companions make their tables from where their vehicles
//! stand; this one is made from the mission's homes, where it states both.

use crate::config::Mission;
use crate::geo::{Attitude, Enu};
use crate::planner::slots::Plan;
use crate::role::PerVehicle;
use crate::schedule::table::{Table, TableError};
use crate::schedule::trajectory::Start;
use crate::schedule::transit::{Router, TransitError};

/// Why there is no table.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoTimetable {
    /// The slots make none.
    #[error(transparent)]
    Table(#[from] TableError),
    /// The airspace has no way for both vehicles.
    #[error(transparent)]
    Airspace(#[from] TransitError),
}

/// The slot table from above both homes, from the bottom of the altitude band; `None` where the mission states no homes.
///
/// # Errors
/// [`NoTimetable`] where the slots cannot be flown one after the other.
pub fn timetable(mission: &Mission, plan: &Plan) -> Result<Option<Table>, NoTimetable> {
    let homes = mission.vehicles.map(|vehicle| vehicle.home_enu_m);
    let (Some(i), Some(j)) = (homes.i, homes.j) else { return Ok(None) };
    let bottom_m = mission.airspace.altitude_m[0];
    let start = PerVehicle { i, j }.map(|home| Start {
        position_enu_m: Enu::new(home.x, home.y, bottom_m),
        attitude: Attitude::level(),
    });
    let router = Router::new(&mission.airspace, &mission.transit_limits())?;
    let table = Table::of_plan(&router, &start, plan, &mission.timing(), mission.tdma.order)?;
    Ok(Some(table))
}
