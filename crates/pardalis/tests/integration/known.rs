//! Searches while the target is tracked.

use pardalis::TargetId;
use pardalis::tracker::{Origin, Verdict};

use crate::common::drawn::{CENTER_PX, Thing, shown, tracker_of};
use crate::common::set_of;

const FPS: f64 = 25.0;

#[test]
fn only_what_is_not_the_target_already_is_fitted_in_searches() {
    let ball = Thing {
        exponent: 2.0,
        radius_px: 26.0,
        middle_px: CENTER_PX,
    };
    let smaller = Thing {
        radius_px: 13.0,
        middle_px: [CENTER_PX[0] + 90.0, CENTER_PX[1] + 40.0],
        ..ball
    };
    let mut tracker = tracker_of(ball);
    let [mut of_ball, mut of_smaller] = [0; 2];
    for number in 0..30 {
        let set = set_of(shown(&[ball, smaller], &[], f64::from(number) / FPS));
        tracker.observe(&set).unwrap();
        if number < 5 {
            // It is only just found.
            continue;
        }
        for candidate in tracker.candidates(TargetId::new(0)).unwrap().flatten() {
            let Origin::Blob(_, blob) = candidate.origin else {
                continue;
            };
            if blob.centroid_px[0] < CENTER_PX[0] + 20.0 {
                assert_eq!(candidate.verdict, Verdict::SamePlace, "{number}");
                assert_eq!(candidate.outline_nats, None, "{number}");
                of_ball += 1;
            } else {
                assert!(candidate.outline_nats.is_some(), "{number}: {candidate:?}");
                of_smaller += 1;
            }
        }
    }
    // Whole images are searched at least once in ten frames.
    assert!(of_ball >= 2 && of_smaller >= 2, "{of_ball} {of_smaller}");
}
