//! Design of mirrors whose image has a constant resolution on a plane.

use super::MirrorProfile;
use super::resolution::{ConstantResolution, Resolution};
use pardalis_core::Error;

/// Number of rows of the designed profile, without the vertex.
const ROWS: usize = 256;
/// Integration steps per row.
const STEPS_PER_ROW: usize = 2;
/// Bisection steps in the search for the resolution.
const HALVINGS: u32 = 60;

impl ConstantResolution {
    /// Designs the mirror by Runge-Kutta integration of F' = tan((atan2(r − t, F − z) −
    /// atan(t/F))/2) with r = (t/F − b)/a.
    ///
    /// # Errors
    ///
    /// Rejects parameters that are out of range or for which no mirror exists.
    pub fn design(&self) -> Result<MirrorProfile, Error> {
        let (name, value, least) = match self.resolution {
            Resolution::PerMetre(a) => ("resolution_per_m", a, 1e-9),
            Resolution::RimShows(r_m) => ("rim_view_m", r_m, 1e-6),
        };
        let positive = [
            ("vertex_m", self.vertex_m, 1e-6),
            ("rim_m", self.rim_m, 1e-6),
            (name, value, least),
        ];
        for (name, value, least) in positive {
            if !(least..=1e6).contains(&value) {
                return Err(Error::out_of_range(name, value, &format!("{least} to 1e6")));
            }
        }
        if !(self.plane_z_m >= -1e6 && self.plane_z_m < self.vertex_m) {
            return Err(Error::out_of_range(
                "plane_z_m",
                self.plane_z_m,
                "at least -1e6 and less than vertex_m (the mirror faces the camera's side)",
            ));
        }
        if !(self.offset >= -1e6 && self.offset <= 0.0) {
            return Err(Error::out_of_range("offset", self.offset, "-1e6 to 0"));
        }
        let a = self.per_metre();
        let rows = self.integrate(a);
        let profile = MirrorProfile::designed(&rows, *self)?;
        if let Resolution::RimShows(r_m) = self.resolution {
            let shown_m = self.shown_by_rim(&rows, a);
            if !((shown_m - r_m).abs() <= 1e-9 * r_m) {
                return Err(Error::out_of_range(
                    "rim_view_m",
                    r_m,
                    &format!(
                        "a distance that a mirror with this rim can show; the closest possible is {shown_m} m"
                    ),
                ));
            }
        }
        Ok(profile)
    }

    /// Returns r of the point shown by the rim.
    fn shown_by_rim(&self, rows: &[[f64; 3]], a: f64) -> f64 {
        let [t, f, _] = rows[ROWS];
        (t / f - self.offset) / a
    }

    /// Returns a. The farther the rim shows, the steeper the mirror and the smaller ρ at the rim:
    /// the solution is unique.
    fn per_metre(&self) -> f64 {
        let r_m = match self.resolution {
            Resolution::PerMetre(a) => return a,
            Resolution::RimShows(r_m) => r_m,
        };
        let (mut low, mut high) = (0.0, 2.0 * (self.rim_m / self.vertex_m - self.offset) / r_m);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.shown_by_rim(&self.integrate(middle), middle) > r_m {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// Returns rows t, F, F' from the vertex to the rim.
    fn integrate(&self, a: f64) -> Vec<[f64; 3]> {
        let slope = |t: f64, f: f64| {
            let r = (t / f - self.offset) / a;
            // The ray to the point is (r − t, F − z), the one to the pinhole (t, F). The slope is
            // the tangent of half the angle between them.
            let (across, along) = (r - t, f - self.plane_z_m);
            let lengths = ((across * across + along * along) * (t * t + f * f)).sqrt();
            (across * f - along * t) / (lengths + along * f + across * t)
        };
        let steps = ROWS * STEPS_PER_ROW;
        let h = self.rim_m / steps as f64;
        let mut f = self.vertex_m;
        let mut rows = vec![[0.0, f, slope(0.0, f)]];
        for step in 0..steps {
            let t = step as f64 * h;
            let k1 = slope(t, f);
            let k2 = slope(t + 0.5 * h, f + 0.5 * h * k1);
            let k3 = slope(t + 0.5 * h, f + 0.5 * h * k2);
            let end = (step + 1) as f64 * h;
            let k4 = slope(end, f + h * k3);
            f += h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
            if (step + 1) % STEPS_PER_ROW == 0 {
                rows.push([end, f, slope(end, f)]);
            }
        }
        rows
    }
}
