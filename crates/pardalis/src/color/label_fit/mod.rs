//! Fits the outline of a round body in an image to a rough label: the ellipse near the label with the strongest transition, all
//! around, between the colours within the label and those around it.
//!
//! Colours and outline are found by turns: colours say which pixels are likely the body's, these pixels where its outline is,
//! and the outline which pixels show its colours. Then the outline is refined to a fraction of a pixel by the steps of
//! brightness and colour along it (`steps`).

mod pixels;
mod steps;

use super::ellipse::{Change, Ellipse};
use super::outline_distance::{OutlineDistance, Part};
pub(super) use pixels::LabelledImage;
use pixels::{Plane, Window};

/// Sectors of the turn around an outline, in each of which it is seen or not.
pub(super) const SECTORS: usize = 32;
/// The minimum step in a sector, from outside to inside, of the probability that a pixel is the body's. Hand-set.
const MIN_STEP: f64 = 0.25;
/// The minimum share of the sectors in which an outline must be seen. Hand-set: fingers hide up to half of it.
pub(super) const MIN_SEEN: f64 = 0.5;
/// The minimum share of the sectors in which an outline must be seen for the edge to be learnt from it. Hand-set.
const WHOLE: f64 = 0.9;
/// By how much of the step, on average, the drawn outline may be better than the fit: labels of other shapes are better than any
/// ellipse. Hand-set.
const MAX_LOSS: f64 = 0.05;
/// Outlines are searched in the octave in which they are no wider than this, half their width in pixels. Hand-set: textures of a
/// body are blurred there.
const SEARCH_RADIUS_PX: f64 = 16.0;
/// The coarsest octave.
const COARSEST: usize = 4;
/// How often colours and outline are found by turns. Hand-set.
const ROUNDS: usize = 3;
/// The centres that are tried first, in radii along each axis from that of the label, and the sizes as multiples of the label's.
const SHIFTS: [f64; 9] = [-0.6, -0.45, -0.3, -0.15, 0.0, 0.15, 0.3, 0.45, 0.6];
const SIZES: [f64; 9] = [0.55, 0.65, 0.75, 0.85, 1.0, 1.15, 1.3, 1.45, 1.6];
/// What a shift by the label's radius, or a size of e times the label's, costs, in steps. Hand-set: of equally good outlines the
/// nearest to the label is likely the one that was meant.
const FAR: f64 = 0.1;
/// Fits whose centre is farther from the label's than this, in radii of the label, or whose size is not within this range, as a
/// multiple of the label's, are other things. Derivation: the search, and a little more.
const MAX_SHIFT: f64 = 0.8;
const SIZE_RANGE: [f64; 2] = [0.5, 1.75];
/// The least ratio of the axes. Hand-set: a ball has 0.4 near the rim of a mirror.
const MIN_AXES_RATIO: f64 = 0.3;
/// A label along the outline that is nowhere farther from the fit than this, in pixels, is learnt as it is ... Hand-set: the edge of a
/// shaded body, and of its shadow, is not more exactly where the image shows it; masks of rendered balls are exact to 0.1 px.
const CAREFUL_PX: f64 = 0.25;
/// ... and so is one whose own step is less by at most this much. Hand-set: circles drawn with care on real clips are.
const MIN_GAIN: f64 = 0.04;
/// In smaller bodies, half their width in pixels, steps do not tell such outlines apart. Derivation: a tenth of it is less than
/// the narrowest band.
const MIN_GAIN_RADIUS_PX: f64 = 10.0;
/// The bands on both sides of an outline in which colours are compared: their width as a share of the radius, and its limits
/// in pixels. Hand-set.
const BAND: f64 = 0.2;
const BAND_PX: [f64; 2] = [1.5, 8.0];
/// The steps of the search, as shares of the radius. Hand-set: the last is finer than a third of a pixel.
const SEARCH_STEPS: [f64; 4] = [0.1, 0.05, 0.025, 0.0125];
/// By how much an ellipse of another form than the label's must be better, in steps: things in front of a body and its shadow change
/// the apparent form. Hand-set.
const OTHER_FORM: f64 = 0.06;
/// A label whose own step is less by at most this much is as good a start for the refinement. Hand-set.
const AS_GOOD: f64 = 0.05;

/// What a label is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// It follows the outline, more or less.
    Outline,
    /// A box, around the body or within it.
    Box,
}

/// What the image shows at a label.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Fit {
    /// The label follows an outline as well as can be told.
    Label,
    /// An outline that the label does not follow.
    Outline(FittedOutline),
}

/// A fitted outline.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FittedOutline {
    pub(super) outline: Ellipse,
    /// Whether it is seen in each sector: the surroundings differ from the body there.
    pub(super) is_seen: [bool; SECTORS],
}

/// Says what the image shows at a label; `None` if neither a fit near it nor, of labels along the outline, the label itself is seen
/// around a sufficient share of the turn.
pub(super) fn fit(image: &LabelledImage, part: &Part, kind: Kind) -> Option<Fit> {
    if image.is_exact {
        return (kind == Kind::Outline).then_some(Fit::Label);
    }
    let label = ellipse_of(part, kind);
    let window = Window::around(image, part, &label);
    fit_nearby(image, part, kind, &window).or_else(|| {
        let probability = window.probability(&label)?;
        let of_label = OutlineDistance::of(part, image.drawn, image.size());
        let is_seen = seen(&steps_along(&of_label, &label, &probability));
        (kind == Kind::Outline && share(&is_seen) >= MIN_SEEN).then_some(Fit::Label)
    })
}

/// Fits an outline to a label; `None` if there is none near it that is seen around a sufficient share of the turn and at least as
/// clearly as the label's own.
fn fit_nearby(image: &LabelledImage, part: &Part, kind: Kind, window: &Window) -> Option<Fit> {
    let label = ellipse_of(part, kind);
    let octave = octave_of(&label);
    let probability = window.probability(&label)?.reduced(octave);
    let nearby = search(&probability, &label.in_octave(octave));
    let mut outline = by_turns(window, &nearby.enlarged_from(octave), octave)?;
    let is_near = |found: &Ellipse| {
        let size = found.radius_px() / label.radius_px();
        let [u, v] = [0, 1].map(|i| found.center_px()[i] - label.center_px()[i]);
        u.hypot(v) <= MAX_SHIFT * label.radius_px()
            && (SIZE_RANGE[0]..=SIZE_RANGE[1]).contains(&size)
            && image.holds(found)
    };
    if !is_near(&outline) {
        return None;
    }
    let along_outline = (kind == Kind::Outline).then_some(&label);
    if let Some(label) = along_outline {
        let probability = window.probability(&outline)?.reduced(octave);
        let [found, drawn] =
            [&outline, label].map(|tried| mean_step(&probability, &tried.in_octave(octave)));
        if drawn >= found - AS_GOOD {
            outline = *label;
        }
    }
    for octave in (0..=octave_of(&outline) + usize::from(outline.radius_px() > 12.0)).rev() {
        let colors = window.colors().reduced(octave);
        let label = along_outline.map(|label| label.in_octave(octave));
        let refined = steps::refined(&colors, &outline.in_octave(octave), label.as_ref(), octave);
        outline = refined.enlarged_from(octave);
    }
    if !is_near(&outline) {
        return None;
    }
    let probability = window.probability(&outline)?;
    let of_fit = OutlineDistance::of_ellipse(&outline, image.size());
    let of_label = OutlineDistance::of(part, image.drawn, image.size());
    let [steps, drawn] =
        [&of_fit, &of_label].map(|along| steps_along(along, &outline, &probability));
    let mean = |steps: &[f64; SECTORS]| steps.iter().sum::<f64>() / SECTORS as f64;
    let is_seen = seen(&steps);
    if share(&is_seen) < MIN_SEEN || mean(&steps) < mean(&drawn) - MAX_LOSS {
        return None;
    }
    if kind == Kind::Outline {
        let points = outline.outline_px(SECTORS).into_iter();
        let apart_px = points.map(|point| label.distance_px(point).abs());
        let is_hardly_better =
            outline.radius_px() > MIN_GAIN_RADIUS_PX && mean(&steps) < mean(&drawn) + MIN_GAIN;
        let is_careful = is_hardly_better || apart_px.fold(0.0, f64::max) <= CAREFUL_PX;
        if is_careful {
            return Some(Fit::Label);
        }
    }
    Some(Fit::Outline(FittedOutline { outline, is_seen }))
}

impl FittedOutline {
    /// Reports whether it is seen nearly all around: only then is the edge learnt from it, because what hides a part of an outline also moves
    /// the fit.
    pub(super) fn is_whole(&self) -> bool {
        share(&self.is_seen) >= WHOLE
    }
}

/// Returns whether an outline with these steps is seen in each sector.
fn seen(steps: &[f64; SECTORS]) -> [bool; SECTORS] {
    steps.map(|step| step >= MIN_STEP)
}

/// Returns the share of the sectors in which something holds.
fn share(sectors: &[bool; SECTORS]) -> f64 {
    sectors.iter().filter(|&&sector| sector).count() as f64 / SECTORS as f64
}

/// Finds colours and outline by turns.
fn by_turns(window: &Window, from: &Ellipse, octave: usize) -> Option<Ellipse> {
    let mut outline = *from;
    for _ in 0..ROUNDS {
        let probability = window.probability(&outline)?.reduced(octave);
        let here = outline.in_octave(octave);
        let [same, free] = [3, 5].map(|changes| descend(&probability, &here, changes));
        let is_other = free.0 > same.0 + OTHER_FORM;
        outline = if is_other { free.1 } else { same.1 }.enlarged_from(octave);
    }
    Some(outline)
}

/// Returns the sector of a share of the turn.
pub(super) fn sector_of(turn: f32) -> usize {
    ((turn * SECTORS as f32) as usize).min(SECTORS - 1)
}

/// Returns the ellipse of a label: with its moments, or inscribed in a box.
pub(super) fn ellipse_of(part: &Part, kind: Kind) -> Ellipse {
    match kind {
        Kind::Outline => Ellipse::of_part(part),
        Kind::Box => inscribed(part),
    }
}

/// Returns the ellipse inscribed in the bounding box of a part.
fn inscribed(part: &Part) -> Ellipse {
    let range = |axis: fn(&(usize, usize)) -> usize| {
        let along = || part.iter().map(axis);
        [along().min().unwrap_or(0), along().max().unwrap_or(0)].map(|c| c as f64)
    };
    let (columns, rows) = (range(|p| p.0), range(|p| p.1));
    let half = |[first, last]: [f64; 2]| 0.5 * (last - first + 1.0);
    let middle = |[first, last]: [f64; 2]| 0.5 * (last + first);
    Ellipse::upright([middle(columns), middle(rows)], [half(columns), half(rows)])
}

/// Returns the octave in which an outline is searched.
fn octave_of(outline: &Ellipse) -> usize {
    let is_small = |&octave: &usize| outline.in_octave(octave).radius_px() <= SEARCH_RADIUS_PX;
    (0..COARSEST).find(is_small).unwrap_or(COARSEST)
}

/// Returns the width of the bands that are compared on both sides of an outline.
fn band_px(outline: &Ellipse) -> f64 {
    let [least, most] = BAND_PX;
    (BAND * outline.radius_px()).clamp(least, most)
}

/// Returns the mean step of the probabilities across an outline, from outside to inside.
fn mean_step(probability: &Plane<f32>, outline: &Ellipse) -> f64 {
    /// Points along the outline, and across each band as shares of its width.
    const POINTS: usize = 48;
    const ACROSS: [f64; 3] = [0.2, 0.6, 1.0];
    let [shorter, longer] = outline.semi_axes_px();
    if shorter < MIN_AXES_RATIO * longer {
        return f64::NEG_INFINITY;
    }
    let band = band_px(outline);
    let [u, v] = outline.center_px();
    let step = |i: usize| {
        let [x, y] = outline.offset(std::f64::consts::TAU * i as f64 / POINTS as f64);
        let [nx, ny] = outline.normal([x, y]);
        let across = ACROSS.map(|share| {
            let at = |d: f64| probability.at([u + x + d * nx, v + y + d * ny]);
            Some(f64::from(at(-share * band)?) - f64::from(at(share * band)?))
        });
        // Outside the image nothing is seen.
        let sum: f64 = across.into_iter().flatten().sum();
        (sum / ACROSS.len() as f64).max(0.0)
    };
    (0..POINTS).map(step).sum::<f64>() / POINTS as f64
}

/// Tries places and sizes around a label.
fn search(probability: &Plane<f32>, label: &Ellipse) -> Ellipse {
    let radius_px = label.radius_px();
    let mut best = (f64::NEG_INFINITY, *label);
    for size in SIZES {
        for dv in SHIFTS {
            for du in SHIFTS {
                let shift = [du * radius_px, dv * radius_px, 0.0, 0.0, 0.0];
                let tried = label.scaled(size).changed(shift);
                let far = FAR * (du.hypot(dv) + libm::fabs(libm::log(size)));
                let score = mean_step(probability, &tried) - far;
                if score > best.0 {
                    best = (score, tried);
                }
            }
        }
    }
    best.1
}

/// Improves an outline by small changes, as long as any helps; the first three keep its form. Returns its step and the outline.
fn descend(probability: &Plane<f32>, from: &Ellipse, count: usize) -> (f64, Ellipse) {
    let mut best = (mean_step(probability, from), *from);
    for step in SEARCH_STEPS {
        let px = step * from.radius_px();
        let changes: [Change; 5] = [
            [px, 0.0, 0.0, 0.0, 0.0],
            [0.0, px, 0.0, 0.0, 0.0],
            [0.0, 0.0, step, step, 0.0],
            [0.0, 0.0, step, -step, 0.0],
            [0.0, 0.0, 0.0, 0.0, step],
        ];
        // Each change is a step, so that this ends; the limit is for images in which steps lead far away.
        for _ in 0..20 {
            let before = best.0;
            for &change in &changes[..count] {
                for sign in [1.0, -1.0] {
                    let tried = best.1.changed(change.map(|entry| sign * entry));
                    let score = mean_step(probability, &tried);
                    if score > best.0 {
                        best = (score, tried);
                    }
                }
            }
            if best.0 <= before {
                break;
            }
        }
    }
    best
}

/// Returns the step of the probabilities in each sector along any outline, within the band of the fitted one.
fn steps_along(along: &OutlineDistance, fit: &Ellipse, probability: &Plane<f32>) -> [f64; SECTORS] {
    let band = band_px(fit) as f32;
    // Sums and counts, inside and outside.
    let mut sums = [[[0.0_f64; 2]; 2]; SECTORS];
    along.for_each_near(|x, y, distance_px, turn| {
        if distance_px.abs() <= band
            && let Some(value) = probability.pixel(x, y)
        {
            let [sum, count] = &mut sums[sector_of(turn)][usize::from(distance_px > 0.0)];
            *sum += f64::from(value);
            *count += 1.0;
        }
    });
    // With both neighbours: sectors of small bodies have few pixels.
    std::array::from_fn(|sector| {
        let near = [SECTORS - 1, 0, 1].map(|next| sums[(sector + next) % SECTORS]);
        let mean = |side: usize| {
            let [sum, count] = [0, 1].map(|i| near.iter().map(|sums| sums[side][i]).sum::<f64>());
            (count > 0.0).then(|| sum / count)
        };
        mean(0)
            .zip(mean(1))
            .map_or(0.0, |(inside, outside)| (inside - outside).max(0.0))
    })
}
