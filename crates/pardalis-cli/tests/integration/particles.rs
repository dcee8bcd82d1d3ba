//! The output of particles and of the best one, and its independence of the number of threads, for detected and for
//! initialised targets.

use std::fs;

use crate::common::{SCENE, Workplace, rows_in};

const FRAMES: usize = 6;

/// The scene without any settings: the ball is a detected target.
fn detected() -> String {
    let (before, _) = SCENE.split_once("contour = ").unwrap();
    before.to_owned()
}

/// One row of a file of particles.
struct Particle {
    frame: usize,
    position_m: [f64; 3],
    weight: f64,
}

/// Returns the rows of a file of particles, which must have the documented columns.
fn particles_in(text: &str) -> Vec<Particle> {
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some("frame,time_s,target,landmark,particle,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,weight")
    );
    let mut rows: Vec<Particle> = Vec::new();
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse::<f64>().unwrap();
        assert_eq!(fields.len(), 12, "{line}");
        assert_eq!((fields[2], fields[3]), ("ball", ""), "{line}");
        assert!((number(1) - number(0) / 25.0).abs() < 1e-12, "{line}");
        assert!((8..11).all(|i| number(i).is_finite()), "{line}");
        let frame = number(0) as usize;
        let before = rows.iter().filter(|row| row.frame == frame).count();
        assert_eq!(number(4) as usize, before, "{line}");
        rows.push(Particle {
            frame,
            position_m: [5, 6, 7].map(number),
            weight: number(11),
        });
    }
    rows
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Runs a scene and compares its particles with its rows; `is_best` reports whether a particle may be the best one of
/// its frame.
fn check(scene: &str, count: usize, is_best: impl Fn(&Particle, &[&Particle]) -> bool) {
    let place = Workplace::with_frames(FRAMES);
    let track = |threads: &str| {
        let arguments = ["-o", "-", "--particles", "cloud.csv", "--threads", threads];
        let rows = place.track_with(scene, &arguments).fine().stdout;
        (rows, fs::read_to_string(place.path("cloud.csv")).unwrap())
    };
    let (tracks, cloud) = track("1");
    for threads in ["2", "8"] {
        assert!(
            track(threads) == (tracks.clone(), cloud.clone()),
            "{threads} threads"
        );
    }
    let without = place.track_with(scene, &["-o", "-"]).fine();
    assert_eq!(without.stdout, tracks, "writing particles changes no row");

    let particles = particles_in(&cloud);
    let rows = rows_in(&tracks);
    let known: Vec<&Vec<String>> = rows.iter().filter(|row| !row[4].is_empty()).collect();
    assert!(known.len() >= FRAMES - 2, "{tracks}");
    assert_eq!(particles.len(), count * known.len());
    for row in known {
        let number = |i: usize| row[i].parse::<f64>().unwrap();
        let of_frame = particles.iter().filter(|p| p.frame == number(0) as usize);
        let of_frame: Vec<&Particle> = of_frame.collect();
        assert_eq!(of_frame.len(), count);
        let total: f64 = of_frame.iter().map(|p| p.weight).sum();
        assert!((total - 1.0).abs() < 1e-9, "{total}");
        let mean_m = [0, 1, 2].map(|axis| {
            let terms = of_frame.iter().map(|p| p.weight * p.position_m[axis]);
            terms.sum::<f64>()
        });
        // Particles are written in single precision.
        assert!(distance_m(mean_m, [4, 5, 6].map(number)) < 1e-6);
        let best_m = [19, 20, 21].map(number);
        let is_there = |p: &&&Particle| distance_m(p.position_m, best_m) < 1e-6;
        let best = of_frame.iter().find(is_there);
        let best = best.unwrap_or_else(|| panic!("{best_m:?} is no particle of frame {}", row[0]));
        assert!(is_best(best, &of_frame), "frame {}", row[0]);
    }
}

#[test]
fn the_best_particle_of_an_initialised_target_has_the_largest_weight() {
    let is_heaviest = |best: &Particle, all: &[&Particle]| {
        all.iter().all(|particle| particle.weight <= best.weight)
    };
    check(SCENE, 100, is_heaviest);
}

#[test]
fn the_best_particle_of_a_detected_target_is_near_the_mean() {
    let is_near = |best: &Particle, all: &[&Particle]| {
        let mean_m = [0, 1, 2].map(|axis| {
            let terms = all.iter().map(|p| p.weight * p.position_m[axis]);
            terms.sum::<f64>()
        });
        let squares = all
            .iter()
            .map(|p| p.weight * distance_m(p.position_m, mean_m).powi(2));
        distance_m(best.position_m, mean_m) < 2.0 * squares.sum::<f64>().sqrt()
    };
    check(&detected(), 500, is_near);
}

#[test]
fn an_unwritable_file_is_rejected_before_tracking() {
    let place = Workplace::with_frames(1);
    let run = place.track_with(SCENE, &["-o", "-", "--particles", "no/such/cloud.csv"]);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(
        run.stderr.contains("--particles: no/such/cloud.csv"),
        "{}",
        run.stderr
    );
}

#[test]
fn a_broken_frame_loses_no_earlier_row_of_a_detected_target() {
    let place = Workplace::with_frames(FRAMES);
    let whole = place.track_with(detected(), &["-o", "-"]).fine().stdout;
    let bytes = fs::read(place.image(4)).unwrap();
    place.write("images/000004.jpg", &bytes[..bytes.len() / 2]);
    let run = place.track_with(detected(), &["-o", "-"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("000004.jpg"), "{}", run.stderr);
    let (found, expected) = (rows_in(&run.stdout), rows_in(&whole));
    let frames: Vec<&str> = found.iter().map(|row| &*row[0]).collect();
    let times: Vec<&str> = found.iter().map(|row| &*row[1]).collect();
    assert_eq!(times, ["0", "0.04", "0.08", "0.12", "0.2"], "{frames:?}");
    assert_eq!(found[..4], expected[..4]);
    assert_eq!(found[4][3], "tracking");
}
