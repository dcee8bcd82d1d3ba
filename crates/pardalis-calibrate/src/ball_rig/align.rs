//! The world of a rig: known points that its cameras see, or places at which the ball was held.

use nalgebra::{DVector, Matrix3, Point3, Vector3};

use super::super::least_squares::{Loss, Problem, Slopes, covariance, minimise};
use super::super::pose::{closest_pose, slopes_by_pose, stepped_pose};
use super::super::spread::Spread;
use super::super::{CalibrationError, Correspondence, OUTLIER_SIGMAS, check, rms};
use pardalis_camera::{Camera, Pose, nearest_pose};

/// Largest residual of known points, and least width of known places, as a share of their extent.
const NARROW: f64 = 0.05;

/// The time around a given one in which the ball rests at a known place, in seconds to either side.
const REST_S: f64 = 0.2;

/// How far the ball may move in that time, in radii.
const REST_RADII: f64 = 0.5;

/// A camera of a rig, and the known points that it sees.
#[derive(Debug, Clone, PartialEq)]
pub struct RigSight<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Its pose in the rig.
    pub rig_from_camera: Pose,
    /// Points with known positions in the world, and their pixels; may be empty.
    pub correspondences: Vec<Correspondence>,
}

/// Where a rig is in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigAlignment {
    /// Pose of the rig.
    pub world_from_rig: Pose,
    /// Root mean square distance of the points from where they should be: in pixels, or in metres for places of the ball.
    pub rms: f64,
    /// How much larger the world is than the rig, and its standard deviation. If it differs from 1, the ball's radius is wrong by
    /// that factor, or the points are. `None` if a single camera sees the points.
    pub scale: Option<[f64; 2]>,
    /// Whether the lengths of the rig take this scale.
    pub is_scaled: bool,
}

impl RigAlignment {
    /// Returns the pose in the world of what has a pose in the rig.
    pub fn in_world(&self, rig_from_camera: &Pose) -> Pose {
        let factor = self.factor();
        let mut grown = *rig_from_camera;
        grown.translation.vector *= factor;
        self.world_from_rig * grown
    }

    /// Returns the factor by which lengths of the rig grow.
    pub fn factor(&self) -> f64 {
        self.scale
            .filter(|_| self.is_scaled)
            .map_or(1.0, |[scale, _]| scale)
    }
}

/// Finds where a rig is in the world, from known points that one or more of its cameras see. `scale_sigma` is the standard deviation of
/// the rig's lengths as a share of them; points that tell the scale better than that set it.
///
/// # Errors
///
/// Fails unless one camera sees four points in a plane or six others, or two cameras see the same three points, or if points and
/// pixels do not match.
pub fn align_to_points(
    sights: &[RigSight],
    scale_sigma: f64,
) -> Result<RigAlignment, CalibrationError> {
    let mut starts: Vec<(f64, Pose)> = Vec::new();
    let mut refused = None;
    for sight in sights.iter().filter(|s| s.correspondences.len() >= 4) {
        match closest_pose(sight.camera, &sight.correspondences, OUTLIER_SIGMAS) {
            Ok(fit) => {
                let world_from_rig = (sight.rig_from_camera * fit.camera_from_target).inverse();
                let points = sight.correspondences.len() as f64;
                starts.push((fit.rms_px / points, world_from_rig));
            }
            Err(refusal) => refused = Some(refusal),
        }
    }
    let of_one = starts.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let of_one = of_one.map(|(_, pose)| pose);
    let start = of_one.or_else(|| from_common_points(sights)).ok_or_else(|| {
        refused.unwrap_or_else(|| CalibrationError::new(
            "the points do not tell where the rig is",
            "give at least four points in one plane (such as the corners of a rectangle) or six others that one camera sees, or three that two cameras see, not on a line",
        ))
    })?;
    let problem = Alignment {
        sights,
        rig_from_world: start.inverse(),
        log_scale: 0.0,
        is_scale_free: false,
    };
    let (fitted, _) = minimise(problem, Loss::Squares, 60);
    let rms_px = rms(fitted.residuals());
    let pixels = sights.iter().flat_map(|s| &s.correspondences);
    let extent_px = check::extent(pixels.map(|c| c.pixel));
    let size_px = libm::hypot(
        extent_px[1][0] - extent_px[0][0],
        extent_px[1][1] - extent_px[0][1],
    );
    if !(rms_px <= NARROW * size_px) {
        return Err(CalibrationError::new(
            format!("the points are {rms_px:.1} px from their pixels after alignment"),
            "check their order, their units (metres), and that each is assigned to the camera in which its pixel was read",
        ));
    }
    let rigid = RigAlignment {
        world_from_rig: fitted.rig_from_world.inverse(),
        rms: rms_px,
        scale: None,
        is_scaled: false,
    };
    let seeing = sights.iter().filter(|s| !s.correspondences.is_empty());
    if seeing.count() < 2 {
        return Ok(rigid);
    }
    let free = Alignment {
        is_scale_free: true,
        ..fitted
    };
    let (free, _) = minimise(free, Loss::Squares, 60);
    let rms_px = rms(free.residuals());
    let Some(covariance) = covariance(&free) else {
        return Ok(rigid);
    };
    let (scale, sigma) = (
        libm::exp(-free.log_scale),
        rms_px * covariance[(6, 6)].sqrt(),
    );
    let is_scaled = sigma < scale_sigma;
    Ok(RigAlignment {
        scale: Some([scale, sigma]),
        is_scaled,
        ..if is_scaled {
            RigAlignment {
                world_from_rig: scaled(free.rig_from_world.inverse(), scale),
                rms: rms_px,
                ..rigid
            }
        } else {
            rigid
        }
    })
}

/// Scales the position of a pose.
fn scaled(mut pose: Pose, scale: f64) -> Pose {
    pose.translation.vector *= scale;
    pose
}

/// Brings points where the rays of cameras meet into line with their known positions.
fn from_common_points(sights: &[RigSight]) -> Option<Pose> {
    let mut places: Vec<[f64; 3]> = Vec::new();
    for seen in sights.iter().flat_map(|s| &s.correspondences) {
        if !places.contains(&seen.point_m) {
            places.push(seen.point_m);
        }
    }
    let met: Vec<_> = places
        .into_iter()
        .filter_map(|place| Some((1.0, [Vector3::from(place), meeting_point(sights, place)?])))
        .collect();
    if met.len() < 3 {
        return None;
    }
    nearest_pose(&met)
}

/// Returns the point of the rig nearest to the rays of the cameras to a known point, at least two.
fn meeting_point(sights: &[RigSight], place_m: [f64; 3]) -> Option<Vector3<f64>> {
    let (mut normal, mut right, mut rays) = (Matrix3::zeros(), Vector3::zeros(), 0);
    for sight in sights {
        let seen = sight.correspondences.iter().find(|c| c.point_m == place_m);
        let Some(ray) = seen.and_then(|seen| sight.camera.unproject(seen.pixel)) else {
            continue;
        };
        let origin = sight.rig_from_camera * Point3::from(ray.origin);
        let along = sight.rig_from_camera.rotation * Vector3::from(ray.direction);
        let across = Matrix3::identity() - along * along.transpose();
        normal += across;
        right += across * origin.coords;
        rays += 1;
    }
    (rays > 1).then(|| normal.try_inverse().map(|inverse| inverse * right))?
}

/// The least-squares problem. Its unknowns are the pose and, if it is free, the logarithm of the scale.
#[derive(Clone)]
struct Alignment<'a> {
    sights: &'a [RigSight<'a>],
    rig_from_world: Pose,
    /// Of the rig relative to the world.
    log_scale: f64,
    is_scale_free: bool,
}

impl Alignment<'_> {
    /// Returns each point with its camera: turned and scaled into the rig, in the camera's frame, and as observed.
    fn points(
        &self,
    ) -> impl Iterator<Item = (&RigSight<'_>, Vector3<f64>, Vector3<f64>, &Correspondence)> {
        let scale = libm::exp(self.log_scale);
        self.sights.iter().flat_map(move |sight| {
            let camera_from_rig = sight.rig_from_camera.inverse();
            sight.correspondences.iter().map(move |c| {
                let turned = self.rig_from_world.rotation * Vector3::from(c.point_m) * scale;
                let in_rig = turned + self.rig_from_world.translation.vector;
                let in_camera = camera_from_rig * Point3::from(in_rig);
                (sight, turned, in_camera.coords, c)
            })
        })
    }

    fn residuals(&self) -> impl Iterator<Item = [f64; 2]> {
        // A point without a pixel is far off.
        self.points().map(|(sight, _, at, c)| {
            let projected = sight.camera.project(at.into());
            projected.map_or([1e3; 2], |[u, v]| [c.pixel[0] - u, c.pixel[1] - v])
        })
    }
}

impl Problem for Alignment<'_> {
    fn unknowns(&self) -> usize {
        6 + usize::from(self.is_scale_free)
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        Some(Self {
            rig_from_world: stepped_pose(&self.rig_from_world, &step.as_slice()[..6]),
            log_scale: self.log_scale + step.get(6).copied().unwrap_or(0.0),
            ..self.clone()
        })
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        for (sight, turned, at, c) in self.points() {
            let Some(mut jacobian) = sight.camera.project_with_jacobian(at.into()) else {
                visit(None, Slopes { blocks: &[] });
                continue;
            };
            // A motion in the rig is the same motion turned into the camera.
            let turn = sight.rig_from_camera.rotation;
            jacobian.by_point = jacobian
                .by_point
                .map(|row| (turn * Vector3::from(row)).into());
            let by_pose = slopes_by_pose(turned, &jacobian);
            let by_scale = jacobian.by_point.map(|row| Vector3::from(row).dot(&turned));
            let [u, v] = jacobian.pixel;
            let blocks: &[(usize, &[[f64; 2]])] = &[(0, &by_pose), (6, &[by_scale])];
            let blocks = &blocks[..=usize::from(self.is_scale_free)];
            visit(Some([u - c.pixel[0], v - c.pixel[1]]), Slopes { blocks });
        }
    }
}

/// Finds where a rig is in the world, from times (of the first camera, in seconds) at which the ball was held still with its centre
/// at known places (metres), and the path of the ball in the rig. `scale_sigma` is as for [`align_to_points`].
///
/// # Errors
///
/// Fails if there are fewer than three places, if they lie on a line, if the ball was not seen or moved at one of the times, or if
/// places and path do not match.
pub fn align_to_places(
    path_m: &[(f64, [f64; 3])],
    radius_m: f64,
    places: &[(f64, [f64; 3])],
    scale_sigma: f64,
) -> Result<RigAlignment, CalibrationError> {
    let mut pairs = Vec::new();
    for &(time_s, place_m) in places {
        let near = path_m
            .iter()
            .filter(|(at_s, _)| (at_s - time_s).abs() <= REST_S);
        let near: Vec<Vector3<f64>> = near.map(|(_, at)| Vector3::from(*at)).collect();
        if near.is_empty() {
            return Err(CalibrationError::new(
                format!(
                    "two cameras did not see the ball at {time_s} s, when it was at a known place"
                ),
                "give times at which two or more cameras see it, by the clock of the first camera",
            ));
        }
        let mean = near.iter().sum::<Vector3<f64>>() / near.len() as f64;
        let moved_m = near.iter().map(|at| (at - mean).norm()).fold(0.0, f64::max);
        if moved_m > REST_RADII * radius_m {
            return Err(CalibrationError::new(
                format!(
                    "the ball moved by {moved_m:.3} m around {time_s} s, when it was at a known place"
                ),
                format!(
                    "give the middle of a time at which it rests for {} s",
                    2.0 * REST_S
                ),
            ));
        }
        pairs.push((1.0, [Vector3::from(place_m), mean]));
    }
    let widths_m = Spread::of(places.iter().map(|(_, place)| *place)).widths_m;
    let pose = (pairs.len() >= 3 && widths_m[1] > NARROW * widths_m[0])
        .then(|| nearest_pose(&pairs))
        .flatten();
    let Some(world_from_rig) = pose else {
        return Err(CalibrationError::new(
            format!("{} places do not tell where the rig is", places.len()),
            "hold the ball at three or more places that are not on a line",
        ));
    };
    let apart = |(_, [wanted, found]): &(f64, [Vector3<f64>; 2])| {
        ((world_from_rig * Point3::from(*found)).coords - wanted).norm_squared()
    };
    let rms_m = (pairs.iter().map(apart).sum::<f64>() / pairs.len() as f64).sqrt();
    if rms_m > NARROW * widths_m[0].max(radius_m) + radius_m {
        return Err(CalibrationError::new(
            format!("the ball was {rms_m:.3} m from its known places (root mean square)"),
            "check that times and places belong together, and that places are those of the ball's centre in metres",
        ));
    }
    let width_m = |which: usize| {
        let of = pairs.iter().map(|(_, pair)| pair[which]);
        let mean = of.clone().sum::<Vector3<f64>>() / pairs.len() as f64;
        of.map(|place| (place - mean).norm_squared())
            .sum::<f64>()
            .sqrt()
    };
    let (wanted_m, found_m) = (width_m(0), width_m(1));
    let coordinates = 3.0 * pairs.len() as f64;
    let sigma_m = rms_m * (coordinates / (3.0 * (coordinates - 7.0))).sqrt();
    let (scale, sigma) = (wanted_m / found_m, sigma_m / found_m);
    let is_scaled = sigma < scale_sigma;
    let mut alignment = RigAlignment {
        world_from_rig,
        rms: rms_m,
        scale: Some([scale, sigma]),
        is_scaled,
    };
    if is_scaled {
        let grown = pairs.iter();
        let grown = grown.map(|(weight, [wanted, found])| (*weight, [*wanted, found * scale]));
        if let Some(pose) = nearest_pose(&grown.collect::<Vec<_>>()) {
            alignment.world_from_rig = pose;
        }
    }
    Ok(alignment)
}
