//! Which of the blobs that cameras saw are the target.

use nalgebra::{Point3, Vector3};

use super::path::{Path, Seen};
use super::{ClockCamera, Clocks, SightedFrame, median};
use pardalis::detect::Blob;
use pardalis::shape::Shape;
use pardalis::view::View;

/// Longer recordings are cut to so many control points: they say no more, and cost the cube.
const MAX_CONTROLS: usize = 400;

/// A blob farther from where the path says than this, and than the target is large, is another thing, in pixels.
const MATCH_PX: f64 = 5.0;

/// A blob is scenery where more than this share of the frames have one of about its size at its place.
const STILL_SHARE: f64 = 0.5;
/// Its place, in pixels.
const STILL_PX: f64 = 1.5;
/// Frames that are looked at for that.
const STILL_FRAMES: usize = 200;

/// A blob is hidden in part, or has grown together with another, where its area is farther from the outline's than this share, counted from the camera's
/// usual blobs, ...
const AREA_TOLERANCE: f64 = 0.08;
/// ... or its width or height than this share.
const SIDE_TOLERANCE: f64 = 0.06;
/// Both are at least so many pixels of the outline's width: blobs end at whole pixels.
const TOLERANCE_PX: f64 = 2.0;

/// Cameras see the target together where their sightings are not more frames apart than this.
const SHARED_FRAMES: f64 = 1.5;

/// The frames of a camera with the blobs that may be the target: whole ones that are not scenery. Repeated frames are left out.
pub(super) fn candidates(camera: &ClockCamera) -> Vec<SightedFrame> {
    let step = camera.frames.len().div_ceil(STILL_FRAMES).max(1);
    let sample: Vec<&SightedFrame> = camera.frames.iter().step_by(step).collect();
    let is_scenery = |blob: &Blob| {
        let same = |other: &Blob| {
            let moved = [0, 1].map(|i| other.centroid_px[i] - blob.centroid_px[i]);
            let grown = other.area_px / blob.area_px;
            moved[0].hypot(moved[1]) <= STILL_PX && (0.7..=1.4).contains(&grown)
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
        kept.push(SightedFrame {
            time_s: frame.time_s,
            blobs: frame.blobs.iter().filter(may_be_target).copied().collect(),
        });
    }
    kept
}

impl Clocks<'_> {
    /// The largest blob of every frame, camera by camera.
    pub(super) fn largest_blobs(&self) -> Vec<Seen> {
        let mut seen = Vec::new();
        for (camera, frames) in self.candidates.iter().enumerate() {
            seen.extend(frames.iter().filter_map(|frame| {
                let blob = frame.blobs.first()?;
                Some(Seen {
                    camera,
                    time_s: frame.time_s,
                    pixel: blob.centroid_px,
                })
            }));
        }
        seen
    }

    /// Of long recordings, the stretch in which images move most.
    pub(super) fn liveliest(&self, mut seen: Vec<Seen>, offsets_s: &[f64]) -> Vec<Seen> {
        let moved = |pair: &[Seen]| {
            let [du, dv] = [0, 1].map(|i| pair[1].pixel[i] - pair[0].pixel[i]);
            // A jump to another blob is no motion.
            let px = du.hypot(dv).min(50.0);
            let same = pair[0].camera == pair[1].camera;
            (
                pair[1].time_s + offsets_s[pair[1].camera],
                if same { px } else { 0.0 },
            )
        };
        let mut motion: Vec<(f64, f64)> = seen.windows(2).map(moved).collect();
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
        seen.retain(|seen| {
            let time_s = seen.time_s + offsets_s[seen.camera];
            (best.1 - stretch_s..=best.1).contains(&time_s)
        });
        seen
    }

    /// The blob of every frame that is most likely the target on this path, as the pixel of the target's middle.
    pub(super) fn matched(&self, path: &Path, offsets_s: &[f64]) -> Vec<Seen> {
        let mut all = Vec::new();
        for (camera, frames) in self.candidates.iter().enumerate() {
            let found: Vec<(Seen, Likeness)> = frames
                .iter()
                .filter_map(|frame| {
                    let middle = path.position_m(frame.time_s + offsets_s[camera])?;
                    let outline = Outline::of(self.shape, self.views[camera], middle)?;
                    let distance = |blob: &Blob| {
                        let [du, dv] = [0, 1].map(|i| blob.centroid_px[i] - outline.centroid_px[i]);
                        du.hypot(dv)
                    };
                    let blobs = frame.blobs.iter();
                    let blob = blobs.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
                    if distance(blob) > outline.area_px.sqrt().max(MATCH_PX) {
                        return None;
                    }
                    let pixel = [0, 1].map(|i| {
                        blob.centroid_px[i] - (outline.centroid_px[i] - outline.middle_px[i])
                    });
                    let seen = Seen {
                        camera,
                        time_s: frame.time_s,
                        pixel,
                    };
                    Some((seen, outline.likeness(blob)))
                })
                .collect();
            let usual = [0, 1, 2].map(|i| {
                let mut ratios: Vec<f64> = found.iter().map(|(_, like)| like.ratios[i]).collect();
                median(&mut ratios).unwrap_or(1.0)
            });
            let whole = found.iter().filter(|(_, like)| like.is_usual(usual));
            all.extend(whole.map(|(seen, _)| *seen));
        }
        all
    }

    /// What was seen while another camera saw the target too: the rest says nothing of clocks.
    pub(super) fn shared(&self, seen: &[Seen], offsets_s: &[f64]) -> Vec<Seen> {
        let time_s = |seen: &Seen| seen.time_s + offsets_s[seen.camera];
        let mut order: Vec<(f64, usize)> = seen.iter().map(|s| (time_s(s), s.camera)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_shared = |seen: &&Seen| {
            let reach_s = SHARED_FRAMES * self.intervals_s[seen.camera];
            let first = order.partition_point(|(at_s, _)| *at_s < time_s(seen) - reach_s);
            let near = order[first..].iter();
            near.take_while(|(at_s, _)| *at_s <= time_s(seen) + reach_s)
                .any(|(_, camera)| *camera != seen.camera)
        };
        seen.iter().filter(is_shared).copied().collect()
    }
}

/// Points on an outline that its middle and area are taken of.
const OUTLINE_POINTS: usize = 32;

/// The target's image, as its shape and place say.
struct Outline {
    /// The middle of the image.
    centroid_px: [f64; 2],
    area_px: f64,
    /// From the first to the last pixel that it covers.
    size_px: [f64; 2],
    /// The image of the target's middle.
    middle_px: [f64; 2],
}

/// How large a blob is beside the outline at its place.
struct Likeness {
    /// Of area, width and height.
    ratios: [f64; 3],
    /// The outline's smaller side.
    side_px: f64,
}

impl Likeness {
    /// Whether the ratios are near those of a camera's usual blobs.
    fn is_usual(&self, usual: [f64; 3]) -> bool {
        let rounding = TOLERANCE_PX / self.side_px;
        let tolerances = [AREA_TOLERANCE, SIDE_TOLERANCE, SIDE_TOLERANCE];
        (0..3).all(|i| (self.ratios[i] / usual[i] - 1.0).abs() <= tolerances[i].max(rounding))
    }
}

impl Outline {
    /// Of a target whose middle is known; `None` where not all of it is seen.
    fn of(shape: &Shape, view: &View, middle: Point3<f64>) -> Option<Self> {
        let position = middle - Vector3::z() * shape.middle_height_m();
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
        let middle_px = camera.project((camera_from_world * middle).into())?;
        let (mut area, mut moment) = (0.0, [0.0; 2]);
        for (i, a) in points.iter().enumerate() {
            // From the middle, so that nothing is lost to rounding.
            let a = [0, 1].map(|k| a[k] - middle_px[k]);
            let b = [0, 1].map(|k| points[(i + 1) % points.len()][k] - middle_px[k]);
            let cross = a[0] * b[1] - a[1] * b[0];
            area += 0.5 * cross;
            moment = [0, 1].map(|k| moment[k] + cross * (a[k] + b[k]) / 6.0);
        }
        let size_px = [0, 1].map(|k| {
            let along = || points.iter().map(|point| point[k]);
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
        });
        (area.abs() > 1e-9).then(|| Self {
            centroid_px: [0, 1].map(|k| middle_px[k] + moment[k] / area),
            area_px: area.abs(),
            size_px,
            middle_px,
        })
    }

    fn likeness(&self, blob: &Blob) -> Likeness {
        let side = |i: usize| (blob.max_px[i] + 1 - blob.min_px[i]) as f64 / self.size_px[i];
        Likeness {
            ratios: [blob.area_px / self.area_px, side(0), side(1)],
            side_px: self.size_px[0].min(self.size_px[1]),
        }
    }
}
