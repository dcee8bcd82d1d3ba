//! Tuned constants of the proposal.

use pardalis_core::tuned;

tuned! {
    /// Tuned constants of the proposal of a Bernoulli filter, for sensitivity studies. They are no settings: names,
    /// meanings and defaults may change in any release. Importance weights correct for them, so that they affect only
    /// how many particles are needed.
    ProposalTuning {
        /// Least share of births: particles drawn at components, independently of the prediction.
        birth_share: f64 = 0.1, "share", "hand-set";
        /// Share of the births that is distributed evenly over the components, and not by their weights.
        even_birth_share: f64 = 0.5, "share", "hand-set: the weights are based on a single frame";
        /// Factor by which births widen the standard deviations of components.
        birth_widening: f64 = 2.0, "factor", "hand-set: likelihoods may have wider tails than components";
        /// Share of the other particles that are drawn from the prediction alone.
        predicted_share: f64 = 0.25, "share", "hand-set: a defensive mixture against wrong components";
        /// Particles are resampled if the effective sample size is at most this share of their number.
        resample_below: f64 = 0.5, "share", "the usual choice";
        /// An update draws more particles if a smaller share of the first is effective.
        effective_share: f64 = 0.3, "share", "hand-set: of 200, 60, whose noise adds 1 % to errors of positions; usually 40 % are effective";
        /// One in this number of particles has a velocity jump, even if jumps are rare.
        jump_one_in: usize = 4, "particles", "hand-set";
        /// The moment-matched proposal is used if the effective sample size falls below this share of the number of
        /// particles.
        min_effective_share: f64 = 0.1, "share", "hand-set";
        /// Share of births among the particles of the moment-matched proposal.
        moment_matched_birth_share: f64 = 0.5, "share", "hand-set";
    }
}
