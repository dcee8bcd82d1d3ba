//! Orthographic maps of the plane z = 0, resampled from camera images.

use nalgebra::{Matrix3, Point3};
use rayon::prelude::*;

use crate::frame::with_pixels;
use crate::view::View;
use crate::{Frame, PixelFormat};
use pardalis_camera::Homography;
use pardalis_camera::{Camera, Mask, Plane};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// The minimum x and y, then the maximum x and y, of a part of the plane, in metres.
pub type Area = [[f64; 2]; 2];

/// Maximum distance of areas from the world's origin, in metres.
const MAX_DISTANCE_M: f64 = 1e6;

/// Resolution of interpolation weights.
const WEIGHT_STEPS: u32 = 256;

/// Resamples images of one camera of any model into maps of a part of the plane z = 0: x to the right, y
/// upwards, at a constant number of metres per pixel.
///
/// Each pixel of a map is interpolated between four pixels of the image, in the frame's own components. It is
/// black if one of these is unusable: outside the image, the camera's domain or its mask. Where the image is
/// finer than the map, its pixels are skipped, not averaged.
#[derive(Debug, Clone)]
pub struct Rectifier {
    image_px: (usize, usize),
    size_px: (usize, usize),
    upper_left_m: [f64; 2],
    step_m: f64,
    camera: Plane<f64>,
    /// The source of each pixel of the map, row by row.
    sources: Vec<Option<Source>>,
}

/// The source of a map pixel in the image: the pixel to the upper left, and the weights of its right and
/// lower neighbours in units of 1/[`WEIGHT_STEPS`].
#[derive(Debug, Clone, Copy)]
struct Source {
    x: u16,
    y: u16,
    right: u16,
    below: u16,
}

impl Rectifier {
    /// Creates a rectifier for an area, at `step_m` metres per pixel from its upper left corner. The size is
    /// rounded to whole pixels.
    ///
    /// # Errors
    ///
    /// The camera does not stand above the plane, the map is too large, or the camera shows nothing of the
    /// area.
    pub fn new(view: &View, area_m: Area, step_m: f64) -> Result<Self, Error> {
        let center_m = center_above_plane_m(view)?;
        let [width, height] = size_px(area_m, step_m)?;
        let [[left_m, _], [_, top_m]] = area_m;
        let source = |pixel: usize| {
            let [x, y] = [pixel % width, pixel / width].map(|i| (i as f64 + 0.5) * step_m);
            Source::of(view, [left_m + x, top_m - y])
        };
        let mut sources = vec![None; width * height];
        sources
            .par_iter_mut()
            .enumerate()
            .for_each(|(pixel, to)| *to = source(pixel));
        if sources.iter().all(Option::is_none) {
            return Err(Error::refused(
                format!("the camera shows nothing of the area {area_m:?}"),
                "give an area in its view",
            ));
        }
        let per_m = 1.0 / step_m;
        #[rustfmt::skip]
        let pixel_from_plane = Matrix3::new(
            per_m, 0.0, -left_m * per_m - 0.5,
            0.0, -per_m, top_m * per_m - 0.5,
            0.0, 0.0, 1.0,
        );
        Ok(Self {
            image_px: view.size(),
            size_px: (width, height),
            upper_left_m: [left_m, top_m],
            step_m,
            camera: Plane::new(&Homography::new(pixel_from_plane)?, center_m)?,
            sources,
        })
    }

    /// Returns the width and height of the maps in pixels.
    pub fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    /// Returns the side of a map pixel in metres.
    pub fn step_m(&self) -> f64 {
        self.step_m
    }

    /// Returns the part of the plane that the maps show, in whole pixels.
    pub fn area_m(&self) -> Area {
        let [left_m, top_m] = self.upper_left_m;
        let (width, height) = self.size_px;
        [
            [left_m, top_m - height as f64 * self.step_m],
            [left_m + width as f64 * self.step_m, top_m],
        ]
    }

    /// Returns the camera whose images the maps are. Its centre is that of the original camera, if known, so
    /// that a point above the plane appears on the map where the original camera sees it against the plane.
    /// For an exact mirror, which has no centre, the viewpoint is used.
    pub fn camera(&self) -> &Plane<f64> {
        &self.camera
    }

    /// Reports for each pixel of the map, row by row, whether it shows the plane.
    pub fn shown(&self) -> impl Iterator<Item = bool> {
        self.sources.iter().map(Option::is_some)
    }

    /// Rectifies a frame. Returns red, green and blue, row by row from the top.
    ///
    /// # Errors
    ///
    /// The frame's size differs from the camera's.
    pub fn rectify(&self, frame: &Frame) -> Result<Vec<u8>, Error> {
        let found = (frame.width(), frame.height());
        if found != self.image_px {
            return Err(Error::SizeMismatch {
                what: "the image".to_owned(),
                expected: self.image_px,
                found,
            });
        }
        let width = self.size_px.0;
        let mut rgb = vec![0; 3 * self.sources.len()];
        let rows = rgb.par_chunks_mut(3 * width);
        let rows = rows.zip(self.sources.par_chunks(width));
        with_pixels!(frame, components => rows.for_each(|(row, sources)| {
            for (pixel, source) in row.as_chunks_mut::<3>().0.iter_mut().zip(sources) {
                if let Some(source) = source {
                    let interpolated = source.interpolated(self.image_px, components);
                    *pixel = match frame.format() {
                        PixelFormat::Rgb8 => interpolated,
                        _ => frame.encoding().rgb8_from_yuv(interpolated),
                    };
                }
            }
        }));
        Ok(rgb)
    }
}

impl Source {
    /// Finds where the image shows a point of the plane; `None` if it does not.
    fn of(view: &View, [x_m, y_m]: [f64; 2]) -> Option<Self> {
        let in_camera = view.camera_from_world() * Point3::new(x_m, y_m, 0.0);
        let [u, v] = view.camera().project(in_camera.coords.into())?;
        let (width, height) = view.size();
        // Pixels extend half a pixel beyond their centres; beyond the outermost centres there is nothing to
        // interpolate with.
        let inside = |at: f64, count: usize| at > -0.5 && at < count as f64 - 0.5;
        if !(inside(u, width) && inside(v, height)) {
            return None;
        }
        let [u, v] = [
            u.clamp(0.0, (width - 1) as f64),
            v.clamp(0.0, (height - 1) as f64),
        ];
        let share = |at: f64| ((at - at.floor()) * f64::from(WEIGHT_STEPS)).round() as u16;
        let source = Self {
            x: u as u16,
            y: v as u16,
            right: share(u),
            below: share(v),
        };
        let is_usable = |mask: &Mask| {
            let used = |dx, dy| (dx == 0 || source.right > 0) && (dy == 0 || source.below > 0);
            let open = |dx, dy| {
                mask.open()[(usize::from(source.y) + dy) * width + usize::from(source.x) + dx]
            };
            [(0, 0), (1, 0), (0, 1), (1, 1)]
                .into_iter()
                .all(|(dx, dy)| !used(dx, dy) || open(dx, dy))
        };
        view.mask().is_none_or(is_usable).then_some(source)
    }

    /// Interpolates between the components of the four pixels.
    #[inline(always)]
    fn interpolated(
        self,
        (width, height): (usize, usize),
        components: impl Fn(usize, usize) -> [u8; 3],
    ) -> [u8; 3] {
        let [x, y] = [self.x, self.y].map(usize::from);
        // The index is clamped beyond the last column and row, where the weight is 0.
        let [right, below] = [(x + 1).min(width - 1), (y + 1).min(height - 1)];
        let mix = |a: u32, b: u32, share: u16| {
            a * (WEIGHT_STEPS - u32::from(share)) + b * u32::from(share)
        };
        let [top, bottom] = [y, below].map(|y| {
            let [left, right] = [components(x, y), components(right, y)];
            [0, 1, 2].map(|i| mix(left[i].into(), right[i].into(), self.right))
        });
        [0, 1, 2].map(|i| {
            let sum = mix(top[i], bottom[i], self.below);
            ((sum + WEIGHT_STEPS * WEIGHT_STEPS / 2) / (WEIGHT_STEPS * WEIGHT_STEPS)) as u8
        })
    }
}

/// Computes the width and height of the map of an area.
fn size_px([low, high]: Area, step_m: f64) -> Result<[usize; 2], Error> {
    let near = |m: &f64| m.abs() <= MAX_DISTANCE_M;
    let ordered = low[0] < high[0] && low[1] < high[1];
    if !(ordered && low.iter().chain(&high).all(near)) {
        return Err(Error::out_of_range(
            "the area",
            format!("{low:?} to {high:?}"),
            "the minimum x and y, then the maximum x and y, in metres, -1e6 to 1e6",
        ));
    }
    if !(step_m > 0.0 && step_m.is_finite()) {
        let allowed = "a positive number of metres per pixel";
        return Err(Error::out_of_range("the step", step_m, allowed));
    }
    let sides = [0, 1].map(|axis| ((high[axis] - low[axis]) / step_m).round());
    if sides
        .iter()
        .all(|&side| side >= 1.0 && side <= MAX_IMAGE_SIDE_PX as f64)
    {
        return Ok(sides.map(|side| side as usize));
    }
    Err(Error::refused(
        format!(
            "an area of {} x {} m at {step_m} m per pixel makes an image of {} x {} pixels; allowed: 1 to {MAX_IMAGE_SIDE_PX} per side",
            high[0] - low[0],
            high[1] - low[1],
            sides[0],
            sides[1]
        ),
        "choose another area or step",
    ))
}

/// Returns the camera's centre in the world, if known, after checking that it lies above the plane.
fn center_above_plane_m(view: &View) -> Result<Option<[f64; 3]>, Error> {
    let center_m = match view.camera() {
        Camera::Plane(plane) if *plane == Plane::image() => {
            return Err(Error::refused(
                "the world of this camera is the image, which has no metric scale",
                "give points of the plane, or a calibrated camera with its pose",
            ));
        }
        Camera::Plane(plane) => plane.center_m(),
        camera => Some(camera.viewpoint_m()),
    };
    let center_m = center_m.map(|center_m| view.world_from_camera() * Point3::from(center_m));
    match center_m.filter(|center| center.z <= 0.0) {
        Some(center) => Err(Error::refused(
            format!("the camera stands {} m below the plane z = 0", -center.z),
            "give a pose above the plane",
        )),
        None => Ok(center_m.map(|center| center.coords.into())),
    }
}

/// Number of samples along the longer side of the image when looking for the visible part of the plane.
const SAMPLES: usize = 256;

/// Maximum ratio of a pixel's footprint side to the finest one for a part of the plane to be mapped. The
/// finest is below a camera that looks down; the limit lies a little beyond twice the camera's height away.
const MAX_COARSENESS: f64 = 4.0;

/// The part of the plane that one pixel of the image shows.
struct Footprint {
    plane_m: [f64; 2],
    /// Side of a square with the area of the footprint, in metres.
    side_m: f64,
}

/// Computes the part of the plane that a camera shows well: where the footprint of its pixels has at most
/// four times the side of the finest one. Rounded outwards to a hundredth of its size.
///
/// # Errors
///
/// The camera shows nothing of the plane.
pub fn visible_area_m(view: &View) -> Result<Area, Error> {
    let footprints = footprints(view)?;
    let finest_m = footprints
        .iter()
        .map(|s| s.side_m)
        .fold(f64::INFINITY, f64::min);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for footprint in footprints
        .iter()
        .filter(|s| s.side_m <= MAX_COARSENESS * finest_m)
    {
        for axis in 0..2 {
            low[axis] = low[axis].min(footprint.plane_m[axis] - footprint.side_m / 2.0);
            high[axis] = high[axis].max(footprint.plane_m[axis] + footprint.side_m / 2.0);
        }
    }
    let size_m = (high[0] - low[0]).max(high[1] - low[1]);
    let per_m = libm::exp10(2.0 - libm::floor(libm::log10(size_m)));
    Ok([
        low.map(|m| libm::floor(m * per_m) / per_m),
        high.map(|m| libm::ceil(m * per_m) / per_m),
    ])
}

/// Computes a map step, in metres per pixel, that makes map pixels as large as the image's at the centre of
/// the area, or where the image shows the plane closest to it. The step is larger if the map would have too
/// many pixels, and rounded to two digits.
///
/// # Errors
///
/// The camera shows nothing of the plane.
pub fn default_step_m(view: &View, area_m: Area) -> Result<f64, Error> {
    let [low, high] = area_m;
    let from_center = |footprint: &Footprint| {
        let offset = |axis: usize| footprint.plane_m[axis] - f64::midpoint(low[axis], high[axis]);
        libm::hypot(offset(0), offset(1))
    };
    let footprints = footprints(view)?;
    let nearest = footprints
        .iter()
        .min_by(|a, b| from_center(a).total_cmp(&from_center(b)));
    let side_m = nearest.map_or(f64::INFINITY, |footprint| footprint.side_m);
    let digit = libm::exp10(libm::floor(libm::log10(side_m)) - 1.0);
    let rounded_m = (side_m / digit).round() * digit;
    let [width_m, height_m] = [0, 1].map(|axis| high[axis] - low[axis]);
    let least_m = width_m.max(height_m) / MAX_IMAGE_SIDE_PX as f64;
    // At least one pixel, even for an area out of view.
    Ok(rounded_m.min(width_m.min(height_m)).max(least_m))
}

/// Samples the footprints of pixels all over the image; at least one.
fn footprints(view: &View) -> Result<Vec<Footprint>, Error> {
    center_above_plane_m(view)?;
    let (width, height) = view.size();
    let apart = width.max(height).div_ceil(SAMPLES);
    // Includes the last pixels.
    let along = |count: usize| (0..count - 1).step_by(apart).chain([count - 1]);
    let pixels = along(height).flat_map(|y| along(width).map(move |x| (x, y)));
    let open = |&(x, y): &(usize, usize)| view.mask().is_none_or(|mask| mask.open()[y * width + x]);
    let found: Vec<_> = pixels
        .filter(open)
        .filter_map(|(x, y)| Footprint::of(view, [x as f64, y as f64]))
        .collect();
    if found.is_empty() {
        return Err(Error::refused(
            "the camera shows nothing of the plane z = 0",
            "check its pose and mask",
        ));
    }
    Ok(found)
}

impl Footprint {
    /// Computes the footprint of the pixel at (u, v); `None` if it does not show the plane.
    fn of(view: &View, [u, v]: [f64; 2]) -> Option<Self> {
        let [at, right, below] =
            [[u, v], [u + 1.0, v], [u, v + 1.0]].map(|p| point_on_plane_m(view, p));
        let (at, right, below) = (at?, right?, below?);
        let [a, b] = [right, below].map(|to| [to[0] - at[0], to[1] - at[1]]);
        let area_m2 = (a[0] * b[1] - a[1] * b[0]).abs();
        let sane = at.iter().all(|m| m.abs() <= MAX_DISTANCE_M) && area_m2 > 0.0;
        sane.then(|| Self {
            plane_m: at,
            side_m: area_m2.sqrt(),
        })
    }
}

/// Returns the point, x and y in metres, where the ray of a pixel meets the plane; `None` if it does not.
pub fn point_on_plane_m(view: &View, pixel: [f64; 2]) -> Option<[f64; 2]> {
    let ray = view.camera().unproject(pixel)?;
    let origin = view.world_from_camera() * Point3::from(ray.origin);
    let direction = view.world_from_camera().rotation * nalgebra::Vector3::from(ray.direction);
    let met = origin - direction * (origin.z / direction.z);
    (direction.z < 0.0).then_some([met.x, met.y])
}
