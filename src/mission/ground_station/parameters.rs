//! Parameters of our own, by the parameter protocol.
//!
//! All are floats: PX4 sends integers bytewise, ArduPilot converts them, and a station that takes us for either reads a
//! float the same. What can be written cannot loosen a limit, nor touch what the two companions have agreed on: the
//! plan, the mission, powers and roles come from files that both vehicles share, and are refused here with the reason.
//! What a station is shown of each stands with it in one table (`metadata`).
//! A refusal is PARAM_VALUE with the value that stays, PARAM_ERROR for stations that know it, and a line of text.

use mavlink::MavHeader;
use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};

use serde_json::{Value, json};

use crate::mission::executive::Executive;
use crate::mission::notice::Notice;
use crate::mission::phase;
use crate::mission::refusal::ParameterRefusal;
use crate::role::Role;
use crate::service::Tolerance;

/// One parameter.
struct Parameter {
    name: &'static str,
    get: fn(&Executive) -> f64,
    access: Access,
    shown: Shown,
}

/// How a ground station is to show it.
struct Shown {
    /// In a few words.
    what: &'static str,
    group: &'static str,
    unit: &'static str,
    decimals: u8,
    /// Its values in words, where it is a number for a kind: from 0 on.
    words: &'static [&'static str],
    /// Changes by itself.
    volatile: bool,
}

impl Shown {
    /// A whole number without a unit that stays.
    const COUNT: Self =
        Self { what: "", group: "Mission", unit: "", decimals: 0, words: &[], volatile: false };
}

enum Access {
    /// Where its value comes from.
    ReadOnly(&'static str),
    Writable(Writable),
}

struct Writable {
    /// Least and greatest value.
    range: [f64; 2],
    /// What it is at every start.
    default: f64,
    /// By how much a button changes it.
    increment: f64,
    /// What it does.
    does: &'static str,
    set: fn(&mut Executive, f64),
}

/// Live figures a second, at the start.
pub(super) const LIVE_HZ: f64 = 10.0;

/// By index. Never reordered: stations keep lists by index.
const TABLE: [Parameter; 12] = [
    Parameter {
        name: "VW_ROLE",
        get: |e| if e.settings.role == Role::I { 0.0 } else { 1.0 },
        access: Access::ReadOnly("the vehicle file: 0 for I, 1 for J"),
        shown: Shown {
            what: "This vehicle's part in the pair",
            words: &["I, the information transmitter", "J, the friendly jammer"],
            ..Shown::COUNT
        },
    },
    Parameter {
        name: "VW_PHASE",
        get: |e| e.phase.number(e.service.slot().is_some()).into(),
        access: Access::ReadOnly("the flight: 0 connecting to 11 ended"),
        shown: Shown { what: "Phase of the flight", words: &phase::NAMES, volatile: true, ..Shown::COUNT },
    },
    Parameter {
        name: "VW_SLOT",
        get: |e| e.service.slot_number().into(),
        access: Access::ReadOnly("the flight: the slot under way, or the next one"),
        shown: Shown { what: "Slot, from 0", volatile: true, ..Shown::COUNT },
    },
    Parameter {
        name: "VW_SLOTS",
        get: |e| e.itinerary.as_ref().map_or(0.0, |itinerary| itinerary.slots() as f64),
        access: Access::ReadOnly("the plan both companions agreed on"),
        shown: Shown { what: "Slots of the mission", volatile: true, ..Shown::COUNT },
    },
    Parameter {
        name: "VW_PMAX_W",
        get: |e| e.service.interlock().ceiling().0.min(f64::from(f32::MAX)),
        access: Access::ReadOnly("the mission, the vehicle file and the radio: the least of their limits"),
        shown: Shown {
            what: "Greatest transmit power",
            group: "Radio",
            unit: "W",
            decimals: 3,
            volatile: true,
            ..Shown::COUNT
        },
    },
    Parameter {
        name: "VW_LEASE_MS",
        get: |e| e.settings.pair.lease.as_millis() as f64,
        access: Access::ReadOnly("the program: how long a power outlives its companion"),
        shown: Shown { what: "Length of a lease", group: "Radio", unit: "ms", ..Shown::COUNT },
    },
    Parameter {
        name: "VW_JITTER_DEG",
        get: |e| e.settings.jitter.std_rad.to_degrees(),
        access: Access::ReadOnly("the mission file"),
        shown: Shown { what: "Jitter that the plan expects", unit: "deg", decimals: 2, ..Shown::COUNT },
    },
    Parameter {
        name: "VW_RATE_HZ",
        get: |e| e.settings.autopilot.rate_hz,
        access: Access::ReadOnly("the vehicle file"),
        shown: Shown { what: "Setpoints a second", unit: "Hz", decimals: 1, ..Shown::COUNT },
    },
    Parameter {
        name: "VW_KILLED",
        get: |e| f64::from(u8::from(e.service.orders().is_killed())),
        access: Access::ReadOnly("command 31011, until it is lifted at both vehicles"),
        shown: Shown {
            what: "Radio kill",
            group: "Radio",
            words: &["no", "killed: nothing radiates"],
            volatile: true,
            ..Shown::COUNT
        },
    },
    Parameter {
        name: "VW_POS_TOL_M",
        get: |e| e.ground_station.tolerance[0],
        access: Access::Writable(Writable {
            range: [0.1, Tolerance::widest()[0]],
            default: Tolerance::widest()[0],
            increment: 0.1,
            does: "How far the vehicle may be from where the plan has it and radiate, in the slots to come.",
            set: |e, metres| {
                e.ground_station.tolerance[0] = metres;
                e.retune();
            },
        }),
        shown: Shown { what: "Tolerance of position", group: "Pose", unit: "m", decimals: 2, ..Shown::COUNT },
    },
    Parameter {
        name: "VW_ATT_TOL_DEG",
        get: |e| e.ground_station.tolerance[1].to_degrees(),
        access: Access::Writable(Writable {
            // In degrees: checked against the range before it is taken.
            range: [0.5, 3.0],
            default: 3.0,
            increment: 0.1,
            does: "How far the vehicle may be turned from how the plan has it and radiate, in the slots to come, before the \
                   jitter's share.",
            set: |e, degrees| {
                e.ground_station.tolerance[1] = degrees.to_radians();
                e.retune();
            },
        }),
        shown: Shown {
            what: "Tolerance of attitude",
            group: "Pose",
            unit: "deg",
            decimals: 2,
            ..Shown::COUNT
        },
    },
    Parameter {
        name: "VW_LIVE_HZ",
        get: |e| e.ground_station.live_hz,
        access: Access::Writable(Writable {
            range: [0.0, 20.0],
            default: LIVE_HZ,
            increment: 1.0,
            does: "How often a live figure is sent, and where the vehicle stands; 0 sends none of them.",
            set: |e, hertz| e.ground_station.live_hz = hertz,
        }),
        shown: Shown {
            what: "Live figures a second",
            group: "Display",
            unit: "Hz",
            decimals: 1,
            ..Shown::COUNT
        },
    },
];

/// Every parameter as parameter.schema.json of the component metadata service has it.
pub(super) fn described() -> Vec<Value> {
    TABLE.iter().map(Parameter::described).collect()
}

impl Parameter {
    fn described(&self) -> Value {
        let Shown { what, group, unit, decimals, words, volatile } = self.shown;
        let mut fields = json!({
            "name": self.name,
            "type": "Float",
            "shortDesc": what,
            "group": group,
            "category": "Companion",
            "decimalPlaces": decimals,
            "volatile": volatile,
            "rebootRequired": false,
        });
        if !unit.is_empty() {
            fields["units"] = unit.into();
        }
        if !words.is_empty() {
            let value = |(number, words)| json!({ "value": number, "description": words });
            fields["values"] = words.iter().enumerate().map(value).collect();
        }
        match &self.access {
            Access::ReadOnly(source) => {
                fields["readOnly"] = true.into();
                fields["longDesc"] = format!("Cannot be set: it is given by {source}.").into();
            }
            Access::Writable(writable) => {
                fields["readOnly"] = false.into();
                fields["longDesc"] = writable.does.into();
                fields["min"] = writable.range[0].into();
                fields["max"] = writable.range[1].into();
                fields["default"] = writable.default.into();
                fields["increment"] = writable.increment.into();
            }
        }
        fields
    }
}

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
            Access::Writable(Writable { range, .. }) if !(range[0]..=range[1]).contains(&value) => {
                Some(ParameterRefusal::OutOfRange { name, value, range: *range })
            }
            Access::Writable(writable) => {
                (writable.set)(self, value);
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
        let tolerance = self.ground_station.tolerance(self.settings.jitter.std_rad);
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

    #[test]
    fn spec_what_changes_by_itself_is_said_to_and_numbers_have_their_units() {
        let shown = TABLE.iter().map(|parameter| {
            let Shown { group, unit, decimals, words, volatile, .. } = parameter.shown;
            (parameter.name, group, unit, decimals, words.len(), volatile)
        });
        let expected = [
            ("VW_ROLE", "Mission", "", 0, 2, false),
            ("VW_PHASE", "Mission", "", 0, 12, true),
            ("VW_SLOT", "Mission", "", 0, 0, true),
            ("VW_SLOTS", "Mission", "", 0, 0, true),
            ("VW_PMAX_W", "Radio", "W", 3, 0, true),
            ("VW_LEASE_MS", "Radio", "ms", 0, 0, false),
            ("VW_JITTER_DEG", "Mission", "deg", 2, 0, false),
            ("VW_RATE_HZ", "Mission", "Hz", 1, 0, false),
            ("VW_KILLED", "Radio", "", 0, 2, true),
            ("VW_POS_TOL_M", "Pose", "m", 2, 0, false),
            ("VW_ATT_TOL_DEG", "Pose", "deg", 2, 0, false),
            ("VW_LIVE_HZ", "Display", "Hz", 1, 0, false),
        ];
        assert_eq!(shown.collect::<Vec<_>>(), expected);
        for ((.., unit, _, words, _), described) in expected.into_iter().zip(described()) {
            assert_eq!(described.get("units").is_some(), !unit.is_empty(), "{described}");
            assert_eq!(described.get("values").is_some(), words > 0, "{described}");
        }
    }

    #[test]
    fn spec_what_is_shown_of_a_parameter_is_whole() {
        for parameter in &TABLE {
            let Shown { what, group, words, .. } = parameter.shown;
            assert!(!what.is_empty() && !group.is_empty(), "{}", parameter.name);
            assert!(words.len() != 1, "{}: one value only", parameter.name);
            if let Access::Writable(writable) = &parameter.access {
                let [least, most] = writable.range;
                assert!((least..=most).contains(&writable.default), "{}", parameter.name);
                assert!(writable.increment > 0.0 && writable.does.ends_with('.'), "{}", parameter.name);
            }
        }
    }
}
