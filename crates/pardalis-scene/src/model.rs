//! Camera models: the table `model` of scenes, worlds and calibration files.

use super::description::{Presence, above};
use super::mirror;
use super::plane::{self, PlaneModel, RectangleConfig};
use super::reader::{Kind, Located, Table};
use pardalis_camera::Pose;
use pardalis_camera::{
    Camera, DoubleSphere, Equidistant, ExactMirror, ExtendedUnified, KannalaBrandt, Mei, Ocam,
    PerspectiveMirror, Pinhole, Plane, Unified,
};
use pardalis_core::Error;

/// A camera's model.
pub(super) enum Model {
    Known(Camera),
    /// A model that is determined by a rectangle in the camera's images.
    Rectangle(Located<RectangleConfig>),
}

const KINDS: [Kind; 12] = [
    (
        "equidistant",
        "Fisheye lens with r = f·θ, where θ is the angle from the optical axis.",
    ),
    (
        "pinhole",
        "Perspective camera, with the distortion of OpenCV's `calibrateCamera`.",
    ),
    (
        "kannala_brandt",
        "Fisheye lens with a polynomial of θ: OpenCV's `fisheye` module, Kalibr's `pinhole-equi`.",
    ),
    (
        "unified",
        "Unified model of central catadioptric cameras (Geyer and Daniilidis 2000), with the parameters l and m of Taiana et al.",
    ),
    (
        "mei",
        "Unified model with distortion (Mei and Rives 2007): OpenCV's `omnidir` module, Kalibr's `omni`.",
    ),
    (
        "perspective_mirror",
        "Perspective approximation of a mirror of constant horizontal resolution.",
    ),
    (
        "double_sphere",
        "Double sphere model of wide lenses (Usenko et al. 2018).",
    ),
    (
        "extended_unified",
        "Extended unified camera model (Khomutenko et al. 2016).",
    ),
    (
        "ocam",
        "Polynomial model of omnidirectional cameras (Scaramuzza et al. 2006), as OCamCalib writes it.",
    ),
    (
        "exact_mirror",
        "Perspective camera that looks at a rotationally symmetric mirror, by exact reflection. Give the mirror as `profile` or as one of the tables below.",
    ),
    (
        "plane",
        "Camera of which only the mapping of one plane, z = 0 of the world, to the image is known. Give it as `points`, `homography` or `rectangle`.",
    ),
    (
        "image",
        "No calibration: the image itself is the world's plane, and positions are in pixels.",
    ),
];

/// Reads the camera's model from the table `model`, for files without images, in which a rectangle cannot be detected.
pub(super) fn read_model(table: &Table) -> Option<Camera> {
    match read_any_model(table)? {
        Model::Known(camera) => Some(camera),
        Model::Rectangle(_) => {
            let message = "needs the camera's images, which only a scene has; give points or homography, as `pardalis calibrate plane` writes them";
            table.problem("model", message);
            None
        }
    }
}

/// Reads the camera's model from the table `model`.
pub(super) fn read_any_model(table: &Table) -> Option<Model> {
    let about = "The camera's model with its parameters.";
    let unless = Presence::RequiredIf("unless `calibration` is given");
    let found = table.choice("model", about, &KINDS, unless, read_kind);
    if !table.has("model") {
        table.problem(
            "model",
            "is missing; give a table such as [cameras.NAME.model.equidistant], or in a scene calibration = \"FILE\"",
        );
    }
    found
}

fn read_kind(kind: &'static str, table: &Table) -> Option<Model> {
    match kind {
        "plane" => {
            return Some(match plane::read_plane(table)? {
                PlaneModel::Known(plane) => Model::Known(Camera::Plane(plane)),
                PlaneModel::Rectangle(config) => Model::Rectangle(table.at("rectangle", config)),
            });
        }
        "image" => return Some(Model::Known(Camera::Plane(Plane::image()))),
        _ => {}
    }
    let center_px = table
        .key(
            "center_px",
            "Principal point: column and row, with pixel centres at whole numbers.",
        )
        .within(-1e6..=1e6)
        .required::<[f64; 2]>();
    let camera = match kind {
        "equidistant" => read_equidistant(table, center_px),
        "pinhole" => read_pinhole(table, center_px),
        "kannala_brandt" => read_kannala_brandt(table, center_px),
        "unified" => read_unified(table, center_px),
        "mei" => read_mei(table, center_px),
        "perspective_mirror" => read_perspective_mirror(table, center_px),
        "double_sphere" => read_double_sphere(table, center_px),
        "extended_unified" => read_extended_unified(table, center_px),
        "ocam" => read_ocam(table, center_px),
        _ => read_exact_mirror(table, center_px),
    };
    camera.map(Model::Known)
}

/// Returns the pose of cameras whose model is a plane of the world: the world's frame.
pub(super) fn pose_of_model(camera: &Camera) -> Option<Pose> {
    matches!(camera, Camera::Plane(_)).then(Pose::identity)
}

/// Returns the principal point, which all other models have.
pub(super) fn principal_point_px(camera: &Camera) -> [f64; 2] {
    let parameters = camera.parameters();
    ["cx_px", "cy_px"].map(|name| {
        let found = parameters.iter().find(|(known, _)| *known == name);
        found.map_or(0.0, |&(_, value)| value)
    })
}

/// Renames the principal point to its key.
fn at_center<T>(result: Result<T, Error>) -> Result<T, Error> {
    result.map_err(|error| match error {
        Error::OutOfRange {
            name,
            value,
            allowed,
        } if name == "cx_px" || name == "cy_px" => Error::OutOfRange {
            name: "center_px".to_owned(),
            value,
            allowed,
        },
        other => other,
    })
}

/// Maximum focal length in pixels.
const MAX_FOCAL: f64 = 1e6;
/// Maximum magnitude of a distortion coefficient.
const MAX_COEFFICIENT: f64 = 1e9;

/// Reads the field of view and returns half of it, in radians.
fn read_max_angle(table: &Table) -> f64 {
    let field_of_view_deg: f64 = table
        .key(
            "field_of_view_deg",
            "Full field of view; directions outside it have no pixel.",
        )
        .within(above(0.0, 360.0))
        .or(360.0);
    (field_of_view_deg / 2.0).to_radians()
}

fn read_focals(table: &Table) -> Option<[f64; 2]> {
    table
        .key("f_px", "Focal lengths along columns and rows.")
        .within(above(0.0, MAX_FOCAL))
        .required()
}

fn read_equidistant(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = table
        .key("f_px_per_rad", "Focal length f.")
        .within(above(0.0, MAX_FOCAL))
        .required();
    let max_angle_rad = read_max_angle(table);
    let model = Equidistant::new(f?, center_px?, max_angle_rad);
    table.checked(at_center(model)).map(Camera::Equidistant)
}

fn read_pinhole(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let distortion: Vec<f64> = table
        .key(
            "distortion",
            "0, 4, 5, 8 or 12 coefficients in OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.",
        )
        .within(-MAX_COEFFICIENT..=MAX_COEFFICIENT)
        .or(Vec::new());
    let model = Pinhole::new(f?, center_px?, &distortion);
    table.checked(at_center(model)).map(Camera::Pinhole)
}

fn read_kannala_brandt(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let k = table
        .key("k", "Coefficients k1 to k4 of θ³, θ⁵, θ⁷ and θ⁹.")
        .within(-MAX_COEFFICIENT..=MAX_COEFFICIENT)
        .or([0.0; 4]);
    let max_angle_rad = read_max_angle(table);
    let model = KannalaBrandt::new(f?, center_px?, k, max_angle_rad);
    table.checked(at_center(model)).map(Camera::KannalaBrandt)
}

fn read_mei(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let skew_px = table
        .key("skew_px", "Skew of the pixels' axes.")
        .within(-MAX_COEFFICIENT..=MAX_COEFFICIENT)
        .or(0.0);
    let xi = table
        .key(
            "xi",
            "Distance ξ of the projection centre from the sphere's centre.",
        )
        .within(0.0..=1000.0)
        .required();
    let distortion = table
        .key("distortion", "Coefficients k1, k2, p1, p2.")
        .within(-MAX_COEFFICIENT..=MAX_COEFFICIENT)
        .or([0.0; 4]);
    let model = Mei::new(f?, skew_px, center_px?, xi?, distortion);
    table.checked(at_center(model)).map(Camera::Mei)
}

fn read_double_sphere(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let xi = table
        .key("xi", "Distance ξ between the two spheres' centres.")
        .within(above(-1.0, 1.0))
        .required();
    let alpha = table
        .key("alpha", "Weight α of the second projection.")
        .within(0.0..=1.0)
        .required();
    let model = DoubleSphere::new(f?, center_px?, xi?, alpha?);
    table.checked(at_center(model)).map(Camera::DoubleSphere)
}

fn read_extended_unified(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let alpha = table
        .key("alpha", "Weight α of the distance from the surface.")
        .within(0.0..=1.0)
        .required();
    let beta = table
        .key("beta", "Shape β of the surface; 1 is a sphere.")
        .within(above(0.0, 1e6))
        .required();
    let model = ExtendedUnified::new(f?, center_px?, alpha?, beta?);
    table.checked(at_center(model)).map(Camera::ExtendedUnified)
}

fn read_ocam(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let polynomial = table
        .key(
            "polynomial",
            "1 to 8 coefficients a0, a1, a2, ... of the image radius in pixels; a0 is negative.",
        )
        .within(-MAX_COEFFICIENT..=MAX_COEFFICIENT)
        .required::<Vec<f64>>();
    let affine = table
        .key(
            "affine",
            "Affine parameters c, d, e of the sensor; c - d·e is above 0.001.",
        )
        .within(-MAX_COEFFICIENT..=MAX_COEFFICIENT)
        .or([1.0, 0.0, 0.0]);
    let max_radius_px = table
        .key("max_radius_px", "Radius of the image circle.")
        .within(above(0.0, MAX_FOCAL))
        .required();
    let model = Ocam::new(&polynomial?, center_px?, affine, max_radius_px?);
    table.checked(at_center(model)).map(Camera::Ocam)
}

fn read_exact_mirror(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let profile = mirror::read_profile(table);
    let model = ExactMirror::new(f?, center_px?, profile?);
    table.checked(at_center(model)).map(Camera::ExactMirror)
}

fn read_unified(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let l = table
        .key(
            "l",
            "Distance l of the projection centre from the sphere's centre, in radii.",
        )
        .within(0.0..=1e6)
        .required();
    let m = table
        .key(
            "m",
            "Distance m of the image plane; l + m is above 0. In pixels if `f_px` is 1.",
        )
        .within(-1e6..=1e6)
        .required();
    let f_px = table
        .key("f_px", "Scale of the image.")
        .within(above(0.0, MAX_FOCAL))
        .or(1.0);
    table
        .checked(at_center(Unified::new(l?, m?, f_px, center_px?)))
        .map(Camera::Unified)
}

fn read_perspective_mirror(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let m_px = table
        .key("m_px", "Focal length of the approximation.")
        .within(above(0.0, MAX_FOCAL))
        .required();
    table
        .checked(at_center(PerspectiveMirror::new(m_px?, center_px?)))
        .map(Camera::PerspectiveMirror)
}
