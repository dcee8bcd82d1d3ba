//! Optional output of particles: one row per time, target and particle, flushed after each time.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::TargetId;
use pardalis_filter::Particles;
use pardalis_scene::{Scene, TargetConfig};

use super::{Instant, Sink, Tracked};
use crate::files::{RowFile, refuse_foreign};
use crate::output::Shown;
use crate::user_error::user_error;

/// The header line. Later versions may append columns.
const HEADER: &str =
    "frame,time_s,target,landmark,particle,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,weight\n";
/// Number of columns of position and velocity; a motion model without velocities has only the first three.
const STATE_COLUMNS: usize = 6;

/// Fails if a path for particles is that of a file with something else, or of another result, of these names, in this folder.
pub(super) fn check_path(path: &Path, folder: Option<&Path>, results: &[&str]) -> Result<()> {
    refuse_foreign("--particles", path, "particles", has_header)?;
    let place = |path: &Path| {
        let found = fs::canonicalize(path);
        found.or_else(|_| std::path::absolute(path)).ok()
    };
    let parent = path.parent().filter(|parent| *parent != Path::new(""));
    let parent = place(parent.unwrap_or(Path::new(".")));
    let is_there = folder.is_some_and(|folder| place(folder) == parent);
    if is_there && results.iter().any(|name| path.ends_with(name)) {
        return Err(user_error!(
            "--particles {}: is the name of another result; choose another, such as particles.csv",
            path.shown()
        ));
    }
    Ok(())
}

/// Returns the files of particles in a folder. The user names them, so they are known by their header.
pub(super) fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    // No pipe, which would keep the program waiting.
    paths
        .filter(|path| path.is_file() && has_header(path))
        .collect()
}

fn has_header(path: &Path) -> bool {
    let columns = HEADER.trim_end().as_bytes();
    let mut begin = vec![0; columns.len()];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut begin));
    read.is_ok() && begin == columns
}

/// Writes the particles of each estimate to a file.
///
/// Only targets with an estimate have rows, because the particles of a searching or lost target mean nothing.
/// Particles are written before resampling; those of a detected target are those of its last update. The weights of
/// the particles of one landmark, or of a target without landmarks, sum to one.
pub(crate) struct ParticleRows {
    out: RowFile,
    targets: Vec<TargetConfig>,
    text: String,
}

impl ParticleRows {
    /// Creates the file and writes the header.
    pub(crate) fn create(path: &Path, scene: &Scene) -> Result<Self> {
        let mut out = RowFile::create(path).map_err(|error| error.context("--particles"))?;
        out.write(HEADER)?;
        Ok(Self {
            out,
            targets: scene.targets.clone(),
            text: String::new(),
        })
    }
}

impl Sink for ParticleRows {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.text.clear();
        for (number, target) in self.targets.iter().enumerate() {
            let clouds: Vec<&Particles> =
                instant.tracker.particles(TargetId::new(number))?.collect();
            for (place, body, member) in instant.bodies(number, target) {
                let is_it = |one: &&Tracked| one.key() == (number, member);
                let tracked = instant.tracked.iter().find(is_it);
                let is_known = tracked.is_some_and(|one| one.estimate.kinematics.is_some());
                if let (true, Some(particles)) = (is_known, clouds.get(place)) {
                    let labels = instant.row_labels(target, body, member);
                    push_rows(&mut self.text, &labels, particles);
                }
            }
        }
        self.out.write(&self.text)
    }
}

/// Adds one row per particle. Numbers are in the shortest form that parses to the same value.
fn push_rows(text: &mut String, labels: &str, particles: &Particles) {
    let columns = particles.columns();
    for (particle, log_weight) in particles.log_weights.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(text, "{labels},{particle}");
        for column in 0..STATE_COLUMNS {
            text.push(',');
            if let Some(values) = columns.get(column) {
                let _ = write!(text, "{}", values[particle]);
            }
        }
        let _ = writeln!(text, ",{}", libm::exp(*log_weight));
    }
}
