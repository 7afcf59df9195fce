//! How wrong poses may be on a motion: at each of the instants at which the search takes the rate, as at a knot of a plan that turns.

use super::super::error::PlanError;
use super::super::model::Memory;
use super::super::setup::Setup;
use super::super::turning::{Sizes, TOLERATED, tolerance_of};
use super::Scene;
use super::frame::Frame;
use super::motion::Motion;
use super::search::{samples, target};

impl Motion {
    /// Looks at how wrong poses may be on it, in a scene as it was made for, by errors of these sizes.
    ///
    /// # Errors
    /// [`PlanError`] for a problem without meaning.
    pub fn add_tolerances(&mut self, scene: &Scene<'_>, sizes: &Sizes, seed: u64) -> Result<(), PlanError> {
        let mut memory = Memory::default();
        let at = |t_s: f64| {
            let problem = scene.problem_at(t_s, self.begins_s());
            let setup = Setup::new(&problem)?;
            let samples = samples(&setup, seed);
            let raw = Setup::raw(&self.at(t_s).vehicles);
            let rate = |raw: &_| memory.value_alone(&setup, target(&setup, &samples), raw);
            Ok((t_s, tolerance_of(&setup, &raw, TOLERATED, sizes, rate)))
        };
        self.tolerances = Frame::nodes_s(self.begins_s()).map(at).collect::<Result<_, _>>()?;
        Ok(())
    }
}
