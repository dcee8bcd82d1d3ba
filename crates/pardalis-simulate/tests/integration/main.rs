//! Integration tests of simulation, in one executable.

mod realism;
mod simulate;

use pardalis_scene::WorldConfig;
use pardalis_simulate::World;

/// Parses a world that refers to no calibration files.
#[track_caller]
fn world(text: &str) -> World {
    let config = WorldConfig::parse(text, &|_, _| Err("no files in this test".to_owned()));
    config
        .unwrap_or_else(|problems| panic!("{problems:#?}"))
        .world
}
