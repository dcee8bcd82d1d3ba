//! Counter-based random numbers: each number is a function of its purpose alone, not of the numbers
//! drawn before.
//!
//! The generator is Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC
//! 2011). Its key is (seed, target) and its counter is (particle, observation, stage, draw). Any
//! thread can therefore draw the numbers of any particle in any order.

use crate::real::{ln_f32, sin_cos_turns_f32};
use crate::simd::Level;

/// Returns four random 32-bit words for a counter and a key.
#[inline(always)]
pub fn philox4x32_10(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let a = u64::from(counter[0]) * 0xD251_1F53;
        let b = u64::from(counter[2]) * 0xCD9E_8D57;
        counter = [
            (b >> 32) as u32 ^ counter[1] ^ key[0],
            b as u32,
            (a >> 32) as u32 ^ counter[3] ^ key[1],
            a as u32,
        ];
        key = [
            key[0].wrapping_add(0x9E37_79B9),
            key[1].wrapping_add(0xBB67_AE85),
        ];
    }
    counter
}

/// The purpose of a random number. The values are part of the counter: changing one changes every
/// result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Stage {
    /// Initial particles.
    Start = 0,
    /// Process noise of the motion model.
    Motion = 1,
    /// Selection of survivors.
    Resampling = 2,
    /// Positions along the ray through a selected pixel.
    Ray = 3,
    /// Noise of simulated pixels.
    Pixel = 4,
    /// Exposure times of simulated cameras.
    Clock = 5,
    /// Clock drifts of simulated cameras.
    Drift = 6,
    /// Simulated still images from which colours are learnt.
    Still = 7,
    /// Jumps of a random walk and their destinations.
    Jump = 8,
    /// Component of the proposal and previous state (followed or relocated) of a particle.
    Proposal = 9,
    /// Blocks of the bootstrap, which estimates the uncertainty of a series' mean.
    Bootstrap = 10,
    /// Component of the moment-matched proposal and previous state (followed, velocity jump or
    /// relocated) of a particle that is resampled because few particles agree with the images.
    Moments = 11,
    /// Simulated detectors: misses, errors of sides, scores.
    Box = 12,
    /// Boxes of simulated detectors around nothing.
    Clutter = 13,
}

/// The random numbers of one target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Draws {
    key: [u32; 2],
}

impl Draws {
    /// Creates the random numbers of a target from the seed and the target's index.
    pub fn new(seed: u32, target: u32) -> Self {
        Self {
            key: [seed, target],
        }
    }

    /// Returns a number in `[0, 1)` with 53 random bits.
    pub fn uniform(self, particle: u32, observation: u32, stage: Stage) -> f64 {
        let [a, b, ..] = philox4x32_10([particle, observation, stage as u32, 0], self.key);
        ((u64::from(a) << 21) ^ (u64::from(b) >> 11)) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Returns four independent numbers in `[0, 1)` with 32 random bits each.
    pub fn uniforms(self, particle: u32, observation: u32, stage: Stage) -> [f64; 4] {
        philox4x32_10([particle, observation, stage as u32, 0], self.key)
            .map(|word| f64::from(word) * (1.0 / (1_u64 << 32) as f64))
    }

    /// Returns four independent standard normal numbers (Box and Muller 1958). `draw` is the index
    /// of the block among those of the same particle, observation and stage.
    #[inline(always)]
    pub fn normals(self, particle: u32, observation: u32, stage: Stage, draw: u32) -> [f32; 4] {
        let words = philox4x32_10([particle, observation, stage as u32, draw], self.key);
        let (a, b) = box_muller(words[0], words[1]);
        let (c, d) = box_muller(words[2], words[3]);
        [a, b, c, d]
    }

    /// Fills rows with standard normal numbers for consecutive particles: `out[j][i]` is the j-th
    /// number of particle `first + i`. All rows must have the same length.
    pub fn fill_normals<const ROWS: usize>(
        self,
        level: Level,
        first: u32,
        observation: u32,
        stage: Stage,
        out: [&mut [f32]; ROWS],
    ) {
        level.run(
            #[inline(always)]
            || self.fill_normals_body(first, observation, stage, out),
        );
    }

    #[inline(always)]
    fn fill_normals_body<const ROWS: usize>(
        self,
        first: u32,
        observation: u32,
        stage: Stage,
        out: [&mut [f32]; ROWS],
    ) {
        const LANES: usize = 16;
        let count = out.first().map_or(0, |row| row.len());
        for start in (0..count).step_by(LANES) {
            let lanes = LANES.min(count - start);
            for block in 0..ROWS.div_ceil(4) {
                let mut normals = [[0_f32; LANES]; 4];
                for lane in 0..LANES {
                    let particle = first + (start + lane) as u32;
                    let four = self.normals(particle, observation, stage, block as u32);
                    for j in 0..4 {
                        normals[j][lane] = four[j];
                    }
                }
                for (j, row) in normals.iter().enumerate().take(ROWS - 4 * block) {
                    out[4 * block + j][start..start + lanes].copy_from_slice(&row[..lanes]);
                }
            }
        }
    }
}

/// Converts two random words to two independent standard normal numbers.
#[inline(always)]
fn box_muller(a: u32, b: u32) -> (f32, f32) {
    const UNIT: f32 = 1.0 / (1 << 24) as f32;
    // The radius lies in (0, 1): its logarithm is finite and the largest result is 5.8.
    let radius_uniform = ((a >> 8) as f32 + 0.5) * UNIT;
    let turns = (b >> 8) as f32 * UNIT;
    let radius = (-2.0 * ln_f32(radius_uniform)).sqrt();
    let (sin, cos) = sin_cos_turns_f32(turns);
    (radius * cos, radius * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers from the Random123 distribution.
    #[test]
    fn philox_reproduces_known_answers() {
        assert_eq!(
            philox4x32_10([0; 4], [0; 2]),
            [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]
        );
        assert_eq!(
            philox4x32_10([u32::MAX; 4], [u32::MAX; 2]),
            [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]
        );
        assert_eq!(
            philox4x32_10(
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0]
            ),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn normals_have_the_moments_and_tails_of_a_normal_distribution() {
        let draws = Draws::new(7, 0);
        let count = 200_000;
        let mut columns = [vec![0_f32; count], vec![0_f32; count]];
        let [a, b] = &mut columns;
        draws.fill_normals(Level::best(), 0, 3, Stage::Motion, [a, b]);
        for column in &columns {
            let moment =
                |k: i32| column.iter().map(|&x| f64::from(x).powi(k)).sum::<f64>() / count as f64;
            assert!(moment(1).abs() < 0.01);
            assert!((moment(2) - 1.0).abs() < 0.015);
            assert!(moment(3).abs() < 0.03);
            assert!((moment(4) - 3.0).abs() < 0.1);
            let beyond_two = column.iter().filter(|x| x.abs() > 2.0).count() as f64 / count as f64;
            assert!((beyond_two - 0.0455).abs() < 0.0025, "{beyond_two}");
        }
        let covariance = columns[0]
            .iter()
            .zip(&columns[1])
            .map(|(&x, &y)| f64::from(x * y))
            .sum::<f64>()
            / count as f64;
        assert!(covariance.abs() < 0.01);
    }

    #[test]
    fn filling_in_chunks_gives_the_same_numbers_at_every_level() {
        let draws = Draws::new(1, 2);
        let mut whole = vec![0_f32; 103];
        draws.fill_normals(Level::BASELINE, 0, 5, Stage::Start, [&mut whole]);
        for level in Level::available() {
            let mut chunks = vec![0_f32; 103];
            let (head, tail) = chunks.split_at_mut(37);
            draws.fill_normals(level, 0, 5, Stage::Start, [head]);
            draws.fill_normals(level, 37, 5, Stage::Start, [tail]);
            assert_eq!(whole, chunks);
        }
    }
}
