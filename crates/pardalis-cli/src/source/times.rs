//! `times.csv`: the time stamps of a folder of images.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use pardalis::frame::MAX_TIME_S;

use crate::fault::fault;

/// Reads columns `frame` (ascending, from 0) and `time_s` (never running backwards) of a CSV file with a header.
/// Further columns are left alone; equal times are repeated frames.
pub(super) fn read_times(path: &Path) -> Result<BTreeMap<u64, f64>> {
    let name = path.display();
    let text = std::fs::read(path).map_err(|error| {
        fault!(
            "{name}: can not be read: {error}; write one with the header frame,time_s, or give fps"
        )
    })?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_slice());
    let header = reader
        .headers()
        .map_err(|error| fault!("{name}: the header can not be read: {error}"))?;
    let column =
        |wanted: &str| {
            header.iter().position(|column| column == wanted).ok_or_else(|| {
            fault!("{name}, line 1: there is no column {wanted}; the header must be frame,time_s")
        })
        };
    let (frame_column, time_column) = (column("frame")?, column("time_s")?);

    let mut times = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|error| fault!("{name}: {error}"))?;
        let line = record.position().map_or(0, csv::Position::line);
        let field = |column: usize| record.get(column).unwrap_or_default();
        let frame: u64 = field(frame_column).parse().map_err(|_| {
            fault!(
                "{name}, line {line}: frame is {:?}; it must be a whole number from 0",
                field(frame_column)
            )
        })?;
        let time_s = field(time_column)
            .parse()
            .ok()
            .filter(|time_s: &f64| time_s.abs() <= MAX_TIME_S)
            .ok_or_else(|| {
                fault!(
                    "{name}, line {line}: time_s is {:?}; it must be a number of seconds, -1e12 to 1e12",
                    field(time_column)
                )
            })?;
        if let Some((&last_frame, &last_time_s)) = times.last_key_value() {
            if frame == last_frame {
                return Err(fault!(
                    "{name}, line {line}: frame {frame} is given a second time; give each frame once"
                ));
            }
            if frame < last_frame {
                return Err(fault!(
                    "{name}, line {line}: frame {frame} follows frame {last_frame}; frames must ascend"
                ));
            }
            if time_s < last_time_s {
                return Err(fault!(
                    "{name}, line {line}: time_s runs backwards, from {last_time_s} to {time_s}; \
                     it must stay or grow from frame to frame"
                ));
            }
        }
        times.insert(frame, time_s);
    }
    Ok(times)
}
