//! An uncalibrated camera above a floor: four known points of the floor turn pixels into metres (Campos 2009).

use pardalis::camera::{Plane, Pose};
use pardalis::color::ColorModel;
use pardalis::shape::{Flat, Shape};
use pardalis::tracker::DetectedSettings;
use pardalis::{Frame, FrameSet, Tracker, View};
use pardalis_calibrate::plane::{PointPair, fit};

const RADIUS_M: f64 = 0.12;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Corners of a rectangle of 2 m x 1.5 m: pixel, metres.
    let corners = [
        ([184.0, 327.0], [0.0, 0.0]),
        ([449.0, 305.0], [2.0, 0.0]),
        ([402.0, 199.0], [2.0, 1.5]),
        ([196.0, 213.0], [0.0, 1.5]),
    ];
    let pairs = corners.map(|(pixel, plane_m)| PointPair { pixel, plane_m });
    let floor = fit(&pairs)?.homography;
    let picture = |[x, y]: [f64; 2]| {
        let pixels = (0..480).flat_map(|v| (0..640).map(move |u| [f64::from(u), f64::from(v)]));
        let shows_disc = |pixel| {
            let point = floor.plane_of(pixel);
            point.is_some_and(|[px, py]| (px - x).hypot(py - y) < RADIUS_M)
        };
        let mask: Vec<bool> = pixels.map(shows_disc).collect();
        let color = |&shown: &bool| {
            if shown {
                [200, 30, 40]
            } else {
                [120, 120, 115]
            }
        };
        (mask.iter().flat_map(color).collect::<Vec<u8>>(), mask)
    };
    let (still, mask) = picture([1.0, 0.5]);
    let colors = ColorModel::from_image(&Frame::from_rgb(640, 480, still, 0.0)?, &mask)?;

    let mut setup = Tracker::builder();
    // Where the camera stands, roughly measured.
    let view = View::new(
        Plane::new(&floor, Some([0.9, -2.9, 3.0]))?,
        Pose::identity(),
        (640, 480),
        None,
    )?;
    let camera = setup.camera(view);
    let disc = Shape::Flat(Flat::disc(RADIUS_M, 0.0)?);
    let robot = setup.target(DetectedSettings::new(disc, colors));
    let mut tracker = setup.build()?;
    for number in 0..20 {
        let time_s = f64::from(number) / 15.0;
        let truth_m = [0.5 + 0.4 * time_s, 0.7];
        let frame = Frame::from_rgb(640, 480, picture(truth_m).0, time_s)?;
        tracker.observe(&FrameSet::of(camera, frame))?;
        if let Some(state) = tracker.estimate(robot)?.kinematics {
            let [x, y, _] = state.position_m;
            println!("{time_s:.2} s: {:.3?} m, truth {truth_m:.3?} m", [x, y]);
        }
    }
    Ok(())
}
