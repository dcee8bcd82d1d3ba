use nalgebra::{Matrix6, Vector2, Vector4, Vector6};

use super::offset::{Offset, OffsetSlope};
use super::tests::{SIZE, ball, colors, grained, picture, start_at, view_with_offset, with_frames};
use super::{Detection, EdgeFrame};
use crate::likelihood::edge::EdgeSettings;
use crate::shape::Stance;
use crate::{Frame, reference};

/// Fits a ball at (0.05, 0, 1.2) that two cameras see, 0.3 m apart. The second shows it this many pixels too low.
fn fitted(too_low_px: f64, offset_sigma_px: f64) -> Detection {
    let (one, _) = picture([0.05, 0.0, 1.2], SIZE.0);
    let (other, _) = picture([0.05 - 0.3, 1.2 * too_low_px / 200.0, 1.2], SIZE.0);
    let pictures: [(&Frame, f64); 2] = [(&one, 0.0), (&other, 0.3)];
    with_frames(
        (1.0, offset_sigma_px),
        &pictures,
        None,
        |cue, frames: Vec<EdgeFrame>| {
            let mut detection = Detection::default();
            let start = start_at([0.04, 0.01, 1.15], 0.02);
            cue.fit(&frames, &start, &mut detection).unwrap();
            assert_eq!(detection.camera_count(), 2);
            detection
        },
    )
}

#[test]
fn cameras_share_what_they_disagree_by() {
    let detection = fitted(3.0, 2.0);
    let measured = [0, 1].map(|camera| detection.offset(camera).measured().unwrap());
    let apart_px = measured[1].px - measured[0].px;
    assert!((apart_px.y - 3.0).abs() < 0.15, "{measured:?}");
    let [x, y, _] = detection.position_m();
    let middle_m = 1.2 * 1.5 / 200.0;
    assert!(
        (x - 0.05).abs() < 2e-3 && (y - middle_m).abs() < 1e-3,
        "{x} {y}"
    );
    // Neither camera contradicts the outline any more.
    let agreeing = fitted(0.0, 2.0).judged_log_ratio();
    assert!(detection.judged_log_ratio() > 0.8 * agreeing);
    // What the cameras say is as uncertain as their errors.
    let height_m = detection.information().try_inverse().unwrap()[(1, 1)].sqrt();
    let of_errors_m = 1.2 * 2.0 / 200.0 / 2.0_f64.sqrt();
    assert!(
        (0.9..1.6).contains(&(height_m / of_errors_m)),
        "{height_m} {of_errors_m}"
    );
}

#[test]
fn cameras_without_errors_have_no_offsets() {
    let detection = fitted(1.0, 0.0);
    for camera in [0, 1] {
        assert_eq!(detection.offset(camera), Offset::default());
        assert!(detection.offset(camera).measured().is_none());
    }
}

/// Eliminating an offset gives the position's part of the solution of the whole system of equations.
#[test]
fn eliminated_offsets_are_those_of_the_whole_system() {
    let mut offset = Offset::with_sigma(0.7);
    offset.px = Vector2::new(0.4, -0.9);
    let (mut lines, mut whole, mut right) =
        (OffsetSlope::default(), Matrix6::zeros(), Vector6::zeros());
    for k in 0..24 {
        let turn = 0.27 * f64::from(k);
        let normal = Vector2::new(turn.cos(), turn.sin());
        let along = Vector4::new(3.0 * normal.x, 2.0 * normal.y, (3.0 * turn).sin(), 1.0);
        let (gradient, curvature) = ((1.7 * turn).sin(), 2.0 + (0.6 * turn).cos());
        lines.add(&along, normal, [gradient, curvature]);
        let all = Vector6::new(along.x, along.y, along.z, along.w, normal.x, normal.y);
        whole += all * all.transpose() * curvature;
        right += all * gradient;
    }
    let information = 1.0 / (0.49 + 0.5 * offset.px.norm_squared() / 4.0);
    for axis in [0, 1] {
        whole[(4 + axis, 4 + axis)] += information;
        right[4 + axis] -= information * offset.px[axis];
    }
    let [expected_curvature, expected_gradient] = [
        whole.fixed_view::<4, 4>(0, 0).into_owned(),
        nalgebra::Matrix4::from_diagonal(&right.fixed_rows::<4>(0).into_owned()),
    ];
    let (gradient, curvature) = offset.note(lines).unwrap();
    let step = (expected_curvature - curvature).try_inverse().unwrap()
        * (expected_gradient.diagonal() - gradient);
    let solution = whole.try_inverse().unwrap() * right;
    assert!((step - solution.fixed_rows::<4>(0)).norm() < 1e-9 * solution.norm());
    let before_px = offset.px;
    offset.step(&step, f64::INFINITY);
    let moved_px = offset.px - before_px;
    assert!((moved_px - solution.fixed_rows::<2>(4)).norm() < 1e-9 * solution.norm());
}

/// Weights with offsets are those of a camera that shows everything beside by the likeliest offset, less what the prior says against that.
#[test]
fn likelihoods_with_offsets_are_the_oracles() {
    let sigma_px = 2.0;
    let pictures = [([0.05, 0.0, 1.2], 0.0), ([-0.25, 0.018, 1.2], 0.3)]
        .map(|(place_m, x_m)| (grained(&picture(place_m, SIZE.0).0), x_m));
    let [(one, _), (other, x_m)] = &pictures;
    with_frames(
        (1.0, sigma_px),
        &[(one, 0.0), (other, *x_m)],
        None,
        |cue, frames| {
            let mut detection = Detection::default();
            let start = start_at([0.04, 0.01, 1.15], 0.0);
            cue.fit(&frames, &start, &mut detection).unwrap();
            // As fitted there, in the octave in which the outline is judged.
            cue.place_lines(&frames, 0, &mut detection).unwrap();
            let offset = detection.offset(1);
            let lines = detection.lines_of(1).next().unwrap();
            let octave = u32::from(lines.octave.0);
            let balance = f64::from(detection.balance(lines));
            let fitted_m = detection.position_m();
            let positions: Vec<[f64; 3]> = (0..40)
                .map(|i| {
                    let off = f64::from(i) - 20.0;
                    let [x, y, z] = fitted_m;
                    [x + 1e-3 * off, y - 6e-4 * off, z * (1.0 + 1e-3 * off)]
                })
                .collect();
            let columns = [0, 1, 2].map(|axis| {
                let column = positions.iter().map(|position| position[axis] as f32);
                column.collect::<Vec<f32>>()
            });
            let mut out = vec![0.0; positions.len()];
            cue.log_likelihood_ratios(
                &frames[1],
                std::iter::once((&detection, 0.0, None)),
                columns.each_ref().map(Vec::as_slice),
                f32::MIN,
                &mut out,
            );

            let settings = EdgeSettings::default();
            let view = view_with_offset(*x_m, offset.px.into());
            let naive = reference::EdgeLines::place(
                &settings,
                &ball(),
                &colors(),
                &view,
                (other, octave),
                fitted_m,
            );
            let naive = naive.unwrap();
            let middle = |position_m: [f64; 3]| {
                let view = view_with_offset(*x_m, [0.0; 2]);
                let count = settings.correspondence_lines;
                let points =
                    reference::outline_points(&view, &ball(), position_m, Stance::default(), count);
                let pixels = points
                    .into_iter()
                    .map(|point| Vector2::from(view.camera().project(point.into()).unwrap()));
                pixels.sum::<Vector2<f64>>() / count as f64
            };
            // A Gaussian with the slope of the prior, and what the lines measured.
            let information = 1.0 / (sigma_px * sigma_px + 0.5 * offset.px.norm_squared() / 4.0);
            let measured = offset.measured().unwrap().covariance_px2;
            let curvature = measured.try_inverse().unwrap();
            let sum = curvature + nalgebra::Matrix2::from_diagonal_element(information);
            let mut moved_px = 0.0_f64;
            for (fast, position_m) in out.iter().zip(&positions) {
                let by_position = middle(*position_m) - middle(fitted_m);
                let px = offset.px - sum.try_inverse().unwrap() * curvature * by_position;
                let view = view_with_offset(*x_m, px.into());
                let more = px.norm_squared() - offset.px.norm_squared();
                let expected = naive.log_likelihood_ratio(&ball(), &view, *position_m) + balance
                    - 0.5 * information * more;
                let allowed = 0.01 * expected.abs().max(1.0);
                let off = (f64::from(*fast) - expected).abs();
                assert!(off < allowed, "{position_m:?}: {fast} {expected}");
                moved_px = moved_px.max((px - offset.px).norm());
            }
            assert!(moved_px > 1.0, "offsets differ: {moved_px}");
        },
    );
}
