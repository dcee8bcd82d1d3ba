//! Learns edge profiles and mean colours of bodies from labelled images, in each octave: an image's own pixels, and means of
//! 2 x 2 pixels of the octave before.

use std::ops::Range;

use super::body_colors::BodyColors;
use super::edge_profile::{Counts, EdgeProfile};
use super::membership::{EdgePixel, Surroundings};
use super::outline_distance::OutlineDistance;

/// Computes the mean colour; `None` for an empty iterator.
fn mean(colors: impl Iterator<Item = [f32; 3]>) -> Option<[f32; 3]> {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for color in colors {
        for (sum, value) in sum.iter_mut().zip(color) {
            *sum += value;
        }
        count += 1.0;
    }
    (count > 0.0).then(|| sum.map(|sum| sum / count))
}

/// Bodies with fewer pixels than this in a coarser octave teach nothing there. Hand-set: a disc with a radius of 5 px.
const MIN_COARSE_AREA_PX: usize = 79;
/// The tracker judges outlines in the finest octave in which they are no wider than this, half their width in pixels: lines
/// then reach across most of the body, edges within it count little, and blur is narrow. Hand-set: between 8 and 16 px most of
/// the balls of real clips are recognised.
pub(crate) const JUDGED_RADIUS_PX: f64 = 16.0;
/// The coarsest octave. Derivation: a body of 256 px, half of what the largest photographs show, has a radius of 16 px there.
pub(crate) const COARSEST_OCTAVE: u8 = 4;
/// Radii in pixels, in its octave, of bodies whose mean colours are learnt there. Derivation: the octave in which the tracker
/// judges outlines (at most [`JUDGED_RADIUS_PX`], and more than half of it where there is a finer octave), and a little more
/// so that none is left out.
const BODY_RADIUS_PX: [f64; 2] = [JUDGED_RADIUS_PX / 2.0 - 0.25, JUDGED_RADIUS_PX + 0.5];
/// The number of octaves that profiles are learnt for. Derivation: those that the tracker uses.
const OCTAVES: u32 = COARSEST_OCTAVE as u32 + 1;

/// Parts of two octaves whose centres lie closer than this, in pixels of the finer one, are the same. Hand-set.
const SAME_PART_PX: f32 = 2.0;

/// The centre of an outline of an octave in the image, pixels.
fn center_px(outline: &OutlineDistance, octave: usize) -> [f32; 2] {
    let size = (1 << octave) as f32;
    let center_px = outline.centroid_px();
    center_px.map(|c| (c as f32 + 0.5) * size - 0.5)
}

/// The radius of a disc of a part's area, in pixels of its octave.
fn radius_px(outline: &OutlineDistance) -> f64 {
    (outline.area_px() as f64 / std::f64::consts::PI).sqrt()
}

/// What the labels of bodies follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Follows {
    /// The outline, to a fraction of a pixel.
    Outline,
    /// A box around the body: where the outline lies is known roughly.
    Box,
}

/// Counts memberships along the outlines of labelled bodies, and collects their mean colours.
#[derive(Debug, Clone, Default)]
pub(super) struct EdgeLearner {
    /// For each octave; indexed in the order of [`Side::ALL`].
    counts: Vec<[Counts; 2]>,
    /// The mean colour of each body.
    bodies: Vec<[f32; 3]>,
    pixels: Vec<EdgePixel>,
}

impl EdgeLearner {
    /// Adds the outlines of a labelled image of the given width. `yuv` returns the colour of a pixel. Parts
    /// that are small or touch the image border are ignored. Memberships are only counted along exact outlines.
    pub(super) fn add(
        &mut self,
        labels: &[bool],
        width: usize,
        follows: Follows,
        yuv: impl Fn(usize, usize) -> [f32; 3],
    ) {
        let Some(labelled) = labelled(labels, width) else {
            return;
        };
        let size_px = (width, labels.len() / width.max(1));
        let octaves = (0..OCTAVES).map(|octave| {
            let labels = coarse_labels(labels, size_px, 1 << octave, &labelled);
            let mut outlines = OutlineDistance::of_parts(&labels, width >> octave);
            let least = if octave > 0 { MIN_COARSE_AREA_PX } else { 0 };
            outlines.retain(|outline| outline.area_px() >= least);
            outlines
        });
        let octaves: Vec<_> = octaves
            .take_while(|outlines| !outlines.is_empty())
            .collect();
        for outline in octaves.first().into_iter().flatten() {
            let center_px = center_px(outline, 0);
            let is_same = |octave: usize, other: &OutlineDistance| {
                let [du, dv] = [0, 1].map(|i| self::center_px(other, octave)[i] - center_px[i]);
                libm::hypotf(du, dv) < SAME_PART_PX * (1 << octave) as f32
            };
            let same = octaves.iter().enumerate().map_while(|(octave, outlines)| {
                outlines.iter().find(|other| is_same(octave, other))
            });
            self.add_part(&same.collect::<Vec<_>>(), follows, &yuv);
        }
    }

    /// Adds a part, given its outline in each octave.
    fn add_part(
        &mut self,
        outlines: &[&OutlineDistance],
        follows: Follows,
        yuv: &impl Fn(usize, usize) -> [f32; 3],
    ) {
        for (octave, outline) in outlines.iter().enumerate() {
            self.take_pixels(outline, octave, yuv);
            let Some(surroundings) = Surroundings::of(&self.pixels) else {
                continue;
            };
            self.take_body(octave, radius_px(outline));
            if follows == Follows::Outline {
                self.count(octave, &surroundings);
            }
        }
    }

    /// Collects the pixels of an octave near an outline.
    fn take_pixels(
        &mut self,
        outline: &OutlineDistance,
        octave: usize,
        yuv: impl Fn(usize, usize) -> [f32; 3],
    ) {
        let size = 1 << octave;
        let mean_yuv = |x: usize, y: usize| {
            let block = (0..size * size).map(|i| yuv(size * x + i % size, size * y + i / size));
            mean(block).unwrap_or([f32::NAN; 3])
        };
        let pixels = &mut self.pixels;
        pixels.clear();
        outline.for_each_near(|x, y, distance_px, turn| {
            pixels.push(EdgePixel {
                yuv: mean_yuv(x, y),
                distance_px,
                turn,
            });
        });
    }

    /// Takes the mean colour of the collected pixels if the body has the right size in this octave.
    fn take_body(&mut self, octave: usize, radius_px: f64) {
        let [least_px, most_px] = BODY_RADIUS_PX;
        if radius_px <= most_px && (octave == 0 || radius_px > least_px) {
            let inside = |pixel: &&EdgePixel| BodyColors::DEPTH_PX.contains(&pixel.distance_px);
            let colors = self.pixels.iter().filter(inside).map(|pixel| pixel.yuv);
            self.bodies.extend(mean(colors));
        }
    }

    /// Counts the collected pixels of an octave.
    fn count(&mut self, octave: usize, surroundings: &Surroundings) {
        while self.counts.len() <= octave {
            let none = vec![[0; EdgeProfile::MEMBERSHIPS]; EdgeProfile::DISTANCES];
            self.counts.push([none.clone(), none]);
        }
        for pixel in &self.pixels {
            let membership = surroundings.at(pixel).membership(&pixel.yuv);
            let row = ((pixel.distance_px + EdgeProfile::REACH_PX) * 4.0).round();
            if membership.is_nan() || row > (EdgeProfile::DISTANCES + 1) as f32 {
                continue;
            }
            // Pixels deeper inside count as at the smallest distance; the last row takes half a pixel
            // more.
            let row = (row.max(0.0) as usize).min(EdgeProfile::DISTANCES - 1);
            let side = surroundings.at(pixel).side() as usize;
            self.counts[octave][side][row][EdgeProfile::bin_of(membership)] += 1;
        }
    }

    /// Returns the mean colours of the bodies; `None` if there were none.
    pub(super) fn body(&self) -> Option<BodyColors> {
        BodyColors::new(self.bodies.clone())
    }

    /// Returns the learnt profile of each octave, up to the first in which some distance on some side has no pixels.
    pub(super) fn profiles(&self) -> Vec<EdgeProfile> {
        let is_seen = |row: &[u32; EdgeProfile::MEMBERSHIPS]| row.iter().any(|&count| count > 0);
        let is_whole = |counts: &Counts| counts.iter().all(is_seen);
        let whole = self.counts.iter();
        let whole = whole.take_while(|sides| sides.iter().all(is_whole));
        whole
            .map(|counts| EdgeProfile {
                counts: counts.clone(),
            })
            .collect()
    }
}

/// Labels of an image whose pixels are blocks of the image's: those of which more than half is labelled, and every other one
/// of those of which half is. Only blocks in these columns and rows of the image have labelled pixels.
fn coarse_labels(
    labels: &[bool],
    (width, height): (usize, usize),
    size: usize,
    (labelled_columns, labelled_rows): &(Range<usize>, Range<usize>),
) -> Vec<bool> {
    let (columns, rows) = (width / size, height / size);
    let blocks = |labelled: &Range<usize>, count: usize| {
        labelled.start / size..labelled.end.div_ceil(size).min(count)
    };
    let mut coarse = vec![false; columns * rows];
    for y in blocks(labelled_rows, rows) {
        for x in blocks(labelled_columns, columns) {
            let block = (0..size * size)
                .filter(|i| labels[(size * y + i / size) * width + size * x + i % size]);
            let twice = 2 * block.count();
            let is_even = (x + y) % 2 == 0;
            coarse[y * columns + x] = twice > size * size || (twice == size * size && is_even);
        }
    }
    coarse
}

/// Returns the columns and rows of the labelled pixels; `None` if there are none.
fn labelled(labels: &[bool], width: usize) -> Option<(Range<usize>, Range<usize>)> {
    let (mut columns, mut rows) = (width..0, labels.len()..0);
    for (y, row) in labels.chunks(width.max(1)).enumerate() {
        let Some(first) = row.iter().position(|label| *label) else {
            continue;
        };
        let last = row.iter().rposition(|label| *label).unwrap_or(first);
        columns = columns.start.min(first)..columns.end.max(last + 1);
        rows = rows.start.min(y)..y + 1;
    }
    (!rows.is_empty()).then_some((columns, rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_blocks_with_labels_are_counted_and_none_of_them_is_left_out() {
        let (width, height) = (53, 41);
        let disc = |u: f64, v: f64, radius: f64| {
            let label = move |i: usize| {
                let [x, y] = [(i % width) as f64 - u, (i / width) as f64 - v];
                x.hypot(y) < radius
            };
            (0..width * height).map(label).collect::<Vec<_>>()
        };
        for labels in [
            disc(20.3, 17.8, 9.0),
            disc(3.0, 38.0, 8.0),
            disc(52.0, 40.0, 11.0),
            vec![true; width * height],
        ] {
            let found = labelled(&labels, width).unwrap();
            for size in [1, 2, 4, 8, 16] {
                let everywhere = (0..width, 0..height);
                let coarse = |region| coarse_labels(&labels, (width, height), size, region);
                assert_eq!(coarse(&found), coarse(&everywhere), "{found:?}, {size}");
            }
            let outside = labels.iter().enumerate().filter(|&(i, label)| {
                *label && !(found.0.contains(&(i % width)) && found.1.contains(&(i / width)))
            });
            assert_eq!(outside.count(), 0, "{found:?}");
        }
        assert_eq!(
            labelled(&disc(20.3, 17.8, 0.6), width),
            Some((20..21, 18..19))
        );
        assert_eq!(labelled(&vec![false; width * height], width), None);
    }
}
