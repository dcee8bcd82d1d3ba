//! What a simulated detector finds in the images of each camera.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use pardalis_simulate::Detector;
use rayon::prelude::*;

use super::Sequence;
use crate::folder::Folder;

/// Returns the file of a camera's boxes.
pub(super) fn file_of(sequence: &Sequence, camera: usize) -> PathBuf {
    let name = &sequence.world().cameras[camera].name;
    PathBuf::from("detections").join(format!("{name}.csv"))
}

/// Writes the boxes of all cameras. The class of clutter is that of one of the targets, too.
pub(super) fn write(sequence: &Sequence, detector: &Detector, folder: &Folder) -> Result<()> {
    let world = sequence.world();
    let targets: Vec<&str> = world
        .objects
        .iter()
        .filter(|object| object.is_target)
        .map(pardalis_simulate::Object::target_name)
        .collect();
    folder.make(&PathBuf::from("detections"))?;
    for (camera, deliveries) in sequence.deliveries.iter().enumerate() {
        let rows_of = |(frame, delivery): (usize, &pardalis_simulate::Delivery)| {
            let mut rows = String::new();
            for found in detector.detect(world, camera, delivery.shown) {
                let class = match found.object {
                    Some(object) => world.objects[object].target_name(),
                    None => targets[frame % targets.len()],
                };
                let [u0, v0, u1, v1] = found.sides_px;
                let _ = writeln!(
                    rows,
                    "{frame},{class},{u0:.2},{v0:.2},{u1:.2},{v1:.2},{:.4}",
                    found.score
                );
            }
            rows
        };
        let rows: Vec<String> = deliveries.par_iter().enumerate().map(rows_of).collect();
        let text =
            "frame,class,left_px,top_px,right_px,bottom_px,score\n".to_owned() + &rows.concat();
        folder.write(file_of(sequence, camera), text.as_bytes())?;
    }
    Ok(())
}
