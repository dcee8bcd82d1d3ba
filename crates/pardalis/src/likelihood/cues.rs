//! All cues of one target over all cameras. They are independent given the state, so their likelihoods
//! multiply.

use super::contour::{ContourCue, ContourSettings};
use super::difference::DifferenceCue;
use super::patch::PatchSettings;
use super::region::RegionCue;
use super::window::{WindowCounting, WindowCue, WindowSettings};
use crate::Frame;
use crate::color::{ColorModel, PixelKind};
use crate::shape::Shape;
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;

/// A cue and the cameras whose frames it evaluates.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CueSettings {
    /// The cue.
    pub cue: Cue,
    /// Indices of the cameras in the tracker; `None` means all cameras.
    pub cameras: Option<Vec<usize>>,
}

/// A cue and its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cue {
    /// Colour just inside and just outside the projected outline.
    Contour(ContourSettings),
    /// Matching colours in a window around the projected position.
    Window(WindowSettings),
    /// Colours in a region, channel by channel.
    Region(PatchSettings),
    /// Changes since the previous frame in a region.
    Difference(PatchSettings),
}

impl Cue {
    /// Reports whether the cue works without a colour model.
    pub fn works_without_color_model(&self) -> bool {
        match self {
            Self::Contour(_) | Self::Region(_) => false,
            Self::Window(window) => window.ranges.is_some(),
            Self::Difference(_) => true,
        }
    }

    /// Reports whether the cue evaluates a flat region, which requires a flat shape.
    pub fn needs_flat_shape(&self) -> bool {
        matches!(self, Self::Region(_) | Self::Difference(_))
    }
}

impl From<Cue> for CueSettings {
    /// Applies the cue to every camera.
    fn from(cue: Cue) -> Self {
        Self { cue, cameras: None }
    }
}

/// The cues of one target.
#[derive(Debug)]
pub struct Cues {
    cues: Vec<(Kernel, Option<Vec<usize>>)>,
    /// For each camera, the log-likelihoods that its latest frame gave to the particles.
    of_cameras: Vec<Vec<f32>>,
}

#[derive(Debug)]
enum Kernel {
    Contour(Box<ContourCue>),
    Window(Box<WindowCue>),
    Region(Box<RegionCue>),
    Difference(Box<DifferenceCue>),
}

impl Cues {
    /// Creates the cues of a target with the given shape and colours. The colour model may be omitted if no
    /// cue needs it.
    ///
    /// # Errors
    ///
    /// There is no cue, a cue's parameters are invalid, or a cue needs colours or a shape that the target
    /// lacks.
    pub fn new(
        settings: &[CueSettings],
        shape: Shape,
        colors: Option<&ColorModel>,
        level: Level,
    ) -> Result<Self, Error> {
        Self::counting(settings, shape, colors, WindowCounting::Cheaper, level)
    }

    /// Creates the cues with a fixed method of counting windows, to compare the methods.
    pub fn counting(
        settings: &[CueSettings],
        shape: Shape,
        colors: Option<&ColorModel>,
        counting: WindowCounting,
        level: Level,
    ) -> Result<Self, Error> {
        let missing = |what: &str, remedy: &str| Error::Empty {
            what: what.to_owned(),
            remedy: remedy.to_owned(),
        };
        if settings.is_empty() {
            return Err(missing("the list of cues", "give at least one"));
        }
        let kernel = |settings: &CueSettings| {
            let kernel = match settings.cue {
                Cue::Contour(contour) => {
                    let colors = colors
                        .ok_or_else(|| missing("the contour cue's colour model", "learn one"))?;
                    Kernel::Contour(Box::new(ContourCue::new(contour, shape, colors, level)?))
                }
                Cue::Window(window) => {
                    window.check()?;
                    let learnt = || colors.and_then(ColorModel::ranges);
                    let ranges = window.ranges.or_else(learnt).ok_or_else(|| {
                        missing(
                            "the colours of the window cue",
                            "give hue_deg and saturation, or learn the colour model again to include them",
                        )
                    })?;
                    Kernel::Window(Box::new(WindowCue::new(window, ranges, counting, level)))
                }
                Cue::Region(region) => {
                    let channels = colors.and_then(ColorModel::channels).ok_or_else(|| {
                        missing(
                            "the region cue's histograms of red, green and blue",
                            "learn the colour model again to include them",
                        )
                    })?;
                    Kernel::Region(Box::new(RegionCue::new(region, &shape, channels, level)?))
                }
                Cue::Difference(difference) => {
                    Kernel::Difference(Box::new(DifferenceCue::new(difference, &shape, level)?))
                }
            };
            Ok((kernel, settings.cameras.clone()))
        };
        Ok(Self {
            cues: settings.iter().map(kernel).collect::<Result<_, Error>>()?,
            of_cameras: Vec::new(),
        })
    }

    /// Prepares a view for look-ups in a frame of its size.
    pub fn prepare(&self, view: &mut View, frame: &Frame) {
        let kind = PixelKind::of(frame);
        for (kernel, _) in &self.cues {
            match kernel {
                Kernel::Contour(cue) => view.prepare(kind, cue.palette()),
                Kernel::Window(cue) => view.prepare_ranges(kind, cue.ranges()),
                Kernel::Region(_) | Kernel::Difference(_) => {}
            }
        }
    }

    /// Returns the likelihood of the frames of one instant, each with its camera's index. The views must have
    /// been prepared for them.
    pub fn of<'a>(
        &'a mut self,
        views: &'a [View],
        frames: &'a [(usize, Frame)],
    ) -> CuesLikelihood<'a> {
        CuesLikelihood {
            cues: self,
            views,
            frames,
        }
    }

    /// Reports whether any cue compares a camera's frame with the previous one ([`View::keep`]).
    pub fn compare_frames(&self) -> bool {
        let compares = |(kernel, _): &(Kernel, _)| matches!(kernel, Kernel::Difference(_));
        self.cues.iter().any(compares)
    }

    /// Returns the log-likelihood of a frame of the camera that shows pure background.
    pub fn background_log_likelihood(&self, camera: usize) -> f64 {
        self.cues
            .iter()
            .filter(|(_, cameras)| uses_camera(cameras.as_deref(), camera))
            .map(|(kernel, _)| match kernel {
                Kernel::Contour(cue) => cue.settings().background_log_likelihood(),
                Kernel::Window(cue) => cue.background_log_likelihood(),
                Kernel::Region(cue) => cue.background_log_likelihood(),
                Kernel::Difference(cue) => cue.background_log_likelihood(),
            })
            .sum()
    }

    /// Returns the log-likelihoods, one per particle, of the camera's latest frame.
    pub fn log_likelihoods_of(&self, camera: usize) -> &[f32] {
        self.of_cameras.get(camera).map_or(&[], Vec::as_slice)
    }
}

fn uses_camera(cameras: Option<&[usize]>, camera: usize) -> bool {
    cameras.is_none_or(|cameras| cameras.contains(&camera))
}

/// The likelihood of a target's cues for the frames of one instant.
#[derive(Debug)]
pub struct CuesLikelihood<'a> {
    cues: &'a mut Cues,
    views: &'a [View],
    frames: &'a [(usize, Frame)],
}

impl Likelihood for CuesLikelihood<'_> {
    fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]) {
        let Cues { cues, of_cameras } = &mut *self.cues;
        if of_cameras.len() < self.views.len() {
            of_cameras.resize(self.views.len(), Vec::new());
        }
        out.fill(0.0);
        for (camera, frame) in self.frames {
            let prepared = self.views[*camera].prepared(frame);
            let of_camera = &mut of_cameras[*camera];
            of_camera.clear();
            of_camera.resize(out.len(), 0.0);
            for (kernel, cameras) in &mut *cues {
                if uses_camera(cameras.as_deref(), *camera) {
                    let positions_m = particles.positions_m();
                    match kernel {
                        Kernel::Contour(cue) => cue.add_camera(&prepared, positions_m, of_camera),
                        Kernel::Window(cue) => cue.add_camera(&prepared, positions_m, of_camera),
                        Kernel::Region(cue) => cue.add_camera(&prepared, positions_m, of_camera),
                        Kernel::Difference(cue) => {
                            cue.add_camera(&prepared, positions_m, of_camera);
                        }
                    }
                }
            }
            for (sum, of_camera) in out.iter_mut().zip(&*of_camera) {
                *sum += of_camera;
            }
        }
    }
}
