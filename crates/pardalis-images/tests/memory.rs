//! Decoding takes memory by the size of the image, whatever else a file contains.
#![allow(unsafe_code)] // a counting allocator passes every call on to the system's

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use pardalis_images::decode;
use png::BitDepth;

struct Counting;

static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is forwarded to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(now, Ordering::Relaxed);
        // SAFETY: the caller fulfils the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above; the memory was allocated by the system allocator.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Returns what a function returns, and the bytes that it allocated at most at a time.
fn peak_of<T>(function: impl FnOnce() -> T) -> (T, usize) {
    let before = NOW.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let result = function();
    (result, PEAK.load(Ordering::Relaxed) - before)
}

/// A side of the test images, in pixels.
const SIDE_PX: usize = 1024;

/// Memory besides the image: tables of the decoders and a few rows.
const REST_BYTES: usize = 1 << 20;

/// Returns a black PNG file with these properties.
fn png_with(color: png::ColorType, depth: BitDepth, info: png::Info) -> Vec<u8> {
    let mut info = info;
    (info.width, info.height) = (SIDE_PX as u32, SIDE_PX as u32);
    (info.color_type, info.bit_depth) = (color, depth);
    let bytes = info.raw_bytes() - SIDE_PX;
    let mut file = Vec::new();
    let encoder = png::Encoder::with_info(&mut file, info).expect("valid properties");
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&vec![0; bytes]).expect("pixels");
    writer.finish().expect("an end");
    file
}

fn progressive_jpeg() -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, 90);
    encoder.set_progressive(true);
    encoder.set_sampling_factor(SamplingFactor::R_4_4_4);
    let side = SIDE_PX as u16;
    let pixels = vec![128; 3 * SIDE_PX * SIDE_PX];
    let encoded = encoder.encode(&pixels, side, side, ColorType::Rgb);
    encoded.expect("a JPEG image");
    file
}

// One test, because tests of one program share the allocator's counts.
#[test]
fn no_file_takes_more_memory_than_its_pixels() {
    use png::ColorType::{Grayscale, Rgb, Rgba};
    let pixels = SIDE_PX * SIDE_PX;
    let long_text = || {
        let mut info = png::Info::default();
        let text = "a".repeat(40 << 20);
        info.compressed_latin1_text
            .push(png::text_metadata::ZTXtChunk::new("Comment", text));
        info
    };
    let long_profile = || {
        let mut info = png::Info::default();
        info.icc_profile = Some(vec![0; 40 << 20].into());
        info
    };
    let plain = png::Info::default;
    for (what, file, per_pixel) in [
        ("grey", png_with(Grayscale, BitDepth::One, plain()), 3),
        ("alpha", png_with(Rgba, BitDepth::Sixteen, plain()), 3),
        ("text", png_with(Rgb, BitDepth::Eight, long_text()), 3),
        ("profile", png_with(Rgb, BitDepth::Eight, long_profile()), 3),
        ("progressive", progressive_jpeg(), 9),
    ] {
        assert!(file.len() < REST_BYTES, "{what}: {} bytes", file.len());
        let (image, peak) = peak_of(|| decode(&file));
        assert_eq!(image.expect(what).size_px(), (SIDE_PX, SIDE_PX));
        let allowed = per_pixel * pixels + REST_BYTES;
        assert!(peak <= allowed, "{what}: {peak} bytes; allowed: {allowed}");
    }
}
