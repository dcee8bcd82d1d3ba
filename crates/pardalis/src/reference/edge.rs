//! Naive implementation of the edge likelihood over correspondence lines.

use nalgebra::{Point3, Vector2, Vector3};

use super::{bin_of_bytes, matches, open_pixel, outline_points};
use crate::Frame;
use crate::color::{ColorModel, PixelKind};
use crate::likelihood::EdgeSettings;
use crate::shape::{Shape, Stance};
use crate::view::View;

/// Number of groups of adjacent lines that are visible or occluded together.
const SECTORS: usize = 16;
/// Number of parts of an outline with separate mean colours.
const PARTS: usize = 64;
/// Number of shifts of the outline along a line: -5 to 5 px, a quarter of a pixel apart.
const SHIFTS: usize = 41;
/// Length of a line to either side of the outline, pixels.
const REACH_PX: f64 = 5.0;

/// A pixel near an outline.
struct Pixel {
    yuv: Vector3<f64>,
    /// Its signed distance from the outline, negative inside.
    distance_px: f64,
    /// The nearest correspondence line.
    line: usize,
    matches: bool,
}

/// Correspondence lines across the outline of one position in one frame.
pub struct EdgeLines {
    points: Vec<Option<Vector2<f64>>>,
    normals: Vec<Vector2<f64>>,
    /// The log-likelihood ratio of each line at each shift.
    log_ratios: Vec<[f64; SHIFTS]>,
    exponent: f64,
    /// The octave's pixels per pixel of the frame.
    scale: f64,
    visible: [f64; SECTORS],
    anywhere: [f64; SECTORS],
}

/// Returns the colour posterior of each bin: t / (t + f), where t is its share of the target's pixels and f its share
/// of the frame's, sampled at every `step_px`th pixel of every `step_px`th row.
pub fn color_posterior(
    colors: &ColorModel,
    view: &View,
    frame: &Frame,
    step_px: usize,
) -> Vec<f64> {
    let mut counts = vec![0.0; colors.palette().bin_count()];
    for y in (0..frame.height()).step_by(step_px) {
        for x in (0..frame.width()).step_by(step_px) {
            if open_pixel(view, [x as f64, y as f64]).is_some() {
                let bytes = frame.components(x, y);
                let bin = bin_of_bytes(colors.palette(), PixelKind::of(frame), bytes);
                counts[usize::from(bin)] += 1.0;
            }
        }
    }
    let total: f64 = counts.iter().sum();
    let shares = colors.histogram().shares().iter().zip(&counts);
    shares
        .map(|(t, count)| {
            if *t > 0.0 {
                t / (t + count / total)
            } else {
                0.0
            }
        })
        .collect()
}

fn outline_px(
    view: &View,
    shape: &Shape,
    (position_m, stance): ([f64; 3], Stance),
    count: usize,
) -> Vec<Option<Vector2<f64>>> {
    let project = |point: Point3<f64>| view.camera().project(point.into()).map(Vector2::from);
    let points = outline_points(view, shape, position_m, stance, count);
    points.into_iter().map(project).collect()
}

impl EdgeLines {
    /// Places lines around a position in the world, in metres, in an octave of the frame, whose pixels are means of
    /// 2ⁿ x 2ⁿ pixels. Returns `None` if any point of the outline has no pixel. Assumes the illumination of the colour
    /// model and no learnt background.
    pub fn place(
        settings: &EdgeSettings,
        shape: &Shape,
        colors: &ColorModel,
        view: &View,
        (frame, octave): (&Frame, u32),
        position_m: [f64; 3],
    ) -> Option<Self> {
        let count = settings.correspondence_lines;
        let points = outline_px(view, shape, (position_m, Stance::default()), count);
        let size = 1_usize << octave;
        let scale = 1.0 / size as f64;
        let in_octave =
            |point: Vector2<f64>| point * scale + Vector2::from_element(0.5 * scale - 0.5);
        let at: Vec<Vector2<f64>> = points
            .iter()
            .map(|point| point.map(in_octave))
            .collect::<Option<_>>()?;
        let at = |k: usize| at[k % count];
        let doubled_area: f64 = (0..count).map(|k| at(k).perp(&at(k + 1))).sum();
        let along = |k: usize| at(k + 1) - at(k + count - 1);
        let normal = |k: usize| {
            let tangent = along(k).normalize();
            Vector2::new(tangent.y, -tangent.x) * doubled_area.signum()
        };
        let length_px: f64 = (0..count).map(|k| 0.5 * along(k).norm()).sum();
        let thinning = if length_px > 150.0 { 2 } else { 1 };
        let distance_of = |pixel: Vector2<f64>| {
            let squared = |k: usize| (pixel - at(k)).norm_squared();
            let compare = |a: &usize, b: &usize| squared(*a).total_cmp(&squared(*b));
            let k = (0..count).min_by(compare)?;
            let tangent = along(k).normalize();
            let turned = (normal(k + 1) - normal(k + count - 1)).dot(&tangent);
            let bend = (turned / along(k).norm()).clamp(-1.0, 1.0);
            let off = pixel - at(k);
            Some((
                k,
                off.dot(&normal(k)) + 0.5 * bend * off.dot(&tangent).powi(2),
            ))
        };
        let posterior = color_posterior(colors, view, frame, 1);
        let ranges = colors.ranges().map(|ranges| ranges.widened());
        let kind = PixelKind::of(frame);
        let mut pixels = Vec::new();
        for y in 0..frame.height() / size {
            for x in (0..frame.width() / size).filter(|x| (x + y) % thinning == 0) {
                let place = Vector2::new(x as f64, y as f64);
                let (line, distance_px) = distance_of(place)?;
                let is_near = (0..count).any(|k| (place - at(k)).norm() <= 12.0);
                if !is_near || !(-9.0..=8.0).contains(&distance_px) {
                    continue;
                }
                let block: Option<Vec<_>> = (0..size * size)
                    .map(|i| {
                        let [x, y] = [size * x + i % size, size * y + i / size];
                        let [x, y] = open_pixel(view, [x as f64, y as f64])?;
                        let bytes = frame.components(x, y);
                        let bin = bin_of_bytes(colors.palette(), kind, bytes);
                        let matches = posterior[usize::from(bin)] >= 2.0 / 3.0
                            && ranges.is_none_or(|ranges| matches(&ranges, kind, bytes));
                        Some((Vector3::from(kind.full_range_yuv(bytes)).cast(), matches))
                    })
                    .collect();
                let Some(block) = block else {
                    continue;
                };
                let sum: Vector3<f64> = block.iter().map(|(yuv, _)| yuv).sum();
                let matching = block.iter().filter(|(_, matches)| *matches).count();
                pixels.push(Pixel {
                    yuv: sum / block.len() as f64,
                    distance_px,
                    line,
                    matches: 2 * matching > block.len(),
                });
            }
        }
        let mut lines = Self {
            normals: (0..count).map(normal).collect(),
            points,
            log_ratios: line_log_ratios((settings, octave), colors, &pixels, thinning as f64)?,
            exponent: settings.likelihood_exponent,
            scale,
            visible: visible_shares(&pixels, count),
            anywhere: [0.0; SECTORS],
        };
        let curvature: f64 = (0..count)
            .map(|k| 2.0 * lines.at(k, 0.0) - lines.at(k, -0.5) - lines.at(k, 0.5))
            .sum();
        let shared_variance = settings.shared_sigma_px.powi(2);
        lines.exponent /= 1.0 + (curvature / 0.25).max(0.0) * shared_variance;
        for sector in 0..SECTORS {
            let of_sector = (0..count).filter(|k| k * SECTORS / count == sector);
            let sums: Vec<f64> = (0..SHIFTS)
                .map(|i| {
                    of_sector
                        .clone()
                        .map(|k| lines.log_ratios[k][i])
                        .sum::<f64>()
                })
                .map(|sum| lines.exponent * sum)
                .collect();
            let greatest = sums.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mean = sums.iter().map(|sum| (sum - greatest).exp()).sum::<f64>() / SHIFTS as f64;
            lines.anywhere[sector] = greatest + mean.ln();
        }
        Some(lines)
    }

    /// Returns the log-likelihood ratio of line `k` for a shift of the outline in pixels: a quadratic B-spline,
    /// reduced by 10 beyond the ends of the line.
    fn at(&self, k: usize, shift_px: f64) -> f64 {
        let step = (4.0 * (shift_px + REACH_PX)).clamp(1.0, (SHIFTS - 2) as f64);
        let spline: f64 = (0..SHIFTS)
            .map(|i| {
                let off = (step - i as f64).abs();
                let weight = if off <= 0.5 {
                    0.75 - off * off
                } else if off < 1.5 {
                    0.5 * (1.5 - off).powi(2)
                } else {
                    0.0
                };
                weight * self.log_ratios[k][i]
            })
            .sum();
        let value = self.exponent * spline;
        if shift_px.abs() < REACH_PX {
            value
        } else {
            value.min(0.0) - 10.0
        }
    }

    /// Returns the log-likelihood ratio at the outline around which the lines were placed, where each sector may deviate from it by up to a tolerance: the
    /// mean likelihood of five deviations.
    pub fn judged_log_ratio(&self, tolerance_px: f64) -> f64 {
        let count = self.points.len();
        let of_sector = |sector: usize| {
            let lines = || (0..count).filter(|k| k * SECTORS / count == sector);
            let likelihoods = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|share| {
                let sum: f64 = lines().map(|k| self.at(k, share * tolerance_px)).sum();
                (sum - self.anywhere[sector]).exp()
            });
            let ratio = likelihoods.iter().sum::<f64>() / 5.0;
            (self.visible[sector] * ratio + 1.0 - self.visible[sector]).ln()
        };
        (0..SECTORS).map(of_sector).sum()
    }

    /// Returns the log-likelihood ratio of rectangles around the middle of the outline around which the lines were placed: the mean likelihood of 36, whose sectors may
    /// deviate by up to a tolerance. Each line of a sector stands for its share of the sector's likelihood.
    pub fn rectangle_log_ratio(&self, tolerance_px: f64) -> f64 {
        let count = self.points.len();
        let points: Vec<_> = self.points.iter().flatten().collect();
        let middle = points.iter().copied().sum::<Vector2<f64>>() / points.len() as f64;
        // A sector's log-likelihood if all of its lines are shifted by as much, at the shifts of lines.
        let tolerant = |sector: usize, i: usize| {
            let lines = || (0..count).filter(|k| k * SECTORS / count == sector);
            let at =
                |i: usize| -> f64 { lines().map(|k| self.exponent * self.log_ratios[k][i]).sum() };
            let deviations = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|share| {
                let step =
                    (i as f64 + 4.0 * share * tolerance_px).clamp(0.0, SHIFTS as f64 - 1.001);
                let low = step.floor() as usize;
                let [near, far] = [at(low), at(low + 1)].map(f64::exp);
                near + (step - low as f64) * (far - near)
            });
            (deviations.iter().sum::<f64>() / 5.0).ln()
        };
        let tables: Vec<Vec<f64>> = (0..SECTORS)
            .map(|sector| (0..SHIFTS).map(|i| tolerant(sector, i)).collect())
            .collect();
        let mut likelihoods = Vec::new();
        for (ratio, directions, whole) in [(1.0, 4, 90.0_f64), (1.25, 8, 180.0)] {
            for direction in 0..directions {
                for size in [0.95, 1.0, 1.05] {
                    let turned =
                        (whole * f64::from(direction) / f64::from(directions)).to_radians();
                    // Half the sides of a rectangle with the area of a circle of this radius.
                    let short = size * (std::f64::consts::PI / 4.0 / ratio).sqrt();
                    let half = [ratio * short, short];
                    let mut total = 0.0;
                    for sector in 0..SECTORS {
                        let lines: Vec<usize> = (0..count)
                            .filter(|k| k * SECTORS / count == sector && self.points[*k].is_some())
                            .collect();
                        let mut sum = 0.0;
                        for &k in &lines {
                            let angle = std::f64::consts::TAU * k as f64 / count as f64 - turned;
                            let radius =
                                (half[0] / angle.cos().abs()).min(half[1] / angle.sin().abs());
                            let point = self.points[k].expect("filtered");
                            let radius_px = self.scale * (point - middle).dot(&self.normals[k]);
                            let shift_px = (radius - 1.0) * radius_px;
                            let step =
                                (4.0 * (shift_px + REACH_PX)).clamp(0.0, SHIFTS as f64 - 1.001);
                            let low = step.floor() as usize;
                            let table = &tables[sector];
                            let value =
                                table[low] + (step - low as f64) * (table[low + 1] - table[low]);
                            sum += value / lines.len() as f64;
                        }
                        let visible = self.visible[sector];
                        total +=
                            (visible * (sum - self.anywhere[sector]).exp() + 1.0 - visible).ln();
                    }
                    likelihoods.push(total.exp());
                }
            }
        }
        (likelihoods.iter().sum::<f64>() / likelihoods.len() as f64).ln()
    }

    /// Returns the log-likelihood ratio of a body at a position in the world (metres) against an edge at any shift
    /// from the outline around which the lines were placed.
    pub fn log_likelihood_ratio(&self, shape: &Shape, view: &View, position_m: [f64; 3]) -> f64 {
        let count = self.points.len();
        let outline = outline_px(view, shape, (position_m, Stance::default()), count);
        let of_sector = |sector: usize| {
            let sum: f64 = (0..count)
                .filter(|k| k * SECTORS / count == sector)
                .filter_map(|k| {
                    let shift = outline[k]? - self.points[k]?;
                    Some(self.at(k, self.scale * shift.dot(&self.normals[k])))
                })
                .sum();
            let visible = self.visible[sector];
            let ratio = (sum - self.anywhere[sector]).min(60.0).exp();
            (visible * ratio + 1.0 - visible).ln()
        };
        (0..SECTORS).map(of_sector).sum()
    }
}

/// Returns the probability that each sector is visible, from the share of its inner pixels with the target's colours.
fn visible_shares(pixels: &[Pixel], count: usize) -> [f64; SECTORS] {
    let is_inner = |pixel: &&Pixel| (-6.0..=-1.2).contains(&pixel.distance_px);
    let share = |sector: Option<usize>| {
        let is_of = |pixel: &&Pixel| sector.is_none_or(|s| pixel.line * SECTORS / count == s);
        let inner = pixels.iter().filter(is_inner).filter(is_of);
        let matching = inner.clone().filter(|pixel| pixel.matches).count() as f64;
        let all = inner.count() as f64;
        (all > 0.0).then(|| matching / all)
    };
    let whole = share(None).unwrap_or(0.0);
    std::array::from_fn(|sector| 0.02 + 0.96 * share(Some(sector)).unwrap_or(whole))
}

/// Returns the mean colour around each part of the outline with von Mises weights, over the pixels for whose distance
/// `takes` returns true.
fn means(
    pixels: &[Pixel],
    count: usize,
    concentration: f64,
    takes: impl Fn(f64) -> bool,
) -> Option<Vec<Vector3<f64>>> {
    if !pixels.iter().any(|pixel| takes(pixel.distance_px)) {
        return None;
    }
    let mean = |part: usize| {
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        for pixel in pixels.iter().filter(|pixel| takes(pixel.distance_px)) {
            let parts = part_of(pixel.line, count) as f64 - part as f64;
            let angle = parts / PARTS as f64 * std::f64::consts::TAU;
            let weight = (concentration * (angle.cos() - 1.0)).exp();
            sum += pixel.yuv * weight;
            total += weight;
        }
        sum / total
    };
    Some((0..PARTS).map(mean).collect())
}

fn part_of(line: usize, count: usize) -> usize {
    ((line * PARTS) as f64 / count as f64 + 0.5).floor() as usize % PARTS
}

/// Returns the log-likelihood ratios of all lines: sums over pixels of the logarithm of the learnt
/// P(membership | distance) / P(membership | outside), and of P(colour | inside) / P(colour | outside) where a pixel
/// lies on the wrong side.
fn line_log_ratios(
    (settings, octave): (&EdgeSettings, u32),
    colors: &ColorModel,
    pixels: &[Pixel],
    weight: f64,
) -> Option<Vec<[f64; SHIFTS]>> {
    let count = settings.correspondence_lines;
    let mut distances: Vec<f64> = pixels.iter().map(|pixel| pixel.distance_px).collect();
    distances.sort_by(f64::total_cmp);
    let sixth = *distances.get(5)?;
    let deepest = if sixth <= -2.0 { -2.0 } else { sixth.min(0.0) };
    let inside = means(pixels, count, 2.0, |distance| distance <= deepest)?;
    let outside = means(pixels, count, 4.0, |distance| {
        (3.0..7.0).contains(&distance)
    })?;
    let is_shaded = |distance: f64| (-6.0..=-1.2).contains(&distance);
    let shading = means(pixels, count, 4.0, is_shaded);
    let shaded: Vec<f64> = pixels
        .iter()
        .filter(|pixel| is_shaded(pixel.distance_px))
        .map(|pixel| pixel.yuv.x)
        .collect();
    let mean_luma = shaded.iter().sum::<f64>() / shaded.len() as f64;
    let edges = colors.edges();
    let profile = edges.get(octave as usize).or(edges.last())?.log_ratios();
    let mixed_px = if octave == 0 { 2.0 } else { 1.0 };
    let mut lines = vec![[0.0; SHIFTS]; count];
    for pixel in pixels {
        let part = part_of(pixel.line, count);
        let channels = Vector3::new(1.0, 15.0, 15.0);
        let difference = inside[part] - outside[part];
        let weighted = difference.component_mul(&channels);
        let contrast = difference.dot(&weighted);
        let membership = (pixel.yuv - outside[part]).dot(&weighted) / contrast;
        let bin = ((membership + 0.5) * 16.0).floor().clamp(0.0, 31.0) as usize;
        let is_lit = shading
            .as_ref()
            .is_none_or(|means| means[part].x >= mean_luma);
        let by_distance = &profile[usize::from(is_lit)];
        // What a pixel at a distance says: by its membership, and by whether it lies on the wrong side.
        let log_ratio = |row: usize| {
            let distance_px = 0.25 * row as f64 - 4.0;
            let of_edge = if contrast < 100.0 {
                0.0
            } else {
                f64::from(by_distance[row][bin])
            };
            let of_region = if pixel.matches {
                -1.95 * (distance_px - mixed_px).clamp(0.0, 1.0)
            } else {
                -1.1 * (-distance_px - mixed_px).clamp(0.0, 1.0)
            };
            of_edge + of_region
        };
        for (i, sum) in lines[pixel.line].iter_mut().enumerate() {
            let shift_px = i as f64 / 4.0 - REACH_PX;
            let step = (4.0 * (pixel.distance_px - shift_px + 4.0)).clamp(0.0, 31.999);
            let row = step.floor() as usize;
            let [near, far] = [row, row + 1].map(log_ratio);
            *sum += weight * (near + (step - row as f64) * (far - near));
        }
    }
    Some(lines)
}
