//! What is lost in flight by not knowing where users and eavesdroppers will go: slots of thirty seconds, flown without faults while both
//! users, or one eavesdropper, walk or drive about. The world reports each once a second, with 3 m of noise, a fifth of the reports lost.
//! Three times: in the paper's arena, with the demonstration's users and eavesdroppers five times as far from its middle; over twice the
//! demonstration's own area, where vehicles fly so low that a metre counts four times as much; and there with 1 m of noise.
//!
//! ```text
//! cargo run --release --example followed -- [FLIGHTS]
//! ```
//!
//! Prints, with standard errors over flights, the part of the rate that is lost to a pair that knows all tracks and begins each slot as the
//! flown one did; to one that begins it where it is best; and by one that stays where the plan has it, to the latter
//! (`desk::simulation::hindsight`). Then how many motions I asked for, how many both took up, and how long that took.

use std::error::Error;
use std::path::Path;

use nalgebra::{Vector2, Vector3};
use veilwing::config::{Mission, MissionDraft, MovesDraft, Optimise, PointingDraft};
use veilwing::desk::campaign::{FollowingLine, FollowingTotal, Mean};
use veilwing::desk::simulation::{Scenario, ScenarioError};
use veilwing::geo::Enu;
use veilwing::planner::following::Gait;
use veilwing::planning;

const SLOT_S: f64 = 30.0;

/// Where it is flown.
struct Over {
    what: &'static str,
    /// Corners of the area, metres from the origin.
    half_m: f64,
    altitude_m: [f64; 2],
    /// Users and eavesdroppers are so much farther from the origin than the demonstration's.
    spread: f64,
    /// Noise of the reports, metres.
    noise_m: f64,
}

const COURTYARD: Over = Over {
    what: "the same, 1 m of noise",
    half_m: 200.0,
    altitude_m: [20.0, 80.0],
    spread: 1.0,
    noise_m: 1.0,
};

const OVER: [Over; 3] = [
    Over { what: "the paper's arena", half_m: 500.0, altitude_m: [80.0, 300.0], spread: 5.0, noise_m: 3.0 },
    Over { what: "200 m about the courtyard", noise_m: 3.0, ..COURTYARD },
    COURTYARD,
];

fn main() -> Result<(), Box<dyn Error>> {
    let flights: u64 = std::env::args().nth(1).map_or(Ok(12), |text| text.parse())?;
    let file = Mission::load(Path::new("config/mission.toml")).map_err(|errors| errors.to_string())?;
    println!(
        "{flights} flights each; lost, %, to who knows all tracks  who begins best as well  by who stays  asked  taken  agreed after s: median   99%  most"
    );
    for over in &OVER {
        println!("over {}", over.what);
        for (who, users) in [("users", true), ("an eavesdropper", false)] {
            for (verb, gait) in [("walk", Gait::Walks), ("drive", Gait::Drives)] {
                let change = |m: &mut MissionDraft| moving(m, over, users, gait);
                let mission = file.changed(change).map_err(|errors| errors.to_string())?;
                let plan = planning::plan(&mission)?;
                let scenario = Scenario::new(&mission, &plan, None)?;
                let fly = |flight: u64| {
                    Ok(FollowingLine::of(&scenario.fly(mission.seed + flight, Vec::new(), &mut ())?))
                };
                let lines = (0..flights).map(fly).collect::<Result<Vec<_>, ScenarioError>>()?;
                if let Some(total) = FollowingTotal::of(lines.iter().flatten()) {
                    println!("{}", row(&format!("{who} {verb}"), &total));
                }
            }
        }
    }
    Ok(())
}

fn moving(m: &mut MissionDraft, over: &Over, users: bool, gait: Gait) {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    m.airspace.area_enu_m = corners.map(|corner| over.half_m * Vector2::from(corner)).to_vec();
    m.airspace.altitude_m = over.altitude_m;
    m.planner.optimise = Optimise::Rate;
    m.tdma.slot_s = SLOT_S;
    // What a flight's own compass costs is no part of what is lost by not knowing.
    m.pointing = PointingDraft::default();
    let farther = |place: &mut Option<Enu>| {
        if let Some(place) = place {
            *place = place.component_mul(&Vector3::new(over.spread, over.spread, 1.0));
        }
    };
    m.users.iter_mut().for_each(|user| farther(&mut user.enu_m));
    m.eavesdroppers.iter_mut().for_each(|node| farther(&mut node.enu_m));
    let moves = |system_id| Some(MovesDraft { system_id, gait, std_m: over.noise_m });
    if users {
        m.users.iter_mut().zip(51..).for_each(|(user, system)| user.moves = moves(Some(system)));
    } else {
        m.eavesdroppers[0].moves = moves(None);
    }
}

fn row(who: &str, total: &FollowingTotal) -> String {
    let percent = |mean: &Mean| {
        let of = |part: Option<f64>| 100.0 * part.unwrap_or(f64::NAN);
        format!("{:6.2} +- {:4.2}", of(mean.mean), of(mean.standard_error))
    };
    let [median, most, longest] = total.agreement_s.unwrap_or([f64::NAN; 3]);
    format!(
        "{who:22}  {:>32}  {:>23}  {:>12}  {:5}  {:5}  {median:22.3}  {most:5.3}  {longest:4.2}",
        percent(&total.lost),
        percent(&total.lost_to_best),
        percent(&total.lost_by_staying),
        total.motions_asked,
        total.motions_taken_up
    )
}
