//! Flat shapes: discs and rectangles that lie level on the ground or at a fixed height above it.

use pardalis_core::Error;

/// Maximum size and height, in metres, or in pixels if the world is the image.
const MAX_SIZE: f64 = 100_000.0;

/// The form of a flat shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FlatForm {
    /// A disc.
    Disc {
        /// Radius in metres.
        radius_m: f64,
    },
    /// A rectangle with sides parallel to the world's x and y axes, unless it is turned.
    Rectangle {
        /// Sizes along x and y in metres.
        size_m: [f64; 2],
    },
}

/// A flat shape. Its position is the point of the ground below its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flat {
    /// Disc or rectangle.
    pub form: FlatForm,
    /// Height above the position in metres.
    pub height_m: f64,
}

impl Flat {
    /// Creates a disc.
    ///
    /// # Errors
    ///
    /// The radius is not above 0 and at most 100 000 m, or the height not within 0 to 100 000 m.
    pub fn disc(radius_m: f64, height_m: f64) -> Result<Self, Error> {
        check_size("radius_m", radius_m)?;
        Self::at(height_m, FlatForm::Disc { radius_m })
    }

    /// Creates a rectangle from its sizes along x and y.
    ///
    /// # Errors
    ///
    /// A size is not above 0 and at most 100 000 m, or the height not within 0 to 100 000 m.
    pub fn rectangle(size_m: [f64; 2], height_m: f64) -> Result<Self, Error> {
        for size_m in size_m {
            check_size("size_m", size_m)?;
        }
        Self::at(height_m, FlatForm::Rectangle { size_m })
    }

    fn at(height_m: f64, form: FlatForm) -> Result<Self, Error> {
        if !(0.0..=MAX_SIZE).contains(&height_m) {
            return Err(Error::out_of_range("height_m", height_m, "0 to 100000"));
        }
        Ok(Self { form, height_m })
    }

    /// Returns the sizes along x and y in metres.
    pub fn size_m(&self) -> [f64; 2] {
        match self.form {
            FlatForm::Disc { radius_m } => [2.0 * radius_m; 2],
            FlatForm::Rectangle { size_m } => size_m,
        }
    }

    /// Returns the least angle after which the shape looks the same again; `None` for a disc.
    pub(super) fn turn_period_rad(&self) -> Option<f64> {
        match self.form {
            FlatForm::Disc { .. } => None,
            FlatForm::Rectangle { size_m } => Some(period_of_rectangle_rad(size_m)),
        }
    }

    /// Returns `count` points of the outline relative to its centre, in metres along x and y,
    /// counterclockwise as seen from above. Points of a disc are evenly spaced, starting in the direction of
    /// x. Points of a rectangle start half a spacing after the corner of least x and y.
    pub(crate) fn outline_points_m(&self, count: usize) -> Vec<[f64; 2]> {
        let place = |k: usize| match self.form {
            FlatForm::Disc { radius_m } => {
                let angle = k as f64 / count as f64 * std::f64::consts::TAU;
                let (sin, cos) = libm::sincos(angle);
                [radius_m * cos, radius_m * sin]
            }
            FlatForm::Rectangle {
                size_m: [width, depth],
            } => {
                let mut rest = (k as f64 + 0.5) / count as f64 * 2.0 * (width + depth);
                let [right, back] = [0.5 * width, 0.5 * depth];
                if rest < width {
                    return [rest - right, -back];
                }
                rest -= width;
                if rest < depth {
                    return [right, rest - back];
                }
                rest -= depth;
                if rest < width {
                    return [right - rest, back];
                }
                [-right, back - (rest - width)]
            }
        };
        (0..count).map(place).collect()
    }
}

/// The least angle after which a rectangle of these sizes looks the same again, in radians.
pub(super) fn period_of_rectangle_rad([x, y]: [f64; 2]) -> f64 {
    if x == y {
        std::f64::consts::FRAC_PI_2
    } else {
        std::f64::consts::PI
    }
}

fn check_size(name: &str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value <= MAX_SIZE {
        return Ok(());
    }
    Err(Error::out_of_range(
        name,
        value,
        "above 0 and at most 100000",
    ))
}
