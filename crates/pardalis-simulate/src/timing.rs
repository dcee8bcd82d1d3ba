//! Exposure times, time stamps and delivery of a camera's images.

use pardalis_core::rng::{Draws, Stage};

/// Clock and transmission of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Timing {
    /// Frame rate in Hz.
    pub fps: f64,
    /// Middle of the first exposure, in seconds.
    pub phase_s: f64,
    /// Whether a random fraction of the frame interval is added to the phase, as in cameras without a trigger.
    pub random_phase: bool,
    /// Standard deviation of the relative error of the frame rate, as in cameras with individual quartz
    /// oscillators.
    pub rate_sigma: f64,
    /// Error of the time stamps (stamp minus true time), in seconds.
    pub clock_offset_s: f64,
    /// Standard deviation of an additional random error that is constant for the camera, in seconds.
    pub clock_offset_sigma_s: f64,
    /// Standard deviation of each stamp's individual error in seconds, truncated at three standard deviations.
    pub stamp_jitter_s: f64,
    /// Probability that a frame is dropped.
    pub drop_probability: f64,
    /// Intervals (from, to) in seconds in which all frames are dropped.
    pub drops_s: Vec<[f64; 2]>,
    /// Intervals (from, to) in seconds in which the last image is delivered repeatedly.
    pub freezes_s: Vec<[f64; 2]>,
    /// Time from the middle of the exposure to the arrival of the image, in seconds.
    pub delay_s: f64,
    /// Standard deviation of a normal variable whose magnitude is added to the delay, in seconds, truncated
    /// at three standard deviations.
    pub delay_jitter_s: f64,
    /// Numbers of delivered images with truncated files.
    pub broken_frames: Vec<usize>,
}

impl Default for Timing {
    /// Returns a triggered camera at 25 frames per second without delay.
    fn default() -> Self {
        Self {
            fps: 25.0,
            phase_s: 0.0,
            random_phase: false,
            rate_sigma: 0.0,
            clock_offset_s: 0.0,
            clock_offset_sigma_s: 0.0,
            stamp_jitter_s: 0.0,
            drop_probability: 0.0,
            drops_s: Vec::new(),
            freezes_s: Vec::new(),
            delay_s: 0.0,
            delay_jitter_s: 0.0,
            broken_frames: Vec::new(),
        }
    }
}

/// A delivered image; its index in the list is its number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivery {
    /// True time of the middle of the exposure, in seconds.
    pub time_s: f64,
    /// Time stamp in seconds.
    pub stamp_s: f64,
    /// True time of arrival, in seconds.
    pub arrival_s: f64,
    /// Number and true time of the exposure in the image: its own, or an earlier one if the camera is frozen.
    pub shown: (u32, f64),
    /// Whether the file is truncated.
    pub is_broken: bool,
}

/// Exposure number that stands for the whole camera in random draws.
const WHOLE_CAMERA: u32 = u32::MAX;

impl Timing {
    /// Returns the deliveries of the camera with this index from time 0 to `duration_s` in seconds, in order
    /// of arrival.
    pub fn deliveries(&self, seed: u32, camera: u32, duration_s: f64) -> Vec<Delivery> {
        let draws = Draws::new(seed, camera);
        let normals = |exposure: u32| {
            let four = draws.normals(exposure, 0, Stage::Clock, 0);
            four.map(|n| f64::from(n).clamp(-3.0, 3.0))
        };
        let [rate, clock, ..] = normals(WHOLE_CAMERA);
        let interval_s = 1.0 / (self.fps * (1.0 + self.rate_sigma * rate));
        let offset_s = self.clock_offset_s + self.clock_offset_sigma_s * clock;
        let phase_s = if self.random_phase {
            self.phase_s + interval_s * draws.uniform(WHOLE_CAMERA, 1, Stage::Clock)
        } else {
            self.phase_s
        };
        let within = |spans: &[[f64; 2]], time_s: f64| {
            spans
                .iter()
                .any(|&[from, to]| from <= time_s && time_s < to)
        };
        let mut deliveries: Vec<Delivery> = Vec::new();
        for exposure in 0.. {
            let time_s = phase_s + f64::from(exposure) * interval_s;
            if time_s >= duration_s {
                break;
            }
            let dropped = within(&self.drops_s, time_s)
                || draws.uniform(exposure, 1, Stage::Clock) < self.drop_probability;
            if dropped {
                continue;
            }
            let [stamp, delay, ..] = normals(exposure);
            let frozen = within(&self.freezes_s, time_s);
            deliveries.push(Delivery {
                time_s,
                stamp_s: time_s + offset_s + self.stamp_jitter_s * stamp,
                arrival_s: time_s + self.delay_s + self.delay_jitter_s * delay.abs(),
                shown: match deliveries.last() {
                    Some(before) if frozen => before.shown,
                    _ => (exposure, time_s),
                },
                is_broken: false,
            });
        }
        deliveries.sort_by(|a, b| a.arrival_s.total_cmp(&b.arrival_s));
        for &number in &self.broken_frames {
            if let Some(delivery) = deliveries.get_mut(number) {
                delivery.is_broken = true;
            }
        }
        deliveries
    }

    /// Reports whether images arrive later than they are taken.
    pub fn has_delays(&self) -> bool {
        self.delay_s > 0.0 || self.delay_jitter_s > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triggered_camera_delivers_all_images_on_time() {
        let deliveries = Timing::default().deliveries(1, 0, 0.4);
        assert_eq!(deliveries.len(), 10);
        for (number, delivery) in deliveries.iter().enumerate() {
            let time_s = number as f64 * 0.04;
            assert_eq!(delivery.time_s, time_s);
            assert_eq!(delivery.stamp_s, time_s);
            assert_eq!(delivery.arrival_s, time_s);
            assert_eq!(delivery.shown, (number as u32, time_s));
        }
    }

    #[test]
    fn drops_freezes_and_delays_match_the_settings() {
        let timing = Timing {
            phase_s: 0.01,
            clock_offset_s: 0.5,
            drops_s: vec![[0.2, 0.4]],
            freezes_s: vec![[0.6, 0.8]],
            delay_s: 0.05,
            broken_frames: vec![3],
            ..Timing::default()
        };
        let deliveries = timing.deliveries(1, 0, 1.0);
        assert_eq!(deliveries.len(), 20);
        assert!(deliveries.iter().all(|d| !(0.2..0.4).contains(&d.time_s)));
        for delivery in &deliveries {
            assert!((delivery.stamp_s - delivery.time_s - 0.5).abs() < 1e-12);
            assert!((delivery.arrival_s - delivery.time_s - 0.05).abs() < 1e-12);
            let frozen = (0.6..0.8).contains(&delivery.time_s);
            let shown = if frozen { 0.57 } else { delivery.time_s };
            assert!((delivery.shown.1 - shown).abs() < 1e-12, "{delivery:?}");
        }
        let broken: Vec<_> = (0..20).filter(|&i| deliveries[i].is_broken).collect();
        assert_eq!(broken, [3]);
    }

    #[test]
    fn random_faults_match_their_frequency_and_size() {
        let timing = Timing {
            fps: 100.0,
            random_phase: true,
            rate_sigma: 0.001,
            stamp_jitter_s: 0.001,
            drop_probability: 0.1,
            delay_jitter_s: 0.02,
            ..Timing::default()
        };
        let of_camera = |camera| timing.deliveries(1, camera, 100.0);
        let deliveries = of_camera(0);
        let count = deliveries.len() as f64;
        assert!((count - 9000.0).abs() < 120.0, "{count}");
        let jitter = deliveries.iter().map(|d| (d.stamp_s - d.time_s).powi(2));
        let jitter_s = (jitter.sum::<f64>() / count).sqrt();
        assert!((jitter_s - 0.001).abs() < 5e-5, "{jitter_s}");
        let ascends = |of: fn(&Delivery) -> f64| {
            let mut sorted = deliveries.clone();
            sorted.sort_by(|a, b| of(a).total_cmp(&of(b)));
            sorted == deliveries
        };
        assert!(ascends(|d| d.arrival_s) && !ascends(|d| d.stamp_s));
        assert!(deliveries.iter().all(|d| d.arrival_s >= d.time_s));
        let other = of_camera(1);
        let first_s = |of: &[Delivery]| of.iter().map(|d| d.shown.1).fold(9.0, f64::min);
        assert_ne!(first_s(&other), first_s(&deliveries));
        assert!((0.0..0.0301).contains(&first_s(&other)));
        assert_eq!(deliveries, of_camera(0));
    }
}
