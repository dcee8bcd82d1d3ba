//! Quadrilaterals of straight edges that may be the image of a rectangle.

use nalgebra::{Matrix3, Vector3};

use super::lines::{Line, dot};

/// Least fraction of each side with an edge, and least mean of all four: parts may be occluded.
const MIN_SUPPORT: f64 = 0.5;
const MIN_MEAN_SUPPORT: f64 = 0.75;

/// Least length of a side divided by the image's shorter side.
pub(super) const MIN_SIDE_FRACTION: f64 = 0.1;

/// Greatest distance of corners from the image, divided by its longer side.
const MAX_OUTSIDE_FRACTION: f64 = 0.15;

/// Least sine of the angle between adjacent sides.
const MIN_TURN_SINE: f64 = 0.14;

/// Greatest cosine of a corner's angle after rectification with a suitable focal length.
const MAX_CORNER_COSINE: f64 = 0.12;

/// Limits for the other edge of a tape: greatest distance divided by the rectangle's size, least distance in pixels, and
/// greatest sine of the angle between the edges.
const MAX_TAPE_FRACTION: f64 = 0.12;
const MIN_TAPE_PX: f64 = 1.0;
const MAX_TAPE_SINE: f64 = 0.1;

/// Least visible fraction of each side of a tape's other edge, and least mean of all four.
const MIN_OTHER_SUPPORT: f64 = 0.3;
const MIN_OTHER_MEAN_SUPPORT: f64 = 0.6;

/// Focal lengths of common lenses, divided by the image's longer side.
const FOCAL_LENGTHS: [f64; 9] = [0.4, 0.5, 0.65, 0.8, 1.0, 1.4, 2.0, 4.0, 8.0];

/// A convex quadrilateral of four edges that are all brighter on the inside, or all on the outside.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quad {
    /// Corners, counter-clockwise as seen in the image (v points down).
    pub(super) corners_px: [[f64; 2]; 4],
    /// Whether the inside is brighter than the outside, next to the edges.
    pub(super) inside_is_brighter: bool,
    /// Fraction of the side from each corner to the next that has an edge.
    pub(super) support: [f64; 4],
    /// Index of the line of each of these sides.
    lines: [usize; 4],
    /// Conspicuousness: mean gradient of the weakest side in grey levels per pixel, times the square root of the
    /// perimeter.
    pub(super) score: f64,
    /// Least fraction of a side inside the image.
    pub(super) visible_fraction: f64,
}

impl Quad {
    /// Returns the same quadrilateral with other corners, such as those in an image of another size.
    pub(super) fn with_corners(self, corners_px: [[f64; 2]; 4]) -> Self {
        Self { corners_px, ..self }
    }

    /// Returns the area in square pixels.
    pub(super) fn area_px2(&self) -> f64 {
        let c = self.corners_px;
        let product = |i: usize| {
            let ([u, v], [u2, v2]) = (c[i], c[(i + 1) % 4]);
            u * v2 - u2 * v
        };
        0.5 * (0..4).map(product).sum::<f64>().abs()
    }
}

/// Returns all quadrilaterals of these lines in an image of this size, the most conspicuous first.
pub(super) fn find(lines: &[Line], size_px: [f64; 2]) -> Vec<Quad> {
    let mut quads = Vec::new();
    for inside_is_brighter in [true, false] {
        let search = Search {
            lines,
            size_px,
            inside_is_brighter,
        };
        search.run(&mut quads);
    }
    quads.sort_by(|a, b| b.score.total_cmp(&a.score));
    quads
}

/// Search for quadrilaterals that are brighter on one side.
struct Search<'a> {
    lines: &'a [Line],
    size_px: [f64; 2],
    inside_is_brighter: bool,
}

/// A side between two corners.
#[derive(Clone, Copy)]
struct Side {
    support: f64,
    gradient: f64,
    length_px: f64,
    visible_fraction: f64,
}

impl Search<'_> {
    /// Tries all cycles of four lines that turn the same way. Nearly all of them end early at a side without edges.
    fn run(&self, quads: &mut Vec<Quad>) {
        let count = self.lines.len();
        for a in 0..count {
            for b in a + 1..count {
                let Some(ab) = self.corner(a, b) else {
                    continue;
                };
                for c in a + 1..count {
                    let Some(bc) = self.corner(b, c) else {
                        continue;
                    };
                    let Some(on_b) = self.side(b, ab, bc) else {
                        continue;
                    };
                    for d in a + 1..count {
                        let closed = || {
                            let (cd, da) = (self.corner(c, d)?, self.corner(d, a)?);
                            let sides = [
                                self.side(a, da, ab)?,
                                on_b,
                                self.side(c, bc, cd)?,
                                self.side(d, cd, da)?,
                            ];
                            self.quad([da, ab, bc, cd], &sides, [a, b, c, d])
                        };
                        quads.extend(closed());
                    }
                }
            }
        }
    }

    /// Returns the direction along a line that has the inside on its right in the image.
    fn direction(&self, line: usize) -> [f64; 2] {
        let tangent = self.lines[line].tangent();
        if self.inside_is_brighter {
            tangent
        } else {
            tangent.map(|c| -c)
        }
    }

    /// Returns the corner between a side and the next.
    fn corner(&self, line: usize, next: usize) -> Option<[f64; 2]> {
        let ([ax, ay], [bx, by]) = (self.direction(line), self.direction(next));
        if ax * by - ay * bx < MIN_TURN_SINE {
            return None;
        }
        let corner = self.lines[line].meets(&self.lines[next])?;
        let margin_px = MAX_OUTSIDE_FRACTION * self.size_px[0].max(self.size_px[1]);
        let is_near = |c: usize| (-margin_px..=self.size_px[c] + margin_px).contains(&corner[c]);
        (is_near(0) && is_near(1)).then_some(corner)
    }

    /// Returns the side of a line between two corners; `None` if it is short, reversed, or has too few edges.
    fn side(&self, line: usize, from: [f64; 2], to: [f64; 2]) -> Option<Side> {
        let step = [to[0] - from[0], to[1] - from[1]];
        let length_px = dot(self.direction(line), step);
        if length_px < MIN_SIDE_FRACTION * self.size_px[0].min(self.size_px[1]) {
            return None;
        }
        // Edges are only expected inside the image.
        let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
        for c in 0..2 {
            if step[c] != 0.0 {
                let [a, b] =
                    [0.0, self.size_px[c] - 1.0].map(|border| (border - from[c]) / step[c]);
                enters = enters.max(a.min(b));
                leaves = leaves.min(a.max(b));
            }
        }
        let visible_fraction = (leaves - enters).max(0.0);
        let line = &self.lines[line];
        let [p, q] = [enters, leaves].map(|t| line.along([0, 1].map(|c| from[c] + t * step[c])));
        let (support, gradient) = line.support(p.min(q), p.max(q));
        (support >= MIN_SUPPORT).then_some(Side {
            support: support.min(1.0),
            gradient,
            length_px,
            visible_fraction,
        })
    }

    /// Returns the quadrilateral with these corners, clockwise as seen in the image, and the sides that start at them.
    fn quad(
        &self,
        [a, b, c, d]: [[f64; 2]; 4],
        sides: &[Side; 4],
        lines: [usize; 4],
    ) -> Option<Quad> {
        let of = |value: fn(&Side) -> f64| [0, 1, 2, 3].map(|i| value(&sides[i]));
        let least = |values: [f64; 4]| values.into_iter().fold(f64::INFINITY, f64::min);
        let support = of(|s| s.support);
        if support.iter().sum::<f64>() < 4.0 * MIN_MEAN_SUPPORT {
            return None;
        }
        let corners_px = [d, c, b, a];
        if !can_be_rectangle(corners_px, self.size_px) {
            return None;
        }
        let perimeter_px: f64 = of(|s| s.length_px).iter().sum();
        Some(Quad {
            corners_px,
            inside_is_brighter: self.inside_is_brighter,
            support: [2, 1, 0, 3].map(|i| support[i]),
            lines: [2, 1, 0, 3].map(|i| lines[i]),
            score: least(of(|s| s.gradient)) * perimeter_px.sqrt(),
            visible_fraction: least(of(|s| s.visible_fraction)),
        })
    }
}

/// Returns the other edge of a tape: the quadrilateral just outside or inside with edges of the opposite direction along
/// part of each side.
pub(super) fn other_edge(quad: &Quad, lines: &[Line]) -> Option<Quad> {
    let found = [-1.0, 1.0].map(|side| edge_beside(quad, lines, side));
    let support = |quad: &Quad| quad.support.iter().sum::<f64>();
    let better = |a: &Quad, b: &Quad| support(a).total_cmp(&support(b));
    found.into_iter().flatten().max_by(better)
}

/// Returns the other edge towards the brighter (1) or the darker side (-1) of this one.
fn edge_beside(quad: &Quad, lines: &[Line], side: f64) -> Option<Quad> {
    let reach_px = MAX_TAPE_FRACTION * quad.area_px2().sqrt();
    let beside = |i: usize| {
        let (line, ends) = (
            &lines[quad.lines[i]],
            [0, 1].map(|n| quad.corners_px[(i + n) % 4]),
        );
        let support = |other: &usize| {
            let other = &lines[*other];
            let [p, q] = ends.map(|end| other.along(end));
            other.support(p.min(q), p.max(q)).0.min(1.0)
        };
        let is_beside = |other: &usize| {
            let other = &lines[*other];
            let near = |end: [f64; 2]| {
                // The normals are opposite: the other edge is on this one's brighter side if this corner is on the
                // other's.
                let distance_px = side * (dot(other.normal, end) - other.offset_px);
                (MIN_TAPE_PX..=reach_px).contains(&distance_px)
            };
            dot(line.normal, other.normal) < 0.0
                && dot(line.tangent(), other.normal).abs() <= MAX_TAPE_SINE
                && ends.into_iter().all(near)
        };
        let candidates = (0..lines.len()).filter(is_beside).map(|n| (n, support(&n)));
        let best = candidates.max_by(|a, b| a.1.total_cmp(&b.1));
        best.filter(|(_, support)| *support >= MIN_OTHER_SUPPORT)
    };
    let sides = [beside(0)?, beside(1)?, beside(2)?, beside(3)?];
    if sides.iter().map(|s| s.1).sum::<f64>() < 4.0 * MIN_OTHER_MEAN_SUPPORT {
        return None;
    }
    let corner = |i: usize| lines[sides[(i + 3) % 4].0].meets(&lines[sides[i].0]);
    Some(Quad {
        corners_px: [corner(0)?, corner(1)?, corner(2)?, corner(3)?],
        inside_is_brighter: !quad.inside_is_brighter,
        support: sides.map(|s| s.1),
        lines: sides.map(|s| s.0),
        ..*quad
    })
}

/// Reports whether the corners are right angles for a lens of some common focal length with its axis through the image's
/// centre (Zhang and He 2007, "Whiteboard scanning", section 3).
fn can_be_rectangle(corners_px: [[f64; 2]; 4], size_px: [f64; 2]) -> bool {
    let unit_px = size_px[0].max(size_px[1]);
    let [p, q, r, s] = corners_px.map(|[u, v]| {
        let [u, v] = [u - 0.5 * size_px[0], v - 0.5 * size_px[1]].map(|c| c / unit_px);
        Vector3::new(u, v, 1.0)
    });
    // Opposite sides meet at the vanishing points of the rectangle's axes.
    let along = p.cross(&q).cross(&s.cross(&r));
    let across = p.cross(&s).cross(&q.cross(&r));
    FOCAL_LENGTHS.iter().any(|f| {
        let scale = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, *f));
        let (a, b) = (scale * along, scale * across);
        a.dot(&b).abs() <= MAX_CORNER_COSINE * a.norm() * b.norm()
    })
}
