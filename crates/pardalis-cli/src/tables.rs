//! CSV tables: `tracks.csv` and `truth.csv`. Every error names file, line and column.

use std::collections::HashMap;
use std::fs::FileType;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::Result;
use csv::{ErrorKind, ReaderBuilder, StringRecord, Trim};
use pardalis::tracker::TrackState;
use pardalis_evaluate::{EstimatedState, TrueState};

use crate::files::Lines;
use crate::output::Shown;
use crate::user_error::user_error;

/// The columns of the covariance of a position.
pub(crate) const COVARIANCE: [&str; 6] = ["xx_m2", "xy_m2", "xz_m2", "yy_m2", "yz_m2", "zz_m2"];

/// The columns of the covariance of a velocity.
pub(crate) const VELOCITY_COVARIANCE: [&str; 6] = [
    "vxx_m2ps2",
    "vxy_m2ps2",
    "vxz_m2ps2",
    "vyy_m2ps2",
    "vyz_m2ps2",
    "vzz_m2ps2",
];

/// The rows of one target or object over time.
#[derive(Debug)]
pub(crate) struct Series<T> {
    /// Name of the target or object.
    pub(crate) name: String,
    /// Times in seconds and their values, in ascending order, each time once.
    pub(crate) rows: Vec<(f64, T)>,
}

/// Returns the times of all rows in seconds, ascending, each once.
pub(crate) fn times_of<T>(all: &[Series<T>]) -> Vec<f64> {
    let rows = all.iter().flat_map(|series| &series.rows);
    let mut times_s: Vec<f64> = rows.map(|(time_s, _)| *time_s).collect();
    times_s.sort_by(f64::total_cmp);
    times_s.dedup();
    times_s
}

/// The row of a track for one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TrackRow {
    /// `None` if the track does not state it.
    pub(crate) state: Option<TrackState>,
    /// `None` while the target is searched for or lost.
    pub(crate) estimate: Option<EstimatedState>,
    /// 0 to 1; `None` if the track does not state it.
    pub(crate) confidence: Option<f64>,
    /// The estimated radius of a ball, in metres; `None` if it was not estimated.
    pub(crate) radius_m: Option<f64>,
}

/// Reads `tracks.csv` and returns the rows of each target, in order of appearance.
///
/// Needs the columns `time_s,target,x_m,y_m,z_m`. States, velocities, headings, covariances, confidences and best
/// particles are optional.
pub(crate) fn read_tracks(path: &Path) -> Result<Vec<Series<TrackRow>>> {
    tracks_of(&Table::read(path)?)
}

/// Returns the rows of the targets in a table, like [`read_tracks`].
pub(crate) fn tracks_of(table: &Table) -> Result<Vec<Series<TrackRow>>> {
    let [time, target] = [table.column("time_s")?, table.column("target")?];
    let state = table.optional_column("state");
    let position = table.columns(["x_m", "y_m", "z_m"])?;
    let best = table.optional_columns(["best_x_m", "best_y_m", "best_z_m"]);
    let velocity = table.optional_columns(["vx_mps", "vy_mps", "vz_mps"]);
    let heading = table.optional_column("heading_rad");
    let covariance = table.optional_columns(COVARIANCE);
    let velocity_covariance = table.optional_columns(VELOCITY_COVARIANCE);
    let confidence = table.optional_column("confidence");
    let radius = table.optional_column("radius_m");
    let mut tracks = Collector::default();
    for row in table.rows() {
        let best_position_m = row.all_or_none(best)?;
        let velocity_mps = row.all_or_none(velocity)?;
        let heading_rad = row.optional_number(heading)?;
        let covariance_m2 = row.all_or_none(covariance)?;
        let velocity_covariance_m2ps2 = row.all_or_none(velocity_covariance)?;
        let estimate = row
            .all_or_none(Some(position))?
            .map(|position_m| EstimatedState {
                position_m,
                best_position_m,
                velocity_mps,
                velocity_covariance_m2ps2,
                heading_rad,
                covariance_m2,
            });
        let found = TrackRow {
            state: row.state(state)?,
            estimate,
            confidence: row.fraction(confidence)?,
            radius_m: row.optional_number(radius)?,
        };
        let (name, time_s) = (row.text(target)?, row.number(time)?);
        if let Some((_, first_line)) = tracks.add(name, time_s, (found, row.line)) {
            return Err(user_error!(
                "{}: target \"{name}\" already has a row for {time_s} s in line {first_line}; \
                 allowed: one row a target and time",
                row.place()
            ));
        }
    }
    Ok(tracks.into_series(|(row, _)| row))
}

/// An object at one time, while `truth.csv` is read.
struct TruthRow {
    state: TrueState,
    /// The cameras whose rows have been merged into `state`.
    cameras: Vec<String>,
    /// The line of the first of these rows.
    line: u64,
}

/// Reads `truth.csv` and returns the rows of each object, in order of appearance.
///
/// Needs the columns `time_s,object,x_m,y_m,z_m`; `camera`, velocities, `heading_rad` and `visible_fraction`
/// are optional. Rows of several cameras are merged into one, with the largest visible fraction.
pub(crate) fn read_truth(path: &Path) -> Result<Vec<Series<TrueState>>> {
    truth_of(&Table::read(path)?)
}

/// Returns the rows of the objects in a table, like [`read_truth`].
pub(crate) fn truth_of(table: &Table) -> Result<Vec<Series<TrueState>>> {
    let [time, object] = [table.column("time_s")?, table.column("object")?];
    let position = table.columns(["x_m", "y_m", "z_m"])?;
    let velocity = table.optional_columns(["vx_mps", "vy_mps", "vz_mps"]);
    let heading = table.optional_column("heading_rad");
    let visible = table.optional_column("visible_fraction");
    let camera = table.optional_column("camera");
    let mut objects = Collector::default();
    for row in table.rows() {
        let visible_fraction = row.fraction(visible)?;
        let state = TrueState {
            position_m: row.numbers(position)?,
            velocity_mps: row.all_or_none(velocity)?,
            heading_rad: row.optional_number(heading)?,
            visible_fraction,
            seeing_cameras: visible_fraction.map(|fraction| usize::from(fraction > 0.5)),
        };
        let camera = camera.map_or("", |column| row.cell(column)).to_owned();
        let (name, time_s) = (row.text(object)?, row.number(time)?);
        let found = TruthRow {
            state,
            cameras: vec![camera.clone()],
            line: row.line,
        };
        let Some(known) = objects.add(name, time_s, found) else {
            continue;
        };
        let (place, line) = (row.place(), known.line);
        if known.cameras.contains(&camera) {
            return Err(user_error!(
                "{place}: object \"{name}\" already has a row for {time_s} s and camera \"{camera}\", \
                 see line {line}; allowed: one row an object, time and camera"
            ));
        }
        let in_world = |s: &TrueState| (s.position_m, s.velocity_mps, s.heading_rad);
        if in_world(&known.state) != in_world(&state) {
            return Err(user_error!(
                "{place}: object \"{name}\" has another position, velocity or heading at {time_s} s than in line {line}; \
                 the world columns must repeat for each camera"
            ));
        }
        known.cameras.push(camera);
        // An unknown fraction compares as less than any known one.
        if known.state.visible_fraction < state.visible_fraction {
            known.state.visible_fraction = state.visible_fraction;
        }
        let seeing = known
            .state
            .seeing_cameras
            .into_iter()
            .chain(state.seeing_cameras);
        known.state.seeing_cameras = seeing.reduce(|a, b| a + b);
    }
    Ok(objects.into_series(|row| row.state))
}

/// Collects rows by name and time.
struct Collector<T> {
    series: Vec<Series<T>>,
    /// Maps a name to its index in `series`, and the bits of a time to its row.
    places: HashMap<String, (usize, HashMap<u64, usize>)>,
}

impl<T> Default for Collector<T> {
    fn default() -> Self {
        Self {
            series: Vec::new(),
            places: HashMap::new(),
        }
    }
}

impl<T> Collector<T> {
    /// Adds a row; returns the existing row if there is one with the same name and time.
    fn add(&mut self, name: &str, time_s: f64, row: T) -> Option<&mut T> {
        if !self.places.contains_key(name) {
            let place = (self.series.len(), HashMap::new());
            self.places.insert(name.to_owned(), place);
            self.series.push(Series {
                name: name.to_owned(),
                rows: Vec::new(),
            });
        }
        let (series, times) = self.places.get_mut(name)?;
        let rows = &mut self.series[*series].rows;
        // Adding zero turns -0 into 0, which is the same time.
        let at = *times.entry((time_s + 0.0).to_bits()).or_insert(rows.len());
        if at < rows.len() {
            return Some(&mut rows[at].1);
        }
        rows.push((time_s, row));
        None
    }

    /// Returns the series in order of appearance, each in ascending order of time.
    fn into_series<U>(self, finish: impl Fn(T) -> U) -> Vec<Series<U>> {
        let in_order = |Series { name, rows }: Series<T>| {
            let finished = rows.into_iter().map(|(time_s, row)| (time_s, finish(row)));
            let mut rows: Vec<(f64, U)> = finished.collect();
            rows.sort_by(|a, b| a.0.total_cmp(&b.0));
            Series { name, rows }
        };
        self.series.into_iter().map(in_order).collect()
    }
}

/// An existing column of the table.
#[derive(Clone, Copy)]
pub(crate) struct Column<'n> {
    name: &'n str,
    index: usize,
}

/// A CSV file with its header, read completely.
pub(crate) struct Table {
    path: PathBuf,
    has_header: bool,
    header: StringRecord,
    records: Vec<StringRecord>,
}

impl Table {
    /// Reads a file with a header and at least one row.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        Self::from_reader(path, open(path)?)
    }

    /// Reads a file with at least one row. If it begins with a number, it has no header, and its columns are the first ones of these.
    pub(crate) fn read_with_or_without_header(path: &Path, columns: &[&str]) -> Result<Self> {
        Self::from_reader_with_or_without_header(path, open(path)?, columns)
    }

    /// Reads a table from `input` like [`Table::read_with_or_without_header`]. Errors name `path`.
    pub(crate) fn from_reader_with_or_without_header(
        path: &Path,
        input: impl Read,
        columns: &[&str],
    ) -> Result<Self> {
        Self::from_reader_of(path, input, Some(columns))
    }

    /// Reads a table from `input`. Errors name `path`.
    pub(crate) fn from_reader(path: &Path, input: impl Read) -> Result<Self> {
        Self::from_reader_of(path, input, None)
    }

    /// Reads a table from `input`, whose columns are the first ones of `columns` if it begins with a number.
    fn from_reader_of(path: &Path, input: impl Read, columns: Option<&[&str]>) -> Result<Self> {
        let failed = |error: csv::Error| csv_error(path, &error);
        let mut reader = ReaderBuilder::new()
            .trim(Trim::All)
            .has_headers(columns.is_none())
            .from_reader(input);
        // The first row, whatever it is.
        let first = reader.headers().map_err(failed)?.clone();
        let is_number = first.get(0).is_some_and(|cell| cell.parse::<f64>().is_ok());
        let without_header = columns.filter(|_| is_number);
        let header = if let Some(columns) = without_header {
            columns_of(path, &first, columns)?
        } else {
            check_header(path, &first)?;
            first
        };
        let records = reader.records();
        // Read as a row before it was known to be the header.
        let repeated = usize::from(columns.is_some() && !is_number);
        let records: Vec<StringRecord> = records
            .skip(repeated)
            .collect::<Result<_, _>>()
            .map_err(failed)?;
        if records.is_empty() {
            return Err(user_error!(
                "{}: has no rows; needed: a header line and at least one row",
                path.shown()
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            has_header: without_header.is_none(),
            header,
            records,
        })
    }

    /// Returns whether the file has a header.
    pub(crate) fn has_header(&self) -> bool {
        self.has_header
    }

    /// Returns the names of the columns.
    pub(crate) fn header(&self) -> impl Iterator<Item = &str> {
        self.header.iter()
    }

    /// Returns the file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns a required column.
    pub(crate) fn column<'n>(&self, name: &'n str) -> Result<Column<'n>> {
        self.optional_column(name).ok_or_else(|| {
            let found: Vec<&str> = self.header.iter().collect();
            user_error!(
                "{}, line 1: column \"{name}\" is missing; found: {}",
                self.path.shown(),
                found.join(",")
            )
        })
    }

    /// Returns required columns.
    pub(crate) fn columns<'n, const N: usize>(
        &self,
        names: [&'n str; N],
    ) -> Result<[Column<'n>; N]> {
        let mut columns = [Column { name: "", index: 0 }; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.column(name)?;
        }
        Ok(columns)
    }

    /// Returns an optional column.
    pub(crate) fn optional_column<'n>(&self, name: &'n str) -> Option<Column<'n>> {
        let index = self.header.iter().position(|found| found == name)?;
        Some(Column { name, index })
    }

    /// Returns optional columns if all of them exist.
    pub(crate) fn optional_columns<'n, const N: usize>(
        &self,
        names: [&'n str; N],
    ) -> Option<[Column<'n>; N]> {
        self.columns(names).ok()
    }

    /// Returns the rows below the header.
    pub(crate) fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.records.iter().map(|record| Row {
            path: &self.path,
            line: record.position().map_or(0, csv::Position::line),
            record,
        })
    }
}

/// One row of a table.
pub(crate) struct Row<'a> {
    path: &'a Path,
    /// Line number in the file.
    pub(crate) line: u64,
    record: &'a StringRecord,
}

impl Row<'_> {
    /// Returns file and line, for error messages.
    pub(crate) fn place(&self) -> String {
        format!("{}, line {}", self.path.shown(), self.line)
    }

    /// Returns the text of a cell; every row has as many cells as the header.
    fn cell(&self, column: Column<'_>) -> &str {
        &self.record[column.index]
    }

    /// Returns a text that is not empty.
    pub(crate) fn text(&self, column: Column<'_>) -> Result<&str> {
        match self.cell(column) {
            "" => Err(self.misfit(column, "a name")),
            text => Ok(text),
        }
    }

    /// Parses a finite number; `None` without the column or if its cell is empty.
    pub(crate) fn optional_number(&self, column: Option<Column<'_>>) -> Result<Option<f64>> {
        let Some(column) = column else {
            return Ok(None);
        };
        let cell = self.cell(column);
        if cell.is_empty() {
            return Ok(None);
        }
        match cell.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Some(number)),
            Err(_) if cell.replacen(',', ".", 1).parse::<f64>().is_ok() => Err(self.misfit(
                column,
                "a number with a decimal point in place of the comma",
            )),
            _ => Err(self.misfit(column, "a finite number")),
        }
    }

    /// Parses a finite number.
    fn number(&self, column: Column<'_>) -> Result<f64> {
        let number = self.optional_number(Some(column))?;
        number.ok_or_else(|| self.misfit(column, "a finite number"))
    }

    /// Parses finite numbers.
    pub(crate) fn numbers<const N: usize>(&self, columns: [Column<'_>; N]) -> Result<[f64; N]> {
        let mut numbers = [0.0; N];
        for (number, column) in numbers.iter_mut().zip(columns) {
            *number = self.number(column)?;
        }
        Ok(numbers)
    }

    /// Parses a whole number from 0.
    pub(crate) fn count(&self, column: Column<'_>) -> Result<usize> {
        let count = self.cell(column).parse();
        count.map_err(|_| self.misfit(column, "a whole number from 0"))
    }

    /// Parses finite numbers; `None` without the columns or if all their cells are empty.
    pub(crate) fn all_or_none<const N: usize>(
        &self,
        columns: Option<[Column<'_>; N]>,
    ) -> Result<Option<[f64; N]>> {
        match columns {
            Some(columns) if columns.iter().any(|&c| !self.cell(c).is_empty()) => {
                self.numbers(columns).map(Some)
            }
            _ => Ok(None),
        }
    }

    /// Parses a share from 0 to 1; `None` without the column or if its cell is empty.
    pub(crate) fn fraction(&self, column: Option<Column<'_>>) -> Result<Option<f64>> {
        match (column, self.optional_number(column)?) {
            (Some(column), Some(share)) if !(0.0..=1.0).contains(&share) => {
                Err(self.misfit(column, "0 to 1"))
            }
            (_, share) => Ok(share),
        }
    }

    /// Parses a track's state; `None` without the column or if its cell is empty.
    pub(crate) fn state(&self, column: Option<Column<'_>>) -> Result<Option<TrackState>> {
        let Some(column) = column.filter(|&c| !self.cell(c).is_empty()) else {
            return Ok(None);
        };
        let cell = self.cell(column);
        let known = TrackState::ALL.into_iter().find(|s| s.name() == cell);
        let misfit = || self.misfit(column, &TrackState::ALL.map(TrackState::name).join(", "));
        known.ok_or_else(misfit).map(Some)
    }

    /// Returns the error of a cell with an invalid value.
    fn misfit(&self, column: Column<'_>, allowed: &str) -> anyhow::Error {
        let (place, cell) = (self.place(), self.cell(column));
        let found = if cell.is_empty() {
            "is empty".to_owned()
        } else {
            format!("holds \"{cell}\"")
        };
        user_error!(
            "{place}, column {}: {found}; allowed: {allowed}",
            column.name
        )
    }
}

/// Fails if a header has a fault.
fn check_header(path: &Path, header: &StringRecord) -> Result<()> {
    let separators = [(';', "semicolons"), ('\t', "tabs")];
    if header.len() == 1
        && let Some((_, name)) = separators.iter().find(|(c, _)| header[0].contains(*c))
    {
        return Err(user_error!(
            "{}, line 1: the columns are separated by {name}; they must be separated by commas, and numbers have a decimal point",
            path.shown()
        ));
    }
    let mut names = header.iter().enumerate();
    let is_second =
        |(i, name): &(usize, &str)| header.iter().take(*i).any(|before| before == *name);
    if let Some((_, twice)) = names.find(is_second) {
        return Err(user_error!(
            "{}, line 1: column \"{twice}\" occurs twice; allowed: each column once",
            path.shown()
        ));
    }
    Ok(())
}

/// Returns the columns of a file without a header, of which this is the first row.
fn columns_of(path: &Path, first: &StringRecord, columns: &[&str]) -> Result<StringRecord> {
    let count = first.len();
    // The shortest such files say where boxes are.
    if !(6..=columns.len()).contains(&count) {
        return Err(user_error!(
            "{}, line 1: has {count} cells; without a header, needed: {}",
            path.shown(),
            columns.join(",")
        ));
    }
    Ok(columns[..count].iter().collect())
}

/// Opens a file that may be read as a table.
fn open(path: &Path) -> Result<impl Read> {
    let unreadable = |error: std::io::Error| csv_error(path, &error.into());
    let kind = std::fs::metadata(path).map_err(unreadable)?.file_type();
    if is_device(kind) {
        return Err(user_error!(
            "{}: is a device, which may have no end; give a CSV file",
            path.shown()
        ));
    }
    Lines::open(path).map_err(unreadable)
}

#[cfg(unix)]
fn is_device(kind: FileType) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    kind.is_char_device() || kind.is_block_device()
}

#[cfg(not(unix))]
fn is_device(_: FileType) -> bool {
    false
}

/// Returns the error of a file that cannot be read as a table.
fn csv_error(path: &Path, error: &csv::Error) -> anyhow::Error {
    let is_folder = path.is_dir();
    let path = path.shown();
    match error.kind() {
        ErrorKind::Io(_) if is_folder => {
            user_error!("{path}: is a folder; give the CSV file in it")
        }
        ErrorKind::Io(error) if error.kind() == std::io::ErrorKind::NotFound => {
            user_error!("{path}: there is no such file; check the name")
        }
        ErrorKind::Io(error) => {
            user_error!("{path}: {error}; give a CSV file")
        }
        ErrorKind::UnequalLengths {
            pos,
            expected_len,
            len,
        } => {
            let hint = if len > expected_len {
                "; numbers are written with a decimal point, not a comma"
            } else {
                ""
            };
            user_error!(
                "{path}, line {}: has {len} cells where the header has {expected_len} columns{hint}",
                pos.as_ref().map_or(0, csv::Position::line)
            )
        }
        ErrorKind::Utf8 { pos, err } => user_error!(
            "{path}, line {}, column {}: is not UTF-8 text; save the file as UTF-8",
            pos.as_ref().map_or(1, csv::Position::line),
            err.field() + 1
        ),
        _ => user_error!("{path}: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads a table from text, using a temporary file with this name.
    fn read<T>(name: &str, text: &str, reader: fn(&Path) -> Result<T>) -> Result<T> {
        let path = std::env::temp_dir().join(format!("pardalis-{}-{name}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        let result = reader(&path);
        std::fs::remove_file(&path).unwrap();
        result
    }

    #[test]
    fn rows_of_several_cameras_are_merged_with_the_best_view() {
        let text = "time_s,object,camera,x_m,y_m,z_m,visible_fraction\n\
                    0.04,ball,cam1,1,2,3,\n0.04,ball,cam2,1,2,3,0.25\n0.04,ball,cam3,1,2,3,0.125\n\
                    0,ball,cam1,4,5,6,\n0,robot,cam1,7,8,9,1\n";
        let objects = read("cameras", text, read_truth).unwrap();
        assert_eq!((&*objects[0].name, &*objects[1].name), ("ball", "robot"));
        let rows = &objects[0].rows;
        assert_eq!((rows[0].0, rows[1].0), (0.0, 0.04));
        assert_eq!(rows[0].1.visible_fraction, None);
        assert_eq!(rows[1].1.visible_fraction, Some(0.25));
        assert_eq!(rows[1].1.position_m, [1.0, 2.0, 3.0]);
        assert_eq!(rows[1].1.velocity_mps, None);
    }

    #[test]
    fn separators_are_named_before_the_rows_are_read() {
        let text = "time_s;target;x_m;y_m;z_m\n0;ball;1,5;2,5;3\n";
        let error = read("separators", text, read_tracks)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("line 1: the columns are separated by semicolons"),
            "{error}"
        );
    }

    #[test]
    fn rows_without_position_have_no_estimate() {
        // With the byte order mark of spreadsheets, spaces, and a different order of columns.
        let text = "\u{feff}target, time_s,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,confidence\r\n\
                    ball, 0,,,,,,,0.25\r\nball, 0.04, 1, 2, 3, 4, 5, 6,\r\n";
        let tracks = read("bare", text, read_tracks).unwrap();
        let [(first_s, first), (_, second)] = tracks[0].rows[..] else {
            panic!("two rows were written")
        };
        assert_eq!(
            (first_s, first.estimate, first.confidence),
            (0.0, None, Some(0.25))
        );
        assert_eq!(second.confidence, None);
        let estimate = second.estimate.unwrap();
        assert_eq!(estimate.position_m, [1.0, 2.0, 3.0]);
        assert_eq!(estimate.velocity_mps, Some([4.0, 5.0, 6.0]));
        assert_eq!(estimate.covariance_m2, None);
    }
}
