//! Sensitivity of detected targets to their settings and tuned constants: each is halved and doubled separately, the odds
//! of shares likewise.
//!
//! `cargo run -p pardalis --example sensitivity > sensitivity.csv` prints one row per setting and factor. The columns of the
//! rendered sequences `thrown` (data/dioptric-jump) and `hidden` (data/dioptric-occlusion-bar) are the share of the instants
//! after the first two that have an estimate, the RMSE of the position over these, and the share of these with the true
//! position inside the 95 % ellipsoid. The columns of the real clip `real` (data/real-balls/half/roll) are the share of the
//! frames with the ball in view that are tracked within one radius of its centre, and the share of all judged frames that
//! are tracked more than 1.5 radii from it or while it is hidden. The first rows are the defaults with different seeds.

#[path = "../tests/integration/common/mod.rs"]
mod common;

use common::{FPS, data, detected_ball, fisheye_view, frame, open, set_of};
use nalgebra::{Point3, Vector3};
use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorLearner, Palette, YuvEncoding};
use pardalis::filter::bernoulli::ParticleRange;
use pardalis::filter::estimate::covariance_matrix;
use pardalis::tracker::{DetectedSettings, TrackState};
use pardalis::tuning::Tuning;
use pardalis::{Estimate, FrameSet, PixelFormat, TargetId, Tracker, View};
use pardalis_core::simd::Level;
use std::ops::Range;

/// Number of instants allowed for detecting the ball.
const FINDING: usize = 2;
/// Number of seeds per row.
const SEEDS: u32 = 3;
/// Number of rows of the defaults.
const REPETITIONS: u32 = 5;
/// The 95 % quantile of the chi-squared distribution with three degrees of freedom.
const CHI_SQUARED_95: f64 = 7.815;
/// The real clip at half size: size in pixels, frame rate in frames per second, assumed radius of the ball in metres.
const ROLL_SIZE: (usize, usize) = (480, 270);
const ROLL_FPS: f64 = 30.0;
const ROLL_RADIUS_M: f64 = 0.035;

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
        s.particles = ParticleRange::fixed((s.particles.max as f64 * factor) as usize);
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

/// A sequence with the truth of each frame.
struct Sequence<T> {
    view: View,
    sets: Vec<FrameSet>,
    truth: Vec<T>,
}

/// A true circle in the image, in pixels.
#[derive(Clone, Copy)]
struct Circle {
    center_px: [f64; 2],
    radius_px: f64,
    /// The share of the disc in view: 0 if the ball is hidden, NaN if the frame could not be judged.
    visible: f64,
}

impl Circle {
    /// Reads columns from `u_px` on, of the clip at full size, for images of half the size. Empty cells are NaN.
    fn of(cells: &[&str]) -> Self {
        let number = |column: usize| {
            let cell = cells.get(column).and_then(|cell| cell.parse().ok());
            cell.unwrap_or(f64::NAN)
        };
        Self {
            center_px: [0, 1].map(|i| 0.5 * (number(i) + 0.5) - 0.5),
            radius_px: 0.5 * number(2),
            visible: number(3),
        }
    }

    /// Returns the distance from the centre in radii.
    fn radii(&self, [u, v]: [f64; 2]) -> f64 {
        (u - self.center_px[0]).hypot(v - self.center_px[1]) / self.radius_px
    }
}

/// Reads the frames of a folder.
fn sets(folder: &str, numbers: Range<usize>, fps: f64) -> Vec<FrameSet> {
    let set = |number: usize| {
        let picture = open(&format!("{folder}/{number:06}.jpg"));
        let (encoding, time_s) = (YuvEncoding::default(), number as f64 / fps);
        set_of(frame(&picture, PixelFormat::Rgb8, encoding, time_s))
    };
    numbers.map(set).collect()
}

/// Returns what `of` makes of each row of a table.
fn rows<T>(path: &str, of: impl Fn(&[&str]) -> T) -> Vec<T> {
    let table = std::fs::read_to_string(data(path)).unwrap();
    let rows = table.lines().skip(1);
    rows.map(|row| of(&row.split(',').collect::<Vec<_>>()))
        .collect()
}

/// Opens a rendered sequence with the true positions, metres.
fn rendered(folder: &str, numbers: Range<usize>) -> Sequence<Vector3<f64>> {
    let position = |cells: &[&str]| Vector3::from([4, 5, 6].map(|i| cells[i].parse().unwrap()));
    Sequence {
        view: fisheye_view(),
        truth: rows(&format!("{folder}/truth.csv"), position),
        sets: sets(&format!("{folder}/frames"), numbers, FPS),
    }
}

/// Opens the real clip with the true circles.
fn real() -> Sequence<Circle> {
    let f_px = 0.5 * ROLL_SIZE.0 as f64 / 30_f64.to_radians().tan();
    let center_px = [ROLL_SIZE.0, ROLL_SIZE.1].map(|size| 0.5 * (size - 1) as f64);
    let lens = Pinhole::new([f_px; 2], center_px, &[]).unwrap();
    let truth = rows("real-balls/roll/truth.csv", |cells| {
        Circle::of(&cells[2..6])
    });
    Sequence {
        view: View::new(lens, Pose::identity(), ROLL_SIZE, None).unwrap(),
        sets: sets("real-balls/half/roll", 0..truth.len(), ROLL_FPS),
        truth,
    }
}

/// Returns the real ball with default settings.
fn real_ball() -> DetectedSettings {
    let mut learner = ColorLearner::new(Palette::HSI).unwrap();
    for (number, circle) in rows("real-balls/roll/labels.csv", |cells| {
        let number: usize = cells[0].parse().unwrap();
        (number, Circle::of(&cells[2..]))
    }) {
        let picture = open(&format!("real-balls/half/roll/{number:06}.jpg"));
        let (width, height) = ROLL_SIZE;
        let is_ball = |i: usize| circle.radii([(i % width) as f64, (i / width) as f64]) <= 1.0;
        let labels: Vec<bool> = (0..width * height).map(is_ball).collect();
        let frame = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0);
        learner.add(&frame, &labels).unwrap();
    }
    DetectedSettings::ball(ROLL_RADIUS_M, learner.learn().unwrap()).unwrap()
}

impl<T> Sequence<T> {
    /// Tracks with these settings and seeds. Calls `score` with each estimate and the truth, after the first instants.
    fn track(
        &self,
        settings: &DetectedSettings,
        seeds: Range<u32>,
        mut score: impl FnMut(&Estimate, &T),
    ) {
        for seed in seeds {
            let targets = [settings.clone()];
            let views = vec![self.view.clone()];
            let mut tracker = Tracker::new(views, targets, seed, Level::best()).unwrap();
            for (index, (set, truth)) in self.sets.iter().zip(&self.truth).enumerate() {
                tracker.observe(set).unwrap();
                if index >= FINDING {
                    score(&tracker.estimate(TargetId::new(0)).unwrap(), truth);
                }
            }
        }
    }
}

/// Returns the share of instants with an estimate, the RMSE in millimetres, and the coverage of the 95 % ellipsoid.
fn position_scores(
    sequence: &Sequence<Vector3<f64>>,
    settings: &DetectedSettings,
    seeds: Range<u32>,
) -> [f64; 3] {
    let (mut squares, mut all, mut estimated, mut covered) = (0.0, 0_u32, 0_u32, 0_u32);
    sequence.track(settings, seeds, |estimate, truth_m| {
        all += 1;
        let Some(known) = &estimate.kinematics else {
            return;
        };
        let off = Vector3::from(known.position_m) - truth_m;
        let squared = covariance_matrix(known.covariance_m2)
            .try_inverse()
            .map(|inverse| (off.transpose() * inverse * off)[0]);
        squares += off.norm_squared();
        estimated += 1;
        covered += u32::from(squared.is_some_and(|squared| squared <= CHI_SQUARED_95));
    });
    let estimated = f64::from(estimated);
    [
        estimated / f64::from(all),
        1e3 * (squares / estimated).sqrt(),
        f64::from(covered) / estimated,
    ]
}

/// Returns the share of the frames with the ball in view that are tracked on it, and the share of wrong frames, as
/// `experiments/real-balls` defines them.
fn circle_scores(
    sequence: &Sequence<Circle>,
    settings: &DetectedSettings,
    seeds: Range<u32>,
) -> [f64; 2] {
    let (mut visible, mut judged, mut right, mut wrong) = (0_u32, 0_u32, 0_u32, 0_u32);
    sequence.track(settings, seeds, |estimate, circle| {
        if circle.visible.is_nan() {
            return;
        }
        judged += 1;
        let known = estimate.kinematics.as_ref();
        let tracked_px = known
            .filter(|_| estimate.state == TrackState::Tracking)
            .and_then(|known| {
                let view = &sequence.view;
                let point = view.world_from_camera().inverse() * Point3::from(known.position_m);
                view.camera().project(point.into())
            });
        let radii = match tracked_px {
            Some(px) if circle.visible > 0.0 => circle.radii(px),
            _ => f64::INFINITY,
        };
        let is_visible = circle.visible >= 0.6;
        visible += u32::from(is_visible);
        right += u32::from(is_visible && radii <= 1.0);
        wrong += u32::from(tracked_px.is_some() && radii > 1.5);
    });
    [
        f64::from(right) / f64::from(visible),
        f64::from(wrong) / f64::from(judged),
    ]
}

/// Multiplies a tuned constant by a factor, or the odds of a share.
fn scale_constant(tuning: &mut Tuning, constant: &str, factor: f64) {
    tuning.visit(&mut |name, unit, value| {
        if name != constant {
            return;
        }
        let scaled = factor * *value;
        *value = if unit == "share" {
            scaled / (1.0 - *value + scaled)
        } else {
            scaled
        };
    });
}

fn main() {
    let thrown = rendered("dioptric-jump", 0..50);
    let hidden = rendered("dioptric-occlusion-bar", 0..90);
    let real = real();
    let (rendered_ball, real_ball) = (detected_ball(), real_ball());
    let print_row =
        |name: &str, factor: f64, first_seed: u32, change: &dyn Fn(&mut DetectedSettings)| {
            let seeds = first_seed..first_seed + SEEDS;
            let [rendered_ball, real_ball] = [&rendered_ball, &real_ball].map(|ball| {
                let mut settings = ball.clone();
                change(&mut settings);
                settings
            });
            print!("{name},{factor}");
            for sequence in [&thrown, &hidden] {
                let [estimated, rmse_mm, coverage] =
                    position_scores(sequence, &rendered_ball, seeds.clone());
                print!(",{estimated:.3},{rmse_mm:.1},{coverage:.3}");
            }
            let [on_ball, wrong] = circle_scores(&real, &real_ball, seeds);
            println!(",{on_ball:.3},{wrong:.3}");
        };
    println!(
        "setting,factor,thrown_estimated,thrown_rmse_mm,thrown_coverage_95,hidden_estimated,hidden_rmse_mm,\
         hidden_coverage_95,real_on_ball,real_wrong"
    );
    for repetition in 0..REPETITIONS {
        print_row("defaults", 1.0, 1 + repetition * SEEDS, &|_| {});
    }
    let mut constants = Vec::new();
    Tuning::default().visit(&mut |name, _, _| constants.push(name.to_owned()));
    for factor in [0.5, 2.0] {
        for (name, scale) in SETTINGS {
            print_row(name, factor, 1, &|settings| scale(settings, factor));
        }
        for name in &constants {
            print_row(&format!("tuning.{name}"), factor, 1, &|settings| {
                scale_constant(&mut settings.tuning, name, factor);
            });
        }
    }
}
