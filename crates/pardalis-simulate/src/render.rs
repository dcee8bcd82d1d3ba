//! Rendering of a camera's images: the static background once, the moving objects in each frame.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::trace::{Snapshot, WorldRay};
use super::{World, WorldCamera};
use pardalis::shape::{OutlineCircle, SphereOutline};
use pardalis_camera::Camera;
use pardalis_camera::Pose;
use pardalis_core::rng::Draws;

/// Renderer of one camera of a world.
///
/// The light on a pixel is the mean over rays within it
/// ([`ImageSettings::samples`](super::ImageSettings::samples) along each side) and over the instants of the
/// exposure. Blur, drift and noise follow, then the conversion to sRGB. Pixels without a ray are black.
pub struct Renderer<'a> {
    world: &'a World,
    camera: &'a WorldCamera,
    draws: Draws,
    /// Indices of the moving objects.
    moving: Vec<usize>,
    /// Light on each pixel without the moving objects.
    sharp: Light,
    /// The same after the lens blur.
    soft: Light,
    kernel: Vec<f32>,
}

/// Linear red, green and blue of each pixel, row by row.
type Light = Vec<[f32; 3]>;

/// A range of pixels: first and one-past-last column and row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Rectangle {
    x: [usize; 2],
    y: [usize; 2],
}

/// Margin around a moving object that is rendered with it, in pixels.
const MARGIN_PX: f64 = 2.0;
/// The same for mirrors without a single viewpoint, whose outlines are only approximate.
const MIRROR_MARGIN_PX: f64 = 8.0;
/// Number of outline points that bound an object's image.
const OUTLINE_POINTS: usize = 64;

impl<'a> Renderer<'a> {
    /// Renders the static background of the camera with this index.
    pub fn new(world: &'a World, camera: usize) -> Self {
        let draws = Draws::new(world.seed, camera as u32);
        let camera = &world.cameras[camera];
        let (width, height) = camera.size_px;
        let snapshot = [Snapshot::still(world)];
        let pose = world.world_from_camera(camera, 0.0);
        let mut sharp = vec![[0.0; 3]; width * height];
        let rows = sharp.par_chunks_mut(width).enumerate();
        rows.for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = light_along(&rays_of(camera, &pose, x, y), &snapshot);
            }
        });
        let kernel = camera.image.blur_kernel();
        let mut soft = sharp.clone();
        let whole = Rectangle {
            x: [0, width],
            y: [0, height],
        };
        blur(&sharp, &mut soft, camera.size_px, &kernel, whole);
        Self {
            world,
            camera,
            draws,
            moving: (0..world.objects.len())
                .filter(|&object| world.moves(object))
                .collect(),
            sharp,
            soft,
            kernel,
        }
    }

    /// Renders the image of an exposure: three bytes per pixel, row by row. Its number selects the noise, its
    /// time in seconds the scene.
    pub fn image(&self, exposure: u32, time_s: f64) -> Vec<u8> {
        let image = &self.camera.image;
        let (mut sharp, mut soft) = (self.sharp.clone(), self.soft.clone());
        if self.camera.platform.is_some() {
            for (rows, time_s) in self.exposures(time_s) {
                self.render_moving(rows, &image.instants_around(time_s), &mut sharp);
            }
            let (width, height) = self.camera.size_px;
            let whole = Rectangle {
                x: [0, width],
                y: [0, height],
            };
            blur(&sharp, &mut soft, self.camera.size_px, &self.kernel, whole);
            return image.develop(&soft, self.draws, exposure, time_s);
        }
        let mut rendered = vec![None; self.moving.len()];
        for (rows, time_s) in self.exposures(time_s) {
            let instants = image.instants_around(time_s);
            let snapshots: Vec<_> = instants
                .iter()
                .map(|&time_s| Snapshot::new(self.world, time_s))
                .collect();
            for (&object, rendered) in self.moving.iter().zip(&mut rendered) {
                let pose = &self.camera.world_from_camera;
                let bounds = self.visible_bounds(object, pose, &snapshots);
                let Some(bounds) = bounds.and_then(|bounds| bounds.within_rows(rows)) else {
                    continue;
                };
                self.render(bounds, &snapshots, &mut sharp);
                *rendered = Some(rendered.map_or(bounds, |all: Rectangle| all.with(bounds)));
            }
        }
        for bounds in rendered.into_iter().flatten() {
            let around = bounds.grown(self.kernel.len() - 1, self.camera.size_px);
            blur(&sharp, &mut soft, self.camera.size_px, &self.kernel, around);
        }
        image.develop(&soft, self.draws, exposure, time_s)
    }

    /// Returns ranges of rows with the middle of their exposure in seconds: all rows at once, or each by itself with a
    /// rolling shutter.
    fn exposures(&self, time_s: f64) -> Vec<([usize; 2], f64)> {
        let (height, line_delay_s) = (self.camera.size_px.1, self.camera.image.line_delay_s);
        if line_delay_s == 0.0 {
            return vec![([0, height], time_s)];
        }
        let below_middle = |y: usize| y as f64 - 0.5 * (height as f64 - 1.0);
        (0..height)
            .map(|y| ([y, y + 1], time_s + line_delay_s * below_middle(y)))
            .collect()
    }

    /// Renders rows of the image of a camera that moves, at these instants in seconds.
    fn render_moving(&self, [from, to]: [usize; 2], instants_s: &[f64], sharp: &mut Light) {
        let width = self.camera.size_px.0;
        let at = |time_s: &f64| {
            let pose = self.world.world_from_camera(self.camera, *time_s);
            (pose, [Snapshot::new(self.world, *time_s)])
        };
        let instants: Vec<_> = instants_s.iter().map(at).collect();
        let rows = sharp[from * width..to * width]
            .par_chunks_mut(width)
            .zip(from..to);
        rows.for_each(|(row, y)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let mut sum = [0.0; 3];
                for (pose, snapshot) in &instants {
                    let light = light_along(&rays_of(self.camera, pose, x, y), snapshot);
                    (0..3).for_each(|channel| sum[channel] += light[channel]);
                }
                *pixel = sum.map(|light| light / instants.len() as f32);
            }
        });
    }

    /// Renders the moving objects within a part of the image.
    fn render(&self, part: Rectangle, snapshots: &[Snapshot], sharp: &mut Light) {
        let width = self.camera.size_px.0;
        for y in part.y[0]..part.y[1] {
            for x in part.x[0]..part.x[1] {
                let rays = rays_of(self.camera, &self.camera.world_from_camera, x, y);
                let is_met = |ray: &WorldRay| {
                    let meets = |s: &Snapshot| self.moving.iter().any(|&o| s.hit(o, ray).is_some());
                    snapshots.iter().any(meets)
                };
                if rays.iter().flatten().any(is_met) {
                    sharp[y * width + x] = light_along(&rays, snapshots);
                }
            }
        }
    }

    /// Returns the share of each pixel, row by row, that an object covers at a time in seconds, without blur.
    pub fn coverage(&self, object: usize, time_s: f64) -> Vec<f32> {
        let snapshot = Snapshot::new(self.world, time_s);
        let (width, height) = self.camera.size_px;
        let mut coverage = vec![0.0; width * height];
        let pose = self.world.world_from_camera(self.camera, time_s);
        let snapshots = std::slice::from_ref(&snapshot);
        let Some(bounds) = self.visible_bounds(object, &pose, snapshots) else {
            return coverage;
        };
        for y in bounds.y[0]..bounds.y[1] {
            for x in bounds.x[0]..bounds.x[1] {
                let rays = rays_of(self.camera, &pose, x, y);
                let shows = |ray: &&WorldRay| {
                    snapshot
                        .first(ray)
                        .is_some_and(|(first, _)| first == object)
                };
                let hits = rays.iter().flatten().filter(shows).count();
                coverage[y * width + x] = hits as f32 / rays.len() as f32;
            }
        }
        coverage
    }

    /// Returns the pixels that bound an object's image at several instants; `None` if it is not visible.
    fn visible_bounds(
        &self,
        object: usize,
        world_from_camera: &Pose,
        snapshots: &[Snapshot],
    ) -> Option<Rectangle> {
        let (width, height) = self.camera.size_px;
        let whole = Rectangle {
            x: [0, width],
            y: [0, height],
        };
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for snapshot in snapshots {
            let (middle, radius_m) = snapshot.bounds(object);
            let pixels = outline_px(self.camera, world_from_camera, &middle, radius_m);
            let outside = pixels.iter().filter(|pixel| pixel.is_none()).count();
            // The domain's border cuts the object; the rest may be anywhere.
            if outside > 0 && outside < pixels.len() {
                return Some(whole);
            }
            for pixel in pixels.into_iter().flatten() {
                for axis in 0..2 {
                    low[axis] = low[axis].min(pixel[axis]);
                    high[axis] = high[axis].max(pixel[axis]);
                }
            }
        }
        let margin = match self.camera.camera {
            Camera::ExactMirror(_) => MIRROR_MARGIN_PX,
            _ => MARGIN_PX,
        };
        // Conversions from floats saturate: positions left of and above the image become 0.
        let span = |axis: usize, count: usize| {
            let from = (low[axis] - margin).floor() as usize;
            let to = (high[axis] + margin).ceil() as usize;
            [from.min(count), to.saturating_add(1).min(count)]
        };
        let bounds = Rectangle {
            x: span(0, width),
            y: span(1, height),
        };
        let is_empty = low[0] > high[0]
            || high[0] + margin < 0.0
            || high[1] + margin < 0.0
            || bounds.x[0] == bounds.x[1]
            || bounds.y[0] == bounds.y[1];
        (!is_empty).then_some(bounds)
    }
}

/// Projects the outline of a sphere in the world, of a smaller one and of the centre; `None` for points
/// outside the camera's domain. If the camera is inside the sphere, returns one point without a pixel,
/// because the sphere is visible in all directions.
fn outline_px(
    camera: &WorldCamera,
    world_from_camera: &Pose,
    middle: &Vector3<f64>,
    radius_m: f64,
) -> Vec<Option<[f64; 2]>> {
    let viewpoint = Vector3::from(camera.camera.viewpoint_m());
    let in_camera = world_from_camera.inverse() * Point3::from(*middle);
    let middle = in_camera.coords - viewpoint;
    let project = |point: Vector3<f64>| camera.camera.project((point + viewpoint).into());
    let (circle, outside) =
        OutlineCircle::of_sphere(middle.into(), radius_m, SphereOutline::Tangent);
    let mut pixels = vec![project(middle)];
    if !outside {
        // One point with a pixel and one without stand for the whole image.
        return vec![None, Some([0.0; 2])];
    }
    for i in 0..OUTLINE_POINTS {
        let (sin, cos) = libm::sincos(i as f64 / OUTLINE_POINTS as f64 * std::f64::consts::TAU);
        pixels.push(project(circle.point(cos, sin).into()));
        pixels.push(project(circle.point(0.5 * cos, 0.5 * sin).into()));
    }
    pixels
}

/// Returns rays through evenly distributed positions of a pixel.
fn rays_of(
    camera: &WorldCamera,
    world_from_camera: &Pose,
    x: usize,
    y: usize,
) -> Vec<Option<WorldRay>> {
    let samples = camera.image.samples;
    let place = |at: usize, i: usize| at as f64 + (i as f64 + 0.5) / samples as f64 - 0.5;
    (0..samples * samples)
        .map(|i| {
            let pixel = [place(x, i % samples), place(y, i / samples)];
            WorldRay::of_pixel(&camera.camera, world_from_camera, pixel)
        })
        .collect()
}

/// Returns the mean light along rays at several instants; black if there is no ray.
fn light_along(rays: &[Option<WorldRay>], snapshots: &[Snapshot]) -> [f32; 3] {
    let mut sum = Vector3::zeros();
    for ray in rays.iter().flatten() {
        for snapshot in snapshots {
            sum += snapshot.color(ray);
        }
    }
    let mean = sum / (rays.len() * snapshots.len()) as f64;
    mean.map(|light| light as f32).into()
}

/// Blurs a part of an image; the border pixels extend beyond the image.
fn blur(
    sharp: &[[f32; 3]],
    soft: &mut [[f32; 3]],
    (width, height): (usize, usize),
    kernel: &[f32],
    part: Rectangle,
) {
    let reach = kernel.len() as isize - 1;
    let rows = part.grown(kernel.len() - 1, (width, height)).y;
    let columns = part.x[1] - part.x[0];
    let sum = |pixel: &dyn Fn(isize) -> [f32; 3]| {
        let mut sum = [0.0; 3];
        for offset in -reach..=reach {
            let (weight, color) = (kernel[offset.unsigned_abs()], pixel(offset));
            for channel in 0..3 {
                sum[channel] += weight * color[channel];
            }
        }
        sum
    };
    // First along rows, then along columns.
    let mut along_rows = Vec::with_capacity(columns * (rows[1] - rows[0]));
    for y in rows[0]..rows[1] {
        for x in part.x[0]..part.x[1] {
            along_rows.push(sum(&|offset| {
                sharp[y * width + x.saturating_add_signed(offset).min(width - 1)]
            }));
        }
    }
    for y in part.y[0]..part.y[1] {
        for x in part.x[0]..part.x[1] {
            soft[y * width + x] = sum(&|offset| {
                let row = y.saturating_add_signed(offset).min(height - 1) - rows[0];
                along_rows[row * columns + x - part.x[0]]
            });
        }
    }
}

impl Rectangle {
    /// Returns the part within a range of rows; `None` if it is empty.
    fn within_rows(self, [from, to]: [usize; 2]) -> Option<Self> {
        let y = [self.y[0].max(from), self.y[1].min(to)];
        (y[0] < y[1]).then_some(Self { x: self.x, y })
    }

    /// Returns the smallest rectangle around both.
    fn with(self, other: Self) -> Self {
        let hull = |[a, b]: [usize; 2], [c, d]: [usize; 2]| [a.min(c), b.max(d)];
        Self {
            x: hull(self.x, other.x),
            y: hull(self.y, other.y),
        }
    }

    /// Grows the rectangle by this number of pixels on each side, within the image.
    fn grown(self, by: usize, (width, height): (usize, usize)) -> Self {
        let grow =
            |[from, to]: [usize; 2], count: usize| [from.saturating_sub(by), (to + by).min(count)];
        Self {
            x: grow(self.x, width),
            y: grow(self.y, height),
        }
    }
}
