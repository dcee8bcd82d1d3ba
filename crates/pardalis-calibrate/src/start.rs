//! Starting cameras for a calibration of which only the model is known: one per assumed field of view.

use pardalis_camera::{
    Camera, DoubleSphere, Equidistant, ExtendedUnified, KannalaBrandt, Mei, Ocam,
    PerspectiveMirror, Pinhole, Unified,
};

/// Camera models that can be fitted without an initial guess.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// Pinhole with distortion k1, k2, p1, p2, k3.
    Pinhole,
    /// Equidistant fisheye.
    Equidistant,
    /// Kannala-Brandt fisheye.
    KannalaBrandt,
    /// Unified model of mirror cameras with the parameters l and m.
    Unified,
    /// Unified model with distortion.
    Mei,
    /// Perspective model of mirror cameras.
    PerspectiveMirror,
    /// Double sphere.
    DoubleSphere,
    /// Extended unified model.
    ExtendedUnified,
    /// Scaramuzza's polynomial model with the coefficients a0 and a2 to a4.
    Ocam,
}

impl ModelKind {
    /// All models.
    pub const ALL: [Self; 9] = [
        Self::Pinhole,
        Self::Equidistant,
        Self::KannalaBrandt,
        Self::Unified,
        Self::Mei,
        Self::PerspectiveMirror,
        Self::DoubleSphere,
        Self::ExtendedUnified,
        Self::Ocam,
    ];

    /// Returns the model's name in scene files ([`Camera::kind`]).
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Equidistant => "equidistant",
            Self::KannalaBrandt => "kannala_brandt",
            Self::Unified => "unified",
            Self::Mei => "mei",
            Self::PerspectiveMirror => "perspective_mirror",
            Self::DoubleSphere => "double_sphere",
            Self::ExtendedUnified => "extended_unified",
            Self::Ocam => "ocam",
        }
    }

    /// Returns the model with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Returns the starting cameras. `radius_px` is the largest distance of an observed pixel from the image
    /// centre; each start assumes a different angle between the optical axis and the ray of that pixel.
    pub(super) fn starts(self, (width, height): (usize, usize), radius_px: f64) -> Vec<Camera> {
        let center = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        let angles_deg: &[f64] = match self {
            Self::Pinhole => &[10.0, 20.0, 32.0, 45.0, 58.0],
            Self::PerspectiveMirror => &[45.0, 60.0, 72.0, 80.0],
            Self::Unified => &[60.0, 75.0, 90.0, 110.0],
            _ => &[20.0, 35.0, 50.0, 65.0, 80.0, 95.0, 115.0],
        };
        let shapes: &[f64] = match self {
            Self::Unified | Self::Mei => &[0.7, 1.0, 1.6],
            _ => &[1.0],
        };
        angles_deg
            .iter()
            .map(|angle| angle.to_radians())
            .flat_map(|angle| shapes.iter().map(move |&shape| (angle, shape)))
            .filter_map(|(angle, shape)| self.start(center, radius_px, angle, shape))
            .collect()
    }

    /// Builds the camera that projects a ray at `angle` (radians) from the axis to `radius_px` from the centre.
    fn start(self, center: [f64; 2], radius_px: f64, angle: f64, shape: f64) -> Option<Camera> {
        let (sin, cos) = libm::sincos(angle);
        let tan_half = libm::tan(0.5 * angle);
        let pi = std::f64::consts::PI;
        let camera = match self {
            Self::Pinhole => {
                let f = radius_px * cos / sin;
                Pinhole::new([f; 2], center, &[]).map(Camera::Pinhole)
            }
            Self::Equidistant => {
                Equidistant::new(radius_px / angle, center, pi).map(Camera::Equidistant)
            }
            Self::KannalaBrandt => KannalaBrandt::new([radius_px / angle; 2], center, [0.0; 4], pi)
                .map(Camera::KannalaBrandt),
            Self::Unified => {
                // The scene has z < 0: ρ = (l + m)·sin/(l + cos), with the angle measured from −z.
                let m = radius_px * (shape + cos) / sin - shape;
                Unified::new(shape, m, 1.0, center).map(Camera::Unified)
            }
            Self::Mei => {
                let f = radius_px * (shape + cos) / sin;
                Mei::new([f; 2], 0.0, center, shape, [0.0; 4]).map(Camera::Mei)
            }
            Self::PerspectiveMirror => {
                PerspectiveMirror::new(radius_px * cos / sin, center).map(Camera::PerspectiveMirror)
            }
            // Both start as stereographic projections: ρ = 2f·tan(θ/2).
            Self::DoubleSphere => {
                DoubleSphere::new([radius_px / (2.0 * tan_half); 2], center, 0.0, 0.5)
                    .map(Camera::DoubleSphere)
            }
            Self::ExtendedUnified => {
                ExtendedUnified::new([radius_px / (2.0 * tan_half); 2], center, 0.5, 1.0)
                    .map(Camera::ExtendedUnified)
            }
            // Also stereographic: −f(ρ) = f − ρ²/(4f).
            Self::Ocam => {
                let f = radius_px / (2.0 * tan_half);
                let polynomial = [-f, 0.0, 0.25 / f, 0.0, 0.0];
                Ocam::new(&polynomial, center, [1.0, 0.0, 0.0], 2.0 * radius_px).map(Camera::Ocam)
            }
        };
        camera.ok()
    }
}

/// Reports for each of a camera's parameters, in the order of [`Camera::parameters`], whether calibration
/// varies it.
pub(super) fn free_parameters(camera: &Camera) -> Vec<bool> {
    // l + m and f have the same effect on scale; e rotates the image, as the pose does.
    let fixed: &[&str] = match camera {
        Camera::Pinhole(_) => &["k4", "k5", "k6", "s1", "s2", "s3", "s4"],
        Camera::Unified(_) => &["f_px"],
        Camera::Ocam(_) => &["e", "a1"],
        _ => &[],
    };
    let parameters = camera.parameters();
    // The degree of a polynomial is fixed.
    let used = match camera {
        Camera::Ocam(model) => parameters.len() - 8 + model.polynomial().len(),
        _ => parameters.len(),
    };
    let names = parameters.iter().map(|&(name, _)| name).enumerate();
    names
        .map(|(i, name)| i < used && !fixed.contains(&name))
        .collect()
}
