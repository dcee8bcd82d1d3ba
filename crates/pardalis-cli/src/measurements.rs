//! What other sensors measure of a scene's targets, read from files and told to the tracker as time passes.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::tracker::{Measurement, MeasurementCounts};
use pardalis::{TargetId, Tracker};
use pardalis_core::Error;
use pardalis_scene::{BodyConfig, TargetConfig};
use serde_json::{Value, json};

use crate::numbers::counted;
use crate::output::Shown;
use crate::source::TimeSpan;
use crate::tables::{COVARIANCE, Column, Row, Table, VELOCITY_COVARIANCE};
use crate::user_error::user_error;

/// The columns of a file; each group may be left out.
const COLUMNS: &str = "time_s and x_m,y_m,z_m,sigma_m (or xx_m2 to zz_m2), vx_mps,vy_mps,vz_mps,velocity_sigma_mps (or vxx_m2ps2 to vzz_m2ps2), from_x_m,from_y_m,from_z_m with range_m,range_sigma_m or direction_x,direction_y,direction_z,direction_sigma_rad";

/// A run of which more than this share of the measurements are outliers has a warning.
const MANY_REJECTED: f64 = 0.1;

/// What other sensors measure of one target of a scene.
#[derive(Debug)]
pub(crate) struct MeasurementRows {
    target: TargetId,
    name: String,
    path: PathBuf,
    /// In the order of time.
    rows: Vec<Measurement>,
    /// The number of rows that were told.
    told: usize,
}

impl MeasurementRows {
    /// Reads the file of the target with this number.
    pub(crate) fn read(path: &Path, number: usize, target: &TargetConfig) -> Result<Self> {
        let table = Table::read(path)?;
        let mut rows = rows_in(&table)?;
        let has_velocity = target.bodies.iter().all(BodyConfig::has_velocity);
        let of_velocity = rows.iter().find(|(row, _)| row.is_of_velocity());
        if let Some((_, line)) = of_velocity.filter(|_| !has_velocity) {
            return Err(user_error!(
                "{}, line {line}: is a velocity, and the motion model of the target has none; leave out velocities, or give motion.constant_velocity",
                path.shown()
            ));
        }
        rows.sort_by(|(a, _), (b, _)| a.time_s().total_cmp(&b.time_s()));
        Ok(Self {
            target: TargetId::new(number),
            name: target.name.clone(),
            path: path.to_owned(),
            rows: rows.into_iter().map(|(row, _)| row).collect(),
            told: 0,
        })
    }

    /// Returns what is wrong if all measurements are of before or after these frames.
    pub(crate) fn problem_with(&self, frames: &TimeSpan) -> Option<String> {
        let (first_s, last_s) = (self.rows.first()?.time_s(), self.rows.last()?.time_s());
        let is_apart = last_s < frames.first_s || frames.last_s < first_s;
        is_apart.then(|| {
            format!(
                "{}: covers {first_s} to {last_s} s, and the frames {} to {} s; give times in seconds on the clock of the frames",
                self.path.shown(),
                frames.first_s,
                frames.last_s,
            )
        })
    }

    /// Tells the tracker what was measured up to a time in seconds.
    fn tell(&mut self, tracker: &mut Tracker, time_s: f64) -> Result<()> {
        while let Some(row) = self.rows.get(self.told)
            && row.time_s() <= time_s
        {
            tracker.observe_measurement(self.target, row)?;
            self.told += 1;
        }
        Ok(())
    }

    fn counts(&self, tracker: &Tracker) -> MeasurementCounts {
        // The target is one of the tracker's.
        tracker.measurement_counts(self.target).unwrap_or_default()
    }

    /// Returns warnings about what became of the measurements.
    fn warnings(&self, counts: &MeasurementCounts) -> Vec<String> {
        let place = format!("warning: targets.{}.measurements", self.name);
        let file = self.path.shown();
        let mut warnings = Vec::new();
        let judged = counts.used + counts.rejected;
        if counts.rejected as f64 > MANY_REJECTED * judged as f64 {
            warnings.push(format!(
                "{place}: {} of {} of {file} were rejected as outliers; are they of this target, in the world frame and in metres, and their standard deviations right?",
                counts.rejected,
                counted(judged as u64, "measurement")
            ));
        }
        if counts.late > 0 {
            warnings.push(format!(
                "{place}: too late, and not used: {} of {file}; times are in seconds on the clock of the frames",
                counted(counts.late as u64, "measurement")
            ));
        }
        warnings
    }
}

/// Tells the tracker what other sensors measured up to a time in seconds.
pub(crate) fn tell(all: &mut [MeasurementRows], tracker: &mut Tracker, time_s: f64) -> Result<()> {
    all.iter_mut()
        .try_for_each(|rows| rows.tell(tracker, time_s))
}

/// Returns warnings about what became of measurements, one per line.
pub(crate) fn warnings(all: &[MeasurementRows], tracker: &Tracker) -> Vec<String> {
    let of_target = |rows: &MeasurementRows| rows.warnings(&rows.counts(tracker));
    all.iter().flat_map(of_target).collect()
}

/// Returns the entry of a target in the summary; `None` without measurements.
pub(crate) fn entry(all: &[MeasurementRows], target: TargetId, tracker: &Tracker) -> Option<Value> {
    let rows = all.iter().find(|rows| rows.target == target)?;
    let counts = rows.counts(tracker);
    Some(json!({
        "file": rows.path.to_string_lossy().into_owned(),
        "used": counts.used,
        "rejected": counts.rejected,
        "without_target": counts.without_target,
        "late": counts.late,
    }))
}

/// The coordinates of a vector, of which some may be missing, and its covariance (xx, xy, xz, yy, yz, zz).
type Vector = ([Option<f64>; 3], [f64; 6]);

/// The columns of a vector of which coordinates may be missing, with those of its errors.
struct VectorColumns<'n> {
    coordinates: [Option<Column<'n>>; 3],
    sigma: Option<Column<'n>>,
    covariance: Option<[Column<'n>; 6]>,
    /// What the row needs if it has no errors.
    needed: &'static str,
}

impl VectorColumns<'_> {
    /// Reads the coordinates with their covariance; `None` if all cells are empty.
    fn read(&self, row: &Row) -> Result<Option<Vector>> {
        let mut values = [None; 3];
        for (value, column) in values.iter_mut().zip(self.coordinates) {
            *value = row.optional_number(column)?;
        }
        if values == [None; 3] {
            return Ok(None);
        }
        let sigma = row.optional_number(self.sigma)?;
        let covariance = match (sigma, row.all_or_none(self.covariance)?) {
            (Some(_), Some(_)) => {
                return Err(user_error!(
                    "{}: has a standard deviation and a covariance, which may differ; keep one of them",
                    row.place()
                ));
            }
            (Some(sigma), None) => {
                let variance = sigma * sigma;
                [variance, 0.0, 0.0, variance, 0.0, variance]
            }
            (None, Some(covariance)) => covariance,
            (None, None) => {
                return Err(user_error!(
                    "{}: does not say how certain it is; give {}",
                    row.place(),
                    self.needed
                ));
            }
        };
        Ok(Some((values, covariance)))
    }
}

/// Returns the measurements in a table with their lines, in the order of the rows.
pub(crate) fn rows_in(table: &Table) -> Result<Vec<(Measurement, u64)>> {
    let optional = |name| table.optional_column(name);
    let position = VectorColumns {
        coordinates: ["x_m", "y_m", "z_m"].map(optional),
        sigma: optional("sigma_m"),
        covariance: table.optional_columns(COVARIANCE),
        needed: "sigma_m, or xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2",
    };
    let velocity = VectorColumns {
        coordinates: ["vx_mps", "vy_mps", "vz_mps"].map(optional),
        sigma: optional("velocity_sigma_mps"),
        covariance: table.optional_columns(VELOCITY_COVARIANCE),
        needed: "velocity_sigma_mps, or vxx_m2ps2,vxy_m2ps2,vxz_m2ps2,vyy_m2ps2,vyz_m2ps2,vzz_m2ps2",
    };
    let range = optional("range_m");
    let direction = table.optional_columns(["direction_x", "direction_y", "direction_z"]);
    if table
        .header()
        .any(|name| ["ax_mps2", "ay_mps2", "az_mps2"].contains(&name))
    {
        return Err(user_error!(
            "{}, line 1: has accelerations, and targets that are searched for have none in their motion model; leave these columns out",
            table.path().shown()
        ));
    }
    let vectors = position.coordinates.iter().chain(&velocity.coordinates);
    if table.optional_column("time_s").is_none()
        || vectors.flatten().next().is_none() && range.is_none() && direction.is_none()
    {
        return Err(user_error!(
            "{}, line 1: has no times or no measurements; needed: {COLUMNS}; found: {}",
            table.path().shown(),
            table.header().collect::<Vec<_>>().join(",")
        ));
    }
    let time = table.column("time_s")?;
    let from = match (range, direction) {
        (None, None) => None,
        _ => Some(table.columns(["from_x_m", "from_y_m", "from_z_m"])?),
    };
    let range = range.map(|range| Ok::<_, anyhow::Error>([range, table.column("range_sigma_m")?]));
    let range = range.transpose()?;
    let direction = direction
        .map(|[x, y, z]| Ok::<_, anyhow::Error>([x, y, z, table.column("direction_sigma_rad")?]));
    let direction = direction.transpose()?;
    let mut rows = Vec::new();
    // A row may measure nothing, as that of a track without an estimate.
    for row in table.rows() {
        let [time_s] = row.numbers([time])?;
        let mut push = |measurement: Result<Measurement, Error>| -> Result<()> {
            let measurement =
                measurement.map_err(|error| user_error!("{}: {error}", row.place()))?;
            rows.push((measurement, row.line));
            Ok(())
        };
        if let Some((position_m, covariance_m2)) = position.read(&row)? {
            push(Measurement::position(time_s, position_m, covariance_m2))?;
        }
        if let Some((velocity_mps, covariance)) = velocity.read(&row)? {
            push(Measurement::velocity(time_s, velocity_mps, covariance))?;
        }
        let range = row.all_or_none(range)?;
        let direction = row.all_or_none(direction)?;
        if let Some(from) = from.filter(|_| range.is_some() || direction.is_some()) {
            let from_m = row.numbers(from)?;
            if let Some([range_m, sigma_m]) = range {
                push(Measurement::range(time_s, from_m, range_m, sigma_m))?;
            }
            if let Some([x, y, z, sigma_rad]) = direction {
                push(Measurement::bearing(time_s, from_m, [x, y, z], sigma_rad))?;
            }
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<(Measurement, u64)>> {
        rows_in(&Table::from_reader(Path::new("m.csv"), text.as_bytes())?)
    }

    #[test]
    fn each_row_has_what_its_cells_say() {
        let text = "time_s,x_m,y_m,z_m,sigma_m,from_x_m,from_y_m,from_z_m,range_m,range_sigma_m\n\
                    0.5,1,2,,0.1,,,,,\n0.4,,,,,0,0,1,3.2,0.02\n0.6,1,2,3,0.1,0,0,1,3.2,0.02\n0.7,,,,,,,,,\n";
        let found = read(text).unwrap();
        let variance = 0.1 * 0.1;
        let covariance = [variance, 0.0, 0.0, variance, 0.0, variance];
        let range = |time_s| Measurement::range(time_s, [0.0, 0.0, 1.0], 3.2, 0.02).unwrap();
        let place = |time_s, z| {
            Measurement::position(time_s, [Some(1.0), Some(2.0), z], covariance).unwrap()
        };
        let expected = [
            (place(0.5, None), 2),
            (range(0.4), 3),
            (place(0.6, Some(3.0)), 4),
            (range(0.6), 4),
        ];
        assert_eq!(found, expected);
        let text = "time_s,vx_mps,velocity_sigma_mps,from_x_m,from_y_m,from_z_m,direction_x,direction_y,direction_z,direction_sigma_rad\n\
                    1,0.5,0.2,1,2,3,0,1,0,0.05\n";
        let found = read(text).unwrap();
        let bearing = Measurement::bearing(1.0, [1.0, 2.0, 3.0], [0.0, 1.0, 0.0], 0.05).unwrap();
        assert!(found[0].0.is_of_velocity() && found[1] == (bearing, 2));
    }

    #[test]
    fn tracks_of_another_run_are_measurements() {
        let text = "frame,time_s,target,state,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,xx_m2,xy_m2,xz_m2,yy_m2,yz_m2,zz_m2,\
                    vxx_m2ps2,vxy_m2ps2,vxz_m2ps2,vyy_m2ps2,vyz_m2ps2,vzz_m2ps2\n\
                    0,0.1,ball,searching,,,,,,,,,,,,,,,,,,\n\
                    1,0.2,ball,tracking,1,2,3,4,5,6,0.01,0,0,0.02,0,0.03,0.1,0,0,0.2,0.01,0.3\n";
        let found = read(text).unwrap();
        let covariance = [0.01, 0.0, 0.0, 0.02, 0.0, 0.03];
        let place = Measurement::position(0.2, [Some(1.0), Some(2.0), Some(3.0)], covariance);
        let covariance = [0.1, 0.0, 0.0, 0.2, 0.01, 0.3];
        let velocity = Measurement::velocity(0.2, [Some(4.0), Some(5.0), Some(6.0)], covariance);
        assert_eq!(found, [(place.unwrap(), 3), (velocity.unwrap(), 3)]);
    }

    #[test]
    fn errors_name_line_and_remedy() {
        for (text, wanted) in [
            (
                "x_m,sigma_m\n1,0.1\n",
                "line 1: has no times or no measurements; needed: time_s and x_m",
            ),
            (
                "time_s,size\n1,0.1\n",
                "line 1: has no times or no measurements",
            ),
            (
                "time_s,x_m\n1,2\n",
                "line 2: does not say how certain it is; give sigma_m",
            ),
            (
                "time_s,x_m,sigma_m\n1,2,0\n",
                "line 2: the covariance is [0.0",
            ),
            ("time_s,x_m,sigma_m\n1,nan,0.1\n", "line 2"),
            (
                "time_s,x_m,sigma_m,ax_mps2\n1,2,0.1,3\n",
                "line 1: has accelerations",
            ),
            ("time_s,range_m,range_sigma_m\n1,2,0.1\n", "from_x_m"),
            (
                "time_s,from_x_m,from_y_m,from_z_m,range_m\n1,0,0,0,2\n",
                "range_sigma_m",
            ),
            (
                "time_s,from_x_m,from_y_m,from_z_m,range_m,range_sigma_m\n1,0,0,,2,0.1\n",
                "line 2",
            ),
            (
                "time_s,from_x_m,from_y_m,from_z_m,range_m,range_sigma_m\n1,0,0,0,-2,0.1\n",
                "line 2: range_m is -2",
            ),
            (
                "time_s,x_m,vx_mps,velocity_sigma_mps\n1,,5,\n",
                "line 2: does not say how certain it is; give velocity_sigma_mps",
            ),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(
                error.contains(wanted) && error.starts_with("m.csv"),
                "{error}"
            );
        }
    }

    #[test]
    fn many_outliers_are_reported() {
        let rows = MeasurementRows {
            target: TargetId::new(0),
            name: "ball".to_owned(),
            path: PathBuf::from("m.csv"),
            rows: Vec::new(),
            told: 0,
        };
        let counts = |used, rejected, late| MeasurementCounts {
            used,
            rejected,
            late,
            ..Default::default()
        };
        assert!(rows.warnings(&counts(50, 2, 0)).is_empty());
        let warnings = rows.warnings(&counts(5, 45, 1));
        assert!(
            warnings[0].contains("45 of 50 measurements of m.csv were rejected"),
            "{warnings:?}"
        );
        assert!(
            warnings[1].contains("too late, and not used: 1 measurement of m.csv"),
            "{warnings:?}"
        );
    }
}
