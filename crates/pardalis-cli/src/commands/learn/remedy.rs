//! Remedies for balls that the detector does not find. Only those are recommended that were tried with success.

use std::fmt;

use anyhow::Result;

use super::balls::Circle;
use super::check::{Check, ImageCheck};
use super::inputs::LabelledFile;
use super::label::Label;
use super::palette::words_of;
use super::{Arguments, Lesson};
use crate::shell_word::shell_word;

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
    /// Another palette, by its options.
    Palette(&'static str),
    /// Boxes that are smaller than the labels.
    CloserBoxes,
    /// The numbers of the boxes as those of two corners.
    Corners,
    /// The numbers of the boxes with rows before columns.
    Swapped,
}

impl Remedy {
    /// Returns the other labels that were likely meant, if the detector finds more balls with them: boxes whose numbers were given in another order, and smaller ones if the labels are too
    /// large.
    ///
    /// Errors: an image cannot be read.
    pub(super) fn of_likely_labels(
        arguments: &Arguments,
        files: &[LabelledFile],
        lesson: &Lesson,
    ) -> Result<Option<Self>> {
        if lesson.check.failures() == 0 {
            return Ok(None);
        }
        let mut best: Option<Self> = None;
        for change in [Change::Corners, Change::Swapped] {
            if let Some(files) = reread_boxes(files, change)
                // Read otherwise, boxes may lie outside of their images.
                && let Ok(other) = Lesson::of(&files, &files, lesson.model.palette())
            {
                let found = best.as_ref().map_or(lesson.check.found(), Self::found);
                let change = (change, &*files);
                best = Self::of_labels(arguments, change, &other, found).or(best);
            }
        }
        match lesson.check.label_error() {
            Some(error) if error > 0.0 && best.is_none() => {
                Self::of_closer_boxes(arguments, files, lesson)
            }
            _ => Ok(best),
        }
    }

    /// Returns boxes that are smaller than the labels, if the detector finds more balls with them.
    ///
    /// Errors: an image cannot be read.
    pub(super) fn of_closer_boxes(
        arguments: &Arguments,
        files: &[LabelledFile],
        lesson: &Lesson,
    ) -> Result<Option<Self>> {
        let mut labels = files.iter().flat_map(|file| &file.labels);
        // Of circles and polygons, the report lists those that fit.
        let has_box = labels.any(|label| matches!(label, Label::Rect { .. }));
        if lesson.check.failures() == 0 || !has_box {
            return Ok(None);
        }
        let files = closer_boxes(files, &lesson.check);
        let other = Lesson::of(&files, &files, lesson.model.palette())?;
        let change = (Change::CloserBoxes, &*files);
        Ok(Self::of_labels(
            arguments,
            change,
            &other,
            lesson.check.found(),
        ))
    }

    /// Returns other labels, if the detector finds the ball in more than `found` images with what they teach.
    fn of_labels(
        arguments: &Arguments,
        (change, files): (Change, &[LabelledFile]),
        other: &Lesson,
        found: usize,
    ) -> Option<Self> {
        let inputs: Vec<String> = files.iter().map(LabelledFile::to_string).collect();
        let palette = words_of(other.model.palette());
        (other.check.found() > found).then(|| Self {
            change,
            found: other.check.found(),
            command: command(arguments, &inputs.join(" "), &palette),
        })
    }

    /// Returns the options of another palette.
    pub(super) fn of_palette(
        arguments: &Arguments,
        options: &'static str,
        better: &Lesson,
    ) -> Self {
        Self {
            change: Change::Palette(options),
            found: better.check.found(),
            command: command(arguments, &arguments.inputs.to_string(), options),
        }
    }

    /// Returns the number of images in which the ball is found then.
    pub(super) fn found(&self) -> usize {
        self.found
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
            Change::Palette(options) => write!(f, "With {options}"),
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
        !matches!(self.change, Change::Palette(_))
    }

    /// Says what to do.
    pub(super) fn advice(&self) -> &'static str {
        match self.change {
            Change::Palette(_) => "learn again with this option",
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
        command(
            &arguments,
            &arguments.inputs.to_string(),
            "--palette hsi --bins 24,16,6",
        )
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
