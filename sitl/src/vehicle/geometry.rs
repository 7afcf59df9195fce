//! Where the rotors sit and which way they push.

/// No airframe has more rotors (PX4's CA_ROTOR parameters end here too).
pub const MAX_ROTORS: usize = 12;
/// No rotor sits farther from the centre of mass, or has a longer lever of drag, in metres; none gives more thrust, in
/// newtons. Products of larger figures overflow.
const FARTHEST_M: f64 = 100.0;
const STRONGEST_N: f64 = 1e6;

/// One rotor, body axes (FLU) from the centre of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotor {
    /// Metres.
    pub position_flu_m: [f64; 3],
    /// Direction of its thrust, a unit vector.
    pub axis_flu: [f64; 3],
    /// Thrust at full throttle, newtons.
    pub thrust_n: f64,
    /// Drag torque per thrust, metres. It turns the body about minus the axis: positive is a rotor that spins
    /// counter-clockwise for who looks down on it, against its thrust.
    pub moment_m: f64,
}

/// All rotors of an airframe and what they have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// At most [`MAX_ROTORS`]; more are left off.
    pub rotors: Vec<Rotor>,
    /// The rotors can push both ways (symmetric blades, motors that reverse).
    pub reversible: bool,
    /// First-order lag of thrust behind throttle, seconds.
    pub lag_s: f64,
    /// Curve of thrust over the motor's signal `s`: `curve s^2 + (1 - curve) s`, both from 0 to 1.
    pub curve: f64,
}

impl Geometry {
    /// Eight reversible rotors on the corners of a cube, their axes tilted so that force and torque go in every
    /// direction: the arrangement of the omnidirectional vehicle of Brescianini and D'Andrea (ICRA 2016).
    pub(crate) fn tilted_eight() -> Self {
        const CORNER_M: f64 = 0.144_35;
        // 1/2 + 1/sqrt(12), 1/2 - 1/sqrt(12) and 1/sqrt(3).
        const LONG: f64 = 0.788_675_134_594_813;
        const SHORT: f64 = 0.211_324_865_405_187;
        const UP: f64 = 0.577_350_269_189_626;
        let rotor = |[x, y, z]: [f64; 3], [ax, ay, az]: [f64; 3]| Rotor {
            position_flu_m: [x * CORNER_M, y * CORNER_M, z * CORNER_M],
            axis_flu: [ax, ay, az],
            thrust_n: 25.1,
            moment_m: 0.05,
        };
        Self {
            rotors: vec![
                rotor([1.0, 1.0, 1.0], [-LONG, SHORT, UP]),
                rotor([-1.0, 1.0, 1.0], [SHORT, LONG, -UP]),
                rotor([1.0, -1.0, 1.0], [-SHORT, -LONG, -UP]),
                rotor([-1.0, -1.0, 1.0], [LONG, -SHORT, UP]),
                rotor([1.0, 1.0, -1.0], [LONG, -SHORT, UP]),
                rotor([-1.0, 1.0, -1.0], [-SHORT, -LONG, -UP]),
                rotor([1.0, -1.0, -1.0], [SHORT, LONG, -UP]),
                rotor([-1.0, -1.0, -1.0], [-LONG, SHORT, UP]),
            ],
            reversible: true,
            lag_s: 0.03,
            curve: 1.0,
        }
    }

    /// A quadrotor in X: level thrust axes, so that it leans to move.
    pub(crate) fn level_four() -> Self {
        const ARM_M: f64 = 0.18;
        let rotor = |x: f64, y: f64, moment_m: f64| Rotor {
            position_flu_m: [x * ARM_M, y * ARM_M, 0.0],
            axis_flu: [0.0, 0.0, 1.0],
            thrust_n: 22.5,
            moment_m,
        };
        Self {
            rotors: vec![
                rotor(1.0, -1.0, 0.05),
                rotor(-1.0, 1.0, 0.05),
                rotor(1.0, 1.0, -0.05),
                rotor(-1.0, -1.0, -0.05),
            ],
            reversible: false,
            lag_s: 0.03,
            curve: 1.0,
        }
    }

    /// The first value that no rotors can have.
    pub(crate) fn fault(&self) -> Option<(&'static str, f64)> {
        if self.rotors.is_empty() || self.rotors.len() > MAX_ROTORS {
            return Some(("geometry: number of rotors", self.rotors.len() as f64));
        }
        let shared = [("geometry: curve", self.curve), ("geometry: lag_s", self.lag_s)];
        if let Some(bad) = shared.into_iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0)) {
            return Some(bad);
        }
        if self.curve > 1.0 {
            return Some(("geometry: curve", self.curve));
        }
        self.rotors.iter().find_map(|r| {
            let length = r.axis_flu.iter().map(|v| v * v).sum::<f64>().sqrt();
            let beyond = |v: f64| !v.is_finite() || v.abs() > FARTHEST_M;
            let place = r.position_flu_m.into_iter().find(|v| beyond(*v));
            if !(r.thrust_n > 0.0 && r.thrust_n <= STRONGEST_N) {
                Some(("geometry: thrust_n", r.thrust_n))
            } else if (length - 1.0).abs() > 1e-3 || !length.is_finite() {
                Some(("geometry: length of axis_flu", length))
            } else if beyond(r.moment_m) {
                Some(("geometry: moment_m", r.moment_m))
            } else {
                place.map(|v| ("geometry: position_flu_m", v))
            }
        })
    }
}
