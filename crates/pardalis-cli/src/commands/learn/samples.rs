//! Learning from frames in memory in which somebody points at the target.

use std::path::PathBuf;

use anyhow::Result;
use pardalis::Frame;
use pardalis::color::{ColorModel, Palette};
use pardalis_camera::Camera;
use pardalis_images::RgbImage;

use super::contrast::{Search, ball_of_contrast};
use super::evidence::Evidence;
use super::inputs::LabelledFile;
use super::label::Label;
use super::outline::refined;
use super::{Lesson, in_better_palette};
use crate::draw::picture::picture_of;
use crate::user_error::user_error;

/// The radius of what fills a box, as a share of half its sides. Hand-set: boxes are hardly drawn more roughly.
const FILLED: std::ops::RangeInclusive<f64> = 0.6..=1.15;
/// Of 3 x 3 pixels, a majority.
const MAJORITY: u8 = 5;
/// The colour of pixels in the colours of the target.
const MARKED: [u8; 3] = [255, 0, 200];

/// What was pointed at in an image; pixel centres at integers.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Pointed {
    /// A pixel on the target.
    At([f64; 2]),
    /// Two opposite corners of a box around the target.
    Within([f64; 2], [f64; 2]),
}

/// A frame in which the target is labelled.
#[derive(Debug, Clone)]
pub(crate) struct Sample {
    /// The camera.
    pub(crate) camera: String,
    /// Its lens, if it is known.
    pub(crate) lens: Option<Camera>,
    /// The number of the frame.
    pub(crate) number: usize,
    pub(crate) frame: Frame,
    /// The corners of the target's outline, pixel centres at integers.
    pub(crate) outline_px: Vec<[f64; 2]>,
}

/// What was learnt.
pub(crate) struct Learnt {
    pub(crate) model: ColorModel,
    evidence: Evidence,
    /// The share of the target's pixels whose colours are found, and that of other pixels that are mistaken for it.
    pub(crate) found: f64,
    pub(crate) mistaken: f64,
    /// The frames, by their place among the samples, in which the detector does not find what is labelled.
    pub(crate) failed: Vec<usize>,
    /// The options of the palette that was taken because the detector misses the ball with the default one.
    pub(crate) palette: Option<&'static str>,
}

/// Returns the outline of a ball that was pointed at, as a camera with this lens shows it; without a lens, as a typical one does. The image decides: what is
/// pointed at need not be exact.
///
/// Errors: there is nothing round.
pub(crate) fn outline_of(
    frame: &Frame,
    lens: Option<Camera>,
    pointed: Pointed,
) -> Result<Vec<[f64; 2]>> {
    let label = Label::Polygon(Vec::new());
    let file = LabelledFile::of_frame(PathBuf::from("image"), (0, frame.clone()), lens, label);
    let camera = file.lens(frame)?;
    let rough_px = match pointed {
        Pointed::At(at) => {
            ball_of_contrast(frame, &camera, &Search::around(frame, at)).ok_or_else(|| {
                user_error!(
                    "there is nothing round at this place that differs from what surrounds it; drag a box around the whole target instead"
                )
            })?
        }
        Pointed::Within(a, b) => {
            let radius_px = 0.25 * ((a[0] - b[0]).abs() + (a[1] - b[1]).abs());
            // Boxes are drawn roughly, and what is beside the target in them is not to be learnt.
            let search = Search {
                at: [0, 1].map(|axis| 0.5 * (a[axis] + b[axis])),
                off_radii: 0.5,
                radius_px: FILLED.start() * radius_px..=FILLED.end() * radius_px,
            };
            match ball_of_contrast(frame, &camera, &search) {
                Some(outline_px) => outline_px,
                None => box_of(frame, pointed)?,
            }
        }
    };
    refined((&file, frame), rough_px)
}

/// Returns the corners of the box in which something that is no ball was pointed at.
///
/// Errors: it was not a box.
pub(crate) fn box_of(frame: &Frame, pointed: Pointed) -> Result<Vec<[f64; 2]>> {
    let Pointed::Within(a, b) = pointed else {
        return Err(user_error!(
            "the outline at a click is that of a ball; drag a box closely around the target instead"
        ));
    };
    let Label::Rect {
        x,
        y,
        width,
        height,
    } = boxed(frame, a, b)?
    else {
        unreachable!("it is a box");
    };
    let [left, top] = [x, y].map(|first| (first as f64 - 0.5).max(0.0));
    let (right, bottom) = ((x + width) as f64 - 0.5, (y + height) as f64 - 0.5);
    Ok(vec![
        [left, top],
        [right, top],
        [right, bottom],
        [left, bottom],
    ])
}

/// Learns the colours of the target from samples.
///
/// Errors: there are none.
pub(crate) fn learn_samples(samples: &[Sample]) -> Result<Learnt> {
    let files: Vec<LabelledFile> = samples
        .iter()
        .map(|sample| {
            let label = Label::Polygon(sample.outline_px.clone());
            let name = PathBuf::from(&sample.camera);
            let frame = (sample.number, sample.frame.clone());
            LabelledFile::of_frame(name, frame, sample.lens.clone(), label)
        })
        .collect();
    learn(&files)
}

fn learn(files: &[LabelledFile]) -> Result<Learnt> {
    let lesson = super::learn(files, Palette::HSI)?;
    let better = in_better_palette(files, &lesson, lesson.check.found())?;
    let palette = better.as_ref().map(|(_, options)| *options);
    let Lesson {
        evidence,
        model,
        check,
        ..
    } = better.map_or(lesson, |(better, _)| better);
    let failed = check.images.iter().enumerate();
    Ok(Learnt {
        found: evidence.separation.object_found,
        mistaken: evidence.separation.background_mistaken,
        failed: failed
            .filter_map(|(number, image)| image.failed().then_some(number))
            .collect(),
        palette,
        model,
        evidence,
    })
}

impl Learnt {
    /// Returns a frame in grey, with what is in the target's colours marked, and which share of it that is. As the detector does, it ignores single pixels.
    pub(crate) fn marked(&self, frame: &Frame) -> (RgbImage, f64) {
        let log_odds = &self.evidence.separation.log_odds;
        let bins = self.evidence.learner().bins_of(frame);
        let is_in = |bin: &u16| u8::from(log_odds[usize::from(*bin)] > 0.0);
        let is_in: Vec<u8> = bins.iter().map(is_in).collect();
        let (width, height) = (frame.width(), frame.height());
        let mut picture = picture_of(frame);
        let mut count = 0;
        for (index, pixel) in picture.pixels_mut().enumerate() {
            let grey = (pixel.iter().map(|c| u16::from(*c)).sum::<u16>() / 3) as u8;
            *pixel = [grey / 2 + 20; 3];
            let (x, y) = (index % width, index / width);
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            let columns = x.saturating_sub(1)..(x + 2).min(width);
            let around = rows.flat_map(|row| &is_in[row * width..][columns.clone()]);
            if around.sum::<u8>() >= MAJORITY {
                *pixel = MARKED;
                count += 1;
            }
        }
        (picture, f64::from(count) / (width * height) as f64)
    }
}

/// Returns a box as a label.
fn boxed(frame: &Frame, a: [f64; 2], b: [f64; 2]) -> Result<Label> {
    let sides = [frame.width(), frame.height()];
    let first = [0, 1].map(|axis| a[axis].min(b[axis]).round().max(0.0) as usize);
    let end =
        [0, 1].map(|axis| (a[axis].max(b[axis]).round().max(0.0) as usize + 1).min(sides[axis]));
    if (0..2).any(|axis| end[axis] < first[axis] + 3) {
        return Err(user_error!(
            "the box is too small, or beside the image; drag it around the whole target"
        ));
    }
    Ok(Label::Rect {
        x: first[0],
        y: first[1],
        width: end[0] - first[0],
        height: end[1] - first[1],
    })
}

#[cfg(test)]
mod tests {
    use pardalis_camera::Equidistant;

    use super::*;
    use crate::commands::learn::balls::Circle;
    use crate::source::decode::decode_image;

    /// Frames of the bundled sequence of a fisheye camera, and the circle with the centre and area of the ball's outline in each, from truth.csv and
    /// camera.json. A fisheye lens shows a ball far off its axis as an ellipse: in the first, with half axes of 8.6 and 12.4 pixels.
    const BALLS: [(usize, [f64; 2], f64); 7] = [
        (0, [459.9, 87.9], 10.32),
        (18, [439.6, 87.8], 9.68),
        (48, [245.1, 63.6], 8.18),
        (60, [199.6, 91.0], 6.12),
        (80, [179.3, 99.0], 4.95),
        (96, [204.3, 80.5], 5.24),
        (102, [213.7, 74.7], 5.32),
    ];

    /// The same of a bundled mirror.
    const MIRROR: [(usize, [f64; 2], f64); 2] =
        [(0, [192.4, 177.8], 10.3), (12, [235.2, 175.2], 9.1)];

    /// The same of a bundled webcam.
    const WEBCAM: [(usize, [f64; 2], f64); 6] = [
        (6, [159.5, 141.1], 25.3),
        (51, [159.5, 141.1], 25.3),
        (69, [166.5, 139.4], 25.5),
        (114, [171.8, 83.0], 20.9),
        (147, [114.7, 167.1], 32.0),
        (153, [154.5, 167.9], 30.4),
    ];

    fn frame(number: usize) -> Frame {
        bundled(&format!("dioptric-jump/frames/{number:06}.jpg"))
    }

    #[test]
    fn a_click_or_a_rough_box_gives_the_outline() {
        let lens = Equidistant::new(145.56, [319.5, 239.5], 92.5_f64.to_radians()).unwrap();
        let (mut sum, mut count) = (0.0, 0.0);
        for (number, [u, v], r) in BALLS {
            let frame = frame(number);
            let circle = Circle {
                center_px: [u, v],
                radius_px: r,
            };
            for pointed in [
                Pointed::At([u, v]),
                Pointed::At([u + 0.4 * r, v - 0.4 * r]),
                Pointed::Within([u - 1.2 * r, v - 1.1 * r], [u + 1.1 * r, v + 1.2 * r]),
            ] {
                let outline = outline_of(&frame, Some(lens.into()), pointed).unwrap();
                let found = Circle::of_outline(&outline).unwrap();
                assert!(
                    circle.radii_to(&found) * r < 0.8,
                    "{number} {pointed:?}: {found:?}"
                );
                let larger_px = found.radius_px - r;
                assert!(larger_px.abs() < 0.3, "{number} {pointed:?}: {found:?}");
                sum += larger_px;
                count += 1.0;
            }
        }
        // A tenth of a pixel too small is 2 % too far.
        let mean_px: f64 = sum / count;
        assert!(mean_px.abs() < 0.06, "{mean_px}");
    }

    /// Reads a frame of a bundled sequence.
    fn bundled(file: &str) -> Frame {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data");
        let image = decode_image(format!("{root}/{file}").as_ref()).unwrap();
        let (width, height) = image.size_px();
        Frame::from_rgb(width, height, image.into_raw(), 0.0).unwrap()
    }

    #[test]
    fn colours_are_learnt_in_a_palette_in_which_the_ball_is_found() {
        // Of the default palette, both colours are in one bin.
        let [ball, floor] = [[150.0, 72.0, 60.0], [158.0, 104.0, 64.0]];
        let (width, height) = (160, 120);
        let color = |index: usize| {
            let [x, y] = [index % width, index / width].map(|at| at as f64);
            let share = 1.0 / (1.0 + libm::exp(2.0 * (libm::hypot(x - 60.0, y - 60.0) - 14.0)));
            [0, 1, 2].map(|c| (floor[c] + share * (ball[c] - floor[c])) as u8)
        };
        let pixels: Vec<u8> = (0..width * height).flat_map(color).collect();
        let corner = |corner: i32| {
            let turn = f64::from(corner) * std::f64::consts::TAU / 24.0;
            [60.0 + 14.0 * libm::cos(turn), 60.0 + 14.0 * libm::sin(turn)]
        };
        let sample = Sample {
            camera: "cam1".to_owned(),
            lens: None,
            number: 0,
            frame: Frame::from_rgb(width, height, pixels, 0.0).unwrap(),
            outline_px: (0..24).map(corner).collect(),
        };
        let learnt = learn_samples(&[sample]).unwrap();
        assert_eq!(learnt.failed, [0; 0]);
        assert_ne!(learnt.model.palette(), Palette::HSI);
        assert!(learnt.palette.is_some());
    }

    /// In these frames of a bundled webcam, the ball has a highlight, is reflected by the table, and is before books of many colours.
    #[test]
    fn a_click_gives_the_ball_where_no_colour_is_round() {
        // From truth.csv and cameras.json.
        for (number, [u, v], r) in WEBCAM {
            let frame = bundled(&format!("webcams-two/frames/cam1/{number:06}.jpg"));
            for [du, dv] in [
                [0.1, -0.1],
                [0.3, 0.0],
                [-0.3, 0.0],
                [0.0, 0.3],
                [0.0, -0.3],
            ] {
                let at = [u + du * r, v + dv * r];
                let outline = outline_of(&frame, None, Pointed::At(at)).unwrap();
                let found = Circle::of_outline(&outline).unwrap();
                let off_px = libm::hypot(found.center_px[0] - u, found.center_px[1] - v);
                assert!(off_px < 0.06 * r, "{number} {at:?}: {found:?}");
                let size = found.radius_px / r;
                assert!((0.94..1.06).contains(&size), "{number} {at:?}: {found:?}");
            }
        }
    }

    /// A mirror shows the ball as an ellipse whose axes are as 1 to 3.
    #[test]
    fn a_click_gives_the_outline_in_a_mirror() {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data");
        let file = format!("{root}/catadioptric-bounce/camera.json");
        let cameras = crate::scene_files::read_calibration(std::path::Path::new(""), &file, None);
        let lens = &cameras.unwrap()[0].camera;
        // From truth.csv and camera.json.
        for (number, [u, v], r) in MIRROR {
            let frame = bundled(&format!("catadioptric-bounce/frames/{number:06}.jpg"));
            let at = [u + 0.2 * r, v - 0.1 * r];
            let outline = outline_of(&frame, Some(lens.clone()), Pointed::At(at)).unwrap();
            let found = Circle::of_outline(&outline).unwrap();
            let off_px = libm::hypot(found.center_px[0] - u, found.center_px[1] - v);
            assert!(off_px < 0.8, "{number}: {found:?}");
            assert!((found.radius_px - r).abs() < 0.6, "{number}: {found:?}");
        }
    }
}
