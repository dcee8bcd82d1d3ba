//! Masks that exclude pixels of a camera: the robot's own body, a bar, the housing or rim of a
//! mirror.

use pardalis_core::Error;

/// The set of usable pixels of a camera. It is never empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: usize,
    height: usize,
    open: Vec<bool>,
}

impl Mask {
    /// Creates a mask from grey values in row-major order: pixels of 128 and above are usable.
    pub fn from_grey(width: usize, height: usize, grey: &[u8]) -> Result<Self, Error> {
        if grey.len() != width * height {
            return Err(Error::ImageBytes {
                expected: width * height,
                found: grey.len(),
            });
        }
        Self::checked(width, height, grey.iter().map(|&g| g >= 128).collect())
    }

    /// Creates a mask of the pixels whose centres lie within `radius_px` of `center_px`.
    pub fn from_radius(
        width: usize,
        height: usize,
        center_px: [f64; 2],
        radius_px: f64,
    ) -> Result<Self, Error> {
        if !(radius_px.is_finite() && radius_px > 0.0) {
            return Err(Error::out_of_range(
                "radius_px",
                radius_px,
                "a positive number of pixels",
            ));
        }
        let mut open = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let (dx, dy) = (x as f64 - center_px[0], y as f64 - center_px[1]);
                open.push(dx * dx + dy * dy <= radius_px * radius_px);
            }
        }
        Self::checked(width, height, open)
    }

    /// Returns the intersection of two masks.
    pub fn and(&self, other: &Self) -> Result<Self, Error> {
        if (self.width, self.height) != (other.width, other.height) {
            return Err(Error::SizeMismatch {
                what: "the mask".to_owned(),
                expected: (self.width, self.height),
                found: (other.width, other.height),
            });
        }
        let open = self
            .open
            .iter()
            .zip(&other.open)
            .map(|(&a, &b)| a && b)
            .collect();
        Self::checked(self.width, self.height, open)
    }

    fn checked(width: usize, height: usize, open: Vec<bool>) -> Result<Self, Error> {
        if !open.contains(&true) {
            return Err(Error::Empty {
                what: "the mask".to_owned(),
                remedy: "paint usable pixels white (128 or more) and all others black".to_owned(),
            });
        }
        Ok(Self {
            width,
            height,
            open,
        })
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns one entry per pixel in row-major order: whether the pixel is usable.
    pub fn open(&self) -> &[bool] {
        &self.open
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_intersect_and_are_never_empty() {
        let disc = Mask::from_radius(5, 4, [2.0, 1.0], 1.0).unwrap();
        assert_eq!(disc.open().iter().filter(|&&o| o).count(), 5);
        let grey: Vec<u8> = (0..20).map(|i| if i % 5 < 3 { 255 } else { 127 }).collect();
        let left = Mask::from_grey(5, 4, &grey).unwrap();
        assert_eq!(
            disc.and(&left)
                .unwrap()
                .open()
                .iter()
                .filter(|&&o| o)
                .count(),
            4
        );
        assert!(Mask::from_grey(5, 4, &[0; 20]).is_err());
        assert!(Mask::from_grey(5, 4, &[255; 19]).is_err());
        assert!(Mask::from_radius(5, 4, [100.0, 0.0], 3.0).is_err());
        assert!(Mask::from_radius(5, 4, [2.0, 1.0], f64::NAN).is_err());
        assert!(
            disc.and(&Mask::from_radius(4, 5, [2.0, 1.0], 1.0).unwrap())
                .is_err()
        );
    }
}
