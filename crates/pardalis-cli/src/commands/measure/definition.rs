//! What an experiment's file says.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use serde::Deserialize;

use super::results::METRICS;
use crate::fault::fault;
use crate::scene::read_text;

/// An experiment: runs that belong together.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Experiment {
    /// Names its results.
    pub(super) name: String,
    /// What it asks.
    #[expect(dead_code, reason = "for the reader of the file")]
    question: String,
    pub(super) runs: Vec<Run>,
}

/// One scene with several seeds.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Run {
    pub(super) name: String,
    /// Paths start at the experiment's folder.
    pub(super) scene: String,
    pub(super) truth: String,
    /// Seeds 1, 2, … are run.
    pub(super) seeds: u32,
    /// How many of them `--verify` runs.
    #[serde(default)]
    pub(super) verify_seeds: u32,
    /// Lowest and highest value of a figure, for every seed and target.
    #[serde(default)]
    pub(super) expect: BTreeMap<String, [f64; 2]>,
}

impl Run {
    /// The run's name as a folder's.
    pub(super) fn slug(&self) -> String {
        self.name
            .chars()
            .map(|c| {
                if c.is_ascii_alphanumeric() {
                    c.to_ascii_lowercase()
                } else {
                    '-'
                }
            })
            .collect()
    }
}

impl Experiment {
    /// Reads and checks the file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = read_text(path)?;
        let experiment: Self =
            toml::from_str(&text).map_err(|error| fault!("{}: {error}", path.display()))?;
        for run in &experiment.runs {
            if let Some(metric) = run
                .expect
                .keys()
                .find(|m| METRICS.iter().all(|(name, _)| name != m))
            {
                let allowed: Vec<_> = METRICS.iter().map(|(name, _)| *name).collect();
                return Err(fault!(
                    "{}: run \"{}\": expect.{metric} is no figure; allowed: {}",
                    path.display(),
                    run.name,
                    allowed.join(", ")
                ));
            }
        }
        Ok(experiment)
    }
}
