//! A motion that both vehicles take up in the middle of a slot, or that I takes up and is silent until J has.
//!
//! I asks for a motion: its number, what each vehicle is flying, when it is to begin, and what is believed of those that move. Both
//! plan it by themselves. J says what it found by a digest; where that is I's own, and there is time, I takes the motion up and
//! says so, again and again until J says that it has, too. No last message of such an exchange can be certain (there is always one
//! that may be lost), so that I may fly a motion that J does not: then I is silent from [`GRACE`] after its beginning
//! on, for as long. J takes a motion up a little late, since a motion begins as the one before goes on; once it is too late it
//! says that it never will, and I asks for one that begins with what each of them is flying then.
//!
//! Neither half reads a clock or sends anything by itself. What is lost is sent again by I alone: J answers.

use std::time::Duration;

use crate::time::Instant;

/// How long I may be on in a motion that J has not said to fly: the one before is nearly the same as long.
pub const GRACE: Duration = Duration::from_millis(300);
/// J takes a motion up no later than so long after its beginning.
pub const LATE: Duration = Duration::from_millis(500);
/// I takes a motion up no later than so long before its beginning.
const MARGIN: Duration = Duration::from_millis(50);
/// What is not answered is said again after this.
const AGAIN: Duration = Duration::from_millis(100);

/// The motion before the first one: both rest as the slot has them.
pub const AT_REST: u16 = 0;

/// What a motion is made of, and when it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked<P> {
    /// Its number in the slot, from 1 on.
    pub number: u16,
    /// What I is flying, and what J is.
    pub from: [u16; 2],
    /// When it begins, on our own monotonic clock.
    pub begins_at: Instant,
    /// What is believed of those that move.
    pub places: P,
}

/// What is said of a motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// J: it is made, with this digest; `None`: none was found.
    Planned(Option<u64>),
    /// I: it is taken up, with this digest.
    Taken(u64),
    /// J: it is, too.
    Follows,
    /// J: it never will; this one is flown.
    Left(u16),
}

/// I's half, for one slot.
#[derive(Debug, Clone, PartialEq)]
pub struct Leader<P> {
    /// What I flies, its digest, and when it began or begins.
    flies: (u16, u64, Instant),
    /// What J flies, where that is known.
    peer: Option<u16>,
    /// Both flew one motion when this one was asked for.
    from_one: bool,
    /// Since when J has made what I flies, as far as I knew.
    made_at: Instant,
    last: u16,
    pending: Option<Pending<P>>,
    say_at: Instant,
}

#[derive(Debug, Clone, PartialEq)]
struct Pending<P> {
    asked: Asked<P>,
    own: Option<u64>,
    /// And when it was heard.
    peers: Option<(u64, Instant)>,
    ask_at: Instant,
}

impl<P: Clone> Leader<P> {
    /// Both rest.
    #[must_use]
    pub fn new(opens_at: Instant) -> Self {
        Self {
            flies: (AT_REST, 0, opens_at),
            peer: Some(AT_REST),
            from_one: true,
            made_at: opens_at,
            last: AT_REST,
            pending: None,
            say_at: opens_at,
        }
    }

    /// What I flies.
    #[must_use]
    pub fn flies(&self) -> u16 {
        self.flies.0
    }

    /// Whether a motion may be asked for: none is under way, and it is known what J flies.
    #[must_use]
    pub fn may_ask(&self, now: Instant) -> bool {
        self.pending.is_none() && self.peer.is_some() && now >= self.flies.2 && self.last < u16::MAX
    }

    /// Whether I may be on: J flies the same, or nearly.
    #[must_use]
    pub fn agrees(&self, now: Instant) -> bool {
        self.peer == Some(self.flies.0) || self.from_one && now <= self.flies.2 + GRACE
    }

    /// Since when J vouches for its part of what I flies as well: it had made it by then, as it said.
    #[must_use]
    pub fn made_at(&self) -> Instant {
        self.made_at
    }

    /// Asks for a motion, if one may be: what is to be planned here.
    pub fn ask(&mut self, begins_at: Instant, places: P, now: Instant) -> Option<Asked<P>> {
        let peer = self.peer.filter(|_| self.may_ask(now))?;
        self.last += 1;
        let asked = Asked { number: self.last, from: [self.flies.0, peer], begins_at, places };
        self.pending = Some(Pending { asked: asked.clone(), own: None, peers: None, ask_at: now });
        Some(asked)
    }

    /// What was found here: `Some` number if that is taken up now, to be flown from its beginning on.
    pub fn planned(&mut self, number: u16, digest: Option<u64>, now: Instant) -> Option<u16> {
        let pending = self.pending.as_mut().filter(|pending| pending.asked.number == number)?;
        match digest {
            Some(_) => pending.own = digest,
            None => self.pending = None,
        }
        self.take_up(now)
    }

    /// What J says; likewise.
    pub fn hear(&mut self, number: u16, word: Word, now: Instant) -> Option<u16> {
        match word {
            Word::Planned(digest) => {
                let pending = self.pending.as_mut().filter(|pending| pending.asked.number == number)?;
                match digest {
                    Some(digest) => _ = pending.peers.get_or_insert((digest, now)),
                    None => self.pending = None,
                }
                self.take_up(now)
            }
            Word::Follows if number == self.flies.0 => {
                self.peer = Some(number);
                None
            }
            Word::Left(flies) if number == self.flies.0 && flies < number => {
                self.peer = Some(flies);
                None
            }
            Word::Follows | Word::Left(_) | Word::Taken(_) => None,
        }
    }

    fn take_up(&mut self, now: Instant) -> Option<u16> {
        let Pending { asked, own, peers, .. } = self.pending.as_ref()?;
        let (own, (peers, made_at)) = ((*own)?, (*peers)?);
        let (number, begins_at, [i, j]) = (asked.number, asked.begins_at, asked.from);
        self.pending = None;
        if own != peers || now + MARGIN > begins_at {
            return None;
        }
        self.flies = (number, own, begins_at);
        self.peer = None;
        self.from_one = i == j;
        self.made_at = made_at;
        self.say_at = now;
        Some(number)
    }

    /// What is to be said now.
    pub fn poll_ask(&mut self, now: Instant) -> Option<Asked<P>> {
        self.pending.take_if(|pending| now + MARGIN > pending.asked.begins_at);
        let pending = self.pending.as_mut().filter(|p| p.peers.is_none() && p.ask_at <= now)?;
        pending.ask_at = now + AGAIN;
        Some(pending.asked.clone())
    }

    /// The same of what I has taken up.
    pub fn poll_word(&mut self, now: Instant) -> Option<(u16, Word)> {
        if self.peer.is_some() || self.say_at > now {
            return None;
        }
        self.say_at = now + AGAIN;
        Some((self.flies.0, Word::Taken(self.flies.1)))
    }

    /// When there is something to be said, or an answer is too late.
    #[must_use]
    pub fn timeout(&self) -> Option<Instant> {
        let pending = self.pending.as_ref().map(|p| match p.peers {
            None => p.ask_at,
            Some(_) => p.asked.begins_at,
        });
        [pending, self.peer.is_none().then_some(self.say_at)].into_iter().flatten().min()
    }
}

/// J's half, for one slot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Follower {
    flies: u16,
    /// The newest that was asked for, when it begins, and what was found, once it was.
    newest: Option<(u16, Instant, Option<Option<u64>>)>,
    /// None up to this one will be taken up any more.
    void: u16,
}

impl Follower {
    /// Both rest.
    #[must_use]
    pub fn new() -> Self {
        Self { flies: AT_REST, newest: None, void: AT_REST }
    }

    /// What J flies.
    #[must_use]
    pub fn flies(&self) -> u16 {
        self.flies
    }

    /// I asks for a motion: whether it is to be planned here; and what to say of one that is made already.
    pub fn hear_ask<P>(&mut self, asked: &Asked<P>) -> (bool, Option<(u16, Word)>) {
        match &self.newest {
            Some((number, _, found)) if *number == asked.number => {
                return (false, found.map(|digest| (asked.number, Word::Planned(digest))));
            }
            Some((number, ..)) if *number > asked.number => return (false, None),
            _ => {}
        }
        // What was overtaken on its way asks for what cannot be any more.
        if asked.from[1] != self.flies || asked.number <= self.void {
            return (false, None);
        }
        self.newest = Some((asked.number, asked.begins_at, None));
        (true, None)
    }

    /// What was found here, and what to say of it.
    pub fn planned(&mut self, number: u16, digest: Option<u64>) -> Option<(u16, Word)> {
        let (_, _, found) = self.newest.as_mut().filter(|(newest, ..)| *newest == number)?;
        *found = Some(digest);
        Some((number, Word::Planned(digest)))
    }

    /// What I says: whether J takes that motion up now, and what to say.
    pub fn hear(&mut self, number: u16, word: Word, now: Instant) -> (bool, Option<(u16, Word)>) {
        let Word::Taken(digest) = word else { return (false, None) };
        if number == self.flies {
            return (false, Some((number, Word::Follows)));
        }
        if number < self.flies {
            return (false, None);
        }
        let made = self.newest.filter(|(newest, ..)| *newest == number && number > self.void);
        let same = made.filter(|(_, _, found)| *found == Some(Some(digest)));
        if same.is_some_and(|(_, begins_at, _)| now <= begins_at + LATE) {
            self.flies = number;
            return (true, Some((number, Word::Follows)));
        }
        self.void = self.void.max(number);
        (false, Some((number, Word::Left(self.flies))))
    }
}

impl Default for Follower {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(ms: u64) -> Instant {
        Instant::from_start(Duration::from_millis(ms))
    }

    /// What a vehicle finds for a motion: by what it is made of, and now and then nothing, or not the same.
    fn found(asked: &Asked<u32>, odd: bool) -> Option<u64> {
        let [i, j] = asked.from;
        let digest =
            u64::from(asked.number) << 40 | u64::from(i) << 20 | u64::from(j) ^ u64::from(asked.places) << 8;
        (!asked.places.is_multiple_of(7)).then_some(if odd { !digest } else { digest })
    }

    #[derive(Debug, Clone)]
    enum Frame {
        Ask(Asked<u32>),
        Word(u16, Word),
    }

    /// Both halves, and what is under way between them: to J and to I.
    struct Pair {
        i: Leader<u32>,
        j: Follower,
        under_way: [Vec<(u64, Frame)>; 2],
        /// What each is still planning: when it is made, and of what.
        planning: [Option<(u64, Asked<u32>)>; 2],
        /// When each motion begins, and what it goes on from.
        begins: Vec<(u16, Instant, [u16; 2])>,
        taken: [u32; 2],
    }

    impl Pair {
        fn new() -> Self {
            Self {
                i: Leader::new(at(0)),
                j: Follower::new(),
                under_way: [vec![], vec![]],
                planning: [None, None],
                begins: vec![(AT_REST, at(0), [AT_REST; 2])],
                taken: [0; 2],
            }
        }

        /// One frame on the link: lost, doubled and held up as the fates have it.
        fn send(&mut self, to: usize, frame: Frame, ms: u64, fate: &mut impl FnMut(u64) -> u64) {
            if fate(100) < 30 {
                return;
            }
            for _ in 0..=u64::from(fate(100) < 20) {
                let held = if fate(100) < 20 { fate(900) } else { fate(40) };
                self.under_way[to].push((ms + 2 + held, frame.clone()));
            }
        }

        fn step(&mut self, ms: u64, cut: bool, odd: bool, fate: &mut impl FnMut(u64) -> u64) {
            let now = at(ms);
            let mut out: Vec<(usize, Frame)> = vec![];
            for to in 0..2 {
                let due: Vec<Frame> =
                    self.under_way[to].iter().filter(|(at, _)| *at <= ms).map(|(_, f)| f.clone()).collect();
                self.under_way[to].retain(|(at, _)| *at > ms);
                for frame in due.into_iter().filter(|_| !cut) {
                    match (to, frame) {
                        (0, Frame::Ask(asked)) => {
                            let (plan, say) = self.j.hear_ask(&asked);
                            out.extend(say.map(|(n, w)| (1, Frame::Word(n, w))));
                            if plan {
                                self.planning[1] = Some((ms + fate(120), asked));
                            }
                        }
                        (0, Frame::Word(number, word)) => {
                            let (taken, say) = self.j.hear(number, word, now);
                            self.taken[1] += u32::from(taken);
                            out.extend(say.map(|(n, w)| (1, Frame::Word(n, w))));
                        }
                        (_, Frame::Word(number, word)) => {
                            let taken = self.i.hear(number, word, now);
                            self.taken[0] += u32::from(taken.is_some());
                        }
                        (_, Frame::Ask(_)) => {}
                    }
                }
            }
            for v in 0..2 {
                if let Some((_, asked)) = self.planning[v].take_if(|(made, _)| *made <= ms) {
                    let digest = found(&asked, odd && v == 1);
                    if v == 0 {
                        self.taken[0] += u32::from(self.i.planned(asked.number, digest, now).is_some());
                    } else if let Some((n, w)) = self.j.planned(asked.number, digest) {
                        out.push((1, Frame::Word(n, w)));
                    }
                }
            }
            if ms.is_multiple_of(200) && self.i.may_ask(now) {
                let asked = self.i.ask(at(ms + 400), fate(1000) as u32, now).unwrap();
                self.begins.push((asked.number, asked.begins_at, asked.from));
                self.planning[0] = Some((ms + fate(120), asked));
            }
            out.extend(self.i.poll_ask(now).map(|asked| (0, Frame::Ask(asked))));
            out.extend(self.i.poll_word(now).map(|(n, w)| (0, Frame::Word(n, w))));
            for (to, frame) in out {
                self.send(to, frame, ms, fate);
            }
            self.check(now);
        }

        /// Where I may be on, J flies the same, or what that goes on from while it has just begun.
        fn check(&self, now: Instant) {
            let (i, j) = (self.i.flies(), self.j.flies());
            let of = |number: u16| *self.begins.iter().find(|(n, ..)| *n == number).unwrap();
            let (_, begins_at, [i_before, j_before]) = of(i);
            if self.i.agrees(now) {
                let nearly = j == j_before && i_before == j_before && now <= begins_at + GRACE;
                assert!(i == j || nearly, "I flies {i}, J {j} at {now:?}");
            }
            assert!(j <= i, "J flies {j}, which I does not: {i}");
            if let Some(known) = self.i.peer {
                assert_eq!(known, j, "J is known to fly another");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
        #[test]
        fn spec_whatever_the_link_does_i_is_on_with_what_j_flies_and_both_find_together_again(
            fates in prop::collection::vec(any::<u32>(), 4096), cut_at in 0u64..15_000,
        ) {
            let mut pair = Pair::new();
            let mut next = 0;
            let mut fate = |below: u64| {
                next += 1;
                u64::from(fates[next % fates.len()].wrapping_add((next as u32).wrapping_mul(2_654_435_761) >> 7)) % below
            };
            for ms in (0..20_000).step_by(10) {
                let cut = (cut_at..cut_at + 5_000).contains(&ms);
                let odd = (3_000..4_000).contains(&ms);
                pair.step(ms, cut, odd, &mut fate);
            }
            // A link that does nothing of the kind, once what was held up is through.
            for ms in (20_000..24_000).step_by(10) {
                let mut kind = |below: u64| if below == 100 { 99 } else { 1 };
                pair.step(ms, false, false, &mut kind);
            }
            let before = pair.taken;
            for ms in (24_000..27_000).step_by(10) {
                let mut kind = |below: u64| if below == 100 { 99 } else { 1 };
                pair.step(ms, false, false, &mut kind);
                prop_assert!(pair.i.agrees(at(ms)));
            }
            prop_assert!(pair.taken[0] >= before[0] + 3 && pair.taken[1] >= before[1] + 3, "{:?} {:?}", before, pair.taken);
        }
    }

    fn asked(number: u16, from: [u16; 2], begins_ms: u64) -> Asked<u32> {
        Asked { number, from, begins_at: at(begins_ms), places: 1 }
    }

    #[test]
    fn spec_one_that_both_found_alike_is_taken_up_by_i_and_then_by_j() {
        let (mut i, mut j) = (Leader::new(at(0)), Follower::new());
        let first = i.ask(at(1400), 1, at(1000)).unwrap();
        assert_eq!((first.number, first.from), (1, [AT_REST; 2]));
        assert!(!i.may_ask(at(1000)) && i.poll_ask(at(1000)) == Some(first));
        assert_eq!(i.poll_ask(at(1099)), None);
        assert_eq!(i.poll_ask(at(1100)), Some(first));
        assert_eq!(j.hear_ask(&first), (true, None));
        assert_eq!(j.hear_ask(&first), (false, None), "a copy");
        assert_eq!(j.planned(1, Some(7)), Some((1, Word::Planned(Some(7)))));
        assert_eq!(j.hear_ask(&first), (false, Some((1, Word::Planned(Some(7))))), "the answer was lost");
        assert_eq!(i.hear(1, Word::Planned(Some(7)), at(1200)), None, "not made here yet");
        assert_eq!(i.poll_ask(at(1300)), None);
        assert_eq!(i.planned(1, Some(7), at(1350)), Some(1));
        assert!(i.agrees(at(1700)) && !i.agrees(at(1701)));
        assert_eq!(i.poll_word(at(1350)), Some((1, Word::Taken(7))));
        assert_eq!(i.poll_word(at(1449)), None);
        assert_eq!(i.poll_word(at(1450)), Some((1, Word::Taken(7))));
        assert_eq!(j.hear(1, Word::Taken(7), at(1900)), (true, Some((1, Word::Follows))));
        assert_eq!(j.hear(1, Word::Taken(7), at(1910)), (false, Some((1, Word::Follows))));
        assert!(!i.may_ask(at(1910)));
        assert_eq!(i.hear(1, Word::Follows, at(1910)), None);
        assert!(i.agrees(at(9000)) && i.may_ask(at(1910)) && i.poll_word(at(9000)).is_none());
        assert_eq!((i.flies(), j.flies()), (1, 1));
    }

    #[test]
    fn spec_what_is_not_found_alike_or_too_late_is_taken_up_by_nobody() {
        for (own, peers, made_ms) in
            [(Some(7), Some(8), 1200), (None, Some(8), 1200), (Some(7), None, 1200), (Some(7), Some(7), 1351)]
        {
            let mut i = Leader::new(at(0));
            i.ask(at(1400), 1, at(1000)).unwrap();
            assert_eq!(i.planned(1, own, at(1100)), None);
            assert_eq!(i.hear(1, Word::Planned(peers), at(made_ms)), None, "{own:?} {peers:?}");
            assert!(i.may_ask(at(1400)) && i.flies() == AT_REST && i.agrees(at(9000)));
            assert_eq!(i.ask(at(2400), 1, at(2000)).unwrap().number, 2);
        }
        // Nobody answers.
        let mut i = Leader::new(at(0));
        i.ask(at(1400), 1, at(1000)).unwrap();
        assert!(i.poll_ask(at(1350)).is_some() && i.poll_ask(at(1360)).is_none() && i.may_ask(at(1360)));
    }

    #[test]
    fn spec_j_that_is_too_late_never_takes_it_up_and_both_go_on_from_what_each_flies() {
        let (mut i, mut j) = (Leader::new(at(0)), Follower::new());
        let first = i.ask(at(1400), 1, at(1000)).unwrap();
        j.hear_ask(&first);
        j.planned(1, Some(7));
        i.hear(1, Word::Planned(Some(7)), at(1100));
        assert_eq!(i.planned(1, Some(7), at(1100)), Some(1));
        assert_eq!(j.hear(1, Word::Taken(7), at(1901)), (false, Some((1, Word::Left(AT_REST)))));
        assert_eq!(j.hear(1, Word::Taken(7), at(1500)), (false, Some((1, Word::Left(AT_REST)))), "never");
        assert!(!i.may_ask(at(2000)) && !i.agrees(at(2000)));
        assert_eq!(i.hear(1, Word::Left(AT_REST), at(2000)), None);
        assert!(!i.agrees(at(2000)), "they fly two motions");
        let second = i.ask(at(2400), 1, at(2000)).unwrap();
        assert_eq!((second.number, second.from), (2, [1, AT_REST]));
        assert_eq!(j.hear_ask(&second), (true, None));
        j.planned(2, Some(9));
        i.planned(2, Some(9), at(2100));
        assert_eq!(i.hear(2, Word::Planned(Some(9)), at(2100)), Some(2));
        assert_eq!(j.hear(2, Word::Taken(9), at(2110)), (true, Some((2, Word::Follows))));
        assert!(!i.agrees(at(2110)), "what it begins with is not one motion");
        i.hear(2, Word::Follows, at(2120));
        assert!(i.agrees(at(9000)));
        // What was overtaken changes nothing.
        assert_eq!(j.hear(1, Word::Taken(7), at(2130)), (false, None));
        assert_eq!(j.hear_ask(&first), (false, None));
        i.hear(1, Word::Left(AT_REST), at(2130));
        assert!(i.agrees(at(9000)));
    }

    #[test]
    fn spec_j_plans_from_what_it_flies_and_from_nothing_else() {
        let mut j = Follower::new();
        assert_eq!(j.hear_ask(&asked(4, [3, 3], 1400)), (false, None));
        assert_eq!(j.hear_ask(&asked(4, [3, AT_REST], 1400)), (true, None));
        j.planned(4, Some(1));
        assert_eq!(j.planned(3, Some(1)), None, "not asked for any more");
        assert_eq!(
            j.hear(4, Word::Taken(2), at(1400)),
            (false, Some((4, Word::Left(AT_REST)))),
            "another motion"
        );
        assert_eq!(
            j.hear(4, Word::Taken(1), at(1400)),
            (false, Some((4, Word::Left(AT_REST)))),
            "it has said so"
        );
        assert_eq!(j.hear(4, Word::Follows, at(1400)), (false, None), "J's own word");
    }
    #[test]
    fn spec_a_question_that_was_overtaken_takes_the_place_of_no_newer_one() {
        let mut j = Follower::new();
        assert_eq!(j.hear_ask(&asked(2, [AT_REST, AT_REST], 1400)), (true, None));
        assert_eq!(j.hear_ask(&asked(1, [AT_REST, AT_REST], 1300)), (false, None));
        assert_eq!((j.planned(1, Some(7)), j.planned(2, Some(8))), (None, Some((2, Word::Planned(Some(8))))));
        assert_eq!(j.hear_ask(&asked(1, [AT_REST, AT_REST], 1300)), (false, None));
        assert_eq!(
            j.hear_ask(&asked(2, [AT_REST, AT_REST], 1400)),
            (false, Some((2, Word::Planned(Some(8)))))
        );
    }

    #[test]
    fn spec_who_says_that_it_left_what_it_flies_has_said_nothing() {
        let mut i = Leader::new(at(0));
        i.ask(at(1400), 1, at(1000)).unwrap();
        i.planned(1, Some(7), at(1100));
        assert_eq!(i.hear(1, Word::Planned(Some(7)), at(1100)), Some(1));
        i.hear(1, Word::Left(1), at(1200));
        assert!(!i.agrees(at(2000)) && !i.may_ask(at(2000)), "not known what J flies");
    }

    #[test]
    fn spec_numbers_come_to_an_end_and_none_comes_twice() {
        let mut i = Leader::new(at(0));
        i.last = u16::MAX - 1;
        assert_eq!(i.ask(at(1400), 1, at(1000)).map(|asked| asked.number), Some(u16::MAX));
        i.planned(u16::MAX, None, at(1100));
        assert_eq!(i.ask(at(2400), 1, at(2000)), None);
    }

    #[test]
    fn spec_i_wakes_to_ask_again_to_give_up_and_to_say_what_it_has_taken_up() {
        let mut i = Leader::new(at(0));
        assert_eq!(i.timeout(), None);
        i.ask(at(1400), 1, at(1000)).unwrap();
        assert_eq!(i.timeout(), Some(at(1000)));
        i.poll_ask(at(1000)).unwrap();
        assert_eq!(i.timeout(), Some(at(1000) + AGAIN));
        i.hear(1, Word::Planned(Some(7)), at(1050));
        assert_eq!(i.timeout(), Some(at(1400)), "nothing more to ask");
        i.planned(1, Some(7), at(1100));
        assert_eq!(i.timeout(), Some(at(1100)), "to say that it is taken up");
        i.poll_word(at(1100)).unwrap();
        assert_eq!(i.timeout(), Some(at(1100) + AGAIN));
        i.hear(1, Word::Follows, at(1150));
        assert_eq!(i.timeout(), None);
    }
}
