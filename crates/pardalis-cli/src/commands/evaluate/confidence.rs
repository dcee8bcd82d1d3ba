//! Evaluation of the confidences of a track.

use pardalis_evaluate::{CheckedConfidence, Reliability, TrueState, reliability};
use serde::Serialize;

use super::{Options, has_required_cameras};
use crate::tables::TrackRow;

/// The confidences of one target in the scored frames.
#[derive(Debug, Serialize)]
pub(crate) struct Confidence {
    /// The distance within which an estimate counts as right, in metres; `None` if it is not known.
    pub(crate) diameter_m: Option<f64>,
    /// The greatest confidence; `None` if the track has no confidences.
    pub(crate) confidence_max: Option<f64>,
    /// The reliability of the confidences; `None` without a diameter or without confidences.
    pub(crate) reliability: Option<Reliability>,
    /// The checked confidences from which `reliability` is computed.
    #[serde(skip)]
    pub(crate) checks: Vec<CheckedConfidence>,
}

impl Confidence {
    /// Evaluates rows of the track against rows of the truth. In a frame with truth for other objects only, the
    /// object does not exist.
    pub(super) fn of<'a>(
        rows: impl Iterator<Item = (Option<&'a TrackRow>, Option<&'a TrueState>)>,
        options: &Options,
        diameter_m: Option<f64>,
    ) -> Self {
        let (mut confidence_max, mut checks) = (None, Vec::new());
        for (row, truth) in rows {
            let Some(row) = row.filter(|_| has_required_cameras(truth, options)) else {
                continue;
            };
            let Some(confidence) = row.confidence else {
                continue;
            };
            confidence_max = Some(confidence_max.map_or(confidence, |m| confidence.max(m)));
            let check = |d| CheckedConfidence::of(confidence, row.estimate.as_ref(), truth, d);
            checks.extend(diameter_m.map(check));
        }
        Self {
            diameter_m,
            confidence_max,
            reliability: reliability(&checks),
            checks,
        }
    }
}
