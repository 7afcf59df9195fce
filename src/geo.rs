//! Frames and attitudes: the only place where a frame changes.
//!
//! - *Mission frame*: ENU (east, north, up), metres, about the mission origin on the WGS 84 ellipsoid.
//! - *Autopilot frame*: NED about the autopilot's own origin (GPS_GLOBAL_ORIGIN); body axes FRD.
//! - *Attitude in the paper's convention*: Euler angles (roll, pitch, yaw) of a body whose axes at rest are the
//!   mission frame's, `R = Rz(yaw) Ry(pitch) Rx(roll)`, body to world, z up (FLU). The antenna lies along body z.
//!   At yaw 0 body x points east: a heading of 90 deg in NED.

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::radio::pattern;

/// A position in the mission frame, or a difference of two.
pub type Enu = Vector3<f64>;
/// A position or velocity in a north-east-down frame.
pub type Ned = Vector3<f64>;

/// A point on or above the WGS 84 ellipsoid.
///
/// Altitudes are used as differences only, so above mean sea level serves as well as above the ellipsoid as long
/// as both ends of a difference use the same (the geoid is flat over a mission's area).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Latitude in degrees, north positive.
    pub lat_deg: f64,
    /// Longitude in degrees, east positive.
    pub lon_deg: f64,
    /// Altitude in metres.
    pub alt_m: f64,
}

impl Geodetic {
    /// This point in the ENU frame about `origin`.
    #[must_use]
    pub fn to_enu(self, origin: Self) -> Enu {
        let (e, n, u) = map_3d::geodetic2enu(
            self.lat_deg.to_radians(),
            self.lon_deg.to_radians(),
            self.alt_m,
            origin.lat_deg.to_radians(),
            origin.lon_deg.to_radians(),
            origin.alt_m,
            map_3d::Ellipsoid::WGS84,
        );
        Enu::new(e, n, u)
    }

    /// The point at `position` in the ENU frame about `origin`.
    #[must_use]
    pub fn from_enu(position: Enu, origin: Self) -> Self {
        let (lat, lon, alt_m) = map_3d::enu2geodetic(
            position.x,
            position.y,
            position.z,
            origin.lat_deg.to_radians(),
            origin.lon_deg.to_radians(),
            origin.alt_m,
            map_3d::Ellipsoid::WGS84,
        );
        Self { lat_deg: lat.to_degrees(), lon_deg: lon.to_degrees(), alt_m }
    }
}

/// Swaps a vector between ENU and NED axes (the same map both ways).
#[must_use]
pub fn swap_enu_ned(v: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.y, v.x, -v.z)
}

/// An autopilot's local NED frame seen from the mission frame.
///
/// The two tangent planes differ by a translation and, over a kilometre, by 1e-4 rad: positions go through
/// geodetic coordinates, vectors and attitudes are passed unrotated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    /// The mission's origin.
    pub mission: Geodetic,
    /// The autopilot's own origin.
    pub autopilot: Geodetic,
}

impl LocalFrame {
    /// A local NED position in the mission frame.
    #[must_use]
    pub fn position_to_enu(&self, local: Ned) -> Enu {
        Geodetic::from_enu(swap_enu_ned(local), self.autopilot).to_enu(self.mission)
    }

    /// A mission-frame position in the autopilot's local NED frame.
    #[must_use]
    pub fn position_to_ned(&self, position: Enu) -> Ned {
        swap_enu_ned(Geodetic::from_enu(position, self.mission).to_enu(self.autopilot))
    }
}

/// An attitude, stored as the rotation from body FLU axes to the mission frame's ENU axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude(UnitQuaternion<f64>);

impl Attitude {
    /// Level, body x to the east.
    pub const fn level() -> Self {
        Self(UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(1.0, 0.0, 0.0, 0.0)))
    }

    /// From the paper's Euler angles: `Rz(yaw) Ry(pitch) Rx(roll)`.
    #[must_use]
    pub fn from_euler(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Self {
        Self(UnitQuaternion::from_euler_angles(roll_rad, pitch_rad, yaw_rad))
    }

    /// The paper's Euler angles (roll, pitch, yaw) in radians.
    #[must_use]
    pub fn euler(&self) -> (f64, f64, f64) {
        self.0.euler_angles()
    }

    /// The quaternion MAVLink carries: body FRD to NED, (w, x, y, z), w >= 0.
    #[must_use]
    pub fn to_mavlink(&self) -> [f64; 4] {
        let q = Self::enu_ned() * self.0 * Self::flu_frd();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        [sign * q.w, sign * q.i, sign * q.j, sign * q.k]
    }

    /// From the quaternion MAVLink carries. `None` if it is not a rotation (zero, not finite).
    #[must_use]
    pub fn from_mavlink(wxyz: [f64; 4]) -> Option<Self> {
        let [w, x, y, z] = wxyz;
        let q = UnitQuaternion::try_new(nalgebra::Quaternion::new(w, x, y, z), 1e-3)?;
        q.coords.iter().all(|c| c.is_finite()).then(|| Self(Self::enu_ned() * q * Self::flu_frd()))
    }

    /// The antenna axis, body z in the mission frame; Y and -Y are the same antenna.
    #[must_use]
    pub fn antenna_axis(&self) -> Vector3<f64> {
        self.0 * Vector3::z()
    }

    /// Angle between body z and the vertical, in [0, pi].
    #[must_use]
    pub fn tilt_rad(&self) -> f64 {
        self.antenna_axis().z.clamp(-1.0, 1.0).acos()
    }

    /// Angle of the rotation from `self` to `other`, in [0, pi].
    #[must_use]
    pub fn angle_to(&self, other: &Self) -> f64 {
        self.0.angle_to(&other.0)
    }

    /// Body FLU to ENU.
    #[must_use]
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        self.0
    }

    /// From a rotation, body FLU to ENU.
    #[must_use]
    pub fn from_rotation(rotation: UnitQuaternion<f64>) -> Self {
        Self(rotation)
    }

    /// The attitude a fraction `t` of the way to `other`, along the shortest rotation.
    #[must_use]
    pub fn slerp(&self, other: &Self, t: f64) -> Self {
        Self(self.0.try_slerp(&other.0, t, 1e-9).unwrap_or(if t < 0.5 { self.0 } else { other.0 }))
    }

    /// ENU to NED axes as a rotation (a half turn about (1, 1, 0)); its own inverse.
    fn enu_ned() -> UnitQuaternion<f64> {
        let m = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m))
    }

    /// FRD to FLU axes as a rotation (a half turn about x); its own inverse.
    fn flu_frd() -> UnitQuaternion<f64> {
        UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0))
    }
}

/// Where a vehicle is and how it is turned, in the mission frame and the paper's angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position in metres, ENU.
    pub position_enu_m: Enu,
    /// Roll, |roll| <= pi/2 in a plan.
    pub roll_rad: f64,
    /// Pitch, |pitch| <= pi/2 in a plan.
    pub pitch_rad: f64,
    /// Yaw, 0 in a plan unless the mission frees it.
    pub yaw_rad: f64,
}

impl Pose {
    /// The attitude of this pose.
    #[must_use]
    pub fn attitude(&self) -> Attitude {
        Attitude::from_euler(self.roll_rad, self.pitch_rad, self.yaw_rad)
    }

    /// The antenna axis of this pose (paper 1.1).
    #[must_use]
    pub fn antenna_axis(&self) -> Vector3<f64> {
        pattern::antenna_axis(self.roll_rad, self.pitch_rad, self.yaw_rad)
    }

    /// The position as a point.
    #[must_use]
    pub fn point(&self) -> Point3<f64> {
        Point3::from(self.position_enu_m)
    }
}
