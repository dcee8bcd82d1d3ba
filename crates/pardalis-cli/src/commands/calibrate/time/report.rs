//! Results of a temporal calibration for the terminal, as tables and as a page.

use std::fmt::{self, Write as _};

use anyhow::Result;
use pardalis_calibrate::{FittedDetection, TemporalCalibration, TimedCamera};
use pardalis_scene::{CameraSetting, Scene};

use super::super::page::{begin, push_paragraph, push_table};
use super::super::report::{with_sigma, write_table};
use crate::draw::calibration::{ObservedPoint, observed_and_projected};
use crate::draw::temporal::{TimeResiduals, residuals_over_time};

/// Share of the image's diagonal beyond which residuals exceed the error of colour detection.
const LARGE_RMS: f64 = 0.005;

/// Report of a temporal calibration.
pub(super) struct Report<'a> {
    cameras: Vec<Camera<'a>>,
}

/// One camera with its detections and offset.
struct Camera<'a> {
    name: &'a str,
    size_px: (usize, usize),
    frames: usize,
    fit: &'a TemporalCalibration,
    /// Time offset in the scene, in seconds.
    given_s: f64,
    /// Corrected time offset, in seconds.
    corrected_s: f64,
}

impl Camera<'_> {
    fn outliers(&self) -> usize {
        let detections = self.fit.detections.iter();
        detections.filter(|detection| detection.outlier).count()
    }
}

impl<'a> Report<'a> {
    /// Creates a report on the scene's cameras, in their order.
    pub(super) fn new(
        scene: &'a Scene,
        cameras: &'a [TimedCamera<'a>],
        fits: &'a [TemporalCalibration],
    ) -> Self {
        let all = scene.cameras.iter().zip(cameras).zip(fits);
        let of_camera =
            |((config, camera), fit): ((_, &'a TimedCamera), &'a TemporalCalibration)| {
                let config: &pardalis_scene::CameraConfig = config;
                Camera {
                    name: camera.name,
                    size_px: camera.view.size(),
                    frames: camera.frames.len(),
                    fit,
                    given_s: config.time_offset_s,
                    // Rounded to a microsecond; never minus zero.
                    corrected_s: (1e6 * (config.time_offset_s + fit.offset_s)).round() / 1e6 + 0.0,
                }
            };
        Self {
            cameras: all.map(of_camera).collect(),
        }
    }

    /// Returns name and corrected time offset (seconds) of all cameras but the first.
    fn offsets_s(&self) -> Vec<(&'a str, f64)> {
        let others = self.cameras.iter().skip(1);
        others
            .map(|camera| (camera.name, camera.corrected_s))
            .collect()
    }

    /// Returns the corrected offsets as settings of a scene.
    pub(super) fn camera_settings(&self) -> Vec<CameraSetting<'a>> {
        let offsets_s = self.offsets_s().into_iter();
        offsets_s
            .map(|(camera, offset_s)| CameraSetting {
                camera,
                key: "time_offset_s",
                value: offset_s.into(),
                is_guess: false,
            })
            .collect()
    }

    /// Returns the corrected offsets as lines of a scene.
    pub(super) fn settings(&self) -> String {
        let mut text = String::new();
        for (name, offset_s) in self.offsets_s() {
            let _ = writeln!(text, "  cameras.{name}.time_offset_s = {offset_s:?}");
        }
        text
    }

    fn title(&self) -> String {
        format!(
            "Time offsets of {} cameras relative to {}",
            self.cameras.len(),
            self.cameras[0].name
        )
    }

    /// Returns one row per camera.
    fn rows(&self) -> Vec<Vec<String>> {
        let head = [
            "camera",
            "frames",
            "detected in",
            "outliers",
            "offset (ms)",
            "time_offset_s before",
            "after",
            "RMS before (px)",
            "after (px)",
        ];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        for (number, camera) in self.cameras.iter().enumerate() {
            let fit = camera.fit;
            let before = fit.rms_before_px.map(|px| format!("{px:.2}"));
            rows.push(vec![
                camera.name.to_owned(),
                camera.frames.to_string(),
                fit.detections.len().to_string(),
                camera.outliers().to_string(),
                if number == 0 {
                    "reference".to_owned()
                } else {
                    with_sigma(1e3 * fit.offset_s, Some(1e3 * fit.sigma_s))
                },
                format!("{:?}", camera.given_s),
                format!("{:?}", camera.corrected_s),
                before.unwrap_or_else(|| "-".to_owned()),
                format!("{:.2}", fit.rms_after_px),
            ]);
        }
        rows
    }

    /// Returns warnings on a successful calibration.
    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for camera in &self.cameras {
            let (width, height) = camera.size_px;
            let rms_px = camera.fit.rms_after_px;
            if rms_px > LARGE_RMS * libm::hypot(width as f64, height as f64) {
                warnings.push(format!(
                    "{}: {rms_px:.1} px remain after the correction: check the camera poses, and whether there are other objects of the target's colours",
                    camera.name
                ));
            }
            let (outliers, count) = (camera.outliers(), camera.fit.detections.len());
            if 4 * outliers > count {
                warnings.push(format!(
                    "{}: {outliers} of {count} detections contradict the others and were rejected: is another object of the target's colours in view?",
                    camera.name
                ));
            }
        }
        warnings
    }

    /// Tabulates the cameras, one row each, with all digits of the offset.
    pub(super) fn table(&self) -> Result<String> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record([
            "camera",
            "frames",
            "detections",
            "outliers",
            "offset_s",
            "offset_sigma_s",
            "time_offset_before_s",
            "time_offset_s",
            "rms_before_px",
            "rms_after_px",
        ])?;
        for camera in &self.cameras {
            let fit = camera.fit;
            let before = fit.rms_before_px.map(|px| px.to_string());
            table.write_record([
                camera.name.to_owned(),
                camera.frames.to_string(),
                fit.detections.len().to_string(),
                camera.outliers().to_string(),
                fit.offset_s.to_string(),
                fit.sigma_s.to_string(),
                camera.given_s.to_string(),
                camera.corrected_s.to_string(),
                before.unwrap_or_default(),
                fit.rms_after_px.to_string(),
            ])?;
        }
        Ok(String::from_utf8(table.into_inner()?)?)
    }

    /// Tabulates the detections, one row each: pixel of the target's centre and distance from the fitted path.
    pub(super) fn detections(&self) -> Result<String> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record([
            "camera",
            "time_s",
            "u_px",
            "v_px",
            "residual_before_u_px",
            "residual_before_v_px",
            "residual_u_px",
            "residual_v_px",
            "outlier",
        ])?;
        for camera in &self.cameras {
            for detection in &camera.fit.detections {
                let mut row = vec![camera.name.to_owned(), detection.time_s.to_string()];
                row.extend(detection.pixel.map(|value| value.to_string()));
                for residual in [detection.before_px, detection.after_px] {
                    let values = residual.map(|pair| pair.map(|value| value.to_string()));
                    row.extend(values.unwrap_or_default());
                }
                row.push(u8::from(detection.outlier).to_string());
                table.write_record(row)?;
            }
        }
        Ok(String::from_utf8(table.into_inner()?)?)
    }

    /// Renders the report as an HTML page.
    pub(super) fn page(&self) -> Result<String> {
        let mut page = begin(&self.title());
        push_table(&mut page, &self.rows());
        for warning in self.warnings() {
            push_paragraph(&mut page, &format!("Warning: {warning}"));
        }
        page.push_str("<h2>Residuals over time</h2>\n");
        let residuals: Vec<TimeResiduals> = self.cameras.iter().map(residuals).collect();
        let _ = writeln!(
            page,
            "<figure>{}</figure>",
            residuals_over_time(&residuals)?.svg
        );
        for camera in &self.cameras {
            for (when, residual) in [
                ("before", (|s| s.before_px) as fn(&FittedDetection) -> _),
                ("after", |s| s.after_px),
            ] {
                let points = camera.fit.detections.iter().map(|detection| ObservedPoint {
                    observed: detection.pixel,
                    residual_px: residual(detection),
                    outlier: detection.outlier,
                });
                let points: Vec<ObservedPoint> = points.collect();
                let picture = observed_and_projected(camera.size_px, &points)?.svg;
                let _ = writeln!(
                    page,
                    "<h2>{}: detections and projected path, {when} the correction</h2>\n<figure>{picture}</figure>",
                    camera.name
                );
            }
        }
        page.push_str("</body></html>\n");
        Ok(page)
    }
}

/// Returns the lengths of a camera's residuals for their plot.
fn residuals<'a>(camera: &Camera<'a>) -> TimeResiduals<'a> {
    let length = |residual: Option<[f64; 2]>| residual.map(|[u, v]| libm::hypot(u, v));
    let kept = camera.fit.detections.iter().filter(|s| !s.outlier);
    TimeResiduals {
        name: camera.name,
        residuals: kept
            .map(|s| (s.time_s, [length(s.before_px), length(s.after_px)]))
            .collect(),
    }
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}:\n", self.title())?;
        write_table(f, &self.rows())?;
        for warning in self.warnings() {
            writeln!(f, "\nWarning: {warning}")?;
        }
        write!(
            f,
            "\nSettings for the scene:\n{}",
            self.settings().trim_end()
        )
    }
}
