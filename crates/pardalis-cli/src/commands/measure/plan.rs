//! A run that is ready to be tracked, evaluated and drawn.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use pardalis::tracker::{PASSES_SIGMA_M, TrackState};
use pardalis_evaluate::CheckedConfidence;
use pardalis_scene::Scene;
use pardalis_scene::experiment::{Method, Run};
use rayon::prelude::*;

use super::finished::{self, Finished};
use super::jobs::Job;
use super::results::Figures;
use crate::commands::evaluate::{self, Report};
use crate::commands::locate::{self, StartsFrom};
use crate::commands::simulate::Sequence;
use crate::draw::camera_symbol::CameraSymbol;
use crate::draw::plots::{Sample, TrackSeries, TruthSeries, write_track_plots};
use crate::files::write_file;
use crate::output::Shown;
use crate::progress::Progress;
use crate::user_error::user_error;
use crate::{scene, tables, tracking};

/// A run whose scene and truth have been checked.
pub(super) struct Plan<'a> {
    pub(super) run: &'a Run,
    /// Number of seeds.
    seeds: u32,
    /// One for all seeds, or one for each.
    recordings: Vec<Recording>,
    /// Settings for single images; `None` for tracking.
    located_from: Option<locate::Settings>,
    /// The folder for the results.
    folder: PathBuf,
}

/// A sequence with its truth.
struct Recording {
    scene_path: PathBuf,
    scene: Scene,
    truth_path: PathBuf,
    /// See [`finished::of_run`].
    fingerprint: u64,
}

impl<'a> Plan<'a> {
    /// Reads the run's scene and truth; `folder` is the experiment's.
    pub(super) fn new(run: &'a Run, seeds: u32, folder: &Path, output: &Path) -> Result<Self> {
        let results = output.join(run.slug());
        let starts = run.starts.as_ref().map(|file| folder.join(file));
        let read = |scene_path: PathBuf, truth_path: PathBuf| {
            let [replaced, _] = run.replaced();
            let scene = scene::read_with(&scene_path, &replaced)?;
            tables::read_truth(&truth_path)?;
            let scene_folder = scene_path.parent().unwrap_or(Path::new(""));
            let fingerprint = finished::of_run(&scene, scene_folder, run.method, starts.as_deref());
            Ok(Recording {
                scene_path,
                scene,
                truth_path,
                fingerprint,
            })
        };
        let recordings = match &run.world {
            None => vec![read(folder.join(&run.scene), folder.join(&run.truth))?],
            Some(world) => {
                let seeds: Vec<Option<u32>> = if run.fresh_world {
                    (1..=seeds).map(Some).collect()
                } else {
                    vec![None]
                };
                simulated(run, &folder.join(world), &seeds, &results, read)?
            }
        };
        let located_from = (run.method == Method::Locate).then(|| locate::Settings {
            stills: Vec::new(),
            starts: match &starts {
                Some(file) => StartsFrom::Positions(file.clone(), None),
                None => StartsFrom::Scene,
            },
            passes_m: PASSES_SIGMA_M.to_vec(),
        });
        Ok(Self {
            run,
            seeds,
            recordings,
            located_from,
            folder: results,
        })
    }

    /// Returns the recording of a seed; seeds count from 1.
    fn recording(&self, seed: u32) -> &Recording {
        &self.recordings[(seed as usize - 1) % self.recordings.len()]
    }

    /// Returns the scene of the first recording; the others have the same cameras and targets.
    pub(super) fn scene(&self) -> &Scene {
        &self.recording(1).scene
    }

    fn seed_folder(&self, seed: u32) -> PathBuf {
        self.folder.join(format!("seed-{seed:02}"))
    }

    /// Returns one job per seed.
    pub(super) fn jobs(&self) -> impl Iterator<Item = Job<'_>> {
        (1..=self.seeds).map(|seed| {
            let recording = self.recording(seed);
            Job {
                run: self.run,
                scene_path: &recording.scene_path,
                scene: &recording.scene,
                located_from: self.located_from.as_ref(),
                seed,
                folder: self.seed_folder(seed),
                fingerprint: finished::of_seed(recording.fingerprint, seed, self.run.timed),
            }
        })
    }

    /// Returns the figures of all seeds over all frames, then over each window; draws all seeds in one figure.
    pub(super) fn score_and_draw(&self) -> Result<Measured<'_>> {
        let done = self.score().and_then(|measured| {
            self.draw(&measured.figures)?;
            Ok(measured)
        });
        done.with_context(|| format!("run \"{}\"", self.run.name))
    }

    fn score(&self) -> Result<Measured<'_>> {
        let whole = ("", self.options());
        let windows = self.run.windows.iter();
        let windows = windows.map(|w| {
            let options = evaluate::Options {
                from_s: w.from_s,
                to_s: w.to_s,
                seen_by: w.seen_by,
                ..self.options()
            };
            (&*w.name, options)
        });
        let (mut figures, mut checks) = (Vec::new(), Vec::new());
        for (window, options) in std::iter::once(whole).chain(windows) {
            for (seed, report) in (1..).zip(self.reports(&options)?) {
                let finished =
                    Finished::read(&self.seed_folder(seed)).filter(|_| window.is_empty());
                let ms_a_frame = finished.and_then(|f| f.ms_a_frame);
                figures.extend(Figures::of(seed, window, &report, ms_a_frame));
                checks.extend(report.targets.into_iter().map(|target| CheckedConfidences {
                    target: target.target,
                    window: window.to_owned(),
                    checks: target.confidence.checks,
                }));
            }
        }
        Ok(Measured {
            plan: self,
            figures,
            checks,
        })
    }

    /// Returns the options for evaluating all frames, relative to the run's origin.
    pub(super) fn options(&self) -> evaluate::Options {
        evaluate::Options {
            around: self.run.origin_m,
            visible_over: self.run.visible_over,
            lost_beyond_m: Some(self.run.lost_beyond_m),
            interpolate: self.run.interpolate,
            ..evaluate::Options::default()
        }
    }

    /// Returns the evaluation of each seed.
    pub(super) fn reports(&self, options: &evaluate::Options) -> Result<Vec<Report>> {
        (1..=self.seeds)
            .map(|seed| {
                let truth = &self.recording(seed).truth_path;
                evaluate::score_files(&self.seed_folder(seed), truth, options)
            })
            .collect()
    }

    /// Returns the tracks of the first `seeds` seeds, in order.
    pub(super) fn tracks(&self, seeds: u32) -> Result<Vec<TrackSeries>> {
        let mut tracks = Vec::new();
        for seed in 1..=self.seeds.min(seeds) {
            let read = tables::read_tracks(&self.seed_folder(seed).join("tracks.csv"))?;
            tracks.extend(read.into_iter().map(|track| {
                TrackSeries {
                    name: track.name,
                    rows: track
                        .rows
                        .into_iter()
                        .map(|(time_s, row)| Sample {
                            time_s,
                            position_m: row.estimate.map(|e| e.position_m),
                            covariance_m2: row.estimate.and_then(|e| e.covariance_m2),
                            is_seen: row.state != Some(TrackState::Occluded),
                        })
                        .collect(),
                }
            }));
        }
        Ok(tracks)
    }

    /// Returns the truth of the evaluated objects for plots, from the first recording: recordings of a world differ
    /// only in their images.
    pub(super) fn truth(&self, figures: &[Figures]) -> Result<Vec<TruthSeries>> {
        let mut truth = tables::read_truth(&self.recording(1).truth_path)?;
        truth.retain(|object| figures.iter().any(|f| f.object == object.name));
        Ok(tracking::truth_series(&truth))
    }

    fn draw(&self, figures: &[Figures]) -> Result<()> {
        let truth = self.truth(figures)?;
        let cameras = CameraSymbol::of_scene(self.scene());
        write_track_plots(&self.folder, &self.tracks(self.seeds)?, &truth, &cameras)?;
        Ok(())
    }
}

/// A world of a run, and its folder.
struct Fresh {
    sequence: Sequence,
    folder: PathBuf,
    fingerprint: String,
    /// Whether it has already been simulated.
    is_there: bool,
}

impl Fresh {
    /// Creates the world of this seed, or the world of the file if `seed` is `None`.
    fn of(run: &Run, world: &Path, seed: Option<u32>, results: &Path) -> Result<Self> {
        let [_, mut replaced] = run.replaced();
        if let Some(seed) = seed {
            replaced.insert("seed".to_owned(), i64::from(seed).into());
        }
        let sequence = Sequence::read(world, &replaced)?;
        let name = seed.map_or_else(|| "world".to_owned(), |seed| format!("world-{seed:02}"));
        let folder = results.join(name);
        let fingerprint = finished::of_world(sequence.text());
        let found = std::fs::read_to_string(Self::mark(&folder));
        Ok(Self {
            is_there: found.is_ok_and(|found| found == fingerprint),
            sequence,
            folder,
            fingerprint,
        })
    }

    /// Returns the file with the fingerprint of the simulated world.
    fn mark(folder: &Path) -> PathBuf {
        folder.join("fingerprint.txt")
    }

    fn simulate(&self, progress: &Progress) -> Result<()> {
        let Self { folder, .. } = self;
        std::fs::create_dir_all(folder.parent().unwrap_or(folder)).map_err(|error| {
            user_error!("{}: {error}; choose another folder with -o", folder.shown())
        })?;
        self.sequence.write(folder, true, progress)?;
        write_file(&Self::mark(folder), self.fingerprint.as_bytes())
    }
}

/// Simulates those of a run's worlds that are missing, one per thread in parallel, and reads the scene and the truth
/// of each.
fn simulated(
    run: &Run,
    world: &Path,
    seeds: &[Option<u32>],
    results: &Path,
    read: impl Fn(PathBuf, PathBuf) -> Result<Recording> + Sync,
) -> Result<Vec<Recording>> {
    let worlds = seeds
        .iter()
        .map(|&seed| Fresh::of(run, world, seed, results));
    let worlds = worlds.collect::<Result<Vec<Fresh>>>()?;
    let missing = worlds.iter().filter(|world| !world.is_there);
    let images = missing.map(|world| world.sequence.image_count()).sum();
    let progress = Progress::new("simulating", Some(images));
    let recorded = |world: &Fresh| {
        if !world.is_there {
            world.simulate(&progress)?;
        }
        let file = |name| world.folder.join(name);
        read(file("scene.toml"), file("truth.csv"))
    };
    let mut recordings = Vec::new();
    for side_by_side in worlds.chunks(rayon::current_num_threads()) {
        let recorded: Vec<_> = side_by_side.par_iter().map(recorded).collect();
        // Report the first error in order, whichever thread was faster, before simulating further worlds.
        for recording in recorded {
            recordings.push(recording?);
        }
    }
    Ok(recordings)
}

/// The checked confidences of one target over one window, for one seed.
pub(super) struct CheckedConfidences {
    pub(super) target: String,
    /// The name of the run's window; empty for all frames.
    pub(super) window: String,
    pub(super) checks: Vec<CheckedConfidence>,
}

/// A run with its results.
pub(super) struct Measured<'a> {
    pub(super) plan: &'a Plan<'a>,
    pub(super) figures: Vec<Figures>,
    /// For every seed, target and window.
    pub(super) checks: Vec<CheckedConfidences>,
}

impl Measured<'_> {
    /// Returns the name of the run's sweep, or else its own.
    pub(super) fn name(&self) -> &str {
        let run = self.plan.run;
        run.swept.as_ref().map_or(&run.name, |swept| &swept.sweep)
    }
}
