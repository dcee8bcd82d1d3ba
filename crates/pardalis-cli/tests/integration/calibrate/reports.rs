//! Reports of successful calibrations: warnings, the limit of the lens, the best model.

use std::fs;

use super::{NOISY, data, figure, folder, pardalis, table};

#[test]
fn reports_the_limit_of_the_lens() {
    let folder = folder();
    let points = "calibrate points data/dioptric/correspondences.csv --size 640x480";
    let words = "The camera ends at 97 degrees from its axis, 10 % beyond the farthest point";
    for (model, key) in [
        ("equidistant", "field_of_view_deg"),
        ("ocam", "max_radius_px"),
    ] {
        let run = format!("{points} --model {model} {NOISY} -o {model}");
        let run = pardalis(&folder, &run).fine();
        let page = fs::read_to_string(folder.path().join(model).join("report.html")).unwrap();
        for text in [&run.stdout, &page] {
            assert!(text.contains("The camera ends at 9"), "{text}");
            assert!(text.contains("beyond the farthest point"), "{text}");
            assert!(text.contains(key), "{text}");
            assert!(model == "ocam" || text.contains(words), "{text}");
            assert!(!text.contains("Warning"), "{text}");
        }
    }
    // This model has no limit.
    let run = format!("{points} --model extended_unified {NOISY} -o other");
    let run = pardalis(&folder, &run).fine();
    assert!(!run.stdout.contains("The camera ends"), "{}", run.stdout);
}

#[test]
fn warns_of_implausible_input() {
    let folder = folder();
    let text = fs::read_to_string(data("dioptric/correspondences.csv")).unwrap();
    let warned = |name: &str, table: &str, size: &str, expected: &str| {
        fs::write(folder.path().join(name), table).unwrap();
        let run =
            format!("calibrate points {name} --size {size} --model equidistant {NOISY} -o out");
        let run = pardalis(&folder, &run).fine();
        let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
        for text in [&run.stdout, &page] {
            assert!(text.contains(expected), "{text}");
        }
        let models = super::table(&folder, "out/models.csv");
        figure(&models, "equidistant", "points")
    };
    // Millimetres instead of metres, and vice versa.
    let in_units = |factor: f64| {
        let line = |line: &str| {
            let cells = line.split(',').enumerate().map(|(i, cell)| {
                let scaled = |value: f64| (factor * value).to_string();
                let is_point = (1..4).contains(&i);
                cell.parse()
                    .ok()
                    .filter(|_| is_point)
                    .map_or(cell.to_owned(), scaled)
            });
            cells.collect::<Vec<_>>().join(",")
        };
        text.lines().map(line).collect::<Vec<_>>().join("\n")
    };
    let units = "Warning: the points extend over ";
    warned("large.csv", &in_units(1e3), "640x480", units);
    warned("small.csv", &in_units(1e-3), "640x480", units);
    let center =
        "Warning: the principal point (319, 239) is far from the centre of images of 1280 x 960";
    warned("sized.csv", &text, "1280x960", center);
    // Repeated rows count once.
    let rows: Vec<&str> = text.lines().skip(1).collect();
    let twice = format!("{}\n{}\n", text.trim_end(), rows.join("\n"));
    let repeated = "Warning: 40 rows repeat others exactly and were ignored";
    let points = warned("twice.csv", &twice, "640x480", repeated);
    assert_eq!(points, 40.0);
}

#[test]
fn warns_of_implausible_square_size() {
    let folder = folder();
    let run =
        "calibrate board data/dioptric --board checkerboard:9x6:60 --model equidistant -o out";
    let run = pardalis(&folder, run).fine();
    let expected =
        "Warning: --board states a side of 60 m for a square of the board: is it in metres?";
    assert!(run.stdout.contains(expected), "{}", run.stdout);
}

#[test]
fn prefers_the_simplest_model_among_equals() {
    let folder = folder();
    let run = "calibrate board data/opencv-stereo/left*.jpg --board checkerboard:9x6:0.025 --model all -o out";
    let run = pardalis(&folder, run).fine();
    assert!(run.stdout.contains("pinhole (best)"), "{}", run.stdout);
    for refused in [
        "unified: does not fit this lens: it is a model for mirrors",
        "perspective_mirror: does not fit this lens: it is a model for mirrors",
    ] {
        assert!(run.stdout.contains(refused), "{}", run.stdout);
    }

    let run = "calibrate board data/opencv-stereo/left*.jpg --board checkerboard:9x6:0.025 --model mei -o mei";
    let run = pardalis(&folder, run).fine();
    let expected = "% only, because other parameters compensate for it";
    assert!(run.stdout.contains(expected), "{}", run.stdout);

    // Extended unified is better by less than 3 % (0.443 px against 0.447 px) with twice as many parameters.
    let run = format!(
        "calibrate points data/dioptric/correspondences.csv --size 640x480 --model extended_unified,equidistant {NOISY} -o points"
    );
    let run = pardalis(&folder, &run).fine();
    assert!(run.stdout.contains("equidistant (best)"), "{}", run.stdout);
    let models = table(&folder, "points/models.csv");
    let held_out = |model| figure(&models, model, "held_out_rms_px");
    let ratio = held_out("equidistant") / held_out("extended_unified");
    assert!((1.0..1.03).contains(&ratio), "{ratio}");

    // On its own, a mirror model reports both possible causes.
    let alone = "calibrate board data/opencv-stereo/left*.jpg --board checkerboard:9x6:0.025 --model unified";
    pardalis(&folder, alone).refused(&[
        "with this model for mirrors the board appears from behind",
        "use a model for a lens if the camera has no mirror, or check whether the images are flipped",
    ]);
}

#[test]
fn reports_and_rejects_a_wrong_image_of_a_rig() {
    let folder = folder();
    for camera in ["left", "right"] {
        fs::create_dir(folder.path().join(camera)).unwrap();
        for number in [1, 2, 3, 4, 5, 6] {
            // The right camera's fourth image was taken at another time.
            let taken = if camera == "right" && number == 4 {
                9
            } else {
                number
            };
            let from = data(&format!("opencv-stereo/{camera}0{taken}.jpg"));
            fs::copy(
                from,
                folder
                    .path()
                    .join(format!("{camera}/{camera}0{number}.jpg")),
            )
            .unwrap();
        }
    }
    let run = "calibrate board --rig left=left --rig right=right --board checkerboard:9x6:0.025 --model pinhole -o out";
    let run = pardalis(&folder, run).fine();
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    for text in [&run.stdout, &page] {
        assert!(text.contains("Rig of 2 cameras in 5 shots"), "{text}");
        let wrong = "left04.jpg with right04.jpg: rejected because the images are not simultaneous";
        assert!(text.contains(wrong), "{text}");
        assert!(!text.contains("corner "), "{text}");
    }
}
