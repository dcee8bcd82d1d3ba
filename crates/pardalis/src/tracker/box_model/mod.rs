//! Boxes that another program draws around a body: the box of a body in an image, the position that boxes measure, and how likely they are.
//!
//! A detector misses the body now and then and reports others: each box is the body's, somebody else's or clutter. The likelihood of all boxes of an image, given where the body is, is
//! that of a Bernoulli filter (Ristic, Vo, Vo and Farina 2013, "A tutorial on Bernoulli filters", eq. 28):
//! 1 − p + p·Σ g(box | position)/λc(box), with the probability of detection p, λ false boxes per image and their density c.

mod body_box;
mod fit;
mod likelihood;
mod sight;
#[cfg(test)]
mod tests;

pub(super) use fit::Body;
pub(super) use likelihood::log_ratio;
pub(super) use sight::{Fit, Sight, clipped, sigma_px};
