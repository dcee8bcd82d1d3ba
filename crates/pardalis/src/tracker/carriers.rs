//! The platforms that carry cameras: sets the poses of these cameras at the time of each frame set, and computes how uncertain positions in the world are because of the platforms.

use nalgebra::{Matrix3, Vector3};
use pardalis_camera::Pose;

use super::PlatformId;
use crate::platform::{Platform, PlatformState};
use crate::view::{CameraMotion, View};
use pardalis_core::Error;

/// Platforms, and which cameras they carry.
#[derive(Debug, Clone, Default)]
pub(super) struct Carriers {
    platforms: Vec<Carrier>,
    cameras: Vec<CarriedCamera>,
}

/// A platform, as it was at the latest frame set.
#[derive(Debug, Clone)]
struct Carrier {
    platform: Platform,
    state: Option<PlatformState>,
    /// Frame sets at whose time it had no pose.
    unplaced: usize,
}

#[derive(Debug, Clone, Copy)]
struct CarriedCamera {
    camera: usize,
    platform: usize,
    platform_from_camera: Pose,
}

impl Carriers {
    pub(super) fn is_empty(&self) -> bool {
        self.cameras.is_empty()
    }

    pub(super) fn add(&mut self, platform: Platform) -> PlatformId {
        self.platforms.push(Carrier {
            platform,
            state: None,
            unplaced: 0,
        });
        PlatformId::new(self.platforms.len() - 1)
    }

    /// Fixes a camera on a platform.
    pub(super) fn carry(
        &mut self,
        platform: PlatformId,
        camera: usize,
        platform_from_camera: Pose,
    ) -> Result<(), Error> {
        platform.check(self.platforms.len())?;
        self.cameras.push(CarriedCamera {
            camera,
            platform: platform.index(),
            platform_from_camera,
        });
        Ok(())
    }

    pub(super) fn platform(&self, platform: PlatformId) -> Result<&Platform, Error> {
        platform.check(self.platforms.len())?;
        Ok(&self.platforms[platform.index()].platform)
    }

    pub(super) fn platform_mut(&mut self, platform: PlatformId) -> Result<&mut Platform, Error> {
        platform.check(self.platforms.len())?;
        Ok(&mut self.platforms[platform.index()].platform)
    }

    /// The number of frame sets at whose time a platform had no pose.
    pub(super) fn unplaced(&self, platform: PlatformId) -> Result<usize, Error> {
        platform.check(self.platforms.len())?;
        Ok(self.platforms[platform.index()].unplaced)
    }

    /// Moves the cameras of all platforms to where they are at a time in seconds.
    pub(super) fn place(&mut self, views: &mut [View], time_s: f64) {
        for carrier in &mut self.platforms {
            carrier.state = carrier.platform.state_at(time_s);
            carrier.unplaced += usize::from(carrier.state.is_none());
        }
        for carried in &self.cameras {
            let Some(state) = &self.platforms[carried.platform].state else {
                continue;
            };
            let world_from_camera = state.world_from_platform * carried.platform_from_camera;
            let lever_m =
                world_from_camera.translation.vector - state.world_from_platform.translation.vector;
            let motion = CameraMotion {
                velocity_mps: state.velocity_mps + state.turn_radps.cross(&lever_m),
                turn_radps: state.turn_radps,
            };
            views[carried.camera].place(world_from_camera, motion);
        }
    }

    /// Whether it is known where a camera was at the latest frame set.
    pub(super) fn is_placed(&self, camera: usize) -> bool {
        let carried = self.carried(camera);
        carried.is_none_or(|carried| self.platforms[carried.platform].state.is_some())
    }

    /// What takes places in the world at a time (seconds) to where they are at a later one, if poses jumped in between and no camera is at rest.
    pub(super) fn jumped(&self, cameras: usize, before_s: f64, now_s: f64) -> Option<Pose> {
        let [carrier] = &self.platforms[..] else {
            // Other cameras keep the world where it is.
            return None;
        };
        let carries_all = self.cameras.len() == cameras;
        carrier
            .platform
            .jumped(before_s, now_s)
            .filter(|_| carries_all)
    }

    /// The covariance, in m², of a position in the world (metres) because of the poses of platforms, if these cameras see what is there.
    ///
    /// Cameras weigh the same. Their own errors are not included.
    pub(super) fn covariance_m2(
        &self,
        position_m: [f64; 3],
        cameras: impl Iterator<Item = usize> + Clone,
    ) -> Matrix3<f64> {
        let count = cameras.clone().count().max(1) as f64;
        let of_carrier = |(number, carrier): (usize, &Carrier)| {
            let is_on = |camera: &usize| {
                let carried = self.carried(*camera);
                carried.is_some_and(|carried| carried.platform == number)
            };
            let share = cameras.clone().filter(is_on).count() as f64 / count;
            let state = carrier.state.as_ref()?;
            let platform_m = state.world_from_platform.translation.vector;
            let of_point = (state.covariance).of_point_m2(&platform_m, &Vector3::from(position_m));
            Some(share * share * of_point)
        };
        let carriers = self.platforms.iter().enumerate();
        carriers.filter_map(of_carrier).sum()
    }

    fn carried(&self, camera: usize) -> Option<&CarriedCamera> {
        self.cameras.iter().find(|carried| carried.camera == camera)
    }
}
