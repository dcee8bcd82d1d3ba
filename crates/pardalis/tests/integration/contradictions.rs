//! Colours that contradict an outline: its size, and so the distance, is less certain.

use pardalis::TargetId;

use crate::common::drawn::{CENTER_PX, FOCAL_PX, RADIUS_M, Thing, shown, tracker_of};
use crate::common::set_of;

/// A ball with this radius in pixels, or something of its form, to the right of the middle by this many.
fn ball(radius_px: f64, right_px: f64) -> Thing {
    Thing {
        exponent: 2.0,
        radius_px,
        middle_px: [CENTER_PX[0] + right_px, CENTER_PX[1]],
    }
}

/// Tracks a ball for 13 frames, then for 3 with `covers` before it. Returns the radius in pixels, and the standard deviation of
/// its logarithm, which is that of the distance, before and at the end.
fn radii(covers: &[Thing]) -> [[f64; 2]; 2] {
    let mut tracker = tracker_of(ball(30.0, 0.0));
    let mut radius = |number: usize, covers: &[Thing]| {
        let frame = shown(&[ball(30.0, 0.0)], covers, 0.04 * number as f64);
        tracker.observe(&set_of(frame)).unwrap();
        let known = tracker.estimate(TargetId::new(0)).unwrap().kinematics;
        known.map(|known| {
            let [_, _, z] = known.position_m;
            [FOCAL_PX * RADIUS_M / z, known.covariance_m2[5].sqrt() / z]
        })
    };
    let before = (0..13).filter_map(|number| radius(number, &[])).last();
    let after = (13..16).filter_map(|number| radius(number, covers));
    [before.unwrap(), after.last().unwrap()]
}

#[test]
fn the_distance_of_a_ball_that_is_partly_covered_is_less_certain() {
    let [[_, before], [radius_px, covered]] = radii(&[ball(22.0, 24.0)]);
    println!("{before} {covered} {radius_px}");
    assert!(covered > 3.0 * before, "{covered} after {before}");
    let off = (radius_px / 30.0).ln().abs();
    assert!(off < 3.0 * covered, "{radius_px} px, {covered}");
    let [[_, before], [radius_px, uncovered]] = radii(&[]);
    assert!(uncovered < 1.1 * before, "{uncovered} after {before}");
    assert!((radius_px - 30.0).abs() < 0.5, "{radius_px}");
}
