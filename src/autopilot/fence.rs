//! The mission's area in the autopilot itself, so that a vehicle without its companion stays inside: uploaded as an inclusion
//! polygon, its no-fly areas that leave no height free as exclusion polygons, with a rally point at home, read back, and compared corner by corner. A state machine without I/O.
//!
//! What is there already and equal is not written again. It is read again now and then, because another station may write as
//! well. Only while the vehicle is disarmed: in flight nothing is asked and nothing is said. Whether the autopilot acts on its
//! fence, and up to what altitude, is for its parameters; they are its owner's, and checked in [`super::firmware`].

mod item;
mod transfer;

#[cfg(test)]
mod tests;

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, MavMissionResult, MavMissionType};
use nalgebra::Vector2;

use super::outbox::{Address, Outbox};
use super::state::VehicleState;
use crate::geo::polygon::Polygon;
use crate::geo::{Enu, Geodetic};
use crate::preflight::Verdict::{self, Fail, Pass, Warn};
use crate::preflight::{Check, check};
use crate::time::Instant;
use item::Item;
use transfer::{Ended, Failure, Transfer};

/// The autopilot's fence lies so far outside the mission's area, and its ceiling so far above the altitude band, in metres.
/// Ordinary flight along the edge must not touch it: the most that was seen past a pose is 1.5 m, and ArduPilot keeps
/// FENCE_MARGIN (2 m by default) away from its fence where it steers by itself.
pub const MARGIN_M: f64 = 5.0;
/// More corners than this no autopilot counts (ArduPilot in one byte); most keep fewer, and say so.
pub const MOST_CORNERS: usize = 255;

/// What is there is read again this often: another station may have written in the meantime.
const AGAIN: Duration = Duration::from_secs(10);
/// After a failure.
const PAUSE: Duration = Duration::from_secs(3);
/// A rally point so near to home is home's, in metres: home moves a little while a vehicle stands.
const AT_HOME_M: f64 = 1.0;

/// What becomes of the fence in the autopilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum FenceDuty {
    /// Uploaded unless it is there already, and read back.
    #[default]
    Upload,
    /// Read and compared, never written.
    Check,
    /// The same, on the day before: what differs will be uploaded before a take-off, and is no fault yet.
    Foresee,
    /// None: the preflight warns.
    None,
}

/// The fence that the autopilot is to have.
#[derive(Debug, Clone, PartialEq)]
pub struct Fence {
    /// What becomes of it.
    pub duty: FenceDuty,
    /// Its corners in the mission frame, the margin included.
    pub corners_enu_m: Vec<Vector2<f64>>,
    /// Polygons in it that the vehicle may not enter, the margin taken off.
    pub zones_enu_m: Vec<Vec<Vector2<f64>>>,
    /// The mission's no-fly areas that the autopilot cannot be told of, each with the reason.
    pub untold: Vec<String>,
    /// At how many corners of the area the margin is less.
    pub tight: usize,
    /// The top of the altitude band, in metres above the mission's origin.
    pub top_m: f64,
    /// The autopilot's home may be so far from where the vehicle stands, in metres.
    pub home_within_m: f64,
}

impl Fence {
    /// Whether a place is inside.
    pub(super) fn holds(&self, place: Enu) -> bool {
        Polygon::new(&self.corners_enu_m).is_ok_and(|area| area.encloses(place.xy()))
    }

    /// How far its farthest corner is from a place.
    pub(super) fn reach_m(&self, place: Enu) -> f64 {
        Polygon::new(&self.corners_enu_m).map_or(0.0, |area| area.farthest_m(place.xy()))
    }
}

/// Whether a message is of the protocol by which such lists travel.
pub(super) fn is_of_a_list(message: &MavMessage) -> bool {
    transfer::addressed(message).is_some()
}

/// What is known of a list in the autopilot.
#[derive(Debug, Clone, PartialEq)]
enum Known {
    NotYet,
    /// As it should be.
    Held,
    /// Otherwise, in words.
    Differs(String),
    /// Otherwise, although it has just been written.
    KeptOtherwise(String),
    Failed(Failure),
}

#[derive(Debug, Clone)]
struct List {
    kind: MavMissionType,
    /// What should be there; empty while that is not known.
    wanted: Vec<Item>,
    known: Known,
    /// When it is read next.
    reads_at: Instant,
    /// Written since it was last read: what is read then is its last word.
    written: bool,
}

impl List {
    fn new(kind: MavMissionType, wanted: Vec<Item>) -> Self {
        Self { kind, wanted, known: Known::NotYet, reads_at: Instant::ZERO, written: false }
    }

    /// The first difference, in words.
    fn difference(&self, read: &[Item]) -> Option<String> {
        let pair = self.wanted.iter().zip(read).enumerate();
        let (number, (wanted, read)) = pair.into_iter().find(|(_, (wanted, read))| !read.is(wanted))?;
        let [wanted_at, read_at] = [wanted.place, read.place];
        if wanted.command == read.command && read_at != wanted_at {
            Some(format!("item {} is at {read_at}, should be at {wanted_at}", number + 1))
        } else {
            let kind = |item: &Item| format!("{:?} of {}", item.command, item.param1);
            Some(format!("item {} is {}, should be {}", number + 1, kind(read), kind(wanted)))
        }
    }
}

/// Brings fence and rally point into the autopilot. See the module.
#[derive(Debug, Clone)]
pub(super) struct Keeper {
    fence: Option<Fence>,
    origin: Geodetic,
    /// Fence and rally point.
    lists: [List; 2],
    /// That of one of the lists, by its number: autopilots serve one at a time.
    under_way: Option<(usize, Transfer)>,
    rally_at: Option<Enu>,
}

const RALLY: usize = 1;

impl Keeper {
    pub(super) fn new(fence: Option<Fence>, origin: Geodetic) -> Self {
        let on_earth = |corners: &Vec<Vector2<f64>>| -> Vec<Geodetic> {
            let place = |corner: &Vector2<f64>| Geodetic::from_enu(Enu::new(corner.x, corner.y, 0.0), origin);
            corners.iter().map(place).collect()
        };
        let (area, zones) = fence.as_ref().map_or_else(Default::default, |fence| {
            (on_earth(&fence.corners_enu_m), fence.zones_enu_m.iter().map(on_earth).collect::<Vec<_>>())
        });
        let lists = [
            List::new(MavMissionType::MAV_MISSION_TYPE_FENCE, item::fence(&area, &zones)),
            List::new(MavMissionType::MAV_MISSION_TYPE_RALLY, Vec::new()),
        ];
        Self { fence, origin, lists, under_way: None, rally_at: None }
    }

    fn duty(&self) -> FenceDuty {
        self.fence.as_ref().map_or(FenceDuty::None, |fence| fence.duty)
    }

    /// Nothing is known of what the autopilot has.
    pub(super) fn forget(&mut self) {
        self.under_way = None;
        for list in &mut self.lists {
            (list.known, list.reads_at, list.written) = (Known::NotYet, Instant::ZERO, false);
        }
    }

    /// Takes one of the mission protocol's messages from the autopilot.
    pub(super) fn handle(
        &mut self,
        message: &MavMessage,
        state: &VehicleState,
        now: Instant,
        out: &mut Outbox,
    ) {
        if let Some((number, transfer)) = self.under_way.as_mut().filter(|_| stands(state))
            && let Some(ended) = transfer.handle(message, now, out)
        {
            let number = *number;
            self.ended(number, ended, now);
        }
    }

    /// Does what is due, of a vehicle that is disarmed; in any other case what was under way is left where it is.
    pub(super) fn advance(
        &mut self,
        state: &VehicleState,
        (own, target): (Address, Address),
        now: Instant,
        out: &mut Outbox,
    ) {
        if self.duty() == FenceDuty::None {
            return;
        }
        if !stands(state) {
            self.under_way = None;
            return;
        }
        self.learn_home(state);
        if let Some((number, transfer)) = &mut self.under_way {
            let number = *number;
            if let Some(ended) = transfer.advance(now, out) {
                self.ended(number, ended, now);
            }
        }
        if self.under_way.is_some() {
            return;
        }
        let upload = self.duty() == FenceDuty::Upload;
        let due = self.lists.iter().position(|list| !list.wanted.is_empty() && list.reads_at <= now);
        let Some(number) = due else { return };
        let list = &self.lists[number];
        let writes =
            upload && !list.written && matches!(list.known, Known::Differs(_) | Known::KeptOtherwise(_));
        let begin = if writes { Transfer::write } else { Transfer::read };
        let mut transfer = begin(list.kind, list.wanted.clone(), (own, target), now);
        // A transfer that has just begun asks, and does not end.
        _ = transfer.advance(now, out);
        self.under_way = Some((number, transfer));
    }

    /// When [`Self::advance`] is to be called next.
    pub(super) fn timeout(&self, state: &VehicleState) -> Option<Instant> {
        if self.duty() == FenceDuty::None || !stands(state) {
            return None;
        }
        match &self.under_way {
            Some((_, transfer)) => Some(transfer.timeout()),
            None => self.lists.iter().filter(|list| !list.wanted.is_empty()).map(|list| list.reads_at).min(),
        }
    }

    /// The rally point belongs where home is, and stays there while home moves by little.
    fn learn_home(&mut self, state: &VehicleState) {
        let Some(home) = state.home_enu_m.map(|home| home.value) else { return };
        if self.rally_at.is_some_and(|at| (at - home).xy().norm() <= AT_HOME_M) {
            return;
        }
        self.rally_at = Some(home);
        if self.under_way.as_ref().is_some_and(|(number, _)| *number == RALLY) {
            self.under_way = None;
        }
        let wanted = vec![item::rally(Geodetic::from_enu(home, self.origin))];
        self.lists[RALLY] = List::new(MavMissionType::MAV_MISSION_TYPE_RALLY, wanted);
    }

    fn ended(&mut self, number: usize, ended: Ended, now: Instant) {
        self.under_way = None;
        let writes = self.duty() == FenceDuty::Upload;
        let list = &mut self.lists[number];
        let count = |count: usize| format!("{count} items, should be {}", list.wanted.len());
        let differs = if list.written { Known::KeptOtherwise } else { Known::Differs };
        let known = match ended {
            Ended::Written => {
                (list.written, list.reads_at) = (true, now);
                return;
            }
            Ended::Failed(failure) => Known::Failed(failure),
            Ended::Counted(n) => differs(count(n.into())),
            Ended::Read(read) if read.len() != list.wanted.len() => differs(count(read.len())),
            Ended::Read(read) => list.difference(&read).map_or(Known::Held, differs),
        };
        let wait = match &known {
            // What differs is written at once, but not a second time without a pause.
            Known::Differs(_) if writes => Duration::ZERO,
            Known::Held => AGAIN,
            _ => PAUSE,
        };
        (list.known, list.reads_at, list.written) = (known, now + wait, false);
    }

    /// The checks before a flight; none where nothing was said of a fence.
    pub(super) fn checks(&self, state: &VehicleState) -> Vec<Check> {
        let Some(fence) = &self.fence else { return Vec::new() };
        if fence.duty == FenceDuty::None {
            let detail = "not in the autopilot ([autopilot] fence = \"none\"), should be: nothing keeps a vehicle inside that has \
                          lost its companion";
            return vec![check("fence", Warn, detail)];
        }
        let mut all = vec![self.check_fence(fence, state)];
        all.extend(check_zones(fence));
        all.extend(self.check_rally());
        all.extend(check_home(fence, state));
        all
    }

    fn check_fence(&self, fence: &Fence, state: &VehicleState) -> Check {
        let home = state.home_enu_m.map(|home| home.value);
        if let Some(home) = home.filter(|home| !fence.holds(*home)) {
            let detail = format!(
                "the autopilot's home at {:.1}, {:.1} m lies outside, should be inside: the autopilot drops a fence around others",
                home.x, home.y
            );
            return check("fence", Fail, detail);
        }
        let corners = self.lists[0].wanted.len();
        match self.judge(0) {
            Ok(()) if fence.tight > 0 => {
                let detail = format!(
                    "{corners} corners as they should be; at {} of the area's corners less than {MARGIN_M} m outside it: a narrow \
                     notch",
                    fence.tight
                );
                check("fence", Pass, detail)
            }
            Ok(()) => check(
                "fence",
                Pass,
                format!("{corners} corners as they should be, {MARGIN_M} m outside the area"),
            ),
            Err((verdict, why)) => check("fence", verdict, why),
        }
    }

    /// Where home is not known, that is a check of its own.
    fn check_rally(&self) -> Option<Check> {
        let list = &self.lists[RALLY];
        if list.wanted.is_empty() {
            return None;
        }
        if list.known == Known::Failed(Failure::Refused(MavMissionResult::MAV_MISSION_UNSUPPORTED)) {
            return Some(check("rally point", Pass, "the autopilot has none: it returns to its home"));
        }
        Some(match self.judge(RALLY) {
            Ok(()) => check("rally point", Pass, "one, at home"),
            Err((verdict, why)) => check("rally point", verdict, why),
        })
    }

    /// Whether a list is as it should be, or how bad it is that it is not.
    fn judge(&self, number: usize) -> Result<(), (Verdict, String)> {
        let why = match &self.lists[number].known {
            Known::Held => return Ok(()),
            Known::NotYet => "not read yet".to_owned(),
            Known::Failed(failure) => failure.to_string(),
            Known::KeptOtherwise(how) => {
                format!("it was uploaded, and the autopilot keeps it otherwise: {how}")
            }
            Known::Differs(how) => match self.duty() {
                FenceDuty::Check => format!(
                    "the autopilot's is not the mission's ({how}): upload it, or give [autopilot] fence = \"upload\""
                ),
                FenceDuty::Foresee => {
                    let why = format!(
                        "the autopilot's is not the mission's yet ({how}): `fly` uploads it before take-off"
                    );
                    return Err((Warn, why));
                }
                FenceDuty::None | FenceDuty::Upload => format!("being uploaded: {how}"),
            },
        };
        Err((Fail, why))
    }
}

/// Whether something may be asked or said: on the ground, disarmed.
fn stands(state: &VehicleState) -> bool {
    state.is_disarmed() && state.is_airborne() != Some(true)
}

/// Whether the autopilot knows of all no-fly areas; `None` where there are none.
fn check_zones(fence: &Fence) -> Option<Check> {
    let told = fence.zones_enu_m.len();
    if fence.untold.is_empty() {
        let detail = format!("{told} of them are in the autopilot's fence, {MARGIN_M} m smaller or less");
        return (told > 0).then(|| check("no-fly areas", Pass, detail));
    }
    let detail = format!(
        "the autopilot's fence has no {}, should have: its zones have no heights, so that a vehicle without its companion may \
         enter there",
        fence.untold.join(" and no ")
    );
    Some(check("no-fly areas", Warn, detail))
}

/// Whether the autopilot's home is where the vehicle stands: there it returns to.
fn check_home(fence: &Fence, state: &VehicleState) -> Option<Check> {
    let home = state.home_enu_m?.value;
    let here = state.position_enu_m.filter(|_| state.is_disarmed())?.value;
    let apart_m = (home - here).xy().norm();
    Some(if apart_m <= fence.home_within_m {
        check("place of home", Pass, format!("{apart_m:.1} m from the vehicle"))
    } else {
        let detail = format!(
            "{apart_m:.1} m from where the vehicle stands, should be at most {} m: set home here, or restart the autopilot",
            fence.home_within_m
        );
        check("place of home", Warn, detail)
    })
}
