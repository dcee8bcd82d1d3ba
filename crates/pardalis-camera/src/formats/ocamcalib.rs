//! `OCamCalib`'s `calib_results.txt`: five lists of numbers between comments.
//!
//! The toolbox counts x along the rows from top to bottom and y along the columns, its camera looks along −z: its point (x, y, z) is
//! (y, x, −z) in our axes, and its centre "row, column" is (cy, cx). `camera::Ocam` holds the polynomial in these terms.

use nalgebra::{DMatrix, DVector};

use super::document::fault_at;
use super::written;
use crate::pose::CalibratedCamera;
use crate::{Camera, Ocam};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// The most coefficients of the inverse polynomial, which the toolbox allows up to 64.
const MAX_INVERSE: usize = 20;

/// How well the inverse polynomial must do, in pixels, as the toolbox asks.
const INVERSE_TOLERANCE_PX: f64 = 0.01;

/// Sizes of the lists: the longest that the toolbox's own reader takes.
const MAX_COEFFICIENTS: usize = 64;

/// The numbers of the file with their lines, without the comments.
struct Numbers<'a> {
    words: Vec<(usize, &'a str)>,
    next: usize,
    last_line: usize,
}

impl<'a> Numbers<'a> {
    fn of(text: &'a str) -> Self {
        let words = text
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim_start().starts_with('#'))
            .flat_map(|(i, line)| line.split_ascii_whitespace().map(move |word| (i + 1, word)))
            .collect();
        Self {
            words,
            next: 0,
            last_line: text.lines().count().max(1),
        }
    }

    /// The next number and its line.
    fn number(&mut self, what: &str) -> Result<(usize, f64), Error> {
        let Some(&(line, word)) = self.words.get(self.next) else {
            return Err(fault_at(
                self.last_line,
                format!("the file ends before {what}"),
            ));
        };
        self.next += 1;
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok((line, number)),
            _ => Err(fault_at(
                line,
                format!(
                    "{what}: is \"{}\"; allowed: a finite number",
                    word.chars().take(40).collect::<String>()
                ),
            )),
        }
    }

    fn several<const N: usize>(&mut self, what: &str) -> Result<(usize, [f64; N]), Error> {
        let mut values = [0.0; N];
        let mut line = 1;
        for value in &mut values {
            (line, *value) = self.number(what)?;
        }
        Ok((line, values))
    }

    fn whole(&mut self, what: &str, max: usize) -> Result<usize, Error> {
        let (line, number) = self.number(what)?;
        if number.fract() == 0.0 && number >= 1.0 && number <= max as f64 {
            return Ok(number as usize);
        }
        Err(fault_at(
            line,
            format!("{what}: is {number}; allowed: a whole number from 1 to {max}"),
        ))
    }

    /// A count and as many numbers.
    fn counted(&mut self, what: &str) -> Result<(usize, Vec<f64>), Error> {
        let count = self.whole(&format!("the count of {what}"), MAX_COEFFICIENTS)?;
        let mut values = Vec::with_capacity(count);
        let mut line = 1;
        for _ in 0..count {
            let (at, value) = self.number(what)?;
            line = at;
            values.push(value);
        }
        Ok((line, values))
    }
}

/// The camera of a file. The inverse polynomial is passed over: it follows from the other.
pub(super) fn read(text: &str) -> Result<Vec<CalibratedCamera>, Error> {
    let mut numbers = Numbers::of(text);
    let (line, polynomial) = numbers.counted("the direct polynomial")?;
    numbers.counted("the inverse polynomial")?;
    let (_, [row, column]) = numbers.several("the centre")?;
    let (_, affine) = numbers.several("the affine parameters")?;
    let height = numbers.whole("the image's height", MAX_IMAGE_SIDE_PX)?;
    let width = numbers.whole("the image's width", MAX_IMAGE_SIDE_PX)?;
    if let Some((line, word)) = numbers.words.get(numbers.next) {
        let word: String = word.chars().take(40).collect();
        return Err(fault_at(
            *line,
            format!("\"{word}\" stands after the image's size, where the file should end"),
        ));
    }
    let radius = farthest_corner_px([column, row], affine, (width, height));
    let camera = Ocam::new(&polynomial, [column, row], affine, radius)
        .map_err(|error| fault_at(line, error.to_string()))?;
    Ok(vec![CalibratedCamera {
        name: "camera".to_owned(),
        camera: Camera::Ocam(camera),
        size_px: Some((width, height)),
        world_from_camera: None,
    }])
}

/// The radius of the image's farthest corner on the sensor, which bounds the model: files give no other bound.
fn farthest_corner_px(
    [cx, cy]: [f64; 2],
    [c, d, e]: [f64; 3],
    (width, height): (usize, usize),
) -> f64 {
    let determinant = c - d * e;
    let mut radius: f64 = 0.0;
    for u in [-0.5, width as f64 - 0.5] {
        for v in [-0.5, height as f64 - 0.5] {
            let (du, dv) = (u - cx, v - cy);
            let (x, y) = ((c * du - e * dv) / determinant, (dv - d * du) / determinant);
            radius = radius.max((x * x + y * y).sqrt());
        }
    }
    radius
}

/// The text of one camera. A pose is left out.
pub(super) fn write(camera: &CalibratedCamera) -> Result<String, Error> {
    let (width, height) = written::size_px(camera)?;
    let Camera::Ocam(model) = &camera.camera else {
        unreachable!("Format::holds was asked before");
    };
    let [cx, cy, c, d, e] = written::parameters(&camera.camera, ["cx_px", "cy_px", "c", "d", "e"]);
    let list = |values: &[f64]| {
        let words: Vec<_> = values.iter().map(|&v| written::number(v)).collect();
        words.join(" ")
    };
    let direct = model.polynomial();
    let inverse = inverse_polynomial(direct, model.max_radius_px());
    Ok(format!(
        "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). These are used by cam2world\n\n\
         {} {}\n\n\
         #polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). These are used by world2cam\n\n\
         {} {}\n\n\
         #center: \"row\" and \"column\", starting from 0 (C convention)\n\n{}\n\n\
         #affine parameters \"c\", \"d\", \"e\"\n\n{}\n\n\
         #image size: \"height\" and \"width\"\n\n{height} {width}\n\n",
        direct.len(),
        list(direct),
        inverse.len(),
        list(&inverse),
        list(&[cy, cx]),
        list(&[c, d, e]),
    ))
}

/// The polynomial that gives ρ from the toolbox's angle θ = atan(f(ρ)/ρ), by least squares over the radii up to `max_radius_px`: the
/// shortest that stays within [`INVERSE_TOLERANCE_PX`], or else the best.
fn inverse_polynomial(direct: &[f64], max_radius_px: f64) -> Vec<f64> {
    const SAMPLES: usize = 400;
    let f = |rho: f64| direct.iter().rev().fold(0.0, |sum, a| sum * rho + a);
    let radii = (0..SAMPLES).map(|i| max_radius_px * i as f64 / (SAMPLES - 1) as f64);
    let samples = radii.map(|rho| (rho, libm::atan2(f(rho), rho)));
    // As far as the angle grows, beyond which no polynomial can be right.
    let mut last = f64::NEG_INFINITY;
    let growing = samples.take_while(|&(_, angle)| std::mem::replace(&mut last, angle) < angle);
    let (radii, angles): (Vec<f64>, Vec<f64>) = growing.unzip();
    let radii = DVector::from_vec(radii);
    let mut best = (f64::INFINITY, Vec::new());
    for count in 1..=MAX_INVERSE.min(radii.len()) {
        let powers = DMatrix::from_fn(radii.len(), count, |i, j| angles[i].powi(j as i32));
        let Ok(solution) = powers.clone().svd(true, true).solve(&radii, 1e-14) else {
            continue;
        };
        let error_px = (&powers * &solution - &radii).amax();
        if error_px < best.0 {
            best = (error_px, solution.iter().copied().collect());
        }
        if error_px < INVERSE_TOLERANCE_PX {
            break;
        }
    }
    best.1
}
