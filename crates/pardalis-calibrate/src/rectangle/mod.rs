//! Detection of the one rectangle that stands out in images: tape on a floor, or a filled patch.
//!
//! Its corners calibrate a camera that sees a plane, without a board ([`plane`](crate::plane)).
//!
//! ```
//! use pardalis_calibrate::plane::{Rectangle, fit};
//! use pardalis_calibrate::rectangle::{Edge, detect};
//! use pardalis_images::RgbImage;
//!
//! // A white patch on a dark floor.
//! let image = RgbImage::from_fn(320, 240, |u, v| {
//!     let is_patch = (80..240).contains(&u) && (60..180).contains(&v);
//!     if is_patch { [220; 3] } else { [60; 3] }
//! });
//! let found = detect(&[image], Edge::Outer)?;
//! assert!(found.is_bright && !found.is_tape);
//! // The corner nearest to the bottom left comes first, between columns 79 and 80 and rows 179 and 180.
//! let [u, v] = found.corners_px[0];
//! assert!((u - 79.5).abs() < 0.1 && (v - 179.5).abs() < 0.1);
//!
//! // Its sides are known to be 2 m and 1.5 m long.
//! let plane = fit(&Rectangle::of_size([2.0, 1.5]).pairs(found.corners_px))?;
//! let center_m = plane.homography.plane_of([159.5, 119.5]).expect("is on the plane");
//! assert!((center_m[0] - 1.0).abs() < 0.01 && (center_m[1] - 0.75).abs() < 0.01);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Method
//!
//! In the mean of all images, straight edges are combined to quadrilaterals that are brighter on one side along all four
//! edges and can be the image of a rectangle. The most conspicuous of them must clearly stand out. Its sides are then
//! measured in each image, and a tape is fitted as a whole to the median of all images.

mod canny;
mod error;
mod hough;
mod lines;
mod quads;
mod sides;
mod tape;

use pardalis_core::srgb::linear_from_srgb;
use pardalis_images::{GrayImage, RgbImage};

use error::MIN_VISIBLE_FRACTION;
use quads::Quad;
use sides::{Light, Measured, measure, median};

pub use error::RectangleNotFound;

/// Longer side at which larger images are searched.
const SEARCH_SIDE_PX: f64 = 800.0;

/// Quadrilaterals are edges of the same rectangle if their corners differ by at most this fraction of their size plus this
/// distance.
const SAME_CORNER_FRACTION: f64 = 0.15;
const SAME_CORNER_PX: f64 = 4.0;

/// Least fraction of each side of a patch with an edge.
const MIN_PATCH_SUPPORT: f64 = 0.8;

/// The choice is ambiguous if another rectangle has more than this fraction of the best one's conspicuousness.
const AMBIGUOUS_FRACTION: f64 = 0.6;

/// Greatest scatter of the corners between images.
const MAX_SCATTER_PX: f64 = 1.5;

/// Pixels with at least this level in any channel may be saturated.
const SATURATED: u8 = 250;

/// Least fraction of the images in which the rectangle must be measurable.
const MIN_MEASURED_FRACTION: f64 = 0.5;

/// Edge of a tape to locate; a filled patch has only one edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Edge {
    /// Outer edge.
    Outer,
    /// Inner edge.
    Inner,
}

/// A rectangle detected in images.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectedRectangle {
    /// Corners in pixels, counter-clockwise as seen in the image, from the one nearest to its bottom left. For tape from
    /// a fit to all images, for a patch medians over the images. Pixel centres have integer coordinates.
    pub corners_px: [[f64; 2]; 4],
    /// Whether the tape or patch is brighter than its surroundings.
    pub is_bright: bool,
    /// Whether it is tape, with an edge inside as well.
    pub is_tape: bool,
    /// For the side from each corner to the next, the fraction with a visible edge.
    pub support: [f64; 4],
    /// Root mean square distance of the corners in single images from their medians, in pixels; `None` for a single
    /// image.
    pub scatter_px: Option<f64>,
    /// Root mean square distance of the edges from straight lines, in pixels.
    pub line_rms_px: f64,
}

/// Detects the one rectangle that stands out in one or more images of a camera that does not move.
///
/// Further images reduce noise and remove objects that move. Brightness is searched first, then red, green and blue.
/// Lenses must hardly bend straight lines.
pub fn detect(images: &[RgbImage], edge: Edge) -> Result<DetectedRectangle, RectangleNotFound> {
    if images
        .windows(2)
        .any(|pair| pair[0].dimensions() != pair[1].dimensions())
    {
        return Err(RectangleNotFound::SizesDiffer);
    }
    let mut first_error = None;
    for channel in [luma, red, green, blue] {
        match detect_in(images, channel, edge) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => {}
            Err(error) => first_error = first_error.or(Some(error)),
        }
    }
    Err(first_error.unwrap_or(RectangleNotFound::NotInView))
}

/// One value of a pixel's red, green and blue.
type Channel = fn([u8; 3]) -> u8;

fn luma([r, g, b]: [u8; 3]) -> u8 {
    ((299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b) + 500) / 1000) as u8
}

fn red(rgb: [u8; 3]) -> u8 {
    rgb[0]
}

fn green(rgb: [u8; 3]) -> u8 {
    rgb[1]
}

fn blue(rgb: [u8; 3]) -> u8 {
    rgb[2]
}

/// Returns the image at the size at which it is searched, and the scale of that size.
fn reduced(mean: &GrayImage) -> (GrayImage, f64) {
    let longer_px = f64::from(mean.width().max(mean.height()));
    let scale = (SEARCH_SIDE_PX / longer_px).min(1.0);
    let side = |px: u32| ((f64::from(px) * scale).round() as u32).max(1);
    let level = mean.resized(side(mean.width()), side(mean.height()));
    (level, scale)
}

/// The most conspicuous rectangle in an image: the quadrilaterals of a tape's edges, in pixels. They are equal for a patch.
struct Candidate {
    outer: Quad,
    inner: Quad,
    is_tape: bool,
}

impl Candidate {
    fn edge(&self, edge: Edge) -> &Quad {
        match edge {
            Edge::Outer => &self.outer,
            Edge::Inner => &self.inner,
        }
    }
}

/// Searches an image for the rectangle; `None` if there is none.
fn search(image: &GrayImage) -> Result<Option<Candidate>, RectangleNotFound> {
    let (level, scale) = reduced(image);
    let size_px = [f64::from(level.width()), f64::from(level.height())];
    let lines = lines::find(&level);
    let rectangles = quads::find(&lines, size_px).into_iter().filter_map(|quad| {
        let other = quads::other_edge(&quad, &lines);
        // A tape is recognised by its two edges, so that parts may be occluded. Any four edges could be a patch.
        let is_whole = quad.support.iter().all(|share| *share >= MIN_PATCH_SUPPORT);
        (other.is_some() || is_whole).then_some((quad, other))
    });
    // Pixel centres, not borders, have integer coordinates.
    let to_image = |corners: [[f64; 2]; 4]| corners.map(|p| p.map(|c| (c + 0.5) / scale - 0.5));
    let (visible, outside): (Vec<_>, Vec<_>) =
        rectangles.partition(|(quad, _)| quad.visible_fraction >= MIN_VISIBLE_FRACTION);
    let Some((best, other)) = visible.first().copied() else {
        return match outside.first() {
            None => Ok(None),
            Some((quad, _)) => Err(RectangleNotFound::OutsideImage {
                corners_px: to_image(quad.corners_px),
                visible_fraction: quad.visible_fraction,
            }),
        };
    };
    let rival = visible.iter().find(|(quad, _)| !is_same(&best, quad));
    if let Some((rival, _)) = rival.filter(|r| r.0.score > AMBIGUOUS_FRACTION * best.score) {
        return Err(RectangleNotFound::Ambiguous {
            corners_px: Box::new([best.corners_px, rival.corners_px].map(to_image)),
        });
    }
    let (outer, inner) = match other {
        Some(other) if other.area_px2() > best.area_px2() => (other, best),
        Some(other) => (best, other),
        None => (best, best),
    };
    let in_image = |quad: Quad| quad.with_corners(to_image(quad.corners_px));
    Ok(Some(Candidate {
        outer: in_image(outer),
        inner: in_image(inner),
        is_tape: other.is_some(),
    }))
}

/// Detects the rectangle in one channel of images of one size; `None` if there is none.
fn detect_in(
    images: &[RgbImage],
    channel: Channel,
    edge: Edge,
) -> Result<Option<DetectedRectangle>, RectangleNotFound> {
    let levels: Vec<GrayImage> = images
        .iter()
        .map(|image| image.map(|rgb| [channel(rgb)]))
        .collect();
    let Some(mean) = mean_of(&levels) else {
        return Ok(None);
    };
    let Some(rectangle) = search(&mean)? else {
        return Ok(None);
    };
    let wanted = rectangle.edge(edge);
    let measured: Vec<Measured> = levels
        .iter()
        .filter_map(|image| measure(&linear(image), wanted))
        .collect();
    if (measured.len() as f64) < MIN_MEASURED_FRACTION * levels.len() as f64 || measured.is_empty()
    {
        return Err(RectangleNotFound::MeasuredInFewImages {
            corners_px: wanted.corners_px,
            measured: measured.len(),
            images: images.len(),
        });
    }
    let first = nearest_bottom_left(wanted.corners_px, f64::from(mean.height()));
    let turned = |i: usize| (first + i) % 4;
    let corner = |i: usize| {
        [0, 1].map(|c| {
            median(
                measured
                    .iter()
                    .map(|m| m.corners_px[turned(i)][c])
                    .collect(),
            )
            .unwrap_or_default()
        })
    };
    let corners_px = [0, 1, 2, 3].map(corner);
    let rms = |squares: f64, count: usize| (squares / count as f64).sqrt();
    let distances = measured.iter().flat_map(|m| {
        (0..4).map(move |i| {
            let ([u, v], [u0, v0]) = (m.corners_px[turned(i)], corners_px[i]);
            (u - u0).powi(2) + (v - v0).powi(2)
        })
    });
    let scatter_px = rms(distances.sum(), 4 * measured.len());
    if scatter_px > MAX_SCATTER_PX {
        return Err(RectangleNotFound::Moving {
            corners_px,
            scatter_px,
        });
    }
    let fitted_px =
        fitted_tape(images, channel, &rectangle).map(|[outer_px, inner_px]| match edge {
            Edge::Outer => outer_px,
            Edge::Inner => inner_px,
        });
    Ok(Some(DetectedRectangle {
        corners_px: fitted_px.map_or(corners_px, |fitted_px| {
            [0, 1, 2, 3].map(|i| fitted_px[turned(i)])
        }),
        is_bright: rectangle.outer.inside_is_brighter,
        is_tape: rectangle.is_tape,
        support: [0, 1, 2, 3].map(|i| wanted.support[turned(i)]),
        scatter_px: (measured.len() > 1).then_some(scatter_px),
        line_rms_px: rms(
            measured.iter().map(|m| m.rms_px.powi(2)).sum(),
            measured.len(),
        ),
    }))
}

/// Returns the linear light of an image, 0 to 255: a pixel on an edge has the mean of the light of both sides, not of their
/// sRGB levels.
fn linear(image: &GrayImage) -> Light {
    let light = |level: u8| (255.0 * linear_from_srgb([f64::from(level); 3])[0]) as f32;
    let table: [f32; 256] = std::array::from_fn(|level| light(level as u8));
    image.map(|[level]| [table[usize::from(level)]])
}

/// Fits the outer and the inner edge of a tape to all images together; `None` for a patch, or if too little is visible.
fn fitted_tape(
    images: &[RgbImage],
    channel: Channel,
    rectangle: &Candidate,
) -> Option<[[[f64; 2]; 4]; 2]> {
    let still = median_of(images).filter(|_| rectangle.is_tape)?;
    let light = linear(&still.map(|rgb| [channel(rgb)]));
    let is_saturated = |x, y| still.get_pixel(x, y).iter().any(|c| *c >= SATURATED);
    let [outer, inner] = [&rectangle.outer, &rectangle.inner].map(|quad| measure(&light, quad));
    tape::fitted(&light, is_saturated, &outer?, &inner?)
}

/// Returns the median of each pixel over images of one size, without noise and moving objects.
fn median_of(images: &[RgbImage]) -> Option<RgbImage> {
    let first = images.first()?;
    let median_at = |x: u32, y: u32| {
        let colors: Vec<[u8; 3]> = images.iter().map(|image| image.get_pixel(x, y)).collect();
        let median = |c: usize| {
            let mut levels: Vec<u8> = colors.iter().map(|color| color[c]).collect();
            *levels.select_nth_unstable(colors.len() / 2).1
        };
        [0, 1, 2].map(median)
    };
    Some(RgbImage::from_fn(first.width(), first.height(), median_at))
}

/// Returns the mean of images of one size, in which noise and moving objects have little weight.
fn mean_of(images: &[GrayImage]) -> Option<GrayImage> {
    let first = images.first()?;
    let mut sums = vec![0_u32; first.as_raw().len()];
    for image in images {
        for (sum, value) in sums.iter_mut().zip(image.as_raw()) {
            *sum += u32::from(*value);
        }
    }
    let count = images.len() as u32;
    let means = sums.iter().map(|sum| ((sum + count / 2) / count) as u8);
    GrayImage::from_raw(first.width(), first.height(), means.collect())
}

/// Reports whether two quadrilaterals are edges of one rectangle.
fn is_same(a: &Quad, b: &Quad) -> bool {
    let limit_px = SAME_CORNER_FRACTION * a.area_px2().sqrt() + SAME_CORNER_PX;
    (0..4).any(|turn| {
        (0..4).all(|i| {
            let ([u, v], [u2, v2]) = (a.corners_px[i], b.corners_px[(i + turn) % 4]);
            libm::hypot(u - u2, v - v2) <= limit_px
        })
    })
}

/// Returns the index of the corner nearest to the bottom left of an image of this height.
fn nearest_bottom_left(corners_px: [[f64; 2]; 4], height_px: f64) -> usize {
    let distance = |i: &usize| libm::hypot(corners_px[*i][0], height_px - 1.0 - corners_px[*i][1]);
    let nearest = (0..4).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.unwrap_or_default()
}
