//! More pixels and more cameras never make the estimate of a detected target worse.

use std::fs;
use std::path::Path;

use crate::common::Run;
use serde_json::Value;

/// A ball between four cameras with images of 80 x 60 pixels times `factor`.
fn world(factor: u32) -> String {
    let (width, height) = (80 * factor, 60 * factor);
    let center = [width, height].map(|side| 0.5 * f64::from(side - 1));
    format!(
        "seed = 3
duration_s = 0.8
training_stills = 4
[ring]
count = 4
center_m = [0.5, 0.5, 0.15]
radius_m = 0.6
height_m = 0.2
size_px = [{width}, {height}]
model.pinhole = {{ f_px = [{width}, {width}], center_px = {center:?} }}
[timing]
fps = 25
[image]
instants = 1
shutter_s = 0.002
blur_px = 0.6
read_noise = 2.0
[ground]
texture.checker = {{ size_m = 0.2, colors_srgb = [[90, 90, 80], [140, 140, 130]] }}
[objects.ball]
target = true
shape.sphere.radius_m = 0.035
color_srgb = [225, 70, 130]
path.circle = {{ center_m = [0.5, 0.5, 0.15], radius_m = 0.12, period_s = 2 }}
"
    )
}

/// Returns the scene with only the first cameras and without any setting of the target.
fn with_cameras(scene: &str, count: usize) -> String {
    let (cameras, _) = scene.split_once("[targets.ball]").unwrap();
    let parts: Vec<&str> = cameras.split_inclusive("[cameras.").collect();
    assert_eq!(parts.len(), 5, "{scene}");
    let kept = parts[..=count].concat();
    let kept = kept.strip_suffix("[cameras.").unwrap_or(&kept);
    format!(
        "{kept}\n[targets.ball]\nshape.sphere.radius_m = 0.035\ncolors = \"ball.colors.toml\"\n"
    )
}

fn pardalis(folder: &Path, arguments: &[&str]) -> String {
    let run = Run::pardalis(folder, arguments);
    assert_eq!(run.code, Some(0), "{arguments:?}: {}", run.stderr);
    run.stdout
}

/// Returns root mean square errors in metres with one, two and four cameras.
fn errors_m(factor: u32) -> [f64; 3] {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    fs::write(folder.join("world.toml"), world(factor)).unwrap();
    pardalis(folder, &["simulate", "world.toml", "-o", "seen"]);
    let scene = fs::read_to_string(folder.join("seen/scene.toml")).unwrap();
    [1, 2, 4].map(|cameras| {
        fs::write(folder.join("seen/few.toml"), with_cameras(&scene, cameras)).unwrap();
        pardalis(
            folder,
            &["track", "seen/few.toml", "-o", "out", "--no-plots"],
        );
        let figures = pardalis(folder, &["evaluate", "out", "seen", "--json", "-"]);
        let figures: Value = serde_json::from_str(&figures).unwrap();
        let target = &figures["targets"][0];
        assert!(
            target["coverage"].as_f64().unwrap() >= 0.9,
            "{cameras} cameras"
        );
        target["all"]["errors"]["position_m"]["rmse"]
            .as_f64()
            .unwrap()
    })
}

#[test]
fn errors_fall_with_every_camera_and_with_smaller_pixels() {
    let [coarse, fine] = [1, 2].map(errors_m);
    println!("{coarse:?} {fine:?}");
    for few_to_many in [coarse, fine] {
        assert!(few_to_many.is_sorted_by(|a, b| a > b), "{few_to_many:?}");
    }
    for (coarse, fine) in coarse.into_iter().zip(fine) {
        assert!(
            fine < coarse,
            "{fine} m with smaller pixels, {coarse} m before"
        );
    }
}
