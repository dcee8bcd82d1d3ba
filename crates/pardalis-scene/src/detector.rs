//! Detectors of other programs, whose boxes are tracked.

use super::description::above;
use super::reader::Table;
use pardalis::tracker::DetectorSettings;

/// A detector, and which of its boxes are a target's.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectorConfig {
    /// Its error rates and precision.
    pub settings: DetectorSettings,
    /// The class of the target's boxes; `None` for that with the target's name.
    pub class: Option<String>,
}

/// Reads the table `detector`.
pub(super) fn read_detector(table: &Table) -> Option<DetectorConfig> {
    let about = "Another program, such as a neural network, finds the target: its boxes are in the files that the cameras' `detections` name. Without `colors` it alone does; with them, boxes say where to look and which of several outlines is the target's, and edges say where exactly it is.";
    table.section("detector", about, |detector| {
        let default = DetectorSettings::default();
        let class = detector
            .key("class", "The target's boxes are those with this class.")
            .depends("the target's name")
            .optional::<String>();
        let mut settings = default;
        settings.detection_probability = detector
            .key(
                "detection_probability",
                "Probability that a box is found of a target that nothing hides.",
            )
            .within(above(0.0, 0.999))
            .or(default.detection_probability);
        settings.false_per_image = detector
            .key(
                "false_per_image",
                "Mean number of boxes in an image that are no target.",
            )
            .within(above(0.0, 1e4))
            .or(default.false_per_image);
        settings.side_sigma = detector
            .key("side_sigma", "Standard deviation of each side of a box, as a share of the square root of its area.")
            .within(above(0.0, 1.0))
            .or(default.side_sigma);
        settings.size_tolerance = detector
            .key("size_tolerance", "Standard deviation of errors of the size that all images share, as a share of it: of the target's size, and of boxes that are always too large or too small.")
            .within(0.0..=1.0)
            .or(default.size_tolerance);
        settings.min_score = detector
            .key("min_score", "Boxes with a lower score are left out.")
            .within(0.0..=1.0)
            .or(default.min_score);
        detector.checked(settings.check())?;
        Some(DetectorConfig { settings, class })
    })
}
