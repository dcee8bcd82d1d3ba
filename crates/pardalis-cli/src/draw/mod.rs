//! Pictures for people: plots of tracks, images with estimates drawn over them, colour models.
//!
//! Plots are drawn once, as SVG and in pixels with the bundled font, so that both look the same on every
//! machine. Overlays and mosaics are drawn into the pixels of an image.

pub(crate) mod calibration;
pub(crate) mod camera_symbol;
pub(crate) mod errors;
pub(crate) mod grid;
pub(crate) mod histogram;
mod legend;
pub(crate) mod lens;
pub(crate) mod likelihood;
mod limits;
pub(crate) mod mosaic;
mod oblique;
pub(crate) mod overlay;
mod panel;
pub(crate) mod paths;
pub(crate) mod picture;
pub(crate) mod plots;
pub(crate) mod reliability;
mod sheet;
pub(crate) mod svg;
pub(crate) mod sweep;
pub(crate) mod temporal;
mod text;

/// Red, green, blue.
pub(crate) type Rgb = [u8; 3];

/// The colours of Okabe and Ito, which colour-blind people can distinguish, without yellow, which is too pale on white.
pub(crate) const PALETTE: [Rgb; 6] = [
    [0, 114, 178],
    [213, 94, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [230, 159, 0],
];

/// Text, axes and truth.
const INK: Rgb = [40, 40, 40];

/// Returns the text without control characters, which XML forbids, and shortened with an ellipsis if it is too long.
fn shortened(text: &str, max_chars: usize) -> String {
    let clean: Vec<char> = text.chars().filter(|c| !c.is_control()).collect();
    if clean.len() <= max_chars {
        return clean.into_iter().collect();
    }
    let kept = clean.into_iter().take(max_chars.saturating_sub(1));
    kept.chain(['…']).collect()
}

/// Returns a folder with this name, beside the test program, for the pictures of one test.
#[cfg(test)]
fn test_folder(name: &str) -> std::path::PathBuf {
    let program = std::env::current_exe().expect("the test program has a path");
    let folder = program.with_file_name("draw-tests").join(name);
    std::fs::create_dir_all(&folder).expect("the build folder can be written to");
    folder
}
