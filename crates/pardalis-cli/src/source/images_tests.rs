use tempfile::TempDir;

use super::*;
use pardalis_scene::FrameRange;

fn folder_with(names: &[&str]) -> TempDir {
    let folder = TempDir::new().expect("a folder");
    for name in names {
        std::fs::write(folder.path().join(name), b"").expect("written");
    }
    folder
}

fn listed(folder: &TempDir) -> Vec<(String, u64)> {
    let images = list_images(folder.path()).expect("a list");
    images
        .into_iter()
        .map(|(path, index)| (file_name(&path), index))
        .collect()
}

fn named(names: &[(&str, u64)]) -> Vec<(String, u64)> {
    names
        .iter()
        .map(|&(name, index)| (name.to_owned(), index))
        .collect()
}

#[test]
fn numbers_are_indices_in_time_with_gaps() {
    let folder = folder_with(&[
        "f9.jpg",
        "f10.JPG",
        "f012.Jpeg",
        "f11.png.txt",
        "notes.txt",
        "._f13.jpg",
    ]);
    std::fs::create_dir(folder.path().join("f14.jpg")).expect("a folder");
    assert_eq!(
        listed(&folder),
        named(&[
            ("f9.jpg", 0),
            ("f10.JPG", 1),
            ("f012.Jpeg", 3),
            ("f14.jpg", 5)
        ])
    );
}

#[test]
fn names_without_final_numbers_are_in_natural_order() {
    let folder = folder_with(&["b10x.png", "b2x.png", "a.png", "b2.png"]);
    let order = [("a.png", 0), ("b2.png", 1), ("b2x.png", 2), ("b10x.png", 3)];
    assert_eq!(listed(&folder), named(&order));
}

#[test]
fn overflowing_numbers_are_still_sorted() {
    let folder = folder_with(&["30000000000000000000.png", "200000000000000000000.png"]);
    let order = [
        ("30000000000000000000.png", 0),
        ("200000000000000000000.png", 1),
    ];
    assert_eq!(listed(&folder), named(&order));
}

fn error_of(folder: &Path, timing: &Timing) -> String {
    match ImageFrames::open(folder, timing, FrameRange::ALL) {
        Ok(_) => panic!("the folder was taken"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn unreadable_folders_are_named_in_errors() {
    let fps = Timing::Fps(25.0);
    let missing = error_of(Path::new("/nonexistent/frames"), &fps);
    assert!(
        missing.contains("/nonexistent/frames: the folder cannot be read"),
        "{missing}"
    );
    let empty = error_of(folder_with(&[]).path(), &fps);
    assert!(empty.contains("holds no images"), "{empty}");
    let others = error_of(folder_with(&["a.txt"]).path(), &fps);
    assert!(others.contains(".jpg, .jpeg or .png"), "{others}");
    let folder = folder_with(&["a1.jpg", "a.txt"]);
    let file = error_of(&folder.path().join("a.txt"), &fps);
    assert!(file.contains("this is a file, but no image"), "{file}");
    // One image is a folder of one.
    let image = error_of(&folder.path().join("a1.jpg"), &fps);
    assert!(image.contains("a1.jpg: the file is empty"), "{image}");
    let twice = error_of(folder_with(&["a1.jpg", "b01.png"]).path(), &fps);
    assert!(
        twice.contains("a1.jpg and b01.png have the same number, 1"),
        "{twice}"
    );
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = error_of(folder.path(), &Timing::Fps(rate));
        assert!(error.contains("fps is"), "{error}");
    }
}

#[test]
fn invalid_times_are_rejected_with_their_line() {
    for (text, expected) in [
        ("frame,time_s\n0,0\n1,0.1\n", "no row for frame 2 (a5.jpg)"),
        (
            "frame,time_s\n0,0\n1,0.1\n1,0.2\n",
            "line 4: frame 1 occurs twice",
        ),
        (
            "frame,time_s\n0,0\n2,0.1\n1,0.2\n",
            "line 4: frame 1 follows frame 2",
        ),
        ("frame,time_s\n0,0\n1,nan\n", "line 3: time_s is \"nan\""),
        ("frame,time_s\n0,inf\n", "line 2: time_s is \"inf\""),
        (
            "frame,time_s,arrival_s\n0,1,soon\n",
            "line 2: arrival_s is \"soon\"",
        ),
        ("frame,time_s\n0,1\n-1,2\n", "line 3: frame is \"-1\""),
        (
            "frame,time_s\n0,1\n1\n",
            "line 3: 1 values, and the header names 2 columns",
        ),
        (
            "frame,time_s\n0,1\n1,2,5\n",
            "line 3: 3 values, and the header names 2 columns; times have decimal points, not commas",
        ),
        (
            "frame;time_s\n0;1\n",
            "line 1: there is no column frame; the header must be frame,time_s or frame,time_s,arrival_s, with commas between",
        ),
        ("frame,time\n0,1\n", "line 1: there is no column time_s"),
        ("", "line 1: there is no column frame"),
        (
            "frame,time_s\n0,0\n1,0.1\n2,0.2\n3,0.3\n",
            "has times up to frame 3, but the last image, a5.jpg, is frame 2",
        ),
        ("frame,time_s\n\u{0},x\n", "line 2: frame is"),
    ] {
        let folder = folder_with(&["a3.jpg", "a4.jpg", "a5.jpg"]);
        std::fs::write(folder.path().join("times.csv"), text).expect("written");
        let error = error_of(folder.path(), &Timing::TimesFile);
        assert!(error.contains("times.csv"), "{error}");
        assert!(error.contains(expected), "{expected}: {error}");
    }
    let error = error_of(folder_with(&["a3.jpg"]).path(), &Timing::TimesFile);
    assert!(error.contains("times.csv: cannot be read"), "{error}");
}

#[test]
fn times_of_missing_images_are_skipped_and_equal_times_kept() {
    let folder = folder_with(&["a3.jpg", "a5.jpg", "a6.jpg"]);
    let text = "\u{feff}frame,time_s,note\r\n0, 10.5,x\r\n1,10.6,x\r\n2,11,x\r\n3,11,x\r\n";
    std::fs::write(folder.path().join("times.csv"), text).expect("written");
    let files = list_images(folder.path()).expect("a list");
    let times = with_times(folder.path(), files, &Timing::TimesFile).expect("times");
    let times: Vec<f64> = times.into_iter().map(|(_, times)| times.time_s).collect();
    assert_eq!(times, [10.5, 11.0, 11.0]);
}
