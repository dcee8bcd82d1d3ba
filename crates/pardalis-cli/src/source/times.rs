//! `times.csv`: the times at which the images of a folder were taken and arrived.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use anyhow::Result;
use pardalis::frame::MAX_TIME_S;

use crate::files::Lines;
use crate::output::Shown;
use crate::user_error::user_error;

/// The times of one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ImageTimes {
    /// Its time stamp, in seconds.
    pub(super) time_s: f64,
    /// When it reached the program that recorded it, in seconds; `None` if unknown.
    pub(super) arrival_s: Option<f64>,
}

impl ImageTimes {
    /// Creates times with a time stamp in seconds only.
    pub(super) fn at(time_s: f64) -> Self {
        Self {
            time_s,
            arrival_s: None,
        }
    }
}

/// Reads the columns `frame` (ascending, from 0), `time_s` and, if present, `arrival_s` of a CSV file with a header.
/// Times may decrease. Frames are delivered in order of arrival, or of their numbers without arrivals. Other columns
/// are ignored; equal times mark repeated frames.
pub(super) fn read_times(path: &Path) -> Result<BTreeMap<u64, ImageTimes>> {
    let file = Lines::open(path).map_err(|error| {
        user_error!(
            "{}: cannot be read: {error}; write one with the header frame,time_s, or give fps",
            path.shown()
        )
    })?;
    times_in(path, file)
}

/// Parses what [`read_times`] reads. Errors name `path`.
pub(super) fn times_in(path: &Path, input: impl Read) -> Result<BTreeMap<u64, ImageTimes>> {
    let name = path.shown();
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(input);
    let header = reader
        .headers()
        .map_err(|error| user_error!("{name}: the header cannot be read: {error}"))?;
    let find = |wanted: &str| header.iter().position(|column| column == wanted);
    let column = |wanted: &str| {
        find(wanted).ok_or_else(|| {
            user_error!("{name}, line 1: there is no column {wanted}; the header must be frame,time_s or frame,time_s,arrival_s, with commas between")
        })
    };
    let (frame_column, time_column) = (column("frame")?, column("time_s")?);
    let arrival_column = find("arrival_s");

    let mut times: BTreeMap<u64, ImageTimes> = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|error| match error.kind() {
            csv::ErrorKind::UnequalLengths { pos, expected_len, len } => user_error!(
                "{name}, line {}: {len} values, and the header names {expected_len} columns; times have decimal points, not commas",
                pos.as_ref().map_or(0, csv::Position::line)
            ),
            _ => user_error!("{name}: {error}; write a header and one row for each image"),
        })?;
        let line = record.position().map_or(0, csv::Position::line);
        let field = |column: usize| record.get(column).unwrap_or_default();
        let frame: u64 = field(frame_column).parse().map_err(|_| {
            user_error!(
                "{name}, line {line}: frame is {:?}; it must be a whole number from 0",
                field(frame_column)
            )
        })?;
        let seconds = |what: &str, column: usize| {
            let number = field(column).parse().ok();
            number.filter(|s: &f64| s.abs() <= MAX_TIME_S).ok_or_else(|| {
                user_error!(
                    "{name}, line {line}: {what} is {:?}; it must be a number of seconds, -1e12 to 1e12",
                    field(column)
                )
            })
        };
        let here = ImageTimes {
            time_s: seconds("time_s", time_column)?,
            arrival_s: arrival_column
                .map(|column| seconds("arrival_s", column))
                .transpose()?,
        };
        if let Some((&last_frame, _)) = times.last_key_value() {
            if frame == last_frame {
                return Err(user_error!(
                    "{name}, line {line}: frame {frame} occurs twice; list each frame once"
                ));
            }
            if frame < last_frame {
                return Err(user_error!(
                    "{name}, line {line}: frame {frame} follows frame {last_frame}; frames must ascend"
                ));
            }
        }
        times.insert(frame, here);
    }
    Ok(times)
}
