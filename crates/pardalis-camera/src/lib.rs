//! Camera models, poses, masks, homographies and calibration file formats.
//!
//! A camera model maps points to pixels ([`Camera::project`]) and pixels to rays
//! ([`Camera::unproject`]). The models range from the pinhole to fisheyes that see more than a
//! hemisphere and to catadioptric cameras, which look into a curved mirror.
//!
//! # Example
//!
//! A point is one metre in front of a fisheye camera. Find its pixel, and the ray of that pixel:
//!
//! ```
//! use pardalis_camera::{Camera, Equidistant, Error};
//!
//! // Focal length 145 px/rad, principal point (319.5, 239.5), 185 degrees field of view.
//! let lens = Equidistant::new(145.0, [319.5, 239.5], 92.5_f64.to_radians())?;
//! let camera = Camera::Equidistant(lens);
//!
//! let [u, v] = camera.project([0.0, 0.5, 1.0]).expect("the point is in view");
//! assert!((u - 319.5).abs() < 1e-9);
//! assert!((v - (239.5 + 145.0 * 0.5_f64.atan())).abs() < 1e-9);
//!
//! let ray = camera.unproject([u, v]).expect("the pixel is in view");
//! assert!((ray.direction[1] / ray.direction[2] - 0.5).abs() < 1e-9);
//!
//! // Points outside the field of view have no pixel.
//! assert_eq!(camera.project([0.0, 0.0, -1.0]), None);
//! # Ok::<(), Error>(())
//! ```
//!
//! Read the camera of a calibration file, here one written by ROS:
//!
//! ```
//! # #[cfg(feature = "formats")] {
//! use pardalis_camera::formats;
//!
//! let text = "
//! image_width: 640
//! image_height: 480
//! camera_name: front
//! camera_matrix: {rows: 3, cols: 3, data: [400, 0, 320, 0, 400, 240, 0, 0, 1]}
//! distortion_model: plumb_bob
//! distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.02, 0, 0, 0]}
//! ";
//! let cameras = formats::read(text, None)?;
//! assert_eq!(cameras[0].name, "front");
//! assert_eq!(cameras[0].camera.kind(), "pinhole");
//! # }
//! # Ok::<(), pardalis_camera::Error>(())
//! ```
//!
//! # Units and frames
//!
//! Lengths are in metres, angles in radians and image coordinates in pixels.
//!
//! - The *camera frame* has x to the right, y down and z along the optical axis. Cameras that look
//!   into a mirror look along +z at the mirror, so that most of the scene has z < 0.
//! - The *world frame* is right-handed; its z axis points up by convention. A [`Pose`] named
//!   `a_from_b` transforms coordinates of frame b to frame a.
//! - *Pixel coordinates* (u, v) point right and down. Pixel centres have integer coordinates: (0, 0) is
//!   the centre of the top left pixel.
//!
//! # Models
//!
//! | model | for |
//! |---|---|
//! | [`Pinhole`] | usual lenses, with Brown-Conrady distortion |
//! | [`Equidistant`], [`KannalaBrandt`] | fisheyes |
//! | [`DoubleSphere`], [`ExtendedUnified`], [`Mei`] | wide-angle lenses and fisheyes |
//! | [`Ocam`] | fisheyes and mirrors calibrated with OCamCalib |
//! | [`Unified`], [`PerspectiveMirror`] | mirrors with a single viewpoint, or approximately so |
//! | [`ExactMirror`] | any mirror of revolution, see [`MirrorProfile`] |
//! | [`Plane`] | an unknown camera above a plane |
//!
//! [`Camera`] holds any of them. All models are generic over the number type: double precision for
//! calibration, single precision for [many points at once](Camera::project_points), and dual numbers
//! for [derivatives](Camera::project_with_jacobian).
//!
//! # Other contents
//!
//! - [`formats`]: calibration files of OpenCV, ROS, Kalibr, OCamCalib and Basalt (feature `formats`,
//!   on by default).
//! - [`Pose`], [`CalibratedCamera`]: where a camera is. [`RigidMotion`]: how it moves between poses.
//! - [`Mask`]: which pixels of a camera are usable.
//! - [`Homography`]: the map from a plane to its image.
//! - [`ConstantResolution`]: design of mirrors.

mod batch;
mod distortion;
mod double_sphere;
mod equidistant;
mod exact_mirror;
mod extended_unified;
#[cfg(feature = "formats")]
pub mod formats;
mod homography;
mod jacobian;
mod kannala_brandt;
mod mask;
mod mei;
mod mirror;
mod ocam;
mod ocam_look_up;
mod perspective_mirror;
mod pinhole;
mod plane;
mod pose;
mod rigid_motion;
mod unified;

#[doc(hidden)]
pub use batch::{LANES, project_block};
pub use double_sphere::DoubleSphere;
pub use equidistant::Equidistant;
pub use exact_mirror::ExactMirror;
pub use extended_unified::ExtendedUnified;
pub use homography::Homography;
pub use jacobian::ProjectionJacobian;
pub use kannala_brandt::KannalaBrandt;
pub use mask::Mask;
pub use mei::Mei;
pub use mirror::{ConstantResolution, MirrorForm, MirrorLookUp, MirrorProfile, Resolution};
pub use ocam::Ocam;
pub use ocam_look_up::OcamLookUp;
pub use pardalis_core::Error;
pub use pardalis_core::simd::Level;
pub use perspective_mirror::PerspectiveMirror;
pub use pinhole::Pinhole;
pub use plane::Plane;
pub use pose::{CalibratedCamera, Pose, looking_at, nearest_pose, pose_from_matrix};
pub use rigid_motion::RigidMotion;
pub use unified::Unified;

use pardalis_core::real::Real;

/// The half line seen by a pixel, in the camera frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray<R> {
    /// Start of the ray in metres: the camera's origin for models with a single viewpoint, a point
    /// on the mirror for the exact mirror.
    pub origin: [R; 3],
    /// Unit direction.
    pub direction: [R; 3],
}

impl<R: Real> Ray<R> {
    /// Creates a ray from the camera's origin along a unit direction.
    fn from_camera(direction: [R; 3]) -> Self {
        Self {
            origin: [R::of(0.0); 3],
            direction,
        }
    }

    /// Creates a ray from the camera's origin along a direction of any length.
    fn towards([x, y, z]: [R; 3]) -> Self {
        let inverse = R::of(1.0) / (x * x + y * y + z * z).sqrt();
        Self::from_camera([x * inverse, y * inverse, z * inverse])
    }

    /// Creates a ray from the camera's origin at an angle from the optical axis, towards the image
    /// direction (x, y) of length `rho`.
    fn at_angle(angle_rad: R, [x, y]: [R; 2], rho: R) -> Self {
        let (sin, cos) = angle_rad.sin_cos();
        let on_axis = !(rho > R::of(0.0));
        let scale = if on_axis { R::of(0.0) } else { sin / rho };
        Self::from_camera([x * scale, y * scale, cos])
    }
}

/// A camera model.
///
/// Invariant, tested over the whole field of view of every model: if `project` reports a point as
/// valid, the point lies on the ray that `unproject` returns for its pixel.
pub trait Projection<R: Real>: Send + Sync {
    /// Returns the pixel of a point in the camera frame (metres), and whether the point lies in the
    /// model's domain. Outside the domain the pixel is meaningless. The function is free of
    /// branches, so that it vectorises.
    fn project(&self, point_in_camera: [R; 3]) -> ([R; 2], bool);

    /// Returns the ray of a pixel, or `None` if the pixel lies outside the model's domain.
    fn unproject(&self, pixel: [R; 2]) -> Option<Ray<R>>;
}

/// Any camera model.
#[derive(Debug, Clone, PartialEq)]
pub enum Camera {
    /// Equidistant fisheye.
    Equidistant(Equidistant<f64>),
    /// Pinhole with Brown-Conrady distortion.
    Pinhole(Pinhole<f64>),
    /// Kannala-Brandt fisheye (OpenCV's fisheye module).
    KannalaBrandt(KannalaBrandt<f64>),
    /// Unified model of catadioptric (mirror) cameras in the form of the thesis.
    Unified(Unified<f64>),
    /// Unified model with distortion, Mei's form (OpenCV's omnidir module).
    Mei(Mei<f64>),
    /// Perspective model of catadioptric cameras.
    PerspectiveMirror(PerspectiveMirror<f64>),
    /// Double sphere.
    DoubleSphere(DoubleSphere<f64>),
    /// Extended unified model.
    ExtendedUnified(ExtendedUnified<f64>),
    /// Scaramuzza's polynomial (OCamCalib).
    Ocam(Ocam<f64>),
    /// Exact model of a perspective camera in front of a mirror of revolution.
    ExactMirror(ExactMirror<f64>),
    /// A camera of unknown lens and pose, described by its view of the plane z = 0.
    Plane(Plane<f64>),
}

macro_rules! from_model {
    ($($model:ident),+ $(,)?) => {
        $(impl From<$model<f64>> for Camera {
            fn from(model: $model<f64>) -> Self {
                Self::$model(model)
            }
        })+
    };
}

from_model!(
    Equidistant,
    Pinhole,
    KannalaBrandt,
    Unified,
    Mei,
    PerspectiveMirror,
    DoubleSphere,
    ExtendedUnified,
    Ocam,
    ExactMirror,
    Plane,
);

/// Evaluates `$body` with `$model` bound to the concrete model of the camera: static dispatch in a
/// single place.
#[doc(hidden)]
#[macro_export]
macro_rules! with_model {
    ($camera:expr, $model:ident => $body:expr) => {
        match $camera {
            $crate::Camera::Equidistant($model) => $body,
            $crate::Camera::Pinhole($model) => $body,
            $crate::Camera::KannalaBrandt($model) => $body,
            $crate::Camera::Unified($model) => $body,
            $crate::Camera::Mei($model) => $body,
            $crate::Camera::PerspectiveMirror($model) => $body,
            $crate::Camera::DoubleSphere($model) => $body,
            $crate::Camera::ExtendedUnified($model) => $body,
            $crate::Camera::Ocam($model) => $body,
            $crate::Camera::ExactMirror($model) => $body,
            $crate::Camera::Plane($model) => $body,
        }
    };
}

/// Evaluates `$body`, which returns a model, and wraps the model as a camera of the same kind.
macro_rules! map_model {
    ($camera:expr, $model:ident => $body:expr) => {
        match $camera {
            Camera::Equidistant($model) => $body.map(Camera::Equidistant),
            Camera::Pinhole($model) => $body.map(Camera::Pinhole),
            Camera::KannalaBrandt($model) => $body.map(Camera::KannalaBrandt),
            Camera::Unified($model) => $body.map(Camera::Unified),
            Camera::Mei($model) => $body.map(Camera::Mei),
            Camera::PerspectiveMirror($model) => $body.map(Camera::PerspectiveMirror),
            Camera::DoubleSphere($model) => $body.map(Camera::DoubleSphere),
            Camera::ExtendedUnified($model) => $body.map(Camera::ExtendedUnified),
            Camera::Ocam($model) => $body.map(Camera::Ocam),
            Camera::ExactMirror($model) => $body.map(Camera::ExactMirror),
            Camera::Plane($model) => $body.map(Camera::Plane),
        }
    };
}

impl Camera {
    /// Returns the pixel of a point (camera frame, metres), or `None` outside the model's domain.
    /// To project many points, use [`Camera::project_points`] or [`Camera::project_rows`], which are faster.
    pub fn project(&self, point_in_camera: [f64; 3]) -> Option<[f64; 2]> {
        let (pixel, valid) = with_model!(self, model => model.project(point_in_camera));
        valid.then_some(pixel)
    }

    /// Returns the ray of a pixel, or `None` if the pixel lies outside the model's domain.
    pub fn unproject(&self, pixel: [f64; 2]) -> Option<Ray<f64>> {
        with_model!(self, model => model.unproject(pixel))
    }

    /// Returns the point through which all rays pass, in metres in the camera frame. The exact
    /// mirror has no such point; the result is then a point close to all its rays. Outlines of
    /// bodies are computed for this viewpoint.
    pub fn viewpoint_m(&self) -> [f64; 3] {
        match self {
            Self::ExactMirror(mirror) => mirror.viewpoint_m(),
            Self::Plane(plane) => plane.viewpoint_m(),
            _ => [0.0; 3],
        }
    }

    /// Returns the name of the model, as in scene files.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Equidistant(_) => "equidistant",
            Self::Pinhole(_) => "pinhole",
            Self::KannalaBrandt(_) => "kannala_brandt",
            Self::Unified(_) => "unified",
            Self::Mei(_) => "mei",
            Self::PerspectiveMirror(_) => "perspective_mirror",
            Self::DoubleSphere(_) => "double_sphere",
            Self::ExtendedUnified(_) => "extended_unified",
            Self::Ocam(_) => "ocam",
            Self::ExactMirror(_) => "exact_mirror",
            Self::Plane(_) => "plane",
        }
    }

    /// Reports whether the camera looks along +z into a mirror, so that the scene lies around −z.
    pub fn looks_into_mirror(&self) -> bool {
        matches!(
            self,
            Self::Unified(_) | Self::PerspectiveMirror(_) | Self::ExactMirror(_)
        )
    }

    /// Returns the names and values of the model's parameters, in the order of
    /// [`Camera::with_parameters`].
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        fn named<const N: usize>(
            names: [&'static str; N],
            values: [f64; N],
        ) -> Vec<(&'static str, f64)> {
            names.into_iter().zip(values).collect()
        }
        match self {
            Self::Equidistant(model) => named(Equidistant::<f64>::NAMES, model.parameters()),
            Self::Pinhole(model) => named(Pinhole::<f64>::NAMES, model.parameters()),
            Self::KannalaBrandt(model) => named(KannalaBrandt::<f64>::NAMES, model.parameters()),
            Self::Unified(model) => named(Unified::<f64>::NAMES, model.parameters()),
            Self::Mei(model) => named(Mei::<f64>::NAMES, model.parameters()),
            Self::PerspectiveMirror(model) => {
                named(PerspectiveMirror::<f64>::NAMES, model.parameters())
            }
            Self::DoubleSphere(model) => named(DoubleSphere::<f64>::NAMES, model.parameters()),
            Self::ExtendedUnified(model) => {
                named(ExtendedUnified::<f64>::NAMES, model.parameters())
            }
            Self::Ocam(model) => named(Ocam::<f64>::NAMES, model.parameters()),
            Self::ExactMirror(model) => named(ExactMirror::<f64>::NAMES, model.parameters()),
            Self::Plane(model) => named(Plane::<f64>::NAMES, model.parameters()),
        }
    }

    /// Returns a camera of the same model with other parameters, in the order and number of
    /// [`Camera::parameters`]. The parameters are checked like those of a new camera.
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self, Error> {
        fn exactly<const N: usize>(parameters: &[f64]) -> [f64; N] {
            parameters
                .try_into()
                .expect("the number of parameters must equal that of Camera::parameters")
        }
        map_model!(self, model => model.with_parameters(exactly(parameters)))
    }
}

fn check_focals([fx_px, fy_px]: [f64; 2]) -> Result<(), Error> {
    check_focal("fx_px", fx_px)?;
    check_focal("fy_px", fy_px)
}

fn check_focal(name: &str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 && value <= 1e6 {
        return Ok(());
    }
    Err(Error::out_of_range(
        name,
        value,
        "a positive number up to 1e6",
    ))
}

fn check_principal_point([cx, cy]: [f64; 2]) -> Result<(), Error> {
    for (name, value) in [("cx_px", cx), ("cy_px", cy)] {
        if !(value.abs() <= 1e6) {
            return Err(Error::out_of_range(
                name,
                value,
                "a number between -1e6 and 1e6",
            ));
        }
    }
    Ok(())
}

/// Returns the angle θ of a point from the optical axis, θ/r with r = √(x² + y²), and whether both are defined: they are
/// not on the axis behind the camera.
#[inline(always)]
fn axis_angle<R: Real>([x, y, z]: [R; 3]) -> (R, R, bool) {
    let r = (x * x + y * y).sqrt();
    let angle = r.atan2(z);
    let on_axis = !(r > R::of(1e-30));
    let ahead = z > R::of(0.0);
    // θ/r tends to 1/z on the axis, where the quotient is undefined.
    let angle_over_r = if on_axis {
        R::of(1.0) / if ahead { z } else { R::of(1.0) }
    } else {
        angle / r
    };
    (angle, angle_over_r, ahead || !on_axis)
}

/// Checks the parameter α of the double sphere and the extended unified model. Returns the w (w1) of their domain.
fn domain_of_alpha(alpha: f64) -> Result<f64, Error> {
    if !(0.0..=1.0).contains(&alpha) {
        return Err(Error::out_of_range("alpha", alpha, "0 to 1"));
    }
    Ok(if alpha <= 0.5 {
        alpha / (1.0 - alpha)
    } else {
        (1.0 - alpha) / alpha
    })
}

fn check_angle(name: &str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value <= std::f64::consts::PI {
        return Ok(());
    }
    Err(Error::out_of_range(
        name,
        value,
        "above 0 and at most pi (180 degrees)",
    ))
}

fn check_coefficients(name: &str, values: &[f64]) -> Result<(), Error> {
    match values.iter().find(|v| !(v.abs() <= 1e9)) {
        None => Ok(()),
        Some(value) => Err(Error::out_of_range(
            name,
            value,
            "numbers between -1e9 and 1e9",
        )),
    }
}
