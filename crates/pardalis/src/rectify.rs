//! The plane as seen from straight above: a map of it, whose pixels are looked up in the image.

use nalgebra::{Matrix3, Point3};
use rayon::prelude::*;

use crate::frame::with_pixels;
use crate::view::View;
use crate::{Frame, PixelFormat};
use pardalis_camera::Homography;
use pardalis_camera::{Camera, Mask, Plane};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// The smallest and the greatest x and y of a part of the plane, in metres.
pub type Area = [[f64; 2]; 2];

/// Areas lie within so many metres of the world's origin.
const MAX_DISTANCE_M: f64 = 1e6;

/// Shares of neighbouring pixels count in this many parts.
const PARTS: u32 = 256;

/// Makes maps of a part of the plane z = 0 from the images of one camera of any model: x to the right, y upwards, the same metres in every pixel.
///
/// Each pixel of the map is interpolated between four of the image, in the frame's own components. It is black where one of these does not count:
/// outside the image, the camera's domain or its mask. Where the image is finer than the map, pixels of it are left out, not averaged.
#[derive(Debug, Clone)]
pub struct Rectifier {
    image_px: (usize, usize),
    size_px: (usize, usize),
    upper_left_m: [f64; 2],
    step_m: f64,
    camera: Plane<f64>,
    /// Of each pixel of the map, row by row.
    places: Vec<Option<Place>>,
}

/// Where a pixel of the map lies in the image: the pixel to the upper left, and the shares of those to its right and below, in [`PARTS`].
#[derive(Debug, Clone, Copy)]
struct Place {
    x: u16,
    y: u16,
    right: u16,
    below: u16,
}

impl Rectifier {
    /// Of an area, from its upper left corner on in steps of so many metres a pixel; its size is rounded to whole pixels.
    ///
    /// Refused: cameras that do not stand above the plane, maps that are too large, areas of which the camera shows nothing.
    pub fn new(view: &View, area_m: Area, step_m: f64) -> Result<Self, Error> {
        let center_m = center_above_plane_m(view)?;
        let [width, height] = size_px(area_m, step_m)?;
        let [[left_m, _], [_, top_m]] = area_m;
        let place = |pixel: usize| {
            let [x, y] = [pixel % width, pixel / width].map(|i| (i as f64 + 0.5) * step_m);
            Place::of(view, [left_m + x, top_m - y])
        };
        let mut places = vec![None; width * height];
        places
            .par_iter_mut()
            .enumerate()
            .for_each(|(pixel, to)| *to = place(pixel));
        if places.iter().all(Option::is_none) {
            return Err(Error::refused(
                format!("the camera shows nothing of the area {area_m:?}"),
                "give one that it sees",
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
            places,
        })
    }

    /// Width and height of the maps in pixels.
    pub fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    /// The side of a pixel in metres.
    pub fn step_m(&self) -> f64 {
        self.step_m
    }

    /// The part of the plane that the maps show: whole pixels.
    pub fn area_m(&self) -> Area {
        let [left_m, top_m] = self.upper_left_m;
        let (width, height) = self.size_px;
        [
            [left_m, top_m - height as f64 * self.step_m],
            [left_m + width as f64 * self.step_m, top_m],
        ]
    }

    /// The camera whose images the maps are. Its centre is that of the camera they are made from, where it is known, so that what stands on the plane is seen where
    /// that one saw it against the plane. (An exact mirror has no centre; its viewpoint stands for it.)
    pub fn camera(&self) -> &Plane<f64> {
        &self.camera
    }

    /// Which pixels of the map show something, row by row.
    pub fn shown(&self) -> impl Iterator<Item = bool> {
        self.places.iter().map(Option::is_some)
    }

    /// The map that a frame makes: red, green and blue, row by row from the top.
    ///
    /// Refused: frames of another size than the camera's.
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
        let mut rgb = vec![0; 3 * self.places.len()];
        let rows = rgb.par_chunks_mut(3 * width);
        let rows = rows.zip(self.places.par_chunks(width));
        with_pixels!(frame, components => rows.for_each(|(row, places)| {
            for (pixel, place) in row.as_chunks_mut::<3>().0.iter_mut().zip(places) {
                if let Some(place) = place {
                    let mixed = place.mixed(self.image_px, components);
                    *pixel = match frame.format() {
                        PixelFormat::Rgb8 => mixed,
                        _ => frame.encoding().rgb8_from_yuv(mixed),
                    };
                }
            }
        }));
        Ok(rgb)
    }
}

impl Place {
    /// Where the image shows a point of the plane; none where it does not.
    fn of(view: &View, [x_m, y_m]: [f64; 2]) -> Option<Self> {
        let in_camera = view.camera_from_world() * Point3::new(x_m, y_m, 0.0);
        let [u, v] = view.camera().project(in_camera.coords.into())?;
        let (width, height) = view.size();
        // Pixels reach half a pixel beyond their middles; what lies beyond the last middles is theirs alone.
        let inside = |at: f64, count: usize| at > -0.5 && at < count as f64 - 0.5;
        if !(inside(u, width) && inside(v, height)) {
            return None;
        }
        let [u, v] = [
            u.clamp(0.0, (width - 1) as f64),
            v.clamp(0.0, (height - 1) as f64),
        ];
        let share = |at: f64| ((at - at.floor()) * f64::from(PARTS)).round() as u16;
        let place = Self {
            x: u as u16,
            y: v as u16,
            right: share(u),
            below: share(v),
        };
        let counts = |mask: &Mask| {
            let used = |dx, dy| (dx == 0 || place.right > 0) && (dy == 0 || place.below > 0);
            let open = |dx, dy| {
                mask.open()[(usize::from(place.y) + dy) * width + usize::from(place.x) + dx]
            };
            [(0, 0), (1, 0), (0, 1), (1, 1)]
                .into_iter()
                .all(|(dx, dy)| !used(dx, dy) || open(dx, dy))
        };
        view.mask().is_none_or(counts).then_some(place)
    }

    /// The components of the pixels around it, mixed by their shares.
    #[inline(always)]
    fn mixed(
        self,
        (width, height): (usize, usize),
        components: impl Fn(usize, usize) -> [u8; 3],
    ) -> [u8; 3] {
        let [x, y] = [self.x, self.y].map(usize::from);
        // Beyond the last column and row, where the share is 0.
        let [right, below] = [(x + 1).min(width - 1), (y + 1).min(height - 1)];
        let mix =
            |a: u32, b: u32, share: u16| a * (PARTS - u32::from(share)) + b * u32::from(share);
        let [top, bottom] = [y, below].map(|y| {
            let [left, right] = [components(x, y), components(right, y)];
            [0, 1, 2].map(|i| mix(left[i].into(), right[i].into(), self.right))
        });
        [0, 1, 2].map(|i| {
            let sum = mix(top[i], bottom[i], self.below);
            ((sum + PARTS * PARTS / 2) / (PARTS * PARTS)) as u8
        })
    }
}

/// Width and height of the map of an area.
fn size_px([low, high]: Area, step_m: f64) -> Result<[usize; 2], Error> {
    let near = |m: &f64| m.abs() <= MAX_DISTANCE_M;
    let ordered = low[0] < high[0] && low[1] < high[1];
    if !(ordered && low.iter().chain(&high).all(near)) {
        return Err(Error::out_of_range(
            "the area",
            format!("{low:?} to {high:?}"),
            "the smaller x and y, then the greater ones, in metres, -1e6 to 1e6",
        ));
    }
    if !(step_m > 0.0 && step_m.is_finite()) {
        let allowed = "a positive number of metres a pixel";
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
            "an area of {} x {} m at {step_m} m a pixel makes an image of {} x {} pixels; allowed: 1 to {MAX_IMAGE_SIDE_PX} a side",
            high[0] - low[0],
            high[1] - low[1],
            sides[0],
            sides[1]
        ),
        "give another area or step",
    ))
}

/// The camera's centre in the world, where it is known.
fn center_above_plane_m(view: &View) -> Result<Option<[f64; 3]>, Error> {
    let center_m = match view.camera() {
        Camera::Plane(plane) if *plane == Plane::image() => {
            return Err(Error::refused(
                "the camera is the image itself, without any metres",
                "say where the plane is, by points of it or a calibrated camera's pose",
            ));
        }
        Camera::Plane(plane) => plane.center_m(),
        camera => Some(camera.viewpoint_m()),
    };
    let center_m = center_m.map(|center_m| view.world_from_camera() * Point3::from(center_m));
    match center_m.filter(|center| center.z <= 0.0) {
        Some(center) => Err(Error::refused(
            format!("the camera stands {} m below the plane z = 0", -center.z),
            "give its pose over the plane",
        )),
        None => Ok(center_m.map(|center| center.coords.into())),
    }
}

/// Samples along the longer side of the image by which it is found out what of the plane is seen.
const SAMPLES: usize = 256;

/// How much coarser than where it is finest an image may show what is still worth a place on the map. The finest is below a camera that looks down; so far off
/// is what lies a good two times its height away.
const COARSEST: f64 = 4.0;

/// What one pixel of the image shows of the plane.
struct Sight {
    plane_m: [f64; 2],
    /// The side of a square as large as its footprint.
    side_m: f64,
}

/// The part of the plane that a camera shows well: up to where its pixels show four times as much of the plane, along a side, as where it is finest.
/// Rounded outwards to a hundredth of its size.
///
/// Refused: cameras that show nothing of the plane.
pub fn area_seen_m(view: &View) -> Result<Area, Error> {
    let sights = sights(view)?;
    let finest_m = sights
        .iter()
        .map(|s| s.side_m)
        .fold(f64::INFINITY, f64::min);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for sight in sights.iter().filter(|s| s.side_m <= COARSEST * finest_m) {
        for axis in 0..2 {
            low[axis] = low[axis].min(sight.plane_m[axis] - sight.side_m / 2.0);
            high[axis] = high[axis].max(sight.plane_m[axis] + sight.side_m / 2.0);
        }
    }
    let size_m = (high[0] - low[0]).max(high[1] - low[1]);
    let per_m = libm::exp10(2.0 - libm::floor(libm::log10(size_m)));
    Ok([
        low.map(|m| libm::floor(m * per_m) / per_m),
        high.map(|m| libm::ceil(m * per_m) / per_m),
    ])
}

/// The step of a map in metres a pixel that makes its pixels as large as the image's in the middle of the area, or where the image shows the plane next to
/// it; larger where the map would have too many. Two digits.
pub fn step_for_m(view: &View, area_m: Area) -> Result<f64, Error> {
    let [low, high] = area_m;
    let from_middle = |sight: &Sight| {
        let offset = |axis: usize| sight.plane_m[axis] - f64::midpoint(low[axis], high[axis]);
        libm::hypot(offset(0), offset(1))
    };
    let sights = sights(view)?;
    let nearest = sights
        .iter()
        .min_by(|a, b| from_middle(a).total_cmp(&from_middle(b)));
    let side_m = nearest.map_or(f64::INFINITY, |sight| sight.side_m);
    let digit = libm::exp10(libm::floor(libm::log10(side_m)) - 1.0);
    let rounded_m = (side_m / digit).round() * digit;
    let [width_m, height_m] = [0, 1].map(|axis| high[axis] - low[axis]);
    let least_m = width_m.max(height_m) / MAX_IMAGE_SIDE_PX as f64;
    // At least one pixel, even of what is not seen.
    Ok(rounded_m.min(width_m.min(height_m)).max(least_m))
}

/// What pixels all over the image show of the plane; at least one does.
fn sights(view: &View) -> Result<Vec<Sight>, Error> {
    center_above_plane_m(view)?;
    let (width, height) = view.size();
    let apart = width.max(height).div_ceil(SAMPLES);
    // Its last pixels, too.
    let along = |count: usize| (0..count - 1).step_by(apart).chain([count - 1]);
    let pixels = along(height).flat_map(|y| along(width).map(move |x| (x, y)));
    let open = |&(x, y): &(usize, usize)| view.mask().is_none_or(|mask| mask.open()[y * width + x]);
    let found: Vec<_> = pixels
        .filter(open)
        .filter_map(|(x, y)| Sight::of(view, [x as f64, y as f64]))
        .collect();
    if found.is_empty() {
        return Err(Error::refused(
            "the camera shows nothing of the plane z = 0",
            "check its pose and mask",
        ));
    }
    Ok(found)
}

impl Sight {
    /// Of the pixel at (u, v); none where it does not show the plane.
    fn of(view: &View, [u, v]: [f64; 2]) -> Option<Self> {
        let [at, right, below] = [[u, v], [u + 1.0, v], [u, v + 1.0]].map(|p| on_plane_m(view, p));
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

/// Where the ray of a pixel meets the plane, x and y in metres; none where it does not.
pub fn on_plane_m(view: &View, pixel: [f64; 2]) -> Option<[f64; 2]> {
    let ray = view.camera().unproject(pixel)?;
    let origin = view.world_from_camera() * Point3::from(ray.origin);
    let direction = view.world_from_camera().rotation * nalgebra::Vector3::from(ray.direction);
    let met = origin - direction * (origin.z / direction.z);
    (direction.z < 0.0).then_some([met.x, met.y])
}
