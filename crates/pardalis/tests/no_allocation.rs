//! A warm step allocates nothing: buffers belong to the filter and the cue.
#![allow(unsafe_code)] // a counting allocator passes every call on to the system's

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use common::{FPS, ball_target, fisheye_view, frame, jump_picture};
use pardalis::color::{Palette, YuvEncoding};
use pardalis::simd::Level;
use pardalis::{Frame, PixelFormat, Tracker};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is the system allocator's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the system allocator's rules.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above; the memory is the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The only test of this file: another's allocations would be counted too.
#[test]
fn a_warm_step_allocates_nothing() {
    let frames: Vec<[(usize, Frame); 1]> = (20..30)
        .map(|index| {
            let format = [PixelFormat::Rgb8, PixelFormat::Yuyv][index % 2];
            let time_s = index as f64 / FPS;
            [(
                0,
                frame(&jump_picture(index), format, YuvEncoding::default(), time_s),
            )]
        })
        .collect();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    for particle_count in [300, 3001] {
        let targets = vec![ball_target(Palette::HSI, particle_count)];
        let mut tracker = Tracker::new(vec![fisheye_view()], targets, 1, Level::best()).unwrap();
        let mut step = |frames: &[(usize, Frame)]| {
            let time_s = frames[0].1.time_s();
            let before = ALLOCATIONS.load(Ordering::Relaxed);
            tracker.observe(frames, time_s).unwrap();
            let estimate = tracker.estimate_at(0, time_s);
            assert!(estimate.kinematics.is_some());
            ALLOCATIONS.load(Ordering::Relaxed) - before
        };
        pool.install(|| {
            // The first frames of either format make tables and buffers.
            let first = step(&frames[0]) + step(&frames[1]);
            assert!(first > 0, "the allocator counts");
            for frames in &frames[2..] {
                assert_eq!(step(frames), 0, "{particle_count} particles");
            }
        });
    }
}
