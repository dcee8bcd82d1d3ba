//! `pardalis learn` on the labelled images of the repository, and on invalid input.

mod judgement;
mod rejected;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use pardalis::color::{ColorModel, Palette};
use pardalis_images::{
    GrayImage, JpegSampling, RgbImage, decode, decode_grey, encode_jpeg, encode_png,
};
use tempfile::TempDir;

/// Returns a folder of the repository's data.
fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(name)
}

/// Runs the command in a folder.
fn learn(folder: &TempDir, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pardalis"))
        .current_dir(folder)
        .arg("learn")
        .args(arguments)
        .output()
        .unwrap()
}

/// Returns the output of a run that must succeed.
fn report(folder: &TempDir, arguments: &[&str]) -> String {
    let output = learn(folder, arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(message.is_empty(), "{message}");
    String::from_utf8(output.stdout).unwrap()
}

/// Returns the message of a run that must end with exit code 2.
fn error_message(folder: &TempDir, arguments: &[&str]) -> String {
    let output = learn(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(output.stdout.is_empty());
    message
}

fn model(folder: &TempDir, name: &str) -> ColorModel {
    ColorModel::from_text(&fs::read_to_string(folder.path().join(name)).unwrap()).unwrap()
}

fn assert_contains(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "\"{part}\" is not in: {text}");
    }
}

const ORANGE: [u8; 3] = [230, 110, 20];
const GREEN: [u8; 3] = [40, 90, 40];
const BLUE: [u8; 3] = [20, 40, 220];

/// Creates a folder of small images: `a.png` and `b.png`, green with an orange square of 10 x 10 pixels at
/// 4,6 and, in `b.png`, a blue one at 20,6; and `a_mask.png` of the orange square.
fn small_images() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let within = |x: u32, y: u32, left: u32| (left..left + 10).contains(&x) && (6..16).contains(&y);
    let save = |name: &str, with_blue: bool| {
        let image = RgbImage::from_fn(40, 30, |x, y| match (within(x, y, 4), within(x, y, 20)) {
            (true, _) => ORANGE,
            (_, true) if with_blue => BLUE,
            _ => GREEN,
        });
        fs::write(folder.path().join(name), encode_png(&image).unwrap()).unwrap();
    };
    save("a.png", false);
    save("b.png", true);
    mask(&folder, "a_mask.png", (40, 30), |x, y| {
        if within(x, y, 4) { 128 } else { 127 }
    });
    folder
}

fn mask(folder: &TempDir, name: &str, size: (u32, u32), grey: impl Fn(u32, u32) -> u8) {
    let mask = GrayImage::from_fn(size.0, size.1, |x, y| [grey(x, y)]);
    fs::write(folder.path().join(name), encode_png(&mask).unwrap()).unwrap();
}

#[test]
fn a_folder_with_masks_is_learnt_and_the_model_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let training = data("training/dioptric");
    let arguments = [
        training.to_str().unwrap(),
        "--masks",
        "_ball_mask.png",
        "-o",
        "orange.colors.toml",
    ];
    let text = report(&folder, &arguments);
    assert_contains(
        &text,
        &[
            "1732 pixels",
            "6 images",
            "hue, saturation, intensity",
            "Good",
            "Bhattacharyya",
            "000.jpg",
            "The detector finds the ball in 6 of 6 of these images",
            "orange-learnt",
        ],
    );
    assert!(!text.contains("bad label"), "{text}");

    let masks = (0..6).map(|i| {
        decode_grey(&fs::read(training.join(format!("00{i}_ball_mask.png"))).unwrap()).unwrap()
    });
    let labelled: usize = masks
        .map(|m| m.pixels().filter(|p| p[0] >= 128).count())
        .sum();
    let model = model(&folder, "orange.colors.toml");
    assert_eq!(
        (model.pixel_count(), model.image_count()),
        (labelled as u64, 6)
    );
    assert_eq!(model.palette(), Palette::HSI);
    let shares = model.histogram().shares();
    let top = (0..shares.len())
        .max_by(|&a, &b| shares[a].total_cmp(&shares[b]))
        .unwrap();
    assert_eq!(
        model.palette().channels_of_bin(top as u16)[0],
        0,
        "orange is in the first of twelve bins of hue"
    );

    let pictures = folder.path().join("orange-learnt");
    for name in ["histogram.png", "mosaic.png"] {
        let picture = decode(&fs::read(pictures.join(name)).unwrap()).unwrap();
        assert!(picture.width() > 800, "{name}");
        let is_magenta = |p: &[u8; 3]| *p == [255, 0, 255];
        let found = picture.pixels().filter(is_magenta).count();
        // Six circles, each about 110 px wide.
        assert!(name != "mosaic.png" || found > 6 * 300, "{found}");
    }
    assert!(pictures.join("histogram.svg").is_file());
    // There are no other files, and a second run gives the same bytes.
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
    let first = fs::read(folder.path().join("orange.colors.toml")).unwrap();
    assert_eq!(report(&folder, &arguments), text);
    assert_eq!(
        fs::read(folder.path().join("orange.colors.toml")).unwrap(),
        first
    );
}

#[test]
fn bundled_models_are_reproduced_from_their_images() {
    let folder = tempfile::tempdir().unwrap();
    for (images, masks, palette, kept) in [
        ("dioptric", "_ball_mask.png", "hsi", "orange-ball.hsi"),
        ("dioptric", "_ball_mask.png", "yuv", "orange-ball.yuv"),
        ("plane", "_landmark_red_mask.png", "hsi", "landmark-red"),
    ] {
        let training = data("training").join(images);
        let arguments = [
            training.to_str().unwrap(),
            "--masks",
            masks,
            "--palette",
            palette,
            "--no-pictures",
            "-o",
            "m.toml",
        ];
        report(&folder, &arguments);
        let kept = data("colors").join(format!("{kept}.colors.toml"));
        let learnt = fs::read_to_string(folder.path().join("m.toml")).unwrap();
        assert_eq!(
            fs::read_to_string(kept).unwrap().replace("\r\n", "\n"),
            learnt
        );
    }
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1, "no pictures");
}

#[test]
fn ranges_of_hue_and_saturation_are_learnt_reported_and_stored() {
    let folder = TempDir::new().unwrap();
    let images = data("training/webcam").display().to_string();
    let arguments = [
        &*images,
        "--masks",
        "_ball_mask.png",
        "--no-pictures",
        "-o",
        "pink.toml",
    ];
    let text = report(&folder, &arguments);
    assert_contains(
        &text,
        &[
            "Ranges for the window cue: hue 335 to 6 degrees",
            "of the target's pixels lie in them",
        ],
    );
    let ranges = model(&folder, "pink.toml").ranges().unwrap();
    assert!(ranges.contain_rgb([200.0, 75.0, 100.0]), "{ranges:?}");
    assert!(
        !ranges.contain_rgb([150.0, 120.0, 90.0]),
        "a desk: {ranges:?}"
    );
    // Grey has no hue.
    let grey = RgbImage::from_pixel(20, 20, [128; 3]);
    fs::write(folder.path().join("grey.png"), encode_png(&grey).unwrap()).unwrap();
    let text = report(
        &folder,
        &[
            "--image",
            "grey.png",
            "--rect",
            "2,2,9,9",
            "--no-pictures",
            "-o",
            "grey.toml",
        ],
    );
    assert_contains(&text, &["The target has no colour"]);
    assert_eq!(model(&folder, "grey.toml").ranges(), None);
}

#[test]
fn labels_apply_to_the_preceding_image_and_are_united() {
    let folder = small_images();
    let pixels = |arguments: &[&str]| {
        report(
            &folder,
            &[arguments, &["-o", "m.toml", "--no-pictures"]].concat(),
        );
        let model = model(&folder, "m.toml");
        (model.pixel_count(), model.image_count())
    };
    assert_eq!(
        pixels(&["--image", "a.png", "--mask", "a_mask.png"]),
        (100, 1)
    );
    assert_eq!(
        pixels(&["--image", "a.png", "--rect", "4,6,10,10"]),
        (100, 1)
    );
    assert_eq!(
        pixels(&["--image", "a.png", "--polygon", "4,6,14,6,14,16,4,16"]),
        (100, 1)
    );
    // Pixels whose centres are within 4.9 of 8.5,10.5.
    assert_eq!(
        pixels(&["--image", "a.png", "--circle", "8.5,10.5,4.9"]),
        (76, 1)
    );
    let overlapping = [
        "--rect",
        "4,6,5,10",
        "--polygon",
        "7,6,14,6,14,16,7,16",
        "--mask",
        "a_mask.png",
    ];
    assert_eq!(
        pixels(&[&["--image", "a.png"][..], &overlapping].concat()),
        (100, 1)
    );
    let both = [
        "--image",
        "b.png",
        "--rect",
        "4,6,3,3",
        "--image",
        "a.png",
        "--rect=4,6,2,2",
        "--rect",
        "10,10,1,1",
    ];
    assert_eq!(pixels(&both), (14, 2));
    // Only the orange square was labelled, and in the right image.
    let model = model(&folder, "m.toml");
    assert_eq!(
        model.count_of(Palette::HSI.bin_of_rgb([230.0, 110.0, 20.0])),
        14
    );
}

#[test]
fn boxes_around_balls_teach_the_colours_that_masks_teach_but_no_edge() {
    let folder = TempDir::new().unwrap();
    let training = data("training/dioptric");
    let folder_of_masks = training.display().to_string();
    let by_masks = [&*folder_of_masks, "--masks", "_ball_mask.png"];
    let written = ["--no-pictures", "-o", "m.toml"];
    let text = report(&folder, &[&by_masks[..], &written].concat());
    assert!(!text.contains("Boxes"), "{text}");
    let masks = model(&folder, "m.toml");

    let labels: Vec<[String; 2]> = (0..6)
        .map(|i| {
            let mask = fs::read(training.join(format!("00{i}_ball_mask.png"))).unwrap();
            let mask = decode_grey(&mask).unwrap();
            let bright = |&(x, y): &(u32, u32)| mask.get_pixel(x, y)[0] >= 128;
            let all = || (0..mask.height()).flat_map(|y| (0..mask.width()).map(move |x| (x, y)));
            let range = |axis: fn((u32, u32)) -> u32| {
                let along = || all().filter(bright).map(axis);
                (along().min().unwrap(), along().max().unwrap() + 1)
            };
            let ((left, right), (top, bottom)) = (range(|p| p.0), range(|p| p.1));
            let image = training.join(format!("00{i}.jpg")).display().to_string();
            [
                image,
                format!("{left},{top},{},{}", right - left, bottom - top),
            ]
        })
        .collect();
    let labels = labels
        .iter()
        .flat_map(|[image, rect]| ["--image", image, "--rect", rect]);
    let text = report(&folder, &labels.chain(written).collect::<Vec<_>>());
    assert_contains(
        &text,
        &["Boxes around the target in 6 images (000.jpg, ", "Good"],
    );
    let boxes = model(&folder, "m.toml");
    let ratio = boxes.pixel_count() as f64 / masks.pixel_count() as f64;
    // A pixel more on one side is 5 %.
    assert!((ratio - 1.0).abs() < 0.08, "{ratio}");
    let similarity = boxes.histogram().similarity(masks.histogram());
    // With the corners, a fifth of the pixels would be background: at most √0.79.
    assert!(similarity > 0.96, "{similarity}");
    assert!(boxes.body().is_some() && masks.body().is_some());
    assert!(boxes.edges().is_empty() && !masks.edges().is_empty());
}

#[test]
fn palettes_and_bins_are_selectable() {
    let folder = small_images();
    for (options, expected) in [
        (
            &["--bins", "8,4,2"][..],
            Palette::Hsi {
                hue_bins: 8,
                saturation_bins: 4,
                intensity_bins: 2,
            },
        ),
        (&["--palette", "yuv"], Palette::YUV),
        (
            &["--palette", "rgb", "--bins", "16"],
            Palette::Rgb { channel_bins: 16 },
        ),
    ] {
        let label = [
            "--image",
            "a.png",
            "--mask",
            "a_mask.png",
            "-o",
            "m.toml",
            "--no-pictures",
        ];
        report(&folder, &[&label[..], options].concat());
        assert_eq!(model(&folder, "m.toml").palette(), expected);
    }
    let arguments = [
        "--image",
        "a.png",
        "--mask",
        "a_mask.png",
        "-o",
        "m.toml",
        "--no-pictures",
        "--palette",
        "yuv",
        "--bins",
        "4,4,4",
        "--yuv-matrix",
        "bt709",
        "--yuv-range",
        "limited",
    ];
    report(&folder, &arguments);
    let text = fs::read_to_string(folder.path().join("m.toml")).unwrap();
    assert_contains(
        &text,
        &["y_bins = 4", "matrix = \"bt709\"", "range = \"limited\""],
    );
}

#[test]
fn images_without_masks_are_listed_and_folders_without_masks_rejected() {
    let folder = small_images();
    let text = report(
        &folder,
        &[".", "--masks", "_mask.png", "-o", "m.toml", "--no-pictures"],
    );
    assert_contains(&text, &["1 image (b.png)", "100 pixels"]);
    let message = error_message(&folder, &[".", "--masks", "_ball.png", "-o", "m.toml"]);
    assert_contains(
        &message,
        &["no mask for any of its 3 images", "a_ball.png", "--masks"],
    );
    fs::create_dir(folder.path().join("empty")).unwrap();
    let message = error_message(&folder, &["empty", "--masks", "_ball.png", "-o", "m.toml"]);
    assert_contains(&message, &["empty", "contains no images"]);
    let message = error_message(
        &folder,
        &["nowhere", "--masks", "_ball.png", "-o", "m.toml"],
    );
    assert_contains(&message, &["nowhere", "cannot be read"]);
}

#[test]
fn images_are_labelled_upright_as_programs_show_them() {
    let folder = small_images();
    let upright = decode(&fs::read(folder.path().join("a.png")).unwrap()).unwrap();
    // Turned to the left, as a camera that is held on its side stores it: its EXIF data state to turn it to the right.
    let stored = RgbImage::from_fn(30, 40, |x, y| upright.get_pixel(39 - y, x));
    let plain = encode_jpeg(&stored, 100, JpegSampling::Automatic).unwrap();
    let exif =
        b"\xFF\xE1\x00\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let turned = [&plain[..2], exif, &plain[2..]].concat();
    fs::write(folder.path().join("turned.jpg"), turned).unwrap();
    let learnt = |image: &str, mask: &str| {
        let arguments = ["--image", image, "--mask", mask, "--no-pictures"];
        report(&folder, &[&arguments[..], &["-o", "m.toml"]].concat())
    };
    let text = learnt("turned.jpg", "a_mask.png");
    assert_contains(
        &text,
        &["100 pixels", "100.0 %   of the target's pixels are found"],
    );
    assert_contains(&text, &["0.0 %   of the background is mistaken"]);
}
