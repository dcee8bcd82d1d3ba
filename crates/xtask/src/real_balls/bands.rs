//! The bands in which the figures of runs must lie.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

use super::score::Figures;

/// The content of `bands.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Bands {
    band: Vec<Band>,
}

/// The bands of some runs of a clip.
#[derive(Debug, Deserialize)]
struct Band {
    clip: String,
    labels: String,
    /// Only at these scales; without it, at all.
    scales: Option<Vec<f64>>,
    /// Only with these factors of the radius; without it, with all.
    radius_factors: Option<Vec<f64>>,
    #[serde(flatten)]
    figures: BTreeMap<String, Range>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Range {
    min: Option<f64>,
    max: Option<f64>,
}

impl Bands {
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
        toml::from_str(&text).with_context(|| path.display().to_string())
    }

    /// Returns a line for each band that a run violates, and one if the run has no band at all.
    pub(crate) fn violations(
        &self,
        clip: &str,
        labels: &str,
        scale: f64,
        radius_factor: f64,
        figures: &Figures,
    ) -> Vec<String> {
        let takes = |allowed: &Option<Vec<f64>>, value: f64| {
            allowed.as_ref().is_none_or(|a| a.contains(&value))
        };
        let run = format!("{clip}, {labels}, scale {scale}, radius factor {radius_factor}");
        let mut count = 0;
        let mut violations = Vec::new();
        for band in &self.band {
            if band.clip != clip
                || band.labels != labels
                || !takes(&band.scales, scale)
                || !takes(&band.radius_factors, radius_factor)
            {
                continue;
            }
            for (name, range) in &band.figures {
                count += 1;
                let Some((_, value)) = figures.iter().find(|(n, _)| n == name) else {
                    violations.push(format!("{run}: there is no figure {name}"));
                    continue;
                };
                let Some(value) = value else {
                    violations.push(format!("{run}: {name} was not measured"));
                    continue;
                };
                if let Some(min) = range.min
                    && !(*value >= min)
                {
                    violations.push(format!("{run}: {name} is {value:.4}, at least {min}"));
                }
                if let Some(max) = range.max
                    && !(*value <= max)
                {
                    violations.push(format!("{run}: {name} is {value:.4}, at most {max}"));
                }
            }
        }
        if count == 0 {
            violations.push(format!("{run}: there is no band"));
        }
        violations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_outside_their_bands_are_named() {
        let text = "[[band]]\nclip = 'roll'\nlabels = 'circles'\nscales = [0.5]\n\
                    on_ball_share = { min = 0.9 }\nwrong_share = { max = 0.01 }\n\
                    [[band]]\nclip = 'roll'\nlabels = 'circles'\nradius_factors = [4]\nrazor = { min = 0 }\n";
        let bands: Bands = toml::from_str(text).unwrap();
        let check = |scale: f64, factor: f64, on_ball: f64, wrong: Option<f64>| {
            let figures = vec![("on_ball_share", Some(on_ball)), ("wrong_share", wrong)];
            bands.violations("roll", "circles", scale, factor, &figures)
        };
        assert!(check(0.5, 1.0, 0.9, Some(0.01)).is_empty());
        let low = check(0.5, 1.0, 0.89, Some(0.02));
        assert_eq!(low.len(), 2, "{low:?}");
        assert!(low[0].ends_with("on_ball_share is 0.8900, at least 0.9"));
        assert!(low[1].ends_with("wrong_share is 0.0200, at most 0.01"));
        assert!(check(0.5, 1.0, 0.9, None)[0].contains("not measured"));
        assert!(check(0.5, 4.0, 0.9, Some(0.0))[0].contains("no figure razor"));
        assert!(check(1.0, 1.0, 0.9, Some(0.0))[0].contains("no band"));
    }
}
