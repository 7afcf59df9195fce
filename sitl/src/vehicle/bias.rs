//! What a vehicle's own instruments cannot know: a compass that is off, an antenna that is not mounted as drawn, a
//! position that is displaced. Drawn once a flight, and wrong by the same all through it.
//!
//! The vehicle flies and reports as if there were none: its autopilot holds what the estimator says, so the truth is off
//! by the bias.

use nalgebra::{UnitQuaternion, Vector3};

use crate::random::{Noise, Purpose};

/// The laws that a vehicle's biases are drawn from: independent Gaussians. The default has none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PointingErrors {
    /// Standard deviation of the heading's bias, degrees.
    pub heading_std_deg: f64,
    /// Of the antenna's tilt against the body, about each of the body's x and y, degrees.
    pub mounting_std_deg: f64,
    /// Of the position's bias: on each horizontal axis, and vertically, metres.
    pub position_std_m: [f64; 2],
}

impl PointingErrors {
    /// Nothing is off.
    pub(crate) fn is_none(&self) -> bool {
        *self == Self::default()
    }

    pub(crate) fn deviations(&self) -> [(&'static str, f64); 4] {
        [
            ("errors.heading_std_deg", self.heading_std_deg),
            ("errors.mounting_std_deg", self.mounting_std_deg),
            ("errors.position_std_m[0]", self.position_std_m[0]),
            ("errors.position_std_m[1]", self.position_std_m[1]),
        ]
    }

    /// A vehicle's biases in the flight of this seed. Each is drawn whatever the others are.
    pub(crate) fn draw(&self, seed: u64, vehicle: usize) -> Bias {
        let mut noise = Noise::new(seed, Purpose::Bias, vehicle);
        let mut of = |std: f64| std * noise.normal();
        let [horizontal_m, vertical_m] = self.position_std_m;
        Bias {
            heading_deg: of(self.heading_std_deg),
            mounting_deg: [of(self.mounting_std_deg), of(self.mounting_std_deg)],
            position_enu_m: [of(horizontal_m), of(horizontal_m), of(vertical_m)],
        }
    }
}

/// By how much the truth is off what the vehicle believes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bias {
    /// The body is turned by this about the world's vertical, from east towards north, degrees.
    pub heading_deg: f64,
    /// The antenna is turned by this against the body: a rotation vector about the body's x and y, degrees.
    pub mounting_deg: [f64; 2],
    /// The vehicle is displaced by this, ENU, metres.
    pub position_enu_m: [f64; 3],
}

/// The frame that a vehicle takes for the mission's, and the antenna in the body that it takes for its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct OwnFrame {
    /// `None` leaves every bit of an attitude as it is.
    turn: Option<UnitQuaternion<f64>>,
    offset_m: Vector3<f64>,
    antenna_flu: Vector3<f64>,
}

impl From<Bias> for OwnFrame {
    fn from(bias: Bias) -> Self {
        let heading_rad = bias.heading_deg.to_radians();
        let [x, y] = bias.mounting_deg.map(f64::to_radians);
        Self {
            turn: (heading_rad != 0.0)
                .then(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_rad)),
            offset_m: Vector3::from(bias.position_enu_m),
            antenna_flu: UnitQuaternion::from_scaled_axis(Vector3::new(x, y, 0.0)) * Vector3::z(),
        }
    }
}

impl Default for OwnFrame {
    fn default() -> Self {
        Self::from(Bias::default())
    }
}

impl OwnFrame {
    /// Where a vehicle that is truly here believes to be, as far as its biases go.
    pub fn position(&self, true_enu_m: &Vector3<f64>) -> Vector3<f64> {
        true_enu_m - self.offset_m
    }

    /// The same of its attitude, body FLU to ENU.
    pub fn attitude(&self, truth: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        self.turn.map_or(*truth, |turn| turn.inverse() * truth)
    }

    /// The antenna's true axis, ENU, of a body of this true attitude.
    pub fn antenna_axis(&self, truth: &UnitQuaternion<f64>) -> Vector3<f64> {
        truth * self.antenna_flu
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Euler;

    #[test]
    fn val_biases_have_their_deviations_and_are_independent() {
        let errors =
            PointingErrors { heading_std_deg: 2.0, mounting_std_deg: 0.5, position_std_m: [0.4, 0.8] };
        let n = 4000;
        let drawn: Vec<[f64; 12]> = (0..n)
            .map(|seed| {
                let [a, b] = [0, 1].map(|vehicle| {
                    let Bias { heading_deg, mounting_deg: [x, y], position_enu_m: [e, n, u] } =
                        errors.draw(seed, vehicle);
                    [heading_deg / 2.0, x / 0.5, y / 0.5, e / 0.4, n / 0.4, u / 0.8]
                });
                std::array::from_fn(|k| if k < 6 { a[k] } else { b[k - 6] })
            })
            .collect();
        let n = n as f64;
        for a in 0..12 {
            let mean = drawn.iter().map(|v| v[a]).sum::<f64>() / n;
            assert!(mean.abs() < 4.0 / n.sqrt(), "{a}: {mean}");
            for b in 0..=a {
                let product = drawn.iter().map(|v| v[a] * v[b]).sum::<f64>() / n;
                let (expected, std) = if a == b { (1.0, 2f64.sqrt()) } else { (0.0, 1.0) };
                assert!((product - expected).abs() < 4.0 * std / n.sqrt(), "{a} {b}: {product}");
            }
        }
    }

    #[test]
    fn spec_without_errors_not_a_bit_is_off() {
        let frame = OwnFrame::from(PointingErrors::default().draw(5, 1));
        let attitude = Euler { roll_rad: 0.3, pitch_rad: -1.2, yaw_rad: 2.0 }.rotation();
        let position = Vector3::new(0.1, -0.2, 30.3);
        assert_eq!(frame.position(&position), position);
        assert_eq!(frame.attitude(&attitude), attitude);
        assert_eq!(frame.antenna_axis(&attitude), attitude * Vector3::z());
    }

    #[test]
    fn val_a_heading_bias_turns_the_papers_yaw_and_a_mounting_error_its_axis() {
        let bias = Bias { heading_deg: 20.0, mounting_deg: [0.0, 0.0], position_enu_m: [1.0, 2.0, -3.0] };
        let frame = OwnFrame::from(bias);
        let believed = Euler { roll_rad: 0.7, pitch_rad: -0.4, yaw_rad: 0.3 };
        let truth = Euler { yaw_rad: 0.3 + 20f64.to_radians(), ..believed };
        assert!(frame.attitude(&truth.rotation()).angle_to(&believed.rotation()) < 1e-12);
        assert_eq!(frame.position(&Vector3::new(11.0, 12.0, 13.0)), Vector3::new(10.0, 10.0, 16.0));
        // Small mounting angles about x and y tip the axis by (y, -x), body axes.
        let (x, y) = (1e-4f64, -2e-4f64);
        let mounting_deg = [x.to_degrees(), y.to_degrees()];
        let frame = OwnFrame::from(Bias { mounting_deg, ..Bias::default() });
        let body = believed.rotation();
        let tipped = body.inverse() * frame.antenna_axis(&body);
        assert!((tipped - Vector3::new(y, -x, 1.0)).norm() < 1e-7, "{tipped}");
    }
}
