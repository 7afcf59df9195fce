//! What control and the firmware's own parts are handed with every input.

use super::command::CommandQueue;
use super::firmware::Firmware;
use super::outbox::{Address, Outbox};
use super::parameter::Parameters;
use super::settings::Settings;
use super::state::{Timed, VehicleState};
use crate::time::Instant;

/// What is known of the autopilot at an instant, and where there is something to be said to it or to the executive.
#[derive(Debug)]
pub(super) struct Context<'a> {
    pub(super) now: Instant,
    pub(super) firmware: Firmware,
    pub(super) target: Address,
    pub(super) settings: &'a Settings,
    pub(super) state: &'a VehicleState,
    /// The autopilot's last words.
    pub(super) last_text: Option<&'a Timed<String>>,
    pub(super) commands: &'a mut CommandQueue,
    pub(super) parameters: &'a mut Parameters,
    pub(super) out: &'a mut Outbox,
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::autopilot::event::Event;
    use crate::geo::Geodetic;
    use mavlink::dialects::ardupilotmega::COMMAND_LONG_DATA;
    use mavlink::dialects::ardupilotmega::MavMessage;
    use std::time::Duration;

    /// Everything that a part is handed, and what it said.
    pub(in crate::autopilot) struct Bench {
        pub now: Instant,
        pub firmware: Firmware,
        pub settings: Settings,
        pub state: VehicleState,
        pub commands: CommandQueue,
        pub parameters: Parameters,
        pub out: Outbox,
    }

    pub(in crate::autopilot) fn settings() -> Settings {
        let origin = Geodetic { lat_deg: 50.0, lon_deg: 14.0, alt_m: 200.0 };
        Settings { tracks_pose: true, ..Settings::new((1, 191), origin) }
    }

    impl Bench {
        pub fn new(firmware: Firmware) -> Self {
            Self {
                now: Instant::from_start(Duration::from_secs(100)),
                firmware,
                settings: settings(),
                state: VehicleState::default(),
                commands: CommandQueue::default(),
                parameters: Parameters::default(),
                out: Outbox::default(),
            }
        }

        pub fn context(&mut self) -> Context<'_> {
            Context {
                now: self.now,
                firmware: self.firmware,
                target: (1, 1),
                settings: &self.settings,
                state: &self.state,
                last_text: None,
                commands: &mut self.commands,
                parameters: &mut self.parameters,
                out: &mut self.out,
            }
        }

        pub fn pass(&mut self, time: Duration) {
            self.now = self.now + time;
        }

        /// The commands that are due, taken off the wire; the queue goes on waiting for their answers.
        pub fn sent(&mut self) -> Vec<COMMAND_LONG_DATA> {
            _ = self.commands.advance(self.now, (1, 1), &mut self.out);
            let command = |message| match message {
                MavMessage::COMMAND_LONG(command) => Some(command),
                _ => None,
            };
            std::iter::from_fn(|| self.out.next_message()).filter_map(command).collect()
        }

        pub fn events(&mut self) -> Vec<Event> {
            std::iter::from_fn(|| self.out.next_event()).collect()
        }
    }
}
