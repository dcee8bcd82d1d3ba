//! Projection of 50 000 points through each camera model on one core. The thesis took 11.2 ms (unified) and 6.3 ms
//! (perspective) in 2007.
//!
//! `cargo bench -p pardalis --bench projection`. `batch` is `Camera::project_points`, which the kernels use;
//! `reference` projects point by point in double precision. Both are compared before they are timed.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use pardalis_camera::{
    Camera, ConstantResolution, DoubleSphere, Equidistant, ExactMirror, ExtendedUnified,
    KannalaBrandt, Mei, Ocam, PerspectiveMirror, Pinhole, Resolution, Unified,
};
use pardalis_core::simd::Level;

const POINTS: usize = 50_000;
const CENTER_PX: [f64; 2] = [319.5, 239.5];
/// Maximum difference of the batch from the reference, in pixels.
const TOLERANCE_PX: f64 = 0.02;

fn cameras() -> Vec<Camera> {
    let mirror = ConstantResolution {
        vertex_m: 0.16,
        rim_m: 0.081,
        plane_z_m: -0.82,
        resolution: Resolution::RimShows(5.0),
        offset: 0.0,
    };
    let wide = 1.6;
    [
        Unified::new(0.9, 1.2, 150.0, CENTER_PX).map(Camera::Unified),
        PerspectiveMirror::new(140.0, CENTER_PX).map(Camera::PerspectiveMirror),
        Equidistant::new(145.56, CENTER_PX, wide).map(Camera::Equidistant),
        Pinhole::new([536.0, 536.0], CENTER_PX, &[-0.27, -0.04, 0.002, 0.0, 0.24])
            .map(Camera::Pinhole),
        KannalaBrandt::new([145.0; 2], CENTER_PX, [0.01, -0.003, 0.002, -0.0007], wide)
            .map(Camera::KannalaBrandt),
        Mei::new(
            [409.0, 410.0],
            0.0,
            CENTER_PX,
            1.05,
            [-0.02, 0.003, 0.0, 0.0],
        )
        .map(Camera::Mei),
        DoubleSphere::new([313.0; 2], CENTER_PX, -0.18, 0.59).map(Camera::DoubleSphere),
        ExtendedUnified::new([380.0; 2], CENTER_PX, 0.63, 1.04).map(Camera::ExtendedUnified),
        Ocam::new(
            &[-131.48, 0.0, 1.849e-3, 2.251e-7, -7.343e-10],
            CENTER_PX,
            [1.0, 0.0, 0.0],
            470.0,
        )
        .map(Camera::Ocam),
        mirror
            .design()
            .and_then(|profile| ExactMirror::new([579.4; 2], CENTER_PX, profile))
            .map(Camera::ExactMirror),
    ]
    .map(|camera| camera.expect("a valid camera"))
    .into()
}

/// Points between 0.2 and 6 m away along rays all over the image, by columns.
fn points(camera: &Camera) -> [Vec<f32>; 3] {
    let rays = (0..).filter_map(|i: u32| {
        // Golden sections: even in both directions.
        let share = |factor: f64| (f64::from(i) * factor).fract();
        let pixel = [640.0 * share(0.754_877_666), 480.0 * share(0.569_840_291)];
        let range_m = 0.2 + 5.8 * share(0.618_033_989);
        let ray = camera.unproject(pixel)?;
        Some([0, 1, 2].map(|c| (ray.origin[c] + range_m * ray.direction[c]) as f32))
    });
    let rays: Vec<_> = rays.take(POINTS).collect();
    [0, 1, 2].map(|c| rays.iter().map(|point| point[c]).collect())
}

fn reference(camera: &Camera, [x, y, z]: &[Vec<f32>; 3]) -> Vec<Option<[f64; 2]>> {
    let point = |i: usize| [x[i], y[i], z[i]].map(f64::from);
    (0..POINTS).map(|i| camera.project(point(i))).collect()
}

fn bench(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("projection");
    for camera in cameras() {
        let points = points(&camera);
        let columns = [0, 1, 2].map(|c| points[c].as_slice());
        let (mut u, mut v) = (vec![0.0_f32; POINTS], vec![0.0_f32; POINTS]);
        let expected = reference(&camera, &points);
        camera.project_points(Level::best(), columns, [&mut u, &mut v]);
        let agrees = |i: usize| {
            let [a, b] = expected[i]?;
            let error_px = (f64::from(u[i]) - a).hypot(f64::from(v[i]) - b);
            (error_px <= TOLERANCE_PX).then_some(())
        };
        // A point on the very border of the domain may fall on either side.
        let differing = (0..POINTS).filter(|&i| agrees(i).is_none()).count();
        assert!(
            differing <= POINTS / 1000,
            "{}: {differing} points differ",
            camera.kind()
        );

        group.bench_function(format!("batch/{}", camera.kind()), |bencher| {
            bencher.iter(|| {
                camera.project_points(Level::best(), black_box(columns), [&mut u, &mut v]);
            });
        });
        group.bench_function(format!("reference/{}", camera.kind()), |bencher| {
            bencher.iter(|| reference(&camera, black_box(&points)));
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
