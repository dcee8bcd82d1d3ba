//! Plot of residuals over time, before and after temporal calibration.

use plotters::prelude::*;

use super::legend::{self, Key};
use super::panel::{Axis, draw_path, extent, padded, panel, write_note};
use super::plots::WIDTH_PX;
use super::svg::{Area, Drawing, drawing, fill, units};
use super::{INK, PALETTE, Rgb};

/// Height of each camera's panel.
const PANEL_HEIGHT_PX: f64 = 180.0;

const BEFORE: Rgb = PALETTE[1];
const AFTER: Rgb = PALETTE[0];

/// Distances between a camera's detections and the fitted path.
pub(crate) struct TimeResiduals<'a> {
    /// The camera's name.
    pub(crate) name: &'a str,
    /// Time in seconds, and distances in pixels before and after the correction (`None` if unknown).
    pub(crate) residuals: Vec<(f64, [Option<f64>; 2])>,
}

/// Draws one panel per camera: distances before and after the correction over time.
pub(crate) fn residuals_over_time(cameras: &[TimeResiduals]) -> anyhow::Result<Drawing> {
    let times = cameras.iter().flat_map(|camera| &camera.residuals);
    let time_s = padded(extent(times.map(|(time_s, _)| *time_s)), 0.1);
    let height_px = PANEL_HEIGHT_PX * cameras.len().max(1) as f64;
    drawing([WIDTH_PX, height_px], |area| {
        let (plots, column) = area.split_horizontally(units(WIDTH_PX - legend::WIDTH_PX));
        let entries = [
            (Key::Track(BEFORE), "before correction".to_owned()),
            (Key::Track(AFTER), "after correction".to_owned()),
        ];
        legend::draw(&column, &entries)?;
        for (area, camera) in plots.split_evenly((cameras.len(), 1)).iter().zip(cameras) {
            draw_panel(area, Axis::new(time_s.clone(), "time stamp (s)"), camera)?;
        }
        Ok(())
    })
}

fn draw_panel(area: &Area<'_>, across: Axis<'_>, camera: &TimeResiduals) -> anyhow::Result<()> {
    let lengths = camera.residuals.iter().flat_map(|(_, both)| both).flatten();
    let largest = lengths.fold(0.1_f64, |largest, px| largest.max(*px));
    let name = format!("{} (px)", camera.name);
    let zero = [(across.range().start, 0.0), (across.range().end, 0.0)];
    let mut panel = panel(area, &across, &Axis::new(0.0..1.05 * largest, &name))?;
    draw_path(&mut panel, &zero, super::svg::line(INK, 1.0, 1.0))?;
    for (which, color) in [(0, BEFORE), (1, AFTER)] {
        let points = camera.residuals.iter();
        let points = points.filter_map(|(time_s, both)| Some((*time_s, both[which]?)));
        panel.draw_series(points.map(|at| Circle::new(at, units(2.0), fill(color, 0.8))))?;
    }
    if camera.residuals.is_empty() {
        write_note(area, "no detections")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::svg::write_svg_and_png;
    use crate::draw::test_folder;

    #[test]
    fn draws_one_panel_per_camera() {
        let residuals = |offset: f64| {
            let at = |i: i32| {
                let time_s = 0.04 * f64::from(i);
                let before = 3.0 * (offset + time_s).sin().abs();
                (time_s, [(i % 7 > 0).then_some(before), Some(0.2 * before)])
            };
            (0..100).map(at).collect()
        };
        let cameras = [
            TimeResiduals {
                name: "left <1>",
                residuals: residuals(0.3),
            },
            TimeResiduals {
                name: "right",
                residuals: residuals(1.0),
            },
            TimeResiduals {
                name: "blind",
                residuals: Vec::new(),
            },
        ];
        let drawing = residuals_over_time(&cameras).unwrap();
        write_svg_and_png(&test_folder("temporal"), "residuals", &drawing).unwrap();
        for wanted in [
            "left &lt;1&gt; (px)",
            "right (px)",
            "no detections",
            "time stamp (s)",
        ] {
            assert!(drawing.svg.contains(wanted), "{wanted}");
        }
        // 200 marks per camera, minus those without a residual.
        assert_eq!(drawing.svg.matches("<circle").count(), 2 * (200 - 15));
    }
}
