//! Streaks against their oracle, and fitted in images of moving bodies.

use super::corners::Corner;
use super::streak::Streak;
use super::tests::{RADIUS_M, SIZE, picture, start_at, with_frame};
use super::*;
use crate::color::YuvEncoding;
use crate::reference;
use crate::{Frame, PixelFormat};

/// A circle as corners; the distances of points from it are exact.
fn circle([u, v]: [f32; 2], radius_px: f32) -> Vec<Corner> {
    let corner = |k: usize| {
        let angle = k as f32 / 64.0 * std::f32::consts::TAU;
        let (sin, cos) = (libm::sinf(angle), libm::cosf(angle));
        Corner::at([u + radius_px * cos, v + radius_px * sin], [cos, sin])
    };
    (0..64).map(corner).collect()
}

#[test]
fn streaks_are_the_oracles() {
    let (middle, radius_px, edge_px) = ([50.3, 41.8], 9.5, 0.55);
    for displacement in [[0.0, 6.0], [14.0, -3.0], [-20.0, 22.0]] {
        let mut streak = Streak::default();
        let outline = circle(middle, radius_px);
        streak.map(&outline, displacement, edge_px, |[u, v], _| {
            let [du, dv] = [u - middle[0], v - middle[1]];
            let angle = libm::atan2f(dv, du).rem_euclid(std::f32::consts::TAU);
            let corner = (angle / std::f32::consts::TAU * 64.0).round() as usize % 64;
            (corner, du.hypot(dv) - radius_px)
        });
        let expected = reference::StreakOfDisc {
            middle: middle.map(f64::from),
            radius_px: radius_px.into(),
            displacement: displacement.map(f64::from),
            edge_px: edge_px.into(),
        };
        let mut count = 0;
        for y in 15..70 {
            for x in 15..90 {
                let pixel = [x as f32, y as f32];
                let Some(found) = streak.mixture(pixel) else {
                    continue;
                };
                let at = pixel.map(f64::from);
                let share = expected.share(at);
                // The grid has a node per pixel; the hull is as coarse along the displacement.
                let off = (f64::from(found.share) - share).abs();
                assert!(off < 0.08, "{displacement:?} {pixel:?}: {off}");
                let hull_px = expected.hull_px(at);
                // Farther pixels are not looked at.
                assert!(
                    hull_px > 13.0 || (f64::from(found.hull_px) - hull_px).abs() < 0.6,
                    "{displacement:?} {pixel:?}: {} {hull_px}",
                    found.hull_px
                );
                if (0.05..0.95).contains(&(share / expected.greatest_share())) {
                    let at_rest_px = expected.at_rest_px(at);
                    let off = (f64::from(found.at_rest_px) - at_rest_px).abs();
                    assert!(off < 0.25, "{displacement:?} {pixel:?}: {off}");
                    count += 1;
                }
                let (mixed, around) = ([90.0, 100.0, 110.0], [60.0, 120.0, 110.0]);
                let own = found.own_color(mixed, around, 0.3, |[y, _, _]| y > 200.0);
                assert_eq!(own.is_some(), found.share >= 0.3);
                if let Some((color, matches)) = own {
                    for i in 0..3 {
                        let again = around[i] + found.share.min(1.0) * (color[i] - around[i]);
                        assert!((again - mixed[i]).abs() < 1e-3);
                    }
                    // No share that is possible makes it as bright.
                    assert!(!matches);
                }
            }
        }
        assert!(count > 100, "{count} pixels are mixed");
    }
}

/// The ball at a position in the middle of the exposure, moving by this much.
fn exposed(position_m: [f64; 3], displacement_m: [f64; 3]) -> Frame {
    const PARTS: usize = 32;
    let mut sums = vec![0_u32; 3 * SIZE.0 * SIZE.1];
    for part in 0..PARTS {
        let share = (part as f64 + 0.5) / PARTS as f64 - 0.5;
        let here = [0, 1, 2].map(|i| position_m[i] + share * displacement_m[i]);
        let (frame, _) = picture(here, SIZE.0);
        for (sum, byte) in sums.iter_mut().zip(frame.bytes()) {
            *sum += u32::from(*byte);
        }
    }
    let bytes: Vec<u8> = sums.iter().map(|sum| (sum / PARTS as u32) as u8).collect();
    let encoding = YuvEncoding::default();
    Frame::new(PixelFormat::Rgb8, encoding, SIZE.0, SIZE.1, bytes, 0.0).unwrap()
}

/// Fits a picture from a start as a streak with this displacement.
fn fitted(frame: &Frame, start_m: [f64; 3], displacement_m: [f64; 3]) -> Option<Detection> {
    with_frame(frame, None, |cue, frame| {
        let mut detection = Detection::default();
        let start = FitStart {
            displacement_m,
            ..start_at(start_m, 0.02)
        };
        let found = cue.fit(&[frame], &start, &mut detection);
        found.is_ok().then_some(detection)
    })
}

#[test]
fn a_streak_is_fitted_where_its_body_was_at_mid_exposure() {
    let position_m = [0.05, -0.03, 1.8];
    let start_m = [0.06, -0.02, 1.75];
    // From half a diameter to more than one: then no pixel shows the ball alone.
    for displacement_m in [[0.0, 0.1, 0.0], [0.15, 0.0, 0.0], [0.17, -0.17, 0.0]] {
        let frame = exposed(position_m, displacement_m);
        let streak = fitted(&frame, start_m, displacement_m).unwrap();
        let [x, y, z] = streak.position_m();
        let across = (x - position_m[0]).hypot(y - position_m[1]) / RADIUS_M;
        let depth = (z - position_m[2]).abs() / position_m[2];
        assert!(
            across < 0.03 && depth < 0.02,
            "{displacement_m:?}: {across} {depth}"
        );
        assert!(streak.visible_share() > 0.9, "{}", streak.visible_share());
        let at_rest = fitted(&frame, start_m, [0.0; 3]);
        let at_rest = at_rest.map_or(0.0, |found| found.coarse_log_ratio());
        let log_ratio = streak.coarse_log_ratio();
        assert!(
            log_ratio > at_rest.max(12.0),
            "{displacement_m:?}: {log_ratio} {at_rest}"
        );
    }
}

#[test]
fn over_long_streaks_are_not_fitted() {
    let position_m = [0.0, 0.0, 1.8];
    // The outline is 3.14 diameters long. A map of the longest of these streaks would have millions of nodes.
    for (diameters, is_too_long) in [(3.5, false), (4.5, true), (1e4, true)] {
        let displacement_m = [diameters * 2.0 * RADIUS_M, 0.0, 0.0];
        let frame = exposed(position_m, displacement_m);
        let start = FitStart {
            displacement_m,
            ..start_at(position_m, 0.02)
        };
        let fit = with_frame(&frame, None, |cue, frame| {
            cue.fit(&[frame], &start, &mut Detection::default())
        });
        // One that is not too long is mapped, and found too pale.
        let is_mapped = matches!(fit, Err(NoFit::Covered(_)));
        assert_eq!(is_mapped, !is_too_long, "{diameters}: {fit:?}");
        assert!(
            is_mapped || fit == Err(NoFit::NoEdges),
            "{diameters}: {fit:?}"
        );
    }
}

#[test]
fn a_ball_at_rest_is_no_streak() {
    let position_m = [0.05, -0.03, 1.8];
    let (frame, _) = picture(position_m, SIZE.0);
    let at_rest = fitted(&frame, position_m, [0.0; 3]).unwrap();
    let streak = fitted(&frame, position_m, [0.2, 0.0, 0.0]);
    let streak = streak.map_or(0.0, |found| found.coarse_log_ratio());
    assert!(at_rest.coarse_log_ratio() > streak + 5.0, "{streak}");
}
