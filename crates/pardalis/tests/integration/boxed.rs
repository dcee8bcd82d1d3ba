//! Targets that another program detects: boxes with noise, misses and clutter, of known bodies.

use nalgebra::{Matrix3, Vector3};
use pardalis::camera::{Camera, Pinhole, looking_at};
use pardalis::shape::{Section, Shape, Sphere, SphereOutline, Stance, Upright, UprightOutline};
use pardalis::tracker::{BoxedSettings, ImageBox, TargetSettings, TrackState};
use pardalis::view::View;
use pardalis::{CameraId, FrameSet, TargetId, Tracker};

const FPS: f64 = 25.0;
const SIZE: (usize, usize) = (640, 480);

/// Random numbers that are the same everywhere.
struct Noise(u64);

impl Noise {
    /// Uniform in 0 to 1.
    fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let bits = (self.0 ^ (self.0 >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Standard normal.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A detector that is as it is expected to be.
struct Detector {
    noise: Noise,
    found: f64,
    false_per_image: f64,
    side_sigma: f64,
}

impl Detector {
    fn usual(seed: u64) -> Self {
        Self {
            noise: Noise(seed),
            found: 0.9,
            false_per_image: 0.5,
            side_sigma: 0.05,
        }
    }

    /// Returns the boxes of bodies at these places in an image.
    fn detect(&mut self, view: &View, shape: &Shape, places_m: &[[f64; 3]]) -> Vec<ImageBox> {
        let mut boxes = Vec::new();
        for &place_m in places_m {
            let Some(sides) = exact_box(view, shape, place_m) else {
                continue;
            };
            let [u0, v0, u1, v1] = sides;
            let sigma_px = self.side_sigma * ((u1 - u0) * (v1 - v0)).sqrt();
            if self.noise.uniform() < self.found {
                let sides = sides.map(|side| side + sigma_px * self.noise.normal());
                boxes.extend(ImageBox::new(sides).ok());
            }
        }
        // Poisson by small chances.
        for _ in 0..100 {
            if self.noise.uniform() < 0.01 * self.false_per_image {
                let [u, v] = [640.0, 480.0].map(|side| side * self.noise.uniform());
                let width = 6.0 * (3.0 * self.noise.uniform()).exp();
                let height = width * (1.4 * (self.noise.uniform() - 0.5)).exp();
                boxes.extend(ImageBox::new([u, v, u + width, v + height]).ok());
            }
        }
        boxes
    }
}

/// The box around a body, within the image; `None` if it is not in it.
fn exact_box(view: &View, shape: &Shape, place_m: [f64; 3]) -> Option<[f64; 4]> {
    let pose = view.camera_from_world();
    let outline = shape.outline_px(view.camera(), pose, place_m, Stance::default(), 2000);
    let pixels: Vec<[f64; 2]> = outline.into_iter().collect::<Option<_>>()?;
    let along = |axis: usize| pixels.iter().map(move |pixel| pixel[axis]);
    let side = |axis: usize, last: usize| {
        let least = along(axis).fold(f64::INFINITY, f64::min).max(-0.5);
        let most = along(axis).fold(f64::NEG_INFINITY, f64::max);
        [least, most.min(last as f64 - 0.5)]
    };
    let ([u0, u1], [v0, v1]) = (side(0, SIZE.0), side(1, SIZE.1));
    (u0 < u1 && v0 < v1).then_some([u0, v0, u1, v1])
}

fn view(camera: impl Into<Camera>, from_m: [f64; 3], at_m: [f64; 3]) -> View {
    let pose = looking_at(Vector3::from(from_m), Vector3::from(at_m), 0.0).unwrap();
    View::new(camera, pose, SIZE, None).unwrap()
}

fn webcams(count: usize) -> Vec<View> {
    let places = [[0.0, -3.0, 1.2], [2.5, -2.0, 1.5]];
    let camera = || Pinhole::new([500.0; 2], [319.5, 239.5], &[]).unwrap();
    let of = |&from_m: &[f64; 3]| view(camera(), from_m, [0.0, 0.0, 0.6]);
    places[..count].iter().map(of).collect()
}

fn ball() -> Shape {
    Shape::Sphere(Sphere::new(0.1, SphereOutline::Tangent).unwrap())
}

fn person() -> Shape {
    let section = Section::circle(0.25).unwrap();
    Shape::Upright(Upright::new(section, 1.75, UprightOutline::Exact).unwrap())
}

fn tracker(views: &[View], target: impl Into<TargetSettings>, seed: u32) -> (Tracker, TargetId) {
    let mut builder = Tracker::builder();
    for view in views {
        builder.camera(view.clone());
    }
    builder.seed(seed);
    let target = builder.target(target);
    (builder.build().unwrap(), target)
}

/// Where a ball is after some time.
fn circle(time_s: f64) -> [f64; 3] {
    let (sin, cos) = (1.5 * time_s).sin_cos();
    [0.7 * cos, 0.5 * sin, 0.6 + 0.3 * (2.3 * time_s).sin()]
}

/// How well a run followed the truth.
#[derive(Debug, Default)]
struct Score {
    tracked: usize,
    squares: f64,
    nees: f64,
    greatest_m: f64,
}

impl Score {
    fn add(&mut self, tracker: &Tracker, target: TargetId, truth_m: [f64; 3], axes: usize) {
        let estimate = tracker.estimate(target).unwrap();
        let Some(known) = estimate.kinematics else {
            return;
        };
        let off = Vector3::from(known.position_m) - Vector3::from(truth_m);
        let [xx, xy, xz, yy, yz, zz] = known.covariance_m2;
        let mut covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        if axes == 2 {
            covariance[(2, 2)] = 1.0;
        }
        self.tracked += usize::from(estimate.state == TrackState::Tracking);
        self.squares += off.norm_squared();
        self.nees += off.dot(&(covariance.try_inverse().unwrap() * off));
        // At first, only one camera may have seen it.
        if tracker.time_s().is_some_and(|time_s| time_s > 0.3) {
            self.greatest_m = self.greatest_m.max(off.norm());
        }
    }
}

fn follow(
    views: &[View],
    shape: &Shape,
    path: impl Fn(f64) -> [f64; 3],
    frames: usize,
    seed: u64,
) -> Score {
    let (mut tracker, target) = tracker(views, BoxedSettings::new(*shape), seed as u32);
    let mut detector = Detector::usual(seed);
    let mut score = Score::default();
    for frame in 0..frames {
        let time_s = frame as f64 / FPS;
        let truth_m = path(time_s);
        let mut set = FrameSet::without_frames(time_s).unwrap();
        for (camera, view) in views.iter().enumerate() {
            let boxes = detector.detect(view, shape, &[truth_m]);
            set = set
                .with_boxes(CameraId::new(camera), target, boxes)
                .unwrap();
        }
        tracker.observe(&set).unwrap();
        let axes = if matches!(shape, Shape::Sphere(_)) {
            3
        } else {
            2
        };
        score.add(&tracker, target, truth_m, axes);
    }
    score
}

#[test]
fn a_ball_is_followed_by_its_boxes() {
    // RMSE in metres: the size of a box says its distance to 5 %, and two cameras know better.
    for (cameras, most_m) in [(1, 0.15), (2, 0.03)] {
        for seed in 1..4 {
            let score = follow(&webcams(cameras), &ball(), circle, 200, seed);
            let rmse_m = (score.squares / 200.0).sqrt();
            let nees = score.nees / 200.0;
            let seen = format!("{cameras} cameras, seed {seed}: {rmse_m} m, {nees}, {score:?}");
            assert!(score.tracked >= 190 && rmse_m < most_m, "{seen}");
            // With one box missed, the other camera knows the distance only by the size.
            assert!(score.greatest_m < 0.8, "{seen}");
            // Three are right if errors of the size are as large as is allowed; here there are none.
            assert!((0.8..4.0).contains(&nees), "{seen}");
        }
    }
}

#[test]
fn a_person_is_followed_on_the_ground() {
    let walk = |time_s: f64| [-1.0 + 0.8 * time_s.min(3.0), 2.0 + 0.5 * time_s, 0.0];
    for seed in 1..4 {
        let score = follow(&webcams(1), &person(), walk, 200, seed);
        let rmse_m = (score.squares / 200.0).sqrt();
        let seen = format!("seed {seed}: {rmse_m} m, {score:?}");
        assert!(score.tracked >= 190 && rmse_m < 0.25, "{seen}");
        assert!((0.4..3.0).contains(&(score.nees / 200.0)), "{seen}");
    }
}

#[test]
fn clutter_is_not_taken_for_a_body() {
    for cameras in [1, 2] {
        let views = webcams(cameras);
        let mut tracking = 0;
        for seed in 1..4 {
            let (mut tracker, target) = tracker(&views, BoxedSettings::new(ball()), seed as u32);
            let mut detector = Detector::usual(seed);
            for frame in 0..200 {
                let mut set = FrameSet::without_frames(frame as f64 / FPS).unwrap();
                for (camera, view) in views.iter().enumerate() {
                    let boxes = detector.detect(view, &ball(), &[]);
                    set = set
                        .with_boxes(CameraId::new(camera), target, boxes)
                        .unwrap();
                }
                tracker.observe(&set).unwrap();
                let state = tracker.estimate(target).unwrap().state;
                tracking += usize::from(state == TrackState::Tracking);
            }
        }
        assert!(tracking <= 6, "{cameras} cameras: {tracking} of 600 rows");
    }
}

/// Tracks a ball at rest; `boxes` says of each frame what the detector reports of it, nothing if it did not look.
fn states(
    frames: usize,
    seed: u32,
    boxes: impl Fn(usize) -> Option<bool>,
) -> Vec<(TrackState, f64)> {
    let views = webcams(1);
    let (mut tracker, target) = tracker(&views, BoxedSettings::new(ball()), seed);
    let sides = exact_box(&views[0], &ball(), [0.2, 0.0, 0.5]).unwrap();
    let step = |frame: usize| {
        let mut set = FrameSet::without_frames(frame as f64 / FPS).unwrap();
        if let Some(is_found) = boxes(frame) {
            let found = is_found.then(|| ImageBox::new(sides).unwrap());
            let found = found.into_iter().collect();
            set = set.with_boxes(CameraId::new(0), target, found).unwrap();
        }
        tracker.observe(&set).unwrap();
        let estimate = tracker.estimate(target).unwrap();
        (estimate.state, estimate.confidence)
    };
    (0..frames).map(step).collect()
}

#[test]
fn what_is_not_found_is_occluded_then_lost_and_found_again() {
    let states = states(200, 1, |frame| Some(!(20..120).contains(&frame)));
    let state = |frame: usize| states[frame].0;
    assert!((3..20).all(|frame| state(frame) == TrackState::Tracking));
    assert_eq!(state(20), TrackState::Tracking, "a miss happens");
    assert_eq!(state(24), TrackState::Occluded);
    assert_eq!(state(119), TrackState::Lost);
    assert!((122..200).all(|frame| state(frame) == TrackState::Tracking));
}

#[test]
fn however_long_it_was_hidden_it_is_found_again() {
    for hidden in [5, 10, 15, 25, 35, 50, 150, 1000] {
        for seed in 1..4 {
            let back = 20 + hidden;
            let states = states(back + 5, seed, |frame| Some(!(20..back).contains(&frame)));
            let (state, confidence) = states[back + 2];
            let seen = format!("hidden {hidden}, seed {seed}: {state:?}, {confidence}");
            assert!(state == TrackState::Tracking && confidence > 0.8, "{seen}");
        }
    }
}

#[test]
fn one_box_may_be_clutter_and_two_are_not() {
    let states = states(40, 1, |frame| Some(frame >= 30));
    assert!((0..31).all(|frame| states[frame].0 == TrackState::Searching));
    assert!((32..40).all(|frame| states[frame].0 == TrackState::Tracking));
}

#[test]
fn images_at_which_no_detector_looked_say_nothing() {
    // Every fifth image; in the others nothing is known.
    let some = states(60, 1, |frame| (frame % 5 == 0).then_some(true));
    assert!(
        some[15..]
            .iter()
            .all(|(state, _)| *state == TrackState::Tracking)
    );
    // The same, with all others empty: mostly occluded.
    let none = states(60, 1, |frame| Some(frame % 5 == 0));
    assert!(none[59].0 != TrackState::Tracking && none[59].1 < some[59].1);
}

#[test]
fn a_crowd_of_boxes_keeps_its_numbers() {
    let camera = Pinhole::new([500.0; 2], [319.5, 239.5], &[]).unwrap();
    let view = view(camera, [0.0, -8.0, 3.0], [0.0, 0.0, 1.0]);
    // Side by side, at most 0.7 m from one another, and the last comes later.
    let places = |time_s: f64| -> Vec<[f64; 3]> {
        let count = if time_s < 2.0 { 3 } else { 4 };
        let place = |k: usize| {
            let x = 0.9 * k as f64 - 1.3 + 0.1 * (1.1 * time_s + 2.0 * k as f64).sin();
            [x, 0.5 * (0.5 * time_s).sin(), 0.0]
        };
        (0..count).map(place).collect()
    };
    for seed in 1..4 {
        let crowd = TargetSettings::boxed_crowd(BoxedSettings::new(person()), 20);
        let (mut tracker, target) = tracker(std::slice::from_ref(&view), crowd, seed as u32);
        let mut detector = Detector::usual(seed);
        let mut numbers = Vec::new();
        for frame in 0..150 {
            let time_s = frame as f64 / FPS;
            let places_m = places(time_s);
            let boxes = detector.detect(&view, &person(), &places_m);
            let set = FrameSet::without_frames(time_s).unwrap();
            let set = set.with_boxes(CameraId::new(0), target, boxes).unwrap();
            tracker.observe(&set).unwrap();
            let members: Vec<_> = tracker.members_at(target, time_s).unwrap().collect();
            let number_at = |place_m: &[f64; 3]| {
                let near = members.iter().filter(|member| {
                    let known = member.estimate.kinematics;
                    known.is_some_and(|known| {
                        let off_m = Vector3::from(known.position_m) - Vector3::from(*place_m);
                        off_m.norm() < 0.4
                    })
                });
                near.map(|member| member.number).next()
            };
            let here: Vec<Option<u32>> = places_m.iter().map(number_at).collect();
            if frame > 80 {
                assert!(
                    here.iter().all(Option::is_some),
                    "seed {seed}, frame {frame}: {here:?}"
                );
                numbers.push(here);
            }
        }
        assert!(
            numbers.iter().all(|here| *here == numbers[0]),
            "seed {seed}: {numbers:?}"
        );
    }
}

#[test]
fn two_balls_in_two_cameras_are_two_members() {
    let views = webcams(2);
    for seed in 1..4 {
        let crowd = TargetSettings::boxed_crowd(BoxedSettings::new(ball()), 10);
        let (mut tracker, target) = tracker(&views, crowd, seed as u32);
        let mut detector = Detector::usual(seed);
        for frame in 0..100 {
            let time_s = frame as f64 / FPS;
            let places_m = [circle(time_s), circle(time_s + 2.0)];
            let mut set = FrameSet::without_frames(time_s).unwrap();
            for (camera, view) in views.iter().enumerate() {
                let boxes = detector.detect(view, &ball(), &places_m);
                set = set
                    .with_boxes(CameraId::new(camera), target, boxes)
                    .unwrap();
            }
            tracker.observe(&set).unwrap();
            let members = tracker.members_at(target, time_s).unwrap();
            let known: Vec<_> = members
                .filter_map(|member| member.estimate.kinematics)
                .collect();
            for place_m in places_m {
                let is_there = |position_m: [f64; 3]| {
                    (Vector3::from(position_m) - Vector3::from(place_m)).norm() < 0.3
                };
                let count = known
                    .iter()
                    .filter(|known| is_there(known.position_m))
                    .count();
                assert!(
                    count == 1 || frame < 5,
                    "seed {seed}, frame {frame}: {known:?}"
                );
            }
            assert!(known.len() <= 2, "seed {seed}, frame {frame}: {known:?}");
        }
    }
}

#[test]
fn of_people_who_are_half_hidden_each_is_one_member() {
    let views = webcams(2);
    for seed in 1..4 {
        let settings = TargetSettings::boxed_crowd(BoxedSettings::new(person()), 10);
        let (mut tracker, target) = tracker(&views, settings, seed as u32);
        let mut detector = Detector::usual(seed);
        detector.false_per_image = 0.0;
        for frame in 0..100 {
            let time_s = frame as f64 / FPS;
            let walk = 0.3 * time_s;
            let places_m = [[-0.5 + walk, 1.0, 0.0], [0.6 - walk, 2.2, 0.0]];
            let mut set = FrameSet::without_frames(time_s).unwrap();
            for (camera, view) in views.iter().enumerate() {
                let mut boxes = detector.detect(view, &person(), &places_m);
                if camera == 1 {
                    // A counter hides the legs: boxes end at the hips.
                    let upper = |found: &ImageBox| {
                        let [u0, v0, u1, v1] = found.sides_px();
                        ImageBox::new([u0, v0, u1, v0 + 0.5 * (v1 - v0)]).unwrap()
                    };
                    boxes = boxes.iter().map(upper).collect();
                }
                set = set
                    .with_boxes(CameraId::new(camera), target, boxes)
                    .unwrap();
            }
            tracker.observe(&set).unwrap();
            let members = tracker.members_at(target, time_s).unwrap();
            let known: Vec<_> = members.filter_map(|m| m.estimate.kinematics).collect();
            let seen = format!("seed {seed}, frame {frame}: {known:?}");
            assert!(known.len() <= 2, "{seen}");
            assert!(known.len() == 2 || frame < 10, "{seen}");
        }
    }
}

#[test]
fn boxes_of_something_else_are_refused() {
    let views = webcams(1);
    let (mut tracker, target) = tracker(&views, BoxedSettings::new(ball()), 1);
    let set = |camera, target| {
        let set = FrameSet::without_frames(0.0).unwrap();
        set.with_boxes(CameraId::new(camera), target, Vec::new())
    };
    let twice = set(0, target).unwrap();
    let twice = twice.with_boxes(CameraId::new(0), target, Vec::new());
    assert!(twice.unwrap_err().to_string().starts_with("camera is 0"));
    let error = tracker.observe(&set(1, target).unwrap()).unwrap_err();
    assert!(error.to_string().starts_with("camera is 1"), "{error}");
    let error = tracker
        .observe(&set(0, TargetId::new(1)).unwrap())
        .unwrap_err();
    assert!(error.to_string().starts_with("target is 1"), "{error}");
    assert_eq!(tracker.time_s(), None, "nothing has changed");
    for (sides, score) in [
        ([0.0, 0.0, f64::NAN, 1.0], 0.5),
        ([0.0, 0.0, 1.0, 1.0], 1.5),
    ] {
        let found = ImageBox::new(sides).and_then(|found| found.with_score(score));
        assert!(found.is_err());
    }
    let mut settings = BoxedSettings::new(ball());
    settings.detector.detection_probability = 1.0;
    let mut builder = Tracker::builder();
    builder.camera(views[0].clone());
    builder.target(settings);
    let error = builder.build().err().unwrap().to_string();
    assert!(error.starts_with("detection_probability is 1"), "{error}");
}
