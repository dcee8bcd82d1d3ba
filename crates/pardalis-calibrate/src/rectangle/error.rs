//! Reasons why no rectangle was detected.

use super::quads::MIN_SIDE_FRACTION;

/// Least fraction of each side inside the image.
pub(super) const MIN_VISIBLE_FRACTION: f64 = 0.5;

/// The reason why no rectangle was detected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RectangleNotFound {
    /// No rectangle stands out, or there are no images.
    #[error(
        "there is no rectangle that stands out; needed: four straight sides in the image, of tape or a patch that is brighter or darker than the floor, each at least {:.0} % of the image's height long",
        100.0 * MIN_SIDE_FRACTION
    )]
    NotInView,
    /// The images differ in size.
    #[error("the images have different sizes; all images must come from one camera")]
    SizesDiffer,
    /// Too much of a side is outside the image.
    #[error(
        "the rectangle with corners at {} has a side with only {:.0} % in the image; needed: {:.0} %; move it into view",
        listed(.corners_px), 100.0 * .visible_fraction, 100.0 * MIN_VISIBLE_FRACTION
    )]
    OutsideImage {
        /// Corners in pixels.
        corners_px: [[f64; 2]; 4],
        /// Fraction of the side inside the image.
        visible_fraction: f64,
    },
    /// Several rectangles are similarly conspicuous.
    #[error(
        "several rectangles stand out, such as those with corners at {} and {}; leave only one in view, or give its corners by hand",
        listed(&.corners_px[0]), listed(&.corners_px[1])
    )]
    Ambiguous {
        /// Corners of two of the rectangles, in pixels.
        corners_px: Box<[[[f64; 2]; 4]; 2]>,
    },
    /// The rectangle's edges are visible in too few images.
    #[error(
        "the rectangle with corners at {} can be measured in only {measured} of {images} images; keep its sides in view and the camera still",
        listed(.corners_px)
    )]
    MeasuredInFewImages {
        /// Corners in pixels.
        corners_px: [[f64; 2]; 4],
        /// Number of images in which it can be measured.
        measured: usize,
        /// Number of images.
        images: usize,
    },
    /// The rectangle moves in the images.
    #[error(
        "the corners of the rectangle at {} vary between images by {scatter_px:.1} px (RMS); keep the camera still and the rectangle in view",
        listed(.corners_px)
    )]
    Moving {
        /// Corners in pixels, medians over all images.
        corners_px: [[f64; 2]; 4],
        /// Root mean square distance of single images' corners from them, in pixels.
        scatter_px: f64,
    },
}

/// Formats corners for a message.
fn listed(corners_px: &[[f64; 2]; 4]) -> String {
    let corners = corners_px.map(|[u, v]| format!("({u:.0}, {v:.0})"));
    corners.join(" ")
}
