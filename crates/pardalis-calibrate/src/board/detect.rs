//! Detection of a board in an image: coarse search at several sizes, then a fit of each corner at full size.

use pardalis_images::GrayImage;

use super::error::{BoardNotFound, MIN_SIDE_PX};
use super::place::{self, PlacedCorners};
use super::{Board, Corner, Geometry};
use super::{lattice, saddle};

/// Images with a longer side than this are first searched at half their size, or less.
const MAX_SIDE_PX: u32 = 1600;

/// In synthetic drawings, the four pixels around a corner may have equal responses, so that none is a maximum. At this
/// scale they differ.
const UNEVEN_SCALE: f64 = 0.73;

/// Least radius around a corner for a fit: fewer pixels do not determine it.
const MIN_FIT_RADIUS_PX: f64 = 2.5;

/// Greatest distance from a corner of the pixels in its fit.
const MAX_FIT_RADIUS_PX: f64 = 16.0;

/// Finds the corners of a board in an image, ordered by number.
///
/// Checkerboards must be completely in view. Of other boards, the visible corners are returned. Typical accuracy is
/// 0.1 pixel.
pub fn detect(board: &Board, image: &GrayImage) -> Result<Vec<Corner>, BoardNotFound> {
    let (width, height) = image.dimensions();
    if width.min(height) < MIN_SIDE_PX {
        return Err(BoardNotFound::ImageTooSmall { width, height });
    }
    let mut best = Err(None);
    for scale in scales(image) {
        match detect_at(board, image, scale) {
            Ok(corners) => {
                if best.as_ref().map_or(0, Vec::len) < corners.len() {
                    best = Ok(corners);
                }
            }
            Err(reason) => {
                best = best.map_err(|first: Option<BoardNotFound>| first.or(Some(reason)));
            }
        }
        if best.as_ref().map_or(0, Vec::len) == board.corner_count() {
            break;
        }
    }
    best.map_err(|reason| reason.unwrap_or(BoardNotFound::NotInView))
}

/// Returns the scales at which the image is searched: first reduced if it is large, then finer for small squares and
/// coarser for blurred ones.
fn scales(image: &GrayImage) -> Vec<f64> {
    let mut scale = 1.0;
    while scale * f64::from(image.width().max(image.height())) > f64::from(MAX_SIDE_PX) {
        scale /= 2.0;
    }
    let mut scales = vec![scale, 2.0 * scale];
    let shorter_px = f64::from(image.width().min(image.height()));
    let coarser = [scale / 2.0, UNEVEN_SCALE * scale];
    let large_enough = |scale: &f64| scale * shorter_px >= f64::from(MIN_SIDE_PX);
    scales.extend(coarser.into_iter().filter(large_enough));
    scales
}

/// Finds the corners in the resized image and fits them in the image itself.
fn detect_at(board: &Board, image: &GrayImage, scale: f64) -> Result<Vec<Corner>, BoardNotFound> {
    let resized = |n: u32| (f64::from(n) * scale).round() as u32;
    let level = image.resized(resized(image.width()), resized(image.height()));
    let saddles = saddle::find(&level);
    let lattices = lattice::grow(&level, &saddles);
    let mut placed = match &board.geometry {
        Geometry::Checkerboard { .. } => place::by_extent(board, &lattices, &saddles)?,
        Geometry::Charuco { dictionary, .. } | Geometry::AprilGrid { dictionary, .. } => {
            place::by_markers(board, dictionary, &level, &lattices, &saddles)?
        }
    };
    // Pixel centres, not borders, have integer coordinates.
    let to_image = |n: f64| (n + 0.5) / scale - 0.5;
    for corner in placed.values_mut() {
        corner.pixel = corner.pixel.map(to_image);
    }
    let fitted = fit(board, image, &placed);
    let must_be_complete = matches!(board.geometry, Geometry::Checkerboard { .. });
    if must_be_complete && fitted.len() < placed.len() {
        return Err(BoardNotFound::Unmeasured {
            unmeasured: placed.len() - fitted.len(),
            corners: placed.len(),
        });
    }
    Ok(fitted)
}

/// Fits each corner in the image and omits those that cannot be fitted.
fn fit(board: &Board, image: &GrayImage, placed: &PlacedCorners) -> Vec<Corner> {
    let distance = |a: &[f64], b: &[f64]| libm::hypot(a[0] - b[0], a[1] - b[1]);
    // The smallest scale towards any neighbour, because perspective makes it vary.
    let pixels_per_m = |[x, y]: [i32; 2], board_m: [f64; 3], pixel: [f64; 2]| {
        [[x - 1, y], [x + 1, y], [x, y - 1], [x, y + 1]]
            .into_iter()
            .filter_map(|neighbour| {
                let (_, neighbour_m) = board.corner_at(neighbour)?;
                let length_px = distance(&placed.get(&neighbour)?.pixel, &pixel);
                Some(length_px / distance(&neighbour_m, &board_m))
            })
            .fold(f64::MAX, f64::min)
    };
    let mut corners: Vec<Corner> = placed
        .iter()
        .filter_map(|(&index, &start)| {
            let (id, board_m) = board.corner_at(index)?;
            let radius_px = board.free_radius_m() * pixels_per_m(index, board_m, start.pixel);
            if radius_px < MIN_FIT_RADIUS_PX {
                return None;
            }
            let (fitted, edge_width_px) =
                saddle::refine(image, start, radius_px.min(MAX_FIT_RADIUS_PX))?;
            Some(Corner {
                id,
                board_m,
                pixel: fitted.pixel,
                edge_width_px,
            })
        })
        .collect();
    corners.sort_by_key(|corner| corner.id);
    corners
}
