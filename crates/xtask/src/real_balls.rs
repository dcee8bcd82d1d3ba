//! The experiments on real clips of balls (`experiments/real-balls` and `experiments/locate`): `pardalis measure` compares
//! positions in metres, but the truth of these clips is circles in the image.

mod bands;
mod clip;
mod methods;
mod score;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};

use bands::Bands;
use clip::{Images, read_clips, read_labels};
use methods::{Command, Labels, Tracked};
use score::{Figures, read_truth, score};

pub(crate) const USAGE: &str = "\
Usage: cargo xtask real-balls [OPTIONS]

  --binary PATH             the program [default: target/release/pardalis]
  --clips A,B               clips of data/real-balls [default: all]
  --scales 1,0.5            sizes of the images [default: 1,0.5,0.25]
  --radius-factors 0.25,1   factors of the assumed radius [default: 0.25,1,4]
  --labels circles,rectangles   shapes of the three labels [default: circles]
  --locate                  look for the ball in each frame by itself, with `pardalis locate` in place of `track`
  --opencv PYTHON           also run OpenCV's usual tracker with this Python
  --frames FOLDER           images in FOLDER/CLIP, scaled before, in place of the videos; needs one scale and no ffmpeg
  --record FILE.csv         write a row for each run
  --verify                  fail if a figure is outside the bands.toml of experiments/real-balls, or of experiments/locate";

/// What the command line says.
struct Options {
    binary: PathBuf,
    clips: Vec<String>,
    scales: Vec<f64>,
    radius_factors: Vec<f64>,
    labels: Vec<Labels>,
    command: Command,
    opencv: Option<PathBuf>,
    frames: Option<PathBuf>,
    record: Option<PathBuf>,
    verify: bool,
}

impl Options {
    fn parse(root: &Path, words: &[&str]) -> Result<Self> {
        let mut options = Self {
            binary: root.join("target/release/pardalis"),
            clips: Vec::new(),
            scales: vec![1.0, 0.5, 0.25],
            radius_factors: vec![0.25, 1.0, 4.0],
            labels: vec![Labels::Circles],
            command: Command::Track,
            opencv: None,
            frames: None,
            record: None,
            verify: false,
        };
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            if word == "--verify" {
                options.verify = true;
                continue;
            }
            if word == "--locate" {
                options.command = Command::Locate;
                continue;
            }
            let value = words
                .next()
                .ok_or_else(|| anyhow!("{word}: unknown, or without a value\n\n{USAGE}"))?;
            match word {
                "--binary" => options.binary = std::path::absolute(value)?,
                "--clips" => options.clips = value.split(',').map(str::to_owned).collect(),
                "--scales" => options.scales = numbers(word, value)?,
                "--radius-factors" => options.radius_factors = numbers(word, value)?,
                "--labels" => {
                    let shape = |name| match name {
                        "circles" => Ok(Labels::Circles),
                        "rectangles" => Ok(Labels::Rectangles),
                        _ => Err(anyhow!("--labels {name}: allowed: circles, rectangles")),
                    };
                    options.labels = value.split(',').map(shape).collect::<Result<_>>()?;
                }
                "--opencv" => options.opencv = Some(std::path::absolute(value)?),
                "--frames" => options.frames = Some(std::path::absolute(value)?),
                "--record" => options.record = Some(std::path::absolute(value)?),
                _ => bail!("{word}: no such option\n\n{USAGE}"),
            }
        }
        if options.frames.is_some() && options.scales.len() != 1 {
            bail!("--frames needs one scale, that of its images");
        }
        Ok(options)
    }
}

fn numbers(option: &str, text: &str) -> Result<Vec<f64>> {
    let number = |word: &str| match word.parse() {
        Ok(value) if value > 0.0 => Ok(value),
        _ => Err(anyhow!("{option} {word}: allowed: positive numbers")),
    };
    text.split(',').map(number).collect()
}

/// A scored run.
struct Run {
    clip: String,
    scale: f64,
    /// The shape of the labels, or `OpenCV`.
    method: &'static str,
    /// `None` for OpenCV, which knows no sizes.
    radius_factor: Option<f64>,
    figures: Figures,
}

impl Run {
    fn new(
        clip: &str,
        scale: f64,
        method: &'static str,
        radius_factor: Option<f64>,
        truth: &score::Truth,
        tracked: &Tracked,
    ) -> Self {
        let mut figures = score(truth, &tracked.estimates);
        figures.push(("fps", Some(tracked.fps)));
        Self {
            clip: clip.to_owned(),
            scale,
            method,
            radius_factor,
            figures,
        }
    }

    /// Names the run in tables.
    fn name(&self) -> String {
        let size = match self.scale {
            1.0 => "full size".to_owned(),
            0.5 => "half size".to_owned(),
            0.25 => "quarter size".to_owned(),
            scale => format!("scale {scale}"),
        };
        format!("{}, {size}, {}", self.clip, self.method)
    }
}

/// Runs the experiment with the words of the command line.
pub(crate) fn run(root: &Path, words: &[&str]) -> Result<()> {
    let options = Options::parse(root, words)?;
    let experiment = match options.command {
        Command::Track => root.join("experiments/real-balls"),
        Command::Locate => root.join("experiments/locate"),
    };
    let bands = if options.verify {
        Some(Bands::read(&experiment.join("bands.toml"))?)
    } else {
        None
    };
    let runs = measure(root, &options)?;
    if let Some(record) = &options.record {
        fs::write(record, table(&runs)?).with_context(|| record.display().to_string())?;
    }
    let Some(bands) = bands else { return Ok(()) };
    let violations: Vec<String> = runs
        .iter()
        .filter_map(|run| Some((run, run.radius_factor?)))
        .flat_map(|(run, factor)| {
            bands.violations(&run.clip, run.method, run.scale, factor, &run.figures)
        })
        .collect();
    if !violations.is_empty() {
        bail!("outside the bands:\n{}", violations.join("\n"));
    }
    println!("{} runs are within their bands", runs.len());
    Ok(())
}

/// Makes and scores all runs, and prints a line for each.
fn measure(root: &Path, options: &Options) -> Result<Vec<Run>> {
    let data = root.join("data/real-balls");
    let clips = read_clips(&data)?;
    let names: Vec<&String> = match &options.clips[..] {
        [] => clips.keys().collect(),
        names => names.iter().collect(),
    };
    let script = root.join("experiments/real-balls/opencv/track.py");
    let mut runs: Vec<Run> = Vec::new();
    let mut keep = |run: Run| {
        println!("{}", line(&run));
        runs.push(run);
    };
    for name in names {
        let clip = clips
            .get(name)
            .ok_or_else(|| anyhow!("{name}: no such clip in {}", data.display()))?;
        let folder = data.join(name);
        let truth = read_truth(&folder.join("truth.csv"))?;
        let labels = read_labels(&folder.join("labels.csv"))?;
        for &scale in &options.scales {
            let kind = if options.frames.is_some() {
                "-frames"
            } else {
                ""
            };
            let work = root.join(format!("target/real-balls/{name}-{scale}{kind}"));
            fs::create_dir_all(&work)?;
            let images = match &options.frames {
                Some(frames) => Images::of_folder(clip, frames.join(name), scale)?,
                None => Images::of_video(clip, &folder.join("clip.mp4"), scale, &work)?,
            };
            for &shape in &options.labels {
                methods::learn(&options.binary, &images, &labels, shape, &work)?;
                for &factor in &options.radius_factors {
                    let radius_m = clip.radius_m * factor;
                    let tracked = methods::find(
                        (&options.binary, options.command),
                        clip,
                        &images,
                        radius_m,
                        &work,
                    )?;
                    let method = shape.name();
                    keep(Run::new(
                        name,
                        scale,
                        method,
                        Some(factor),
                        &truth,
                        &tracked,
                    ));
                }
            }
            if let Some(python) = &options.opencv {
                let tracked = methods::opencv(python, &script, &images, &labels, &work)?;
                keep(Run::new(name, scale, "OpenCV", None, &truth, &tracked));
            }
        }
    }
    Ok(runs)
}

/// The figures that are printed while runs are made.
const PRINTED: [&str; 8] = [
    "on_ball_share",
    "wrong_share",
    "centre_error_radii",
    "image_centre_error_radii",
    "radius_ratio",
    "image_radius_ratio",
    "confidence_right",
    "fps",
];

fn line(run: &Run) -> String {
    let mut line = run.name();
    if let Some(factor) = run.radius_factor {
        let _ = write!(line, ", radius x {factor}");
    }
    line.push(':');
    for (name, value) in &run.figures {
        if PRINTED.contains(name) {
            let value = value.map_or_else(|| "-".to_owned(), |v| format!("{v:.3}"));
            let _ = write!(line, " {name} {value}");
        }
    }
    line
}

/// The record: a row for each run.
fn table(runs: &[Run]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for (number, run) in runs.iter().enumerate() {
        if number == 0 {
            let figures = run.figures.iter().map(|(name, _)| *name);
            let keys = ["run", "clip", "scale", "method", "radius_factor"];
            writer.write_record(keys.into_iter().chain(figures))?;
        }
        let factor = run
            .radius_factor
            .map_or_else(String::new, |f| f.to_string());
        let keys = [
            run.name(),
            run.clip.clone(),
            run.scale.to_string(),
            run.method.to_owned(),
            factor,
        ];
        let figure = |value: &Option<f64>| match value {
            Some(value) if value.fract() == 0.0 => format!("{value}"),
            Some(value) => format!("{value:.4}"),
            None => String::new(),
        };
        let figures = run.figures.iter().map(|(_, value)| figure(value));
        writer.write_record(keys.into_iter().chain(figures))?;
    }
    Ok(writer.into_inner()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_or_refused() {
        let root = Path::new("/root");
        let words = [
            "--clips",
            "roll,throw",
            "--scales",
            "0.5",
            "--labels",
            "rectangles",
        ];
        let options = Options::parse(root, &words).unwrap();
        assert_eq!(options.clips, ["roll", "throw"]);
        assert_eq!(options.scales, [0.5]);
        assert_eq!(options.radius_factors, [0.25, 1.0, 4.0]);
        assert!(options.labels == [Labels::Rectangles] && !options.verify);
        for wrong in [
            &["--scales", "0"][..],
            &["--labels", "dots"],
            &["--clips"],
            &["--clip", "roll"],
            &["--frames", "half"],
        ] {
            assert!(Options::parse(root, wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn records_have_a_row_for_each_run() {
        let run = |radius_factor| Run {
            clip: "roll".to_owned(),
            scale: 0.5,
            method: "circles",
            radius_factor,
            figures: vec![("on_ball_share", Some(0.97436)), ("fps", None)],
        };
        let record = String::from_utf8(table(&[run(Some(0.25)), run(None)]).unwrap()).unwrap();
        let expected = "run,clip,scale,method,radius_factor,on_ball_share,fps\n\
                        \"roll, half size, circles\",roll,0.5,circles,0.25,0.9744,\n\
                        \"roll, half size, circles\",roll,0.5,circles,,0.9744,\n";
        assert_eq!(record, expected);
    }
}
