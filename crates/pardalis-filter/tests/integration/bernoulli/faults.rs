//! Rejected settings, and robustness against arbitrary inputs.

use pardalis_core::rng::Draws;
use pardalis_filter::bernoulli::{
    BernoulliFilter, BernoulliSettings, MeasurementComponent, ParticleRange,
};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::motion::{
    AccelerationNoise, ConstantAcceleration, ConstantVelocity, JumpChance, Jumps, Motion,
    PositionNoise, RandomWalk, VelocityNoise,
};
use proptest::prelude::*;

use super::{START, filter, lively, matrix, velocity, walk};

/// Makes settings invalid.
type Break = fn(&mut BernoulliSettings);

#[test]
fn unsupported_motion_and_settings_out_of_range_are_rejected() {
    let jumping = RandomWalk::new(PositionNoise::Diffusion { density_m2ps: 1.0 })
        .unwrap()
        .with_jumps(Jumps::new(JumpChance::PerStep { share: 0.1 }, [0.0; 3], [1.0; 3]).unwrap());
    let walk_by_step = RandomWalk::new(PositionNoise::PerStep { sigma_m: 0.1 }).unwrap();
    let velocity_by_step = ConstantVelocity::new(VelocityNoise::PerStep {
        velocity_sigma_mps: 0.1,
    })
    .unwrap();
    let accelerated = ConstantAcceleration::new(AccelerationNoise::White {
        jerk_density_m2ps5: 1.0,
    })
    .unwrap();
    for motion in [
        jumping.into(),
        walk_by_step.into(),
        velocity_by_step.into(),
        Motion::from(accelerated),
    ] {
        let error =
            BernoulliFilter::new(BernoulliSettings::of(motion), Draws::new(1, 0)).unwrap_err();
        assert!(
            error.to_string().contains("random walk with diffusion"),
            "{error}"
        );
    }
    let good = lively();
    let breaks: [(Break, &str); 8] = [
        (
            |settings| settings.particles = ParticleRange::fixed(0),
            "particles is 0",
        ),
        (|settings| settings.particles.min = 0, "min_particles is 0"),
        (
            |settings| settings.particles.min = 501,
            "min_particles is 501; allowed: 1 to 500",
        ),
        (|settings| settings.birth_rate_hz = -1.0, "birth_rate_hz"),
        (
            |settings| settings.death_rate_hz = f64::NAN,
            "death_rate_hz",
        ),
        (
            |settings| settings.relocation_rate_hz = f64::INFINITY,
            "relocation_rate_hz",
        ),
        (|settings| settings.birth_density = -0.1, "birth_density"),
        (
            |settings| settings.birth_velocity_sigma_mps = -0.1,
            "birth_velocity_sigma_mps",
        ),
    ];
    for (make_invalid, name) in breaks {
        let mut settings = good;
        make_invalid(&mut settings);
        let error = BernoulliFilter::new(settings, Draws::new(1, 0)).unwrap_err();
        assert!(error.to_string().starts_with(name), "{error}");
    }
    let mut filter = filter(&good, 1);
    assert!(filter.start(&START, 1.5).is_err());
    assert!(
        filter
            .start(
                &GaussianStart {
                    position_m: [f64::NAN; 3],
                    ..START
                },
                0.5
            )
            .is_err()
    );
}

/// Checks that weights sum to one, covariances are positive semidefinite, existence is a probability and nothing is
/// NaN.
fn check_invariants(filter: &BernoulliFilter) -> Result<(), TestCaseError> {
    let (existence, located) = (filter.existence(), filter.located());
    prop_assert!((0.0..=1.0).contains(&existence), "{}", existence);
    prop_assert!(
        (0.0..=existence).contains(&located),
        "{} {}",
        located,
        existence
    );
    let sum: f64 = filter.weights().iter().sum();
    prop_assert!((sum - 1.0).abs() < 1e-9, "{}", sum);
    prop_assert!(filter.weights().iter().all(|w| *w >= 0.0));
    prop_assert!(
        filter
            .particles()
            .columns()
            .iter()
            .flatten()
            .all(|v| v.is_finite())
    );
    if let Some(estimate) = filter.estimate(0.1) {
        let covariance = matrix(estimate.covariance_m2);
        let least = covariance.symmetric_eigenvalues().min();
        prop_assert!(least >= -1e-12 * covariance.trace(), "{:?}", estimate);
        let velocity = estimate.velocity_mps.unwrap_or_default();
        let numbers = [estimate.position_m, velocity, estimate.best_position_m];
        prop_assert!(numbers.as_flattened().iter().all(|v| v.is_finite()));
        prop_assert!(estimate.effective_sample_size >= 1.0 - 1e-9);
    }
    let within = filter.weight_within([0.0; 3], 2.0);
    prop_assert!((0.0..=1.0).contains(&within));
    Ok(())
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -5.0..5.0_f64,
        1 => Just(0.0),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
        1 => Just(1e-200),
        1 => Just(9e5),
    ]
}

fn log_ratio() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -600.0..600.0_f32,
        1 => Just(f32::NAN),
        1 => Just(f32::NEG_INFINITY),
        1 => Just(f32::INFINITY),
        1 => Just(f32::MAX),
        1 => Just(f32::MIN),
    ]
}

fn component() -> impl Strategy<Value = MeasurementComponent> {
    let numbers = || prop::array::uniform3(number());
    (numbers(), numbers(), numbers(), number()).prop_map(
        |(position_m, [a, b, c], [d, e, f], log_weight)| MeasurementComponent {
            position_m,
            covariance_m2: [a, b, c, d, e, f],
            log_weight,
        },
    )
}

fn motion() -> impl Strategy<Value = Motion> {
    prop_oneof![
        Just(velocity()),
        Just(velocity().in_plane()),
        Just(walk(0.5)),
        Just(walk(0.0)),
        Just(walk(1e9).in_plane()),
    ]
}

proptest! {
    #[test]
    fn arbitrary_inputs_keep_the_invariants(
        motion in motion(),
        rates_hz in prop::array::uniform3(prop_oneof![0.0..2.0_f64, Just(0.0), Just(1e9)]),
        birth_density in prop_oneof![0.0..2.0_f64, Just(0.0)],
        starts in any::<bool>(),
        steps in prop::collection::vec(
            (
                prop_oneof![6 => 0.0..0.5_f64, 1 => Just(f64::NAN), 1 => Just(-1.0), 1 => Just(f64::INFINITY)],
                prop::collection::vec(component(), 0..4),
                prop::collection::vec(log_ratio(), 1..5),
            ),
            1..8,
        ),
    ) {
        let mut settings = BernoulliSettings::of(motion);
        settings.particles = ParticleRange { min: 20, max: 37 };
        [settings.birth_rate_hz, settings.death_rate_hz, settings.relocation_rate_hz] = rates_hz;
        settings.birth_density = birth_density;
        let mut filter = filter(&settings, 9);
        if starts {
            filter.start(&START, 0.8).unwrap();
        }
        for (dt_s, components, log_ratios) in steps {
            filter.predict(dt_s);
            check_invariants(&filter)?;
            filter.update(&components, f64::INFINITY, |_, out| {
                for (out, log_ratio) in out.iter_mut().zip(log_ratios.iter().cycle()) {
                    *out = *log_ratio;
                }
            });
            check_invariants(&filter)?;
        }
    }
}
