//! The rows of a page, as columns.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use anyhow::Result;
use serde::{Serialize, Serializer};

use crate::tables::{Column, Row, Table};

/// The most rows of a page: a few tens of megabytes. Hand-set.
const MAX_ROWS: usize = 200_000;

/// How finely numbers of a column are written. More digits would only make pages larger.
#[derive(Clone, Copy)]
enum Digits {
    All,
    /// To a millionth: micrometres.
    Millionths,
    /// Four of them.
    Four,
}

const COLUMNS: [(&str, Digits); 25] = [
    ("time_s", Digits::All),
    ("frame", Digits::All),
    ("x_m", Digits::Millionths),
    ("y_m", Digits::Millionths),
    ("z_m", Digits::Millionths),
    ("vx_mps", Digits::Millionths),
    ("vy_mps", Digits::Millionths),
    ("vz_mps", Digits::Millionths),
    ("heading_rad", Digits::Millionths),
    ("xx_m2", Digits::Four),
    ("xy_m2", Digits::Four),
    ("xz_m2", Digits::Four),
    ("yy_m2", Digits::Four),
    ("yz_m2", Digits::Four),
    ("zz_m2", Digits::Four),
    ("confidence", Digits::Millionths),
    ("radius_m", Digits::Millionths),
    ("sigma_radius_m", Digits::Millionths),
    ("sigma_heading_rad", Digits::Millionths),
    ("vxx_m2ps2", Digits::Four),
    ("vxy_m2ps2", Digits::Four),
    ("vxz_m2ps2", Digits::Four),
    ("vyy_m2ps2", Digits::Four),
    ("vyz_m2ps2", Digits::Four),
    ("vzz_m2ps2", Digits::Four),
];

impl Digits {
    fn rounded(self, value: f64) -> f64 {
        match self {
            Self::All => value,
            Self::Millionths => {
                let rounded = (value * 1e6).round() / 1e6;
                if rounded.is_finite() { rounded } else { value }
            }
            Self::Four => format!("{value:.3e}").parse().unwrap_or(value),
        }
    }
}

/// The columns of each target, in the order in which targets appear.
#[derive(Default)]
pub(super) struct TrackColumns(Vec<(String, Columns)>);

impl Serialize for TrackColumns {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, columns)| (name, columns)))
    }
}

/// The columns of one target.
struct Columns {
    state: Vec<&'static str>,
    /// In the order of [`COLUMNS`].
    numbers: Vec<Vec<Option<f64>>>,
}

impl Serialize for Columns {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap as _;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("state", &self.state)?;
        for ((name, _), numbers) in COLUMNS.iter().zip(&self.numbers) {
            if numbers.iter().any(Option::is_some) {
                map.serialize_entry(name, &Whole(numbers))?;
            }
        }
        map.end()
    }
}

/// Numbers, of which those without a fraction are written without one.
struct Whole<'a>(&'a [Option<f64>]);

impl Serialize for Whole<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        #[serde(untagged)]
        enum Number {
            Whole(i64),
            Any(f64),
        }
        let number = |value: f64| {
            if value.fract() == 0.0 && value.abs() < 1e15 {
                Number::Whole(value as i64)
            } else {
                Number::Any(value)
            }
        };
        serializer.collect_seq(self.0.iter().map(|value| value.map(number)))
    }
}

/// The rows of a file.
#[derive(Default)]
pub(super) struct ReadTracks {
    pub(super) columns: TrackColumns,
    /// The time in seconds of each frame.
    pub(super) times_s: BTreeMap<usize, f64>,
    /// What is left out.
    pub(super) note: Option<String>,
}

/// Reads rows like those of `tracks.csv`. Needs the columns `time_s,target,x_m,y_m,z_m`.
pub(super) fn read(path: &Path) -> Result<ReadTracks> {
    columns_of(&Table::read(path)?)
}

/// Returns the columns of the targets in a table, like [`read`].
pub(super) fn columns_of(table: &Table) -> Result<ReadTracks> {
    let [target, time] = [table.column("target")?, table.column("time_s")?];
    table.columns(["x_m", "y_m", "z_m"])?;
    let state = table.optional_column("state");
    let frame = table.optional_column("frame");
    let columns = COLUMNS.map(|(name, _)| table.optional_column(name));
    let step = table.rows().count().div_ceil(MAX_ROWS).max(1);
    let mut read = ReadTracks::default();
    let mut places: HashMap<String, usize> = HashMap::new();
    let mut last_s = f64::NAN;
    let mut instants = 0_usize;
    for row in table.rows() {
        let [time_s] = row.numbers([time])?;
        if time_s != last_s {
            instants += 1;
            last_s = time_s;
        }
        if let Some(frame) = frame {
            read.times_s.insert(row.count(frame)?, time_s);
        }
        let name = row.text(target)?;
        if !(instants - 1).is_multiple_of(step) {
            continue;
        }
        let all = &mut read.columns.0;
        let place = *places.entry(name.to_owned()).or_insert_with(|| {
            all.push((name.to_owned(), Columns::default()));
            all.len() - 1
        });
        all[place].1.push(&row, state, &columns)?;
    }
    if step > 1 {
        read.note = Some(format!(
            "The tracks have more rows than a page shows smoothly: it shows one of {step} times."
        ));
    }
    Ok(read)
}

impl Default for Columns {
    fn default() -> Self {
        Self {
            state: Vec::new(),
            numbers: vec![Vec::new(); COLUMNS.len()],
        }
    }
}

impl Columns {
    fn push(&mut self, row: &Row, state: Option<Column>, columns: &[Option<Column>]) -> Result<()> {
        // Tracks of others may not state it.
        let state = row.state(state)?.map_or("tracking", |state| state.name());
        self.state.push(state);
        for ((numbers, column), (_, digits)) in self.numbers.iter_mut().zip(columns).zip(&COLUMNS) {
            let number = row.optional_number(*column)?;
            numbers.push(number.map(|value| digits.rounded(value)));
        }
        Ok(())
    }
}
