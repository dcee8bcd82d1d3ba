//! Stills in different light with the targets at other positions, their masks, and the colour models learnt from them.

use std::path::PathBuf;

use anyhow::Result;
use pardalis::Frame;
use pardalis::color::{ColorLearner, Palette};
use pardalis_core::rng::{Draws, Stage};
use pardalis_images::{GrayImage, encode_png};
use pardalis_simulate::{Body, Course, Object, Path, Renderer, World, truth};

use super::frames;
use super::{Sequence, scene_text};
use crate::folder::Folder;
use crate::output::Shown;
use crate::progress::Progress;
use crate::source::decode::decode_image;
use crate::user_error::user_error;

/// Maximum number of attempts to find a view of a target.
const ATTEMPTS: u32 = 200;
/// Minimum visible share of a target in a still.
const VISIBLE: f64 = 0.8;
/// Minimum covered share of a pixel for it to belong to the target.
const COVERED: f32 = 0.5;

/// Writes `training/NNN.*` with `NNN_TARGET_mask.png`, 255 on the target, and each target's colour model. Stills
/// cycle through cameras, targets and the members of crowds.
pub(super) fn write(sequence: &Sequence, folder: &Folder, progress: &Progress) -> Result<()> {
    let world = sequence.world();
    let targets = targets(world);
    let mut learners = Vec::new();
    for _ in &targets {
        learners.push(ColorLearner::new(Palette::HSI)?);
    }
    let images = PathBuf::from("training");
    folder.make(&images)?;
    for still in 0..sequence.config.training_stills {
        let (_, members) = &targets[still % targets.len()];
        let first = still / targets.len();
        let mut wanted = (0..members.len()).map(|member| members[(first + member) % members.len()]);
        let found = wanted.find_map(|wanted| staged(world, wanted, still as u32));
        let Some((world, number)) = found else {
            progress.step()?;
            continue;
        };
        let camera = &world.cameras[number];
        let renderer = Renderer::new(&world, number);
        let bytes = frames::encoded(camera, renderer.image(u32::MAX - still as u32, 0.0))?;
        let name = format!("{still:03}.{}", frames::ending_of(camera));
        folder.write(images.join(&name), &bytes)?;
        // As seen when learning: after compression.
        let decoded = decode_image(&folder.path_of("training").join(&name))?;
        let (width, height) = camera.size_px;
        let frame = Frame::from_rgb(width, height, decoded.into_raw(), 0.0)?;
        for (learner, (target, members)) in learners.iter_mut().zip(&targets) {
            let mut mask = vec![false; width * height];
            for &member in members {
                let coverage = renderer.coverage(member, 0.0);
                for (is_target, share) in mask.iter_mut().zip(coverage) {
                    *is_target |= share >= COVERED;
                }
            }
            learner.add(&frame, &mask)?;
            let grey: Vec<u8> = mask
                .iter()
                .map(|&is_target| 255 * u8::from(is_target))
                .collect();
            let mask = GrayImage::from_raw(width as u32, height as u32, grey);
            let bytes = encode_png(&mask.expect("one byte per pixel"))?;
            let mask_name = format!("{still:03}_{target}_mask.png");
            folder.write(images.join(mask_name), &bytes)?;
        }
        progress.step()?;
    }
    for (learner, (_, members)) in learners.iter().zip(&targets) {
        let model = learner.learn().map_err(|_| {
            user_error!(
                "{}: objects.{}: none of {} stills shows it, so its colours cannot be learnt; place it in view of a camera, or set training_stills = 0",
                sequence.path.shown(),
                world.objects[members[0]].name,
                sequence.config.training_stills
            )
        })?;
        let path = scene_text::colors_of(&world.objects[members[0]]);
        folder.write(path, model.to_text().as_bytes())?;
    }
    Ok(())
}

/// Returns the names of the targets and the numbers of the objects of each: one, or the members of a crowd.
fn targets(world: &World) -> Vec<(&str, Vec<usize>)> {
    let mut targets: Vec<(&str, Vec<usize>)> = Vec::new();
    for (number, object) in world.objects.iter().enumerate() {
        let name = object.target_name();
        let known = targets.iter_mut().find(|(target, _)| *target == name);
        match known {
            _ if !object.is_target => {}
            Some((_, members)) => members.push(number),
            None => targets.push((name, vec![number])),
        }
    }
    targets
}

/// Returns the world of a still, in which nothing moves, and the index of the camera that sees the target; `None` if no
/// view is found.
fn staged(world: &World, target: usize, still: u32) -> Option<(World, usize)> {
    let draws = Draws::new(world.seed, still);
    (0..ATTEMPTS).find_map(|attempt| {
        let uniform = |what: u32| draws.uniform(what, attempt, Stage::Still);
        let around = |what: u32, reach: f64| reach * (2.0 * uniform(what) - 1.0);
        let mut staged = world.clone();
        let time_s = world.duration_s * uniform(0);
        for camera in &mut staged.cameras {
            camera.world_from_camera = world.world_from_camera(camera, time_s);
            camera.platform = None;
        }
        let placed = world.placed(time_s);
        for (object, placed) in staged.objects.iter_mut().zip(placed) {
            let mut position_m = placed.position_m;
            if object.is_target {
                let width_m = width_m(object);
                position_m.x += around(1, width_m);
                position_m.y += around(2, width_m);
            }
            object.heading_rad = Some(placed.heading_rad);
            (object.tilt_rad, object.spin_rad_per_s) = (placed.tilt_rad, 0.0);
            object.course = Course::Path(Path::Still { position_m });
        }
        let light = &mut staged.light;
        light.direction.x += around(3, 0.5);
        light.direction.y += around(4, 0.5);
        light.direction = light.direction.normalize();
        light.ambient = (light.ambient + around(5, 0.2)).clamp(0.0, 1.0);
        let number = (still + attempt) as usize % staged.cameras.len();
        let seen = truth(&staged, &staged.cameras[number], 0.0)[target];
        (seen.visible_fraction >= VISIBLE).then_some((staged, number))
    })
}

/// Returns the width of a target.
fn width_m(target: &Object) -> f64 {
    match target.body {
        Body::Sphere { radius_m } | Body::Cylinder { radius_m, .. } => 2.0 * radius_m,
        Body::Box { size_m } => size_m.x.max(size_m.y),
        _ => unreachable!("world files allow only spheres, cylinders and boxes as targets"),
    }
}
