//! Alignment of labelled outlines with the edges that an image shows: people draw outlines too wide, too narrow, with corners, or across fingers.
//!
//! In each sector of the turn the edge is found as the shift of a soft step that fits the memberships best. The outline is then moved and scaled as most sectors
//! agree, and sectors that do not agree teach nothing.

use super::membership::{EdgePixel, Surroundings};

/// Sectors of the turn in which edges are found. Hand-set.
const SECTORS: usize = 32;
/// Shifts of the outline that are tried, in pixels either way and per pixel. Hand-set.
const REACH_PX: f32 = 4.0;
const SHIFTS_PER_PX: f32 = 4.0;
const SHIFTS: usize = 33;
/// Pixels farther from the shifted edge than this do not count, pixels. Hand-set.
const NEAR_PX: f32 = 4.0;
/// The blur of the soft step, a standard deviation in pixels. Hand-set.
const BLUR_PX: f32 = 0.9;
/// A sector shows an edge if the memberships differ from the soft step by no more than this on average (root mean square). Hand-set.
const MAX_RESIDUAL: f32 = 0.25;
/// A sector agrees with the others if its edge lies within this distance of theirs, pixels. Hand-set.
const AGREES_PX: f32 = 1.0;
/// Outlines that lie closer than this to the edge, pixels, are taken as they are: they may say more than the edge, whose half level need not be the outline. Hand-set.
const ROUGH_PX: f32 = 0.5;
/// The least number of sectors that have to agree. Hand-set: three eighths of the turn.
const MIN_AGREEING: usize = 12;

/// Where the edges of one labelled part lie.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Alignment {
    /// By how many pixels the outline grows, and moves to the right and down.
    shift_px: [f32; 3],
    agrees: [bool; SECTORS],
}

impl Alignment {
    /// Finds where the edges lie; `None` if too few sectors agree.
    pub(super) fn of(pixels: &[EdgePixel]) -> Option<Self> {
        let surroundings = Surroundings::of(pixels)?;
        let shifts = edge_shifts(pixels, &surroundings);
        // The outline that most sectors agree with, of those through three of them; then the mean over these sectors.
        let known: Vec<(usize, f32)> = shifts
            .iter()
            .enumerate()
            .filter_map(|(sector, shift)| Some((sector, (*shift)?)))
            .collect();
        let agreeing = |shift_px: &[f32; 3]| {
            let near = |&&(sector, shift): &&(usize, f32)| {
                (shift - shift_at(shift_px, turn_of(sector))).abs() < AGREES_PX
            };
            known.iter().filter(near).copied().collect::<Vec<_>>()
        };
        let mut best: Vec<(usize, f32)> = Vec::new();
        for (i, a) in known.iter().enumerate() {
            for (j, b) in known.iter().enumerate().skip(i + 1) {
                for c in &known[j + 1..] {
                    let through = least_squares(&[*a, *b, *c]).map(|shift| agreeing(&shift));
                    if let Some(through) = through.filter(|found| found.len() > best.len()) {
                        best = through;
                    }
                }
            }
        }
        if best.len() < MIN_AGREEING {
            return None;
        }
        let shift_px = least_squares(&best)?;
        let mut agrees = [false; SECTORS];
        for (sector, _) in agreeing(&shift_px) {
            agrees[sector] = true;
        }
        Some(Self { shift_px, agrees })
    }

    /// By how many pixels the outline has to grow, and to move to the right and down, to lie on the edge; `None` if it does already, but for an edge
    /// `inside_px` pixels further inside.
    pub(super) fn correction_px(&self, inside_px: f32) -> Option<[f32; 3]> {
        let [grows, right, down] = self.shift_px;
        let grows = grows + inside_px;
        let is_off = grows.abs() > ROUGH_PX || right.hypot(down) > ROUGH_PX;
        is_off.then_some([grows, right, down])
    }

    /// Whether the edge lies where most others do.
    pub(super) fn agrees_at(&self, turn: f32) -> bool {
        self.agrees[sector_of(turn)]
    }
}

fn sector_of(turn: f32) -> usize {
    (turn * SECTORS as f32) as usize % SECTORS
}

/// The middle of a sector, as a share of the turn.
fn turn_of(sector: usize) -> f32 {
    (sector as f32 + 0.5) / SECTORS as f32
}

/// The shift, in pixels outwards, at a share of the turn of an outline that grows and moves.
pub(super) fn shift_at([grows, right, down]: &[f32; 3], turn: f32) -> f32 {
    let (sin, cos) = libm::sincosf(turn * std::f32::consts::TAU);
    grows + right * cos + down * sin
}

/// Finds the shift of the edge in each sector; `None` where there is no clear edge.
fn edge_shifts(pixels: &[EdgePixel], surroundings: &Surroundings) -> [Option<f32>; SECTORS] {
    let mut sums = [[(0.0_f32, 0.0_f32); SHIFTS]; SECTORS];
    for pixel in pixels {
        let membership = surroundings.membership(pixel);
        if membership.is_nan() {
            continue;
        }
        let membership = membership.clamp(-0.5, 1.5);
        for (i, (squares, count)) in sums[sector_of(pixel.turn)].iter_mut().enumerate() {
            let shift_px = i as f32 / SHIFTS_PER_PX - REACH_PX;
            let off_px = pixel.distance_px - shift_px;
            if off_px.abs() <= NEAR_PX {
                let step = 0.5 * libm::erfcf(off_px / (BLUR_PX * std::f32::consts::SQRT_2));
                *squares += (membership - step).powi(2);
                *count += 1.0;
            }
        }
    }
    sums.map(|sums| {
        let residual = |&(squares, count): &(f32, f32)| squares / count.max(1e-3);
        let residuals = sums.each_ref().map(residual);
        let least = (0..SHIFTS).min_by(|&a, &b| residuals[a].total_cmp(&residuals[b]))?;
        let is_inside = least > 0 && least + 1 < SHIFTS;
        let is_clear = residuals[least] < MAX_RESIDUAL * MAX_RESIDUAL && sums[least].1 > 0.0;
        if !(is_inside && is_clear) {
            return None;
        }
        // The vertex of the parabola through the three least residuals.
        let [before, here, after] = [-1, 0, 1].map(|i| residuals[least.wrapping_add_signed(i)]);
        let bend = before - 2.0 * here + after;
        let vertex = if bend > 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
        Some((least as f32 + vertex.clamp(-0.5, 0.5)) / SHIFTS_PER_PX - REACH_PX)
    })
}

/// Fits growth and movement to the shifts of sectors; `None` if these lie too close together.
fn least_squares(shifts: &[(usize, f32)]) -> Option<[f32; 3]> {
    let mut normal = nalgebra::Matrix3::<f32>::zeros();
    let mut right = nalgebra::Vector3::<f32>::zeros();
    for &(sector, shift) in shifts {
        let (sin, cos) = libm::sincosf(turn_of(sector) * std::f32::consts::TAU);
        let row = nalgebra::Vector3::new(1.0, cos, sin);
        normal += row * row.transpose();
        right += row * shift;
    }
    // Three neighbouring sectors determine nothing.
    if normal.determinant() < 0.5 {
        return None;
    }
    Some(normal.try_inverse()?.transpose() * right).map(Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pixels around an outline drawn `off_px` away from the edge, of a body of which a share of the turn is hidden.
    fn pixels(off_px: impl Fn(f32) -> f32, hidden: std::ops::Range<f32>) -> Vec<EdgePixel> {
        let mut pixels = Vec::new();
        for i in 0..400 {
            let turn = i as f32 / 400.0;
            for step in -16..=16 {
                let distance_px = 0.5 * step as f32;
                let off = (distance_px - off_px(turn)) / 1.2;
                let share = if hidden.contains(&turn) { 0.0 } else { 0.5 * libm::erfcf(off) };
                let grain = ((i * 7 + step * 13) % 11) as f32 - 5.0;
                let yuv = [90.0 + 60.0 * share + grain, 110.0 - 50.0 * share, 100.0 + 90.0 * share];
                pixels.push(EdgePixel { yuv, distance_px, turn });
            }
        }
        pixels
    }

    #[test]
    fn outlines_drawn_too_wide_or_beside_the_body_are_aligned() {
        let off = |turn: f32| -1.4 + 0.8 * libm::cosf(turn * std::f32::consts::TAU);
        let alignment = Alignment::of(&pixels(off, 2.0..3.0)).unwrap();
        for turn in [0.1, 0.35, 0.8] {
            let shift = shift_at(&alignment.correction_px(0.0).unwrap(), turn);
            assert!((shift - off(turn)).abs() < 0.2, "{shift} {}", off(turn));
            assert!(alignment.agrees_at(turn));
        }
    }

    #[test]
    fn hidden_sectors_do_not_agree_and_move_nothing() {
        let alignment = Alignment::of(&pixels(|_| 0.0, 0.2..0.4)).unwrap();
        assert_eq!(alignment.correction_px(0.0), None);
        assert!(!alignment.agrees_at(0.3) && alignment.agrees_at(0.7));
        assert_eq!(Alignment::of(&pixels(|_| 0.0, 0.0..0.8)), None);
    }
}
