//! Conversion of sRGB to linear light.

/// Converts sRGB (0 to 255) to linear red, green and blue (0 to 1) according to IEC 61966-2-1.
pub fn linear_from_srgb(srgb: [f64; 3]) -> [f64; 3] {
    srgb.map(|level| {
        let v = level / 255.0;
        if v <= 0.040_45 {
            v / 12.92
        } else {
            libm::pow((v + 0.055) / 1.055, 2.4)
        }
    })
}
