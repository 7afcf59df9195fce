//! A mission file that was edited in flight: where those are that move, and nothing else of it.

use crate::geo::Enu;
use crate::planner::following::{Moved, Who};
use crate::planner::problem::Uncertainty;

use super::mission::{Difference, Mission};

/// What may differ of one that moves.
const KEYS: [&str; 6] = ["enu_m", "lat_deg", "lon_deg", "alt_m", "radius_m", "std_m"];

/// A user or an eavesdropper, as a mission has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node<'a> {
    /// Its name.
    pub name: &'a str,
    /// Where, ENU, metres.
    pub position_enu_m: Enu,
    /// How far it may be from there.
    pub uncertainty: Uncertainty,
}

impl Mission {
    /// The one of this number of its kind, if there is one.
    #[must_use]
    pub fn node(&self, who: Who) -> Option<Node<'_>> {
        match who {
            Who::User(index) => self.users.get(index).map(|user| Node {
                name: &user.name,
                position_enu_m: user.position_enu_m,
                uncertainty: user.uncertainty,
            }),
            Who::Eavesdropper(index) => self.eavesdroppers.get(index).map(|eavesdropper| Node {
                name: &eavesdropper.name,
                position_enu_m: eavesdropper.node.position_enu_m,
                uncertainty: eavesdropper.node.uncertainty,
            }),
        }
    }

    /// Those that move and are elsewhere in `edited`, this mission's file as it is now.
    ///
    /// # Errors
    /// The first key that must not change in flight, or that nothing has; in words.
    pub fn moved(&self, edited: &Self) -> Result<Vec<Moved>, String> {
        let differences = self.differences(edited);
        let of = |difference: &Difference| {
            let (node, key) = difference.key.rsplit_once('.')?;
            let who = self.movers.iter().map(|mover| mover.who).find(|who| path(*who) == node)?;
            KEYS.contains(&key).then_some(who)
        };
        if let Some(other) = differences.iter().find(|difference| of(difference).is_none()) {
            let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "not set".into());
            return Err(format!(
                "`{}` is {} in it, and {} in the mission that is flown; in flight only the place of one that `moves` may change",
                other.key,
                value(&other.theirs),
                value(&other.ours)
            ));
        }
        let moved = |who: &Who| differences.iter().any(|difference| of(difference) == Some(*who));
        let known = |who: Who| {
            let Node { position_enu_m, uncertainty, .. } = edited.node(who)?;
            let mover = edited.movers.iter().find(|mover| mover.who == who)?;
            let std_m = match uncertainty {
                Uncertainty::None => mover.std_m,
                // Of a disc, along one axis.
                Uncertainty::Disc { radius_m } => radius_m / 2.0,
                Uncertainty::Gaussian { std_m } => std_m,
            };
            Some(Moved { who, position_enu_m, std_m })
        };
        let all: Vec<Moved> =
            self.movers.iter().map(|mover| mover.who).filter(moved).filter_map(known).collect();
        if all.is_empty() { Err("nobody that `moves` is elsewhere in it".into()) } else { Ok(all) }
    }
}

/// Where a mission file has somebody.
fn path(who: Who) -> String {
    match who {
        Who::User(index) => format!("user[{index}]"),
        Who::Eavesdropper(index) => format!("eavesdropper[{index}]"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MovesDraft;
    use crate::geo::Enu;

    #[test]
    fn spec_only_places_of_those_that_move_are_taken_from_an_edited_file() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/mission.toml");
        let flown = Mission::load(&path).unwrap().changed(|m| {
            m.planner.optimise = crate::config::Optimise::Rate;
            m.users[1].moves = Some(MovesDraft::default());
            m.eavesdroppers[0].moves = Some(MovesDraft { std_m: 9.0, ..MovesDraft::default() });
        });
        let flown = flown.unwrap();
        assert_eq!(flown.moved(&flown).unwrap_err(), "nobody that `moves` is elsewhere in it");
        let edited = flown.changed(|m| {
            m.eavesdroppers[0].enu_m = Some(Enu::new(70.0, -35.0, 5.0));
            (m.eavesdroppers[0].radius_m, m.eavesdroppers[0].std_m) = (None, None);
            m.users[1].enu_m = Some(Enu::new(16.0, 9.0, 1.5));
            m.users[1].radius_m = Some(3.0);
        });
        let edited = edited.unwrap();
        let [user, eavesdropper] = flown.moved(&edited).unwrap()[..] else { panic!() };
        assert_eq!((user.who, user.std_m), (Who::User(1), 1.5));
        assert_eq!((eavesdropper.who, eavesdropper.std_m), (Who::Eavesdropper(0), 9.0));
        assert!((eavesdropper.position_enu_m - Enu::new(70.0, -35.0, 5.0)).norm() < 1e-9);
        // Whoever stays, and everything else.
        let stays = edited.changed(|m| m.users[0].enu_m = Some(Enu::new(1.0, 1.0, 0.0))).unwrap();
        assert!(flown.moved(&stays).unwrap_err().contains("`user[0].enu_m` is "));
        let slots = edited.changed(|m| m.tdma.slot_s = 7.0).unwrap();
        let why = flown.moved(&slots).unwrap_err();
        assert!(why.starts_with("`tdma.slot_s` is 7"), "{why}");
        let gait = edited.changed(|m| m.users[1].moves.as_mut().unwrap().std_m = 1.0).unwrap();
        assert!(flown.moved(&gait).unwrap_err().contains("`user[1].moves.std_m`"));
        let fewer = edited.changed(|m| m.users[1].moves = None).unwrap();
        assert!(flown.moved(&fewer).unwrap_err().contains("`user[1].moves"));
    }
}
