//! The contour cue's log-likelihood over scaled outlines and along a ray.

use anyhow::Result;
use nalgebra::{Point3, Vector3};
use pardalis::Frame;
use pardalis::color::ColorModel;
use pardalis::likelihood::{ContourSettings, Sampling};
use pardalis::reference::contour_log_likelihood;
use pardalis::shape::{Section, Shape};
use pardalis::view::View;

use crate::draw::likelihood::Curve;
use crate::user_error::user_error;

/// Range of scales of the outline.
const SCALES: [f64; 2] = [0.5, 2.0];
/// Smallest distance along the ray, in metres.
const MIN_RANGE_M: f64 = 0.3;
/// Number of points of a curve.
const POINTS: usize = 601;

/// Everything that determines a likelihood except the cue's settings and the position.
pub(super) struct Setup<'a> {
    pub(super) shape: Shape,
    pub(super) colors: &'a ColorModel,
    pub(super) views: &'a [View],
    pub(super) frames: &'a [(usize, Frame)],
}

impl Setup<'_> {
    /// Returns the log-likelihood ratio to pure background in nats.
    fn nats(&self, settings: &ContourSettings, shape: &Shape, position_m: [f64; 3]) -> f64 {
        let (views, frames) = (self.views, self.frames);
        contour_log_likelihood(settings, shape, self.colors, views, frames, position_m)
            - settings.background_log_likelihood()
    }
}

/// Returns the scene's settings and, if other contours are given, the same settings with those, each with a name.
pub(super) fn with_contours(
    settings: &ContourSettings,
    contours: Option<[f64; 2]>,
) -> Result<Vec<(String, ContourSettings)>> {
    let named = |settings: ContourSettings| {
        let name = match settings.sampling {
            Sampling::Scaled(scaled) => {
                format!("contours {} and {}", scaled.inner_scale, scaled.outer_scale)
            }
            Sampling::Spline(spline) => format!("B-spline, {} px", spline.reach_px),
        };
        (name, settings)
    };
    let mut all = vec![named(*settings)];
    if let Some([inner, outer]) = contours {
        let Sampling::Scaled(scaled) = settings.sampling else {
            return Err(user_error!(
                "--contours {inner},{outer}: the scene's cue samples along a B-spline, which has no such scales"
            ));
        };
        let mut other = *settings;
        other.sampling = Sampling::Scaled(pardalis::likelihood::ScaledSampling {
            inner_scale: inner,
            outer_scale: outer,
            ..scaled
        });
        other
            .sampling
            .check(other.points)
            .map_err(|error| user_error!("--contours {inner},{outer}: {error}"))?;
        all.push(named(other));
    }
    Ok(all)
}

/// Returns a shape scaled by a factor.
fn scaled(shape: &Shape, scale: f64) -> Shape {
    let mut shape = *shape;
    match &mut shape {
        Shape::Sphere(sphere) => sphere.radius_m *= scale,
        Shape::Upright(upright) => {
            upright.height_m *= scale;
            match &mut upright.section {
                Section::Circle { radius_m } => *radius_m *= scale,
                Section::Polygon { apothem_m, .. } => *apothem_m *= scale,
                Section::Rectangle { size_m } => *size_m = size_m.map(|size_m| scale * size_m),
            }
        }
        Shape::Flat(_) => {}
    }
    shape
}

/// Returns the likelihood of a target at one position, scaled by a range of factors.
pub(super) fn over_scales(
    setup: &Setup<'_>,
    settings: &[(String, ContourSettings)],
    position_m: [f64; 3],
) -> Vec<Curve> {
    let [least, most] = SCALES;
    curves(settings, &spread(least, most), |settings, scale| {
        setup.nats(settings, &scaled(&setup.shape, scale), position_m)
    })
}

/// Returns the likelihood along the ray through a pixel, and the distance of a position from the ray's origin.
pub(super) fn along_ray(
    setup: &Setup<'_>,
    settings: &[(String, ContourSettings)],
    pixel: [f64; 2],
    position_m: [f64; 3],
    max_range_m: f64,
) -> Result<(Vec<Curve>, f64)> {
    let view = &setup.views[0];
    let Some(ray) = view.camera().unproject(pixel) else {
        let [u, v] = pixel;
        return Err(user_error!(
            "--pixel {u},{v}: lies outside the camera's field of view"
        ));
    };
    let origin = view.world_from_camera() * Point3::from(ray.origin);
    let direction = view.world_from_camera() * Vector3::from(ray.direction);
    let far_m = max_range_m.max(2.0 * MIN_RANGE_M);
    let found = curves(
        settings,
        &spread(MIN_RANGE_M, far_m),
        |settings, range_m| {
            let at = origin + direction * range_m;
            setup.nats(settings, &setup.shape, at.into())
        },
    );
    Ok((found, (Point3::from(position_m) - origin).norm()))
}

/// Returns values from one to another with equal ratios.
fn spread(least: f64, most: f64) -> Vec<f64> {
    let share = |i: usize| i as f64 / (POINTS - 1) as f64;
    let at = |i: usize| least * libm::pow(most / least, share(i));
    (0..POINTS).map(at).collect()
}

fn curves(
    settings: &[(String, ContourSettings)],
    values: &[f64],
    nats: impl Fn(&ContourSettings, f64) -> f64,
) -> Vec<Curve> {
    let curve = |(name, settings): &(String, ContourSettings)| Curve {
        name: name.clone(),
        points: values.iter().map(|&v| [v, nats(settings, v)]).collect(),
    };
    settings.iter().map(curve).collect()
}

/// Returns curves over the same values as a CSV table: the values, then a column of nats per curve.
pub(super) fn to_csv(x_name: &str, curves: &[Curve]) -> String {
    use std::fmt::Write as _;
    let mut text = x_name.to_owned();
    for curve in curves {
        // Writing to a String cannot fail.
        let _ = write!(text, ",\"{} (nats)\"", curve.name);
    }
    text.push('\n');
    for (i, [value, _]) in curves[0].points.iter().enumerate() {
        let _ = write!(text, "{value}");
        for curve in curves {
            let _ = write!(text, ",{}", curve.points[i][1]);
        }
        text.push('\n');
    }
    text
}
