//! `pardalis report`: a table for people from a record, so that no figure in a README is typed by hand.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::fault::fault;
use crate::files::write_file;
use crate::say::say;
use crate::scene::read_text;

/// Makes a Markdown table of a record
///
/// Prints the median over the seeds of each run, with the lowest and the highest value; lengths in mm, angles in mrad, courses in degrees, pixels to 0.001. A record
/// without seeds (of benchmarks, say) is printed as it is.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis report experiments/record/2026-11-21/jump.csv --columns rmse_m,distance_mean_m
  pardalis report experiments/record/2026-11-21/jump.csv --columns rmse_m --splice README.md
  pardalis report experiments/record/2026-11-21/jump.csv --columns rmse_m --splice README.md --check")]
pub(crate) struct Arguments {
    /// The record
    #[arg(value_name = "RECORD.csv")]
    record: PathBuf,
    /// The figures to show [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAME,NAME")]
    columns: Vec<String>,
    /// Puts tables into this file, wherever lines `<!-- table NAME: COLUMNS -->` and `<!-- end -->` stand, NAME being the record's; the
    /// columns may be left out, and `<!-- table NAME of RUN*: COLUMNS -->` shows only the runs whose names begin so
    #[arg(long, value_name = "FILE.md")]
    splice: Option<PathBuf>,
    /// Changes nothing, but fails where the file's table is another
    #[arg(long, requires = "splice")]
    check: bool,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let record = &arguments.record;
    let Some(path) = &arguments.splice else {
        say(table_of(record, &arguments.columns, "")?.trim_end());
        return Ok(());
    };
    let text = read_text(path)?;
    let name = record.file_stem().unwrap_or_default().to_string_lossy();
    let spliced = splice(&text, &name, |mark| {
        let columns = if mark.columns.is_empty() {
            &arguments.columns
        } else {
            &mark.columns
        };
        table_of(record, columns, mark.runs)
    })?
    .ok_or_else(|| {
        fault!(
            "{}: has no line <!-- table {name} --> followed by a line <!-- end -->",
            path.display()
        )
    })?;
    if arguments.check {
        if spliced == text {
            return Ok(());
        }
        return Err(anyhow::anyhow!(
            "{}: the table {name} is not what the record says; splice it anew",
            path.display()
        ));
    }
    write_file(path, spliced.as_bytes())
}

/// Which table stands at a place of a page.
struct Mark<'t> {
    /// Only runs whose names begin so.
    runs: &'t str,
    /// The figures to show; none: those of the command line.
    columns: Vec<String>,
}

impl<'t> Mark<'t> {
    /// The mark of this record's table that a line is, if it is one.
    fn of(line: &'t str, name: &str) -> Option<Self> {
        let inside = line.strip_prefix("<!-- table ")?.strip_suffix(" -->")?;
        let rest = inside.strip_prefix(name)?;
        let (runs, columns) = match rest.strip_prefix(" of ") {
            Some(rest) => rest.split_once('*')?,
            None => ("", rest),
        };
        let columns = match columns.strip_prefix(':') {
            Some(columns) => columns.split(',').map(|c| c.trim().to_owned()).collect(),
            None if columns.is_empty() => Vec::new(),
            None => return None,
        };
        Some(Self { runs, columns })
    }
}

/// The text with each of the record's tables in its place; none where there is no place.
fn splice(
    text: &str,
    name: &str,
    table: impl Fn(&Mark) -> Result<String>,
) -> Result<Option<String>> {
    let mut spliced = String::new();
    let mut found = false;
    let mut rest = text;
    while let Some((line, after)) = rest.split_once('\n') {
        spliced.push_str(line);
        spliced.push('\n');
        rest = after;
        if let Some(mark) = Mark::of(line, name)
            && let Some(end) = after.find("<!-- end -->")
        {
            let _ = write!(spliced, "\n{}\n", table(&mark)?);
            rest = &after[end..];
            found = true;
        }
    }
    spliced.push_str(rest);
    Ok(found.then_some(spliced))
}

/// The record as a Markdown table of the runs whose names begin with `runs`.
fn table_of(path: &Path, columns: &[String], runs: &str) -> Result<String> {
    let text = read_text(path)?;
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let broken = |error: csv::Error| fault!("{}: {error}", path.display());
    let headers: Vec<String> = reader
        .headers()
        .map_err(broken)?
        .iter()
        .map(str::to_owned)
        .collect();
    let mut rows: Vec<Vec<String>> = reader
        .records()
        .map(|row| Ok(row?.iter().map(str::to_owned).collect()))
        .collect::<Result<_, csv::Error>>()
        .map_err(broken)?;
    if !runs.is_empty() {
        let run = headers.iter().position(|h| h == "run");
        rows.retain(|row| run.is_some_and(|i| row[i].starts_with(runs)));
        if rows.is_empty() {
            return Err(fault!("{}: has no run {runs}*", path.display()));
        }
    }
    // A column of windows says something only where there are any.
    let keys: Vec<usize> = (0..headers.len())
        .filter(|&i| match &*headers[i] {
            "run" | "target" => true,
            "window" => rows.iter().any(|row| !row[i].is_empty()),
            _ => false,
        })
        .collect();
    let seed = headers.iter().position(|h| h == "seed");
    let shown: Vec<usize> = if columns.is_empty() {
        (0..headers.len())
            .filter(|i| {
                !matches!(
                    &*headers[*i],
                    "run" | "target" | "window" | "seed" | "object"
                )
            })
            .collect()
    } else {
        let find = |name: &String| {
            headers.iter().position(|h| h == name).ok_or_else(|| {
                fault!(
                    "--columns: {name} is no column of {}; allowed: {}",
                    path.display(),
                    headers.join(", ")
                )
            })
        };
        columns.iter().map(find).collect::<Result<_>>()?
    };
    let mut groups: Vec<(Vec<&str>, Vec<&Vec<String>>)> = Vec::new();
    for row in &rows {
        let key: Vec<&str> = keys.iter().map(|&i| &*row[i]).collect();
        match groups.iter_mut().find(|(k, _)| seed.is_some() && *k == key) {
            Some((_, members)) => members.push(row),
            None => groups.push((key, vec![row])),
        }
    }
    let mut table = String::from("|");
    for &i in &keys {
        let _ = write!(table, " {} |", headers[i]);
    }
    for &i in &shown {
        let _ = write!(table, " {} |", heading(&headers[i]));
    }
    table.push_str("\n|");
    table.push_str(&"---|".repeat(keys.len()));
    table.push_str(&"---:|".repeat(shown.len()));
    for (key, members) in groups {
        table.push_str("\n|");
        for (part, &i) in key.iter().zip(&keys) {
            let part = match *part {
                "" if headers[i] == "window" => "all frames",
                part => part,
            };
            let _ = write!(table, " {part} |");
        }
        for &i in &shown {
            let _ = write!(
                table,
                " {} |",
                cell(
                    &headers[i],
                    &members.iter().map(|row| &*row[i]).collect::<Vec<_>>()
                )
            );
        }
    }
    table.push('\n');
    Ok(table)
}

/// How figures whose names end so are shown: the unit, and what they are multiplied by.
const UNITS: [(&str, &str, f64); 11] = [
    ("_mps", "mm/s", 1e3),
    ("course_rad", "°", 180.0 / std::f64::consts::PI),
    ("course_error_median_rad", "°", 180.0 / std::f64::consts::PI),
    (
        "heading_error_median_rad",
        "°",
        180.0 / std::f64::consts::PI,
    ),
    ("heading_error_p95_rad", "°", 180.0 / std::f64::consts::PI),
    ("heading_bias_rad", "°", 180.0 / std::f64::consts::PI),
    ("_rad", "mrad", 1e3),
    ("_m", "mm", 1e3),
    ("_us", "µs", 1.0),
    ("_px", "px", 1.0),
    ("_s", "s", 1.0),
];

/// A column's name with the unit that is shown.
fn heading(name: &str) -> String {
    let Some((_, unit, _)) = UNITS.iter().find(|(end, ..)| name.ends_with(end)) else {
        return name.replace('_', " ");
    };
    let words = name.rsplit_once('_').map_or(name, |(words, _)| words);
    format!("{} ({unit})", words.replace('_', " "))
}

/// Figures that are 1 where something is so, and 0 where it is not.
const YES_OR_NO: [&str; 2] = ["ends_on_target", "changed_target"];

/// Median, lowest and highest of a column's values, or the value itself where there is one; of figures that say yes or no, how often they say yes.
fn cell(name: &str, values: &[&str]) -> String {
    let unit = UNITS.iter().find(|(end, ..)| name.ends_with(end));
    let scale = unit.map_or(1.0, |(.., scale)| *scale);
    let mut numbers: Vec<f64> = values
        .iter()
        .filter_map(|v| v.parse().ok())
        .map(|v: f64| v * scale)
        .collect();
    if numbers.len() != values.len() {
        return values.first().copied().unwrap_or_default().to_owned();
    }
    if YES_OR_NO.contains(&name) {
        let yes = numbers.iter().filter(|&&v| v > 0.0).count();
        return format!("{yes} of {}", numbers.len());
    }
    numbers.sort_by(f64::total_cmp);
    let shown = |v: f64| {
        if name.ends_with("_px") {
            format!("{v:.3}")
        } else {
            shown(v)
        }
    };
    let (lowest, highest) = (shown(numbers[0]), shown(numbers[numbers.len() - 1]));
    if lowest == highest {
        lowest
    } else {
        format!("{} ({lowest} to {highest})", shown(median(&numbers)))
    }
}

/// A figure with three digits or so.
pub(super) fn shown(value: f64) -> String {
    let digits = if value.abs() >= 100.0 || value.fract() == 0.0 {
        0
    } else if value.abs() >= 10.0 {
        1
    } else {
        2
    };
    format!("{value:.digits$}")
}

/// The median of at least one number; they are sorted.
pub(super) fn median(sorted: &[f64]) -> f64 {
    f64::midpoint(sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_give_median_and_range_over_seeds() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("jump.csv");
        std::fs::write(&record, "run,seed,target,rmse_m,lost_frames,ends_on_target\na,1,ball,0.3,0,1\na,2,ball,0.35,0,0\na,3,ball,0.31,0,1\nb,1,ball,1,2,0\n").unwrap();
        let table = table_of(&record, &[], "").unwrap();
        let expected = "| run | target | rmse (mm) | lost frames | ends on target |\n|---|---|---:|---:|---:|\n\
                        | a | ball | 310 (300 to 350) | 0 | 2 of 3 |\n| b | ball | 1000 | 2 | 0 of 1 |\n";
        assert_eq!(table, expected);
        assert!(
            table_of(&record, &["rsme_m".to_owned()], "")
                .unwrap_err()
                .to_string()
                .contains("rsme_m")
        );
    }

    #[test]
    fn tables_take_their_places_between_marks() {
        let text = "a\n<!-- table jump -->\nold\n<!-- end -->\nb\n<!-- table jump of near*: rmse_m, max_m -->\n<!-- end -->\n\
                    <!-- table jumps -->\n<!-- end -->\n";
        let table = |mark: &Mark| Ok(format!("| {}/{} |\n", mark.runs, mark.columns.join("+")));
        let spliced = splice(text, "jump", table).unwrap().unwrap();
        assert_eq!(
            spliced,
            "a\n<!-- table jump -->\n\n| / |\n\n<!-- end -->\nb\n<!-- table jump of near*: rmse_m, max_m -->\n\n\
             | near/rmse_m+max_m |\n\n<!-- end -->\n<!-- table jumps -->\n<!-- end -->\n"
        );
        let again = splice(&spliced, "jump", table).unwrap();
        assert_eq!(again, Some(spliced));
        assert_eq!(splice(text, "other", table).unwrap(), None);
    }

    #[test]
    fn runs_are_chosen_by_the_beginning_of_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("jump.csv");
        std::fs::write(
            &record,
            "run,seed,target,window,course_rad\nnear: a,1,ball,,0.1\nfar,1,ball,,2\n",
        )
        .unwrap();
        let table = table_of(&record, &[], "near").unwrap();
        assert_eq!(
            table,
            "| run | target | course (°) |\n|---|---|---:|\n| near: a | ball | 5.73 |\n"
        );
        let error = table_of(&record, &[], "none").unwrap_err().to_string();
        assert!(error.contains("no run none*"), "{error}");
    }
}
