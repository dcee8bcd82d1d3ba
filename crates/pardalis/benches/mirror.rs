//! What 50 000 points through an exact mirror cost on one core: solved exactly, and by the kernels' look-up.
//!
//! `cargo bench -p pardalis --bench mirror`. With `RUSTFLAGS="-C target-feature=+avx2"` the look-up is compiled as the kernels
//! compile it for CPUs with AVX2. It is first held to the exact solution.

#[path = "../tests/common/mirrors.rs"]
mod mirrors;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use mirrors::mirrors;
use pardalis::camera::{ExactMirror, MirrorLookUp, Projection};

const POINTS: usize = 50_000;
const LANES: usize = 16;

/// Points that the mirror shows, from its surface to far away.
fn points(mirror: &ExactMirror<f64>) -> [Vec<f32>; 3] {
    let shown: Vec<_> = mirrors::points(mirror)
        .into_iter()
        .map(|[r, z]| [0.6 * r, -0.8 * r, z])
        .filter(|&point| mirror.project(point).1)
        .collect();
    [0, 1, 2].map(|axis| {
        let column = shown.iter().cycle().map(|point| point[axis] as f32);
        column.take(POINTS).collect()
    })
}

fn exact(mirror: &ExactMirror<f64>, [x, y, z]: &[Vec<f32>; 3], pixels: &mut [[f32; 2]]) {
    for (i, pixel) in pixels.iter_mut().enumerate() {
        let point = [x[i], y[i], z[i]].map(f64::from);
        *pixel = mirror.project(point).0.map(|v| v as f32);
    }
}

/// In blocks of lanes, as kernels do it.
fn looked_up(mirror: MirrorLookUp, [x, y, z]: &[Vec<f32>; 3], pixels: &mut [[f32; 2]]) {
    for (block, pixels) in pixels.chunks_exact_mut(LANES).enumerate() {
        let lanes = block * LANES..(block + 1) * LANES;
        let (x, y, z) = (&x[lanes.clone()], &y[lanes.clone()], &z[lanes]);
        let mut found = [[0.0; LANES]; 2];
        for lane in 0..LANES {
            let ([u, v], valid) = mirror.project([x[lane], y[lane], z[lane]]);
            found[0][lane] = if valid { u } else { -1.0 };
            found[1][lane] = if valid { v } else { -1.0 };
        }
        for lane in 0..LANES {
            pixels[lane] = [found[0][lane], found[1][lane]];
        }
    }
}

fn bench(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group(format!("{POINTS} points"));
    for (name, mirror) in mirrors() {
        if !["table", "sphere", "constant resolution with a tip"].contains(&name) {
            continue;
        }
        let points = points(&mirror);
        let mut pixels = vec![[0.0; 2]; POINTS];
        let mut expected = pixels.clone();
        exact(&mirror, &points, &mut expected);
        looked_up(mirror.to_f32(), &points, &mut pixels);
        let far = |(a, b): &(&[f32; 2], &[f32; 2])| (a[0] - b[0]).hypot(a[1] - b[1]) > 0.02;
        let unlike = pixels.iter().zip(&expected).filter(far).count();
        assert!(unlike < POINTS / 100, "{name}: {unlike} points differ");
        group.bench_function(format!("{name}, exact"), |bencher| {
            bencher.iter(|| exact(&mirror, black_box(&points), &mut pixels));
        });
        group.bench_function(format!("{name}, look-up"), |bencher| {
            bencher.iter(|| looked_up(mirror.to_f32(), black_box(&points), &mut pixels));
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
