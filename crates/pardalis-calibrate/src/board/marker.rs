//! Square markers: dictionaries, and reading a marker in a square of the lattice.

use pardalis_images::GrayImage;

use super::saddle::brightness;

/// The dictionaries, one per line. The file's header describes the format.
const DICTIONARIES: &str = include_str!("dictionaries.txt");

/// Least difference between the brightest and the darkest module, in grey levels of 255.
const MIN_CONTRAST: f64 = 15.0;

/// Greatest fraction of the border's modules that may be light.
const MAX_BORDER_ERRORS: f64 = 0.1;

/// A set of markers that differ in their modules.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Dictionary {
    /// OpenCV's name, such as `DICT_4X4_50`.
    pub(super) name: &'static str,
    /// Number of modules along a side, without the border.
    side: usize,
    /// Number of wrong modules that are corrected.
    corrected: u32,
    /// Modules of each marker, row by row from the top left. The first is the highest bit; 1 is white.
    codes: Vec<u64>,
}

/// A marker that was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reading {
    /// Number of the marker in its dictionary.
    pub(super) id: usize,
    /// Number of clockwise quarter turns from the given corners to the upright marker.
    pub(super) turns: usize,
}

/// Returns the names of all dictionaries.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    lines().filter_map(|line| line.split(' ').next())
}

/// Returns the lines of the dictionary file without its header.
fn lines() -> impl Iterator<Item = &'static str> {
    DICTIONARIES.lines().filter(|line| !line.starts_with('#'))
}

impl Dictionary {
    /// Returns the dictionary of this name; `None` if there is none.
    pub(super) fn named(name: &str) -> Option<Self> {
        let line = lines().find(|line| line.split(' ').next() == Some(name))?;
        let mut fields = line.split(' ');
        Some(Self {
            name: fields.next()?,
            side: fields.next()?.parse().ok()?,
            corrected: fields.next()?.parse().ok()?,
            codes: fields
                .map(|code| u64::from_str_radix(code, 16).ok())
                .collect::<Option<_>>()?,
        })
    }

    /// Returns the number of modules along a side, without the border.
    pub(super) fn side(&self) -> usize {
        self.side
    }

    /// Reports whether this module of an upright marker is white.
    pub(super) fn is_light(&self, id: usize, row: usize, column: usize) -> bool {
        let module = row * self.side + column;
        self.codes[id] >> (self.side * self.side - 1 - module) & 1 == 1
    }

    /// Returns the number of markers.
    pub(super) fn len(&self) -> usize {
        self.codes.len()
    }

    /// Reads the marker in a square with these corners in pixels, clockwise from the square's own top left.
    ///
    /// `fraction` is the side of the marker divided by the side of the square, `border` the width of its dark border in
    /// modules.
    pub(super) fn read(
        &self,
        image: &GrayImage,
        corners: [[f64; 2]; 4],
        fraction: f64,
        border: usize,
    ) -> Option<Reading> {
        let modules = self.side + 2 * border;
        let to_image = square_to(corners)?;
        let light: Vec<f64> = (0..modules * modules)
            .map(|module| {
                let position = |n: usize, shift: f64| {
                    0.5 + fraction * ((n as f64 + 0.5 + shift) / modules as f64 - 0.5)
                };
                let mut sum = 0.0;
                for (dx, dy) in [
                    (-0.2, -0.2),
                    (0.2, -0.2),
                    (0.0, 0.0),
                    (-0.2, 0.2),
                    (0.2, 0.2),
                ] {
                    let at = [
                        position(module % modules, dx),
                        position(module / modules, dy),
                    ];
                    sum += brightness(image, to_image(at));
                }
                sum / 5.0
            })
            .collect();
        let least = light.iter().copied().fold(f64::MAX, f64::min);
        let most = light.iter().copied().fold(f64::MIN, f64::max);
        if most - least < MIN_CONTRAST {
            return None;
        }
        let is_light =
            |row: usize, column: usize| light[row * modules + column] > f64::midpoint(least, most);
        let inside = border..border + self.side;
        let (mut border_modules, mut border_errors) = (0, 0);
        for row in 0..modules {
            for column in 0..modules {
                if !(inside.contains(&row) && inside.contains(&column)) {
                    border_modules += 1;
                    border_errors += usize::from(is_light(row, column));
                }
            }
        }
        if border_errors as f64 > MAX_BORDER_ERRORS * border_modules as f64 {
            return None;
        }
        // Each further quarter turn moves the bottom left to the top left.
        let last = self.side - 1;
        let turned = |turns: usize, row: usize, column: usize| {
            let (row, column) = match turns {
                0 => (row, column),
                1 => (last - column, row),
                2 => (last - row, last - column),
                _ => (column, last - row),
            };
            is_light(row + border, column + border)
        };
        (0..4).find_map(|turns| {
            let code = (0..self.side * self.side).fold(0, |code, module| {
                code << 1 | u64::from(turned(turns, module / self.side, module % self.side))
            });
            let id = self
                .codes
                .iter()
                .position(|other| (code ^ other).count_ones() <= self.corrected)?;
            Some(Reading { id, turns })
        })
    }
}

/// Returns the projective map from the unit square to four pixels, in the order (0, 0), (1, 0), (1, 1), (0, 1); `None` if
/// they are collinear.
fn square_to([a, b, c, d]: [[f64; 2]; 4]) -> Option<impl Fn([f64; 2]) -> [f64; 2]> {
    let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let minus = |p: [f64; 2], q: [f64; 2]| [p[0] - q[0], p[1] - q[1]];
    let (u, v) = (minus(b, c), minus(d, c));
    let s = [a[0] - b[0] + c[0] - d[0], a[1] - b[1] + c[1] - d[1]];
    let area = cross(u, v);
    if area.abs() < 1.0 {
        return None;
    }
    let (g, h) = (cross(s, v) / area, cross(u, s) / area);
    let along = |n: usize| b[n] - a[n] + g * b[n];
    let down = |n: usize| d[n] - a[n] + h * d[n];
    let (along, down) = ([along(0), along(1)], [down(0), down(1)]);
    Some(move |[x, y]: [f64; 2]| {
        let w = g * x + h * y + 1.0;
        [
            (along[0] * x + down[0] * y + a[0]) / w,
            (along[1] * x + down[1] * y + a[1]) / w,
        ]
    })
}
