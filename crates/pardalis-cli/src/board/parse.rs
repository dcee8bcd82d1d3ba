//! Boards as people write them: on the command line, in TOML files, and in Kalibr's YAML files.

use std::path::Path;

use anyhow::Result;
use serde::Deserialize;

use super::Board;
use super::marker::{self, Dictionary};
use crate::scene::read_text;
use crate::user_error::user_error;

/// What a board is written as.
const SPELLINGS: &str = "checkerboard:9x6:0.06 (inner corners, square in metres), \
    charuco:5x7:0.04:0.03:DICT_4X4_50 (squares, square and marker in metres, dictionary), \
    aprilgrid:6x6:0.088:0.3 (tags, tag in metres, gap between tags by the tag), or a .toml or Kalibr .yaml file";

/// Corners, squares or tags along one side.
const COUNTS: std::ops::RangeInclusive<usize> = 1..=200;

/// The dictionary of an AprilGrid's tags, of Kalibr's own choice.
const TAG36H11: &str = "DICT_APRILTAG_36h11";

/// A board file in TOML: one table, named after the kind of board.
#[derive(Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
enum BoardFile {
    /// Inner corners in a row and in a column.
    Checkerboard(CheckerboardTable),
    /// Squares in a row and in a column.
    Charuco(CharucoTable),
    /// Tags in a row and in a column.
    AprilGrid(AprilGridTable),
}

/// See [`Board::Checkerboard`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckerboardTable {
    columns: usize,
    rows: usize,
    square_m: f64,
}

/// See [`Board::Charuco`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CharucoTable {
    columns: usize,
    rows: usize,
    square_m: f64,
    marker_m: f64,
    dictionary: String,
}

/// See [`Board::AprilGrid`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AprilGridTable {
    columns: usize,
    rows: usize,
    tag_m: f64,
    spacing: f64,
}

/// A target file of Kalibr.
#[derive(Deserialize)]
#[serde(tag = "target_type", rename_all = "lowercase")]
enum KalibrFile {
    #[serde(rename_all = "camelCase")]
    Checkerboard {
        target_cols: usize,
        target_rows: usize,
        row_spacing_meters: f64,
        col_spacing_meters: f64,
    },
    #[serde(rename_all = "camelCase")]
    AprilGrid {
        tag_cols: usize,
        tag_rows: usize,
        tag_size: f64,
        tag_spacing: f64,
    },
}

impl Board {
    /// The board that an argument of the command line describes, or names the file of.
    ///
    /// # Errors
    ///
    /// A fault that names the argument or the file and its key, and what is allowed.
    pub(crate) fn from_argument(argument: &str) -> Result<Self> {
        let path = Path::new(argument);
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("toml") => Self::from_toml(argument, &read_text(path)?),
            Some("yaml" | "yml") => Self::from_kalibr(argument, &read_text(path)?),
            _ => Self::from_words(argument),
        }
    }

    /// Reads a board of words that colons separate.
    fn from_words(argument: &str) -> Result<Self> {
        let unread = || user_error!("{argument}: is no board; allowed: {SPELLINGS}");
        let words: Vec<&str> = argument.split(':').collect();
        let counts = |word: &str| -> Option<(usize, usize)> {
            let (columns, rows) = word.split_once('x')?;
            Some((columns.parse().ok()?, rows.parse().ok()?))
        };
        let number = |word: &str| word.parse::<f64>().ok();
        let table = match words[..] {
            ["checkerboard", size, square] => {
                counts(size)
                    .zip(number(square))
                    .map(|((columns, rows), square_m)| {
                        BoardFile::Checkerboard(CheckerboardTable {
                            columns,
                            rows,
                            square_m,
                        })
                    })
            }
            ["charuco", size, square, marker, dictionary] => counts(size)
                .zip(number(square).zip(number(marker)))
                .map(|((columns, rows), (square_m, marker_m))| {
                    BoardFile::Charuco(CharucoTable {
                        columns,
                        rows,
                        square_m,
                        marker_m,
                        dictionary: dictionary.into(),
                    })
                }),
            ["aprilgrid", size, tag, spacing] => counts(size)
                .zip(number(tag).zip(number(spacing)))
                .map(|((columns, rows), (tag_m, spacing))| {
                    BoardFile::AprilGrid(AprilGridTable {
                        columns,
                        rows,
                        tag_m,
                        spacing,
                    })
                }),
            _ => None,
        };
        Self::checked(argument, table.ok_or_else(unread)?)
    }

    /// Reads a board file in TOML.
    fn from_toml(name: &str, text: &str) -> Result<Self> {
        let table: BoardFile = toml::from_str(text).map_err(|error| {
            user_error!("{name}: is no board: {error}allowed: a table [checkerboard] with columns, rows and square_m, [charuco] with columns, rows, square_m, marker_m and dictionary, or [aprilgrid] with columns, rows, tag_m and spacing")
        })?;
        Self::checked(name, table)
    }

    /// Reads a target file of Kalibr.
    fn from_kalibr(name: &str, text: &str) -> Result<Self> {
        let file: KalibrFile = serde_saphyr::from_str(text).map_err(|error| {
            user_error!("{name}: is no target of Kalibr: {error}; allowed: target_type aprilgrid with tagCols, tagRows, tagSize and tagSpacing, or checkerboard with targetCols, targetRows, rowSpacingMeters and colSpacingMeters")
        })?;
        let table = match file {
            KalibrFile::Checkerboard {
                row_spacing_meters,
                col_spacing_meters,
                ..
            } if row_spacing_meters != col_spacing_meters => {
                return Err(user_error!(
                    "{name}: rowSpacingMeters is {row_spacing_meters}, colSpacingMeters {col_spacing_meters}; allowed: squares, with both the same"
                ));
            }
            KalibrFile::Checkerboard {
                target_cols,
                target_rows,
                row_spacing_meters,
                ..
            } => BoardFile::Checkerboard(CheckerboardTable {
                columns: target_cols,
                rows: target_rows,
                square_m: row_spacing_meters,
            }),
            KalibrFile::AprilGrid {
                tag_cols,
                tag_rows,
                tag_size,
                tag_spacing,
            } => BoardFile::AprilGrid(AprilGridTable {
                columns: tag_cols,
                rows: tag_rows,
                tag_m: tag_size,
                spacing: tag_spacing,
            }),
        };
        Self::checked(name, table)
    }

    /// A board of sensible values.
    fn checked(name: &str, table: BoardFile) -> Result<Self> {
        let count = |what: &str, value: usize, least: usize| {
            if value < least || !COUNTS.contains(&value) {
                return Err(user_error!(
                    "{name}: {what} is {value}; allowed: {least} to {}",
                    COUNTS.end()
                ));
            }
            Ok(value)
        };
        let positive = |what: &str, value: f64| {
            if value > 0.0 && value.is_finite() {
                return Ok(value);
            }
            Err(user_error!("{name}: {what} is {value}; allowed: above 0"))
        };
        Ok(match table {
            BoardFile::Checkerboard(t) => Board::Checkerboard {
                columns: count("columns", t.columns, 3)?,
                rows: count("rows", t.rows, 3)?,
                square_m: positive("square_m", t.square_m)?,
            },
            BoardFile::Charuco(t) => {
                let (columns, rows) = (count("columns", t.columns, 3)?, count("rows", t.rows, 3)?);
                let dictionary = Dictionary::named(&t.dictionary).ok_or_else(|| {
                    let names: Vec<&str> = marker::names().collect();
                    user_error!(
                        "{name}: dictionary {} is not known; allowed: {}",
                        t.dictionary,
                        names.join(", ")
                    )
                })?;
                let needed = (columns * rows).div_ceil(2);
                if needed > dictionary.len() {
                    return Err(user_error!(
                        "{name}: {columns} x {rows} squares need {needed} markers, but {} has {}; allowed: a larger dictionary",
                        dictionary.name,
                        dictionary.len()
                    ));
                }
                let square_m = positive("square_m", t.square_m)?;
                if !(t.marker_m > 0.0 && t.marker_m < square_m) {
                    return Err(user_error!(
                        "{name}: marker_m is {}; allowed: above 0 and below square_m, which is {square_m}",
                        t.marker_m
                    ));
                }
                Board::Charuco {
                    columns,
                    rows,
                    square_m,
                    marker_m: t.marker_m,
                    dictionary,
                }
            }
            BoardFile::AprilGrid(t) => {
                let (columns, rows) = (count("columns", t.columns, 1)?, count("rows", t.rows, 1)?);
                let Some(dictionary) = Dictionary::named(TAG36H11) else {
                    unreachable!("the dictionary file holds {TAG36H11}")
                };
                if columns * rows > dictionary.len() {
                    return Err(user_error!(
                        "{name}: {columns} x {rows} tags; allowed: at most {} tags",
                        dictionary.len()
                    ));
                }
                let spacing = positive("spacing", t.spacing)?;
                if spacing > 1.0 {
                    return Err(user_error!(
                        "{name}: spacing is {spacing}; allowed: above 0, at most 1 (the gap between tags divided by the side of a tag)"
                    ));
                }
                Board::AprilGrid {
                    columns,
                    rows,
                    tag_m: positive("tag_m", t.tag_m)?,
                    spacing,
                    dictionary,
                }
            }
        })
    }
}
