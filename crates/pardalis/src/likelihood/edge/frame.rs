//! One camera's frame, prepared for the edge cue of one target.

use nalgebra::{Point3, Vector3};

use super::super::outline::Projector;
use crate::color::{
    COARSEST_OCTAVE, ColorRanges, IlluminationCorrection, MatchTable, Palette, PixelKind,
    PixelTable,
};
use crate::frame::with_pixels;
use crate::rolling_shutter::RowMotion;
use crate::view::PreparedFrame;
use pardalis_camera::LANES;
use pardalis_core::simd::Level;

/// The pixels of a row that are converted at once.
pub(super) const CHUNK: usize = 16;

/// The mean colour of a pixel of an octave (Y, U and V), and 1 if most of it is in the target's colours, 0 if not, NaN if part of it is masked.
pub(super) type OctavePixel = [f32; 4];

/// An octave of the image pyramid: its pixels are means of 2ⁿ x 2ⁿ pixels of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct Octave(pub(super) u8);

impl Octave {
    /// The coarsest octave.
    pub(super) const COARSEST: Self = Self(COARSEST_OCTAVE);
    /// Coarser octaves average every second, fourth, ... pixel of a block in each direction only. Hand-set: 16 pixels make a mean sharp enough.
    const SAMPLED: u8 = 2;

    /// The frame's pixels that one pixel of the octave covers in each direction.
    pub(super) fn pixels(self) -> usize {
        1 << self.0
    }

    /// The octave's pixels per pixel of the frame: 1, 1/2, 1/4, ...
    pub(super) fn scale(self) -> f32 {
        f32::from_bits((127 - u32::from(self.0)) << 23)
    }

    /// Maps a coordinate of the frame to the octave. Integers are pixel centres in both.
    pub(super) fn coordinate(self, frame_px: f32) -> f32 {
        frame_px * self.scale() + 0.5 * (self.scale() - 1.0)
    }

    /// The size of the octave of a frame; pixels that the frame does not cover wholly are left out.
    pub(super) fn size(self, (width, height): (usize, usize)) -> (usize, usize) {
        (width >> self.0, height >> self.0)
    }
}

/// Groups of neighbouring lines that are visible or occluded together. Hand-set.
pub(crate) const SECTORS: usize = 16;

/// The mean Y, U and V of what surrounds a body in an image, sector by sector; NaN for sectors without such pixels.
pub(crate) type Surrounding = [[f32; 3]; SECTORS];

/// Outlines in one camera's image, as closed polygons.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outlines {
    /// The points of all outlines, u and v in pixels.
    points: Vec<[f32; 2]>,
    /// Where each outline's points end.
    ends: Vec<usize>,
    /// The box around each outline: its least and its greatest u and v.
    boxes: Vec<[[f32; 2]; 2]>,
    /// Whether the body within each outline has been found in this image.
    found: Vec<bool>,
}

impl Outlines {
    /// Removes all outlines.
    pub(crate) fn clear(&mut self) {
        self.points.clear();
        self.ends.clear();
        self.boxes.clear();
        self.found.clear();
    }

    /// Adds the outline of a body, given whether that has been found in this image.
    pub(super) fn push(&mut self, points: impl Iterator<Item = [f32; 2]>, is_found: bool) {
        let first = self.points.len();
        self.points.extend(points);
        self.ends.push(self.points.len());
        let around = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
        let around = self.points[first..]
            .iter()
            .fold(around, |[least, most], point| {
                [
                    [0, 1].map(|axis| point[axis].min(least[axis])),
                    [0, 1].map(|axis| point[axis].max(most[axis])),
                ]
            });
        self.boxes.push(around);
        self.found.push(is_found);
    }

    /// Returns whether a point of the image lies within any outline, or within one of those of bodies that have been found (even-odd rule).
    fn contain(&self, [u, v]: [f32; 2], only_found: bool) -> bool {
        let mut start = 0;
        let bodies = self.boxes.iter().zip(&self.found);
        self.ends
            .iter()
            .zip(bodies)
            .any(|(&end, (around, is_found))| {
                let outline = &self.points[start..end];
                start = end;
                let [[u_min, v_min], [u_max, v_max]] = *around;
                let is_near = (u_min..=u_max).contains(&u) && (v_min..=v_max).contains(&v);
                if !is_near || (only_found && !is_found) {
                    return false;
                }
                let next = outline.iter().cycle().skip(1);
                let crossed = outline.iter().zip(next).filter(|([u0, v0], [u1, v1])| {
                    (*v0 > v) != (*v1 > v) && u < u0 + (v - v0) / (v1 - v0) * (u1 - u0)
                });
                crossed.count() % 2 == 1
            })
    }
}

/// What the edge cue knows of one camera before it looks at its frame.
pub(crate) struct EdgeFrameContext<'a> {
    /// The palette and the ranges of the target's colours.
    pub(crate) colors: (Palette, Option<ColorRanges>),
    /// The colour posterior of each bin of the palette.
    pub(crate) posterior: &'a [f64],
    /// From this posterior on a pixel counts as the target's.
    pub(crate) min_posterior: f64,
    /// Maps pixels to the illumination in which the colours were learnt.
    pub(crate) correction: IlluminationCorrection,
    /// What surrounded the target when this camera saw it last.
    pub(crate) surrounding: Option<&'a Surrounding>,
    /// The outlines of look-alikes: an edge between the target and them is invisible.
    pub(crate) look_alikes: &'a Outlines,
    /// How the target moves while the rows of a rolling shutter are exposed.
    pub(crate) motion: Option<RowMotion>,
    /// The standard deviation of errors of the camera's pose, focal length and clock, in pixels; 0 for a camera without error.
    pub(crate) offset_sigma_px: f64,
}

/// One camera's frame, prepared for the edge cue of one target.
pub(crate) struct EdgeFrame<'a> {
    camera: usize,
    prepared: PreparedFrame<'a>,
    projector: Projector<'a>,
    kind: PixelKind,
    /// The bins of the palette.
    bins: &'a PixelTable,
    /// Pixels outside of these ranges are not the target's.
    in_ranges: Option<&'a MatchTable>,
    context: EdgeFrameContext<'a>,
}

impl<'a> EdgeFrame<'a> {
    /// A frame of the camera of this number. It must have been prepared for the context's palette and ranges.
    pub(crate) fn new(
        camera: usize,
        prepared: PreparedFrame<'a>,
        context: EdgeFrameContext<'a>,
    ) -> Self {
        Self {
            camera,
            prepared,
            projector: Projector::moving(prepared.view(), context.motion.as_ref()),
            kind: PixelKind::of(prepared.frame()),
            bins: prepared.table(context.colors.0),
            in_ranges: context.colors.1.map(|ranges| prepared.match_table(ranges)),
            context,
        }
    }

    /// The camera's number.
    pub(crate) fn camera(&self) -> usize {
        self.camera
    }

    pub(crate) fn prepared(&self) -> &PreparedFrame<'a> {
        &self.prepared
    }

    pub(crate) fn context(&self) -> &EdgeFrameContext<'a> {
        &self.context
    }

    pub(super) fn projector(&self) -> &Projector<'a> {
        &self.projector
    }

    pub(super) fn size(&self) -> (usize, usize) {
        self.prepared.view().size()
    }

    /// The ray of a pixel in the world: its origin, metres, and its direction. `None` outside of the lens's domain.
    pub(crate) fn ray(&self, pixel: [f64; 2]) -> Option<(Point3<f64>, Vector3<f64>)> {
        let view = self.prepared.view();
        let ray = view.camera().unproject(pixel)?;
        let (mut origin, mut direction) = (Vector3::from(ray.origin), Vector3::from(ray.direction));
        if let Some(motion) = &self.context.motion {
            let ahead = motion.true_m(origin + direction);
            origin = motion.true_m(origin);
            direction = (ahead - origin).normalize();
        }
        let pose = view.world_from_camera();
        Some((pose * Point3::from(origin), pose * direction))
    }

    /// The point that outlines are seen from, in the world, metres.
    pub(crate) fn viewpoint_m(&self) -> Vector3<f64> {
        self.prepared.view().viewpoint_m()
    }

    /// Returns whether a point of the image lies within the outline of a look-alike.
    pub(super) fn is_look_alike(&self, point: [f32; 2]) -> bool {
        self.context.look_alikes.contain(point, false)
    }

    /// Returns whether a point of the image lies within the outline of a look-alike that has been found in it.
    pub(crate) fn is_taken(&self, point: [f32; 2]) -> bool {
        self.context.look_alikes.contain(point, true)
    }

    /// Returns whether a point of the image lies on an unmasked pixel.
    pub(super) fn holds(&self, point: [f32; 2]) -> bool {
        self.prepared.view().holds_point(point)
    }

    /// Returns whether each of a block of places in the world lies on an unmasked pixel.
    pub(super) fn holds_block(&self, level: Level, places: &[[f32; LANES]; 3]) -> [bool; LANES] {
        let [u, v] = self.projector.project(level, places);
        std::array::from_fn(|lane| self.holds([u[lane], v[lane]]))
    }

    fn is_open(&self, column: usize, row: usize) -> bool {
        self.prepared.view().is_open(column, row)
    }

    /// Returns the mean colours of `count` pixels of a row of an octave, from a column and a row on, and whether most of each is in the target's colours.
    pub(super) fn pixels(
        &self,
        level: Level,
        octave: Octave,
        [column, row]: [usize; 2],
        count: usize,
    ) -> [OctavePixel; CHUNK] {
        let size = octave.pixels();
        let step = 1 << octave.0.saturating_sub(Octave::SAMPLED);
        let first = step / 2;
        let mut sums = [[0_f32; CHUNK]; 4];
        let mut samples = 0.0;
        for y in (first..size).step_by(step) {
            for x in (first..size).step_by(step) {
                let place = [column * size + x, row * size + y];
                self.add_pixels(level, (place, size), count, &mut sums);
                samples += 1.0;
            }
        }
        let [y, u, v, matches] = sums;
        std::array::from_fn(|i| {
            let matches = if matches[i].is_nan() {
                f32::NAN
            } else {
                f32::from(u8::from(2.0 * matches[i] > samples))
            };
            [y[i] / samples, u[i] / samples, v[i] / samples, matches]
        })
    }

    /// Adds the colours of `count` pixels of the frame that are `step` apart, from a column and a row on: Y, U and V, and whether each is in the target's colours, or NaN if
    /// it is masked.
    fn add_pixels(
        &self,
        level: Level,
        ([column, row], step): ([usize; 2], usize),
        count: usize,
        sums: &mut [[f32; CHUNK]; 4],
    ) {
        let mut bytes = [[0_u8; CHUNK]; 3];
        let frame = self.prepared.frame();
        with_pixels!(frame, components => for i in 0..count {
            let pixel = components(column + i * step, row);
            for (of_channel, value) in bytes.iter_mut().zip(pixel) {
                of_channel[i] = value;
            }
        });
        let mut corrected = bytes;
        level.run(
            #[inline(always)]
            || {
                corrected = self.context.correction.block(bytes);
                let yuv = self.kind.full_range_yuv_of_block(&bytes);
                for (sums, values) in sums.iter_mut().zip(&yuv) {
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum += value;
                    }
                }
            },
        );
        for i in 0..count {
            sums[3][i] += if self.is_open(column + i * step, row) {
                let corrected = [corrected[0][i], corrected[1][i], corrected[2][i]];
                f32::from(u8::from(self.matches_corrected(corrected)))
            } else {
                f32::NAN
            };
        }
    }

    /// Returns whether a pixel's raw bytes are one of the target's colours.
    pub(crate) fn matches(&self, bytes: [u8; 3]) -> bool {
        self.matches_corrected(self.context.correction.bytes(bytes))
    }

    fn matches_corrected(&self, corrected: [u8; 3]) -> bool {
        // The small table first: it rules out most pixels.
        let in_ranges = self.in_ranges;
        in_ranges.is_none_or(|table| table.matches(corrected) == 1)
            && self.context.posterior[usize::from(self.bins.bin(corrected))]
                >= self.context.min_posterior
    }

    /// Returns whether a colour (Y, U and V) is one of the target's.
    pub(super) fn is_target_color(&self, yuv: [f32; 3]) -> bool {
        self.matches(self.kind.bytes(yuv))
    }
}
