//! S4, S5, F2 and F3: how companions behave when something fails, judged by what the wire showed them and by what the
//! vehicles then did.
//!
//! S4 counts from the first sign on the wire, and so only where the sign can have arrived: a companion that does not run,
//! or whose link is impaired, is judged from the first sign after that. A link that is cut, and a peer that is not heard,
//! are signs by themselves: there the leases end what is on the air.

use std::time::Duration;

use super::{I, LEASE, Monitor, WIRE};
use crate::vehicle::autopilot::{Shown, Taken, Traces};
use crate::world::circumstances::{Circumstances, GOOD_WAY, Passage};
use crate::world::violation::Breach;

/// S4: 100 ms from the first sign on the wire; the sign's and the command's way, and the steps of all who take part.
const REACTION: Duration = Duration::from_millis(150);
/// Three heartbeats, of which a poor link lets one pass.
const HEARTBEATS: Duration = Duration::from_secs(3);
/// State that is older is used for nothing.
const STATE_LIMIT: Duration = Duration::from_millis(250);
/// A lease's length, and the wire.
const LEASED: Duration = LEASE.saturating_add(WIRE);
/// A cut link: S4's reaction, and the lease of a command that could still be given within it.
const CUT: Duration = LEASED.saturating_add(Duration::from_millis(100));
/// A radio speaks five times a second, unasked.
const RADIO_WORD: Duration = Duration::from_millis(200);
/// The steps of all who take part in what is under way.
const STEPS: Duration = Duration::from_millis(100);

/// For how long what was sent may be under way: since when, and how long, in the order of time.
#[derive(Debug, Clone, Default)]
struct Way {
    spans: Vec<(Duration, Duration)>,
}

impl Way {
    /// From now on.
    fn change(&mut self, longest: Duration, now: Duration) {
        if self.spans.last().is_none_or(|(_, last)| *last != longest) {
            self.spans.push((now, longest));
        }
    }

    /// Of what has not arrived at an instant, be it long ago: what was sent before a change may be under way yet.
    fn longest(&self, at: Duration) -> Duration {
        let ends = self.spans.iter().skip(1).map(|(from, _)| *from).chain([Duration::MAX]);
        let under_way = self
            .spans
            .iter()
            .zip(ends)
            .filter(|((from, longest), end)| *from <= at && end.saturating_add(*longest) > at);
        under_way.map(|((_, longest), _)| *longest).max().unwrap_or_default()
    }
}

/// What is known of one companion.
#[derive(Debug, Clone, Default)]
pub(super) struct Side {
    told: Circumstances,
    /// What faults in the world do to the link between it and its vehicle.
    world_link: Passage,
    /// Commands to its radio, or what the radio says, are held up or lost on the hop between autopilot and radio.
    radio_hop_troubled: bool,
    /// What was given to that hop while it was in trouble arrives by then, though it may be well again.
    late_commands_until: Duration,
    /// It runs, and its vehicle's words reach it: since the beginning, or since.
    reached_since: Option<Duration>,
    unreached: bool,
    gone_since: Option<Duration>,
    /// When the process of this life began.
    started_at: Option<Duration>,
    /// By then what a former process, which died before that, left on the air is over (S5).
    inherited_until: Duration,
    cut_since: Option<Duration>,
    /// What a link held up arrived then.
    mended_at: Option<Duration>,
    /// Nothing of its peer has reached it since.
    unheard_since: Option<Duration>,
    /// It has taken its vehicle back from another hand: whether it could know of that hand, judged when it did.
    takes_back: Option<bool>,
    /// Of what passes between it and its vehicle, and from its peer to it.
    vehicle_way: Way,
    peer_way: Way,
}

impl Side {
    fn link(&self) -> Passage {
        self.told.vehicle_link.max(self.world_link)
    }

    /// The sign's time, if it can have reached the companion.
    fn sign(&self, shown: Option<Shown>) -> Option<Duration> {
        let shown = shown.filter(|_| !self.unreached)?;
        let since = self.reached_since.unwrap_or_default();
        [shown.first, shown.latest].into_iter().find(|at| *at >= since)
    }

    /// What another hand has taken, as far as this process can know of it: one that was started since finds a vehicle
    /// that has been disarmed as it finds any other.
    fn knows_of(&self, taken: Option<Taken>) -> Option<Taken> {
        taken.filter(|taken| !(taken.disarmed && self.started_at.is_some_and(|at| at > taken.at)))
    }

    /// Whether a command that its radio carries out now may have been held up or lost on the hop.
    fn radio_hop_is_troubled(&self, now: Duration) -> bool {
        self.radio_hop_troubled || now <= self.late_commands_until
    }

    /// For how long a command may outlast the off that should have ended it: what holds up or loses off leaves the expiry.
    fn expiry(&self, now: Duration) -> Duration {
        if self.radio_hop_is_troubled(now) { LEASE } else { Duration::ZERO }
    }

    /// Whether all that its peer says reaches it within a good way, what was said before included.
    fn hears_at_once(&self, now: Duration) -> bool {
        self.told.from_peer == Passage::Good && self.peer_way.longest(now) <= GOOD_WAY
    }

    /// Runs, is reached by its vehicle and hears its peer.
    fn is_well(&self, now: Duration) -> bool {
        !self.unreached && !self.radio_hop_is_troubled(now) && self.told.from_peer == Passage::Good
    }
}

/// One vehicle's emission, as conduct sees it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Emitting {
    pub radiates: bool,
    /// What is left of the power command in force.
    pub lasts: Option<Duration>,
}

impl Monitor {
    /// The circumstances of a companion have changed.
    pub fn tell(&mut self, v: usize, told: Circumstances, now: Duration) {
        let before = std::mem::replace(&mut self.sides[v].told, told);
        if told.life != before.life {
            let side = &mut self.sides[v];
            side.started_at = Some(now);
            side.inherited_until = side.gone_since.map_or(Duration::ZERO, |gone| gone + LEASED);
        }
        self.sides[v].vehicle_way.change(told.vehicle_way, now);
        self.sides[v].peer_way.change(told.peer_way, now);
        self.reckon(now);
    }

    /// The companion has died.
    pub fn companion_gone(&mut self, v: usize, now: Duration) {
        self.sides[v].told.runs = false;
        self.reckon(now);
    }

    /// A fault in the world has changed the link between a companion and its vehicle.
    pub fn world_link(&mut self, v: usize, passage: Passage, now: Duration) {
        self.sides[v].world_link = passage;
        self.reckon(now);
    }

    /// A fault has begun or ended on the hop between a vehicle's autopilot and its radio. `arrive_by`: when the last of the
    /// commands that are under way on it arrives.
    pub fn radio_hop(&mut self, v: usize, troubled: bool, arrive_by: Option<Duration>) {
        let side = &mut self.sides[v];
        side.radio_hop_troubled = troubled;
        side.late_commands_until =
            side.late_commands_until.max(arrive_by.map_or(Duration::ZERO, |at| at + GOOD_WAY));
    }

    /// By how much later than on good ways a command may arrive that its companion gave before it could know better.
    pub fn command_is_late_by(&self, v: usize, now: Duration) -> Duration {
        let side = &self.sides[v];
        match side.radio_hop_is_troubled(now) || side.link() != Passage::Good {
            true => CUT,
            false => Duration::ZERO,
        }
    }

    /// How much later than on good ways the sign of what befalls a vehicle and the command that answers it may arrive:
    /// state that is older is used for nothing, and a command that is later has expired. One that is dead or stopped answers nothing, and
    /// over a link that is cut no answer arrives until it is mended: what was commanded before expires (S5, S4).
    pub(super) fn sign_and_command(&self, v: usize, now: Duration) -> Duration {
        let side = &self.sides[v];
        let way = side.vehicle_way.longest(now).saturating_sub(GOOD_WAY);
        let mended = side.mended_at.is_some_and(|at| now <= at + REACTION);
        let expires = self.cannot_act(v) || self.inherits(v, now) || mended;
        let expiry = if expires { LEASE } else { side.expiry(now) };
        way.min(STATE_LIMIT) + way.min(LEASE).max(expiry)
    }

    /// The companion is gone, or nothing passes between it and its vehicle.
    pub(super) fn cannot_act(&self, v: usize) -> bool {
        self.sides[v].gone_since.is_some() || self.sides[v].cut_since.is_some()
    }

    /// What J's former process promised may be on the air yet: I may rest on it (S3), and the one that was started since
    /// knows neither of that nor of the pose, so that it leaves it to its lease as a dead one does (S5).
    fn inherits(&self, v: usize, now: Duration) -> bool {
        v == 1 && now <= self.sides[v].inherited_until
    }

    fn reckon(&mut self, now: Duration) {
        for v in 0..2 {
            let peer_runs = self.sides[1 - v].told.runs;
            let side = &mut self.sides[v];
            let since = |holds: bool, since: Option<Duration>| holds.then(|| since.unwrap_or(now));
            let unreached = !side.told.runs || side.link() != Passage::Good;
            if side.unreached && !unreached {
                side.reached_since = Some(now);
            }
            side.unreached = unreached;
            side.gone_since = since(!side.told.runs, side.gone_since);
            if side.cut_since.is_some() && side.link() != Passage::Cut {
                side.mended_at = Some(now);
            }
            side.cut_since = since(side.link() == Passage::Cut, side.cut_since);
            side.unheard_since = since(!peer_runs || side.told.from_peer == Passage::Cut, side.unheard_since);
        }
    }

    pub(super) fn conduct(&mut self, now: Duration, emitting: [Emitting; 2], traces: [&Traces; 2]) {
        for v in 0..2 {
            self.reaction(v, now, emitting[v].radiates, traces[v]);
            self.outliving(v, now, emitting[v]);
            self.control(v, now, traces[v]);
        }
        self.following(now, emitting);
    }

    /// S4 of one vehicle by itself, and of its peer's loss.
    fn reaction(&mut self, v: usize, now: Duration, radiates: bool, traces: &Traces) {
        let side = &self.sides[v];
        // Off may never arrive; the expiry of what was commanded before does.
        let reaction = self.allowance + if side.radio_hop_is_troubled(now) { CUT } else { REACTION };
        // J jams on while I may rest on it (S3), on state that is not old (S2): until it can have heard that I is off.
        let word = STEPS + side.peer_way.longest(now);
        let rested_on = self.protection.i_on_last.is_some_and(|on| now <= on + word);
        // Nor can it know that where I itself does not know what its radio does, or where what either says to the other is
        // late or lost: I may come on at any moment by a lease that was granted it a while ago.
        let unknown = self.sides.iter().any(|side| !side.hears_at_once(now))
            || self.sides[0].radio_hop_is_troubled(now);
        let owed = v == 1 && (rested_on || unknown);
        let state_reaction = if owed { self.allowance + STATE_LIMIT + WIRE } else { reaction }.max(reaction);
        let reached = side.reached_since.unwrap_or_default();
        let state = traces.state_due().filter(|_| !side.unreached).map(|due| due.max(reached));
        // A peer's datagrams may be under way for a while yet; a lease that was granted counts from before.
        let unheard_since = side.unheard_since.unwrap_or_default();
        let under_way = if v == 1 { STEPS + side.peer_way.longest(unheard_since) } else { Duration::ZERO };
        let acts = !self.inherits(v, now);
        let of = |since: Option<Duration>, allowed: Duration| {
            since.map(|since| now.saturating_sub(since)).filter(|held| acts && radiates && *held > allowed)
        };
        let out_of_control = of(side.sign(traces.out_of_control), reaction);
        let bad_estimate = of(side.sign(traces.bad_estimate), reaction);
        let state_late = of(state, state_reaction);
        let link_cut = of(side.cut_since, CUT);
        // Of a companion that is gone S5 says how long, and of one whose off cannot reach its vehicle a cut link's bound.
        let allowed = LEASED + under_way + side.expiry(now);
        let unheard = of(side.unheard_since.filter(|_| !self.cannot_act(v)), allowed);
        self.lasting(now, Some(v), out_of_control, |after| Breach::OutOfControl { after });
        self.lasting(now, Some(v), bad_estimate, |after| Breach::BadEstimate { after });
        self.lasting(now, Some(v), state_late, |after| Breach::StateLate { after });
        self.lasting(now, Some(v), link_cut, |after| Breach::LinkCut { after });
        self.lasting(now, Some(v), unheard, |after| Breach::Unheard { after });
    }

    /// A breach that goes on if it has a length.
    fn lasting(
        &mut self,
        now: Duration,
        vehicle: Option<usize>,
        held: Option<Duration>,
        breach: fn(Duration) -> Breach,
    ) {
        self.set(now, vehicle, breach(held.unwrap_or_default()), held.is_some());
    }

    /// S4 of the pair: J that falls silent out of turn says so, and I follows.
    fn following(&mut self, now: Duration, emitting: [Emitting; 2]) {
        // J's companion hears of what its radio does by itself only from the radio's next word.
        if self.radios[1].is_some() {
            self.followed_from = now + RADIO_WORD;
        } else if !self.sides.iter().all(|side| side.is_well(now)) {
            self.followed_from = self.followed_from.max(now);
        }
        let bare = self.protection.bare_since.filter(|(_, had_jam)| *had_jam && emitting[0].radiates);
        let reaction = REACTION + self.allowance;
        let held = bare
            .map(|(since, _)| now.saturating_sub(since.max(self.followed_from)))
            .filter(|held| *held > reaction);
        self.lasting(now, I, held, |after| Breach::Bare { after });
    }

    /// S5: what a companion leaves on the air when it is gone, and how long any command could last.
    fn outliving(&mut self, v: usize, now: Duration, emitting: Emitting) {
        let gone = self.sides[v].gone_since.map(|since| now.saturating_sub(since));
        let left = gone.filter(|gone| emitting.radiates && *gone > LEASED);
        self.lasting(now, Some(v), left, |after| Breach::Outlives { after });
        let lasts = emitting.lasts.filter(|lasts| *lasts > LEASED);
        self.lasting(now, Some(v), lasts, |lasts| Breach::Endless { lasts });
    }

    /// F2 and F3.
    fn control(&mut self, v: usize, now: Duration, traces: &Traces) {
        let side = &self.sides[v];
        let after = |since: Option<Duration>, allowed: Duration| {
            let setpoint = traces.setpoint_at?;
            setpoint.checked_sub(since?).filter(|after| *after > allowed)
        };
        // PX4 wants setpoints before it gives its mode to one that is ordered to fly.
        let unasked = traces.taken.filter(|taken| !taken.ordered);
        let taken = side.knows_of(unasked).and_then(|taken| side.sign(taken.shown));
        let mended_at = side.mended_at.unwrap_or_default();
        let way = side.vehicle_way.longest(mended_at.max(taken.unwrap_or_default()));
        let goes_on = after(taken, REACTION + way + self.allowance);
        // What a cut or a freeze held up arrives when it is over.
        let gone = side.gone_since.map(|gone| gone.max(mended_at));
        let under_way = STEPS + side.vehicle_way.longest(gone.unwrap_or_default()) + self.allowance;
        let heard = [traces.setpoint_at, traces.heartbeat_at].into_iter().flatten().max();
        let ghost = heard
            .zip(gone)
            .and_then(|(heard, gone)| heard.checked_sub(gone))
            .filter(|after| *after > under_way);
        // Heartbeats that a poor link loses show nothing; several in a row it does not lose.
        let unseen = |taken: &Taken| side.link() != Passage::Good && now < taken.at + HEARTBEATS;
        let judged = side.takes_back;
        let back = side.knows_of(traces.taken_back).map(|taken| judged.unwrap_or_else(|| !unseen(&taken)));
        self.lasting(now, Some(v), goes_on, |after| Breach::Setpoints { after });
        self.sides[v].takes_back = back;
        self.set(now, Some(v), Breach::TakesBack, back == Some(true));
        self.lasting(now, Some(v), ghost, |after| Breach::Ghost { after });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_how_long_something_was_under_way_is_known_however_often_the_way_changes_later() {
        let ms = Duration::from_millis;
        let mut way = Way::default();
        assert_eq!(way.longest(ms(5)), ms(0));
        way.change(ms(10), ms(0));
        way.change(ms(600), ms(1000));
        way.change(ms(600), ms(1500));
        way.change(ms(10), ms(2000));
        way.change(ms(20), ms(9000));
        for (at_ms, longest_ms) in [
            (0, 10),
            (999, 10),
            (1000, 600),
            (1999, 600),
            (2599, 600),
            (2600, 10),
            (8999, 10),
            (9000, 20),
            (90_000, 20),
        ] {
            assert_eq!(way.longest(ms(at_ms)), ms(longest_ms), "{at_ms}");
        }
    }
}
