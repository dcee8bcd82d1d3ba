//! Basalt's calibration: JSON as the cereal library writes it, below the key `value0`. The world is
//! the frame of the IMU.

use std::f64::consts::PI;

use nalgebra::{Quaternion, Rotation3, Translation3, UnitQuaternion};

use super::document::Entry;
use super::intrinsics::size_from_pair;
use super::output;
use crate::pose::{CalibratedCamera, Pose};
use crate::{Camera, DoubleSphere, ExtendedUnified, KannalaBrandt, Pinhole};
use pardalis_core::Error;

/// Tolerance of the length of a quaternion.
const UNIT_TOLERANCE: f64 = 1e-3;

/// Largest distance of a camera from the IMU, in metres.
const MAX_OFFSET_M: f64 = 1e6;

/// Reads the cameras of a document. A single camera with the identity transform has no pose: Basalt
/// writes it for cameras without an IMU.
pub(super) fn read(root: &Entry) -> Result<Vec<CalibratedCamera>, Error> {
    let root = root.required("value0")?;
    let intrinsics = root.required("intrinsics")?;
    let tables = intrinsics.items()?;
    let per_camera = |key: &str| {
        let entry = root.required(key)?;
        let items = entry.items()?;
        if items.len() == tables.len() {
            return Ok(items);
        }
        Err(entry.error(format!(
            "has {} entries, but intrinsics has {}",
            items.len(),
            tables.len()
        )))
    };
    let transforms = per_camera("T_imu_cam")?;
    let sizes = per_camera("resolution")?;
    let mut cameras = Vec::new();
    for (i, table) in tables.iter().enumerate() {
        let pose = read_transform(&transforms[i])?;
        let is_placeholder = tables.len() == 1 && pose == Pose::identity();
        cameras.push(CalibratedCamera {
            name: format!("cam{i}"),
            camera: read_camera(table)?,
            size_px: Some(size_from_pair(&sizes[i])?),
            world_from_camera: (!is_placeholder).then_some(pose),
        });
    }
    Ok(cameras)
}

fn numbers<const N: usize>(table: &Entry, keys: [&str; N]) -> Result<[f64; N], Error> {
    let mut values = [0.0; N];
    for (value, key) in values.iter_mut().zip(keys) {
        *value = table.required(key)?.number()?;
    }
    Ok(values)
}

fn read_transform(table: &Entry) -> Result<Pose, Error> {
    let [x, y, z] = numbers(table, ["px", "py", "pz"])?;
    let [i, j, k, w] = numbers(table, ["qx", "qy", "qz", "qw"])?;
    if [x, y, z].iter().any(|v| v.abs() > MAX_OFFSET_M) {
        return Err(table.error("has an offset beyond 1e6 metres; allowed: at most 1e6"));
    }
    let quaternion = Quaternion::new(w, i, j, k);
    let length = quaternion.norm();
    if !((length - 1.0).abs() <= UNIT_TOLERANCE) {
        return Err(table.error(format!(
            "has a quaternion of length {length}; allowed: length 1"
        )));
    }
    let rotation = Rotation3::from(UnitQuaternion::new_normalize(quaternion));
    Ok(Pose::from_parts(Translation3::new(x, y, z), rotation))
}

fn read_camera(table: &Entry) -> Result<Camera, Error> {
    let kind = table.required("camera_type")?;
    let values = table.required("intrinsics")?;
    let [fx, fy, cx, cy] = numbers(&values, ["fx", "fy", "cx", "cy"])?;
    let (f, c) = ([fx, fy], [cx, cy]);
    let camera = match kind.text()?.as_str() {
        "pinhole" => Pinhole::new(f, c, &[]).map(Camera::Pinhole),
        "pinhole-radtan8" => {
            let k = numbers(&values, ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"])?;
            Pinhole::new(f, c, &k).map(Camera::Pinhole)
        }
        "kb4" => {
            let k = numbers(&values, ["k1", "k2", "k3", "k4"])?;
            KannalaBrandt::new(f, c, k, PI).map(Camera::KannalaBrandt)
        }
        "ds" => {
            let [xi, alpha] = numbers(&values, ["xi", "alpha"])?;
            DoubleSphere::new(f, c, xi, alpha).map(Camera::DoubleSphere)
        }
        "eucm" => {
            let [alpha, beta] = numbers(&values, ["alpha", "beta"])?;
            ExtendedUnified::new(f, c, alpha, beta).map(Camera::ExtendedUnified)
        }
        "ucm" => {
            let [alpha] = numbers(&values, ["alpha"])?;
            ExtendedUnified::new(f, c, alpha, 1.0).map(Camera::ExtendedUnified)
        }
        _ => return Err(kind.invalid("pinhole, pinhole-radtan8, kb4, ds, eucm, ucm")),
    };
    values.checked(camera)
}

/// Returns the text of a rig. The IMU parameters that Basalt requires are written as zeros.
pub(super) fn write(cameras: &[CalibratedCamera]) -> Result<String, Error> {
    let poses = match output::poses(cameras)? {
        Some(poses) => poses,
        None if cameras.len() == 1 => vec![Pose::identity()],
        None => {
            return Err(output::not_representable(
                &cameras[0],
                "the pose",
                "missing",
                "world_from_camera for each camera of a Basalt file with several cameras; or write each camera to its own file",
            ));
        }
    };
    let mut sizes = Vec::new();
    let mut intrinsics = Vec::new();
    for camera in cameras {
        let (width, height) = output::size_px(camera)?;
        sizes.push(format!("[{width}, {height}]"));
        intrinsics.push(intrinsics_of(camera)?);
    }
    let transforms: Vec<_> = poses.iter().map(transform_text).collect();
    let listed = |items: &[String]| {
        format!(
            "[\n            {}\n        ]",
            items.join(",\n            ")
        )
    };
    let zeros = |count| format!("[{}]", output::numbers(&vec![0.0; count]));
    let fields = [
        ("T_imu_cam", listed(&transforms)),
        ("intrinsics", listed(&intrinsics)),
        ("resolution", listed(&sizes)),
        ("calib_accel_bias", zeros(9)),
        ("calib_gyro_bias", zeros(12)),
        ("imu_update_rate", output::number(0.0)),
        ("accel_noise_std", zeros(3)),
        ("gyro_noise_std", zeros(3)),
        ("accel_bias_std", zeros(3)),
        ("gyro_bias_std", zeros(3)),
        ("cam_time_offset_ns", "0".to_owned()),
        ("vignette", "[]".to_owned()),
    ];
    let fields: Vec<_> = fields
        .iter()
        .map(|(key, value)| format!("        \"{key}\": {value}"))
        .collect();
    Ok(format!(
        "{{\n    \"value0\": {{\n{}\n    }}\n}}\n",
        fields.join(",\n")
    ))
}

fn object(fields: impl IntoIterator<Item = (&'static str, f64)>) -> String {
    let fields: Vec<_> = fields
        .into_iter()
        .map(|(key, value)| format!("\"{key}\": {}", output::number(value)))
        .collect();
    format!("{{ {} }}", fields.join(", "))
}

fn transform_text(pose: &Pose) -> String {
    let [x, y, z]: [f64; 3] = pose.translation.vector.into();
    let q = UnitQuaternion::from_rotation_matrix(&pose.rotation);
    object([
        ("px", x),
        ("py", y),
        ("pz", z),
        ("qx", q.i),
        ("qy", q.j),
        ("qz", q.k),
        ("qw", q.w),
    ])
}

fn intrinsics_of(camera: &CalibratedCamera) -> Result<String, Error> {
    let model = &camera.camera;
    let f_and_c = ["fx", "fy", "cx", "cy"]
        .into_iter()
        .zip(output::focals_and_center(model));
    let (kind, names, values): (_, &[&'static str], Vec<f64>) = if let Some(k) =
        output::fisheye(model)
    {
        ("kb4", &["k1", "k2", "k3", "k4"], k.to_vec())
    } else if let Camera::DoubleSphere(_) = model {
        let values = output::parameters(model, ["xi", "alpha"]);
        ("ds", &["xi", "alpha"], values.to_vec())
    } else if let Camera::ExtendedUnified(_) = model {
        let values = output::parameters(model, ["alpha", "beta"]);
        ("eucm", &["alpha", "beta"], values.to_vec())
    } else {
        let all = output::pinhole_distortion(model);
        match output::count_of(&all, &[0, 8]) {
            Some(0) => ("pinhole", &[], Vec::new()),
            // rpmax = 0: Basalt then does not limit the radius. Pardalis derives the limit from
            // the coefficients.
            Some(_) => (
                "pinhole-radtan8",
                &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "rpmax"],
                [&all[..8], &[0.0]].concat(),
            ),
            None => {
                return Err(output::not_representable(
                    camera,
                    "the distortion",
                    "too long: it has the thin-prism coefficients s1 to s4",
                    "k1 k2 p1 p2 k3 k4 k5 k6 in Basalt files; OpenCV files can represent all twelve",
                ));
            }
        }
    };
    let values = object(f_and_c.chain(names.iter().copied().zip(values)));
    Ok(format!(
        "{{ \"camera_type\": \"{kind}\", \"intrinsics\": {values} }}"
    ))
}
