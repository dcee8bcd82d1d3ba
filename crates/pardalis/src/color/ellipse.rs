//! Ellipses in an image: the outlines of balls and discs.

/// An ellipse in an image, pixel centres at integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipse {
    center_px: [f64; 2],
    /// The entries xx, xy and yy of the matrix S, square pixels: pᵀS⁻¹p = 1 for points p of the outline, relative to the centre.
    shape_px2: [f64; 3],
}

/// A small change of an ellipse: the shift of its centre in pixels, then the entries xx, yy and xy of a symmetric matrix E. The
/// points p of its outline, relative to its centre, become p + Ep.
pub(super) type Change = [f64; 5];

impl Ellipse {
    /// Returns the upright ellipse with these semi-axes along x and y, which are positive.
    pub(super) fn upright(center_px: [f64; 2], [along_x, along_y]: [f64; 2]) -> Self {
        Self {
            center_px,
            shape_px2: [along_x * along_x, 0.0, along_y * along_y],
        }
    }

    /// Returns the ellipse with the centroid and the second moments of a part, whose pixels are given by column and row.
    pub(super) fn of_part(part: &[(usize, usize)]) -> Self {
        let count = part.len() as f64;
        let mean = |value: &dyn Fn(f64, f64) -> f64| {
            let sum: f64 = part.iter().map(|&(x, y)| value(x as f64, y as f64)).sum();
            sum / count
        };
        let [u, v] = [mean(&|x, _| x), mean(&|_, y| y)];
        // Sums over pixel centres equal those over the area, averaged over the subpixel position. The variance of an ellipse's
        // area along a semi-axis r is r²/4.
        Self {
            center_px: [u, v],
            shape_px2: [
                4.0 * mean(&|x, _| (x - u) * (x - u)),
                4.0 * mean(&|x, y| (x - u) * (y - v)),
                4.0 * mean(&|_, y| (y - v) * (y - v)),
            ],
        }
    }

    /// Returns its centre, pixels.
    pub fn center_px(&self) -> [f64; 2] {
        self.center_px
    }

    /// Returns the radius of the circle of its area, pixels.
    pub fn radius_px(&self) -> f64 {
        self.determinant().sqrt().sqrt()
    }

    /// Returns the ratio of the shorter axis to the longer one.
    pub fn axes_ratio(&self) -> f64 {
        let [shorter, longer] = self.semi_axes_px();
        shorter / longer
    }

    /// Returns points of its outline at equal parts of the turn, pixels.
    pub fn outline_px(&self, count: usize) -> Vec<[f64; 2]> {
        let point = |i| {
            let [x, y] = self.offset(std::f64::consts::TAU * i as f64 / count as f64);
            [self.center_px[0] + x, self.center_px[1] + y]
        };
        (0..count).map(point).collect()
    }

    fn determinant(&self) -> f64 {
        let [xx, xy, yy] = self.shape_px2;
        xx * yy - xy * xy
    }

    /// Returns the semi-axes, the shorter one first, pixels.
    pub(super) fn semi_axes_px(&self) -> [f64; 2] {
        let [xx, xy, yy] = self.shape_px2;
        let (middle, spread) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        [middle - spread, middle + spread].map(|squared| squared.max(0.0).sqrt())
    }

    /// Returns the symmetric square root of S: entries xx, xy and yy.
    fn root(&self) -> [f64; 3] {
        let [xx, xy, yy] = self.shape_px2;
        let root = self.determinant().max(0.0).sqrt();
        let trace = (xx + yy + 2.0 * root).sqrt();
        [(xx + root) / trace, xy / trace, (yy + root) / trace]
    }

    /// Returns a point of the outline, relative to the centre. The angle is that on the circle of which the ellipse is the image
    /// under a symmetric map.
    pub(super) fn offset(&self, angle_rad: f64) -> [f64; 2] {
        let [xx, xy, yy] = self.root();
        let (sin, cos) = (libm::sin(angle_rad), libm::cos(angle_rad));
        [xx * cos + xy * sin, xy * cos + yy * sin]
    }

    /// Returns the angle of a point in the sense of [`Self::offset`], radians.
    pub(super) fn angle_rad(&self, point: [f64; 2]) -> f64 {
        let [x, y] = self.relative(point);
        let [xx, xy, yy] = self.root();
        libm::atan2(xx * y - xy * x, yy * x - xy * y)
    }

    fn relative(&self, point: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| point[axis] - self.center_px[axis])
    }

    /// Returns S⁻¹p.
    fn gradient(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [xx, xy, yy] = self.shape_px2;
        let determinant = self.determinant();
        [yy * x - xy * y, xx * y - xy * x].map(|entry| entry / determinant)
    }

    /// Returns the unit normal, outwards, at a point of the outline relative to the centre.
    pub(super) fn normal(&self, offset: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.gradient(offset);
        let length = x.hypot(y);
        [x / length, y / length]
    }

    /// Returns the direction from the centre to a point as a share of a full turn from 0 to 1.
    pub(super) fn turn(&self, point: [f64; 2]) -> f32 {
        let [x, y] = self.relative(point);
        (libm::atan2(y, x) / std::f64::consts::TAU).rem_euclid(1.0) as f32
    }

    /// Returns the factor by which the ellipse must be scaled to pass through a point: 0 in its centre, 1 on its outline.
    pub(super) fn scale_at(&self, point: [f64; 2]) -> f64 {
        let p = self.relative(point);
        let [x, y] = self.gradient(p);
        (p[0] * x + p[1] * y).max(0.0).sqrt()
    }

    /// Computes the signed distance of a point in pixels to first order, which is exact for circles; negative inside.
    pub(super) fn distance_px(&self, point: [f64; 2]) -> f64 {
        let [x, y] = self.gradient(self.relative(point));
        let scale = self.scale_at(point);
        let distance = (scale - 1.0) * scale / x.hypot(y);
        let [deepest, _] = self.semi_axes_px();
        // The distance is undefined at the centre.
        if distance > -deepest {
            distance
        } else {
            -deepest
        }
    }

    /// Returns it scaled about its centre.
    #[must_use]
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self {
            center_px: self.center_px,
            shape_px2: self.shape_px2.map(|entry| factor * factor * entry),
        }
    }

    #[must_use]
    pub(super) fn changed(&self, [du, dv, xx, yy, xy]: Change) -> Self {
        let [a, b, c] = self.root();
        let (xx, yy) = (1.0 + xx, 1.0 + yy);
        // (I + E) S^½, times its transpose.
        let [top, bottom] = [
            [xx * a + xy * b, xx * b + xy * c],
            [xy * a + yy * b, xy * b + yy * c],
        ];
        let dot = |m: [f64; 2], n: [f64; 2]| m[0] * n[0] + m[1] * n[1];
        Self {
            center_px: [self.center_px[0] + du, self.center_px[1] + dv],
            shape_px2: [dot(top, top), dot(top, bottom), dot(bottom, bottom)],
        }
    }

    /// Returns it as it appears in an octave, an image whose pixels are squares of 2^octave pixels.
    #[must_use]
    pub(super) fn in_octave(&self, octave: usize) -> Self {
        let size = (1_usize << octave) as f64;
        Self {
            center_px: self.center_px.map(|c| (c + 0.5) / size - 0.5),
            shape_px2: self.shape_px2.map(|entry| entry / (size * size)),
        }
    }

    /// Returns the reverse of [`Self::in_octave`].
    #[must_use]
    pub(super) fn enlarged_from(&self, octave: usize) -> Self {
        let size = (1_usize << octave) as f64;
        Self {
            center_px: self.center_px.map(|c| (c + 0.5) * size - 0.5),
            shape_px2: self.shape_px2.map(|entry| entry * size * size),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slanted() -> Ellipse {
        Ellipse::upright([30.0, 20.0], [12.0, 7.0]).changed([0.5, -0.25, 0.05, -0.1, 0.2])
    }

    #[test]
    fn points_of_the_outline_have_scale_one_and_their_angle() {
        let ellipse = slanted();
        for i in 0..12 {
            let angle = 0.5 * f64::from(i) - 3.0;
            let [x, y] = ellipse.offset(angle);
            let [u, v] = ellipse.center_px();
            let point = [u + x, v + y];
            assert!((ellipse.scale_at(point) - 1.0).abs() < 1e-12);
            assert!(ellipse.distance_px(point).abs() < 1e-12);
            assert!((ellipse.angle_rad(point) - angle).abs() < 1e-12);
            let [nx, ny] = ellipse.normal([x, y]);
            let outside = ellipse.distance_px([point[0] + 0.1 * nx, point[1] + 0.1 * ny]);
            assert!((outside - 0.1).abs() < 2e-3, "{outside}");
        }
    }

    #[test]
    fn a_change_moves_the_points_of_the_outline_along_the_normal_as_stated() {
        let (ellipse, change) = (slanted(), [0.02, -0.01, 0.002, -0.001, 0.003]);
        let changed = ellipse.changed(change);
        for i in 0..12 {
            let [x, y] = ellipse.offset(0.5 * f64::from(i));
            let [nx, ny] = ellipse.normal([x, y]);
            let [du, dv, xx, yy, xy] = change;
            let moved = nx * (du + xx * x + xy * y) + ny * (dv + xy * x + yy * y);
            let [u, v] = ellipse.center_px();
            let distance = changed.distance_px([u + x, v + y]);
            assert!((distance + moved).abs() < 3e-4, "{distance} {moved}");
        }
    }

    #[test]
    fn moments_and_octaves_keep_an_ellipse() {
        let ellipse = slanted();
        let part: Vec<(usize, usize)> = (0..60 * 40)
            .map(|i| (i % 60, i / 60))
            .filter(|&(x, y)| ellipse.scale_at([x as f64, y as f64]) < 1.0)
            .collect();
        let found = Ellipse::of_part(&part);
        assert!((found.radius_px() - ellipse.radius_px()).abs() < 0.03);
        let back = ellipse.in_octave(2).enlarged_from(2);
        assert!((back.radius_px() - ellipse.radius_px()).abs() < 1e-12);
        assert!((ellipse.in_octave(1).radius_px() - 0.5 * ellipse.radius_px()).abs() < 1e-12);
    }
}
