//! The images to learn from, and their labels.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::builder::{PathBufValueParser, TypedValueParser};
use clap::{Arg, ArgAction, ArgMatches, Command};
use pardalis::Frame;

use super::label::Label;
use crate::source::decode::decode_image;
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

/// An image and its labels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LabelledFile {
    pub(super) image: PathBuf,
    /// The target is the union of the labels.
    pub(super) labels: Vec<Label>,
}

/// The images to learn from.
#[derive(Debug, PartialEq)]
pub(super) struct Inputs {
    pub(super) files: Vec<LabelledFile>,
    /// Names of the images in the folder that have no mask.
    pub(super) without_mask: Vec<String>,
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

impl LabelledFile {
    /// Returns the name of the image file.
    pub(super) fn name(&self) -> String {
        name_of(&self.image)
    }

    /// Reads the image, and whether each pixel, row by row, shows the target.
    ///
    /// Errors: a file cannot be read or decoded, or a label does not fit the image.
    pub(super) fn load(&self) -> Result<(Frame, Vec<bool>)> {
        let image = decode_image(&self.image)?;
        let (width, height) = image.size_px();
        let mut is_object = vec![false; width * height];
        for label in &self.labels {
            label.mark(&self.image, (width, height), &mut is_object)?;
        }
        let frame = Frame::from_rgb(width, height, image.into_raw(), 0.0)?;
        Ok((frame, is_object))
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(
        || path.display().to_string(),
        |name| name.to_string_lossy().into_owned(),
    )
}

fn folder_inputs(folder: &Path, masks: &str) -> Result<Inputs> {
    let unreadable = |error| {
        user_error!(
            "{}: the folder cannot be read: {error}; give a folder of images, or --image FILE for a single image",
            folder.display()
        )
    };
    let mut images = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        let is_image = matches!(extension.as_deref(), Some("jpg" | "jpeg" | "png"));
        let name = name_of(&path);
        if is_image && !name.starts_with('.') && !name.ends_with(masks) && path.is_file() {
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
                image,
                labels: vec![Label::Mask(mask)],
            });
        } else {
            inputs.without_mask.push(name_of(&image));
        }
    }
    if inputs.files.is_empty() {
        let found = match inputs.without_mask.as_slice() {
            [] => "contains no images; allowed: files ending in .jpg, .jpeg or .png".to_owned(),
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
        return Err(user_error!("{}: the folder {found}", folder.display()));
    }
    Ok(inputs)
}

/// The options of [`Listed`].
const LISTED: [&str; 4] = ["image", "mask", "rect", "polygon"];

/// Images and labels in the order of the command line; a label belongs to the last image before it.
#[derive(Debug)]
struct Listed(Vec<Item>);

#[derive(Debug, Clone)]
enum Item {
    Image(PathBuf),
    Label(Label),
}

impl Listed {
    fn inputs(&self) -> Result<Inputs> {
        let mut files: Vec<LabelledFile> = Vec::new();
        for item in &self.0 {
            match (item, files.last_mut()) {
                (Item::Image(image), _) => {
                    if files.iter().any(|file| file.image == *image) {
                        return Err(user_error!(
                            "--image {} is given twice; give it once, followed by all its labels",
                            image.display()
                        ));
                    }
                    files.push(LabelledFile {
                        image: image.clone(),
                        labels: Vec::new(),
                    });
                }
                (Item::Label(label), Some(file)) => file.labels.push(label.clone()),
                (Item::Label(label), None) => {
                    return Err(user_error!(
                        "{label} comes before any image; put it after the --image FILE that it labels"
                    ));
                }
            }
        }
        if let Some(file) = files.iter().find(|file| file.labels.is_empty()) {
            return Err(user_error!(
                "--image {}: nothing is labelled; add --mask FILE, --rect X,Y,WIDTH,HEIGHT or \
                 --polygon X,Y,X,Y,X,Y after it",
                file.image.display()
            ));
        }
        if files.is_empty() {
            return Err(user_error!(
                "no image is given; give FOLDER --masks ENDING, or --image FILE and a label \
                 (see pardalis learn --help)"
            ));
        }
        Ok(Inputs {
            files,
            without_mask: Vec::new(),
        })
    }
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
                    .help("A JPEG or PNG image; may be repeated. Its labels are those that follow it; their union is the target"),
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
