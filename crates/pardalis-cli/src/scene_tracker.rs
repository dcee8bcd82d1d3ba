//! The tracker of a scene for a caller who has the frames, such as the Python package.

use std::path::Path;

use anyhow::Result;
use pardalis::Tracker;
use pardalis_scene::{Assembly, CameraConfig, Problem, Scene};

use crate::scene::{problems_in, read_scene_text};
use crate::scene_files::{SceneFiles, read_calibration};
use crate::user_error::user_error;

/// The name of a scene that is in no file, in messages.
const NO_FILE: &str = "the settings";

/// Reads the scene in a file, with some settings replaced, and checks everything in it that needs no images. Its inputs are not opened.
///
/// # Errors
///
/// What is wrong with the file, or every problem of the scene.
pub fn scene_without_inputs(file: &Path, settings: &toml::Table) -> Result<Scene> {
    let scene = parsed(Some(file), settings)?;
    let files = SceneFiles::of(folder_of(file));
    let mut assembly = Assembly::default();
    for camera in &scene.cameras {
        assembly.add_camera(camera, None, &files);
    }
    assembly.add_targets(&scene, true, &files);
    if assembly.problems.is_empty() {
        return Ok(scene);
    }
    assembly.problems.sort();
    Err(problems_in("scene", file, &assembly.problems))
}

/// Reads the scene in a file, with some settings replaced or added, or the scene that these settings are without a file.
fn parsed(file: Option<&Path>, settings: &toml::Table) -> Result<Scene> {
    let path = file.unwrap_or(Path::new(NO_FILE));
    let text = file.map_or(Ok(String::new()), read_scene_text)?;
    let scene = Scene::parse_without_inputs(&text, settings, &|name, lens| {
        read_calibration(folder_of(path), name, lens)
    });
    scene.map_err(|problems| problems_in("scene", path, &problems))
}

fn folder_of(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new(""))
}

/// Reads the scene in a file, with some settings replaced or added, or the scene that these settings are without a file, and returns it with its
/// tracker. Relative paths start at the file's folder, otherwise at the current one.
///
/// `settings` maps full keys, such as `targets.ball.filter.particles`, to values. The inputs of cameras and platforms are not opened: the caller has the
/// frames. Each image has the size given for its camera here (width and height in pixels), or else in the scene or its calibration file.
///
/// # Errors
///
/// What is wrong with the file, or every problem of the scene.
pub fn tracker_of_scene(
    file: Option<&Path>,
    settings: &toml::Table,
    sizes_px: &[(String, (usize, usize))],
) -> Result<(Scene, Tracker)> {
    let path = file.unwrap_or(Path::new(NO_FILE));
    let scene = parsed(file, settings)?;
    let is_camera = |name: &str| scene.cameras.iter().any(|camera| camera.name == name);
    if let Some((unknown, _)) = sizes_px.iter().find(|(name, _)| !is_camera(name)) {
        let names: Vec<&str> = scene.cameras.iter().map(|camera| &*camera.name).collect();
        return Err(user_error!(
            "size_px: there is no camera \"{unknown}\"; allowed: {}",
            names.join(", ")
        ));
    }
    let files = SceneFiles::of(folder_of(path));
    let mut assembly = Assembly::default();
    for camera in &scene.cameras {
        let given = sizes_px.iter().find(|(name, _)| *name == camera.name);
        let size_px = given.map_or_else(|| stated_size_px(camera), |(_, size_px)| Ok(*size_px));
        let size_px = size_px.map_err(|problem| assembly.problems.push(problem));
        assembly.add_camera(camera, size_px.ok(), &files);
        if let Some(rectangle) = &camera.rectangle {
            let message = "is found in the images of the scene, which are not read; give the corners as model.plane";
            assembly.problems.push(rectangle.problem(message));
        }
    }
    assembly.add_targets(&scene, true, &files);
    let tracker = assembly.finish(&scene);
    let tracker = tracker.map_err(|problems| problems_in("scene", path, &problems))?;
    Ok((scene, tracker))
}

/// The size of a camera's images that the scene or its calibration file states.
fn stated_size_px(camera: &CameraConfig) -> Result<(usize, usize), Problem> {
    match &camera.size_px {
        Some(stated) => {
            let [width, height] = stated.value;
            Ok((width as usize, height as usize))
        }
        None => Err(Problem {
            line: camera.input.place().line,
            key: format!("cameras.{}.size_px", camera.name),
            message: "is missing; give the width and height of its images".to_owned(),
        }),
    }
}
