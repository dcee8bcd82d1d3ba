//! Selection of the target among the blobs of each image.

use nalgebra::{Point3, Vector3};

use super::path::{Observation, Path};
use super::{BlobFrame, Recording, TimedCamera, median};
use pardalis::detect::Blob;
use pardalis::shape::Shape;
use pardalis::view::View;

/// Largest number of control points. Longer recordings are cut: the cost grows with the cube of this number,
/// the accuracy hardly.
const MAX_CONTROLS: usize = 400;

/// Distance from the predicted position, in pixels, beyond which a blob is another object (if it also exceeds
/// the target's size).
const MATCH_PX: f64 = 5.0;

/// A blob belongs to the background if more than this share of the frames contain a blob of similar size at
/// its position.
const STILL_SHARE: f64 = 0.5;
/// Tolerance of that position, in pixels.
const STILL_PX: f64 = 1.5;
/// Number of frames that this test samples.
const STILL_FRAMES: usize = 200;

/// A blob is partly occluded or merged with another if its area differs from the outline's by more than this
/// share, relative to the typical ratio of the camera's blobs.
const AREA_TOLERANCE: f64 = 0.08;
/// The same for width and height.
const SIDE_TOLERANCE: f64 = 0.06;
/// Lower bound of both tolerances, in pixels of the outline's width: blobs end at whole pixels.
const TOLERANCE_PX: f64 = 2.0;

/// Largest distance, in frames, at which the detections of two cameras count as simultaneous.
const SHARED_FRAMES: f64 = 1.5;

/// Returns a camera's frames with the blobs that may be the target: complete ones that do not belong to the
/// background. Repeated frames are dropped.
pub(super) fn candidates(camera: &TimedCamera) -> Vec<BlobFrame> {
    let step = camera.frames.len().div_ceil(STILL_FRAMES).max(1);
    let sample: Vec<&BlobFrame> = camera.frames.iter().step_by(step).collect();
    let is_scenery = |blob: &Blob| {
        let same = |other: &Blob| {
            let moved = [0, 1].map(|i| other.centroid_px[i] - blob.centroid_px[i]);
            let grown = other.area_px / blob.area_px;
            libm::hypot(moved[0], moved[1]) <= STILL_PX && (0.7..=1.4).contains(&grown)
        };
        let with_it = sample.iter().filter(|frame| frame.blobs.iter().any(same));
        with_it.count() as f64 > STILL_SHARE * sample.len() as f64
    };
    let mut last_s = f64::NEG_INFINITY;
    let mut kept = Vec::new();
    for frame in &camera.frames {
        if frame.time_s <= last_s {
            continue;
        }
        last_s = frame.time_s;
        let may_be_target = |blob: &&Blob| !blob.cut_off && !is_scenery(blob);
        kept.push(BlobFrame {
            time_s: frame.time_s,
            blobs: frame.blobs.iter().filter(may_be_target).copied().collect(),
        });
    }
    kept
}

impl Recording<'_> {
    /// Returns the largest blob of every frame, camera by camera.
    pub(super) fn largest_blobs(&self) -> Vec<Observation> {
        let mut observations = Vec::new();
        for (camera, frames) in self.candidates.iter().enumerate() {
            observations.extend(frames.iter().filter_map(|frame| {
                let blob = frame.blobs.first()?;
                Some(Observation {
                    camera,
                    time_s: frame.time_s,
                    pixel: blob.centroid_px,
                })
            }));
        }
        observations
    }

    /// Limits long recordings to the interval with the most motion in the images.
    pub(super) fn fastest_stretch(
        &self,
        mut observations: Vec<Observation>,
        offsets_s: &[f64],
    ) -> Vec<Observation> {
        let moved = |pair: &[Observation]| {
            let [du, dv] = [0, 1].map(|i| pair[1].pixel[i] - pair[0].pixel[i]);
            // A jump to another blob is not motion.
            let px = libm::hypot(du, dv).min(50.0);
            let same = pair[0].camera == pair[1].camera;
            (
                pair[1].time_s + offsets_s[pair[1].camera],
                if same { px } else { 0.0 },
            )
        };
        let mut motion: Vec<(f64, f64)> = observations.windows(2).map(moved).collect();
        motion.sort_by(|a, b| a.0.total_cmp(&b.0));
        let stretch_s = MAX_CONTROLS as f64 * self.control_interval_s();
        let (mut first, mut sum) = (0, 0.0);
        let mut best = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for &(time_s, px) in &motion {
            sum += px;
            while motion[first].0 < time_s - stretch_s {
                sum -= motion[first].1;
                first += 1;
            }
            if sum > best.0 {
                best = (sum, time_s);
            }
        }
        observations.retain(|observation| {
            let time_s = observation.time_s + offsets_s[observation.camera];
            (best.1 - stretch_s..=best.1).contains(&time_s)
        });
        observations
    }

    /// Returns the blob of every frame that is most likely the target on this path, as the pixel of the
    /// target's centre.
    pub(super) fn matched(&self, path: &Path, offsets_s: &[f64]) -> Vec<Observation> {
        let mut all = Vec::new();
        for (camera, frames) in self.candidates.iter().enumerate() {
            let found: Vec<(Observation, SizeRatios)> = frames
                .iter()
                .filter_map(|frame| {
                    let center = path.position_m(frame.time_s + offsets_s[camera])?;
                    let outline = Outline::of(self.shape, self.views[camera], center)?;
                    let distance = |blob: &Blob| {
                        let [du, dv] = [0, 1].map(|i| blob.centroid_px[i] - outline.centroid_px[i]);
                        libm::hypot(du, dv)
                    };
                    let blobs = frame.blobs.iter();
                    let blob = blobs.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
                    if distance(blob) > outline.area_px.sqrt().max(MATCH_PX) {
                        return None;
                    }
                    let pixel = [0, 1].map(|i| {
                        blob.centroid_px[i] - (outline.centroid_px[i] - outline.center_px[i])
                    });
                    let observation = Observation {
                        camera,
                        time_s: frame.time_s,
                        pixel,
                    };
                    Some((observation, outline.size_ratios(blob)))
                })
                .collect();
            let typical = [0, 1, 2].map(|i| {
                let mut ratios: Vec<f64> = found.iter().map(|(_, size)| size.ratios[i]).collect();
                median(&mut ratios).unwrap_or(1.0)
            });
            let whole = found.iter().filter(|(_, size)| size.is_typical(typical));
            all.extend(whole.map(|(observation, _)| *observation));
        }
        all
    }

    /// Returns the observations made while another camera also saw the target; the others carry no
    /// information on time offsets.
    pub(super) fn simultaneous(
        &self,
        observations: &[Observation],
        offsets_s: &[f64],
    ) -> Vec<Observation> {
        let time_s = |observation: &Observation| observation.time_s + offsets_s[observation.camera];
        let mut order: Vec<(f64, usize)> =
            observations.iter().map(|s| (time_s(s), s.camera)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_simultaneous = |observation: &&Observation| {
            let reach_s = SHARED_FRAMES * self.intervals_s[observation.camera];
            let first = order.partition_point(|(at_s, _)| *at_s < time_s(observation) - reach_s);
            let near = order[first..].iter();
            near.take_while(|(at_s, _)| *at_s <= time_s(observation) + reach_s)
                .any(|(_, camera)| *camera != observation.camera)
        };
        observations
            .iter()
            .filter(is_simultaneous)
            .copied()
            .collect()
    }
}

/// Number of outline points from which centroid and area are computed.
const OUTLINE_POINTS: usize = 32;

/// Image of the target, predicted from its shape and position.
struct Outline {
    /// Centroid of the image.
    centroid_px: [f64; 2],
    area_px: f64,
    /// Width and height between the outermost points, in pixels.
    size_px: [f64; 2],
    /// Image of the target's centre.
    center_px: [f64; 2],
}

/// Size of a blob relative to the outline at its position.
struct SizeRatios {
    /// Ratios of area, width and height.
    ratios: [f64; 3],
    /// Smaller side of the outline, in pixels.
    side_px: f64,
}

impl SizeRatios {
    /// Reports whether the ratios are close to the typical ratios of the camera.
    fn is_typical(&self, typical: [f64; 3]) -> bool {
        let rounding = TOLERANCE_PX / self.side_px;
        let tolerances = [AREA_TOLERANCE, SIDE_TOLERANCE, SIDE_TOLERANCE];
        (0..3).all(|i| (self.ratios[i] / typical[i] - 1.0).abs() <= tolerances[i].max(rounding))
    }
}

impl Outline {
    /// Computes the outline of a target centred at `center`; `None` if part of it is outside the camera's
    /// domain.
    fn of(shape: &Shape, view: &View, center: Point3<f64>) -> Option<Self> {
        let position = center - Vector3::z() * shape.middle_height_m();
        let (camera, camera_from_world) = (view.camera(), view.camera_from_world());
        let points: Vec<[f64; 2]> = shape
            .outline_px(
                camera,
                camera_from_world,
                position.into(),
                1.0,
                OUTLINE_POINTS,
            )
            .into_iter()
            .collect::<Option<_>>()?;
        let center_px = camera.project((camera_from_world * center).into())?;
        let (mut area, mut moment) = (0.0, [0.0; 2]);
        for (i, a) in points.iter().enumerate() {
            // Relative to the centre, to avoid cancellation.
            let a = [0, 1].map(|k| a[k] - center_px[k]);
            let b = [0, 1].map(|k| points[(i + 1) % points.len()][k] - center_px[k]);
            let cross = a[0] * b[1] - a[1] * b[0];
            area += 0.5 * cross;
            moment = [0, 1].map(|k| moment[k] + cross * (a[k] + b[k]) / 6.0);
        }
        let size_px = [0, 1].map(|k| {
            let along = || points.iter().map(|point| point[k]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        });
        (area.abs() > 1e-9).then(|| Self {
            centroid_px: [0, 1].map(|k| center_px[k] + moment[k] / area),
            area_px: area.abs(),
            size_px,
            center_px,
        })
    }

    fn size_ratios(&self, blob: &Blob) -> SizeRatios {
        let side = |i: usize| (blob.max_px[i] + 1 - blob.min_px[i]) as f64 / self.size_px[i];
        SizeRatios {
            ratios: [blob.area_px / self.area_px, side(0), side(1)],
            side_px: self.size_px[0].min(self.size_px[1]),
        }
    }
}
