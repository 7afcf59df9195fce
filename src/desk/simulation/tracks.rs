//! Where those go that move, in simulation: a CSV file.
//!
//! ```text
//! name,t_s,east_m,north_m,up_m
//! alpha,0,-15,0,0
//! alpha,60,40,25,0
//! ```
//!
//! A row is where somebody is at a time of the flight, in the mission frame; straight on from row to row, at rest before the first
//! and after the last. `up_m` may be left out: as the mission has it. Who is not in the file wanders about its place.

use std::path::Path;

use serde::Deserialize;
use sha2::{Digest, Sha256};
use veilwing_sitl as sim;

use crate::config::Mission;
use crate::planner::following::Who;
use crate::planner::slots::hex;

/// See the module.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tracks(Vec<(Who, Vec<sim::Fix>)>);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    t_s: f64,
    east_m: f64,
    north_m: f64,
    up_m: Option<f64>,
}

impl Tracks {
    /// Reads a file of tracks of those that move in a mission.
    ///
    /// # Errors
    /// The first thing that is wrong with it: file, line, what, and what to do.
    pub fn load(path: &Path, mission: &Mission) -> Result<Self, String> {
        let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
        Self::parse(&text, mission).map_err(|(line, what)| format!("{}:{line}: {what}", path.display()))
    }

    fn parse(text: &str, mission: &Mission) -> Result<Self, (u64, String)> {
        let mut tracks: Vec<(Who, Vec<sim::Fix>)> = Vec::new();
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
        let wrong = |line: u64, error: csv::Error| {
            (line, format!("{error}; rows are name,t_s,east_m,north_m and, where wanted, up_m"))
        };
        // A row's position is before the empty lines above it.
        let line_of = |position: Option<&csv::Position>| {
            let begins =
                position.and_then(|at| Some((at.line(), text.get(usize::try_from(at.byte()).ok()?..)?)));
            begins.map_or(1, |(line, rest)| {
                let empty = &rest[..rest.len() - rest.trim_start().len()];
                line + empty.matches('\n').count() as u64
            })
        };
        let headers = reader.headers().map_err(|error| wrong(1, error))?.clone();
        for record in reader.records() {
            let record = record.map_err(|error| wrong(line_of(error.position()), error))?;
            let line = line_of(record.position());
            let row: Row = record.deserialize(Some(&headers)).map_err(|error| wrong(line, error))?;
            let Row { name, t_s, east_m, north_m, up_m } = row;
            let (who, z) = named(&name, mission).map_err(|what| (line, what))?;
            let position_enu_m = [east_m, north_m, up_m.unwrap_or(z)];
            if !position_enu_m.iter().chain([&t_s]).all(|number| number.is_finite()) {
                return Err((line, "a number that is none; give times in s and places in m".into()));
            }
            let fix = sim::Fix { at_s: t_s, position_enu_m };
            match tracks.iter_mut().find(|(known, _)| *known == who) {
                None => tracks.push((who, vec![fix])),
                Some((_, fixes)) if fixes.last().is_some_and(|last| last.at_s >= t_s) => {
                    return Err((
                        line,
                        format!("`{name}` is there before, or at, the row above; sort its rows by t_s"),
                    ));
                }
                Some((_, fixes)) => fixes.push(fix),
            }
        }
        if tracks.is_empty() {
            Err((1, "no rows; give name,t_s,east_m,north_m".into()))
        } else {
            Ok(Self(tracks))
        }
    }

    /// SHA-256 over what it says, in hexadecimal.
    #[must_use]
    pub fn digest(&self) -> String {
        hex(&Sha256::digest(format!("{:?}", self.0)))
    }

    /// Has them gone along in a world of the same mission.
    pub fn lay(&self, world: &mut sim::WorldConfig) {
        for (who, fixes) in &self.0 {
            let node = match who {
                Who::User(index) => world.users.get_mut(*index),
                Who::Eavesdropper(index) => world.eavesdroppers.get_mut(*index),
            };
            if let Some(roams) = node.and_then(|node| node.roams.as_mut()) {
                roams.track.clone_from(fixes);
            }
        }
    }
}

/// The one that moves and has this name, and how high the mission has it.
fn named(name: &str, mission: &Mission) -> Result<(Who, f64), String> {
    let movers = || mission.movers.iter().filter_map(|mover| Some((mover.who, mission.node(mover.who)?)));
    let mut found = movers().filter(|(_, node)| node.name == name);
    match (found.next(), found.next()) {
        (Some((who, node)), None) => Ok((who, node.position_enu_m.z)),
        (Some(_), Some(_)) => {
            Err(format!("a user and an eavesdropper are called `{name}`; rename one in the mission"))
        }
        (None, _) => {
            let known: Vec<&str> = movers().map(|(_, node)| node.name).collect();
            let known = if known.is_empty() { "nobody".into() } else { known.join(", ") };
            Err(format!(
                "`{name}` does not move in the mission ({known}); give it `moves`, or leave its rows out"
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MovesDraft;

    fn mission() -> Mission {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/mission.toml");
        let mission = Mission::load(&path).unwrap().changed(|m| {
            m.planner.optimise = crate::config::Optimise::Rate;
            m.users[1].moves = Some(MovesDraft::default());
            m.eavesdroppers[0].moves = Some(MovesDraft::default());
        });
        mission.unwrap()
    }

    #[test]
    fn spec_rows_are_places_at_times_and_heights_are_the_missions_where_not_given() {
        let mission = mission();
        let text = "name,t_s,east_m,north_m,up_m\nhill, 0, 80, -40, 6\nbravo,5,1,2,\nhill,10,90,-40,6\n";
        let tracks = Tracks::parse(text, &mission).unwrap();
        let plan = crate::planning::plan(&mission).unwrap();
        let mut world = super::super::world_config(&mission, &plan).unwrap();
        tracks.lay(&mut world);
        let fixes = |node: &sim::Node| node.roams.as_ref().map(|roams| roams.track.clone());
        let hill = fixes(&world.eavesdroppers[0]).unwrap();
        assert_eq!(
            hill.iter().map(|fix| (fix.at_s, fix.position_enu_m[0])).collect::<Vec<_>>(),
            [(0.0, 80.0), (10.0, 90.0)]
        );
        assert_eq!(fixes(&world.users[1]).unwrap()[0].position_enu_m, [1.0, 2.0, 1.5]);
        assert_eq!(fixes(&world.users[0]), None);
    }

    #[test]
    fn spec_what_is_wrong_is_told_with_its_line_and_what_to_do() {
        let mission = mission();
        for (text, line, says) in [
            ("", 1, "no rows"),
            ("name,t_s,east_m,north_m\n", 1, "no rows"),
            ("name,t_s,east_m\nhill,0,1\n", 2, "north_m"),
            ("name,t_s,east_m,north_m\nhill,0,one,2\n", 2, "name,t_s,east_m,north_m"),
            ("name,t_s,east_m,north_m\nhill,0,1,2\nhill,0,1,3\n", 3, "sort its rows"),
            (
                "name,t_s,east_m,north_m\nhill,0,1,2\nalpha,0,1,3\n",
                3,
                "`alpha` does not move in the mission (bravo, hill)",
            ),
            ("name,t_s,east_m,north_m\nhill,NaN,1,2\n", 2, "a number that is none"),
            ("name,t_s,east_m,north_m\n\nhill,0,1,2\n\nhill,NaN,1,2\n", 5, "a number that is none"),
        ] {
            let (at, what) = Tracks::parse(text, &mission).unwrap_err();
            assert!(at == line && what.contains(says), "{text}: {at}: {what}");
        }
    }
}
