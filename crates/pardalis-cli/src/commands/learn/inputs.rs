//! The images to learn from, and their labels.

use std::path::{Path, PathBuf};
use std::{fmt, fs};

use anyhow::Result;
use clap::builder::{NonEmptyStringValueParser, PathBufValueParser, TypedValueParser};
use clap::{Arg, ArgAction, ArgMatches, Command};
use pardalis::{Frame, View};
use pardalis_camera::{Camera, Mask, Pinhole, Pose};
use pardalis_scene::{FrameRange, VideoInput};

use super::label::Label;
use crate::focal_length::{TYPICAL_FOV_DEG, focal_length_px, middle_px};
use crate::output::{Shown, in_line};
use crate::shell_word::shell_word;
use crate::source::decode::{decode_image, media_kind};
use crate::source::{Delivery, Source, SourceConfig, SourceKind};
use crate::user_error::user_error;

/// A folder with masks, or images and labels one by one.
#[derive(Debug, clap::Args)]
pub(super) struct InputOptions {
    /// A folder of JPEG or PNG images with masks next to them
    #[arg(requires = "masks", conflicts_with_all = LISTED)]
    folder: Option<PathBuf>,
    /// Ending of the masks of FOLDER: with _mask.png, the mask of 000.jpg is 000_mask.png. Images without a
    /// mask are skipped
    #[arg(long, value_name = "ENDING", requires = "folder")]
    masks: Option<String>,
    #[command(flatten)]
    listed: Listed,
}

/// An image, or a frame of a video, and its labels.
#[derive(Debug, Clone)]
pub(super) struct LabelledFile {
    /// The image or the video.
    path: PathBuf,
    /// The frame of a video.
    frame: Option<VideoFrame>,
    /// The target is the union of the labels.
    pub(super) labels: Vec<Label>,
    /// The lens of the camera, if it is known.
    lens: Option<Camera>,
}

/// A frame of a video or a recording, with its number from 0. Cloning shares the pixels.
#[derive(Debug, Clone)]
struct VideoFrame {
    /// The topic of a recording, if it was named.
    topic: Option<String>,
    number: usize,
    frame: Frame,
}

/// The images to learn from.
#[derive(Debug)]
pub(super) struct Inputs {
    pub(super) files: Vec<LabelledFile>,
    /// Names of the images in the folder that have no mask.
    pub(super) without_mask: Vec<String>,
}

/// Formats the options as on the command line.
impl fmt::Display for InputOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(folder), Some(masks)) = (&self.folder, &self.masks) {
            let masks = shell_word(Path::new(masks));
            return write!(f, "{} --masks {masks}", shell_word(folder));
        }
        let words: Vec<String> = self.listed.0.iter().map(Item::to_string).collect();
        write!(f, "{}", words.join(" "))
    }
}

impl InputOptions {
    /// Returns the images and labels given on the command line.
    ///
    /// Errors: there are none, or they are inconsistent.
    pub(super) fn inputs(&self) -> Result<Inputs> {
        match (&self.folder, &self.masks) {
            (Some(folder), Some(masks)) => folder_inputs(folder, masks),
            _ => self.listed.inputs(),
        }
    }
}

/// Formats the image and its labels as on the command line.
impl fmt::Display for LabelledFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", Item::Image(self.path.clone()))?;
        if let Some(VideoFrame { topic, number, .. }) = &self.frame {
            if let Some(topic) = topic {
                write!(f, " {}", Item::Topic(topic.clone()))?;
            }
            write!(f, " {}", Item::Frame(*number))?;
        }
        self.labels
            .iter()
            .try_for_each(|label| write!(f, " {label}"))
    }
}

impl LabelledFile {
    /// Labels a frame of a video or a camera, with its number.
    #[cfg(feature = "studio")]
    pub(super) fn of_frame(
        path: PathBuf,
        (number, frame): (usize, Frame),
        lens: Option<Camera>,
        label: Label,
    ) -> Self {
        Self {
            lens,
            path,
            frame: Some(VideoFrame {
                topic: None,
                number,
                frame,
            }),
            labels: vec![label],
        }
    }

    /// Whether its label is a single circle or polygon, drawn around one body.
    pub(super) fn has_drawn_outline(&self) -> bool {
        matches!(self.labels[..], [Label::Circle { .. } | Label::Polygon(_)])
    }

    /// Returns the image with its label enlarged by this factor; `None` unless that is a single circle.
    pub(super) fn resized(&self, factor: f64) -> Option<Self> {
        let [label] = &self.labels[..] else {
            return None;
        };
        label.resized(factor).map(|label| self.labelled(label))
    }

    /// Returns the image with this label alone.
    pub(super) fn labelled(&self, label: Label) -> Self {
        Self {
            labels: vec![label],
            ..self.clone()
        }
    }

    /// Returns the name of the image file, or of the video with the number of the frame: with as many folders before it as tell it from
    /// these others.
    pub(super) fn name_among(&self, files: &[Self]) -> String {
        let others = files.iter().filter(|other| other.path != self.path);
        let is_unique = |name: &PathBuf| !others.clone().any(|other| other.path.ends_with(name));
        let mut endings =
            (1..=self.path.components().count()).map(|count| ending(&self.path, count));
        let name = endings.find(is_unique).unwrap_or_else(|| self.path.clone());
        let name = name.shown();
        match &self.frame {
            Some(VideoFrame { number, .. }) => format!("{name} {number}"),
            None => name,
        }
    }

    /// Returns the view of the camera of a frame with the identity as pose; that of a typical pinhole camera if its lens is not known.
    pub(super) fn view(&self, frame: &Frame, mask: Option<Mask>) -> Result<View> {
        let size = (frame.width(), frame.height());
        Ok(View::new(self.lens(frame)?, Pose::identity(), size, mask)?)
    }

    /// Returns the lens of the camera of a frame; that of a typical pinhole camera if it is not known.
    pub(super) fn lens(&self, frame: &Frame) -> Result<Camera> {
        let size = (frame.width(), frame.height());
        let focal_px = focal_length_px(size, TYPICAL_FOV_DEG);
        Ok(match &self.lens {
            Some(lens) => lens.clone(),
            None => Pinhole::new([focal_px; 2], middle_px(size), &[])?.into(),
        })
    }

    /// Reads the image, and whether each pixel, row by row, shows the target.
    ///
    /// Errors: a file cannot be read or decoded, or a label does not fit the image.
    pub(super) fn load(&self) -> Result<(Frame, Vec<bool>)> {
        let frame = match &self.frame {
            Some(VideoFrame { frame, .. }) => frame.clone(),
            None => still(&self.path)?,
        };
        let size = (frame.width(), frame.height());
        let mut is_object = vec![false; size.0 * size.1];
        for label in &self.labels {
            label.mark(&self.path, size, &mut is_object)?;
        }
        Ok((frame, is_object))
    }
}

/// Reads an image.
fn still(path: &Path) -> Result<Frame> {
    let image = decode_image(path).map_err(|error| {
        if !path.is_file() || has_image_ending(path) {
            return error;
        }
        user_error!(
            "{error:#}; or, if it is a video or a recording, name a frame: --image {} --frame NUMBER",
            shell_word(path)
        )
    })?;
    let (width, height) = image.size_px();
    Ok(Frame::from_rgb(width, height, image.into_raw(), 0.0)?)
}

/// Reads the frame of a video or a recording with this number, from 0.
fn video_frame(image: &ListedImage, number: usize) -> Result<Frame> {
    let path = image.path;
    let unusable = |reason: &str| user_error!("{image}: {reason}");
    if has_image_ending(path) {
        return Err(unusable("this is a single image; leave --frame out"));
    }
    let is_recording = media_kind(path) == Some("recording");
    if image.topic.is_some() && !is_recording {
        return Err(unusable(
            "is no MCAP recording, which alone has topics; leave --topic out",
        ));
    }
    let mut source = Source::open(&SourceConfig {
        kind: if is_recording {
            SourceKind::Mcap {
                file: path.to_owned(),
                topic: image.topic.map(str::to_owned),
            }
        } else {
            SourceKind::Video {
                video: VideoInput::of_path(&path.to_string_lossy()),
                encoding: None,
            }
        },
        time_offset_s: 0.0,
        frames: FrameRange {
            first: number,
            step: 1,
            limit: Some(1),
        },
    })?;
    match source.next() {
        Some(Ok(Delivery::Frame { frame, .. })) => Ok(frame),
        Some(Ok(Delivery::Broken(error)) | Err(error)) => Err(unusable(&format!("{error:#}"))),
        None => Err(unusable("there is no such frame; give a smaller number")),
    }
}

fn has_image_ending(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    matches!(ending.as_deref(), Some("jpg" | "jpeg" | "png"))
}

/// Returns the last components of a path, this many.
fn ending(path: &Path, count: usize) -> PathBuf {
    let all = path.components();
    all.clone().skip(all.count() - count).collect()
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .map_or_else(|| path.shown(), |name| name.to_string_lossy().into_owned())
}

fn folder_inputs(folder: &Path, masks: &str) -> Result<Inputs> {
    let unreadable = |error| {
        user_error!(
            "{}: the folder cannot be read: {error}; give a folder of images, or --image FILE for a single image",
            folder.shown()
        )
    };
    let mut images = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let name = name_of(&path);
        if has_image_ending(&path)
            && !name.starts_with('.')
            && !name.ends_with(masks)
            && path.is_file()
        {
            images.push(path);
        }
    }
    images.sort();
    let mut inputs = Inputs {
        files: Vec::new(),
        without_mask: Vec::new(),
    };
    for image in images {
        let mut mask = image.file_stem().unwrap_or_default().to_owned();
        mask.push(masks);
        let mask = image.with_file_name(mask);
        if mask.is_file() {
            inputs.files.push(LabelledFile {
                path: image,
                frame: None,
                labels: vec![Label::Mask(mask)],
                lens: None,
            });
        } else {
            inputs.without_mask.push(in_line(&name_of(&image)));
        }
    }
    if inputs.files.is_empty() {
        let found = match inputs.without_mask.as_slice() {
            [] => {
                "contains no images; allowed: files ending in .jpg, .jpeg or .png (convert others)"
                    .to_owned()
            }
            [first, ..] => format!(
                "has no mask for any of its {} images: {first} needs a mask {}{masks} next to it; \
                 give the ending of the masks with --masks",
                inputs.without_mask.len(),
                Path::new(first)
                    .file_stem()
                    .unwrap_or_default()
                    .to_string_lossy()
            ),
        };
        return Err(user_error!("{}: the folder {found}", folder.shown()));
    }
    Ok(inputs)
}

/// The options of [`Listed`].
const LISTED: [&str; 7] = [
    "image", "topic", "frame", "mask", "rect", "circle", "polygon",
];

/// Images, topics, frames and labels in the order of the command line; a topic and a frame belong to the last recording or video before them, and a label to
/// the last image or frame before it.
#[derive(Debug)]
struct Listed(Vec<Item>);

#[derive(Debug, Clone)]
enum Item {
    Image(PathBuf),
    /// A topic of a recording.
    Topic(String),
    /// A frame of a video or a recording by its number.
    Frame(usize),
    Label(Label),
}

/// Formats it as on the command line.
impl fmt::Display for Item {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Image(path) => write!(f, "--image {}", shell_word(path)),
            Self::Topic(topic) => write!(f, "--topic {}", shell_word(Path::new(topic))),
            Self::Frame(number) => write!(f, "--frame {number}"),
            Self::Label(label) => write!(f, "{label}"),
        }
    }
}

/// An image of the command line, or a frame of a video or a recording by its number, and its labels.
struct ListedImage<'a> {
    path: &'a Path,
    topic: Option<&'a str>,
    frame: Option<usize>,
    labels: Vec<Label>,
}

/// Formats it as on the command line.
impl fmt::Display for ListedImage<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", Item::Image(self.path.to_owned()))?;
        if let Some(topic) = self.topic {
            write!(f, " {}", Item::Topic(topic.to_owned()))?;
        }
        match self.frame {
            Some(number) => write!(f, " {}", Item::Frame(number)),
            None => Ok(()),
        }
    }
}

impl Listed {
    fn inputs(&self) -> Result<Inputs> {
        let images = self.images()?;
        for (number, image) in images.iter().enumerate() {
            let is_same = |other: &ListedImage| {
                (other.path, other.topic, other.frame) == (image.path, image.topic, image.frame)
            };
            if images[..number].iter().any(is_same) {
                return Err(user_error!(
                    "{image} is given twice; give it once, followed by all its labels"
                ));
            }
        }
        if let Some(image) = images.iter().find(|image| image.labels.is_empty()) {
            return Err(user_error!(
                "{image}: nothing is labelled; add --mask FILE, --rect X,Y,WIDTH,HEIGHT, \
                 --circle U,V,R or --polygon X,Y,X,Y,X,Y after it",
            ));
        }
        if images.is_empty() {
            return Err(user_error!(
                "no image is given; give FOLDER --masks ENDING, or --image FILE and a label \
                 (see pardalis learn --help)"
            ));
        }
        let files = images.into_iter().map(|image| {
            let frame = match image.frame {
                Some(number) => Some(VideoFrame {
                    topic: image.topic.map(str::to_owned),
                    number,
                    frame: video_frame(&image, number)?,
                }),
                None if image.topic.is_some() => {
                    return Err(user_error!(
                        "{image}: which of its images is meant? Add --frame NUMBER after it"
                    ));
                }
                None => None,
            };
            Ok(LabelledFile {
                path: image.path.to_owned(),
                frame,
                labels: image.labels,
                lens: None,
            })
        });
        Ok(Inputs {
            files: files.collect::<Result<_>>()?,
            without_mask: Vec::new(),
        })
    }

    /// Assigns frames and labels to images.
    fn images(&self) -> Result<Vec<ListedImage<'_>>> {
        let mut images: Vec<ListedImage> = Vec::new();
        for item in &self.0 {
            match (item, images.last_mut()) {
                (Item::Image(path), _) => images.push(ListedImage {
                    path,
                    topic: None,
                    frame: None,
                    labels: Vec::new(),
                }),
                (Item::Topic(topic), Some(image))
                    if image.frame.is_none() && image.topic.is_none() =>
                {
                    image.topic = Some(topic);
                }
                (Item::Topic(_), _) => {
                    return Err(user_error!(
                        "{item}: put it directly after the --image FILE that names the recording, before --frame"
                    ));
                }
                (Item::Frame(number), Some(image)) if image.frame.is_some() => {
                    let (path, topic) = (image.path, image.topic);
                    images.push(ListedImage {
                        path,
                        topic,
                        frame: Some(*number),
                        labels: Vec::new(),
                    });
                }
                (Item::Frame(number), Some(image)) if image.labels.is_empty() => {
                    image.frame = Some(*number);
                }
                (Item::Frame(number), Some(image)) => {
                    return Err(user_error!(
                        "--frame {number} follows labels; put it directly after {image}, before the labels of the frame"
                    ));
                }
                (Item::Frame(number), None) => {
                    return Err(user_error!(
                        "--frame {number} comes before any video; put it after the --image FILE that names the video or recording"
                    ));
                }
                (Item::Label(label), Some(image)) => image.labels.push(label.clone()),
                (Item::Label(label), None) => {
                    return Err(user_error!(
                        "{label} comes before any image; put it after the --image FILE that it labels"
                    ));
                }
            }
        }
        Ok(images)
    }
}

fn frame_number(text: &str) -> Result<Item, &'static str> {
    let number = text.parse().map(Item::Frame);
    number.map_err(|_| "allowed: a whole number, 0 or more")
}

impl clap::FromArgMatches for Listed {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut items: Vec<(usize, &Item)> = Vec::new();
        for name in LISTED {
            let indices = matches.indices_of(name).into_iter().flatten();
            items.extend(indices.zip(matches.get_many(name).into_iter().flatten()));
        }
        items.sort_by_key(|&(index, _)| index);
        Ok(Self(
            items.into_iter().map(|(_, item)| item.clone()).collect(),
        ))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl clap::Args for Listed {
    fn augment_args(command: Command) -> Command {
        let option = |name: &'static str, value_name: &'static str| {
            Arg::new(name)
                .long(name)
                .value_name(value_name)
                .action(ArgAction::Append)
        };
        let label = |parse: fn(&str) -> Result<Label, String>| {
            move |text: &str| parse(text).map(Item::Label)
        };
        command
            .arg(
                option("image", "FILE")
                    .value_parser(PathBufValueParser::new().map(Item::Image))
                    .help("A JPEG or PNG image, a video or an MCAP recording; may be repeated. Its labels are those that follow it; their union is the target"),
            )
            .arg(
                option("topic", "TOPIC")
                    .value_parser(NonEmptyStringValueParser::new().map(Item::Topic))
                    .help("Selects the images of the recording before it, if it has several topics with images"),
            )
            .arg(
                option("frame", "NUMBER")
                    .value_parser(frame_number)
                    .allow_hyphen_values(true)
                    .help("Selects a frame of the video or recording before it, counted from 0; may be repeated. Its labels follow it. Videos need an installed ffmpeg"),
            )
            .arg(
                option("mask", "FILE")
                    .value_parser(PathBufValueParser::new().map(|p| Item::Label(Label::Mask(p))))
                    .help("Labels the image: a mask of the same size, 128 or brighter on the target"),
            )
            .arg(
                option("rect", "X,Y,WIDTH,HEIGHT")
                    .value_parser(label(Label::rect))
                    .allow_hyphen_values(true)
                    .help("Labels the image: a box drawn closely around the target, in pixels; 0,0 is the top left pixel"),
            )
            .arg(
                option("circle", "U,V,R")
                    .value_parser(label(Label::circle))
                    .allow_hyphen_values(true)
                    .help("Labels the image: a circle along the target's outline, given by its centre and its radius in pixels; 0,0 is the centre of the top left pixel. It may reach beyond the image"),
            )
            .arg(
                option("polygon", "X,Y,X,Y,X,Y...")
                    .value_parser(label(Label::polygon))
                    .allow_hyphen_values(true)
                    .help("Labels the image: a polygon along the target's outline, given by its corners in pixels"),
            )
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_have_as_many_folders_as_tell_them_apart() {
        let paths = [
            "a/left/1.jpg",
            "a/right/1.jpg",
            "b/left/2.jpg",
            "3.jpg",
            "b/3.jpg",
        ];
        let file = |path: &str| LabelledFile {
            path: path.into(),
            frame: None,
            labels: Vec::new(),
            lens: None,
        };
        // Twice, as in two labels of one image.
        let files: Vec<_> = paths
            .into_iter()
            .chain(["a/left/1.jpg"])
            .map(file)
            .collect();
        let names: Vec<String> = files.iter().map(|file| file.name_among(&files)).collect();
        let expected = [
            "left/1.jpg",
            "right/1.jpg",
            "2.jpg",
            "3.jpg",
            "b/3.jpg",
            "left/1.jpg",
        ];
        assert_eq!(names, expected);
    }
}
