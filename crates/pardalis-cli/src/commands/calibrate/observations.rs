//! Known points and where they were seen, from a table.

use std::path::Path;

use anyhow::Result;
use pardalis::calibrate::{CalibrationView, Correspondence};

use crate::fault::fault;
use crate::tables::{Row, Table};

/// The most faulty rows that are listed.
const MAX_LISTED: usize = 10;

/// What was seen, and how its points are called.
pub(super) struct Observations {
    /// For each view its points.
    pub(super) views: Vec<CalibrationView>,
    /// For each view the numbers of its points.
    pub(super) numbers: Vec<Vec<usize>>,
    /// What the numbers count: `line` or `corner`.
    pub(super) numbered_by: &'static str,
}

/// The names of a table's columns.
#[derive(Debug, Clone)]
pub(super) struct Columns([String; 6]);

/// What [`Columns`] calls them.
const KEYS: [&str; 6] = ["x", "y", "z", "u", "v", "view"];

impl Default for Columns {
    fn default() -> Self {
        Self(["x_m", "y_m", "z_m", "u_px", "v_px", "view"].map(str::to_owned))
    }
}

impl Columns {
    /// Parses `u=u_noisy_px,v=v_noisy_px`.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let mut columns = Self::default();
        for pair in text.split(',') {
            let place = pair
                .split_once('=')
                .and_then(|(key, name)| Some((KEYS.iter().position(|k| *k == key)?, name)))
                .filter(|(_, name)| !name.is_empty());
            let Some((place, name)) = place else {
                return Err(format!(
                    "{pair:?} is no column; allowed: {}, each with = and a column's name",
                    KEYS.join(", ")
                ));
            };
            name.clone_into(&mut columns.0[place]);
        }
        Ok(columns)
    }
}

/// Reads the points of a table; those with the same `view` share one pose, and without that column all do.
///
/// Faults: the file cannot be read, lacks a column, or has rows that are no points; they are named by line.
pub(super) fn read(path: &Path, columns: &Columns) -> Result<Observations> {
    let [x, y, z, u, v, view] = &columns.0;
    let table = Table::read(path)?;
    let point = table.columns([&**x, &**y, &**z])?;
    let pixel = table.columns([&**u, &**v]).map_err(|error| {
        fault!("{error:#}; say which column is which with --columns u=NAME,v=NAME")
    })?;
    let view = table.optional_column(view);
    let parse = |row: &Row| -> Result<(String, Correspondence)> {
        let name = view
            .map_or(Ok("the table"), |view| row.text(view))?
            .to_owned();
        let (point_m, pixel) = (row.numbers(point)?, row.numbers(pixel)?);
        Ok((name, Correspondence { point_m, pixel }))
    };
    let mut observations = Observations {
        views: Vec::new(),
        numbers: Vec::new(),
        numbered_by: "line",
    };
    let mut faults = Vec::new();
    for row in table.rows() {
        match parse(&row) {
            Ok((name, correspondence)) => observations.add(name, row.line as usize, correspondence),
            Err(fault) => faults.push(format!("{fault:#}")),
        }
    }
    if faults.is_empty() {
        return Ok(observations);
    }
    let more = faults.len().saturating_sub(MAX_LISTED);
    faults.truncate(MAX_LISTED);
    if more > 0 {
        faults.push(format!("and {more} more such rows"));
    }
    Err(fault!("{}", faults.join("\n")))
}

impl Observations {
    fn add(&mut self, name: String, number: usize, correspondence: Correspondence) {
        let known = self.views.iter().position(|view| view.name == name);
        let place = known.unwrap_or_else(|| {
            self.views.push(CalibrationView {
                name,
                correspondences: Vec::new(),
            });
            self.numbers.push(Vec::new());
            self.views.len() - 1
        });
        self.views[place].correspondences.push(correspondence);
        self.numbers[place].push(number);
    }

    /// How many points there are in all views.
    pub(super) fn point_count(&self) -> usize {
        self.views
            .iter()
            .map(|view| view.correspondences.len())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_renamed_one_by_one() {
        let columns = Columns::parse("v=b,u=a").unwrap();
        assert_eq!(columns.0, ["x_m", "y_m", "z_m", "a", "b", "view"]);
        for wrong in ["", "u", "w=a", "u="] {
            assert!(Columns::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn rows_of_the_same_view_are_gathered() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        std::fs::write(
            &path,
            "view,v_px,u_px,x_m,y_m,z_m,id\na,2,1,3,4,5,0\nb,7,6,0,0,0,1\na,9,8,3,4,6,2\n",
        )
        .unwrap();
        let read = read(&path, &Columns::default()).unwrap();
        assert_eq!(read.numbers, [vec![2, 4], vec![3]]);
        assert_eq!(read.views[0].correspondences[0].pixel, [1.0, 2.0]);
        assert_eq!(read.views[0].correspondences[1].point_m, [3.0, 4.0, 6.0]);
    }
}
