//! Motions that are taken up in the middle of a slot, over the wire.

use crate::role::Role;
use crate::time::Instant;

use super::super::adoption::{Asked, Follower, Leader, Word};
use super::super::wire::{self, MavMessage, VeilwingWord};
use super::terms::{Commitment, Drifting, Event, MeasuredJitter, OF_POSES, Pace, Places};
use crate::planner::following::MOST_MOVERS;
use crate::role::PerVehicle;

/// See the module. Of one slot.
#[derive(Debug, Clone)]
pub(super) struct Motions {
    /// Of I.
    boot_id: u32,
    commitment: Commitment,
    half: Half,
    /// The newest that was asked for.
    asked: Option<Asked<Places>>,
}

#[derive(Debug, Clone)]
enum Half {
    I(Box<Leader<Places>>),
    J(Follower),
}

/// What comes of an input: news for the owner, and what is to be sent.
pub(super) type Outcome = (Option<Event>, Option<MavMessage>);

const NOTHING: Outcome = (None, None);

/// Nobody, among those that move.
const NOBODY: u8 = 255;

impl Motions {
    pub fn new(role: Role, boot_id: u32, commitment: Commitment) -> Self {
        let half = match role {
            Role::I => Half::I(Box::new(Leader::new(commitment.opens_at))),
            Role::J => Half::J(Follower::new()),
        };
        Self { boot_id, commitment, half, asked: None }
    }

    /// I: whether a motion may be asked for.
    pub fn may_ask(&self, now: Instant) -> bool {
        matches!(&self.half, Half::I(leader) if leader.may_ask(now))
    }

    /// I: whether J flies the same, or nearly.
    pub fn agrees(&self, now: Instant) -> bool {
        matches!(&self.half, Half::I(leader) if leader.agrees(now))
    }

    /// I: since when leases are of the motion that I flies, too.
    pub fn made_at(&self) -> Option<Instant> {
        match &self.half {
            Half::I(leader) => Some(leader.made_at()),
            Half::J(_) => None,
        }
    }

    /// I: asks for a motion; what is to be planned here.
    pub fn ask(&mut self, places: Places, now: Instant) -> Option<Event> {
        let Half::I(leader) = &mut self.half else { return None };
        let begins_at = self.commitment.opens_at + places.begins();
        let asked = leader.ask(begins_at, places, now)?;
        self.asked = Some(asked);
        Some(Event::PlanMotion)
    }

    /// The newest that was asked for.
    pub fn asked(&self) -> Option<&Asked<Places>> {
        self.asked.as_ref()
    }

    /// What was found here.
    pub fn planned(&mut self, number: u16, digest: Option<u64>, now: Instant) -> Outcome {
        match &mut self.half {
            Half::I(leader) => (leader.planned(number, digest, now).map(Event::TakeUp), None),
            Half::J(follower) => {
                let said = follower.planned(number, digest);
                (None, said.map(|(number, word)| self.message(number, word)))
            }
        }
    }

    /// What is to be sent by now.
    pub fn advance(&mut self, now: Instant) -> [Option<MavMessage>; 2] {
        let Half::I(leader) = &mut self.half else { return [None, None] };
        let (asked, word) = (leader.poll_ask(now), leader.poll_word(now));
        [asked.map(|asked| self.question(&asked)), word.map(|(number, word)| self.message(number, word))]
    }

    pub fn timeout(&self) -> Option<Instant> {
        match &self.half {
            Half::I(leader) => leader.timeout(),
            Half::J(_) => None,
        }
    }

    /// J: I asks for a motion.
    pub fn take_places(&mut self, places: &wire::VEILWING_PLACES_DATA) -> Outcome {
        let own = places.boot_id == self.boot_id && places.proposal == self.commitment.proposal;
        let Half::J(follower) = &mut self.half else { return NOTHING };
        if !own {
            return NOTHING;
        }
        let believed = Places::of_wire(places);
        let asked = Asked {
            number: places.number,
            from: [places.i_flies, places.j_flies],
            begins_at: self.commitment.opens_at + believed.begins(),
            places: believed,
        };
        let (plan, said) = follower.hear_ask(&asked);
        if plan {
            self.asked = Some(asked);
        }
        (plan.then_some(Event::PlanMotion), said.map(|(number, word)| self.message(number, word)))
    }

    /// What the other says of one.
    pub fn take_motion(&mut self, motion: &wire::VEILWING_MOTION_DATA, now: Instant) -> Outcome {
        if motion.boot_id != self.boot_id || motion.proposal != self.commitment.proposal {
            return NOTHING;
        }
        let word = match motion.word {
            VeilwingWord::VEILWING_WORD_PLANNED => Word::Planned(Some(motion.digest)),
            VeilwingWord::VEILWING_WORD_NOT_FOUND => Word::Planned(None),
            VeilwingWord::VEILWING_WORD_TAKEN => Word::Taken(motion.digest),
            VeilwingWord::VEILWING_WORD_FOLLOWS => Word::Follows,
            VeilwingWord::VEILWING_WORD_LEFT => Word::Left(motion.flies),
        };
        match &mut self.half {
            Half::I(leader) => (leader.hear(motion.number, word, now).map(Event::TakeUp), None),
            Half::J(follower) => {
                let (taken, said) = follower.hear(motion.number, word, now);
                let message = said.map(|(number, word)| self.message(number, word));
                (taken.then_some(Event::TakeUp(motion.number)), message)
            }
        }
    }

    fn message(&self, number: u16, word: Word) -> MavMessage {
        let (word, digest, flies) = match word {
            Word::Planned(Some(digest)) => (VeilwingWord::VEILWING_WORD_PLANNED, digest, 0),
            Word::Planned(None) => (VeilwingWord::VEILWING_WORD_NOT_FOUND, 0, 0),
            Word::Taken(digest) => (VeilwingWord::VEILWING_WORD_TAKEN, digest, 0),
            Word::Follows => (VeilwingWord::VEILWING_WORD_FOLLOWS, 0, 0),
            Word::Left(flies) => (VeilwingWord::VEILWING_WORD_LEFT, 0, flies),
        };
        MavMessage::VEILWING_MOTION(wire::VEILWING_MOTION_DATA {
            digest,
            boot_id: self.boot_id,
            proposal: self.commitment.proposal,
            number,
            flies,
            word,
        })
    }

    fn question(&self, asked: &Asked<Places>) -> MavMessage {
        MavMessage::VEILWING_PLACES(wire::VEILWING_PLACES_DATA {
            number: asked.number,
            i_flies: asked.from[0],
            j_flies: asked.from[1],
            ..asked.places.to_wire(self.boot_id, self.commitment.proposal)
        })
    }
}

impl Places {
    /// Of the poses of a slot that is proposed; of a motion in it with its number.
    pub(super) fn to_wire(self, boot_id: u32, proposal: u32) -> wire::VEILWING_PLACES_DATA {
        let mut message = wire::VEILWING_PLACES_DATA {
            boot_id,
            proposal,
            begins_ms: self.begins_ms,
            number: OF_POSES,
            jitter_cdeg: MeasuredJitter::to_wire(self.jitter),
            i_pace_percent: Pace::to_wire(self.paces.i),
            j_pace_percent: Pace::to_wire(self.paces.j),
            who: [NOBODY; MOST_MOVERS],
            ..Default::default()
        };
        for (k, drifting) in self.moving().enumerate() {
            message.who[k] = drifting.who;
            message.position_enu_dm[3 * k..3 * k + 3].copy_from_slice(&drifting.position_enu_dm);
            message.velocity_enu_cm_s[3 * k..3 * k + 3].copy_from_slice(&drifting.velocity_enu_cm_s);
            message.std_quarter_m[2 * k..2 * k + 2].copy_from_slice(&drifting.std_quarter_m);
        }
        message
    }

    pub(super) fn of_wire(message: &wire::VEILWING_PLACES_DATA) -> Self {
        let mut places = Self::new(message.begins_ms);
        places.jitter = MeasuredJitter::of_wire(message.jitter_cdeg);
        let [i, j] = [message.i_pace_percent, message.j_pace_percent].map(Pace::of_wire);
        places.paces = PerVehicle { i, j };
        for (k, who) in message.who.iter().enumerate().filter(|(_, who)| **who != NOBODY) {
            let three = |all: &[i16; 3 * MOST_MOVERS]| [0, 1, 2].map(|axis: usize| all[3 * k + axis]);
            places.push(Drifting {
                who: *who,
                position_enu_dm: three(&message.position_enu_dm),
                velocity_enu_cm_s: three(&message.velocity_enu_cm_s),
                std_quarter_m: [message.std_quarter_m[2 * k], message.std_quarter_m[2 * k + 1]],
            });
        }
        places
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::geo::{Enu, EnuVelocity};
    use crate::planner::following::Belief;
    use crate::time::Utc;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    /// By a clock that is so far from the other's.
    fn motions(role: Role, off_ms: u64) -> Motions {
        let commitment = Commitment {
            proposal: 7,
            slot: 3,
            opens_at: at(10_000 + off_ms),
            opens: Utc::default(),
            leaves_at: at(9_000 + off_ms),
        };
        Motions::new(role, 99, commitment)
    }

    fn belief(east_m: f64, north_m_s: f64, std_m: f64) -> Belief {
        Belief {
            position_enu_m: Enu::new(east_m, -0.04, 12.34),
            velocity_enu_m_s: EnuVelocity::new(0.0, north_m_s, 0.0),
            std_m: [std_m, 2.0 * std_m],
        }
    }

    #[test]
    fn spec_both_hear_of_the_same_question_and_say_what_they_have_found() {
        let (mut i, mut j) = (motions(Role::I, 0), motions(Role::J, 500));
        let mut places = Places::new(1_500);
        places.jitter = Some(MeasuredJitter::of(0.1));
        places.paces.j = Pace::of(0.4);
        places.push(Drifting::of(0, &belief(-123.44, 7.996, 1.1)).unwrap());
        places.push(Drifting::of(4, &belief(3000.0, 0.0, 90.0)).unwrap());
        assert_eq!(i.ask(places, at(11_000)), Some(Event::PlanMotion));
        let [Some(MavMessage::VEILWING_PLACES(asked)), None] = i.advance(at(11_000)) else {
            panic!("nothing is asked")
        };
        assert_eq!(i.timeout(), Some(at(11_100)), "to ask again");
        // Nobody else's.
        for other in [
            wire::VEILWING_PLACES_DATA { boot_id: 98, ..asked.clone() },
            wire::VEILWING_PLACES_DATA { proposal: 6, ..asked.clone() },
        ] {
            assert_eq!(j.take_places(&other), NOTHING);
        }
        assert_eq!(j.take_places(&asked), (Some(Event::PlanMotion), None));
        let (own, heard) = (i.asked().unwrap(), j.asked().unwrap());
        assert_eq!((heard.number, heard.from, heard.places), (own.number, own.from, own.places));
        assert_eq!((own.begins_at, heard.begins_at), (at(11_500), at(12_000)));
        let (_, Some(MavMessage::VEILWING_MOTION(planned))) = j.planned(1, Some(u64::MAX), at(11_550)) else {
            panic!("nothing is said")
        };
        assert_eq!(i.take_motion(&planned, at(11_100)), NOTHING);
        assert_eq!(i.planned(1, Some(u64::MAX), at(11_100)), (Some(Event::TakeUp(1)), None));
        let [None, Some(MavMessage::VEILWING_MOTION(taken))] = i.advance(at(11_100)) else {
            panic!("nothing is said")
        };
        let stray = wire::VEILWING_MOTION_DATA { proposal: 6, ..taken.clone() };
        assert_eq!(j.take_motion(&stray, at(11_620)), NOTHING);
        let (Some(Event::TakeUp(1)), Some(MavMessage::VEILWING_MOTION(follows))) =
            j.take_motion(&taken, at(11_620))
        else {
            panic!("it is not taken up")
        };
        assert!(!i.may_ask(at(11_600)));
        assert_eq!(i.take_motion(&follows, at(11_130)), NOTHING);
        assert!(i.may_ask(at(11_600)) && i.agrees(at(99_000)) && i.timeout().is_none());
    }

    #[test]
    fn spec_a_belief_is_told_to_the_decimetre_and_no_surer_than_it_is() {
        let drift = Drifting::of(0, &belief(-123.44, 7.996, 1.1)).unwrap().drift(1.5);
        let (told, was) = (drift.belief, belief(-123.44, 7.996, 1.1));
        assert!((told.position_enu_m - was.position_enu_m).amax() <= 0.05 + 1e-9, "{told:?}");
        assert!((told.velocity_enu_m_s.vector() - was.velocity_enu_m_s.vector()).amax() <= 0.005 + 1e-9);
        assert_eq!((drift.at_s, told.std_m), (1.5, [1.25, 2.25]));
        assert_eq!(Drifting::of(0, &belief(0.0, 0.0, 1e9)).unwrap().std_quarter_m, [255; 2]);
        for beyond in [belief(3277.0, 0.0, 1.0), belief(0.0, -328.0, 1.0), belief(f64::NAN, 0.0, 1.0)] {
            assert_eq!(Drifting::of(0, &beyond), None);
        }
        let mut places = Places::new(0);
        (0..9).for_each(|who| places.push(Drifting { who, ..Drifting::default() }));
        assert_eq!(places.moving().map(|drifting| drifting.who).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
    }
}
