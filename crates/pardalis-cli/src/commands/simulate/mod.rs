//! `pardalis simulate`: images of a synthetic world, with ground truth.

mod detections;
mod frames;
mod scene_text;
mod tables;
mod training;

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_scene::WorldConfig;
use pardalis_simulate::{Delivery, World};

use crate::arguments::Threads;
use crate::folder::{Content, Folder};
use crate::output::{Shown, print};
use crate::progress::Progress;
use crate::scene::problems_in;
use crate::scene_files::{read_calibration, read_text};
use crate::user_error::user_error;

/// Renders images of a synthetic world, with ground truth
///
/// Reads a world file (objects with colours and paths, light, floor, and cameras of any model, with clocks and
/// faults) and writes a sequence: the images of each camera with times.csv, truth.csv, the cameras, a scene that
/// tracks the targets, and their colour models, learnt from stills in different light. The same file and seed give
/// the same bytes.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis simulate data/worlds/ring.toml -o ring
  pardalis track ring/scene.toml -o ring-tracks && pardalis evaluate ring-tracks ring

Times in truth.csv are the true exposure times. If the cameras have clocks of their own or wrong time stamps, use
`pardalis evaluate --interpolate`.")]
pub(crate) struct Arguments {
    /// The world file
    #[arg(value_name = "WORLD.toml")]
    world: PathBuf,
    /// The folder for the sequence [default: the world's name]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// Overrides the world's seed
    #[arg(long)]
    seed: Option<u32>,
    #[command(flatten)]
    threads: Threads,
    /// Replaces an earlier simulated sequence
    #[arg(long)]
    force: bool,
}

/// The contents of a sequence's folder.
const CONTENT: Content = Content {
    mark: "simulated.txt",
    text: "Written by pardalis simulate, whose --force replaces this folder unless it contains other files.\n",
    what: "a simulated sequence",
    entries: &[
        "frames",
        "training",
        "detections",
        "truth.csv",
        "cameras.toml",
        "cameras.json",
        "scene.toml",
        "world.toml",
        // Used by experiments.
        "fingerprint.txt",
    ],
};

/// A world and the images that its cameras deliver.
pub(crate) struct Sequence {
    /// The world file.
    path: PathBuf,
    /// Its text, preceded by comments about replaced settings.
    text: String,
    config: WorldConfig,
    /// For each camera, in the order of its frames.
    deliveries: Vec<Vec<Delivery>>,
}

/// Runs the command. The folder appears when everything is written; after a failure the previous one is intact.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.world;
    let mut replaced = toml::Table::new();
    if let Some(seed) = arguments.seed {
        replaced.insert("seed".to_owned(), i64::from(seed).into());
    }
    let output = match &arguments.output {
        Some(output) => output.clone(),
        None => PathBuf::from(path.file_stem().unwrap_or_default()),
    };
    let pool = arguments.threads.start()?;
    let sequence = Sequence::read(path, &replaced)?;
    let progress = Progress::new("simulating", Some(sequence.image_count()));
    pool.install(|| sequence.write(&output, arguments.force, &progress))?;
    print(sequence.summary(&output));
    Ok(())
}

impl Sequence {
    /// Reads and checks a world file with some settings replaced: full keys, such as `ring.count`, with their values.
    pub(crate) fn read(path: &Path, replaced: &toml::Table) -> Result<Self> {
        let text = read_text(path)?;
        let home = path.parent().unwrap_or(Path::new(""));
        let read = |file: &str, lens| read_calibration(home, file, lens);
        let config = WorldConfig::parse_with(&text, replaced, &read)
            .map_err(|problems| problems_in("world", path, &problems))?;
        let comments = replaced
            .iter()
            .map(|(key, value)| format!("# Simulated with {key} = {value}\n"));
        let text = comments.collect::<String>() + &text;
        let World {
            seed,
            cameras,
            duration_s,
            ..
        } = &config.world;
        let deliveries: Vec<_> = cameras
            .iter()
            .zip(0..)
            .map(|(camera, number)| camera.timing.deliveries(*seed, number, *duration_s))
            .collect();
        let silent = cameras.iter().zip(&deliveries).find(|(_, d)| d.is_empty());
        if let Some((camera, _)) = silent {
            return Err(user_error!(
                "{}: camera {} delivers no image within duration_s = {duration_s}; increase duration_s, or drop fewer images",
                path.shown(),
                camera.name
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            text,
            config,
            deliveries,
        })
    }

    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// Returns the number of images, including the stills for learning colours.
    pub(crate) fn image_count(&self) -> usize {
        let frames: usize = self.deliveries.iter().map(Vec::len).sum();
        if self.config.detector.is_some() {
            return frames;
        }
        frames + self.config.training_stills
    }

    /// Writes everything into a folder; with `force`, replaces an earlier simulated sequence.
    pub(crate) fn write(&self, output: &Path, force: bool, progress: &Progress) -> Result<()> {
        let world = self.world();
        let folder = Folder::begin(&CONTENT, output, force)?;
        for camera in 0..world.cameras.len() {
            frames::write(self, camera, &folder, progress)?;
        }
        folder.write("truth.csv", tables::truth(self).as_bytes())?;
        tables::write_cameras(world, &folder)?;
        tables::write_platforms(world, &folder)?;
        if let Some(detector) = &self.config.detector {
            detections::write(self, detector, &folder)?;
        } else if self.config.training_stills > 0 {
            training::write(self, &folder, progress)?;
        }
        folder.write("scene.toml", scene_text::of(self).as_bytes())?;
        folder.write("world.toml", self.text.as_bytes())?;
        folder.finish()
    }

    fn world(&self) -> &World {
        &self.config.world
    }

    /// Returns a summary of the written sequence as text.
    fn summary(&self, output: &Path) -> String {
        use std::fmt::Write as _;
        let world = self.world();
        let mut text = format!("{}: {} s of", output.shown(), world.duration_s);
        for (camera, deliveries) in world.cameras.iter().zip(&self.deliveries) {
            let frozen = deliveries.iter().filter(|d| d.shown.1 != d.time_s).count();
            let broken = deliveries.iter().filter(|d| d.is_broken).count();
            let _ = write!(text, "\n  {}: {} images", camera.name, deliveries.len());
            for (count, what) in [(frozen, "frozen"), (broken, "broken")] {
                if count > 0 {
                    let _ = write!(text, ", {count} {what}");
                }
            }
        }
        let _ = write!(
            text,
            "\nNext:\n  pardalis track {0}/scene.toml -o {0}-tracks\n  pardalis evaluate {0}-tracks {0}",
            output.shown()
        );
        text
    }
}
