//! Remedies for balls that the detector does not find. Only those are recommended that were tried with success.

use std::fmt;

use anyhow::Result;
use pardalis::color::Palette;

use super::Arguments;
use super::balls::Circle;
use super::check::{Check, ImageCheck};
use super::evidence::Evidence;
use super::inputs::LabelledFile;
use super::label::Label;
use super::palette::words_of;
use crate::shell_word::shell_word;

/// The options of other palettes that are tried.
pub(super) const PALETTES: [(&str, Palette); 3] = [
    (
        "--palette hsi --bins 24,16,6",
        Palette::Hsi {
            hue_bins: 24,
            saturation_bins: 16,
            intensity_bins: 6,
        },
    ),
    ("--palette yuv", Palette::YUV),
    ("--palette rgb", Palette::Rgb { channel_bins: 8 }),
];
/// The size of boxes that are tried, as a share of the labels'.
const CLOSER: f64 = 0.85;

/// What to change, and in how many images the ball is found then.
#[derive(Debug)]
pub(super) struct Remedy {
    change: Change,
    found: usize,
    /// The command that does it.
    pub(super) command: String,
}

#[derive(Debug, Clone, Copy)]
enum Change {
    /// Another palette, and its options.
    Options(&'static str, Palette),
    /// Boxes that are smaller than the labels.
    CloserBoxes,
    /// The numbers of the boxes as those of two corners.
    Corners,
    /// The numbers of the boxes with rows before columns.
    Swapped,
}

impl Remedy {
    /// Returns the change that makes the detector find the ball in most images, and in more than `check` did; of equal ones
    /// the first that was tried.
    ///
    /// Errors: an image cannot be read.
    pub(super) fn find(
        arguments: &Arguments,
        files: &[LabelledFile],
        palette: Palette,
        check: &Check,
    ) -> Result<Option<Self>> {
        let closer = closer_boxes(files, check);
        let others = PALETTES.iter().filter(|(_, other)| *other != palette);
        let palettes =
            others.map(|&(options, other)| (Change::Options(options, other), files, other));
        let boxes = (Change::CloserBoxes, &*closer, palette);
        // If labels are too large, that is the likely cause.
        let is_too_large = check.label_error().is_some_and(|error| error > 0.0);
        let [first, last] = [is_too_large, !is_too_large].map(|tries| tries.then_some(boxes));
        let reread = [Change::Corners, Change::Swapped];
        let reread = reread.map(|change| Some((change, reread_boxes(files, change)?)));
        let reread = reread.iter().flatten();
        let reread = reread.map(|(change, files)| (*change, &**files, palette));
        let tried = reread.chain(first).chain(palettes).chain(last);
        let balls = check.ball_count();
        let mut best: Option<Self> = None;
        for (change, files, palette) in tried {
            let evidence = match Evidence::gather(files, palette) {
                // Read otherwise, boxes may lie outside of their images.
                Err(_) if matches!(change, Change::Corners | Change::Swapped) => continue,
                evidence => evidence?,
            };
            let tried = Check::run(files, &mut evidence.learner(), &evidence.model()?)?;
            let found = tried.ball_count() - tried.failures();
            let best_found = best
                .as_ref()
                .map_or(balls - check.failures(), |best| best.found);
            if found > best_found {
                let command = if let Change::Options(options, _) = change {
                    command(arguments, &arguments.inputs.to_string(), options)
                } else {
                    let inputs: Vec<String> = files.iter().map(LabelledFile::to_string).collect();
                    command(arguments, &inputs.join(" "), &words_of(palette))
                };
                best = Some(Self {
                    change,
                    found,
                    command,
                });
            }
            if found >= balls {
                break;
            }
        }
        Ok(best)
    }
}

/// Reads the four numbers of a box as those of two corners or in the other order; `None` if they make no box then.
fn reread([a, b, c, d]: [usize; 4], change: Change) -> Option<Label> {
    let [x, y, width, height] = match change {
        Change::Corners => [a, b, c.checked_sub(a)?, d.checked_sub(b)?],
        _ => [b, a, d, c],
    };
    (width > 0 && height > 0).then_some(Label::Rect {
        x,
        y,
        width,
        height,
    })
}

/// Returns the files with all labels read otherwise; `None` unless all are boxes that can be.
fn reread_boxes(files: &[LabelledFile], change: Change) -> Option<Vec<LabelledFile>> {
    let of_label = |label: &Label| match *label {
        Label::Rect {
            x,
            y,
            width,
            height,
        } => reread([x, y, width, height], change),
        _ => None,
    };
    let of_file = |file: &LabelledFile| {
        let mut file = file.clone();
        file.labels = file.labels.iter().map(of_label).collect::<Option<_>>()?;
        (!file.labels.is_empty()).then_some(file)
    };
    files.iter().map(of_file).collect()
}

/// Returns the files with boxes that are smaller than the labelled balls.
fn closer_boxes(files: &[LabelledFile], check: &Check) -> Vec<LabelledFile> {
    let with_boxes = |(file, image): (&LabelledFile, &ImageCheck)| {
        let mut file = file.clone();
        if let ImageCheck::Ball { labels, .. } = image {
            file.labels = labels.iter().map(closer_box).collect();
        }
        file
    };
    files.iter().zip(&check.images).map(with_boxes).collect()
}

/// Returns a box that is smaller than a labelled ball.
fn closer_box(ball: &Circle) -> Label {
    let reach_px = CLOSER * ball.radius_px;
    let corner = |center_px: f64| (center_px + 0.5 - reach_px).round().max(0.0) as usize;
    let [x, y] = ball.center_px.map(corner);
    let side = ((2.0 * reach_px).round() as usize).max(1);
    Label::Rect {
        x,
        y,
        width: side,
        height: side,
    }
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.change {
            Change::Options(options, _) => write!(f, "With {options}"),
            Change::CloserBoxes => write!(
                f,
                "With boxes {:.0} % smaller than these labels",
                100.0 * (1.0 - CLOSER)
            ),
            Change::Corners => write!(f, "With these boxes as two corners, X1,Y1,X2,Y2"),
            Change::Swapped => write!(f, "With these boxes as Y,X,HEIGHT,WIDTH"),
        }?;
        write!(f, ", it is found in {}", self.found)
    }
}

impl Remedy {
    /// Reports whether it is about the size of the labels.
    pub(super) fn changes_labels(&self) -> bool {
        !matches!(self.change, Change::Options(..))
    }

    /// Returns the other palette that it consists in, if it does, and its options.
    pub(super) fn palette(&self) -> Option<(Palette, &'static str)> {
        match self.change {
            Change::Options(options, palette) => Some((palette, options)),
            _ => None,
        }
    }

    /// Says what to do.
    pub(super) fn advice(&self) -> &'static str {
        match self.change {
            Change::Options(..) => "learn again with this option",
            Change::CloserBoxes => {
                "the labels are larger than the ball, or its edge is blurred; take these boxes"
            }
            Change::Corners | Change::Swapped => "boxes are X,Y,WIDTH,HEIGHT; take these",
        }
    }
}

/// Formats the command of the arguments with these inputs and options of the palette.
fn command(arguments: &Arguments, inputs: &str, palette: &str) -> String {
    let pictures = match &arguments.pictures {
        Some(folder) => format!(" --pictures {}", shell_word(folder)),
        None if arguments.no_pictures => " --no-pictures".to_owned(),
        None => String::new(),
    };
    let output = shell_word(&arguments.output);
    format!("pardalis learn {inputs} {palette}{pictures} -o {output}")
}

#[cfg(test)]
mod tests {
    use clap::{Args, Command, FromArgMatches};

    use super::*;

    /// Returns the command of these arguments with finer bins.
    fn with_finer_bins(words: &[&str]) -> String {
        let command_line = Arguments::augment_args(Command::new("learn"));
        let matches = command_line.try_get_matches_from([&["learn"], words].concat());
        let arguments = Arguments::from_arg_matches(&matches.unwrap()).unwrap();
        command(&arguments, &arguments.inputs.to_string(), PALETTES[0].0)
    }

    #[test]
    fn commands_repeat_the_arguments_except_for_the_palette() {
        let inputs = "--image a.mp4 --frame 3 --circle 1,2.5,3 --rect 1,2,3,4 --frame 5 \
                      --mask b.png --polygon 1,2,8,2,8,9";
        let words: Vec<&str> = inputs.split(' ').collect();
        let options = ["--palette", "yuv", "--no-pictures", "-o", "m.toml"];
        assert_eq!(
            with_finer_bins(&[&words[..], &options].concat()),
            format!("pardalis learn {inputs} --palette hsi --bins 24,16,6 --no-pictures -o m.toml")
        );
        assert_eq!(
            with_finer_bins(&["a", "--masks", "_m.png", "--pictures", "b", "-o", "c.toml"]),
            "pardalis learn a --masks _m.png --palette hsi --bins 24,16,6 --pictures b -o c.toml"
        );
    }
}
