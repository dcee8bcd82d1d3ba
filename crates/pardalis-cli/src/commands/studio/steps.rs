//! What each step of the page changes in the scene.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_camera::Camera;
use pardalis_scene::{NAMES_ALLOWED, Scene, is_name};
use serde::Deserialize;
use serde_json::{Value, json};

use super::edits::{with_camera_name, with_lens, with_table, without};
use super::places::is_device;
use super::running::Running;
use super::session::{Inner, Session};
use crate::commands::devices::Asked;
use crate::commands::init::text::{Calibration, CameraText, target_text};
use crate::commands::init::{self, Fov, Input, Model, Opened};
use crate::commands::learn::samples::{Learnt, Pointed, Sample, box_of, learn_samples, outline_of};
use crate::draw::picture::jpeg_of;
use crate::focal_length::parse_fov_deg;
use crate::output::Shown as _;
use crate::scene::{self, problems_in};
use crate::scene_files::read_calibration;
use crate::source::Source;
use crate::user_error::{SingleImages, user_error};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Renamed {
    camera: String,
    name: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Guessed {
    camera: String,
    fov_deg: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Calibrated {
    camera: String,
    file: String,
    /// The camera of this name in the file, if it has several.
    of: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Label {
    camera: String,
    target: String,
    /// A pixel on the target.
    at_px: Option<[f64; 2]>,
    /// Two corners of a box around it.
    box_px: Option<[[f64; 2]; 2]>,
}

impl Session {
    /// Adds the cameras of a file, a folder, a device or an address.
    pub(super) fn add_source(&self, input: &str, fps: Option<f64>) -> Result<()> {
        // Anything else is a file, which must be in an allowed place.
        let is_live = input.contains("://") || is_device(input);
        let refuse_twice = || {
            if self.has_source(input) {
                return Err(user_error!(
                    "{}: is a camera of the scene already; choose another source",
                    Path::new(input).shown()
                ));
            }
            Ok(())
        };
        let (texts, radius_m) = if is_live {
            refuse_twice()?;
            (vec![self.live_camera(input)?], None)
        } else {
            let path = self.places.allowed(input)?;
            refuse_twice()?;
            let output = self.inner().project.path().to_owned();
            let known_fps = fps.filter(|_| path.is_dir() && !path.join("times.csv").is_file());
            init::cameras(&init::Arguments::of(path, output, known_fps))?
        };
        let names: Vec<String> = texts.iter().map(|text| text.name.clone()).collect();
        let key = "cameras";
        self.edit(key, format!("add {}", names.join(", ")), |state| {
            for camera in texts {
                let name = unused_name(&state.text, &camera.name);
                let mut table = String::new();
                camera.named(name).text(&mut table);
                state.text = with_table(&state.text, &table)?.into();
            }
            let has_target = state.text.contains("[targets.");
            if let (false, Some(radius_m)) = (has_target, radius_m) {
                let table = target_text("ball", Some(radius_m), "ball.colors.toml");
                state.text = with_table(&state.text, &table)?.into();
            }
            Ok(())
        })
    }

    /// Reports whether the scene has a camera of a file, a folder, a device or an address.
    pub(super) fn has_source(&self, input: &str) -> bool {
        let inner = self.inner();
        let folder = inner.project.folder().to_owned();
        let given = std::fs::canonicalize(input).ok();
        let is_it = |camera: &toml::Value| {
            let place = |key| camera.get(key).and_then(toml::Value::as_str);
            let Some(place) = place("video").or(place("images")).or(place("mcap")) else {
                return false;
            };
            let file = std::fs::canonicalize(folder.join(place)).ok();
            place == input || given.is_some() && file == given
        };
        let cameras = inner.project.now().text.parse::<toml::Table>().ok();
        let cameras = cameras
            .as_ref()
            .and_then(|table| table.get("cameras")?.as_table());
        cameras.is_some_and(|cameras| cameras.values().any(is_it))
    }

    /// Opens a live camera, for the size of its images and then for its pictures.
    fn live_camera(&self, input: &str) -> Result<CameraText> {
        if is_device(input) {
            return self.live_camera_of(input, &Asked::of(Path::new(input))?);
        }
        match self.live_camera_of(input, &Asked::default()) {
            // Most network cameras send such images, and the address does not say so.
            Err(error) if error.is::<SingleImages>() => {
                let lines = "input.format = \"mpjpeg\"\n".to_owned();
                let size_px = None;
                self.live_camera_of(input, &Asked { lines, size_px })
            }
            result => result,
        }
    }

    /// The same with further lines of settings.
    fn live_camera_of(&self, input: &str, asked: &Asked) -> Result<CameraText> {
        let place = toml::Value::from(input);
        let Asked { lines, size_px } = asked;
        let size_px = size_px.map_or(String::new(), |size_px| format!("size_px = {size_px:?}\n"));
        let probe = format!(
            "[cameras.camera]\nvideo = {place}\n{lines}{size_px}world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n\
             model.pinhole = {{ f_px = [1, 1], center_px = [0, 0] }}\n"
        );
        let (scene, problems) = Scene::parse_parts(&probe, &|_, _| Err(String::new()));
        let of_camera = problems
            .into_iter()
            .find(|p| p.key.starts_with("cameras.camera"));
        if let Some(problem) = of_camera {
            return Err(user_error!("{input}: {}", problem.message));
        }
        let path = self.inner().project.path().to_owned();
        let folder = path.parent().unwrap_or(Path::new(""));
        let config = scene
            .cameras
            .first()
            .map(|camera| scene::source_config(camera, folder));
        let config = config.unwrap_or_else(|| unreachable!("it has no problem"));
        let config = config.map_err(|problem| problems_in("scene", &path, &[problem]))?;
        let source = Source::open(&config)?;
        let opened = Opened {
            size: source.size(),
            input: Input::Video,
        };
        self.inner().open = vec![(config, source)];
        let camera = CameraText::guessed(Model::Pinhole, &Fov::Unknown, &opened, input, None);
        Ok(camera.with_settings(lines))
    }

    /// Removes a camera or a target.
    pub(super) fn remove(&self, kind: &str, name: &str) -> Result<()> {
        if !["cameras", "targets"].contains(&kind) {
            return Err(user_error!("{kind}: allowed: cameras, targets"));
        }
        self.edit("seed", format!("remove {name}"), |state| {
            state.text = without(&state.text, kind, name)?.into();
            state.samples.remove(name);
            Ok(())
        })
    }

    /// Gives a camera another name. Its picture goes on.
    pub(super) fn rename_camera(&self, renamed: &Renamed) -> Result<()> {
        let Renamed { camera, name } = renamed;
        if !is_name(name) {
            return Err(user_error!("{name}: allowed: {NAMES_ALLOWED}"));
        }
        if self.inner().running.as_ref().is_some_and(Running::goes_on) {
            return Err(user_error!("a run goes on; stop it first"));
        }
        // Any new problem: a target may name the camera, or a calibration file of several cameras.
        self.edit("", format!("{name} for {camera}"), |state| {
            state.text = with_camera_name(&state.text, camera, name)?.into();
            for sample in state.samples.values_mut().flatten() {
                if sample.camera == *camera {
                    sample.camera.clone_from(name);
                }
            }
            Ok(())
        })
    }

    /// Gives a camera the lens of a pinhole camera with an angle of view.
    pub(super) fn set_fov(&self, guessed: &Guessed) -> Result<()> {
        let name = &guessed.camera;
        let fov_deg = parse_fov_deg(&guessed.fov_deg.to_string())
            .map_err(|allowed| user_error!("the angle of view: {allowed}"))?;
        let opened = self.inner().opened(name)?;
        let camera = CameraText::guessed(Model::Pinhole, &Fov::Given(fov_deg), &opened, "", None);
        self.set_lens(name, format!("{fov_deg} degrees for {name}"), camera)
    }

    /// Gives a camera the lens, and the pose if it has one, of a calibration file. Returns the names of its cameras if it is not clear which is meant.
    pub(super) fn set_calibration(&self, calibrated: &Calibrated) -> Result<Option<Vec<String>>> {
        let name = &calibrated.camera;
        let file = self.places.allowed(&calibrated.file)?;
        let cameras = read_calibration(Path::new(""), &file.to_string_lossy(), None)
            .map_err(|message| user_error!("{message}"))?;
        let wanted = calibrated.of.as_ref().unwrap_or(name);
        let camera = match &cameras[..] {
            [camera] => camera,
            _ => match cameras.iter().find(|camera| camera.name == *wanted) {
                Some(camera) => camera,
                None => {
                    return Ok(Some(
                        cameras.into_iter().map(|camera| camera.name).collect(),
                    ));
                }
            },
        };
        let opened = self.inner().opened(name)?;
        init::check_size(&file, camera, opened.size)?;
        let path = self.inner().project.path().to_owned();
        let calibration = Calibration {
            file: init::shown_path(&file, &path),
            camera: (cameras.len() > 1).then(|| camera.name.clone()),
            lens: None,
        };
        let text = CameraText::known(camera, calibration, &opened, "", None);
        let what = format!("{} for {name}", file.shown());
        self.set_lens(name, what, text)?;
        Ok(None)
    }

    fn set_lens(&self, name: &str, what: String, camera: CameraText) -> Result<()> {
        let mut table = String::new();
        camera.named(name.to_owned()).text(&mut table);
        self.edit(&format!("cameras.{name}"), what, |state| {
            state.text = with_lens(&state.text, name, &table)?.into();
            Ok(())
        })
    }

    /// Labels a target in the frame that a camera shows, and learns its colours from all its labels.
    pub(super) fn label(&self, label: &Label) -> Result<()> {
        let pointed = match (label.at_px, label.box_px) {
            (Some(at_px), None) => Pointed::At(at_px),
            (None, Some([a, b])) => Pointed::Within(a, b),
            _ => return Err(user_error!("give either at_px or box_px")),
        };
        self.inner().colors_file(&label.target)?;
        let (number, frame) = self.inner().shown(&label.camera)?;
        let lens = self.inner().lens(&label.camera);
        let outline_px = if self.inner().is_ball(&label.target) {
            let outline_px = outline_of(&frame, lens.clone(), pointed)?;
            if label
                .at_px
                .is_some_and(|at_px| !is_around(&outline_px, at_px))
            {
                return Err(user_error!(
                    "no outline is found around this place; drag a box closely around {}",
                    label.target
                ));
            }
            outline_px
        } else {
            box_of(&frame, pointed)?
        };
        let sample = Sample {
            camera: label.camera.clone(),
            lens,
            number,
            frame,
            outline_px,
        };
        let what = format!("label {} in {} {number}", label.target, label.camera);
        self.learn(&label.target, what, |samples| {
            // The last label of a frame counts.
            samples
                .retain(|other| (&other.camera, other.number) != (&sample.camera, sample.number));
            samples.push(sample);
            Ok(())
        })
    }

    /// Removes a label.
    pub(super) fn unlabel(&self, target: &str, number: usize) -> Result<()> {
        self.learn(target, format!("remove a label of {target}"), |samples| {
            if number >= samples.len() {
                return Err(user_error!("targets.{target}: has no label {number}"));
            }
            samples.remove(number);
            Ok(())
        })
    }

    /// Changes the labels of a target, and learns its colours from them.
    fn learn(
        &self,
        target: &str,
        what: String,
        change: impl FnOnce(&mut Vec<Sample>) -> Result<()>,
    ) -> Result<()> {
        let file = self.inner().colors_file(target)?;
        let mut learnt = None;
        self.edit(&format!("targets.{target}.colors"), what, |state| {
            let samples = state.samples.entry(target.to_owned()).or_default();
            change(samples)?;
            if samples.is_empty() {
                // What was learnt from labels that are gone.
                state.files.remove(&file);
            } else {
                let learnt = learnt.insert(learn_samples(samples)?);
                // A model that was not learnt here stays as it is.
                let is_own = state.files.contains_key(&file) || !file.exists();
                if !is_own {
                    return Err(user_error!(
                        "{}: holds colours that were learnt before; press Learn them anew in the step Colours",
                        file.shown()
                    ));
                }
                state.files.insert(file, learnt.model.to_text().into());
            }
            Ok(())
        })?;
        let learnt = learnt.map(|learnt| (target.to_owned(), learnt));
        self.inner().learnt.extend(learnt);
        Ok(())
    }

    /// Shows what in the picture of a camera has the colours of a target.
    pub(super) fn show_marked(&self, target: &str, camera: &str) -> Result<Value> {
        let mut inner = self.inner();
        let (number, frame) = inner.shown(camera)?;
        let learnt = inner.learnt(target)?;
        let (picture, share) = learnt.marked(&frame);
        let about = json!({
            "index": number,
            "share": share,
            "found": learnt.found,
            "mistaken": learnt.mistaken,
            "failed": learnt.failed,
        });
        let jpeg = jpeg_of(&picture)?;
        self.feed.show_image("marked", &about, &jpeg);
        Ok(about)
    }
}

impl Inner {
    /// Returns the frame that a camera shows, with its number.
    pub(super) fn shown(&self, camera: &str) -> Result<(usize, pardalis::Frame)> {
        self.player(camera)?.shown().ok_or_else(|| {
            user_error!("cameras.{camera}: shows no frame yet; wait for its picture")
        })
    }

    /// Returns the lens of a camera, if it is known well enough for the outline of a ball.
    pub(super) fn lens(&self, camera: &str) -> Option<Camera> {
        let cameras = self.parts().scene.cameras.into_iter();
        let mut named = cameras.filter(|one| one.name == camera);
        // That of a plane sees no heights.
        named
            .next()
            .map(|one| one.camera)
            .filter(|lens| !matches!(lens, Camera::Plane(_)))
    }

    /// Describes the images of a camera for `init`'s guesses.
    pub(super) fn opened(&self, camera: &str) -> Result<Opened> {
        let size = self.player(camera)?.size_px().ok_or_else(|| {
            user_error!("cameras.{camera}: has no picture yet; wait for it, or see the problems of the step Sources")
        })?;
        Ok(Opened {
            size,
            input: Input::Video,
        })
    }

    /// Returns the file of the colours of a target.
    pub(super) fn colors_file(&self, target: &str) -> Result<PathBuf> {
        let table = self.table_of("targets", target);
        let table = table
            .ok_or_else(|| user_error!("targets.{target}: is not in the scene; add it first"))?;
        let name = table.get("colors").and_then(toml::Value::as_str);
        let name = name.ok_or_else(|| {
            user_error!(
                "targets.{target}: has no colours of its own, but perhaps landmarks or a detector"
            )
        })?;
        Ok(self.project.folder().join(name))
    }

    /// Returns what the samples of a target teach.
    fn learnt(&mut self, target: &str) -> Result<&Learnt> {
        if !self.learnt.contains_key(target) {
            let samples = self.project.now().samples.get(target);
            let samples = samples
                .filter(|samples| !samples.is_empty())
                .ok_or_else(|| {
                    user_error!(
                        "targets.{target}: is labelled in no frame; click it in a picture first"
                    )
                })?;
            let learnt = learn_samples(samples)?;
            self.learnt.insert(target.to_owned(), learnt);
        }
        Ok(&self.learnt[target])
    }
}

/// Reports whether an outline is around a place, or nearly: small balls are not hit exactly.
fn is_around(outline_px: &[[f64; 2]], at_px: [f64; 2]) -> bool {
    let count = outline_px.len() as f64;
    let middle = [0, 1].map(|axis| outline_px.iter().map(|point| point[axis]).sum::<f64>() / count);
    let away = |[u, v]: [f64; 2]| libm::hypot(u - middle[0], v - middle[1]);
    let radius_px = outline_px.iter().map(|point| away(*point)).sum::<f64>() / count;
    away(at_px) <= 1.3 * radius_px + 2.0
}

/// Returns a name of a camera that the scene does not have.
fn unused_name(text: &str, wanted: &str) -> String {
    let table: toml::Table = text.parse().unwrap_or_default();
    let cameras = table.get("cameras").and_then(toml::Value::as_table);
    let is_free = |name: &String| cameras.is_none_or(|cameras| !cameras.contains_key(name));
    let numbered = (2..).map(|number| format!("{wanted}-{number}"));
    let mut names = std::iter::once(wanted.to_owned()).chain(numbered);
    names.find(is_free).unwrap_or_else(|| wanted.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outlines_are_around_places_within_or_beside_them() {
        let circle = |radius_px: f64| {
            let angles = (0..36).map(|step| f64::from(step).to_radians() * 10.0);
            let points = angles.map(|a| [100.0 + radius_px * a.cos(), 50.0 + radius_px * a.sin()]);
            points.collect::<Vec<_>>()
        };
        assert!(is_around(&circle(20.0), [110.0, 45.0]));
        assert!(is_around(&circle(3.0), [104.0, 53.0]));
        assert!(!is_around(&circle(20.0), [130.0, 50.0]));
        assert!(!is_around(&circle(3.0), [110.0, 50.0]));
    }
}
