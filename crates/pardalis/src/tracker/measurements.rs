//! Measurements of other sensors that wait for the frames of their time or after it.

use pardalis_core::Error;
use pardalis_filter::Measurement;
use pardalis_filter::bernoulli::{BernoulliFilter, MAX_AGO_S, Measured};
use pardalis_filter::gaussian::GaussianStart;

/// How many measurements may wait. Hand-set: minutes of a fast sensor.
const MAX_WAITING: usize = 100_000;

/// What became of a measurement ([`Tracker::observe_measurement`](super::Tracker::observe_measurement)).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservedMeasurement {
    /// It is taken into account with the next frame set at its time or after it.
    Waiting,
    /// It is too old, and was ignored.
    Late,
}

/// What became of the measurements of a target so far, but for those that still wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MeasurementCounts {
    /// Those that were used.
    pub used: usize,
    /// Outliers: further from the prediction than one in a thousand.
    pub rejected: usize,
    /// Those made while the target was not known, but for full positions.
    pub without_target: usize,
    /// Those that were ignored because frames that came before them were too much later.
    pub late: usize,
}

/// What a body knows of the sensors that measure it.
#[derive(Debug, Default)]
pub(super) struct Measurements {
    /// In the order of time.
    waiting: Vec<Measurement>,
    counts: MeasurementCounts,
    /// The covariance of the position because of the poses of platforms, xx, xy, xz, yy, yz, zz in m².
    pub(super) platforms_m2: [f64; 6],
}

/// How a body stands when measurements reach it.
pub(super) struct Standing {
    /// Whether it is tracked or occluded.
    pub(super) is_known: bool,
    /// The covariance of errors that frames share (xx, xy, xz, yy, yz, zz in m²), without those of platforms.
    pub(super) shared_m2: [f64; 6],
    /// The height at which it stays, metres, if it does.
    pub(super) ground_z_m: Option<f64>,
    /// Its velocity where it appears, m/s.
    pub(super) birth_velocity_sigma_mps: f64,
}

impl Measurements {
    pub(super) fn counts(&self) -> MeasurementCounts {
        self.counts
    }

    pub(super) fn are_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    /// Takes a measurement, after frames of this time in seconds.
    ///
    /// Returns an error if too many wait.
    pub(super) fn push(
        &mut self,
        measurement: &Measurement,
        latest_s: Option<f64>,
    ) -> Result<ObservedMeasurement, Error> {
        let ago_s = latest_s.map_or(0.0, |latest_s| latest_s - measurement.time_s());
        if ago_s > MAX_AGO_S || measurement.is_of_velocity() && ago_s > 0.0 {
            self.counts.late += 1;
            return Ok(ObservedMeasurement::Late);
        }
        if self.waiting.len() >= MAX_WAITING {
            return Err(Error::refused(
                format!("{MAX_WAITING} measurements wait for frames"),
                "observe frames, or FrameSet::without_frames to let time pass",
            ));
        }
        let time_s = measurement.time_s();
        let place = self
            .waiting
            .partition_point(|other| other.time_s() <= time_s);
        self.waiting.insert(place, *measurement);
        Ok(ObservedMeasurement::Waiting)
    }

    /// Forgets those that wait.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Predicts a filter by `dt_s` seconds to a time in seconds, with the measurements on the way.
    ///
    /// A position of a body that is not known is where it is probably found: the particles are drawn there.
    pub(super) fn advance(
        &mut self,
        filter: &mut BernoulliFilter,
        (time_s, dt_s): (f64, f64),
        standing: &Standing,
    ) {
        let due = self
            .waiting
            .partition_point(|measurement| measurement.time_s() <= time_s);
        if due == 0 {
            filter.predict(dt_s);
            return;
        }
        // The time that is left to predict. Without rounding if all measurements are of the end.
        let mut left_s = dt_s;
        let mut shared_m2 = standing.shared_m2;
        for (sum, of_platforms) in shared_m2.iter_mut().zip(self.platforms_m2) {
            *sum += of_platforms;
        }
        for measurement in self.waiting.drain(..due) {
            let before_s = time_s - measurement.time_s();
            if before_s < left_s {
                filter.predict(left_s - before_s);
                left_s = before_s;
            }
            let start = standing.start_at(&measurement);
            let counts = &mut self.counts;
            if !standing.is_known && start.is_none() {
                counts.without_target += 1;
                continue;
            }
            let ago_s = before_s - left_s;
            match (filter.measure(&measurement, ago_s, shared_m2), start) {
                (Measured::Used, _) => counts.used += 1,
                (Measured::Late, _) => counts.late += 1,
                (Measured::Rejected | Measured::NoTarget, Some(start)) => {
                    let restarted = filter.start(&start, filter.existence());
                    filter.predict(ago_s);
                    counts.used += usize::from(restarted.is_ok());
                    counts.rejected += usize::from(restarted.is_err());
                }
                (Measured::Rejected, None) => counts.rejected += 1,
                (Measured::NoTarget, None) => counts.without_target += 1,
            }
        }
        filter.predict(left_s);
    }
}

impl Standing {
    /// Where a body that is not known is probably found, if a measurement is a position with all coordinates along which it moves.
    fn start_at(&self, measurement: &Measurement) -> Option<GaussianStart> {
        let axes = if self.ground_z_m.is_some() { 2 } else { 3 };
        let (mut position_m, covariance_m2) = measurement.full_position(axes)?;
        if let Some(ground_z_m) = self.ground_z_m {
            position_m[2] = ground_z_m;
        }
        (!self.is_known).then_some(GaussianStart {
            position_m,
            covariance_m2,
            velocity_mps: [0.0; 3],
            velocity_sigma_mps: [self.birth_velocity_sigma_mps; 3],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_core::rng::Draws;
    use pardalis_filter::bernoulli::BernoulliSettings;
    use pardalis_filter::motion::Motion;

    const STANDING: Standing = Standing {
        is_known: true,
        shared_m2: [0.0; 6],
        ground_z_m: None,
        birth_velocity_sigma_mps: 1.0,
    };

    fn filter() -> BernoulliFilter {
        BernoulliFilter::new(BernoulliSettings::of(Motion::DEFAULT), Draws::new(1, 0)).unwrap()
    }

    fn started() -> BernoulliFilter {
        let mut filter = filter();
        filter.start(&GaussianStart::at([0.0; 3]), 0.9).unwrap();
        filter
    }

    fn range(time_s: f64) -> Measurement {
        Measurement::range(time_s, [2.0, 0.0, 0.0], 1.95, 0.05).unwrap()
    }

    fn place(time_s: f64, x_m: f64) -> Measurement {
        let at = [Some(x_m), Some(0.0), Some(0.0)];
        Measurement::position(time_s, at, [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]).unwrap()
    }

    #[test]
    fn measurements_are_taken_in_the_order_of_time_whatever_the_order_in_which_they_come() {
        let run = |order: [f64; 3]| {
            let (mut filter, mut measurements) = (started(), Measurements::default());
            for time_s in order {
                let pushed = measurements.push(&range(time_s), Some(0.0)).unwrap();
                assert_eq!(pushed, ObservedMeasurement::Waiting);
            }
            measurements.advance(&mut filter, (0.1, 0.1), &STANDING);
            assert!(measurements.are_waiting(), "one is of later");
            assert_eq!(measurements.counts().used, 2);
            measurements.advance(&mut filter, (0.2, 0.1), &STANDING);
            assert_eq!(
                (measurements.counts().used, measurements.are_waiting()),
                (3, false)
            );
            format!("{:?}", filter.estimate(0.0))
        };
        let in_order = run([0.02, 0.06, 0.15]);
        assert_eq!(in_order, run([0.15, 0.02, 0.06]));
        let mut without = started();
        Measurements::default().advance(&mut without, (0.2, 0.2), &STANDING);
        assert_ne!(in_order, format!("{:?}", without.estimate(0.0)));
    }

    #[test]
    fn without_measurements_the_prediction_is_the_same_to_the_bit() {
        let [mut plain, mut through] = [started(), started()];
        let mut measurements = Measurements::default();
        measurements.push(&range(9.0), None).unwrap();
        for dt_s in [0.04, 0.037, 1e-9] {
            plain.predict(dt_s);
            measurements.advance(&mut through, (5.0, dt_s), &STANDING);
            assert_eq!(plain.estimate(0.0), through.estimate(0.0));
        }
    }

    #[test]
    fn late_ones_are_counted_and_those_of_velocities_sooner() {
        let mut measurements = Measurements::default();
        let speed = |time_s| {
            Measurement::velocity(time_s, [Some(1.0); 3], [0.1, 0.0, 0.0, 0.1, 0.0, 0.1]).unwrap()
        };
        for (measurement, wanted) in [
            (range(0.95), ObservedMeasurement::Waiting),
            (range(0.85), ObservedMeasurement::Late),
            (speed(0.95), ObservedMeasurement::Late),
            (speed(1.0), ObservedMeasurement::Waiting),
        ] {
            assert_eq!(measurements.push(&measurement, Some(1.0)).unwrap(), wanted);
        }
        assert_eq!(measurements.counts().late, 2);
        let mut filter = started();
        measurements.advance(&mut filter, (1.04, 0.04), &STANDING);
        assert_eq!(measurements.counts().used, 2);
    }

    #[test]
    fn full_positions_say_where_to_search_and_nothing_else_does() {
        let unknown = Standing {
            is_known: false,
            ..STANDING
        };
        let mut filter = filter();
        let mut measurements = Measurements::default();
        filter.predict(1.0);
        let existence = filter.existence();
        assert!(existence > 0.05 && filter.estimate(0.0).is_none());
        measurements.push(&range(1.0), None).unwrap();
        let height = Measurement::position(1.0, [None, None, Some(1.0)], [0.01; 6]).unwrap();
        measurements.push(&height, None).unwrap();
        measurements.advance(&mut filter, (1.0, 0.0), &unknown);
        assert!(filter.estimate(0.0).is_none());
        assert_eq!(measurements.counts().without_target, 2);
        measurements.push(&place(1.02, 3.0), Some(1.0)).unwrap();
        measurements.advance(&mut filter, (1.04, 0.04), &unknown);
        let found = filter.estimate(0.0).unwrap();
        assert!((found.position_m[0] - 3.0).abs() < 0.02, "{found:?}");
        assert!((filter.existence() - existence).abs() < 0.01);
        // One that is elsewhere is believed as long as nobody is known, and then no more.
        for (standing, wanted) in [(&unknown, [8.0, 0.0]), (&STANDING, [8.0, 1.0])] {
            let far = if wanted[1] > 0.0 { -5.0 } else { 8.0 };
            measurements.push(&place(1.04, far), Some(1.04)).unwrap();
            measurements.advance(&mut filter, (1.04, 0.0), standing);
            let found = filter.estimate(0.0).unwrap();
            assert!((found.position_m[0] - wanted[0]).abs() < 0.02, "{found:?}");
            assert_eq!(measurements.counts().rejected, wanted[1] as usize);
        }
    }

    #[test]
    fn on_the_ground_two_coordinates_are_a_position() {
        let unknown = Standing {
            is_known: false,
            ground_z_m: Some(0.2),
            ..STANDING
        };
        let settings = BernoulliSettings::of(Motion::DEFAULT.in_plane());
        let mut filter = BernoulliFilter::new(settings, Draws::new(1, 0)).unwrap();
        filter.predict(1.0);
        let mut measurements = Measurements::default();
        let place = Measurement::position(
            1.0,
            [Some(1.0), Some(2.0), None],
            [0.01, 0.0, 0.0, 0.01, 0.0, 0.0],
        );
        measurements.push(&place.unwrap(), None).unwrap();
        measurements.advance(&mut filter, (1.0, 0.0), &unknown);
        let found = filter.estimate(0.0).unwrap().position_m;
        assert!(
            (found[0] - 1.0).abs() < 0.02 && (found[2] - 0.2).abs() < 1e-9,
            "{found:?}"
        );
    }
}
