//! Calibration boards as given by users: on the command line, in TOML files and in Kalibr's YAML files.

use std::path::Path;

use anyhow::Result;
use pardalis_calibrate::board::Board;
use serde::Deserialize;

use crate::scene_files::read_text;
use crate::user_error::user_error;

/// Ways to describe a board.
const ALLOWED: &str = "checkerboard:9x6:0.06 (inner corners, square in metres), \
    charuco:5x7:0.04:0.03:DICT_4X4_50 (squares, square and marker in metres, dictionary), \
    aprilgrid:6x6:0.088:0.3 (tags, tag in metres, gap between tags divided by the side of a tag), \
    or a .toml or Kalibr .yaml file";

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

/// Arguments of [`Board::checkerboard`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckerboardTable {
    columns: usize,
    rows: usize,
    square_m: f64,
}

/// Arguments of [`Board::charuco`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CharucoTable {
    columns: usize,
    rows: usize,
    square_m: f64,
    marker_m: f64,
    dictionary: String,
}

/// Arguments of [`Board::april_grid`].
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

/// Returns the board that a command line argument describes, or the file that it names.
///
/// Error messages name the argument or the file and its key, and state what is allowed.
pub(crate) fn parse_board(argument: &str) -> Result<Board> {
    parse_with(argument, read_text)
}

/// Returns the board that words describe, for a page that may not name files.
#[cfg(feature = "studio")]
pub(crate) fn parse_words(argument: &str) -> Result<Board> {
    let no_file = |_: &Path| {
        Err(user_error!(
            "describe the board in words, such as checkerboard:9x6:0.025"
        ))
    };
    parse_with(argument, no_file)
}

/// Like [`parse_board`]; `read_text` returns the text of the file at a path.
pub(crate) fn parse_with(
    argument: &str,
    read_text: impl Fn(&Path) -> Result<String>,
) -> Result<Board> {
    let path = Path::new(argument);
    let file = match path.extension().and_then(|extension| extension.to_str()) {
        Some("toml") => from_toml(argument, &read_text(path)?)?,
        Some("yaml" | "yml") => from_kalibr(argument, &read_text(path)?)?,
        _ => from_words(argument)
            .ok_or_else(|| user_error!("{argument}: is not a board; allowed: {ALLOWED}"))?,
    };
    let board = match file {
        BoardFile::Checkerboard(t) => Board::checkerboard(t.columns, t.rows, t.square_m),
        BoardFile::Charuco(t) => {
            Board::charuco(t.columns, t.rows, t.square_m, t.marker_m, &t.dictionary)
        }
        BoardFile::AprilGrid(t) => Board::april_grid(t.columns, t.rows, t.tag_m, t.spacing),
    };
    board.map_err(|error| user_error!("{argument}: {error}"))
}

/// Reads a board from words separated by colons.
fn from_words(argument: &str) -> Option<BoardFile> {
    let words: Vec<&str> = argument.split(':').collect();
    let counts = |word: &str| -> Option<(usize, usize)> {
        let (columns, rows) = word.split_once('x')?;
        Some((columns.parse().ok()?, rows.parse().ok()?))
    };
    let number = |word: &str| word.parse::<f64>().ok();
    Some(match words[..] {
        ["checkerboard", size, square] => {
            let (columns, rows) = counts(size)?;
            BoardFile::Checkerboard(CheckerboardTable {
                columns,
                rows,
                square_m: number(square)?,
            })
        }
        ["charuco", size, square, marker, dictionary] => {
            let (columns, rows) = counts(size)?;
            BoardFile::Charuco(CharucoTable {
                columns,
                rows,
                square_m: number(square)?,
                marker_m: number(marker)?,
                dictionary: dictionary.into(),
            })
        }
        ["aprilgrid", size, tag, spacing] => {
            let (columns, rows) = counts(size)?;
            BoardFile::AprilGrid(AprilGridTable {
                columns,
                rows,
                tag_m: number(tag)?,
                spacing: number(spacing)?,
            })
        }
        _ => return None,
    })
}

/// Reads a board file in TOML.
fn from_toml(name: &str, text: &str) -> Result<BoardFile> {
    toml::from_str(text).map_err(|error| {
        user_error!("{name}: is not a board: {error}allowed: a table [checkerboard] with columns, rows and square_m, [charuco] with columns, rows, square_m, marker_m and dictionary, or [aprilgrid] with columns, rows, tag_m and spacing")
    })
}

/// Reads a target file of Kalibr.
fn from_kalibr(name: &str, text: &str) -> Result<BoardFile> {
    let file: KalibrFile = serde_saphyr::from_str(text).map_err(|error| {
        user_error!("{name}: is not a target of Kalibr: {error}; allowed: target_type aprilgrid with tagCols, tagRows, tagSize and tagSpacing, or checkerboard with targetCols, targetRows, rowSpacingMeters and colSpacingMeters")
    })?;
    Ok(match file {
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
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(argument: &str) -> Board {
        parse_board(argument).unwrap()
    }

    #[test]
    fn reads_boards_from_words_and_files() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path.to_str().unwrap().to_owned()
        };
        let checkerboard = write(
            "a.toml",
            "[checkerboard]\ncolumns = 9\nrows = 6\nsquare_m = 0.06\n",
        );
        assert_eq!(board(&checkerboard), board("checkerboard:9x6:0.06"));
        let charuco = "[charuco]\ncolumns = 5\nrows = 7\nsquare_m = 0.04\nmarker_m = 0.03\ndictionary = \"DICT_4X4_50\"\n";
        let charuco = board(&write("b.toml", charuco));
        assert_eq!(charuco, board("charuco:5x7:0.04:0.03:DICT_4X4_50"));
        let grid = "[aprilgrid]\ncolumns = 6\nrows = 6\ntag_m = 0.088\nspacing = 0.3\n";
        assert_eq!(
            board(&write("c.toml", grid)),
            board("aprilgrid:6x6:0.088:0.3")
        );
        let kalibr = "target_type: 'aprilgrid' #gridtype\ntagCols: 6 #tags\ntagRows: 6\ntagSize: 0.088\ntagSpacing: 0.3\n";
        assert_eq!(
            board(&write("d.yaml", kalibr)),
            board("aprilgrid:6x6:0.088:0.3")
        );
        let kalibr = "target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\ncolSpacingMeters: 0.06\n";
        assert_eq!(
            board(&write("e.yaml", kalibr)),
            board("checkerboard:6x7:0.06")
        );

        for (text, named) in [
            ("checkerboard:9x6", "checkerboard:9x6:0.06"),
            ("checkerboard:2x6:0.06", "columns is 2"),
            ("checkerboard:9x6:nan", "square_m is NaN"),
            ("charuco:5x7:0.04:0.04:DICT_4X4_50", "marker_m is 0.04"),
            ("charuco:5x7:0.04:0.03:DICT_3X3_5", "DICT_4X4_50"),
            ("charuco:50x7:0.04:0.03:DICT_4X4_50", "a larger dictionary"),
            ("aprilgrid:6x6:0.088:30", "spacing is 30"),
            ("missing.toml", "missing.toml"),
            (
                write(
                    "f.toml",
                    "[checkerboard]\ncolumns = 9\nrows = 6\nsquare = 1\n",
                )
                .as_str(),
                "square",
            ),
            (
                write("g.yaml", "target_type: 'circlegrid'\n").as_str(),
                "g.yaml",
            ),
            (
                write(
                    "h.yaml",
                    kalibr
                        .replace("colSpacingMeters: 0.06", "colSpacingMeters: 0.05")
                        .as_str(),
                )
                .as_str(),
                "both the same",
            ),
        ] {
            let error = parse_board(text).unwrap_err();
            assert!(error.is::<crate::user_error::UserError>(), "{text}");
            let message = format!("{error:#}");
            assert!(
                message.contains(named) && message.contains(text),
                "{text}: {message}"
            );
        }
    }
}
