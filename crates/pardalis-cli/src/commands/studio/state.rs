//! The state of a session as the page sees it.

use pardalis_scene::{CameraConfig, Problem, Scene, TargetConfig};
use serde_json::{Value, json};

use super::session::Inner;
use crate::commands::init::text::guesses;
use crate::output::Shown;

/// The steps of the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Sources,
    Camera,
    Pose,
    Colors,
    Targets,
    Track,
}

impl Step {
    /// Returns the step in which a key of the scene is set.
    fn of(key: &str) -> Self {
        let mut parts = key.split('.');
        let (table, key) = (parts.next(), parts.nth(1));
        match (table, key) {
            (
                Some("cameras"),
                Some(
                    "calibration" | "calibration_camera" | "calibration_lens" | "model" | "size_px"
                    | "mask" | "mask_radius_px",
                ),
            ) => Self::Camera,
            (Some("cameras"), Some("world_from_camera" | "platform" | "plane")) => Self::Pose,
            (Some("cameras"), _) => Self::Sources,
            (Some("targets"), Some("colors")) => Self::Colors,
            (Some("targets"), _) => Self::Targets,
            _ => Self::Track,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Sources => "sources",
            Self::Camera => "camera",
            Self::Pose => "pose",
            Self::Colors => "colors",
            Self::Targets => "targets",
            Self::Track => "track",
        }
    }
}

impl Inner {
    /// Returns the state of the session.
    pub(super) fn state(&self) -> Value {
        let parts = self.parts();
        let now = self.project.now();
        let guessed = guesses(&now.text);
        let written = |problem: &Problem, is_warning: bool| {
            // The page finds it.
            let is_missing_pose = parts.scene.cameras.iter().any(|camera| {
                !camera.has_pose
                    && problem.key == format!("cameras.{}.world_from_camera", camera.name)
            });
            let message = if is_missing_pose && problem.message.starts_with("is missing") {
                "is missing; choose above how to find it"
            } else {
                &problem.message
            };
            json!({
                "step": Step::of(&problem.key).name(),
                "key": problem.key,
                "line": problem.line,
                "message": message,
                "is_warning": is_warning,
                "is_unread": self.is_unread(&parts.scene, &problem.key),
            })
        };
        let problems = parts.assembly.problems.iter().map(|p| written(p, false));
        // The page says of each guess what to do.
        let warnings = parts.scene.warnings.iter().filter(|p| p.key != "guessed");
        let problems = problems.chain(warnings.map(|p| written(p, true)));
        let (undo, redo) = self.project.steps();
        json!({
            "path": self.project.path().shown(),
            "text": &*now.text,
            "is_saved": self.project.is_saved(),
            "seed": parts.scene.seed,
            "undo": undo,
            "redo": redo,
            "problems": problems.collect::<Vec<_>>(),
            "guesses": guessed.iter().map(|key| json!({ "key": key, "step": Step::of(key).name() })).collect::<Vec<_>>(),
            "cameras": parts.scene.cameras.iter().map(|camera| self.camera(camera)).collect::<Vec<_>>(),
            "targets": parts.scene.targets.iter().map(|target| self.target(target)).collect::<Vec<_>>(),
            "can_use_rig": self.waved.as_ref().is_some_and(|waved| waved.is_of(&now.text)),
            "run": self.running.as_ref().map(super::running::Running::about),
        })
    }

    /// Reports whether a key is in the table of a camera or target that is there and could not be read: the page has nothing else of it.
    fn is_unread(&self, scene: &Scene, key: &str) -> bool {
        let mut parts = key.split('.');
        let (Some(kind), Some(name)) = (parts.next(), parts.next()) else {
            return false;
        };
        let is_read = match kind {
            "cameras" => scene.cameras.iter().any(|camera| camera.name == name),
            "targets" => scene.targets.iter().any(|target| target.name == name),
            _ => true,
        };
        !is_read && self.table_of(kind, name).is_some()
    }

    fn camera(&self, camera: &CameraConfig) -> Value {
        let player = self.players.get(&camera.name);
        let table = self.table_of("cameras", &camera.name);
        let calibration = table
            .as_ref()
            .and_then(|table| table.get("calibration")?.as_str());
        let size_px = player.and_then(super::player::Player::size_px);
        // Of a pinhole camera.
        let focal_px = camera.camera.parameters().first().map(|(_, value)| *value);
        let is_pinhole = camera.camera.kind() == "pinhole";
        let fov_deg =
            size_px
                .zip(focal_px.filter(|_| is_pinhole))
                .map(|((width, height), focal_px)| {
                    2.0 * libm::atan2(0.5 * width.max(height) as f64, focal_px).to_degrees()
                });
        json!({
            "name": camera.name,
            "input": camera.input.place().value,
            "source": player.map(super::player::Player::about),
            "model": camera.camera.kind(),
            "calibration": calibration,
            "fps": table.as_ref().and_then(|table| table.get("fps")?.as_float()),
            "fov_deg": fov_deg,
            "position_m": camera.position_m(),
            "has_pose": camera.has_pose,
        })
    }

    fn target(&self, target: &TargetConfig) -> Value {
        let body = &target.bodies[0];
        let shape = self.table_of("targets", &target.name);
        let shape = shape.and_then(|table| table.get("shape").cloned());
        let samples = self.project.now().samples.get(&target.name);
        let samples = samples.into_iter().flatten().map(|sample| {
            json!({ "camera": sample.camera, "frame": sample.number, "outline_px": sample.outline_px })
        });
        let learnt = self.learnt.get(&target.name).map(|learnt| {
            json!({ "found": learnt.found, "mistaken": learnt.mistaken, "failed": learnt.failed, "palette": learnt.palette })
        });
        let colors = body.colors.as_ref().map(|file| &file.value);
        let has_colors = colors.is_some_and(|file| self.project.folder().join(file).is_file());
        json!({
            "name": target.name,
            "shape": shape,
            "is_crowd": target.crowd.is_some(),
            "particles": body.particle_count(),
            "colors": colors,
            "has_colors": has_colors,
            "samples": samples.collect::<Vec<_>>(),
            "learnt": learnt,
        })
    }

    /// Returns the table of a camera or target as it stands in the text.
    pub(super) fn table_of(&self, kind: &str, name: &str) -> Option<toml::Table> {
        let text: toml::Table = self.project.now().text.parse().ok()?;
        text.get(kind)?.get(name)?.as_table().cloned()
    }
}
