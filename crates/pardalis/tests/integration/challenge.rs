//! Two things that may be the target: evidence over time decides between them.

use nalgebra::Vector3;
use pardalis::TargetId;
use pardalis::tracker::TrackState;

use crate::common::drawn::{CENTER_PX, FOCAL_PX, Thing, shown, tracker_of};
use crate::common::set_of;

/// A thing that swings from side to side.
fn swinging(number: usize, exponent: f64) -> Thing {
    Thing {
        exponent,
        radius_px: 22.0,
        middle_px: [160.0 + 100.0 * (0.08 * number as f64).cos(), 60.0],
    }
}

/// Tracks 60 frames of these things. Returns the distances of the estimates from what swings, in radii; `None` if it is not tracked.
fn off_swinging(things: impl Fn(usize) -> Vec<Thing>) -> Vec<Option<f64>> {
    let mut tracker = tracker_of(swinging(0, 2.0));
    let track = |number: usize| {
        let frame = shown(&things(number), &[], 0.04 * number as f64);
        tracker.observe(&set_of(frame)).unwrap();
        let estimate = tracker.estimate(TargetId::new(0)).unwrap();
        let [x, y, z] = estimate
            .kinematics
            .filter(|_| estimate.state == TrackState::Tracking)?
            .position_m;
        let seen_px = [
            FOCAL_PX * x / z + CENTER_PX[0],
            FOCAL_PX * y / z + CENTER_PX[1],
        ];
        let swinging = swinging(number, 2.0);
        let off_px = Vector3::new(
            seen_px[0] - swinging.middle_px[0],
            seen_px[1] - swinging.middle_px[1],
            0.0,
        );
        Some(off_px.norm() / swinging.radius_px)
    };
    (0..60).map(track).collect()
}

/// Something at rest with this exponent.
fn still(exponent: f64) -> Thing {
    Thing {
        exponent,
        radius_px: 30.0,
        middle_px: [160.0, 170.0],
    }
}

/// The exponent of something that is taken for a ball where there is no ball.
const CUSHION: f64 = 3.2;

#[test]
fn a_ball_that_appears_wins_over_something_still_that_looks_less_like_it() {
    let off = off_swinging(|number| {
        let mut things = vec![still(CUSHION)];
        things.extend((number >= 10).then(|| swinging(number, 2.0)));
        things
    });
    println!("{off:.1?}");
    // At first, nothing else is there.
    assert!(off[9].is_some_and(|off| off > 2.0), "{:?}", off[9]);
    let late = &off[25..];
    assert!(
        late.iter().all(|off| off.is_some_and(|off| off < 0.1)),
        "{late:?}"
    );
}

#[test]
fn what_is_still_does_not_win_over_what_moves() {
    let off = off_swinging(|number| {
        let mut things = vec![swinging(number, CUSHION)];
        // Even if it looks more like a ball.
        things.extend((number >= 25).then(|| still(2.0)));
        things
    });
    println!("{off:.1?}");
    let followed = |off: &Option<f64>| off.is_some_and(|off| off < 0.5);
    assert!(off[2..].iter().all(followed), "{off:?}");
}
