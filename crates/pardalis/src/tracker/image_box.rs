//! Boxes in images: what another program's detector found.

use pardalis_core::Error;

/// Greatest distance of a side of a box from the image's first pixel, pixels.
const MAX_PX: f64 = 1e6;

/// A box around a body in an image, by a detector other than this library: a neural network, a threshold, a person.
///
/// ```
/// use pardalis::tracker::ImageBox;
///
/// // A circle around (320, 240).
/// let found = ImageBox::around_circle([320.0, 240.0], 12.0)?.with_score(0.9)?;
/// assert_eq!(found.sides_px(), [308.0, 228.0, 332.0, 252.0]);
/// assert!(ImageBox::new([30.0, 0.0, 20.0, 10.0]).is_err(), "right of its right side");
/// # Ok::<(), pardalis::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageBox {
    sides_px: [f64; 4],
    score: Option<f64>,
}

impl ImageBox {
    /// Creates a box from its left, top, right and bottom side, in pixels. Pixel centres have integer coordinates: of detectors whose images begin at 0 (YOLO, COCO and
    /// others), subtract a half.
    ///
    /// Returns an error unless they are numbers within ±1e6, left of right and above bottom.
    pub fn new(sides_px: [f64; 4]) -> Result<Self, Error> {
        let [left, top, right, bottom] = sides_px;
        let is_number = sides_px.iter().all(|side| side.abs() <= MAX_PX);
        if is_number && left < right && top < bottom {
            return Ok(Self {
                sides_px,
                score: None,
            });
        }
        let allowed = "left, top, right and bottom within ±1e6 pixels, left less than right and top less than bottom";
        Err(Error::out_of_range("box", format!("{sides_px:?}"), allowed))
    }

    /// Creates the box around a circle, pixels.
    ///
    /// Returns an error as [`ImageBox::new`].
    pub fn around_circle([u, v]: [f64; 2], radius_px: f64) -> Result<Self, Error> {
        Self::new([u - radius_px, v - radius_px, u + radius_px, v + radius_px])
    }

    /// Sets the probability, in the detector's opinion, that it shows such a body. Without a score, it is as likely as not.
    ///
    /// Returns an error unless it lies within 0 and 1.
    pub fn with_score(mut self, score: f64) -> Result<Self, Error> {
        if !(0.0..=1.0).contains(&score) {
            return Err(Error::out_of_range("score", score, "0 to 1"));
        }
        self.score = Some(score);
        Ok(self)
    }

    /// Returns the left, top, right and bottom side, in pixels.
    pub fn sides_px(&self) -> [f64; 4] {
        self.sides_px
    }

    /// Returns the score, if there is one.
    pub fn score(&self) -> Option<f64> {
        self.score
    }
}

/// What a detector found of one target in the image of one camera.
#[derive(Debug, Clone)]
pub(super) struct CameraBoxes {
    /// The number of the camera.
    pub(super) camera: usize,
    /// The number of the target.
    pub(super) target: usize,
    /// Nothing if there are none.
    pub(super) boxes: Vec<ImageBox>,
}
