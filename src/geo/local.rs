//! An autopilot's local frame, and the map projection its firmware makes it by.
//!
//! The mission's frame is a tangent plane of the WGS 84 ellipsoid. Autopilots take the earth for a sphere: at 50 deg of
//! latitude a kilometre to the east is 1002 m to the mission and 999 m to PX4. Half a kilometre from the autopilot's
//! origin the difference is as large as the tolerance of a pose, so each firmware's own formula is used, both ways.

use super::{Enu, Geodetic, Ned, swap_enu_ned};

/// Mean radius of the earth to PX4, in metres.
const EQUIDISTANT_RADIUS_M: f64 = 6_371_000.0;
/// Radius of the earth to ArduPilot, in metres.
const EQUIRECTANGULAR_RADIUS_M: f64 = 6_378_100.0;
/// ArduPilot's least length of a degree of longitude, as a part of one at the equator.
const LEAST_LONGITUDE_SCALE: f64 = 0.01;

/// How a firmware turns latitude, longitude and altitude into local north, east and down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Projection {
    /// The tangent plane of the ellipsoid, as the mission's own frame.
    #[default]
    Tangent,
    /// PX4: azimuthal equidistant on a sphere of 6371 km; down is the difference of altitudes.
    Equidistant,
    /// ArduPilot: degrees of latitude, and degrees of longitude times the cosine of the mean latitude, on a sphere of
    /// 6378.1 km; down is the difference of altitudes.
    Equirectangular,
}

impl Projection {
    /// `point` in the local frame about `origin`, north, east, down in metres.
    #[must_use]
    pub fn to_ned(self, point: Geodetic, origin: Geodetic) -> Ned {
        let down_m = origin.alt_m - point.alt_m;
        match self {
            Self::Tangent => Ned::from_vector(swap_enu_ned(point.to_enu(origin))),
            Self::Equidistant => {
                let (sin_lat, cos_lat) = point.lat_deg.to_radians().sin_cos();
                let (sin_lat0, cos_lat0) = origin.lat_deg.to_radians().sin_cos();
                let (sin_dlon, cos_dlon) = (point.lon_deg - origin.lon_deg).to_radians().sin_cos();
                // East and north of the tangent plane at the origin, of the unit sphere.
                let east = cos_lat * sin_dlon;
                let north = cos_lat0 * sin_lat - sin_lat0 * cos_lat * cos_dlon;
                let up = sin_lat0 * sin_lat + cos_lat0 * cos_lat * cos_dlon;
                let sine = east.hypot(north);
                // The angle from the origin over its sine; the arc tangent is exact where the arc cosine is not.
                let stretch = if sine > 0.0 { sine.atan2(up) / sine } else { 1.0 };
                let radius_m = stretch * EQUIDISTANT_RADIUS_M;
                Ned::new(north * radius_m, east * radius_m, down_m)
            }
            Self::Equirectangular => {
                let north = (point.lat_deg - origin.lat_deg).to_radians();
                let east = wrapped_deg(point.lon_deg - origin.lon_deg).to_radians();
                let scale = longitude_scale(0.5 * (point.lat_deg + origin.lat_deg));
                Ned::new(north * EQUIRECTANGULAR_RADIUS_M, east * scale * EQUIRECTANGULAR_RADIUS_M, down_m)
            }
        }
    }

    /// The inverse of [`Self::to_ned`].
    #[must_use]
    pub fn from_ned(self, local: Ned, origin: Geodetic) -> Geodetic {
        let local = local.vector();
        let alt_m = origin.alt_m - local.z;
        match self {
            Self::Tangent => Geodetic::from_enu(swap_enu_ned(local), origin),
            Self::Equidistant => {
                let (north, east) = (local.x / EQUIDISTANT_RADIUS_M, local.y / EQUIDISTANT_RADIUS_M);
                let angle = north.hypot(east);
                let shrink = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
                let (north, east, up) = (north * shrink, east * shrink, angle.cos());
                let (sin_lat0, cos_lat0) = origin.lat_deg.to_radians().sin_cos();
                // Along the earth's axis, and away from it in the origin's meridian.
                let (axial, radial) = (up * sin_lat0 + north * cos_lat0, up * cos_lat0 - north * sin_lat0);
                Geodetic {
                    lat_deg: axial.atan2(radial.hypot(east)).to_degrees(),
                    lon_deg: wrapped_deg(origin.lon_deg + east.atan2(radial).to_degrees()),
                    alt_m,
                }
            }
            Self::Equirectangular => {
                let lat_deg = origin.lat_deg + (local.x / EQUIRECTANGULAR_RADIUS_M).to_degrees();
                let scale = longitude_scale(0.5 * (lat_deg + origin.lat_deg));
                let east_deg = (local.y / EQUIRECTANGULAR_RADIUS_M / scale).to_degrees();
                Geodetic { lat_deg, lon_deg: wrapped_deg(origin.lon_deg + east_deg), alt_m }
            }
        }
    }
}

fn longitude_scale(lat_deg: f64) -> f64 {
    lat_deg.to_radians().cos().max(LEAST_LONGITUDE_SCALE)
}

/// An angle in [-180, 180).
fn wrapped_deg(angle: f64) -> f64 {
    (angle + 180.0).rem_euclid(360.0) - 180.0
}

/// An autopilot's local NED frame seen from the mission frame.
///
/// Positions go through geodetic coordinates. The axes of the two frames differ by 1e-4 rad over a kilometre and by a
/// part in three hundred in length: vectors and attitudes are passed as they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    /// The mission's origin.
    pub mission: Geodetic,
    /// The autopilot's own origin.
    pub autopilot: Geodetic,
    /// How the autopilot's firmware projects.
    pub projection: Projection,
}

impl LocalFrame {
    /// A local NED position in the mission frame.
    #[must_use]
    pub fn position_to_enu(&self, local: Ned) -> Enu {
        self.projection.from_ned(local, self.autopilot).to_enu(self.mission)
    }

    /// A mission-frame position in the autopilot's local NED frame.
    #[must_use]
    pub fn position_to_ned(&self, position: Enu) -> Ned {
        self.projection.to_ned(Geodetic::from_enu(position, self.mission), self.autopilot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const PRAGUE: Geodetic = Geodetic { lat_deg: 50.0755, lon_deg: 14.4378, alt_m: 200.0 };
    const ALL: [Projection; 3] = [Projection::Tangent, Projection::Equidistant, Projection::Equirectangular];

    fn distance_m(a: Ned, b: Ned) -> f64 {
        (a.vector() - b.vector()).norm()
    }

    fn frame(projection: Projection, origin_enu_m: Enu) -> LocalFrame {
        LocalFrame { mission: PRAGUE, autopilot: Geodetic::from_enu(origin_enu_m, PRAGUE), projection }
    }

    #[test]
    fn val_the_sphere_as_px4_states_it() {
        // PX4's own formula written out: k = c / sin c with c from the arc cosine, in metres on 6371 km.
        let by_the_book = |point: Geodetic, origin: Geodetic| {
            let (lat, lat0) = (point.lat_deg.to_radians(), origin.lat_deg.to_radians());
            let turn = (point.lon_deg - origin.lon_deg).to_radians();
            let c = (lat0.sin() * lat.sin() + lat0.cos() * lat.cos() * turn.cos()).clamp(-1.0, 1.0).acos();
            let k = c / c.sin() * 6_371_000.0;
            let north = k * (lat0.cos() * lat.sin() - lat0.sin() * lat.cos() * turn.cos());
            Ned::new(north, k * lat.cos() * turn.sin(), origin.alt_m - point.alt_m)
        };
        for (lat_deg, lon_deg) in [(50.0755, 14.9), (50.6, 14.4378), (49.8, 14.1), (50.1, 14.45)] {
            let point = Geodetic { lat_deg, lon_deg, alt_m: 260.0 };
            let (ours, book) = (Projection::Equidistant.to_ned(point, PRAGUE), by_the_book(point, PRAGUE));
            assert!(distance_m(ours, book) < 1e-3, "{ours:?} {book:?}");
        }
        // A degree of latitude on a sphere of 6371 km.
        let north = Geodetic { lat_deg: PRAGUE.lat_deg + 1.0, ..PRAGUE };
        let ned = Projection::Equidistant.to_ned(north, PRAGUE).vector();
        assert!((ned.x - 111_194.926_645).abs() < 1e-3 && ned.y.abs() < 1e-6, "{ned}");
    }

    #[test]
    fn val_degrees_as_ardupilot_scales_them() {
        // 0.011131884502145034 m for 1e-7 deg, and the cosine of the mean latitude for longitude.
        let point = Geodetic { lat_deg: PRAGUE.lat_deg + 0.01, lon_deg: PRAGUE.lon_deg - 0.02, alt_m: 190.0 };
        let ned = Projection::Equirectangular.to_ned(point, PRAGUE);
        let metres_per_degree = 111_318.845_021_450_34;
        let east = -0.02 * metres_per_degree * (PRAGUE.lat_deg + 0.005).to_radians().cos();
        assert!(distance_m(ned, Ned::new(0.01 * metres_per_degree, east, 10.0)) < 1e-6, "{ned:?}");
    }

    #[test]
    fn val_half_a_kilometre_away_the_firmwares_are_a_metre_and_more_off_the_tangent_plane() {
        // Radii of curvature of WGS 84 at 50.0755 deg: 6372.9 km along the meridian, 6390.7 km across it.
        for (projection, north_m, east_m) in
            [(Projection::Equidistant, -0.15, -1.54), (Projection::Equirectangular, 0.41, -0.99)]
        {
            let point = Geodetic::from_enu(Enu::new(500.0, 500.0, 0.0), PRAGUE);
            let off = projection.to_ned(point, PRAGUE).vector() - Vector3::new(500.0, 500.0, 0.0);
            assert!((off.x - north_m).abs() < 0.06 && (off.y - east_m).abs() < 0.06, "{projection:?} {off}");
        }
    }

    #[test]
    fn spec_the_date_line_and_the_pole_are_no_edges() {
        let origin = Geodetic { lat_deg: 10.0, lon_deg: 179.999, alt_m: 0.0 };
        for projection in ALL {
            let point = projection.from_ned(Ned::new(100.0, 500.0, -20.0), origin);
            assert!((-180.0..180.0).contains(&point.lon_deg) && point.lon_deg < -179.9, "{point:?}");
            let back = projection.to_ned(point, origin);
            assert!(distance_m(back, Ned::new(100.0, 500.0, -20.0)) < 1e-4, "{projection:?} {back:?}");
        }
        let high = Geodetic { lat_deg: 89.99, lon_deg: 0.0, alt_m: 0.0 };
        let over = Projection::Equidistant.from_ned(Ned::new(3000.0, 10.0, 0.0), high);
        let back = Projection::Equidistant.to_ned(over, high);
        assert!(distance_m(back, Ned::new(3000.0, 10.0, 0.0)) < 1e-4, "{back:?}");
    }

    #[test]
    fn val_local_frames_differ_by_the_offset_of_their_origins() {
        for projection in ALL {
            let frame = frame(projection, Enu::new(120.0, -45.0, 7.0));
            assert!(
                (frame.position_to_enu(Ned::new(0.0, 0.0, 0.0)) - Enu::new(120.0, -45.0, 7.0)).norm() < 1e-6
            );
        }
        // 100 m north, 50 m east and 80 m up of the autopilot's origin; tangent planes turn by 2e-5 rad in 130 m.
        let enu = frame(Projection::Tangent, Enu::new(120.0, -45.0, 7.0))
            .position_to_enu(Ned::new(100.0, 50.0, -80.0));
        assert!((enu - Enu::new(170.0, 55.0, 87.0)).norm() < 0.02, "{enu}");
    }

    proptest! {
        #[test]
        fn prop_local_frame_round_trip(n in -2e3..2e3, e in -2e3..2e3, d in -300.0..0.0, oe in -900.0..900.0, on in -900.0..900.0, kind in 0..3usize) {
            let frame = frame(ALL[kind], Enu::new(oe, on, 3.0));
            let local = Ned::new(n, e, d);
            prop_assert!(distance_m(frame.position_to_ned(frame.position_to_enu(local)), local) < 1e-4);
        }
    }
}
