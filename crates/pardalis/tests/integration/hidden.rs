//! A target that something hides: what is left to see where it is tracked may be the target or something else.

use pardalis::TargetId;
use pardalis::tracker::TrackState;

use crate::common::drawn::{Thing, shown, tracker_of};
use crate::common::set_of;

/// A thing of this exponent, radius and column of its middle, pixels.
fn thing(exponent: f64, radius_px: f64, u: f64) -> Thing {
    Thing {
        exponent,
        radius_px,
        middle_px: [u, 120.0],
    }
}

fn ball(u: f64) -> Thing {
    thing(2.0, 25.0, u)
}

/// Tracks a ball on the left for 12 frames, none for 2 frames, then for 10 frames what is seen of something else in its place behind a cover, and then for 6 frames another ball on the right, too.
/// Returns the state and x/z of each frame.
fn track_behind(other: Thing, cover: Thing) -> Vec<(TrackState, Option<f64>)> {
    let mut tracker = tracker_of(ball(80.0));
    let track = |number: usize| {
        let mut things = match number {
            0..12 => vec![ball(80.0)],
            12..14 => vec![],
            _ => vec![other],
        };
        let covers = [cover].into_iter().filter(|_| number >= 14);
        things.extend((number >= 24).then(|| ball(240.0)));
        let covers: Vec<_> = covers.collect();
        let frame = shown(&things, &covers, 0.04 * number as f64);
        tracker.observe(&set_of(frame)).unwrap();
        let estimate = tracker.estimate(TargetId::new(0)).unwrap();
        let right = |[x, _, z]: [f64; 3]| x / z;
        let position_m = estimate.kinematics.map(|known| known.position_m);
        (estimate.state, position_m.map(right))
    };
    (0..30).map(track).collect()
}

#[test]
fn half_of_something_else_is_no_target_and_does_not_hold_the_track() {
    for (exponent, radius_px, cover_u) in
        [(3.2, 30.0, 100.0), (4.0, 28.0, 104.0), (5.0, 25.0, 105.0)]
    {
        let other = thing(exponent, radius_px, 82.0);
        let tracked = track_behind(other, thing(8.0, 25.0, cover_u));
        println!("{tracked:.2?}");
        let states = |range: std::ops::Range<usize>| tracked[range].iter().map(|(state, _)| *state);
        assert!(states(2..12).all(|state| state == TrackState::Tracking));
        assert!(states(12..24).all(|state| state == TrackState::Occluded));
        let on_right = |right: Option<f64>| right.is_some_and(|right| (right - 0.2).abs() < 0.01);
        let found = |(state, right): &(TrackState, Option<f64>)| {
            *state == TrackState::Tracking && on_right(*right)
        };
        assert!(tracked[26..].iter().all(found), "{tracked:.2?}");
    }
}

#[test]
fn half_of_the_target_is_the_target() {
    let tracked = track_behind(ball(80.0), thing(8.0, 25.0, 110.0));
    println!("{tracked:.2?}");
    let on_left = |right: Option<f64>| right.is_some_and(|right| (right + 0.2).abs() < 0.01);
    let found = |(state, right): &(TrackState, Option<f64>)| {
        *state == TrackState::Tracking && on_left(*right)
    };
    assert!(tracked[2..12].iter().all(found));
    assert!(tracked[15..].iter().all(found));
}
