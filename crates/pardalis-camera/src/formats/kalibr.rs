//! Kalibr's camchain: cameras `cam0`, `cam1`, …, each with its pose relative to the previous camera
//! and, if there is an IMU, to the IMU.
//!
//! The world is the frame of the IMU; without an IMU, the frame of `cam0`.

use std::fmt::Write as _;

use super::document::Entry;
use super::intrinsics::{size_from_pair, transform};
use super::output;
use crate::pose::{CalibratedCamera, Pose};
use crate::{Camera, DoubleSphere, ExtendedUnified, KannalaBrandt, Mei, Pinhole};
use pardalis_core::Error;

/// Largest difference between the two poses of a camera, in metres and in the elements of the
/// rotation.
const AGREEMENT: f64 = 0.01;

/// Reads the cameras of a document.
pub(super) fn read(root: &Entry) -> Result<Vec<CalibratedCamera>, Error> {
    let tables: Vec<Entry> = (0..).map_while(|i| root.get(&format!("cam{i}"))).collect();
    for entry in root.entries() {
        let number = entry.name().strip_prefix("cam").map(str::parse::<usize>);
        if let Some(Ok(number)) = number
            && number >= tables.len()
        {
            return Err(entry.error(format!(
                "the previous camera cam{} is missing",
                tables.len()
            )));
        }
    }
    let mut cameras = Vec::new();
    let mut before: Option<Pose> = None;
    for table in &tables {
        let camera_from_world = read_pose(table, before, tables.len())?;
        before = camera_from_world;
        cameras.push(CalibratedCamera {
            name: table.name().to_owned(),
            camera: read_camera(table)?,
            size_px: table
                .get("resolution")
                .map(|entry| size_from_pair(&entry))
                .transpose()?,
            world_from_camera: camera_from_world.map(|pose| pose.inverse()),
        });
    }
    Ok(cameras)
}

/// Reads the transform from the world to this camera. `before` is the transform of the previous
/// camera.
fn read_pose(table: &Entry, before: Option<Pose>, count: usize) -> Result<Option<Pose>, Error> {
    let from_imu = table.get("T_cam_imu");
    let from_imu = from_imu.map(|entry| transform(&entry)).transpose()?;
    let Some(before) = before else {
        // The first camera.
        return Ok(match from_imu {
            None if count > 1 => Some(Pose::identity()),
            other => other,
        });
    };
    let Some(chained) = table.get("T_cn_cnm1") else {
        if from_imu.is_none() {
            return Err(table.error("has neither T_cn_cnm1 nor T_cam_imu; give one of them"));
        }
        return Ok(from_imu);
    };
    let along_chain = transform(&chained)? * before;
    if let Some(from_imu) = from_imu {
        let difference = (from_imu.to_homogeneous() - along_chain.to_homogeneous())
            .abs()
            .max();
        if difference > AGREEMENT {
            return Err(chained.error(format!(
                "contradicts T_cam_imu: the two poses of this camera differ by {difference:.3}; allowed: {AGREEMENT}"
            )));
        }
        return Ok(Some(from_imu));
    }
    Ok(Some(along_chain))
}

fn read_camera(table: &Entry) -> Result<Camera, Error> {
    let model = table.required("camera_model")?;
    let intrinsics = table.required("intrinsics")?;
    let distortion_model = table.required("distortion_model")?;
    let coefficients = match table.get("distortion_coeffs") {
        Some(entry) => entry,
        None => table.required("distortion_coefficients")?,
    };
    let distortion = match distortion_model.text()?.as_str() {
        "radtan" => Distortion::Radtan(coefficients.exactly("k1, k2, p1, p2")?),
        "equidistant" | "equi" => Distortion::Equidistant(coefficients.exactly("k1, k2, k3, k4")?),
        "none" => {
            let [] = coefficients.exactly("none")?;
            Distortion::None
        }
        "fov" => {
            return Err(distortion_model.error(
                "is fov, the field-of-view model, which is not supported; calibrate with equidistant, ds or eucm",
            ));
        }
        _ => return Err(distortion_model.invalid("radtan, equidistant, none")),
    };
    let incompatible = || {
        distortion_model.invalid(
            "radtan, equidistant or none for a pinhole, radtan or none for omni, none for ds and eucm",
        )
    };
    match (model.text()?.as_str(), distortion) {
        ("pinhole", distortion) => {
            let [fx, fy, cx, cy] = intrinsics.exactly("fu, fv, pu, pv")?;
            let (f, c) = ([fx, fy], [cx, cy]);
            let camera = match distortion {
                Distortion::Radtan(k) => Pinhole::new(f, c, &k).map(Camera::Pinhole),
                Distortion::None => Pinhole::new(f, c, &[]).map(Camera::Pinhole),
                Distortion::Equidistant(k) => {
                    KannalaBrandt::new(f, c, k, std::f64::consts::PI).map(Camera::KannalaBrandt)
                }
            };
            intrinsics.checked(camera)
        }
        ("omni", distortion) => {
            let [xi, fx, fy, cx, cy] = intrinsics.exactly("xi, fu, fv, pu, pv")?;
            let k = match distortion {
                Distortion::Radtan(k) => k,
                Distortion::None => [0.0; 4],
                Distortion::Equidistant(_) => return Err(incompatible()),
            };
            let camera = Mei::new([fx, fy], 0.0, [cx, cy], xi, k);
            intrinsics.checked(camera).map(Camera::Mei)
        }
        ("ds", Distortion::None) => {
            let [xi, alpha, fx, fy, cx, cy] = intrinsics.exactly("xi, alpha, fu, fv, pu, pv")?;
            let camera = DoubleSphere::new([fx, fy], [cx, cy], xi, alpha);
            intrinsics.checked(camera).map(Camera::DoubleSphere)
        }
        ("eucm", Distortion::None) => {
            let [alpha, beta, fx, fy, cx, cy] =
                intrinsics.exactly("alpha, beta, fu, fv, pu, pv")?;
            let camera = ExtendedUnified::new([fx, fy], [cx, cy], alpha, beta);
            intrinsics.checked(camera).map(Camera::ExtendedUnified)
        }
        ("ds" | "eucm", _) => Err(incompatible()),
        _ => Err(model.invalid("pinhole, omni, ds, eucm")),
    }
}

enum Distortion {
    None,
    Radtan([f64; 4]),
    Equidistant([f64; 4]),
}

/// Returns the text of a rig. Poses are written as `T_cam_imu`, with the world as the frame of the
/// IMU, and relative to the previous camera.
pub(super) fn write(cameras: &[CalibratedCamera]) -> Result<String, Error> {
    let poses = output::poses(cameras)?;
    if poses.is_none() && cameras.len() > 1 {
        return Err(output::not_representable(
            &cameras[0],
            "the pose",
            "missing",
            "world_from_camera for each camera of a Kalibr file with several cameras; or write each camera to its own file",
        ));
    }
    let mut text = String::new();
    for (i, camera) in cameras.iter().enumerate() {
        let (width, height) = output::size_px(camera)?;
        let (model, intrinsics, distortion_model, distortion) = model_of(camera)?;
        // Writing to a String cannot fail.
        let _ = writeln!(text, "cam{i}:");
        if let Some(poses) = &poses {
            push_transform(&mut text, "T_cam_imu", &poses[i].inverse());
            if i > 0 {
                push_transform(&mut text, "T_cn_cnm1", &(poses[i].inverse() * poses[i - 1]));
            }
        }
        let _ = writeln!(
            text,
            "  cam_overlaps: []\n  camera_model: {model}\n  distortion_coeffs: [{}]\n  distortion_model: {distortion_model}\n  \
             intrinsics: [{}]\n  resolution: [{width}, {height}]\n  rostopic: /{}/image_raw",
            output::numbers(&distortion),
            output::numbers(&intrinsics),
            camera.name,
        );
    }
    Ok(text)
}

fn push_transform(text: &mut String, key: &str, transform: &Pose) {
    let _ = writeln!(text, "  {key}:");
    for row in output::rows(transform) {
        let _ = writeln!(text, "  - [{}]", output::numbers(&row));
    }
}

/// Model, intrinsics, distortion model and distortion coefficients.
type ModelParts = (&'static str, Vec<f64>, &'static str, Vec<f64>);

fn model_of(camera: &CalibratedCamera) -> Result<ModelParts, Error> {
    let model = &camera.camera;
    let pinhole = output::focals_and_center(model).to_vec();
    if let Some(k) = output::fisheye(model) {
        return Ok(("pinhole", pinhole, "equidistant", k.to_vec()));
    }
    let with = |first: &[f64]| [first, &pinhole[..]].concat();
    Ok(match model {
        Camera::Mei(_) => {
            let [xi, skew] = output::parameters(model, ["xi", "skew_px"]);
            if skew != 0.0 {
                return Err(output::not_representable(
                    camera,
                    "skew_px",
                    skew,
                    "0 in Kalibr files; OpenCV files can represent it",
                ));
            }
            let k = output::parameters(model, ["k1", "k2", "p1", "p2"]);
            ("omni", with(&[xi]), "radtan", k.to_vec())
        }
        Camera::DoubleSphere(_) => {
            let first = output::parameters(model, ["xi", "alpha"]);
            ("ds", with(&first), "none", Vec::new())
        }
        Camera::ExtendedUnified(_) => {
            let first = output::parameters(model, ["alpha", "beta"]);
            ("eucm", with(&first), "none", Vec::new())
        }
        _ => {
            let all = output::pinhole_distortion(model);
            if output::count_of(&all, &[4]).is_none() {
                return Err(output::not_representable(
                    camera,
                    "the distortion",
                    "too long: it has coefficients other than k1, k2, p1, p2",
                    "k1, k2, p1, p2 in Kalibr files; OpenCV and ROS files can represent more",
                ));
            }
            ("pinhole", pinhole, "radtan", all[..4].to_vec())
        }
    })
}
