//! What follows the ball: the program, or OpenCV's usual tracker for comparison.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process;
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use serde::Deserialize;

use super::clip::{Clip, Images, Label, call};
use super::score::Estimate;

/// The shape of the labels that the program learns from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Labels {
    Circles,
    Rectangles,
}

impl Labels {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Circles => "circles",
            Self::Rectangles => "rectangles",
        }
    }
}

/// The command that looks for the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Command {
    Track,
    /// In each frame by itself.
    Locate,
}

/// The estimates of a run by frame, and its speed in frames per second of wall time.
pub(crate) struct Tracked {
    pub(crate) estimates: BTreeMap<u32, Estimate>,
    pub(crate) fps: f64,
}

/// Runs `pardalis learn`; writes `target.colors.toml` into `work`.
pub(crate) fn learn(
    binary: &Path,
    images: &Images,
    labels: &[Label],
    shape: Labels,
    work: &Path,
) -> Result<()> {
    let mut command = process::Command::new(binary);
    command.arg("learn");
    for label in labels {
        command.arg("--image").arg(images.frame(label.frame, work)?);
        match shape {
            Labels::Circles => command.args(["--polygon", &label.polygon(images)]),
            Labels::Rectangles => command.args(["--rect", &label.rectangle(images)]),
        };
    }
    command.arg("-o").arg(work.join("target.colors.toml"));
    call(command.arg("--no-pictures"))?;
    Ok(())
}

/// Runs `pardalis init` and a command with default settings and a guessed pinhole camera.
pub(crate) fn find(
    (binary, command): (&Path, Command),
    clip: &Clip,
    images: &Images,
    radius_m: f64,
    work: &Path,
) -> Result<Tracked> {
    let scene = work.join("scene.toml");
    let mut init = process::Command::new(binary);
    init.arg("init").arg(&images.source);
    init.args(["--camera", "pinhole", "--target", "ball", "--force"]);
    init.arg("--colors").arg(work.join("target.colors.toml"));
    init.args(["--radius-m", &radius_m.to_string()]);
    if images.is_folder() {
        init.args(["--fps", &clip.fps.to_string()]);
    }
    call(init.arg("-o").arg(&scene))?;
    let mut find = process::Command::new(binary);
    match command {
        Command::Track => find.arg("track").arg(&scene).arg("--no-plots"),
        Command::Locate => find.arg("locate").arg(&scene),
    };
    let seconds = timed(find.arg("-o").arg(work.join("tracks")))?;
    let camera = Pinhole::of_scene(&scene)?;
    let rows = read_rows(&work.join("tracks/tracks.csv"))?;
    let estimates = rows
        .iter()
        .filter(|row| row.state == "tracking")
        .filter_map(|row| Some((row.frame, camera.estimate(row, radius_m, images)?)))
        .collect();
    Ok(Tracked {
        estimates,
        fps: rows.len() as f64 / seconds,
    })
}

/// Runs a Python script that follows the ball with OpenCV; it has no confidence.
pub(crate) fn opencv(
    python: &Path,
    script: &Path,
    images: &Images,
    labels: &[Label],
    work: &Path,
) -> Result<Tracked> {
    let circles = work.join("circles.csv");
    let mut writer = csv::Writer::from_path(&circles)?;
    writer.write_record(["frame", "u_px", "v_px", "radius_px"])?;
    for label in labels {
        let [u_px, v_px] = images.scaled([label.u_px, label.v_px]);
        let radius_px = label.radius_px * images.factor[0];
        writer.serialize((label.frame, u_px, v_px, radius_px))?;
    }
    writer.flush()?;
    let found = work.join("found.csv");
    let mut command = process::Command::new(python);
    command.arg(script).arg(&images.source).arg(&circles);
    let printed = call(command.arg(&found))?;
    let fps = printed
        .trim()
        .parse()
        .context("the script's frames per second")?;
    let mut estimates = BTreeMap::new();
    for row in csv::Reader::from_path(&found)?.deserialize() {
        let circle: Label = row?;
        let centre_px = images.unscaled([circle.u_px, circle.v_px]);
        let radius_px = circle.radius_px / images.factor[0];
        let estimate = Estimate {
            centre_px,
            image_centre_px: centre_px,
            radius_px,
            image_radius_px: radius_px,
            confidence: None,
        };
        estimates.insert(circle.frame, estimate);
    }
    Ok(Tracked { estimates, fps })
}

/// Runs a command and returns the seconds that it took, with starting and decoding.
#[expect(
    clippy::disallowed_methods,
    reason = "measures the program from outside"
)]
fn timed(command: &mut process::Command) -> Result<f64> {
    let start = Instant::now();
    call(command)?;
    Ok(start.elapsed().as_secs_f64())
}

#[derive(Deserialize)]
struct Row {
    frame: u32,
    state: String,
    x_m: Option<f64>,
    y_m: Option<f64>,
    z_m: Option<f64>,
    confidence: Option<f64>,
}

fn read_rows(path: &Path) -> Result<Vec<Row>> {
    let mut reader = csv::Reader::from_path(path).with_context(|| path.display().to_string())?;
    let rows: Result<Vec<Row>, _> = reader.deserialize().collect();
    rows.with_context(|| path.display().to_string())
}

/// The only camera of a scene, as `init --camera pinhole` guesses it.
struct Pinhole {
    f_px: [f64; 2],
    center_px: [f64; 2],
    world_from_camera: [[f64; 4]; 4],
}

impl Pinhole {
    fn of_scene(path: &Path) -> Result<Self> {
        #[derive(Deserialize)]
        struct Scene {
            cameras: BTreeMap<String, Camera>,
        }
        #[derive(Deserialize)]
        struct Camera {
            model: Models,
            world_from_camera: [[f64; 4]; 4],
        }
        #[derive(Deserialize)]
        struct Models {
            pinhole: Model,
        }
        #[derive(Deserialize)]
        struct Model {
            f_px: [f64; 2],
            center_px: [f64; 2],
            #[serde(default)]
            distortion: Vec<f64>,
        }
        let text = fs::read_to_string(path)?;
        let scene: Scene = toml::from_str(&text).with_context(|| path.display().to_string())?;
        let camera = scene.cameras.into_values().next();
        let camera = camera.ok_or_else(|| anyhow!("{}: no camera", path.display()))?;
        let model = camera.model.pinhole;
        if model.distortion.iter().any(|&k| k != 0.0) {
            bail!(
                "{}: a camera without distortion is expected",
                path.display()
            );
        }
        Ok(Self {
            f_px: model.f_px,
            center_px: model.center_px,
            world_from_camera: camera.world_from_camera,
        })
    }

    /// Projects a sphere; `None` if the row has no position or one that is not wholly in front of the camera.
    ///
    /// A sphere of half-angle a at an angle t from the axis is seen as an ellipse whose middle lies
    /// f sin t cos t / D from the principal point, with D = cos² t - sin² a, and whose semi-axes are
    /// f sin a cos a / D along that direction and f sin a / √D across it.
    fn estimate(&self, row: &Row, radius_m: f64, images: &Images) -> Option<Estimate> {
        let world = [row.x_m?, row.y_m?, row.z_m?];
        let pose = &self.world_from_camera;
        let [x, y, z] = [0, 1, 2].map(|k| {
            (0..3)
                .map(|j| pose[j][k] * (world[j] - pose[j][3]))
                .sum::<f64>()
        });
        let square: f64 = x * x + y * y + z * z;
        let sin2_a = radius_m * radius_m / square;
        let cos2_t = z * z / square;
        let difference = cos2_t - sin2_a;
        if z <= 0.0 || difference <= 0.0 {
            return None;
        }
        let pixel = |stretch: f64| {
            let [f_u, f_v] = self.f_px;
            let [c_u, c_v] = self.center_px;
            images.unscaled([f_u * x / z * stretch + c_u, f_v * y / z * stretch + c_v])
        };
        let f_px = self.f_px[0] / images.factor[0];
        let along_px = f_px * (sin2_a * (1.0 - sin2_a)).sqrt() / difference;
        let across_px = f_px * (sin2_a / difference).sqrt();
        Some(Estimate {
            centre_px: pixel(1.0),
            image_centre_px: pixel(cos2_t / difference),
            radius_px: f_px * (sin2_a / (1.0 - sin2_a)).sqrt(),
            image_radius_px: (along_px * across_px).sqrt(),
            confidence: row.confidence,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_project_to_the_ellipse_of_their_tangents() {
        let camera = Pinhole {
            f_px: [400.0; 2],
            center_px: [160.0, 120.0],
            // Looks along x of the world from a height of 1 m.
            world_from_camera: [
                [0.0, 0.0, 1.0, 0.0],
                [-1.0, 0.0, 0.0, 0.0],
                [0.0, -1.0, 0.0, 1.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
        };
        let clip = Clip {
            size_px: [640, 480],
            fps: 30.0,
            radius_m: 0.1,
        };
        let folder = tempfile::tempdir().unwrap();
        let images = Images::of_folder(&clip, folder.path().to_owned(), 0.5).unwrap();
        let row = |y_m: f64| Row {
            frame: 0,
            state: "tracking".to_owned(),
            x_m: Some(1.0),
            y_m: Some(y_m),
            z_m: Some(1.0),
            confidence: Some(0.5),
        };
        let (angle, half) = (0.5_f64, 0.1_f64);
        let radius_m = half.sin() / angle.cos();
        let seen = camera
            .estimate(&row(-angle.tan()), radius_m, &images)
            .unwrap();
        // Full size: f is 800 px, the principal point 320.5 and 240.5.
        let (low, high) = (800.0 * (angle - half).tan(), 800.0 * (angle + half).tan());
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        close(seen.centre_px[0], 320.5 + 800.0 * angle.tan());
        close(seen.image_centre_px[0], 320.5 + f64::midpoint(low, high));
        close(seen.image_centre_px[1], 240.5);
        close(seen.radius_px, 800.0 * half.tan());
        let across = 800.0 * half.sin() / (angle.cos().powi(2) - half.sin().powi(2)).sqrt();
        close(seen.image_radius_px, ((high - low) / 2.0 * across).sqrt());
        // The camera inside the sphere, or a sphere that reaches behind it, has no outline.
        assert!(camera.estimate(&row(0.0), 1.5, &images).is_none());
        assert!(camera.estimate(&row(5.0), 1.5, &images).is_none());
    }
}
