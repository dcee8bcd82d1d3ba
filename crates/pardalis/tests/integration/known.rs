//! Searches while the target is tracked.

use pardalis::camera::Pose;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::tracker::{Origin, Verdict};
use pardalis::{CameraId, FrameSet, TargetId, Tracker};
use pardalis_core::simd::Level;

use crate::common::drawn::{CENTER_PX, RADIUS_M, Thing, settings_of, shown, view};

const FPS: f64 = 25.0;
/// How far the second camera stands beside the first, metres.
const BESIDE_M: f64 = 0.2;

/// A thing as the second camera sees it.
fn seen_from_beside(thing: Thing) -> Thing {
    let [u, v] = thing.middle_px;
    // Things twice as small are twice as far away.
    Thing {
        middle_px: [u - BESIDE_M / RADIUS_M * thing.radius_px, v],
        ..thing
    }
}

/// A tracker of a ball with two cameras beside each other.
fn two_cameras(ball: Thing) -> Tracker {
    let views = [0.0, BESIDE_M].map(|x_m| view(Pose::translation(x_m, 0.0, 0.0)));
    Tracker::new(views.to_vec(), vec![settings_of(ball)], 1, Level::best()).unwrap()
}

/// Lets both cameras see these things.
fn observe<const N: usize>(tracker: &mut Tracker, things: [Thing; N], time_s: f64) {
    let frames = [things, things.map(seen_from_beside)].map(|things| shown(&things, &[], time_s));
    let frames = frames.into_iter().enumerate();
    let frames = frames.map(|(camera, frame)| (CameraId::new(camera), frame));
    tracker.observe(&FrameSet::new(frames).unwrap()).unwrap();
}

#[test]
fn only_what_is_not_the_target_already_is_fitted_in_searches_by_several_cameras() {
    let ball = Thing {
        exponent: 2.0,
        radius_px: 26.0,
        middle_px: [CENTER_PX[0] + 20.0, CENTER_PX[1]],
    };
    let smaller = Thing {
        radius_px: 13.0,
        // In the same row, so that rays of one meet those of the other.
        middle_px: [ball.middle_px[0] + 90.0, CENTER_PX[1]],
        ..ball
    };
    let mut tracker = two_cameras(ball);
    let [mut of_ball, mut of_smaller, mut rays_left_out] = [0; 3];
    for number in 0..30 {
        observe(&mut tracker, [ball, smaller], f64::from(number) / FPS);
        if number < 5 {
            // It is only just found.
            continue;
        }
        for candidate in tracker.candidates(TargetId::new(0)).unwrap().flatten() {
            // Where the ball's ray in one camera meets that of the smaller thing in the other, much nearer than both.
            if let (Origin::Rays, Some([.., z_m])) = (candidate.origin, candidate.position_m)
                && z_m < 1.0
            {
                assert_eq!(candidate.verdict, Verdict::SamePlace, "{number}");
                rays_left_out += 1;
            }
            let Origin::Blob(_, blob) = candidate.origin else {
                continue;
            };
            if blob.area_px > 1000.0 {
                assert_eq!(candidate.verdict, Verdict::SamePlace, "{number}");
                assert_eq!(candidate.outline_nats, None, "{number}");
                of_ball += 1;
            } else {
                // It may be a ball farther away: its blob in the other camera then belongs to it.
                of_smaller += i32::from(candidate.outline_nats.is_some());
            }
        }
    }
    // Whole images are searched at least once in ten frames.
    assert!(of_ball >= 4 && of_smaller >= 2, "{of_ball} {of_smaller}");
    assert!(rays_left_out >= 2, "{rays_left_out}");
}

#[test]
fn the_part_of_the_target_that_another_camera_sees_is_not_fitted() {
    let shift_px = BESIDE_M / RADIUS_M * 26.0;
    let ball = Thing {
        exponent: 2.0,
        radius_px: 26.0,
        // The second camera sees some two thirds of it.
        middle_px: [shift_px + 8.0, CENTER_PX[1]],
    };
    let mut tracker = two_cameras(ball);
    let mut parts = 0;
    for number in 0..30 {
        let frames =
            [ball, seen_from_beside(ball)].map(|ball| shown(&[ball], &[], f64::from(number) / FPS));
        let frames = frames.into_iter().enumerate();
        let frames = frames.map(|(camera, frame)| (CameraId::new(camera), frame));
        tracker.observe(&FrameSet::new(frames).unwrap()).unwrap();
        if number < 5 {
            continue;
        }
        for candidate in tracker.candidates(TargetId::new(0)).unwrap().flatten() {
            if let Some(blob) = candidate.origin.blob().filter(|blob| blob.cut_off) {
                assert!((1000.0..1500.0).contains(&blob.area_px), "{blob:?}");
                assert_eq!(candidate.verdict, Verdict::SamePlace, "{number}");
                assert_eq!(candidate.outline_nats, None, "{number}");
                parts += 1;
            }
        }
    }
    assert!(parts >= 2, "{parts}");
}

#[test]
fn whole_images_are_searched_for_one_target_at_a_time() {
    let ball = Thing {
        exponent: 2.0,
        radius_px: 26.0,
        middle_px: CENTER_PX,
    };
    // Three targets of different sizes, which all take it for theirs.
    let target = |larger: f64| {
        let mut settings = settings_of(ball);
        let radius_m = larger * RADIUS_M;
        settings.shape = Shape::Sphere(Sphere::new(radius_m, SphereOutline::Tangent).unwrap());
        settings
    };
    let targets = [1.0, 1.1, 1.2].map(target).to_vec();
    let views = vec![view(Pose::identity())];
    let mut tracker = Tracker::new(views, targets, 1, Level::best()).unwrap();
    let mut searches = [0; 3];
    for number in 0..42 {
        let frame = shown(&[ball], &[], f64::from(number) / FPS);
        tracker
            .observe(&FrameSet::of(CameraId::new(0), frame))
            .unwrap();
        if number < 12 {
            // They are only just found.
            continue;
        }
        let before = searches;
        for (target, searches) in searches.iter_mut().enumerate() {
            let mut candidates = tracker.candidates(TargetId::new(target)).unwrap().flatten();
            *searches += i32::from(candidates.any(|one| one.origin != Origin::Prediction));
        }
        let now: i32 = searches
            .iter()
            .zip(before)
            .map(|(now, before)| now - before)
            .sum();
        assert!(now <= 1, "{number}: {before:?} {searches:?}");
    }
    // Once in ten frames each.
    assert!(
        searches.iter().all(|count| (2..=4).contains(count)),
        "{searches:?}"
    );
}
