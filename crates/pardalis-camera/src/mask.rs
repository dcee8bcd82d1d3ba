//! Which pixels of a camera carry evidence: not the robot's own body, a bar, a mirror's housing or rim.

use pardalis_core::Error;

/// The pixels of one camera that carry evidence; at least one does.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: usize,
    height: usize,
    open: Vec<bool>,
}

impl Mask {
    /// From grey values, row by row: 128 and more is used, darker is not.
    pub fn from_grey(width: usize, height: usize, grey: &[u8]) -> Result<Self, Error> {
        if grey.len() != width * height {
            return Err(Error::ImageBytes {
                expected: width * height,
                found: grey.len(),
            });
        }
        Self::checked(width, height, grey.iter().map(|&g| g >= 128).collect())
    }

    /// The pixels whose centres lie within `radius_px` of `center_px`.
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

    /// The pixels that both masks use.
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
                remedy: "paint white (128 or more) what the camera may use, black what it may not"
                    .to_owned(),
            });
        }
        Ok(Self {
            width,
            height,
            open,
        })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One entry a pixel, row by row: whether it carries evidence.
    pub fn open(&self) -> &[bool] {
        &self.open
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_combine_and_never_close_the_whole_image() {
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
