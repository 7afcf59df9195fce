//! What goes wrong in simulated flights: the kinds, the fault file and its laws, and one flight's faults drawn from them.

mod draw;
mod drawn;
mod extent;
mod file;
mod kind;
mod law;
mod schedule;

pub use draw::{Lengths, draw};
pub use drawn::Fault;
pub use file::Faults;
pub use kind::{FaultKind, Magnitude, RadioFault};
pub use law::{FaultLaw, Frequency, Whom};
pub use schedule::{Change, Schedule};
