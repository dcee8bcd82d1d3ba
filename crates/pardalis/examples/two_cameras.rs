//! Two cameras without a common trigger: their frames are observed in temporal order, and together their rays
//! determine the depth.

mod painter;

use nalgebra::Vector3;
use pardalis::camera::{Pinhole, looking_at};
use pardalis::color::ColorModel;
use pardalis::tracker::DetectedSettings;
use pardalis::{Error, Frame, FrameSet, Tracker, View};

const RADIUS_M: f64 = 0.035;

fn main() -> Result<(), Error> {
    let view = |from_m: [f64; 3]| {
        let lens = Pinhole::new([320.0, 320.0], [159.5, 119.5], &[])?;
        let pose = looking_at(from_m.into(), Vector3::zeros(), 0.0).expect("two different points");
        View::new(lens, pose, (320, 240), None)
    };
    let views = [view([-0.4, -0.8, 0.3])?, view([0.4, -0.8, 0.3])?];
    let (still, mask) = painter::ball(&views[0], [0.0; 3], RADIUS_M);
    let colors = ColorModel::from_image(&Frame::from_rgb(320, 240, still, 0.0)?, &mask)?;

    let mut setup = Tracker::builder();
    let cameras = views.clone().map(|view| setup.camera(view));
    let ball = setup.target(DetectedSettings::ball(RADIUS_M, colors)?);
    let mut tracker = setup.build()?;
    for number in 0..20 {
        // The second camera takes its frames 10 ms after the first.
        for (camera, delay_s) in [(0, 0.0), (1, 0.010)] {
            let time_s = f64::from(number) / 25.0 + delay_s;
            let truth_m = [0.1 * time_s, 0.05, 0.02];
            let (rgb, _) = painter::ball(&views[camera], truth_m, RADIUS_M);
            let frame = Frame::from_rgb(320, 240, rgb, time_s)?;
            tracker.observe(&FrameSet::of(cameras[camera], frame))?;
            if let Some(state) = tracker.estimate(ball)?.kinematics {
                println!(
                    "{time_s:.3} s: {:.4?} m, truth {truth_m:.4?} m",
                    state.position_m
                );
            }
        }
    }
    Ok(())
}
