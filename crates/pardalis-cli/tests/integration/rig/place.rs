//! A folder with the four cameras of data/webcams-four, which tests may damage.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::common::run::{Run, rows_in};

/// Number of frames of each camera.
pub(crate) const FRAMES: usize = 120;

/// Frames per second.
pub(crate) const FPS: f64 = 25.0;

const TARGET: &str = r#"[targets.ball]
shape.sphere.radius_m = 0.035
colors = "ball.toml"
filter = { particles = 1000 }
motion.constant_velocity.acceleration_density_m2ps3 = 5
[targets.ball.start.gaussian]
position_m = [0.47, 0.45, 0.15]
position_sigma_m = 0.02
"#;

/// The folder: `cam1` to `cam4` with images and times.csv, and calibration, colours and the scene.
pub(crate) struct Rig {
    folder: tempfile::TempDir,
    /// Settings of each camera.
    settings: RefCell<BTreeMap<&'static str, String>>,
}

fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data")
}

impl Rig {
    /// The cameras.
    pub(crate) const CAMERAS: [&str; 4] = ["cam1", "cam2", "cam3", "cam4"];

    /// Creates the folder with four working cameras.
    pub(crate) fn new() -> Self {
        let rig = Self {
            folder: tempfile::tempdir().unwrap(),
            settings: RefCell::default(),
        };
        for camera in Self::CAMERAS {
            fs::create_dir(rig.path(camera)).unwrap();
            rig.deliver(camera, |place| place);
            rig.edit(camera, "");
        }
        let copy = |from: &str, to: &str| fs::copy(data().join(from), rig.path(to)).unwrap();
        copy("webcams-four/cameras.json", "cameras.json");
        copy("colors/pink-ball.hsi.colors.toml", "ball.toml");
        rig
    }

    /// Returns the path of a file in the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the path of an image of a camera.
    pub(crate) fn image(&self, camera: &str, place: usize) -> PathBuf {
        self.path(&format!("{camera}/{place:06}.jpg"))
    }

    /// Makes a camera deliver at each index the frame with the returned index, with its time.
    pub(crate) fn deliver(&self, camera: &str, frame_at: impl Fn(usize) -> usize) {
        for place in 0..FRAMES {
            let name = format!("webcams-four/frames/{camera}/{:06}.jpg", frame_at(place));
            fs::copy(data().join(name), self.image(camera, place)).unwrap();
        }
        self.times(camera, false, |place| (frame_at(place) as f64 / FPS, 0.0));
    }

    /// Writes a camera's times.csv: the time stamp of each image and, optionally, its arrival.
    pub(crate) fn times(
        &self,
        camera: &str,
        arrivals: bool,
        times_s: impl Fn(usize) -> (f64, f64),
    ) {
        let mut text = if arrivals {
            "frame,time_s,arrival_s\n"
        } else {
            "frame,time_s\n"
        }
        .to_owned();
        for place in 0..FRAMES {
            let (time_s, arrival_s) = times_s(place);
            let _ = if arrivals {
                writeln!(text, "{place},{time_s},{arrival_s}")
            } else {
                writeln!(text, "{place},{time_s}")
            };
        }
        fs::write(self.path(&format!("{camera}/times.csv")), text).unwrap();
    }

    /// Makes a camera repeat the image before these.
    pub(crate) fn freeze(&self, camera: &str, places: Range<usize>) {
        let last = self.image(camera, places.start - 1);
        for place in places {
            fs::copy(&last, self.image(camera, place)).unwrap();
        }
    }

    /// Removes these images of a camera.
    pub(crate) fn remove(&self, camera: &str, places: Range<usize>) {
        for place in places {
            fs::remove_file(self.image(camera, place)).unwrap();
        }
    }

    /// Sets the frame rate of all cameras to 25 frames per second in the scene.
    pub(crate) fn by_fps(&self) {
        for camera in Self::CAMERAS {
            fs::remove_file(self.path(&format!("{camera}/times.csv"))).unwrap();
            self.edit(camera, "fps = 25\n");
        }
    }

    /// Adds settings to a camera's images and calibration.
    pub(crate) fn edit(&self, camera: &'static str, settings: &str) {
        let table = format!("images = \"{camera}\"\ncalibration = \"cameras.json\"\n{settings}");
        self.settings.borrow_mut().insert(camera, table);
    }

    /// Replaces the table of a camera.
    pub(crate) fn replace(&self, camera: &'static str, table: &str) {
        self.settings.borrow_mut().insert(camera, table.to_owned());
    }

    /// Removes a camera from the scene.
    pub(crate) fn leave_out(&self, camera: &str) {
        self.settings.borrow_mut().remove(camera);
    }

    /// Returns the scene, with additional tables before its cameras.
    pub(crate) fn scene(&self, before: &str) -> String {
        self.cameras(before) + TARGET
    }

    /// Returns the cameras of the scene, with additional tables before them.
    fn cameras(&self, before: &str) -> String {
        let mut scene = before.to_owned();
        for (camera, table) in self.settings.borrow().iter() {
            let _ = write!(scene, "[cameras.{camera}]\n{table}");
        }
        scene
    }

    /// Tracks a ball with these settings and no start, with results in the folder `out`.
    pub(crate) fn track_ball(&self, settings: &str) -> Run {
        let scene = self.cameras("") + "[targets.ball]\n" + settings;
        Run::of(&mut self.command(&scene, &["-o", "out", "--no-plots"]))
    }

    /// Returns the command `pardalis track` in the folder.
    pub(crate) fn command(&self, scene: &str, arguments: &[&str]) -> Command {
        fs::write(self.path("scene.toml"), scene).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
        command.current_dir(self.folder.path());
        command.args(["track", "scene.toml"]).args(arguments);
        command
    }

    /// Tracks, with results in the folder `out`.
    pub(crate) fn track(&self, before: &str) -> Run {
        self.track_with(before, &["-o", "out", "--no-plots"])
    }

    /// Tracks.
    pub(crate) fn track_with(&self, before: &str, arguments: &[&str]) -> Run {
        Run::of(&mut self.command(&self.scene(before), arguments))
    }

    /// out/tracks.csv.
    pub(crate) fn tracks(&self) -> String {
        fs::read_to_string(self.path("out/tracks.csv")).unwrap()
    }

    /// out/summary.json.
    pub(crate) fn summary(&self) -> Value {
        serde_json::from_slice(&fs::read(self.path("out/summary.json")).unwrap()).unwrap()
    }

    /// Returns the counts of a camera's frames in the summary after checking that they add up.
    pub(crate) fn frames(&self, camera: &str) -> Value {
        let frames = self.summary()["cameras"][camera]["frames"].clone();
        let count = |key: &str| frames[key].as_u64().unwrap();
        let parts = [
            "used",
            "frozen",
            "dropped_late",
            "overtaken",
            "repeated",
            "broken",
        ];
        let sum: u64 = parts.into_iter().map(count).sum();
        assert_eq!(sum, count("delivered"), "{frames}");
        frames
    }

    /// Checks the estimates in out/tracks.csv against the truth: an error within a third of the ball's radius overall.
    pub(crate) fn assert_followed(&self) {
        self.assert_followed_within(0.012);
    }

    /// Checks that the error is at most `bound_m` overall, and twice that at the end.
    pub(crate) fn assert_followed_within(&self, bound_m: f64) {
        let truth = fs::read_to_string(data().join("webcams-four/truth.csv")).unwrap();
        let true_m: Vec<[f64; 3]> = truth
            .lines()
            .map(|line| line.split(',').collect::<Vec<_>>())
            .filter(|row| row[3] == "cam1")
            .map(|row| [4, 5, 6].map(|column| row[column].parse().unwrap()))
            .collect();
        let rows = rows_in(&self.tracks());
        let mut squares_m2 = Vec::new();
        for row in &rows {
            let time_s: f64 = row[1].parse().unwrap();
            let frame = (time_s * FPS).round() as usize;
            assert!((time_s - frame as f64 / FPS).abs() < 1e-6, "{time_s}");
            let found_m: [f64; 3] = [4, 5, 6].map(|column| row[column].parse().unwrap());
            let square = |axis: usize| (found_m[axis] - true_m[frame][axis]).powi(2);
            squares_m2.push((0..3).map(square).sum::<f64>());
        }
        assert_eq!(rows.len(), FRAMES);
        let rmse_m = (squares_m2.iter().sum::<f64>() / rows.len() as f64).sqrt();
        let last_m = squares_m2[rows.len() - 1].sqrt();
        println!("rmse {:.2} mm, last {:.2} mm", 1e3 * rmse_m, 1e3 * last_m);
        assert!(
            rmse_m < bound_m && last_m < 2.0 * bound_m,
            "{rmse_m} {last_m}"
        );
    }
}
