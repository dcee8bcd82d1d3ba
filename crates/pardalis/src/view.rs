//! One camera over time: model, pose, mask, look-up tables and the frame before. It prepares frames for look-ups.

use crate::Frame;
use crate::color::{ColorRanges, MatchTable, Palette, PixelKind, PixelTable};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Mask};
use pardalis_core::Error;

/// One camera: where it stands, how it projects, which of its pixels count.
#[derive(Debug, Clone)]
pub struct View {
    camera: Camera,
    world_from_camera: Pose,
    camera_from_world: Pose,
    width: usize,
    height: usize,
    mask: Option<Mask>,
    tables: Vec<(Palette, PixelKind, PixelTable)>,
    match_tables: Vec<(ColorRanges, PixelKind, MatchTable)>,
    /// Its frame before the one at hand, where it was kept.
    before: Option<Frame>,
}

impl View {
    /// A camera whose images have this size in pixels. The mask, if there is one, has the images' size.
    pub fn new(
        camera: impl Into<Camera>,
        world_from_camera: Pose,
        (width, height): (usize, usize),
        mask: Option<Mask>,
    ) -> Result<Self, Error> {
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
            tables: Vec::new(),
            match_tables: Vec::new(),
            before: None,
        })
    }

    /// The projection model.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The camera's pose.
    pub fn world_from_camera(&self) -> &Pose {
        &self.world_from_camera
    }

    /// The inverse of the camera's pose.
    pub fn camera_from_world(&self) -> &Pose {
        &self.camera_from_world
    }

    /// Width and height of its images in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Which pixels count; all of them if there is no mask.
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

    /// Makes sure that pixels of this kind can be looked up in a palette. Tables are kept from frame to frame.
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

    /// Makes sure that pixels of this kind can be compared with ranges of colour. Tables are kept from frame to frame.
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

    /// Keeps a frame of its size to compare the next one with.
    pub fn keep(&mut self, frame: Frame) {
        self.before = Some(frame);
    }

    /// A frame of this camera, for look-ups in the palettes and ranges it was prepared for ([`View::prepare`], [`View::prepare_ranges`]).
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
    /// The camera that took the frame.
    pub fn view(&self) -> &'a View {
        self.view
    }

    /// The frame.
    pub fn frame(&self) -> &'a Frame {
        self.frame
    }

    /// The camera's frame before this one, of the same size, where it was kept ([`View::keep`]).
    pub fn before(&self) -> Option<&'a Frame> {
        self.view.before.as_ref()
    }

    /// The table from this frame's pixels to the bins of a palette that it was prepared for ([`View::prepare`]).
    ///
    /// Panics when it was not.
    pub fn table(&self, palette: Palette) -> &'a PixelTable {
        let found = self
            .view
            .tables
            .iter()
            .find(|&&(p, k, _)| (p, k) == (palette, self.kind));
        &found.expect("View::prepare comes before look-ups").2
    }

    /// The table of this frame's pixels that lie in ranges that it was prepared for ([`View::prepare_ranges`]).
    ///
    /// Panics when it was not.
    pub fn match_table(&self, ranges: ColorRanges) -> &'a MatchTable {
        let found = self
            .view
            .match_tables
            .iter()
            .find(|&&(r, k, _)| (r, k) == (ranges, self.kind));
        &found.expect("View::prepare_ranges comes before look-ups").2
    }
}
