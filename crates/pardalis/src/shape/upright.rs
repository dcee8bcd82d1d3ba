//! Upright bodies: vertical cylinders, prisms and boxes, and their outlines seen from a point.

use serde::{Deserialize, Serialize};

use super::Stance;
use super::flat::period_of_rectangle_rad;
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Maximum width and height in metres.
const MAX_SIZE_M: f64 = 1000.0;

/// The horizontal cross-section of a body, the same at every height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Section {
    /// A circle: the body is a cylinder.
    Circle {
        /// Radius in metres.
        radius_m: f64,
    },
    /// A regular polygon: the body is a prism.
    Polygon {
        /// Number of sides.
        sides: usize,
        /// Distance of the sides from the axis in metres.
        apothem_m: f64,
        /// Angle of a corner from the world's x axis, counterclockwise as seen from above, in full turns.
        turn: f64,
    },
    /// A rectangle with sides parallel to the world's x and y axes, unless it is turned: the body is a box.
    Rectangle {
        /// Sizes along x and y in metres.
        size_m: [f64; 2],
    },
}

impl Section {
    /// The default number of a polygon's sides.
    pub const DEFAULT_SIDES: usize = 8;

    /// Creates a circle.
    ///
    /// # Errors
    ///
    /// The diameter is not above 0 and at most 1000 m.
    pub fn circle(radius_m: f64) -> Result<Self, Error> {
        check_size("radius_m", radius_m)?;
        Ok(Self::Circle { radius_m })
    }

    /// Creates a regular polygon from the distance between opposite sides (twice the distance of the sides
    /// from the axis), with a corner at `turn_rad` from the world's x axis.
    ///
    /// # Errors
    ///
    /// There are fewer than 3 or more than 100 sides, the width is not above 0 and at most 1000 m, or the
    /// turn exceeds a full turn.
    pub fn polygon(sides: usize, across_flats_m: f64, turn_rad: f64) -> Result<Self, Error> {
        check_size("across_flats_m", across_flats_m)?;
        if !(3..=100).contains(&sides) {
            return Err(Error::out_of_range("sides", sides, "3 to 100"));
        }
        if !(turn_rad.abs() <= std::f64::consts::TAU) {
            return Err(Error::out_of_range(
                "turn",
                turn_rad,
                "within one full turn",
            ));
        }
        Ok(Self::Polygon {
            sides,
            apothem_m: 0.5 * across_flats_m,
            turn: turn_rad / std::f64::consts::TAU,
        })
    }

    /// Creates a rectangle from its sizes along x and y.
    ///
    /// # Errors
    ///
    /// A size is not above 0 and at most 1000 m.
    pub fn rectangle(size_m: [f64; 2]) -> Result<Self, Error> {
        for size_m in size_m {
            check_size("size_m", size_m)?;
        }
        Ok(Self::Rectangle { size_m })
    }

    /// Returns the greatest distance from the axis in metres.
    fn circumradius_m(&self) -> f64 {
        match *self {
            Self::Circle { radius_m } => radius_m,
            Self::Polygon {
                sides, apothem_m, ..
            } => apothem_m / libm::cos(std::f64::consts::PI / sides as f64),
            Self::Rectangle { size_m: [x, y] } => 0.5 * libm::hypot(x, y),
        }
    }

    /// Returns half the width seen from far away, averaged over all directions, in metres: perimeter/2π
    /// (Cauchy).
    fn mean_half_width_m(&self) -> f64 {
        match *self {
            Self::Circle { radius_m } => radius_m,
            Self::Polygon {
                sides, apothem_m, ..
            } => {
                let half_angle = std::f64::consts::PI / sides as f64;
                apothem_m * libm::tan(half_angle) / half_angle
            }
            Self::Rectangle { size_m: [x, y] } => (x + y) / std::f64::consts::PI,
        }
    }
}

/// The line that is used as the outline of an upright body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UprightOutline {
    /// Where rays from the camera touch the body: the exact outline.
    #[default]
    Exact,
    /// A rectangle in the plane through the axis that faces the camera, with the mean width of the body
    /// (Taiana 2007, section 4.2 and figure 4.4).
    Facing,
}

/// An upright body. Its position is the centre of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upright {
    /// Horizontal cross-section.
    pub section: Section,
    /// Height in metres.
    pub height_m: f64,
    /// The line used as the outline.
    pub outline: UprightOutline,
}

impl Upright {
    /// Creates a body.
    ///
    /// # Errors
    ///
    /// The height is not above 0 and at most 1000 m.
    pub fn new(section: Section, height_m: f64, outline: UprightOutline) -> Result<Self, Error> {
        check_size("height_m", height_m)?;
        Ok(Self {
            section,
            height_m,
            outline,
        })
    }

    /// Returns the least angle after which the outline looks the same again; `None` for a cylinder, and for an outline that always faces the camera.
    pub(super) fn turn_period_rad(&self) -> Option<f64> {
        match (self.outline, self.section) {
            (UprightOutline::Facing, _) | (_, Section::Circle { .. }) => None,
            (UprightOutline::Exact, Section::Polygon { sides, .. }) => {
                Some(std::f64::consts::TAU / sides as f64)
            }
            (UprightOutline::Exact, Section::Rectangle { size_m }) => {
                Some(period_of_rectangle_rad(size_m))
            }
        }
    }

    /// Returns the largest horizontal width in metres.
    pub fn width_m(&self) -> f64 {
        2.0 * self.section.circumradius_m()
    }

    /// Returns `count` points on the outline, which runs over the top, down one side, back along the base and
    /// up the other side. They are evenly spaced along a rectangle of the body's width and height.
    pub(crate) fn outline_points<R: Real>(&self, count: usize) -> Vec<OutlinePoint<R>> {
        let (width, height) = (2.0 * self.section.mean_half_width_m(), self.height_m);
        let perimeter = 2.0 * (width + height);
        (0..count)
            .map(|k| {
                let around = (k as f64 + 0.5) / count as f64;
                let mut rest = around * perimeter;
                let mut outline_point = [0.0; 5];
                if rest < width {
                    let share = rest / width;
                    outline_point = [1.0, share, 0.0, 1.0, 1.0 - 2.0 * share];
                } else if rest < width + height {
                    rest -= width;
                    outline_point[3] = 1.0 - rest / height;
                    outline_point[4] = -1.0;
                } else if rest < 2.0 * width + height {
                    let share = (rest - width - height) / width;
                    outline_point[2] = share;
                    outline_point[4] = 2.0 * share - 1.0;
                } else {
                    rest -= 2.0 * width + height;
                    outline_point = [1.0, 0.0, 0.0, rest / height, 1.0];
                }
                let [visible_side, along_top, along_base, height, across] =
                    outline_point.map(R::of);
                OutlinePoint {
                    visible_side,
                    along_top,
                    along_base,
                    height,
                    across,
                    around: R::of(around),
                }
            })
            .collect()
    }

    /// Returns the parameters of the section in a stance that kernels need.
    pub(crate) fn sides<R: Real>(&self, stance: Stance) -> Sides<R> {
        let scale = stance.scale;
        let (kind, inradius_m) = match (self.outline, self.section) {
            (UprightOutline::Facing, section) => (SidesKind::Flat, section.mean_half_width_m()),
            (UprightOutline::Exact, Section::Circle { radius_m }) => (SidesKind::Round, radius_m),
            (
                UprightOutline::Exact,
                Section::Polygon {
                    sides,
                    apothem_m,
                    turn,
                },
            ) => {
                let count = sides as f64;
                let half_side = libm::tan(std::f64::consts::PI / count);
                let kind = SidesKind::Corners {
                    count: R::of(count),
                    turn: R::of(turn + stance.yaw_rad * IN_TURNS),
                    half_side: R::of(half_side),
                };
                (kind, apothem_m)
            }
            (UprightOutline::Exact, Section::Rectangle { size_m }) => {
                let (sin, cos) = libm::sincos(stance.yaw_rad);
                let kind = SidesKind::Rectangle {
                    half_m: size_m.map(|size_m| R::of(0.5 * scale * size_m)),
                    ahead: [R::of(cos), R::of(sin)],
                };
                (kind, 0.5 * size_m[0].min(size_m[1]))
            }
        };
        let half_height = 0.5 * scale * self.height_m;
        Sides {
            kind,
            inradius_m: R::of(scale * inradius_m),
            base_m: R::of(0.5 * self.height_m - half_height),
            top_m: R::of(0.5 * self.height_m + half_height),
        }
    }
}

fn check_size(name: &str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value <= MAX_SIZE_M {
        return Ok(());
    }
    Err(Error::out_of_range(name, value, "above 0 and at most 1000"))
}

/// A point on the outline, as fractions of the quantities in [`VisibleBody`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutlinePoint<R> {
    /// Fraction of the turn around the visible side.
    visible_side: R,
    /// Fraction of the outline of the top.
    along_top: R,
    /// Fraction of the outline of the base.
    along_base: R,
    /// Fraction of the height.
    height: R,
    /// Position across the plane that faces the viewpoint, from −1 to 1.
    across: R,
    /// Fraction of the whole outline.
    around: R,
}

/// The sides of a body, scaled about its centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sides<R> {
    kind: SidesKind<R>,
    /// Distance of the sides from the axis, or half the width of the rectangle that faces the viewpoint.
    inradius_m: R,
    /// Heights of base and top above the position.
    base_m: R,
    top_m: R,
}

/// The form of the sides.
#[derive(Debug, Clone, Copy)]
pub(crate) enum SidesKind<R> {
    Round,
    Corners {
        count: R,
        /// Angle of a corner in full turns.
        turn: R,
        /// Half the length of a side for an inradius of 1.
        half_side: R,
    },
    Rectangle {
        /// Half the sizes along its own x and y axes, metres.
        half_m: [R; 2],
        /// The direction of its x axis.
        ahead: [R; 2],
    },
    Flat,
}

/// A body as seen from one viewpoint. Positions around it are in full turns, in corners of a polygon, or in metres along the sides of a rectangle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VisibleBody<R> {
    axis: [R; 2],
    base: R,
    height: R,
    /// Start and extent of the visible side; for the flat outline, the direction across in metres.
    first: R,
    seen: R,
    /// Extents of the outlines of the top and of the base, from the ends of the visible side: along the near
    /// rim or around the far one.
    top_extent: R,
    base_extent: R,
    /// 1 if only the top or only the base is visible, from above or below; then all points lie around it. 0
    /// otherwise.
    whole: R,
}

impl<R: Real> Sides<R> {
    /// Computes the view of a body at `position` from `viewpoint`, both in the world, and whether it has an
    /// outline: there is none from inside. Branches depend only on quantities that all particles share.
    #[inline(always)]
    pub(crate) fn seen_from(&self, position: [R; 3], viewpoint: [R; 3]) -> (VisibleBody<R>, bool) {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let (dx, dy) = (viewpoint[0] - position[0], viewpoint[1] - position[1]);
        let distance2 = dx * dx + dy * dy;
        let (base, top) = (position[2] + self.base_m, position[2] + self.top_m);
        let (over, under) = (viewpoint[2] > top, viewpoint[2] < base);
        let inradius2 = self.inradius_m * self.inradius_m;
        let mut seen = VisibleBody {
            axis: [position[0], position[1]],
            base,
            height: top - base,
            ..VisibleBody::zero()
        };
        let beside = match self.kind {
            SidesKind::Flat => {
                let ok = distance2 > zero;
                let scale = self.inradius_m / (if ok { distance2 } else { one }).sqrt();
                seen.first = -dy * scale;
                seen.seen = dx * scale;
                return (seen, ok);
            }
            SidesKind::Round => {
                let beside = distance2 > inradius2;
                let tangent = if beside { distance2 - inradius2 } else { zero };
                let half = tangent.sqrt().atan2(self.inradius_m) * R::of(IN_TURNS);
                let bearing = dy.atan2(dx) * R::of(IN_TURNS);
                seen.first = bearing - half;
                seen.seen = half + half;
                beside
            }
            SidesKind::Corners { count, turn, .. } => {
                let outer = if distance2 > inradius2 {
                    distance2 - inradius2
                } else {
                    zero
                };
                // Sides are visible if their normals lie within this angle of the bearing.
                let half = outer.sqrt().atan2(self.inradius_m) * R::of(IN_TURNS) * count;
                let bearing = (dy.atan2(dx) * R::of(IN_TURNS) - turn) * count - R::of(0.5);
                let first = -(half - bearing).floor();
                let last = (bearing + half).floor();
                seen.first = first;
                seen.seen = last + one - first;
                (distance2 > inradius2) & (last >= first)
            }
            SidesKind::Rectangle { half_m, ahead } => {
                let [half_x, half_y] = half_m;
                let (x, y) = (ahead[0] * dx + ahead[1] * dy, ahead[0] * dy - ahead[1] * dx);
                let (front, left) = (x > half_x, y > half_y);
                let (rear, right) = (x < -half_x, y < -half_y);
                let [depth, width] = [half_x + half_x, half_y + half_y];
                // The right end of the front is at 0, then the sides follow counterclockwise.
                let on_right = if right { zero - depth } else { zero };
                let behind = if rear { width + depth } else { zero - depth };
                let beside_front = if left { width } else { behind };
                seen.first = if front { on_right } else { beside_front };
                let along_x = if left | right { depth } else { zero };
                let along_y = if front | rear { width } else { zero };
                seen.seen = along_x + along_y;
                front | left | rear | right
            }
        };
        let period = self.period();
        let far = period - seen.seen;
        seen.top_extent = if over { far } else { -seen.seen };
        seen.base_extent = if under { -far } else { seen.seen };
        if !beside {
            seen.whole = one;
            seen.base = if over { top } else { base };
        }
        (seen, beside | over | under)
    }

    pub(crate) fn kind(&self) -> &SidesKind<R> {
        &self.kind
    }

    /// Returns the period of positions around the body.
    fn period(&self) -> R {
        match self.kind {
            SidesKind::Corners { count, .. } => count,
            SidesKind::Rectangle {
                half_m: [half_x, half_y],
                ..
            } => R::of(4.0) * (half_x + half_y),
            SidesKind::Round | SidesKind::Flat => R::of(1.0),
        }
    }

    /// Returns a point of the outline in the world, in metres. Kernels call [`Self::round`] and its
    /// counterparts directly.
    pub(crate) fn point(&self, seen: &VisibleBody<R>, outline_point: &OutlinePoint<R>) -> [R; 3] {
        match self.kind {
            SidesKind::Round => self.round(seen, outline_point),
            SidesKind::Corners { .. } => self.cornered(seen, outline_point),
            SidesKind::Rectangle { .. } => self.rectangular(seen, outline_point),
            SidesKind::Flat => Self::flat(seen, outline_point),
        }
    }

    /// Returns a point of the outline of a cylinder.
    #[inline(always)]
    pub(crate) fn round(&self, seen: &VisibleBody<R>, outline_point: &OutlinePoint<R>) -> [R; 3] {
        let (sin, cos) = seen.around(outline_point, R::of(1.0)).sin_cos_turns();
        seen.at(
            outline_point,
            [self.inradius_m * cos, self.inradius_m * sin],
        )
    }

    /// Returns a point of the outline of a prism.
    #[inline(always)]
    pub(crate) fn cornered(
        &self,
        seen: &VisibleBody<R>,
        outline_point: &OutlinePoint<R>,
    ) -> [R; 3] {
        let SidesKind::Corners {
            count,
            turn,
            half_side,
        } = self.kind
        else {
            return seen.at(outline_point, [R::of(f64::NAN); 2]);
        };
        let around = seen.around(outline_point, count);
        let corner = around.floor();
        let (sin, cos) = ((corner + R::of(0.5)) / count + turn).sin_cos_turns();
        let along = (R::of(2.0) * (around - corner) - R::of(1.0)) * half_side;
        let offset = [
            self.inradius_m * (cos - along * sin),
            self.inradius_m * (sin + along * cos),
        ];
        seen.at(outline_point, offset)
    }

    /// Returns a point of the outline of a box.
    #[inline(always)]
    pub(crate) fn rectangular(
        &self,
        seen: &VisibleBody<R>,
        outline_point: &OutlinePoint<R>,
    ) -> [R; 3] {
        let SidesKind::Rectangle {
            half_m: [half_x, half_y],
            ahead: [cos, sin],
        } = self.kind
        else {
            return seen.at(outline_point, [R::of(f64::NAN); 2]);
        };
        let (width, depth) = (half_y + half_y, half_x + half_x);
        let half = width + depth;
        let period = half + half;
        let around = seen.around(outline_point, period);
        let around = around - (around / period).floor() * period;
        // The rear half is the front half turned by half a turn.
        let is_rear = around >= half;
        let along = if is_rear { around - half } else { around };
        let is_front = along < width;
        let x = if is_front {
            half_x
        } else {
            half_x - (along - width)
        };
        let y = if is_front { along - half_y } else { half_y };
        let sign = if is_rear { R::of(-1.0) } else { R::of(1.0) };
        let (x, y) = (sign * x, sign * y);
        seen.at(outline_point, [cos * x - sin * y, sin * x + cos * y])
    }

    /// Returns a point of the rectangle that faces the viewpoint.
    #[inline(always)]
    pub(crate) fn flat(seen: &VisibleBody<R>, outline_point: &OutlinePoint<R>) -> [R; 3] {
        seen.at(
            outline_point,
            [
                seen.first * outline_point.across,
                seen.seen * outline_point.across,
            ],
        )
    }
}

impl<R: Real> VisibleBody<R> {
    /// The number of fields, for kernels that store them as columns.
    pub(crate) const FIELDS: usize = 9;

    fn zero() -> Self {
        Self::of_fields([R::of(0.0); 9])
    }

    /// Returns the position around the body of a point of its outline.
    #[inline(always)]
    fn around(&self, outline_point: &OutlinePoint<R>, period: R) -> R {
        let beside = R::of(1.0) - self.whole;
        beside
            * (self.first
                + outline_point.visible_side * self.seen
                + outline_point.along_top * self.top_extent
                + outline_point.along_base * self.base_extent)
            + self.whole * outline_point.around * period
    }

    /// Returns the point at an offset from the axis.
    #[inline(always)]
    fn at(&self, outline_point: &OutlinePoint<R>, [x, y]: [R; 2]) -> [R; 3] {
        let beside = R::of(1.0) - self.whole;
        let z = self.base + outline_point.height * self.height * beside;
        [self.axis[0] + x, self.axis[1] + y, z]
    }

    #[inline(always)]
    pub(crate) fn to_fields(self) -> [R; 9] {
        let [x, y] = self.axis;
        let Self {
            base,
            height,
            first,
            seen,
            top_extent,
            base_extent,
            whole,
            ..
        } = self;
        [
            x,
            y,
            base,
            height,
            first,
            seen,
            top_extent,
            base_extent,
            whole,
        ]
    }

    #[inline(always)]
    pub(crate) fn of_fields(fields: [R; 9]) -> Self {
        let [
            x,
            y,
            base,
            height,
            first,
            seen,
            top_extent,
            base_extent,
            whole,
        ] = fields;
        Self {
            axis: [x, y],
            base,
            height,
            first,
            seen,
            top_extent,
            base_extent,
            whole,
        }
    }
}

const IN_TURNS: f64 = 1.0 / std::f64::consts::TAU;

#[cfg(test)]
mod tests;
