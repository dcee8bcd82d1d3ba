//! Start positions of the targets in each image.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Result;
use libm::hypot;
use pardalis::shape::Stance;
use pardalis::start::{PixelStart, Start};
use pardalis::{TargetId, Tracker};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_scene::{FrameRange, Input, Scene, TargetConfig};

use crate::output::Shown;
use crate::scene::OpenScene;
use crate::source::Source;
use crate::tables::{Column, Row, Table};
use crate::user_error::user_error;

/// Points of an outline whose radius is measured.
const OUTLINE_POINTS: usize = 16;

/// The source of start positions.
#[derive(Debug, Clone)]
pub(crate) enum StartsFrom {
    /// The scene's own starts.
    Scene,
    /// One pixel for all images.
    Pixel([f64; 2]),
    /// A table of positions, and the object whose rows to use; `None` for the target's name.
    Positions(PathBuf, Option<String>),
    /// A table of pixels, and the object whose rows to use.
    Clicks(PathBuf, Option<String>),
}

impl StartsFrom {
    /// Returns a key and value for the summary.
    pub(super) fn written(&self) -> (&'static str, toml::Value) {
        match self {
            Self::Scene => ("starts", "scene".into()),
            Self::Pixel(pixel) => ("at_px", pixel.to_vec().into()),
            Self::Positions(file, _) => ("starts", file.to_string_lossy().into_owned().into()),
            Self::Clicks(file, _) => ("clicks", file.to_string_lossy().into_owned().into()),
        }
    }
}

/// Parses two numbers separated by a comma.
pub(crate) fn parse_pixel(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 2]>::try_from(numbers).ok())
        .filter(|pixel| pixel.iter().all(|v| v.is_finite()))
        .ok_or_else(|| {
            "allowed: two numbers in pixels, U,V without a space, inside the image, such as 412,96.5".to_owned()
        })
}

/// A rough start of one target in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RoughStart {
    /// A position in the world, in metres.
    Position([f64; 3]),
    /// A pixel of the camera with the given index.
    Pixel(usize, [f64; 2]),
}

impl RoughStart {
    /// Converts to a start. A pixel's ray is searched with the scene's settings if the scene also starts from
    /// a pixel.
    fn start(self, of_scene: Option<&Start>) -> Start {
        match (self, of_scene) {
            (Self::Position(position_m), _) => Start::Gaussian(GaussianStart {
                position_m,
                ..GaussianStart::default()
            }),
            (Self::Pixel(camera, pixel), Some(Start::Pixel(start))) => Start::Pixel(PixelStart {
                camera,
                pixel,
                ..*start
            }),
            (Self::Pixel(camera, pixel), Some(Start::Gaussian(_)) | None) => {
                Start::Pixel(PixelStart::at(camera, pixel))
            }
        }
    }
}

/// The start of each frame in a table, with its line number.
pub(super) type Listed = BTreeMap<usize, (RoughStart, u64)>;

/// The starts of all images.
pub(super) enum Starts {
    /// The scene's own starts.
    Scene,
    /// One start for all images.
    Same(RoughStart),
    /// A table: the starts of each target by frame.
    Listed {
        file: PathBuf,
        targets: Vec<(String, Listed)>,
    },
}

impl Starts {
    /// Reads the starts.
    ///
    /// Errors: the table does not fit the scene, or a pixel is ambiguous because there are several cameras or
    /// targets.
    pub(super) fn read(from: &StartsFrom, scene: &Scene, scene_path: &Path) -> Result<Self> {
        let several = scene.targets.iter().find(|target| target.bodies.len() > 1);
        if let (Some(target), false) = (several, matches!(from, StartsFrom::Scene)) {
            return Err(user_error!(
                "{}: targets.{} has several landmarks, which a single start does not locate; remove --at, --starts and --clicks to use the scene's start",
                scene_path.shown(),
                target.name
            ));
        }
        match from {
            StartsFrom::Scene => Ok(Self::Scene),
            StartsFrom::Pixel(pixel) => match (&scene.cameras[..], &scene.targets[..]) {
                ([_], [_]) => Ok(Self::Same(RoughStart::Pixel(0, *pixel))),
                (cameras, targets) => Err(user_error!(
                    "--at: {} has {} cameras and {} targets, so the pixel is ambiguous; give --clicks FILE.csv with the columns camera and object",
                    scene_path.shown(),
                    cameras.len(),
                    targets.len()
                )),
            },
            StartsFrom::Positions(file, object) => {
                let table = Table::read(file)?;
                let columns = table.columns(["x_m", "y_m", "z_m"])?;
                Self::listed(file, &table, object.as_deref(), scene, |row| {
                    Ok(row.all_or_none(Some(columns))?.map(RoughStart::Position))
                })
            }
            StartsFrom::Clicks(file, object) => {
                let table = Table::read(file)?;
                let columns = table.columns(["u_px", "v_px"])?;
                let camera = camera_column(&table, scene)?;
                Self::listed(file, &table, object.as_deref(), scene, |row| {
                    let Some(pixel) = row.all_or_none(Some(columns))? else {
                        return Ok(None);
                    };
                    let number =
                        camera.map_or(Ok(0), |camera| camera_number(row, camera, scene))?;
                    Ok(Some(RoughStart::Pixel(number, pixel)))
                })
            }
        }
    }

    /// Reads the rows of each target.
    fn listed(
        file: &Path,
        table: &Table,
        object: Option<&str>,
        scene: &Scene,
        start_of: impl Fn(&Row) -> Result<Option<RoughStart>>,
    ) -> Result<Self> {
        let frame_column = table.column("frame")?;
        let whose = Assignment::read(table, object, scene.targets.len())?;
        let mut targets = Vec::new();
        for target in &scene.targets {
            let wanted = whose.rows_of(file, object.unwrap_or(&target.name))?;
            let mut listed = Listed::new();
            for row in table.rows() {
                if let Some((column, name)) = wanted
                    && row.text(column)? != name
                {
                    continue;
                }
                let frame = row.count(frame_column)?;
                let Some(rough_start) = start_of(&row)? else {
                    continue;
                };
                let (first, line) = *listed.entry(frame).or_insert((rough_start, row.line));
                if first.contradicts(&rough_start) {
                    return Err(user_error!(
                        "{}: frame {frame} already has a start in line {line}; allowed: one start per frame",
                        row.place()
                    ));
                }
            }
            targets.push((target.name.clone(), listed));
        }
        Ok(Self::Listed {
            file: file.to_owned(),
            targets,
        })
    }

    /// Returns the start of each body in the image with the given index, target by target.
    ///
    /// Errors: the table has none.
    pub(super) fn of_frame(&self, tracker: &Tracker, frame: usize) -> Result<Vec<Option<Start>>> {
        let of_body = |(target, of_scene): (TargetId, Option<Start>)| match self {
            Self::Scene => Ok(of_scene),
            Self::Same(rough_start) => Ok(Some(rough_start.start(of_scene.as_ref()))),
            Self::Listed { file, targets } => {
                let (name, listed) = &targets[target.index()];
                let Some((rough_start, _)) = listed.get(&frame) else {
                    return Err(user_error!(
                        "{}: has no start of {name} in frame {frame}; give each image a row, or use fewer images (first_frame, frame_limit)",
                        file.shown()
                    ));
                };
                Ok(Some(rough_start.start(of_scene.as_ref())))
            }
        };
        let mut starts = Vec::new();
        for target in tracker.targets() {
            for of_scene in tracker.starts(target)? {
                starts.push(of_body((target, of_scene))?);
            }
        }
        Ok(starts)
    }

    /// Returns the frames whose starts can be checked before the images are read: all of a folder or of `stills`; of a
    /// video, whose length is not certain, those that the table lists.
    pub(super) fn frames(&self, open: &OpenScene, range: FrameRange, stills: bool) -> Vec<usize> {
        let cameras = &open.scene.cameras;
        let are_images = stills
            || cameras
                .iter()
                .all(|c| matches!(c.input, Input::Images { .. }));
        if are_images {
            let counts = open.sources.iter().filter_map(Source::frame_count);
            let count = counts.max().unwrap_or(0);
            return (0..count).map(|i| range.first + range.step * i).collect();
        }
        let Self::Listed { targets, .. } = self else {
            return vec![range.first];
        };
        let mut frames = targets.iter().map(|(_, listed)| {
            let taken = listed.keys().copied().filter(|&frame| range.takes(frame));
            taken.take(range.limit.unwrap_or(usize::MAX)).collect()
        });
        let first: BTreeSet<usize> = frames.next().unwrap_or_default();
        // A frame that another target lacks is reported when it is reached.
        let common = frames.fold(first, |common, listed: BTreeSet<usize>| &common & &listed);
        common.into_iter().collect()
    }

    /// Errors: a start of this frame is missing or out of range.
    pub(super) fn check(&self, tracker: &Tracker, frame: usize) -> Result<()> {
        for start in self.of_frame(tracker, frame)?.iter().flatten() {
            let checked = match start {
                Start::Gaussian(start) => start.check(),
                Start::Pixel(start) => start
                    .check()
                    .and_then(|()| start.check_in(&tracker.views()[start.camera])),
            };
            checked.map_err(|error| user_error!("{}: {error}", self.source_of_frame(frame)))?;
        }
        Ok(())
    }

    /// Returns the pixel that is given as the start of a target, with the index of its camera.
    pub(super) fn click(&self, number: usize, frame: usize) -> Option<(usize, [f64; 2])> {
        match self.rough(number, frame)? {
            RoughStart::Pixel(camera, pixel) => Some((camera, pixel)),
            RoughStart::Position(_) => None,
        }
    }

    /// Returns the start that is given for a target, in place of the scene's.
    fn rough(&self, number: usize, frame: usize) -> Option<RoughStart> {
        match self {
            Self::Scene => None,
            Self::Same(rough_start) => Some(*rough_start),
            Self::Listed { targets, .. } => Some(targets[number].1.get(&frame)?.0),
        }
    }

    /// Says how far a target was found from the start given for it, which does not guide detection, and need not be where the published
    /// cues find it; `None` if it is not farther away than its diameter.
    pub(super) fn far_from(
        &self,
        tracker: &Tracker,
        (number, target): (usize, &TargetConfig),
        frame: usize,
        found_m: [f64; 3],
    ) -> Option<String> {
        let [body] = &target.bodies[..] else {
            return None;
        };
        match self.rough(number, frame)? {
            RoughStart::Position(position_m) => {
                let [x, y, z] = [0, 1, 2].map(|i| found_m[i] - position_m[i]);
                let away_m = hypot(hypot(x, y), z);
                (away_m > body.shape.diameter_m())
                    .then(|| format!("found {away_m:.2} m from the given start"))
            }
            RoughStart::Pixel(camera, click_px) => {
                let view = &tracker.views()[camera];
                let position = view.camera_from_world() * nalgebra::Point3::from(found_m);
                let Some([u, v]) = view.camera().project(position.into()) else {
                    return Some("found out of view of the camera of the click".to_owned());
                };
                let away_px = |[x, y]: [f64; 2]| hypot(x - u, y - v);
                let outline_px = body.shape.outline_px(
                    view.camera(),
                    view.camera_from_world(),
                    found_m,
                    Stance::default(),
                    OUTLINE_POINTS,
                );
                let radius_px = outline_px.into_iter().flatten().map(away_px);
                let radius_px = radius_px.fold(0.0, f64::max);
                let away_px = away_px(click_px);
                (away_px > 2.0 * radius_px).then(|| format!("found {away_px:.0} px from the click"))
            }
        }
    }

    /// Returns what an error message about a start of this frame refers to.
    pub(super) fn source_of_frame(&self, frame: usize) -> String {
        match self {
            Self::Scene => format!("frame {frame}"),
            Self::Same(_) => "--at".to_owned(),
            Self::Listed { file, .. } => format!("{}, frame {frame}", file.shown()),
        }
    }
}

impl RoughStart {
    /// Reports whether two rows of a frame contradict each other. Pixels of several cameras do not: the first
    /// is used.
    fn contradicts(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Pixel(camera, _), Self::Pixel(others, _)) if camera != others => false,
            _ => self != other,
        }
    }
}

/// How the rows of a table are assigned to targets.
enum Assignment<'t> {
    /// There is only one target, so all rows belong to it.
    OneTarget,
    /// By the column `object`, which contains these names.
    Column(Column<'t>, Vec<String>),
}

impl<'t> Assignment<'t> {
    fn read(table: &'t Table, object: Option<&str>, target_count: usize) -> Result<Self> {
        if target_count > 1 && object.is_some() {
            return Err(user_error!(
                "--object: the scene has {target_count} targets; remove it: each target uses the rows with its own name"
            ));
        }
        let Some(column) = table.optional_column("object") else {
            if target_count > 1 || object.is_some() {
                table.column("object")?;
            }
            return Ok(Self::OneTarget);
        };
        let mut names = Vec::new();
        for row in table.rows() {
            names.push(row.text(column)?.to_owned());
        }
        names.sort_unstable();
        names.dedup();
        if let ([_], None, 1) = (&names[..], object, target_count) {
            return Ok(Self::OneTarget);
        }
        Ok(Self::Column(column, names))
    }

    /// Returns the column and the name that it must contain; `None` if all rows apply.
    fn rows_of<'n>(&self, file: &Path, wanted: &'n str) -> Result<Option<(Column<'t>, &'n str)>> {
        match self {
            Self::OneTarget => Ok(None),
            Self::Column(column, names) if names.iter().any(|name| name == wanted) => {
                Ok(Some((*column, wanted)))
            }
            Self::Column(_, names) => Err(user_error!(
                "{}, column object: nothing is named \"{wanted}\"; select one of these with --object: {}",
                file.shown(),
                names.join(", ")
            )),
        }
    }
}

/// Returns the column of the camera's name; `None` if there is only one camera.
fn camera_column<'t>(table: &'t Table, scene: &Scene) -> Result<Option<Column<'t>>> {
    match scene.cameras.len() {
        1 => Ok(None),
        _ => table.column("camera").map(Some),
    }
}

fn camera_number(row: &Row, column: Column, scene: &Scene) -> Result<usize> {
    let name = row.text(column)?;
    let found = scene.cameras.iter().position(|camera| camera.name == name);
    found.ok_or_else(|| {
        let names: Vec<&str> = scene.cameras.iter().map(|camera| &*camera.name).collect();
        user_error!(
            "{}, column camera: \"{name}\" is not a camera of the scene; allowed: {}",
            row.place(),
            names.join(", ")
        )
    })
}
