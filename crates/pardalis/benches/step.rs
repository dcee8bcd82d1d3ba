//! Tracker steps and their stages on one core, at every CPU level, and the naive reference for comparison.
//!
//! `cargo bench -p pardalis --bench step`. Likelihoods are compared with the reference, and estimates of default
//! steps with the truth, before they are timed.

#[path = "../tests/integration/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::{
    FPS, ball, ball_colors, ball_filter, ball_start, ball_target, data, detected_ball,
    fisheye_view, frame, jump_picture, set_of,
};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use nalgebra::{Point3, Vector3};
use pardalis::color::{ColorModel, Palette, PixelKind, PixelTable, YuvEncoding};
use pardalis::likelihood::{ContourSettings, Cue, Cues};
use pardalis::reference;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::tracker::{
    BoxedSettings, DetectedSettings, DetectorSettings, ImageBox, TargetSettings, TrackState,
};
use pardalis::view::View;
use pardalis::{CameraId, Estimate, Frame, FrameSet, PixelFormat, TargetId, Tracker};
use pardalis_camera::CalibratedCamera;
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;
use pardalis_filter::particle_filter::ParticleFilter;
use pardalis_filter::resample::Resampling;

/// Numbers of particles in real time and offline in Taiana 2007, each with two contours of 50 points.
const PARTICLE_COUNTS: [usize; 2] = [300, 10_000];

/// A frame format with the palette that suits it.
const INPUTS: [(&str, PixelFormat, Palette); 2] = [
    ("rgb8-hsi", PixelFormat::Rgb8, Palette::HSI),
    ("yuyv-yuv", PixelFormat::Yuyv, Palette::YUV),
];

/// The ball before it is thrown, as one camera's frames of two instants.
fn frames(format: PixelFormat) -> [[(usize, Frame); 1]; 2] {
    [0, 1].map(|index| {
        let time_s = index as f64 / FPS;
        [(
            0,
            frame(&jump_picture(index), format, YuvEncoding::default(), time_s),
        )]
    })
}

fn levels() -> Vec<(&'static str, Level)> {
    let levels = Level::available().into_iter();
    levels.map(|level| (level.name(), level)).collect()
}

/// The contour cue as published offline.
fn contour(colors: &ColorModel, level: Level) -> Cues {
    let settings = [Cue::Contour(ContourSettings::default()).into()];
    Cues::new(&settings, Shape::Sphere(ball()), Some(colors), level).unwrap()
}

/// Particles after the first frame, the view prepared for it, and the ball's colours.
struct Scene {
    colors: ColorModel,
    views: [View; 1],
    frames: [(usize, Frame); 1],
    filter: ParticleFilter,
}

impl Scene {
    fn new((_, format, palette): (&str, PixelFormat, Palette), particle_count: usize) -> Self {
        let colors = ball_colors(palette);
        let [frames, _] = frames(format);
        let mut views = [fisheye_view()];
        views[0].prepare(PixelKind::of(&frames[0].1), palette);
        let draws = Draws::new(1, 0);
        let mut filter = ParticleFilter::new(
            ball_filter(particle_count),
            &ball_start(),
            draws,
            Level::best(),
        )
        .unwrap();
        // A few frames without motion, after which the particles are as concentrated as during tracking.
        let mut cue = contour(&colors, Level::best());
        for _ in 0..4 {
            filter.update(&mut cue.of(&views, &frames));
            filter.predict(1.0 / FPS);
        }
        Self {
            colors,
            views,
            frames,
            filter,
        }
    }

    fn cue(&self, level: Level) -> Cues {
        contour(&self.colors, level)
    }

    fn naive_log_likelihoods(&self, particles: &Particles) -> Vec<f64> {
        let settings = ContourSettings::default();
        (0..particles.count())
            .map(|i| {
                let position_m = particles.position_m(i);
                reference::contour_log_likelihood(
                    &settings,
                    &Shape::Sphere(ball()),
                    &self.colors,
                    &self.views,
                    &self.frames,
                    position_m,
                )
            })
            .collect()
    }

    /// Compares the kernel with the reference. At most one particle in twenty may differ, because rounding can move
    /// points across the border between two pixels.
    fn check(&self, cue: &mut Cues) {
        let particles = self.filter.particles();
        let mut fast = vec![0.0; particles.count()];
        cue.of(&self.views, &self.frames)
            .log_likelihoods(particles, &mut fast);
        let naive = self.naive_log_likelihoods(particles);
        let differs =
            |(fast, naive): &(&f32, &f64)| (f64::from(**fast) - **naive).abs() > 1e-4 * naive.abs();
        let different = fast.iter().zip(&naive).filter(differs).count();
        assert!(
            20 * different <= fast.len(),
            "{different} of {} differ from the reference",
            fast.len()
        );
    }
}

/// Predict, likelihood, update and estimate, through the tracker.
fn whole_steps(criterion: &mut Criterion) {
    for input in INPUTS {
        let (name, format, palette) = input;
        let [first, second] = frames(format);
        for count in PARTICLE_COUNTS {
            let scene = Scene::new(input, count);
            for (level_name, level) in levels() {
                scene.check(&mut scene.cue(level));
                let targets = vec![ball_target(palette, count)];
                let mut tracker = Tracker::new(vec![fisheye_view()], targets, 1, level).unwrap();
                let [(_, first)] = &first;
                let [(_, second)] = &second;
                tracker.observe(&set_of(first.clone())).unwrap();
                let mut time_s = 0.0;
                criterion.bench_function(&format!("step/{name}/{count}/{level_name}"), |bencher| {
                    bencher.iter(|| {
                        time_s += 1.0 / FPS;
                        let set = set_of(second.with_time_s(time_s).unwrap());
                        tracker.observe(black_box(&set)).unwrap();
                        tracker.estimate_at(TargetId::new(0), time_s).unwrap()
                    });
                });
            }
        }
        let mut scene = Scene::new(input, PARTICLE_COUNTS[0]);
        criterion.bench_function(
            &format!("step/{name}/{}/reference", PARTICLE_COUNTS[0]),
            |bencher| {
                bencher.iter(|| {
                    scene.filter.predict(1.0 / FPS);
                    let particles = scene.filter.particles();
                    let naive = scene.naive_log_likelihoods(particles);
                    let positions: Vec<_> = (0..particles.count())
                        .map(|i| Vector3::from(particles.position_m(i)))
                        .collect();
                    reference::posterior(scene.filter.weights(), &naive, &positions)
                });
            },
        );
    }
}

/// A tracker with the default settings that has processed a sequence, and what it is timed on repeatedly.
struct DefaultScene {
    name: &'static str,
    tracker: Tracker,
    seen: Seen,
    /// Position of the ball there, metres.
    truth_m: Vector3<f64>,
    time_s: f64,
}

/// What the cameras show at one instant: frames, boxes of a detector, or both.
struct Seen {
    frames: Vec<(CameraId, Frame)>,
    boxes: Vec<(CameraId, ImageBox)>,
}

impl Seen {
    fn at(&self, time_s: f64) -> FrameSet {
        let frames = self.frames.iter();
        let frames = frames.map(|(camera, frame)| (*camera, frame.with_time_s(time_s).unwrap()));
        let set = match self.frames[..] {
            [] => FrameSet::without_frames(time_s),
            _ => FrameSet::new(frames),
        };
        let boxes = self.boxes.iter();
        boxes.fold(set.unwrap(), |set, (camera, found)| {
            set.with_boxes(*camera, TargetId::new(0), vec![*found])
                .unwrap()
        })
    }
}

/// Index of the picture on which default steps are timed: one that alone places the ball in the fisheye camera within 30 mm. Others place it up to 40 mm
/// off, and repeating a picture does not make it better.
const TIMED: usize = 17;
/// Maximum error of the estimates of default steps, metres.
const MAX_ERROR_M: f64 = 0.03;

/// Returns the true positions of the ball in the pictures of a sequence up to the timed one.
fn truth_m(sequence: &str) -> Vec<Vector3<f64>> {
    let table = std::fs::read_to_string(data(&format!("{sequence}/truth.csv"))).unwrap();
    let rows = table.lines().map(|row| row.split(',').collect::<Vec<_>>());
    let rows: Vec<_> = rows.skip(1).collect();
    let of = |index: usize| {
        let row = rows.iter().find(|row| row[0] == index.to_string());
        let row = row.expect("the truth has the picture");
        Vector3::from([4, 5, 6].map(|column| row[column].parse().unwrap()))
    };
    (0..=TIMED).map(of).collect()
}

impl DefaultScene {
    fn new(
        name: &'static str,
        views: Vec<View>,
        ball: impl Into<TargetSettings>,
        truth_m: Vector3<f64>,
        seen_in: impl Fn(usize) -> Seen,
    ) -> Self {
        let mut tracker = Tracker::new(views, [ball.into()], 1, Level::best()).unwrap();
        for index in 0..TIMED {
            let set = seen_in(index).at(index as f64 / FPS);
            tracker.observe(&set).unwrap();
        }
        let mut scene = Self {
            name,
            tracker,
            seen: seen_in(TIMED),
            truth_m,
            time_s: (TIMED - 1) as f64 / FPS,
        };
        // Enough steps for searches of whole images to correct the track.
        for _ in 0..25 {
            scene.step();
        }
        scene.check();
        scene
    }

    /// Performs one step with the same images or boxes at the next instant.
    fn step(&mut self) -> Estimate {
        self.time_s += 1.0 / FPS;
        let set = self.seen.at(self.time_s);
        self.tracker.observe(black_box(&set)).unwrap();
        let target = TargetId::new(0);
        self.tracker.estimate_at(target, self.time_s).unwrap()
    }

    /// Asserts that the next estimate is close to the truth.
    fn check(&mut self) {
        let found = self.step();
        assert_eq!(found.state, TrackState::Tracking, "{}", self.name);
        let position_m = Vector3::from(found.kinematics.unwrap().position_m);
        let error_m = (position_m - self.truth_m).norm();
        assert!(error_m < MAX_ERROR_M, "{}: {error_m} m", self.name);
    }

    /// The default path on one ball in the fisheye camera.
    fn fisheye() -> Self {
        let truth_m = truth_m("dioptric-jump")[TIMED];
        let views = vec![fisheye_view()];
        Self::new("fisheye", views, detected_ball(), truth_m, |index| {
            let time_s = index as f64 / FPS;
            let format = PixelFormat::Rgb8;
            let frame = frame(&jump_picture(index), format, YuvEncoding::default(), time_s);
            Seen {
                frames: vec![(CameraId::new(0), frame)],
                boxes: Vec::new(),
            }
        })
    }

    /// The default path on one ball in two webcams, the same with boxes of a detector, and with boxes in place of images and colours.
    fn webcams() -> [Self; 3] {
        let colors = data("colors/pink-ball.hsi.colors.toml");
        let colors = ColorModel::from_text(&std::fs::read_to_string(colors).unwrap()).unwrap();
        let ball = Sphere::new(WEBCAM_RADIUS_M, SphereOutline::Tangent).unwrap();
        let boxed = BoxedSettings::new(Shape::Sphere(ball));
        let detected = DetectedSettings::new(Shape::Sphere(ball), colors);
        let mut beside = detected.clone();
        beside.detector = Some(DetectorSettings::default());
        [
            Self::of_webcams("webcams", detected, (true, false)),
            Self::of_webcams("webcams-boxes-beside", beside, (true, true)),
            Self::of_webcams("webcams-boxes", boxed, (false, true)),
        ]
    }

    fn of_webcams(
        name: &'static str,
        ball: impl Into<TargetSettings>,
        (has_frames, has_boxes): (bool, bool),
    ) -> Self {
        let calibration = std::fs::read_to_string(data("webcams-two/cameras.json")).unwrap();
        let cameras = pardalis_camera::formats::read(&calibration, None).unwrap();
        let view = |camera: &CalibratedCamera| {
            let (pose, size) = (camera.world_from_camera.unwrap(), camera.size_px.unwrap());
            View::new(camera.camera.clone(), pose, size, None).unwrap()
        };
        let views: Vec<View> = cameras.iter().map(view).collect();
        let truth_m = truth_m("webcams-two");
        let frame_of = |camera: usize, index: usize| {
            let name = format!("webcams-two/frames/cam{}/{index:06}.jpg", camera + 1);
            let (picture, time_s) = (common::open(&name), index as f64 / FPS);
            let frame = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s);
            (CameraId::new(camera), frame)
        };
        let box_of = |camera: usize, index: usize| {
            (
                CameraId::new(camera),
                box_of(&views[camera], truth_m[index]),
            )
        };
        let numbers = |is_there: bool| 0..if is_there { views.len() } else { 0 };
        let seen_in = |index| Seen {
            frames: numbers(has_frames).map(|c| frame_of(c, index)).collect(),
            boxes: numbers(has_boxes).map(|c| box_of(c, index)).collect(),
        };
        Self::new(name, views.clone(), ball, truth_m[TIMED], seen_in)
    }
}

/// Radius of the ball before the webcams, metres.
const WEBCAM_RADIUS_M: f64 = 0.035;

/// Returns the box of the ball before a webcam at a place in the world, metres.
fn box_of(view: &View, place_m: Vector3<f64>) -> ImageBox {
    let in_camera = view.camera_from_world() * Point3::from(place_m);
    let pixel = |x: f64, y: f64| {
        let edge = in_camera + Vector3::new(x, y, 0.0);
        view.camera()
            .project(edge.into())
            .expect("the ball is in view")
    };
    let [left, top] = pixel(-WEBCAM_RADIUS_M, -WEBCAM_RADIUS_M);
    let [right, bottom] = pixel(WEBCAM_RADIUS_M, WEBCAM_RADIUS_M);
    ImageBox::new([left, top, right, bottom]).unwrap()
}

/// Times default steps: detection, association, update, visibility and adaptation. At least one step in ten searches
/// whole images.
fn default_steps(criterion: &mut Criterion) {
    let scenes = DefaultScene::webcams().into_iter();
    for mut scene in scenes.chain([DefaultScene::fisheye()]) {
        criterion.bench_function(&format!("step/default/{}", scene.name), |bencher| {
            bencher.iter(|| scene.step());
        });
        scene.check();
    }
}

/// Projection, look-ups and histograms of the contour cue.
fn likelihoods(criterion: &mut Criterion) {
    for input in INPUTS {
        for count in PARTICLE_COUNTS {
            let scene = Scene::new(input, count);
            let mut out = vec![0.0; count];
            for (level_name, level) in levels() {
                let mut cue = scene.cue(level);
                scene.check(&mut cue);
                criterion.bench_function(
                    &format!("likelihood/{}/{count}/{level_name}", input.0),
                    |bencher| {
                        bencher.iter(|| {
                            cue.of(&scene.views, &scene.frames)
                                .log_likelihoods(scene.filter.particles(), &mut out);
                        });
                    },
                );
            }
        }
    }
}

/// Times the stages that do not depend on images, and the construction of a palette's table.
fn stages(criterion: &mut Criterion) {
    for count in PARTICLE_COUNTS {
        let motion = ball_filter(count).motion;
        for (level_name, level) in levels() {
            let mut particles = Particles::new(count, motion.column_count());
            criterion.bench_function(&format!("motion/{count}/{level_name}"), |bencher| {
                bencher.iter(|| {
                    motion.propagate(&mut particles, 1.0 / FPS, Draws::new(1, 0), 1, level);
                });
            });
        }
        let scene = Scene::new(INPUTS[0], count);
        let filter = &scene.filter;
        criterion.bench_function(&format!("estimate/{count}"), |bencher| {
            bencher.iter(|| filter.estimate(black_box(0.0)));
        });
        let weights: Vec<f64> = (0..count)
            .map(|i| 2.0 * i as f64 / (count * (count - 1)) as f64)
            .collect();
        let (mut ancestors, mut scratch) = (vec![0; count], vec![0.0; count]);
        let draws = Draws::new(1, 0);
        for scheme in [
            Resampling::Multinomial,
            Resampling::Stratified,
            Resampling::Systematic,
            Resampling::Residual,
        ] {
            criterion.bench_function(&format!("resampling/{count}/{scheme:?}"), |bencher| {
                let uniform = |i| draws.uniform(i as u32, 1, Stage::Resampling);
                bencher.iter(|| {
                    scheme.draw(black_box(&weights), uniform, &mut ancestors, &mut scratch);
                });
            });
        }
    }
    for (name, format, palette) in INPUTS {
        let kind = PixelKind::of(&frames(format)[0][0].1);
        criterion.bench_function(&format!("table/{name}"), |bencher| {
            bencher.iter_batched(
                || palette,
                |palette| PixelTable::new(palette, kind),
                BatchSize::LargeInput,
            );
        });
    }
}

/// Runs everything on a pool of one thread.
fn on_one_thread(criterion: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread().build_global().unwrap();
    default_steps(criterion);
    whole_steps(criterion);
    likelihoods(criterion);
    stages(criterion);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30).without_plots();
    targets = on_one_thread
}
criterion_main!(benches);
