//! The best particle is the most likely one, not the one with the greatest importance weight.

use std::cell::RefCell;

use nalgebra::Vector3;
use pardalis_filter::bernoulli::MeasurementComponent;

use super::{START, certain, entries, filter, gaussian_ratio, measured, slanted, velocity};

#[test]
fn the_best_particle_is_the_most_likely_one() {
    let covariance = slanted(0.1, 0.02);
    let ratio_of = |position_m| gaussian_ratio(position_m, covariance, 5.0);
    let mut tracked = filter(&certain(velocity()), 5);
    tracked.start(&START, 1.0).unwrap();
    let mut coincidences = 0;
    for step in 0..20 {
        let position_m = measured(step, 0.04 * step as f64, &covariance);
        let component = MeasurementComponent {
            position_m: position_m.into(),
            covariance_m2: entries(&covariance),
            log_weight: 1.0,
        };
        tracked.predict(0.04);
        let likeliest = RefCell::new([0.0; 3]);
        tracked.update(&[component], f64::INFINITY, |particles, out| {
            ratio_of(position_m)(particles, out);
            let best = (0..out.len()).max_by(|&a, &b| out[a].total_cmp(&out[b]));
            *likeliest.borrow_mut() = particles.position_m(best.unwrap());
        });
        let best_m = tracked.estimate(0.0).unwrap().best_position_m;
        let off = Vector3::from(best_m) - Vector3::from(*likeliest.borrow());
        // Positions are passed to kernels in single precision.
        assert!(off.norm() < 1e-6, "step {step}: {off}");
        let weights = tracked.weights();
        let heaviest = (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b]));
        let heaviest_m = tracked.particles().position_m(heaviest.unwrap());
        coincidences +=
            usize::from((Vector3::from(heaviest_m) - Vector3::from(best_m)).norm() < 1e-6);
    }
    assert!(coincidences < 10, "{coincidences} of 20");
}

#[test]
fn the_best_particle_is_extrapolated_with_its_own_velocity() {
    let covariance = slanted(0.05, 0.01);
    let mut tracked = filter(&certain(velocity()), 6);
    tracked.start(&START, 1.0).unwrap();
    let position_m = measured(0, 0.0, &covariance);
    tracked.predict(0.04);
    tracked.update(
        &[],
        f64::INFINITY,
        gaussian_ratio(position_m, covariance, 0.0),
    );
    let [now, later] = [0.0, 0.5].map(|at| tracked.estimate(at).unwrap().best_position_m);
    let particles = tracked.particles();
    let near = |i: &usize| {
        let off = Vector3::from(particles.position_m(*i)) - Vector3::from(now);
        off.norm() < 1e-6
    };
    let best = (0..particles.count()).find(near).expect("a particle");
    let velocity_mps = [3, 4, 5].map(|column| f64::from(particles.columns()[column][best]));
    for axis in 0..3 {
        let moved_m = later[axis] - now[axis];
        assert!(
            (moved_m - 0.5 * velocity_mps[axis]).abs() < 1e-5,
            "axis {axis}: {moved_m}"
        );
    }
}
