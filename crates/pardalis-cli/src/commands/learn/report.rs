//! The printed report of `pardalis learn`.

use std::fmt;
use std::path::PathBuf;

use pardalis::color::ColorModel;

use super::Adopted;
use super::balls::Circle;
use super::check::{Check, ImageCheck};
use super::evidence::Evidence;
use super::pictures::MOSAIC;
use super::remedy::Remedy;
use crate::numbers::counted;
use crate::output::Shown;

/// Maximum number of bins, or of image names, that are listed.
const MAX_LISTED: usize = 8;

/// Minimum share of both the target and the background for a bin to be listed as shared.
const SHARED_PART: f64 = 0.01;

/// The data of the report.
pub(super) struct Report<'a> {
    pub(super) evidence: &'a Evidence,
    pub(super) model: &'a ColorModel,
    pub(super) check: &'a Check,
    /// What helps if the target was not found everywhere.
    pub(super) remedy: Option<&'a Remedy>,
    /// The palette that was taken in place of the default one.
    pub(super) adopted: Option<Adopted>,
    /// Whether the outlines in the images were learnt in place of the labels.
    pub(super) follows_outlines: bool,
    /// Names of skipped images.
    pub(super) without_mask: &'a [String],
    /// The written files.
    pub(super) written: &'a [PathBuf],
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let background_pixels = self.evidence.background_pixels();
        writeln!(
            f,
            "Learnt from {} of the target in {}; {} of background.",
            counted(self.model.pixel_count(), "pixel"),
            counted(self.model.image_count(), "image"),
            counted(background_pixels, "pixel")
        )?;
        self.write_left_out(f)?;
        self.write_boxes(f)?;
        if self.follows_outlines {
            writeln!(
                f,
                "The outlines in the images were learnt in place of the labels, most of which are larger or smaller by the same share."
            )?;
        }
        self.write_bins(f)?;
        if background_pixels > 0 {
            self.write_separation(f)?;
        } else {
            writeln!(
                f,
                "\nThe separation cannot be judged because every pixel is labelled as the target. \
                 Label images that also show its surroundings."
            )?;
        }
        self.write_ranges(f)?;
        self.write_images(f)?;
        // Last, because it says what to do next.
        self.write_check(f)?;
        writeln!(f, "\nWritten:")?;
        for path in self.written {
            writeln!(f, "  {}", path.shown())?;
        }
        Ok(())
    }
}

impl Report<'_> {
    /// Returns where the labels are drawn.
    fn mosaic(&self) -> String {
        let drawn = self.written.iter().find(|path| path.ends_with(MOSAIC));
        drawn.map_or_else(
            || format!("{MOSAIC} (leave --no-pictures out)"),
            |path| path.shown(),
        )
    }

    fn write_left_out(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.without_mask.is_empty() {
            return Ok(());
        }
        let names: Vec<&str> = self.without_mask.iter().map(String::as_str).collect();
        writeln!(f, "Skipped for lack of a mask: {}.", images(&names))
    }

    fn write_boxes(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let images_with_boxes = self.evidence.images.iter().filter(|image| image.has_box);
        let names: Vec<&str> = images_with_boxes.map(|image| image.name.as_str()).collect();
        if names.is_empty() {
            return Ok(());
        }
        writeln!(
            f,
            "Boxes around the target in {}: the colours of the ellipse inside each box are learnt, but no edge; \
             for the most accurate distances, draw masks or polygons along the outline.",
            images(&names)
        )
    }

    fn write_bins(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let palette = self.model.palette();
        let [first, second, third] = palette.channel_names();
        let [a, b, c] = palette.channel_bins();
        let (object, background) = self.evidence.counts();
        let mut bins: Vec<usize> = (0..object.len()).filter(|&bin| object[bin] > 0).collect();
        bins.sort_by_key(|&bin| (u64::MAX - object[bin], bin));
        writeln!(
            f,
            "\nMost frequent of the {} bins in use, out of {} ({first} {a}, {second} {b}, {third} {c}; indices start at 0):",
            bins.len(),
            object.len()
        )?;
        writeln!(
            f,
            "{:>9} {:>11}   {first}, {second}, {third}",
            "target", "background"
        )?;
        for &bin in bins.iter().take(MAX_LISTED) {
            let [a, b, c] = palette.channels_of_bin(bin as u16);
            writeln!(
                f,
                "{:>9} {:>11}   {a}, {b}, {c}",
                percent(share(object, bin)),
                percent(share(background, bin))
            )?;
        }
        Ok(())
    }

    fn write_separation(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let separation = &self.evidence.separation;
        let (found, mistaken) = (separation.object_found, separation.background_mistaken);
        writeln!(f, "\nSeparation of the target from the background:")?;
        writeln!(
            f,
            "{:>9}   of the target's pixels are found (log odds above 0)",
            percent(found)
        )?;
        writeln!(
            f,
            "{:>9}   of the background is mistaken for it",
            percent(mistaken)
        )?;
        writeln!(
            f,
            "{:>9.4}   area under the curve (1 is perfect, 0.5 is chance)",
            separation.area_under_curve
        )?;
        writeln!(
            f,
            "{:>9.4}   Bhattacharyya similarity to the background (0: no shared colours, 1: identical)",
            separation.similarity
        )?;
        match Verdict::of(found, mistaken) {
            Verdict::Good if self.check.failures() > 0 => writeln!(
                f,
                "Fair: the target stands out by its colours, but is not found in every image; see below."
            ),
            Verdict::Good
                if self.check.label_error().is_some() || self.check.label_shift().is_some() =>
            {
                let labels = if self.follows_outlines {
                    "; its outlines were learnt in place of the labels, which do not follow them"
                } else {
                    ", but the labels do not follow its outline"
                };
                writeln!(
                    f,
                    "Fair: the target stands out by its colours{labels}; see below."
                )
            }
            Verdict::Good => writeln!(
                f,
                "Good: the target stands out from these images by its colours."
            ),
            Verdict::Fair => {
                writeln!(
                    f,
                    "Fair: the target stands out by its colours, but not everywhere."
                )?;
                self.write_shared_bins(f)
            }
            Verdict::Poor => {
                writeln!(f, "Poor: the target hardly stands out by its colours.")?;
                self.write_shared_bins(f)
            }
        }
    }

    /// Lists the shared bins, with advice.
    fn write_shared_bins(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let palette = self.model.palette();
        let (object, background) = self.evidence.counts();
        let both = |bin: usize| share(object, bin).min(share(background, bin));
        let mut bins: Vec<usize> = (0..object.len())
            .filter(|&bin| both(bin) >= SHARED_PART)
            .collect();
        bins.sort_by(|&a, &b| both(b).total_cmp(&both(a)));
        let names: Vec<String> = bins
            .into_iter()
            .take(MAX_LISTED)
            .map(|bin| {
                let [a, b, c] = palette.channels_of_bin(bin as u16);
                format!("{a}, {b}, {c}")
            })
            .collect();
        if !names.is_empty() {
            let [first, second, third] = palette.channel_names();
            writeln!(
                f,
                "These bins ({first}, {second}, {third}) are shared with the background: {}.",
                names.join("; ")
            )?;
        }
        writeln!(
            f,
            "Remedies: first see in {} whether every label is on the target. Then labels on the outline of the whole target, or boxes closely around it; {}a target in a colour \
             that does not occur in its surroundings.",
            self.mosaic(),
            // Otherwise these were tried.
            if self.adopted.is_none() && self.check.failures() == 0 {
                "finer --bins or another --palette; "
            } else {
                ""
            }
        )
    }

    /// Writes what the detector found in each image, with advice.
    fn write_check(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let balls = self.check.ball_count();
        if balls == 0 {
            return writeln!(
                f,
                "\nNot checked whether the detector finds the target: this is done for balls only, and no label is round and whole. \
                 If it is a ball, label its whole outline with --circle, or draw boxes closely around it with --rect."
            );
        }
        let found = self.check.found();
        writeln!(
            f,
            "\nThe detector finds the ball in {found} of {balls} of these images, with a typical camera:"
        )?;
        let width = self.name_width();
        if let Some(Adopted {
            options,
            found_before,
        }) = self.adopted
        {
            writeln!(
                f,
                "The colours were learnt with {options}: with the default palette, the detector finds the ball in {found_before} of them."
            )?;
        }
        writeln!(
            f,
            "{:width$} {:>22}   {:>22}",
            "", "label: u, v, radius", "found: u, v, radius"
        )?;
        for (image, check) in self.evidence.images.iter().zip(&self.check.images) {
            writeln!(f, "{:width$} {}", image.name, row(check))?;
        }
        self.write_advice(f)
    }

    /// Advises what to do if the ball was not found everywhere, or if labels do not follow its outline.
    fn write_advice(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let balls = self.check.ball_count();
        let says_more = self.remedy.is_some_and(Remedy::changes_labels);
        if let Some(error) = self.check.label_error().filter(|_| !says_more) {
            let size = if error > 0.0 { "large" } else { "small" };
            let percent = 100.0 * error.abs();
            let advice = if self.evidence.images.iter().any(|image| image.has_box) {
                "Draw boxes that touch the ball on all sides, or give the outlines listed above if they are right."
            } else if self.follows_outlines {
                "The outlines listed above were learnt in their place: see whether they are right."
            } else {
                "The edge is learnt where they end, so that distances will be wrong by as much. Give the outlines \
                 listed above if they are right."
            };
            writeln!(
                f,
                "The labels are about {percent:.0} % too {size} for the outlines in the images. {advice}"
            )?;
        }
        if let Some(shift) = self.check.label_shift().filter(|_| !says_more) {
            writeln!(
                f,
                "The labels are beside the ball by about {:.0} % of its radius, so that the background is learnt with it. Give the outlines \
                 listed above if they are right.",
                100.0 * shift
            )?;
        }
        match self.remedy {
            Some(remedy) => writeln!(
                f,
                "{remedy} of {balls}: {}:\n  {}",
                remedy.advice(),
                remedy.command
            ),
            None if self.check.failures() > 0 => writeln!(
                f,
                "{} See in {} whether the labels are on the ball. If they are, learn from images in which the ball is sharp, whole, and in \
                 front of other colours; label all balls in view.",
                if self.adopted.is_some() {
                    "No other palette and no closer labels help further."
                } else {
                    "Neither finer bins nor other palettes nor closer labels help."
                },
                self.mosaic()
            ),
            None => Ok(()),
        }?;
        if self.check.failures() > 0 {
            writeln!(
                f,
                "This is about balls; of a target with another shape it says nothing."
            )?;
        }
        Ok(())
    }

    /// Returns the width of the column of the images' names.
    fn name_width(&self) -> usize {
        let names = self.evidence.images.iter().map(|image| &image.name);
        names.map(|name| name.chars().count()).max().unwrap_or(0)
    }

    fn write_ranges(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(ranges) = self.model.ranges() else {
            return writeln!(
                f,
                "\nThe target has no colour: no range of hue identifies it, and the window cue cannot track it."
            );
        };
        let [found, mistaken] = self.evidence.shares_within(&ranges);
        let ([hue_from, hue_to], [s_from, s_to]) = (ranges.hue_deg, ranges.saturation);
        let [i_from, i_to] = ranges.intensity;
        writeln!(
            f,
            "\nRanges for the window cue: hue {hue_from:.0} to {hue_to:.0} degrees, saturation {s_from:.2} to {s_to:.2}, \
             intensity {i_from:.2} to {i_to:.2}\n{:>9}   of the target's pixels lie in them\n{:>9}   of the background lies in them",
            percent(found),
            percent(mistaken)
        )
    }

    fn write_images(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let images = &self.evidence.images;
        let width = self.name_width();
        writeln!(
            f,
            "\n{:width$} {:>9} {:>9} {:>9} {:>9}",
            "", "pixels", "found", "mistaken", "fit"
        )?;
        let or_none = |share: Option<f64>| share.map_or_else(|| "-".to_owned(), percent);
        for image in images {
            writeln!(
                f,
                "{:width$} {:>9} {:>9} {:>9} {:>9}",
                image.name,
                image.pixels,
                percent(image.found),
                or_none(image.mistaken),
                or_none(image.fit)
            )?;
        }
        writeln!(
            f,
            "fit: the share of the target that the labels of the other images would find"
        )?;
        for image in images.iter().filter(|image| image.is_suspect()) {
            writeln!(
                f,
                "{}: its labelled pixels differ from those of the other images: the label may be beside the target, or blur, surroundings or light differ. \
                 Correct the label, or, if it is right, label another image like this one.",
                image.name
            )?;
        }
        Ok(())
    }
}

/// What the figures mean for a tracker.
#[derive(Debug, PartialEq)]
enum Verdict {
    Good,
    Fair,
    Poor,
}

impl Verdict {
    fn of(found: f64, mistaken: f64) -> Self {
        if found >= 0.9 && mistaken <= 0.02 {
            Self::Good
        } else if found >= 0.75 && mistaken <= 0.1 {
            Self::Fair
        } else {
            Self::Poor
        }
    }
}

/// Formats what was labelled and found in an image.
fn row(check: &ImageCheck) -> String {
    let ImageCheck::Ball { labels, found, .. } = check else {
        return "  not checked: no label is round and whole".to_owned();
    };
    let label = labels[0];
    let Some(found) = found else {
        return format!("{label}   nothing");
    };
    let remark = match check.label_error() {
        _ if check.failed() => {
            let radii = label.radii_to(&found.circle);
            if radii <= 1.0 {
                format!("   {:.0} % of the radius beside the label", 100.0 * radii)
            } else {
                "   elsewhere".to_owned()
            }
        }
        Some(error) => {
            let size = if error > 0.0 { "large" } else { "small" };
            let percent = 100.0 * error.abs();
            format!("   label {percent:.0} % too {size}{}", better(check))
        }
        None => check.label_shift().map_or_else(String::new, |shift| {
            let percent = 100.0 * shift;
            format!("   label {percent:.0} % of the radius off{}", better(check))
        }),
    };
    format!("{label}   {}{remark}", found.circle)
}

/// Returns the label that follows the outline in the image.
fn better(check: &ImageCheck) -> String {
    let words = |outline: &Circle| {
        let [u, v] = outline.center_px;
        format!(
            "; if that is right, the outline: --circle {u:.1},{v:.1},{:.1}",
            outline.radius_px
        )
    };
    check.outline().map_or_else(String::new, words)
}

fn share(counts: &[u64], bin: usize) -> f64 {
    counts[bin] as f64 / counts.iter().sum::<u64>().max(1) as f64
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Formats `3 images (a.png, b.png, c.png)`, and the number of those that are not listed.
fn images(names: &[&str]) -> String {
    let listed = &names[..names.len().min(MAX_LISTED)];
    let more = match names.len() - listed.len() {
        0 => String::new(),
        rest => format!(" and {rest} more"),
    };
    let count = counted(names.len() as u64, "image");
    format!("{count} ({}{more})", listed.join(", "))
}
