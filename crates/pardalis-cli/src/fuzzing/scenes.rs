//! Scenes, worlds, experiments, colour models, boards and summaries.

use std::path::Path;
use std::sync::LazyLock;

use pardalis::color::ColorModel;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_core::Error;
use pardalis_scene::experiment::{Experiment, Run};
use pardalis_scene::{Scene, WorldConfig};

use super::{check_finite, check_problems, text_of};
use crate::board;
use crate::commands::evaluate::RunSummary;
use crate::fuzzed_file::{FILE, check_error, check_message};

/// Stands for the calibration files that scenes and worlds name, whatever the lens.
const CALIBRATION: &str = "[cameras.left]\nsize_px = [640, 480]\nmodel.pinhole = { f_px = [500, 500], center_px = [320, 240] }\n\
     world_from_camera = [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 1], [0, 0, 0, 1]]\n";

fn calibration(file: &str, _: Option<Lens>) -> Result<Vec<CalibratedCamera>, String> {
    static CAMERAS: LazyLock<Vec<CalibratedCamera>> = LazyLock::new(|| {
        pardalis_scene::calibration::read(CALIBRATION, None).expect("a valid calibration")
    });
    if file == "missing.toml" {
        return Err("there is no such file".to_owned());
    }
    Ok(CAMERAS.clone())
}

pub(super) fn scene(bytes: &[u8]) -> bool {
    let Some(text) = text_of(bytes) else {
        return false;
    };
    // `Scene::parse` is the same, without the parts that are sound.
    let (scene, problems) = Scene::parse_parts(&text, &calibration);
    if !problems.is_empty() {
        check_problems(&problems, &text);
        return false;
    }
    assert!(!scene.cameras.is_empty() && !scene.targets.is_empty());
    check_finite(&toml::Value::Table(scene.resolved));
    true
}

pub(super) fn world(bytes: &[u8]) -> bool {
    let Some(text) = text_of(bytes) else {
        return false;
    };
    match WorldConfig::parse(&text, &calibration) {
        Ok(config) => {
            assert!(config.start_sigma_m.is_none_or(f64::is_finite));
            assert!(!config.world.cameras.is_empty());
            true
        }
        Err(problems) => {
            check_problems(&problems, &text);
            false
        }
    }
}

pub(super) fn experiment(bytes: &[u8]) -> bool {
    let Some(text) = text_of(bytes) else {
        return false;
    };
    match Experiment::parse(&text) {
        Ok(experiment) => {
            let slugs: Vec<_> = experiment.runs.iter().map(Run::slug).collect();
            for (index, slug) in slugs.iter().enumerate() {
                assert!(!slugs[..index].contains(slug), "{slug} twice");
                // Runs write into folders of these names.
                assert!(
                    !slug.is_empty() && !slug.contains(['/', '\\', '.']),
                    "{slug}"
                );
            }
            true
        }
        Err(problems) => {
            check_problems(&problems, &text);
            false
        }
    }
}

pub(super) fn colors(bytes: &[u8]) -> bool {
    let Some(text) = text_of(bytes) else {
        return false;
    };
    match ColorModel::from_text(&text) {
        Ok(model) => {
            let written = model.to_text();
            assert_eq!(ColorModel::from_text(&written), Ok(model), "{written}");
            true
        }
        Err(error) => {
            check_message(&error.to_string());
            let Error::Parse { line, .. } = error else {
                panic!("{error} names no line");
            };
            assert!(
                (1..=text.matches('\n').count() + 1).contains(&line),
                "{error}"
            );
            false
        }
    }
}

pub(super) fn board(bytes: &[u8]) -> bool {
    let is_read = ["toml", "yaml"].map(|extension| {
        let name = format!("{FILE}.{extension}");
        let read = |path: &Path| crate::scene_files::text_in(path, bytes.to_vec());
        match board::parse_with(&name, read) {
            Ok(board) => {
                assert!((4..=160_000).contains(&board.corner_count()), "{board:?}");
                assert!(board.side_m() > 0.0 && board.side_m().is_finite());
                true
            }
            Err(error) => {
                check_error(&error);
                false
            }
        }
    });
    is_read.contains(&true)
}

pub(super) fn summary(bytes: &[u8]) -> bool {
    let Some(text) = text_of(bytes) else {
        return false;
    };
    let path = Path::new(FILE);
    let read = RunSummary::parse(path, &text).and_then(|summary| summary.first_camera(path));
    match read {
        Ok(point) => {
            assert!(point.position_m.iter().all(|x| x.is_finite()));
            true
        }
        Err(error) => {
            check_error(&error);
            false
        }
    }
}
