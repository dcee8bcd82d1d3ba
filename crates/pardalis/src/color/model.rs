//! Colour models: learnt from labelled pixels and stored as small readable files.

use std::fmt::Write as _;

use serde::Deserialize;

use super::body_colors::{BodyColors, BodyText};
use super::box_labels::PixelLabels;
use super::channels::{ChannelHistograms, ChannelsText};
use super::edge_learner::{EdgeLearner, Follows};
use super::edge_profile::{EdgeProfile, EdgeText};
use super::histogram::Histogram;
use super::palette::{Palette, PixelKind, PixelTable};
use super::ranges::{ColorRanges, RangeLearner};
use crate::frame::with_pixels;
use crate::{Frame, PixelFormat};
use pardalis_core::Error;

/// The appearance of a target: the histogram of its pixels in one palette, the ranges that hold them, the
/// histograms of red, green and blue, the edge profile, and the mean colours of its bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorModel {
    palette: Palette,
    histogram: Histogram,
    ranges: Option<ColorRanges>,
    channels: Option<ChannelHistograms>,
    /// One per octave, from the image's own pixels on.
    edges: Vec<EdgeProfile>,
    body: Option<BodyColors>,
    pixel_count: u64,
    image_count: u64,
}

/// The value of `format` in every colour model file.
const FORMAT: &str = "pardalis color model 1";

/// The contents of a colour model file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ColorModelText {
    format: String,
    palette: Palette,
    pixel_count: u64,
    image_count: u64,
    /// Channel indices of a bin and the number of the target's pixels in it.
    bins: Vec<toml::Spanned<[u64; 4]>>,
    /// Absent in older files.
    ranges: Option<ColorRanges>,
    /// Absent in older files.
    channels: Option<ChannelsText>,
    /// Absent in older files.
    edge: Option<EdgeText>,
    #[serde(default)]
    coarser_edges: Vec<toml::Spanned<EdgeText>>,
    /// Absent in older files.
    body: Option<BodyText>,
}

impl ColorModel {
    /// Learns a model from one image, in HSI. `is_target` states for each pixel, row by row, whether it shows
    /// the target. To learn from several images, use [`ColorLearner`].
    ///
    /// # Errors
    ///
    /// The mask has another size or marks no pixel.
    pub fn from_image(frame: &Frame, is_target: &[bool]) -> Result<Self, Error> {
        let mut learner = ColorLearner::new(Palette::HSI)?;
        learner.add(frame, is_target)?;
        learner.learn()
    }

    /// Returns the division of colour space into bins.
    pub fn palette(&self) -> Palette {
        self.palette
    }

    /// Returns the shares of the target's pixels per bin.
    pub fn histogram(&self) -> &Histogram {
        &self.histogram
    }

    /// Returns the narrowest ranges of hue, saturation and intensity that each hold 98 % of the target's
    /// pixels; `None` for older files and for targets without colour.
    pub fn ranges(&self) -> Option<ColorRanges> {
        self.ranges
    }

    /// Returns the histograms of red, green and blue of the target and of the rest of its images; `None` for
    /// older files.
    pub fn channels(&self) -> Option<&ChannelHistograms> {
        self.channels.as_ref()
    }

    /// Returns the profile of the target's colours across its outline in images of full size, of half the size, of a
    /// quarter and on, as far as labelled bodies are large enough there. Empty for older files, and if no body was
    /// labelled whole, along its outline and clear of the image border.
    pub fn edges(&self) -> &[EdgeProfile] {
        &self.edges
    }

    /// Returns the mean colours of whole bodies; `None` for older files, and if no body was labelled whole
    /// and clear of the image border.
    pub fn body(&self) -> Option<&BodyColors> {
        self.body.as_ref()
    }

    /// Returns the number of pixels that the model was learnt from.
    pub fn pixel_count(&self) -> u64 {
        self.pixel_count
    }

    /// Returns the number of images that the model was learnt from.
    pub fn image_count(&self) -> u64 {
        self.image_count
    }

    /// Formats the model as TOML, one line per bin, the most frequent first.
    pub fn to_text(&self) -> String {
        let [first, second, third] = self.palette.channel_names();
        let mut text = format!(
            "# The colours of a target, learnt by `pardalis learn`.\nformat = \"{FORMAT}\"\n\
             pixel_count = {}\nimage_count = {}\n\n# bin indices of {first}, {second} and {third}, and the number of pixels\nbins = [\n",
            self.pixel_count, self.image_count
        );
        let mut rows: Vec<(u64, u16)> = (0..self.palette.bin_count() as u16)
            .map(|bin| (self.count_of(bin), bin))
            .filter(|&(count, _)| count > 0)
            .collect();
        rows.sort_by_key(|&(count, bin)| (u64::MAX - count, bin));
        for (count, bin) in rows {
            let [a, b, c] = self.palette.channels_of_bin(bin);
            let _ = writeln!(text, "    [{a}, {b}, {c}, {count}],");
        }
        text.push_str("]\n\n");
        if let Some(ranges) = self.ranges {
            let [hue, saturation, intensity] =
                [ranges.hue_deg, ranges.saturation, ranges.intensity];
            let _ = writeln!(
                text,
                "# the colours that the window cue counts; hue runs from the first number up to the second, through 0 if the second is less\n\
                 [ranges]\nhue_deg = {hue:?}\nsaturation = {saturation:?}\nintensity = {intensity:?}\n"
            );
        }
        let bins = self.palette.channel_bins();
        let _ = match self.palette {
            Palette::Hsi { .. } => writeln!(
                text,
                "[palette.hsi]\nhue_bins = {}\nsaturation_bins = {}\nintensity_bins = {}",
                bins[0], bins[1], bins[2]
            ),
            Palette::Yuv { encoding, .. } => writeln!(
                text,
                "[palette.yuv]\ny_bins = {}\nu_bins = {}\nv_bins = {}\nmatrix = \"{}\"\nrange = \"{}\"",
                bins[0],
                bins[1],
                bins[2],
                encoding.matrix.name(),
                encoding.range.name()
            ),
            Palette::Rgb { channel_bins } => {
                writeln!(text, "[palette.rgb]\nchannel_bins = {channel_bins}")
            }
        };
        let channels = self.channels.as_ref().map(ChannelHistograms::to_text);
        let edges = EdgeProfile::all_to_text(&self.edges);
        let body = self.body.as_ref().map(BodyColors::to_text);
        text + &channels.unwrap_or_default() + &body.unwrap_or_default() + &edges
    }

    /// Parses the text of a colour model file.
    ///
    /// # Errors
    ///
    /// [`Error::Parse`] with the line, if the text is not TOML, a key is unknown or missing, or a value is
    /// out of range or inconsistent.
    pub fn from_text(text: &str) -> Result<Self, Error> {
        let line_of = |offset: usize| text[..offset.min(text.len())].matches('\n').count() + 1;
        let parsed: ColorModelText = toml::from_str(text).map_err(|e| Error::Parse {
            line: line_of(e.span().map_or(0, |span| span.start)),
            message: e.message().to_owned(),
        })?;
        let at = |line: usize, message: String| Error::Parse { line, message };
        let line_with = |key: &str| {
            text.lines()
                .position(|l| l.starts_with(key))
                .map_or(1, |i| i + 1)
        };
        if parsed.format != FORMAT {
            let message = format!("format is \"{}\"; expected \"{FORMAT}\"", parsed.format);
            return Err(at(line_with("format"), message));
        }
        parsed
            .palette
            .check()
            .map_err(|e| at(line_with("[palette"), e.to_string()))?;
        let mut counts = vec![0_u64; parsed.palette.bin_count()];
        for row in &parsed.bins {
            let line = line_of(row.span().start);
            let [a, b, c, count] = *row.get_ref();
            let channels = [a, b, c].map(|index| u16::try_from(index).unwrap_or(u16::MAX));
            let Some(bin) = parsed.palette.bin_of_channels(channels) else {
                let allowed = parsed.palette.channel_bins();
                let message = format!(
                    "bin {a}, {b}, {c} does not exist; the palette has {allowed:?} bins, counted from 0"
                );
                return Err(at(line, message));
            };
            let slot = &mut counts[usize::from(bin)];
            if *slot > 0 {
                return Err(at(line, format!("bin {a}, {b}, {c} is listed twice")));
            }
            if count == 0 || count > 1 << 40 {
                return Err(at(
                    line,
                    format!("{count} pixels; allowed: 1 to 2^40 (leave out empty bins)"),
                ));
            }
            *slot = count;
        }
        let total: u64 = counts.iter().sum();
        if total != parsed.pixel_count {
            let message = format!(
                "pixel_count is {}, but the bins hold {total} pixels",
                parsed.pixel_count
            );
            return Err(at(line_with("pixel_count"), message));
        }
        if let Some(ranges) = &parsed.ranges {
            ranges
                .check()
                .map_err(|e| at(line_with("[ranges]"), e.to_string()))?;
        }
        let channels = parsed.channels.map(|text| text.read(parsed.pixel_count));
        let channels = channels
            .transpose()
            .map_err(|(offset, message)| at(line_of(offset), message))?;
        let mut edges = Vec::new();
        if let Some(coarser) = parsed
            .coarser_edges
            .first()
            .filter(|_| parsed.edge.is_none())
        {
            let message = "coarser_edges without edge; learn the model again";
            return Err(at(line_of(coarser.span().start), message.to_owned()));
        }
        let coarser = parsed.coarser_edges.iter().map(toml::Spanned::get_ref);
        for text in parsed.edge.iter().chain(coarser) {
            let edge = text.read();
            edges.push(edge.map_err(|(offset, message)| at(line_of(offset), message))?);
        }
        let body = parsed.body.map(|text| text.read()).transpose();
        let body = body.map_err(|(offset, message)| at(line_of(offset), message))?;
        let histogram = Histogram::from_counts(&counts).ok_or_else(|| {
            at(
                line_with("bins"),
                "bins holds no pixels; learn the model again".to_owned(),
            )
        })?;
        Ok(Self {
            palette: parsed.palette,
            histogram,
            ranges: parsed.ranges,
            channels,
            edges,
            body,
            pixel_count: parsed.pixel_count,
            image_count: parsed.image_count,
        })
    }

    /// Returns the number of the target's pixels in a bin.
    pub fn count_of(&self, bin: u16) -> u64 {
        (self.histogram.shares()[usize::from(bin)] * self.pixel_count as f64).round() as u64
    }
}

/// Accumulates the labelled pixels of several images.
#[derive(Debug, Clone)]
pub struct ColorLearner {
    palette: Palette,
    table: Option<(PixelKind, PixelTable)>,
    object_counts: Vec<u64>,
    background_counts: Vec<u64>,
    ranges: RangeLearner,
    channels: ChannelHistograms,
    edge: EdgeLearner,
    image_count: u64,
}

impl ColorLearner {
    /// Creates an empty learner for a palette.
    ///
    /// # Errors
    ///
    /// The bin counts of the palette are out of range.
    pub fn new(palette: Palette) -> Result<Self, Error> {
        palette.check()?;
        let bins = palette.bin_count();
        Ok(Self {
            palette,
            table: None,
            object_counts: vec![0; bins],
            background_counts: vec![0; bins],
            ranges: RangeLearner::new(),
            channels: ChannelHistograms::EMPTY,
            edge: EdgeLearner::default(),
            image_count: 0,
        })
    }

    /// Returns the bin of every pixel of a frame, row by row.
    pub fn bins_of(&mut self, frame: &Frame) -> Vec<u16> {
        let table = table_of(&mut self.table, self.palette, frame);
        let mut bins = Vec::with_capacity(frame.width() * frame.height());
        with_pixels!(frame, components => for y in 0..frame.height() {
            bins.extend((0..frame.width()).map(|x| table.bin(components(x, y))));
        });
        bins
    }

    /// Adds one image. `is_object` marks the pixels that show the target, row by row, one entry per pixel.
    ///
    /// The marked pixels follow the target's outline, or fill a box around it: an upright rectangle, at least 8 pixels wide
    /// and high, whose corners have the colours of its surroundings rather than its own. Of such a box the inscribed
    /// ellipse is taken as the target; the corners count neither as target nor as background, and nothing is learnt about
    /// the edge, because boxes are seldom exact. Rectangles whose corners have
    /// the target's colours are taken as they are. [`Self::target_pixels`] returns the result.
    ///
    /// # Errors
    ///
    /// `is_object` has another length than the image has pixels.
    pub fn add(&mut self, frame: &Frame, is_object: &[bool]) -> Result<(), Error> {
        let labels = self.labels_of(frame, is_object)?;
        let table = table_of(&mut self.table, self.palette, frame);
        let is_rgb = frame.format() == PixelFormat::Rgb8;
        with_pixels!(frame, components => for y in 0..frame.height() {
            for x in 0..frame.width() {
                let index = y * frame.width() + x;
                let object = labels.is_target[index];
                if labels.is_boxed[index] && !object {
                    continue;
                }
                let counts = if object {
                    &mut self.object_counts
                } else {
                    &mut self.background_counts
                };
                let components = components(x, y);
                counts[usize::from(table.bin(components))] += 1;
                let rgb = if is_rgb { components } else { frame.rgb(x, y) };
                self.ranges.add(rgb, object);
                self.channels.add(rgb, object);
            }
        });
        let kind = PixelKind::of(frame);
        for follows in [Follows::Outline, Follows::Box] {
            let labels = labels.of_target(follows == Follows::Box);
            self.edge.add(&labels, frame.width(), follows, |x, y| {
                kind.full_range_yuv(frame.components(x, y))
            });
        }
        self.image_count += 1;
        Ok(())
    }

    /// Returns the pixels, row by row, that [`Self::add`] takes as the target's: those marked, except in the corners of
    /// boxes around bodies.
    ///
    /// # Errors
    ///
    /// As for [`Self::add`].
    pub fn target_pixels(&mut self, frame: &Frame, is_object: &[bool]) -> Result<Vec<bool>, Error> {
        Ok(self.labels_of(frame, is_object)?.is_target)
    }

    fn labels_of(&mut self, frame: &Frame, is_object: &[bool]) -> Result<PixelLabels, Error> {
        let expected = frame.width() * frame.height();
        if is_object.len() != expected {
            return Err(Error::ImageBytes {
                expected,
                found: is_object.len(),
            });
        }
        let table = table_of(&mut self.table, self.palette, frame);
        let bin_at = |x: usize, y: usize| table.bin(frame.components(x, y));
        let bin_count = self.palette.bin_count();
        Ok(PixelLabels::of(
            is_object,
            &bin_at,
            bin_count,
            frame.width(),
        ))
    }

    /// Returns the pixel counts per bin, of the target and of the rest of the images.
    pub fn counts(&self) -> (&[u64], &[u64]) {
        (&self.object_counts, &self.background_counts)
    }

    /// Computes the model from all pixels added so far.
    ///
    /// # Errors
    ///
    /// [`Error::Empty`] if no pixel of the target was added.
    pub fn learn(&self) -> Result<ColorModel, Error> {
        let histogram =
            Histogram::from_counts(&self.object_counts).ok_or_else(|| Error::Empty {
                what: "the set of labelled pixels".to_owned(),
                remedy: "label at least one pixel of the target".to_owned(),
            })?;
        Ok(ColorModel {
            palette: self.palette,
            histogram,
            ranges: self.ranges.ranges(),
            channels: Some(self.channels.clone()),
            edges: self.edge.profiles(),
            body: self.edge.body(),
            pixel_count: self.object_counts.iter().sum(),
            image_count: self.image_count,
        })
    }

    /// Returns the shares of the target's pixels and of the other pixels that lie in the given ranges.
    pub fn shares_within(&self, ranges: &ColorRanges) -> [f64; 2] {
        self.ranges.shares(ranges)
    }

    /// Computes how well the bins separate the target's pixels from the others.
    pub fn separation(&self) -> Separation {
        Separation::of(&self.object_counts, &self.background_counts)
    }
}

/// Returns the table of a palette for the pixels of a frame; the last one is kept.
fn table_of<'t>(
    known: &'t mut Option<(PixelKind, PixelTable)>,
    palette: Palette,
    frame: &Frame,
) -> &'t PixelTable {
    let kind = PixelKind::of(frame);
    let fitting = known.take().filter(|(known, _)| *known == kind);
    let (_, table) =
        known.insert(fitting.unwrap_or_else(|| (kind, PixelTable::new(palette, kind))));
    table
}

/// How well a palette separates a target's pixels from the rest of the images it was learnt from.
#[derive(Debug, Clone, PartialEq)]
pub struct Separation {
    /// Log of the object share over the background share of each bin, with half a pixel added to every bin.
    pub log_odds: Vec<f64>,
    /// Bhattacharyya similarity of the two histograms: 0 if they share no bin.
    pub similarity: f64,
    /// Share of the target's pixels with positive log odds.
    pub object_found: f64,
    /// Share of the other pixels with positive log odds.
    pub background_mistaken: f64,
    /// Probability that a pixel of the target scores above one of the background (area under the ROC curve).
    pub area_under_curve: f64,
}

impl Separation {
    /// Compares the pixel counts of a target with those of the background, in the bins of one palette.
    ///
    /// # Panics
    ///
    /// The two slices differ in length.
    pub fn of(object: &[u64], background: &[u64]) -> Self {
        assert_eq!(object.len(), background.len(), "counts of one palette");
        let total = |counts: &[u64]| counts.iter().sum::<u64>().max(1) as f64;
        let (object_total, background_total) = (total(object), total(background));
        let share =
            |count: u64, total: f64| (count as f64 + 0.5) / (total + 0.5 * object.len() as f64);
        let log_odds: Vec<f64> = object
            .iter()
            .zip(background)
            .map(|(&o, &b)| libm::log(share(o, object_total) / share(b, background_total)))
            .collect();
        let above_zero = |counts: &[u64], total: f64| {
            counts
                .iter()
                .zip(&log_odds)
                .filter(|&(_, &l)| l > 0.0)
                .map(|(&n, _)| n)
                .sum::<u64>() as f64
                / total
        };
        let similarity = object
            .iter()
            .zip(background)
            .map(|(&o, &b)| (o as f64 * b as f64).sqrt())
            .sum::<f64>()
            / (object_total * background_total).sqrt();
        // Bins in ascending order of their log odds; pairs of equal log odds count half.
        let mut order: Vec<usize> = (0..object.len()).collect();
        order.sort_by(|&a, &b| log_odds[a].total_cmp(&log_odds[b]).then(a.cmp(&b)));
        let (mut below, mut area) = (0.0, 0.0);
        for group in order.chunk_by(|&a, &b| log_odds[a] == log_odds[b]) {
            let o = group.iter().map(|&bin| object[bin]).sum::<u64>() as f64;
            let b = group.iter().map(|&bin| background[bin]).sum::<u64>() as f64;
            area += o * (below + b / 2.0);
            below += b;
        }
        Self {
            similarity,
            object_found: above_zero(object, object_total),
            background_mistaken: above_zero(background, background_total),
            area_under_curve: area / (object_total * background_total),
            log_odds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{ChannelBins, YuvEncoding};

    fn two_color_frame() -> (Frame, Vec<bool>) {
        let mut bytes = Vec::new();
        for i in 0..12 {
            bytes.extend_from_slice(if i < 5 {
                &[230, 110, 20]
            } else {
                &[40, 90, 40]
            });
        }
        let frame =
            Frame::new(PixelFormat::Rgb8, YuvEncoding::default(), 4, 3, bytes, 0.0).unwrap();
        (frame, (0..12).map(|i| i < 5).collect())
    }

    #[test]
    fn models_round_trip_through_text() {
        let (frame, labels) = two_color_frame();
        for palette in [Palette::HSI, Palette::YUV, Palette::Rgb { channel_bins: 8 }] {
            let mut learner = ColorLearner::new(palette).unwrap();
            learner.add(&frame, &labels).unwrap();
            let model = learner.learn().unwrap();
            assert_eq!(model.count_of(palette.bin_of_rgb([230.0, 110.0, 20.0])), 5);
            let bins = ChannelBins::new(4).unwrap();
            let [red, _, blue] = model.channels().unwrap().shares(bins);
            assert_eq!(
                (red, blue),
                (vec![0.0, 0.0, 0.0, 1.0], vec![1.0, 0.0, 0.0, 0.0])
            );
            assert_eq!(
                ColorModel::from_text(&model.to_text()),
                Ok(model.clone()),
                "{}",
                model.to_text()
            );
            let text = model.to_text();
            let (older, _) = text.split_once("\n# pixels in each").unwrap();
            assert_eq!(ColorModel::from_text(older).unwrap().channels(), None);
            let separation = learner.separation();
            assert_eq!(
                (
                    separation.object_found,
                    separation.background_mistaken,
                    separation.area_under_curve
                ),
                (1.0, 0.0, 1.0)
            );
            assert_eq!(separation.similarity, 0.0);
        }
    }

    #[test]
    fn invalid_files_are_rejected_with_their_line() {
        let (frame, labels) = two_color_frame();
        let mut learner = ColorLearner::new(Palette::HSI).unwrap();
        learner.add(&frame, &labels).unwrap();
        let text = learner.learn().unwrap().to_text();
        for (from, to, line, word) in [
            ("color model 1", "color model 9", 2, "format"),
            ("hue_bins = 12", "hue_bins = 0", 17, "hue"),
            ("hue_bins = 12", "hue_bins = 12\nhues = 3", 19, "hues"),
            ("hue_deg = [", "hue_deg = [-", 12, "hue_deg"),
            ("saturation = [", "saturation = 0 # [", 13, "array"),
            ("pixel_count = 5", "pixel_count = 6", 3, "pixel_count"),
            (", 5],", ", 5],\n    [1, 200, 3, 5],", 9, "does not exist"),
            (", 5],", ", -5],", 8, "-5"),
            (", 5],", ", nan],", 8, "float"),
            ("\nred = [0, ", "\nred = [", 23, "63 numbers"),
            ("\nred = [0, ", "\nred = [1, ", 23, "6 pixels"),
            ("\ngreen = [0, ", "\ngreen = [-1, ", 24, "-1"),
            (
                "background_blue = [0, ",
                "background_blue = [9, ",
                28,
                "sum to 16 pixels, but background_red gives 7",
            ),
            ("\nblue = ", "\nblues = ", 25, "blues"),
        ] {
            let broken = text.replacen(from, to, 1);
            assert_ne!(broken, text);
            match ColorModel::from_text(&broken) {
                Err(Error::Parse {
                    line: found,
                    message,
                }) => {
                    assert!(message.contains(word), "{message}");
                    assert!(
                        found.abs_diff(line) <= 2,
                        "line {found} for {message}\n{broken}"
                    );
                }
                other => panic!("{other:?} for\n{broken}"),
            }
        }
        for cut in 0..text.len() {
            let _ = ColorModel::from_text(&text[..cut]); // must not panic
        }
    }

    #[test]
    fn learning_without_labelled_pixels_fails() {
        let (frame, _) = two_color_frame();
        let mut learner = ColorLearner::new(Palette::HSI).unwrap();
        learner.add(&frame, &[false; 12]).unwrap();
        assert!(learner.learn().is_err());
        assert!(learner.add(&frame, &[true; 3]).is_err());
    }
}
