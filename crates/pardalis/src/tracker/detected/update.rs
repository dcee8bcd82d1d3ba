//! Step 3, Bernoulli update: existence and position, from the associated detections and from what each camera's frame says at every particle.

use super::association::AssociatedDetection;
use super::visibility::Visibility;
use crate::likelihood::edge::{Detection, EdgeCue, EdgeFrame};
use crate::tracker::existence::Region;
use pardalis_filter::bernoulli::{BernoulliFilter, MeasurementComponent};

/// By how much a particle outside of the target's region is less likely, nats: it is impossible, but should all be outside, one must remain.
const OUTSIDE_NATS: f32 = 50.0;

/// What the update reads.
pub(super) struct Measurement<'a> {
    pub(super) frames: &'a [EdgeFrame<'a>],
    pub(super) detections: &'a [Detection],
    pub(super) associated: &'a [AssociatedDetection],
    /// The predicted visibility in each camera.
    pub(super) visibilities: &'a [Option<Visibility>],
    /// Where the target can be.
    pub(super) region: Region,
    /// The log-likelihood ratio of a frame in which a visible target is nowhere near a detection, nats.
    pub(super) missed: f32,
}

/// Runs the update. Writes each camera's log-likelihood ratios, one per particle, into `log_ratios`; `components` is a buffer.
pub(super) fn update(
    filter: &mut BernoulliFilter,
    edge: &mut EdgeCue,
    measurement: &Measurement,
    log_ratios: &mut [Vec<f32>],
    components: &mut Vec<MeasurementComponent>,
) {
    let Measurement {
        frames,
        detections,
        associated,
        visibilities,
        region,
        missed,
    } = *measurement;
    components.clear();
    components.extend(associated.iter().map(|associated| associated.component));
    let max_log_ratio = max_existence_log_ratio(filter, edge, measurement);
    let detections = associated.iter().map(|associated| {
        let detection = &detections[associated.detection];
        (
            detection,
            associated.log_ratio_offset,
            associated.widened.as_ref(),
        )
    });
    filter.update(components, max_log_ratio, |particles, out| {
        out.fill(0.0);
        let positions_m = particles.positions_m();
        for frame in frames {
            let of_camera = &mut log_ratios[frame.camera()];
            of_camera.clear();
            of_camera.resize(out.len(), 0.0);
            edge.log_likelihood_ratios(frame, detections.clone(), positions_m, missed, of_camera);
            let Some(visibility) = &visibilities[frame.camera()] else {
                continue;
            };
            for (sum, &log_ratio) in out.iter_mut().zip(&*of_camera) {
                *sum += visibility.mixture_log_ratio(log_ratio);
            }
        }
        let [x, y, z] = positions_m;
        for (particle, sum) in out.iter_mut().enumerate() {
            if !region.contains([x, y, z].map(|column| f64::from(column[particle]))) {
                *sum -= OUTSIDE_NATS;
            }
        }
    });
}

/// The greatest log-ratio by which existence may become more likely. A camera that does not see a target says nothing against one that is occluded or out of its
/// image.
fn max_existence_log_ratio(
    filter: &BernoulliFilter,
    edge: &EdgeCue,
    measurement: &Measurement,
) -> f64 {
    let log_ratios = measurement.associated.iter();
    let log_ratios = log_ratios.map(|associated| associated.existence_log_ratio);
    let greatest = log_ratios.fold(f64::from(measurement.missed), f64::max);
    let predicted = filter.estimate(0.0);
    let of_frame = |frame: &EdgeFrame| {
        let visibility = measurement.visibilities[frame.camera()]?;
        let mixed = f64::from(visibility.mixture_log_ratio(greatest as f32));
        let predicted_m = predicted.as_ref().map(|known| known.position_m);
        let in_view = predicted_m.is_none_or(|position_m| edge.is_in_view(frame, position_m));
        Some(if in_view { mixed } else { mixed.max(0.0) })
    };
    let of_frames = measurement.frames.iter().filter_map(of_frame);
    of_frames.reduce(f64::max).unwrap_or(f64::INFINITY)
}
