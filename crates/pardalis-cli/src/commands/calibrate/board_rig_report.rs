//! Report of a rig calibration for the terminal and as a page.

use std::fmt::{self, Write as _};

use anyhow::Result;
use pardalis_calibrate::RigCalibration;

use super::images::SearchedImage;
use super::page::{begin, push_paragraph, push_table};
use super::report::{Report, listed, metres, with_sigma, write_table};
use crate::draw::calibration::{ObservedPoint, residual_arrows, rms_bars};

/// Explanation of the larger RMS of a camera in a rig.
const WHY_LARGER: &str = "On its own, each image of a camera has its own pose. In the rig, all cameras share one pose per shot, so that the RMS \
    is larger. It is much larger if the images are not exactly simultaneous or the board is not flat.";

/// Report of a rig calibration.
pub(super) struct RigReport<'a> {
    /// Calibration of the rig.
    pub(super) calibration: &'a RigCalibration,
    /// Report of each camera on its own; its images are the shots.
    pub(super) cameras: &'a [Report<'a>],
}

impl RigReport<'_> {
    fn title(&self) -> String {
        let [shots, left_out] = [
            self.cameras[0].images.len(),
            self.calibration.rejected_shots.len(),
        ];
        format!(
            "Rig of {} cameras in {} shots, in the frame of {}",
            self.cameras.len(),
            shots - left_out,
            self.calibration.cameras[0].name
        )
    }

    /// Returns one row per camera: its RMS alone and in the rig, and its pose.
    fn rows(&self) -> Vec<Vec<String>> {
        let head = [
            "camera",
            "RMS on its own (px)",
            "RMS in the rig (px)",
            "position (m)",
            "distance (m)",
            "rotation (deg)",
        ];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        let rig = self.calibration;
        for (i, camera) in rig.cameras.iter().enumerate() {
            let pose = camera.world_from_camera.unwrap_or_default();
            let position = pose.translation.vector;
            let turn_deg = pose.rotation.angle().to_degrees();
            let measured = |value: f64, sigma: f64| match i {
                0 => "-".to_owned(),
                _ => with_sigma(value, Some(sigma)),
            };
            rows.push(vec![
                camera.name.clone(),
                format!("{:.3}", self.cameras[i].best().rms_px),
                format!("{:.3}", rig.rms_px[i]),
                metres(position),
                measured(position.norm(), rig.baseline_sigma_m[i]),
                measured(turn_deg, rig.turn_sigma_rad[i].to_degrees()),
            ]);
        }
        rows
    }

    /// Returns the rejected shots, named by their images.
    fn rejected_shots(&self) -> Vec<String> {
        let shots = self.calibration.rejected_shots.iter();
        let named = shots.map(|&shot| {
            let images = self.cameras.iter().map(|camera| &camera.images[shot]);
            let seen = images.filter(|image| image.found.is_ok());
            let names: Vec<&str> = seen.map(|image| &*image.name).collect();
            format!(
                "{}: rejected because the images are not simultaneous: the cameras disagree on the position of the board",
                names.join(" with ")
            )
        });
        listed(named.collect(), "")
    }

    /// Returns the rejected corners of the other shots.
    fn outliers(&self) -> Vec<String> {
        let outliers = self.calibration.outliers.iter();
        let named = outliers.filter_map(|&(camera, shot, point)| {
            let image = &self.cameras[camera].images[shot];
            let corner = image.found.as_ref().ok()?[point].id;
            let name = self.cameras[camera].camera;
            Some(format!("{name}, {}, corner {corner}", image.name))
        });
        listed(named.collect(), "")
    }

    /// Returns the corners of one camera in one shot.
    fn observed_points(
        &self,
        camera: usize,
        shot: usize,
        image: &SearchedImage,
    ) -> Vec<ObservedPoint> {
        let residuals = &self.calibration.residuals_px[camera][shot];
        let corners = image.found.iter().flatten().zip(residuals);
        corners
            .enumerate()
            .map(|(point, (corner, residual))| ObservedPoint {
                observed: corner.pixel,
                residual_px: *residual,
                outlier: self.calibration.outliers.contains(&(camera, shot, point)),
            })
            .collect()
    }

    /// Renders the report as an HTML page.
    pub(super) fn page(&self) -> Result<String> {
        let mut page = begin(&self.title());
        push_table(&mut page, &self.rows());
        push_paragraph(&mut page, WHY_LARGER);
        for shot in self.rejected_shots() {
            push_paragraph(&mut page, &shot);
        }
        for (place, camera) in self.cameras.iter().enumerate() {
            let rms_px = self.calibration.rms_px[place];
            let _ = writeln!(page, "<h2>{}</h2>", camera.camera);
            let (mut all, mut views) = (Vec::new(), Vec::new());
            for (shot, image) in camera.images.iter().enumerate() {
                let seen = self.observed_points(place, shot, image);
                if let Some(rms_px) = rms_px_of(&seen) {
                    views.push((&*image.name, rms_px));
                    all.extend(seen);
                }
            }
            for picture in [
                residual_arrows(camera.size_px, &all)?,
                rms_bars(&views, rms_px)?,
            ] {
                let _ = writeln!(page, "<figure>{}</figure>", picture.svg);
            }
        }
        let outliers = self.outliers();
        if !outliers.is_empty() {
            page.push_str("<h2>Outliers</h2>\n");
        }
        for outlier in outliers {
            push_paragraph(&mut page, &outlier);
        }
        page.push_str("</body></html>\n");
        Ok(page)
    }
}

impl fmt::Display for RigReport<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}:\n", self.title())?;
        write_table(f, &self.rows())?;
        write!(f, "\n{WHY_LARGER}")?;
        for shot in self.rejected_shots() {
            write!(f, "\n{shot}")?;
        }
        let outliers = self.outliers();
        if !outliers.is_empty() {
            write!(f, "\nOutliers:\n  {}", outliers.join("\n  "))?;
        }
        Ok(())
    }
}

/// Returns the root mean square residual of the fitted points in pixels; `None` if there are none.
fn rms_px_of(observed_points: &[ObservedPoint]) -> Option<f64> {
    let fitted = observed_points.iter().filter(|observed| !observed.outlier);
    let squares: Vec<f64> = fitted
        .filter_map(|observed| observed.residual_px)
        .map(|[du, dv]| du * du + dv * dv)
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}
