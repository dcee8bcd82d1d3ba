//! Look-alikes: other targets that no image tells apart from one.
//!
//! Two bodies are never at the same place, and a detection is of at most one of them. Where one is thought to be, with the probability of its
//! existence, its density says how likely a detection there is its own.

use nalgebra::Matrix3;

use super::DetectedTarget;
use crate::shape::Stance;

/// The other targets that look like one, in the order in which they look at frames.
pub(in crate::tracker) struct LookAlikes<'a> {
    /// The detected body of this number; `None` for an initialised one.
    pub(in crate::tracker) detected: &'a dyn Fn(usize) -> Option<&'a DetectedTarget>,
    /// What the body of the first number claims of the box of the second, as a ratio to clutter; 0 unless boxes are its own.
    pub(in crate::tracker) claim: &'a dyn Fn(usize, usize) -> f64,
    /// The numbers of those that have been updated with this instant's frames.
    pub(in crate::tracker) updated: &'a [usize],
    /// The numbers of those that are only predicted.
    pub(in crate::tracker) predicted: &'a [usize],
}

impl<'a> LookAlikes<'a> {
    fn targets(&self, numbers: &'a [usize]) -> impl Iterator<Item = &'a DetectedTarget> + '_ {
        numbers.iter().filter_map(|&number| (self.detected)(number))
    }

    /// The positions of those that probably exist, in metres, with their velocities in m/s and their stances, and whether each has been found at this instant.
    pub(super) fn places(&self) -> impl Iterator<Item = (([f64; 3], [f64; 3], Stance), bool)> + '_ {
        let updated = self.targets(self.updated);
        let updated = updated.map(|other| (other, other.detected.is_some()));
        let predicted = self.targets(self.predicted).map(|other| (other, false));
        let all = updated.chain(predicted);
        let known = all.filter(|(other, _)| other.filter.located() >= 0.5);
        known.filter_map(|(other, is_found)| {
            let known = other.filter.estimate(0.0)?;
            let velocity_mps = known.velocity_mps.unwrap_or_default();
            let place = (known.position_m, velocity_mps, other.stance());
            Some((place, is_found))
        })
    }

    /// Whether one of those that are only predicted is not found yet.
    pub(super) fn leaves_some_to_others(&self) -> bool {
        let mut predicted = self.targets(self.predicted);
        predicted.any(|other| !other.track.is_known())
    }

    /// The sum of the densities of updated and of predicted ones at a detection with this covariance, 1/m³ (1/m² on the ground).
    pub(super) fn densities(&self, position_m: [f64; 3], covariance_m2: &Matrix3<f64>) -> [f64; 2] {
        [self.updated, self.predicted].map(|numbers| {
            let density = |other: &DetectedTarget| other.density(position_m, covariance_m2);
            self.targets(numbers).map(density).sum()
        })
    }

    /// The sum of what updated and what predicted ones claim of the box with this number, as ratios to clutter.
    pub(in crate::tracker) fn claims(&self, number: usize) -> [f64; 2] {
        [self.updated, self.predicted].map(|numbers| {
            numbers
                .iter()
                .map(|&other| (self.claim)(other, number))
                .sum()
        })
    }
}

impl DetectedTarget {
    /// Returns whether it looks like another: no image tells the two apart.
    pub(in crate::tracker) fn looks_like(&self, other: &Self) -> bool {
        self.shape == other.shape && self.colors == other.colors
    }

    /// Its predicted density at a detection with this covariance, times the probability that it exists, in 1/m³ (1/m² on the ground).
    pub(super) fn density(&self, position_m: [f64; 3], covariance_m2: &Matrix3<f64>) -> f64 {
        let density = self.filter.predicted_density(position_m, covariance_m2);
        self.filter.located() * density
    }
}
