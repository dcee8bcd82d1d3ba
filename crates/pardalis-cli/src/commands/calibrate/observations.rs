//! Table of known points and their pixels.

use std::collections::HashSet;
use std::path::Path;

use anyhow::Result;
use pardalis_calibrate::{CalibrationView, Correspondence};

use crate::output::Shown;
use crate::tables::{Row, Table};
use crate::user_error::user_error;

/// Largest number of wrong rows that are listed.
const MAX_LISTED: usize = 10;

/// Largest plausible coordinate in metres.
const MAX_COORDINATE_M: f64 = 1e6;

/// Observations with the numbers that identify their points.
pub(crate) struct Observations {
    /// Points of each view.
    pub(crate) views: Vec<CalibrationView>,
    /// Numbers of the points of each view.
    pub(crate) numbers: Vec<Vec<usize>>,
    /// Meaning of the numbers: `line` or `corner`.
    pub(super) numbered_by: &'static str,
    /// Number of rows dropped as exact repetitions of others. Counted twice, they would make standard
    /// deviations too small.
    pub(super) repeated: usize,
}

/// Names of a table's columns.
#[derive(Debug, Clone)]
pub(crate) struct Columns([String; 6]);

/// Keys of the columns on the command line.
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
                    "{pair:?} is not a column; allowed: {}, each with = and the name of a column",
                    KEYS.join(", ")
                ));
            };
            name.clone_into(&mut columns.0[place]);
        }
        Ok(columns)
    }
}

/// Reads the points of a table. Points with the same `view` share one pose; without that column all points do.
///
/// Fails if the file cannot be read, lacks a column or has invalid rows, which the message names by line.
pub(super) fn read(path: &Path, columns: &Columns) -> Result<Observations> {
    read_table(&Table::read(path)?, columns)
}

/// Returns the points of a table, like [`read`].
pub(crate) fn read_table(table: &Table, columns: &Columns) -> Result<Observations> {
    let [x, y, z, u, v, view] = &columns.0;
    let point = table.columns([&**x, &**y, &**z])?;
    let pixel = table
        .columns([&**u, &**v])
        .map_err(|error| user_error!("{error:#}; name the columns with --columns u=NAME,v=NAME"))?;
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
        repeated: 0,
    };
    let mut known = HashSet::new();
    let mut problems = Vec::new();
    for row in table.rows() {
        match parse(&row) {
            Ok((name, correspondence)) => {
                if known.insert((name.clone(), bits(&correspondence))) {
                    observations.add(name, row.line as usize, correspondence);
                } else {
                    observations.repeated += 1;
                }
            }
            Err(problem) => problems.push(format!("{problem:#}")),
        }
    }
    if problems.is_empty() {
        return Ok(observations);
    }
    let more = problems.len().saturating_sub(MAX_LISTED);
    problems.truncate(MAX_LISTED);
    if more > 0 {
        problems.push(format!("and {more} more such rows"));
    }
    Err(user_error!("{}", problems.join("\n")))
}

/// Returns a key that is equal for equal points at equal pixels only.
fn bits(correspondence: &Correspondence) -> [u64; 5] {
    let ([x, y, z], [u, v]) = (correspondence.point_m, correspondence.pixel);
    // Adding zero turns -0 into 0.
    [x, y, z, u, v].map(|value| (value + 0.0).to_bits())
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

    /// Fails if coordinates are implausible in metres or pixels lie outside the images; the message names the
    /// lines.
    pub(super) fn check(&self, path: &Path, (width, height): (usize, usize)) -> Result<()> {
        self.refuse_rows(
            path,
            |point| {
                let far = point
                    .point_m
                    .iter()
                    .any(|value| value.abs() > MAX_COORDINATE_M);
                far.then(|| format!("{:?}", point.point_m))
            },
            "points are too far away to be in metres",
            &format!("allowed: coordinates up to {MAX_COORDINATE_M} m"),
        )?;
        self.refuse_rows(
            path,
            |point| {
                let [u, v] = point.pixel;
                let inside =
                    (-1.0..=width as f64).contains(&u) && (-1.0..=height as f64).contains(&v);
                (!inside).then(|| format!("({u:?}, {v:?})"))
            },
            &format!("pixels lie outside images of {width} x {height}"),
            "correct these lines, or give the size of the images in which the points were observed",
        )
    }

    /// Fails if `problem` returns text for any point.
    fn refuse_rows(
        &self,
        path: &Path,
        problem: impl Fn(&Correspondence) -> Option<String>,
        what: &str,
        remedy: &str,
    ) -> Result<()> {
        let points = self.views.iter().flat_map(|view| &view.correspondences);
        let numbered = points.zip(self.numbers.iter().flatten());
        let mut problems: Vec<String> = numbered
            .filter_map(|(point, number)| {
                Some(format!("{} {number} {}", self.numbered_by, problem(point)?))
            })
            .collect();
        let count = problems.len();
        if count == 0 {
            return Ok(());
        }
        if count > MAX_LISTED {
            problems.truncate(MAX_LISTED);
            problems.push("...".to_owned());
        }
        Err(user_error!(
            "{}: {count} of {} {what}: {}; {remedy}",
            path.shown(),
            self.point_count(),
            problems.join(", ")
        ))
    }

    /// Returns the largest extent of all points along an axis, in metres.
    pub(super) fn extent_m(&self) -> f64 {
        let extent = |axis: usize| {
            let points = self.views.iter().flat_map(|view| &view.correspondences);
            let along = points.map(|point| point.point_m[axis]);
            let ends = along.fold([f64::MAX, f64::MIN], |[low, high], value| {
                [low.min(value), high.max(value)]
            });
            ends[1] - ends[0]
        };
        (0..3).map(extent).fold(0.0, f64::max)
    }

    /// Returns the number of points in all views.
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
    fn columns_are_renamed_individually() {
        let columns = Columns::parse("v=b,u=a").unwrap();
        assert_eq!(columns.0, ["x_m", "y_m", "z_m", "a", "b", "view"]);
        for wrong in ["", "u", "w=a", "u="] {
            assert!(Columns::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn rows_of_the_same_view_are_grouped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.csv");
        std::fs::write(
            &path,
            "view,v_px,u_px,x_m,y_m,z_m,id\na,2,1,3,4,5,0\nb,7,6,0,0,0,1\na,9,8,3,4,6,2\na,2,1,3,4,5,3\n",
        )
        .unwrap();
        let read = read(&path, &Columns::default()).unwrap();
        // The last row repeats the first.
        assert_eq!(read.numbers, [vec![2, 4], vec![3]]);
        assert_eq!(read.repeated, 1);
        assert_eq!(read.views[0].correspondences[0].pixel, [1.0, 2.0]);
        assert_eq!(read.views[0].correspondences[1].point_m, [3.0, 4.0, 6.0]);
    }
}
