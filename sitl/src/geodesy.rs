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

/// How an autopilot's firmware makes local coordinates of latitude, longitude and altitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Projection {
    /// A tangent plane of the ellipsoid: what the mission itself uses.
    Tangent,
    /// PX4: distance and bearing along great circles of a sphere.
    GreatCircle,
    /// ArduPilot: degrees times metres per degree, longitude shortened by the cosine of the mean latitude.
    MetresPerDegree,
}

impl Projection {
    /// The earth's radius to PX4 and to ArduPilot, metres.
    const GREAT_CIRCLE_RADIUS_M: f64 = 6_371_000.0;
    const METRES_PER_DEGREE: f64 = 111_318.845_021_450_34;

    /// North and east of `origin`, metres.
    fn horizontal(self, origin: Origin, point: Origin) -> (f64, f64) {
        let (a, b) = (origin.lat_deg.to_radians(), point.lat_deg.to_radians());
        let turn = (point.lon_deg - origin.lon_deg).to_radians();
        match self {
            Self::Tangent => {
                let enu = origin.enu(point);
                (enu.y, enu.x)
            }
            Self::GreatCircle => {
                // Haversines keep their digits over short distances.
                let hav = ((b - a) / 2.0).sin().powi(2) + a.cos() * b.cos() * (turn / 2.0).sin().powi(2);
                let distance = 2.0 * hav.sqrt().min(1.0).asin() * Self::GREAT_CIRCLE_RADIUS_M;
                let bearing =
                    (turn.sin() * b.cos()).atan2(a.cos() * b.sin() - a.sin() * b.cos() * turn.cos());
                (distance * bearing.cos(), distance * bearing.sin())
            }
            Self::MetresPerDegree => {
                let shortened = ((a + b) / 2.0).cos() * Self::METRES_PER_DEGREE;
                ((b - a).to_degrees() * Self::METRES_PER_DEGREE, turn.to_degrees() * shortened)
            }
        }
    }

    /// The latitude and longitude so far north and east of `origin`; the inverse of [`Self::horizontal`].
    fn point(self, origin: Origin, north_m: f64, east_m: f64) -> (f64, f64) {
        let a = origin.lat_deg.to_radians();
        match self {
            Self::Tangent => {
                let point = origin.geodetic(Vector3::new(east_m, north_m, 0.0));
                (point.lat_deg, point.lon_deg)
            }
            Self::GreatCircle => {
                let (arc, bearing) =
                    (north_m.hypot(east_m) / Self::GREAT_CIRCLE_RADIUS_M, east_m.atan2(north_m));
                let lat = (a.sin() * arc.cos() + a.cos() * arc.sin() * bearing.cos()).clamp(-1.0, 1.0).asin();
                let turn = (bearing.sin() * arc.sin() * a.cos()).atan2(arc.cos() - a.sin() * lat.sin());
                (lat.to_degrees(), origin.lon_deg + turn.to_degrees())
            }
            Self::MetresPerDegree => {
                let lat_deg = origin.lat_deg + north_m / Self::METRES_PER_DEGREE;
                let mean = (origin.lat_deg + lat_deg) / 2.0;
                let shortened = mean.to_radians().cos() * Self::METRES_PER_DEGREE;
                (lat_deg, origin.lon_deg + east_m / shortened)
            }
        }
    }
}

/// One vehicle's own local NED frame, seen from the mission's ENU: positions by the firmware's projection, directions
/// by the turn between the two tangent planes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalFrame {
    /// The mission's origin.
    pub mission: Origin,
    /// Where the local frame's zero is: what GPS_GLOBAL_ORIGIN says, to its resolution.
    pub origin: Origin,
    origin_enu_m: Vector3<f64>,
    /// Mission ENU to local NED.
    rotation: UnitQuaternion<f64>,
    projection: Projection,
}

impl LocalFrame {
    /// The frame whose zero is at `enu_m` of the mission, rounded to what the wire can say.
    pub fn at(mission: Origin, enu_m: Vector3<f64>, projection: Projection) -> Self {
        let (lat, lon, alt) = mission.geodetic(enu_m).to_wire();
        let origin = Origin::from_wire(lat, lon, alt);
        let turn = origin.ecef_to_enu() * mission.ecef_to_enu().transpose();
        Self {
            mission,
            origin,
            origin_enu_m: mission.enu(origin),
            rotation: enu_to_ned()
                * UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn)),
            projection,
        }
    }

    pub fn position_to_ned(&self, enu_m: Vector3<f64>) -> Vector3<f64> {
        if self.projection == Projection::Tangent {
            return self.rotation * (enu_m - self.origin_enu_m);
        }
        let point = self.mission.geodetic(enu_m);
        let (north, east) = self.projection.horizontal(self.origin, point);
        Vector3::new(north, east, self.origin.alt_amsl_m - point.alt_amsl_m)
    }

    pub fn position_to_enu(&self, ned_m: Vector3<f64>) -> Vector3<f64> {
        if self.projection == Projection::Tangent {
            return self.rotation.inverse() * ned_m + self.origin_enu_m;
        }
        let (lat_deg, lon_deg) = self.projection.point(self.origin, ned_m.x, ned_m.y);
        let alt_amsl_m = self.origin.alt_amsl_m - ned_m.z;
        self.mission.enu(Origin { lat_deg, lon_deg, alt_amsl_m })
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
    fn spec_geodetic_and_back() {
        for enu in [Vector3::new(500.0, -300.0, 120.0), Vector3::new(-4e4, 2e4, 3e3), Vector3::zeros()] {
            let back = PRAGUE.enu(PRAGUE.geodetic(enu));
            assert!((back - enu).norm() < 1e-6, "{back}");
        }
    }

    #[test]
    fn val_a_point_north_is_north_in_both_frames() {
        let frame = LocalFrame::at(PRAGUE, Vector3::new(200.0, -100.0, 3.0), Projection::Tangent);
        let ned = frame.position_to_ned(Vector3::new(200.0, -90.0, 23.0));
        assert!((ned - Vector3::new(10.0, 0.0, -20.0)).norm() < 0.02, "{ned}");
        assert!((frame.position_to_enu(ned) - Vector3::new(200.0, -90.0, 23.0)).norm() < 1e-9);
        // Two frames 200 m apart are turned by 200 m / earth radius, 0.0018 degrees.
        let east = frame.attitude_to_ned(&UnitQuaternion::identity());
        assert!((east.euler_angles().2 - std::f64::consts::FRAC_PI_2).abs() < 1e-4);
    }

    #[test]
    fn val_spheres_are_off_the_ellipsoid_by_what_their_radii_say() {
        // At 50.0755 deg the ellipsoid's radii of curvature are 6373.0 km to the north and 6390.7 km to the east; the
        // parallel bends away from the east by 0.1 m in a kilometre.
        for (projection, north_m, east_m) in [
            (Projection::GreatCircle, 1000.0 * 6371.0 / 6373.0, 1000.0 * 6371.0 / 6390.7),
            (Projection::MetresPerDegree, 1000.0 * 6378.1 / 6373.0, 1000.0 * 6378.1 / 6390.7),
        ] {
            let frame = LocalFrame::at(PRAGUE, Vector3::zeros(), projection);
            let enu = Vector3::new(1000.0, 1000.0, 80.0);
            let ned = frame.position_to_ned(enu);
            assert!((ned.x - north_m).abs() < 0.2 && (ned.y - east_m).abs() < 0.2, "{projection:?} {ned}");
            assert!((frame.position_to_enu(ned) - enu).norm() < 1e-5, "{projection:?}");
        }
    }
}
