//! Whether the outline where a target is tracked falls short of its usual one: where the target passes something of its colours, a part of that may have taken its place. The filter
//! does not notice it: what is seen is where the target was predicted, and an outline that is worse may be one that is partly hidden.

/// The outline falls short if it has less than this share of the usual log-likelihood ratio. Hand-set: that of a ball on real clips rarely does for longer than two frames.
const SHARE: f64 = 0.4;
/// The weight of one frame in what is usual. Hand-set: less than a second, during which a ball becomes larger or smaller, or comes into other light; what lasts for longer becomes usual.
const RATE: f64 = 0.05;
/// By how much each frame with such an outline is likelier if something else is tracked, nats; ...
const FRAME_NATS: f64 = 0.9;
/// ... and how much likelier it was before that it is the target, nats. Hand-set, both: the first frame with such an outline says little, and the fifth in a row is likelier of something else.
const BEFORE_NATS: f64 = 3.4;

/// For how long the outline has fallen short.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Shortfall {
    /// The usual log-likelihood ratio of the outline per camera, nats; zero if nothing is known.
    usual_nats: f64,
    /// The number of frames in a row.
    frames: u32,
}

impl Shortfall {
    /// Adds a frame, with the log-likelihood ratio of the outline per camera, nats.
    pub(super) fn add(&mut self, nats: f64) {
        let falls_short = nats < SHARE * self.usual_nats;
        self.frames = if falls_short { self.frames + 1 } else { 0 };
        if nats > 0.0 {
            let rate = if self.usual_nats > 0.0 { RATE } else { 1.0 };
            self.usual_nats += rate * (nats - self.usual_nats);
        }
    }

    /// The probability that it is nevertheless the target.
    pub(super) fn confidence(&self) -> f64 {
        if self.frames == 0 {
            return 1.0;
        }
        1.0 / (1.0 + libm::exp(FRAME_NATS * f64::from(self.frames) - BEFORE_NATS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longer_an_outline_falls_short_the_less_certain_is_the_target() {
        let mut seen = Shortfall::default();
        let mut confidences = |nats: f64, frames: usize| -> Vec<f64> {
            let confidences = (0..frames).map(|_| {
                seen.add(nats);
                seen.confidence()
            });
            confidences.collect()
        };
        assert_eq!(confidences(20.0, 10), [1.0; 10]);
        assert_eq!(confidences(12.0, 3), [1.0; 3]);
        let short = confidences(4.0, 5);
        let expected = [0.92, 0.83, 0.67, 0.45, 0.25];
        let near = |(a, b): (&f64, f64)| (a - b).abs() < 0.02;
        assert!(short.iter().zip(expected).all(near), "{short:?}");
        assert_eq!(confidences(16.0, 1), [1.0]);
        // A ball that goes away slowly has a weaker outline in the end.
        let mut nats = 16.0;
        while nats > 2.0 {
            assert_eq!(confidences(nats, 1), [1.0], "{nats}");
            nats *= 0.98;
        }
        assert_eq!(confidences(-1.0, 1), [1.0 / (1.0 + libm::exp(-2.5))]);
    }
}
