//! The declaration by the parameter protocol: read only, all of it REAL32.

use mavlink::dialects::ardupilotmega::{MavMessage, MavParamType, PARAM_VALUE_DATA};
use mavlink::types::CharArray;

use super::facts::Facts;

/// What is answered to a message of the parameter protocol that is addressed to us; nothing to any other. Setting changes
/// nothing, and is answered with the value.
pub(super) fn answers(facts: &Facts, message: &MavMessage) -> Vec<MavMessage> {
    match message {
        MavMessage::PARAM_REQUEST_LIST(_) => {
            (0..facts.parameters().len()).map(|index| value(facts, index)).collect()
        }
        MavMessage::PARAM_REQUEST_READ(m) => {
            let index = usize::try_from(m.param_index).ok().or_else(|| named(facts, &m.param_id));
            index
                .filter(|index| *index < facts.parameters().len())
                .map(|index| value(facts, index))
                .into_iter()
                .collect()
        }
        MavMessage::PARAM_SET(m) => {
            named(facts, &m.param_id).map(|index| value(facts, index)).into_iter().collect()
        }
        _ => Vec::new(),
    }
}

fn named(facts: &Facts, id: &CharArray<16>) -> Option<usize> {
    let name = id.to_str().ok()?;
    facts.parameters().iter().position(|(known, _)| *known == name)
}

fn value(facts: &Facts, index: usize) -> MavMessage {
    let parameters = facts.parameters();
    let (name, value) = parameters[index];
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_value: value as f32,
        param_count: u16::try_from(parameters.len()).unwrap_or(u16::MAX),
        param_index: u16::try_from(index).unwrap_or(u16::MAX),
        param_id: name.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}
