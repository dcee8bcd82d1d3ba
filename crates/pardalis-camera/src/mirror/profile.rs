//! Shapes of mirrors of revolution, and the conditions for a usable shape.

use super::resolution::ConstantResolution;
use super::table::ProfileTable;
use pardalis_core::Error;

/// Largest dimension of a mirror, in metres.
const MAX_LENGTH_M: f64 = 1e3;
/// Smallest dimension of a mirror, in metres.
const MIN_LENGTH_M: f64 = 1e-6;
/// Cosine of the largest angle between the mirror's normal and the line of sight from the pinhole,
/// 87 degrees.
const MIN_COS_INCIDENCE: f64 = 0.05;
/// Number of points between axis and rim at which an analytic shape is checked.
const CHECKED_POINTS: u32 = 500;

/// A mirror of revolution z = F(t) for t from 0 (on the optical axis) to the rim, in metres, with
/// the pinhole at the origin.
///
/// Every profile satisfies the following conditions, so that each point of the scene is seen at
/// most once: F > 0; the pinhole sees the front of the whole mirror (F − t·F' > 0: the image radius
/// increases with t) at no less than 3 degrees from the surface; the reflected rays diverge, φ' > 0
/// with φ(0) ≥ 0 (no folds, and no ray meets the mirror again).
#[derive(Debug, Clone, PartialEq)]
pub struct MirrorProfile {
    vertex_m: f64,
    rim_m: f64,
    shape: Shape,
}

/// The description from which a profile was created.
#[derive(Debug, Clone, PartialEq)]
pub enum MirrorForm {
    /// A sphere.
    Sphere {
        /// Radius in metres.
        radius_m: f64,
    },
    /// A cone with its tip towards the pinhole.
    Cone {
        /// Angle between axis and surface in radians.
        half_angle_rad: f64,
    },
    /// A paraboloid.
    Paraboloid {
        /// Focal length in metres.
        focal_m: f64,
    },
    /// A sheet of a hyperboloid.
    Hyperboloid {
        /// Semi-axes along the optical axis and across it, in metres.
        semi_axes_m: [f64; 2],
    },
    /// A mirror designed for constant resolution.
    ConstantResolution(ConstantResolution),
    /// A table of t, F and F', with t and F in metres.
    Rows(Vec<[f64; 3]>),
}

/// F(t) − F(0).
#[derive(Debug, Clone, PartialEq)]
enum Shape {
    /// c·t² / (1 + √(1 − (1 + k)·c²·t²)): the sphere (k = 0), paraboloid (k = −1) or hyperboloid (k
    /// < −1) of curvature c at the vertex.
    Conic { curvature_per_m: f64, conic: f64 },
    /// s·t.
    Cone { slope: f64 },
    /// Interpolated table, with its design if it has one.
    Table(ProfileTable, Option<ConstantResolution>),
}

impl MirrorProfile {
    /// Creates a sphere from the distance of the pinhole from the vertex, the radius and the
    /// (smaller) radius of the rim, all in metres.
    pub fn sphere(vertex_m: f64, radius_m: f64, rim_m: f64) -> Result<Self, Error> {
        check_length("radius_m", radius_m)?;
        check_length("rim_m", rim_m)?;
        if rim_m >= radius_m {
            return Err(Error::out_of_range("rim_m", rim_m, "less than radius_m"));
        }
        Self::conic(vertex_m, 1.0 / radius_m, 0.0, rim_m)
    }

    /// Creates a paraboloid F(0) + t²/(4·f) with focal length f, all in metres.
    pub fn paraboloid(vertex_m: f64, focal_m: f64, rim_m: f64) -> Result<Self, Error> {
        check_length("focal_m", focal_m)?;
        Self::conic(vertex_m, 0.5 / focal_m, -1.0, rim_m)
    }

    /// Creates one sheet of a hyperboloid with semi-axes `a_m` along the optical axis and `b_m`
    /// across it, all in metres.
    ///
    /// With c = √(a² + b²), a pinhole at the outer focus has its vertex at a + c, and all rays then
    /// point at the inner focus at z = 2·c.
    pub fn hyperboloid(vertex_m: f64, [a_m, b_m]: [f64; 2], rim_m: f64) -> Result<Self, Error> {
        check_length("a_m", a_m)?;
        check_length("b_m", b_m)?;
        Self::conic(
            vertex_m,
            a_m / (b_m * b_m),
            -1.0 - (b_m / a_m) * (b_m / a_m),
            rim_m,
        )
    }

    /// Creates a cone with its tip towards the pinhole from the distance of the tip in metres, the
    /// angle between axis and surface in radians (0.001 to less than π/2) and the radius of the rim
    /// in metres. A cone does not show points near the axis.
    pub fn cone(vertex_m: f64, half_angle_rad: f64, rim_m: f64) -> Result<Self, Error> {
        if !(1e-3..std::f64::consts::FRAC_PI_2).contains(&half_angle_rad) {
            return Err(Error::out_of_range(
                "half_angle_rad",
                half_angle_rad,
                "0.001 to less than pi/2",
            ));
        }
        let (sin, cos) = libm::sincos(half_angle_rad);
        Self::checked(vertex_m, rim_m, Shape::Cone { slope: cos / sin })
    }

    /// Creates a profile from rows t, F, interpolated with continuous curvature. The vertex is
    /// assumed smooth, F'(0) = 0.
    ///
    /// Requires 5 to 100 000 rows, with t increasing from 0 to the rim.
    pub fn from_rows(rows: &[[f64; 2]]) -> Result<Self, Error> {
        let rows_with_slopes = super::table::with_slopes(rows)?;
        Self::from_rows_with_slopes(&rows_with_slopes)
    }

    /// Creates a profile from rows t, F, F', interpolated with continuous curvature. F'(0) is 0 for
    /// a smooth vertex.
    ///
    /// Requires 5 to 100 000 rows, with t increasing from 0 to the rim.
    pub fn from_rows_with_slopes(rows: &[[f64; 3]]) -> Result<Self, Error> {
        Self::from_table(rows, None)
    }

    /// Creates a designed profile from its rows t, F, F'.
    pub(super) fn designed(rows: &[[f64; 3]], design: ConstantResolution) -> Result<Self, Error> {
        Self::from_table(rows, Some(design))
    }

    fn from_table(rows: &[[f64; 3]], design: Option<ConstantResolution>) -> Result<Self, Error> {
        let table = ProfileTable::new(rows)?;
        let shape = Shape::Table(table, design);
        Self::checked(rows[0][1], rows[rows.len() - 1][0], shape)
    }

    fn conic(vertex_m: f64, curvature_per_m: f64, conic: f64, rim_m: f64) -> Result<Self, Error> {
        let shape = Shape::Conic {
            curvature_per_m,
            conic,
        };
        Self::checked(vertex_m, rim_m, shape)
    }

    fn checked(vertex_m: f64, rim_m: f64, shape: Shape) -> Result<Self, Error> {
        check_length("vertex_m", vertex_m)?;
        check_length("rim_m", rim_m)?;
        let profile = Self {
            vertex_m,
            rim_m,
            shape,
        };
        match &profile.shape {
            Shape::Table(table, _) => table.check_points().try_for_each(|t| profile.check_at(t))?,
            _ => (0..=CHECKED_POINTS)
                .map(|i| rim_m * f64::from(i) / f64::from(CHECKED_POINTS))
                .try_for_each(|t| profile.check_at(t))?,
        }
        Ok(profile)
    }

    /// Returns the same shape at another distance from the pinhole, in metres.
    pub fn at_vertex(&self, vertex_m: f64) -> Result<Self, Error> {
        Self::checked(vertex_m, self.rim_m, self.shape.clone())
    }

    /// Checks that the mirror is usable at distance t from the axis.
    fn check_at(&self, t: f64) -> Result<(), Error> {
        let [f, slope, curvature] = self.at(t);
        let reject = |what: &str, allowed: &str| {
            let found = format!("{what} at t = {t} m (F = {f} m, F' = {slope})");
            Err(Error::out_of_range("the mirror", found, allowed))
        };
        if !(f.abs() <= MAX_LENGTH_M && slope.is_finite() && curvature.is_finite()) {
            return reject("out of bounds", "finite numbers, F up to 1000 m");
        }
        if !(f > 0.0) {
            return reject("behind the pinhole", "F above 0");
        }
        let cos_incidence = (f - t * slope) / ((f * f + t * t) * (1.0 + slope * slope)).sqrt();
        if !(cos_incidence >= MIN_COS_INCIDENCE) {
            return reject(
                "hidden by itself or seen at a grazing angle from the pinhole",
                "at most 87 degrees between surface normal and line of sight; reduce the radius of the rim",
            );
        }
        if !(slope >= 0.0 || t > 0.0) {
            return reject("hollow", "F' of 0 or more at the vertex");
        }
        let spread = (f - t * slope) / (f * f + t * t) + 2.0 * curvature / (1.0 + slope * slope);
        if !(spread > 0.0) {
            return reject(
                "folded (it shows the same points twice)",
                "a surface curved towards the camera, whose reflected rays diverge",
            );
        }
        Ok(())
    }

    /// Returns F(0), the distance of the vertex from the pinhole, in metres.
    pub fn vertex_m(&self) -> f64 {
        self.vertex_m
    }

    /// Returns the radius of the rim, in metres.
    pub fn rim_m(&self) -> f64 {
        self.rim_m
    }

    /// Returns the description from which the profile was created, up to rounding. A design may
    /// have another distance from the pinhole than the profile.
    pub fn form(&self) -> MirrorForm {
        match &self.shape {
            &Shape::Conic {
                curvature_per_m: c,
                conic,
            } => {
                if conic == 0.0 {
                    MirrorForm::Sphere { radius_m: 1.0 / c }
                } else if conic == -1.0 {
                    MirrorForm::Paraboloid { focal_m: 0.5 / c }
                } else {
                    // c = a/b² and k = −1 − b²/a².
                    let a_m = -1.0 / (c * (1.0 + conic));
                    let b_m = (a_m / c).sqrt();
                    MirrorForm::Hyperboloid {
                        semi_axes_m: [a_m, b_m],
                    }
                }
            }
            Shape::Cone { slope } => MirrorForm::Cone {
                half_angle_rad: libm::atan(1.0 / slope),
            },
            &Shape::Table(_, Some(design)) => MirrorForm::ConstantResolution(design),
            Shape::Table(table, None) => {
                let row = |&t: &f64| {
                    let [f, slope, _] = self.at(t);
                    [t, f, slope]
                };
                MirrorForm::Rows(table.t_m().iter().map(row).collect())
            }
        }
    }

    /// Returns F in metres, F' and F'' in 1/m at `t_m` from the axis, 0 to the rim.
    pub fn at(&self, t_m: f64) -> [f64; 3] {
        let [sag, slope, curvature] = self.sag_at(t_m);
        [self.vertex_m + sag, slope, curvature]
    }

    /// Returns F − F(0), F' and F''.
    pub(crate) fn sag_at(&self, t: f64) -> [f64; 3] {
        match &self.shape {
            &Shape::Conic {
                curvature_per_m: c,
                conic,
            } => {
                let w = (1.0 - (1.0 + conic) * c * c * t * t).sqrt();
                [c * t * t / (1.0 + w), c * t / w, c / (w * w * w)]
            }
            &Shape::Cone { slope } => [slope * t, slope, 0.0],
            Shape::Table(table, _) => table.at(t),
        }
    }

    /// Reports whether the mirror has a tip instead of a smooth vertex.
    pub(crate) fn has_tip(&self) -> bool {
        self.sag_at(0.0)[1] > 0.0
    }
}

fn check_length(name: &str, value_m: f64) -> Result<(), Error> {
    if (MIN_LENGTH_M..=MAX_LENGTH_M).contains(&value_m) {
        return Ok(());
    }
    Err(Error::out_of_range(name, value_m, "1e-6 to 1000 metres"))
}
