//! `pardalis learn`: learns a colour model from labelled images.

mod balls;
mod check;
mod contrast;
mod detector;
mod evidence;
mod inputs;
mod label;
mod outline;
mod palette;
mod pictures;
mod remedy;
mod report;
#[cfg(feature = "studio")]
pub(crate) mod samples;

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::color::{ColorModel, Palette};

use crate::files::{refuse_foreign, write_file};
use crate::output::{Shown, print};
use crate::user_error::user_error;
use check::Check;
use evidence::Evidence;
use inputs::{InputOptions, LabelledFile};
use palette::{PALETTES, PaletteOptions};
use remedy::Remedy;
use report::Report;

const EXAMPLES: &str = "Examples:
  Every image of a folder that has a mask beside it (000.jpg and 000_mask.png):
    pardalis learn training --masks _mask.png -o orange.colors.toml
  Images and boxes drawn around the target, left, top, width and height; labels belong to the image before them:
    pardalis learn --image a.jpg --rect 396,82,28,28 --image b.jpg --rect 210,80,40,40 -o orange.colors.toml
  A mask, and a polygon along the outline:
    pardalis learn --image a.jpg --mask a_mask.png --image b.jpg \\
      --polygon 424,96,423,101,420,106,415,109,410,110,405,109,400,106,397,101,\\
396,96,397,91,400,86,405,83,410,82,415,83,420,86,423,91 -o orange.colors.toml
  Two frames of a video (needs an installed ffmpeg):
    pardalis learn --image clip.mp4 --frame 17 --rect 641,222,98,98 --frame 37 --circle 265,261,51 -o ball.colors.toml
  A frame of an MCAP recording:
    pardalis learn --image ride.mcap --topic /left/image_raw --frame 120 --circle 265,261,51 -o ball.colors.toml
  For a camera that delivers YUV:
    pardalis learn training --masks _mask.png --palette yuv --yuv-range limited -o orange.colors.toml";

/// Learns the colours of a target from labelled images
///
/// Label the whole target: along its outline with a mask, a circle or a polygon of 16 corners or more, or with a box drawn
/// closely around it. From a box around a round target, the colours of the inscribed ellipse are learnt, but not how the edge
/// blurs into the surroundings; a rectangular target that fills its box is learnt as it is. Labels that touch the image
/// border are not used to learn the edge. Circles and polygons of which most are larger than the sharp outlines of balls in the images
/// by the same share, or smaller, give way to these outlines.
///
/// Afterwards the detector of `track` is run on the images. The report says in which of them a labelled ball was found and
/// where, whether the labels fit the outlines, and the command that helps if not. If balls are missed, finer bins and other palettes
/// are tried, and taken if that helps, unless --palette or --bins is given. `Good` means that all balls were found.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Arguments {
    #[command(flatten)]
    inputs: InputOptions,
    /// The colour model to write; its name must end in .toml
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    palette: PaletteOptions,
    /// The folder for pictures of the model and of the labels [default: next to the output, orange-learnt for
    /// orange.colors.toml]
    #[arg(long, value_name = "FOLDER", conflicts_with = "no_pictures")]
    pictures: Option<PathBuf>,
    /// Draws no pictures
    #[arg(long)]
    no_pictures: bool,
}

/// Runs the command. The model is written before the pictures, which must not cost it if they do not fit on the disk.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let palette = arguments.palette.palette()?;
    let inputs = arguments.inputs.inputs()?;
    let output = &arguments.output;
    check_output(output)?;
    let files = &inputs.files;
    let (lesson, remedy, adopted) = learn_in_best_palette(arguments, files, palette)?;
    let Lesson {
        evidence,
        model,
        check,
        follows_outlines,
    } = lesson;
    let folder = arguments.pictures.clone();
    let folder = folder.unwrap_or_else(|| pictures_folder(output));
    if !arguments.no_pictures {
        pictures::make_folder(&folder)?;
    }
    write_file(output, model.to_text().as_bytes())?;
    let mut written = vec![output.clone()];
    if !arguments.no_pictures {
        let pictures = pictures::write(&folder, files, &evidence, &model, &check)?;
        written.extend(pictures);
    }
    let report = Report {
        evidence: &evidence,
        model: &model,
        check: &check,
        remedy: remedy.as_ref(),
        adopted,
        follows_outlines,
        without_mask: &inputs.without_mask,
        written: &written,
    };
    print(report.to_string().trim_end());
    Ok(())
}

/// What labelled images teach.
struct Lesson {
    evidence: Evidence,
    model: ColorModel,
    /// The detector on the images, and the labels as they were drawn.
    check: Check,
    /// Whether the outlines in the images were learnt in place of labels of another size.
    follows_outlines: bool,
}

impl Lesson {
    /// Learns from labels, and compares what is found with those that were drawn.
    fn of(labelled: &[LabelledFile], drawn: &[LabelledFile], palette: Palette) -> Result<Self> {
        let evidence = Evidence::gather(labelled, palette)?;
        let model = evidence.model()?;
        Ok(Self {
            check: Check::run(drawn, &mut evidence.learner(), &model)?,
            evidence,
            model,
            follows_outlines: false,
        })
    }
}

/// Another palette that was taken because the detector misses labelled balls with the default one.
#[derive(Debug, Clone, Copy)]
struct Adopted {
    /// Its options.
    options: &'static str,
    /// The number of images in which the ball is found with the default palette.
    found_before: usize,
}

/// Learns from labels. If the detector misses balls, takes the palette with which it finds more of them, unless a palette was chosen or other labels are likelier to help. Returns
/// also what helps if it still misses some.
fn learn_in_best_palette(
    arguments: &Arguments,
    files: &[LabelledFile],
    palette: Palette,
) -> Result<(Lesson, Option<Remedy>, Option<Adopted>)> {
    let lesson = learn(files, palette)?;
    let remedy = Remedy::of_likely_labels(arguments, files, &lesson)?;
    let found = remedy.as_ref().map_or(lesson.check.found(), Remedy::found);
    let Some((better, options)) = in_better_palette(files, &lesson, found)? else {
        let remedy = match remedy {
            None => Remedy::of_closer_boxes(arguments, files, &lesson)?,
            remedy => remedy,
        };
        return Ok((lesson, remedy, None));
    };
    if arguments.palette.is_given() {
        let remedy = Remedy::of_palette(arguments, options, &better);
        return Ok((lesson, Some(remedy), None));
    }
    let remedy = match Remedy::of_likely_labels(arguments, files, &better)? {
        None => Remedy::of_closer_boxes(arguments, files, &better)?,
        remedy => remedy,
    };
    let adopted = Adopted {
        options,
        found_before: lesson.check.found(),
    };
    Ok((better, remedy, Some(adopted)))
}

/// Learns from labels in other palettes than that of a lesson. Returns what the one teaches with which the detector finds most balls, the first of equal ones, and its options; `None` if
/// it finds no more than `found` with any.
fn in_better_palette(
    files: &[LabelledFile],
    lesson: &Lesson,
    found: usize,
) -> Result<Option<(Lesson, &'static str)>> {
    let balls = lesson.check.ball_count();
    let (mut best, mut most) = (None, found);
    for (options, palette) in PALETTES {
        if most < balls && palette != lesson.model.palette() {
            let other = learn(files, palette)?;
            if other.check.found() > most {
                most = other.check.found();
                best = Some((other, options));
            }
        }
    }
    Ok(best)
}

/// Learns from labels, or from the outlines in their images if these are sharp and most of the labels are too large or too small.
fn learn(files: &[LabelledFile], palette: Palette) -> Result<Lesson> {
    let drawn = Lesson::of(files, files, palette)?;
    let Some(outlined) = drawn.check.followed(files)? else {
        return Ok(drawn);
    };
    let followed = Lesson::of(&outlined, files, palette)?;
    if followed.check.failures() > drawn.check.failures() {
        return Ok(drawn);
    }
    Ok(Lesson {
        follows_outlines: true,
        ..followed
    })
}

/// Rejects, before any work is done, an output that cannot be a colour model file.
fn check_output(path: &Path) -> Result<()> {
    let name = path.shown();
    if path.extension().is_none_or(|extension| extension != "toml") {
        return Err(user_error!(
            "--output {name}: a colour model is a TOML file; choose a name ending in .toml, such as orange.colors.toml"
        ));
    }
    if path.is_dir() {
        return Err(user_error!(
            "--output {name}: this is a folder; give the name of a file"
        ));
    }
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    match folder {
        Some(folder) if !folder.is_dir() => Err(user_error!(
            "--output {name}: the folder {} does not exist; create it, or choose another",
            folder.shown()
        )),
        _ => refuse_foreign("--output", path, "colour model", is_model),
    }
}

fn is_model(path: &Path) -> bool {
    let text = std::fs::read_to_string(path);
    text.is_ok_and(|text| ColorModel::from_text(&text).is_ok())
}

/// Returns `orange-learnt`, next to `orange.colors.toml`.
fn pictures_folder(output: &Path) -> PathBuf {
    let stem = output.file_stem().unwrap_or_default().to_string_lossy();
    let stem = stem.strip_suffix(".colors").unwrap_or(&stem);
    output.with_file_name(format!("{stem}-learnt"))
}
