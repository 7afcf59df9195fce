//! The loop: takes inputs of the corpus, changes them, runs them, and keeps what reached something new.

use std::cell::RefCell;
use std::panic::{self, AssertUnwindSafe};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use veilwing::link::Clock;

use crate::corpus::trimmed;
use crate::mutator::Mutator;
use crate::reached::Reached;
use crate::target::Target;
use crate::watchdog::Watchdog;

/// What became of an input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It reached nothing that another had not.
    Known,
    /// It, or what was left of it, reached something new, and is part of the corpus now.
    New(Vec<u8>),
    /// The target panicked, with these words.
    Panicked {
        /// The input.
        input: Vec<u8>,
        /// Where, and what was said.
        message: String,
    },
}

thread_local! {
    static LAST_PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Keeps the words of panics for [`reach`] instead of printing them.
pub fn quiet_panics() {
    panic::set_hook(Box::new(|info| LAST_PANIC.with(|last| *last.borrow_mut() = info.to_string())));
}

/// Runs one input.
///
/// # Errors
/// The words of its panic, if [`quiet_panics`] keeps them.
pub fn reach(target: &Target, input: &[u8]) -> Result<Reached, String> {
    panic::catch_unwind(AssertUnwindSafe(|| target.reach(input)))
        .map_err(|_| LAST_PANIC.with(|last| std::mem::take(&mut *last.borrow_mut())))
}

/// The state of a search. The same seed and the same corpus give the same inputs.
#[derive(Debug)]
pub struct Fuzzer {
    target: Target,
    mutator: Mutator,
    rng: ChaCha8Rng,
    corpus: Vec<Vec<u8>>,
    known: Reached,
    watch: Option<(Watchdog, Clock)>,
}

impl Fuzzer {
    /// A search that has yet to begin.
    #[must_use]
    pub fn new(target: &Target, seed: u64) -> Self {
        Self {
            target: *target,
            mutator: Mutator::new(target.words),
            rng: ChaCha8Rng::seed_from_u64(seed),
            corpus: Vec::new(),
            known: Reached::default(),
            watch: None,
        }
    }

    /// Tells this watchdog, by this clock, of each input that begins and ends.
    #[must_use]
    pub fn watched(self, watchdog: Watchdog, clock: Clock) -> Self {
        Self { watch: Some((watchdog, clock)), ..self }
    }

    fn reach(&self, input: &[u8]) -> Result<Reached, String> {
        let Some((watchdog, clock)) = &self.watch else { return reach(&self.target, input) };
        watchdog.begins(input, clock.now());
        let reached = reach(&self.target, input);
        watchdog.ends();
        reached
    }

    /// All that was reached so far.
    #[must_use]
    pub fn known(&self) -> &Reached {
        &self.known
    }

    /// The next input to run.
    pub fn next_input(&mut self) -> Vec<u8> {
        let (one, other) = (self.pick(), self.pick());
        let entry = |at: Option<usize>| at.and_then(|at| self.corpus.get(at)).map_or(&[][..], Vec::as_slice);
        self.mutator.mutate(entry(one), entry(other), &mut self.rng)
    }

    /// One of the corpus, half of the time of the newest: what reached something new leads on.
    fn pick(&mut self) -> Option<usize> {
        let length = self.corpus.len();
        let recent = self.rng.random_bool(0.5);
        let least = if recent { length.saturating_sub(16) } else { 0 };
        (length > 0).then(|| self.rng.random_range(least..length))
    }

    /// Runs an input as it is, for what it reaches, and remembers it whatever that is.
    pub fn take(&mut self, input: Vec<u8>) -> Outcome {
        match self.reach(&input) {
            Err(message) => Outcome::Panicked { input, message },
            Ok(reached) => {
                let new = !self.known.covers(&reached);
                self.known.join(&reached);
                self.corpus.push(input.clone());
                if new { Outcome::New(input) } else { Outcome::Known }
            }
        }
    }

    /// Runs an input, and keeps the least of it that reaches what is new.
    pub fn run(&mut self, input: Vec<u8>) -> Outcome {
        let reached = match self.reach(&input) {
            Err(message) => return Outcome::Panicked { input, message },
            Ok(reached) => reached,
        };
        let new = reached.beyond(&self.known);
        if new.is_empty() {
            return Outcome::Known;
        }
        let least = trimmed(&input, &new, |shorter| self.reach(shorter).ok());
        self.known.join(&reached);
        self.corpus.push(least.clone());
        Outcome::New(least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Panics at four letters, each of which is an outcome of its own.
    fn locked(input: &[u8], reached: &mut Reached) {
        let right = input.iter().zip(b"lock").take_while(|(a, b)| a == b).count();
        reached.note(format_args!("{right}"));
        assert!(right < 4, "open");
    }

    const LOCKED: Target =
        Target { name: "locked", what: "a lock", words: &[], seeds: Vec::new, run: locked, generated: 0 };

    #[test]
    fn spec_a_panic_behind_four_outcomes_is_found_and_its_input_kept() {
        let mut fuzzer = Fuzzer::new(&LOCKED, 1);
        let found = (0..200_000).find_map(|_| {
            let input = fuzzer.next_input();
            match fuzzer.run(input) {
                Outcome::Panicked { input, .. } => Some(input),
                Outcome::Known | Outcome::New(_) => None,
            }
        });
        assert!(found.is_some_and(|input| input.starts_with(b"lock")), "not found");
        // One entry an outcome, each no longer than it needs to be.
        assert_eq!(fuzzer.corpus, [&b""[..], b"l", b"lo", b"loc"]);
    }

    #[test]
    fn spec_two_searches_with_one_seed_are_one() {
        let inputs = |seed| {
            let mut fuzzer = Fuzzer::new(&LOCKED, seed);
            let run = |_| {
                let input = fuzzer.next_input();
                fuzzer.run(input.clone());
                input
            };
            (0..2000).map(run).collect::<Vec<_>>()
        };
        assert_eq!(inputs(7), inputs(7));
        assert_ne!(inputs(7), inputs(8));
    }
}
