//! Comparison of complete updates of random filters with the oracle.

use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

use super::oracle::{Before, Drawn, ROUNDING, chances as chances_of};
use super::*;
use crate::gaussian::diagonal_m2;
use crate::motion::{ConstantVelocity, PositionNoise, RandomWalk, VelocityNoise};

/// Most particles per filter.
const PARTICLES: usize = 30;
/// Centre of all positions, metres.
const MIDDLE_M: [f64; 3] = [1.0, -0.5, 2.3];

/// The images of one update.
#[derive(Debug, Clone)]
struct Images {
    dt_s: f64,
    components: Vec<MeasurementComponent>,
    max_log_ratio: f64,
    /// Height (nats) and width (metres) of the likelihood's peak, at the first component or the centre.
    peak: [f64; 2],
    /// Amplitude (nats) and wave number (radians per metre) of its waves.
    waves: [f64; 2],
    /// One in this number of particles is impossible.
    impossible_one_in: usize,
}

impl Images {
    fn log_ratios(&self, particles: &Particles, out: &mut [f32]) {
        let first = self.components.first();
        let peak_m = first.map_or(MIDDLE_M, |component| component.position_m);
        let [height, width_m] = self.peak;
        let [amplitude, frequency] = self.waves;
        for (i, out) in out.iter_mut().enumerate() {
            let position_m = particles.position_m(i);
            let squares = position_m.iter().zip(peak_m).map(|(a, b)| (a - b).powi(2));
            let squared = squares.sum::<f64>() / width_m.powi(2);
            let waves = amplitude * (frequency * position_m[0]).sin();
            *out = ((height - 0.5 * squared).max(-20.0) + waves) as f32;
            if i % self.impossible_one_in == 1 {
                *out = [f32::NAN, f32::NEG_INFINITY][i % 2];
            }
        }
    }
}

fn proposal() -> impl Strategy<Value = ProposalTuning> {
    let share = || 0.05..0.95_f64;
    let shares = [share(), share(), share(), share(), share(), share()];
    let others = (1.0..4.0_f64, 2..8_usize, 0.05..0.95_f64);
    let drawn = (shares, others).prop_map(|(shares, others)| {
        let (birth_widening, jump_one_in, effective_share) = others;
        let [birth, even, predicted, resample, effective, matched] = shares;
        ProposalTuning {
            birth_share: birth,
            even_birth_share: even,
            birth_widening,
            predicted_share: predicted,
            resample_below: resample,
            jump_one_in,
            min_effective_share: effective,
            effective_share,
            moment_matched_birth_share: matched,
        }
    });
    prop_oneof![Just(ProposalTuning::DEFAULT), drawn]
}

fn settings() -> impl Strategy<Value = BernoulliSettings> {
    let noise = (0.1..5.0_f64, any::<bool>(), any::<bool>());
    let motion = noise.prop_map(|(density, is_walk, is_planar)| {
        let motion: Motion = if is_walk {
            let density_m2ps = density;
            let noise = PositionNoise::Diffusion { density_m2ps };
            RandomWalk::new(noise).unwrap().into()
        } else {
            let acceleration_density_m2ps3 = density;
            let noise = VelocityNoise::White {
                acceleration_density_m2ps3,
            };
            ConstantVelocity::new(noise).unwrap().into()
        };
        if is_planar { motion.in_plane() } else { motion }
    });
    let rate = || prop_oneof![Just(0.0), 0.01..2.0_f64];
    let jumps = (prop_oneof![Just(0.0), 0.1..5.0_f64], 0.0..5.0_f64);
    let births = (1e-3..1.0_f64, 0.0..3.0_f64);
    let max = PARTICLES;
    let particles = (8..=max).prop_map(move |min| ParticleRange { min, max });
    let particles = prop_oneof![Just(ParticleRange::fixed(max)), particles];
    let rates = [rate(), rate(), rate()];
    (motion, rates, births, jumps, proposal(), particles).prop_map(
        |(motion, [birth, death, relocation], births, jumps, proposal, particles)| {
            BernoulliSettings {
                particles,
                birth_rate_hz: birth,
                death_rate_hz: death,
                relocation_rate_hz: relocation,
                birth_density: births.0,
                birth_velocity_sigma_mps: births.1,
                velocity_jump_rate_hz: jumps.0,
                velocity_jump_sigma_mps: jumps.1,
                proposal,
                ..BernoulliSettings::of(motion)
            }
        },
    )
}

fn component() -> impl Strategy<Value = MeasurementComponent> {
    let off_m = || -1.0..1.0_f64;
    let angle_rad = || -3.0..3.0_f64;
    let sigma_m = || 0.01..0.5_f64;
    (
        [off_m(), off_m(), off_m()],
        [angle_rad(), angle_rad(), angle_rad()],
        [sigma_m(), sigma_m(), sigma_m()],
        -5.0..5.0_f64,
    )
        .prop_map(|(off_m, [roll, pitch, yaw], sigmas_m, log_weight)| {
            let axes = Rotation3::from_euler_angles(roll, pitch, yaw);
            let variances = Matrix3::from_diagonal(&sigmas_m.map(|sigma| sigma * sigma).into());
            let covariance = axes.matrix() * variances * axes.matrix().transpose();
            MeasurementComponent {
                position_m: [0, 1, 2].map(|axis| MIDDLE_M[axis] + off_m[axis]),
                covariance_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
                    .map(|at| covariance[at]),
                log_weight,
            }
        })
}

fn images() -> impl Strategy<Value = Images> {
    let dt_s = prop_oneof![1 => Just(0.0), 9 => 0.005..0.5_f64];
    let components = prop::collection::vec(component(), 0..4);
    let max_log_ratio = prop_oneof![Just(f64::INFINITY), -2.0..5.0_f64];
    let peak = [0.0..25.0_f64, 0.0..25.0_f64]
        .prop_map(|[height, width]| [height, 0.01 * (0.18 * width).exp()]);
    let waves = (0.0..3.0_f64, 1.0..20.0_f64);
    let impossible = prop_oneof![Just(usize::MAX), 2..9_usize];
    (dt_s, components, max_log_ratio, peak, waves, impossible).prop_map(
        |(dt_s, components, max_log_ratio, peak, waves, impossible_one_in)| Images {
            dt_s,
            components,
            max_log_ratio,
            peak,
            waves: waves.into(),
            impossible_one_in,
        },
    )
}

fn start() -> impl Strategy<Value = (GaussianStart, f64)> {
    let sigma_m = || 0.0..0.3_f64;
    let sigma_mps = || 0.0..2.0_f64;
    let existence = prop_oneof![1 => Just(0.0), 1 => Just(1.0), 8 => 0.01..1.0_f64];
    let sigmas = (
        [sigma_m(), sigma_m(), sigma_m()],
        [sigma_mps(), sigma_mps(), sigma_mps()],
    );
    (sigmas, existence).prop_map(|((position, velocity_sigma_mps), existence)| {
        let start = GaussianStart {
            position_m: MIDDLE_M,
            covariance_m2: diagonal_m2(position),
            velocity_mps: [0.5, 0.0, -0.3],
            velocity_sigma_mps,
        };
        (start, existence)
    })
}

/// Asserts that two numbers are equal except for rounding.
fn check((found, expected): (f64, f64), rounding: f64, what: &str) {
    let allowed = rounding * expected.abs() + 1e-14;
    assert!(
        (found - expected).abs() <= allowed,
        "{what}: {found:e} for {expected:e}"
    );
}

/// Returns the positions of the first draw of the next update in double precision. The update draws the same ones.
fn first_positions_m(filter: &mut BernoulliFilter, images: &Images, count: usize) -> Vec<[f64; 3]> {
    let before = filter.observation;
    filter.observation = before.wrapping_add(1);
    let prior = filter.prior();
    let elsewhere = prior.elsewhere / (prior.located + prior.elsewhere);
    filter.proposal.condition_on(&images.components, elsewhere);
    filter.resize_new(count);
    filter.draw_new(&prior);
    filter.observation = before;
    positions_m(&filter.new_hypotheses)
}

fn positions_m(hypotheses: &[Hypothesis]) -> Vec<[f64; 3]> {
    let positions_m = hypotheses.iter().map(|hypothesis| hypothesis.position_m);
    positions_m.collect()
}

/// Returns the weights times likelihood ratios, and their sum, which is 0 if no particle is possible, as with few of them where the target was predicted.
fn weighted(drawn: &Drawn, log_ratios: &[f32]) -> (Vec<f64>, f64) {
    let ratio = |log: &f32| {
        if log.is_nan() {
            0.0
        } else {
            f64::from(*log).exp()
        }
    };
    let products = drawn.weights.iter().zip(log_ratios);
    let products: Vec<f64> = products.map(|(w, log)| w * ratio(log)).collect();
    let sum: f64 = products.iter().sum();
    (products.iter().map(|w| w / sum).collect(), sum)
}

/// Reports whether all particles are impossible.
fn are_impossible(log_ratios: &[f32]) -> bool {
    let is_impossible = |log: &f32| log.is_nan() || *log == f32::NEG_INFINITY;
    log_ratios.iter().all(is_impossible)
}

/// Runs one update and compares the complete result with the oracle.
fn check_update(filter: &mut BernoulliFilter, images: &Images) {
    filter.predict(images.dt_s);
    let (hypotheses, weights) = (filter.hypotheses.clone(), filter.weights.clone());
    let prior = filter.prior();
    let chances = [prior.located, prior.elsewhere, prior.absent];
    let expected = chances_of(&filter.settings, filter.existence, images.dt_s);
    for (found, expected) in chances.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-13, "{found} for {expected}");
    }
    let [located, elsewhere, absent] = chances;
    let exists = located + elsewhere;
    let before = Before {
        settings: filter.settings,
        hypotheses: &hypotheses,
        weights: &weights,
        dt_s: images.dt_s,
        chances,
        components: &images.components,
    };

    let first_m = first_positions_m(filter, images, before.first_count());
    let mut answers: Vec<Vec<f32>> = Vec::new();
    filter.update(
        &images.components,
        images.max_log_ratio,
        |particles, out| {
            images.log_ratios(particles, out);
            answers.push(out.to_vec());
        },
    );
    let Some(first_answer) = answers.first() else {
        assert!(located == 0.0 && (images.components.is_empty() || exists == 0.0));
        assert_eq!((filter.existence(), &filter.weights), (0.0, &weights));
        return;
    };

    let (draws, observation) = (filter.draws, filter.observation);
    let resampling = draws.uniform(0, observation, Stage::Resampling);
    let births = |i: usize| draws.uniform(i as u32, observation, Stage::Proposal);
    let mut drawn = before.first_draw(&first_m, resampling, births);
    let (mut expected, mut sum) = weighted(&drawn, first_answer);
    if sum == 0.0 && !are_impossible(first_answer) {
        // The densities are too small for numbers that are not logarithms.
        assert!((0.0..=1.0).contains(&filter.existence()));
        return;
    }
    let is_drawn_again = before.is_drawn_again(&expected);
    let needed = before.needed(&expected).filter(|_| !is_drawn_again);
    if let Some(needed) = needed {
        assert_eq!((answers.len(), answers[1].len()), (2, needed));
        if are_impossible(&answers[1]) {
            assert!((0.0..=1.0).contains(&filter.existence()));
            return;
        }
        drawn = before.first_draw(&positions_m(&filter.hypotheses), resampling, births);
        (expected, sum) = weighted(&drawn, &answers[1]);
    }
    if sum == 0.0 {
        assert!((0.0..=1.0).contains(&filter.existence()));
        return;
    }
    let evidence = sum.min(exists * images.max_log_ratio.exp());
    let existence = evidence / (evidence + absent);
    let found = filter.existence();
    check((found, existence), ROUNDING, "existence");
    check((1.0 - found, 1.0 - existence), ROUNDING, "absence");

    let is_first_kept = !is_drawn_again && needed.is_none();
    assert_eq!(answers.len(), if is_first_kept { 1 } else { 2 });
    if is_drawn_again {
        let uniforms = |i: usize| {
            let [_, jump, birth, _] = draws.uniforms(i as u32, observation, Stage::Moments);
            [jump, birth]
        };
        drawn = before.moment_matched_draw(&positions_m(&filter.hypotheses), uniforms);
        (expected, sum) = weighted(&drawn, &answers[1]);
        if sum == 0.0 {
            return;
        }
    } else if is_first_kept {
        assert_eq!(positions_m(&filter.hypotheses), first_m);
    }
    for (i, (found, expected)) in filter.weights.iter().zip(&expected).enumerate() {
        check((*found, *expected), drawn.rounding, &format!("weight {i}"));
    }
    for (i, (found, expected)) in filter.hypotheses.iter().zip(&drawn.hypotheses).enumerate() {
        // If both densities vanish, rounding decides whether a particle was elsewhere, but its weight is zero.
        if filter.weights[i] < 1e-12 {
            continue;
        }
        let [found_mps, expected_mps] = [found, expected].map(|h| Vector3::from(h.velocity_mps));
        assert!(
            (found_mps - expected_mps).norm() <= drawn.rounding * expected_mps.norm() + 1e-14,
            "velocity {i}: {:?} for {:?}",
            found.velocity_mps,
            expected.velocity_mps
        );
        let compared = (
            found.velocity_variance_m2ps2,
            expected.velocity_variance_m2ps2,
        );
        check(compared, drawn.rounding, &format!("velocity variance {i}"));
    }
}

proptest! {
    #[test]
    fn an_update_is_the_oracles(
        settings in settings(),
        (start, existence) in start(),
        seed in any::<u32>(),
        updates in prop::collection::vec(images(), 1..4),
    ) {
        let mut filter = BernoulliFilter::new(settings, Draws::new(seed, 0)).unwrap();
        filter.start(&start, existence).unwrap();
        for images in &updates {
            check_update(&mut filter, images);
        }
    }
}

/// A change of a filter, with its name.
type Change<'a> = (&'a str, &'a mut dyn FnMut(&mut BernoulliFilter));

#[test]
fn whatever_changes_the_filter_changes_its_estimate() {
    let settings = BernoulliSettings::of(Motion::DEFAULT);
    let mut filter = BernoulliFilter::new(settings, Draws::new(3, 0)).unwrap();
    let component = MeasurementComponent {
        position_m: [0.2, 0.0, 1.0],
        covariance_m2: diagonal_m2([0.1; 3]),
        log_weight: 0.0,
    };
    let measurement = crate::Measurement::position(
        0.0,
        [Some(0.1), Some(0.1), Some(1.0)],
        diagonal_m2([0.1; 3]),
    )
    .unwrap();
    let mut changes: [Change; 7] = [
        ("start", &mut |filter| {
            let start = GaussianStart {
                position_m: [0.0, 0.0, 1.0],
                covariance_m2: diagonal_m2([0.3; 3]),
                ..GaussianStart::default()
            };
            filter.start(&start, 0.9).unwrap();
        }),
        ("predict", &mut |filter| filter.predict(0.1)),
        ("update", &mut |filter| {
            filter.update(&[component], 9.0, |_, out| out.fill(1.0));
        }),
        ("keep", &mut |filter| filter.keep(|[x, ..]| x > 0.1)),
        ("measure", &mut |filter| {
            let measured = filter.measure(&measurement, 0.0, [0.0; 6]);
            assert_eq!(measured, Measured::Used);
        }),
        ("predict again", &mut |filter| filter.predict(0.1)),
        ("rates", &mut |filter| {
            filter.set_births(0.0, 1e9).unwrap();
        }),
    ];
    for (name, change) in &mut changes {
        let before = filter.estimate(0.0);
        change(&mut filter);
        let after = filter.estimate(0.0);
        assert_eq!(after, filter.estimate_ahead(0.0), "{name}");
        assert_ne!(after, before, "{name}");
    }
}
