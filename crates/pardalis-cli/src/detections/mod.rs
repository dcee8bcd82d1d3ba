//! What another program detected in the images of a scene's cameras, read from files.

pub(crate) mod coco;

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::fs;
use std::path::Path;

use anyhow::Result;
use pardalis::tracker::ImageBox;
use pardalis::{CameraId, FrameSet, TargetId};
use pardalis_scene::{CameraConfig, FrameRange, TargetConfig};

use crate::numbers::counted;
use crate::output::Shown;
use crate::tables::{Row, Table};
use crate::user_error::user_error;

/// The names of the columns of the MOT Challenge's files, which have no header.
pub(crate) const MOT_COLUMNS: [&str; 10] = [
    "frame", "id", "left", "top", "width", "height", "score", "x", "y", "z",
];

/// The columns of files with a header.
const COLUMNS: &str = "frame,left_px,top_px,right_px,bottom_px or frame,u_px,v_px,radius_px, and optionally class and score";

/// The largest file in the format of COCO. Derivation: masks of a long video, and no computer's memory.
const MAX_JSON_BYTES: u64 = 512 << 20;

/// Sides of boxes up to this may be shares of the width and height: those that reach beyond the image are not above 1 by much.
const LARGEST_SHARE: f64 = 1.2;

/// So many boxes are hardly all in one quarter of the images by chance. Hand-set.
const MANY_BOXES: usize = 20;

/// Classes of a file that a message names.
const NAMED_CLASSES: usize = 10;

/// What was detected in the images of all cameras of a scene.
#[derive(Debug, Default)]
pub(crate) struct Detections {
    /// One per camera; `None` of a camera without a file.
    cameras: Vec<Option<CameraDetections>>,
    /// The targets that are detected.
    targets: Vec<TargetId>,
}

/// What was detected in the images of one camera.
#[derive(Debug)]
pub(crate) struct CameraDetections {
    /// The frames of its recording that are read.
    frames: FrameRange,
    /// By the number of the frame in the recording.
    boxes: HashMap<usize, Vec<(TargetId, ImageBox)>>,
    /// The frames that the file has, if others say nothing.
    looked_at: Option<HashSet<usize>>,
    /// What may be wrong with the file.
    warnings: Vec<String>,
    /// The first classes in the file.
    classes: Vec<String>,
}

/// One box of a file, or that there is none in an image.
pub(crate) struct Found {
    /// The number of its frame in the recording, from 0.
    frame: usize,
    /// `None` if the file has no classes.
    class: Option<String>,
    pub(crate) found: Option<ImageBox>,
    place: Place,
}

/// Where a box stands in its file, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Line(u64),
    Entry(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(number) => write!(f, "line {number}"),
            Self::Entry(number) => write!(f, "entry {number}"),
        }
    }
}

/// The images of a camera.
pub(crate) struct Images {
    pub(crate) size_px: (usize, usize),
    /// How many are read, if that is known.
    pub(crate) count: Option<usize>,
    /// The names of those of a folder, from its first one on.
    pub(crate) names: Option<Vec<String>>,
}

impl Detections {
    /// No detections of cameras yet, for these targets.
    pub(crate) fn of(targets: &[TargetConfig]) -> Self {
        let numbered = targets.iter().enumerate();
        let detected = numbered.filter(|(_, target)| class_of(target).is_some());
        Self {
            cameras: Vec::new(),
            targets: detected.map(|(number, _)| TargetId::new(number)).collect(),
        }
    }

    /// Adds those of the next camera.
    pub(crate) fn push(&mut self, camera: Option<CameraDetections>) {
        self.cameras.push(camera);
    }

    /// Returns what may be wrong with the files, each with the number of its camera.
    pub(crate) fn warnings(&self) -> impl Iterator<Item = (usize, &String)> {
        let cameras = self.cameras.iter().enumerate();
        cameras.flat_map(|(number, camera)| {
            let warnings = camera.iter().flat_map(|camera| &camera.warnings);
            warnings.map(move |warning| (number, warning))
        })
    }

    /// Fails if no file has a box of any of these targets. A single camera may never see them.
    pub(crate) fn check(&self, targets: &[TargetConfig]) -> Result<()> {
        let mut files = self.cameras.iter().flatten().peekable();
        if files.peek().is_none() || files.clone().any(|camera| !camera.boxes.is_empty()) {
            return Ok(());
        }
        let wanted: Vec<&str> = targets.iter().filter_map(class_of).collect();
        let mut found: Vec<&str> = files
            .flat_map(|camera| camera.classes.iter().map(String::as_str))
            .collect();
        found.sort_unstable();
        found.dedup();
        Err(user_error!(
            "no box is of the class {}; found: {}; give detector.class",
            wanted.join(" or "),
            found.join(", ")
        ))
    }

    /// Adds what was detected in the images of a set, of which each camera's is the one with this number among those that it has delivered.
    pub(crate) fn add(
        &self,
        mut set: FrameSet,
        images: impl Iterator<Item = (usize, usize)>,
    ) -> Result<FrameSet, pardalis::Error> {
        for (camera, number) in images {
            let Some(Some(detections)) = self.cameras.get(camera) else {
                continue;
            };
            let frame = detections.frames.first + number * detections.frames.step;
            let looked_at = detections.looked_at.as_ref();
            if looked_at.is_some_and(|frames| !frames.contains(&frame)) {
                continue;
            }
            let found = detections.boxes.get(&frame).map_or(&[][..], Vec::as_slice);
            for &target in &self.targets {
                let own = found.iter().filter(|(of, _)| *of == target);
                let own = own.map(|(_, found)| *found).collect();
                set = set.with_boxes(CameraId::new(camera), target, own)?;
            }
        }
        Ok(set)
    }
}

/// The class of the boxes of a target that another program detects.
fn class_of(target: &TargetConfig) -> Option<&str> {
    target.bodies.first()?.class()
}

impl CameraDetections {
    /// Reads the file of a camera.
    pub(crate) fn read(
        path: &Path,
        camera: &CameraConfig,
        targets: &[TargetConfig],
        images: &Images,
    ) -> Result<Self> {
        let all = if path.extension().is_some_and(|ending| ending == "json") {
            coco::boxes_in(path, &read_json(path)?, images)?
        } else {
            boxes_in(&Table::read_with_or_without_header(path, &MOT_COLUMNS)?)?
        };
        let size_px = images.size_px;
        let last = all.iter().max_by_key(|found| found.frame);
        let range = camera.frames;
        if let (Some(last), Some(count), true) = (last, images.count, range == FrameRange::ALL)
            && last.frame >= count
        {
            return Err(user_error!(
                "{}, {}: frame {}, but the camera has {}, which count from 0; give the file of these images",
                path.shown(),
                last.place,
                last.frame,
                counted(count as u64, "image")
            ));
        }
        let found: Vec<ImageBox> = all.iter().filter_map(|one| one.found).collect();
        check_places(&found, size_px)
            .map_err(|problem| user_error!("{}: {problem}", path.shown()))?;
        let frames: HashSet<usize> = all.iter().map(|one| one.frame).collect();
        let mut warnings = Vec::new();
        if found.len() >= MANY_BOXES && found.iter().all(|found| is_in_quarter(found, size_px)) {
            warnings.push(format!(
                "{}: all boxes lie in the upper left quarter of the images; are they in pixels of images of half the size?",
                path.shown()
            ));
        }
        let count = images
            .count
            .filter(|count| camera.detections_complete && 2 * frames.len() < *count);
        if let (Some(count), true) = (count, range == FrameRange::ALL) {
            warnings.push(format!(
                "{}: has boxes of {} of {count} images, and says of the others that the detector found nothing; if it did not look at them, give detections_complete = false",
                path.shown(),
                frames.len()
            ));
        }
        let classes: Vec<(TargetId, &str)> = targets
            .iter()
            .enumerate()
            .filter_map(|(number, target)| Some((TargetId::new(number), class_of(target)?)))
            .collect();
        let mut boxes: HashMap<usize, Vec<(TargetId, ImageBox)>> = HashMap::new();
        for one in &all {
            let Some(found) = one.found else { continue };
            let targets = classes
                .iter()
                .filter(|(_, class)| one.class.as_ref().is_none_or(|of_box| of_box == class));
            for (target, _) in targets {
                boxes.entry(one.frame).or_default().push((*target, found));
            }
        }
        let has_classes = all.iter().any(|found| found.class.is_some());
        if classes.len() > 1 && !has_classes {
            return Err(user_error!(
                "{}: has no classes, and {} targets have a detector; add a column class with the targets' names, or category_id",
                path.shown(),
                classes.len()
            ));
        }
        let mut others: Vec<String> = all.into_iter().filter_map(|one| one.class).collect();
        others.sort_unstable();
        others.dedup();
        others.truncate(NAMED_CLASSES);
        Ok(Self {
            frames: range,
            boxes,
            looked_at: (!camera.detections_complete).then_some(frames),
            warnings,
            classes: others,
        })
    }
}

fn read_json(path: &Path) -> Result<Vec<u8>> {
    let failed = |error| user_error!("{}: cannot be read: {error}; check the name", path.shown());
    let length = fs::metadata(path).map_err(failed)?.len();
    if length > MAX_JSON_BYTES {
        return Err(user_error!(
            "{}: has {length} bytes; allowed: at most {MAX_JSON_BYTES}; keep the boxes of this camera only, without masks",
            path.shown()
        ));
    }
    fs::read(path).map_err(failed)
}

/// Checks that boxes may be those of images of this size in pixels. Returns the problem.
fn check_places(found: &[ImageBox], size_px: (usize, usize)) -> Result<(), String> {
    if found.is_empty() {
        return Err(
            "has no boxes; run the detector again, or remove detections from the scene".to_owned(),
        );
    }
    let are_shares = |found: &ImageBox| {
        found
            .sides_px()
            .iter()
            .all(|side| side.abs() <= LARGEST_SHARE)
    };
    if found.iter().all(are_shares) {
        return Err(format!(
            "all sides of its boxes are between 0 and 1, as shares of the width and height are; multiply these by {} and {} and subtract 0.5",
            size_px.0, size_px.1
        ));
    }
    let outside = found
        .iter()
        .filter(|found| is_outside(found, size_px))
        .count();
    if 4 * outside > found.len() {
        return Err(format!(
            "{outside} of {} boxes are outside of the images, which are {} x {} pixels; are they in pixels of resized images?",
            found.len(),
            size_px.0,
            size_px.1
        ));
    }
    Ok(())
}

/// Returns whether a box is in the upper left quarter of images of this size.
fn is_in_quarter(found: &ImageBox, (width, height): (usize, usize)) -> bool {
    let [_, _, right, bottom] = found.sides_px();
    right < 0.5 * width as f64 && bottom < 0.5 * height as f64
}

/// Returns whether most of a box is outside of images of this size.
fn is_outside(found: &ImageBox, (width, height): (usize, usize)) -> bool {
    let [left, top, right, bottom] = found.sides_px();
    let [u, v] = [f64::midpoint(left, right), f64::midpoint(top, bottom)];
    !(0.0..width as f64).contains(&u) || !(0.0..height as f64).contains(&v)
}

/// Returns the boxes of a table: with a header as described in the guide, without one as the MOT Challenge has them.
pub(crate) fn boxes_in(table: &Table) -> Result<Vec<Found>> {
    if !table.has_header() {
        return table.rows().map(|row| mot_box(table, &row)).collect();
    }
    let frame = table.column("frame")?;
    let [class, score] = ["class", "score"].map(|name| table.optional_column(name));
    let sides = table.optional_columns(["left_px", "top_px", "right_px", "bottom_px"]);
    let circle = table.optional_columns(["u_px", "v_px", "radius_px"]);
    if sides.is_none() && circle.is_none() {
        return Err(user_error!(
            "{}, line 1: has no boxes or circles; needed: {COLUMNS}; found: {}",
            table.path().shown(),
            table.header().collect::<Vec<_>>().join(",")
        ));
    }
    let found = |row: Row| {
        let found = match (row.all_or_none(sides)?, row.all_or_none(circle)?) {
            (Some(sides_px), _) => ImageBox::new(sides_px).map(Some),
            (None, Some([u, v, radius_px])) => ImageBox::around_circle([u, v], radius_px).map(Some),
            (None, None) => Ok(None),
        };
        let score = row.fraction(score)?;
        let found = found.and_then(|found| match (found, score) {
            (Some(found), Some(score)) => found.with_score(score).map(Some),
            (found, _) => Ok(found),
        });
        // Nothing has no class.
        let has_box = !matches!(found, Ok(None));
        Ok(Found {
            frame: row.count(frame)?,
            class: class
                .filter(|_| has_box)
                .map(|class| row.text(class).map(str::to_owned))
                .transpose()?,
            found: found.map_err(|error| user_error!("{}: {error}", row.place()))?,
            place: Place::Line(row.line),
        })
    };
    table.rows().map(found).collect()
}

/// Returns the box of a row as the MOT Challenge has them: frames and pixels count from 1.
fn mot_box(table: &Table, row: &Row) -> Result<Found> {
    let frame = row.count(table.column("frame")?)?;
    let place = row.place();
    let frame = frame
        .checked_sub(1)
        .ok_or_else(|| user_error!("{place}: frame 0; without a header, frames count from 1"))?;
    let [left, top, width, height] =
        row.numbers(table.columns(["left", "top", "width", "height"])?)?;
    // A side lies half a pixel beyond the pixels' centres.
    let [left, top] = [left, top].map(|first| first - 1.5);
    let found = ImageBox::new([left, top, left + width, top + height]);
    let found = found.map_err(|error| user_error!("{place}: {error}"))?;
    // Some detectors' scores are no probabilities.
    let score = match table.optional_column("score") {
        Some(score) => row.numbers([score])?[0],
        None => -1.0,
    };
    Ok(Found {
        frame,
        class: None,
        found: Some(found.with_score(score).unwrap_or(found)),
        place: Place::Line(row.line),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(text: &str) -> Result<Vec<Found>> {
        let path = Path::new("boxes.csv");
        boxes_in(&Table::from_reader_with_or_without_header(
            path,
            text.as_bytes(),
            &MOT_COLUMNS,
        )?)
    }

    #[test]
    fn boxes_circles_and_files_of_the_mot_challenge_are_read() {
        let found = boxes(
            "frame,class,left_px,top_px,right_px,bottom_px,score\n3,cup,10,20,30,60,0.5\n3,ball,1,2,3,4,\n",
        );
        let found = found.unwrap();
        assert_eq!(
            (found[0].frame, found[0].class.as_deref()),
            (3, Some("cup"))
        );
        assert_eq!(found[0].found.unwrap().sides_px(), [10.0, 20.0, 30.0, 60.0]);
        assert_eq!(
            (
                found[0].found.unwrap().score(),
                found[1].found.unwrap().score()
            ),
            (Some(0.5), None)
        );
        let found = boxes("frame,u_px,v_px,radius_px\n0,100,50,10\n").unwrap();
        assert_eq!(
            found[0].found.unwrap().sides_px(),
            [90.0, 40.0, 110.0, 60.0]
        );
        let found = boxes("frame,u_px,v_px,radius_px\n4,,,\n").unwrap();
        assert_eq!((found[0].frame, found[0].found.is_none()), (4, true));
        let found = boxes("1,-1,11,21,20,40,0.8,-1,-1,-1\n2,-1,1,1,2,2,37.5,-1,-1,-1\n").unwrap();
        assert_eq!((found[0].frame, found[1].frame), (0, 1));
        // The pixels 10 to 29, counted from 0.
        assert_eq!(found[0].found.unwrap().sides_px(), [9.5, 19.5, 29.5, 59.5]);
        assert_eq!(
            (
                found[0].found.unwrap().score(),
                found[1].found.unwrap().score()
            ),
            (Some(0.8), None)
        );
        assert_eq!(
            (found[1].place, found[0].class.as_deref()),
            (Place::Line(2), None)
        );
    }

    #[test]
    fn one_camera_may_never_see_a_target_but_not_all() {
        let found = ImageBox::new([1.0, 2.0, 3.0, 4.0]).unwrap();
        let camera = |boxes: &[(TargetId, ImageBox)]| {
            let boxes = boxes.iter().map(|one| (0, vec![*one]));
            Some(CameraDetections {
                frames: FrameRange::ALL,
                boxes: boxes.collect(),
                looked_at: None,
                warnings: Vec::new(),
                classes: vec!["cup".to_owned()],
            })
        };
        let all = |cameras| Detections {
            cameras,
            targets: vec![TargetId::new(0)],
        };
        let sees = [(TargetId::new(0), found)];
        assert!(
            all(vec![camera(&[]), None, camera(&sees)])
                .check(&[])
                .is_ok()
        );
        let error = all(vec![camera(&[]), camera(&[])]).check(&[]).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("found: cup; give detector.class"),
            "{error}"
        );
    }

    #[test]
    fn errors_name_the_line() {
        for (text, wanted) in [
            (
                "frame,left_px\n0,1\n",
                "line 1: has no boxes or circles; needed: frame,left_px",
            ),
            (
                "left_px,top_px,right_px,bottom_px\n1,2,3,4\n",
                "line 1: column \"frame\" is missing",
            ),
            (
                "frame,left_px,top_px,right_px,bottom_px\n0,9,2,3,4\n",
                "line 2: box is [9.0, 2.0, 3.0, 4.0]",
            ),
            (
                "frame,left_px,top_px,right_px,bottom_px\n0,1,,,\n",
                "line 2, column top_px: ",
            ),
            (
                "frame,left_px,top_px,right_px,bottom_px,score\n0,1,2,3,4,50\n",
                "line 2, column score: holds \"50\"",
            ),
            (
                "frame,left_px,top_px,right_px,bottom_px\n-1,1,2,3,4\n",
                "line 2, column frame: holds \"-1\"",
            ),
            (
                "frame;left_px;top_px\n0;1,5;2,5\n",
                "line 1: the columns are separated by semicolons",
            ),
            ("0,-1,1,1,2,2,1\n", "line 1: frame 0"),
            ("1,-1,1,1,2,2,1\n1,-1,1,1,0,2,1\n", "line 2: box is"),
            ("1,-1,1,1\n", "line 1: has 4 cells"),
        ] {
            let error = boxes(text).err().map(|error| format!("{error:#}"));
            let error = error.unwrap_or_default();
            assert!(
                error.starts_with("boxes.csv, ") && error.contains(wanted),
                "{error}"
            );
        }
    }
}
