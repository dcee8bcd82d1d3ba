//! `candidates.csv`: what was examined at each time and what ruled it out, flushed after each time.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::TargetId;
use pardalis::tracker::Candidate;
use pardalis_scene::{Scene, TargetConfig};

use super::{Instant, Sink};
use crate::files::RowFile;

/// The header line. Later versions may append columns.
const HEADER: &str = "frame,time_s,target,landmark,origin,camera,u_px,v_px,area_px,x_m,y_m,z_m,\
                      outline_nats,color_nats,visible_share,verdict\n";

/// Writes the candidates of each target to a file.
pub(crate) struct CandidateRows {
    out: RowFile,
    path: PathBuf,
    cameras: Vec<String>,
    targets: Vec<TargetConfig>,
    text: String,
}

impl CandidateRows {
    /// The name of the file in the output folder.
    pub(crate) const FILE: &str = "candidates.csv";

    /// Creates the file in the output folder and writes the header.
    pub(crate) fn create(folder: &Path, scene: &Scene) -> Result<Self> {
        let path = folder.join(Self::FILE);
        let mut out = RowFile::create(&path)?;
        out.write(HEADER)?;
        Ok(Self {
            out,
            path,
            cameras: scene.cameras.iter().map(|c| c.name.clone()).collect(),
            targets: scene.targets.clone(),
            text: String::new(),
        })
    }

    /// Returns the path of the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

impl Sink for CandidateRows {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.text.clear();
        for (number, target) in self.targets.iter().enumerate() {
            let of_bodies = instant.tracker.candidates(TargetId::new(number))?;
            let of_bodies: Vec<_> = of_bodies.collect();
            let known: Vec<_> = instant.bodies(number, target).collect();
            // Whoever is new to a crowd has no number yet.
            let is_new = |place: &usize| known.iter().all(|(known, ..)| known != place);
            let new = (0..of_bodies.len()).filter(is_new);
            let new = new.map(|place| (place, &target.bodies[0], None));
            for (place, body, member) in known.iter().copied().chain(new) {
                let candidates = of_bodies[place];
                let labels = instant.row_labels(target, body, member);
                for candidate in candidates {
                    push_row(&mut self.text, &labels, &self.cameras, candidate);
                }
            }
        }
        self.out.write(&self.text)
    }
}

/// Adds a row. Numbers are in the shortest form that parses to the same value; fields that do not apply are empty.
fn push_row(text: &mut String, labels: &str, cameras: &[String], candidate: &Candidate) {
    let origin = &candidate.origin;
    let camera = origin
        .camera()
        .map_or("", |camera| &cameras[camera.index()]);
    // Writing to a String cannot fail.
    let _ = write!(text, "{labels},{},{camera}", origin.name());
    let blob = origin.blob();
    let fields = (0..2)
        .map(|axis| blob.map(|blob| blob.centroid_px[axis]))
        .chain([blob.map(|blob| blob.area_px)])
        .chain((0..3).map(|axis| candidate.position_m.map(|p| p[axis])))
        .chain([
            candidate.outline_nats,
            candidate.color_nats,
            candidate.visible_share,
        ]);
    for field in fields {
        text.push(',');
        if let Some(value) = field {
            let _ = write!(text, "{value}");
        }
    }
    let _ = writeln!(text, ",{}", candidate.verdict.name());
}
