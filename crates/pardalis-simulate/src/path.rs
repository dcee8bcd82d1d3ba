//! Paths: position and velocity as functions of time.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use pardalis_core::Error;

/// A path through the world frame, in metres and seconds.
#[derive(Debug, Clone, PartialEq)]
pub enum Path {
    /// A fixed position.
    Still {
        /// The position.
        position_m: Vector3<f64>,
    },
    /// A straight line at constant velocity.
    Line {
        /// Position at time 0.
        position_m: Vector3<f64>,
        /// Velocity in m/s.
        velocity_mps: Vector3<f64>,
    },
    /// A horizontal circle, counter-clockwise as seen from above.
    Circle {
        /// Centre.
        center_m: Vector3<f64>,
        /// Radius.
        radius_m: f64,
        /// Period in seconds; negative for clockwise motion.
        period_s: f64,
        /// Angle from the x axis at time 0, in radians.
        phase_rad: f64,
    },
    /// A curve through points at given times.
    Waypoints(Waypoints),
    /// A sum of sines on each axis.
    Harmonic {
        /// Centre.
        center_m: Vector3<f64>,
        /// Sines along x, y and z.
        sines: [Vec<Sine>; 3],
    },
    /// A throw with bounces.
    Throw(Throw),
}

/// `amplitude_m · sin(2π t / period_s + phase_rad)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sine {
    /// Amplitude in metres.
    pub amplitude_m: f64,
    /// Period in seconds.
    pub period_s: f64,
    /// Phase in radians.
    pub phase_rad: f64,
}

impl Path {
    /// Returns position and velocity at a time.
    pub fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        match self {
            Self::Still { position_m } => (*position_m, Vector3::zeros()),
            Self::Line {
                position_m,
                velocity_mps,
            } => (position_m + velocity_mps * time_s, *velocity_mps),
            Self::Circle {
                center_m,
                radius_m,
                period_s,
                phase_rad,
            } => {
                let rate = TAU / period_s;
                let (sin, cos) = libm::sincos(rate * time_s + phase_rad);
                let speed = radius_m * rate;
                (
                    center_m + Vector3::new(radius_m * cos, radius_m * sin, 0.0),
                    Vector3::new(-speed * sin, speed * cos, 0.0),
                )
            }
            Self::Waypoints(waypoints) => waypoints.at(time_s),
            Self::Harmonic { center_m, sines } => {
                let (mut position_m, mut velocity_mps) = (*center_m, Vector3::zeros());
                for (axis, sines) in sines.iter().enumerate() {
                    for sine in sines {
                        let rate = TAU / sine.period_s;
                        let (sin, cos) = libm::sincos(rate * time_s + sine.phase_rad);
                        position_m[axis] += sine.amplitude_m * sin;
                        velocity_mps[axis] += sine.amplitude_m * rate * cos;
                    }
                }
                (position_m, velocity_mps)
            }
            Self::Throw(throw) => throw.at(time_s),
        }
    }

    /// Returns the direction of motion about the vertical, in radians; 0 for vertical motion. At rest it is
    /// the next direction of motion, or the last one.
    pub fn course_rad(&self, time_s: f64) -> f64 {
        /// Speed below which an object counts as at rest, in m/s.
        const REST_MPS: f64 = 1e-9;
        let velocity = match self {
            Self::Waypoints(waypoints) => {
                let [first, last] = waypoints.span_s();
                let inside = 1e-3 * (last - first);
                waypoints.at(time_s.clamp(first + inside, last - inside)).1
            }
            Self::Throw(throw) => throw.velocity_mps,
            _ => self.at(time_s).1,
        };
        if velocity.xy().norm() < REST_MPS {
            return 0.0;
        }
        libm::atan2(velocity.y, velocity.x)
    }
}

/// A smooth curve through points: cubic Hermite with slopes from neighbouring points (Catmull and Rom 1974).
/// It is at rest before the first point and after the last; its velocity is continuous in between.
#[derive(Debug, Clone, PartialEq)]
pub struct Waypoints {
    times_s: Vec<f64>,
    positions_m: Vec<Vector3<f64>>,
}

impl Waypoints {
    /// Creates a curve through two or more points at ascending times.
    pub fn new(times_s: Vec<f64>, positions_m: Vec<Vector3<f64>>) -> Result<Self, Error> {
        if times_s.len() < 2 || times_s.len() != positions_m.len() {
            return Err(Error::out_of_range(
                "times_s",
                format!("{} times for {} points", times_s.len(), positions_m.len()),
                "two or more points in positions_m, with one time each",
            ));
        }
        if let Some([before, after]) = times_s.array_windows().find(|[a, b]| !(b > a)) {
            return Err(Error::out_of_range(
                "times_s",
                format!("{after} after {before}"),
                "ascending times",
            ));
        }
        Ok(Self {
            times_s,
            positions_m,
        })
    }

    /// Returns the first and the last time.
    fn span_s(&self) -> [f64; 2] {
        [self.times_s[0], self.times_s[self.times_s.len() - 1]]
    }

    /// Returns the velocity at a point; zero at the ends.
    fn slope(&self, point: usize) -> Vector3<f64> {
        if point == 0 || point + 1 == self.times_s.len() {
            return Vector3::zeros();
        }
        (self.positions_m[point + 1] - self.positions_m[point - 1])
            / (self.times_s[point + 1] - self.times_s[point - 1])
    }

    fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let last = self.times_s.len() - 1;
        let after = self.times_s.partition_point(|&t| t <= time_s);
        if after == 0 {
            return (self.positions_m[0], Vector3::zeros());
        }
        if after > last {
            return (self.positions_m[last], Vector3::zeros());
        }
        let (a, b) = (after - 1, after);
        let h = self.times_s[b] - self.times_s[a];
        let s = (time_s - self.times_s[a]) / h;
        let (p, q) = (self.positions_m[a], self.positions_m[b]);
        let (u, v) = (self.slope(a) * h, self.slope(b) * h);
        // Power basis of the Hermite cubic.
        let (c2, c3) = ((q - p) * 3.0 - u * 2.0 - v, (p - q) * 2.0 + u + v);
        (
            p + (u + (c2 + c3 * s) * s) * s,
            (u + (c2 * 2.0 + c3 * (3.0 * s)) * s) / h,
        )
    }
}

/// A throw under gravity that bounces at a given height and finally rolls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Throw {
    /// Starting point, where the object rests until the throw.
    pub position_m: Vector3<f64>,
    /// Initial velocity in m/s.
    pub velocity_mps: Vector3<f64>,
    /// Time of the throw in seconds.
    pub start_s: f64,
    /// Height of `position_m.z` at which it bounces: the radius for a ball on the floor.
    pub rest_z_m: f64,
    /// Vertical speed after a bounce divided by the speed before, from 0 to below 1.
    pub bounce: f64,
    /// The drag coefficient in 1/m, and w in 1/s, which is along the axis of the spin: to the acceleration of gravity air adds
    /// −drag · |v| · v + w × v.
    pub air: (f64, Vector3<f64>),
}

/// Gravity in m/s².
const GRAVITY_MPS2: f64 = 9.81;
/// Step in seconds in which flights in air are integrated.
const STEP_S: f64 = 1e-3;
/// Rebound speed in m/s below which the object rolls instead.
const ROLLS_BELOW_MPS: f64 = 0.05;

impl Throw {
    /// The default share of the vertical speed that a bounce leaves.
    pub const DEFAULT_RESTITUTION: f64 = 0.7;

    fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let elapsed_s = time_s - self.start_s;
        if elapsed_s < 0.0 {
            return (self.position_m, Vector3::zeros());
        }
        if self.air != (0.0, Vector3::zeros()) {
            return self.in_air(elapsed_s);
        }
        let (mut z, mut vz) = (self.position_m.z - self.rest_z_m, self.velocity_mps.z);
        let mut left_s = elapsed_s;
        // Speeds shrink by the factor `bounce` each time, so that the loop ends.
        loop {
            let flight_s = (vz + (vz * vz + 2.0 * GRAVITY_MPS2 * z.max(0.0)).sqrt()) / GRAVITY_MPS2;
            if left_s < flight_s {
                z += (vz - 0.5 * GRAVITY_MPS2 * left_s) * left_s;
                vz -= GRAVITY_MPS2 * left_s;
                break;
            }
            left_s -= flight_s;
            vz = self.bounce * (GRAVITY_MPS2 * flight_s - vz);
            z = 0.0;
            if vz < ROLLS_BELOW_MPS {
                vz = 0.0;
                break;
            }
        }
        let velocity = self.velocity_mps;
        let mut position_m = self.position_m + velocity * elapsed_s;
        position_m.z = self.rest_z_m + z;
        (position_m, Vector3::new(velocity.x, velocity.y, vz))
    }

    /// The same in air, integrated by Runge and Kutta's method of fourth order in steps of a millisecond. Within a step, a bounce is where the body would be below.
    fn in_air(&self, elapsed_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (drag, spin) = self.air;
        let acceleration = |v: &Vector3<f64>| {
            Vector3::new(0.0, 0.0, -GRAVITY_MPS2) - drag * v.norm() * v + spin.cross(v)
        };
        let step = |position: &Vector3<f64>, velocity: &Vector3<f64>, h: f64| {
            let a1 = acceleration(velocity);
            let a2 = acceleration(&(velocity + 0.5 * h * a1));
            let a3 = acceleration(&(velocity + 0.5 * h * a2));
            let a4 = acceleration(&(velocity + h * a3));
            (
                position + h * velocity + h * h / 6.0 * (a1 + a2 + a3),
                velocity + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4),
            )
        };
        let (mut position, mut velocity) = (self.position_m, self.velocity_mps);
        let mut left_s = elapsed_s;
        while left_s > 0.0 {
            let h = left_s.min(STEP_S);
            let (mut next, mut next_velocity) = step(&position, &velocity, h);
            if next.z < self.rest_z_m && next_velocity.z < 0.0 {
                // Within a step the way down is straight.
                let until_s = h * (position.z - self.rest_z_m) / (position.z - next.z);
                (next, next_velocity) = step(&position, &velocity, until_s);
                next.z = self.rest_z_m;
                next_velocity.z *= -self.bounce;
                left_s -= until_s;
                if next_velocity.z < ROLLS_BELOW_MPS {
                    // It slides on at the speed that it has.
                    next_velocity.z = 0.0;
                    return (next + left_s * next_velocity, next_velocity);
                }
            } else {
                left_s -= h;
            }
            (position, velocity) = (next, next_velocity);
        }
        (position, velocity)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths() -> Vec<Path> {
        let sine = |amplitude_m, period_s, phase_rad| Sine {
            amplitude_m,
            period_s,
            phase_rad,
        };
        vec![
            Path::Still {
                position_m: Vector3::new(1.0, 2.0, 3.0),
            },
            Path::Line {
                position_m: Vector3::new(1.0, 2.0, 3.0),
                velocity_mps: Vector3::new(-0.3, 0.2, 0.1),
            },
            Path::Circle {
                center_m: Vector3::new(0.0, 1.0, 0.2),
                radius_m: 0.7,
                period_s: -3.0,
                phase_rad: 0.4,
            },
            Path::Waypoints(
                Waypoints::new(
                    vec![0.5, 1.0, 2.5, 3.0],
                    [0.0, 1.0, -1.0, 0.5]
                        .map(|x| Vector3::new(x, 1.0 - x, x * x))
                        .to_vec(),
                )
                .unwrap(),
            ),
            Path::Harmonic {
                center_m: Vector3::new(0.5, 0.5, 0.2),
                sines: [
                    vec![sine(0.2, 2.0, 0.0), sine(0.05, 0.7, 1.0)],
                    vec![sine(0.1, 3.0, 2.0)],
                    vec![],
                ],
            },
            Path::Throw(Throw {
                position_m: Vector3::new(0.0, 0.0, 1.0),
                velocity_mps: Vector3::new(1.0, 0.5, 1.0),
                start_s: 0.2,
                rest_z_m: 0.1,
                bounce: 0.6,
                air: (0.0, Vector3::zeros()),
            }),
        ]
    }

    #[test]
    fn velocities_are_derivatives_of_positions() {
        const H: f64 = 1e-6;
        for path in paths() {
            let mut jumps = 0;
            for i in 0..400 {
                let t = f64::from(i) * 0.01 + 0.0012;
                let difference = (path.at(t + H).0 - path.at(t - H).0) / (2.0 * H);
                jumps += i32::from((difference - path.at(t).1).norm() > 1e-6);
            }
            assert_eq!(jumps, 0, "{path:?}");
        }
    }

    #[test]
    fn waypoint_curve_passes_its_points_and_rests_at_its_ends() {
        let points = [[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [1.0, 3.0, 1.0]].map(Vector3::from);
        let path = Path::Waypoints(Waypoints::new(vec![1.0, 1.5, 4.0], points.to_vec()).unwrap());
        for (time_s, point) in [1.0, 1.5, 4.0].into_iter().zip(points) {
            assert!((path.at(time_s).0 - point).norm() < 1e-12);
        }
        assert_eq!(path.at(-5.0), (points[0], Vector3::zeros()));
        assert_eq!(path.at(9.0), (points[2], Vector3::zeros()));
        // Points towards (1, 2), after a first segment that bends towards y.
        assert!(path.course_rad(0.0) > 0.8 && path.course_rad(0.0) < 1.6);
        assert!(Waypoints::new(vec![1.0, 1.0, 2.0], points.to_vec()).is_err());
        assert!(Waypoints::new(vec![1.0, 2.0], points.to_vec()).is_err());
    }

    #[test]
    fn throw_loses_speed_with_each_bounce_and_finally_rolls() {
        let throw = Throw {
            position_m: Vector3::new(0.0, 0.0, 1.1),
            velocity_mps: Vector3::new(2.0, 0.0, 0.0),
            start_s: 1.0,
            rest_z_m: 0.1,
            bounce: 0.5,
            air: (0.0, Vector3::zeros()),
        };
        assert_eq!(throw.at(0.5), (throw.position_m, Vector3::zeros()));
        // It falls 1 m in sqrt(2 / g) and rises to a quarter of that height.
        let fall_s = (2.0 / GRAVITY_MPS2).sqrt();
        assert!((throw.at(1.0 + fall_s).0.z - 0.1).abs() < 1e-9);
        assert!((throw.at(1.0 + 1.5 * fall_s).0.z - 0.35).abs() < 1e-9);
        let (position_m, velocity_mps) = throw.at(9.0);
        assert_eq!(position_m.z, 0.1);
        assert_eq!(velocity_mps, Vector3::new(2.0, 0.0, 0.0));
    }

    #[test]
    fn a_throw_in_the_thinnest_air_is_that_in_none_and_air_brakes_and_turns_it() {
        let throw = |air| Throw {
            position_m: Vector3::new(0.3, -0.2, 1.2),
            velocity_mps: Vector3::new(3.0, 0.5, 1.5),
            start_s: 0.2,
            rest_z_m: 0.1,
            bounce: 0.7,
            air,
        };
        let none = throw((0.0, Vector3::zeros()));
        let thinnest = throw((1e-12, Vector3::zeros()));
        for step in 0..60 {
            let time_s = 0.04 * f64::from(step);
            let off = none.at(time_s).0 - thinnest.at(time_s).0;
            // A bounce is found within its step of a millisecond.
            assert!(off.norm() < 1e-4, "{time_s}: {off}");
        }
        let braked = throw((0.2, Vector3::zeros())).at(0.6).0;
        assert!(braked.x < none.at(0.6).0.x - 0.05, "{braked}");
        // Spin about the vertical turns it to the left, and topspin pulls it down.
        let turned = throw((0.0, Vector3::new(0.0, 0.0, 0.5))).at(0.6).0;
        assert!(turned.y > none.at(0.6).0.y + 0.05, "{turned}");
        let topspin = throw((0.0, Vector3::new(0.0, 0.5, 0.0))).at(0.6).0;
        assert!(topspin.z < none.at(0.6).0.z - 0.05, "{topspin}");
    }
}
