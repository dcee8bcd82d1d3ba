//! `OCamCalib`'s `calib_results.txt`: five lists of numbers, separated by comments.
//!
//! In the toolbox, x points down in the image, y to the right, and the camera looks along −z: its
//! point (x, y, z) is (y, x, −z) in Pardalis' axes, and its centre "row, column" is (cy, cx).
//! [`Ocam`] documents the polynomial.

use nalgebra::{DMatrix, DVector};

use super::document::error_at;
use super::output;
use crate::pose::CalibratedCamera;
use crate::{Camera, Ocam};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// Largest number of coefficients of the inverse polynomial; the toolbox allows up to 64.
const MAX_INVERSE: usize = 20;

/// Required accuracy of the inverse polynomial, in pixels, as in the toolbox.
const INVERSE_TOLERANCE_PX: f64 = 0.01;

/// Largest number of coefficients, that of the toolbox's own reader.
const MAX_COEFFICIENTS: usize = 64;

/// The numbers of a file and their lines, without the comments.
struct Numbers<'a> {
    words: Vec<(usize, &'a str)>,
    next: usize,
    last_line: usize,
}

impl<'a> Numbers<'a> {
    fn parse(text: &'a str) -> Self {
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

    /// Returns the next number and its line.
    fn number(&mut self, what: &str) -> Result<(usize, f64), Error> {
        let Some(&(line, word)) = self.words.get(self.next) else {
            return Err(error_at(
                self.last_line,
                format!("the file ends before {what}"),
            ));
        };
        self.next += 1;
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok((line, number)),
            _ => Err(error_at(
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
        Err(error_at(
            line,
            format!("{what}: is {number}; allowed: a whole number from 1 to {max}"),
        ))
    }

    /// Returns the line and values of a list that starts with its length.
    fn counted(&mut self, what: &str) -> Result<(usize, Vec<f64>), Error> {
        let count = self.whole(&format!("the number of values of {what}"), MAX_COEFFICIENTS)?;
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

/// Reads the camera of a file. The inverse polynomial is ignored: the direct polynomial determines
/// it.
pub(super) fn read(text: &str) -> Result<Vec<CalibratedCamera>, Error> {
    let mut numbers = Numbers::parse(text);
    let (line, polynomial) = numbers.counted("the direct polynomial")?;
    numbers.counted("the inverse polynomial")?;
    let (_, [row, column]) = numbers.several("the centre")?;
    let (_, affine) = numbers.several("the affine parameters")?;
    let height = numbers.whole("the image's height", MAX_IMAGE_SIDE_PX)?;
    let width = numbers.whole("the image's width", MAX_IMAGE_SIDE_PX)?;
    if let Some((line, word)) = numbers.words.get(numbers.next) {
        let word: String = word.chars().take(40).collect();
        return Err(error_at(
            *line,
            format!("unexpected \"{word}\" after the image's size, where the file should end"),
        ));
    }
    let radius = farthest_corner_px([column, row], affine, (width, height));
    let camera = Ocam::new(&polynomial, [column, row], affine, radius)
        .map_err(|error| error_at(line, error.to_string()))?;
    Ok(vec![CalibratedCamera {
        name: "camera".to_owned(),
        camera: Camera::Ocam(camera),
        size_px: Some((width, height)),
        world_from_camera: None,
    }])
}

/// Returns the radius of the image's farthest corner on the sensor. It limits the model, since
/// files contain no other limit.
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

/// Returns the text of one camera, without its pose.
pub(super) fn write(camera: &CalibratedCamera) -> Result<String, Error> {
    let (width, height) = output::size_px(camera)?;
    let Camera::Ocam(model) = &camera.camera else {
        unreachable!("`write` checks the model with `Format::holds`");
    };
    let [cx, cy, c, d, e] = output::parameters(&camera.camera, ["cx_px", "cy_px", "c", "d", "e"]);
    let list = |values: &[f64]| {
        let words: Vec<_> = values.iter().map(|&v| output::number(v)).collect();
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

/// Returns the polynomial from the toolbox's angle θ = atan(f(ρ)/ρ) to ρ, by least squares over the
/// radii up to `max_radius_px`: the shortest one within [`INVERSE_TOLERANCE_PX`], or else the best
/// one.
fn inverse_polynomial(direct: &[f64], max_radius_px: f64) -> Vec<f64> {
    const SAMPLES: usize = 400;
    let f = |rho: f64| direct.iter().rev().fold(0.0, |sum, a| sum * rho + a);
    let radii = (0..SAMPLES).map(|i| max_radius_px * i as f64 / (SAMPLES - 1) as f64);
    let samples = radii.map(|rho| (rho, libm::atan2(f(rho), rho)));
    // Use the radii up to which the angle increases; beyond, no polynomial fits.
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
