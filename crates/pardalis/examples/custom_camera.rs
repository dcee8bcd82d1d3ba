//! A lens that no built-in model describes: fit one to points that the lens projects.

use pardalis_calibrate::{
    CalibrationSettings, CalibrationStart, CalibrationView, Correspondence, ModelKind, calibrate,
};

/// Your projection: a stereographic fisheye. `None` outside its field of view.
fn project([x, y, z]: [f64; 3]) -> Option<[f64; 2]> {
    let angle_rad = x.hypot(y).atan2(z);
    let radius_px = 2.0 * 150.0 * (angle_rad / 2.0).tan();
    let azimuth_rad = y.atan2(x);
    let pixel = [
        319.5 + radius_px * azimuth_rad.cos(),
        239.5 + radius_px * azimuth_rad.sin(),
    ];
    let in_image = (0.0..640.0).contains(&pixel[0]) && (0.0..480.0).contains(&pixel[1]);
    (angle_rad < 1.4 && in_image).then_some(pixel)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Points all over the field of view, at several distances.
    let mut correspondences = Vec::new();
    for [u, v] in (-12..=12).flat_map(|u| (-12..=12).map(move |v| [f64::from(u), f64::from(v)])) {
        for range_m in [1.0, 2.0] {
            let direction = [u / 6.0, v / 6.0, 1.0];
            let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
            let point_m = direction.map(|c| range_m * c / length);
            if let Some(pixel) = project(point_m) {
                correspondences.push(Correspondence { point_m, pixel });
            }
        }
    }
    let view = CalibrationView {
        name: "all points".to_owned(),
        correspondences,
    };
    let start = CalibrationStart::Model(ModelKind::KannalaBrandt);
    let settings = CalibrationSettings::new(start, (640, 480));
    let calibration = calibrate(&[view], &settings)?;
    println!("fits to {:.4} px", calibration.rms_px);
    // calibration.camera goes into View::new like any built-in camera.
    println!("{:?}", calibration.camera.project([0.3, -0.2, 1.0]));
    println!("{:?}", project([0.3, -0.2, 1.0]));
    Ok(())
}
