//! Straight lines by a Hough transform in polar coordinates.

/// Number of angles: one per degree.
const ANGLES: usize = 180;

/// A line of the points p with (cos a, sin a) · p = r.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PolarLine {
    /// The angle a in degrees, 0 to 179.
    pub(super) angle_deg: usize,
    /// The signed distance r of the line from the origin, in pixels, rounded towards zero.
    pub(super) offset_px: i32,
}

/// Finds the lines that at least `least_votes` points lie on, each with the most votes within `radius` cells of angle
/// and offset. The image has this size in pixels; points are columns and rows.
pub(super) fn lines(
    points: impl Iterator<Item = [u32; 2]>,
    (width, height): (u32, u32),
    least_votes: u32,
    radius: usize,
) -> Vec<PolarLine> {
    let largest_px = f64::from(width * width + height * height).sqrt() as i32;
    let offsets = 2 * largest_px as usize + 1;
    let directions: Vec<(f32, f32)> = (0..ANGLES)
        .map(|degrees| libm::sincosf((degrees as f32).to_radians()))
        .collect();
    let mut votes = Votes {
        offsets,
        counts: vec![0; offsets * ANGLES],
    };
    for [x, y] in points {
        for (angle, (sin, cos)) in directions.iter().enumerate() {
            let offset = (x as f32 * cos + y as f32 * sin) as i32 + largest_px;
            if let Ok(offset) = usize::try_from(offset)
                && offset < offsets
            {
                votes.counts[angle * offsets + offset] += 1;
            }
        }
    }
    let cells = (0..ANGLES).flat_map(|angle| (0..offsets).map(move |offset| (angle, offset)));
    cells
        .filter(|&(angle, offset)| votes.at(angle, offset) >= least_votes.max(1))
        .filter(|&(angle, offset)| votes.is_highest(angle, offset, radius))
        .map(|(angle_deg, offset)| PolarLine {
            angle_deg,
            offset_px: offset as i32 - largest_px,
        })
        .collect()
}

/// Votes by angle and offset.
struct Votes {
    offsets: usize,
    counts: Vec<u32>,
}

impl Votes {
    fn at(&self, angle: usize, offset: usize) -> u32 {
        self.counts[angle * self.offsets + offset]
    }

    /// Reports whether no cell within a radius has more votes. Of cells with equal votes, the one with the least offset,
    /// then the least angle, wins.
    fn is_highest(&self, angle: usize, offset: usize, radius: usize) -> bool {
        let own = self.at(angle, offset);
        let angles = angle.saturating_sub(radius)..(angle + radius + 1).min(ANGLES);
        angles.into_iter().all(|a| {
            let offsets = offset.saturating_sub(radius)..(offset + radius + 1).min(self.offsets);
            offsets.into_iter().all(|o| {
                let other = self.at(a, o);
                other < own || (other == own && (o, a) >= (offset, angle))
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_lines_of_a_row_and_a_column_of_points() {
        let row = (10..42).map(|x| [x, 40]);
        let column = (5..38).map(|y| [30, y]);
        let found = lines(row.chain(column), (100, 80), 30, 3);
        let line = |angle_deg, offset_px| PolarLine {
            angle_deg,
            offset_px,
        };
        // The whole row also rounds to 39 px at 91 degrees, and of equal votes the least offset wins. The column is found
        // again near 180 degrees, with the opposite normal.
        assert_eq!(found, [line(0, 30), line(91, 39), line(179, -29)]);
    }

    #[test]
    fn ignores_too_few_points() {
        assert_eq!(lines((0..20).map(|x| [x, x]), (100, 80), 21, 3), []);
        assert_eq!(lines(std::iter::empty(), (100, 80), 0, 3), []);
    }
}
