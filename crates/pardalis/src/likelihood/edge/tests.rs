use super::*;
use crate::color::{ColorLearner, IlluminationCorrection, PixelKind, YuvEncoding};
use crate::detect::BinCounts;
use crate::reference;
use crate::shape::{Sphere, SphereOutline};
use crate::tuning::{AdaptationTuning, BlobTuning};
use crate::view::View;
use crate::{Frame, PixelFormat};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Pinhole};

pub(super) const SIZE: (usize, usize) = (160, 120);
pub(super) const RADIUS_M: f64 = 0.1;

fn view() -> View {
    view_from(0.0)
}

/// The view from a place along x.
fn view_from(x_m: f64) -> View {
    view_with_offset(x_m, [0.0; 2])
}

/// The same of a camera that shows everything this many pixels beside.
pub(super) fn view_with_offset(x_m: f64, [du, dv]: [f64; 2]) -> View {
    let camera = Camera::Pinhole(Pinhole::new([200.0; 2], [79.5 + du, 59.5 + dv], &[]).unwrap());
    View::new(camera, Pose::translation(x_m, 0.0, 0.0), SIZE, None).unwrap()
}

/// An orange ball at a place before a green ground, its edge as soft as a camera's, with what hides columns from `hidden_from` on.
pub(super) fn picture([x, y, z]: [f64; 3], hidden_from: usize) -> (Frame, Vec<bool>) {
    let (mut bytes, mut labels) = (Vec::new(), Vec::new());
    let center = nalgebra::Vector3::new(x, y, z);
    for i in 0..SIZE.0 * SIZE.1 {
        let (column, row) = (i % SIZE.0, i / SIZE.0);
        let ray = nalgebra::Vector3::new(
            (column as f64 - 79.5) / 200.0,
            (row as f64 - 59.5) / 200.0,
            1.0,
        );
        let off = ray.angle(&center) - (RADIUS_M / center.norm()).asin();
        let share = 0.5 * libm::erfc(off * 200.0 / 0.9 / 2.0_f64.sqrt());
        labels.push(share > 0.5);
        let mixed = [(230.0, 60.0), (110.0, 100.0), (20.0, 70.0)]
            .map(|(ball, ground)| ground + share * (ball - ground));
        let hidden = column >= hidden_from;
        bytes.extend(mixed.map(|value| if hidden { 15 } else { value as u8 }));
    }
    let encoding = YuvEncoding::default();
    let frame = Frame::new(PixelFormat::Rgb8, encoding, SIZE.0, SIZE.1, bytes, 0.0).unwrap();
    (frame, labels)
}

pub(super) fn colors() -> ColorModel {
    let mut learner = ColorLearner::new(Palette::HSI).unwrap();
    for x in [-0.1, 0.0, 0.13] {
        let (frame, labels) = picture([x, 0.02, 1.3 + x], SIZE.0);
        learner.add(&frame, &labels).unwrap();
    }
    learner.learn().unwrap()
}

/// Calls `look` with the cue of the ball and a picture's frame, prepared for it.
pub(super) fn with_frame<T>(
    frame: &Frame,
    surrounding: Option<&Surrounding>,
    look: impl FnOnce(&mut EdgeCue, EdgeFrame) -> T,
) -> T {
    with_frames(
        (1.0, 0.0),
        &[(frame, 0.0)],
        surrounding,
        |cue, mut frames| look(cue, frames.remove(0)),
    )
}

/// Calls `look` with the cue of a ball `scale` times as large, and with pictures of cameras at these places along x, whose errors have a standard deviation in pixels,
/// prepared for it.
pub(super) fn with_frames<T>(
    (scale, offset_sigma_px): (f64, f64),
    pictures: &[(&Frame, f64)],
    surrounding: Option<&Surrounding>,
    look: impl FnOnce(&mut EdgeCue, Vec<EdgeFrame>) -> T,
) -> T {
    let colors = colors();
    let mut cue = EdgeCue::new(
        (EdgeSettings::default(), EdgeTuning::DEFAULT),
        (ball_of(scale), true),
        &colors,
        (pictures.len(), Level::best()),
    )
    .unwrap();
    let correction = IlluminationCorrection::NONE;
    let mut views = Vec::new();
    let mut posteriors = Vec::new();
    for (frame, x_m) in pictures {
        let mut view = view_from(*x_m);
        let kind = PixelKind::of(frame);
        view.prepare(kind, cue.palette());
        view.prepare_ranges(kind, cue.ranges().unwrap());
        let prepared = view.prepared(frame);
        let (mut counts, mut posterior) = (BinCounts::default(), Vec::new());
        counts.count(&prepared, cue.palette(), &correction, (1, Level::best()));
        counts.color_posterior(&colors, &mut posterior);
        posteriors.push(posterior);
        views.push(view);
    }
    let look_alikes = Outlines::default();
    let frames = pictures.iter().enumerate().map(|(camera, (frame, _))| {
        let context = EdgeFrameContext {
            motion: None,
            colors: (cue.palette(), cue.ranges()),
            posterior: &posteriors[camera],
            correction,
            min_posterior: BlobTuning::DEFAULT.min_posterior,
            surrounding,
            look_alikes: &look_alikes,
            offset_sigma_px,
        };
        EdgeFrame::new(camera, views[camera].prepared(frame), context)
    });
    let frames = frames.collect();
    look(&mut cue, frames)
}

pub(super) fn ball() -> Shape {
    ball_of(1.0)
}

fn ball_of(scale: f64) -> Shape {
    Shape::Sphere(Sphere::new(scale * RADIUS_M, SphereOutline::Tangent).unwrap())
}

/// A start of a fit, of a ball whose size is known to a share.
pub(super) fn start_at(position_m: [f64; 3], tolerance: f64) -> FitStart<'static> {
    FitStart {
        position_m,
        displacement_m: [0.0; 3],
        log_scale: 0.0,
        prior: None,
        size: SizePrior {
            log_scale: 0.0,
            sigma: tolerance,
        },
        yaw: None,
        is_planar: false,
        min_log_ratio: f64::NEG_INFINITY,
    }
}

/// Fits a picture from a start.
fn fitted(
    frame: &Frame,
    start_m: [f64; 3],
    surrounding: Option<&Surrounding>,
) -> Option<Detection> {
    with_frame(frame, surrounding, |cue, frame| {
        let mut detection = Detection::default();
        let found = cue.fit(&[frame], &start_at(start_m, 0.02), &mut detection);
        found.is_ok().then_some(detection)
    })
}

#[test]
fn the_color_posterior_is_the_oracles() {
    let (frame, _) = picture([0.05, -0.03, 1.2], SIZE.0);
    let expected = reference::color_posterior(&colors(), &view(), &frame, 1);
    let found = with_frame(&frame, None, |_, frame| frame.context().posterior.to_vec());
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}

/// The picture with noise: in plain colours every membership would lie on the border of two bins.
pub(super) fn grained(frame: &Frame) -> Frame {
    let grain = |(i, &byte): (usize, &u8)| {
        let (column, row) = (i / 3 % SIZE.0, i / 3 / SIZE.0);
        let noise = ((column * 7 + row * 13 + i % 3 * 5) % 11) as u8;
        byte.saturating_add(noise)
    };
    let bytes: Vec<u8> = frame.bytes().iter().enumerate().map(grain).collect();
    let encoding = YuvEncoding::default();
    Frame::new(PixelFormat::Rgb8, encoding, SIZE.0, SIZE.1, bytes, 0.0).unwrap()
}

#[test]
fn likelihoods_over_correspondence_lines_are_the_oracles() {
    // Fully visible, small, large enough that every second pixel is skipped, partly occluded, and in coarser octaves.
    // The last ones are sought as smaller and larger balls.
    for (place_m, occluded_from, octave, scale) in [
        ([0.05, -0.03, 1.25], SIZE.0, 0, 1.0),
        ([0.1, -0.03, 3.0], SIZE.0, 0, 1.0),
        ([0.02, 0.01, 0.7], SIZE.0, 0, 1.0),
        ([0.05, -0.03, 1.25], 92, 0, 1.0),
        ([0.021, 0.012, 0.72], SIZE.0, 1, 1.0),
        ([0.021, 0.012, 0.72], 92, 1, 1.0),
        ([0.01, 0.01, 0.5], SIZE.0, 2, 1.0),
        ([0.05, -0.03, 1.25], SIZE.0, 0, 0.9),
        ([0.021, 0.012, 0.72], SIZE.0, 1, 1.05),
    ] {
        let frame = grained(&picture(place_m, occluded_from).0);
        let settings = EdgeSettings::default();
        let naive = reference::EdgeLines::place(
            &settings,
            &ball_of(scale),
            &colors(),
            &view(),
            (&frame, octave),
            place_m,
        );
        let naive = naive.unwrap();
        let at_place = naive.log_likelihood_ratio(&ball_of(scale), &view(), place_m);
        // From the middle to beyond the reach of lines.
        let positions: Vec<[f64; 3]> = (0..40)
            .map(|i| {
                let off = f64::from(i) - 20.0;
                let [x, y, z] = place_m;
                [
                    x + 1e-3 * off * z,
                    y - 4e-4 * off * z,
                    z * (1.0 + 2e-3 * off),
                ]
            })
            .collect();
        let fast = with_frame(&frame, None, |cue, frame| {
            let mut detection = Detection::at(place_m, scale);
            cue.place_lines(std::slice::from_ref(&frame), 0, &mut detection)
                .unwrap();
            let judged = detection.lines()[0].octave.0;
            let finer = judged - u8::try_from(octave).unwrap();
            cue.place_lines(std::slice::from_ref(&frame), finer, &mut detection)
                .unwrap();
            assert_eq!(detection.camera_count(), 1);
            // As fitted here.
            detection.log_likelihood_ratio = at_place;
            detection.lines[0].fitted_log_ratio = at_place as f32;
            let columns = [0, 1, 2].map(|axis| {
                let column = positions.iter().map(|position| position[axis] as f32);
                column.collect::<Vec<f32>>()
            });
            let mut out = vec![0.0; positions.len()];
            let detections = std::iter::once((&detection, 0.0, None));
            let columns = columns.each_ref().map(Vec::as_slice);
            cue.log_likelihood_ratios(&frame, detections, columns, f32::MIN, &mut out);
            out
        });
        for (fast, position_m) in fast.iter().zip(&positions) {
            let expected = naive.log_likelihood_ratio(&ball_of(scale), &view(), *position_m);
            // No position is likelier than that of the fit.
            let expected = expected.min(at_place);
            // Memberships within rounding of a bin's border may fall to either side.
            let allowed = 0.01 * expected.abs().max(1.0);
            let off = (f64::from(*fast) - expected).abs();
            assert!(
                off < allowed,
                "{place_m:?} {position_m:?}: {fast} {expected}"
            );
        }
        assert!(
            scale != 1.0 || at_place > 3.0,
            "the ball is seen: {at_place}"
        );
    }
}

#[test]
fn judgements_are_the_oracles() {
    for (place_m, occluded_from) in [
        ([0.05, -0.03, 1.25], SIZE.0),
        ([0.021, 0.012, 0.72], SIZE.0),
        ([0.021, 0.012, 0.72], 92),
    ] {
        let frame = grained(&picture(place_m, occluded_from).0);
        let (judged, octave) = with_frame(&frame, None, |cue, frame| {
            let mut detection = Detection::at(place_m, 1.0);
            cue.place_lines(std::slice::from_ref(&frame), 0, &mut detection)
                .unwrap();
            cue.judge(&[frame], &mut detection);
            (
                (detection.judged_log_ratio, detection.rectangle_nats),
                detection.lines()[0].octave.0.into(),
            )
        });
        let (judged, of_rectangle) = judged;
        let settings = EdgeSettings {
            shared_sigma_px: 0.0,
            ..EdgeSettings::default()
        };
        let (ball, view) = (ball(), view());
        let frame = (&frame, octave);
        let naive = reference::EdgeLines::place(&settings, &ball, &colors(), &view, frame, place_m);
        let tolerance_px = EdgeTuning::DEFAULT.judged_tolerance_px.into();
        let naive = naive.unwrap();
        let expected = naive.judged_log_ratio(tolerance_px);
        assert!(
            (judged - expected).abs() < 0.01 * expected.abs().max(1.0),
            "{place_m:?}: {judged} {expected}"
        );
        let rarity = EdgeTuning::DEFAULT.rectangle_rarity_nats;
        let expected = (naive.rectangle_log_ratio(tolerance_px) - rarity)
            .exp()
            .ln_1p();
        assert!(
            (of_rectangle - expected).abs() < 0.01 * expected.max(1e-3),
            "{place_m:?}: {of_rectangle} {expected}"
        );
    }
}

#[test]
fn a_square_of_the_targets_colors_is_judged_to_be_something_else() {
    let place_m = [0.02, 0.01, 1.25];
    let (frame, _) = picture(place_m, SIZE.0);
    let ball = fitted(&frame, place_m, None).unwrap();
    // As large as the ball, in its colours, with corners.
    let square = [0.0_f64, 0.4].map(|turn| {
        let mut bytes = frame.bytes().to_vec();
        for (i, pixel) in bytes.chunks_exact_mut(3).enumerate() {
            let (u, v) = ((i % SIZE.0) as f64 - 82.7, (i / SIZE.0) as f64 - 61.1);
            let (sin, cos) = turn.sin_cos();
            let outside = (cos * u + sin * v).abs().max((cos * v - sin * u).abs()) - 14.0;
            let share = 0.5 * libm::erfc(outside / 0.9 / 2.0_f64.sqrt());
            let mixed = [(230.0, 60.0), (110.0, 100.0), (20.0, 70.0)]
                .map(|(ball, ground)| (ground + share * (ball - ground)) as u8);
            pixel.copy_from_slice(&mixed);
        }
        let encoding = YuvEncoding::default();
        let frame = Frame::new(PixelFormat::Rgb8, encoding, SIZE.0, SIZE.1, bytes, 0.0).unwrap();
        fitted(&frame, place_m, None).unwrap()
    });
    assert!(
        ball.judged_log_ratio() > 20.0,
        "{}",
        ball.judged_log_ratio()
    );
    for square in square {
        assert!(
            square.judged_log_ratio() < 0.0,
            "{}",
            square.judged_log_ratio()
        );
    }
}

#[test]
fn an_outline_is_found_to_a_fraction_of_a_pixel_from_some_pixels_off() {
    let place_m = [0.05, -0.03, 1.2];
    let (frame, _) = picture(place_m, SIZE.0);
    // 3 px aside, and a tenth too far.
    for start_m in [[0.068, -0.03, 1.2], [0.05, -0.02, 1.32], [0.05, -0.03, 1.1]] {
        let detection = fitted(&frame, start_m, None).unwrap();
        for axis in 0..3 {
            // 0.05 px across, 0.1 px of 17 in radius.
            let allowed_m = [3e-4, 3e-4, 7e-3][axis];
            let off_m = (detection.position_m()[axis] - place_m[axis]).abs();
            assert!(
                off_m < allowed_m,
                "{start_m:?}: {:?}",
                detection.position_m()
            );
        }
        assert!(detection.log_likelihood_ratio() > 15.0 && detection.visible_share() > 0.95);
        assert!(detection.information().cholesky().is_some());
    }
}

#[test]
fn large_outlines_are_found_from_far_off_and_as_precisely() {
    // 40 px in radius: starts 8 px aside and a fifth too near or too far, beyond the reach of lines in the frame's own pixels.
    let place_m = [0.02, 0.01, 0.5];
    let (frame, _) = picture(place_m, SIZE.0);
    for start_m in [[0.04, 0.01, 0.5], [0.02, 0.01, 0.42], [0.02, 0.02, 0.6]] {
        let detection = fitted(&frame, start_m, None).unwrap();
        assert_eq!(detection.lines()[0].octave.0, 0, "{start_m:?}");
        for axis in 0..3 {
            // 0.1 px across, 0.15 px of 40 in radius.
            let allowed_m = [3e-4, 3e-4, 2e-3][axis];
            let off_m = (detection.position_m()[axis] - place_m[axis]).abs();
            assert!(
                off_m < allowed_m,
                "{start_m:?}: {:?}",
                detection.position_m()
            );
        }
    }
}

#[test]
fn where_nothing_has_the_colours_there_is_no_detection() {
    let (frame, _) = picture([0.05, -0.03, 1.2], SIZE.0);
    assert!(fitted(&frame, [-0.25, 0.1, 1.2], None).is_none());
    assert!(
        fitted(&frame, [0.0, 0.0, -1.2], None).is_none(),
        "behind the camera"
    );
    assert!(
        fitted(&frame, [3.0, 0.0, 1.2], None).is_none(),
        "out of the image"
    );
}

#[test]
fn what_has_come_between_does_not_make_a_small_body_smaller() {
    // A ball of 5 px in radius.
    let place_m = [0.1, -0.03, 4.0];
    let (whole, _) = picture(place_m, SIZE.0);
    let mut around = None;
    let seen = fitted(&whole, place_m, None).unwrap();
    seen.update_surrounding(0, &mut around, &AdaptationTuning::DEFAULT);
    // The right third of it is hidden.
    let (partly, _) = picture(place_m, 86);
    let naive = fitted(&partly, place_m, None).unwrap();
    let aware = fitted(&partly, place_m, around.as_ref()).unwrap();
    let error_m = |detection: &Detection| (detection.position_m()[2] - place_m[2]).abs();
    let found = [&seen, &naive, &aware].map(Detection::position_m);
    // A tenth of a pixel in radius.
    assert!(error_m(&seen) < 0.08, "{found:?}");
    assert!(error_m(&aware) < 0.5 * error_m(&naive), "{found:?}");
}

#[test]
fn two_cameras_find_position_and_size_of_a_ball_whose_size_is_wrong() {
    let place_m = [0.02, -0.03, 1.2];
    // The second camera stands 0.3 m beside the first.
    let pictures =
        [0.0, 0.3].map(|x_m| picture([place_m[0] - x_m, place_m[1], place_m[2]], SIZE.0).0);
    let pictures = [(&pictures[0], 0.0), (&pictures[1], 0.3)];
    for scale in [0.8, 0.95, 1.0, 1.05, 1.2] {
        let detection = with_frames((scale, 0.0), &pictures, None, |cue, frames| {
            let mut detection = Detection::default();
            let start = start_at([0.03, -0.03, 1.22], 0.02);
            cue.fit(&frames, &start, &mut detection).unwrap();
            detection
        });
        assert_eq!(detection.camera_count(), 2, "{scale}");
        for axis in 0..3 {
            // 0.1 px across in either camera; along, 0.25 px of parallax at 24 mm a pixel.
            let off_m = (detection.position_m()[axis] - place_m[axis]).abs();
            assert!(
                off_m < [6e-4, 6e-4, 6e-3][axis],
                "{scale}: {:?}",
                detection.position_m()
            );
        }
        // 0.15 px of 17 px in radius.
        let size = detection.size().unwrap();
        assert!(
            (scale * detection.scale() - 1.0).abs() < 9e-3,
            "{scale}: {size:?}"
        );
        let of_frames = scale * libm::exp(size.form);
        assert!((of_frames - 1.0).abs() < 9e-3, "{scale}: {size:?}");
        assert!((size.px_per_unit - 17.0).abs() < 1.0, "{scale}: {size:?}");
        assert!(size.information > 1e3, "{scale}: {size:?}");
    }
}

#[test]
fn one_camera_takes_the_size_as_given_and_its_error_moves_the_ball_along_the_ray() {
    let place_m = [0.05, -0.03, 1.2];
    let (frame, _) = picture(place_m, SIZE.0);
    let fitted_as = |scale: f64, tolerance: f64| {
        with_frames((scale, 0.0), &[(&frame, 0.0)], None, |cue, frames| {
            let mut detection = Detection::default();
            let start = start_at([0.05, -0.03, 1.25], tolerance);
            cue.fit(&frames, &start, &mut detection).unwrap();
            detection
        })
    };
    let exact = fitted_as(1.0, 0.0);
    let tolerant = fitted_as(1.0, 0.02);
    assert_eq!(exact.position_m(), tolerant.position_m());
    assert_eq!((tolerant.scale(), tolerant.size()), (1.0, None));
    let larger = fitted_as(1.02, 0.02);
    for axis in 0..3 {
        let moved_m = larger.position_m()[axis] - exact.position_m()[axis];
        let predicted_m = 0.02 * exact.drift_m()[axis];
        assert!(
            (moved_m - predicted_m).abs() < 1e-3,
            "{moved_m} {predicted_m}"
        );
        let along_m = exact.position_m()[axis];
        assert!(
            (exact.drift_m()[axis] - along_m).abs() < 0.01,
            "{:?}",
            exact.drift_m()
        );
    }
}

/// A ball of 41 px whose middle is darker than its rim. Its mean colour is that of the model which was learnt from the same image, although the outline is fitted in finer octaves.
#[test]
fn mean_colours_are_those_that_are_learnt() {
    let place_m = [0.0, 0.0, 0.5];
    let (frame, labels) = picture(place_m, SIZE.0);
    let mut bytes = frame.bytes().to_vec();
    for (i, rgb) in bytes.chunks_exact_mut(3).enumerate() {
        let (column, row) = ((i % SIZE.0) as f64 - 79.5, (i / SIZE.0) as f64 - 59.5);
        if column.hypot(row) < 31.0 {
            for value in rgb {
                *value = (0.8 * f64::from(*value)) as u8;
            }
        }
    }
    let encoding = YuvEncoding::default();
    let (width, height) = SIZE;
    let frame = Frame::new(PixelFormat::Rgb8, encoding, width, height, bytes, 0.0).unwrap();
    let mut learner = ColorLearner::new(Palette::HSI).unwrap();
    learner.add(&frame, &labels).unwrap();
    let learnt = learner.learn().unwrap().body().unwrap().mean();
    let found = fitted(&frame, place_m, None).unwrap();
    assert!(
        found.lines()[0].octave < Octave(2),
        "finer than where it is judged"
    );
    let seen: Vec<_> = found.body_colors().collect();
    for (seen, learnt) in seen[0].1.into_iter().zip(learnt) {
        assert!((seen - learnt).abs() < 3.0, "{seen} {learnt}");
    }
}
