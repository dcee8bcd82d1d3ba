//! Symbols of cameras in plots.

use std::f64::consts::PI;

use nalgebra::{Point3, Rotation3, Vector3};
use pardalis_camera::{Camera, Pose};
use pardalis_scene::Scene;

/// A camera to be drawn.
#[derive(Debug, Clone)]
pub(crate) struct CameraSymbol {
    /// Its name, written beside it.
    pub(crate) name: String,
    /// Its pose, in metres; the camera looks along its z axis.
    pub(crate) world_from_camera: Pose,
    /// Whether the camera looks into a mirror.
    pub(crate) looks_into_mirror: bool,
    /// Where it was before, in metres; empty if it is at rest.
    pub(crate) way_m: Vec<[f64; 3]>,
}

impl CameraSymbol {
    /// Returns the cameras of a scene whose positions are known. Cameras that are calibrated by a plane are drawn
    /// looking straight down because their orientation is unknown.
    pub(crate) fn of_scene(scene: &Scene) -> Vec<Self> {
        let cameras = scene.cameras.iter().filter_map(|camera| {
            let world_from_camera = match camera.camera {
                Camera::Plane(_) => {
                    let down = Rotation3::from_axis_angle(&Vector3::x_axis(), PI);
                    let place = Vector3::from(camera.position_m()?);
                    Pose::from_parts(place.into(), down)
                }
                _ => camera.world_from_camera,
            };
            Some(Self {
                name: camera.name.clone(),
                world_from_camera,
                looks_into_mirror: camera.camera.looks_into_mirror(),
                way_m: Vec::new(),
            })
        });
        cameras.collect()
    }

    /// Puts the camera at the last of its poses in the world, which it has reached through the others.
    #[must_use]
    pub(crate) fn moved<'p>(
        self,
        poses: impl DoubleEndedIterator<Item = &'p Pose> + Clone,
    ) -> Self {
        let Some(latest) = poses.clone().next_back() else {
            return self;
        };
        Self {
            world_from_camera: *latest,
            way_m: poses.map(|pose| pose.translation.vector.into()).collect(),
            ..self
        }
    }

    /// Returns the position in the world, in metres.
    pub(super) fn position_m(&self) -> [f64; 3] {
        self.world_from_camera.translation.vector.into()
    }

    /// Returns a pyramid that opens in the viewing direction, with its tip at the camera, as lines of world points in
    /// metres. For a camera with a mirror, adds the mirror's rim and its bulge. `length_m` is the length of the
    /// pyramid.
    pub(super) fn outline_m(&self, length_m: f64) -> Vec<Vec<[f64; 3]>> {
        let world = |camera: [f64; 3]| -> [f64; 3] {
            let offset = self.world_from_camera.rotation * (length_m * Vector3::from(camera));
            (Point3::from(self.position_m()) + offset).into()
        };
        let corners = [[-0.45, -0.35], [0.45, -0.35], [0.45, 0.35], [-0.45, 0.35]];
        let base = corners.map(|[x, y]| world([x, y, 1.0]));
        let tip = self.position_m();
        let mut lines: Vec<Vec<[f64; 3]>> = (0..4)
            .map(|i| vec![tip, base[i], base[(i + 1) % 4], tip])
            .collect();
        if self.looks_into_mirror {
            let around = |i: usize| libm::sincos((i as f64 * 7.5).to_radians());
            let rim = (0..=48)
                .map(around)
                .map(|(sin, cos)| world([0.9 * cos, 0.9 * sin, 2.2]));
            lines.push(rim.collect());
            // Two meridians of the bulge, whose lowest point faces the camera.
            for turned in [false, true] {
                let meridian = (-6..=6).map(|i| {
                    let r = 0.15 * f64::from(i);
                    let z = 1.5 + 0.7 * (r / 0.9).powi(2);
                    world(if turned { [0.0, r, z] } else { [r, 0.0, z] })
                });
                lines.push(meridian.collect());
            }
        }
        lines
    }
}
