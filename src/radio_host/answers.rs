//! Commands whose answer waits for the device.

use std::collections::VecDeque;

/// More that wait than these are not answered, the oldest first: the companion repeats off every 25 ms, and a power every
/// 100 ms.
const MOST: usize = 64;

/// A power command that was taken and is not answered yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Waiting {
    pub boot: u32,
    pub number: u32,
    /// It asks for silence.
    pub off: bool,
}

/// See the module.
#[derive(Debug, Clone, Default)]
pub(super) struct Answers(VecDeque<Waiting>);

impl Answers {
    pub fn wait(&mut self, command: Waiting) {
        if self.0.len() == MOST {
            self.0.pop_front();
        }
        self.0.push_back(command);
    }

    /// Takes out those that this is true of.
    pub fn take(&mut self, which: impl Fn(&Waiting) -> bool) -> Vec<Waiting> {
        let (mut taken, mut left) = (Vec::new(), VecDeque::new());
        for waiting in self.0.drain(..) {
            if which(&waiting) {
                taken.push(waiting);
            } else {
                left.push_back(waiting);
            }
        }
        self.0 = left;
        taken
    }
}
