//! The filter of a target.

use super::description::above;
use super::motion::read_motion;
use super::reader::Table;
use super::setting::Word;
use pardalis::shape::Shape;
use pardalis::tracker::DetectedSettings;
use pardalis_filter::bernoulli::ParticleRange;
use pardalis_filter::motion::ConstantVelocity;
use pardalis_filter::particle_filter::{FilterSettings, MAX_PARTICLES};
use pardalis_filter::resample::Resampling;

/// Description of the table `filter`.
const ABOUT_FILTER: &str = "The particle filter.";

/// Reads the numbers of particles of a detected target.
pub(super) fn read_detected_particles(table: &Table) -> ParticleRange {
    let default = DetectedSettings::PARTICLES;
    let particles = table.section("filter", ABOUT_FILTER, |filter| {
        let max = read_particles(filter, default.max);
        let min = read_min_particles(filter, max);
        for key in ["resampling", "resample_below"] {
            if filter.knows(key) {
                let message =
                    "has no effect on a detected target, whose filter resamples differently";
                filter.warn(key, message);
            }
        }
        Some(ParticleRange { min, max })
    });
    particles.unwrap_or(default)
}

/// Reads the least number of particles of a target that has up to `max`.
fn read_min_particles(filter: &Table, max: usize) -> usize {
    let min = filter
        .key(
            "min_particles",
            "Number of particles with which an update begins, for a target with the edge cue or a detector. Where too few of them agree with the images, more are drawn, up to `particles`. Fewer are faster, and velocities noisier.",
        )
        .within(1.0..=MAX_PARTICLES as f64)
        .depends("as many as `particles`")
        .or(max);
    if min > max {
        let message =
            format!("is {min}, and there are at most {max}; raise particles, or lower this");
        filter.problem("min_particles", message);
    }
    min
}

fn read_particles(filter: &Table, default: usize) -> usize {
    filter
        .key(
            "particles",
            "Number of particles; the greatest, for a target with the edge cue or a detector.",
        )
        .within(1.0..=MAX_PARTICLES as f64)
        .depends("2000; 500 for a target with the edge cue or a detector")
        .or(default)
}

pub(super) fn read_filter(table: &Table, shape: Option<&Shape>) -> Option<FilterSettings> {
    let default = FilterSettings::default();
    let motion = read_motion(table, shape, ConstantVelocity::DEFAULT);
    let settings = table.section("filter", ABOUT_FILTER, |filter| {
        let particle_count = read_particles(filter, default.particle_count);
        if filter.is_describing() {
            read_min_particles(filter, particle_count);
        } else if filter.knows("min_particles") {
            let message = "has no effect on a target with published cues, whose number of particles is constant";
            filter.warn("min_particles", message);
        }
        let resampling = filter
            .key("resampling", "Resampling scheme.")
            .word(default.resampling);
        let resample_below = filter
            .key(
                "resample_below",
                "Resample when the effective sample size falls to this share of the particles; 1 resamples at every step.",
            )
            .within(above(0.0, 1.0))
            .or(default.resample_below);
        let mut settings = default;
        settings.particle_count = particle_count;
        settings.resampling = resampling?;
        settings.resample_below = resample_below;
        Some(settings)
    });
    let settings = if table.has("filter") {
        settings
    } else {
        Some(default)
    };
    let mut settings = settings?;
    settings.motion = motion?;
    Some(settings)
}

impl Word for Resampling {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("systematic", Self::Systematic),
        ("stratified", Self::Stratified),
        ("residual", Self::Residual),
        ("multinomial", Self::Multinomial),
    ];
}
