//! Companions in step with the world: each is told how far time goes, and the world waits for it. Nobody is late because the
//! machine is busy; the flight takes longer then.

use std::time::Duration;

use tokio::io::AsyncWriteExt;
use tokio::process::ChildStdin;
use tokio::sync::mpsc;
use tokio::time::timeout;
use veilwing_sitl::vehicle::TICK;

use crate::cli::step::{Flies, Order};
use crate::desk::simulation::{index, reads_at_start};
use crate::role::{PerVehicle, Role};
use crate::time::{Instant, Utc};

use super::process::{Companion, Line, Said};

/// The world and the companions hear each other this often, in flight time.
pub(super) const STEP: Duration = TICK;
/// A companion that takes longer for a step, by the wall, hangs. Planning is part of its first.
const HANGS_AFTER: Duration = Duration::from_secs(120);

/// What leads a companion process through time.
#[derive(Debug)]
pub(super) struct Lead {
    role: Role,
    stdin: ChildStdin,
    /// The flight time at which it was first told the time.
    began: Option<Duration>,
    stop: bool,
}

impl Lead {
    pub fn new(role: Role, stdin: ChildStdin) -> Self {
        Self { role, stdin, began: None, stop: false }
    }

    /// Asks it to stop, in order, in the next step.
    pub fn stop(&mut self) {
        self.stop = true;
    }

    async fn go(&mut self, step: &Step) {
        let is_first = self.began.is_none();
        let began = *self.began.get_or_insert(step.from);
        let reads = |at: Duration| Instant::from_start(at.saturating_sub(began) + reads_at_start(self.role));
        // No two computers agree what time it is.
        let utc = step.utc + Duration::from_millis(index(self.role) as u64);
        let begin = is_first.then_some(Order::Begin { now: reads(step.from), utc });
        let stop = std::mem::take(&mut self.stop).then_some(Order::Stop);
        let go = Order::Go { from: reads(step.from), to: reads(step.to) };
        let lines: String =
            [begin, stop, Some(go)].iter().flatten().map(|order| format!("{order}\n")).collect();
        // One that is dead does not answer either, and that is waited for.
        let _ = self.stdin.write_all(lines.as_bytes()).await;
    }
}

/// How far time goes next.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Flight time.
    pub from: Duration,
    /// Flight time.
    pub to: Duration,
    /// At `from`.
    pub utc: Utc,
}

/// Lets the companions that run do all that is due in a step. Those in `awaited` have been told, or killed, and have neither
/// done so nor ended yet.
pub(super) struct Round<'a> {
    step: Step,
    awaited: Vec<&'a mut Companion>,
}

impl<'a> Round<'a> {
    /// Tells the companions that run to go on.
    pub async fn begin(step: Step, companions: [&'a mut Companion; 2]) -> Self {
        let mut awaited = Vec::new();
        for companion in companions.into_iter().filter(|companion| companion.lives()) {
            let runs = !companion.is_held() && !companion.killed;
            if let Some(lead) = companion.lead.as_mut().filter(|_| runs) {
                lead.go(&step).await;
            }
            // One that is stopped by a signal answers when it goes on, unless it is killed first.
            if runs || companion.killed {
                awaited.push(companion);
            }
        }
        Self { step, awaited }
    }

    /// Waits until all are done or gone, and says what both vehicles fly where motions are made anew. What companions say meanwhile
    /// goes to `hear`.
    ///
    /// # Errors
    /// A companion hangs; in words.
    pub async fn end(
        mut self,
        said: &mut mpsc::UnboundedReceiver<(Role, Said)>,
        mut hear: impl FnMut(Role, Line),
    ) -> Result<Option<Flies>, String> {
        let mut flown: PerVehicle<Option<Flies>> = PerVehicle::default();
        while !self.awaited.is_empty() {
            match timeout(HANGS_AFTER, said.recv()).await.map_err(|_| self.hangs())? {
                Some((role, Said::Line(line))) => hear(role, line),
                Some((role, Said::Done(flies))) => {
                    flown[role] = flies;
                    self.awaited.retain(|companion| companion.role != role);
                }
                Some((role, Said::Gone)) => {
                    if let Some(k) = self.awaited.iter().position(|companion| companion.role == role) {
                        // Whoever closes its pipe has all but ended; how, is asked later.
                        let ended = timeout(HANGS_AFTER, self.awaited[k].child.wait()).await;
                        if ended.is_err() {
                            return Err(self.hangs());
                        }
                        self.awaited.swap_remove(k);
                    }
                }
                None => break,
            }
        }
        // By I's, as long as J flies the same.
        Ok(flown.i.filter(|flies| flies.alike).or(flown.j))
    }

    fn hangs(&self) -> String {
        let roles: Vec<String> = self.awaited.iter().map(|companion| companion.role.to_string()).collect();
        format!(
            "companion {} hangs: neither gone on to {:.4} s of flight, as it was told, nor ended, in {} s",
            roles.join(" and "),
            self.step.to.as_secs_f64(),
            HANGS_AFTER.as_secs()
        )
    }
}
