//! Calibration files of other programs: equal projections, lossless round trips, and errors that name the camera.

use std::collections::HashMap;
use std::fs;

use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use pardalis_camera::formats::{Format, Lens};
use pardalis_camera::{CalibratedCamera, Pose};
use pardalis_camera::{
    Camera, DoubleSphere, Equidistant, ExtendedUnified, KannalaBrandt, Mei, Ocam,
    PerspectiveMirror, Pinhole, Unified,
};
use pardalis_scene::calibration::CalibrationFormat::{self, Foreign, Pardalis};
use pardalis_scene::calibration::{read, write};

use crate::samples::{SAMPLES, folder, sample};

/// Reads the rows x, y, z, u, v of a table.
fn rows(name: &str) -> Option<Vec<[f64; 5]>> {
    let text = fs::read_to_string(folder().join(name)).ok()?;
    let row = |line: &str| {
        let values: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        values.try_into().unwrap()
    };
    Some(text.lines().skip(1).map(row).collect())
}

#[test]
fn cameras_of_a_sequence_folder_are_read() {
    let cameras = read(&sample("sequence-cameras.json"), None).unwrap();
    let names: Vec<_> = cameras.iter().map(|camera| &*camera.name).collect();
    assert_eq!(names, ["fisheye", "web_cam", "camera"]);
    let [fisheye, pinhole, mirror] = &cameras[..] else {
        panic!("three cameras");
    };
    assert_eq!(fisheye.size_px, Some((640, 480)));
    let pose = fisheye.world_from_camera.unwrap();
    assert_eq!(pose.translation.vector.z, 0.9);
    // rho = f a at 90 degrees and beyond, to 92.5.
    let ahead = fisheye.camera.project([1.0, 0.0, 0.0]).unwrap();
    let rho_px = 145.562_250_654_857_8 * std::f64::consts::FRAC_PI_2;
    assert!((ahead[0] - 319.5 - rho_px).abs() < 1e-9);
    assert_eq!(fisheye.camera.project([1.0, 0.0, -0.05]), None);
    let expected = [330.5, 331.5, 159.5, 119.5, 0.1, -0.01, 0.0, 0.0, 0.002];
    for ((_, value), expected) in pinhole.camera.parameters().iter().zip(expected) {
        assert_eq!(*value, expected);
    }
    assert_eq!(mirror.camera.kind(), "exact_mirror");
    assert_eq!(mirror.world_from_camera, None);
    // The mirror's point at t = 0.03 is imaged at rho = f t / F.
    let ray = mirror
        .camera
        .unproject([319.5 + 579.5 * 0.03 / 0.163, 239.5])
        .unwrap();
    assert!((ray.origin[0] - 0.03).abs() < 1e-9 && (ray.origin[2] - 0.163).abs() < 1e-9);
}

#[test]
fn files_of_other_programs_project_as_they_do() {
    let mut tables = 0;
    for (name, lens) in SAMPLES {
        let cameras = read(&sample(name), lens).unwrap_or_else(|e| panic!("{name}: {e}"));
        let stem = name.split('.').next().unwrap();
        for (i, camera) in cameras.iter().enumerate() {
            let table = if i == 0 {
                format!("{stem}.csv")
            } else {
                format!("{stem}.{}.csv", camera.name)
            };
            let Some(rows) = rows(&table) else {
                assert!(
                    [
                        "pardalis.toml",
                        "opencv-omnidir.xml",
                        "sequence-cameras.json"
                    ]
                    .contains(&name),
                    "{table}"
                );
                continue;
            };
            tables += 1;
            assert!(rows.len() > 100);
            let camera_from_world = camera.world_from_camera.unwrap_or_default().inverse();
            for [x, y, z, u, v] in rows {
                let point = camera_from_world * Point3::new(x, y, z);
                let pixel = camera
                    .camera
                    .project(point.into())
                    .unwrap_or_else(|| panic!("{table}: no pixel for {x} {y} {z}"));
                let miss = (pixel[0] - u).hypot(pixel[1] - v);
                assert!(miss < 1e-6, "{table}: {x} {y} {z} is missed by {miss} px");
            }
        }
    }
    assert_eq!(tables, 33);
}

#[test]
fn names_sizes_and_poses_are_read() {
    let read = |name: &str, lens| read(&sample(name), lens).unwrap();
    let size = |name: &str| read(name, None)[0].size_px;
    assert_eq!(size("opencv-stereo.yml"), Some((640, 480)));
    assert_eq!(size("opencv-left-intrinsics.yml"), Some((640, 480)));
    assert_eq!(size("opencv-stereo-intrinsics.yml"), None);
    assert_eq!(size("ocamcalib-fisheye.txt"), Some((1024, 768)));
    assert_eq!(size("kalibr-imu.yaml"), Some((752, 480)));
    let names =
        |name: &str| -> Vec<String> { read(name, None).into_iter().map(|c| c.name).collect() };
    assert_eq!(names("ros-plumb_bob.yaml"), ["narrow_stereo_left"]);
    assert_eq!(names("ros-message.yaml"), ["camera"]);
    assert_eq!(names("opencv-stereo.yml"), ["cam1", "cam2"]);
    assert_eq!(names("kalibr-chain.yaml"), ["cam0", "cam1", "cam2", "cam3"]);
    let posed = |name: &str| read(name, None)[0].world_from_camera.is_some();
    assert!(posed("opencv-stereo.yml") && posed("opencv-pose.yml") && posed("kalibr-chain.yaml"));
    assert!(!posed("opencv-stereo-intrinsics.yml") && !posed("ros-message.yaml"));
}

#[test]
fn ros_calibrations_have_a_camera_of_rectified_images_too() {
    let text = sample("ros-plumb_bob.yaml");
    // P with other numbers than the camera matrix, as of the right camera of a pair.
    let (rest, p) = text.split_once("projection_matrix:").unwrap();
    let p = p
        .replacen("412.31", "390.5", 1)
        .replacen("321.7", "318.25", 1);
    let p = p
        .replacen("409.87", "391.5", 1)
        .replacen("236.9", "240.75", 1);
    let text = format!("{rest}projection_matrix:{p}");
    let rectified = &read(&text, Some(Lens::Rectified)).unwrap()[0];
    let parameters: Vec<f64> = rectified
        .camera
        .parameters()
        .iter()
        .map(|(_, v)| *v)
        .collect();
    assert_eq!(rectified.camera.kind(), "pinhole");
    assert_eq!(parameters[..4], [390.5, 391.5, 318.25, 240.75]);
    assert!(parameters[4..].iter().all(|&v| v == 0.0));
    assert_eq!(rectified.size_px, Some((640, 480)));
    assert_eq!(rectified.name, "narrow_stereo_left");
    // Of the raw images as before.
    let raw = &read(&text, None).unwrap()[0];
    assert_eq!(raw.camera.parameters()[0].1, 412.31);
    assert_eq!(raw.camera.parameters()[4].1, 0.134_462);

    let error = |text: &str| read(text, Some(Lens::Rectified)).unwrap_err().to_string();
    let without = error(rest);
    assert!(
        without.contains("projection_matrix is missing"),
        "{without}"
    );
    let zero = error(&text.replacen("390.5", "0.0", 1));
    assert!(zero.contains("has no camera of rectified images"), "{zero}");
    let negative = error(&text.replacen("390.5", "-390.5", 1));
    assert!(
        negative.contains("allowed: a positive number"),
        "{negative}"
    );
    // Other formats have none, unless the lens has no distortion.
    let other = error(&sample("opencv-fisheye.yml"));
    assert!(other.contains("was to be read as rectified"), "{other}");
    let kalibr = error(&sample("kalibr-imu.yaml"));
    assert!(kalibr.contains("was to be read as rectified"), "{kalibr}");
}

/// Returns one camera of each model, with numbers that any rounding would change.
fn cameras() -> Vec<Camera> {
    let (f, c) = (
        [411.300_000_000_000_1, 1.0 / 0.0024],
        [319.7 / 0.99, 241.123_456_789_012_3],
    );
    let k = [
        -0.283,
        1e-7 / 3.0,
        4.1e-4,
        -6.3e-5,
        1e-5,
        0.012,
        -1.0 / 3e4,
        1e-12,
        1e-3 / 7.0,
        0.0,
        -2e-4,
        3e-5,
    ];
    let pinhole = |count: usize| Camera::Pinhole(Pinhole::new(f, c, &k[..count]).unwrap());
    vec![
        pinhole(0),
        pinhole(4),
        pinhole(5),
        pinhole(8),
        pinhole(12),
        Camera::KannalaBrandt(
            KannalaBrandt::new(
                f,
                c,
                [-0.01, 0.045, -1.0 / 23.0, 0.0084],
                std::f64::consts::PI,
            )
            .unwrap(),
        ),
        Camera::Equidistant(
            Equidistant::new(145.562_250_654_857_8, c, 92.5_f64.to_radians()).unwrap(),
        ),
        Camera::Mei(Mei::new(f, 0.0, c, 1.053, [-0.31, 0.09, 1.2e-3, -1e-5 / 3.0]).unwrap()),
        Camera::Mei(Mei::new(f, 0.7, c, 0.8, [0.0; 4]).unwrap()),
        Camera::DoubleSphere(DoubleSphere::new(f, c, -0.2 / 1.1, 0.59).unwrap()),
        Camera::ExtendedUnified(ExtendedUnified::new(f, c, 0.61, 1.0).unwrap()),
        Camera::ExtendedUnified(ExtendedUnified::new(f, c, 0.59, 1.127).unwrap()),
        Camera::Ocam(
            Ocam::new(
                &[-131.479_7, 0.0, 1.848_991e-3, 2.251_206e-7, -7.343_233e-10],
                c,
                [0.999_845, 4.4e-5, 8e-6],
                500.0,
            )
            .unwrap(),
        ),
        Camera::Unified(Unified::new(0.9, 1.0 / 3.0, 200.0, c).unwrap()),
        Camera::PerspectiveMirror(PerspectiveMirror::new(300.0 / 7.0, c).unwrap()),
    ]
}

fn posed(name: &str, camera: Camera, turn: f64) -> CalibratedCamera {
    let rotation = Rotation3::from_scaled_axis(Vector3::new(0.3 * turn, -1.1, turn));
    let translation = Translation3::new(0.1 / 3.0, -turn, 1.7);
    CalibratedCamera {
        name: name.to_owned(),
        camera,
        size_px: Some((640, 480)),
        world_from_camera: Some(Pose::from_parts(translation, rotation)),
    }
}

/// Returns the parameters by name. An equidistant fisheye is written as Kannala-Brandt with zeros.
fn parameters(camera: &Camera) -> HashMap<&'static str, f64> {
    let mut all: HashMap<_, _> = camera.parameters().into_iter().collect();
    if let Some(f) = all.remove("f_px_per_rad") {
        all.extend([
            ("fx_px", f),
            ("fy_px", f),
            ("k1", 0.0),
            ("k2", 0.0),
            ("k3", 0.0),
            ("k4", 0.0),
        ]);
    }
    all
}

fn assert_same(a: &CalibratedCamera, b: &CalibratedCamera, format: CalibrationFormat) {
    let (pa, pb) = (parameters(&a.camera), parameters(&b.camera));
    assert_eq!(pa.len(), pb.len(), "{format:?} {}", a.camera.kind());
    for (name, x) in pa {
        let y = pb[name];
        assert!(
            (x - y).abs() <= 1e-12 * x.abs(),
            "{format:?} {}: {name} {x} {y}",
            a.camera.kind()
        );
    }
    assert_eq!(a.size_px, b.size_px);
}

fn assert_same_pose(a: &Pose, b: &Pose, format: CalibrationFormat) {
    let difference = (a.to_homogeneous() - b.to_homogeneous()).abs().max();
    assert!(difference < 1e-12, "{format:?}: {difference}");
}

/// Reports whether the format rejects this camera although it supports the kind of model.
fn rejected_by_details(format: CalibrationFormat, camera: &Camera) -> bool {
    let all = parameters(camera);
    let has = |names: &[&str]| {
        names
            .iter()
            .any(|name| all.get(name).is_some_and(|&v| v != 0.0))
    };
    match (format, camera) {
        (Foreign(Format::Ros | Format::Basalt), Camera::Pinhole(_)) => {
            has(&["s1", "s2", "s3", "s4"])
        }
        (Foreign(Format::Kalibr), Camera::Pinhole(_)) => has(&["k3", "k4", "k5", "k6", "s1"]),
        (Foreign(Format::Kalibr), Camera::Mei(_)) => has(&["skew_px"]),
        _ => false,
    }
}

#[test]
fn round_trips_through_every_format_change_nothing() {
    let mut trips = 0;
    for format in CalibrationFormat::ALL {
        for camera in cameras() {
            let one = posed("left", camera.clone(), 0.4);
            let written = write(format, std::slice::from_ref(&one));
            if !format.holds(camera.kind()) || rejected_by_details(format, &camera) {
                let message = written.unwrap_err().to_string();
                assert!(message.contains("camera left"), "{message}");
                continue;
            }
            let again = read(&written.unwrap(), None).unwrap();
            assert_eq!(again.len(), 1);
            assert_same(&one, &again[0], format);
            trips += 1;
            let posed = !matches!(format, Foreign(Format::Ros | Format::OcamCalib));
            assert_eq!(again[0].world_from_camera.is_some(), posed, "{format:?}");
            if posed {
                assert_same_pose(
                    &one.world_from_camera.unwrap(),
                    &again[0].world_from_camera.unwrap(),
                    format,
                );
            }
            // Without a pose and, if the format allows it, without a size.
            let bare = CalibratedCamera {
                world_from_camera: None,
                ..one.clone()
            };
            let again = read(&write(format, std::slice::from_ref(&bare)).unwrap(), None).unwrap();
            assert_eq!(again[0].world_from_camera, None, "{format:?}");
            let sizeless = CalibratedCamera {
                size_px: None,
                ..bare
            };
            match write(format, std::slice::from_ref(&sizeless)) {
                Ok(text) => assert_eq!(read(&text, None).unwrap()[0].size_px, None),
                Err(error) => assert!(
                    error.to_string().contains("--size, or as size_px"),
                    "{error}"
                ),
            }
        }
    }
    assert_eq!(trips, 15 + 2 * 9 + 6 + 8 + 1 + 9);
}

#[test]
fn our_own_format_keeps_everything() {
    let all: Vec<_> = cameras()
        .into_iter()
        .enumerate()
        .map(|(i, camera)| posed(&format!("cam{i}"), camera, i as f64))
        .collect();
    let text = write(Pardalis, &all).unwrap();
    let again = read(&text, None).unwrap();
    for (a, b) in all.iter().zip(&again) {
        assert_eq!(
            (&a.name, &a.camera, a.size_px),
            (&b.name, &b.camera, b.size_px)
        );
        assert_same_pose(
            &a.world_from_camera.unwrap(),
            &b.world_from_camera.unwrap(),
            Pardalis,
        );
    }
    assert!(text.contains("field_of_view_deg = 185.0\n"), "{text}");
}

#[test]
fn rigs_of_several_cameras_are_written_and_read() {
    let camera = |i: usize| cameras()[i].clone();
    let rig = [
        posed("a", camera(1), 0.2),
        posed("b", camera(5), 0.9),
        posed("c", camera(9), -0.7),
    ];
    for format in [Foreign(Format::Kalibr), Foreign(Format::Basalt)] {
        let again = read(&write(format, &rig).unwrap(), None).unwrap();
        for (a, b) in rig.iter().zip(&again) {
            assert_same(a, b, format);
            assert_same_pose(
                &a.world_from_camera.unwrap(),
                &b.world_from_camera.unwrap(),
                format,
            );
        }
        let mut bare = rig.clone();
        bare[1].world_from_camera = None;
        let message = write(format, &bare).unwrap_err().to_string();
        assert!(
            message.contains("camera b") && message.contains("pose"),
            "{message}"
        );
    }
    // OpenCV keeps the pose of the second from the first.
    let pair = [posed("a", camera(2), 0.2), posed("b", camera(3), 0.9)];
    for format in [Foreign(Format::OpenCvYaml), Foreign(Format::OpenCvXml)] {
        let again = read(&write(format, &pair).unwrap(), None).unwrap();
        let a_from_b = |rig: &[CalibratedCamera]| {
            rig[0].world_from_camera.unwrap().inverse() * rig[1].world_from_camera.unwrap()
        };
        assert_same_pose(&a_from_b(&pair), &a_from_b(&again), format);
        assert_same(&pair[1], &again[1], format);
        let three = [pair[0].clone(), pair[1].clone(), posed("c", camera(0), 0.0)];
        let message = write(format, &three).unwrap_err().to_string();
        assert!(message.contains("1 or 2 in an OpenCV file"), "{message}");
    }
    for format in [Foreign(Format::Ros), Foreign(Format::OcamCalib)] {
        assert!(write(format, &pair).is_err());
    }
    let message = write(Foreign(Format::Ros), &pair).unwrap_err().to_string();
    assert!(
        message.contains("is 2; allowed: 1 in a ros file"),
        "{message}"
    );
    assert!(write(Foreign(Format::Basalt), &[]).is_err());
    let twice = [pair[0].clone(), pair[0].clone()];
    let message = write(Pardalis, &twice).unwrap_err().to_string();
    assert!(message.contains("is a; allowed: unique names"), "{message}");
}

#[test]
fn unsupported_models_are_named_with_the_formats_that_support_them() {
    for (format, camera, wanted) in [
        (Foreign(Format::Kalibr), 12, ["ocam", "pardalis, ocamcalib"]),
        (
            Foreign(Format::OcamCalib),
            5,
            [
                "kannala_brandt",
                "pardalis, opencv-yaml, opencv-xml, ros, kalibr, basalt",
            ],
        ),
        (
            Foreign(Format::OpenCvYaml),
            9,
            ["double_sphere", "pardalis, kalibr, basalt"],
        ),
        (Foreign(Format::Basalt), 13, ["unified", "pardalis"]),
    ] {
        let one = posed("left", cameras()[camera].clone(), 0.0);
        let message = write(format, &[one]).unwrap_err().to_string();
        assert!(message.contains("camera left"), "{message}");
        assert!(wanted.iter().all(|w| message.contains(w)), "{message}");
    }
}

/// The written inverse polynomial agrees with the direct one, evaluated with the toolbox's own formula.
#[test]
fn the_inverse_polynomial_of_ocamcalib_matches_the_direct_one() {
    for name in ["ocamcalib-catadioptric.txt", "ocamcalib-fisheye.txt"] {
        let camera = read(&sample(name), None).unwrap().remove(0);
        let text = write(Foreign(Format::OcamCalib), std::slice::from_ref(&camera)).unwrap();
        let lists: Vec<Vec<f64>> = text
            .lines()
            .filter(|line| !line.is_empty() && !line.starts_with('#'))
            .map(|line| line.split(' ').map(|v| v.parse().unwrap()).collect())
            .collect();
        let ([xc, yc], [c, d, e]) = (
            [lists[2][0], lists[2][1]],
            [lists[3][0], lists[3][1], lists[3][2]],
        );
        assert_eq!(lists[1].len(), 1 + lists[1][0] as usize);
        for [x, y, z, u, v] in rows(&name.replace(".txt", ".csv")).unwrap() {
            let (x, y, z) = (y, x, -z);
            let norm = x.hypot(y);
            let theta = (z / norm).atan();
            let rho = lists[1][1..]
                .iter()
                .rev()
                .fold(0.0, |sum, a| sum * theta + a);
            let (x, y) = (x / norm * rho, y / norm * rho);
            let (row, column) = (x * c + y * d + xc, x * e + y + yc);
            let miss = (row - v).hypot(column - u);
            assert!(miss < 0.02, "{name}: {miss} px");
        }
    }
}
