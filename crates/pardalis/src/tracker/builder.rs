//! Assembles a tracker from cameras and targets.

use super::carriers::Carriers;
use super::{CameraId, PlatformId, TargetId, TargetSettings, Tracker};
use crate::platform::Platform;
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// Collects cameras and targets, and builds a [`Tracker`]; see [`Tracker::builder`].
#[derive(Debug)]
pub struct TrackerBuilder {
    views: Vec<View>,
    carriers: Carriers,
    targets: Vec<TargetSettings>,
    seed: u32,
}

impl Tracker {
    /// Returns a builder without cameras and targets.
    pub fn builder() -> TrackerBuilder {
        TrackerBuilder {
            views: Vec::new(),
            carriers: Carriers::default(),
            targets: Vec::new(),
            seed: 1,
        }
    }
}

impl TrackerBuilder {
    /// Adds a camera. The returned identifier is that of its frames.
    pub fn camera(&mut self, view: View) -> CameraId {
        self.views.push(view);
        CameraId::new(self.views.len() - 1)
    }

    /// Adds a moving platform: a robot, a pan-tilt head, an arm. Report its motion with [`Tracker::observe_pose`] or [`Tracker::observe_increment`].
    pub fn platform(&mut self, platform: Platform) -> PlatformId {
        self.carriers.add(platform)
    }

    /// Adds a camera that is fixed on a platform. The view's pose is the camera's pose on the platform, `platform_from_camera`, in place of that in the world.
    ///
    /// Returns an error if the platform is unknown.
    pub fn camera_on(&mut self, platform: PlatformId, view: View) -> Result<CameraId, Error> {
        let camera = self.views.len();
        self.carriers
            .carry(platform, camera, *view.world_from_camera())?;
        Ok(self.camera(view))
    }

    /// Adds a target: [detected](super::DetectedSettings), [initialised](super::InitializedSettings) or with
    /// several landmarks ([`TargetSettings`]). The returned identifier is that of its estimates.
    pub fn target(&mut self, settings: impl Into<TargetSettings>) -> TargetId {
        self.targets.push(settings.into());
        TargetId::new(self.targets.len() - 1)
    }

    /// Sets the seed of all random numbers; 1 by default. The same seed and frames give the same estimates.
    pub fn seed(&mut self, seed: u32) -> &mut Self {
        self.seed = seed;
        self
    }

    /// Builds the tracker.
    ///
    /// Returns an error if there is no camera or no target, settings are out of range, a target has no bodies, or a
    /// start lies outside its camera's image.
    pub fn build(self) -> Result<Tracker, Error> {
        let missing = |what: &str, remedy: &str| Error::Empty {
            what: what.to_owned(),
            remedy: remedy.to_owned(),
        };
        if self.views.is_empty() {
            return Err(missing("the list of cameras", "add one with `camera`"));
        }
        if self.targets.is_empty() {
            return Err(missing("the list of targets", "add one with `target`"));
        }
        let mut tracker = Tracker::new(self.views, self.targets, self.seed, Level::best())?;
        tracker.carriers = self.carriers;
        Ok(tracker)
    }
}
