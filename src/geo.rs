//! Frames and attitudes: the only place where a frame changes.
//!
//! - *Mission frame*: ENU (east, north, up), metres, about the mission origin on the WGS 84 ellipsoid.
//! - *Autopilot frame*: NED about the autopilot's own origin (GPS_GLOBAL_ORIGIN), by the firmware's own [`Projection`] of
//!   the earth; body axes FRD.
//! - *Attitude in the paper's convention*: Euler angles (roll, pitch, yaw) of a body whose axes at rest are the
//!   mission frame's, `R = Rz(yaw) Ry(pitch) Rx(roll)`, body to world, z up (FLU). The antenna lies along body z.
//!   At yaw 0 body x points east: a heading of 90 deg in NED.

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

mod local;
mod ned;
pub mod polygon;

pub use local::{LocalFrame, Projection};
pub use ned::{Ned, NedAcceleration, NedVelocity};

use crate::radio::pattern;

/// A position in the mission frame in metres, or a difference of two. Everything reckons in this frame, so it is the plain
/// vector; what is not a position in it, and could be taken for one, has a type of its own: [`EnuVelocity`],
/// [`EnuAcceleration`], [`Ned`], [`NedVelocity`], [`NedAcceleration`].
pub type Enu = Vector3<f64>;

/// A velocity in the mission frame in m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnuVelocity(Vector3<f64>);

impl EnuVelocity {
    /// At rest.
    pub const ZERO: Self = Self(Vector3::new(0.0, 0.0, 0.0));

    /// From its components to the east, north and up in m/s.
    #[must_use]
    pub const fn new(east: f64, north: f64, up: f64) -> Self {
        Self(Vector3::new(east, north, up))
    }

    /// From a vector with these components.
    #[must_use]
    pub const fn from_vector(vector: Vector3<f64>) -> Self {
        Self(vector)
    }

    /// As a vector, to reckon with.
    #[must_use]
    pub const fn vector(self) -> Vector3<f64> {
        self.0
    }
}

/// An acceleration in the mission frame in m/s^2, gravity left out: zero at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnuAcceleration(Vector3<f64>);

impl EnuAcceleration {
    /// At rest, or in straight and steady motion.
    pub const ZERO: Self = Self(Vector3::new(0.0, 0.0, 0.0));

    /// From a vector with these components.
    #[must_use]
    pub const fn from_vector(vector: Vector3<f64>) -> Self {
        Self(vector)
    }

    /// As a vector, to reckon with.
    #[must_use]
    pub const fn vector(self) -> Vector3<f64> {
        self.0
    }
}

/// Whether what was said is a place at all, or a velocity: finite, and within [`MAX_COORDINATE_M`](polygon::MAX_COORDINATE_M). The way
/// to what is farther takes longer than a clock can count.
#[must_use]
pub fn has_meaning(said: &Vector3<f64>) -> bool {
    said.iter().all(|c| c.abs() <= polygon::MAX_COORDINATE_M)
}

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
    /// A point as MAVLink has it: degrees times 1e7, and millimetres.
    #[must_use]
    pub fn of_wire(lat: i32, lon: i32, alt_mm: i32) -> Self {
        Self {
            lat_deg: f64::from(lat) * 1e-7,
            lon_deg: f64::from(lon) * 1e-7,
            alt_m: f64::from(alt_mm) * 1e-3,
        }
    }

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

/// A vector with its axes swapped between ENU and NED (the same map both ways). Only here: who swaps axes by hand has a
/// vector whose frame no type tells.
fn swap_enu_ned(v: Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.y, v.x, -v.z)
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

    /// Roll, pitch and heading of the quaternion MAVLink carries, in radians: about FRD's x, y and z from NED.
    #[must_use]
    pub fn to_mavlink_euler(&self) -> (f64, f64, f64) {
        let [w, x, y, z] = self.to_mavlink();
        UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z)).euler_angles()
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    const PRAGUE: Geodetic = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };

    /// The attitude MAVLink carries, applied to FRD's up: the antenna axis in NED.
    fn axis_ned_from_wire([w, x, y, z]: [f64; 4]) -> Vector3<f64> {
        UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, x, y, z)) * Vector3::new(0.0, 0.0, -1.0)
    }

    /// Roll, pitch, yaw of the aerospace sequence from a body-to-NED quaternion, written out by hand.
    fn frd_euler([w, x, y, z]: [f64; 4]) -> (f64, f64, f64) {
        (
            (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
            (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
            (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
        )
    }

    #[test]
    fn val_level_points_east() {
        let (roll, pitch, yaw) = frd_euler(Attitude::level().to_mavlink());
        assert!(roll.abs() < 1e-15 && pitch.abs() < 1e-15 && (yaw - FRAC_PI_2).abs() < 1e-15);
    }

    #[test]
    fn val_mavlink_angles_at_zero_yaw() {
        // MODEL section 1: NED yaw = 90 deg, FRD roll = phi, FRD pitch = -theta.
        for (phi, theta) in [(0.3, 0.0), (0.0, 0.4), (-0.7, 1.1), (1.2, -0.2)] {
            let (roll, pitch, yaw) = frd_euler(Attitude::from_euler(phi, theta, 0.0).to_mavlink());
            assert!(
                (roll - phi).abs() < 1e-12
                    && (pitch + theta).abs() < 1e-12
                    && (yaw - FRAC_PI_2).abs() < 1e-12
            );
        }
    }

    #[test]
    fn val_mavlinks_angles_at_any_yaw() {
        // The paper's roll is about body x, which FLU and FRD share; pitch and heading change their sign and zero.
        for (roll, pitch, yaw) in [(0.3, 0.0, 0.0), (0.0, 0.4, 0.0), (-0.7, 0.9, 1.1), (1.2, -1.3, -2.0)] {
            let (r, p, h) = Attitude::from_euler(roll, pitch, yaw).to_mavlink_euler();
            assert!((r - roll).abs() < 1e-9 && (p + pitch).abs() < 1e-9, "{r} {p}");
            let turn = (h - (FRAC_PI_2 - yaw)).rem_euclid(2.0 * PI);
            assert!(turn.min(2.0 * PI - turn) < 1e-9, "{h}");
        }
    }

    #[test]
    fn spec_quaternions_that_are_no_rotation() {
        for q in [[0.0; 4], [f64::NAN, 0.0, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0, 1.0], [1e-9, 0.0, 0.0, 0.0]]
        {
            assert_eq!(Attitude::from_mavlink(q), None, "{q:?}");
        }
        let scaled = Attitude::from_mavlink([2.0, 0.0, 0.0, 2.0]).unwrap();
        assert!(scaled.angle_to(&Attitude::level()) < 1e-12);
    }

    #[test]
    fn val_one_degree_north_at_prague() {
        // A degree of meridian at 50.58 deg is 111.239 km (WGS 84 series 111132.954 - 559.822 cos 2l + 1.175 cos 4l);
        // the chord and the tangent plane take 1.4e-5 from it, and the earth falls away by 970 m.
        let north = Geodetic { lat_deg: PRAGUE.lat_deg + 1.0, ..PRAGUE }.to_enu(PRAGUE);
        assert!(north.x.abs() < 1e-6);
        assert!((north.y - 111_240.0).abs() < 12.0, "{north}");
        assert!((north.z + 971.0).abs() < 3.0, "{north}");
    }

    #[test]
    fn val_axes_swap() {
        assert_eq!(swap_enu_ned(Vector3::new(1.0, 2.0, 3.0)), Vector3::new(2.0, 1.0, -3.0));
    }

    proptest! {
        /// R_NED<-FRD (0, 0, -1) is the paper's Y carried to NED: the sign and frame of every angle at once.
        #[test]
        fn prop_the_wire_carries_the_antenna_axis(r in -PI..PI, p in -FRAC_PI_2..FRAC_PI_2, y in -PI..PI) {
            let attitude = Attitude::from_euler(r, p, y);
            let paper = swap_enu_ned(pattern::antenna_axis(r, p, y));
            prop_assert!((axis_ned_from_wire(attitude.to_mavlink()) - paper).norm() < 1e-12);
            prop_assert!(attitude.to_mavlink()[0] >= 0.0);
            prop_assert!((attitude.antenna_axis() - pattern::antenna_axis(r, p, y)).norm() < 1e-12);
        }

        #[test]
        fn prop_mavlink_round_trip(r in -PI..PI, p in -FRAC_PI_2..FRAC_PI_2, y in -PI..PI) {
            let attitude = Attitude::from_euler(r, p, y);
            let again = Attitude::from_mavlink(attitude.to_mavlink()).unwrap();
            prop_assert!(again.angle_to(&attitude) < 1e-7);
        }

        #[test]
        fn prop_enu_round_trip(e in -5e3..5e3, n in -5e3..5e3, u in -100.0..500.0, lat in -80.0..80.0, lon in -180.0..180.0) {
            let origin = Geodetic { lat_deg: lat, lon_deg: lon, alt_m: 200.0 };
            let position = Enu::new(e, n, u);
            prop_assert!((Geodetic::from_enu(position, origin).to_enu(origin) - position).norm() < 1e-5);
        }

        #[test]
        fn prop_slerp_stays_on_the_arc(r in -3.0..3.0, p in -1.5..1.5, t in 0.0..1.0) {
            let (a, b) = (Attitude::level(), Attitude::from_euler(r, p, 0.0));
            let angle = a.angle_to(&b);
            prop_assert!((a.angle_to(&a.slerp(&b, t)) - t * angle).abs() < 1e-6);
        }
    }
}
