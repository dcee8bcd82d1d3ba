//! Mean colours of whole bodies: one per labelled body, and the likelihood that a body of another mean colour
//! is the target.

use std::fmt::Write as _;

use serde::Deserialize;

/// Standard deviations by which illumination absent from the labelled images changes the two ratios of chroma
/// to luma, and ln of the luma. Hand-set.
const UNSEEN_ILLUMINATION: [f64; 3] = [0.045, 0.045, 0.3];
/// The standard deviation by which grey light changes the luma alone, as a share of it: reflections, haze, and what a label contains of the
/// surroundings. The ratios change in proportion, most for dark, saturated colours. Hand-set, from real clips with labels that are up to 6 % too large.
const UNSEEN_GREY: f64 = 0.055;
/// Widths of the uniform distribution of clutter over the same three features. Hand-set.
const LOOKALIKE_SPREAD: [f64; 3] = [0.3, 0.3, 1.0];

/// The mean colours of labelled bodies, one per body and image.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyColors {
    /// Y, U and V of BT.601, full range, 0 to 255.
    means: Vec<[f32; 3]>,
    /// Mean and variance of each feature ([`features`]), without what grey light adds.
    features: [(f64, f64); 3],
}

/// Returns the features that illumination changes least: (U − 128)/Y, (V − 128)/Y and ln Y.
fn features([y, u, v]: [f32; 3]) -> [f64; 3] {
    let [y, u, v] = [y.max(1.0), u - 128.0, v - 128.0].map(f64::from);
    [u / y, v / y, libm::log(y)]
}

impl BodyColors {
    /// Distances from the outline, in pixels and negative inside, of the pixels that enter a body's mean
    /// colour: inside the blur of the edge. Hand-set.
    pub const DEPTH_PX: std::ops::RangeInclusive<f32> = -6.0..=-1.2;

    /// Summarises mean colours, rounded to the tenths that files hold; `None` if there are none.
    pub(super) fn new(mut means: Vec<[f32; 3]>) -> Option<Self> {
        if means.is_empty() {
            return None;
        }
        for value in means.as_flattened_mut() {
            *value = (10.0 * *value).round() / 10.0;
        }
        let count = means.len() as f64;
        let all: Vec<[f64; 3]> = means.iter().map(|mean| features(*mean)).collect();
        let features = std::array::from_fn(|i| {
            let mean = all.iter().map(|values| values[i]).sum::<f64>() / count;
            let squares = all.iter().map(|values| (values[i] - mean).powi(2));
            let scatter = squares.sum::<f64>() / (count - 1.0).max(1.0);
            (mean, scatter + UNSEEN_ILLUMINATION[i].powi(2))
        });
        Some(Self { means, features })
    }

    /// Returns the mean of all bodies (Y, U and V).
    pub(crate) fn mean(&self) -> [f32; 3] {
        let count = self.means.len() as f32;
        [0, 1, 2].map(|i| self.means.iter().map(|mean| mean[i]).sum::<f32>() / count)
    }

    /// Returns the log-likelihood ratio, in nats, of a body's mean colour (Y, U and V): the target against
    /// clutter whose single pixels could be the target's.
    pub fn log_ratio(&self, mean: [f32; 3]) -> f64 {
        self.log_ratio_with_grey(mean, UNSEEN_GREY)
    }

    /// As [`log_ratio`](Self::log_ratio), for a body whose mean colour contains nothing of its surroundings.
    pub(crate) fn log_ratio_without_grey(&self, mean: [f32; 3]) -> f64 {
        self.log_ratio_with_grey(mean, 0.0)
    }

    fn log_ratio_with_grey(&self, mean: [f32; 3], grey: f64) -> f64 {
        let of_feature = |i: usize, value: f64| {
            let (mean, variance) = self.features[i];
            let of_grey = if i < 2 { grey * mean } else { 0.0 };
            let variance = variance + of_grey.powi(2);
            let normal = libm::log(std::f64::consts::TAU * variance);
            libm::log(LOOKALIKE_SPREAD[i]) - 0.5 * ((value - mean).powi(2) / variance + normal)
        };
        let values = features(mean).into_iter().enumerate();
        values.map(|(i, value)| of_feature(i, value)).sum()
    }

    /// Formats the means as a section of a colour model file.
    pub(super) fn to_text(&self) -> String {
        let mut text = String::from(
            "\n# the mean colour (y, u, v from 0 to 255) within the outline, one row per labelled body\n[body]\nmeans = [\n",
        );
        for [y, u, v] in &self.means {
            let _ = writeln!(text, "    [{y:.1}, {u:.1}, {v:.1}],");
        }
        text.push_str("]\n");
        text
    }
}

/// The section `[body]` of a colour model file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BodyText {
    means: toml::Spanned<Vec<toml::Spanned<[f32; 3]>>>,
}

impl BodyText {
    /// Validates the section; on failure returns the offset in the text and the message.
    pub(super) fn read(&self) -> Result<BodyColors, (usize, String)> {
        let is_color = |row: &[f32; 3]| row.iter().all(|value| (0.0..=255.0).contains(value));
        for row in self.means.get_ref() {
            if !is_color(row.get_ref()) {
                let message = format!(
                    "{:?} is not a colour; each value must be 0 to 255",
                    row.get_ref()
                );
                return Err((row.span().start, message));
            }
        }
        let rows = self.means.get_ref().iter();
        BodyColors::new(rows.map(|row| *row.get_ref()).collect()).ok_or_else(|| {
            let message = "means has no row; remove [body] or learn the model again";
            (self.means.span().start, message.to_owned())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORANGE: [f32; 3] = [130.0, 79.0, 181.0];

    #[test]
    fn illumination_changes_cost_less_than_colour_changes() {
        let colors = BodyColors::new(vec![ORANGE; 3]).unwrap();
        let lit = |light: f32, [y, u, v]: [f32; 3]| {
            [
                light * y,
                128.0 + light * (u - 128.0),
                128.0 + light * (v - 128.0),
            ]
        };
        let own = colors.log_ratio(ORANGE);
        assert!(own > 2.0, "{own}");
        for light in [0.75, 1.3] {
            assert!(colors.log_ratio(lit(light, ORANGE)) > 1.0);
        }
        // A brown of the same hue, then a dark orange.
        let brown = [116.0, 100.0, 157.0];
        assert!(
            colors.log_ratio(brown) < -2.0,
            "{}",
            colors.log_ratio(brown)
        );
        assert!(colors.log_ratio(lit(0.3, ORANGE)) < -3.0);
    }

    #[test]
    fn a_rim_of_the_surroundings_in_a_label_costs_little() {
        // A dark red, and the same with a fortieth of a white wall; a brown as dark.
        let red = [60.0, 115.0, 197.0];
        let wall = [220.0, 128.0, 128.0];
        let with_rim = [0, 1, 2].map(|i| red[i] + 0.025 * (wall[i] - red[i]));
        let colors = BodyColors::new(vec![with_rim; 3]).unwrap();
        assert!(colors.log_ratio(red) > 0.0, "{}", colors.log_ratio(red));
        // Without the allowance it costs much, and what the labels contain is surer.
        assert!(colors.log_ratio_without_grey(red) < 0.0);
        assert!(colors.log_ratio_without_grey(with_rim) > colors.log_ratio(with_rim));
        let brown = [60.0, 112.0, 152.0];
        assert!(colors.log_ratio(brown) < -5.0);
    }

    #[test]
    fn varied_training_colours_tolerate_larger_differences() {
        let other = [130.0, 90.0, 170.0];
        let [same, varied] =
            [[ORANGE; 2], [ORANGE, other]].map(|means| BodyColors::new(means.to_vec()).unwrap());
        let far = [130.0, 98.0, 160.0];
        assert!(varied.log_ratio(far) > same.log_ratio(far) + 2.0);
        assert_eq!(BodyColors::new(Vec::new()), None);
    }

    #[test]
    fn invalid_sections_are_rejected_with_their_offset() {
        let read = |text: &str| {
            let parsed: BodyText = toml::from_str(text).unwrap();
            parsed.read()
        };
        let colors = BodyColors::new(vec![[130.04, 79.96, 181.0]]).unwrap();
        let text = colors.to_text();
        let (_, section) = text.split_once("[body]").unwrap();
        assert_eq!(read(section).unwrap(), colors);
        let (offset, message) = read("means = [[1, 2, 3], [1, 256, 3]]").unwrap_err();
        assert!(offset == 20 && message.contains("0 to 255"), "{message}");
        assert!(read("means = [[1, 2, nan]]").is_err());
        assert!(read("means = []").unwrap_err().1.contains("no row"));
    }
}
