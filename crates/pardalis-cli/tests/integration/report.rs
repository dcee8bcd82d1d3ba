//! `track --report` and `pardalis view`: what their pages contain, and what they say about files that are wrong. In a browser they are tested
//! by scripts/web-test.

use std::fs;
use std::path::Path;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::common::run::{interrupt, rows_in, wait_for_lines};
use crate::common::{
    BALL_COLORS, FRONT_LANDMARK, PLANE_ROBOT, REAR_LANDMARK, Run, SCENE, Workplace, scene_with,
};

const HEADER: &str = "frame,time_s,target,state,x_m,y_m,z_m";

/// Returns the data of a page.
fn data_in(page: &Path) -> Value {
    let text = fs::read_to_string(page).unwrap();
    let (_, data) = text.split_once("id=\"data\">").unwrap();
    let (data, _) = data.split_once("</script>").unwrap();
    serde_json::from_str(data).unwrap()
}

/// Runs `pardalis view --no-open` in a folder.
fn view(place: &Workplace, arguments: &[&str]) -> Run {
    Run::pardalis(
        place.path(""),
        &[&["view", "--no-open"], arguments].concat(),
    )
}

#[test]
fn a_report_holds_rows_scene_frames_and_summary() {
    let place = Workplace::with_frames(5);
    let run = place.track_with(
        SCENE,
        &["-o", "out", "--no-plots", "--annotate", "--report"],
    );
    assert!(run.fine().stdout.contains("\n  out/report.html\n"));
    let data = data_in(&place.path("out/report.html"));
    let ball = &data["tracks"]["ball"];
    let rows = place.rows();
    for (number, row) in rows.iter().enumerate() {
        assert_eq!(ball["time_s"][number].as_f64(), row[1].parse().ok());
        assert_eq!(ball["state"][number], *row[3]);
        for (column, name, digits) in [(4, "x_m", 1e-6), (9, "vz_mps", 1e-6), (15, "yz_m2", 1e-4)] {
            let value: f64 = row[column].parse().unwrap();
            let shown = ball[name][number].as_f64().unwrap();
            let allowed = if column < 11 {
                digits
            } else {
                digits * value.abs()
            };
            assert!((value - shown).abs() <= allowed, "{name}: {value} {shown}");
        }
    }
    assert_eq!(ball["time_s"].as_array().unwrap().len(), 5);
    assert!(ball.get("heading_rad").is_none());

    let scene = &data["scene"];
    assert_eq!(scene["units"], "m");
    assert_eq!(
        scene["targets"][0]["shape"],
        json!({ "kind": "sphere", "radius_m": 0.11 })
    );
    let camera = &scene["cameras"][0];
    assert_eq!(camera["name"], "cam1");
    assert_eq!(camera["position_m"], json!([0.0, 0.0, 0.9]));
    assert_eq!(camera["world_from_camera"][0], json!([0.0, -1.0, 0.0]));
    assert_eq!(camera["image_size"], json!([640, 480]));
    // The circle of the fisheye, which is inside the image: half of 185 degrees from the axis.
    let rays = camera["border_rays"].as_array().unwrap();
    assert_eq!(rays.len(), 64);
    for ray in rays {
        let [x, y, z] = [0, 1, 2].map(|axis| ray[axis].as_f64().unwrap());
        assert!((x.hypot(y).hypot(z) - 1.0).abs() < 1e-9);
        assert!((z.acos().to_degrees() - 92.5).abs() < 0.01, "{z}");
    }

    let frames = scene["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 5);
    assert_eq!(frames[3]["time_s"], 0.12);
    let image = frames[3]["images"]["cam1"].as_str().unwrap();
    assert!(image.starts_with("data:image/jpeg;base64,/9j/"));
    let whole = fs::metadata(place.path("out/annotated/000003.jpg"))
        .unwrap()
        .len();
    assert!(image.len() < whole as usize, "{} of {whole}", image.len());
    assert_eq!(data["summary"]["frame_sets"], 5);
    assert_eq!(data["notes"], json!([]));

    // A later run without a page leaves none that would show other rows.
    view(&place, &["out"]).fine();
    assert!(place.path("out/view.html").exists());
    place.track(SCENE).fine();
    assert!(!place.path("out/report.html").exists() && !place.path("out/view.html").exists());
}

#[test]
fn a_finished_track_is_shown_with_its_scene() {
    let place = Workplace::with_frames(3);
    place
        .track_with(SCENE, &["-o", "out", "--no-plots", "--report"])
        .fine();
    let run = view(&place, &["out"]).fine();
    assert_eq!(run.stdout, "out/view.html\n");
    let [report, shown] =
        ["report", "view"].map(|page| data_in(&place.path(&format!("out/{page}.html"))));
    assert_eq!(shown, report);
    // From another folder, and from the file of the rows.
    let tracks = place.path("out/tracks.csv");
    let page = place.path("elsewhere.html");
    let arguments = [
        "view",
        "--no-open",
        tracks.to_str().unwrap(),
        "-o",
        page.to_str().unwrap(),
    ];
    Run::pardalis(std::env::temp_dir(), &arguments).fine();
    assert_eq!(data_in(&page)["scene"], report["scene"]);
    // A page may be replaced by another, but nothing else.
    Run::pardalis(std::env::temp_dir(), &arguments).fine();
    place.write("notes.html", "<p>mine</p>");
    view(&place, &["out", "-o", "notes.html"])
        .refused(&["-o notes.html: exists and holds no page of pardalis view"]);

    #[cfg(unix)]
    {
        fs::remove_file(place.path("out/view.html")).unwrap();
        std::os::unix::fs::symlink(place.path("notes.html"), place.path("out/view.html")).unwrap();
        view(&place, &["out"]).refused(&["out/view.html: is a link", "give -o"]);
        fs::remove_file(place.path("out/view.html")).unwrap();
    }

    // The scene is gone: its rows are shown without cameras, and the page says so.
    fs::remove_file(place.path("scene.toml")).unwrap();
    let run = view(&place, &["out"]);
    assert_eq!(run.code, Some(0));
    assert!(
        run.stderr
            .contains("warning: the scene scene.toml is not found"),
        "{}",
        run.stderr
    );
    let data = data_in(&place.path("out/view.html"));
    assert_eq!(data["scene"]["cameras"], json!([]));
    assert_eq!(data["scene"]["targets"][0]["shape"]["radius_m"], 0.11);
    assert!(data["notes"][0].as_str().unwrap().contains("scene.toml"));
    assert_eq!(data["tracks"], report["tracks"]);
}

#[test]
fn tracks_of_other_programs_need_only_times_targets_and_positions() {
    let place = Workplace::with_frames(0);
    place.write(
        "other.csv",
        "time_s,target,x_m,y_m,z_m\n0.5,a,1,2,3\n0.5,b,,,\n0.75,a,1,2,4\n",
    );
    view(&place, &["other.csv"]).fine();
    let data = data_in(&place.path("view.html"));
    assert_eq!(data["tracks"]["a"]["z_m"], json!([3, 4]));
    assert_eq!(data["tracks"]["b"]["time_s"], json!([0.5]));
    assert_eq!(data["summary"], Value::Null);
}

#[test]
fn two_runs_are_compared_by_time_and_name() {
    let place = Workplace::with_frames(4);
    let other_seed = scene_with("seed = 1", "seed = 2");
    place.track_with(SCENE, &["-o", "one", "--no-plots"]).fine();
    place
        .track_with(&other_seed, &["-o", "one", "--no-plots", "--frames", "3"])
        .fine();
    let run = view(&place, &["one/tracks.previous.csv", "one"]).fine();
    assert_eq!(run.stdout, "one/comparison.html\n");
    let data = data_in(&place.path("one/comparison.html"));
    let rows = |name: &str| {
        let text = fs::read_to_string(place.path(&format!("one/{name}"))).unwrap();
        rows_in(&text)
    };
    let runs = [rows("tracks.previous.csv"), rows("tracks.csv")];
    let number = |cell: &String| cell.parse::<f64>().unwrap();
    let shown = &data["comparison"];
    assert_eq!(shown["names"], json!(["one/tracks.previous.csv", "one"]));
    assert_eq!(
        shown["settings"],
        json!([{ "key": "seed", "values": ["1", "2"] }])
    );
    let apart_m = runs[0].iter().zip(&runs[1]).map(|(a, b)| {
        let squares = (4..7).map(|axis| (number(&a[axis]) - number(&b[axis])).powi(2));
        (squares.sum::<f64>().sqrt(), number(&a[1]))
    });
    let mut apart: Vec<_> = apart_m.collect();
    apart.sort_by(|a, b| a.0.total_cmp(&b.0));
    let ball = &shown["targets"]["ball"];
    let distance = &ball["distance"];
    assert_eq!(distance["times"], 3);
    let close = |value: &Value, expected: f64| {
        let value = value.as_f64().unwrap();
        assert!((value - expected).abs() < 1e-12, "{value} {expected}");
    };
    close(&distance["median_m"], apart[1].0);
    close(&distance["largest_m"], apart[2].0);
    assert!(apart[2].0 > 0.0);
    close(&distance["largest_at_s"], apart[2].1);
    for (run, rows) in runs.iter().enumerate() {
        let figures = &ball["figures"][run];
        assert_eq!(figures["rows"], json!({ "tracking": rows.len() }));
        let sum: f64 = rows.iter().map(|row| number(&row[18])).sum();
        close(&figures["mean_confidence"], sum / rows.len() as f64);
    }
    assert_eq!(data["tracks"]["ball"]["frame"], json!([0, 1, 2, 3]));
    assert_eq!(shown["tracks"]["ball"]["frame"], json!([0, 1, 2]));
    // The settings are those of each run, and a new run leaves no comparison of others.
    assert_eq!(data["summary"]["seed"], 1);
    // Runs of other images.
    let path = place.path("one/summary.json");
    let text = fs::read_to_string(&path).unwrap();
    let mut summary: Value = serde_json::from_str(&text).unwrap();
    summary["settings"]["cameras"]["cam1"]["images"] = json!("elsewhere");
    fs::write(&path, summary.to_string()).unwrap();
    let run = view(&place, &["one/tracks.previous.csv", "one"]);
    let doubt = "The runs may be of different images: cameras.cam1.images is \"images\" in one/tracks.previous.csv and \"elsewhere\" in one";
    assert!(
        run.code == Some(0) && run.stderr.contains(doubt),
        "{}",
        run.stderr
    );
    let data = data_in(&place.path("one/comparison.html"));
    assert!(data["notes"].to_string().contains("of different images"));
    place.track(SCENE).fine();
    assert!(!place.path("out/comparison.html").exists());
}

#[test]
fn runs_with_nothing_in_common_are_refused() {
    let place = Workplace::with_frames(0);
    let rows = |target: &str, from: u32| {
        let row = |frame: u32| format!("{frame},{frame},{target},tracking,1,2,3\n");
        format!("{HEADER}\n{}{}", row(from), row(from + 1))
    };
    place.write("a.csv", rows("ball", 0));
    place.write("b.csv", rows("robot", 0));
    place.write("c.csv", rows("ball", 5));
    let remedy = "give two runs of the same recording, whose targets have the same names";
    view(&place, &["a.csv", "b.csv"]).refused(&[
        "a.csv has ball from 0 to 1 s, b.csv has robot from 0 to 1 s",
        "no target has rows at common times",
        remedy,
    ]);
    view(&place, &["a.csv", "c.csv"]).refused(&["c.csv has ball from 5 to 6 s", remedy]);
    view(&place, &["a.csv", "nowhere"]).refused(&["nowhere: there is no such file"]);
    place.write("cut.csv", format!("{HEADER}\n0,0,ball,tracking,1,2\n"));
    view(&place, &["a.csv", "cut.csv"]).refused(&["cut.csv", "line 2"]);
    assert!(!place.path("comparison.html").exists());
}

#[test]
fn wrong_files_are_refused_with_line_and_remedy() {
    let place = Workplace::with_frames(0);
    let remedy = "give the folder with the results of `pardalis track`";
    view(&place, &["nowhere"]).refused(&["nowhere: there is no such file", remedy]);
    view(&place, &["."]).refused(&["there is no tracks.csv in this folder", remedy]);
    place.write("summary.json", "{}");
    view(&place, &["summary.json"]).refused(&["has the summary and not the rows", remedy]);
    fs::remove_file(place.path("summary.json")).unwrap();
    place.write("empty.csv", format!("{HEADER}\n"));
    view(&place, &["empty.csv"]).refused(&["empty.csv: has no rows"]);
    place.write("cut.csv", format!("{HEADER}\n0,0,ball,tracking,1,2\n"));
    view(&place, &["cut.csv"]).refused(&["cut.csv", "line 2"]);
    for (name, row, wanted) in [
        (
            "nan",
            "0,0,ball,tracking,NaN,2,3",
            "column x_m: holds \"NaN\"; allowed: a finite number",
        ),
        (
            "state",
            "0,0,ball,gone,1,2,3",
            "column state: holds \"gone\"; allowed: ",
        ),
        (
            "frame",
            "-1,0,ball,lost,1,2,3",
            "column frame: holds \"-1\"; allowed: a whole number from 0",
        ),
    ] {
        let file = format!("{name}.csv");
        place.write(&file, format!("{HEADER}\n{row}\n"));
        view(&place, &[&file]).refused(&[&file, "line 2", wanted]);
    }
    place.write("good.csv", format!("{HEADER}\n0,0,ball,tracking,1,2,3\n"));
    view(&place, &["good.csv", "-o", "no/such/page.html"])
        .refused(&["no/such/page.html: cannot be written"]);
    place.write("summary.json", "{\"scene\": ");
    view(&place, &["good.csv"]).refused(&["summary.json: is no summary of pardalis track"]);
    // Anything that is no summary counts as one that says nothing.
    place.write("summary.json", "[1]");
    assert_eq!(view(&place, &["good.csv"]).code, Some(0));
    let run = Run::pardalis(
        place.path(""),
        &["track", "scene.toml", "--report", "-o", "-"],
    );
    run.refused(&["--report: writes report.html into the output folder"]);
}

#[test]
fn long_tracks_are_thinned_by_whole_times() {
    use std::fmt::Write as _;
    let place = Workplace::with_frames(0);
    let mut text = format!("{HEADER}\n");
    for frame in 0..150_000 {
        for target in ["a", "b"] {
            writeln!(
                text,
                "{frame},{},{target},tracking,{frame},0,0",
                f64::from(frame) / 25.0
            )
            .unwrap();
        }
    }
    place.write("tracks.csv", text);
    view(&place, &["tracks.csv"]).fine();
    let data = data_in(&place.path("view.html"));
    for target in ["a", "b"] {
        let frames = data["tracks"][target]["frame"].as_array().unwrap();
        assert_eq!((frames.len(), &frames[1]), (75_000, &json!(2)));
    }
    assert!(
        data["notes"]
            .as_array()
            .unwrap()
            .iter()
            .any(|note| note.as_str().unwrap().contains("one of 2 times"))
    );
}

#[test]
fn cameras_that_move_have_their_path() {
    let place = Workplace::with_frames(0);
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/dioptric-moving-robot");
    let data = data.to_str().unwrap();
    let scene = format!(
        "[platforms.robot]\nposes = \"{data}/poses.csv\"\n[cameras.cam1]\nimages = \"{data}/frames\"\nfps = 25\nframe_limit = 4\nplatform = \"robot\"\n\
         calibration = \"{data}/camera.json\"\n[targets.ball]\nshape.sphere.radius_m = 0.11\ncolors = \"ball.toml\"\n"
    );
    place.write("ball.toml", BALL_COLORS);
    place
        .track_with(scene, &["-o", "out", "--no-plots", "--report"])
        .fine();
    let camera = &data_in(&place.path("out/report.html"))["scene"]["cameras"][0];
    let path = camera["path"].as_array().unwrap();
    assert_eq!(path.len(), 4);
    assert_eq!(path[3][0], 0.12);
    let [w, x, y, z] = [4, 5, 6, 7].map(|entry| path[3][entry].as_f64().unwrap());
    assert!((w * w + x * x + y * y + z * z - 1.0).abs() < 1e-9);
    assert_eq!(
        camera["position_m"],
        json!([path[0][1], path[0][2], path[0][3]])
    );

    // The same in the page of the finished track, from the file beside it, and of an earlier run from its own.
    let close = |shown: &Value, count: usize| {
        let shown = shown["scene"]["cameras"][0]["path"].as_array().unwrap();
        assert_eq!(shown.len(), count);
        for (pose, other) in path.iter().zip(shown) {
            for (number, other) in pose
                .as_array()
                .unwrap()
                .iter()
                .zip(other.as_array().unwrap())
            {
                assert!((number.as_f64().unwrap() - other.as_f64().unwrap()).abs() < 1e-12);
            }
        }
    };
    view(&place, &["out"]).fine();
    close(&data_in(&place.path("out/view.html")), 4);
    let scene = fs::read_to_string(place.path("scene.toml")).unwrap();
    place
        .track_with(&scene, &["-o", "out", "--no-plots", "--frames", "2"])
        .fine();
    view(&place, &["out"]).fine();
    close(&data_in(&place.path("out/view.html")), 2);
    let earlier = place.path("out/tracks.previous.csv");
    view(&place, &[earlier.to_str().unwrap()]).fine();
    close(&data_in(&place.path("out/view.html")), 4);

    let table = fs::read_to_string(place.path("out/cameras.csv")).unwrap();
    let mut lines: Vec<&str> = table.lines().collect();
    lines.swap(1, 2);
    place.write("out/cameras.csv", lines.join("\n"));
    view(&place, &["out"]).refused(&[
        "out/cameras.csv, line 3: is at 0 s",
        "the rows must be in order of time",
    ]);
    place.write("out/cameras.csv", table.replace(",-0\n", ",-3\n"));
    view(&place, &["out"]).refused(&["out/cameras.csv, line 2: the quaternion", "have length 1"]);
}

#[test]
fn planes_have_the_part_that_is_in_view() {
    let place = Workplace::with_frames(0);
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    let scene = format!("{PLANE_ROBOT}{FRONT_LANDMARK}{REAR_LANDMARK}")
        .replace("DATA", data.to_str().unwrap());
    place
        .track_with(
            scene,
            &["-o", "out", "--no-plots", "--report", "--frames", "3"],
        )
        .fine();
    let data = data_in(&place.path("out/report.html"));
    let camera = &data["scene"]["cameras"][0];
    assert_eq!(camera["position_m"], json!([0.0, -3.2, 3.0]));
    let footprint = camera["footprint_m"].as_array().unwrap();
    assert!(footprint.len() >= 32, "{}", footprint.len());
    // The tape around the origin is in view, and the camera, which looks towards y, is behind the nearest part.
    let reach = |axis: usize, most: fn(f64, f64) -> f64| {
        footprint
            .iter()
            .map(|place| place[axis].as_f64().unwrap())
            .reduce(most)
            .unwrap()
    };
    assert!(reach(0, f64::min) < -1.0 && reach(0, f64::max) > 1.2);
    assert!(reach(1, f64::max) > 1.4 && (-3.2..-0.3).contains(&reach(1, f64::min)));
    assert_eq!(data["scene"]["targets"][0]["shape"]["kind"], "disc");
    assert!(data["tracks"]["robot"]["heading_rad"][2].is_number());
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_has_its_report() {
    let place = Workplace::with_frames(1);
    for number in 1..500 {
        fs::hard_link(place.image(0), place.image(number)).unwrap();
    }
    let scene = scene_with("particles = 100", "particles = 20000");
    let mut command = place.command(scene, &["-o", "out", "--no-plots", "--report"]);
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    wait_for_lines(&mut child, &place.path("out/tracks.csv"), 4);
    assert_eq!(interrupt(child).code, Some(1));
    let data = data_in(&place.path("out/report.html"));
    assert_eq!(data["summary"]["interrupted"], true);
    let times = data["tracks"]["ball"]["time_s"].as_array().unwrap();
    assert_eq!(times.len(), place.rows().len());
}
