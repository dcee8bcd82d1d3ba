//! Starts of particles: around a rough guess, or along the ray through a clicked pixel.

use nalgebra::{Point3, Vector3};

use crate::view::View;
use pardalis_camera::Mask;
use pardalis_core::Error;
use pardalis_core::rng::{Draws, Stage};
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;
use pardalis_filter::gaussian::{GaussianStart, MAX_START, check_sigma, diagonal_m2};

/// The start of the particles of an initialised target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Start {
    /// Around a rough guess.
    Gaussian(GaussianStart),
    /// At the most likely position along the ray through a pixel of a camera.
    Pixel(PixelStart),
}

/// A start from a clicked pixel (thesis 5.2, fig. 5.1): a Gaussian around the most likely of the particles along the
/// pixel's ray, from near the camera to the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelStart {
    /// Index of the pixel's camera in the tracker.
    pub camera: usize,
    /// A pixel near the centre of the target.
    pub pixel: [f64; 2],
    /// Standard deviation of the click around the target's centre in pixels: the ray of each particle passes through
    /// a pixel drawn around the clicked one. 0 for the single ray of the thesis.
    pub pixel_sigma_px: f64,
    /// Distance along the ray at which the search begins, or at the ground if that is nearer, metres.
    pub min_range_m: f64,
    /// Distance along the ray at which the search ends, or at the ground if that is nearer, metres.
    pub max_range_m: f64,
    /// Height of the ground in the world, metres.
    pub ground_z_m: f64,
    /// Number of particles along the ray.
    pub ray_particles: usize,
    /// Standard deviation of the positions around the best one, metres.
    pub position_sigma_m: [f64; 3],
    /// Standard deviation of the velocities around zero, m/s.
    pub velocity_sigma_mps: [f64; 3],
}

impl PixelStart {
    /// Returns a start in a pixel of a camera with the defaults of scenes: clicks off by 3 px, 0.3 to 8 m away, above
    /// the ground z = 0.
    pub const fn at(camera: usize, pixel: [f64; 2]) -> Self {
        Self {
            camera,
            pixel,
            pixel_sigma_px: 3.0,
            min_range_m: 0.3,
            max_range_m: 8.0,
            ground_z_m: 0.0,
            ray_particles: 2000,
            position_sigma_m: GaussianStart::POSITION_SIGMA_M,
            velocity_sigma_mps: GaussianStart::VELOCITY_SIGMA_MPS,
        }
    }

    /// Returns an error if a value is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let positive = |v: f64| v > 0.0 && v <= MAX_START;
        if let Some(value) = self.pixel.iter().find(|v| !v.is_finite()) {
            return Err(Error::out_of_range("pixel_px", value, "finite numbers"));
        }
        if !(0.0..=1000.0).contains(&self.pixel_sigma_px) {
            return Err(Error::out_of_range(
                "pixel_sigma_px",
                self.pixel_sigma_px,
                "0 to 1000",
            ));
        }
        if !positive(self.min_range_m) {
            return Err(Error::out_of_range(
                "min_range_m",
                self.min_range_m,
                "above 0 and at most 1e6",
            ));
        }
        if !(positive(self.max_range_m) && self.max_range_m > self.min_range_m) {
            return Err(Error::out_of_range(
                "max_range_m",
                self.max_range_m,
                "above min_range_m and at most 1e6",
            ));
        }
        if !(self.ground_z_m.abs() <= MAX_START) {
            return Err(Error::out_of_range(
                "ground_z_m",
                self.ground_z_m,
                "a number between -1e6 and 1e6",
            ));
        }
        if !(2..=100_000).contains(&self.ray_particles) {
            return Err(Error::out_of_range(
                "ray_particles",
                self.ray_particles,
                "2 to 100000",
            ));
        }
        check_sigma("position_sigma_m", self.position_sigma_m)?;
        check_sigma("velocity_sigma_mps", self.velocity_sigma_mps)
    }

    /// Returns an error if the start's camera does not have this pixel, masks it or has no ray for it.
    pub fn check_in(&self, view: &View) -> Result<(), Error> {
        let (width, height) = view.size();
        let inside = |v: f64, size: usize| v >= -0.5 && v <= size as f64 - 0.5;
        let [u, v] = self.pixel;
        if inside(u, width) && inside(v, height) && self.ray(view, self.pixel).is_some() {
            let pixel = v.round().max(0.0) as usize * width + u.round().max(0.0) as usize;
            let is_open = |mask: &Mask| mask.open().get(pixel) == Some(&true);
            if view.mask().is_none_or(is_open) {
                return Ok(());
            }
            return Err(Error::out_of_range(
                "pixel_px",
                format!("{:?}", self.pixel),
                "a pixel that the camera's mask leaves open",
            ));
        }
        Err(Error::out_of_range(
            "pixel_px",
            format!("{:?}", self.pixel),
            &format!("a pixel of the {width} x {height} image inside the camera's field of view"),
        ))
    }

    fn around(&self, position_m: [f64; 3]) -> GaussianStart {
        GaussianStart {
            position_m,
            covariance_m2: diagonal_m2(self.position_sigma_m),
            velocity_mps: [0.0; 3],
            velocity_sigma_mps: self.velocity_sigma_mps,
        }
    }

    /// Returns the origin of the ray (the camera, or the point on its mirror) and its direction in the world, and the
    /// distances at which the search begins and ends in metres; `None` if the camera has no ray. A ray that does not
    /// meet the ground, such as one above the horizon, ends at the maximum range.
    fn ray(&self, view: &View, pixel: [f64; 2]) -> Option<(Point3<f64>, Vector3<f64>, [f64; 2])> {
        let ray = view.camera().unproject(pixel)?;
        let origin = view.world_from_camera() * Point3::from(ray.origin);
        let direction = view.world_from_camera() * Vector3::from(ray.direction);
        let to_ground = (self.ground_z_m - origin.z) / direction.z;
        let end = if to_ground > 0.0 {
            self.max_range_m.min(to_ground)
        } else {
            self.max_range_m
        };
        Some((origin, direction, [self.min_range_m.min(end), end]))
    }

    /// Searches along the ray, which must exist ([`PixelStart::check_in`]). The distances are spaced evenly in their
    /// logarithm, so that apparent sizes differ by equal factors, and each is drawn at random within its interval.
    ///
    /// A target of fixed height (`is_planar`) stands on the ground below the point on the ray. A flat one, at
    /// `flat_height_m` above the ground, lies where the ray reaches that height.
    pub fn search(
        &self,
        view: &View,
        likelihood: &mut impl Likelihood,
        is_planar: bool,
        flat_height_m: Option<f64>,
        draws: Draws,
        observation: u32,
    ) -> GaussianStart {
        let clicked_ray = self
            .ray(view, self.pixel)
            .expect("check_in accepted the pixel");
        let count = self.ray_particles;
        let mut particles = Particles::new(count, 3);
        for i in 0..count {
            let particle = i as u32;
            let share =
                (i as f64 + draws.uniform(particle, observation, Stage::Ray)) / count as f64;
            let [du, dv, ..] = draws
                .normals(particle, observation, Stage::Ray, 1)
                .map(f64::from);
            let pixel = [
                self.pixel[0] + self.pixel_sigma_px * du,
                self.pixel[1] + self.pixel_sigma_px * dv,
            ];
            let (origin, direction, [near, far]) = self.ray(view, pixel).unwrap_or(clicked_ray);
            let to_surface = flat_height_m
                .filter(|_| is_planar)
                .map(|height_m| (self.ground_z_m + height_m - origin.z) / direction.z)
                .filter(|&distance_m| distance_m > 0.0 && distance_m.is_finite());
            let distance_m = to_surface.unwrap_or(near * libm::pow(far / near, share));
            let mut position = origin + direction * distance_m;
            if is_planar {
                position.z = self.ground_z_m;
            }
            for axis in 0..3 {
                particles.columns_mut()[axis][i] = position[axis] as f32;
            }
        }
        let mut log_likelihoods = vec![0.0; count];
        likelihood.log_likelihoods(&particles, &mut log_likelihoods);
        let best = (0..count)
            .filter(|&i| !log_likelihoods[i].is_nan())
            .reduce(|best, i| {
                if log_likelihoods[i] > log_likelihoods[best] {
                    i
                } else {
                    best
                }
            })
            .unwrap_or(count / 2);
        self.around(particles.position_m(best))
    }
}
