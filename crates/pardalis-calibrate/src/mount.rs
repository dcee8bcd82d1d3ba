//! Where a camera is mounted on a moving platform: hand-eye calibration from a target at rest, with the offset between the clocks.
//!
//! The platform's poses T are known, the camera's pose X on it and the target's pose Y in the world are not: a point b of the target appears at the pixel of X⁻¹ T⁻¹ Y b (Tsai and
//! Lenz 1989; the reprojection form of Dornaika and Horaud 1998). If the clock of the poses is late by δ, T is that of the time t + δ.

use nalgebra::{
    DMatrix, DVector, Matrix3, Matrix6, Point3, Rotation3, Translation3, Unit, Vector3, Vector6,
};

use super::least_squares::{Loss, Problem, Slopes, covariance, minimise};
use super::pose::{closest_pose, slopes_by_pose, stepped_pose};
use super::{CalibrationError, CalibrationView, check, rms};
use pardalis_camera::{Camera, Pose, ProjectionJacobian, RigidMotion};

/// What the camera saw of the target at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct MountView {
    /// The points of the target. A target of a single point is at its origin.
    pub view: CalibrationView,
    /// The time in seconds.
    pub time_s: f64,
}

/// Where the platform is at a time in seconds, and how it moves, per second in its own frame; `None` if that is not known.
pub type PlatformAt<'a> = &'a dyn Fn(f64) -> Option<(Pose, RigidMotion)>;

/// A view with the pose of the platform.
#[derive(Debug, Clone, PartialEq)]
struct PlacedView<'a> {
    view: &'a CalibrationView,
    world_from_platform: Pose,
    rates: RigidMotion,
}

/// Settings of [`calibrate_mount`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MountSettings {
    /// Where the camera is, roughly.
    pub platform_from_camera: Pose,
    /// Width and height of the images in pixels.
    pub size_px: (usize, usize),
    /// Whether the offset of the clocks is estimated, too.
    pub fit_clock: bool,
    /// Number of robust standard deviations beyond which a point is an outlier ([`OUTLIER_SIGMAS`](super::OUTLIER_SIGMAS)).
    pub outlier_sigmas: f64,
}

impl MountSettings {
    /// Returns settings for a camera that is roughly here, with images of this width and height in pixels.
    pub fn new(platform_from_camera: Pose, size_px: (usize, usize)) -> Self {
        Self {
            platform_from_camera,
            size_px,
            fit_clock: true,
            outlier_sigmas: super::OUTLIER_SIGMAS,
        }
    }
}

/// The result of [`calibrate_mount`].
#[derive(Debug, Clone, PartialEq)]
pub struct MountCalibration {
    /// Where the camera is.
    pub platform_from_camera: Pose,
    /// Standard deviations of the camera's position on the platform, metres. Where the motion does not determine it, that of the given pose is kept, with the deviation 0.
    pub position_sigma_m: [f64; 3],
    /// Standard deviations of rotations about the axes of the platform, radians.
    pub turn_sigma_rad: [f64; 3],
    /// Where the target is.
    pub world_from_target: Pose,
    /// Seconds to add to the times of the poses, and their standard deviation, if they were estimated.
    pub time_offset_s: Option<[f64; 2]>,
    /// The axis on the platform along which the camera's position cannot be determined, because all turns were about it.
    pub undetermined: Option<[f64; 3]>,
    /// The number of views at whose time the platform's pose is known.
    pub used_views: usize,
    /// The number of points that were rejected.
    pub outliers: usize,
    /// Root mean square distance of the other points, in pixels.
    pub rms_px: f64,
    /// By how much the platform turned between any two views, at most, in radians.
    pub turned_rad: f64,
}

/// Turns of less than this between all views determine nothing, in radians.
const LEAST_TURN_RAD: f64 = 0.1;

/// What to do if the views contradict each other.
const CONTRADICTED: &str = "check that the target was at rest, that the poses are of this platform and of the same time (odometry lacks pitch and roll), and the guess of the camera's pose";

/// The turns are about one axis if those about all others are at most this share of them.
const OTHER_TURNS: f64 = 0.05;

/// Residuals beyond this are not those of a target at rest: pixels, and a share of the image's diagonal. Hand-set.
const LARGE_PX: [f64; 2] = [0.5, 1e-3];

/// Offsets of the clocks from which the search begins, one after the other until one fits, in seconds.
const OFFSETS_S: [f64; 5] = [0.0, -0.2, 0.2, -0.4, 0.4];

/// The greatest number of times that the offset of the clocks is refined.
const ROUNDS: usize = 12;

/// The offset of the clocks is refined until it changes by less than this, in seconds.
const CLOSE_S: f64 = 1e-4;

/// The largest offset of the clocks, in seconds.
const MAX_OFFSET_S: f64 = 1.0;

/// Weight of the position that is kept where it is undetermined: pixels per metre.
const KEPT_PX_PER_M: f64 = 1e5;

/// Starts are tried every eighth of a turn about the axis of the platform's turns, and as given.
const STARTS: u32 = 8;

/// Finds where a camera is on a platform, from views of a target at rest while the platform moves.
///
/// The platform must turn by at least 0.1 rad between some of the views; turns about two axes determine everything. A robot that turns about its vertical alone leaves the
/// camera's height open, which is kept as in the settings. A target of several points, such as a board, needs no good guess; one of a single point does.
///
/// # Errors
///
/// Fails if there are fewer than three views, the platform turns too little, or the observations contradict each other.
pub fn calibrate_mount(
    camera: &Camera,
    views: &[MountView],
    platform_at: PlatformAt,
    settings: &MountSettings,
) -> Result<MountCalibration, CalibrationError> {
    let starts_s: &[f64] = if settings.fit_clock {
        &OFFSETS_S
    } else {
        &[0.0]
    };
    let mut first = None;
    for &start_s in starts_s {
        match calibrate_from(camera, views, platform_at, settings, start_s) {
            Ok(found) => return Ok(found),
            Err(error) => first = first.or(Some(error)),
        }
    }
    Err(first.unwrap_or_else(|| CalibrationError::new("there are no views", "give some")))
}

/// Finds where the camera is, from a first offset of the clocks in seconds.
fn calibrate_from(
    camera: &Camera,
    views: &[MountView],
    platform_at: PlatformAt,
    settings: &MountSettings,
    start_s: f64,
) -> Result<MountCalibration, CalibrationError> {
    let mut offset_s = start_s;
    let mut guess = settings.clone();
    for round in 0..ROUNDS {
        let placed = views.iter().filter_map(|view| {
            let (world_from_platform, rates) = platform_at(view.time_s - offset_s)?;
            Some(PlacedView {
                view: &view.view,
                world_from_platform,
                rates,
            })
        });
        let placed: Vec<_> = placed.collect();
        let mut found = calibrate_placed(camera, &placed, &guess, round == 0)?;
        let later_s = match &mut found.time_offset_s {
            None => 0.0,
            Some([later_s, _]) => {
                let by_s = *later_s;
                offset_s += by_s;
                *later_s = offset_s;
                by_s
            }
        };
        // Rates are constant for a short time only.
        if later_s.abs() < CLOSE_S {
            return found.checked(settings);
        }
        if !(offset_s.abs() <= MAX_OFFSET_S) {
            break;
        }
        guess.platform_from_camera = found.platform_from_camera;
    }
    Err(CalibrationError::new(
        "no offset of the clocks within a second explains where the target is seen",
        CONTRADICTED,
    ))
}

/// Finds where the camera is, given the platform's poses. `is_rough` says that the guess may be far off.
fn calibrate_placed(
    camera: &Camera,
    views: &[PlacedView],
    settings: &MountSettings,
    is_rough: bool,
) -> Result<MountCalibration, CalibrationError> {
    if views.len() < 3 {
        return Err(CalibrationError::new(
            format!(
                "the target was seen in {} views, which are too few",
                views.len()
            ),
            "give three or more, better thirty, between which the platform turns and drives",
        ));
    }
    let pixels = views.iter().flat_map(|view| &view.view.correspondences);
    check::pixels(pixels.map(|point| point.pixel), settings.size_px)?;
    let turned_rad = greatest_turn_rad(views);
    if turned_rad < LEAST_TURN_RAD {
        return Err(CalibrationError::new(
            format!(
                "the platform turned by {:.1} degrees between the views, which determines nothing",
                turned_rad.to_degrees()
            ),
            "let it turn by 30 degrees or more while the target stays in view",
        ));
    }
    let undetermined = single_axis(views);
    let is_point = views
        .iter()
        .all(|view| view.view.correspondences.len() == 1);
    let mount = Mount {
        camera,
        views,
        is_point,
        fit_clock: settings.fit_clock,
        kept: undetermined.map(|axis| (axis, settings.platform_from_camera.translation.vector)),
        camera_from_platform: settings.platform_from_camera.inverse(),
        world_from_target: Pose::identity(),
        time_offset_s: 0.0,
        used: views
            .iter()
            .map(|view| vec![true; view.view.correspondences.len()])
            .collect(),
    };
    let starts = mount.starts(undetermined.unwrap_or(Vector3::z()), is_rough);
    let robust = starts
        .into_iter()
        .map(|start| minimise(start, Loss::Cauchy(2.0), 60))
        .reduce(|best, next| if next.1 < best.1 { next } else { best });
    let Some((mut robust, _)) = robust else {
        return Err(CalibrationError::new(
            "no view shows where the target is",
            "give views in which it is wholly visible, and a better guess of the camera's pose",
        ));
    };
    let residuals: Vec<_> = robust.residuals_px().into_iter().flatten().collect();
    let inliers = check::inliers(&residuals, settings.outlier_sigmas);
    if check::mostly_inliers("", &inliers).is_err() {
        let agreeing = inliers.iter().filter(|inlier| **inlier).count();
        return Err(CalibrationError::new(
            format!(
                "only {agreeing} of {} points are seen where a target at rest would be",
                inliers.len()
            ),
            CONTRADICTED,
        ));
    }
    let mut inliers = inliers.into_iter();
    for used in robust.used.iter_mut().flatten() {
        *used = inliers.next().unwrap_or(false);
    }
    let (fitted, _) = minimise(robust, Loss::Squares, 100);
    fitted.finish(undetermined, turned_rad)
}

impl MountCalibration {
    /// Returns an error if the target is not seen where it should be.
    fn checked(self, settings: &MountSettings) -> Result<Self, CalibrationError> {
        let (width, height) = settings.size_px;
        let diagonal_px = libm::hypot(width as f64, height as f64);
        if self.rms_px <= LARGE_PX[0] + LARGE_PX[1] * diagonal_px {
            return Ok(self);
        }
        Err(CalibrationError::new(
            format!(
                "the best pose leaves {:.1} px between where the target is seen and where it should be, and 0.1 to 0.5 px are usual",
                self.rms_px
            ),
            CONTRADICTED,
        ))
    }
}

/// By how much the platform turned between the first view and any other, at most, radians.
fn greatest_turn_rad(views: &[PlacedView]) -> f64 {
    let first = views[0].world_from_platform.rotation.inverse();
    let turns = views.iter().map(|view| {
        RigidMotion::to(&Pose::from_parts(
            Translation3::identity(),
            first * view.world_from_platform.rotation,
        ))
        .turn_rad
        .norm()
    });
    turns.fold(0.0, f64::max)
}

/// The axis on the platform about which it turned, if it turned about no other.
fn single_axis(views: &[PlacedView]) -> Option<Vector3<f64>> {
    let mut scatter = Matrix3::zeros();
    for (number, a) in views.iter().enumerate() {
        for b in &views[..number] {
            let turn = b.world_from_platform.rotation.inverse() * a.world_from_platform.rotation;
            let turned = Pose::from_parts(Translation3::identity(), turn);
            let turn_rad = RigidMotion::to(&turned).turn_rad;
            scatter += turn_rad * turn_rad.transpose();
        }
    }
    let eigen = scatter.symmetric_eigen();
    let most = eigen.eigenvalues.imax();
    let others = eigen.eigenvalues.sum() - eigen.eigenvalues[most];
    let axis = eigen.eigenvectors.column(most).into_owned();
    // Upwards, as a robot's vertical is.
    let axis = if axis.z < 0.0 { -axis } else { axis };
    (others < OTHER_TURNS * OTHER_TURNS * eigen.eigenvalues[most]).then_some(axis)
}

/// The least-squares problem. Its unknowns are six of the camera's pose, six of the target's (three of a single point), and the offset of the clocks.
#[derive(Clone)]
struct Mount<'a> {
    camera: &'a Camera,
    views: &'a [PlacedView<'a>],
    /// Whether the target is a single point, whose rotation means nothing.
    is_point: bool,
    fit_clock: bool,
    /// The axis along which the camera's position is kept, and that position.
    kept: Option<(Vector3<f64>, Vector3<f64>)>,
    camera_from_platform: Pose,
    world_from_target: Pose,
    time_offset_s: f64,
    used: Vec<Vec<bool>>,
}

impl Mount<'_> {
    const TARGET_AT: usize = 6;

    fn clock_at(&self) -> usize {
        Self::TARGET_AT + if self.is_point { 3 } else { 6 }
    }

    /// The platform's pose at the time of a view, by the offset of the clocks.
    fn world_from_platform(&self, view: &PlacedView) -> Pose {
        view.world_from_platform * view.rates.times(-self.time_offset_s).pose()
    }

    /// Starts at the given pose of the camera and, if that is rough, at those that the views themselves suggest.
    fn starts(&self, axis: Vector3<f64>, is_rough: bool) -> Vec<Self> {
        let mut poses = vec![self.camera_from_platform.inverse()];
        if is_rough
            && !self.is_point
            && let Some(suggested) = self.suggested()
        {
            let axis = Unit::new_normalize(axis);
            poses.extend((0..STARTS).filter_map(|turn| {
                let angle = std::f64::consts::TAU * f64::from(turn) / f64::from(STARTS);
                let rotation = Rotation3::from_axis_angle(&axis, angle) * suggested.rotation;
                self.placed(rotation)
            }));
        }
        poses
            .into_iter()
            .filter_map(|platform_from_camera| {
                Some(Self {
                    camera_from_platform: platform_from_camera.inverse(),
                    world_from_target: self.target_from(&platform_from_camera)?,
                    ..self.clone()
                })
            })
            .collect()
    }

    /// The poses of the target in the camera, from each view by itself.
    fn camera_from_target(&self) -> impl Iterator<Item = (Pose, Pose)> {
        self.views.iter().filter_map(|view| {
            let fit = closest_pose(self.camera, &view.view.correspondences, f64::INFINITY).ok()?;
            Some((view.world_from_platform, fit.camera_from_target))
        })
    }

    /// A rotation of the camera that takes the turns of the target in the camera to those of the platform (Park and Martin 1994); the position means nothing.
    fn suggested(&self) -> Option<Pose> {
        let views: Vec<_> = self.camera_from_target().collect();
        let (first_platform, first_target) = views.first()?;
        let mut correlation = Matrix3::zeros();
        for (platform, target) in &views[1..] {
            let of_platform = RigidMotion::to(&(first_platform.inverse() * platform)).turn_rad;
            let of_camera = RigidMotion::to(&(first_target * target.inverse())).turn_rad;
            correlation += of_platform * of_camera.transpose();
        }
        let svd = correlation.svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let sign = (u * v_t).determinant().signum();
        let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
        Some(Pose::from_parts(
            Translation3::identity(),
            Rotation3::from_matrix_unchecked(rotation),
        ))
    }

    /// The camera's pose with this rotation and the position that agrees best with the views, near the given one where they leave it open.
    fn placed(&self, rotation: Rotation3<f64>) -> Option<Pose> {
        let views: Vec<_> = self.camera_from_target().collect();
        let (first_platform, first_target) = views.first()?;
        // T₀ (R t + x) = Tᵢ (R tᵢ + x) for the target's origin t in the camera.
        let mut normal = Matrix3::from_diagonal_element(1e-6);
        let given = self.camera_from_platform.inverse().translation.vector;
        let mut right = normal * given;
        for (platform, target) in &views[1..] {
            let rows = first_platform.rotation.matrix() - platform.rotation.matrix();
            let seen = platform.rotation * (rotation * target.translation.vector)
                + platform.translation.vector
                - first_platform.rotation * (rotation * first_target.translation.vector)
                - first_platform.translation.vector;
            normal += rows.transpose() * rows;
            right += rows.transpose() * seen;
        }
        let position = normal.try_inverse()? * right;
        Some(Pose::from_parts(Translation3::from(position), rotation))
    }

    /// Where the target is if the camera is here: that of the first view with a pose, or where the rays of a single point meet.
    fn target_from(&self, platform_from_camera: &Pose) -> Option<Pose> {
        if !self.is_point {
            let (platform, target) = self.camera_from_target().next()?;
            return Some(platform * platform_from_camera * target);
        }
        let (mut normal, mut right) = (Matrix3::from_diagonal_element(1e-9), Vector3::zeros());
        for view in self.views {
            let [point] = &view.view.correspondences[..] else {
                return None;
            };
            let ray = self.camera.unproject(point.pixel)?;
            let world_from_camera = view.world_from_platform * platform_from_camera;
            let origin = (world_from_camera * Point3::from(ray.origin)).coords;
            let direction = world_from_camera.rotation * Vector3::from(ray.direction);
            let across = Matrix3::identity() - direction * direction.transpose();
            normal += across;
            right += across * origin;
        }
        let position = normal.try_inverse()? * right;
        Some(Pose::from_parts(
            Translation3::from(position),
            Rotation3::identity(),
        ))
    }

    /// Observed minus projected pixels.
    fn residuals_px(&self) -> Vec<Vec<Option<[f64; 2]>>> {
        let of_view = |view: &PlacedView| {
            let camera_from_target = self.camera_from_platform
                * self.world_from_platform(view).inverse()
                * self.world_from_target;
            super::pose::residuals_px(self.camera, &camera_from_target, &view.view.correspondences)
        };
        self.views.iter().map(of_view).collect()
    }

    fn finish(
        self,
        undetermined: Option<Vector3<f64>>,
        turned_rad: f64,
    ) -> Result<MountCalibration, CalibrationError> {
        let residuals_px = self.residuals_px();
        let mut outliers = 0;
        let mut inliers = Vec::new();
        let residuals = residuals_px.iter().flatten();
        for (residual, used) in residuals.zip(self.used.iter().flatten()) {
            match residual {
                Some(residual) if *used => inliers.push(*residual),
                _ => outliers += 1,
            }
        }
        let freedom = (2 * inliers.len()) as f64 - self.unknowns() as f64;
        let count = inliers.len() as f64;
        let rms_px = rms(inliers.into_iter());
        let covariance: DMatrix<f64> = covariance(&self).ok_or_else(|| {
            CalibrationError::new(
                "the views do not determine the camera's pose on the platform",
                "let the platform turn more, and drive nearer to the target and farther away",
            )
        })?;
        let sigma_px = rms_px * (count / freedom.max(1.0)).sqrt();
        let platform_from_camera = self.camera_from_platform.inverse();
        // Of the camera's pose: a rotation ω and a shift s of C = X⁻¹ move X's position -Cᵣᵀ c by Cᵣᵀ (ω × c - s), and turn it by -Cᵣᵀ ω.
        let inverse = *platform_from_camera.rotation.matrix();
        let mut of_step = Matrix6::zeros();
        let shifted = -(inverse * self.camera_from_platform.translation.vector.cross_matrix());
        of_step.fixed_view_mut::<3, 3>(0, 0).copy_from(&shifted);
        of_step.fixed_view_mut::<3, 3>(0, 3).copy_from(&-inverse);
        of_step.fixed_view_mut::<3, 3>(3, 0).copy_from(&-inverse);
        let step = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let variances: Vector6<f64> = (of_step * step * of_step.transpose()).diagonal();
        let sigma = |i: usize| sigma_px * variances[i].max(0.0).sqrt();
        let kept = |i: usize| undetermined.is_some_and(|axis| axis[i].abs() > 0.99);
        let clock = self.clock_at();
        Ok(MountCalibration {
            platform_from_camera,
            position_sigma_m: [0, 1, 2].map(|i| if kept(i) { 0.0 } else { sigma(i) }),
            turn_sigma_rad: [3, 4, 5].map(sigma),
            world_from_target: self.world_from_target,
            time_offset_s: self.fit_clock.then(|| {
                [
                    self.time_offset_s,
                    sigma_px * covariance[(clock, clock)].sqrt(),
                ]
            }),
            undetermined: undetermined.map(Into::into),
            used_views: self.views.len(),
            outliers,
            rms_px,
            turned_rad,
        })
    }
}

impl Problem for Mount<'_> {
    fn unknowns(&self) -> usize {
        self.clock_at() + usize::from(self.fit_clock)
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        let step = step.as_slice();
        let mut next = self.clone();
        next.camera_from_platform = stepped_pose(&self.camera_from_platform, &step[..6]);
        let mut of_target = [0.0; 6];
        let given = &step[Self::TARGET_AT..self.clock_at()];
        of_target[6 - given.len()..].copy_from_slice(given);
        next.world_from_target = stepped_pose(&self.world_from_target, &of_target);
        if self.fit_clock {
            next.time_offset_s += step[self.clock_at()];
        }
        Some(next)
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        let camera_from_platform = &self.camera_from_platform;
        for (view, used) in self.views.iter().zip(&self.used) {
            let platform_from_world = self.world_from_platform(view).inverse();
            let camera_from_world = camera_from_platform * platform_from_world;
            let points = view.view.correspondences.iter().zip(used);
            for (point, _) in points.filter(|(_, used)| **used) {
                let in_world = self.world_from_target * Point3::from(point.point_m);
                let on_platform = platform_from_world * in_world;
                let in_camera = camera_from_platform * on_platform;
                let Some(jacobian) = self.camera.project_with_jacobian(in_camera.into()) else {
                    visit(None, Slopes { blocks: &[] });
                    continue;
                };
                let rotated = in_camera.coords - camera_from_platform.translation.vector;
                let by_camera = slopes_by_pose(rotated, &jacobian);
                let by_world = ProjectionJacobian {
                    by_point: jacobian.by_point.map(|row| {
                        (camera_from_world.rotation.inverse() * Vector3::from(row)).into()
                    }),
                    ..jacobian
                };
                let turned = in_world.coords - self.world_from_target.translation.vector;
                let by_target = slopes_by_pose(turned, &by_world);
                // A later clock puts the platform where it was before: what is at rest moves with its rates.
                let moved_m =
                    view.rates.velocity_m + view.rates.turn_rad.cross(&on_platform.coords);
                let moved_m = camera_from_platform.rotation * moved_m;
                let by_clock = jacobian
                    .by_point
                    .map(|row| Vector3::from(row).dot(&moved_m));
                let [u, v] = by_world.pixel;
                let residual = Some([u - point.pixel[0], v - point.pixel[1]]);
                let target = &by_target[if self.is_point { 3 } else { 0 }..];
                let clock = [by_clock];
                let blocks = [
                    (0, &by_camera[..]),
                    (Self::TARGET_AT, target),
                    (self.clock_at(), &clock[..]),
                ];
                let count = if self.fit_clock { 3 } else { 2 };
                visit(
                    residual,
                    Slopes {
                        blocks: &blocks[..count],
                    },
                );
            }
        }
        if let Some((axis, position_m)) = &self.kept {
            // The position is -Rᵀ t, and a rotation ω and a shift s of the pose move it by Rᵀ (ω × t - s).
            let turned = camera_from_platform.rotation * axis;
            let t = camera_from_platform.translation.vector;
            let by_turn = t.cross(&turned) * KEPT_PX_PER_M;
            let by_shift = -turned * KEPT_PX_PER_M;
            let slopes = [by_turn, by_shift].map(|slopes| [0, 1, 2].map(|k| [slopes[k], 0.0]));
            let position = camera_from_platform.inverse().translation.vector;
            let off_px = axis.dot(&(position - position_m)) * KEPT_PX_PER_M;
            let blocks = [(0, slopes.as_flattened())];
            visit(Some([off_px, 0.0]), Slopes { blocks: &blocks });
        }
    }
}
