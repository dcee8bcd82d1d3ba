//! The edge cue: where in the image the outline lies, to a fraction of a pixel.
//!
//! Around the outline of a hypothesis each pixel has a membership: 0 where its colour is that of what surrounds the body there, 1 where it is the body's own
//! ([`Surroundings`](crate::color::Surroundings)). How memberships go over from inside to outside is learnt ([`EdgeProfile`]): optics, chroma at half the
//! resolution and compression are in it. Lines across the outline (as in region-based tracking: Bibby and Reid 2008, Tjaden et al. 2018, Stoiber et al. 2022) say how likely each shift of it
//! is; hypotheses nearby are weighed by these alone.

mod fit;
mod lines;
#[cfg(test)]
mod tests;

pub(crate) use fit::Sighting;
use fit::Sums;

use super::outline::{Coordinates, OutlineKernel, Points, Projector};
use crate::color::{
    ColorModel, ColorRanges, EdgeLogRatios, EdgeProfile, IlluminationCorrection, MatchTable,
    Palette, PixelKind, Side,
};
use crate::detect::LEAST_LIKENESS;
use crate::shape::Shape;
use crate::view::Evidence;
use lines::{Lines, REACH_PX, SECTORS, SHIFTS, Scratch};
use pardalis_camera::{LANES, Mask};
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// Parameters of the edge cue.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::struct_excessive_bools)] // parts that are switched off one by one, not states
pub struct EdgeSettings {
    /// Lines across the outline.
    pub correspondence_lines: usize,
    /// What a pixel's log-likelihood counts: below 1, as neighbouring pixels say the same (chroma at half the resolution, compression).
    pub likelihood_exponent: f64,
    /// The standard deviation, in pixels, of what is wrong with a whole outline at once and does not average out over its pixels: shading, highlights, shadows.
    pub shared_sigma_px: f64,
    /// Whether edges look as they do where the colours were learnt; else as a soft step does.
    pub learned_profile: bool,
    /// Whether edges on the shaded side look as such do, and on the lit side; else alike all around.
    pub lit_and_shaded_profiles: bool,
    /// Whether sectors into which something else came say nothing; else they do as any.
    pub background_model: bool,
    /// Whether the mean colour within an outline tells whether it is the target's; else single pixels alone.
    pub color_evidence: bool,
    /// Whether colours are looked up as if in the light in which they were learnt, by what light the target was seen in; else as they are.
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
    /// Refuses what makes no lines.
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

/// A profile as lines sum it: of each bin of membership the log ratios over distance, on either side.
#[derive(Debug)]
struct Table {
    rows: [Vec<[f32; EdgeProfile::DISTANCES]>; 2],
}

impl Table {
    fn new(by_distance: &[Box<EdgeLogRatios>; 2]) -> Self {
        let rows = by_distance.each_ref().map(|by_distance| {
            let row = |bin: usize| std::array::from_fn(|distance| by_distance[distance][bin]);
            (0..EdgeProfile::MEMBERSHIPS).map(row).collect()
        });
        Self { rows }
    }

    /// Adds a pixel's log ratios for all shifts of the outline. Shifts are as far apart as the profile's distances.
    #[inline(always)]
    fn add(
        &self,
        (side, membership): (Side, f32),
        distance_px: f32,
        weight: f32,
        log_ratios: &mut [f32; SHIFTS],
    ) {
        let row = &self.rows[side as usize][EdgeProfile::bin_of(membership)];
        let last = (row.len() - 1) as f32;
        for (i, log_ratio) in log_ratios.iter_mut().enumerate() {
            let step = (4.0 * (distance_px + REACH_PX + EdgeProfile::REACH_PX) - i as f32)
                .clamp(0.0, last - 1e-3);
            let j = step as usize;
            *log_ratio += weight * (row[j] + (step - j as f32) * (row[j + 1] - row[j]));
        }
    }
}

/// One camera's frame, to be looked at.
pub(crate) struct Look<'a> {
    camera: usize,
    evidence: Evidence<'a>,
    projector: Projector<'a>,
    kind: PixelKind,
    palette: Palette,
    /// Pixels outside of these are not the target's.
    in_ranges: Option<&'a MatchTable>,
    /// How much likelier a pixel of each bin is the target's than the frame's, t / (t + f).
    likeness: &'a [f64],
    /// To the light in which the colours were learnt.
    relight: IlluminationCorrection,
    /// What surrounded the target when this camera saw it last, sector by sector.
    known_around: Option<&'a Around>,
    /// The outlines of others of its colours: an edge between it and them cannot be seen.
    others: Vec<Vec<[f32; 2]>>,
}

/// Mean Y, U and V around a body, sector by sector.
pub(crate) type Around = [[f32; 3]; SECTORS];

impl<'a> Look<'a> {
    pub(crate) fn new(
        camera: usize,
        evidence: Evidence<'a>,
        (palette, ranges): (Palette, Option<ColorRanges>),
        (likeness, relight): (&'a [f64], IlluminationCorrection),
        known_around: Option<&'a Around>,
    ) -> Self {
        Self {
            camera,
            evidence,
            projector: Projector::new(evidence.view()),
            kind: PixelKind::of(evidence.frame()),
            palette,
            in_ranges: ranges.map(|ranges| evidence.match_table(ranges)),
            likeness,
            relight,
            known_around,
            others: Vec::new(),
        }
    }

    /// Whether a place in the image lies within the outline of another of the target's colours.
    fn is_anothers(&self, [u, v]: [f32; 2]) -> bool {
        let is_within = |outline: &Vec<[f32; 2]>| {
            let next = outline.iter().cycle().skip(1);
            let crossed = outline.iter().zip(next).filter(|([u0, v0], [u1, v1])| {
                (*v0 > v) != (*v1 > v) && u < u0 + (v - v0) / (v1 - v0) * (u1 - u0)
            });
            crossed.count() % 2 == 1
        };
        self.others.iter().any(is_within)
    }

    pub(crate) fn camera(&self) -> usize {
        self.camera
    }

    pub(crate) fn evidence(&self) -> &Evidence<'a> {
        &self.evidence
    }

    pub(crate) fn likeness(&self) -> &'a [f64] {
        self.likeness
    }

    pub(crate) fn relight(&self) -> &IlluminationCorrection {
        &self.relight
    }

    fn size(&self) -> (usize, usize) {
        self.evidence.view().size()
    }

    /// Whether a place in the image is a pixel, unmasked.
    fn holds(&self, place: [f32; 2]) -> bool {
        let (width, height) = self.size();
        let [x, y] = place.map(|v| (v + 0.5).floor());
        let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        inside && self.is_open(x as usize, y as usize)
    }

    fn is_open(&self, column: usize, row: usize) -> bool {
        let view = self.evidence.view();
        let mask = view.mask().map(Mask::open);
        mask.is_none_or(|open| open[row * view.size().0 + column])
    }

    /// The colour of a pixel of the image, and whether that is the body's; `None` where it is masked.
    fn pixel(&self, column: usize, row: usize) -> Option<([f32; 3], bool)> {
        if !self.is_open(column, row) {
            return None;
        }
        let bytes = self.evidence.frame().components(column, row);
        let relit = self.relight.bytes(bytes);
        let bin = self.evidence.table(self.palette).bin(relit);
        let is_alike = self.likeness[usize::from(bin)] >= LEAST_LIKENESS
            && self.in_ranges.is_none_or(|table| table.matches(relit) == 1);
        Some((self.kind.full_range_yuv(bytes), is_alike))
    }

    /// Whether a place in the world lies in the image, unmasked.
    fn shows(&self, level: Level, positions: &[[f32; LANES]; 3]) -> [bool; LANES] {
        let [u, v] = self.projector.project(level, positions);
        std::array::from_fn(|lane| self.holds([u[lane], v[lane]]))
    }
}

/// The edge cue of one target.
#[derive(Debug)]
pub(crate) struct EdgeCue {
    settings: EdgeSettings,
    outline: OutlineKernel,
    /// How high the middle of the shape lies above its position, in metres.
    middle_height_m: f32,
    diameter_m: f64,
    table: Table,
    palette: Palette,
    ranges: Option<ColorRanges>,
    points: Vec<Points>,
    coordinates: Vec<Coordinates>,
    scratch: Scratch,
    level: Level,
}

impl EdgeCue {
    pub(crate) fn new(
        settings: EdgeSettings,
        shape: Shape,
        colors: &ColorModel,
        level: Level,
    ) -> Result<Self, Error> {
        settings.check()?;
        let profile = colors.edge().filter(|_| settings.learned_profile);
        let profile = profile.map(|profile| {
            if settings.lit_and_shaded_profiles {
                profile.log_ratios()
            } else {
                profile.without_sides().log_ratios()
            }
        });
        Ok(Self {
            settings,
            outline: OutlineKernel::new(shape, settings.correspondence_lines),
            middle_height_m: shape.middle_height_m() as f32,
            diameter_m: shape.diameter_m(),
            table: Table::new(&profile.unwrap_or_else(EdgeProfile::soft_step)),
            palette: colors.palette(),
            ranges: colors.ranges().map(|ranges| ranges.widened()),
            points: vec![[[0.0; LANES]; 3]; settings.correspondence_lines],
            coordinates: vec![[[0.0; LANES]; 2]; settings.correspondence_lines],
            scratch: Scratch::default(),
            level,
        })
    }

    pub(crate) fn settings(&self) -> &EdgeSettings {
        &self.settings
    }

    pub(crate) fn palette(&self) -> Palette {
        self.palette
    }

    /// The ranges that hold the target's colours in any light; none for what has no colour.
    pub(crate) fn ranges(&self) -> Option<ColorRanges> {
        self.ranges
    }

    /// Projects the outlines of a block of positions.
    fn project(&mut self, look: &Look, positions: &[[f32; LANES]; 3]) {
        self.outline.project(
            self.level,
            &look.projector,
            positions,
            1.0,
            &mut self.points,
            &mut self.coordinates,
        );
    }

    /// Whether the middle of the body at a position lies in the image, unmasked.
    pub(crate) fn shows(&self, look: &Look, position_m: [f64; 3]) -> bool {
        let mut place = position_m.map(|v| [v as f32; LANES]);
        place[2] = place[2].map(|z| z + self.middle_height_m);
        look.shows(self.level, &place)[0]
    }

    /// The outline of a position, as far as it has pixels.
    fn outline_px(
        &mut self,
        look: &Look,
        position_m: [f64; 3],
    ) -> impl Iterator<Item = [f32; 2]> + Clone {
        self.project(look, &position_m.map(|v| [v as f32; LANES]));
        let points = self.coordinates.iter().map(|[u, v]| [u[0], v[0]]);
        points.filter(|point| point.iter().all(|v| v.is_finite()))
    }

    /// Tells a look of a body that looks as the target does.
    pub(crate) fn show_another(&mut self, look: &mut Look, position_m: [f64; 3]) {
        let outline = self.outline_px(look, position_m).collect();
        look.others.push(outline);
    }

    /// The area within the outline of a position, as far as it has pixels, in square pixels.
    pub(crate) fn area_px(&mut self, look: &Look, position_m: [f64; 3]) -> f64 {
        let points = self.outline_px(look, position_m);
        let points = points.map(|point| point.map(f64::from));
        let next = points.clone().cycle().skip(1);
        let twice: f64 = points
            .zip(next)
            .map(|([u0, v0], [u1, v1])| u0 * v1 - u1 * v0)
            .sum();
        0.5 * twice.abs()
    }

    /// Adds to each position, of one camera, ln of the likelihood ratio of the best of the sightings there; nothing where the camera does not show it, and
    /// `missed` at the least where it does.
    pub(crate) fn add_camera(
        &mut self,
        look: &Look,
        sightings: &[Sighting],
        [x, y, z]: [&[f32]; 3],
        missed: f32,
        out: &mut [f32],
    ) {
        let lines: Vec<(&Lines, f32)> = sightings
            .iter()
            .flat_map(|sighting| {
                let lines = sighting.lines_of(look.camera);
                lines.map(|lines| (lines, sighting.offset))
            })
            .collect();
        for start in (0..out.len()).step_by(LANES) {
            let lanes = LANES.min(out.len() - start);
            let mut positions = [[0_f32; LANES]; 3];
            for (position, column) in positions.iter_mut().zip([x, y, z]) {
                position[..lanes].copy_from_slice(&column[start..start + lanes]);
            }
            let mut best = [missed; LANES];
            if !lines.is_empty() {
                self.project(look, &positions);
                for (lines, offset) in &lines {
                    let sums = Sums::of(lines, &self.coordinates);
                    for (lane, best) in best.iter_mut().enumerate().take(lanes) {
                        let log_ratio = lines.log_ratio(&sums.lane(lane)) + offset;
                        if log_ratio > *best {
                            *best = log_ratio;
                        }
                    }
                }
            }
            positions[2] = positions[2].map(|z| z + self.middle_height_m);
            let shown = look.shows(self.level, &positions);
            for lane in 0..lanes {
                out[start + lane] = if shown[lane] { best[lane] } else { 0.0 };
            }
        }
    }
}
