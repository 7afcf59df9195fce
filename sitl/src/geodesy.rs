//! WGS 84: geodetic coordinates, and the rigid transform between two local tangent frames.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::frames::enu_to_ned;

/// WGS 84 semi-major axis in metres and flattening.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY_SQUARED: f64 = FLATTENING * (2.0 - FLATTENING);

/// A point on or above the earth. Heights above mean sea level and above the ellipsoid are taken as one: the
/// simulated earth has no geoid undulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Origin {
    /// Geodetic latitude, degrees north.
    pub lat_deg: f64,
    /// Longitude, degrees east.
    pub lon_deg: f64,
    /// Height above mean sea level, metres.
    pub alt_amsl_m: f64,
}

impl Origin {
    fn ecef(self) -> Vector3<f64> {
        let (sin_lat, cos_lat) = self.lat_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = self.lon_deg.to_radians().sin_cos();
        let n = SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQUARED * sin_lat * sin_lat).sqrt();
        let r = (n + self.alt_amsl_m) * cos_lat;
        Vector3::new(r * cos_lon, r * sin_lon, (n * (1.0 - ECCENTRICITY_SQUARED) + self.alt_amsl_m) * sin_lat)
    }

    /// The rotation from earth-centred axes to east, north, up here.
    fn ecef_to_enu(self) -> Matrix3<f64> {
        let (sin_lat, cos_lat) = self.lat_deg.to_radians().sin_cos();
        let (sin_lon, cos_lon) = self.lon_deg.to_radians().sin_cos();
        Matrix3::new(
            -sin_lon,
            cos_lon,
            0.0,
            -sin_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lat,
            cos_lat * cos_lon,
            cos_lat * sin_lon,
            sin_lat,
        )
    }

    /// The geodetic coordinates of a point given in this origin's ENU, by iterating the latitude (converges by
    /// a factor of 300 a step near the surface).
    pub(crate) fn geodetic(self, enu_m: Vector3<f64>) -> Self {
        let p = self.ecef() + self.ecef_to_enu().transpose() * enu_m;
        let r = p.x.hypot(p.y);
        let mut lat = p.z.atan2(r * (1.0 - ECCENTRICITY_SQUARED));
        let mut height = 0.0;
        for _ in 0..6 {
            let (sin, cos) = lat.sin_cos();
            let n = SEMI_MAJOR_M / (1.0 - ECCENTRICITY_SQUARED * sin * sin).sqrt();
            // The form that is well conditioned at the equator and at the poles alike.
            height = r * cos + p.z * sin - n * (1.0 - ECCENTRICITY_SQUARED * sin * sin);
            lat = p.z.atan2(r * (1.0 - ECCENTRICITY_SQUARED * n / (n + height)));
        }
        Self { lat_deg: lat.to_degrees(), lon_deg: p.y.atan2(p.x).to_degrees(), alt_amsl_m: height }
    }

    /// A geodetic point in this origin's ENU.
    pub(crate) fn enu(self, point: Self) -> Vector3<f64> {
        self.ecef_to_enu() * (point.ecef() - self.ecef())
    }

    /// As MAVLink carries it: 1e-7 degrees and millimetres.
    pub(crate) fn to_wire(self) -> (i32, i32, i32) {
        (
            (self.lat_deg * 1e7).round() as i32,
            (self.lon_deg * 1e7).round() as i32,
            (self.alt_amsl_m * 1e3).round() as i32,
        )
    }

    /// The inverse of [`Self::to_wire`].
    pub(crate) fn from_wire(lat: i32, lon: i32, alt_mm: i32) -> Self {
        Self {
            lat_deg: f64::from(lat) / 1e7,
            lon_deg: f64::from(lon) / 1e7,
            alt_amsl_m: f64::from(alt_mm) / 1e3,
        }
    }
}

/// One vehicle's own local NED frame, seen from the mission's ENU. Both are tangent frames of one ellipsoid, so
/// the transform is rigid and exact.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalFrame {
    /// The mission's origin.
    pub mission: Origin,
    /// Where the local frame's zero is: what GPS_GLOBAL_ORIGIN says, to its resolution.
    pub origin: Origin,
    origin_enu_m: Vector3<f64>,
    /// Mission ENU to local NED.
    rotation: UnitQuaternion<f64>,
}

impl LocalFrame {
    /// The frame whose zero is at `enu_m` of the mission, rounded to what the wire can say.
    pub fn at(mission: Origin, enu_m: Vector3<f64>) -> Self {
        let (lat, lon, alt) = mission.geodetic(enu_m).to_wire();
        let origin = Origin::from_wire(lat, lon, alt);
        let turn = origin.ecef_to_enu() * mission.ecef_to_enu().transpose();
        Self {
            mission,
            origin,
            origin_enu_m: mission.enu(origin),
            rotation: enu_to_ned()
                * UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn)),
        }
    }

    pub fn position_to_ned(&self, enu_m: Vector3<f64>) -> Vector3<f64> {
        self.rotation * (enu_m - self.origin_enu_m)
    }

    pub fn position_to_enu(&self, ned_m: Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * ned_m + self.origin_enu_m
    }

    pub fn vector_to_ned(&self, enu: Vector3<f64>) -> Vector3<f64> {
        self.rotation * enu
    }

    pub fn vector_to_enu(&self, ned: Vector3<f64>) -> Vector3<f64> {
        self.rotation.inverse() * ned
    }

    /// Body FLU to mission ENU, as body FRD to local NED.
    pub fn attitude_to_ned(&self, attitude: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        self.rotation * attitude * crate::frames::frd_to_flu()
    }

    /// Body FRD to local NED, as body FLU to mission ENU.
    pub fn attitude_to_enu(&self, attitude: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        self.rotation.inverse() * attitude * crate::frames::frd_to_flu()
    }

    /// Geodetic coordinates of a point of the mission's frame.
    pub fn geodetic(&self, enu_m: Vector3<f64>) -> Origin {
        self.mission.geodetic(enu_m)
    }

    /// A geodetic point in this frame's NED.
    pub fn ned_of(&self, point: Origin) -> Vector3<f64> {
        self.position_to_ned(self.mission.enu(point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRAGUE: Origin = Origin { lat_deg: 50.0755, lon_deg: 14.4378, alt_amsl_m: 200.0 };

    #[test]
    fn val_a_degree_of_latitude_at_the_equator_and_at_the_pole() {
        // Lengths of a degree of latitude from NIMA TR8350.2: 110 574 m at the equator, 111 694 m at the pole.
        for (lat, metres) in [(0.0, 110_574.3), (89.5, 111_693.9)] {
            let a = Origin { lat_deg: lat - 0.005, lon_deg: 0.0, alt_amsl_m: 0.0 };
            let b = Origin { lat_deg: lat + 0.005, lon_deg: 0.0, alt_amsl_m: 0.0 };
            assert!(((b.ecef() - a.ecef()).norm() * 100.0 - metres).abs() < 1.5);
        }
    }

    #[test]
    fn prop_geodetic_and_back() {
        for enu in [Vector3::new(500.0, -300.0, 120.0), Vector3::new(-4e4, 2e4, 3e3), Vector3::zeros()] {
            let back = PRAGUE.enu(PRAGUE.geodetic(enu));
            assert!((back - enu).norm() < 1e-6, "{back}");
        }
    }

    #[test]
    fn val_a_point_north_is_north_in_both_frames() {
        let frame = LocalFrame::at(PRAGUE, Vector3::new(200.0, -100.0, 3.0));
        let ned = frame.position_to_ned(Vector3::new(200.0, -90.0, 23.0));
        assert!((ned - Vector3::new(10.0, 0.0, -20.0)).norm() < 0.02, "{ned}");
        assert!((frame.position_to_enu(ned) - Vector3::new(200.0, -90.0, 23.0)).norm() < 1e-9);
        // Two frames 200 m apart are turned by 200 m / earth radius, 0.0018 degrees.
        let east = frame.attitude_to_ned(&UnitQuaternion::identity());
        assert!((east.euler_angles().2 - std::f64::consts::FRAC_PI_2).abs() < 1e-4);
    }
}
