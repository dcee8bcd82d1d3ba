//! What the calibration of a rig says, for the terminal and as a page.

use std::fmt::{self, Write as _};

use anyhow::Result;
use pardalis_calibrate::RigCalibration;

use super::images::SearchedImage;
use super::page::{begin, push_paragraph, push_table};
use super::report::{Report, listed, metres, with_sigma, write_table};
use crate::draw::calibration::{Sighting, residual_arrows, rms_bars};

/// Why a camera's RMS rises in a rig.
const WHY_LARGER: &str = "On its own, a camera has a pose for each of its images; in the rig, all cameras share one pose a shot, so that the RMS \
    is larger: much larger where images were not taken at quite the same instants, or the board is not flat.";

/// All there is to say about a calibrated rig.
pub(super) struct RigReport<'a> {
    /// What was fitted.
    pub(super) calibration: &'a RigCalibration,
    /// What each camera says on its own; its images are the shots.
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

    /// A row a camera: its RMS alone and in the rig, and where it stands.
    fn rows(&self) -> Vec<Vec<String>> {
        let head = [
            "camera",
            "RMS on its own (px)",
            "RMS in the rig (px)",
            "position (m)",
            "distance (m)",
            "turned by (deg)",
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

    /// The shots that were left out, by their images.
    fn shots_left_out(&self) -> Vec<String> {
        let shots = self.calibration.rejected_shots.iter();
        let named = shots.map(|&shot| {
            let images = self.cameras.iter().map(|camera| &camera.images[shot]);
            let seen = images.filter(|image| image.found.is_ok());
            let names: Vec<&str> = seen.map(|image| &*image.name).collect();
            format!(
                "{}: left out, as they do not belong together: the cameras do not agree on where the board was",
                names.join(" with ")
            )
        });
        listed(named.collect(), "")
    }

    /// The corners that were left out of the other shots.
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

    /// The corners of one camera in one shot.
    fn sightings(&self, camera: usize, shot: usize, image: &SearchedImage) -> Vec<Sighting> {
        let residuals = &self.calibration.residuals_px[camera][shot];
        let corners = image.found.iter().flatten().zip(residuals);
        corners
            .enumerate()
            .map(|(point, (corner, residual))| Sighting {
                observed: corner.pixel,
                residual_px: *residual,
                outlier: self.calibration.outliers.contains(&(camera, shot, point)),
            })
            .collect()
    }

    /// The report as one HTML page.
    pub(super) fn page(&self) -> Result<String> {
        let mut page = begin(&self.title());
        push_table(&mut page, &self.rows());
        push_paragraph(&mut page, WHY_LARGER);
        for shot in self.shots_left_out() {
            push_paragraph(&mut page, &shot);
        }
        for (place, camera) in self.cameras.iter().enumerate() {
            let rms_px = self.calibration.rms_px[place];
            let _ = writeln!(page, "<h2>{}</h2>", camera.camera);
            let (mut all, mut views) = (Vec::new(), Vec::new());
            for (shot, image) in camera.images.iter().enumerate() {
                let seen = self.sightings(place, shot, image);
                if let Some(rms_px) = rms_px_of(&seen) {
                    views.push((&*image.name, rms_px));
                    all.extend(seen);
                }
            }
            for picture in [
                residual_arrows(camera.size_px, &all)?,
                rms_bars(&views, rms_px)?,
            ] {
                let _ = writeln!(page, "<figure>{picture}</figure>");
            }
        }
        let outliers = self.outliers();
        if !outliers.is_empty() {
            page.push_str("<h2>Left out as outliers</h2>\n");
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
        for shot in self.shots_left_out() {
            write!(f, "\n{shot}")?;
        }
        let outliers = self.outliers();
        if !outliers.is_empty() {
            write!(f, "\nLeft out as outliers:\n  {}", outliers.join("\n  "))?;
        }
        Ok(())
    }
}

/// The root mean square residual of the points that were fitted, if there are any.
fn rms_px_of(sightings: &[Sighting]) -> Option<f64> {
    let fitted = sightings.iter().filter(|sighting| !sighting.outlier);
    let squares: Vec<f64> = fitted
        .filter_map(|sighting| sighting.residual_px)
        .map(|[du, dv]| du * du + dv * dv)
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}
