//! Where a calibration starts when nothing but the model's kind is known: cameras of several fields of view.

use pardalis_camera::{
    Camera, DoubleSphere, Equidistant, ExtendedUnified, KannalaBrandt, Mei, Ocam,
    PerspectiveMirror, Pinhole, Unified,
};

/// The models that can be fitted without a guess.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelKind {
    /// Pinhole with k1, k2, p1, p2, k3.
    Pinhole,
    /// Equidistant fisheye.
    Equidistant,
    /// Kannala-Brandt fisheye.
    KannalaBrandt,
    /// Unified model of mirror cameras, the thesis' l and m.
    Unified,
    /// Unified model with distortion.
    Mei,
    /// Perspective model of mirror cameras.
    PerspectiveMirror,
    /// Double sphere.
    DoubleSphere,
    /// Extended unified model.
    ExtendedUnified,
    /// Scaramuzza's polynomial, a0 and a2 to a4.
    Ocam,
}

impl ModelKind {
    /// All of them.
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

    /// The name, as scene files have it ([`Camera::kind`]).
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

    /// The kind of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Cameras to start from. `radius_px` is how far from the middle of the image the farthest point was seen; its ray is supposed at several
    /// angles from the axis.
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

    /// The camera whose ray at `angle` from the axis is seen `radius_px` from the middle.
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
                // The scene has z < 0: ρ = (l + m)·sin/(l + cos) of the angle from −z.
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
            // Both are stereographic here: ρ = 2f·tan(θ/2).
            Self::DoubleSphere => {
                DoubleSphere::new([radius_px / (2.0 * tan_half); 2], center, 0.0, 0.5)
                    .map(Camera::DoubleSphere)
            }
            Self::ExtendedUnified => {
                ExtendedUnified::new([radius_px / (2.0 * tan_half); 2], center, 0.5, 1.0)
                    .map(Camera::ExtendedUnified)
            }
            // The same projection: −f(ρ) = f − ρ²/(4f).
            Self::Ocam => {
                let f = radius_px / (2.0 * tan_half);
                let polynomial = [-f, 0.0, 0.25 / f, 0.0, 0.0];
                Ocam::new(&polynomial, center, [1.0, 0.0, 0.0], 2.0 * radius_px).map(Camera::Ocam)
            }
        };
        camera.ok()
    }
}

/// Which of a camera's parameters calibration varies, in the order of [`Camera::parameters`].
pub(super) fn free_parameters(camera: &Camera) -> Vec<bool> {
    // l + m and f scale the same; e turns the image as the pose does.
    let fixed: &[&str] = match camera {
        Camera::Pinhole(_) => &["k4", "k5", "k6", "s1", "s2", "s3", "s4"],
        Camera::Unified(_) => &["f_px"],
        Camera::Ocam(_) => &["e", "a1"],
        _ => &[],
    };
    let parameters = camera.parameters();
    // A polynomial keeps its degree.
    let used = match camera {
        Camera::Ocam(model) => parameters.len() - 8 + model.polynomial().len(),
        _ => parameters.len(),
    };
    let names = parameters.iter().map(|&(name, _)| name).enumerate();
    names
        .map(|(i, name)| i < used && !fixed.contains(&name))
        .collect()
}
