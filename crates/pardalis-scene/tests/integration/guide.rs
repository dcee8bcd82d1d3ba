//! The cameras in the pages of the guide: every table is one that a scene accepts.

use std::fs;
use std::path::Path;

use pardalis_camera::formats::Lens;
use pardalis_camera::{CalibratedCamera, Pinhole, Pose};
use pardalis_scene::{Input, Scene, WorldConfig};

/// What the pages leave to the user.
const TARGET: &str = "[targets.ball]\nshape.sphere.radius_m = 0.1\ncolors = \"ball.colors.toml\"\n";

/// Returns the blocks of a page in TOML, each with its first line.
fn blocks(page: &str) -> Vec<(usize, String)> {
    let mut blocks: Vec<(usize, String)> = Vec::new();
    let mut is_inside = false;
    for (number, line) in page.lines().enumerate() {
        match line {
            "```toml" => {
                is_inside = true;
                blocks.push((number + 2, String::new()));
            }
            "```" => is_inside = false,
            line if is_inside => {
                let (_, block) = blocks.last_mut().unwrap();
                *block += line;
                block.push('\n');
            }
            _ => {}
        }
    }
    blocks
}

/// A calibration in place of the file of this name, which only the user has.
fn calibration(_: &str, _: Option<Lens>) -> Result<Vec<CalibratedCamera>, String> {
    let lens = Pinhole::new([900.0; 2], [639.5, 359.5], &[]).map_err(|error| error.to_string())?;
    Ok(vec![CalibratedCamera {
        name: "camera".to_owned(),
        camera: lens.into(),
        size_px: Some((1280, 720)),
        world_from_camera: Some(Pose::identity()),
    }])
}

#[test]
fn cameras_of_the_guide_are_accepted() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs");
    for page in ["cameras-live.md", "videos.md"] {
        let text = fs::read_to_string(docs.join(page)).unwrap();
        let blocks = blocks(&text);
        assert!(blocks.len() > 1, "{page}");
        for (line, block) in blocks {
            let scene = Scene::parse(&format!("{block}{TARGET}"), &calibration);
            let scene =
                scene.unwrap_or_else(|problems| panic!("{page}, line {line}: {problems:?}"));
            for camera in scene.cameras {
                let is_video = matches!(camera.input, Input::Video { .. });
                assert!(is_video, "{page}, line {line}: {}", camera.name);
            }
        }
    }
}

#[test]
fn objects_and_image_of_the_guide_to_simulation_are_accepted() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/simulation.md");
    let blocks = blocks(&fs::read_to_string(page).unwrap());
    let [(line, block)] = &blocks[..] else {
        panic!("expected one block, found {}", blocks.len());
    };
    let before = "duration_s = 1\n[cameras.eye]\nsize_px = [64, 48]\nlook_from_m = [0, 0, 1]\nlook_at_m = [2, 0, 0]\n\
                  model.pinhole = { f_px = [60, 60], center_px = [31.5, 23.5] }\n";
    let config = WorldConfig::parse(&format!("{before}{block}"), &calibration);
    let config = config.unwrap_or_else(|problems| panic!("line {line}: {problems:?}"));
    assert_eq!(config.world.objects.len(), 3);
}
