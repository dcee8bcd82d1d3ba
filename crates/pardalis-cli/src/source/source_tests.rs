use std::path::Path;

use tempfile::TempDir;

use super::decode::decode_image;
use super::*;

fn sequence() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/dioptric-jump/frames")
}

fn images(folder: &Path, timing: Timing) -> SourceConfig {
    SourceConfig {
        kind: SourceKind::Images {
            folder: folder.to_owned(),
            timing,
        },
        time_offset_s: 0.0,
        first_frame: 0,
        frame_limit: None,
    }
}

/// A folder with the sequence's frames 0, 1, 3 and 4.
fn broken_sequence() -> TempDir {
    let folder = TempDir::new().expect("a folder");
    for name in ["000000.jpg", "000001.jpg", "000003.jpg", "000004.jpg"] {
        std::fs::copy(sequence().join(name), folder.path().join(name)).expect("copied");
    }
    folder
}

#[test]
fn a_sequence_comes_whole_and_in_order() {
    let config = images(&sequence(), Timing::Fps(25.0));
    let mut source = Source::open(&config).expect("opens");
    assert_eq!(
        (source.size(), source.frame_count()),
        ((640, 480), Some(110))
    );
    assert_eq!(
        source.describe().content,
        "110 images, 000000.jpg to 000109.jpg"
    );
    let mut count = 0;
    for (index, frame) in source.by_ref().enumerate() {
        let frame = frame.expect("a frame");
        assert_eq!(frame.time_s(), index as f64 / 25.0);
        if index % 20 == 3 {
            let image = decode_image(&sequence().join(format!("{index:06}.jpg"))).expect("decodes");
            assert!(frame.bytes() == image.bytes, "frame {index}");
        }
        count += 1;
    }
    assert_eq!(count, 110);
    let counters = source.counters();
    assert_eq!(
        (
            counters.frames,
            counters.repeated_times,
            counters.dropped_late
        ),
        (110, 0, 0)
    );
    assert!(counters.decode_s > 0.0);
    assert!(source.next().is_none(), "an ended source stays ended");
}

#[test]
fn a_part_of_a_sequence_keeps_its_times() {
    let folder = broken_sequence();
    let config = SourceConfig {
        time_offset_s: -0.5,
        first_frame: 1,
        frame_limit: Some(2),
        ..images(folder.path(), Timing::Fps(10.0))
    };
    let mut source = Source::open(&config).expect("opens");
    assert_eq!(source.frame_count(), Some(2));
    let times: Vec<f64> = source
        .by_ref()
        .map(|frame| frame.expect("a frame").time_s())
        .collect();
    assert_eq!(
        times,
        [0.1 - 0.5, 0.3 - 0.5],
        "frame 2 is missing, and leaves a gap"
    );
    let beyond = SourceConfig {
        first_frame: 4,
        ..config
    };
    let error = Source::open(&beyond)
        .err()
        .expect("beyond the end")
        .to_string();
    assert!(error.contains("holds 4 images; allowed: 0 to 3"), "{error}");
}

#[test]
fn repeated_times_are_counted() {
    let folder = broken_sequence();
    std::fs::write(
        folder.path().join("times.csv"),
        "frame,time_s\n0,1\n1,1\n3,2\n4,2\n",
    )
    .expect("written");
    let mut source = Source::open(&images(folder.path(), Timing::TimesFile)).expect("opens");
    assert_eq!(source.by_ref().count(), 4);
    assert_eq!(source.counters().repeated_times, 2);
}

#[test]
fn frames_before_a_broken_one_are_delivered_and_none_after() {
    let folder = broken_sequence();
    let third = folder.path().join("000003.jpg");
    let bytes = std::fs::read(&third).expect("read");
    std::fs::write(&third, &bytes[..bytes.len() / 2]).expect("written");
    let mut source = Source::open(&images(folder.path(), Timing::Fps(25.0))).expect("opens");
    assert!(source.next().is_some_and(|frame| frame.is_ok()));
    assert!(source.next().is_some_and(|frame| frame.is_ok()));
    let error = source
        .next()
        .expect("an error")
        .expect_err("cut off")
        .to_string();
    assert!(
        error.contains("000003.jpg: the file ends before its image does"),
        "{error}"
    );
    assert!(source.next().is_none());
}

#[test]
fn an_image_of_another_size_is_refused() {
    let folder = broken_sequence();
    image::RgbImage::new(320, 240)
        .save(folder.path().join("000002.png"))
        .expect("written");
    let mut source = Source::open(&images(folder.path(), Timing::Fps(25.0))).expect("opens");
    let error = source
        .nth(2)
        .expect("an error")
        .expect_err("another size")
        .to_string();
    assert!(
        error.contains("000002.png: the image is 320 x 240 pixels where"),
        "{error}"
    );
    assert!(error.contains("000000.jpg has 640 x 480"), "{error}");
}

#[test]
fn a_source_dropped_early_stops_its_thread() {
    let mut source = Source::open(&images(&sequence(), Timing::Fps(25.0))).expect("opens");
    assert!(source.next().is_some_and(|frame| frame.is_ok()));
    // Joins the thread, which waits with frames that nobody takes: this must return.
    drop(source);
}

#[test]
fn a_time_offset_that_is_no_number_is_an_error() {
    let config = SourceConfig {
        time_offset_s: f64::NAN,
        ..images(&sequence(), Timing::Fps(25.0))
    };
    let mut source = Source::open(&config).expect("opens");
    let error = source
        .next()
        .expect("an error")
        .expect_err("not a number")
        .to_string();
    assert!(error.contains("time_s is NaN"), "{error}");
}
