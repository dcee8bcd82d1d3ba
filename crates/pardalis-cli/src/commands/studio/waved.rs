//! Cameras before which a ball is waved, and what they have seen of it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};

use crate::commands::calibrate::rig::CalibratedRig;
use crate::interrupt::Stop;
use crate::timing::now_s;

/// A rig that is calibrated, or was.
pub(super) struct Waved {
    pub(super) shared: Arc<Mutex<Seen>>,
    pub(super) stop: Stop,
}

impl Waved {
    /// Reports whether the cameras are those of a scene with this text.
    pub(super) fn is_of(&self, text: &str) -> bool {
        &*lock(&self.shared).text == text
    }

    /// Reports whether the cameras are in use.
    pub(super) fn goes_on(&self) -> bool {
        lock(&self.shared).goes_on
    }
}

impl Drop for Waved {
    fn drop(&mut self) {
        lock(&self.shared).is_cancelled = true;
        self.stop.request();
    }
}

/// What came of it so far.
pub(super) struct Seen {
    /// The text of the scene of which the cameras are.
    pub(super) text: Arc<str>,
    pub(super) cameras: Vec<OfCamera>,
    pub(super) began_s: f64,
    pub(super) duration_s: Option<f64>,
    pub(super) goes_on: bool,
    pub(super) is_cancelled: bool,
    pub(super) done: Option<Result<CalibratedRig, String>>,
}

/// What a camera has seen so far.
pub(super) struct OfCamera {
    pub(super) name: String,
    pub(super) is_live: bool,
    pub(super) frame_count: Option<usize>,
    pub(super) frames: usize,
    pub(super) found: usize,
    pub(super) shown_s: f64,
}

impl Seen {
    /// Returns what the page shows.
    pub(super) fn about(&self) -> Value {
        let cameras = self.cameras.iter().map(|camera| {
            json!({
                "name": camera.name,
                "frames": camera.frames,
                "frame_count": camera.frame_count,
                "found": camera.found,
            })
        });
        let report = self.done.as_ref().and_then(|done| {
            let report = done.as_ref().ok()?.report();
            let [notes, warnings] = [report.notes(), report.warnings()].map(|texts| {
                texts
                    .iter()
                    .map(|text| without_options(text))
                    .collect::<Vec<_>>()
            });
            Some(json!({ "rows": report.rows(), "notes": notes, "warnings": warnings }))
        });
        json!({
            "goes_on": self.goes_on,
            "cameras": cameras.collect::<Vec<_>>(),
            "elapsed_s": now_s() - self.began_s,
            "duration_s": self.duration_s,
            "report": report,
            "error": self.done.as_ref().and_then(|done| Some(without_options(done.as_ref().err()?))),
        })
    }
}

/// Returns a text without the options of the command line in brackets, in place of which a page has controls.
fn without_options(text: &str) -> String {
    let mut parts = text.split(" (--");
    let mut kept = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        kept.push_str(part.split_once(')').map_or("", |(_, rest)| rest));
    }
    kept
}

pub(super) fn lock(shared: &Mutex<Seen>) -> MutexGuard<'_, Seen> {
    // Each change is whole.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_the_command_line_are_left_out() {
        let text =
            "lay it (in view), or check its description (--board); give points (--points) or more";
        assert_eq!(
            without_options(text),
            "lay it (in view), or check its description; give points or more"
        );
        assert_eq!(without_options("as it is"), "as it is");
    }
}
