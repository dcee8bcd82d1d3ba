use std::path::Path;

use tempfile::TempDir;

use super::decode::decode_image;
use super::*;
use pardalis_images::{JpegSampling, RgbImage, encode_jpeg};
use pardalis_scene::FrameRange;

/// Creates a folder of JPEG images of 160 x 120 pixels, in which a bright square moves.
fn sequence(indices: impl IntoIterator<Item = u32>) -> TempDir {
    let folder = TempDir::new().expect("a folder");
    for index in indices {
        let image = RgbImage::from_fn(160, 120, |x, y| {
            if (index..index + 20).contains(&x) && (50..70).contains(&y) {
                [230, 110, 20]
            } else {
                [(x * y % 90) as u8, x as u8, y as u8]
            }
        });
        let bytes = encode_jpeg(&image, 90, JpegSampling::Automatic).expect("encoded");
        std::fs::write(folder.path().join(format!("{index:06}.jpg")), bytes).expect("written");
    }
    folder
}

fn images(folder: &Path, timing: Timing) -> SourceConfig {
    SourceConfig {
        kind: SourceKind::Images {
            folder: folder.to_owned(),
            timing,
        },
        time_offset_s: 0.0,
        frames: FrameRange::ALL,
    }
}

/// Creates a folder with the frames 0, 1, 3 and 4.
fn broken_sequence() -> TempDir {
    sequence([0, 1, 3, 4])
}

/// Returns the next frame and its arrival.
fn next_frame(source: &mut Source) -> (Frame, f64) {
    match source.next() {
        Some(Ok(Delivery::Frame { frame, arrival_s })) => (frame, arrival_s),
        other => panic!("no frame: {other:?}"),
    }
}

/// Returns the reason why the next image cannot be used.
fn next_broken(source: &mut Source) -> String {
    match source.next() {
        Some(Ok(Delivery::Broken(why))) => why.to_string(),
        other => panic!("not broken: {other:?}"),
    }
}

#[test]
fn a_sequence_is_complete_and_in_order() {
    let folder = sequence(0..110);
    let config = images(folder.path(), Timing::Fps(25.0));
    let mut source = Source::open(&config).expect("opens");
    assert_eq!(
        (source.size(), source.frame_count()),
        ((160, 120), Some(110))
    );
    assert_eq!(
        source.describe().content,
        "110 images, 000000.jpg to 000109.jpg"
    );
    let span = source.span().expect("known before");
    assert_eq!((span.first_s, span.last_s), (0.0, 109.0 / 25.0));
    for index in 0..110 {
        let (frame, arrival_s) = next_frame(&mut source);
        let time_s = index as f64 / 25.0;
        assert_eq!((frame.time_s(), arrival_s), (time_s, time_s));
        if index % 20 == 3 {
            let image =
                decode_image(&folder.path().join(format!("{index:06}.jpg"))).expect("decodes");
            assert!(frame.bytes() == image.as_raw(), "frame {index}");
        }
    }
    assert!(source.next().is_none() && source.next().is_none());
    assert!(source.counters().decode_s > 0.0);
}

#[test]
fn a_range_of_a_sequence_keeps_its_times() {
    let folder = broken_sequence();
    let config = SourceConfig {
        time_offset_s: -0.5,
        frames: FrameRange {
            first: 1,
            step: 2,
            limit: Some(2),
        },
        ..images(folder.path(), Timing::Fps(10.0))
    };
    let mut source = Source::open(&config).expect("opens");
    assert_eq!(source.frame_count(), Some(2));
    assert_eq!(source.first_time_s(), Some(0.1 - 0.5));
    let times_s = [(); 2].map(|()| next_frame(&mut source).0.time_s());
    let wanted_s = [0.1 - 0.5, 0.4 - 0.5];
    assert_eq!(times_s, wanted_s, "frame 2 is missing and leaves a gap");
    assert!(source.next().is_none());
    let beyond = SourceConfig {
        frames: FrameRange {
            first: 4,
            ..FrameRange::ALL
        },
        ..config
    };
    let error = Source::open(&beyond)
        .err()
        .expect("beyond the end")
        .to_string();
    assert!(error.contains("holds 4 images; allowed: 0 to 3"), "{error}");
}

#[test]
fn frames_arrive_at_recorded_times_or_at_their_stamps() {
    let folder = broken_sequence();
    let arrivals_s = |times: &str| {
        std::fs::write(folder.path().join("times.csv"), times).expect("written");
        let config = SourceConfig {
            time_offset_s: 10.0,
            ..images(folder.path(), Timing::TimesFile)
        };
        let mut source = Source::open(&config).expect("opens");
        [(); 4].map(|()| {
            let (frame, arrival_s) = next_frame(&mut source);
            (frame.time_s(), arrival_s)
        })
    };
    // Stamps may decrease; frames are delivered in order of their numbers.
    let wanted = [(11.0, 11.0), (12.0, 12.0), (11.5, 12.0), (13.0, 13.0)];
    assert_eq!(arrivals_s("frame,time_s\n0,1\n1,2\n3,1.5\n4,3\n"), wanted);
    // The camera's time offset does not shift arrival times, which determine the order.
    let wanted = [(11.0, 11.25), (13.0, 12.5), (14.0, 12.5), (12.0, 20.0)];
    assert_eq!(
        arrivals_s("frame,time_s,arrival_s\n0,1,11.25\n1,2,20\n3,3,12.5\n4,4,12.5\n"),
        wanted
    );
}

#[test]
fn broken_images_and_images_of_another_size_are_skipped() {
    let folder = broken_sequence();
    let third = folder.path().join("000003.jpg");
    let bytes = std::fs::read(&third).expect("read");
    std::fs::write(&third, &bytes[..bytes.len() / 2]).expect("written");
    std::fs::write(folder.path().join("000000.jpg"), "no image").expect("written");
    let small = pardalis_images::encode_png(&RgbImage::new(80, 60));
    std::fs::write(folder.path().join("000002.png"), small.expect("encoded")).expect("written");
    let mut source = Source::open(&images(folder.path(), Timing::Fps(25.0))).expect("opens");
    assert_eq!(
        source.size(),
        (160, 120),
        "of the first image that has a header"
    );
    let first = next_broken(&mut source);
    assert!(first.contains("000000.jpg"), "{first}");
    assert_eq!(next_frame(&mut source).0.time_s(), 1.0 / 25.0);
    let small = next_broken(&mut source);
    assert!(
        small.contains("000002.png: the image is 80 x 60 pixels where"),
        "{small}"
    );
    assert!(small.contains("000001.jpg has 160 x 120"), "{small}");
    let cut = next_broken(&mut source);
    assert!(
        cut.contains("000003.jpg: the file ends before its image does"),
        "{cut}"
    );
    assert_eq!(next_frame(&mut source).0.time_s(), 4.0 / 25.0);
    assert!(source.next().is_none());
}

#[test]
fn a_source_dropped_early_stops_its_thread() {
    let folder = sequence(0..110);
    let mut source = Source::open(&images(folder.path(), Timing::Fps(25.0))).expect("opens");
    next_frame(&mut source);
    // Joins the thread, which is blocked with frames that nothing receives: this must return.
    drop(source);
}

#[test]
fn a_time_offset_that_is_not_a_number_is_an_error() {
    let folder = sequence([0]);
    let config = SourceConfig {
        time_offset_s: f64::NAN,
        ..images(folder.path(), Timing::Fps(25.0))
    };
    let mut source = Source::open(&config).expect("opens");
    let error = source
        .next()
        .expect("an error")
        .expect_err("not a number")
        .to_string();
    assert!(error.contains("time_s is NaN"), "{error}");
}
