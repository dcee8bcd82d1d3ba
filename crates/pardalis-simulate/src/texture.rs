//! Surface colours as functions of a point in space.

use nalgebra::Vector3;

use pardalis_core::rng::philox4x32_10;

/// Two colours and the pattern in which they alternate.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Pattern.
    pub pattern: Pattern,
    /// The two colours: linear red, green and blue, 0 to 1.
    pub colors: [[f64; 3]; 2],
}

/// Pattern of two colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pattern {
    /// The first colour everywhere.
    Plain,
    /// Alternating cubes (squares on a plane).
    Checker {
        /// Side of a cube in metres.
        size_m: f64,
    },
    /// Layers perpendicular to a horizontal direction (stripes on a plane).
    Stripes {
        /// Thickness of a layer in metres.
        width_m: f64,
        /// Direction about the vertical from the x axis, in radians.
        turn_rad: f64,
    },
    /// Smooth value noise (Perlin's lattice, Hermite weights); each octave has half the size and half the
    /// weight of the previous one.
    Noise {
        /// Lattice spacing of the coarsest octave in metres.
        size_m: f64,
        /// Number of octaves.
        octaves: u32,
    },
}

impl Pattern {
    /// Default number of octaves of noise.
    pub const DEFAULT_OCTAVES: u32 = 4;
}

impl Texture {
    /// Returns the colour at a point in metres. `key` separates the noise of different surfaces.
    pub(super) fn color_at(&self, point_m: &Vector3<f64>, key: [u32; 2]) -> Vector3<f64> {
        let [first, second] = self.colors.map(Vector3::from);
        let odd = |cell: f64| f64::from(cell.rem_euclid(2.0) >= 1.0);
        let share = match self.pattern {
            Pattern::Plain => 0.0,
            Pattern::Checker { size_m } => odd(point_m.iter().map(|c| (c / size_m).floor()).sum()),
            Pattern::Stripes { width_m, turn_rad } => {
                let (sin, cos) = libm::sincos(turn_rad);
                odd(((cos * point_m.x + sin * point_m.y) / width_m).floor())
            }
            Pattern::Noise { size_m, octaves } => noise(point_m / size_m, octaves, key),
        };
        first + (second - first) * share
    }
}

/// Returns noise from 0 to 1 with a mean of one half.
fn noise(point: Vector3<f64>, octaves: u32, key: [u32; 2]) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    let (mut point, mut weight) = (point, 1.0);
    for octave in 0..octaves {
        sum += weight * smooth_noise(&point, octave, key);
        weights += weight;
        weight *= 0.5;
        point *= 2.0;
    }
    sum / weights
}

fn smooth_noise(point: &Vector3<f64>, octave: u32, key: [u32; 2]) -> f64 {
    let cell = point.map(f64::floor);
    let share = (point - cell).map(|s| s * s * (3.0 - 2.0 * s));
    let mut sum = 0.0;
    for corner in 0..8_u32 {
        let bit = |axis: usize| corner >> axis & 1 == 1;
        let weight: f64 = (0..3)
            .map(|a| if bit(a) { share[a] } else { 1.0 - share[a] })
            .product();
        // Flat surfaces that coincide with the lattice need only half of the corners.
        if weight > 0.0 {
            let lattice = |axis: usize| (cell[axis] as i64 + i64::from(bit(axis))) as u32;
            let words = philox4x32_10([lattice(0), lattice(1), lattice(2), octave], key);
            sum += weight * f64::from(words[0]) / f64::from(u32::MAX);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_alternate_and_noise_is_smooth_and_within_its_colors() {
        let texture = |pattern| Texture {
            pattern,
            colors: [[0.0; 3], [1.0; 3]],
        };
        let red = |t: &Texture, x: f64, y: f64| t.color_at(&Vector3::new(x, y, 0.0), [1, 2]).x;
        let checker = texture(Pattern::Checker { size_m: 0.5 });
        assert_eq!(red(&checker, 0.1, 0.1), red(&checker, -0.1, -0.1));
        assert_ne!(red(&checker, 0.1, 0.1), red(&checker, -0.1, 0.1));
        let stripes = texture(Pattern::Stripes {
            width_m: 0.2,
            turn_rad: 0.0,
        });
        assert_eq!(red(&stripes, 0.1, 0.0), red(&stripes, 0.1, 7.3));
        assert_ne!(red(&stripes, 0.1, 0.0), red(&stripes, 0.3, 0.0));
        let noise = texture(Pattern::Noise {
            size_m: 0.5,
            octaves: 3,
        });
        let values: Vec<f64> = (0..4000)
            .map(|i| red(&noise, f64::from(i) * 1e-3, 0.3))
            .collect();
        assert!(values.iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(values.windows(2).all(|w| (w[1] - w[0]).abs() < 0.02));
        let spread =
            values.iter().copied().fold(0.0, f64::max) - values.iter().copied().fold(1.0, f64::min);
        assert!(spread > 0.3, "{spread}");
    }
}
