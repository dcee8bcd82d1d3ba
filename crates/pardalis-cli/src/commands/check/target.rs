//! Whether the targets and their colours are in the first frames.

use std::path::Path;

use pardalis::Frame;
use pardalis::color::{ColorModel, PixelKind};
use pardalis::detect::blobs;
use pardalis::tracker::BodySettings;
use pardalis_scene::TargetConfig;

use super::cost::Found;
use crate::numbers::{fixed, significant};
use crate::output::Shown;
use crate::scene::Parts;
use crate::tracking::missed;
use crate::units::is_searched;

/// A target of a scene.
pub(super) struct Seen {
    name: String,
    /// Whether it is detected, not followed from a start.
    is_searched: bool,
    /// Its bodies with colours.
    bodies: Vec<BodyColors>,
}

/// Where the colours of a body occur.
struct BodyColors {
    /// The line and key of its colours.
    place: String,
    name: String,
    /// The cameras with a frame in which they occur.
    cameras: Vec<Area>,
    /// The cameras with a frame in which they do not.
    others: Vec<String>,
}

/// How much of a camera's frame is in a body's colours.
struct Area {
    camera: String,
    area_px: f64,
    share: f64,
}

/// Looks for the colours of all targets in the first frames of the cameras that have one.
pub(super) fn examine(parts: &mut Parts, firsts: &[Option<Frame>]) -> Vec<Seen> {
    let mut targets = Vec::new();
    for (target, settings) in parts.scene.targets.iter().zip(&parts.assembly.bodies) {
        let mut bodies = Vec::new();
        for (body, settings) in target.bodies.iter().zip(settings) {
            let model = settings.as_ref().and_then(model_of);
            let (Some(model), Some(file)) = (model, &body.colors) else {
                continue;
            };
            let (mut cameras, mut others) = (Vec::new(), Vec::new());
            let views = parts.assembly.views.iter_mut().zip(firsts);
            for (camera, (view, first)) in parts.scene.cameras.iter().zip(views) {
                let (Some(view), Some(first)) = (view, first) else {
                    continue;
                };
                view.prepare(PixelKind::of(first), model.palette());
                let blobs = blobs(&view.prepared(first), model);
                let area_px: f64 = blobs.iter().map(|blob| blob.area_px).sum();
                let camera = camera.name.clone();
                if area_px > 0.0 {
                    cameras.push(Area {
                        camera,
                        area_px,
                        share: area_px / (first.width() * first.height()) as f64,
                    });
                } else {
                    others.push(camera);
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
            is_searched: is_searched(target),
            bodies,
        });
    }
    targets
}

fn model_of(settings: &BodySettings) -> Option<&ColorModel> {
    match settings {
        BodySettings::Detected(settings) => Some(&settings.colors),
        BodySettings::Initialized(settings) => settings.colors.as_ref(),
        BodySettings::Boxed(_) => None,
    }
}

impl Seen {
    /// Whether there was a frame and a colour model to look for it.
    pub(super) fn was_looked_for(&self) -> bool {
        let was_compared = |body: &BodyColors| !(body.cameras.is_empty() && body.others.is_empty());
        self.bodies.iter().any(was_compared)
    }

    /// Says how much of the first frames is in the target's colours, in one line per body, and if the target was looked for there and not found.
    pub(super) fn text(&self, found: Option<&Found>) -> String {
        let but = if self.is_missing(found) {
            ", but the target is not recognised there"
        } else {
            ""
        };
        let mut lines = vec![format!("targets.{}:", self.name)];
        for body in &self.bodies {
            let whose = if self.bodies.len() > 1 {
                format!("{}'s", body.name)
            } else {
                "its".to_owned()
            };
            let cameras: Vec<_> = body.cameras.iter().map(Area::text).collect();
            let line = match (&cameras[..], &body.others[..]) {
                ([], []) => continue,
                ([], others) => format!(
                    "{whose} colours do not occur in the first frame of {}",
                    others.join(", ")
                ),
                (cameras, []) => format!("in {whose} colours: {}{but}", cameras.join(", ")),
                (cameras, others) => format!(
                    "in {whose} colours: {}, nothing in that of {}{but}",
                    cameras.join(", "),
                    others.join(", ")
                ),
            };
            lines.push(format!("  {line}"));
        }
        lines.join("\n")
    }

    /// Reports whether the target was looked for and not found.
    fn is_missing(&self, found: Option<&Found>) -> bool {
        self.is_searched && found.is_some_and(|found| found.estimate.kinematics.is_none())
    }

    /// Returns a warning if there is something in the target's colours that is not the target.
    pub(super) fn missing_warning(&self, path: &Path, found: &Found) -> Option<String> {
        let shown = |body: &&BodyColors| !body.cameras.is_empty();
        let body = self.bodies.iter().find(shown)?;
        self.is_missing(Some(found)).then(|| {
            format!(
                "{}: {}: these colours occur in the first frames, but the target is not recognised there; unless it is out of view, see docs/not-found.md",
                path.shown(),
                body.place
            )
        })
    }

    /// Returns a warning for each body whose colours occur nowhere.
    pub(super) fn warnings(&self, path: &Path) -> Vec<String> {
        let nowhere = |body: &&BodyColors| body.cameras.is_empty() && !body.others.is_empty();
        let warning = |body: &BodyColors| {
            format!(
                "{}: {}: these colours occur in no first frame; unless the target is out of view there, learn them from images of this \
                 camera in this light",
                path.shown(),
                body.place
            )
        };
        self.bodies.iter().filter(nowhere).map(warning).collect()
    }
}

impl Area {
    fn text(&self) -> String {
        let percent = 100.0 * self.share;
        let percent = if percent < 0.01 {
            "less than 0.01".to_owned()
        } else {
            significant(percent)
        };
        let Self {
            camera, area_px, ..
        } = self;
        format!("{area_px} pixels ({percent} %) of the first frame of {camera}")
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
    let is_searched = is_searched(target);
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
            missed::what(*reason, missed::is_boxed(target)),
            reason.name()
        ),
        (None, None) => "  not found in the first frames".to_owned(),
    }
}
