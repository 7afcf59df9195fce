//! Onboard parameters and their encodings in the float of PARAM_VALUE and PARAM_SET.

use std::borrow::Cow;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavParamType, PARAM_SET_DATA, PARAM_VALUE_DATA};

use super::config::Firmware;
use super::geometry::Geometry;

/// How an integer rides in the message's float.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// Its bits (PX4).
    Bytewise,
    /// Its value (ArduPilot and most radios).
    Cast,
}

/// A parameter's value and type.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Value {
    Int(i32),
    Real(f32),
}

/// What became of a PARAM_SET.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SetOutcome {
    /// Taken: echo this index.
    Stored(usize),
    /// No such parameter.
    Unknown,
    /// The wrong type, or not a number.
    Refused(usize),
}

/// A table in the order of its names, which is the protocol's order of indices.
#[derive(Debug, Clone)]
pub(crate) struct Parameters {
    encoding: Encoding,
    table: Vec<(Cow<'static, str>, Value)>,
    /// Counts the writes: who keeps values of its own knows when they are old.
    pub revision: u32,
}

impl Parameters {
    pub fn new(encoding: Encoding, table: &[(&'static str, Value)]) -> Self {
        let mut table: Vec<_> = table.iter().map(|(name, value)| (Cow::Borrowed(*name), *value)).collect();
        table.sort_by(|a, b| a.0.cmp(&b.0));
        Self { encoding, table, revision: 0 }
    }

    /// What an autopilot of this firmware has.
    pub fn of_firmware(firmware: Firmware) -> Self {
        match firmware {
            Firmware::Px4 => Self::new(Encoding::Bytewise, PX4),
            Firmware::ArduCopter => Self::new(Encoding::Cast, ARDUCOPTER),
        }
    }

    /// Adds the rotors as PX4 describes them (CA_ROTOR*): body FRD axes, thrust at full throttle, moment ratio.
    pub fn describe_rotors(&mut self, geometry: &Geometry) {
        let mut rows = vec![("CA_ROTOR_COUNT".into(), Value::Int(geometry.rotors.len() as i32))];
        for (k, rotor) in geometry.rotors.iter().enumerate() {
            let ([px, py, pz], [ax, ay, az]) = (rotor.position_flu_m, rotor.axis_flu);
            let fields = [("PX", px), ("PY", -py), ("PZ", -pz), ("AX", ax), ("AY", -ay), ("AZ", -az)];
            for (field, value) in fields.into_iter().chain([("CT", rotor.thrust_n), ("KM", rotor.moment_m)]) {
                rows.push((format!("CA_ROTOR{k}_{field}").into(), Value::Real(value as f32)));
            }
        }
        self.add(rows);
    }

    /// Adds what only PX4 in simulation has: how long its battery lasts, in seconds, and where it stops, in percent.
    pub fn describe_simulated_battery(&mut self) {
        let rows = [("SIM_BAT_DRAIN", 60.0), ("SIM_BAT_MIN_PCT", 50.0)];
        self.add(rows.map(|(name, value)| (name.into(), Value::Real(value))));
    }

    fn add(&mut self, rows: impl IntoIterator<Item = (Cow<'static, str>, Value)>) {
        self.table.extend(rows);
        self.table.sort_by(|a, b| a.0.cmp(&b.0));
        self.revision += 1;
    }

    pub fn len(&self) -> usize {
        self.table.len()
    }

    pub fn index_of(&self, name: &str) -> Option<usize> {
        self.table.binary_search_by(|(n, _)| n.as_ref().cmp(name)).ok()
    }

    /// A parameter as a number; 0 where the table has none.
    pub fn real(&self, name: &str) -> f32 {
        match self.index_of(name).map(|k| self.table[k].1) {
            Some(Value::Real(v)) => v,
            Some(Value::Int(v)) => v as f32,
            None => 0.0,
        }
    }

    /// A parameter in seconds as a duration; what makes none is 0.
    pub fn seconds(&self, name: &str) -> Duration {
        Duration::try_from_secs_f32(self.real(name)).unwrap_or_default()
    }

    /// Sets a parameter that exists, keeping its type.
    pub fn set(&mut self, name: &str, value: Value) {
        if let Some(k) = self.index_of(name) {
            self.revision += 1;
            self.table[k].1 = value;
        }
    }

    /// The PARAM_VALUE of an index.
    pub fn message(&self, index: usize) -> Option<PARAM_VALUE_DATA> {
        let (name, value) = self.table.get(index)?;
        let (param_value, param_type) = match (*value, self.encoding) {
            (Value::Real(v), _) => (v, MavParamType::MAV_PARAM_TYPE_REAL32),
            (Value::Int(v), Encoding::Bytewise) => {
                (f32::from_bits(v.cast_unsigned()), MavParamType::MAV_PARAM_TYPE_INT32)
            }
            (Value::Int(v), Encoding::Cast) => (v as f32, MavParamType::MAV_PARAM_TYPE_INT32),
        };
        Some(PARAM_VALUE_DATA {
            param_value,
            param_count: self.table.len() as u16,
            param_index: index as u16,
            param_id: name.as_ref().into(),
            param_type,
        })
    }

    /// Carries out a PARAM_SET.
    pub fn handle_set(&mut self, set: &PARAM_SET_DATA) -> SetOutcome {
        let Some(index) = set.param_id.to_str().ok().and_then(|name| self.index_of(name)) else {
            return SetOutcome::Unknown;
        };
        let value = match (self.table[index].1, self.encoding) {
            (Value::Int(_), Encoding::Bytewise) => {
                if set.param_type != MavParamType::MAV_PARAM_TYPE_INT32 {
                    return SetOutcome::Refused(index);
                }
                Value::Int(set.param_value.to_bits().cast_signed())
            }
            (Value::Real(_), Encoding::Bytewise) if set.param_type != MavParamType::MAV_PARAM_TYPE_REAL32 => {
                return SetOutcome::Refused(index);
            }
            _ if !set.param_value.is_finite() => return SetOutcome::Refused(index),
            (Value::Int(_), Encoding::Cast) => Value::Int(set.param_value.round() as i32),
            (Value::Real(_), _) => Value::Real(set.param_value),
        };
        self.table[index].1 = value;
        self.revision += 1;
        SetOutcome::Stored(index)
    }
}

/// PX4's, with the defaults of a vehicle prepared for companion flight where the stock ones would end it
/// (COM_OBL_RC_ACT, FD_FAIL_R/P) or make a lost rotor fatal (CA_FAILURE_MODE), and that returns at its fence (GF_ACTION).
const PX4: &[(&str, Value)] = &[
    ("BAT_CRIT_THR", Value::Real(0.07)),
    ("BAT_EMERGEN_THR", Value::Real(0.05)),
    ("BAT_LOW_THR", Value::Real(0.15)),
    ("CA_AIRFRAME", Value::Int(0)),
    ("CA_FAILURE_MODE", Value::Int(1)),
    ("COM_ARM_WO_GPS", Value::Int(1)),
    ("COM_DISARM_LAND", Value::Real(2.0)),
    ("COM_DISARM_PRFLT", Value::Real(10.0)),
    ("COM_DL_LOSS_T", Value::Int(10)),
    ("COM_LOW_BAT_ACT", Value::Int(3)),
    ("COM_OBL_RC_ACT", Value::Int(5)),
    ("COM_OF_LOSS_T", Value::Real(1.0)),
    ("COM_RC_IN_MODE", Value::Int(4)),
    ("COM_RC_OVERRIDE", Value::Int(1)),
    ("FD_FAIL_P", Value::Int(0)),
    ("FD_FAIL_R", Value::Int(0)),
    ("GF_ACTION", Value::Int(3)),
    ("GF_MAX_HOR_DIST", Value::Real(0.0)),
    ("GF_MAX_VER_DIST", Value::Real(0.0)),
    ("LNDMC_ROT_MAX", Value::Real(20.0)),
    ("LNDMC_TRIG_TIME", Value::Real(1.0)),
    ("LNDMC_XY_VEL_MAX", Value::Real(1.5)),
    ("LNDMC_Z_VEL_MAX", Value::Real(0.25)),
    ("MAV_COMP_ID", Value::Int(1)),
    ("MAV_SYS_ID", Value::Int(1)),
    ("MAV_TYPE", Value::Int(14)),
    ("MIS_TAKEOFF_ALT", Value::Real(2.5)),
    ("MPC_LAND_SPEED", Value::Real(0.7)),
    ("MPC_MANTHR_MIN", Value::Real(0.08)),
    ("MPC_XY_VEL_MAX", Value::Real(12.0)),
    ("MPC_Z_VEL_MAX_DN", Value::Real(6.0)),
    ("MPC_Z_VEL_MAX_UP", Value::Real(6.0)),
    ("NAV_DLL_ACT", Value::Int(0)),
    ("NAV_RCL_ACT", Value::Int(2)),
    ("RTL_CONE_ANG", Value::Int(0)),
    ("RTL_RETURN_ALT", Value::Real(30.0)),
    ("SYS_AUTOSTART", Value::Int(4001)),
    ("THR_MDL_FAC", Value::Real(1.0)),
];

/// ArduCopter's; lengths and speeds in centimetres, as it has them. Its fence is switched on, without the circle about home.
const ARDUCOPTER: &[(&str, Value)] = &[
    ("ARMING_CHECK", Value::Int(1)),
    ("BATT_CAPACITY", Value::Int(3300)),
    ("BATT_CRT_MAH", Value::Int(330)),
    ("BATT_FS_CRT_ACT", Value::Int(1)),
    ("BATT_FS_LOW_ACT", Value::Int(2)),
    ("BATT_LOW_MAH", Value::Int(660)),
    ("DISARM_DELAY", Value::Int(10)),
    ("FENCE_ACTION", Value::Int(1)),
    ("FENCE_ALT_MAX", Value::Real(100.0)),
    ("FENCE_ENABLE", Value::Int(1)),
    ("FENCE_MARGIN", Value::Real(2.0)),
    ("FENCE_RADIUS", Value::Real(300.0)),
    ("FENCE_TYPE", Value::Int(5)),
    ("FRAME_CLASS", Value::Int(3)),
    ("FRAME_TYPE", Value::Int(1)),
    ("FS_GCS_ENABLE", Value::Int(0)),
    ("FS_GCS_TIMEOUT", Value::Real(5.0)),
    ("FS_THR_ENABLE", Value::Int(0)),
    ("GUID_OPTIONS", Value::Int(0)),
    ("GUID_TIMEOUT", Value::Real(3.0)),
    ("LAND_SPEED", Value::Int(70)),
    ("PSC_JERK_XY", Value::Real(5.0)),
    ("PSC_JERK_Z", Value::Real(5.0)),
    ("RTL_ALT", Value::Int(3000)),
    ("RTL_CONE_SLOPE", Value::Real(0.0)),
    ("SCR_ENABLE", Value::Int(1)),
    ("SCR_VM_I_COUNT", Value::Int(10_000)),
    ("SYSID_THISMAV", Value::Int(1)),
    ("WPNAV_ACCEL", Value::Real(250.0)),
    ("WPNAV_ACCEL_Z", Value::Real(100.0)),
    ("WPNAV_SPEED", Value::Int(1200)),
    ("WPNAV_SPEED_DN", Value::Int(600)),
    ("WPNAV_SPEED_UP", Value::Int(600)),
];

#[cfg(test)]
mod tests {
    use super::*;

    fn set(name: &str, param_value: f32, param_type: MavParamType) -> PARAM_SET_DATA {
        PARAM_SET_DATA { param_value, param_id: name.into(), param_type, ..PARAM_SET_DATA::DEFAULT }
    }

    #[test]
    fn spec_px4_integers_ride_as_their_bits() {
        let mut p = Parameters::of_firmware(Firmware::Px4);
        let index = p.index_of("MAV_TYPE").unwrap();
        assert_eq!(p.message(index).unwrap().param_value.to_bits(), 14);
        let int = MavParamType::MAV_PARAM_TYPE_INT32;
        assert_eq!(p.handle_set(&set("MAV_TYPE", f32::from_bits(2), int)), SetOutcome::Stored(index));
        assert_eq!(p.real("MAV_TYPE"), 2.0);
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        assert_eq!(p.handle_set(&set("MAV_TYPE", 3.0, real)), SetOutcome::Refused(index));
        assert_eq!(p.handle_set(&set("NO_SUCH", 3.0, real)), SetOutcome::Unknown);
        // Minus one has the bits of a NaN, and is still a number.
        assert_eq!(p.handle_set(&set("MAV_TYPE", f32::from_bits(u32::MAX), int)), SetOutcome::Stored(index));
        assert_eq!(p.real("MAV_TYPE"), -1.0);
    }

    #[test]
    fn spec_arducopter_integers_are_cast() {
        let mut p = Parameters::of_firmware(Firmware::ArduCopter);
        let index = p.index_of("RTL_ALT").unwrap();
        assert_eq!(p.message(index).unwrap().param_value, 3000.0);
        let any = MavParamType::MAV_PARAM_TYPE_REAL32;
        assert_eq!(p.handle_set(&set("RTL_ALT", 1500.0, any)), SetOutcome::Stored(index));
        assert_eq!(p.handle_set(&set("RTL_ALT", f32::NAN, any)), SetOutcome::Refused(index));
        assert_eq!(p.real("RTL_ALT"), 1500.0);
    }

    #[test]
    fn prop_names_fit_and_tables_are_sorted() {
        for table in [PX4, ARDUCOPTER] {
            assert!(table.iter().all(|(n, _)| n.len() <= 16));
            assert!(table.windows(2).all(|w| w[0].0 < w[1].0));
        }
    }
}
