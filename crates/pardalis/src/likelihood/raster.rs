//! Conversion from image coordinates to the pixels that are looked up.

use super::outline::Coordinates;
use crate::view::View;
use pardalis_camera::LANES;

/// Row stride of pixel numbers for look-ups that need both coordinates.
pub(super) const COORDINATES_STRIDE: u32 = 1 << 16;
/// A contour point outside the image or the mask.
pub(super) const NO_PIXEL: u32 = u32::MAX;

/// Reports which inner contours share more than `max_share` of their pixels with the outer ones.
#[inline(always)]
pub(super) fn share_pixels(
    inner: &[[u32; LANES]],
    outer: &[[u32; LANES]],
    max_share: f32,
) -> [bool; LANES] {
    let (mut shared, mut valid) = ([0_u32; LANES], [0_u32; LANES]);
    for inner in inner {
        let mut found = [0_u32; LANES];
        for outer in outer {
            for lane in 0..LANES {
                found[lane] |= u32::from(inner[lane] == outer[lane]);
            }
        }
        for lane in 0..LANES {
            let is_pixel = u32::from(inner[lane] != NO_PIXEL);
            shared[lane] += found[lane] & is_pixel;
            valid[lane] += is_pixel;
        }
    }
    std::array::from_fn(|lane| shared[lane] as f32 > max_share * valid[lane] as f32)
}

/// The pixels of an image by their coordinates.
#[derive(Clone, Copy)]
pub(super) struct Raster {
    /// Coordinates of the last column and row.
    last_u_px: f32,
    last_v_px: f32,
    /// Row stride of pixel numbers.
    stride: u32,
}

impl Raster {
    pub(super) fn new(view: &View, stride: u32) -> Self {
        let (width, height) = view.size();
        Self {
            last_u_px: width as f32 - 0.5,
            last_v_px: height as f32 - 0.5,
            stride,
        }
    }

    /// Returns `y * stride + x` of the pixel at the given coordinates; [`NO_PIXEL`] outside the image.
    #[inline(always)]
    fn pixel(self, u: f32, v: f32) -> u32 {
        let inside = (u > -0.5) & (u < self.last_u_px) & (v > -0.5) & (v < self.last_v_px);
        let pixel = rounded(v) * self.stride + rounded(u);
        if inside { pixel } else { NO_PIXEL }
    }

    #[inline(always)]
    pub(super) fn write_pixels(self, coordinates: &[Coordinates], pixels: &mut [[u32; LANES]]) {
        for ([u, v], pixels) in coordinates.iter().zip(pixels) {
            for lane in 0..LANES {
                pixels[lane] = self.pixel(u[lane], v[lane]);
            }
        }
    }

    /// Writes the pixels at the given distance from the outlines, for the chosen lanes.
    #[inline(always)]
    pub(super) fn write_along_normals(
        self,
        outline: &[Coordinates],
        normals: &[Coordinates],
        distance_px: f32,
        chosen: &[bool; LANES],
        pixels: &mut [[u32; LANES]],
    ) {
        for ((point, normal), pixels) in outline.iter().zip(normals).zip(pixels) {
            for lane in 0..LANES {
                let at = |axis: usize| point[axis][lane] + distance_px * normal[axis][lane];
                let pixel = self.pixel(at(0), at(1));
                pixels[lane] = if chosen[lane] { pixel } else { pixels[lane] };
            }
        }
    }
}

/// Rounds a number between −0.5 and 2^14 to the nearest integer, ties to even: the addition shifts out the
/// fraction.
#[inline(always)]
fn rounded(x: f32) -> u32 {
    (x + 12_582_912.0).to_bits() & 0xffff
}
