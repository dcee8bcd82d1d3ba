//! From frames in memory to 3D positions: one camera, one ball.

use pardalis::camera::{Pinhole, Pose};
use pardalis::color::ColorModel;
use pardalis::tracker::DetectedSettings;
use pardalis::{Error, Frame, FrameSet, Tracker, View};

fn main() -> Result<(), Error> {
    let lens = Pinhole::new([500.0, 500.0], [159.5, 119.5], &[])?;
    let (still, mask) = picture(0.0);
    let colors = ColorModel::from_image(&Frame::from_rgb(320, 240, still, 0.0)?, &mask)?;

    let mut setup = Tracker::builder();
    let camera = setup.camera(View::new(lens, Pose::identity(), (320, 240), None)?);
    let ball = setup.target(DetectedSettings::ball(0.1, colors)?);
    let mut tracker = setup.build()?;
    for number in 0..20 {
        let time_s = f64::from(number) / 25.0;
        let frame = Frame::from_rgb(320, 240, picture(time_s).0, time_s)?;
        tracker.observe(&FrameSet::of(camera, frame))?;
        let estimate = tracker.estimate(ball)?;
        let position_m = estimate.kinematics.map(|state| state.position_m);
        println!("{time_s:.2} s: {} {position_m:.3?}", estimate.state.name());
    }
    Ok(())
}

/// Replaces a camera: returns packed RGB of an orange ball that moves to the right 2 m ahead, and which pixels show
/// it.
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
