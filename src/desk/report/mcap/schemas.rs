//! The types of the messages. Those of `foxglove` are as its programs publish them, with every field that is not optional
//! (a fix's heading and velocity are), whether it is written or not, since a reader may ask for any of them; those of
//! `veilwing` are ours.

use super::protobuf::Kind::{
    Bool, Bytes, Double, Enum, Fixed32, Int32, Int64, Many, ManyDoubles, ManyFixed32, Of, Text,
};
use super::protobuf::{Enumeration, Field, Type};

macro_rules! types {
    ($($name:ident = $full:literal { $($number:literal $field:tt : $kind:expr),* $(,)? } $([$($enum:expr),*])?)*) => {
        $(
            pub(super) static $name: Type = {
                static FIELDS: &[Field] = &[$(($number, stringify!($field), $kind)),*];
                static ENUMS: &[Enumeration] = &[$($($enum),*)?];
                Type { name: $full, fields: FIELDS, enums: ENUMS }
            };
        )*
    };
}

types! {
    TIMESTAMP = "google.protobuf.Timestamp" { 1 seconds: Int64, 2 nanos: Int32 }
    DURATION = "google.protobuf.Duration" { 1 seconds: Int64, 2 nanos: Int32 }

    VECTOR3 = "foxglove.Vector3" { 1 x: Double, 2 y: Double, 3 z: Double }
    POINT3 = "foxglove.Point3" { 1 x: Double, 2 y: Double, 3 z: Double }
    QUATERNION = "foxglove.Quaternion" { 1 x: Double, 2 y: Double, 3 z: Double, 4 w: Double }
    COLOR = "foxglove.Color" { 1 r: Double, 2 g: Double, 3 b: Double, 4 a: Double }
    KEY_VALUE = "foxglove.KeyValuePair" { 1 key: Text, 2 value: Text }
    POSE = "foxglove.Pose" { 1 position: Of(&VECTOR3), 2 orientation: Of(&QUATERNION) }
    POSE_IN_FRAME = "foxglove.PoseInFrame" { 1 timestamp: Of(&TIMESTAMP), 2 frame_id: Text, 3 pose: Of(&POSE) }
    FRAME_TRANSFORM = "foxglove.FrameTransform" {
        1 timestamp: Of(&TIMESTAMP), 2 parent_frame_id: Text, 3 child_frame_id: Text, 4 translation: Of(&VECTOR3),
        5 rotation: Of(&QUATERNION),
    }
    FRAME_TRANSFORMS = "foxglove.FrameTransforms" { 1 transforms: Many(&FRAME_TRANSFORM) }
    LOCATION_FIX = "foxglove.LocationFix" {
        6 timestamp: Of(&TIMESTAMP), 7 frame_id: Text, 1 latitude: Double, 2 longitude: Double, 3 altitude: Double,
        4 position_covariance: ManyDoubles, 5 position_covariance_type: Enum("PositionCovarianceType"),
        8 color: Of(&COLOR), 9 metadata: Many(&KEY_VALUE),
    } [("PositionCovarianceType", &["UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"])]
    LOG = "foxglove.Log" {
        1 timestamp: Of(&TIMESTAMP), 2 level: Enum("Level"), 3 message: Text, 4 name: Text, 5 file: Text, 6 line: Fixed32,
    } [("Level", &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"])]

    ARROW = "foxglove.ArrowPrimitive" {
        1 pose: Of(&POSE), 2 shaft_length: Double, 3 shaft_diameter: Double, 4 head_length: Double,
        5 head_diameter: Double, 6 color: Of(&COLOR),
    }
    CUBE = "foxglove.CubePrimitive" { 1 pose: Of(&POSE), 2 size: Of(&VECTOR3), 3 color: Of(&COLOR) }
    SPHERE = "foxglove.SpherePrimitive" { 1 pose: Of(&POSE), 2 size: Of(&VECTOR3), 3 color: Of(&COLOR) }
    CYLINDER = "foxglove.CylinderPrimitive" {
        1 pose: Of(&POSE), 2 size: Of(&VECTOR3), 3 bottom_scale: Double, 4 top_scale: Double, 5 color: Of(&COLOR),
    }
    LINE = "foxglove.LinePrimitive" {
        1 type: Enum("Type"), 2 pose: Of(&POSE), 3 thickness: Double, 4 scale_invariant: Bool,
        5 points: Many(&POINT3), 6 color: Of(&COLOR), 7 colors: Many(&COLOR), 8 indices: ManyFixed32,
    } [("Type", &["LINE_STRIP", "LINE_LOOP", "LINE_LIST"])]
    TRIANGLES = "foxglove.TriangleListPrimitive" {
        1 pose: Of(&POSE), 2 points: Many(&POINT3), 3 color: Of(&COLOR), 4 colors: Many(&COLOR), 5 indices: ManyFixed32,
    }
    LETTERING = "foxglove.TextPrimitive" {
        1 pose: Of(&POSE), 2 billboard: Bool, 3 font_size: Double, 4 scale_invariant: Bool, 5 color: Of(&COLOR), 6 text: Text,
    }
    MODEL = "foxglove.ModelPrimitive" {
        1 pose: Of(&POSE), 2 scale: Of(&VECTOR3), 3 color: Of(&COLOR), 4 override_color: Bool, 5 url: Text,
        6 media_type: Text, 7 data: Bytes,
    }
    SCENE_ENTITY = "foxglove.SceneEntity" {
        1 timestamp: Of(&TIMESTAMP), 2 frame_id: Text, 3 id: Text, 4 lifetime: Of(&DURATION), 5 frame_locked: Bool,
        6 metadata: Many(&KEY_VALUE), 7 arrows: Many(&ARROW), 8 cubes: Many(&CUBE), 9 spheres: Many(&SPHERE),
        10 cylinders: Many(&CYLINDER), 11 lines: Many(&LINE), 12 triangles: Many(&TRIANGLES), 13 texts: Many(&LETTERING),
        14 models: Many(&MODEL),
    }
    SCENE_ENTITY_DELETION = "foxglove.SceneEntityDeletion" {
        1 timestamp: Of(&TIMESTAMP), 2 type: Enum("Type"), 3 id: Text,
    } [("Type", &["MATCHING_ID", "ALL"])]
    SCENE_UPDATE = "foxglove.SceneUpdate" { 1 deletions: Many(&SCENE_ENTITY_DELETION), 2 entities: Many(&SCENE_ENTITY) }

    ANTENNA = "veilwing.Antenna" {
        1 timestamp: Of(&TIMESTAMP), 2 position_enu_m: Of(&VECTOR3), 3 axis_enu: Of(&VECTOR3), 4 roll_deg: Double,
        5 pitch_deg: Double, 6 yaw_deg: Double,
    }
    STATE = "veilwing.State" {
        1 timestamp: Of(&TIMESTAMP), 2 phase: Text, 3 mode: Text, 4 armed: Bool, 5 landed: Bool, 6 battery_percent: Double,
    }
    POWER = "veilwing.Power" { 1 timestamp: Of(&TIMESTAMP), 2 on: Bool, 3 tx_power_w: Double, 4 slot: Int32 }
    HEARD = "veilwing.HeardByEavesdropper" { 1 name: Text, 2 sinr_linear: Double }
    SINR = "veilwing.Sinr" {
        1 timestamp: Of(&TIMESTAMP), 2 on: Bool, 3 user: Text, 4 user_sinr_linear: Double, 5 eavesdroppers: Many(&HEARD),
        6 strongest_eavesdropper_sinr_linear: Double,
    }
    SECRECY = "veilwing.SecrecyRate" {
        1 timestamp: Of(&TIMESTAMP), 2 on: Bool, 3 slot: Int32, 4 user: Text, 5 secrecy_rate_bps: Double,
    }
    LEASE = "veilwing.Lease" {
        1 timestamp: Of(&TIMESTAMP), 2 what: Enum("What"), 3 slot: Int32, 4 duration_ms: Int32, 5 left_s: Double,
    } [("What", &["ASKED", "GRANTED", "GIVEN_UP"])]
}
