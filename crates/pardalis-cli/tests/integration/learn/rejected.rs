//! Frames of videos, and invalid labels, images and options.

use super::*;

/// Asserts that each run fails with the given texts in its message, and leaves an older model intact.
fn assert_refused(folder: &TempDir, runs: &[(&[&str], &[&str], &[&str])]) {
    let path = folder.path().join("m.toml");
    let older = fs::read_to_string(data("colors/orange-ball.hsi.colors.toml")).unwrap();
    fs::write(&path, &older).unwrap();
    for (inputs, options, expected) in runs {
        let message = error_message(folder, &[*inputs, *options, &["-o", "m.toml"]].concat());
        assert_contains(&message, expected);
        let kept = fs::read_to_string(&path).unwrap();
        assert_eq!(kept, older, "{options:?}");
    }
}

const A: &[&str] = &["--image", "a.png"];
const LABELLED_A: &[&str] = &["--image", "a.png", "--mask", "a_mask.png"];

#[test]
fn invalid_labels_are_rejected() {
    let folder = small_images();
    mask(&folder, "small.png", (20, 30), |_, _| 255);
    mask(&folder, "black.png", (40, 30), |_, _| 127);
    assert_refused(
        &folder,
        &[
            (&[], &[], &["no image is given", "--image FILE"]),
            (A, &[], &["--image a.png: nothing is labelled", "--rect"]),
            (
                LABELLED_A,
                &["--image", "b.png"],
                &["--image b.png: nothing is labelled"],
            ),
            (LABELLED_A, A, &["--image a.png is given twice"]),
            (
                &["--frame", "3"],
                LABELLED_A,
                &["--frame 3 comes before any video"],
            ),
            (
                LABELLED_A,
                &["--frame", "3"],
                &["--frame 3 follows labels; put it directly after --image a.png"],
            ),
            (
                A,
                &["--frame", "3", "--rect", "4,6,10,10"],
                &["--image a.png --frame 3: this is a single image; leave --frame out"],
            ),
            (
                A,
                &["--frame", "3", "--frame", "3"],
                &["--image a.png --frame 3 is given twice"],
            ),
            (A, &["--frame", "-1"], &["--frame", "-1", "whole number"]),
            (
                &["--rect", "1,2,3,4"],
                A,
                &["--rect 1,2,3,4 comes before any image"],
            ),
            (
                A,
                &["--rect", "1,2,3"],
                &["--rect", "1,2,3", "X,Y,WIDTH,HEIGHT"],
            ),
            (
                A,
                &["--rect", "-1,2,3,4"],
                &["--rect", "-1,2,3,4", "whole numbers"],
            ),
            (A, &["--rect", "1,2,0,4"], &["1 or more"]),
            (
                A,
                &["--rect", "30,20,11,5"],
                &["a.png", "--rect 30,20,11,5", "40 x 30"],
            ),
            // Two corners.
            (
                A,
                &["--rect", "4,6,14,30"],
                &["--rect 4,6,14,30 exceeds", "give --rect 4,6,10,24"],
            ),
            (A, &["--circle", "9,11,-5"], &["--circle", "R above 0"]),
            (
                A,
                &["--circle", "9,31,5"],
                &["a.png", "--circle 9,31,5 exceeds", "V up to its height"],
            ),
            (
                A,
                &["--polygon", "1,2,3,4"],
                &["--polygon", "three corners"],
            ),
            (
                A,
                &["--polygon", "1,1,5,5,9,9"],
                &["a.png", "no pixel centre"],
            ),
            (
                A,
                &["--polygon", "1,1,50,5,9,9"],
                &["a.png", "exceeds the image"],
            ),
            (
                A,
                &["--mask", "small.png"],
                &["small.png", "20 x 30", "a.png has 40 x 30"],
            ),
            (
                A,
                &["--mask", "black.png"],
                &["black.png", "128 or brighter"],
            ),
            (A, &["--mask", "none.png"], &["none.png"]),
        ],
    );
}

#[test]
fn frames_of_a_video_are_learnt_like_images() {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        eprintln!("not tested: there is no ffmpeg");
        return;
    }
    let folder = TempDir::new().unwrap();
    let clip = data("real-balls/roll/clip.mp4").display().to_string();
    let labels: &[&str] = &[
        "--image",
        &clip,
        "--frame",
        "17",
        "--rect",
        "641,222,98,98",
        "--frame",
        "37",
        "--circle",
        "264.8,261.2,50.6",
        "--frame",
        "44",
        "--rect",
        "75,202,110,110",
    ];
    let text = report(&folder, &[labels, &["-o", "m.toml"]].concat());
    assert_contains(
        &text,
        &[
            "3 images",
            "clip.mp4 37",
            "The detector finds the ball in 3 of 3",
            "mosaic.png",
        ],
    );
    assert!(!text.contains("The labels are"), "{text}");

    fs::write(folder.path().join("clip.mp4"), "no video").unwrap();
    let rect: &[&str] = &["--rect", "1,1,9,9"];
    assert_refused(
        &folder,
        &[
            (
                &["--image", &clip, "--frame", "51"],
                rect,
                &["--frame 51: ", "the video has 51 frames; allowed: 0 to 50"],
            ),
            (
                &["--image", &clip],
                rect,
                &[
                    "clip.mp4: this is not a JPEG or PNG image",
                    "--frame NUMBER",
                ],
            ),
            (
                &["--image", "clip.mp4", "--frame", "0"],
                rect,
                &["clip.mp4", "cannot open it"],
            ),
            (
                &["--image", "none.mp4", "--frame", "0"],
                rect,
                &["none.mp4"],
            ),
            (
                &["--image", &clip, "--frame", "0", "--frame", "1"],
                rect,
                &["clip.mp4 --frame 0: nothing is labelled"],
            ),
            (
                &[
                    "--image", &clip, "--frame", "4", "--rect", "1,1,9,9", "--frame", "4",
                ],
                rect,
                &["clip.mp4 --frame 4 is given twice"],
            ),
        ],
    );
}

#[test]
fn invalid_images_are_rejected() {
    let folder = small_images();
    let whole = fs::read(folder.path().join("a.png")).unwrap();
    fs::write(folder.path().join("text.jpg"), "no image").unwrap();
    fs::write(folder.path().join("a.bmp"), "BM no image").unwrap();
    fs::write(folder.path().join("cut.png"), &whole[..whole.len() / 2]).unwrap();
    let rect: &[&str] = &["--rect", "1,1,2,2"];
    assert_refused(
        &folder,
        &[
            (&["--image", "none.jpg"], rect, &["none.jpg"]),
            (
                &["--image", "text.jpg"],
                rect,
                &["text.jpg", "not a JPEG or PNG"],
            ),
            (&["--image", "cut.png"], rect, &["cut.png", "cut off"]),
            (
                &["--image", "a.bmp"],
                rect,
                &["a.bmp: this is a BMP image", "convert it", "ffmpeg -i"],
            ),
            (&["."], &[], &["--masks"]),
            (
                &[".", "--masks", "_mask.png"],
                LABELLED_A,
                &["cannot be used with"],
            ),
            (
                &["a.png", "--masks", "_mask.png"],
                &[],
                &["a.png", "cannot be read"],
            ),
        ],
    );
}

#[test]
fn only_models_are_replaced() {
    let folder = small_images();
    let scene = "[cameras.cam1]\nimages = \"a\"\n";
    fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let message = error_message(&folder, &[LABELLED_A, &["-o", "scene.toml"]].concat());
    let expected = "--output scene.toml: exists and holds no colour model; choose another name";
    assert_contains(&message, &[expected]);
    let kept = fs::read_to_string(folder.path().join("scene.toml")).unwrap();
    assert_eq!(kept, scene);
}

#[test]
fn invalid_options_are_rejected() {
    let folder = small_images();
    assert_refused(
        &folder,
        &[
            (
                LABELLED_A,
                &["--bins", "12,12"],
                &["--bins has 2 numbers", "12,12,4"],
            ),
            (
                LABELLED_A,
                &["--bins", "0,12,4"],
                &["--bins", "hue", "1 to 64"],
            ),
            (
                LABELLED_A,
                &["--bins", "64,64,64"],
                &["--bins", "bins in all"],
            ),
            (
                LABELLED_A,
                &["--palette", "rgb", "--bins", "4,4,4"],
                &["--palette rgb: one"],
            ),
            (LABELLED_A, &["--palette", "lab"], &["hsi", "yuv", "rgb"]),
            (
                LABELLED_A,
                &["--yuv-range", "full"],
                &["--yuv-range requires --palette yuv"],
            ),
            (
                LABELLED_A,
                &["--pictures", "p", "--no-pictures"],
                &["cannot be used with"],
            ),
            (
                LABELLED_A,
                &["--pictures", "a.png"],
                &["--pictures a.png", "--no-pictures"],
            ),
        ],
    );
    let image = fs::read(folder.path().join("a.png")).unwrap();
    fs::create_dir(folder.path().join("folder.toml")).unwrap();
    for (output, expected) in [
        ("a.png", "ending in .toml"),
        ("folder.toml", "this is a folder"),
        ("nowhere/m.toml", "the folder nowhere does not exist"),
    ] {
        let message = error_message(&folder, &[LABELLED_A, &["-o", output]].concat());
        assert_contains(&message, &[output, expected]);
    }
    assert_eq!(fs::read(folder.path().join("a.png")).unwrap(), image);
}
