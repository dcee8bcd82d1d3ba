//! Tracks in another world frame than the truth.

use std::path::Path;

use anyhow::Result;
use nalgebra::Point3;
use pardalis_camera::Pose;
use serde::{Serialize, Serializer};

use super::{Options, Placed, names, pairing};
use crate::output::Shown;
use crate::tables::{Series, TrackRow};
use crate::user_error::user_error;

/// Where the world of the tracks is in that of the truth.
#[derive(Debug, Serialize)]
pub(crate) struct Aligned {
    #[serde(serialize_with = "rows")]
    truth_from_tracks: Pose,
}

/// Writes a pose as the rows of a matrix.
fn rows<S: Serializer>(pose: &Pose, serializer: S) -> Result<S::Ok, S::Error> {
    let matrix = pose.to_homogeneous();
    let rows = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)]));
    rows.serialize(serializer)
}

impl Aligned {
    /// Aligns the tracks with those objects that are theirs wherever they are: by name, as the user says, or because there is one of each.
    pub(super) fn of(
        placed: &Placed,
        (tracks_path, truth_path): (&Path, &Path),
        options: &Options,
        lost_beyond_m: f64,
    ) -> Result<Self> {
        let [tracks, objects] = [names(placed.tracks), names(placed.objects)];
        let pairs = pairing::pair(
            (tracks_path, &tracks, &placed.track_paths),
            (truth_path, &objects, &placed.object_paths),
            &options.map,
            f64::INFINITY,
        )?;
        let known = pairs
            .iter()
            .filter(|pair| pair.matched_by != pairing::MatchedBy::Position);
        let positions = known.flat_map(|pair| {
            let truth = placed.object_paths[pair.object].iter();
            let both = truth.zip(&placed.track_paths[pair.target]);
            both.filter_map(|(truth, estimate)| Some([(*truth)?, (*estimate)?]))
        });
        let positions: Vec<_> = positions.collect();
        if positions.is_empty() {
            return Err(user_error!(
                "--align: no target of {} ({}) has the name of an object of {} ({}) and rows at its times; pair them with --map TARGET=OBJECT",
                tracks_path.shown(),
                tracks.join(", "),
                truth_path.shown(),
                objects.join(", ")
            ));
        }
        let pose = pardalis_evaluate::alignment(&positions, lost_beyond_m);
        let truth_from_tracks = pose.ok_or_else(|| {
            user_error!(
                "--align: needs three or more positions that are not on a line, and there are {}; evaluate a longer track",
                positions.len()
            )
        })?;
        Ok(Self { truth_from_tracks })
    }

    /// Moves the tracks into the world of the truth.
    pub(super) fn move_tracks(&self, tracks: &mut [Series<TrackRow>]) {
        let rows = tracks.iter_mut().flat_map(|track| &mut track.rows);
        for estimate in rows.filter_map(|(_, row)| row.estimate.as_mut()) {
            *estimate = estimate.moved(&self.truth_from_tracks);
        }
    }

    /// Returns a point of the tracks' world in that of the truth, in metres.
    pub(super) fn place(&self, point_m: [f64; 3]) -> [f64; 3] {
        (self.truth_from_tracks * Point3::from(point_m))
            .coords
            .into()
    }

    /// Returns by how much the tracks were turned, in degrees, and moved, in metres.
    pub(super) fn extent(&self) -> (f64, f64) {
        let pose = &self.truth_from_tracks;
        let angle_deg = pose.rotation.angle().to_degrees();
        (angle_deg, pose.translation.vector.norm())
    }
}
