//! A camera with model, pose, mask, look-up tables and previous frame. It prepares frames for look-ups.

use crate::Frame;
use crate::color::{ColorRanges, MatchTable, Palette, PixelKind, PixelTable};
use crate::rolling_shutter::RowMotion;
use nalgebra::{Point3, Vector3};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Mask};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// How a camera moves, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CameraMotion {
    /// Of the camera's origin, m/s.
    pub(crate) velocity_mps: Vector3<f64>,
    /// About the axes of the world, rad/s.
    pub(crate) turn_radps: Vector3<f64>,
}

/// A camera with its pose, its projection model and the mask of the pixels to use.
#[derive(Debug, Clone)]
pub struct View {
    camera: Camera,
    world_from_camera: Pose,
    camera_from_world: Pose,
    width: usize,
    height: usize,
    mask: Option<Mask>,
    line_delay_s: f64,
    /// How much later than the frame set its latest frame is, in seconds: not positive, as the set has the time of its latest frame.
    later_s: f64,
    /// How the camera moves, if it is on a platform.
    motion: Option<CameraMotion>,
    tables: Vec<(Palette, PixelKind, PixelTable)>,
    match_tables: Vec<(ColorRanges, PixelKind, MatchTable)>,
    /// The previous frame, if it was kept.
    before: Option<Frame>,
}

impl View {
    /// Creates a view of a camera with images of this width and height in pixels.
    ///
    /// Returns an error if images cannot have this size, or the mask has another.
    pub fn new(
        camera: impl Into<Camera>,
        world_from_camera: Pose,
        (width, height): (usize, usize),
        mask: Option<Mask>,
    ) -> Result<Self, Error> {
        if [width, height]
            .iter()
            .any(|side| !(1..=MAX_IMAGE_SIDE_PX).contains(side))
        {
            return Err(Error::ImageSize { width, height });
        }
        if let Some(mask) = &mask {
            let found = (mask.width(), mask.height());
            if found != (width, height) {
                return Err(Error::SizeMismatch {
                    what: "the mask".to_owned(),
                    expected: (width, height),
                    found,
                });
            }
        }
        let camera_from_world = world_from_camera.inverse();
        Ok(Self {
            camera: camera.into(),
            world_from_camera,
            camera_from_world,
            width,
            height,
            mask,
            line_delay_s: 0.0,
            later_s: 0.0,
            motion: None,
            tables: Vec::new(),
            match_tables: Vec::new(),
            before: None,
        })
    }

    /// Sets the time from the exposure of one row to that of the next, in seconds: the readout time over the number of rows, for cameras with a rolling shutter. Negative if the
    /// lowest row is exposed first. The middle row is exposed at the time of the frame. Detected targets take it into account, initialised ones do not.
    ///
    /// Returns an error unless it lies within ±0.001 s.
    pub fn with_line_delay_s(mut self, line_delay_s: f64) -> Result<Self, Error> {
        if !(line_delay_s.abs() <= 1e-3) {
            let allowed = "-0.001 to 0.001";
            return Err(Error::out_of_range("line_delay_s", line_delay_s, allowed));
        }
        self.line_delay_s = line_delay_s;
        Ok(self)
    }

    /// Returns the time from the exposure of one row to that of the next, in seconds; 0 if all rows are exposed at once.
    pub fn line_delay_s(&self) -> f64 {
        self.line_delay_s
    }

    /// Returns the view without the difference in time between its latest frame and the frame set, for positions at the time of its own frame.
    pub fn at_its_frame(mut self) -> Self {
        self.later_s = 0.0;
        self
    }

    /// Sets how much later than the frame set its frame is, in seconds.
    pub(crate) fn set_later_s(&mut self, later_s: f64) {
        self.later_s = later_s;
    }

    /// Returns where a body was, in metres, when the rows that show it were exposed, given its position (metres) and velocity (m/s) at the time of the frame set. Differs from its
    /// position only with a rolling shutter, or if another frame of the set is later.
    pub fn shown_position_m(&self, position_m: [f64; 3], velocity_mps: [f64; 3]) -> [f64; 3] {
        let Some(motion) = self.row_motion(position_m, velocity_mps) else {
            return position_m;
        };
        let place_m = self.camera_from_world * Point3::from(position_m);
        let shown_m = motion.shown_m(place_m.coords);
        (self.world_from_camera * Point3::from(shown_m)).into()
    }

    /// The greatest time between that of the frame set and the exposure of a row, in seconds.
    pub(crate) fn skew_s(&self) -> f64 {
        self.later_s.abs() + 0.5 * self.height as f64 * self.line_delay_s.abs()
    }

    /// Moves the camera to a pose, where it has this motion.
    pub(crate) fn place(&mut self, world_from_camera: Pose, motion: CameraMotion) {
        self.world_from_camera = world_from_camera;
        self.camera_from_world = world_from_camera.inverse();
        self.motion = Some(motion);
    }

    /// Returns whether the camera may move.
    pub(crate) fn is_moving(&self) -> bool {
        self.motion.is_some()
    }

    /// The velocity, in m/s in the world, of a body at a position (metres) with a velocity (m/s), relative to a body there that moves with the camera.
    pub(crate) fn relative_velocity_mps(
        &self,
        position_m: [f64; 3],
        velocity_mps: [f64; 3],
    ) -> Vector3<f64> {
        let velocity_mps = Vector3::from(velocity_mps);
        let Some(motion) = &self.motion else {
            return velocity_mps;
        };
        let lever_m = Vector3::from(position_m) - self.world_from_camera.translation.vector;
        velocity_mps - motion.velocity_mps - motion.turn_radps.cross(&lever_m)
    }

    /// The motion of a body at a position (metres) with a velocity (m/s) between the time of the frame set and the exposure of its rows; `None` as for [`RowMotion::new`].
    pub(crate) fn row_motion(
        &self,
        position_m: [f64; 3],
        velocity_mps: [f64; 3],
    ) -> Option<RowMotion> {
        let middle = self.camera_from_world * Point3::from(position_m);
        let velocity_mps = self.relative_velocity_mps(position_m, velocity_mps);
        let velocity = self.camera_from_world.rotation * velocity_mps;
        let rows = (self.height, self.line_delay_s);
        RowMotion::new(&self.camera, rows, self.later_s, middle.coords, velocity)
    }

    /// Returns whether a place in the world, in metres, has an unmasked pixel.
    pub(crate) fn holds(&self, place_m: [f64; 3]) -> bool {
        let place = self.camera_from_world * Point3::from(place_m);
        let pixel = self.camera.project(place.into());
        pixel.is_some_and(|pixel| self.holds_point(pixel.map(|v| v as f32)))
    }

    /// Returns whether a point of the image lies on an unmasked pixel.
    pub(crate) fn holds_point(&self, point: [f32; 2]) -> bool {
        let [x, y] = point.map(|v| (v + 0.5).floor());
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32;
        inside && self.is_open(x as usize, y as usize)
    }

    /// Returns whether a pixel of the image is not masked.
    pub(crate) fn is_open(&self, column: usize, row: usize) -> bool {
        let open = self.mask.as_ref().map(Mask::open);
        open.is_none_or(|open| open[row * self.width + column])
    }

    /// Returns the projection model.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns the camera's pose: of a camera on a platform, that of its latest frame.
    pub fn world_from_camera(&self) -> &Pose {
        &self.world_from_camera
    }

    /// Returns the inverse of the camera's pose.
    pub fn camera_from_world(&self) -> &Pose {
        &self.camera_from_world
    }

    /// The point that outlines are seen from, in the world, metres.
    pub(crate) fn viewpoint_m(&self) -> Vector3<f64> {
        let viewpoint = Point3::from(self.camera().viewpoint_m());
        (self.world_from_camera() * viewpoint).coords
    }

    /// Returns the width and height of the images in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Returns the mask of the pixels to use; `None` for all pixels.
    pub fn mask(&self) -> Option<&Mask> {
        self.mask.as_ref()
    }

    /// Returns an error for a frame that does not have this camera's size.
    pub fn check(&self, frame: &Frame) -> Result<(), Error> {
        let found = (frame.width(), frame.height());
        if found != self.size() {
            return Err(Error::SizeMismatch {
                what: "the image".to_owned(),
                expected: self.size(),
                found,
            });
        }
        Ok(())
    }

    /// Prepares the table from pixels of this kind to the bins of a palette. Tables are kept from frame to frame.
    pub fn prepare(&mut self, kind: PixelKind, palette: Palette) {
        if !self
            .tables
            .iter()
            .any(|&(p, k, _)| (p, k) == (palette, kind))
        {
            self.tables
                .push((palette, kind, PixelTable::new(palette, kind)));
        }
    }

    /// Prepares the table of pixels of this kind in ranges of colour. Tables are kept from frame to frame.
    pub fn prepare_ranges(&mut self, kind: PixelKind, ranges: ColorRanges) {
        if !self
            .match_tables
            .iter()
            .any(|&(r, k, _)| (r, k) == (ranges, kind))
        {
            self.match_tables
                .push((ranges, kind, MatchTable::new(&ranges, kind)));
        }
    }

    /// Keeps a frame of this camera's size for comparison with the next one.
    pub fn keep(&mut self, frame: Frame) {
        self.before = Some(frame);
    }

    /// Returns a frame of this camera for look-ups in the palettes and ranges that were prepared ([`View::prepare`],
    /// [`View::prepare_ranges`]).
    pub fn prepared<'a>(&'a self, frame: &'a Frame) -> PreparedFrame<'a> {
        PreparedFrame {
            view: self,
            frame,
            kind: PixelKind::of(frame),
        }
    }
}

/// One frame of one camera, prepared for look-ups; shared by all targets.
#[derive(Debug, Clone, Copy)]
pub struct PreparedFrame<'a> {
    view: &'a View,
    frame: &'a Frame,
    kind: PixelKind,
}

impl<'a> PreparedFrame<'a> {
    /// Returns the camera that took the frame.
    pub fn view(&self) -> &'a View {
        self.view
    }

    /// Returns the frame.
    pub fn frame(&self) -> &'a Frame {
        self.frame
    }

    /// Returns the camera's previous frame, of the same size, if it was kept ([`View::keep`]).
    pub fn before(&self) -> Option<&'a Frame> {
        self.view.before.as_ref()
    }

    /// Returns the table from this frame's pixels to the bins of a palette.
    ///
    /// Panics if the table was not prepared ([`View::prepare`]).
    pub fn table(&self, palette: Palette) -> &'a PixelTable {
        let found = self
            .view
            .tables
            .iter()
            .find(|&&(p, k, _)| (p, k) == (palette, self.kind));
        &found.expect("View::prepare was called before").2
    }

    /// Returns the table of this frame's pixels in ranges of colour.
    ///
    /// Panics if the table was not prepared ([`View::prepare_ranges`]).
    pub fn match_table(&self, ranges: ColorRanges) -> &'a MatchTable {
        let found = self
            .view
            .match_tables
            .iter()
            .find(|&&(r, k, _)| (r, k) == (ranges, self.kind));
        &found.expect("View::prepare_ranges was called before").2
    }
}
