//! Compares tracks of this checkout with those of another, byte by byte: what a change of structure must leave as it is.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};

/// Scenes of `experiments/` that cover the default path (edge/) and the published cues.
const SCENES: [&str; 16] = [
    "edge/fisheye",
    "edge/mirror",
    "edge/plane",
    "edge/two-balls",
    "edge/webcams-four",
    "edge/webcams-two",
    "jump/scene",
    "occlusion-bar/scene",
    "plane/contour",
    "plane/scene",
    "ramp/scene",
    "robot/scene",
    "two-balls/scene",
    "webcams-four/scene",
    "webcams-two/contour",
    "webcams-two/scene",
];

/// Tracks every scene in both checkouts. Rows may have further columns here, at their ends.
pub(crate) fn run(root: &Path, other: &Path) -> Result<()> {
    let mut different = Vec::new();
    for scene in SCENES {
        let here = tracks(root, scene)?;
        let there = tracks(other, scene)?;
        let same = here.lines().count() == there.lines().count()
            && here
                .lines()
                .zip(there.lines())
                .all(|(new, old)| new == old || new.starts_with(&format!("{old},")));
        println!("{} {scene}", if same { "same     " } else { "DIFFERENT" });
        if !same {
            different.push(scene);
        }
    }
    if !different.is_empty() {
        bail!("tracks differ: {}", different.join(", "));
    }
    Ok(())
}

/// Returns the rows that the release binary of a checkout writes for a scene.
fn tracks(checkout: &Path, scene: &str) -> Result<String> {
    let binary = checkout.join("target/release/pardalis");
    let output = Command::new(&binary)
        .current_dir(checkout)
        .args(["track", &format!("experiments/{scene}.toml"), "-o", "-"])
        .output()
        .with_context(|| {
            format!(
                "{}: build it with `cargo build --release`",
                binary.display()
            )
        })?;
    if !output.status.success() {
        bail!(
            "{}: {scene}: {}",
            binary.display(),
            String::from_utf8_lossy(&output.stderr)
        );
    }
    Ok(String::from_utf8(output.stdout)?)
}
