//! Refines an outline to a fraction of a pixel: the steps of brightness and colour across it, sector by sector.
//!
//! Around an outline the colours inside and outside are taken as linear in the distance from it: a round body darkens towards
//! its outline, and the ground near it lies in its shadow. In between they blend over a Gaussian blur. In each sector the
//! offset is found at which this fits best, and how certain it is; the ellipse follows from all of them, robust against those that
//! disagree.

use nalgebra::{Matrix4, SMatrix, SVector, Vector4};

use super::pixels::Plane;
use crate::color::ellipse::{Change, Ellipse};

/// Length of a sector along the outline in pixels, and limits of their number. Hand-set: some 20 pixels each.
const SECTOR_PX: f64 = 3.0;
const SECTORS: [usize; 2] = [12, 48];
/// Distances from the outline at which pixels are compared, pixels. Hand-set: beyond the blur of most edges.
const REACH_PX: f64 = 3.5;
/// The offsets that are tried, from the first on in equal steps, pixels. Hand-set.
const FIRST_PX: f64 = -1.5;
const STEP_PX: f64 = 0.1;
const OFFSETS: usize = 31;
/// The blurs that are tried, standard deviations in pixels.
const BLURS_PX: [f64; 4] = [0.4, 0.55, 0.8, 1.2];
/// Cameras and files store chroma at half the resolution: its additional blur in the finest octave, a standard deviation in pixels.
const CHROMA_BLUR_PX: f64 = 1.2;
/// How firmly colours are held constant with the distance from the outline, in squared grey levels per squared grey level per
/// pixel. Hand-set.
const STIFFNESS: f64 = 0.3;
/// The least variance of a pixel, squared grey levels. Hand-set.
const MIN_VARIANCE: f64 = 4.0;
/// The most that a sector says, 1/px². Hand-set: the edge of a shaded body, and of its shadow, is some 0.3 px from where the image shows it.
const MAX_INFORMATION: f64 = 10.0;
/// Sectors that disagree by more than this count less, pixels. Hand-set.
const AGREEMENT_PX: f64 = 0.3;
/// The same for the label, and the information that it counts with in every sector, 1/px²: one that follows the outline to a tenth of
/// a pixel is more accurate than the edges, and a rougher one hardly counts. Hand-set: masks of rendered balls are that accurate.
const LABEL_AGREEMENT_PX: f64 = 0.15;
const LABEL_INFORMATION: f64 = 15.0;
/// How firmly the form is held, as a share of the information that the edges can have about it at most: where a part of an outline
/// is hidden, the rest does not determine it. Hand-set.
const FIRMNESS: f64 = 0.3;
/// What misfits of chroma count, relative to those of luma. Hand-set: cameras and files treat it worse.
const CHROMA: f64 = 0.3;
const ITERATIONS: usize = 5;
const ROBUST_ITERATIONS: usize = 10;
/// An outline that would move farther than this, in pixels, is left as it is: the steps are those of something else.
const MAX_MOVE_PX: f64 = 2.0;

/// Where a sector sees the edge: the offset from the outline in pixels, outwards, and the information about it, 1/px².
struct Edge {
    offset_px: f64,
    information: f64,
    cost: f64,
}

/// Returns the outline in an octave, refined by its colours (Y, U and V), and by a label that may follow the outline; unchanged if
/// that leads elsewhere.
pub(super) fn refined(
    colors: &Plane<[f32; 3]>,
    outline: &Ellipse,
    label: Option<&Ellipse>,
    octave: usize,
) -> Ellipse {
    let along = std::f64::consts::TAU * outline.radius_px() / SECTOR_PX;
    let count = (along.round() as usize).clamp(SECTORS[0], SECTORS[1]);
    let mut found = *outline;
    let mut blur_px = None;
    for _ in 0..ITERATIONS {
        let sectors = Sector::all(colors, &found, count);
        let edges = |blur_px: f64| {
            let chroma_px = blur_px.hypot(CHROMA_BLUR_PX / (1_usize << octave) as f64);
            let edge = |sector: &Sector| sector.edge([blur_px, chroma_px]);
            sectors.iter().map(edge).collect::<Vec<_>>()
        };
        let blur_px = *blur_px.get_or_insert_with(|| {
            let cost = |blur_px: f64| edges(blur_px).iter().map(|edge| edge.cost).sum::<f64>();
            let costs = BLURS_PX.map(|blur_px| (cost(blur_px), blur_px));
            let best = costs.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
            best.map_or(BLURS_PX[0], |(_, blur_px)| blur_px)
        });
        let Some(change) = agreed_change(&found, &edges(blur_px), label) else {
            return *outline;
        };
        found = found.changed(change);
    }
    let points = found.outline_px(24).into_iter();
    let moved_px = points.map(|point| outline.distance_px(point).abs());
    if moved_px.fold(0.0, f64::max) <= MAX_MOVE_PX {
        found
    } else {
        *outline
    }
}

/// The pixels of a sector: distances from the outline, and colours.
#[derive(Default)]
struct Sector {
    distances_px: Vec<f64>,
    colors: [Vec<f64>; 3],
}

impl Sector {
    fn all(colors: &Plane<[f32; 3]>, outline: &Ellipse, count: usize) -> Vec<Self> {
        let mut sectors: Vec<Self> = (0..count).map(|_| Self::default()).collect();
        colors.for_each(|x, y, color| {
            let point = [x as f64, y as f64];
            let distance_px = outline.distance_px(point);
            if distance_px.abs() < REACH_PX {
                let turn = outline.angle_rad(point).rem_euclid(std::f64::consts::TAU);
                let sector = (turn / std::f64::consts::TAU * count as f64) as usize;
                let sector = &mut sectors[sector.min(count - 1)];
                sector.distances_px.push(distance_px);
                for (values, value) in sector.colors.iter_mut().zip(color) {
                    values.push(f64::from(value));
                }
            }
        });
        sectors
    }

    /// Finds the edge, with the blur of luma and of chroma.
    fn edge(&self, [luma_px, chroma_px]: [f64; 2]) -> Edge {
        let costs: [f64; OFFSETS] = std::array::from_fn(|i| {
            let offset_px = FIRST_PX + STEP_PX * i as f64;
            self.misfit(offset_px, luma_px, 0..1) + CHROMA * self.misfit(offset_px, chroma_px, 1..3)
        });
        let best = (0..OFFSETS).min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let best = best.unwrap_or(0);
        let cost = costs[best];
        let parameters = 4.0;
        let variance = MIN_VARIANCE + cost / (self.distances_px.len() as f64 - parameters).max(1.0);
        let mut edge = Edge {
            offset_px: 0.0,
            information: 0.0,
            cost,
        };
        if (2..OFFSETS - 2).contains(&best) {
            let bend = costs[best - 1] - 2.0 * cost + costs[best + 1];
            let wide = costs[best - 2] - 2.0 * cost + costs[best + 2];
            if bend > 0.0 {
                let shift = 0.5 * (costs[best - 1] - costs[best + 1]) / bend;
                edge.offset_px = FIRST_PX + STEP_PX * (best as f64 + shift);
                let curvature = 0.5 * wide / (2.0 * STEP_PX).powi(2);
                edge.information = (curvature / variance).clamp(0.0, MAX_INFORMATION);
            }
        }
        edge
    }

    /// Returns the squared misfit of the best colours on both sides of an edge, over these channels.
    fn misfit(&self, offset_px: f64, blur_px: f64, channels: std::ops::Range<usize>) -> f64 {
        let mut normal = Matrix4::from_diagonal(&Vector4::new(1e-6, 1e-6, STIFFNESS, STIFFNESS));
        let mut right = [Vector4::zeros(); 3];
        let mut squares = 0.0;
        for (i, distance_px) in self.distances_px.iter().enumerate() {
            let off = distance_px - offset_px;
            let inside = 0.5 * libm::erfc(off / (blur_px * std::f64::consts::SQRT_2));
            let outside = 1.0 - inside;
            // Slopes are relative to places clear of the edge.
            let basis = Vector4::new(inside, outside, inside * (off + 2.0), outside * (off - 2.0));
            normal += basis * basis.transpose();
            for channel in channels.clone() {
                let value = self.colors[channel][i];
                right[channel] += value * basis;
                squares += value * value;
            }
        }
        let Some(factor) = normal.cholesky() else {
            return squares;
        };
        let explained = channels.map(|channel| right[channel].dot(&factor.solve(&right[channel])));
        squares - explained.sum::<f64>()
    }
}

/// Returns the change of the outline that most sectors agree on, and then the label if it agrees with them; `None` if they do not
/// determine it.
fn agreed_change(outline: &Ellipse, edges: &[Edge], label: Option<&Ellipse>) -> Option<Change> {
    let count = edges.len() as f64;
    let [u, v] = outline.center_px();
    let row = |sector: usize| {
        let turn = (sector as f64 + 0.5) / count;
        let [x, y] = outline.offset(std::f64::consts::TAU * turn);
        let [nx, ny] = outline.normal([x, y]);
        let row = SVector::<f64, 5>::from([nx, ny, nx * x, ny * y, nx * y + ny * x]);
        let label_px = label.map(|label| -label.distance_px([u + x, v + y]));
        (row, label_px)
    };
    let rows: Vec<_> = (0..edges.len()).map(row).collect();
    let firmness = FIRMNESS * MAX_INFORMATION * count * outline.radius_px().powi(2);
    let mut change = SVector::<f64, 5>::zeros();
    for with_label in [false, true] {
        for _ in 0..ROBUST_ITERATIONS {
            // The form: half the difference of xx and yy, and xy.
            let mut normal = SMatrix::<f64, 5, 5>::from_diagonal(&SVector::from([1e-3; 5]));
            for (i, j, entry) in [
                (2, 2, 0.25),
                (3, 3, 0.25),
                (2, 3, -0.25),
                (3, 2, -0.25),
                (4, 4, 1.0),
            ] {
                normal[(i, j)] += entry * firmness;
            }
            let mut right = SVector::<f64, 5>::zeros();
            let mut add =
                |row: &SVector<f64, 5>, offset_px: f64, information: f64, agreement_px: f64| {
                    let off = (offset_px - row.dot(&change)) / agreement_px;
                    let weight = information / (1.0 + off * off);
                    normal += weight * row * row.transpose();
                    right += weight * offset_px * row;
                };
            for ((row, label_px), edge) in rows.iter().zip(edges) {
                add(row, edge.offset_px, edge.information, AGREEMENT_PX);
                if let Some(label_px) = label_px.filter(|_| with_label) {
                    add(row, label_px, LABEL_INFORMATION, LABEL_AGREEMENT_PX);
                }
            }
            change = normal.cholesky()?.solve(&right);
        }
    }
    let is_finite = change.iter().all(|entry| entry.is_finite());
    is_finite.then(|| change.into())
}
