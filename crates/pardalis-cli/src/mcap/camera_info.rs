//! Calibrations in messages, as the text of a file.

use std::fmt::Write as _;

use foxglove::messages::CameraCalibration;

/// A calibration with the fields of ROS.
pub(super) struct Info {
    pub(super) size_px: [u32; 2],
    pub(super) distortion_model: String,
    pub(super) d: Vec<f64>,
    pub(super) k: Vec<f64>,
    pub(super) r: Vec<f64>,
    pub(super) p: Vec<f64>,
    pub(super) binning: [u32; 2],
    /// `x_offset`, `y_offset`, height and width of the region of interest.
    pub(super) region: [u32; 4],
}

impl Info {
    pub(super) fn of_foxglove(info: CameraCalibration) -> Self {
        // The same model has another name in ROS.
        let distortion_model = match &*info.distortion_model {
            "kannala_brandt" => "equidistant".to_owned(),
            _ => info.distortion_model,
        };
        Self {
            size_px: [info.width, info.height],
            distortion_model,
            d: info.d,
            k: info.k,
            r: info.r,
            p: info.p,
            binning: [0; 2],
            region: [0; 4],
        }
    }

    /// Returns the text that ROS prints of the message, which is read like any calibration file.
    pub(super) fn text(&self, name: &str) -> String {
        let [width, height] = self.size_px;
        let mut text = format!(
            "camera_name: {name}\nwidth: {width}\nheight: {height}\ndistortion_model: {:?}\n",
            // Older recordings name no model of images without distortion.
            if self.d.is_empty() && self.distortion_model.is_empty() {
                "plumb_bob"
            } else {
                &self.distortion_model
            },
        );
        let d = if self.d.is_empty() {
            &[0.0; 5][..]
        } else {
            &self.d
        };
        for (key, values) in [("d", d), ("k", &self.k), ("r", &self.r), ("p", &self.p)] {
            // Those that are left out are all zero in ROS.
            if !values.is_empty() {
                let _ = writeln!(text, "{key}: {values:?}");
            }
        }
        let [binning_x, binning_y] = self.binning;
        let [x_offset, y_offset, height, width] = self.region;
        let _ = write!(
            text,
            "binning_x: {binning_x}\nbinning_y: {binning_y}\nroi:\n  x_offset: {x_offset}\n  y_offset: {y_offset}\n  height: {height}\n  width: {width}\n"
        );
        text
    }
}
