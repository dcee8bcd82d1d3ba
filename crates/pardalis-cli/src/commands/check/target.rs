//! Whether the targets and their colours are in the first frames.

use std::path::Path;

use pardalis::Frame;
use pardalis::color::{ColorModel, PixelKind};
use pardalis::detect::blobs;
use pardalis::tracker::BodySettings;
use pardalis_scene::TargetConfig;

use super::cost::Found;
use crate::numbers::fixed;
use crate::scene::Parts;
use crate::tracking::missed;

/// A target of a scene.
pub(super) struct Seen {
    name: String,
    /// Its bodies with colours.
    bodies: Vec<BodyColors>,
}

/// Where the colours of a body occur.
struct BodyColors {
    /// The line and key of its colours.
    place: String,
    name: String,
    /// The cameras with a frame in which they occur, with the area of their largest connected part, in pixels.
    cameras: Vec<(String, f64)>,
    /// The cameras with a frame in which they do not.
    others: Vec<String>,
}

/// Looks for the colours of all targets in the first frames of the cameras that have one.
pub(super) fn examine(parts: &mut Parts, firsts: &[Option<Frame>]) -> Vec<Seen> {
    let mut targets = Vec::new();
    for (target, settings) in parts.scene.targets.iter().zip(&parts.targets) {
        let mut bodies = Vec::new();
        for (body, settings) in target.bodies.iter().zip(settings) {
            let model = settings.as_ref().and_then(model_of);
            let (Some(model), Some(file)) = (model, &body.colors) else {
                continue;
            };
            let (mut cameras, mut others) = (Vec::new(), Vec::new());
            let views = parts.views.iter_mut().zip(firsts);
            for (camera, (view, first)) in parts.scene.cameras.iter().zip(views) {
                let (Some(view), Some(first)) = (view, first) else {
                    continue;
                };
                view.prepare(PixelKind::of(first), model.palette());
                // The largest one is the first.
                match blobs(&view.prepared(first), model).first() {
                    Some(blob) => cameras.push((camera.name.clone(), blob.area_px)),
                    None => others.push(camera.name.clone()),
                }
            }
            bodies.push(BodyColors {
                place: format!("line {}: {}", file.line, file.key),
                name: body.name.clone(),
                cameras,
                others,
            });
        }
        targets.push(Seen {
            name: target.name.clone(),
            bodies,
        });
    }
    targets
}

fn model_of(settings: &BodySettings) -> Option<&ColorModel> {
    match settings {
        BodySettings::Detected(settings) => Some(&settings.colors),
        BodySettings::Initialized(settings) => settings.colors.as_ref(),
    }
}

impl Seen {
    /// Whether there was a frame and a colour model to look for it.
    pub(super) fn was_looked_for(&self) -> bool {
        let was_compared = |body: &BodyColors| !(body.cameras.is_empty() && body.others.is_empty());
        self.bodies.iter().any(was_compared)
    }

    /// Says where the target's colours occur, in one line per body.
    pub(super) fn text(&self) -> String {
        let mut lines = vec![format!("targets.{}:", self.name)];
        for body in &self.bodies {
            let whose = if self.bodies.len() > 1 {
                format!("{}'s colours", body.name)
            } else {
                "its colours".to_owned()
            };
            let area = |(camera, area_px): &(String, f64)| format!("{camera} ({area_px} pixels)");
            let cameras: Vec<_> = body.cameras.iter().map(area).collect();
            let line = match (&cameras[..], &body.others[..]) {
                ([], []) => continue,
                ([], others) => format!(
                    "{whose} do not occur in the first frame of {}",
                    others.join(", ")
                ),
                (_, []) => format!("{whose} occur in the first frame of {}", cameras.join(", ")),
                (_, others) => format!(
                    "{whose} occur in the first frame of {}, and not in that of {}",
                    cameras.join(", "),
                    others.join(", ")
                ),
            };
            lines.push(format!("  {line}"));
        }
        lines.join("\n")
    }

    /// Returns a warning for each body whose colours occur nowhere.
    pub(super) fn warnings(&self, path: &Path) -> Vec<String> {
        let nowhere = |body: &&BodyColors| body.cameras.is_empty() && !body.others.is_empty();
        let warning = |body: &BodyColors| {
            format!(
                "{}: {}: these colours occur in no first frame; unless the target is out of view there, learn them from images of this \
                 camera in this light",
                path.display(),
                body.place
            )
        };
        self.bodies.iter().filter(nowhere).map(warning).collect()
    }
}

/// Says in a line whether a target was found in the first frames, by its estimate and what ruled out the candidate that came
/// nearest to it.
pub(super) fn outcome(
    target: &TargetConfig,
    Found {
        estimate,
        members,
        reason,
    }: &Found,
) -> String {
    let is_searched = target.bodies.iter().all(|body| body.cues().is_empty());
    match (&estimate.kinematics, reason) {
        (None, _) if !is_searched => {
            "  is followed from its start, where it is not in the first frames; check the start"
                .to_owned()
        }
        _ if !is_searched => "  is followed from its start, and not searched for".to_owned(),
        (Some(_), _) if target.crowd.is_some() => {
            format!("  {members} found in the first frames")
        }
        (Some(found), _) => {
            let [x, y, z] = found.position_m.map(|c| fixed(c, 3));
            format!("  found in the first frames at {x}, {y}, {z} m")
        }
        (None, Some(reason)) => format!(
            "  not found in the first frames: {} ({})",
            missed::what(*reason),
            reason.name()
        ),
        (None, None) => "  not found in the first frames".to_owned(),
    }
}
