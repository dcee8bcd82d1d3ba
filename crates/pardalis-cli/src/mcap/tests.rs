//! Recordings that are damaged anywhere. Those of other programs are read in the tests of the Python package.

use std::collections::BTreeMap;
use std::io::Cursor;

use foxglove::Encode;
use foxglove::messages::{CameraCalibration, RawImage, Timestamp};
use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use pardalis_core::rng::philox4x32_10;
use pardalis_scene::FrameRange;

use super::{Images, calibrations};

/// Returns a recording of three images of 6 x 4 pixels, each with a calibration.
fn recording(compression: Option<Compression>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let options = WriteOptions::new().compression(compression);
    let mut writer = options
        .chunk_size(Some(100))
        .create(Cursor::new(&mut bytes))
        .unwrap();
    let mut channels = BTreeMap::new();
    let mut write = |topic: &str, schema: foxglove::Schema, data: &[u8], log_time: u64| {
        let channel_id = *channels.entry(topic.to_owned()).or_insert_with(|| {
            let schema = writer
                .add_schema(&schema.name, &schema.encoding, &schema.data)
                .unwrap();
            writer
                .add_channel(schema, topic, "protobuf", &BTreeMap::new())
                .unwrap()
        });
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time,
            publish_time: log_time,
        };
        writer.write_to_known_channel(&header, data).unwrap();
    };
    for number in 0..3_u8 {
        let time_ns = 1_000_000_000 * u64::from(number + 1);
        let image = RawImage {
            timestamp: Some(Timestamp::new(u32::from(number) + 1, 0)),
            frame_id: "cam".to_owned(),
            width: 6,
            height: 4,
            encoding: "rgb8".to_owned(),
            step: 20,
            data: vec![number; 80].into(),
        };
        let mut data = Vec::new();
        image.encode(&mut data).unwrap();
        write(
            "/cam/image",
            RawImage::get_schema().unwrap(),
            &data,
            time_ns,
        );
        let calibration = CameraCalibration {
            width: 6,
            height: 4,
            distortion_model: "kannala_brandt".to_owned(),
            d: vec![0.0; 4],
            k: vec![5.0, 0.0, 2.5, 0.0, 5.0, 1.5, 0.0, 0.0, 1.0],
            ..CameraCalibration::default()
        };
        let mut data = Vec::new();
        calibration.encode(&mut data).unwrap();
        let schema = CameraCalibration::get_schema().unwrap();
        write("/cam/calibration", schema, &data, time_ns);
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

/// Reads everything in a recording. Returns the number of images, and all errors.
fn read(bytes: &[u8]) -> (usize, Vec<String>) {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("rec.mcap");
    std::fs::write(&path, bytes).unwrap();
    let mut errors = match calibrations(&path, None) {
        Ok((_, problems)) => problems,
        Err(error) => vec![error],
    };
    let mut count = 0;
    match Images::open(&path, None, FrameRange::ALL) {
        Err(error) => errors.push(format!("{error:#}")),
        Ok(images) => {
            let (size_px, format) = images.format();
            let length = format.byte_count(size_px.0, size_px.1);
            for image in images {
                match image.and_then(|image| image) {
                    Ok(image) => {
                        assert_eq!(image.bytes.len(), length);
                        count += 1;
                    }
                    Err(error) => errors.push(format!("{error:#}")),
                }
            }
        }
    }
    (count, errors)
}

#[test]
fn recordings_with_any_compression_are_read() {
    for compression in [None, Some(Compression::Lz4), Some(Compression::Zstd)] {
        assert_eq!(read(&recording(compression)), (3, Vec::new()));
    }
}

#[test]
fn damaged_recordings_give_errors_that_name_the_file() {
    let whole = recording(None);
    let mut seen = [0; 2];
    for run in 0..400_u32 {
        let draws = philox4x32_10([run, 0, 0, 0], [1, 0]);
        let at = |draw: u32| draw as usize % whole.len();
        let mut damaged = whole.clone();
        match draws[0] % 3 {
            0 => damaged.truncate(at(draws[1])),
            1 => damaged[at(draws[1])] = draws[2] as u8,
            _ => {
                let part = whole[at(draws[1])..].iter().take(20).copied();
                let place = at(draws[2]);
                damaged.splice(place..place, part.collect::<Vec<_>>());
            }
        }
        let (count, errors) = read(&damaged);
        assert!(count <= 6);
        for error in &errors {
            assert!(error.contains("rec.mcap"), "{error}");
        }
        seen[usize::from(!errors.is_empty())] += 1;
    }
    // Most damage is noticed, by checksums, and some of it is in what is not read.
    assert!(seen[0] > 5 && seen[1] > 200, "{seen:?}");
}
