//! `pardalis demo`, which most users run first.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// The bundled sequences.
fn data() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data")
}

fn run(program: &Path, folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(program);
    command
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn the_demo_tracks_the_ball_and_prints_the_error() {
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_pardalis"));
    let data = data();
    let demo = run(
        program,
        folder.path(),
        &["demo", "--data", data.to_str().unwrap()],
    );
    let printed = String::from_utf8(demo.stdout).unwrap();
    assert_eq!((demo.status.code(), &*demo.stderr), (Some(0), &b""[..]));

    let results = folder.path().join("pardalis-demo");
    let files = ["tracks.csv", "summary.json"];
    let plots = ["above", "side", "3d", "coordinates"]
        .map(|plot| [format!("{plot}.svg"), format!("{plot}.png")]);
    for file in files
        .into_iter()
        .chain(plots.iter().flatten().map(|plot| &**plot))
    {
        let size = fs::metadata(results.join(file)).unwrap().len();
        assert!(size > 1000, "{file}: {size} bytes");
        assert!(
            printed.contains(&format!("pardalis-demo/{file}")),
            "{file}: {printed}"
        );
    }
    assert_eq!(
        fs::read_dir(results.join("annotated")).unwrap().count(),
        110
    );

    let truth = data.join("dioptric-jump");
    let arguments = [
        "evaluate",
        "pardalis-demo",
        truth.to_str().unwrap(),
        "--json",
        "-",
    ];
    let evaluated = run(program, folder.path(), &arguments);
    let figures: Value = serde_json::from_slice(&evaluated.stdout).unwrap();
    let all = &figures["targets"][0]["all"];
    assert_eq!(
        (&all["frames"], &all["estimates"]),
        (&110.into(), &110.into())
    );
    let errors = &all["errors"];
    let figure = |value: &Value| value.as_f64().unwrap();
    let worst_deg = figure(&errors["direction_max_rad"]).to_degrees();
    assert!(worst_deg < 1.0, "{worst_deg} degrees");
    let mean_mm = 1e3 * figure(&errors["position_m"]["mean"]);
    assert!(mean_mm < 60.0, "{mean_mm} mm");
    let mean_deg = figure(&errors["direction_mean_rad"]).to_degrees();
    for sentence in [
        format!("The mean position error was {mean_mm:.0} mm"),
        format!("the mean direction error was {mean_deg:.1} degrees"),
    ] {
        assert!(printed.contains(&sentence), "{sentence}: {printed}");
    }
}

#[test]
fn a_missing_data_folder_is_named_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |program: &Path, arguments: &[&str], wanted: &[&str]| {
        let output = run(program, folder.path(), arguments);
        let printed = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), &*output.stdout), (Some(2), &b""[..]));
        for wanted in wanted {
            assert!(printed.contains(wanted), "no {wanted:?} in: {printed}");
        }
    };
    let program = Path::new(env!("CARGO_BIN_EXE_pardalis"));
    let wanted = ["--data nowhere", "dioptric-jump/scene.toml"];
    refused(program, &["demo", "--data", "nowhere"], &wanted);
    // Installed elsewhere, the program has no data folder above it.
    let installed = folder.path().join("pardalis");
    fs::copy(program, &installed).unwrap();
    refused(&installed, &["demo"], &["not found", "--data PATH/data"]);
    assert!(!folder.path().join("pardalis-demo").exists());
}

#[test]
fn packages_of_systems_keep_the_bundled_sequences_in_share() {
    let folder = tempfile::tempdir().unwrap();
    let [binaries, sequence] =
        ["usr/bin", "usr/share/pardalis/data/dioptric-jump"].map(|name| folder.path().join(name));
    for folder in [&binaries, &sequence] {
        fs::create_dir_all(folder).unwrap();
    }
    let installed = binaries.join("pardalis");
    fs::copy(env!("CARGO_BIN_EXE_pardalis"), &installed).unwrap();
    let scene = sequence.join("scene.toml");
    fs::write(&scene, "sed = 1").unwrap();
    let elsewhere = tempfile::tempdir().unwrap();
    let output = run(&installed, elsewhere.path(), &["demo"]);
    let printed = String::from_utf8(output.stderr).unwrap();
    assert!(printed.contains(scene.to_str().unwrap()), "{printed}");
    assert!(printed.contains("sed"), "{printed}");
}
