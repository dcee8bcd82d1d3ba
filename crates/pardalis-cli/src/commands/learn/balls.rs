//! The labelled balls of an image, as circles.

use std::fmt;

/// Parts with fewer pixels are taken as round, because too few pixels show no shape. Hand-set: a radius of 5 px.
const MIN_JUDGED_PX: usize = 80;
/// The minimum share of a round part within the ellipse that has its area and second moments. Hand-set: 0.95 and more for
/// polygons of eight corners along a circle, at most 0.94 for quadrilaterals.
const MIN_ROUND_SHARE: f64 = 0.945;
/// The minimum ratio of the axes of that ellipse. Hand-set: a ball near the border of a wide image has 0.7.
const MIN_AXES_RATIO: f64 = 0.6;

/// A circle in an image, pixel centres at integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Circle {
    pub(super) center_px: [f64; 2],
    pub(super) radius_px: f64,
}

impl Circle {
    /// Returns the circle with the centroid and the area of a closed polygon; `None` if it encloses nothing.
    pub(super) fn of_outline(corners: &[[f64; 2]]) -> Option<Self> {
        let (mut area, mut moment) = (0.0, [0.0; 2]);
        let next = corners.iter().cycle().skip(1);
        for ([u, v], [next_u, next_v]) in corners.iter().zip(next) {
            let cross = 0.5 * (u * next_v - next_u * v);
            area += cross;
            moment[0] += cross * (u + next_u) / 3.0;
            moment[1] += cross * (v + next_v) / 3.0;
        }
        (area != 0.0).then(|| Self {
            center_px: moment.map(|sum| sum / area),
            radius_px: (area.abs() / std::f64::consts::PI).sqrt(),
        })
    }

    /// Returns the distance of the other circle's centre from this one's, in radii of this one.
    pub(super) fn radii_to(&self, other: &Self) -> f64 {
        let [u, v] = [0, 1].map(|axis| other.center_px[axis] - self.center_px[axis]);
        libm::hypot(u, v) / self.radius_px
    }
}

impl fmt::Display for Circle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [u, v] = self.center_px;
        write!(f, "{u:7.1} {v:7.1} {:6.1}", self.radius_px)
    }
}

/// Returns the connected parts of the labelled pixels (row by row) that are round and clear of the image's border, the
/// largest first, as circles of their area.
pub(super) fn labelled_balls(is_target: &[bool], width: usize) -> Vec<Circle> {
    let height = is_target.len() / width;
    let mut balls: Vec<Circle> = parts(is_target, width)
        .iter()
        .filter(|part| {
            let is_inside =
                |&(x, y): &(usize, usize)| x > 0 && y > 0 && x + 1 < width && y + 1 < height;
            part.iter().all(is_inside)
        })
        .filter_map(|part| circle_of(part))
        .collect();
    balls.sort_by(|a, b| b.radius_px.total_cmp(&a.radius_px));
    balls
}

/// Returns the pixels of each connected part.
fn parts(is_target: &[bool], width: usize) -> Vec<Vec<(usize, usize)>> {
    let mut is_left = is_target.to_vec();
    let mut parts = Vec::new();
    for first in 0..is_left.len() {
        if !is_left[first] {
            continue;
        }
        is_left[first] = false;
        let (mut part, mut next) = (Vec::new(), vec![first]);
        while let Some(index) = next.pop() {
            let (x, y) = (index % width, index / width);
            part.push((x, y));
            let neighbours = [
                (x > 0).then(|| index - 1),
                (x + 1 < width).then_some(index + 1),
                (y > 0).then(|| index - width),
                (index + width < is_left.len()).then_some(index + width),
            ];
            for neighbour in neighbours.into_iter().flatten() {
                if std::mem::take(&mut is_left[neighbour]) {
                    next.push(neighbour);
                }
            }
        }
        parts.push(part);
    }
    parts
}

/// Returns the circle with the centre and area of pixels, whatever their shape.
fn circle_of_area(part: &[(usize, usize)]) -> Circle {
    Circle {
        center_px: [mean(part, &|x, _| x), mean(part, &|_, y| y)],
        radius_px: (part.len() as f64 / std::f64::consts::PI).sqrt(),
    }
}

fn mean(part: &[(usize, usize)], value: &dyn Fn(f64, f64) -> f64) -> f64 {
    let sum: f64 = part.iter().map(|&(x, y)| value(x as f64, y as f64)).sum();
    sum / part.len() as f64
}

/// Returns the circle of the pixels' area if they are round: nearly all lie within the ellipse that has their area and
/// second moments.
fn circle_of(part: &[(usize, usize)]) -> Option<Circle> {
    let area = part.len() as f64;
    let mean = |value: &dyn Fn(f64, f64) -> f64| mean(part, value);
    let circle = circle_of_area(part);
    if part.len() < MIN_JUDGED_PX {
        return Some(circle);
    }
    let [u, v] = circle.center_px;
    // Pixels are squares, not points: their own second moment is 1/12.
    let xx = mean(&|x, _| (x - u).powi(2)) + 1.0 / 12.0;
    let yy = mean(&|_, y| (y - v).powi(2)) + 1.0 / 12.0;
    let xy = mean(&|x, y| (x - u) * (y - v));
    let determinant = xx * yy - xy * xy;
    let scale = area / (std::f64::consts::PI * determinant.sqrt());
    let inside = mean(&|x, y| {
        let (x, y) = (x - u, y - v);
        let squared = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant;
        f64::from(u8::from(squared <= scale))
    });
    let (half_trace, half_spread) = (0.5 * (xx + yy), libm::hypot(0.5 * (xx - yy), xy));
    let axes_ratio = ((half_trace - half_spread) / (half_trace + half_spread)).sqrt();
    (inside >= MIN_ROUND_SHARE && axes_ratio >= MIN_AXES_RATIO).then_some(circle)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 80;

    fn labels(is_target: impl Fn(f64, f64) -> bool) -> Vec<bool> {
        let pixel = |i: usize| is_target((i % WIDTH) as f64, (i / WIDTH) as f64);
        (0..WIDTH * 60).map(pixel).collect()
    }

    fn disc(x: f64, y: f64, [u, v, radius]: [f64; 3]) -> bool {
        (x - u).hypot(y - v) < radius
    }

    #[test]
    fn discs_of_all_sizes_are_balls_with_their_centre_and_radius() {
        for radius in [2.5, 4.0, 7.3, 12.0, 25.0] {
            let balls = labelled_balls(&labels(|x, y| disc(x, y, [30.4, 29.7, radius])), WIDTH);
            let [ball] = balls[..] else {
                panic!("{radius}: {balls:?}")
            };
            let [u, v] = ball.center_px;
            assert!((u - 30.4).abs() < 0.3 && (v - 29.7).abs() < 0.3, "{ball:?}");
            assert!((ball.radius_px - radius).abs() < 0.3, "{ball:?}");
        }
    }

    #[test]
    fn every_ball_is_listed_the_largest_first() {
        let both = labels(|x, y| disc(x, y, [12.0, 12.0, 6.0]) || disc(x, y, [50.0, 30.0, 14.0]));
        let radii: Vec<f64> = labelled_balls(&both, WIDTH)
            .iter()
            .map(|ball| ball.radius_px.round())
            .collect();
        assert_eq!(radii, [14.0, 6.0]);
    }

    #[test]
    fn ellipses_and_rough_polygons_are_balls() {
        let ellipse = labels(|x, y| disc(x, 1.4 * y, [40.0, 42.0, 16.0]));
        assert_eq!(labelled_balls(&ellipse, WIDTH).len(), 1);
        let octagon = labels(|x, y| {
            let [x, y] = [(x - 40.3).abs(), (y - 30.2).abs()];
            x.max(y) < 12.0 && x + y < 17.0
        });
        assert_eq!(labelled_balls(&octagon, WIDTH).len(), 1);
    }

    #[test]
    fn other_shapes_and_balls_at_the_border_are_not() {
        let square = |x: f64, y: f64| (20.0..32.0).contains(&x) && (20.0..32.0).contains(&y);
        let rectangle = |x: f64, y: f64| (20.0..60.0).contains(&x) && (20.0..32.0).contains(&y);
        let diamond = |x: f64, y: f64| (x - 30.0).abs() + (y - 30.0).abs() < 14.0;
        let stripe = |x: f64, y: f64| disc(x, 3.0 * y, [40.0, 90.0, 24.0]);
        let cut = |x: f64, y: f64| disc(x, y, [3.0, 30.0, 12.0]);
        let half = |x: f64, y: f64| disc(x, y, [40.0, 30.0, 14.0]) && x < 40.0;
        let shapes: [&dyn Fn(f64, f64) -> bool; 7] = [
            &square,
            &rectangle,
            &diamond,
            &stripe,
            &cut,
            &half,
            &|_, _| false,
        ];
        for (number, shape) in shapes.iter().enumerate() {
            let found = labelled_balls(&labels(shape), WIDTH);
            assert_eq!(found, [], "shape {number}");
        }
    }

    #[test]
    fn the_circle_of_an_outline_has_its_centroid_and_area() {
        let point = |i: i32| {
            let (sin, cos) = (f64::from(i) * 0.1).sin_cos();
            [100.0 + 5.0 * cos, -20.0 + 5.0 * sin]
        };
        let circle = Circle::of_outline(&(0..63).map(point).collect::<Vec<_>>()).unwrap();
        assert!((circle.center_px[0] - 100.0).abs() < 0.02, "{circle:?}");
        assert!((circle.center_px[1] + 20.0).abs() < 0.02, "{circle:?}");
        assert!((circle.radius_px - 5.0).abs() < 0.02, "{circle:?}");
        assert_eq!(Circle::of_outline(&[[1.0, 1.0], [5.0, 5.0]]), None);
        assert_eq!(Circle::of_outline(&[]), None);
    }
}
