//! Calibration from images of boards: rendered ones with ground truth, and real ones with published intrinsics.

use std::path::Path;

use nalgebra::Matrix4;
use pardalis_calibrate::board::{Board, detect};
use pardalis_calibrate::{
    CalibrationSettings, CalibrationStart, CalibrationView, Correspondence, ModelKind,
    OUTLIER_SIGMAS, RigCamera, calibrate, calibrate_rig,
};
use pardalis_images::decode_grey;

/// Detects a checkerboard of 9 x 6 inner corners with squares of this side.
fn view(square_m: f64, image: &str) -> CalibrationView {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data/calibration")
        .join(image);
    let grey = decode_grey(&std::fs::read(path).unwrap()).unwrap();
    let board = Board::checkerboard(9, 6, square_m).unwrap();
    let corners = detect(&board, &grey).unwrap();
    CalibrationView {
        name: image.to_owned(),
        correspondences: corners
            .iter()
            .map(|c| Correspondence {
                point_m: c.board_m,
                pixel: c.pixel,
            })
            .collect(),
    }
}

fn settings(kind: ModelKind) -> CalibrationSettings {
    let mut settings = CalibrationSettings::new(CalibrationStart::Model(kind), (640, 480));
    settings.board = true;
    settings
}

#[test]
fn calibrates_a_rendered_fisheye_camera() {
    let views: Vec<_> = (0..6)
        .map(|n| view(0.06, &format!("dioptric/board_{n}.jpg")))
        .collect();
    let found = calibrate(&views, &settings(ModelKind::Equidistant)).unwrap();
    println!("{} {:?}", found.rms_px, found.parameters);
    assert!(found.rms_px <= 0.3, "{}", found.rms_px);
    for (n, view) in found.views.iter().enumerate() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../../data/calibration/dioptric/board_{n}.json"));
        let text = std::fs::read_to_string(path).unwrap();
        let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
        let rows: [[f64; 4]; 4] =
            serde_json::from_value(truth["T_camera_from_board"].clone()).unwrap();
        let truth = Matrix4::from_fn(|i, j| rows[i][j]);
        let error = (view.camera_from_target.to_homogeneous() - truth)
            .column(3)
            .norm();
        println!("board {n}: {error}");
        assert!(error < 0.01, "board {n}: {error} m");
    }
    let mirrored: Vec<_> = views
        .into_iter()
        .map(|mut view| {
            for c in &mut view.correspondences {
                c.point_m[0] = -c.point_m[0];
            }
            view
        })
        .collect();
    let refusal = calibrate(&mirrored, &settings(ModelKind::Equidistant)).unwrap_err();
    assert!(refusal.reason.contains("mirror"), "{refusal}");
}

#[test]
fn calibrates_a_real_stereo_pair_to_published_focal_lengths() {
    let shots = [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14];
    let cameras: Vec<RigCamera> = ["left", "right"]
        .into_iter()
        .map(|side| {
            let views: Vec<_> = shots
                .iter()
                .map(|n| view(0.025, &format!("opencv-stereo/{side}{n:02}.jpg")))
                .collect();
            let found = calibrate(&views, &settings(ModelKind::Pinhole)).unwrap();
            println!(
                "{side}: {} {:?} {:?}",
                found.rms_px, found.held_out_rms_px, found.parameters
            );
            // OpenCV's left_intrinsics.yml has 535.916 for the left camera, intrinsics.yml 534.803 for both.
            for focal in &found.parameters[..2] {
                assert!((focal.value / 535.4 - 1.0).abs() < 0.01, "{side} {focal:?}");
            }
            RigCamera {
                name: side.to_owned(),
                camera: found.camera,
                size_px: (640, 480),
                views: views.into_iter().map(Some).collect(),
            }
        })
        .collect();
    let rig = calibrate_rig(&cameras, OUTLIER_SIGMAS).unwrap();
    println!("{:?} {:?}", rig.rms_px, rig.cameras[1].world_from_camera);
    assert!(rig.rms_px.iter().all(|rms| *rms < 0.5), "{:?}", rig.rms_px);
    let baseline = rig.cameras[1].world_from_camera.unwrap().translation.vector;
    // The second camera is to the right, at the same height.
    assert!(baseline.x > 0.05 && baseline.y.abs() < 0.01, "{baseline:?}");
    let alone = [cameras[0].clone(), {
        let mut right = cameras[1].clone();
        right.views.iter_mut().for_each(|v| *v = None);
        right
    }];
    let refusal = calibrate_rig(&alone, OUTLIER_SIGMAS).unwrap_err();
    assert!(refusal.reason.contains("right"), "{refusal}");
}
