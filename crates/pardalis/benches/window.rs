//! The published system of two webcams on one core (Barrera 2005: 200 particles, windows of 25 pixels), and the
//! number of particles above which sums over the image are faster than look-ups.
//!
//! `cargo bench -p pardalis --bench window`. Each is compared with the naive reference before it is timed.

#[path = "../tests/integration/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::{data, frame, open};
use criterion::{Criterion, criterion_group, criterion_main};
use pardalis::color::{ColorModel, ColorRanges, YuvEncoding};
use pardalis::likelihood::{Cue, Cues, WindowCounting, WindowSettings};
use pardalis::reference::window_log_likelihood;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::start::Start;
use pardalis::tracker::InitializedSettings;
use pardalis::view::View;
use pardalis::{CameraId, Frame, FrameSet, PixelFormat, Tracker};
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
use pardalis_filter::motion::RandomWalk;

/// Published number of particles.
const PARTICLES: usize = 200;
/// Numbers of particles around the crossover.
const COUNTS: [usize; 5] = [200, 1000, 3000, 10_000, 30_000];

fn views() -> Vec<View> {
    let text = std::fs::read_to_string(data("webcams-two/cameras.json")).unwrap();
    let cameras = pardalis_camera::formats::read(&text, None).unwrap();
    let view = |camera: &pardalis_camera::CalibratedCamera| {
        let size = camera.size_px.unwrap();
        View::new(
            camera.camera.clone(),
            camera.world_from_camera.unwrap(),
            size,
            None,
        )
        .unwrap()
    };
    cameras.iter().map(view).collect()
}

/// Returns both cameras' frames of an instant.
fn frames(index: usize) -> [(usize, Frame); 2] {
    [0, 1].map(|camera| {
        let name = format!("webcams-two/frames/cam{}/{index:06}.jpg", camera + 1);
        let picture = open(&name);
        let time_s = index as f64 / 25.0;
        let frame = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s);
        (camera, frame)
    })
}

fn set_of(frames: [(usize, Frame); 2]) -> FrameSet {
    FrameSet::new(frames.map(|(camera, frame)| (CameraId::new(camera), frame))).unwrap()
}

fn ball() -> Shape {
    Shape::Sphere(Sphere::new(0.035, SphereOutline::Tangent).unwrap())
}

fn pink() -> ColorRanges {
    let text = std::fs::read_to_string(data("colors/pink-ball.hsi.colors.toml")).unwrap();
    ColorModel::from_text(&text).unwrap().ranges().unwrap()
}

fn window() -> WindowSettings {
    let mut window = WindowSettings::default();
    window.ranges = Some(pink());
    window
}

fn target() -> InitializedSettings {
    let start = GaussianStart {
        position_m: [0.45, 0.45, 0.12],
        covariance_m2: diagonal_m2([0.03; 3]),
        ..GaussianStart::default()
    };
    let mut target = InitializedSettings::new(ball(), None, Start::Gaussian(start));
    target.cues = vec![Cue::Window(window()).into()];
    target.filter.particle_count = PARTICLES;
    target.filter.motion = RandomWalk::PUBLISHED.into();
    target
}

/// Returns particles around the ball, as during tracking, or all over the room in view.
fn particles(count: usize, spread_m: f32) -> Particles {
    let mut particles = Particles::new(count, 3);
    let draws = Draws::new(1, 0);
    for i in 0..count {
        let normals = draws.normals(i as u32, 0, Stage::Start, 0);
        for (axis, center_m) in [0.45, 0.45, 0.12].into_iter().enumerate() {
            particles.columns_mut()[axis][i] = center_m + spread_m * normals[axis];
        }
    }
    particles
}

/// Compares the kernel with the reference. At most one particle in fifty may be rounded to another pixel.
fn check(cues: &mut Cues, views: &[View], frames: &[(usize, Frame)], particles: &Particles) {
    let (window, pink) = (window(), pink());
    let mut fast = vec![0.0; particles.count()];
    cues.of(views, frames).log_likelihoods(particles, &mut fast);
    let differs = |&(i, &fast): &(usize, &f32)| {
        let position_m = particles.position_m(i);
        let naive = window_log_likelihood(&window, &pink, views, frames, position_m);
        (f64::from(fast) - naive).abs() > 1e-5
    };
    let different = fast.iter().enumerate().filter(differs).count();
    assert!(
        50 * different <= fast.len(),
        "{different} of {}",
        fast.len()
    );
}

/// Times steps: predict, count, update and estimate.
fn steps(criterion: &mut Criterion) {
    for level in Level::available() {
        let name = level.name();
        let mut tracker = Tracker::new(views(), vec![target()], 1, level).unwrap();
        let ball_id = tracker.targets().next().unwrap();
        for index in 0..30 {
            tracker.observe(&set_of(frames(index))).unwrap();
        }
        let estimate = tracker
            .estimate_at(ball_id, 29.0 / 25.0)
            .unwrap()
            .kinematics
            .unwrap();
        assert!(
            (estimate.position_m[1] - 0.45).abs() < 0.02,
            "the ball must be tracked"
        );
        let frames = frames(30);
        let mut time_s = 30.0 / 25.0;
        criterion.bench_function(&format!("window/step/{PARTICLES}/{name}"), |bencher| {
            bencher.iter(|| {
                time_s += 1.0 / 25.0;
                let at_time = |(camera, frame): &(usize, Frame)| {
                    (*camera, frame.with_time_s(time_s).unwrap())
                };
                let set = set_of(frames.each_ref().map(at_time));
                tracker.observe(black_box(&set)).unwrap();
                tracker.estimate_at(ball_id, time_s).unwrap()
            });
        });
    }
    let (mut views, frames, particles) = (views(), frames(30), particles(PARTICLES, 0.03));
    let mut cues = Cues::new(&target().cues, ball(), None, Level::best()).unwrap();
    for (camera, frame) in &frames {
        cues.prepare(&mut views[*camera], frame);
    }
    check(&mut cues, &views, &frames, &particles);
    let (window, pink) = (window(), pink());
    criterion.bench_function(&format!("window/reference/{PARTICLES}"), |bencher| {
        let of =
            |i| window_log_likelihood(&window, &pink, &views, &frames, particles.position_m(i));
        bencher.iter(|| (0..PARTICLES).map(of).sum::<f64>());
    });
}

/// Times both ways of counting, for particles around the ball and all over the images.
fn crossing(criterion: &mut Criterion) {
    let (mut views, frames) = (views(), frames(30));
    for (place, spread_m) in [("around", 0.03), ("all-over", 0.3)] {
        for count in COUNTS {
            let particles = particles(count, spread_m);
            let mut out = vec![0.0; count];
            for (name, counting) in [
                ("look-ups", WindowCounting::LookUps),
                ("sums", WindowCounting::Sums),
                ("chosen", WindowCounting::Cheaper),
            ] {
                let cue = [Cue::Window(window()).into()];
                let mut cues = Cues::counting(&cue, ball(), None, counting, Level::best()).unwrap();
                for (camera, frame) in &frames {
                    cues.prepare(&mut views[*camera], frame);
                }
                check(&mut cues, &views, &frames, &particles);
                criterion.bench_function(&format!("window/{place}/{count}/{name}"), |bencher| {
                    bencher.iter(|| {
                        cues.of(&views, &frames)
                            .log_likelihoods(black_box(&particles), &mut out);
                    });
                });
            }
        }
    }
}

/// Runs everything on a pool of one thread.
fn on_one_thread(criterion: &mut Criterion) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread().build_global().unwrap();
    steps(criterion);
    crossing(criterion);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30).without_plots();
    targets = on_one_thread
}
criterion_main!(benches);
