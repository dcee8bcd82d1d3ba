//! Projection of points in double precision, as of NumPy arrays: `Camera::project_rows`, for comparison with the Python package.
//!
//! `cargo bench -p pardalis --bench rows -- FOLDER CALLS`, of `experiments/projection/measure.py`. The folder has `camera.toml`, a
//! calibration with a pose, and `points.f64`, rows of x, y and z in double precision. Writes the pixels into `pixels.f64`, and prints the least time of the
//! calls in ms.

#![allow(clippy::disallowed_methods)] // It measures time.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use pardalis::camera::Level;
use pardalis_scene::calibration;

fn numbers(file: &Path) -> Vec<f64> {
    let bytes = std::fs::read(file).unwrap();
    let (numbers, rest) = bytes.as_chunks();
    assert!(rest.is_empty(), "{}", file.display());
    numbers.iter().copied().map(f64::from_le_bytes).collect()
}

fn main() {
    // Cargo adds its own.
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(|word| &**word).collect();
    let words: Vec<&str> = words
        .into_iter()
        .filter(|word| *word != "--bench")
        .collect();
    let [folder, calls] = words[..] else {
        println!(
            "rows: give the folder and the number of calls; experiments/projection/measure.py does"
        );
        return;
    };
    let folder = Path::new(folder);
    let text = std::fs::read_to_string(folder.join("camera.toml")).unwrap();
    let [camera] = &calibration::read(&text, None).unwrap()[..] else {
        panic!("camera.toml has several cameras");
    };
    let camera_from_world = camera.world_from_camera.unwrap().inverse();
    let points_m = numbers(&folder.join("points.f64"));
    let (points_m, _) = points_m.as_chunks::<3>();
    let mut pixels = vec![[0.0; 2]; points_m.len()];
    let mut least_ms = f64::INFINITY;
    for _ in 0..calls.parse().unwrap() {
        let begin = Instant::now();
        let points_m = black_box(points_m);
        let lens = &camera.camera;
        lens.project_rows(Level::best(), &camera_from_world, points_m, &mut pixels);
        black_box(&mut pixels);
        least_ms = least_ms.min(1e3 * begin.elapsed().as_secs_f64());
    }
    let bytes: Vec<u8> = pixels
        .as_flattened()
        .iter()
        .flat_map(|c| c.to_le_bytes())
        .collect();
    std::fs::write(folder.join("pixels.f64"), bytes).unwrap();
    println!("{least_ms}");
}
