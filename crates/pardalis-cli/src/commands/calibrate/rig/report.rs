//! Results of the calibration of a rig with a ball for the terminal, as tables and as a page.

use std::fmt::{self, Write as _};

use anyhow::Result;
use nalgebra::Point3;
use pardalis_calibrate::{BallRigCalibration, BallRigCamera, BallSighting, RigAlignment};
use pardalis_camera::{CalibratedCamera, Camera, Pose};
use pardalis_scene::{CameraConfig, Scene};

use super::super::page::{begin, push_paragraph, push_table};
use super::super::report::{metres, with_sigma, write_table};
use super::align::{Ball, World};
use crate::draw::calibration::{ObservedPoint, residual_arrows};
use crate::draw::camera_symbol::CameraSymbol;
use crate::draw::paths::rig_figures;

/// Share of the image's diagonal beyond which residuals exceed the error of detection.
const LARGE_RMS: f64 = 0.005;

/// Number of standard deviations from which a difference is real.
const REAL_SIGMAS: f64 = 3.0;

/// Least difference of a focal length that is worth a warning, as a share of it.
const FOCAL_OFF: f64 = 0.005;

/// The same of the scale.
const SCALE_OFF: f64 = 0.02;

/// Report of the calibration of a rig.
pub(in crate::commands) struct Report<'a> {
    cameras: Vec<Row<'a>>,
    found: &'a BallRigCalibration,
    world: &'a World,
    ball: &'a Ball,
}

/// One camera.
struct Row<'a> {
    config: &'a CameraConfig,
    size_px: (usize, usize),
    frames: usize,
    of: &'a BallRigCamera,
    world_from_camera: Pose,
}

impl Row<'_> {
    fn outliers(&self) -> usize {
        self.of
            .detections
            .iter()
            .filter(|seen| seen.outlier)
            .count()
    }
}

/// Returns the time offset of a camera in the scene, corrected; rounded to a microsecond, never minus zero.
pub(super) fn corrected_offset_s(config: &CameraConfig, of: &BallRigCamera) -> f64 {
    (1e6 * (config.time_offset_s + of.offset_s)).round() / 1e6 + 0.0
}

/// Returns the rows of a camera's pose, to a tenth of a micrometre.
pub(super) fn pose_value(camera: &CalibratedCamera) -> toml::Value {
    let matrix = camera
        .world_from_camera
        .unwrap_or_default()
        .to_homogeneous();
    // The rotation is orthonormal to 1e-9, which readers restore.
    let row = |i: usize| -> toml::Value {
        let values = (0..4).map(|j| toml::Value::from((1e9 * matrix[(i, j)]).round() / 1e9 + 0.0));
        values.collect::<Vec<_>>().into()
    };
    (0..4).map(row).collect::<Vec<_>>().into()
}

/// Returns the keys of a camera's focal length in the table of a camera, with their values.
pub(super) fn focal_values(camera: &Camera) -> Vec<(&'static str, toml::Value)> {
    let parameters = camera.parameters();
    let value = |name: &str| parameters.iter().find(|p| p.0 == name).map_or(0.0, |p| p.1);
    let pair = || toml::Value::from(vec![value("fx_px"), value("fy_px")]);
    match camera {
        Camera::Pinhole(_) => vec![("model.pinhole.f_px", pair())],
        Camera::KannalaBrandt(_) => vec![("model.kannala_brandt.f_px", pair())],
        Camera::Mei(_) => vec![("model.mei.f_px", pair())],
        Camera::DoubleSphere(_) => vec![("model.double_sphere.f_px", pair())],
        Camera::ExtendedUnified(_) => vec![("model.extended_unified.f_px", pair())],
        Camera::ExactMirror(_) => vec![("model.exact_mirror.f_px", pair())],
        Camera::Equidistant(_) => vec![(
            "model.equidistant.f_px_per_rad",
            value("f_px_per_rad").into(),
        )],
        Camera::Unified(_) => vec![("model.unified.f_px", value("f_px").into())],
        Camera::PerspectiveMirror(_) => {
            vec![("model.perspective_mirror.m_px", value("m_px").into())]
        }
        Camera::Ocam(_) | Camera::Plane(_) => Vec::new(),
    }
}

impl<'a> Report<'a> {
    /// Creates a report on the scene's cameras, in their order: the size of their images in pixels, and the number of their frames.
    pub(super) fn new(
        scene: &'a Scene,
        seen: &[((usize, usize), usize)],
        found: &'a BallRigCalibration,
        world: &'a World,
        ball: &'a Ball,
    ) -> Self {
        let all = scene.cameras.iter().zip(seen).zip(&found.cameras);
        let rows = all.map(|((config, &(size_px, frames)), of)| Row {
            config,
            size_px,
            frames,
            of,
            world_from_camera: world.aligned.in_world(&of.world_from_camera),
        });
        Self {
            cameras: rows.collect(),
            found,
            world,
            ball,
        }
    }

    /// Returns the cameras with their poses in the world.
    pub(super) fn calibrated(&self) -> Vec<CalibratedCamera> {
        let cameras = self.cameras.iter().map(|row| CalibratedCamera {
            name: row.config.name.clone(),
            camera: row.of.camera.clone(),
            size_px: Some(row.size_px),
            world_from_camera: Some(row.world_from_camera),
        });
        cameras.collect()
    }

    /// Returns what to put into the scene, given the path of the rig's file from there.
    pub(super) fn settings(&self, rig: &str) -> String {
        let mut text = "\nSettings for the scene, in place of models and poses (--corrected writes such a scene):\n".to_owned();
        for row in &self.cameras {
            let (name, offset_s) = (&row.config.name, corrected_offset_s(row.config, row.of));
            let file = toml::Value::from(rig);
            let _ = writeln!(text, "  cameras.{name}.calibration = {file}");
            let _ = writeln!(text, "  cameras.{name}.time_offset_s = {offset_s:?}");
        }
        text.truncate(text.trim_end().len());
        text
    }

    fn title(&self) -> String {
        let spans = &self.found.path_m;
        let duration_s = match (spans.first(), spans.last()) {
            (Some(first), Some(last)) => last.0 - first.0,
            _ => 0.0,
        };
        format!(
            "Rig of {} cameras from a ball that two or more of them saw within {duration_s:.1} s",
            self.cameras.len()
        )
    }

    /// Returns one row per camera.
    pub(in crate::commands) fn rows(&self) -> Vec<Vec<String>> {
        let head = [
            "camera",
            "frames",
            "detected in",
            "outliers",
            "RMS (px)",
            "position (m)",
            "± (mm)",
            "rotation ± (deg)",
            "offset (ms)",
            "focal length (%)",
        ];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        for (number, row) in self.cameras.iter().enumerate() {
            let of = row.of;
            let measured = |text: String| {
                if number == 0 {
                    "reference".to_owned()
                } else {
                    text
                }
            };
            let focal = of.focal.map_or_else(
                || "-".to_owned(),
                |focal| {
                    let change =
                        with_sigma(100.0 * (focal.factor - 1.0), Some(100.0 * focal.sigma));
                    format!("{change}{}", if focal.is_refined { "" } else { " (held)" })
                },
            );
            rows.push(vec![
                row.config.name.clone(),
                row.frames.to_string(),
                of.detections.len().to_string(),
                row.outliers().to_string(),
                format!("{:.2}", of.rms_px),
                metres(row.world_from_camera.translation.vector),
                measured(format!("{:.1}", 1e3 * of.position_sigma_m)),
                measured(format!("{:.3}", of.turn_sigma_rad.to_degrees())),
                measured(with_sigma(1e3 * of.offset_s, Some(1e3 * of.offset_sigma_s))),
                focal,
            ]);
        }
        rows
    }

    /// Returns statements on what the figures are relative to.
    pub(in crate::commands) fn notes(&self) -> Vec<String> {
        let first = &self.cameras[0].config.name;
        let widths_m = self.found.widths_m;
        // Without digits of rounding.
        let radius_mm = (1e9 * self.ball.radius_m).round() / 1e6;
        vec![
            format!(
                "Standard deviations are those relative to {first}, along the worst axis. The ball moved by {:.3}, {:.3} and {:.3} m (standard deviations along the axes of its path).",
                widths_m[0], widths_m[1], widths_m[2]
            ),
            match self.world.aligned {
                RigAlignment {
                    is_scaled: true,
                    scale: Some([scale, sigma]),
                    ..
                } => format!(
                    "All lengths are those of the known points. They make the radius of the ball {:.3} ± {:.3} mm; the scene says {radius_mm} mm.",
                    scale * radius_mm,
                    sigma * radius_mm
                ),
                _ => format!(
                    "All lengths are proportional to the radius of the ball in the scene, {radius_mm} mm: if it is 1 % too large, so are they."
                ),
            },
            format!("World: {}.", self.world.because),
        ]
    }

    /// Returns warnings on a successful calibration.
    pub(in crate::commands) fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self.world.doubt.clone().into_iter().collect();
        for row in &self.cameras {
            let (name, of) = (&row.config.name, row.of);
            let (width, height) = row.size_px;
            if of.rms_px > LARGE_RMS * libm::hypot(width as f64, height as f64) {
                warnings.push(format!(
                    "{name}: {:.1} px remain: check the model of its lens, and whether there are other objects of the ball's colours",
                    of.rms_px
                ));
            }
            let (outliers, count) = (row.outliers(), of.detections.len());
            if 4 * outliers > count {
                warnings.push(format!(
                    "{name}: {outliers} of {count} detections contradict the others and were rejected: is another object of the ball's colours in view, or a hand around it?"
                ));
            }
            if let Some(focal) = of.focal.filter(|focal| !focal.is_refined) {
                let off = focal.factor - 1.0;
                if off.abs() > FOCAL_OFF.max(REAL_SIGMAS * focal.sigma) {
                    warnings.push(format!(
                        "{name}: its focal length seems to be {:.4} ± {:.4} times that of the scene: calibrate its lens, or refine the focal lengths (--refine-focal)",
                        focal.factor, focal.sigma
                    ));
                }
            }
        }
        if let Some([scale, sigma]) = self.world.aligned.scale
            && (scale - 1.0).abs() > SCALE_OFF.max(REAL_SIGMAS * sigma)
        {
            warnings.push(format!(
                "lengths in the world are {scale:.3} times those of the rig: either they are wrong, or the radius of the ball is {:.2} mm instead of {:.2} mm",
                1e3 * scale * self.ball.radius_m,
                1e3 * self.ball.radius_m
            ));
        }
        warnings
    }

    /// Tabulates the cameras, one row each, with all digits.
    pub(super) fn table(&self) -> Result<String> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record([
            "camera",
            "frames",
            "detections",
            "outliers",
            "rms_px",
            "x_m",
            "y_m",
            "z_m",
            "position_sigma_m",
            "turn_sigma_rad",
            "offset_s",
            "offset_sigma_s",
            "time_offset_before_s",
            "time_offset_s",
            "focal_factor",
            "focal_factor_sigma",
            "focal_refined",
        ])?;
        for row in &self.cameras {
            let of = row.of;
            let mut cells = vec![
                row.config.name.clone(),
                row.frames.to_string(),
                of.detections.len().to_string(),
                row.outliers().to_string(),
                of.rms_px.to_string(),
            ];
            let position_m = row.world_from_camera.translation.vector;
            cells.extend(position_m.iter().map(f64::to_string));
            let figures = [
                of.position_sigma_m,
                of.turn_sigma_rad,
                of.offset_s,
                of.offset_sigma_s,
                row.config.time_offset_s,
                corrected_offset_s(row.config, of),
            ];
            cells.extend(figures.iter().map(f64::to_string));
            cells.extend(match of.focal {
                Some(focal) => [
                    focal.factor.to_string(),
                    focal.sigma.to_string(),
                    u8::from(focal.is_refined).to_string(),
                ],
                None => [String::new(), String::new(), "0".to_owned()],
            });
            table.write_record(cells)?;
        }
        Ok(String::from_utf8(table.into_inner()?)?)
    }

    /// Tabulates the detections, one row each: pixel of the ball's centre and distance from the fitted path.
    pub(super) fn detections(&self) -> Result<String> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record([
            "camera",
            "time_s",
            "u_px",
            "v_px",
            "residual_u_px",
            "residual_v_px",
            "residual_radius_px",
            "outlier",
        ])?;
        for row in &self.cameras {
            for seen in &row.of.detections {
                let text = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
                let [u, v] = [0, 1].map(|i| text(seen.residual_px.map(|px| px[i])));
                table.write_record([
                    row.config.name.clone(),
                    seen.time_s.to_string(),
                    seen.pixel[0].to_string(),
                    seen.pixel[1].to_string(),
                    u,
                    v,
                    text(seen.radius_residual_px),
                    u8::from(seen.outlier).to_string(),
                ])?;
            }
        }
        Ok(String::from_utf8(table.into_inner()?)?)
    }

    /// Returns the path of the ball in the world: time in seconds, position in metres.
    fn path_m(&self) -> Vec<(f64, [f64; 3])> {
        let aligned = &self.world.aligned;
        let in_world =
            |place: &[f64; 3]| aligned.world_from_rig * (Point3::from(*place) * aligned.factor());
        let path = self.found.path_m.iter();
        path.map(|(time_s, place)| (*time_s, in_world(place).into()))
            .collect()
    }

    /// Tabulates the path of the ball in the world, by the clock of the first camera.
    pub(super) fn path(&self) -> Result<String> {
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record(["time_s", "x_m", "y_m", "z_m"])?;
        for (time_s, [x, y, z]) in self.path_m() {
            table.write_record([time_s, x, y, z].map(|value| value.to_string()))?;
        }
        Ok(String::from_utf8(table.into_inner()?)?)
    }

    /// Renders the report as an HTML page.
    pub(super) fn page(&self) -> Result<String> {
        let mut page = begin(&self.title());
        push_table(&mut page, &self.rows());
        for note in self.notes() {
            push_paragraph(&mut page, &note);
        }
        for warning in self.warnings() {
            push_paragraph(&mut page, &format!("Warning: {warning}"));
        }
        page.push_str("<h2>Cameras and path of the ball, from above and from the side</h2>\n");
        let symbols = self.cameras.iter().map(|row| CameraSymbol {
            name: row.config.name.clone(),
            world_from_camera: row.world_from_camera,
            looks_into_mirror: row.of.camera.looks_into_mirror(),
            way_m: Vec::new(),
        });
        for picture in rig_figures(&self.path_m(), &symbols.collect::<Vec<_>>())? {
            let _ = writeln!(page, "<figure>{}</figure>", picture.svg);
        }
        for row in &self.cameras {
            let points = row
                .of
                .detections
                .iter()
                .map(|seen: &BallSighting| ObservedPoint {
                    observed: seen.pixel,
                    residual_px: seen.residual_px,
                    outlier: seen.outlier,
                });
            let picture = residual_arrows(row.size_px, &points.collect::<Vec<_>>())?;
            let _ = writeln!(
                page,
                "<h2>{}: residuals</h2>\n<figure>{}</figure>",
                row.config.name, picture.svg
            );
        }
        page.push_str("</body></html>\n");
        Ok(page)
    }
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}:\n", self.title())?;
        write_table(f, &self.rows())?;
        write!(f, "\n{}", self.notes().join("\n"))?;
        for warning in self.warnings() {
            write!(f, "\n\nWarning: {warning}")?;
        }
        Ok(())
    }
}
