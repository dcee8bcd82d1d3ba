//! The rectangle that stands out in images: tape on a floor, or a filled patch.
//!
//! Straight edges (`lines`) are joined to quadrilaterals with edges along all their sides, everywhere brighter on the same side (`quads`), in the mean
//! of all images. The best of them must stand out; its sides are then measured in each image (`sides`), and a tape is fitted whole (`tape`).

mod canny;
mod hough;
mod in_scene;
mod lines;
mod quads;
mod sides;
mod tape;

use anyhow::Result;
use pardalis::Frame;
use pardalis_images::{GrayImage, RgbImage};
use pardalis_simulate::linear_from_srgb;

use crate::user_error::user_error;
pub(crate) use in_scene::{find_in_scene, first_frames};
use quads::Quad;
use sides::{Light, Measured, measure, median};

/// Larger images are searched at this length of their longer side.
const SEARCHED_SIDE_PX: f64 = 800.0;

/// Quadrilaterals whose corners lie within this share of their size, and so many pixels, are edges of one rectangle.
const SAME_CORNER_SHARE: f64 = 0.15;
const SAME_CORNER_PX: f64 = 4.0;

/// The least share of each side of a patch that has an edge.
const MIN_PATCH_SUPPORT: f64 = 0.8;

/// Another rectangle that stands out more than this share of the best makes the choice ambiguous.
const AMBIGUOUS_SHARE: f64 = 0.6;

/// The least share of each side that must lie in the image.
const MIN_SEEN_SHARE: f64 = 0.5;

/// The largest scatter of corners over images.
const MAX_SCATTER_PX: f64 = 1.5;

/// Pixels with this level in any colour may have been brighter than it says.
const SATURATED: u8 = 250;

/// The least share of images in which the rectangle can be measured.
const MIN_MEASURED_SHARE: f64 = 0.5;

/// Which edge of a tape is wanted; of a filled patch both are the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Edge {
    /// The outer one.
    Outer,
    /// The inner one.
    Inner,
}

/// A rectangle found in images.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FoundRectangle {
    /// Counter-clockwise to the eye, first the one nearest the image's bottom left: of a tape as it fits all images together, else the median over them.
    pub(crate) corners_px: [[f64; 2]; 4],
    /// Whether the tape or patch is brighter than what is around it.
    pub(crate) is_bright: bool,
    /// Whether it is a tape, with an edge inside as well.
    pub(crate) is_tape: bool,
    /// For the side from each corner to the next the share along which the edge was found.
    pub(crate) support: [f64; 4],
    /// How far the corners of single images lie from their medians, root mean square in pixels; none for a single image.
    pub(crate) scatter_px: Option<f64>,
    /// How far the edges lie from straight lines, root mean square in pixels.
    pub(crate) line_rms_px: f64,
}

/// Finds the one rectangle that stands out in one or more images of a camera that stands still.
///
/// Faults, as the end of a sentence about the images: there is no such rectangle, there are several, or much of it is outside the images.
pub(crate) fn find(frames: &[Frame], edge: Edge) -> Result<FoundRectangle> {
    let mut first_fault = None;
    for channel in [luma, red, green, blue] {
        match find_in(frames, channel, edge) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => {}
            Err(fault) => first_fault = first_fault.or(Some(fault)),
        }
    }
    Err(first_fault.unwrap_or_else(|| {
        user_error!(
            "there is no rectangle that stands out; needed: four straight sides in the image, of tape or a patch that is brighter or darker than the floor, each at least {:.0} % of the image's height long",
            100.0 * quads::MIN_SIDE_SHARE
        )
    }))
}

/// What is looked at of red, green and blue.
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

fn grey(frame: &Frame, channel: Channel) -> GrayImage {
    GrayImage::from_fn(frame.width() as u32, frame.height() as u32, |x, y| {
        [channel(frame.rgb(x as usize, y as usize))]
    })
}

/// The image at the size at which it is searched, and that size as a share of its own.
fn searched(mean: &GrayImage) -> (GrayImage, f64) {
    let longer_px = f64::from(mean.width().max(mean.height()));
    let scale = (SEARCHED_SIDE_PX / longer_px).min(1.0);
    let side = |px: u32| ((f64::from(px) * scale).round() as u32).max(1);
    let level = mean.resized(side(mean.width()), side(mean.height()));
    (level, scale)
}

/// The rectangle that stands out: the quadrilaterals of a tape's edges, in the image's own pixels. Of a patch both are the same.
struct StandsOut {
    outer: Quad,
    inner: Quad,
    is_tape: bool,
}

impl StandsOut {
    fn edge(&self, edge: Edge) -> &Quad {
        match edge {
            Edge::Outer => &self.outer,
            Edge::Inner => &self.inner,
        }
    }
}

/// Looks for the rectangle in an image; `None` where there is none.
fn stands_out(image: &GrayImage) -> Result<Option<StandsOut>> {
    let (level, scale) = searched(image);
    let size_px = [f64::from(level.width()), f64::from(level.height())];
    let lines = lines::find(&level);
    let rectangles = quads::find(&lines, size_px).into_iter().filter_map(|quad| {
        let other = quads::other_edge(&quad, &lines);
        // A tape is known by its two edges, so that parts may be hidden; any four edges could be a patch.
        let is_whole = quad.support.iter().all(|share| *share >= MIN_PATCH_SUPPORT);
        (other.is_some() || is_whole).then_some((quad, other))
    });
    // Centres of pixels, not their borders, are at integers.
    let to_image = |corners: [[f64; 2]; 4]| corners.map(|p| p.map(|c| (c + 0.5) / scale - 0.5));
    let (seen, cut): (Vec<_>, Vec<_>) =
        rectangles.partition(|(quad, _)| quad.seen_share >= MIN_SEEN_SHARE);
    let Some((best, other)) = seen.first().copied() else {
        return match cut.first() {
            None => Ok(None),
            Some((quad, _)) => Err(user_error!(
                "the rectangle with corners at {} has a side of which {:.0} % lie in the image; needed: {:.0} %; move it into view",
                listed(to_image(quad.corners_px)),
                100.0 * quad.seen_share,
                100.0 * MIN_SEEN_SHARE
            )),
        };
    };
    let rival = seen.iter().find(|(quad, _)| !is_same(&best, quad));
    if let Some((rival, _)) = rival.filter(|r| r.0.score > AMBIGUOUS_SHARE * best.score) {
        return Err(user_error!(
            "several rectangles stand out alike, such as those with corners at {} and {}; leave one in view, or give its corners by hand",
            listed(to_image(best.corners_px)),
            listed(to_image(rival.corners_px))
        ));
    }
    let (outer, inner) = match other {
        Some(other) if other.area_px2() > best.area_px2() => (other, best),
        Some(other) => (best, other),
        None => (best, best),
    };
    let in_image = |quad: Quad| quad.moved_to(to_image(quad.corners_px));
    Ok(Some(StandsOut {
        outer: in_image(outer),
        inner: in_image(inner),
        is_tape: other.is_some(),
    }))
}

/// Finds the rectangle in images of one size; `None` where there is none.
fn find_in(frames: &[Frame], channel: Channel, edge: Edge) -> Result<Option<FoundRectangle>> {
    let images: Vec<GrayImage> = frames.iter().map(|frame| grey(frame, channel)).collect();
    let Some(mean) = mean_of(&images) else {
        return Ok(None);
    };
    let Some(rectangle) = stands_out(&mean)? else {
        return Ok(None);
    };
    let wanted = rectangle.edge(edge);
    let measured: Vec<Measured> = images
        .iter()
        .filter_map(|image| measure(&linear(image), wanted))
        .collect();
    if (measured.len() as f64) < MIN_MEASURED_SHARE * images.len() as f64 || measured.is_empty() {
        return Err(user_error!(
            "the rectangle with corners at {} can be measured in {} of {} images only; keep its sides in view and the camera still",
            listed(wanted.corners_px),
            measured.len(),
            images.len()
        ));
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
        return Err(user_error!(
            "the rectangle with corners at {} lies {scatter_px:.1} px (RMS) elsewhere in single images; keep the camera still and the rectangle in view",
            listed(corners_px)
        ));
    }
    let fitted_px =
        fitted_tape(frames, channel, &rectangle).map(|[outer_px, inner_px]| match edge {
            Edge::Outer => outer_px,
            Edge::Inner => inner_px,
        });
    Ok(Some(FoundRectangle {
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

/// The light of an image, 0 to 255: a pixel that an edge divides shows the mean of the light of both sides, not of their grey levels.
fn linear(image: &GrayImage) -> Light {
    let light = |level: u8| (255.0 * linear_from_srgb([f64::from(level); 3])[0]) as f32;
    let table: [f32; 256] = std::array::from_fn(|level| light(level as u8));
    image.map(|[level]| [table[usize::from(level)]])
}

/// The corners of a tape's outer and of its inner edge, in all images together; none of a patch, and where too little is seen.
fn fitted_tape(
    frames: &[Frame],
    channel: Channel,
    rectangle: &StandsOut,
) -> Option<[[[f64; 2]; 4]; 2]> {
    let still = median_of(frames).filter(|_| rectangle.is_tape)?;
    let levels = GrayImage::from_fn(still.width(), still.height(), |x, y| {
        [channel(still.get_pixel(x, y))]
    });
    let light = linear(&levels);
    let is_saturated = |x, y| still.get_pixel(x, y).iter().any(|c| *c >= SATURATED);
    let [outer, inner] = [&rectangle.outer, &rectangle.inner].map(|quad| measure(&light, quad));
    tape::fitted(&light, is_saturated, &outer?, &inner?)
}

/// The median of each pixel over images of one size: without noise, and without what moves.
fn median_of(frames: &[Frame]) -> Option<RgbImage> {
    let first = frames.first()?;
    let median_at = |x: u32, y: u32| {
        let colors: Vec<[u8; 3]> = frames
            .iter()
            .map(|frame| frame.rgb(x as usize, y as usize))
            .collect();
        let median = |c: usize| {
            let mut levels: Vec<u8> = colors.iter().map(|color| color[c]).collect();
            *levels.select_nth_unstable(colors.len() / 2).1
        };
        [0, 1, 2].map(median)
    };
    Some(RgbImage::from_fn(
        first.width() as u32,
        first.height() as u32,
        median_at,
    ))
}

/// The mean of images of one size, so that noise and what moves hardly count.
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

/// Whether two quadrilaterals are edges of one rectangle.
fn is_same(a: &Quad, b: &Quad) -> bool {
    let limit_px = SAME_CORNER_SHARE * a.area_px2().sqrt() + SAME_CORNER_PX;
    (0..4).any(|turn| {
        (0..4).all(|i| {
            let ([u, v], [u2, v2]) = (a.corners_px[i], b.corners_px[(i + turn) % 4]);
            (u - u2).hypot(v - v2) <= limit_px
        })
    })
}

/// Which corner is nearest the bottom left of an image of this height.
fn nearest_bottom_left(corners_px: [[f64; 2]; 4], height_px: f64) -> usize {
    let distance = |i: &usize| corners_px[*i][0].hypot(height_px - 1.0 - corners_px[*i][1]);
    let nearest = (0..4).min_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.unwrap_or_default()
}

/// Corners, for people.
fn listed(corners_px: [[f64; 2]; 4]) -> String {
    let corners = corners_px.map(|[u, v]| format!("({u:.0}, {v:.0})"));
    corners.join(" ")
}
