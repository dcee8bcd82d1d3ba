//! The region cue (100 samples), the difference cue (256 samples) and both on one core, for particles around a
//! tracked landmark.
//!
//! `cargo bench -p pardalis --bench region`. Each is compared with the naive reference before it is timed.

#[path = "../tests/integration/common/mod.rs"]
mod common;

use std::hint::black_box;

use common::frame;
use common::robot::{landmark, landmark_colors, mast_view, picture};
use criterion::{Criterion, criterion_group, criterion_main};
use pardalis::color::YuvEncoding;
use pardalis::likelihood::{Cue, CueSettings, Cues, PatchSettings};
use pardalis::reference::{difference_log_likelihood, region_log_likelihood};
use pardalis::view::View;
use pardalis::{Frame, PixelFormat};
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;

const COUNTS: [usize; 2] = [500, 5000];
/// Position of the red landmark in frame 20.
const LANDMARK_M: [f32; 3] = [-0.835, -0.35, 0.0];

fn frame_at(index: usize) -> Frame {
    let time_s = index as f64 / common::robot::FPS;
    frame(
        &picture(index),
        PixelFormat::Rgb8,
        YuvEncoding::default(),
        time_s,
    )
}

/// Particles around the landmark.
fn particles(count: usize) -> Particles {
    let mut particles = Particles::new(count, 3);
    let draws = Draws::new(1, 0);
    for i in 0..count {
        let normals = draws.normals(i as u32, 0, Stage::Start, 0);
        for (axis, spread_m) in [0.05, 0.05, 0.0].into_iter().enumerate() {
            particles.columns_mut()[axis][i] = LANDMARK_M[axis] + spread_m * normals[axis];
        }
    }
    particles
}

/// Returns the log-likelihood of a particle according to the reference.
fn reference(
    cues: &[CueSettings],
    views: &[View],
    frames: &[(usize, Frame)],
    position_m: [f64; 3],
) -> f64 {
    let (shape, colors) = (landmark(), landmark_colors("red"));
    let of = |cue: &CueSettings| match &cue.cue {
        Cue::Region(settings) => {
            region_log_likelihood(settings, &shape, &colors, views, frames, position_m)
        }
        Cue::Difference(settings) => {
            difference_log_likelihood(settings, &shape, views, frames, position_m)
        }
        other => panic!("{other:?}"),
    };
    cues.iter().map(of).sum()
}

fn likelihoods(criterion: &mut Criterion) {
    let mut views = [mast_view()];
    views[0].keep(frame_at(19));
    let frames = [(0, frame_at(20))];
    let region = Cue::Region(PatchSettings::within(&landmark()));
    let difference = Cue::Difference(PatchSettings::around());
    let colors = landmark_colors("red");
    for (name, cues) in [
        ("region", vec![region.into()]),
        ("difference", vec![difference.into()]),
        ("both", vec![region.into(), difference.into()]),
    ] {
        for count in COUNTS {
            let particles = particles(count);
            let mut out = vec![0.0; count];
            for level in Level::available() {
                let level_name = level.name();
                let mut fast = Cues::new(&cues, landmark(), Some(&colors), level).unwrap();
                fast.of(&views, &frames)
                    .log_likelihoods(&particles, &mut out);
                // Some samples may be rounded to another pixel.
                let differs = |&i: &usize| {
                    let naive = reference(&cues, &views, &frames, particles.position_m(i));
                    (f64::from(out[i]) - naive).abs() > 1e-3
                };
                let different = (0..100).filter(differs).count();
                assert!(different < 30, "{different} of 100");
                let id = format!("region/{name}/{count}/{level_name}");
                criterion.bench_function(&id, |bencher| {
                    bencher.iter(|| {
                        fast.of(&views, &frames)
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
    likelihoods(criterion);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30).without_plots();
    targets = on_one_thread
}
criterion_main!(benches);
