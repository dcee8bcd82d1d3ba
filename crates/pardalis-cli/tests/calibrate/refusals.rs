//! What is no calibration, and what the program says to do about it.

use std::fs;

use super::{data, folder, pardalis};

const HEADER: &str = "x_m,y_m,z_m,u_px,v_px";

/// The rendered points with their true pixels, as rows.
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
fn tables_that_are_no_points() {
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
    // Cut off in the middle of a row.
    let cut = format!("{good}\n1,2,3");
    refused(cut, &["points.csv, line 42: has 3 cells"]);
    refused(
        [good.as_bytes(), b"\n1,2,3,4,\xff"].concat(),
        &["line 42, column 5: is not UTF-8"],
    );
}

#[test]
fn points_that_determine_no_camera() {
    let rows = rows();
    refused(
        table_of(&rows[..3]),
        &[
            "points.csv: equidistant: 3 points are too few",
            "give more points",
        ],
    );
    refused(
        table_of(&rows[..4]),
        &[
            "8 coordinates are too few for 9 unknowns",
            "give more points or more views",
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
        &["of the image", "show points all over it"],
    );
    let mirrored: Vec<[f64; 5]> = rows
        .iter()
        .map(|&[x, y, z, u, v]| [-x, y, z, u, v])
        .collect();
    refused(
        table_of(&mirrored),
        &["agree only when mirrored", "right-handed coordinates"],
    );
    let outside: Vec<[f64; 5]> = rows
        .iter()
        .map(|&[x, y, z, u, v]| [x, y, z, 3.0 * u, v])
        .collect();
    refused(
        table_of(&outside),
        &[
            "outside of images of 640 x 480",
            "give the size of the images",
        ],
    );
}

#[test]
fn boards_that_are_not_there() {
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
        &["--model fisheye: there is no such model; allowed: pinhole, equidistant"],
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
fn models_and_cameras_that_are_not_chosen() {
    let folder = folder();
    fs::write(folder.path().join("points.csv"), table_of(&rows())).unwrap();
    let points = "calibrate points points.csv --size 640x480 --model";
    pardalis(&folder, &format!("{points} all,pinhole"))
        .refused(&["--model all,pinhole: all has every model already"]);
    let help = pardalis(&folder, "calibrate points --help").fine();
    for model in ::pardalis::calibrate::ModelKind::ALL {
        assert!(help.stdout.contains(model.name()), "{}", help.stdout);
    }

    let lens = "[cameras.a.model.pinhole]\nf_px = [300, 300]\ncenter_px = [320, 240]\n";
    let two = format!("{lens}{}", lens.replace(".a.", ".b."));
    fs::write(folder.path().join("two.toml"), two).unwrap();
    let pose = "calibrate pose points.csv --size 640x480 --camera two.toml";
    pardalis(&folder, pose)
        .refused(&["two.toml: has several cameras (a, b)", "--camera-name NAME"]);
}
