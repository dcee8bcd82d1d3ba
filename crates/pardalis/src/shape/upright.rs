//! Upright bodies: a cylinder or prism whose axis is vertical in the world, and its outline seen from a point.

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::real::Real;

/// The largest width and height in metres.
const MAX_SIZE_M: f64 = 1000.0;

/// A body's horizontal section, the same at every height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Section {
    /// A circle: the body is a cylinder.
    Circle {
        /// Its radius in metres.
        radius_m: f64,
    },
    /// A regular polygon: the body is a prism.
    Polygon {
        /// Its number of sides.
        sides: usize,
        /// Distance of its sides from the axis in metres.
        apothem_m: f64,
        /// The angle of a corner from the world's x axis, counterclockwise from above, in full turns.
        turn: f64,
    },
}

impl Section {
    /// A circle, up to a kilometre wide.
    pub fn circle(radius_m: f64) -> Result<Self, Error> {
        check_size("radius_m", radius_m)?;
        Ok(Self::Circle { radius_m })
    }

    /// A regular polygon of this width from side to opposite side (twice the sides' distance from the axis), with a corner at `turn_rad`
    /// from the world's x axis.
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

    /// The greatest distance from the axis in metres.
    fn circumradius_m(&self) -> f64 {
        match *self {
            Self::Circle { radius_m } => radius_m,
            Self::Polygon {
                sides, apothem_m, ..
            } => apothem_m / libm::cos(std::f64::consts::PI / sides as f64),
        }
    }

    /// Half the width seen from far away, in metres, on average over all directions: perimeter/2π (Cauchy).
    fn mean_half_width_m(&self) -> f64 {
        match *self {
            Self::Circle { radius_m } => radius_m,
            Self::Polygon {
                sides, apothem_m, ..
            } => {
                let half_angle = std::f64::consts::PI / sides as f64;
                apothem_m * libm::tan(half_angle) / half_angle
            }
        }
    }
}

/// Which line stands for the outline of an upright body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UprightOutline {
    /// Where rays from the camera touch the body: the true outline.
    #[default]
    Exact,
    /// A rectangle in the plane through the axis that faces the camera, as wide as the body is on average (Taiana 2007, section 4.2 and figure 4.4).
    Facing,
}

/// An upright body. Its position is the centre of its base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Upright {
    /// Its horizontal section.
    pub section: Section,
    /// Its height in metres.
    pub height_m: f64,
    /// Which line stands for its outline.
    pub outline: UprightOutline,
}

impl Upright {
    /// A body of this section, up to a kilometre high.
    pub fn new(section: Section, height_m: f64, outline: UprightOutline) -> Result<Self, Error> {
        check_size("height_m", height_m)?;
        Ok(Self {
            section,
            height_m,
            outline,
        })
    }

    /// Its largest horizontal width in metres.
    pub fn width_m(&self) -> f64 {
        2.0 * self.section.circumradius_m()
    }

    /// Where `count` points lie on the outline, which runs over the top, down one side, back along the base and up the other side; evenly spaced along
    /// a rectangle as wide and high as the body.
    pub(crate) fn places<R: Real>(&self, count: usize) -> Vec<Place<R>> {
        let (width, height) = (2.0 * self.section.mean_half_width_m(), self.height_m);
        let perimeter = 2.0 * (width + height);
        (0..count)
            .map(|k| {
                let around = (k as f64 + 0.5) / count as f64;
                let mut rest = around * perimeter;
                let mut place = [0.0; 5];
                if rest < width {
                    let share = rest / width;
                    place = [1.0, share, 0.0, 1.0, 1.0 - 2.0 * share];
                } else if rest < width + height {
                    rest -= width;
                    place[3] = 1.0 - rest / height;
                    place[4] = -1.0;
                } else if rest < 2.0 * width + height {
                    let share = (rest - width - height) / width;
                    place[2] = share;
                    place[4] = 2.0 * share - 1.0;
                } else {
                    rest -= 2.0 * width + height;
                    place = [1.0, 0.0, 0.0, rest / height, 1.0];
                }
                let [seen_side, along_top, along_base, height, across] = place.map(R::of);
                Place {
                    seen_side,
                    along_top,
                    along_base,
                    height,
                    across,
                    around: R::of(around),
                }
            })
            .collect()
    }

    /// What kernels need of the section, scaled.
    pub(crate) fn sides<R: Real>(&self, scale: f64) -> Sides<R> {
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
                    turn: R::of(turn),
                    half_side: R::of(half_side),
                };
                (kind, apothem_m)
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

/// A place on the outline, as factors of what [`Seen`] holds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place<R> {
    /// Of the way around the side that is seen.
    seen_side: R,
    /// Of the way along the outline of the top.
    along_top: R,
    /// Of the way along the outline of the base.
    along_base: R,
    /// Of the height.
    height: R,
    /// From −1 to 1 across the plane that faces the viewpoint.
    across: R,
    /// Of the way around the whole outline.
    around: R,
}

/// A body's sides, scaled about its centre.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sides<R> {
    kind: SidesKind<R>,
    /// Distance of the sides from the axis; half the width of the rectangle that faces the viewpoint.
    inradius_m: R,
    /// Heights above the position.
    base_m: R,
    top_m: R,
}

#[derive(Debug, Clone, Copy)]
enum SidesKind<R> {
    Round,
    Corners {
        count: R,
        /// Of a corner, in full turns.
        turn: R,
        /// Half a side's length for an inradius of 1.
        half_side: R,
    },
    Flat,
}

/// A body as seen from one viewpoint. Places around it are counted in full turns, or in corners of a polygon.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen<R> {
    axis: [R; 2],
    base: R,
    height: R,
    /// Where the side that is seen begins, and how far it reaches; for the flat outline the direction across, in metres.
    first: R,
    seen: R,
    /// From its ends, the way that the outline of the top and of the base takes: along the near rim or around the far one.
    top_way: R,
    base_way: R,
    /// 1 where only the top or only the base is seen, from above or below: then all points lie around it.
    whole: R,
}

impl<R: Real> Sides<R> {
    /// The body at `position` seen from `viewpoint`, both in the world; and whether it has an outline: not from inside. Without branches but on
    /// what is the same for all particles.
    #[inline(always)]
    pub(crate) fn seen_from(&self, position: [R; 3], viewpoint: [R; 3]) -> (Seen<R>, bool) {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let (dx, dy) = (viewpoint[0] - position[0], viewpoint[1] - position[1]);
        let distance2 = dx * dx + dy * dy;
        let (base, top) = (position[2] + self.base_m, position[2] + self.top_m);
        let (over, under) = (viewpoint[2] > top, viewpoint[2] < base);
        let inradius2 = self.inradius_m * self.inradius_m;
        let mut seen = Seen {
            axis: [position[0], position[1]],
            base,
            height: top - base,
            ..Seen::zero()
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
                // The sides whose normals lie within this of the bearing are seen.
                let half = outer.sqrt().atan2(self.inradius_m) * R::of(IN_TURNS) * count;
                let bearing = (dy.atan2(dx) * R::of(IN_TURNS) - turn) * count - R::of(0.5);
                let first = -(half - bearing).floor();
                let last = (bearing + half).floor();
                seen.first = first;
                seen.seen = last + one - first;
                (distance2 > inradius2) & (last >= first)
            }
        };
        let period = self.period();
        let far = period - seen.seen;
        seen.top_way = if over { far } else { -seen.seen };
        seen.base_way = if under { -far } else { seen.seen };
        if !beside {
            seen.whole = one;
            seen.base = if over { top } else { base };
        }
        (seen, beside | over | under)
    }

    fn period(&self) -> R {
        match self.kind {
            SidesKind::Corners { count, .. } => count,
            SidesKind::Round | SidesKind::Flat => R::of(1.0),
        }
    }

    /// A point of the outline in the world.
    #[inline(always)]
    pub(crate) fn point(&self, seen: &Seen<R>, place: &Place<R>) -> [R; 3] {
        let (half, one) = (R::of(0.5), R::of(1.0));
        let beside = one - seen.whole;
        let z = seen.base + place.height * seen.height * beside;
        let around = beside
            * (seen.first
                + place.seen_side * seen.seen
                + place.along_top * seen.top_way
                + place.along_base * seen.base_way)
            + seen.whole * place.around * self.period();
        let [x, y] = match self.kind {
            SidesKind::Flat => [seen.first * place.across, seen.seen * place.across],
            SidesKind::Round => {
                let (sin, cos) = around.sin_cos_turns();
                [self.inradius_m * cos, self.inradius_m * sin]
            }
            SidesKind::Corners {
                count,
                turn,
                half_side,
            } => {
                let corner = around.floor();
                let (sin, cos) = ((corner + half) / count + turn).sin_cos_turns();
                let along = (R::of(2.0) * (around - corner) - one) * half_side;
                [
                    self.inradius_m * (cos - along * sin),
                    self.inradius_m * (sin + along * cos),
                ]
            }
        };
        [seen.axis[0] + x, seen.axis[1] + y, z]
    }
}

impl<R: Real> Seen<R> {
    /// The number of fields, for kernels that keep them as columns.
    pub(crate) const FIELDS: usize = 9;

    fn zero() -> Self {
        Self::of_fields([R::of(0.0); 9])
    }

    #[inline(always)]
    pub(crate) fn to_fields(self) -> [R; 9] {
        let [x, y] = self.axis;
        let Self {
            base,
            height,
            first,
            seen,
            top_way,
            base_way,
            whole,
            ..
        } = self;
        [x, y, base, height, first, seen, top_way, base_way, whole]
    }

    #[inline(always)]
    pub(crate) fn of_fields(fields: [R; 9]) -> Self {
        let [x, y, base, height, first, seen, top_way, base_way, whole] = fields;
        Self {
            axis: [x, y],
            base,
            height,
            first,
            seen,
            top_way,
            base_way,
            whole,
        }
    }
}

const IN_TURNS: f64 = 1.0 / std::f64::consts::TAU;
