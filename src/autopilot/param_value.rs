//! A parameter's value, and how it travels in MAVLink's only field for it, a float.

use mavlink::dialects::ardupilotmega::MavParamType;

/// A parameter's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParamValue {
    /// Of one of the integer types.
    Int(i64),
    /// Of one of the floating-point types.
    Real(f64),
}

impl ParamValue {
    /// The value as a number.
    #[must_use]
    pub fn as_f64(self) -> f64 {
        match self {
            Self::Int(value) => value as f64,
            Self::Real(value) => value,
        }
    }
}

/// How integers travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum IntegerForm {
    /// Bytewise in the float field.
    Bytes,
    /// Converted to a float.
    Number,
}

impl IntegerForm {
    /// The value in a PARAM_VALUE; `None` if it is not finite.
    pub(super) fn decode(self, raw: f32, kind: MavParamType) -> Option<ParamValue> {
        let bytes = raw.to_le_bytes();
        if is_real(kind) {
            return raw.is_finite().then_some(ParamValue::Real(f64::from(raw)));
        }
        if self == Self::Number {
            return raw.is_finite().then_some(ParamValue::Int(raw.round() as i64));
        }
        Some(ParamValue::Int(match kind {
            MavParamType::MAV_PARAM_TYPE_UINT8 => i64::from(bytes[0]),
            MavParamType::MAV_PARAM_TYPE_INT8 => i64::from(i8::from_le_bytes([bytes[0]])),
            MavParamType::MAV_PARAM_TYPE_UINT16 => i64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
            MavParamType::MAV_PARAM_TYPE_INT16 => i64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
            MavParamType::MAV_PARAM_TYPE_UINT32 => i64::from(u32::from_le_bytes(bytes)),
            _ => i64::from(i32::from_le_bytes(bytes)),
        }))
    }

    /// The value as PARAM_SET carries it.
    pub(super) fn encode(self, value: f64, kind: MavParamType) -> f32 {
        if is_real(kind) || self == Self::Number {
            return value as f32;
        }
        // Two's complement, little-endian: the low bytes are right for every narrower type too.
        f32::from_le_bytes((value.round() as i64 as u32).to_le_bytes())
    }
}

fn is_real(kind: MavParamType) -> bool {
    matches!(kind, MavParamType::MAV_PARAM_TYPE_REAL32 | MavParamType::MAV_PARAM_TYPE_REAL64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use IntegerForm::{Bytes, Number};

    #[test]
    fn val_integers_travel_bytewise_or_converted() {
        let kind = MavParamType::MAV_PARAM_TYPE_INT32;
        for raw in [5, -1, 1_234_567, i32::MIN] {
            let wire = f32::from_le_bytes(raw.to_le_bytes());
            assert_eq!(Bytes.decode(wire, kind), Some(ParamValue::Int(i64::from(raw))));
            assert_eq!(Bytes.encode(f64::from(raw), kind).to_le_bytes(), raw.to_le_bytes());
        }
        let kind = MavParamType::MAV_PARAM_TYPE_INT8;
        assert_eq!(Number.decode(16.0, kind), Some(ParamValue::Int(16)));
        assert_eq!(Number.encode(16.0, kind), 16.0);
        assert_eq!(Bytes.decode(f32::NAN, MavParamType::MAV_PARAM_TYPE_REAL32), None);
    }
}
