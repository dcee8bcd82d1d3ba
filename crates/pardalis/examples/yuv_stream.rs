//! A webcam's YUYV frames, used without conversion to RGB.

mod painter;

use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::DetectedSettings;
use pardalis::{Error, Frame, FrameSet, PixelFormat, Tracker, View};

const RADIUS_M: f64 = 0.1;

/// Packs RGB as YUYV: two pixels share their chroma.
fn yuyv(rgb: &[u8], encoding: YuvEncoding) -> Vec<u8> {
    let yuv = |rgb: &[u8]| encoding.yuv_from_rgb([rgb[0], rgb[1], rgb[2]].map(f64::from));
    let pairs = rgb.chunks_exact(6).flat_map(|pair| {
        let ([y0, u, v], [y1, ..]) = (yuv(&pair[..3]), yuv(&pair[3..]));
        [y0, u, y1, v].map(|value| value.round() as u8)
    });
    pairs.collect()
}

fn main() -> Result<(), Error> {
    let lens = Pinhole::new([500.0, 500.0], [159.5, 119.5], &[])?;
    let view = View::new(lens, Pose::identity(), (320, 240), None)?;
    let encoding = YuvEncoding::VIDEO;
    let frame_at = |center_m: [f64; 3], time_s: f64| {
        let (rgb, mask) = painter::ball(&view, center_m, RADIUS_M);
        let bytes = yuyv(&rgb, encoding);
        let frame = Frame::new(PixelFormat::Yuyv, encoding, 320, 240, bytes, time_s)?;
        Ok::<_, Error>((frame, mask))
    };
    let (still, mask) = frame_at([0.0, 0.0, 2.0], 0.0)?;
    let colors = ColorModel::from_image(&still, &mask)?;

    let mut setup = Tracker::builder();
    let camera = setup.camera(view.clone());
    let ball = setup.target(DetectedSettings::ball(RADIUS_M, colors)?);
    let mut tracker = setup.build()?;
    for number in 0..20 {
        let time_s = f64::from(number) / 30.0;
        let truth_m = [-0.2 + 0.3 * time_s, 0.05, 2.0];
        tracker.observe(&FrameSet::of(camera, frame_at(truth_m, time_s)?.0))?;
        if let Some(state) = tracker.estimate(ball)?.kinematics {
            println!(
                "{time_s:.2} s: {:.3?} m, truth {truth_m:.3?} m",
                state.position_m
            );
        }
    }
    Ok(())
}
