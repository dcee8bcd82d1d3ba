//! Two things that may be the target: evidence over time decides between them.

use pardalis::TargetId;
use pardalis::tracker::{Estimate, PASSES_SIGMA_M, TrackState};

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
        off(&estimate, swinging(number, 2.0))
    };
    (0..60).map(track).collect()
}

/// Returns the distance of an estimate from a thing, in radii; `None` if the target is not tracked.
fn off(estimate: &Estimate, thing: Thing) -> Option<f64> {
    let [x, y, z] = estimate
        .kinematics
        .filter(|_| estimate.state == TrackState::Tracking)?
        .position_m;
    let seen_px = [
        FOCAL_PX * x / z + CENTER_PX[0],
        FOCAL_PX * y / z + CENTER_PX[1],
    ];
    let [u, v] = [0, 1].map(|i| seen_px[i] - thing.middle_px[i]);
    Some(u.hypot(v) / thing.radius_px)
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

/// Returns how far from the nearer of two things the target is located in a single picture of them, in radii; `None` if it is not found.
fn off_nearer_of([one, other]: [Thing; 2]) -> Option<f64> {
    let mut tracker = tracker_of(swinging(0, 2.0));
    let set = set_of(shown(&[one, other], &[], 0.0));
    let estimate = tracker.locate(&set, &[None], &PASSES_SIGMA_M).unwrap()[0];
    let offs = [one, other].map(|thing| off(&estimate, thing));
    offs[0].map(|off| off.min(offs[1].unwrap()))
}

#[test]
fn what_is_located_is_never_between_two_that_look_alike() {
    let at = |u, radius_px, exponent| Thing {
        exponent,
        radius_px,
        middle_px: [u, 120.0],
    };
    let mut offs = Vec::new();
    // Balls that nearly touch, and such as are farther apart than the target is wide; the second is the same, smaller, or less round.
    for apart_px in [50.0, 58.0, 70.0, 100.0] {
        for (radius_px, exponent) in [
            (22.0, 2.0),
            (21.0, 2.0),
            (18.0, 2.0),
            (22.0, 3.2),
            (22.0, 5.0),
        ] {
            offs.push(off_nearer_of([
                at(110.0, 22.0, 2.0),
                at(110.0 + apart_px, radius_px, exponent),
            ]));
        }
    }
    println!("{offs:.2?}");
    let found = offs.iter().flatten();
    assert!(found.clone().all(|off| *off < 0.2), "{offs:.2?}");
    let found = found.count();
    assert!((1..offs.len()).contains(&found), "found {found} times");
}
