//! A camera on a robot that drives: positions in the world, from the robot's poses.

use pardalis::camera::{Pinhole, Pose};
use pardalis::color::ColorModel;
use pardalis::platform::{OdometryErrors, Platform, PoseCovariance, StampedPose};
use pardalis::tracker::DetectedSettings;
use pardalis::{Error, Frame, FrameSet, Tracker, View};

fn main() -> Result<(), Error> {
    let lens = Pinhole::new([500.0, 500.0], [159.5, 119.5], &[])?;
    let (still, mask) = picture(0.0);
    let colors = ColorModel::from_image(&Frame::from_rgb(320, 240, still, 0.0)?, &mask)?;

    let mut setup = Tracker::builder();
    let robot = setup.platform(Platform::new(OdometryErrors::default())?);
    let robot_from_camera = Pose::identity();
    let view = View::new(lens, robot_from_camera, (320, 240), None)?;
    let camera = setup.camera_on(robot, view)?;
    let ball = setup.target(DetectedSettings::ball(0.1, colors)?);
    let mut tracker = setup.build()?;
    for number in 0..20 {
        let time_s = f64::from(number) / 25.0;
        let pose = StampedPose {
            time_s,
            world_from_platform: Pose::translation(-0.16 * time_s, 0.0, 0.0),
            covariance: PoseCovariance::of_sigmas(0.005, 0.002)?,
        };
        tracker.observe_pose(robot, &pose)?;
        let frame = Frame::from_rgb(320, 240, picture(time_s).0, time_s)?;
        tracker.observe(&FrameSet::of(camera, frame))?;
        let position_m = tracker
            .estimate(ball)?
            .kinematics
            .map(|state| state.position_m);
        println!("{time_s:.2} s: {position_m:.3?}");
    }
    Ok(())
}

/// Replaces a camera: returns packed RGB of an orange ball at rest 2 m ahead, which the robot passes to the left, and which pixels show it.
fn picture(time_s: f64) -> (Vec<u8>, Vec<bool>) {
    let pixels = (0..240).flat_map(|v| (0..320).map(move |u| [f64::from(u), f64::from(v)]));
    let distance_px = pixels.map(|[u, v]| (u - 120.0 - 40.0 * time_s).hypot(v - 110.0) - 25.0);
    let mask: Vec<bool> = distance_px.map(|px| px < 0.0).collect();
    let color = |&shown: &bool| {
        if shown {
            [230, 120, 30]
        } else {
            [90, 100, 110]
        }
    };
    (mask.iter().flat_map(color).collect(), mask)
}
