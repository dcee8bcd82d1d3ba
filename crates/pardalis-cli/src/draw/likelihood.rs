//! Illustrations of the contour cue in one frame: curves of its log-likelihood, and the pixels that it compares.

use std::path::{Path, PathBuf};

use plotters::prelude::*;

use super::legend::{self, Key};
use super::panel::{Axis, draw_path, extent, padded, panel};
use super::svg::{drawing, fill, line, units, write_svg_and_png};
use super::{INK, PALETTE, Rgb};

/// Size of a figure of curves, without its legend.
const CURVES_PX: [f64; 2] = [620.0, 380.0];
/// Side of an image pixel in the picture of sampled pixels.
const PIXEL_PX: f64 = 12.0;
/// Inner and outer pixels, as in thesis fig. 4.7.
const INNER: Rgb = [255, 220, 0];
const OUTER: Rgb = [0, 90, 255];

/// One curve: a name and points (x, log-likelihood ratio to pure background in nats).
pub(crate) struct Curve {
    pub(crate) name: String,
    pub(crate) points: Vec<[f64; 2]>,
}

/// Draws curves over one axis into `STEM.svg` and `STEM.png` in a folder that must exist. `marked` is a value on that
/// axis with a name; it is shown as a vertical line.
pub(crate) fn write_curves(
    folder: &Path,
    stem: &str,
    x_name: &str,
    curves: &[Curve],
    marked: (f64, &str),
) -> anyhow::Result<Vec<PathBuf>> {
    let all = || curves.iter().flat_map(|curve| &curve.points);
    let x_range = padded(extent(all().map(|p| p[0]).chain([marked.0])), 1e-6);
    let y_range = padded(extent(all().map(|p| p[1]).chain([0.0])), 1e-6);
    let [width_px, height_px] = CURVES_PX;
    let drawing = drawing([width_px + legend::WIDTH_PX, height_px], |area| {
        let (plot, column) = area.split_horizontally(units(width_px));
        let mut entries: Vec<(Key, String)> = (curves.iter().enumerate())
            .map(|(i, curve)| (Key::Track(color_of(i)), curve.name.clone()))
            .collect();
        entries.push((Key::Truth, marked.1.to_owned()));
        legend::draw(&column, &entries)?;
        let x = Axis::new(x_range.clone(), x_name);
        let y = Axis::new(y_range.clone(), "log-likelihood over background (nats)");
        let mut panel = panel(&plot, &x, &y)?;
        let vertical = [(marked.0, y_range.start), (marked.0, y_range.end)];
        draw_path(&mut panel, &vertical, line(INK, 1.0, 1.0))?;
        for (i, curve) in curves.iter().enumerate() {
            let points: Vec<(f64, f64)> = curve.points.iter().map(|p| (p[0], p[1])).collect();
            draw_path(&mut panel, &points, line(color_of(i), 1.0, 1.5))?;
        }
        Ok(())
    })?;
    Ok(write_svg_and_png(folder, stem, &drawing)?.into())
}

fn color_of(curve: usize) -> Rgb {
    PALETTE[curve % PALETTE.len()]
}

/// A part of an image and the marks over it, in pixels of the whole image.
pub(crate) struct Sampled<'a> {
    /// Column and row of the first pixel of the part.
    pub(crate) origin_px: [usize; 2],
    /// Its rows of colours.
    pub(crate) rows: Vec<Vec<Rgb>>,
    /// The pixels of the inner and of the outer set.
    pub(crate) sides: [&'a [[usize; 2]]; 2],
    /// The outline of the body.
    pub(crate) outline_px: &'a [[f64; 2]],
}

/// Draws the sampled pixels over the image, enlarged, into `STEM.svg` and `STEM.png` in a folder that must exist.
pub(crate) fn write_sampled(
    folder: &Path,
    stem: &str,
    sampled: &Sampled<'_>,
) -> anyhow::Result<Vec<PathBuf>> {
    let columns = sampled.rows.first().map_or(0, Vec::len);
    let picture_px = [columns, sampled.rows.len()].map(|count| PIXEL_PX * count as f64);
    let [width_px, height_px] = [picture_px[0] + legend::WIDTH_PX, picture_px[1]];
    let drawing = drawing([width_px, height_px], |area| {
        let (picture, column) = area.split_horizontally(units(picture_px[0]));
        let entries = [
            (Key::Track(INNER), "inner pixels".to_owned()),
            (Key::Track(OUTER), "outer pixels".to_owned()),
            (Key::Truth, "outline (white in the image)".to_owned()),
        ];
        legend::draw(&column, &entries)?;
        // The square of a pixel, from its corner, without a margin on each side.
        let square = |[x, y]: [usize; 2], margin: f64, color: Rgb| {
            let at = |pixel: usize, origin: usize, end: f64| {
                let offset = pixel as f64 - origin as f64;
                units(
                    PIXEL_PX
                        * (offset
                            + if end > 0.5 {
                                end - margin
                            } else {
                                end + margin
                            }),
                )
            };
            let [left, top] = sampled.origin_px;
            let corners = [
                (at(x, left, 0.0), at(y, top, 0.0)),
                (at(x, left, 1.0), at(y, top, 1.0)),
            ];
            Rectangle::new(corners, fill(color, 1.0))
        };
        for (row, colors) in sampled.rows.iter().enumerate() {
            for (column, &color) in colors.iter().enumerate() {
                let [left, top] = sampled.origin_px;
                picture.draw(&square([left + column, top + row], 0.0, color))?;
            }
        }
        for (pixels, color) in sampled.sides.into_iter().zip([INNER, OUTER]) {
            for &pixel in pixels {
                picture.draw(&square(pixel, 0.25, color))?;
            }
        }
        let [left, top] = sampled.origin_px.map(|first| first as f64 - 0.5);
        let closed = (sampled.outline_px.iter()).chain(sampled.outline_px.first());
        let points: Vec<(i32, i32)> = closed
            .map(|[u, v]| (units(PIXEL_PX * (u - left)), units(PIXEL_PX * (v - top))))
            .collect();
        picture.draw(&PathElement::new(points, line([255; 3], 1.0, 2.0)))?;
        Ok(())
    })?;
    Ok(write_svg_and_png(folder, stem, &drawing)?.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::test_folder;

    fn text(files: &[PathBuf]) -> String {
        std::fs::read_to_string(&files[0]).unwrap()
    }

    #[test]
    fn every_curve_is_drawn_and_named() {
        let curve = |name: &str, shift: f64| Curve {
            name: name.to_owned(),
            points: (0..50)
                .map(|i| f64::from(i) * 0.05)
                .map(|x| [x, 20.0 - (x - shift).powi(2)])
                .collect(),
        };
        let curves = [curve("near <1>", 0.9), curve("far", 1.2)];
        let folder = test_folder("likelihood");
        let files = write_curves(&folder, "scales", "scale", &curves, (1.0, "truth")).unwrap();
        let drawing = text(&files);
        for wanted in ["near &lt;1&gt;", "far", "truth", "scale"] {
            assert!(drawing.contains(wanted), "{wanted}");
        }
        assert!(files.iter().all(|file| file.is_file()));
    }

    #[test]
    fn every_sampled_pixel_is_a_square_over_the_image() {
        let rows = vec![vec![[10, 20, 30]; 6]; 5];
        let (inner, outer) = ([[12, 8], [13, 8]], [[11, 7], [14, 9], [15, 9]]);
        let sampled = Sampled {
            origin_px: [10, 6],
            rows,
            sides: [&inner, &outer],
            outline_px: &[[11.5, 7.5], [13.5, 7.5], [13.5, 8.5]],
        };
        let folder = test_folder("likelihood");
        let drawing = text(&write_sampled(&folder, "sampled", &sampled).unwrap());
        // The picture's pixels and the two sets.
        assert_eq!(drawing.matches("<rect").count(), 1 + 30 + 2 + 3);
    }
}
