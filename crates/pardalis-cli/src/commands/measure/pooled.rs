//! Statistics over all recordings of a run or sweep: consistency of covariances and reliability of confidences.

use std::fmt::Write as _;

use pardalis_evaluate::{CheckedConfidence, Reliability, reliability};

use super::plan::Measured;
use super::results::quoted;

/// Half width of the central 99 % of a normal distribution, in standard deviations.
const SIGMAS_99: f64 = 2.576;

/// Returns the reliability of the confidences of runs over all frames, targets and seeds; `None` without confidences.
pub(super) fn reliability_of(runs: &[&Measured]) -> Option<Reliability> {
    let checks = runs.iter().flat_map(|measured| &measured.checks);
    let whole = checks.filter(|checks| checks.window.is_empty());
    let all: Vec<CheckedConfidence> = whole.flat_map(|c| c.checks.iter().copied()).collect();
    reliability(&all)
}

/// Returns one row per run or sweep, target and window: `recordings` (number of distinct recordings), their mean NEES
/// with the 99 % band of that mean from the scatter of recordings, rows with a confidence, the calibration error over
/// them, their largest confidence, and the numbers of frames in which the target is tracked elsewhere and in which a
/// confidence above one half is wrong.
pub(super) fn to_csv(measured: &[Measured]) -> String {
    let mut text = "run,target,window,recordings,mean_nees,nees_99_low,nees_99_high,rows,calibration_error,confidence_max,elsewhere_frames,overconfident_frames\n".to_owned();
    let mut names: Vec<&str> = measured.iter().map(Measured::name).collect();
    names.dedup();
    for name in names {
        let runs: Vec<&Measured> = measured.iter().filter(|m| m.name() == name).collect();
        let mut keys: Vec<(&str, &str)> = Vec::new();
        for checks in runs.iter().flat_map(|m| &m.checks) {
            let key = (&*checks.target, &*checks.window);
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        for (target, window) in keys {
            push_row(&mut text, name, target, window, &runs);
        }
    }
    text
}

fn push_row(text: &mut String, name: &str, target: &str, window: &str, runs: &[&Measured]) {
    let nees: Vec<f64> = runs
        .iter()
        .flat_map(|measured| nees_of_recordings(measured, target, window))
        .collect();
    let checks: Vec<CheckedConfidence> = (runs.iter().flat_map(|m| &m.checks))
        .filter(|c| c.target == target && c.window == window)
        .flat_map(|c| c.checks.iter().copied())
        .collect();
    let mean = mean(&nees);
    let band = mean.zip(half_band_99(&nees));
    let reliability = reliability(&checks);
    let error = reliability.as_ref().map(|r| r.calibration_error);
    let figures = || {
        (runs.iter().flat_map(|m| &m.figures)).filter(|f| f.target == target && f.window == window)
    };
    let sum = |name: &str| figures().filter_map(|f| f.value(name)).reduce(|a, b| a + b);
    let confidence_max = checks.iter().map(|c| c.confidence).reduce(f64::max);
    // Writing to a String cannot fail.
    let _ = write!(text, "{},{target},", quoted(name));
    if !window.is_empty() {
        text.push_str(&quoted(window));
    }
    let _ = write!(text, ",{}", nees.len());
    for value in [
        mean,
        band.map(|(mean, half)| mean - half),
        band.map(|(mean, half)| mean + half),
        reliability.as_ref().map(|r| r.rows as f64),
        error,
        confidence_max,
        sum("elsewhere_frames"),
        sum("overconfident_frames"),
    ] {
        text.push(',');
        if let Some(value) = value {
            let _ = write!(text, "{value}");
        }
    }
    text.push('\n');
}

/// Returns the mean NEES of each recording, over all seeds that share it.
fn nees_of_recordings(measured: &Measured, target: &str, window: &str) -> Vec<f64> {
    let seeds = measured.figures.iter();
    let seeds = seeds.filter(|f| f.target == target && f.window == window);
    let nees: Vec<f64> = seeds.filter_map(|f| f.value("mean_nees")).collect();
    if measured.plan.run.fresh_world {
        nees
    } else {
        mean(&nees).into_iter().collect()
    }
}

/// `None` without numbers.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Returns the half width of the 99 % confidence band of the mean of independent numbers; `None` if they are too few.
fn half_band_99(values: &[f64]) -> Option<f64> {
    let count = values.len() as f64;
    let mean = mean(values)?;
    let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (values.len() > 1).then(|| SIGMAS_99 * (squares / (count - 1.0) / count).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_narrow_with_the_root_of_the_number_of_values() {
        assert_eq!(half_band_99(&[3.0]), None);
        let values = [2.0, 4.0, 2.0, 4.0];
        // The variance is 4/3; that of the mean of four values is a quarter of it.
        let expected = 2.576 * (1.0 / 3.0_f64).sqrt();
        assert!((half_band_99(&values).unwrap() - expected).abs() < 1e-12);
    }
}
