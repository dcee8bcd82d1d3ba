use pardalis::PixelFormat;
use pardalis::color::YuvEncoding;

use super::*;

/// A small image whose content is its time, so that no two images are equal.
fn frame(time_s: f64) -> Frame {
    image(time_s, time_s)
}

fn image(time_s: f64, content: f64) -> Frame {
    let mut bytes = vec![0; 12];
    bytes[..8].copy_from_slice(&content.to_le_bytes());
    let frame = Frame::new(
        PixelFormat::Rgb8,
        YuvEncoding::default(),
        2,
        2,
        bytes,
        time_s,
    );
    frame.expect("a sound frame")
}

/// Returns all sets of these frames (camera, time stamp, arrival), in any order, and the statistics.
fn merged(
    camera_count: usize,
    max_delay_s: f64,
    frames: &[(usize, f64, f64)],
) -> (Vec<FrameSet>, Vec<FrameCounts>) {
    let merge = Merge::new(camera_count, max_delay_s, Limit::default());
    merged_by(merge, frames)
}

/// Merges frames like [`merged`] in a merge of one's own.
fn merged_by(mut merge: Merge, frames: &[(usize, f64, f64)]) -> (Vec<FrameSet>, Vec<FrameCounts>) {
    let mut frames = frames.to_vec();
    frames.sort_by(|a, b| a.2.total_cmp(&b.2));
    let mut sets = Vec::new();
    for (camera, time_s, arrival_s) in frames {
        sets.extend(std::iter::from_fn(|| merge.next_set(arrival_s)));
        merge.take(camera, frame(time_s), arrival_s);
    }
    sets.extend(std::iter::from_fn(|| merge.next_set(f64::INFINITY)));
    (sets, merge.counts().collect())
}

fn times_and_cameras(sets: &[FrameSet]) -> Vec<(f64, Vec<usize>)> {
    let cameras = |set: &FrameSet| set.frames.iter().map(|(camera, _)| *camera).collect();
    sets.iter().map(|set| (set.time_s, cameras(set))).collect()
}

#[test]
fn triggered_cameras_share_sets_and_free_running_cameras_do_not() {
    let triggered = [(0, 0.0, 0.0), (1, 4e-7, 4e-7), (0, 0.1, 0.1), (1, 0.1, 0.1)];
    for max_delay_s in [0.0, 1.0] {
        let (sets, _) = merged(2, max_delay_s, &triggered);
        assert_eq!(
            times_and_cameras(&sets),
            [(4e-7, vec![0, 1]), (0.1, vec![0, 1])]
        );
    }
    let free = [
        (0, 0.0, 0.0),
        (1, 0.03, 0.03),
        (0, 0.1, 0.1),
        (1, 0.13, 0.13),
    ];
    let (sets, counts) = merged(2, 0.1, &free);
    assert_eq!(
        times_and_cameras(&sets),
        [
            (0.0, vec![0]),
            (0.03, vec![1]),
            (0.1, vec![0]),
            (0.13, vec![1])
        ]
    );
    assert_eq!(
        sets.iter().map(|set| set.index).collect::<Vec<_>>(),
        [0, 1, 2, 3]
    );
    assert_eq!((counts[1].used, counts[1].sorted_in_late), (2, 0));
    assert_eq!(counts[1].longest_gap_s, 0.13 - 0.03);
}

/// Of frames that are stamped when they arrive, those of one instant differ by a few milliseconds.
#[test]
fn frames_that_are_nearly_of_one_time_share_sets() {
    // The order of arrival varies. Camera 2 is 20 ms later than the others.
    let mut frames = Vec::new();
    for number in 0..30 {
        let time_s = 0.04 * f64::from(number);
        let late_s = 0.0015 * f64::from(number % 3);
        let (first, second) = if number % 2 == 0 { (0, 1) } else { (1, 0) };
        frames.push((first, time_s, time_s));
        frames.push((second, time_s + late_s, time_s + late_s));
        frames.push((2, time_s + 0.02, time_s + 0.02));
    }
    let (sets, counts) = merged(3, 0.1, &frames);
    assert_eq!(sets.len(), 60);
    for pair in sets.chunks(2) {
        let cameras = pair.iter().map(|set| set.frames.iter().map(|(c, _)| *c));
        let cameras: Vec<Vec<usize>> = cameras.map(Iterator::collect).collect();
        assert_eq!(cameras, [vec![0, 1], vec![2]]);
        // The time of the latest.
        let last_s = pair[0].frames.iter().map(|(_, frame)| frame.time_s());
        assert_eq!(pair[0].time_s, last_s.fold(0.0, f64::max));
        pair[0].whole(&Detections::default()).unwrap();
    }
    assert!(counts.iter().all(|counts| counts.used == 30));
    // Live, the first waits for the second, and for no other.
    let mut merge = Merge::new(3, 0.1, Limit::default()).prompt();
    let mut waited = Vec::new();
    for &(camera, time_s, arrival_s) in &frames {
        merge.take(camera, frame(time_s), arrival_s);
        while let Some(set) = merge.next_set(arrival_s) {
            waited.push((set.frames.len(), arrival_s - set.time_s));
        }
    }
    let later = &waited[40..];
    assert!(
        later.iter().all(|(_, waited_s)| *waited_s == 0.0),
        "{later:?}"
    );
    let sizes: Vec<usize> = later.iter().map(|(size, _)| *size).collect();
    assert!(sizes.chunks(2).all(|pair| pair == [2, 1]), "{sizes:?}");
}

/// A camera has one frame in a set, however fast it is.
#[test]
fn fast_cameras_keep_all_their_frames() {
    let frames: Vec<_> = (0..100)
        .flat_map(|number| {
            let time_s = 0.002 * f64::from(number);
            [(0, time_s, time_s), (1, time_s + 0.0005, time_s + 0.0005)]
        })
        .collect();
    for cameras in [1, 2] {
        let frames: Vec<_> = frames.iter().copied().filter(|f| f.0 < cameras).collect();
        let (sets, counts) = merged(cameras, 0.1, &frames);
        assert_eq!(sets.len(), 100);
        assert!(counts.iter().all(|counts| counts.used == 100));
        assert!(sets.iter().all(|set| set.frames.len() == cameras));
        // Nor do they wait for what is not due.
        let mut merge = Merge::new(cameras, 0.1, Limit::default()).prompt();
        let mut emitted = 0;
        for &(camera, time_s, arrival_s) in &frames {
            merge.take(camera, frame(time_s), arrival_s);
            let sets = std::iter::from_fn(|| merge.next_set(arrival_s)).count();
            emitted += sets;
            if time_s > 0.1 && camera + 1 == cameras {
                assert_eq!(sets, 1, "{time_s}");
            }
        }
        assert!(emitted > 95);
    }
}

/// A camera whose frames arrive one interval late: waiting saves exactly the frames that are dropped without it.
#[test]
fn late_frames_are_sorted_in_or_dropped() {
    let mut frames = Vec::new();
    for n in 0..10 {
        let time_s = f64::from(n) * 0.04;
        for camera in 0..3 {
            let late_s = if camera == 0 { 0.04 } else { 0.0 };
            frames.push((camera, time_s, time_s + late_s));
        }
    }
    let (sets, counts) = merged(3, 0.1, &frames);
    assert_eq!(sets.len(), 10);
    assert!(sets.iter().all(|set| set.frames.len() == 3));
    assert_eq!((counts[0].sorted_in_late, counts[0].dropped_late), (10, 0));
    assert_eq!((counts[1].sorted_in_late, counts[2].sorted_in_late), (0, 0));
    let (sets, counts) = merged(3, 0.0, &frames);
    assert!(sets.iter().all(|set| set.frames.len() == 2));
    assert_eq!((counts[0].sorted_in_late, counts[0].dropped_late), (0, 10));
    assert_eq!((counts[0].used, counts[1].used), (0, 10));
}

#[test]
fn live_cameras_wait_only_for_those_that_have_not_delivered_later_frames() {
    let mut merge = Merge::new(3, 0.1, Limit::default()).prompt();
    let mut emitted = Vec::new();
    // Camera 2 is silent from 1.0 s on.
    for (camera, time_s, arrival_s) in [
        (0, 0.90, 0.91),
        (1, 0.91, 0.92),
        (2, 0.92, 0.93),
        (0, 0.94, 0.95),
        (1, 0.95, 0.96),
        (2, 0.96, 0.97),
        (0, 1.00, 1.01),
        (1, 1.01, 1.02),
        (0, 1.08, 1.09),
        (1, 1.09, 1.10),
    ] {
        merge.take(camera, frame(time_s), arrival_s);
        while let Some(set) = merge.next_set(arrival_s) {
            emitted.push((set.time_s, arrival_s));
        }
    }
    assert_eq!(
        emitted,
        [
            // Once all have come, those up to the first that may still come.
            (0.90, 0.93),
            (0.91, 0.95),
            (0.92, 0.96),
            (0.94, 0.97),
            (0.95, 1.01),
            (0.96, 1.02),
        ]
    );
    // The others do not wait for the silent one for longer than the limit.
    let set = merge.next_set(1.12).expect("one that has waited enough");
    assert_eq!(set.time_s, 1.00);
    assert!(merge.counts().all(|counts| counts.dropped_late == 0));
}

#[test]
fn frames_of_regular_live_cameras_wait_for_no_frame_that_is_not_due() {
    let mut merge = Merge::new(2, 0.1, Limit::default()).prompt();
    let emitted_at = |merge: &mut Merge, camera: usize, time_s: f64, arrival_s: f64| {
        merge.take(camera, frame(time_s), arrival_s);
        let sets = std::iter::from_fn(|| merge.next_set(arrival_s));
        sets.map(|set| (set.time_s, set.frames.len()))
            .collect::<Vec<_>>()
    };
    // Camera 1 is 10 ms later than camera 0, and each frame takes 2 ms.
    for number in 0..30 {
        let time_s = 0.04 * f64::from(number);
        let of_first = emitted_at(&mut merge, 0, time_s, time_s + 0.002);
        let of_second = emitted_at(&mut merge, 1, time_s + 0.01, time_s + 0.012);
        if number > 20 {
            assert_eq!(of_first, [(time_s, 1)]);
            assert_eq!(of_second, [(time_s + 0.01, 1)]);
        }
    }
    // A frame of camera 0 is late, and one of camera 1 waits for it.
    assert_eq!(emitted_at(&mut merge, 1, 1.21, 1.212), []);
    assert_eq!(emitted_at(&mut merge, 0, 1.2, 1.213), [(1.2, 1), (1.21, 1)]);
    // Camera 0 falls silent, and camera 1 waits for it until it is known to be away.
    assert_eq!(emitted_at(&mut merge, 1, 1.25, 1.252), []);
    merge.set_away(0, true);
    assert_eq!(
        emitted_at(&mut merge, 1, 1.29, 1.292),
        [(1.25, 1), (1.29, 1)]
    );
    merge.set_away(0, false);
    assert_eq!(emitted_at(&mut merge, 1, 1.33, 1.332), []);
    // Both at once, as if triggered, one after the other.
    let mut merge = Merge::new(2, 0.1, Limit::default()).prompt();
    for number in 0..30 {
        let time_s = 0.04 * f64::from(number);
        let of_first = emitted_at(&mut merge, 0, time_s, time_s + 0.002);
        let of_second = emitted_at(&mut merge, 1, time_s, time_s + 0.003);
        assert_eq!((of_first, of_second), (vec![], vec![(time_s, 2)]));
    }
    assert!(merge.counts().all(|counts| counts.dropped_late == 0));
}

#[test]
fn the_oldest_frames_are_dropped_while_tracking_is_slow() {
    let mut merge = Merge::new(2, 0.0, Limit::default());
    for n in 0..5 {
        let time_s = f64::from(n);
        merge.take(0, frame(time_s), time_s);
        merge.take(1, frame(time_s + 0.5), time_s + 0.5);
    }
    merge.overtake(0, 10.0);
    let sets: Vec<_> = std::iter::from_fn(|| merge.next_set(10.0)).collect();
    let of = |camera| {
        let times = times_and_cameras(&sets).into_iter();
        let times = times.filter(move |(_, cameras)| cameras == &[camera]);
        times.map(|(time_s, _)| time_s).collect::<Vec<_>>()
    };
    assert_eq!(of(0), [3.0, 4.0]);
    assert_eq!(of(1), [0.5, 1.5, 2.5, 3.5, 4.5]);
    let counts: Vec<_> = merge.counts().collect();
    assert_eq!(
        (counts[0].delivered, counts[0].used, counts[0].overtaken),
        (5, 2, 3)
    );
    assert_eq!(counts[1].overtaken, 0);
    // While one camera lags, the others wait for it; what all have delivered waits for tracking.
    let mut merge = Merge::new(2, 1.0, Limit::default()).prompt();
    for n in 0..8 {
        let time_s = 0.01 * f64::from(n);
        merge.take(0, frame(time_s), time_s);
    }
    merge.overtake(0, 0.08);
    assert_eq!(merge.held.len(), 8);
    merge.take(1, frame(0.05), 0.08);
    merge.overtake(0, 0.08);
    let times_s: Vec<f64> = merge.held.iter().map(|held| held.frame.time_s()).collect();
    assert_eq!(times_s, [0.04, 0.05, 0.06, 0.07, 0.05]);
    // No more than may wait, and those that are not due yet.
    let mut merge = Merge::new(1, 1.0, Limit::default());
    for n in 0..5 {
        merge.take(0, frame(f64::from(n)), f64::from(n));
    }
    merge.overtake(0, 3.5);
    assert_eq!(merge.held.len(), 4);
    merge.overtake(0, 3.5);
    assert_eq!(merge.held.len(), 4);
}

#[test]
fn the_first_of_equal_times_of_a_camera_is_used() {
    // Within one set, and after the set was emitted.
    let frames = [(0, 1.0, 1.0), (0, 1.0, 1.0), (0, 2.0, 2.0), (0, 2.0, 2.5)];
    let (sets, counts) = merged(1, 0.0, &frames);
    assert_eq!(times_and_cameras(&sets), [(1.0, vec![0]), (2.0, vec![0])]);
    assert_eq!(
        (sets[0].index, sets[1].index),
        (0, 2),
        "the number of the image"
    );
    assert_eq!((counts[0].repeated, counts[0].dropped_late), (2, 0));
}

#[test]
fn a_repeated_image_is_frozen() {
    let mut merge = Merge::new(2, 0.0, Limit::default());
    for (camera, content) in [(0, 1.0), (1, 2.0), (0, 1.0), (1, 3.0), (0, 1.0), (1, 3.0)] {
        let step = merge.counts().map(|c| c.delivered).sum::<usize>() / 2;
        let time_s = step as f64;
        merge.take(camera, image(time_s, content), time_s);
    }
    merge.count_broken(1);
    let sets: Vec<FrameSet> = std::iter::from_fn(|| merge.next_set(f64::INFINITY)).collect();
    let fresh: Vec<Vec<usize>> = sets
        .iter()
        .map(|set| {
            set.without_frozen(&Detections::default())
                .unwrap()
                .frames()
                .map(|(camera, _)| camera.index())
                .collect()
        })
        .collect();
    assert_eq!(fresh, [vec![0, 1], vec![1], vec![]]);
    assert!(sets.iter().all(|set| set.frames.len() == 2));
    let counts: Vec<FrameCounts> = merge.counts().collect();
    assert_eq!((counts[0].used, counts[0].frozen), (1, 2));
    assert_eq!((counts[1].used, counts[1].frozen), (2, 1));
    assert_eq!((counts[1].broken, counts[1].delivered), (1, 4));
}

proptest::proptest! {
    /// For any arrivals: sets are in strict order of time, each frame is emitted once or counted as left out, and
    /// waiting longer loses no more frames.
    #[test]
    fn every_frame_is_emitted_once_or_counted(
        frames in proptest::collection::vec((0..4_usize, 0..60_u32, 0..80_u32), 0..60),
        delays in (0..40_u32, 0..40_u32),
    ) {
        let seconds = |ticks: u32| f64::from(ticks) * 0.01;
        let frames: Vec<_> = frames.into_iter().map(|(c, t, a)| (c, seconds(t), seconds(a))).collect();
        let run = |delay: u32| merged(4, seconds(delay), &frames);
        let (sets, counts) = run(delays.0);
        assert!(sets.is_sorted_by(|a, b| a.time_s < b.time_s));
        for (camera, counts) in counts.iter().enumerate() {
            let given = frames.iter().filter(|f| f.0 == camera).count();
            let handed: Vec<f64> = sets
                .iter()
                .flat_map(|set| &set.frames)
                .filter(|(number, _)| *number == camera)
                .map(|(_, frame)| frame.time_s())
                .collect();
            assert!(handed.is_sorted_by(|a, b| a < b));
            assert_eq!(handed.len(), counts.used + counts.frozen);
            let left_out = counts.dropped_late + counts.repeated + counts.broken;
            assert_eq!((counts.delivered, handed.len() + left_out), (given, given));
            assert!(counts.sorted_in_late <= handed.len());
        }
        let dropped = |counts: &[FrameCounts]| counts.iter().map(|c| c.dropped_late).sum::<usize>();
        let longest = merged(4, 60.0, &frames).1;
        assert_eq!(dropped(&longest), 0);
    }
}

#[test]
fn a_limit_ends_the_sets_and_only_frames_in_them_count() {
    // One camera is a tenth of a second late.
    let frames: Vec<_> = (0..40)
        .map(|number| {
            let (camera, time_s) = (number % 2, f64::from((number / 2) as u32) * 0.04);
            (camera, time_s, time_s + 0.1 * camera as f64)
        })
        .collect();
    for (frame_sets, duration_s, sets) in [
        (Some(3), None, 3),
        (None, Some(0.2), 5),
        (Some(3), Some(0.2), 3),
        (Some(9), Some(0.2), 5),
        (Some(30), Some(1.0), 20),
    ] {
        let limit = Limit {
            frame_sets,
            duration_s,
        };
        let (limited, counts) = merged_by(Merge::new(2, 0.2, limit), &frames);
        let (all, _) = merged(2, 0.2, &frames);
        assert_eq!(
            times_and_cameras(&limited),
            times_and_cameras(&all)[..sets],
            "{limit:?}"
        );
        for counts in counts {
            assert_eq!((counts.delivered, counts.used), (sets, sets), "{limit:?}");
            assert_eq!(counts.last_time_s, Some(limited[sets - 1].time_s));
        }
    }
}

#[test]
fn a_stamp_from_the_future_does_not_fill_the_memory() {
    // All later frames arrive after the frame from the future, and therefore together with it.
    let stamps_s = [0.0, 0.1, 3600.0, 0.3, 0.4, 0.5, 0.6, 0.7];
    let arrival_s = |number: usize| if number < 2 { stamps_s[number] } else { 3600.0 };
    let frames: Vec<_> = (0..8).map(|n| (0, stamps_s[n], arrival_s(n))).collect();
    let mut merge = Merge::new(1, 0.0, Limit::default());
    // Each has 12 bytes.
    merge.held_bytes_limit = 40;
    let mut most_held = 0;
    let mut times_s = Vec::new();
    for (camera, time_s, arrival_s) in frames {
        times_s.extend(std::iter::from_fn(|| merge.next_set(arrival_s)).map(|set| set.time_s));
        merge.take(camera, frame(time_s), arrival_s);
        most_held = most_held.max(merge.held.len());
    }
    times_s.extend(std::iter::from_fn(|| merge.next_set(f64::INFINITY)).map(|set| set.time_s));
    assert_eq!(times_s, [0.0, 0.1, 0.3, 0.4, 0.5, 0.6, 0.7, 3600.0]);
    assert_eq!(most_held, 4);
}
