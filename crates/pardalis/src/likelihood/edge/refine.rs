//! Refines the fit of a large body, octave by octave from the one in which it is judged down to the frame's own pixels, as long as these agree.
//!
//! In the coarse octave edges are wide and errors that the whole outline shares make its likelihood flat: it shows that the body is there, but where part of the
//! outline is hidden, blurred or lost in shade, an outline too small or to one side fits as well. Without the shared errors the likelihood has its greatest value
//! where most lines agree, and many local ones. So candidates are drawn as in RANSAC (Fischler and Bolles 1981): the position at which three lines cross their
//! strongest edges, for many triples of lines; the likeliest is where Newton's method starts.

use nalgebra::{Matrix3, Vector3};

use super::fit::{Detection, Neighbors, SectorSums};
use super::lines::{CorrespondenceLines, Errors, REACH_PX, SHIFTS};
use super::{EdgeCue, EdgeFrame, LANES};

/// Times that the lines are placed again around the likeliest candidate. Hand-set: the second time colours are those around the outline.
const ROUNDS: usize = 2;
/// The second and third line of a triple, as shares of the way around the outline from the first. Hand-set: apart enough to determine a circle.
const TRIPLES: [[f64; 2]; 9] = [
    [0.22, 0.53],
    [0.22, 0.66],
    [0.22, 0.78],
    [0.33, 0.53],
    [0.33, 0.66],
    [0.33, 0.78],
    [0.44, 0.53],
    [0.44, 0.66],
    [0.44, 0.78],
];
/// Every so many lines one is the first of triples. Hand-set: neighbours show the same edge.
const FIRST_STEP: usize = 2;
/// No candidate moves the outline farther than this anywhere, in the octave's pixels. Hand-set: a little farther than lines reach.
const MAX_SHIFT_PX: f64 = 6.0;
/// A finer octave agrees if its log-likelihood ratio is at least this share of the coarser one's. Hand-set.
const MIN_SHARE: f64 = 0.5;

/// Buffers of the refinement.
#[derive(Debug, Default)]
pub(super) struct RefineBuffers {
    latest: Detection,
    /// Of each line: by how many pixels it moves per metre along each axis, and the shift of its strongest edge in pixels.
    edges: Vec<(Vector3<f64>, f64)>,
    /// Candidate positions in metres.
    candidates: Vec<Vector3<f64>>,
}

impl RefineBuffers {
    /// Buffers with room for an outline of this many points in each camera.
    pub(super) fn with_room(points: usize) -> Self {
        Self {
            latest: Detection::default(),
            edges: Vec::with_capacity(points),
            candidates: Vec::with_capacity(points.div_ceil(FIRST_STEP) * TRIPLES.len() + 1),
        }
    }
}

impl EdgeCue {
    /// Refines a detection that was fitted in these frames, if it is large enough to be judged in a coarse octave of any.
    pub(crate) fn refine(
        &mut self,
        frames: &[EdgeFrame],
        is_planar: bool,
        detection: &mut Detection,
    ) {
        let octaves = detection.lines().iter().map(|lines| lines.octave.0);
        let coarsest = octaves.max().unwrap_or(0);
        if coarsest == 0 {
            return;
        }
        let mut buffers = std::mem::take(&mut self.refine_buffers);
        for finer in 0..=coarsest {
            let latest = &mut buffers.latest;
            latest.position_m = detection.position_m;
            for _ in 0..ROUNDS {
                self.place_lines(frames, finer, latest);
                self.move_to_consensus(
                    frames,
                    is_planar,
                    latest,
                    &mut buffers.edges,
                    &mut buffers.candidates,
                );
            }
            let is_found =
                self.fit_octave(Errors::OfPixels, frames, None, (is_planar, finer), latest);
            let before = detection.fitted_log_ratio;
            let least = if finer == 0 { before } else { before.min(MIN_SHARE * before) };
            let agrees = is_found
                && latest.camera_count == detection.camera_count
                && latest.fitted_log_ratio >= least;
            if agrees {
                latest.judged_log_ratio = detection.judged_log_ratio;
                latest.number = detection.number;
                std::mem::swap(latest, detection);
            } else if finer > 0 {
                break;
            }
        }
        self.refine_buffers = buffers;
    }

    /// Moves a detection with lines to the likeliest of the positions at which three of one camera's lines cross their strongest edges.
    fn move_to_consensus(
        &mut self,
        frames: &[EdgeFrame],
        is_planar: bool,
        detection: &mut Detection,
        edges: &mut Vec<(Vector3<f64>, f64)>,
        candidates: &mut Vec<Vector3<f64>>,
    ) {
        let here = Vector3::from(detection.position_m);
        candidates.clear();
        candidates.push(here);
        let neighbors = Neighbors::of(here, self.diameter_m);
        for lines in detection.lines() {
            let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                continue;
            };
            self.project(frame.projector(), &neighbors.positions);
            edges.clear();
            edges.extend(self.coordinates.iter().enumerate().map(|(k, point)| {
                let px_per_metre = neighbors.px_per_metre(lines, k, point);
                (px_per_metre, f64::from(lines.strongest_edge_px(k)))
            }));
            add_candidates(edges, here, is_planar, candidates);
        }
        let mut best = (f32::NEG_INFINITY, here);
        for block in candidates.chunks(LANES) {
            let mut positions = [[0_f32; LANES]; 3];
            for (lane, candidate) in block.iter().enumerate() {
                (0..3).for_each(|axis| positions[axis][lane] = candidate[axis] as f32);
            }
            let mut values = [0_f32; LANES];
            for lines in detection.lines() {
                let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                    continue;
                };
                self.project(frame.projector(), &positions);
                let sums = SectorSums::of(lines, Errors::OfPixels, &self.coordinates);
                for (lane, value) in values.iter_mut().enumerate().take(block.len()) {
                    *value += lines.log_likelihood_ratio(Errors::OfPixels, &sums.lane(lane));
                }
            }
            for (value, candidate) in values.into_iter().zip(block) {
                if value > best.0 {
                    best = (value, *candidate);
                }
            }
        }
        detection.position_m = best.1.into();
    }
}

/// Adds the positions at which three lines of an outline cross their edges, to first order.
fn add_candidates(
    edges: &[(Vector3<f64>, f64)],
    here: Vector3<f64>,
    is_planar: bool,
    candidates: &mut Vec<Vector3<f64>>,
) {
    let count = edges.len();
    let after = |first: usize, share: f64| (first + (share * count as f64) as usize) % count;
    for first in (0..count).step_by(FIRST_STEP) {
        for [second, third] in TRIPLES {
            let triple = [first, after(first, second), after(first, third)].map(|k| edges[k]);
            let (mut information, mut right) = (Matrix3::zeros(), Vector3::zeros());
            for (px_per_metre, shift_px) in triple {
                information += px_per_metre * px_per_metre.transpose();
                right += px_per_metre * shift_px;
            }
            if is_planar {
                information.fill_row(2, 0.0);
                information.fill_column(2, 0.0);
                information[(2, 2)] = 1.0;
                right[2] = 0.0;
            }
            // Lines without a pixel make it NaN, those that determine too little huge.
            let Some(step) = information.cholesky().map(|root| root.solve(&right)) else {
                continue;
            };
            let moves = |(px_per_metre, _): &(Vector3<f64>, f64)| px_per_metre.dot(&step).abs();
            let most_px = edges.iter().map(moves).fold(0.0, f64::max);
            if step.iter().all(|v| v.is_finite()) && most_px < MAX_SHIFT_PX {
                candidates.push(here + step);
            }
        }
    }
}

impl CorrespondenceLines {
    /// The shift, in pixels outwards, at which line `k` and its neighbours most likely cross the edge.
    fn strongest_edge_px(&self, k: usize) -> f32 {
        let count = self.line_count();
        let of_line = |k: usize| self.raw_log_ratios((k + count) % count);
        let [before, here, after] = [k + count - 1, k, k + 1].map(of_line);
        let mut strongest = (f32::NEG_INFINITY, 0);
        for i in 0..SHIFTS {
            let sum = before[i] + here[i] + after[i];
            if sum > strongest.0 {
                strongest = (sum, i);
            }
        }
        strongest.1 as f32 / 4.0 - REACH_PX
    }
}
