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
/// Prints the median over the seeds of each run, with the lowest and the highest value; lengths in mm, angles in mrad, pixels to 0.001. A record
/// without seeds (of benchmarks, say) is printed as it is.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis report experiments/record/2026-11-21/fisheye.csv --columns rmse_m,distance_mean_m
  pardalis report experiments/record/2026-11-21/fisheye.csv --columns rmse_m --splice README.md
  pardalis report experiments/record/2026-11-21/fisheye.csv --columns rmse_m --splice README.md --check")]
pub(crate) struct Arguments {
    /// The record
    #[arg(value_name = "RECORD.csv")]
    record: PathBuf,
    /// The figures to show [default: all]
    #[arg(long, value_delimiter = ',', value_name = "NAME,NAME")]
    columns: Vec<String>,
    /// Puts the table into this file, between the lines `<!-- table NAME -->` and `<!-- end -->`, NAME being the record's
    #[arg(long, value_name = "FILE.md")]
    splice: Option<PathBuf>,
    /// Changes nothing, but fails where the file's table is another
    #[arg(long, requires = "splice")]
    check: bool,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let table = table_of(&arguments.record, &arguments.columns)?;
    let Some(path) = &arguments.splice else {
        say(table.trim_end());
        return Ok(());
    };
    let text = read_text(path)?;
    let name = arguments
        .record
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy();
    let spliced = splice(&text, &name, &table).ok_or_else(|| {
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

/// The text with the table in its place.
fn splice(text: &str, name: &str, table: &str) -> Option<String> {
    let begin = format!("<!-- table {name} -->\n");
    let after_begin = text.find(&begin)? + begin.len();
    let end = after_begin + text[after_begin..].find("<!-- end -->")?;
    Some(format!(
        "{}\n{table}\n{}",
        &text[..after_begin],
        &text[end..]
    ))
}

/// The record as a Markdown table.
fn table_of(path: &Path, columns: &[String]) -> Result<String> {
    let text = read_text(path)?;
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let broken = |error: csv::Error| fault!("{}: {error}", path.display());
    let headers: Vec<String> = reader
        .headers()
        .map_err(broken)?
        .iter()
        .map(str::to_owned)
        .collect();
    let rows: Vec<Vec<String>> = reader
        .records()
        .map(|row| Ok(row?.iter().map(str::to_owned).collect()))
        .collect::<Result<_, csv::Error>>()
        .map_err(broken)?;
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

/// A column's name with the unit that is shown.
fn heading(name: &str) -> String {
    let units = [
        ("_m", " (mm)"),
        ("_rad", " (mrad)"),
        ("_us", " (µs)"),
        ("_px", " (px)"),
        ("_s", " (s)"),
    ];
    let known = units
        .iter()
        .find_map(|(suffix, unit)| Some((name.strip_suffix(suffix)?, *unit)));
    let (words, unit) = known.unwrap_or((name, ""));
    format!("{}{unit}", words.replace('_', " "))
}

/// Median, lowest and highest of a column's values, or the value itself where there is one.
fn cell(name: &str, values: &[&str]) -> String {
    let scale = if name.ends_with("_m") || name.ends_with("_rad") {
        1e3
    } else {
        1.0
    };
    let mut numbers: Vec<f64> = values
        .iter()
        .filter_map(|v| v.parse().ok())
        .map(|v: f64| v * scale)
        .collect();
    if numbers.len() != values.len() {
        return values.first().copied().unwrap_or_default().to_owned();
    }
    numbers.sort_by(f64::total_cmp);
    let shown = |v: f64| {
        let digits = if name.ends_with("_px") {
            3
        } else if v.abs() >= 100.0 || v.fract() == 0.0 {
            0
        } else if v.abs() >= 10.0 {
            1
        } else {
            2
        };
        format!("{v:.digits$}")
    };
    let (lowest, highest) = (shown(numbers[0]), shown(numbers[numbers.len() - 1]));
    if lowest == highest {
        lowest
    } else {
        format!("{} ({lowest} to {highest})", shown(median(&numbers)))
    }
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
        std::fs::write(&record, "run,seed,target,rmse_m,lost_frames\na,1,ball,0.3,0\na,2,ball,0.35,0\na,3,ball,0.31,0\nb,1,ball,1,2\n").unwrap();
        let table = table_of(&record, &[]).unwrap();
        let expected = "| run | target | rmse (mm) | lost frames |\n|---|---|---:|---:|\n\
                        | a | ball | 310 (300 to 350) | 0 |\n| b | ball | 1000 | 2 |\n";
        assert_eq!(table, expected);
        assert!(
            table_of(&record, &["rsme_m".to_owned()])
                .unwrap_err()
                .to_string()
                .contains("rsme_m")
        );
    }

    #[test]
    fn a_table_takes_the_place_between_its_marks() {
        let text = "a\n<!-- table jump -->\nold\n<!-- end -->\nb\n";
        let spliced = splice(text, "jump", "| new |\n").unwrap();
        assert_eq!(
            spliced,
            "a\n<!-- table jump -->\n\n| new |\n\n<!-- end -->\nb\n"
        );
        assert_eq!(splice(&spliced, "jump", "| new |\n").unwrap(), spliced);
        assert!(splice(text, "other", "").is_none());
    }
}
