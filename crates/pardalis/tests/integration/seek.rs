//! Detected targets on the rendered fisheye sequence: detection, tracking, occlusion and loss.

use std::ops::Range;

use crate::common::{FPS, SIZE, data, detected_ball, fisheye_view, frame, jump_picture, set_of};
use pardalis::color::YuvEncoding;
use pardalis::likelihood::EdgeSettings;
use pardalis::tracker::{DetectedSettings, PASSES_SIGMA_M, Region, TrackState, Verdict};
use pardalis::{Estimate, Frame, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use pardalis_images::RgbImage;

/// Returns the ball as a detected target with these settings of the edge cue.
fn detected(edge: EdgeSettings) -> DetectedSettings {
    let mut ball = detected_ball();
    ball.edge = edge;
    ball
}

fn tracker_with(edge: EdgeSettings, seed: u32) -> Tracker {
    let views = vec![fisheye_view()];
    Tracker::new(views, vec![detected(edge)], seed, Level::best()).unwrap()
}

pub(crate) fn tracker(seed: u32) -> Tracker {
    tracker_with(EdgeSettings::default(), seed)
}

pub(crate) fn truth_m(index: usize) -> [f64; 3] {
    let table = std::fs::read_to_string(data("dioptric-jump/truth.csv")).unwrap();
    let row: Vec<&str> = table.lines().nth(index + 1).unwrap().split(',').collect();
    [4, 5, 6].map(|column| row[column].parse().unwrap())
}

pub(crate) fn as_frame(picture: &RgbImage, index: usize, format: PixelFormat) -> Frame {
    frame(picture, format, YuvEncoding::default(), index as f64 / FPS)
}

/// Returns the estimate after each frame.
fn track(tracker: &mut Tracker, frames: impl IntoIterator<Item = Frame>) -> Vec<Estimate> {
    let step = |frame: Frame| {
        let time_s = frame.time_s();
        tracker.observe(&set_of(frame)).unwrap();
        tracker.estimate_at(TargetId::new(0), time_s).unwrap()
    };
    frames.into_iter().map(step).collect()
}

pub(crate) fn error_m(estimate: &Estimate, index: usize) -> f64 {
    let found_m = estimate.kinematics.expect("an estimate").position_m;
    let squares = found_m
        .iter()
        .zip(truth_m(index))
        .map(|(a, b)| (a - b).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Returns a picture of the sequence with the ball and its surroundings painted over in grey.
pub(crate) fn covered(index: usize) -> RgbImage {
    let mut picture = jump_picture(index);
    let view = fisheye_view();
    let position_m = nalgebra::Point3::from(truth_m(index));
    let place = view.camera_from_world() * position_m;
    let [u, v] = view.camera().project(place.into()).unwrap();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        if (f64::from(x) - u).abs() < 40.0 && (f64::from(y) - v).abs() < 40.0 {
            *pixel = [90, 92, 95];
        }
    }
    picture
}

#[test]
fn a_thrown_ball_is_detected_and_tracked_in_any_format() {
    for (seed, format) in [(1, PixelFormat::Rgb8), (2, PixelFormat::I420)] {
        let frames = (0..25).map(|index| as_frame(&jump_picture(index), index, format));
        let estimates = track(&mut tracker(seed), frames);
        for (index, estimate) in estimates.iter().enumerate().skip(2) {
            assert_eq!(estimate.state, TrackState::Tracking, "frame {index}");
            assert!(error_m(estimate, index) < 0.1, "frame {index}");
            assert!(estimate.confidence > 0.9, "frame {index}");
        }
    }
}

#[test]
fn an_outline_fainter_than_those_of_targets_is_a_patch_of_something_larger() {
    let verdicts = |clear_contrast: f64| {
        let mut ball = detected_ball();
        // The perfect outline of a rendered ball outweighs the default.
        ball.tuning.association.faint_nats = 20.0;
        ball.tuning.association.faint_contrast = 0.5 * clear_contrast;
        ball.tuning.association.clear_contrast = clear_contrast;
        let mut tracker = Tracker::new(vec![fisheye_view()], vec![ball], 1, Level::best()).unwrap();
        let picture = |index| as_frame(&jump_picture(index), index, PixelFormat::Rgb8);
        let states = track(&mut tracker, (0..5).map(picture)).into_iter();
        let candidates = tracker.candidates(TargetId::new(0)).unwrap().flatten();
        let verdicts: Vec<_> = candidates.map(|candidate| candidate.verdict).collect();
        (states.last().unwrap().state, verdicts)
    };
    let (state, _) = verdicts(30.0);
    assert_eq!(state, TrackState::Tracking);
    // As if the ball stood out no more than a patch of skin does.
    let (state, found) = verdicts(5000.0);
    assert_eq!(state, TrackState::Searching);
    assert!(found.contains(&Verdict::NoEdges), "{found:?}");
}

#[test]
fn a_ball_outside_of_its_region_is_another_thing() {
    let tracked = |region: Region| {
        let mut ball = detected_ball();
        ball.existence.region = region;
        let views = vec![fisheye_view()];
        let mut tracker = Tracker::new(views, vec![ball], 1, Level::best()).unwrap();
        let picture = |index| as_frame(&jump_picture(index), index, PixelFormat::Rgb8);
        track(&mut tracker, (0..10).map(picture))
    };
    let everywhere = tracked(Region::default());
    assert!(everywhere.iter().any(is_tracked));
    // The ball is 0.1 to 0.9 m above the floor, the camera 0.9 m.
    let above_floor = Region {
        min_m: [-5.0, -5.0, 0.0],
        max_m: [5.0, 5.0, 3.0],
    };
    let estimates = tracked(above_floor);
    for (index, (inside, everywhere)) in estimates.iter().zip(&everywhere).enumerate() {
        assert_eq!(inside.state, everywhere.state, "frame {index}");
        let position_m = inside.kinematics.unwrap().position_m;
        assert!(above_floor.contains(position_m) && error_m(inside, index) < 0.1);
    }
    let below_floor = Region {
        max_m: [5.0, 5.0, -0.5],
        ..Region::default()
    };
    assert!(!tracked(below_floor).iter().any(is_tracked));
}

#[test]
fn a_covered_ball_is_occluded_and_then_tracked_again() {
    let picture = |index| match index {
        10..15 => covered(index),
        _ => jump_picture(index),
    };
    let frames = (0..20).map(|index| as_frame(&picture(index), index, PixelFormat::Rgb8));
    let estimates = track(&mut tracker(3), frames);
    for index in 11..15 {
        assert_eq!(
            estimates[index].state,
            TrackState::Occluded,
            "frame {index}"
        );
    }
    // While the ball is occluded, its position becomes less and less certain.
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
fn images_without_a_ball_have_no_detection() {
    let frames = (0..10).map(|index| as_frame(&covered(index), index, PixelFormat::Rgb8));
    for estimate in track(&mut tracker(4), frames) {
        assert_eq!(estimate.state, TrackState::Searching);
        assert!(estimate.kinematics.is_none() && estimate.confidence < 0.1);
    }
    let black = RgbImage::new(SIZE.0 as u32, SIZE.1 as u32);
    let estimates = track(&mut tracker(5), [as_frame(&black, 0, PixelFormat::Rgb8)]);
    assert_eq!(estimates[0].state, TrackState::Searching);
}

/// Paints a disc over a picture, with an edge as blurred as the ball's.
fn with_disc(mut picture: RgbImage, [u, v]: [f64; 2], radius_px: f64, rgb: [f64; 3]) -> RgbImage {
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let off_px = (f64::from(x) - u).hypot(f64::from(y) - v) - radius_px;
        let share = 0.5 * libm::erfc(off_px / 1.2);
        for (value, painted) in pixel.iter_mut().zip(rgb) {
            *value = (f64::from(*value) * (1.0 - share) + painted * share).round() as u8;
        }
    }
    picture
}

#[test]
fn a_disc_of_equal_size_is_detected_only_if_its_whole_colour_matches() {
    let painted = |rgb, color_evidence| {
        let mut edge = EdgeSettings::default();
        edge.color_evidence = color_evidence;
        let picture = |index| with_disc(covered(index), [200.0, 150.0], 8.0, rgb);
        let frames = (0..15).map(|index| as_frame(&picture(index), index, PixelFormat::Rgb8));
        track(&mut tracker_with(edge, 7), frames)
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
        let mut states = estimates.iter().map(|estimate| estimate.state);
        states.all(|state| state == TrackState::Tracking)
    };
    assert!(is_taken(&painted([185.0, 90.0, 37.0], true)[2..]));
    // Without colour evidence, the hue suffices, in time: there is little contrast.
    assert!(is_taken(&painted([60.0, 30.0, 15.0], false)[10..]));
}

/// A disc in the image: its centre and its radius in pixels.
type Disc = ([f64; 2], f64);

/// Returns a frame in which the ball is replaced by discs of its colour, later ones in front of earlier ones.
fn with_balls(index: usize, discs: &[Disc]) -> Frame {
    let balls = discs
        .iter()
        .fold(covered(index), |picture, (center, radius_px)| {
            with_disc(picture, *center, *radius_px, [185.0, 90.0, 37.0])
        });
    as_frame(&balls, index, PixelFormat::Rgb8)
}

/// Returns the estimates of two targets that look alike after each frame.
fn track_two(seed: u32, frames: impl IntoIterator<Item = Frame>) -> Vec<[Estimate; 2]> {
    let ball = || detected(EdgeSettings::default());
    let views = vec![fisheye_view()];
    let mut tracker = Tracker::new(views, vec![ball(), ball()], seed, Level::best()).unwrap();
    let step = |frame: Frame| {
        let time_s = frame.time_s();
        tracker.observe(&set_of(frame)).unwrap();
        let targets = [0, 1].map(TargetId::new);
        targets.map(|target| tracker.estimate_at(target, time_s).unwrap())
    };
    frames.into_iter().map(step).collect()
}

/// Returns the disc whose centre is within two pixels of the target.
fn disc_of(estimate: &Estimate, discs: &[Disc]) -> Option<usize> {
    let view = fisheye_view();
    let position_m = nalgebra::Point3::from(estimate.kinematics?.position_m);
    let place = view.camera_from_world() * position_m;
    let [u, v] = view.camera().project(place.into())?;
    let off_px = |disc: &Disc| (disc.0[0] - u).hypot(disc.0[1] - v);
    discs.iter().position(|disc| off_px(disc) < 2.0)
}

#[test]
fn two_targets_are_assigned_to_two_equal_balls() {
    let discs = [([200.0, 150.0], 8.0), ([300.0, 180.0], 8.0)];
    for seed in 1..6 {
        let frames = (0..8).map(|index| with_balls(index, &discs));
        let estimates = track_two(seed, frames);
        for (index, both) in estimates.iter().enumerate().skip(2) {
            let mut found = both.each_ref().map(|estimate| disc_of(estimate, &discs));
            found.sort_unstable();
            assert_eq!(found, [Some(0), Some(1)], "seed {seed}, frame {index}");
            assert!(both.iter().all(|e| e.state == TrackState::Tracking));
        }
    }
}

/// Checks with these seeds that one of two targets is a single ball, and the other none.
fn check_single_ball(seeds: Range<u32>) {
    for seed in seeds {
        let discs = [([200.0, 150.0], 8.0)];
        let frames = (0..25).map(|index| with_balls(index, &discs));
        let estimates = track_two(seed, frames);
        for (index, [one, other]) in estimates.iter().enumerate().skip(2) {
            assert_eq!(
                one.state,
                TrackState::Tracking,
                "seed {seed}, frame {index}"
            );
            assert_eq!(
                other.state,
                TrackState::Searching,
                "seed {seed}, frame {index}"
            );
            assert!(other.confidence < 0.5, "{}", other.confidence);
        }
    }
}

#[test]
fn a_single_ball_is_assigned_to_one_of_two_targets() {
    check_single_ball(1..3);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn a_single_ball_is_assigned_to_one_of_two_targets_with_more_seeds() {
    check_single_ball(3..6);
}

/// Checks with these seeds that two equal balls that pass each other keep their identities.
fn check_passing_balls(seeds: Range<u32>) {
    // The second is nearer and occludes the first completely.
    let discs = |index: usize| {
        let moved_px = 4.0 * index as f64;
        [
            ([330.0 - moved_px, 150.0], 6.0),
            ([200.0 + moved_px, 152.0], 11.0),
        ]
    };
    for seed in seeds {
        let frames = (0..32).map(|index| with_balls(index, &discs(index)));
        let estimates = track_two(seed, frames);
        let found = |index: usize| {
            let discs = discs(index);
            estimates[index]
                .each_ref()
                .map(|estimate| disc_of(estimate, &discs))
        };
        let first = found(4);
        assert!(
            first == [Some(0), Some(1)] || first == [Some(1), Some(0)],
            "seed {seed}: {first:?}"
        );
        for index in (4..12).chain(22..32) {
            assert_eq!(found(index), first, "seed {seed}, frame {index}");
        }
        // In between, neither target is lost, and they do not merge.
        for (index, both) in estimates.iter().enumerate().take(22).skip(12) {
            let [one, other] = both.each_ref().map(|e| e.kinematics.unwrap().position_m);
            let apart_m = (0..3)
                .map(|i| (one[i] - other[i]).powi(2))
                .sum::<f64>()
                .sqrt();
            assert!(apart_m > 0.11, "seed {seed}, frame {index}: {apart_m}");
        }
        let occluded = first.iter().position(|found| *found == Some(0)).unwrap();
        let states = [16, 17].map(|index| estimates[index][occluded].state);
        assert!(
            states.contains(&TrackState::Occluded),
            "seed {seed}: {states:?}"
        );
    }
}

#[test]
fn two_equal_balls_that_pass_each_other_keep_their_identities() {
    check_passing_balls(1..3);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn two_equal_balls_that_pass_each_other_keep_their_identities_with_more_seeds() {
    check_passing_balls(3..6);
}

#[test]
fn two_equal_balls_in_a_single_image_are_assigned_to_two_targets() {
    let ball = || detected(EdgeSettings::default());
    let views = vec![fisheye_view()];
    let mut tracker = Tracker::new(views, vec![ball(), ball()], 1, Level::best()).unwrap();
    let discs = [([200.0, 150.0], 8.0), ([300.0, 180.0], 8.0)];
    let frame = with_balls(0, &discs);
    let located = tracker
        .locate(&set_of(frame), &[None; 2], &PASSES_SIGMA_M)
        .unwrap();
    let mut found = [0, 1].map(|target: usize| disc_of(&located[target], &discs));
    found.sort_unstable();
    assert_eq!(found, [Some(0), Some(1)]);
}

/// Applies gains to the red, green and blue of a picture.
fn in_light(mut picture: RgbImage, gains: [f64; 3]) -> RgbImage {
    for pixel in picture.pixels_mut() {
        for (value, gain) in pixel.iter_mut().zip(gains) {
            *value = (f64::from(*value) * gain).round().min(255.0) as u8;
        }
    }
    picture
}

/// Gains of darker illumination, and of darker and colder illumination.
const DARK: [f64; 3] = [0.28, 0.28, 0.28];
const COLD: [f64; 3] = [0.42, 0.6, 1.0];

/// Number of frames in five seconds, in which the ball moves a little, back and forth.
const FIVE_SECONDS: usize = 125;

/// Returns the index of the picture that one of these frames shows.
fn picture_of(frame: usize) -> usize {
    let step = frame % 50;
    step.min(49 - step)
}

/// Returns the estimates of five seconds. `paint` returns a frame's picture, given an index and the share of the time
/// that has passed.
fn five_seconds(
    illumination_adaptation: bool,
    paint: impl Fn(usize, f64) -> RgbImage,
) -> Vec<Estimate> {
    let mut edge = EdgeSettings::default();
    edge.illumination_adaptation = illumination_adaptation;
    let frames = (0..FIVE_SECONDS).map(|frame| {
        let share = frame as f64 / (FIVE_SECONDS - 1) as f64;
        as_frame(&paint(picture_of(frame), share), frame, PixelFormat::Rgb8)
    });
    track(&mut tracker_with(edge, 8), frames)
}

fn is_tracked(estimate: &Estimate) -> bool {
    estimate.state == TrackState::Tracking
}

/// Checks that a ball is tracked in changing light, of these gains at last, and only with illumination adaptation.
fn check_changing_illumination(gains: [f64; 3]) {
    let paint = |index, share| {
        let gains = gains.map(|gain| libm::pow(gain, share));
        in_light(jump_picture(index), gains)
    };
    let adapting = five_seconds(true, paint);
    for (frame, estimate) in adapting.iter().enumerate().skip(2) {
        assert!(is_tracked(estimate), "frame {frame}");
        let error_m = error_m(estimate, picture_of(frame));
        assert!(error_m < 0.1, "frame {frame}: {error_m}");
    }
    let fixed = five_seconds(false, paint);
    assert!(is_tracked(&fixed[30]));
    assert!(!is_tracked(&fixed[FIVE_SECONDS - 1]));
}

#[test]
fn darker_and_colder_illumination_requires_illumination_adaptation() {
    check_changing_illumination(COLD);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn darker_illumination_requires_illumination_adaptation() {
    check_changing_illumination(DARK);
}

/// Checks that a ball is no longer tracked after it has slowly changed to these colours.
fn check_slow_change_of_colour(colors: &[[f64; 3]]) {
    const ORANGE: [f64; 3] = [185.0, 90.0, 37.0];
    for rgb in colors {
        let estimates = five_seconds(true, |index, share| {
            let turned = (share / 0.75).min(1.0);
            let now = [0, 1, 2].map(|i| ORANGE[i] + turned * (rgb[i] - ORANGE[i]));
            with_disc(covered(index), [200.0, 150.0], 8.0, now)
        });
        assert!(estimates[2..20].iter().all(is_tracked), "{rgb:?}");
        for estimate in &estimates[FIVE_SECONDS - 10..] {
            assert!(!is_tracked(estimate), "{rgb:?}");
            assert!(estimate.confidence < 0.5, "{rgb:?}");
        }
    }
}

#[test]
fn a_ball_that_slowly_changes_its_colour_is_not_tracked() {
    // Skin or wood.
    check_slow_change_of_colour(&[[150.0, 105.0, 78.0]]);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn a_ball_that_slowly_turns_brown_or_olive_is_not_tracked() {
    check_slow_change_of_colour(&[[60.0, 30.0, 15.0], [90.0, 110.0, 40.0]]);
}

#[test]
fn a_disc_of_another_colour_is_not_detected_after_adaptation() {
    let estimates = five_seconds(true, |index, share| {
        let ball_or_none = if share < 0.7 { jump_picture } else { covered };
        let skin = [150.0, 105.0, 78.0];
        let picture = with_disc(ball_or_none(index), [200.0, 150.0], 8.0, skin);
        let faded = (share / 0.7).min(1.0);
        in_light(picture, DARK.map(|gain| libm::pow(gain, faded)))
    });
    let gone = FIVE_SECONDS * 7 / 10 + 2;
    assert!(estimates[2..gone - 5].iter().all(is_tracked));
    for estimate in &estimates[gone + 5..] {
        assert!(!is_tracked(estimate));
        assert!(estimate.confidence < 0.5, "{}", estimate.confidence);
    }
}

#[test]
fn threads_and_instruction_sets_do_not_change_the_estimates() {
    let run = |threads: usize, level: Level| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let frames = (0..6).map(|i| as_frame(&jump_picture(i), i, PixelFormat::Rgb8));
            let target = detected_ball();
            let mut tracker = Tracker::new(vec![fisheye_view()], vec![target], 6, level).unwrap();
            track(&mut tracker, frames)
        })
    };
    let one = run(1, Level::BASELINE);
    assert!(one[5].kinematics.is_some());
    for level in Level::available() {
        for threads in [1, 2, 5] {
            assert_eq!(one, run(threads, level), "{threads} threads at {level:?}");
        }
    }
}
