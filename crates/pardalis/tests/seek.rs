//! Targets without a start: found, followed, hidden, lost and found again, on the rendered fisheye sequence.

mod common;

use common::{FPS, SIZE, ball_target, data, fisheye_view, frame, jump_picture};
use image::{Rgb, RgbImage};
use pardalis::color::{Palette, YuvEncoding};
use pardalis::filter::FilterSettings;
use pardalis::likelihood::{Cue, EdgeSettings};
use pardalis::motion::ConstantVelocity;
use pardalis::simd::Level;
use pardalis::start::Start;
use pardalis::tracker::{BodySettings, TrackState};
use pardalis::{Estimate, Frame, PixelFormat, Tracker};

/// The ball, of which nothing but size and colours is known.
fn sought(edge: EdgeSettings) -> BodySettings {
    let published = ball_target(Palette::HSI, 500);
    BodySettings {
        cues: vec![Cue::Edge(edge).into()],
        filter: FilterSettings {
            motion: ConstantVelocity::BETWEEN_KICKS.into(),
            ..published.filter
        },
        start: Start::Anywhere,
        ..published
    }
}

fn tracker_with(edge: EdgeSettings, seed: u32) -> Tracker {
    let views = vec![fisheye_view()];
    Tracker::new(views, vec![sought(edge)], seed, Level::best()).unwrap()
}

fn tracker(seed: u32) -> Tracker {
    tracker_with(EdgeSettings::default(), seed)
}

fn truth_m(index: usize) -> [f64; 3] {
    let table = std::fs::read_to_string(data("dioptric-jump/truth.csv")).unwrap();
    let row: Vec<&str> = table.lines().nth(index + 1).unwrap().split(',').collect();
    [4, 5, 6].map(|column| row[column].parse().unwrap())
}

fn as_frame(picture: &RgbImage, index: usize, format: PixelFormat) -> Frame {
    frame(picture, format, YuvEncoding::default(), index as f64 / FPS)
}

/// What is known after each of these frames.
fn follow(tracker: &mut Tracker, frames: impl IntoIterator<Item = Frame>) -> Vec<Estimate> {
    let step = |frame: Frame| {
        let time_s = frame.time_s();
        tracker.observe(&[(0, frame)], time_s).unwrap();
        tracker.estimate_at(0, time_s)
    };
    frames.into_iter().map(step).collect()
}

fn error_m(estimate: &Estimate, index: usize) -> f64 {
    let found_m = estimate.kinematics.expect("an estimate").position_m;
    let squares = found_m
        .iter()
        .zip(truth_m(index))
        .map(|(a, b)| (a - b).powi(2));
    squares.sum::<f64>().sqrt()
}

/// The image with everything near a place in plain grey.
fn covered(index: usize) -> RgbImage {
    let mut picture = jump_picture(index);
    let view = fisheye_view();
    let position_m = nalgebra::Point3::from(truth_m(index));
    let place = view.camera_from_world() * position_m;
    let [u, v] = view.camera().project(place.into()).unwrap();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        if (f64::from(x) - u).abs() < 40.0 && (f64::from(y) - v).abs() < 40.0 {
            *pixel = Rgb([90, 92, 95]);
        }
    }
    picture
}

#[test]
fn a_thrown_ball_is_found_in_the_first_frames_and_followed_in_any_format() {
    for (seed, format) in [(1, PixelFormat::Rgb8), (2, PixelFormat::I420)] {
        let frames = (0..25).map(|index| as_frame(&jump_picture(index), index, format));
        let estimates = follow(&mut tracker(seed), frames);
        for (index, estimate) in estimates.iter().enumerate().skip(2) {
            assert_eq!(estimate.state, TrackState::Tracking, "frame {index}");
            assert!(error_m(estimate, index) < 0.1, "frame {index}");
            assert!(estimate.confidence > 0.9, "frame {index}");
        }
    }
}

#[test]
fn a_ball_that_something_hides_is_occluded_and_then_followed_again() {
    let picture = |index| match index {
        10..15 => covered(index),
        _ => jump_picture(index),
    };
    let frames = (0..20).map(|index| as_frame(&picture(index), index, PixelFormat::Rgb8));
    let estimates = follow(&mut tracker(3), frames);
    for index in 11..15 {
        assert_eq!(
            estimates[index].state,
            TrackState::Occluded,
            "frame {index}"
        );
    }
    // Hidden, it may be farther and farther from where it was thought to go.
    let variance = |index: usize| estimates[index].kinematics.unwrap().covariance_m2[0];
    assert!(variance(14) > 4.0 * variance(9));
    assert!(estimates[14].confidence < estimates[9].confidence);
    for index in 17..20 {
        assert_eq!(
            estimates[index].state,
            TrackState::Tracking,
            "frame {index}"
        );
        assert!(error_m(&estimates[index], index) < 0.1, "frame {index}");
    }
}

#[test]
fn where_there_is_no_ball_none_is_found() {
    let frames = (0..10).map(|index| as_frame(&covered(index), index, PixelFormat::Rgb8));
    for estimate in follow(&mut tracker(4), frames) {
        assert_eq!(estimate.state, TrackState::Searching);
        assert!(estimate.kinematics.is_none() && estimate.confidence < 0.1);
    }
    let black = RgbImage::new(SIZE.0 as u32, SIZE.1 as u32);
    let estimates = follow(&mut tracker(5), [as_frame(&black, 0, PixelFormat::Rgb8)]);
    assert_eq!(estimates[0].state, TrackState::Searching);
}

/// A disc, as soft at its edge as the ball's, painted over a picture.
fn with_disc(mut picture: RgbImage, [u, v]: [f64; 2], radius_px: f64, rgb: [f64; 3]) -> RgbImage {
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let off_px = (f64::from(x) - u).hypot(f64::from(y) - v) - radius_px;
        let share = 0.5 * libm::erfc(off_px / 1.2);
        for (value, painted) in pixel.0.iter_mut().zip(rgb) {
            *value = (f64::from(*value) * (1.0 - share) + painted * share).round() as u8;
        }
    }
    picture
}

#[test]
fn a_disc_of_its_size_and_hue_is_not_taken_for_the_ball_but_one_of_its_colour_is() {
    let painted = |rgb, weighs_colors| {
        let edge = EdgeSettings {
            weighs_colors,
            ..EdgeSettings::default()
        };
        let picture = |index| with_disc(covered(index), [200.0, 150.0], 8.0, rgb);
        let frames = (0..15).map(|index| as_frame(&picture(index), index, PixelFormat::Rgb8));
        follow(&mut tracker_with(edge, 7), frames)
    };
    // Hues of 18, 22 and 20 degrees.
    for rgb in [
        [125.0, 85.0, 68.0],
        [150.0, 105.0, 78.0],
        [60.0, 30.0, 15.0],
    ] {
        for estimate in painted(rgb, true) {
            assert_ne!(estimate.state, TrackState::Tracking, "{rgb:?}");
            assert!(
                estimate.confidence < 0.5,
                "{rgb:?}: {}",
                estimate.confidence
            );
        }
    }
    let is_taken = |estimates: &[Estimate]| {
        estimates[2..]
            .iter()
            .all(|e| e.state == TrackState::Tracking)
    };
    assert!(is_taken(&painted([185.0, 90.0, 37.0], true)));
    // It is the colour as a whole that tells.
    assert!(is_taken(&painted([60.0, 30.0, 15.0], false)));
}

/// The picture in other light: gains of red, green and blue.
fn in_light(mut picture: RgbImage, gains: [f64; 3]) -> RgbImage {
    for pixel in picture.pixels_mut() {
        for (value, gain) in pixel.0.iter_mut().zip(gains) {
            *value = (f64::from(*value) * gain).round().min(255.0) as u8;
        }
    }
    picture
}

/// Six seconds, in which the ball moves little, up and down again; `paint` makes each picture, given its number and the share of the time that is over.
fn six_seconds(edge: EdgeSettings, paint: impl Fn(usize, f64) -> RgbImage) -> Vec<Estimate> {
    let frames = (0..150).map(|count| {
        let index = if count % 50 < 25 {
            count % 25
        } else {
            24 - count % 25
        };
        let picture = paint(index, f64::from(count as u32) / 149.0);
        as_frame(&picture, count, PixelFormat::Rgb8)
    });
    follow(&mut tracker_with(edge, 8), frames)
}

const FIXED: EdgeSettings = EdgeSettings {
    adapts_colors: false,
    lines: 64,
    temper: 0.15,
    shared_sigma_px: 0.15,
    learnt_profile: true,
    tells_sides: true,
    watches_surroundings: true,
    weighs_colors: true,
};

/// Light that becomes so much darker and colder, and that grows warm.
const LIGHTS: [[f64; 3]; 3] = [[0.35, 0.35, 0.35], [0.48, 0.6, 0.9], [0.74, 0.6, 0.4]];

fn fading(gains: [f64; 3], share: f64) -> [f64; 3] {
    gains.map(|gain| libm::pow(gain, share))
}

#[test]
fn light_that_changes_is_followed_by_colours_that_adapt() {
    for gains in LIGHTS {
        for adapts in [true, false] {
            let edge = EdgeSettings {
                adapts_colors: adapts,
                ..EdgeSettings::default()
            };
            let estimates = six_seconds(edge, |index, share| {
                in_light(jump_picture(index), fading(gains, share))
            });
            let t: String = estimates
                .iter()
                .map(|e| format!("{:?}", e.state).chars().next().unwrap())
                .collect();
            println!(
                "{gains:?} {adapts} {t} {:.2} {:.2}",
                estimates[120].confidence, estimates[149].confidence
            );
        }
    }
}

#[test]
fn a_ball_that_is_painted_slowly() {
    for rgb in [
        [150.0, 105.0, 78.0],
        [230.0, 180.0, 60.0],
        [60.0, 30.0, 15.0],
        [215.0, 85.0, 60.0],
        [125.0, 85.0, 68.0],
    ] {
        for adapts in [true, false] {
            let edge = EdgeSettings {
                adapts_colors: adapts,
                ..EdgeSettings::default()
            };
            let estimates = six_seconds(edge, |index, share| {
                let color = [0, 1, 2].map(|i| {
                    [185.0, 90.0, 37.0][i]
                        + share.min(0.8) / 0.8 * (rgb[i] - [185.0, 90.0, 37.0][i])
                });
                with_disc(covered(index), [200.0, 150.0], 8.0, color)
            });
            let t: String = estimates
                .iter()
                .map(|e| format!("{:?}", e.state).chars().next().unwrap())
                .collect();
            println!(
                "{rgb:?} {adapts} {t} {:.2} {:.2}",
                estimates[120].confidence, estimates[149].confidence
            );
        }
    }
}

#[test]
fn distractor() {
    for gains in [[1.0; 3]] {
        for rgb in [
            [125.0, 85.0, 68.0],
            [150.0, 105.0, 78.0],
            [60.0, 30.0, 15.0],
            [200.0, 45.0, 40.0],
            [215.0, 85.0, 60.0],
            [170., 100., 60.],
        ] {
            for adapts in [true, false] {
                let edge = EdgeSettings {
                    adapts_colors: adapts,
                    ..EdgeSettings::default()
                };
                let estimates = six_seconds(edge, |index, share| {
                    let p = if share < 0.6 {
                        jump_picture(index)
                    } else {
                        covered(index)
                    };
                    in_light(
                        with_disc(p, [200.0, 150.0], 8.0, rgb),
                        fading(gains, (share / 0.6).min(1.0)),
                    )
                });
                let t: String = estimates
                    .iter()
                    .map(|e| format!("{:?}", e.state).chars().next().unwrap())
                    .collect();
                println!(
                    "{gains:?} {rgb:?} {adapts} {t} {:.2} {:.2}",
                    estimates[120].confidence, estimates[149].confidence
                );
            }
        }
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let frames = (0..6).map(|i| as_frame(&jump_picture(i), i, PixelFormat::Rgb8));
            follow(&mut tracker(6), frames)
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}
