//! One parameter by MAVLink's two parameter protocols, in their three encodings: how it is asked for, set, and understood.
//!
//! The companion's own driver and the radio host's device both speak it. A parameter's type is learnt by reading it, and needed to
//! write it: what is written in another type is refused or misread. The two encodings of PARAM_SET look alike on the wire
//! and differ for integers: 4 is 4.0 by C cast, and 5.6e-45, whose bytes are those of the integer, bytewise. MAVLink's documents
//! have a component say which by MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST or _BYTEWISE in AUTOPILOT_VERSION.

use mavlink::dialects::ardupilotmega::{
    MavMessage, MavParamExtType, MavParamType, PARAM_EXT_REQUEST_READ_DATA, PARAM_EXT_SET_DATA,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, ParamAck,
};
use mavlink::types::CharArray;

use super::at_most;

/// Which messages carry the parameter, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Protocol {
    /// PARAM_EXT_SET.
    Extended,
    /// PARAM_SET, integers converted to float (C cast).
    Classic,
    /// PARAM_SET, integers by their bytes.
    Bytewise,
}

/// A parameter's type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Type {
    /// Of PARAM_EXT_VALUE.
    Extended(MavParamExtType),
    /// Of PARAM_VALUE.
    Classic(MavParamType),
}

/// What a component says of the parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// Its type.
    pub kind: Type,
    /// Its value; `None`: none that is a finite number.
    pub value: Option<f64>,
    /// What became of a setting, where the protocol says that.
    pub result: ParamAck,
}

impl Type {
    /// Whether it holds integers alone.
    #[must_use]
    pub fn is_whole(self) -> bool {
        match self {
            Self::Extended(kind) => !matches!(
                kind,
                MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32
                    | MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64
                    | MavParamExtType::MAV_PARAM_EXT_TYPE_CUSTOM
            ),
            Self::Classic(kind) => {
                !matches!(kind, MavParamType::MAV_PARAM_TYPE_REAL32 | MavParamType::MAV_PARAM_TYPE_REAL64)
            }
        }
    }
}

/// Asks for the parameter.
#[must_use]
pub fn read(protocol: Protocol, name: &str, (target_system, target_component): (u8, u8)) -> MavMessage {
    match protocol {
        Protocol::Extended => MavMessage::PARAM_EXT_REQUEST_READ(PARAM_EXT_REQUEST_READ_DATA {
            param_index: -1,
            target_system,
            target_component,
            param_id: name.into(),
        }),
        Protocol::Classic | Protocol::Bytewise => MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: -1,
            target_system,
            target_component,
            param_id: name.into(),
        }),
    }
}

/// Sets the parameter, which is of this type.
#[must_use]
pub fn set(
    protocol: Protocol,
    name: &str,
    (target_system, target_component): (u8, u8),
    kind: Type,
    value: f64,
) -> MavMessage {
    match kind {
        Type::Extended(param_type) => MavMessage::PARAM_EXT_SET(PARAM_EXT_SET_DATA {
            target_system,
            target_component,
            param_id: name.into(),
            param_value: encode(value, param_type).into(),
            param_type,
        }),
        Type::Classic(param_type) => MavMessage::PARAM_SET(PARAM_SET_DATA {
            param_value: match protocol {
                Protocol::Bytewise => bytewise(value, param_type),
                Protocol::Classic | Protocol::Extended => at_most(value),
            },
            target_system,
            target_component,
            param_id: name.into(),
            param_type,
        }),
    }
}

/// What `message` says of the parameter, if anything.
#[must_use]
pub fn said(protocol: Protocol, name: &str, message: &MavMessage) -> Option<Said> {
    let is_named = |id: &CharArray<16>| id.to_str() == Ok(name);
    let accepted = ParamAck::PARAM_ACK_ACCEPTED;
    match (message, protocol) {
        (MavMessage::PARAM_EXT_VALUE(m), Protocol::Extended) if is_named(&m.param_id) => Some(Said {
            kind: Type::Extended(m.param_type),
            value: decode(&m.param_value, m.param_type),
            result: accepted,
        }),
        (MavMessage::PARAM_EXT_ACK(m), Protocol::Extended) if is_named(&m.param_id) => Some(Said {
            kind: Type::Extended(m.param_type),
            value: decode(&m.param_value, m.param_type),
            result: m.param_result,
        }),
        (MavMessage::PARAM_VALUE(m), Protocol::Classic | Protocol::Bytewise) if is_named(&m.param_id) => {
            let value = match protocol {
                Protocol::Bytewise => of_bytes(m.param_value, m.param_type),
                Protocol::Classic | Protocol::Extended => Some(f64::from(m.param_value)),
            };
            Some(Said {
                kind: Type::Classic(m.param_type),
                value: value.filter(|value| value.is_finite()),
                result: accepted,
            })
        }
        _ => None,
    }
}

/// Equal but for single precision.
#[must_use]
pub fn same(a: f64, b: f64) -> bool {
    a == b || (a - b).abs() <= 1e-6 * a.abs().max(b.abs())
}

/// PARAM_EXT carries values as they lie in memory, little-endian.
fn encode(value: f64, kind: MavParamExtType) -> [u8; 128] {
    let mut wire = [0u8; 128];
    let bytes: Vec<u8> = match kind {
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32 => at_most(value).to_le_bytes().to_vec(),
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64 => value.to_le_bytes().to_vec(),
        _ => (value.round() as i64).to_le_bytes()[..width(kind)].to_vec(),
    };
    wire[..bytes.len()].copy_from_slice(&bytes);
    wire
}

fn decode(wire: &[u8; 128], kind: MavParamExtType) -> Option<f64> {
    let mut eight = [0u8; 8];
    eight.copy_from_slice(&wire[..8]);
    let [a, b, c, d, ..] = eight;
    let value = match kind {
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32 => f64::from(f32::from_le_bytes([a, b, c, d])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64 => f64::from_le_bytes(eight),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8 => f64::from(a),
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT8 => f64::from(i8::from_le_bytes([a])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT16 => f64::from(u16::from_le_bytes([a, b])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT16 => f64::from(i16::from_le_bytes([a, b])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT32 => f64::from(u32::from_le_bytes([a, b, c, d])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT32 => f64::from(i32::from_le_bytes([a, b, c, d])),
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT64 => u64::from_le_bytes(eight) as f64,
        MavParamExtType::MAV_PARAM_EXT_TYPE_INT64 => i64::from_le_bytes(eight) as f64,
        MavParamExtType::MAV_PARAM_EXT_TYPE_CUSTOM => return None,
    };
    value.is_finite().then_some(value)
}

/// Bytes of an integer type.
fn width(kind: MavParamExtType) -> usize {
    match kind {
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8 | MavParamExtType::MAV_PARAM_EXT_TYPE_INT8 => 1,
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT16 | MavParamExtType::MAV_PARAM_EXT_TYPE_INT16 => 2,
        MavParamExtType::MAV_PARAM_EXT_TYPE_UINT32 | MavParamExtType::MAV_PARAM_EXT_TYPE_INT32 => 4,
        _ => 8,
    }
}

/// The same type in PARAM_EXT; those of eight bytes do not fit into PARAM_VALUE.
fn extended(kind: MavParamType) -> Option<MavParamExtType> {
    match kind {
        MavParamType::MAV_PARAM_TYPE_UINT8 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_UINT8),
        MavParamType::MAV_PARAM_TYPE_INT8 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_INT8),
        MavParamType::MAV_PARAM_TYPE_UINT16 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_UINT16),
        MavParamType::MAV_PARAM_TYPE_INT16 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_INT16),
        MavParamType::MAV_PARAM_TYPE_UINT32 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_UINT32),
        MavParamType::MAV_PARAM_TYPE_INT32 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_INT32),
        MavParamType::MAV_PARAM_TYPE_REAL32 => Some(MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32),
        MavParamType::MAV_PARAM_TYPE_UINT64
        | MavParamType::MAV_PARAM_TYPE_INT64
        | MavParamType::MAV_PARAM_TYPE_REAL64 => None,
    }
}

/// The float whose bytes are the value's in its own type.
fn bytewise(value: f64, kind: MavParamType) -> f32 {
    let Some(kind) = extended(kind) else { return at_most(value) };
    let wire = encode(value, kind);
    f32::from_le_bytes([wire[0], wire[1], wire[2], wire[3]])
}

fn of_bytes(value: f32, kind: MavParamType) -> Option<f64> {
    let mut wire = [0u8; 128];
    wire[..4].copy_from_slice(&value.to_le_bytes());
    decode(&wire, extended(kind)?)
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::ardupilotmega::PARAM_VALUE_DATA;

    use super::*;

    #[test]
    fn val_what_is_set_in_either_encoding_is_what_the_other_side_s_arithmetic_makes_of_it() {
        for (kind, value, cast, bytes) in [
            (MavParamType::MAV_PARAM_TYPE_UINT8, 4.0, 4.0f32, 4u32),
            (MavParamType::MAV_PARAM_TYPE_INT8, -3.0, -3.0, 0xfd),
            (MavParamType::MAV_PARAM_TYPE_UINT16, 1000.0, 1000.0, 1000),
            (MavParamType::MAV_PARAM_TYPE_INT32, -2.0, -2.0, 0xffff_fffe),
            (MavParamType::MAV_PARAM_TYPE_REAL32, 20.5, 20.5, 20.5f32.to_bits()),
        ] {
            for (protocol, wire) in [(Protocol::Classic, cast.to_bits()), (Protocol::Bytewise, bytes)] {
                let MavMessage::PARAM_SET(sent) =
                    set(protocol, "TX_POWER", (51, 68), Type::Classic(kind), value)
                else {
                    panic!("not by PARAM_SET")
                };
                assert_eq!(sent.param_value.to_bits(), wire, "{protocol:?} {kind:?}");
                let answer = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
                    param_value: sent.param_value,
                    param_id: "TX_POWER".into(),
                    param_type: kind,
                    ..PARAM_VALUE_DATA::DEFAULT
                });
                let heard = said(protocol, "TX_POWER", &answer).unwrap();
                assert_eq!((heard.kind, heard.value), (Type::Classic(kind), Some(value)), "{protocol:?}");
                assert_eq!(said(protocol, "TX_POWE", &answer), None);
                assert_eq!(said(Protocol::Extended, "TX_POWER", &answer), None);
            }
        }
    }

    #[test]
    fn spec_a_type_that_does_not_fit_into_four_bytes_says_no_value_bytewise() {
        let answer = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: 1.0,
            param_id: "TX_POWER".into(),
            param_type: MavParamType::MAV_PARAM_TYPE_INT64,
            ..PARAM_VALUE_DATA::DEFAULT
        });
        assert_eq!(said(Protocol::Bytewise, "TX_POWER", &answer).unwrap().value, None);
    }

    #[test]
    fn val_an_extended_value_lies_in_as_many_bytes_as_its_type_has() {
        use mavlink::dialects::ardupilotmega::{PARAM_EXT_ACK_DATA, PARAM_EXT_VALUE_DATA};
        for (kind, value, bytes, whole) in [
            (MavParamExtType::MAV_PARAM_EXT_TYPE_INT8, -3.0, vec![0xfd], true),
            (MavParamExtType::MAV_PARAM_EXT_TYPE_INT16, -3.0, vec![0xfd, 0xff], true),
            (MavParamExtType::MAV_PARAM_EXT_TYPE_INT32, -3.0, vec![0xfd, 0xff, 0xff, 0xff], true),
            (MavParamExtType::MAV_PARAM_EXT_TYPE_UINT64, 258.0, vec![2, 1], true),
            (MavParamExtType::MAV_PARAM_EXT_TYPE_REAL32, 20.5, 20.5f32.to_le_bytes().to_vec(), false),
            (MavParamExtType::MAV_PARAM_EXT_TYPE_REAL64, 0.1, 0.1f64.to_le_bytes().to_vec(), false),
        ] {
            assert_eq!(Type::Extended(kind).is_whole(), whole);
            let sent = set(Protocol::Extended, "TX_POWER", (51, 68), Type::Extended(kind), value);
            let MavMessage::PARAM_EXT_SET(sent) = sent else { panic!("not by PARAM_EXT_SET") };
            let (head, tail) = sent.param_value.split_at(bytes.len());
            assert!(head == bytes && tail.iter().all(|&byte| byte == 0), "{kind:?}: {head:?}");
            let stated = MavMessage::PARAM_EXT_VALUE(PARAM_EXT_VALUE_DATA {
                param_value: sent.param_value,
                param_id: "TX_POWER".into(),
                param_type: kind,
                ..PARAM_EXT_VALUE_DATA::DEFAULT
            });
            let answered = MavMessage::PARAM_EXT_ACK(PARAM_EXT_ACK_DATA {
                param_value: sent.param_value,
                param_id: "TX_POWER".into(),
                param_type: kind,
                ..PARAM_EXT_ACK_DATA::DEFAULT
            });
            for message in [stated, answered] {
                let heard = said(Protocol::Extended, "TX_POWER", &message).unwrap();
                assert_eq!((heard.kind, heard.value), (Type::Extended(kind), Some(value)));
                assert_eq!(said(Protocol::Extended, "TX_POWE", &message), None);
            }
        }
        assert!(!Type::Classic(MavParamType::MAV_PARAM_TYPE_REAL32).is_whole());
        assert!(Type::Classic(MavParamType::MAV_PARAM_TYPE_INT32).is_whole());
    }

    #[test]
    fn spec_a_parameter_is_asked_for_by_its_name_and_not_by_an_index() {
        let indices =
            [Protocol::Classic, Protocol::Bytewise, Protocol::Extended].map(|protocol| {
                match read(protocol, "TX_POWER", (51, 68)) {
                    MavMessage::PARAM_REQUEST_READ(asked) => asked.param_index,
                    MavMessage::PARAM_EXT_REQUEST_READ(asked) => asked.param_index,
                    other => panic!("{other:?}"),
                }
            });
        assert_eq!(indices, [-1; 3]);
    }

    #[test]
    fn val_values_are_the_same_up_to_a_millionth() {
        assert!(same(0.0, 0.0) && same(1.0, 1.0 + 0.9e-6) && same(-1e6, -1e6 - 0.9));
        assert!(!same(1.0, 1.0 + 1.1e-6) && !same(0.01, 0.010_001) && !same(1.0, -1.0));
    }
}
