//! Labelled images beside the scores that a colour model gives to their pixels.

use std::path::Path;

use pardalis_images::RgbImage;
use tiny_skia::{Paint, PathBuilder, Pixmap, Stroke, Transform};

use super::picture::{canvas_of, opaque, picture_from, write_picture};
use super::text::{Caption, write_caption};
use super::{INK, Rgb};

/// One labelled image and its scores.
#[derive(Debug, Clone)]
pub(crate) struct Tile {
    /// The text above it.
    pub(crate) label: String,
    /// The image.
    pub(crate) image: RgbImage,
    /// Which pixels are the object's, row by row.
    pub(crate) mask: Vec<bool>,
    /// The log odds of each pixel, row by row.
    pub(crate) log_odds: Vec<f32>,
    /// The outline that the detector found, pixel centres at integers; empty if there is none.
    pub(crate) found_px: Vec<[f64; 2]>,
}

const SIDE_PX: u32 = 220;
const GAP_PX: u32 = 10;
const LABEL_PX: u32 = 22;
const KEY_PX: u32 = 44;
/// Side of the shown square, as a multiple of the object's size.
const SURROUNDINGS: f64 = 2.0;
const MIN_SHOWN_PX: f64 = 16.0;

const PAPER: Rgb = [255; 3];
const OUTSIDE: Rgb = [200; 3];
const FOUND: Rgb = [255, 0, 255];
/// Colours of scores far below, at and far above the threshold.
const COLD: Rgb = [0, 90, 181];
const NEUTRAL: Rgb = [247; 3];
const WARM: Rgb = [220, 50, 32];

/// Draws, for each image, the surroundings of the object with the outline of its mask in black and white and the found
/// one in magenta, and its scores: red above the threshold, blue below. Two pairs lie side by side.
pub(crate) fn write_mosaic(
    path: &Path,
    tiles: impl IntoIterator<Item = anyhow::Result<Tile>>,
    threshold: f32,
) -> anyhow::Result<()> {
    // Images can be large, and there may be many: each is dropped before the next is made.
    let tiles = tiles.into_iter().map(|tile| Ok(Drawn::of(tile?)));
    let tiles: Vec<Drawn> = tiles.collect::<anyhow::Result<_>>()?;
    let columns = (tiles.len() as u32).clamp(1, 2);
    let rows = (tiles.len() as u32).div_ceil(columns);
    let pair_px = 2 * SIDE_PX + 2;
    let row_px = LABEL_PX + SIDE_PX + GAP_PX;
    let mut picture = RgbImage::from_pixel(
        GAP_PX + columns * (pair_px + GAP_PX),
        rows * row_px + KEY_PX,
        PAPER,
    );
    let reach = score_reach(&tiles, threshold);
    let corner_px = |index: usize| {
        let index = index as u32;
        let left = GAP_PX + (index % columns) * (pair_px + GAP_PX);
        [left, (index / columns) * row_px + LABEL_PX]
    };
    for (index, tile) in tiles.iter().enumerate() {
        let [left, top] = corner_px(index);
        for ((x, y), (color, score)) in places().zip(&tile.pixels) {
            picture.put_pixel(left + x, top + y, *color);
            let score = score.map(|score| (score - threshold) / reach);
            let color = score.map_or(OUTSIDE, diverging_color);
            picture.put_pixel(left + SIDE_PX + 2 + x, top + y, color);
        }
    }
    let key_top_px = rows * row_px;
    let key_width_px = 2 * SIDE_PX;
    for x in 0..key_width_px {
        let score = 2.0 * x as f32 / (key_width_px - 1) as f32 - 1.0;
        for y in 0..12 {
            picture.put_pixel(GAP_PX + x, key_top_px + y, diverging_color(score));
        }
    }
    let Some(mut canvas) = canvas_of(&picture) else {
        return write_picture(path, &picture);
    };
    for (index, tile) in tiles.iter().enumerate() {
        let [left, top] = corner_px(index);
        draw_found(&mut canvas, tile, [left, top]);
        write(&mut canvas, &tile.label, [left, top - 6], pair_px);
    }
    let key = [
        format!("log odds {:.1}", threshold - reach),
        format!("threshold {threshold:.1}"),
        format!("{:.1}", threshold + reach),
    ];
    for (text, left) in key.iter().zip([0, SIDE_PX - 40, 2 * SIDE_PX - 28]) {
        let at_px = [GAP_PX + left, key_top_px + 28];
        write(&mut canvas, &text.replace('-', "−"), at_px, SIDE_PX - 50);
    }
    write_picture(path, &picture_from(&canvas))
}

fn write(canvas: &mut Pixmap, text: &str, at_px: [u32; 2], max_px: u32) {
    let caption = Caption {
        text,
        at_px: at_px.map(|c| c as f32),
        height_px: 13.0,
        max_width_px: max_px as f32,
        color: INK,
    };
    write_caption(canvas, &caption);
}

/// Draws the part of the found outline that a tile shows, whose image begins at this corner.
fn draw_found(canvas: &mut Pixmap, tile: &Drawn, corner_px: [u32; 2]) {
    let shown = |point: &[f64; 2]| {
        let at = tile.crop.place(*point);
        let is_shown = at.iter().all(|c| (0.0..f64::from(SIDE_PX)).contains(c));
        is_shown.then(|| [0, 1].map(|axis| corner_px[axis] as f32 + at[axis] as f32))
    };
    let mut path = PathBuilder::new();
    let next = tile.found_px.iter().cycle().skip(1);
    for (from, to) in tile.found_px.iter().zip(next) {
        if let (Some([x, y]), Some([next_x, next_y])) = (shown(from), shown(to)) {
            path.move_to(x, y);
            path.line_to(next_x, next_y);
        }
    }
    let mut paint = Paint::default();
    paint.set_color(opaque(FOUND));
    let stroke = Stroke {
        width: 2.0,
        ..Stroke::default()
    };
    if let Some(path) = path.finish() {
        canvas.stroke_path(&path, &paint, &stroke, Transform::identity(), None);
    }
}

/// What is shown of a tile.
struct Drawn {
    label: String,
    found_px: Vec<[f64; 2]>,
    crop: Crop,
    /// The colour of each pixel of the tile and its score, if it has one, row by row.
    pixels: Vec<(Rgb, Option<f32>)>,
}

impl Drawn {
    fn of(tile: Tile) -> Self {
        let crop = Crop::around_mask(&tile);
        let pixel = |(x, y)| (crop.outlined_color(&tile, x, y), crop.score(&tile, x, y));
        Self {
            pixels: places().map(pixel).collect(),
            crop,
            label: tile.label,
            found_px: tile.found_px,
        }
    }
}

/// Returns the columns and rows of the pixels of a tile, row by row.
fn places() -> impl Iterator<Item = (u32, u32)> {
    (0..SIDE_PX).flat_map(|y| (0..SIDE_PX).map(move |x| (x, y)))
}

/// The square of an image that is shown.
struct Crop {
    corner_px: [f64; 2],
    side_px: f64,
}

impl Crop {
    /// Returns the surroundings of the mask, or the whole image if the mask is empty.
    fn around_mask(tile: &Tile) -> Self {
        let (width, height) = tile.image.dimensions();
        let (mut columns, mut rows) = ((u32::MAX, 0), (u32::MAX, 0));
        for (y, row) in (0..height).zip(tile.mask.chunks(width.max(1) as usize)) {
            let Some(first) = row.iter().position(|object| *object) else {
                continue;
            };
            let last = row.iter().rposition(|object| *object).unwrap_or(first);
            columns = (columns.0.min(first as u32), columns.1.max(last as u32 + 1));
            rows = (rows.0.min(y), y + 1);
        }
        let empty = columns.0 >= columns.1;
        if empty {
            (columns, rows) = ((0, width), (0, height));
        }
        let object_px = f64::from((columns.1 - columns.0).max(rows.1 - rows.0));
        let side_px = if empty {
            object_px
        } else {
            SURROUNDINGS * object_px
        };
        let side_px = side_px.max(MIN_SHOWN_PX);
        Self {
            corner_px: [columns, rows].map(|(low, high)| 0.5 * (f64::from(low + high) - side_px)),
            side_px,
        }
    }

    /// Returns the image pixel for a pixel of the tile, or `None` outside the image.
    fn source(&self, tile: &Tile, x: u32, y: u32) -> Option<(u32, u32)> {
        let scale = self.side_px / f64::from(SIDE_PX);
        let u = (self.corner_px[0] + scale * (f64::from(x) + 0.5)).floor();
        let v = (self.corner_px[1] + scale * (f64::from(y) + 0.5)).floor();
        let inside = (0.0..f64::from(tile.image.width())).contains(&u)
            && (0.0..f64::from(tile.image.height())).contains(&v);
        inside.then_some((u as u32, v as u32))
    }

    /// Returns the place in the tile of an image point, pixel centres at integers.
    fn place(&self, point_px: [f64; 2]) -> [f64; 2] {
        let scale = f64::from(SIDE_PX) / self.side_px;
        [0, 1].map(|axis| scale * (point_px[axis] + 0.5 - self.corner_px[axis]))
    }

    fn object_at(&self, tile: &Tile, x: u32, y: u32) -> bool {
        self.source(tile, x, y)
            .is_some_and(|(u, v)| is_object(tile, u, v))
    }

    /// Returns the image's colour, but white just inside the edge of the mask and black just outside it.
    fn outlined_color(&self, tile: &Tile, x: u32, y: u32) -> Rgb {
        let Some((u, v)) = self.source(tile, x, y) else {
            return OUTSIDE;
        };
        let object = self.object_at(tile, x, y);
        let neighbours = [
            (x + 1, y),
            (x.wrapping_sub(1), y),
            (x, y + 1),
            (x, y.wrapping_sub(1)),
        ];
        let edge = neighbours
            .iter()
            .any(|&(x, y)| self.object_at(tile, x, y) != object);
        match (edge, object) {
            (true, true) => [255; 3],
            (true, false) => [0; 3],
            (false, _) => tile.image.get_pixel(u, v),
        }
    }

    fn score(&self, tile: &Tile, x: u32, y: u32) -> Option<f32> {
        let (u, v) = self.source(tile, x, y)?;
        let score = *tile.log_odds.get((v * tile.image.width() + u) as usize)?;
        (!score.is_nan()).then_some(score)
    }
}

fn is_object(tile: &Tile, x: u32, y: u32) -> bool {
    let index = y as usize * tile.image.width() as usize + x as usize;
    tile.mask.get(index) == Some(&true)
}

/// Returns the distance from the threshold at which colours are saturated: 98 % of the shown scores are nearer.
fn score_reach(tiles: &[Drawn], threshold: f32) -> f32 {
    let scores = tiles
        .iter()
        .flat_map(|tile| tile.pixels.iter().filter_map(|(_, score)| *score));
    let distances = scores.map(|score| (score - threshold).abs());
    let mut distances: Vec<f32> = distances.filter(|d| d.is_finite()).collect();
    distances.sort_by(f32::total_cmp);
    let index = (0.98 * distances.len() as f64) as usize;
    distances.get(index).copied().unwrap_or(1.0).max(1e-3)
}

/// Returns the colour of a score from -1 to 1.
fn diverging_color(score: f32) -> Rgb {
    let end = if score < 0.0 { COLD } else { WARM };
    let share = score.abs().min(1.0);
    [0, 1, 2].map(|c| {
        let (from, to) = (f32::from(NEUTRAL[c]), f32::from(end[c]));
        (from + share * (to - from)).round() as u8
    })
}

#[cfg(test)]
#[path = "mosaic_tests.rs"]
mod tests;
