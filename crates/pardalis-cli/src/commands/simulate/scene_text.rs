//! The scene file of a simulated sequence.

use std::fmt::Write as _;

use pardalis_scene::WorldConfig;
use pardalis_simulate::{Body, Course, Object, Path, Placed, Platform};

use super::{Sequence, detections, frames, tables};

/// Returns the text of scene.toml.
pub(super) fn of(sequence: &Sequence) -> String {
    let world = sequence.world();
    let mut text = format!(
        "# Written by pardalis simulate from world.toml.\nseed = {}\n",
        world.seed
    );
    if world
        .cameras
        .iter()
        .any(|camera| camera.timing.has_delays())
    {
        let delays = sequence
            .deliveries
            .iter()
            .flatten()
            .map(|d| d.arrival_s - d.stamp_s);
        let least_s = delays.clone().fold(f64::INFINITY, f64::min);
        let most_s = delays.fold(f64::NEG_INFINITY, f64::max);
        // Rounded up to a hundredth, so that the wait suffices but is not longer than necessary.
        let max_delay_s = (1.0 + (100.0 * (most_s - least_s)).ceil()).min(6000.0) / 100.0;
        let _ = write!(
            text,
            "\n[timing]\nmax_delay_s = {max_delay_s:?}  # largest delay of frames\n"
        );
    }
    for platform in &world.platforms {
        push_platform(&mut text, platform);
    }
    for (number, camera) in world.cameras.iter().enumerate() {
        let deliveries = &sequence.deliveries[number];
        let folder = frames::folder_of(sequence, number);
        // Writing to a String cannot fail. Paths use slashes on all platforms.
        let folder = folder.to_string_lossy().into_owned().replace('\\', "/");
        let _ = write!(
            text,
            "\n[cameras.{}]\nimages = \"{folder}\"\ncalibration = \"cameras.toml\"\n",
            camera.name
        );
        if sequence.config.detector.is_some() {
            let file = detections::file_of(sequence, number);
            let file = file.to_string_lossy().into_owned().replace('\\', "/");
            let _ = writeln!(text, "detections = \"{file}\"");
        }
        if let Some(platform) = camera.platform {
            let _ = writeln!(text, "platform = \"{}\"", world.platforms[platform].name);
        }
        let line_delay_s = camera.image.line_delay_s;
        if line_delay_s != 0.0 {
            let _ = writeln!(text, "line_delay_s = {line_delay_s:?}");
        }
        let errors = deliveries.iter().map(|d| d.stamp_s - d.time_s);
        let mean_s = errors.sum::<f64>() / deliveries.len() as f64;
        if mean_s != 0.0 {
            let _ = writeln!(
                text,
                "# Its clock is wrong; this undoes it:\n# time_offset_s = {:.6}",
                -mean_s
            );
        }
    }
    let times = sequence.deliveries.iter().flatten().map(|d| d.time_s);
    let placed = world.placed(times.fold(f64::INFINITY, f64::min));
    let targets = world
        .objects
        .iter()
        .zip(&placed)
        .filter(|(o, _)| o.is_target);
    let mut crowds = Vec::new();
    for (object, placed) in targets {
        if object.crowd.is_some() && crowds.contains(&object.target_name()) {
            continue;
        }
        crowds.push(object.target_name());
        push_target(&mut text, object, placed, &sequence.config);
    }
    text
}

/// Writes the table of a platform with the odometry, which begins where the platform is at 0 s.
fn push_platform(text: &mut String, platform: &Platform) {
    let start = platform.pose(0.0);
    let position_m: [f64; 3] = start.translation.vector.into();
    let heading_deg = start.rotation.euler_angles().2.to_degrees();
    let [odometry, poses] = [tables::odometry_of(platform), tables::poses_of(platform)];
    let _ = write!(
        text,
        "\n[platforms.{}]\n# In place of the rest, poses = \"{poses}\" has its true poses.\nodometry = \"{odometry}\"\n\
         start_position_m = {:?}\nstart_heading_deg = {:?}\n",
        platform.name,
        position_m.map(|c| c + 0.0),
        heading_deg + 0.0,
    );
}

/// Returns the file name of a target's colour model.
pub(super) fn colors_of(target: &Object) -> String {
    format!("{}.colors.toml", target.target_name())
}

fn push_target(text: &mut String, object: &Object, placed: &Placed, config: &WorldConfig) {
    let shape = match object.body {
        Body::Sphere { radius_m } => format!("sphere.radius_m = {radius_m:?}"),
        Body::Cylinder { radius_m, height_m } => {
            format!("cylinder = {{ radius_m = {radius_m:?}, height_m = {height_m:?} }}")
        }
        Body::Box { size_m } => {
            let size_m: [f64; 3] = size_m.into();
            format!("box.size_m = {size_m:?}")
        }
        _ => unreachable!("world files allow only spheres, cylinders and boxes as targets"),
    };
    let (name, colors) = (object.target_name(), colors_of(object));
    let count = object.crowd.as_ref().map(|_| "count = \"any\"\n");
    if let Some(detector) = &config.detector {
        let _ = write!(
            text,
            "\n[targets.{name}]\n{}shape.{shape}\ndetector = {{ detection_probability = {:?}, false_per_image = {:?}, side_sigma = {:?} }}\n",
            count.unwrap_or_default(),
            detector.detection_probability,
            detector.false_per_image,
            detector.side_sigma
        );
        return;
    }
    // The published cues track neither crowds nor bodies that turn: both are found without a start.
    let is_found = count.is_some() || matches!(object.body, Body::Box { .. });
    let Some(sigma_m) = config.start_sigma_m.filter(|_| !is_found) else {
        let count = count.unwrap_or_default();
        let _ = write!(
            text,
            "\n[targets.{name}]\n{count}shape.{shape}\ncolors = \"{colors}\"\n"
        );
        return;
    };
    let motion = match object.body {
        Body::Sphere { .. } => "constant_velocity",
        _ => "planar_constant_velocity",
    };
    // Only bounces are abrupt; all other motion is smooth.
    let density = match &object.course {
        Course::Path(Path::Throw(_)) => 100.0,
        _ => 2.0,
    };
    let shown = |v: [f64; 3]| v.map(|c| c + 0.0);
    let _ = write!(
        text,
        "\n[targets.{name}]\nshape.{shape}\ncolors = \"{colors}\"\n\
         motion.{motion}.acceleration_density_m2ps3 = {density:?}\n\n[targets.{name}.start.gaussian]\n\
         position_m = {position:?}\nposition_sigma_m = {sigma_m:?}\nvelocity_mps = {velocity:?}\n",
        position = shown(placed.position_m.into()),
        velocity = shown(placed.velocity_mps.into()),
    );
}
