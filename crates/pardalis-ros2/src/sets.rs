//! Images of several cameras, and what detectors found in them, as sets of one instant. Of those that tracking is too slow for, the latest win.
//!
//! A detector is a camera here, whose images are lists of boxes.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Images closer in time than this belong together: triggered cameras whose stamps were rounded.
const SAME_INSTANT_NS: i64 = 1000;

/// How many images of a camera came, and what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Counts {
    pub(crate) received: usize,
    pub(crate) used: usize,
    /// Those that came after later ones had been tracked, or have the stamp of one that was.
    pub(crate) late: usize,
    /// Those for which tracking was too slow.
    pub(crate) dropped: usize,
}

struct Waiting<T> {
    stamp_ns: i64,
    arrived: Instant,
    image: T,
}

/// Collects images in order of time.
pub(crate) struct Sets<T> {
    waiting: Vec<VecDeque<Waiting<T>>>,
    /// The latest stamp of each camera.
    latest_ns: Vec<i64>,
    /// How long an image waits for those of other cameras.
    max_delay: Duration,
    /// Number of images of a camera that may wait. Of more, the oldest is dropped.
    max_waiting: usize,
    emitted_ns: i64,
    counts: Vec<Counts>,
}

/// The images of one instant, each with the number of its camera.
pub(crate) struct Set<T> {
    pub(crate) stamp_ns: i64,
    pub(crate) images: Vec<(usize, T)>,
}

impl<T> Sets<T> {
    pub(crate) fn new(cameras: usize, max_delay: Duration, max_waiting: usize) -> Self {
        Self {
            waiting: (0..cameras).map(|_| VecDeque::new()).collect(),
            latest_ns: vec![i64::MIN; cameras],
            max_delay,
            max_waiting,
            emitted_ns: i64::MIN,
            counts: vec![Counts::default(); cameras],
        }
    }

    pub(crate) fn counts(&self) -> &[Counts] {
        &self.counts
    }

    /// Takes an image that arrived now.
    pub(crate) fn take(&mut self, camera: usize, stamp_ns: i64, image: T, now: Instant) {
        let counts = &mut self.counts[camera];
        let waiting = &mut self.waiting[camera];
        counts.received += 1;
        let is_known = waiting.iter().any(|other| other.stamp_ns == stamp_ns);
        if stamp_ns <= self.emitted_ns || is_known {
            counts.late += 1;
            return;
        }
        self.latest_ns[camera] = self.latest_ns[camera].max(stamp_ns);
        let place = waiting.partition_point(|other| other.stamp_ns < stamp_ns);
        let image = Waiting {
            stamp_ns,
            arrived: now,
            image,
        };
        waiting.insert(place, image);
        if waiting.len() > self.max_waiting {
            waiting.pop_front();
            counts.dropped += 1;
        }
    }

    /// Returns the earliest set, once no camera can have an earlier image, or it has waited long enough.
    pub(crate) fn next(&mut self, now: Instant) -> Option<Set<T>> {
        let first = self.first()?;
        let (stamp_ns, arrived) = (first.stamp_ns, first.arrived);
        let is_complete = self
            .latest_ns
            .iter()
            .all(|latest_ns| *latest_ns >= stamp_ns);
        // Of a camera that is fast, no image may be dropped because another is silent.
        let is_full = self
            .waiting
            .iter()
            .any(|waiting| waiting.len() >= self.max_waiting);
        if !is_complete && !is_full && now < arrived + self.max_delay {
            return None;
        }
        let mut images = Vec::new();
        let until_ns = stamp_ns + SAME_INSTANT_NS;
        self.emitted_ns = until_ns;
        for (camera, waiting) in self.waiting.iter_mut().enumerate() {
            while let Some(image) = waiting.pop_front_if(|image| image.stamp_ns <= until_ns) {
                if images.last().is_some_and(|(last, _)| *last == camera) {
                    self.counts[camera].late += 1;
                } else {
                    self.counts[camera].used += 1;
                    images.push((camera, image.image));
                }
            }
        }
        Some(Set { stamp_ns, images })
    }

    /// Returns when the earliest image has waited long enough.
    pub(crate) fn due(&self) -> Option<Instant> {
        Some(self.first()?.arrived + self.max_delay)
    }

    fn first(&self) -> Option<&Waiting<T>> {
        let firsts = self.waiting.iter().filter_map(VecDeque::front);
        firsts.min_by_key(|image| image.stamp_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock;

    const MAX_DELAY: Duration = Duration::from_millis(100);

    fn numbers(set: Option<Set<u32>>) -> Option<(i64, Vec<(usize, u32)>)> {
        set.map(|set| (set.stamp_ns, set.images))
    }

    #[test]
    fn a_set_is_complete_with_the_last_camera() {
        let now = clock::instant();
        let mut sets = Sets::new(2, MAX_DELAY, 3);
        sets.take(0, 1_000_000, 10, now);
        assert_eq!(numbers(sets.next(now)), None);
        // Half a microsecond later.
        sets.take(1, 1_000_500, 20, now);
        assert_eq!(
            numbers(sets.next(now)),
            Some((1_000_000, vec![(0, 10), (1, 20)]))
        );
        assert_eq!(numbers(sets.next(now)), None);
        assert_eq!(sets.due(), None);
    }

    #[test]
    fn a_camera_that_is_silent_delays_the_others_and_no_more() {
        let now = clock::instant();
        let mut sets = Sets::new(2, MAX_DELAY, 3);
        sets.take(0, 1_000_000, 10, now);
        assert_eq!(sets.due(), Some(now + MAX_DELAY));
        assert_eq!(numbers(sets.next(now + MAX_DELAY / 2)), None);
        let late = now + MAX_DELAY;
        assert_eq!(numbers(sets.next(late)), Some((1_000_000, vec![(0, 10)])));
        // What comes after it is late.
        sets.take(1, 900_000, 20, late);
        assert_eq!(numbers(sets.next(late)), None);
        let expected = Counts {
            received: 1,
            late: 1,
            ..Counts::default()
        };
        assert_eq!(sets.counts()[1], expected);
    }

    #[test]
    fn a_fast_camera_is_not_held_up_by_a_silent_one() {
        let begin = clock::instant();
        let mut sets = Sets::new(2, MAX_DELAY, 3);
        let mut emitted = 0;
        for number in 1..=50 {
            let now = begin + Duration::from_millis(5 * number);
            sets.take(0, 5_000_000 * number as i64, number as u32, now);
            emitted += usize::from(sets.next(now).is_some());
        }
        assert_eq!(emitted, 48);
        assert_eq!(sets.counts()[0].dropped, 0);
    }

    #[test]
    fn images_are_sorted_and_the_latest_win() {
        let now = clock::instant();
        let mut sets = Sets::new(1, MAX_DELAY, 3);
        for stamp_ns in [30_000, 10_000, 20_000, 20_000, 40_000] {
            sets.take(0, stamp_ns, stamp_ns as u32, now);
        }
        let mut stamps = Vec::new();
        while let Some(set) = sets.next(now) {
            stamps.push(set.stamp_ns);
        }
        assert_eq!(stamps, [20_000, 30_000, 40_000]);
        let expected = Counts {
            received: 5,
            used: 3,
            late: 1,
            dropped: 1,
        };
        assert_eq!(sets.counts()[0], expected);
    }
}
