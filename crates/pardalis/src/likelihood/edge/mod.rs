//! The edge cue: locates an outline in an image to a fraction of a pixel.
//!
//! Around the outline of a hypothesis each pixel has a membership: 0 if its colour is that of what surrounds the body there, 1 if it is the body's own
//! ([`Surroundings`](crate::color::Surroundings)). How memberships change across an edge is learnt ([`EdgeProfile`]): it contains optics, chroma at half the
//! resolution and compression. Correspondence lines across the outline (as in region-based tracking: Bibby and Reid 2008, Tjaden et al. 2018, Stoiber et al. 2022) give the
//! likelihood of each shift of the outline; hypotheses nearby are weighted by these alone.

mod corners;
mod detection;
mod fit;
mod form;
mod frame;
mod lines;
mod offset;
#[cfg(test)]
mod offset_tests;
mod offsets;
mod patch;
mod rectangles;
mod size;
mod streak;
#[cfg(test)]
mod streak_tests;
mod table;
#[cfg(test)]
mod tests;
mod widening;
mod yaw;

pub(crate) use detection::{Detection, Detections};
pub(crate) use fit::{FitStart, PositionPrior};
pub(crate) use form::FormEvidence;
pub(crate) use frame::{EdgeFrame, EdgeFrameContext, Outlines, Surrounding};

use super::outline::{Coordinates, OutlineKernel, Points, Projector};
use crate::color::{ColorModel, ColorRanges, EdgeProfile, JUDGED_RADIUS_PX, Palette};
use crate::shape::{Shape, Stance};
use crate::tuning::EdgeTuning;
use crate::view::View;
use frame::{Octave, SECTORS};
use lines::LineBuffers;
pub(crate) use lines::NoFit;
pub(crate) use offset::MeasuredOffset;
use pardalis_camera::LANES;
use pardalis_core::Error;
use pardalis_core::simd::Level;
use patch::Patch;
use rectangles::Rectangles;
pub(crate) use size::SizePrior;
use table::Table;
pub(crate) use widening::Widening;
pub(crate) use yaw::YawPrior;

/// Parameters of the edge cue.
///
/// ```
/// use pardalis::likelihood::EdgeSettings;
///
/// let mut settings = EdgeSettings::default();
/// settings.correspondence_lines = 100;
/// assert!(settings.check().is_ok());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // parts that are switched off one by one, not states
#[non_exhaustive]
pub struct EdgeSettings {
    /// The number of correspondence lines across the outline, 16 to 1000.
    pub correspondence_lines: usize,
    /// The exponent of each pixel's likelihood, above 0 and at most 1: below 1, because neighbouring pixels are not independent (chroma at half the resolution, compression).
    pub likelihood_exponent: f64,
    /// The standard deviation, in pixels, of errors that a whole outline shares and that do not average out over its pixels: shading, highlights, shadows.
    pub shared_sigma_px: f64,
    /// Whether the edge profile of the colour model is used; a soft step otherwise.
    pub learned_profile: bool,
    /// Whether the shaded and the lit side of a body have profiles of their own; one for both otherwise.
    pub lit_and_shaded_profiles: bool,
    /// Whether sectors into which something else has come are ignored.
    pub background_model: bool,
    /// Whether the mean colour within an outline counts for data association, beside single pixels.
    pub color_evidence: bool,
    /// Whether colours are corrected to the illumination in which they were learnt, which is estimated from the target.
    pub illumination_adaptation: bool,
}

impl Default for EdgeSettings {
    fn default() -> Self {
        Self {
            correspondence_lines: 64,
            likelihood_exponent: 0.3,
            shared_sigma_px: 0.15,
            learned_profile: true,
            lit_and_shaded_profiles: true,
            background_model: true,
            color_evidence: true,
            illumination_adaptation: true,
        }
    }
}

impl EdgeSettings {
    /// Returns an error for settings out of range.
    pub fn check(&self) -> Result<(), Error> {
        if !(SECTORS..=1000).contains(&self.correspondence_lines) {
            return Err(Error::out_of_range(
                "correspondence_lines",
                self.correspondence_lines,
                "16 to 1000",
            ));
        }
        if !(self.likelihood_exponent > 0.0 && self.likelihood_exponent <= 1.0) {
            return Err(Error::out_of_range(
                "likelihood_exponent",
                self.likelihood_exponent,
                "above 0 and at most 1",
            ));
        }
        if !(0.0..=10.0).contains(&self.shared_sigma_px) {
            return Err(Error::out_of_range(
                "shared_sigma_px",
                self.shared_sigma_px,
                "0 to 10",
            ));
        }
        Ok(())
    }
}

/// The area in square pixels within a closed polygon.
fn area_px(points: impl Iterator<Item = [f32; 2]> + Clone) -> f64 {
    let points = points.map(|point| point.map(f64::from));
    let next = points.clone().cycle().skip(1);
    let twice: f64 = points
        .zip(next)
        .map(|([u0, v0], [u1, v1])| u0 * v1 - u1 * v0)
        .sum();
    0.5 * twice.abs()
}

/// The edge cue of one target.
#[derive(Debug)]
pub(crate) struct EdgeCue {
    settings: EdgeSettings,
    tuning: EdgeTuning,
    outline: OutlineKernel,
    /// The height of the middle of the shape above its position, metres.
    middle_height_m: f32,
    diameter_m: f64,
    /// Whether sizes of the shape can be compared: those of balls.
    is_ball: bool,
    /// Whether the yaw of the shape is fitted.
    turns: bool,
    /// What else an outline may be: that of a ball.
    rectangles: Option<Rectangles>,
    /// One per octave; those coarser than the learnt profiles have the last one's.
    tables: Vec<Table>,
    palette: Palette,
    ranges: Option<ColorRanges>,
    points: Vec<Points>,
    coordinates: Vec<Coordinates>,
    /// Where the points of an outline are as it turns either way.
    turned: Vec<Coordinates>,
    /// How far each moves in the image then, pixels per radian.
    of_yaw: Vec<[f32; 2]>,
    buffers: LineBuffers,
    /// The colours around the outline that is being fitted, one per camera.
    patches: Vec<Patch>,
    level: Level,
}

impl EdgeCue {
    /// The edge cue of a target in the images of this many cameras.
    pub(crate) fn new(
        (settings, tuning): (EdgeSettings, EdgeTuning),
        (shape, turns): (Shape, bool),
        colors: &ColorModel,
        (cameras, level): (usize, Level),
    ) -> Result<Self, Error> {
        settings.check()?;
        let profiles = if settings.learned_profile {
            colors.edges()
        } else {
            &[]
        };
        let table = |octave: u8| {
            let profile = profiles.get(usize::from(octave)).or(profiles.last());
            let log_ratios = profile.map(|profile| {
                if settings.lit_and_shaded_profiles {
                    profile.log_ratios()
                } else {
                    profile.without_sides().log_ratios()
                }
            });
            let log_ratios =
                log_ratios.unwrap_or_else(|| EdgeProfile::soft_step(Octave(octave).scale().into()));
            Table::new(&log_ratios, Octave(octave), &tuning, level)
        };
        let tables = (0..=Octave::COARSEST.0).map(table).collect();
        let is_ball = matches!(shape, Shape::Sphere(_));
        Ok(Self {
            settings,
            tuning,
            outline: OutlineKernel::new(shape, settings.correspondence_lines),
            middle_height_m: shape.middle_height_m() as f32,
            diameter_m: shape.diameter_m(),
            is_ball,
            turns: turns && shape.turn_period_rad().is_some(),
            rectangles: is_ball.then(|| Rectangles::new(settings.correspondence_lines)),
            tables,
            palette: colors.palette(),
            ranges: colors.ranges().map(|ranges| ranges.widened()),
            points: vec![[[0.0; LANES]; 3]; settings.correspondence_lines],
            coordinates: vec![[[0.0; LANES]; 2]; settings.correspondence_lines],
            turned: vec![[[0.0; LANES]; 2]; settings.correspondence_lines],
            of_yaw: vec![[0.0; 2]; settings.correspondence_lines],
            buffers: LineBuffers::new(),
            patches: (0..cameras).map(|_| Patch::with_room()).collect(),
            level,
        })
    }

    pub(crate) fn settings(&self) -> &EdgeSettings {
        &self.settings
    }

    pub(crate) fn palette(&self) -> Palette {
        self.palette
    }

    /// The ranges that hold the target's colours in any illumination; `None` for targets without colour.
    pub(crate) fn ranges(&self) -> Option<ColorRanges> {
        self.ranges
    }

    /// Projects the outlines of a block of positions, of the shape in this stance.
    fn project(&mut self, projector: &Projector, positions: &[[f32; LANES]; 3], stance: Stance) {
        self.outline.project(
            self.level,
            projector,
            positions,
            stance,
            &mut self.points,
            &mut self.coordinates,
        );
    }

    /// Returns whether the middle of the body at a position lies in the image, unmasked.
    pub(crate) fn is_in_view(&self, frame: &EdgeFrame, position_m: [f64; 3]) -> bool {
        let mut position = position_m.map(|v| [v as f32; LANES]);
        position[2] = position[2].map(|z| z + self.middle_height_m);
        frame.holds_block(self.level, &position)[0]
    }

    /// Projects the outline of a position, of the shape in this stance, and returns its points that have a pixel.
    fn outline_px(
        &mut self,
        projector: &Projector,
        position_m: [f64; 3],
        stance: Stance,
    ) -> impl Iterator<Item = [f32; 2]> + Clone {
        self.project(projector, &position_m.map(|v| [v as f32; LANES]), stance);
        let points = self.coordinates.iter().map(|[u, v]| [u[0], v[0]]);
        points.filter(|point| point.iter().all(|v| v.is_finite()))
    }

    /// Adds the outline that this camera has of a look-alike at a position, with a velocity and in a stance, given whether it has been found in this image.
    pub(crate) fn add_look_alike(
        &mut self,
        view: &View,
        (position_m, velocity_mps, stance): ([f64; 3], [f64; 3], Stance),
        is_found: bool,
        outlines: &mut Outlines,
    ) {
        let motion = view.row_motion(position_m, velocity_mps);
        let projector = Projector::moving(view, motion.as_ref());
        outlines.push(self.outline_px(&projector, position_m, stance), is_found);
    }

    /// The octave in which the latest projected outline, its first lane, is small enough to be judged as a whole.
    fn octave(&self) -> Octave {
        let points = self.coordinates.iter().map(|[u, v]| [u[0], v[0]]);
        let points = points.filter(|point| point.iter().all(|v| v.is_finite()));
        let next = points.clone().cycle().skip(1);
        let (mut twice_area, mut length) = (0.0_f32, 0.0_f32);
        for ([u0, v0], [u1, v1]) in points.zip(next) {
            twice_area += u0 * v1 - u1 * v0;
            length += libm::hypotf(u1 - u0, v1 - v0);
        }
        // Half the width of a long outline, the radius of a round one.
        let radius_px = twice_area.abs() / length.max(1e-6);
        let mut octave = Octave::default();
        while octave < Octave::COARSEST && octave.scale() * radius_px > JUDGED_RADIUS_PX as f32 {
            octave.0 += 1;
        }
        octave
    }

    /// Returns the area in square pixels within the outline of a position, of the shape at this scale, as far as it has pixels.
    pub(crate) fn area_px(&mut self, frame: &EdgeFrame, position_m: [f64; 3], scale: f64) -> f64 {
        let stance = Stance::scaled(scale);
        area_px(self.outline_px(frame.projector(), position_m, stance))
    }

    /// Returns the middle of a detection's outline in a frame, in pixels, and the area within it; `None` if it has no pixel.
    pub(crate) fn disc_px(
        &mut self,
        frame: &EdgeFrame,
        detection: &Detection,
    ) -> Option<([f64; 2], f64)> {
        let stance = detection.stance();
        let points = self.outline_px(frame.projector(), detection.position_m(), stance);
        let [count, u, v] = points.clone().fold([0.0; 3], |[count, u, v], point| {
            [
                count + 1.0,
                u + f64::from(point[0]),
                v + f64::from(point[1]),
            ]
        });
        (count > 0.0).then(|| ([u / count, v / count], area_px(points)))
    }

    /// Writes the log-likelihood ratio of one camera's frame at each position (world frame, metres): the largest over the detections, each with what is added to it,
    /// widened, with its offset and balanced among the cameras; at least `missed` where the camera has the position in view, and 0 where it does not. In a single camera no position is
    /// likelier than the detection itself: poor fits of small outlines may miss the likeliest one, which their weight does not count on.
    pub(crate) fn log_likelihood_ratios<'d>(
        &mut self,
        frame: &EdgeFrame,
        detections: impl Iterator<Item = (&'d Detection, f32, Option<&'d Widening>)> + Clone,
        [x, y, z]: [&[f32]; 3],
        missed: f32,
        out: &mut [f32],
    ) {
        let lines = detections.flat_map(|(detection, log_ratio, widening)| {
            let lines = detection.lines_of(frame.camera());
            lines.map(move |lines| {
                let log_ratio = log_ratio + detection.balance(lines);
                let most = detection.most(lines);
                (lines, (detection, widening), (log_ratio, most))
            })
        });
        let has_error = frame.context().offset_sigma_px > 0.0;
        let has_lines = lines.clone().next().is_some();
        for start in (0..out.len()).step_by(LANES) {
            let lanes = LANES.min(out.len() - start);
            let mut positions = [[0_f32; LANES]; 3];
            for (position, column) in positions.iter_mut().zip([x, y, z]) {
                position[..lanes].copy_from_slice(&column[start..start + lanes]);
            }
            let mut best = [missed; LANES];
            if has_lines {
                let mut projected = None;
                for (lines, (detection, widening), (added, most)) in lines.clone() {
                    let stance = detection.stance();
                    if projected.replace((stance, widening)) != Some((stance, widening)) {
                        let moved = widening.map(|widening| widening.moved(&positions));
                        let places = moved.as_ref().unwrap_or(&positions);
                        self.project(frame.projector(), places, stance);
                    }
                    let mut penalties = [0.0; LANES];
                    let mut offsets = None;
                    if has_error {
                        let middles = offset::middles(&self.coordinates);
                        let of_block = detection.offset(lines.camera).of_block(&middles);
                        (offsets, penalties) = (Some(of_block.0), of_block.1);
                    }
                    let of_lines = lines.log_likelihood_ratios(
                        self.level,
                        &self.coordinates,
                        offsets.as_ref(),
                    );
                    for (lane, best) in best.iter_mut().enumerate().take(lanes) {
                        let log_ratio = of_lines[lane].min(most) + added - penalties[lane];
                        if log_ratio > *best {
                            *best = log_ratio;
                        }
                    }
                }
            }
            positions[2] = positions[2].map(|z| z + self.middle_height_m);
            let in_view = frame.holds_block(self.level, &positions);
            for lane in 0..lanes {
                out[start + lane] = if in_view[lane] { best[lane] } else { 0.0 };
            }
        }
    }
}
