//! Targets that look the same: what one of them is, another is not.
//!
//! Two bodies are never in the same place, and a sighting is of one at most. Where one is thought to be, with the probability of its existence, its density says how likely
//! a sighting there is its own.

use nalgebra::Matrix3;

use super::{Seeker, TrackState};

/// The others that look as a target does.
pub(in crate::tracker) struct Alike<'a> {
    /// Those who have had their word on this instant's frames.
    pub(in crate::tracker) before: Vec<&'a Seeker>,
    /// Those who are still to have it.
    pub(in crate::tracker) after: Vec<&'a Seeker>,
}

impl Alike<'_> {
    /// Where those are that surely exist.
    pub(super) fn places_m(&self) -> impl Iterator<Item = [f64; 3]> {
        let others = self.before.iter().chain(&self.after);
        let known = others.filter(|other| other.filter.located() >= 0.5);
        known.filter_map(|other| Some(other.filter.estimate(0.0)?.position_m))
    }

    /// Whether there is one that is not found yet and will look after this one.
    pub(super) fn leaves_some_to_others(&self) -> bool {
        self.after.iter().any(|other| !other.is_found())
    }
}

impl Seeker {
    /// Whether it looks like another: no image tells the two apart.
    pub(in crate::tracker) fn looks_like(&self, other: &Self) -> bool {
        self.shape == other.shape && self.colors == other.colors
    }

    pub(super) fn is_found(&self) -> bool {
        matches!(self.state, TrackState::Tracking | TrackState::Occluded)
    }

    /// How dense its place is where something was sighted with this covariance, 1/m³ (1/m² on the ground), with the probability that it exists.
    pub(super) fn density(&self, position_m: [f64; 3], covariance_m2: &Matrix3<f64>) -> f64 {
        self.filter.located() * self.filter.predicted_density(position_m, covariance_m2)
    }

    /// By how many nats a sighting is less likely this target's, because it may be another's. Those who have looked at this instant's frames have taken what is theirs; of
    /// those who have not, and this one, it is likelier the one's that was expected there. Against all of them it may be a thing that looks like them: such have the density
    /// `anywhere`, and are so much less likely to look so (`likeness`, nats).
    pub(super) fn taken_nats(
        &self,
        alike: &Alike,
        (position_m, covariance_m2): ([f64; 3], &Matrix3<f64>),
        likeness: f64,
        anywhere: f64,
    ) -> f64 {
        let density = |others: &[&Self]| -> f64 {
            let densities = others
                .iter()
                .map(|other| other.density(position_m, covariance_m2));
            libm::exp(likeness) * densities.sum::<f64>()
        };
        let taken = libm::log1p(density(&alike.before) / anywhere);
        let mine = anywhere + density(&[self]);
        taken + libm::log1p(density(&alike.after) / mine)
    }
}
