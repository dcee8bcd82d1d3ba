//! Predictions of where a ball in flight lands, from simulated images of table tennis.

use std::fs;

use crate::common::Run;

/// The height of the ball's centre when it touches the table, metres.
const LANDS_Z_M: f64 = 0.78;

const BUNDLED: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/worlds/table-tennis.toml"
);

fn rows(text: &str) -> Vec<Vec<String>> {
    let lines = text.lines().skip(1);
    let fields = |line: &str| line.split(',').map(str::to_owned).collect();
    lines.map(fields).collect()
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

/// When and where the ball lands in truth: from the last rows before, between which and the table it falls freely.
fn landings(truth: &str) -> Vec<(f64, [f64; 2])> {
    let rows = rows(truth);
    let of_camera = |row: &&Vec<String>| row[2] == "ball" && row[3] == "cam1";
    let rows: Vec<_> = rows.iter().filter(of_camera).collect();
    let bounces = rows.windows(2).filter_map(|pair| {
        let vz = [0, 1].map(|i| number(&pair[i][9]));
        (vz[0] < 0.0 && vz[1] > 0.0).then_some(pair[0])
    });
    let landing = |row: &Vec<String>| {
        let (height_m, vz) = (number(&row[6]) - LANDS_Z_M, number(&row[9]));
        let after_s = (vz + (vz * vz + 2.0 * 9.81 * height_m).sqrt()) / 9.81;
        let at = |axis: usize| number(&row[4 + axis]) + after_s * number(&row[7 + axis]);
        (number(&row[1]) + after_s, [at(0), at(1)])
    };
    bounces.map(landing).collect()
}

#[test]
fn landings_of_a_ball_with_drag_and_spin_are_predicted() {
    let place = tempfile::tempdir().unwrap();
    let run = Run::pardalis(&place, &["simulate", BUNDLED, "-o", "made"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let path = place.path().join("made/scene.toml");
    let scene = fs::read_to_string(&path).unwrap();
    let plane = format!("crossing.point_m = [0, 0, {LANDS_Z_M}]\n");
    fs::write(&path, format!("{scene}{plane}")).unwrap();
    let run = Run::pardalis(&place, &["track", "made/scene.toml", "-o", "out"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.contains("crossings.csv"), "{}", run.stdout);

    // It is thrown at once, by three of its diameters from one frame to the next.
    let run = Run::pardalis(&place, &["evaluate", "out", "made", "--json", "-"]);
    let report: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    let errors = &report["targets"][0]["all"]["errors"]["position_m"];
    let error_m = |figure: &str| errors[figure].as_f64().unwrap();
    assert!(error_m("median") < 0.002, "{errors}");
    assert!(error_m("max") < 0.01, "{errors}");

    let text = fs::read_to_string(place.path().join("out/crossings.csv")).unwrap();
    let predicted = rows(&text);
    assert!(predicted.iter().all(|row| row.len() == 14), "{text}");
    let truth = fs::read_to_string(place.path().join("made/truth.csv")).unwrap();
    let landings = landings(&truth);
    assert_eq!(landings.len(), 2, "{landings:?}");
    // It is thrown at 0.1 s.
    let mut before_s = 0.1;
    for (lands_s, lands_m) in landings {
        // The flight must be known for a tenth of a second.
        let since_s: f64 = before_s + 0.1;
        let latest = |ahead_s: f64| {
            let times = move |row: &&Vec<String>| {
                let time_s = number(&row[1]);
                time_s > since_s && time_s < lands_s - ahead_s
            };
            predicted.iter().rfind(times)
        };
        for (ahead_s, most_m) in [(0.2, 0.12), (0.1, 0.01), (0.05, 0.006)] {
            let row = latest(ahead_s).unwrap();
            let off = [0, 1].map(|axis| number(&row[5 + axis]) - lands_m[axis]);
            let off_m = off[0].hypot(off[1]);
            assert!(
                off_m < most_m,
                "{ahead_s} s ahead of {lands_s} s: {off_m} m"
            );
            let sigma_m = (number(&row[8]) + number(&row[11])).sqrt();
            assert!(off_m < 3.0 * sigma_m, "{off_m} m for {sigma_m} m");
            let late_s = number(&row[3]) - lands_s;
            assert!(late_s.abs() < 3.0 * number(&row[4]) + 1e-3, "{late_s} s");
            assert!((number(&row[7]) - LANDS_Z_M).abs() < 1e-9);
        }
        before_s = lands_s;
    }
    // The last landing is predicted from early on.
    let second = |row: &&Vec<String>| number(&row[1]) > 0.43 && number(&row[1]) < 0.62;
    assert!(predicted.iter().any(|row| second(&row)));

    let run = Run::pardalis(
        &place,
        &["track", "made/scene.toml", "-o", "-", "--frames", "2"],
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let warning = "targets.ball.crossing: crossings are written into a folder only";
    assert!(run.stderr.contains(warning), "{}", run.stderr);

    // A run without a plane leaves none of these rows.
    fs::write(&path, &scene).unwrap();
    let run = Run::pardalis(
        &place,
        &["track", "made/scene.toml", "-o", "out", "--frames", "2"],
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(!place.path().join("out/crossings.csv").exists());

    for (more, wanted) in [
        ("crossing.point_m = [0, 0, nan]\n", "crossing.point_m"),
        (
            "crossing = { point_m = [0, 0, 1], normal = [0, 0, 0] }\n",
            "normal: is [0, 0, 0]; allowed: a direction other than zero",
        ),
        (
            "crossing.point_m = [0, 0, 1]\nmotion.planar_constant_velocity.acceleration_density_m2ps3 = 2\n",
            "targets.ball.crossing: is given, but the target stays on the ground",
        ),
        (
            "crossing.point_m = [0, 0, 1]\ncontour = {}\nstart.gaussian.position_m = [0, 0, 1]\n",
            "targets.ball.crossing: is given, but the published cues, which a start selects, measure no single positions",
        ),
    ] {
        fs::write(&path, format!("{scene}{more}")).unwrap();
        let run = Run::pardalis(&place, &["track", "made/scene.toml", "-o", "out"]);
        assert_eq!(run.code, Some(2), "{more}");
        assert!(run.stderr.contains(wanted), "{}", run.stderr);
    }
}
