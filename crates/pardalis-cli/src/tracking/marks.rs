//! What is drawn over a camera's image: trails, particles, outlines, boxes and what was examined.

use std::collections::{BTreeMap, VecDeque};

use anyhow::Result;
use pardalis::shape::Stance;
use pardalis::tracker::{Candidate, Origin, TrackState, Verdict};
use pardalis::view::View;
use pardalis::{CameraId, Estimate, TargetId};
use pardalis_filter::Particles;
use pardalis_filter::estimate::StateEstimate;
use pardalis_scene::{BodyConfig, TargetConfig, TrackingConfig};

use super::series::Key;
use super::{Instant, Tracked};
use crate::draw::PALETTE;
use crate::draw::overlay::{Mark, Note, Shape};

/// Maximum number of particles shown; more would hide the target.
const MAX_DOTS: usize = 300;
/// Number of past positions that are drawn as a trail.
const TRAIL: usize = 50;
/// Points of a drawn contour.
pub(crate) const CONTOUR_POINTS: usize = 72;
/// Length of the arrow along the heading, as a multiple of the distance of the front landmark from the target's
/// position.
const ARROW_LENGTH: f64 = 4.0;

/// The last positions of a target, each with whether it was seen there; `None` where there was no estimate.
type Trail = VecDeque<Option<([f64; 3], bool)>>;

/// Finds what is drawn, one time after another.
pub(super) struct Marker {
    pub(super) targets: Vec<TargetConfig>,
    has_trails: bool,
    has_candidates: bool,
    /// The trail of each target, and of each member of a crowd that is there.
    trails: BTreeMap<Key, Trail>,
}

impl Marker {
    /// Draws these targets, on request also their past positions, and what was examined.
    pub(super) fn new(targets: &[TargetConfig], has_trails: bool, has_candidates: bool) -> Self {
        Self {
            targets: targets.to_vec(),
            has_trails,
            has_candidates,
            trails: BTreeMap::new(),
        }
    }

    /// Prolongs the trails to this time. Call it before what is drawn at this time is asked for.
    pub(super) fn follow(&mut self, instant: &Instant) {
        let is_there = |key: &Key| instant.tracked.iter().any(|one| one.key() == *key);
        self.trails.retain(|key, _| is_there(key));
        for one in instant.tracked {
            let (trail, estimate) = (self.trails.entry(one.key()).or_default(), &one.estimate);
            let shown = estimate.kinematics.filter(|_| self.has_trails);
            let is_seen = estimate.state == TrackState::Tracking;
            trail.push_back(shown.map(|k| (k.position_m, is_seen)));
            if trail.len() > TRAIL {
                trail.pop_front();
            }
        }
    }

    /// Returns the trail of each target, dashed where it was occluded, its particles, the contours of the best particle in
    /// white and those of the mean in black, as in the paper; the black ones wider, so that they show where both agree. Boxes of other programs as well.
    pub(super) fn marks(&self, instant: &Instant, camera: CameraId) -> Result<Vec<Mark>> {
        let view = &instant.tracker.views()[camera.index()];
        let mut marks = Vec::new();
        for (key, trail) in &self.trails {
            push_trail(&mut marks, trail, view, color_of(*key));
        }
        for (number, target) in self.targets.iter().enumerate() {
            let id = TargetId::new(number);
            let now = instant.tracker.bodies_at(id, instant.time_s)?;
            let clouds: Vec<&Particles> = instant.tracker.particles(id)?.collect();
            // All places of a crowd have the same boxes.
            let mut examined = instant.tracker.candidates(id)?;
            if let Some(candidates) = examined.find(|candidates| !candidates.is_empty()) {
                push_boxes(
                    &mut marks,
                    candidates,
                    camera,
                    PALETTE[number % PALETTE.len()],
                );
            }
            for (place, body, member) in instant.bodies(number, target) {
                let now = &now[place];
                let (Some(known), Some(particles)) = (&now.kinematics, clouds.get(place)) else {
                    continue;
                };
                marks.push(cloud(body, particles, view, color_of((number, member))));
                push_outlines(&mut marks, body, (known, stance_of(body, now)), view);
                if let (true, Some(heading_rad)) = (body.turns, now.heading_rad) {
                    let front_m = ahead_m(body, known.position_m, heading_rad);
                    let color = color_of((number, member));
                    marks.push(arrow(shown_m(body, known.position_m), front_m, view, color));
                }
            }
            let tracked = instant.tracked.iter().find(|one| one.target == number);
            if let (Some([front, _]), Some(tracked)) = (target.heading, tracked)
                && let (Some(known), Some(front)) =
                    (&tracked.estimate.kinematics, &now[front].kinematics)
            {
                let color = color_of(tracked.key());
                marks.push(arrow(known.position_m, front.position_m, view, color));
            }
        }
        Ok(marks)
    }

    /// Returns what was examined in a camera's image, or for all cameras, each with what became of it.
    pub(super) fn notes(&self, instant: &Instant, camera: CameraId) -> Result<Vec<Note>> {
        let view = &instant.tracker.views()[camera.index()];
        if !self.has_candidates {
            return Ok(self.numbers(instant, view));
        }
        let mut notes = Vec::new();
        for (number, target) in self.targets.iter().enumerate() {
            let of_bodies = instant.tracker.candidates(TargetId::new(number))?;
            let body = |landmark: usize| target.bodies.get(landmark).unwrap_or(&target.bodies[0]);
            for (landmark, candidates) in of_bodies.enumerate() {
                let body = body(landmark);
                let shown = candidates.iter().filter(|candidate| {
                    let is_here = candidate.origin.camera().is_none_or(|of| of == camera);
                    is_here && candidate.verdict != Verdict::SamePlace
                });
                notes.extend(shown.filter_map(|candidate| {
                    let at_px = match candidate.origin.blob() {
                        Some(blob) => Some(blob.centroid_px),
                        None => pixel_of(view, shown_m(body, candidate.position_m?)),
                    };
                    let note = Note {
                        at_px: at_px?,
                        text: candidate.verdict.name().into(),
                        color: PALETTE[number % PALETTE.len()],
                    };
                    Some((candidate.verdict, note))
                }));
            }
        }
        // Verdicts are in the order of the tests. The target's own label is on top.
        notes.sort_by_key(|(verdict, _)| *verdict);
        Ok(notes.into_iter().map(|(_, note)| note).collect())
    }

    /// Returns the numbers of the members of crowds.
    fn numbers(&self, instant: &Instant, view: &View) -> Vec<Note> {
        let note = |one: &Tracked| {
            let body = &self.targets[one.target].bodies[0];
            let position_m = one.estimate.kinematics.as_ref()?.position_m;
            Some(Note {
                at_px: pixel_of(view, shown_m(body, position_m))?,
                text: one.member?.to_string().into(),
                color: color_of(one.key()),
            })
        };
        instant.tracked.iter().filter_map(note).collect()
    }

    pub(super) fn label(&self, instant: &Instant) -> String {
        let targets = self.targets.iter().enumerate();
        let states = targets.map(|(number, target)| {
            let mut of_target = instant.tracked.iter().filter(|one| one.target == number);
            let name = &target.name;
            if target.crowd.is_some() {
                let known = of_target.filter(|one| one.estimate.kinematics.is_some());
                return format!("{name}: {}", known.count());
            }
            let Some(Tracked { estimate, .. }) = of_target.next() else {
                return name.clone();
            };
            let state = estimate.state.name();
            // Without a position, the confidence would look like that of being lost.
            match estimate.kinematics {
                Some(_) => format!("{name} {state} {:.2}", estimate.confidence),
                None => format!("{name} {state}"),
            }
        });
        format!(
            "frame {}  {:.3} s  {}",
            instant.index,
            instant.time_s,
            states.collect::<Vec<_>>().join("  ")
        )
    }
}

/// Adds the line through a target's past positions: dashed from and to those where it was not seen.
fn push_trail(marks: &mut Vec<Mark>, trail: &Trail, view: &View, color: [u8; 3]) {
    let points: Vec<_> = trail.iter().copied().collect();
    for (shape, wanted) in [(Shape::Line, true), (Shape::Dashes, false)] {
        let mut points_px = Vec::new();
        for pair in points.windows(2) {
            let ends = match pair {
                [Some((from, seen)), Some((to, still_seen))]
                    if (*seen && *still_seen) == wanted =>
                {
                    [pixel_of(view, *from), pixel_of(view, *to)]
                }
                _ => [None; 2],
            };
            if points_px.last() != Some(&ends[0]) {
                points_px.extend([None, ends[0]]);
            }
            points_px.push(ends[1]);
        }
        marks.push(Mark {
            shape,
            points_px,
            color,
        });
    }
}

/// Adds the boxes that another program found in a camera's image.
fn push_boxes(marks: &mut Vec<Mark>, candidates: &[Candidate], camera: CameraId, color: [u8; 3]) {
    for candidate in candidates {
        let Origin::Box(of, blob) = &candidate.origin else {
            continue;
        };
        if *of != camera {
            continue;
        }
        let [u, v] = blob.centroid_px;
        // Those of a box that is filled evenly.
        let [across, down] = [0, 2].map(|axis| (3.0 * blob.covariance_px2[axis]).sqrt());
        let corners = [
            [-1.0, -1.0],
            [1.0, -1.0],
            [1.0, 1.0],
            [-1.0, 1.0],
            [-1.0, -1.0],
        ];
        let corner = |[x, y]: [f64; 2]| Some([u + x * across, v + y * down]);
        marks.push(Mark {
            shape: Shape::Line,
            points_px: corners.map(corner).to_vec(),
            color,
        });
    }
}

/// Adds the contours of the best particle in white and those of the mean in black.
fn push_outlines(
    marks: &mut Vec<Mark>,
    body: &BodyConfig,
    (known, estimated): (&StateEstimate, Stance),
    view: &View,
) {
    // Cues other than the contour cue have no scaled contours: draw the outline itself, as large as it is estimated.
    let stances = body.contour().map_or_else(
        || vec![estimated],
        |contour| {
            let scales = contour.sampling.shown_scales().into_iter();
            scales.map(Stance::scaled).collect()
        },
    );
    for (position_m, shape, color) in [
        (known.position_m, Shape::WideContour, [0; 3]),
        (known.best_position_m, Shape::Contour, [255; 3]),
    ] {
        let position_m = in_rows_m(known, position_m, body, view);
        for &stance in &stances {
            let points_px = body.shape.outline_px(
                view.camera(),
                view.camera_from_world(),
                position_m,
                stance,
                CONTOUR_POINTS,
            );
            marks.push(Mark {
                shape,
                points_px,
                color,
            });
        }
    }
}

/// Returns where the body was when a camera exposed the rows that show it. Initialised targets are fitted as if all rows were exposed at once.
pub(super) fn in_rows_m(
    known: &StateEstimate,
    position_m: [f64; 3],
    body: &BodyConfig,
    view: &View,
) -> [f64; 3] {
    let velocity_mps = known
        .velocity_mps
        .filter(|_| matches!(body.tracking, TrackingConfig::Detected { .. }));
    view.shown_position_m(position_m, velocity_mps.unwrap_or_default())
}

/// Returns some of a body's particles, each at the pixel of its drawn position.
fn cloud(body: &BodyConfig, particles: &Particles, view: &View, color: [u8; 3]) -> Mark {
    let step = particles.count().div_ceil(MAX_DOTS);
    let points_px = (0..particles.count())
        .step_by(step)
        .map(|particle| pixel_of(view, shown_m(body, particles.position_m(particle))))
        .collect();
    Mark {
        shape: Shape::Dots,
        points_px,
        color,
    }
}

/// Returns the estimated stance of a body. Its yaw is its heading: which side is the front does not change the outline.
pub(super) fn stance_of(body: &BodyConfig, now: &Estimate) -> Stance {
    let scale = now.radius.map_or(1.0, |radius| {
        2.0 * radius.radius_m / body.shape.diameter_m()
    });
    Stance {
        scale,
        yaw_rad: now.heading_rad.unwrap_or(0.0),
    }
}

/// Returns the drawn position of the point at the end of a body to which it faces.
fn ahead_m(body: &BodyConfig, position_m: [f64; 3], heading_rad: f64) -> [f64; 3] {
    let [x, y, z] = shown_m(body, position_m);
    let (sin, cos) = libm::sincos(heading_rad);
    let reach_m = 0.5 * body.shape.diameter_m();
    [x + reach_m * cos, y + reach_m * sin, z]
}

/// Returns the drawn position of a body at this position: the middle of a flat shape, which lies above its position;
/// otherwise the position itself.
pub(super) fn shown_m(body: &BodyConfig, [x, y, z]: [f64; 3]) -> [f64; 3] {
    match body.shape {
        pardalis::shape::Shape::Flat(flat) => [x, y, z + flat.height_m],
        _ => [x, y, z],
    }
}

/// Returns an arrow on the ground from a target's position towards its front.
fn arrow([x, y, z]: [f64; 3], front_m: [f64; 3], view: &View, color: [u8; 3]) -> Mark {
    let (ahead, left) = (
        [front_m[0] - x, front_m[1] - y],
        [y - front_m[1], front_m[0] - x],
    );
    let at = |along: f64, across: f64| {
        let [dx, dy] = [0, 1].map(|axis| along * ahead[axis] + across * left[axis]);
        pixel_of(view, [x + dx, y + dy, z])
    };
    let (tip, barb) = (ARROW_LENGTH, 0.8 * ARROW_LENGTH);
    Mark {
        shape: Shape::Line,
        points_px: vec![
            at(0.0, 0.0),
            at(tip, 0.0),
            at(barb, 0.4),
            at(tip, 0.0),
            at(barb, -0.4),
        ],
        color,
    }
}

/// The colour of a target, or of a member of a crowd.
pub(super) fn color_of((target, member): Key) -> [u8; 3] {
    let number = target + member.map_or(0, |number| number as usize - 1);
    PALETTE[number % PALETTE.len()]
}

pub(super) fn pixel_of(view: &View, position_m: [f64; 3]) -> Option<[f64; 2]> {
    let point = view.camera_from_world() * nalgebra::Point3::from(position_m);
    view.camera().project(point.into())
}
