//! `crossings.csv`: when and where targets in flight are predicted to cross a plane, flushed after each time.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::TargetId;
use pardalis::filter::flight::{Crossing, Flight};
use pardalis::tracker::TrackState;
use pardalis_scene::{Scene, TargetConfig};

use super::series::Key;
use super::{Instant, Output, Sink};
use crate::files::RowFile;
use crate::output::warn;

/// The header line. Later versions may append columns.
const HEADER: &str = "frame,time_s,target,crosses_s,sigma_crosses_s,x_m,y_m,z_m,xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2\n";

/// Follows the flights of targets and writes their crossings to a file.
pub(super) struct CrossingRows {
    out: RowFile,
    path: PathBuf,
    targets: Vec<TargetConfig>,
    flights: BTreeMap<Key, Flight>,
    text: String,
}

impl CrossingRows {
    /// The name of the file in the output folder.
    pub(super) const FILE: &str = "crossings.csv";

    /// Creates the file in the output folder and writes the header; `None` if there is no folder, or no target of the scene has a plane.
    pub(super) fn create(output: &Output, scene: &Scene) -> Result<Option<Self>> {
        let Some(target) = scene
            .targets
            .iter()
            .find(|target| target.crossing.is_some())
        else {
            return Ok(None);
        };
        let Output::Folder(folder) = output else {
            warn(format!(
                "targets.{}.crossing: crossings are written into a folder only; give -o a folder instead of -",
                target.name
            ));
            return Ok(None);
        };
        let path = folder.join(Self::FILE);
        let mut out = RowFile::create(&path)?;
        out.write(HEADER)?;
        Ok(Some(Self {
            out,
            path,
            targets: scene.targets.clone(),
            flights: BTreeMap::new(),
            text: String::new(),
        }))
    }

    /// Returns the path of the file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

impl Sink for CrossingRows {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.text.clear();
        let known = |key: &Key| instant.tracked.iter().any(|one| one.key() == *key);
        self.flights.retain(|key, _| known(key));
        for tracked in instant.tracked {
            let Some(crossing) = self.targets[tracked.target].crossing else {
                continue;
            };
            let mut measurements = instant
                .tracker
                .measurements(TargetId::new(tracked.target))?;
            let is_tracking = tracked.estimate.state == TrackState::Tracking;
            let measured = measurements.nth(tracked.place).flatten();
            let flight = match self.flights.entry(tracked.key()) {
                Entry::Occupied(flight) => flight.into_mut(),
                Entry::Vacant(new) => new.insert(Flight::new(crossing.flight)?),
            };
            if let Some(measured) = measured.filter(|_| is_tracking) {
                let covariances = (measured.covariance_m2, measured.shared_m2);
                flight.add(instant.time_s, measured.position_m, covariances);
            }
            let Some(predicted) = flight.crossing(&crossing.plane) else {
                continue;
            };
            // What is over by now was not seen to happen.
            if predicted.time_s > instant.time_s {
                let name = tracked.name(&self.targets);
                let labels = format!("{},{},{name}", instant.index, instant.time_s);
                push_row(&mut self.text, &labels, &predicted);
            }
        }
        self.out.write(&self.text)
    }
}

/// Adds a row. Numbers are in the shortest form that parses to the same value.
fn push_row(text: &mut String, labels: &str, crossing: &Crossing) {
    // Writing to a String cannot fail.
    let _ = write!(text, "{labels},{},{}", crossing.time_s, crossing.sigma_s);
    for value in crossing.position_m.iter().chain(&crossing.covariance_m2) {
        let _ = write!(text, ",{value}");
    }
    text.push('\n');
}
