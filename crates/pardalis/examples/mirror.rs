//! A camera that looks up into a hyperboloidal mirror sees the ball in any direction around it.

mod painter;

use pardalis::camera::{ExactMirror, MirrorProfile, Pose};
use pardalis::color::ColorModel;
use pardalis::tracker::DetectedSettings;
use pardalis::{Error, Frame, FrameSet, Tracker, View};

const RADIUS_M: f64 = 0.11;

fn main() -> Result<(), Error> {
    // The pinhole is at the outer focus of the mirror. Therefore all rays point at the inner one.
    let [a_m, b_m] = [0.028, 0.023];
    let profile = MirrorProfile::hyperboloid(a_m + f64::hypot(a_m, b_m), [a_m, b_m], 0.035)?;
    let lens = ExactMirror::new([600.0, 600.0], [319.5, 239.5], profile)?;
    let view = View::new(lens, Pose::identity(), (640, 480), None)?;
    let at = |angle_rad: f64| [1.2 * angle_rad.cos(), 1.2 * angle_rad.sin(), -0.3];
    let (still, mask) = painter::ball(&view, at(3.0), RADIUS_M);
    let colors = ColorModel::from_image(&Frame::from_rgb(640, 480, still, 0.0)?, &mask)?;

    let mut setup = Tracker::builder();
    let camera = setup.camera(view.clone());
    let ball = setup.target(DetectedSettings::ball(RADIUS_M, colors)?);
    let mut tracker = setup.build()?;
    for number in 0..20 {
        let time_s = f64::from(number) / 25.0;
        let truth_m = at(0.5 * time_s);
        let (rgb, _) = painter::ball(&view, truth_m, RADIUS_M);
        let frame = Frame::from_rgb(640, 480, rgb, time_s)?;
        tracker.observe(&FrameSet::of(camera, frame))?;
        if let Some(state) = tracker.estimate(ball)?.kinematics {
            println!(
                "{time_s:.2} s: {:.3?} m, truth {truth_m:.3?} m",
                state.position_m
            );
        }
    }
    Ok(())
}
