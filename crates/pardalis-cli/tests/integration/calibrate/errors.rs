//! Errors of `pardalis calibrate` for unsuitable input, with their remedies.

use std::fs;

use super::{data, folder, pardalis};

const HEADER: &str = "x_m,y_m,z_m,u_px,v_px";

/// Returns the rendered points with their true pixels, as rows.
fn rows() -> Vec<[f64; 5]> {
    let text = fs::read_to_string(data("dioptric/correspondences.csv")).unwrap();
    let row = |line: &str| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        std::array::from_fn(|i| cells[i + 1])
    };
    text.lines().skip(1).map(row).collect()
}

fn table_of(rows: &[[f64; 5]]) -> String {
    let lines = rows
        .iter()
        .map(|row| row.map(|value| value.to_string()).join(","));
    let lines: Vec<String> = std::iter::once(HEADER.to_owned()).chain(lines).collect();
    lines.join("\n")
}

#[track_caller]
fn refused(table: impl AsRef<[u8]>, wanted: &[&str]) {
    let folder = folder();
    fs::write(folder.path().join("points.csv"), table).unwrap();
    let run = "calibrate points points.csv --size 640x480 --model equidistant";
    pardalis(&folder, run).refused(wanted);
    assert!(!folder.path().join("points-calibration").exists());
}

#[test]
fn rejects_invalid_tables() {
    let good = table_of(&rows());
    refused("", &["points.csv: has no rows"]);
    refused(HEADER, &["points.csv: has no rows"]);
    refused(
        good.replacen("u_px", "u", 1),
        &[
            "points.csv, line 1: column \"u_px\" is missing; found: x_m",
            "--columns u=NAME",
        ],
    );
    refused(
        good.replacen("y_m", "x_m", 1),
        &["points.csv, line 1: column \"x_m\" occurs twice"],
    );
    for (separator, name) in [(";", "semicolons"), ("\t", "tabs")] {
        let wanted = format!(
            "points.csv, line 1: the columns are separated by {name}; they must be separated by commas"
        );
        refused(good.replace(',', separator), &[&wanted]);
    }
    refused(
        format!("{good}\n1,2,3,4,5,25"),
        &[
            "line 42: has 6 cells where the header has 5",
            "decimal point",
        ],
    );
    refused(
        format!("{good}\n1,2,3,4,\"5,25\""),
        &["line 42, column v_px: holds \"5,25\"; allowed: a number with a decimal point"],
    );
    let with = |cell: &str| format!("{good}\n1,2,3,4,{cell}");
    for cell in ["NaN", "inf", "12px"] {
        let place = format!("points.csv, line 42, column v_px: holds \"{cell}\"");
        refused(with(cell), &[&place, "allowed: a finite number"]);
    }
    refused(
        with(""),
        &["points.csv, line 42, column v_px: is empty; allowed"],
    );
    // Truncated within a row.
    let cut = format!("{good}\n1,2,3");
    refused(cut, &["points.csv, line 42: has 3 cells"]);
    refused(
        [good.as_bytes(), b"\n1,2,3,4,\xff"].concat(),
        &["line 42, column 5: is not UTF-8"],
    );
}

#[test]
fn rejects_points_that_do_not_determine_a_camera() {
    let rows = rows();
    refused(
        table_of(&rows[..3]),
        &[
            "points.csv: equidistant: 3 points are too few",
            "add points",
        ],
    );
    refused(
        table_of(&rows[..4]),
        &[
            "8 coordinates are too few for 9 unknowns",
            "add points or views",
        ],
    );
    let flat: Vec<[f64; 5]> = rows
        .iter()
        .map(|&[x, y, _, u, v]| [x, y, 0.0, u, v])
        .collect();
    refused(
        table_of(&flat),
        &[
            "all points of the table lie in one plane",
            "at other heights",
        ],
    );
    let corner: Vec<[f64; 5]> = rows
        .iter()
        .map(|&[x, y, z, u, v]| [x, y, z, 0.2 * u, 0.2 * v])
        .collect();
    refused(
        table_of(&corner),
        &["of the image", "distribute the points over the whole image"],
    );
    let mirrored: Vec<[f64; 5]> = rows
        .iter()
        .map(|&[x, y, z, u, v]| [-x, y, z, u, v])
        .collect();
    refused(
        table_of(&mirrored),
        &["match only when mirrored", "right-handed coordinates"],
    );
    let outside: Vec<[f64; 5]> = rows
        .iter()
        .map(|&[x, y, z, u, v]| [x, y, z, 3.0 * u, v])
        .collect();
    refused(
        table_of(&outside),
        &[
            "pixels lie outside images of 640 x 480: line ",
            "give the size of the images",
        ],
    );
    let mut far = rows.clone();
    far[4][0] = 1e300;
    refused(
        table_of(&far),
        &["points.csv: 1 of 40 points are too far away to be in metres: line 6 [1e300, "],
    );
    far[4] = [0.1, 0.2, 0.0, 1e9, 240.0];
    refused(
        table_of(&far),
        &[
            "points.csv: 1 of 40 pixels lie outside images of 640 x 480: line 6 (1000000000.0, 240.0)",
        ],
    );
    let same: Vec<[f64; 5]> = rows.iter().map(|r| [0.1, 0.2, 0.3, r[3], r[4]]).collect();
    refused(
        table_of(&same),
        &["all points of the table are the same; spread them"],
    );
    refused(
        table_of(&rows[..8]),
        &[
            "16 coordinates are too few for 9 unknowns",
            "at least 9 points",
        ],
    );
}

#[test]
fn rejects_poses_from_mismatched_points() {
    let rows = rows();
    let folder = folder();
    let refused = |rows: &[[f64; 5]], camera: &str, wanted: &[&str]| {
        fs::write(folder.path().join("points.csv"), table_of(rows)).unwrap();
        let camera = format!("[cameras.lens]\nsize_px = [640, 480]\n{camera}\n");
        fs::write(folder.path().join("lens.toml"), camera).unwrap();
        pardalis(&folder, "calibrate pose points.csv --camera lens.toml").refused(wanted);
        assert!(!folder.path().join("points-pose").exists());
    };
    let lens = "model.equidistant = { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185 }";
    let changed = |change: &dyn Fn([f64; 5]) -> [f64; 5]| -> Vec<[f64; 5]> {
        rows.iter().map(|row| change(*row)).collect()
    };
    let mirrored = changed(&|[x, y, z, u, v]| [-x, y, z, u, v]);
    refused(
        &mirrored,
        lens,
        &[
            "points.csv: points and pixels match only when mirrored",
            "right-handed coordinates",
        ],
    );
    let swapped = changed(&|[x, y, z, u, v]| [x, y, z, v, u]);
    refused(
        &swapped,
        lens,
        &["of 40 pixels lie outside images of 640 x 480: line 13 "],
    );
    let inside: Vec<[f64; 5]> = swapped.into_iter().filter(|row| row[4] < 480.0).collect();
    refused(
        &inside,
        lens,
        &[
            "match only with u and v exchanged",
            "the order of the columns",
        ],
    );
    let moved: Vec<[f64; 5]> = (0..40)
        .map(|i| {
            let ([x, y, z, ..], [.., u, v]) = (rows[i], rows[(7 * i + 3) % 40]);
            [x, y, z, u, v]
        })
        .collect();
    refused(&moved, lens, &["in the same order"]);
    let pinhole = "model.pinhole = { f_px = [300, 300], center_px = [319.5, 239.5] }";
    refused(&rows, pinhole, &["the camera file belongs to these images"]);
    refused(
        &rows[..4],
        lens,
        &["4 points are too few for a pose from points not in one plane, which needs 6"],
    );
}

#[test]
fn rejects_rigs_with_images_that_are_not_simultaneous() {
    let folder = folder();
    for (camera, left_out) in [("left", "left14"), ("right", "right01")] {
        fs::create_dir(folder.path().join(camera)).unwrap();
        for entry in fs::read_dir(data("opencv-stereo")).unwrap() {
            let file = entry.unwrap().path();
            let name = file.file_name().unwrap().to_str().unwrap();
            if name.starts_with(camera) && !name.starts_with(left_out) {
                fs::copy(&file, folder.path().join(camera).join(name)).unwrap();
            }
        }
    }
    let run = "calibrate board --rig left=left --rig right=right --board checkerboard:9x6:0.025 --model pinhole -o out";
    pardalis(&folder, run).refused(&[
        "--rig: the cameras disagree on the target's position in ",
        " of 12 shots: left01.jpg with right02.jpg, left02.jpg with right03.jpg",
        "whether one is missing",
    ]);
    assert!(!folder.path().join("out").exists());
}

#[test]
fn rejects_missing_images_and_boards() {
    let folder = folder();
    let refused = |arguments: &str, wanted: &[&str]| {
        pardalis(&folder, &format!("calibrate board {arguments}")).refused(wanted);
    };
    let board = "--board checkerboard:9x6:0.06 --model equidistant";
    fs::create_dir(folder.path().join("empty")).unwrap();
    refused(
        &format!("empty {board}"),
        &["empty: no images there; allowed"],
    );
    refused(&format!("none.jpg {board}"), &["none.jpg"]);
    fs::create_dir(folder.path().join("broken")).unwrap();
    fs::write(folder.path().join("broken/a.jpg"), b"no image").unwrap();
    refused(&format!("broken {board}"), &["broken/a.jpg"]);
    refused(
        "data/dioptric/board_0.jpg --board checkerboard:11x8:0.06 --model equidistant",
        &["the board was found in none of the images", "board_0.jpg: "],
    );
    refused(
        "data/dioptric --board checkerboard:9x6:0.06 --model fisheye",
        &["--model fisheye: unknown model; allowed: pinhole, equidistant"],
    );
    refused(
        &format!("data/dioptric/board_0.jpg {board}"),
        &["lie in one plane", "several views of the plane"],
    );
    refused(
        &format!("data/dioptric {board} --distance board_9.jpg=1"),
        &["--distance board_9.jpg: the board was found in no image of this name"],
    );
    refused(
        &format!("--rig left=data/opencv-stereo {board}"),
        &["--rig: left is the only camera"],
    );
}

#[test]
fn a_camera_below_the_floor_is_asked_about() {
    let folder = folder();
    let lens = "[cameras.lens]\nsize_px = [640, 480]\nmodel.pinhole = { f_px = [500, 500], center_px = [320, 240] }\n";
    fs::write(folder.path().join("lens.toml"), lens).unwrap();
    let stdout = |exchange: f64| {
        let corners = [[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]];
        // Two meters above, looking down.
        let rows =
            corners.map(|[x, y]| [x, y, 0.0, 320.0 + 250.0 * x, 240.0 - exchange * 250.0 * y]);
        fs::write(folder.path().join("points.csv"), table_of(&rows)).unwrap();
        let run = pardalis(&folder, "calibrate pose points.csv --camera lens.toml");
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        run.stdout + &run.stderr
    };
    assert!(!stdout(1.0).contains("below the plane"));
    let exchanged = stdout(-1.0);
    let wanted = "the camera is 2.00 m below the plane of the points: if they are on a floor or a table and z points up, some of them are exchanged, or an axis points the other way";
    assert!(exchanged.contains(wanted), "{exchanged}");
}

#[test]
fn rejects_ambiguous_models_and_cameras() {
    let folder = folder();
    fs::write(folder.path().join("points.csv"), table_of(&rows())).unwrap();
    let points = "calibrate points points.csv --size 640x480 --model";
    pardalis(&folder, &format!("{points} all,pinhole"))
        .refused(&["--model all,pinhole: all includes every model"]);
    let help = pardalis(&folder, "calibrate points --help").fine();
    for model in ::pardalis_calibrate::ModelKind::ALL {
        assert!(help.stdout.contains(model.name()), "{}", help.stdout);
    }

    let lens = "[cameras.a.model.pinhole]\nf_px = [300, 300]\ncenter_px = [320, 240]\n";
    let two = format!("{lens}{}", lens.replace(".a.", ".b."));
    fs::write(folder.path().join("two.toml"), two).unwrap();
    let pose = "calibrate pose points.csv --size 640x480 --camera two.toml";
    pardalis(&folder, pose)
        .refused(&["two.toml: has several cameras (a, b)", "--camera-name NAME"]);
}
