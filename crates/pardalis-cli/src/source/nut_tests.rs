use super::*;

/// Four frames of 4 x 2 pixels in RGB, as ffmpeg wrote them, at 0, 0.04, 0 and 5 s after 2^20 s.
const SAMPLE: &[u8] = include_bytes!("nut_sample.nut");

/// The size of a stream, the ticks and the bytes of its frames.
type Content = (Option<(usize, usize)>, Vec<i64>, Vec<u8>);

/// Reads a stream to its end.
fn read(stream: &[u8]) -> Result<Content> {
    let mut nut = Nut::new(stream);
    let size_px = nut.size_px()?;
    let (mut ticks, mut bytes) = (Vec::new(), Vec::new());
    while let Some(header) = nut.next_frame()? {
        if header.byte_count > 1 << 20 {
            return Err(invalid("too long"));
        }
        let mut frame = vec![0; header.byte_count];
        nut.read(&mut frame)?;
        ticks.push(header.ticks);
        bytes.extend(frame);
    }
    Ok((size_px, ticks, bytes))
}

#[test]
fn a_stream_of_ffmpeg_is_read() {
    let (size_px, ticks, bytes) = read(SAMPLE).expect("valid");
    assert_eq!(size_px, Some((4, 2)));
    let offset = (1 << 20) * 9_000_000;
    let wanted = [0, 360_000, 0, 45_000_000];
    assert_eq!(ticks, wanted.map(|ticks| offset + ticks));
    assert_eq!(bytes.len(), 4 * 4 * 2 * 3);
    let mut nut = Nut::new(SAMPLE);
    nut.next_frame().expect("valid");
    assert_eq!(nut.time_base(), (1, 9_000_000));
}

#[test]
fn truncated_and_damaged_streams_are_errors_or_shorter() {
    let (_, whole, _) = read(SAMPLE).expect("valid");
    for end in 0..SAMPLE.len() {
        match read(&SAMPLE[..end]) {
            Ok((_, ticks, _)) => assert!(whole.starts_with(&ticks), "{end}"),
            Err(error) => assert_eq!(error.kind(), ErrorKind::UnexpectedEof, "{end}"),
        }
    }
    // Any result will do, but no panic.
    let mut errors = 0;
    for place in 0..SAMPLE.len() {
        for value in 0..=255 {
            let mut damaged = SAMPLE.to_vec();
            damaged[place] = value;
            errors += usize::from(read(&damaged).is_err());
        }
    }
    assert!(errors > 10_000, "{errors}");
}

#[test]
fn numbers_have_seven_bits_a_byte() {
    for (bytes, wanted) in [
        (&[0x00][..], 0),
        (&[0x7F], 127),
        (&[0x81, 0x00], 128),
        (
            &[0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F],
            i64::MAX as u64,
        ),
    ] {
        let mut input = bytes;
        assert_eq!(number(&mut input).expect("valid"), wanted);
        assert!(input.is_empty());
    }
    for bytes in [&[0xFF; 11][..], &[0x80]] {
        let mut input = bytes;
        assert!(number(&mut input).is_err());
    }
    for (byte, wanted) in [(0, 0), (1, 1), (2, -1), (3, 2), (4, -2)] {
        let mut input = &[byte][..];
        assert_eq!(signed(&mut input).expect("valid"), wanted);
    }
}
