//! Parameters of our own, by the parameter protocol.
//!
//! All are floats: PX4 sends integers bytewise, ArduPilot converts them, and a station that takes us for either reads a
//! float the same. What can be written cannot loosen a limit, nor touch what the two companions have agreed on: the
//! plan, the mission, powers and roles come from files that both vehicles share, and are refused here with the reason.
//! A refusal is PARAM_VALUE with the value that stays, PARAM_ERROR for stations that know it, and a line of text.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};

use crate::mission::executive::Executive;
use crate::mission::notice::Notice;
use crate::mission::refusal::ParameterRefusal;
use crate::role::Role;
use crate::service::Tolerance;

/// One parameter.
struct Parameter {
    name: &'static str,
    get: fn(&Executive) -> f64,
    access: Access,
}

enum Access {
    /// Where its value comes from.
    ReadOnly(&'static str),
    /// Least and greatest value.
    Writable([f64; 2], fn(&mut Executive, f64)),
}

/// By index. Never reordered: stations keep lists by index.
const TABLE: [Parameter; 12] = [
    Parameter {
        name: "VW_ROLE",
        get: |e| if e.settings.role == Role::I { 0.0 } else { 1.0 },
        access: Access::ReadOnly("the vehicle file: 0 for I, 1 for J"),
    },
    Parameter {
        name: "VW_PHASE",
        get: |e| e.phase.number(e.service.slot().is_some()).into(),
        access: Access::ReadOnly("the flight: 0 connecting to 11 ended"),
    },
    Parameter {
        name: "VW_SLOT",
        get: |e| e.service.slot_number().into(),
        access: Access::ReadOnly("the flight: the slot under way, or the next one"),
    },
    Parameter {
        name: "VW_SLOTS",
        get: |e| e.itinerary.as_ref().map_or(0.0, |itinerary| itinerary.slots() as f64),
        access: Access::ReadOnly("the plan both companions agreed on"),
    },
    Parameter {
        name: "VW_PMAX_W",
        get: |e| e.service.interlock().ceiling().0.min(f64::from(f32::MAX)),
        access: Access::ReadOnly("the mission, the vehicle file and the radio: the least of their limits"),
    },
    Parameter {
        name: "VW_LEASE_MS",
        get: |e| e.settings.pair.lease.as_millis() as f64,
        access: Access::ReadOnly("the program: how long a power outlives its companion"),
    },
    Parameter {
        name: "VW_JITTER_DEG",
        get: |e| e.settings.jitter_rad.to_degrees(),
        access: Access::ReadOnly("the mission file"),
    },
    Parameter {
        name: "VW_RATE_HZ",
        get: |e| e.settings.autopilot.rate_hz,
        access: Access::ReadOnly("the vehicle file"),
    },
    Parameter {
        name: "VW_KILLED",
        get: |e| f64::from(u8::from(e.service.orders().is_killed())),
        access: Access::ReadOnly("command 31011, until it is lifted at both vehicles"),
    },
    Parameter {
        name: "VW_POS_TOL_M",
        get: |e| e.ground_station.tolerance[0],
        access: Access::Writable([0.1, Tolerance::widest()[0]], |e, metres| {
            e.ground_station.tolerance[0] = metres;
            e.retune();
        }),
    },
    Parameter {
        name: "VW_ATT_TOL_DEG",
        get: |e| e.ground_station.tolerance[1].to_degrees(),
        // In degrees: checked against the range before it is taken.
        access: Access::Writable([0.5, 3.0], |e, degrees| {
            e.ground_station.tolerance[1] = degrees.to_radians();
            e.retune();
        }),
    },
    Parameter {
        name: "VW_LIVE_HZ",
        get: |e| e.ground_station.live_hz,
        access: Access::Writable([0.0, 20.0], |e, hertz| e.ground_station.live_hz = hertz),
    },
];

/// As the parameter protocol says it.
fn code(refusal: &ParameterRefusal) -> MavParamError {
    match refusal {
        ParameterRefusal::ReadOnly { .. } => MavParamError::MAV_PARAM_ERROR_READ_ONLY,
        ParameterRefusal::NoOperator { .. } => MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED,
        ParameterRefusal::NotAFloat(_) => MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH,
        ParameterRefusal::OutOfRange { .. } => MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
    }
}

fn index_of(name: &str) -> Option<usize> {
    TABLE.iter().position(|parameter| parameter.name == name)
}

impl Executive {
    /// Takes a message of the parameter protocol that is addressed to us, or to every component.
    pub(in crate::mission) fn handle_parameters(&mut self, header: MavHeader, message: &MavMessage) {
        let (system, component) = self.settings.own;
        let to_us = |s: u8, c: u8| s == system && c == component;
        let to_all = |s: u8, c: u8| (s == system || s == 0) && c == 0;
        match message {
            MavMessage::PARAM_REQUEST_LIST(m)
                if to_us(m.target_system, m.target_component)
                    || to_all(m.target_system, m.target_component) =>
            {
                self.ground_station.listing = (0..TABLE.len()).collect();
            }
            MavMessage::PARAM_REQUEST_READ(m) => {
                let named = m.param_id.to_str().ok().and_then(index_of);
                let index = match usize::try_from(m.param_index) {
                    Ok(index) => Some(index).filter(|index| *index < TABLE.len()),
                    Err(_) => named,
                };
                let exact = to_us(m.target_system, m.target_component);
                match index {
                    Some(index) if exact => self.outbox.extend(self.parameter_value(index)),
                    // Asked of every component, an index is anyone's.
                    Some(index) if m.param_index < 0 && to_all(m.target_system, m.target_component) => {
                        self.outbox.extend(self.parameter_value(index));
                    }
                    None if exact => {
                        let id = m.param_id.to_str().unwrap_or_default();
                        let error = MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
                        self.outbox.push_back(parameter_error(header, id, m.param_index, error));
                    }
                    _ => {}
                }
            }
            MavMessage::PARAM_SET(m) if to_us(m.target_system, m.target_component) => {
                self.set_parameter(header, m);
            }
            _ => {}
        }
    }

    fn set_parameter(&mut self, header: MavHeader, m: &PARAM_SET_DATA) {
        let id = m.param_id.to_str().unwrap_or_default();
        let value = f64::from(m.param_value);
        let Some((index, parameter)) = index_of(id).and_then(|index| Some((index, TABLE.get(index)?))) else {
            let error = MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
            return self.outbox.push_back(parameter_error(header, id, -1, error));
        };
        let name = parameter.name;
        let refusal = match &parameter.access {
            _ if !self.settings.operators.include(header.system_id) => {
                Some(ParameterRefusal::NoOperator { name, system: header.system_id })
            }
            Access::ReadOnly(source) => Some(ParameterRefusal::ReadOnly { name, source_of_it: source }),
            Access::Writable(..) if m.param_type != MavParamType::MAV_PARAM_TYPE_REAL32 => {
                Some(ParameterRefusal::NotAFloat(name))
            }
            // Not a number is in no range.
            Access::Writable(range, _) if !(range[0]..=range[1]).contains(&value) => {
                Some(ParameterRefusal::OutOfRange { name, value, range: *range })
            }
            Access::Writable(_, set) => {
                set(self, value);
                None
            }
        };
        self.outbox.extend(self.parameter_value(index));
        let Some(refusal) = refusal else { return self.notice(Notice::ParameterSet(name, value)) };
        self.outbox.push_back(parameter_error(header, name, index as i16, code(&refusal)));
        if matches!(refusal, ParameterRefusal::NoOperator { .. }) {
            return self.count_stranger(header);
        }
        self.notice(Notice::ParameterRefused(refusal));
    }

    /// The operator's tolerance, for the slots to come.
    fn retune(&mut self) {
        let tolerance = self.ground_station.tolerance(self.settings.jitter_rad);
        self.service.set_tolerance(tolerance);
    }

    pub(super) fn parameter_value(&self, index: usize) -> Option<MavMessage> {
        let parameter = TABLE.get(index)?;
        Some(MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: (parameter.get)(self) as f32,
            param_count: TABLE.len() as u16,
            param_index: index as u16,
            param_id: parameter.name.into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        }))
    }
}

fn parameter_error(header: MavHeader, id: &str, param_index: i16, error: MavParamError) -> MavMessage {
    MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
        param_index,
        target_system: u8::try_from(header.system_id).unwrap_or_default(),
        target_component: header.component_id,
        param_id: id.into(),
        error,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_names_are_unique_and_fit_the_wire() {
        for (index, parameter) in TABLE.iter().enumerate() {
            assert!(parameter.name.len() <= 16 && parameter.name.starts_with("VW_"), "{}", parameter.name);
            assert_eq!(index_of(parameter.name), Some(index));
        }
    }
}
