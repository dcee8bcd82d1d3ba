//! Tables of experiment records in Markdown pages, so that no figure in a page is typed by hand.
//!
//! A page marks the place of a table with the lines `<!-- table NAME: COLUMN, COLUMN -->` and `<!-- end -->`, where
//! NAME is a record `experiments/record/DATE/NAME.csv`. Without columns the table shows all of them; `<!-- table NAME
//! of RUN*: ... -->` shows only the runs whose names begin with RUN, `<!-- table NAME in WINDOW: ... -->` only the rows
//! of that window, `in all frames` those without one. A cell holds the median over the seeds of a run (in `real-balls`, over the factors of the
//! ball's radius) with the lowest and the highest value.
//! Lengths are in mm, angles in mrad, headings and courses in degrees, pixels and ratios of radii to 0.001.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};

/// Puts the newest record's tables into all pages; with `check`, fails if any is out of date instead.
pub(crate) fn run(root: &Path, check: bool) -> Result<()> {
    let mut count = 0;
    for page in crate::files(root, "md")? {
        let text = fs::read_to_string(&page)?;
        let mut spliced = text.clone();
        for name in names(&text) {
            let record = newest_record(root, name)
                .with_context(|| format!("{}: table {name}", page.display()))?;
            spliced = splice(&spliced, name, |mark| table_of(&record, mark))
                .with_context(|| page.display().to_string())?
                .ok_or_else(|| {
                    anyhow!("{}: table {name} has no line <!-- end -->", page.display())
                })?;
            count += 1;
        }
        if spliced != text {
            if check {
                bail!(
                    "{}: a table is not what its record says; run `cargo xtask tables`",
                    page.display()
                );
            }
            fs::write(&page, spliced)?;
        }
    }
    println!("{count} records are shown as they are");
    Ok(())
}

/// Returns the names of the records whose tables a page holds.
fn names(text: &str) -> BTreeSet<&str> {
    let marks = text
        .lines()
        .filter_map(|line| line.strip_prefix("<!-- table "));
    let is_end = |c: char| !(c.is_ascii_alphanumeric() || c == '-' || c == '_');
    marks
        .map(|mark| &mark[..mark.find(is_end).unwrap_or(mark.len())])
        .collect()
}

/// Returns the newest record of this name.
fn newest_record(root: &Path, name: &str) -> Result<PathBuf> {
    let mut dates: Vec<PathBuf> = fs::read_dir(root.join("experiments/record"))?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<_, std::io::Error>>()?;
    dates.sort();
    let mut records = dates.iter().map(|date| date.join(format!("{name}.csv")));
    records
        .rfind(|record| record.is_file())
        .ok_or_else(|| anyhow!("experiments/record has no {name}.csv"))
}

/// Which table stands at a place of a page.
struct Mark<'t> {
    /// The beginning of the names of the runs to show.
    runs: &'t str,
    /// The window whose rows to show, empty for all frames; `None`: all rows.
    window: Option<&'t str>,
    /// The figures to show; none: all.
    columns: Vec<String>,
}

impl<'t> Mark<'t> {
    /// The mark of this record's table that a line is, if it is one.
    fn of(line: &'t str, name: &str) -> Option<Self> {
        let inside = line.strip_prefix("<!-- table ")?.strip_suffix(" -->")?;
        let rest = inside.strip_prefix(name)?;
        let (window, rest) = match rest.strip_prefix(" in ") {
            Some(rest) => {
                let end = [" of ", ":"].iter().filter_map(|end| rest.find(end)).min();
                let (window, rest) = rest.split_at(end.unwrap_or(rest.len()));
                (Some(if window == "all frames" { "" } else { window }), rest)
            }
            None => (None, rest),
        };
        let (runs, columns) = match rest.strip_prefix(" of ") {
            Some(rest) => rest.split_once('*')?,
            None => ("", rest),
        };
        let columns = match columns.strip_prefix(':') {
            Some(columns) => columns.split(',').map(|c| c.trim().to_owned()).collect(),
            None if columns.is_empty() => Vec::new(),
            None => return None,
        };
        Some(Self {
            runs,
            window,
            columns,
        })
    }
}

/// Returns the text with each of the record's tables inserted at its marker; `None` without markers.
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
fn table_of(path: &Path, mark: &Mark) -> Result<String> {
    let (columns, runs) = (&mark.columns, mark.runs);
    let text = fs::read_to_string(path)?;
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let broken = |error: csv::Error| anyhow!("{}: {error}", path.display());
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
            return Err(anyhow!("{}: has no run {runs}*", path.display()));
        }
    }
    if let Some(name) = mark.window {
        let window = headers.iter().position(|h| h == "window");
        rows.retain(|row| window.map_or(name.is_empty(), |i| row[i] == name));
        if rows.is_empty() {
            return Err(anyhow!("{}: has no window {name}", path.display()));
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
    let is_repeated = headers.iter().any(|h| REPEATS.contains(&&**h));
    let shown: Vec<usize> = if columns.is_empty() {
        (0..headers.len())
            .filter(|i| {
                let name = &*headers[*i];
                !REPEATS.contains(&name) && !["run", "target", "window", "object"].contains(&name)
            })
            .collect()
    } else {
        let find = |name: &String| {
            headers.iter().position(|h| h == name).ok_or_else(|| {
                anyhow!(
                    "{name} is no column of {}; allowed: {}",
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
        match groups.iter_mut().find(|(k, _)| is_repeated && *k == key) {
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

/// What tells the repetitions of a run apart.
const REPEATS: [&str; 2] = ["seed", "radius_factor"];

/// How figures whose names end so are shown: the unit, and what they are multiplied by.
const UNITS: [(&str, &str, f64); 14] = [
    ("_radii", "% of radius", 100.0),
    ("_share", "%", 100.0),
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
    ("_ms", "ms", 1.0),
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

/// Median, lowest and highest of a column's values that are not empty, or the value itself where there is one; of
/// figures that say yes or no, how often they say yes.
fn cell(name: &str, values: &[&str]) -> String {
    let values: Vec<&str> = values.iter().copied().filter(|v| !v.is_empty()).collect();
    let unit = UNITS.iter().find(|(end, ..)| name.ends_with(end));
    let scale = unit.map_or(1.0, |(.., scale)| *scale);
    let mut numbers: Vec<f64> = values
        .iter()
        .filter_map(|v| v.parse().ok())
        .map(|v: f64| v * scale)
        .collect();
    if numbers.is_empty() || numbers.len() != values.len() {
        return values.first().copied().unwrap_or_default().to_owned();
    }
    if YES_OR_NO.contains(&name) {
        let yes = numbers.iter().filter(|&&v| v > 0.0).count();
        return format!("{yes} of {}", numbers.len());
    }
    numbers.sort_by(f64::total_cmp);
    let shown = |v: f64| {
        if name.ends_with("_px") || name.ends_with("radius_ratio") {
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
fn shown(value: f64) -> String {
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
fn median(sorted: &[f64]) -> f64 {
    f64::midpoint(sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All columns of the runs whose names begin so.
    fn all(runs: &str) -> Mark<'_> {
        Mark {
            runs,
            window: None,
            columns: Vec::new(),
        }
    }

    #[test]
    fn pages_show_the_newest_record_or_are_refused() {
        let root = tempfile::tempdir().unwrap();
        let record = |date: &str, values: &str| {
            let folder = root.path().join("experiments/record").join(date);
            fs::create_dir_all(&folder).unwrap();
            let rows = format!("run,seed,target,rmse_m\n{values}");
            fs::write(folder.join("small.csv"), rows).unwrap();
        };
        record(
            "2026-01-02",
            "slow,1,ball,0.3\nslow,2,ball,0.1\nslow,3,ball,0.2\n",
        );
        record("2026-01-01", "slow,1,ball,9\n");
        let page = root.path().join("page.md");
        fs::write(
            &page,
            "Before\n<!-- table small: rmse_m -->\n<!-- end -->\nAfter\n",
        )
        .unwrap();
        assert!(run(root.path(), true).is_err());
        run(root.path(), false).unwrap();
        let text = fs::read_to_string(&page).unwrap();
        assert!(
            text.contains("| slow | ball | 200 (100 to 300) |"),
            "{text}"
        );
        run(root.path(), true).unwrap();
        record("2026-01-03", "slow,1,ball,0.25\n");
        assert!(run(root.path(), true).is_err());
        fs::write(&page, "<!-- table none -->\n<!-- end -->\n").unwrap();
        let error = format!("{:#}", run(root.path(), false).unwrap_err());
        assert!(error.contains("none.csv"), "{error}");
    }

    #[test]
    fn tables_give_median_and_range_over_seeds() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("jump.csv");
        std::fs::write(&record, "run,seed,target,rmse_m,lost_frames,ends_on_target\na,1,ball,0.3,0,1\na,2,ball,0.35,0,0\na,3,ball,0.31,0,1\nb,1,ball,1,2,0\n").unwrap();
        let table = table_of(&record, &all("")).unwrap();
        let expected = "| run | target | rmse (mm) | lost frames | ends on target |\n|---|---|---:|---:|---:|\n\
                        | a | ball | 310 (300 to 350) | 0 | 2 of 3 |\n| b | ball | 1000 | 2 | 0 of 1 |\n";
        assert_eq!(table, expected);
        assert!(
            table_of(
                &record,
                &Mark {
                    columns: vec!["rsme_m".to_owned()],
                    ..all("")
                }
            )
            .unwrap_err()
            .to_string()
            .contains("rsme_m")
        );
    }

    #[test]
    fn tables_give_the_range_over_radius_factors_that_were_measured() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("real-balls.csv");
        let rows = "run,radius_factor,on_ball_share,radius_ratio\na,0.25,0.5,0.9\na,1,0.975,\na,4,1,1\nb,,0,\n";
        std::fs::write(&record, rows).unwrap();
        let table = table_of(&record, &all("")).unwrap();
        let expected = "| run | on ball (%) | radius ratio |\n|---|---:|---:|\n\
                        | a | 97.5 (50 to 100) | 0.950 (0.900 to 1.000) |\n| b | 0 |  |\n";
        assert_eq!(table, expected);
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
    fn tables_have_a_row_for_each_window() {
        let folder = tempfile::tempdir().unwrap();
        let record = folder.path().join("small.csv");
        let rows = "run,seed,target,window,estimates\na,1,ball,,3\na,1,ball,at first,2\n";
        fs::write(&record, rows).unwrap();
        let table = table_of(&record, &all("")).unwrap();
        let expected = "| a | ball | all frames | 3 |\n| a | ball | at first | 2 |\n";
        assert!(table.ends_with(expected), "{table}");
        let whole = Mark {
            window: Some(""),
            ..all("")
        };
        let table = table_of(&record, &whole).unwrap();
        assert!(
            table.ends_with("|---|---|---:|\n| a | ball | 3 |\n"),
            "{table}"
        );
        let text = "<!-- table small in at first of a*: estimates -->";
        let first = table_of(&record, &Mark::of(text, "small").unwrap()).unwrap();
        assert!(
            first.ends_with("|---|---|---|---:|\n| a | ball | at first | 2 |\n"),
            "{first}"
        );
        let none = Mark::of("<!-- table small in no: estimates -->", "small").unwrap();
        assert!(table_of(&record, &none).is_err());
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
        let table = table_of(&record, &all("near")).unwrap();
        assert_eq!(
            table,
            "| run | target | course (°) |\n|---|---|---:|\n| near: a | ball | 5.73 |\n"
        );
        let error = table_of(&record, &all("none")).unwrap_err().to_string();
        assert!(error.contains("no run none*"), "{error}");
    }
}
