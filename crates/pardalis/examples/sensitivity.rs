//! Sensitivity of detected targets to their settings on the rendered fisheye sequence: each setting is halved and
//! doubled separately.
//!
//! `cargo run -p pardalis --example sensitivity > sensitivity.csv` prints one row per setting and factor: the share
//! of the instants after the first two that have an estimate, the RMSE of the position over these, and the share of
//! these with the true position inside the 95 % ellipsoid.

#[path = "../tests/integration/common/mod.rs"]
mod common;

use common::{FPS, data, detected_ball, fisheye_view, frame, jump_picture, set_of};
use nalgebra::{Matrix3, Vector3};
use pardalis::color::YuvEncoding;
use pardalis::tracker::DetectedSettings;
use pardalis::{FrameSet, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;

/// Number of frames used: the throw and the first bounces.
const FRAMES: usize = 50;
/// Number of instants allowed for detecting the ball.
const FINDING: usize = 2;
const SEEDS: u32 = 5;
/// The 95 % quantile of the chi-squared distribution with three degrees of freedom.
const CHI_SQUARED_95: f64 = 7.815;

/// Multiplies a setting by a factor.
type Scale = fn(&mut DetectedSettings, f64);

const SETTINGS: [(&str, Scale); 10] = [
    ("edge.correspondence_lines", |s, factor| {
        let lines = s.edge.correspondence_lines as f64;
        s.edge.correspondence_lines = (lines * factor) as usize;
    }),
    ("edge.likelihood_exponent", |s, factor| {
        s.edge.likelihood_exponent *= factor;
    }),
    ("edge.shared_sigma_px", |s, factor| {
        s.edge.shared_sigma_px *= factor;
    }),
    ("filter.particles", |s, factor| {
        s.particle_count = (s.particle_count as f64 * factor) as usize;
    }),
    ("existence.birth_rate_hz", |s, factor| {
        s.existence.birth_rate_hz *= factor;
    }),
    ("existence.death_rate_hz", |s, factor| {
        s.existence.death_rate_hz *= factor;
    }),
    ("existence.relocation_rate_hz", |s, factor| {
        s.existence.relocation_rate_hz *= factor;
    }),
    ("existence.velocity_jump_rate_hz", |s, factor| {
        s.existence.velocity_jump_rate_hz *= factor;
    }),
    ("existence.velocity_jump_sigma_mps", |s, factor| {
        s.existence.velocity_jump_sigma_mps *= factor;
    }),
    ("existence.occlusion_rate_hz", |s, factor| {
        s.existence.occlusion.occlusion_hz *= factor;
    }),
];

/// The true positions, metres.
fn truths_m() -> Vec<Vector3<f64>> {
    let table = std::fs::read_to_string(data("dioptric-jump/truth.csv")).unwrap();
    let row = |row: &str| {
        let cells: Vec<&str> = row.split(',').collect();
        Vector3::from([4, 5, 6].map(|column| cells[column].parse().unwrap()))
    };
    table.lines().skip(1).take(FRAMES).map(row).collect()
}

/// Prints a row for these settings.
fn print_row(
    name: &str,
    factor: f64,
    settings: &DetectedSettings,
    sets: &[FrameSet],
    truths_m: &[Vector3<f64>],
) {
    let (mut squares, mut estimated, mut covered) = (0.0, 0_u32, 0_u32);
    for seed in 1..=SEEDS {
        let targets = [settings.clone()];
        let mut tracker = Tracker::new(vec![fisheye_view()], targets, seed, Level::best()).unwrap();
        for (index, (set, truth_m)) in sets.iter().zip(truths_m).enumerate() {
            tracker.observe(set).unwrap();
            let estimate = tracker.estimate_at(TargetId::new(0), set.time_s()).unwrap();
            let Some(known) = estimate.kinematics.filter(|_| index >= FINDING) else {
                continue;
            };
            let off = Vector3::from(known.position_m) - truth_m;
            let [xx, xy, xz, yy, yz, zz] = known.covariance_m2;
            let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let squared = covariance
                .try_inverse()
                .map(|inverse| (off.transpose() * inverse * off)[0]);
            squares += off.norm_squared();
            estimated += 1;
            covered += u32::from(squared.is_some_and(|squared| squared <= CHI_SQUARED_95));
        }
    }
    let all = SEEDS as usize * (sets.len() - FINDING);
    println!(
        "{name},{factor},{:.3},{:.2},{:.3}",
        f64::from(estimated) / all as f64,
        1e3 * (squares / f64::from(estimated)).sqrt(),
        f64::from(covered) / f64::from(estimated)
    );
}

fn main() {
    let set = |index: usize| {
        let time_s = index as f64 / FPS;
        let picture = jump_picture(index);
        set_of(frame(
            &picture,
            PixelFormat::Rgb8,
            YuvEncoding::default(),
            time_s,
        ))
    };
    let sets: Vec<FrameSet> = (0..FRAMES).map(set).collect();
    let truths_m = truths_m();
    println!("setting,factor,estimated,rmse_mm,coverage_95");
    let defaults = detected_ball();
    print_row("defaults", 1.0, &defaults, &sets, &truths_m);
    for (name, scale) in SETTINGS {
        for factor in [0.5, 2.0] {
            let mut settings = defaults.clone();
            scale(&mut settings, factor);
            print_row(name, factor, &settings, &sets, &truths_m);
        }
    }
}
