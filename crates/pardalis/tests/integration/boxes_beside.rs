//! Boxes of a detector beside the edge cue: they say which of several outlines is the target's, and where to look; the outline says where it is.

use pardalis::camera::Pose;
use pardalis::tracker::{
    DetectedSettings, DetectorSettings, ImageBox, TargetSettings, TrackState, Verdict,
};
use pardalis::{CameraId, FrameSet, TargetId, Tracker};
use pardalis_core::rng::philox4x32_10;
use pardalis_core::simd::Level;

use crate::common::drawn::{CENTER_PX, FOCAL_PX, Thing, settings_of, shown, view};
use crate::common::set_of;

const RADIUS_PX: f64 = 22.0;

/// The target, which swings from side to side.
fn swinging(number: usize) -> Thing {
    Thing {
        exponent: 2.0,
        radius_px: RADIUS_PX,
        middle_px: [160.0 + 100.0 * (0.08 * number as f64).cos(), 60.0],
    }
}

/// Another ball of its colours and size, at rest.
const OTHER: Thing = Thing {
    exponent: 2.0,
    radius_px: RADIUS_PX,
    middle_px: [160.0, 170.0],
};

/// A random number within ±1.
fn random(number: usize, stream: u32) -> f64 {
    f64::from(philox4x32_10([number as u32, stream, 0, 0], [1, 0])[0]) / f64::from(u32::MAX) * 2.0
        - 1.0
}

/// The box of a thing as a detector finds it: each side is off by up to 4 pixels.
fn box_of(thing: Thing, number: usize) -> ImageBox {
    let [u, v] = thing.middle_px;
    let sides = [(u, -1.0), (v, -1.0), (u, 1.0), (v, 1.0)];
    let mut stream = 0;
    let sides = sides.map(|(middle, sign)| {
        stream += 1;
        middle + sign * RADIUS_PX + 4.0 * random(number, stream)
    });
    ImageBox::new(sides).unwrap().with_score(0.9).unwrap()
}

fn tracker(settings: impl Into<TargetSettings>) -> Tracker {
    let views = vec![view(Pose::identity())];
    Tracker::new(views, vec![settings.into()], 1, Level::best()).unwrap()
}

fn with_detector() -> DetectedSettings {
    let mut settings = settings_of(swinging(0));
    settings.detector = Some(DetectorSettings::default());
    settings
}

/// Tracks 60 frames of both balls with these boxes. Returns how far estimates are from the target, in pixels; `None` where it is not tracked.
fn off_px(
    tracker: &mut Tracker,
    boxes: impl Fn(usize) -> Option<Vec<ImageBox>>,
) -> Vec<Option<f64>> {
    let track = |number: usize| {
        let frame = shown(&[swinging(number), OTHER], &[], 0.04 * number as f64);
        let mut set = set_of(frame);
        if let Some(boxes) = boxes(number) {
            set = set
                .with_boxes(CameraId::new(0), TargetId::new(0), boxes)
                .unwrap();
        }
        tracker.observe(&set).unwrap();
        let estimate = tracker.estimate(TargetId::new(0)).unwrap();
        let is_tracked = estimate.state == TrackState::Tracking;
        let [x, y, z] = estimate.kinematics.filter(|_| is_tracked)?.position_m;
        let [u, v] = swinging(number).middle_px;
        let [off_u, off_v] = [
            FOCAL_PX * x / z + CENTER_PX[0] - u,
            FOCAL_PX * y / z + CENTER_PX[1] - v,
        ];
        Some(off_u.hypot(off_v))
    };
    (0..60).map(track).collect()
}

#[test]
fn boxes_tell_the_target_from_another_ball_and_edges_where_it_is() {
    // A detector that misses the target in a fifth of the images, and now and then takes the other ball for it.
    let boxes = |number: usize| {
        let mut boxes = Vec::new();
        if number < 3 || random(number, 10) > -0.6 {
            boxes.push(box_of(swinging(number), number));
        }
        if random(number, 11) > 0.8 {
            boxes.push(box_of(OTHER, number + 1000));
        }
        Some(boxes)
    };
    let counts = (0..60).map(|number| boxes(number).unwrap().len());
    let (none, two) = counts.fold((0, 0), |(none, two), count| {
        (
            none + usize::from(count == 0),
            two + usize::from(count == 2),
        )
    });
    assert!(none > 5 && two > 2, "{none} {two}");
    let off = off_px(&mut tracker(with_detector()), boxes);
    println!("{off:.2?}");
    let near = |off: &Option<f64>| off.is_some_and(|off| off < 1.0);
    assert!(off[1..].iter().all(near), "{off:.2?}");
    let squares: f64 = off[1..].iter().flatten().map(|off| off * off).sum();
    // A box alone is off by 2 pixels.
    assert!((squares / 59.0).sqrt() < 0.3, "{squares}");
}

#[test]
fn without_boxes_nobody_knows_which_ball_is_meant() {
    let off = off_px(&mut tracker(settings_of(swinging(0))), |_| None);
    let right = off.iter().flatten().filter(|off| **off < 1.0).count();
    println!("{off:.2?}");
    assert!(right < 30, "{right}");
    // A detector that does not look says nothing, and changes nothing.
    assert_eq!(off_px(&mut tracker(with_detector()), |_| None), off);
}

#[test]
fn what_a_detector_leaves_out_is_not_the_target() {
    let mut tracker = tracker(with_detector());
    let off = off_px(&mut tracker, |_| Some(Vec::new()));
    assert_eq!(off, [None; 60]);
    let candidates = tracker.candidates(TargetId::new(0)).unwrap();
    let verdicts: Vec<_> = candidates
        .flatten()
        .map(|candidate| candidate.verdict)
        .collect();
    assert!(verdicts.contains(&Verdict::NoBox), "{verdicts:?}");
}

#[test]
fn boxes_are_candidates_where_blobs_are_none() {
    // Grown together with something of its colours, of which the largest circle is elsewhere.
    let wall = Thing {
        exponent: 8.0,
        radius_px: 60.0,
        middle_px: [210.0, 150.0],
    };
    let ball = Thing {
        middle_px: [140.0, 100.0],
        ..OTHER
    };
    let mut found = [0; 2];
    for (with_boxes, found) in found.iter_mut().enumerate() {
        let mut tracker = tracker(with_detector());
        for number in 0..10 {
            let mut set = set_of(shown(&[ball, wall], &[], 0.04 * number as f64));
            if with_boxes == 1 {
                let boxes = vec![box_of(ball, number)];
                set = set
                    .with_boxes(CameraId::new(0), TargetId::new(0), boxes)
                    .unwrap();
            }
            tracker.observe(&set).unwrap();
            let estimate = tracker.estimate(TargetId::new(0)).unwrap();
            let [u, v] = ball.middle_px;
            *found += usize::from(estimate.kinematics.is_some_and(|known| {
                let [x, y, z] = known.position_m;
                let [x, y] = [x, y].map(|v| FOCAL_PX * v / z);
                (x + CENTER_PX[0] - u).hypot(y + CENTER_PX[1] - v) < 0.1 * RADIUS_PX
            }));
        }
    }
    println!("{found:?}");
    assert!(found[0] == 0 && found[1] >= 8, "{found:?}");
}

#[test]
fn detectors_beside_colours_are_of_single_bodies_and_checked() {
    let new = |settings: TargetSettings| {
        Tracker::new(
            vec![view(Pose::identity())],
            vec![settings],
            1,
            Level::best(),
        )
        .map(|_| ())
        .unwrap_err()
        .to_string()
    };
    let crowd = new(TargetSettings::crowd(with_detector(), 5));
    assert!(
        crowd.contains("detector") && crowd.contains("one body"),
        "{crowd}"
    );
    let landmarks = vec![with_detector().into(), with_detector().into()];
    let landmarks = new(TargetSettings::of_landmarks(landmarks));
    assert!(landmarks.contains("one body"), "{landmarks}");
    let mut settings = with_detector();
    settings.detector.as_mut().unwrap().side_sigma = f64::NAN;
    assert!(new(settings.into()).contains("side_sigma"));
    // Only those that have one take boxes.
    let mut tracker = tracker(settings_of(swinging(0)));
    let set = FrameSet::without_frames(0.0)
        .unwrap()
        .with_boxes(CameraId::new(0), TargetId::new(0), Vec::new())
        .unwrap();
    let error = tracker.observe(&set).unwrap_err().to_string();
    assert!(error.contains("a target with a detector"), "{error}");
}
