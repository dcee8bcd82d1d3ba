//! Challenge: whether something else has been likelier the target for a while than what is tracked.
//!
//! The filter prefers what it has tracked to what appears, frame by frame, however much likelier the latter is: a target is rarely relocated. A track that began on
//! something else, while the target was hidden, would never end. Evidence over time decides: the mean likeness of what is tracked since it was found, against that of
//! the likeliest other thing since that was first seen.

use nalgebra::Vector3;
use pardalis_filter::bernoulli::MeasurementComponent;

/// By how much the mean likeness of a challenger exceeds that of what is tracked, nats. Hand-set: balls of one kind differ by less.
const MARGIN_NATS: f64 = 1.5;
/// A challenger wins once it has been seen in this many searches. Hand-set: a third of a second at 25 frames per second.
const MIN_FRAMES: f64 = 8.0;
/// The same for one that moves, while what is tracked has been still. Hand-set: scenery is still, targets rarely are for long.
const MOVING_MARGIN_NATS: f64 = 0.5;
const MOVING_MIN_FRAMES: f64 = 4.0;
/// The sum over frames, since the target was last visible where it is tracked, of a challenger's likeness beyond that of what is seen there and beyond clutter: with this it wins,
/// nats. Derivation: at 25 frames per second, a target is relocated in one of 1250 frames, to anywhere in a volume ten thousand times as large as where it is tracked.
const HIDDEN_NATS: f64 = 16.0;
/// By how much each further camera that shows something makes it likelier the target, nats. Hand-set: what looks like the target from one side rarely does from another,
/// at the right distance.
const CAMERA_NATS: f64 = 2.0;
/// The number of frames after which what they said has faded to a third. Hand-set: four seconds, likewise.
const MEMORY_FRAMES: f64 = 100.0;
/// A challenger that was not seen for longer than this is forgotten, seconds. Hand-set.
const MAX_MISSED_S: f64 = 0.4;
/// A challenger is near where it was seen before, within this many diameters ... Hand-set.
const REACH_DIAMETERS: f64 = 1.0;
/// ... and with at most this change of its velocity. Hand-set: a fast throw.
const MAX_SPEED_MPS: f64 = 5.0;
/// What has come this many diameters far moves. Hand-set.
const MOVING_DIAMETERS: f64 = 1.0;

/// A thing in the latest frames that may be the target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    /// Its number among the associated detections.
    pub(super) number: usize,
    /// Metres.
    pub(super) position_m: Vector3<f64>,
    /// The greatest standard deviation of its position, metres.
    pub(super) sigma_m: f64,
    /// By how much it is likelier the target than clutter, nats.
    pub(super) likeness: f64,
}

impl Sighting {
    /// Creates a sighting from a detection: its number, its Gaussian, its likeness per camera in nats, and the number of cameras that show it.
    pub(super) fn new(
        number: usize,
        component: &MeasurementComponent,
        (likeness, cameras): (f64, usize),
    ) -> Self {
        let [xx, _, _, yy, _, zz] = component.covariance_m2;
        Self {
            number,
            position_m: component.position_m.into(),
            sigma_m: xx.max(yy).max(zz).sqrt(),
            likeness: likeness + CAMERA_NATS * (cameras as f64 - 1.0),
        }
    }
}

/// What has been seen of one thing.
#[derive(Debug, Clone, Copy)]
struct Record {
    frames: f64,
    /// The mean of its likeness, nats.
    likeness: f64,
    /// Where it was first seen, metres.
    first_m: Vector3<f64>,
    /// How far from there it has been, beyond what the sightings leave open, metres.
    way_m: f64,
}

impl Record {
    fn of(seen: &Sighting) -> Self {
        Self {
            frames: 1.0,
            likeness: seen.likeness,
            first_m: seen.position_m,
            way_m: 0.0,
        }
    }

    fn add(&mut self, seen: &Sighting) {
        self.frames = (self.frames + 1.0).min(MEMORY_FRAMES);
        self.likeness += (seen.likeness - self.likeness) / self.frames;
        let way_m = (seen.position_m - self.first_m).norm() - 2.0 * seen.sigma_m;
        self.way_m = self.way_m.max(way_m);
    }
}

/// Something else that may be the target.
#[derive(Debug, Clone, Copy)]
struct Challenger {
    record: Record,
    latest: Sighting,
    time_s: f64,
    velocity_mps: Vector3<f64>,
    /// What speaks for it since the target was last visible, nats.
    hidden_nats: f64,
}

/// What is tracked, and what challenges it.
#[derive(Debug, Default)]
pub(super) struct Challenge {
    /// While it was visible.
    target: Option<Record>,
    /// The likeness of what is seen where it is tracked while it is not visible, nats: minus infinity for nothing. `None` while it is.
    hidden: Option<f64>,
    challenger: Option<Challenger>,
}

/// What wins a challenge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Winner {
    /// Its number among the associated detections.
    pub(super) number: usize,
    /// Metres per second.
    pub(super) velocity_mps: Vector3<f64>,
}

impl Challenge {
    /// Forgets everything.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// Whether something challenges what is tracked, so that whole images must be searched.
    pub(super) fn is_open(&self) -> bool {
        self.challenger.is_some()
    }

    /// Notes what was seen in the latest frames where the target is tracked, and whether it is visible there. Otherwise that says nothing of what was seen before.
    pub(super) fn note_target(&mut self, seen: Option<&Sighting>, is_visible: bool) {
        self.hidden = (!is_visible).then(|| seen.map_or(f64::NEG_INFINITY, |seen| seen.likeness));
        if let Some(seen) = seen.filter(|_| is_visible) {
            match &mut self.target {
                Some(record) => record.add(seen),
                unknown => *unknown = Some(Record::of(seen)),
            }
        }
    }

    /// Notes what else was seen in a search of the latest frames, by targets of this diameter in metres. Returns what has won the challenge.
    pub(super) fn note_others(
        &mut self,
        others: impl Iterator<Item = Sighting> + Clone,
        time_s: f64,
        diameter_m: f64,
    ) -> Option<Winner> {
        let target = self.target?;
        // Nothing is gained by what is no likelier than clutter.
        let hidden = self.hidden.map(|likeness| likeness.max(0.0));
        let least = hidden.unwrap_or(target.likeness) + MOVING_MARGIN_NATS;
        let Some(challenger) = &mut self.challenger else {
            let likeliest = others.reduce(|a, b| if b.likeness > a.likeness { b } else { a });
            self.challenger =
                likeliest
                    .filter(|seen| seen.likeness > least)
                    .map(|seen| Challenger {
                        record: Record::of(&seen),
                        latest: seen,
                        time_s,
                        velocity_mps: Vector3::zeros(),
                        hidden_nats: hidden.map_or(0.0, |hidden| seen.likeness - hidden),
                    });
            return None;
        };
        let since_s = time_s - challenger.time_s;
        let here_m = challenger.latest.position_m + challenger.velocity_mps * since_s;
        let distance_m = |seen: &Sighting| (seen.position_m - here_m).norm();
        let nearest = others.reduce(|a, b| {
            if distance_m(&b) < distance_m(&a) {
                b
            } else {
                a
            }
        });
        let reach_m = REACH_DIAMETERS * diameter_m + MAX_SPEED_MPS * since_s;
        let near = |seen: &Sighting| {
            distance_m(seen) <= reach_m + 2.0 * libm::hypot(seen.sigma_m, challenger.latest.sigma_m)
        };
        let Some(seen) = nearest.filter(near) else {
            if since_s > MAX_MISSED_S {
                self.challenger = None;
            }
            return None;
        };
        challenger.velocity_mps = (seen.position_m - challenger.latest.position_m) / since_s;
        challenger.record.add(&seen);
        challenger.hidden_nats = hidden.map_or(0.0, |hidden| {
            challenger.hidden_nats + seen.likeness - hidden
        });
        challenger.latest = seen;
        challenger.time_s = time_s;
        let record = challenger.record;
        if record.likeness < least {
            self.challenger = None;
            return None;
        }
        let moves = |record: &Record| record.way_m > MOVING_DIAMETERS * diameter_m;
        let excess_nats = record.likeness - target.likeness;
        let is_clear = match (moves(&record), moves(&target)) {
            (true, false) => {
                excess_nats >= MOVING_MARGIN_NATS && record.frames >= MOVING_MIN_FRAMES
            }
            (false, true) => false,
            _ => excess_nats >= MARGIN_NATS && record.frames >= MIN_FRAMES,
        };
        if !is_clear && challenger.hidden_nats < HIDDEN_NATS {
            return None;
        }
        let winner = Winner {
            number: seen.number,
            velocity_mps: challenger.velocity_mps,
        };
        *self = Self {
            target: Some(record),
            ..Self::default()
        };
        Some(winner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(likeness: f64, x_m: f64) -> Sighting {
        Sighting {
            number: 0,
            position_m: Vector3::new(x_m, 0.0, 2.0),
            sigma_m: 0.01,
            likeness,
        }
    }

    /// After how many frames something that stays where it is, of this likeness, wins over a target that was clearly seen for a second and moved, and then is seen with another likeness, or not at all,
    /// and is visible or not.
    fn frames_to_win(other: f64, target: Option<f64>, is_visible: bool) -> Option<usize> {
        let mut challenge = Challenge::default();
        for number in 0..25 {
            let x_m = -0.05 * f64::from(number);
            challenge.note_target(Some(&seen(6.0, x_m)), true);
        }
        let wins = |number: &usize| {
            let target = target.map(|likeness| seen(likeness, -1.2));
            challenge.note_target(target.as_ref(), is_visible);
            let others = [seen(other, 1.0)].into_iter();
            let time_s = 0.04 * *number as f64;
            challenge.note_others(others, time_s, 0.2).is_some()
        };
        (1..100).find(wins)
    }

    #[test]
    fn what_is_likelier_than_clutter_wins_over_a_target_that_is_not_visible() {
        assert_eq!(frames_to_win(8.0, Some(-6.0), false), Some(2));
        assert_eq!(frames_to_win(8.0, None, false), Some(2));
        assert_eq!(frames_to_win(4.0, Some(-6.0), false), Some(4));
        // It is no more likely than what is tracked, or hardly likelier than clutter.
        assert_eq!(frames_to_win(4.0, Some(4.0), false), None);
        assert_eq!(frames_to_win(0.3, Some(-6.0), false), None);
        // What is still does not win over what moves and is visible.
        assert_eq!(frames_to_win(8.0, Some(-6.0), true), None);
    }

    #[test]
    fn one_frame_without_the_target_does_not_decide() {
        let mut challenge = Challenge::default();
        for number in 0..60 {
            // It is hidden once. The other is as likely, and would have been for long.
            let is_hidden = number == 40;
            let target = seen(8.0, 0.0);
            challenge.note_target((!is_hidden).then_some(&target), !is_hidden);
            let others = [seen(8.6, 1.0)].into_iter();
            let winner = challenge.note_others(others, 0.04 * f64::from(number), 0.2);
            assert!(winner.is_none(), "{number}");
        }
    }
}
